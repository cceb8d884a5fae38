//! The interface between methods and the rest of the program: what a method is ([`Method`]), and what it has to do ([`Plan`]).

use super::cost::Cost;
use super::laws::Deviation;
use super::target::{MAX_VIEWS, Target};
use crate::error::Error;
use crate::gpu::Gpu;
use crate::image::Image;
use crate::lens::Optics;
use crate::scene::{
    Background, Effect, EffectKind, EnvironmentShading, Extrapolation, Inputs, Scene, Workload,
};
use crate::settings::{ParameterTable, Parameters};
use serde::{Serialize, Serializer};
use std::borrow::Cow;
use std::fmt;
use std::sync::Arc;

/// Description of a method, for `thinlens methods`, the documentation and the laws.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MethodInfo {
    /// Unique name, as the setting `method` takes it.
    pub name: &'static str,
    /// The publication or program that the method implements.
    pub source: &'static str,
    /// Its role in the program.
    pub role: Role,
    /// One-sentence summary.
    pub summary: &'static str,
    /// Optional passes ([`EffectKind::is_pass`]) that the method implements; a plan switches off all others.
    pub effects: &'static [EffectKind],
    /// Key of the parameter that holds the number of lens samples per pixel; `None` for a method that does not sample the lens.
    pub lens_samples: Option<&'static str>,
    /// Quality levels that a comparison runs, from fast to accurate, in the syntax that follows the method's name in a candidate.
    pub steps: &'static [&'static str],
    /// The laws that the method breaks by design.
    pub deviations: &'static [Deviation],
}

impl MethodInfo {
    /// Description of a method of a library's user, without optional passes, lens samples, quality levels or deviations. What it has of
    /// these is added: `MethodInfo { steps: &["kept=0.5", "kept=1"], ..MethodInfo::new("dim", "the picture, dimmed") }`.
    pub const fn new(name: &'static str, summary: &'static str) -> Self {
        Self {
            name,
            source: "own method",
            role: Role::Custom,
            summary,
            effects: &[],
            lens_samples: None,
            steps: &[],
            deviations: &[],
        }
    }
}

/// Role of a method in the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Role {
    /// The method that `auto` selects.
    Default,
    /// Ground truth that other methods are compared with.
    Reference,
    /// A published method.
    Paper,
    /// A published method that papers use as a baseline.
    Baseline,
    /// A method added by a user of the library.
    Custom,
}

impl Role {
    /// Name in listings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Default => "default",
            Self::Reference => "reference",
            Self::Paper => "paper",
            Self::Baseline => "baseline",
            Self::Custom => "custom",
        }
    }
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// Progress callback: called from any thread with the fraction of the work that is done, 0 … 1.
pub type Progress<'a> = dyn Fn(f32) + Sync + 'a;

/// A depth-of-field method.
///
/// Only [`Method::info`] and [`Method::blur`] are required. The other functions have defaults; they are part of the trait so that
/// everything about a method is in one folder.
pub trait Method: fmt::Debug + Sync {
    /// Description of the method.
    fn info(&self) -> MethodInfo;

    /// Parameters of the method: the `[method.NAME]` table of presets.
    fn parameters(&self) -> ParameterTable {
        ParameterTable::none()
    }

    /// Decides the passes of [`MethodInfo::effects`] that depend neither on the scene alone nor on the lens.
    ///
    /// # Errors
    /// Parameters that contradict each other.
    fn decide(&self, _inputs: &Inputs<'_>, _parameters: &Parameters) -> Result<Vec<Effect>, Error> {
        Ok(Vec::new())
    }

    /// Cost of executing `plan`; `None` where the method cannot predict it from the scene's statistics.
    fn cost(&self, _plan: &Plan, _workload: &Workload<'_>) -> Option<Cost> {
        None
    }

    /// Number of rows above and below a pixel of a picture by `plan` on which its value depends, where fragments contribute to pixels within
    /// `reach_px` picture pixels. `None` for a method whose pixels depend on the whole picture: its frames are not rendered in bands of rows,
    /// and have to fit into memory.
    fn rows_around(&self, _plan: &Plan, _reach_px: usize) -> Option<usize> {
        None
    }

    /// The method as a sampler of single pixels with any number of lens samples; `None` where it has none.
    fn lens_sampling(&self) -> Option<&dyn LensSampling> {
        None
    }

    /// Renders `scene` by `plan`, at the scene's picture size.
    ///
    /// [`render`](super::render) calls it only where the plan blurs. The scene is passed by value: it takes most of the memory,
    /// and a method may work in place.
    ///
    /// # Errors
    /// When a device fails; on the CPU a method with a valid plan succeeds.
    fn blur(&self, scene: Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error>;

    /// GPU backend; `None` for a method that runs on the CPU only.
    #[doc(hidden)]
    fn gpu(&self) -> Option<&dyn GpuBackend> {
        None
    }
}

impl dyn Method + '_ {
    /// Name of the method.
    pub fn name(&self) -> &'static str {
        self.info().name
    }

    /// Whether the method samples the lens, so that a number of views has an effect.
    pub fn samples_lens(&self) -> bool {
        self.info().lens_samples.is_some()
    }

    /// Lens samples per pixel set by the method's parameters; `None` for a method that does not sample the lens.
    pub fn lens_samples(&self, parameters: &Parameters) -> Option<usize> {
        let key = self.info().lens_samples?;
        parameters.table()[key].as_u64().map(|samples| samples as usize)
    }
}

/// Methods are equal if their names are.
impl PartialEq for dyn Method + '_ {
    fn eq(&self, other: &Self) -> bool {
        self.name() == other.name()
    }
}

impl Eq for dyn Method + '_ {}

/// A method is serialized as its name.
impl Serialize for dyn Method + '_ {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl fmt::Display for dyn Method + '_ {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// GPU implementation of a method: the same picture from the same plan.
#[doc(hidden)]
pub trait GpuBackend: fmt::Debug + Sync {
    /// Renders the picture of [`Method::blur`], equal to within rounding. The scene is borrowed: if the GPU fails, the CPU
    /// renders from it.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Device`] when the device fails or has too little memory.
    fn blur(&self, gpu: &Gpu, scene: &Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error>;

    /// The backend's shader.
    #[cfg(feature = "gpu")]
    fn shader(&self) -> &'static crate::gpu::Shader;
}

/// A method that renders with any number of lens samples.
pub trait LensSampling {
    /// Prepares to render `scene` by `plan`; the plan's number of views is not used.
    fn begin<'p>(&self, scene: Scene, plan: &'p Plan) -> Box<dyn Sampler + 'p>;

    /// PSNR gain in dB of 16 lens samples over one, and of each further factor √2: means over scenes, used for a first estimate.
    /// The default holds for methods that follow rays.
    fn gain_db(&self) -> [f64; 2] {
        [15.0, 1.8]
    }

    /// The part of `scene` that the lens samples of `plan` render: all of it, except for lights that the method adds to its picture
    /// exactly ([`LensSampling::exact_lights`]).
    fn sampled<'s>(&self, scene: &'s Scene, _plan: &Plan) -> Cow<'s, Scene> {
        Cow::Borrowed(scene)
    }

    /// The lights that are not in [`LensSampling::sampled`], as the picture of `scene` by `plan` has them before
    /// [`LensSampling::filter`]; `None` where there are none.
    fn exact_lights(&self, _scene: &Scene, _plan: &Plan) -> Option<Image> {
        None
    }

    /// The filter that ends the picture of `scene` by `plan`, if there is one.
    fn filter(&self, _scene: &Scene, _plan: &Plan) -> Option<Box<dyn PixelFilter>> {
        None
    }
}

/// A filter over each pixel of a picture and its four neighbours. It is part of the method and no error of its lens samples, so that the
/// truth that they are measured against is filtered too.
pub trait PixelFilter: fmt::Debug + Send + Sync {
    /// How far a fragment of the CoC radius `coc_px`, in picture pixels, counts as in focus: 0 … 1.
    fn focus(&self, coc_px: f32) -> f32;

    /// The value of `pixel`, `y · width + x`, from its `own` value and those `around` it ([`crate::image::neighbours`]); `share` is the
    /// mean over its rays of how far what they hit is in focus. Equal to `own` where `share` is 0.
    fn filtered(&self, pixel: usize, share: f32, own: [f32; 4], around: [[f32; 4]; 4]) -> [f32; 4];
}

/// A lens-sampling method with a scene.
pub trait Sampler {
    /// Values at `pixels`, each `y · width + x`, of the picture of [`LensSampling::sampled`] with `views` lens samples, to within
    /// rounding. Intermediate results are cached for the next call with the same `views`.
    fn pixels(&mut self, views: usize, pixels: &[usize]) -> Vec<[f32; 4]>;

    /// Renders the picture with `views` lens samples, with its lights.
    fn picture(self: Box<Self>, views: usize, progress: &Progress<'_>) -> Image;
}

/// What a ray counts as that passes all layers and does not end in the background: the stack has nothing there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum LostRays {
    /// It is left out of the mean.
    LeftOut,
    /// It hits an opaque black surface, so that lost rays are visible.
    Black,
}

/// What a method has to do: a pure function of statistics and settings. A method reads nothing else beside the scene.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Plan {
    /// The method that executes the plan.
    pub method: &'static dyn Method,
    /// Reason for the method.
    pub method_reason: String,
    /// Lens samples per pixel; `None` for a method that does not sample the lens. With a target: the method's default until the
    /// search has found the number that reaches it.
    pub views: Option<usize>,
    /// What the number of views has to reach, where the number is not fixed.
    #[serde(rename = "goal")]
    pub target: Option<Target>,
    /// Reason for the number of views or the target.
    pub views_reason: String,
    /// Extent of the views' positions in a pixel whose colours are averages over it, as a fraction of its width: less than the 1 of point
    /// samples, because averages are filtered already. See [`Plan::jitter`].
    pub averages_jitter: f32,
    /// Width of the square that such an average represents, in picture pixels: 0, because its edges are antialiased already, or the width
    /// of a sample of a supersampled stack. A point sample represents a pixel.
    pub averages_px: f32,
    /// Lens properties that rays use beside focus: aperture shape, barrel, aberrations.
    pub optics: Optics,
    /// The same as requested, including effects too small to be visible.
    #[serde(skip)]
    pub optics_requested: Optics,
    /// Smallest and largest signed CoC radius in picture pixels.
    pub coc_range_px: [f32; 2],
    /// Lights that are blurred too little for exact discs, in picture pixels: lens samples render them with more noise than anything else.
    pub barely_blurred_lights: f64,
    /// Parameters of highlight extrapolation.
    pub extrapolation: Extrapolation,
    /// What rays count as that end where the stack has nothing.
    pub lost_rays: LostRays,
    /// The decision about every effect.
    pub effects: Vec<Effect>,
    /// The method's parameters.
    pub parameters: Parameters,
}

impl Plan {
    /// Maximum number of lens samples per pixel: the error of this many is below the precision of a half float.
    pub const MAX_VIEWS: usize = MAX_VIEWS;

    /// Lens samples per pixel, for a method that samples the lens.
    ///
    /// # Panics
    /// If the method does not sample the lens.
    pub fn lens_samples(&self) -> usize {
        self.views.expect("a plan for a method that samples the lens has a number of views")
    }

    /// The plan with another number of lens samples, and no target.
    #[must_use]
    pub fn with_views(&self, views: usize) -> Self {
        Self { views: Some(views), target: None, ..self.clone() }
    }

    /// The decision about `kind`.
    ///
    /// # Panics
    /// Never: a plan has a decision about every effect.
    pub fn effect(&self, kind: EffectKind) -> &Effect {
        let found = self.effects.iter().find(|effect| effect.name == kind);
        found.expect("a plan has a decision about every effect")
    }

    /// The background of `scene`, where the plan simulates it and it is visible.
    pub fn background(&self, scene: &Scene) -> Option<Arc<Background>> {
        scene.background.clone().filter(|_| self.does(EffectKind::TransparentBackground))
    }

    /// The environment that surfaces of `scene` reflect, where the plan shades it for each point of the lens.
    pub fn environment(&self, scene: &Scene) -> Option<Arc<EnvironmentShading>> {
        scene.environment.clone().filter(|_| self.does(EffectKind::Environment))
    }

    /// Extent of the views' positions in a pixel, as a fraction of its width, where the share `antialiased` of its colours are averages
    /// ([`crate::scene::Antialiasing`]).
    pub fn jitter(&self, antialiased: f32) -> f32 {
        1.0 - antialiased * (1.0 - self.averages_jitter)
    }

    /// Whether `kind` is on.
    pub fn does(&self, kind: EffectKind) -> bool {
        self.effects.iter().any(|effect| effect.name == kind && effect.on)
    }

    /// Strength of `kind`, if it is on and has one.
    pub fn strength(&self, kind: EffectKind) -> Option<f32> {
        self.effects.iter().find(|effect| effect.name == kind && effect.on)?.strength
    }

    /// The plan with `kind` forced on or off, independent of the statistics.
    #[must_use]
    pub fn forced(mut self, kind: EffectKind, on: bool) -> Self {
        self.effects.iter_mut().filter(|effect| effect.name == kind).for_each(|effect| effect.force(on));
        self.with_lens_effects()
    }

    /// The plan with its optics reduced to the effects that are on.
    pub(super) fn with_lens_effects(mut self) -> Self {
        let does = |kind| self.does(kind);
        let requested = &self.optics_requested;
        let strength = |kind, strength: f32| if does(kind) { strength } else { 0.0 };
        let colors = |kind, colors: [f32; 3]| if does(kind) { colors } else { [0.0; 3] };
        let (curved, squeezed) = (does(EffectKind::BladeCurvature), does(EffectKind::Squeeze));
        self.optics = Optics {
            aperture: requested.aperture.simplified(curved, squeezed),
            image: requested.image.clone().filter(|_| does(EffectKind::ApertureImage)),
            cats_eye: strength(EffectKind::CatsEye, requested.cats_eye),
            spherical_px: strength(EffectKind::SphericalAberration, requested.spherical_px),
            axial_px: colors(EffectKind::AxialColor, requested.axial_px),
            lateral_px: colors(EffectKind::LateralColor, requested.lateral_px),
            vignetting: strength(EffectKind::Vignetting, requested.vignetting),
        };
        self
    }
}
