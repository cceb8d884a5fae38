//! The contract between a method and the rest of the program: what a method is ([`Method`]), and what it is asked to do ([`Plan`]).

use super::cost::Cost;
use super::laws::Deviation;
use super::target::{MAX_VIEWS, Target};
use crate::error::Error;
use crate::gpu::Gpu;
use crate::image::Image;
use crate::lens::Optics;
use crate::scene::{Effect, EffectKind, Extrapolation, Inputs, Scene, Workload};
use crate::settings::{ParameterTable, Parameters};
use serde::{Serialize, Serializer};
use std::fmt;

/// What a method is, for `thinlens methods`, the README and the laws.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MethodInfo {
    /// The name of `--method`, which tells methods apart.
    pub name: &'static str,
    /// The publication or program that it follows.
    pub source: &'static str,
    /// What it is there for.
    pub role: Role,
    /// One sentence.
    pub summary: &'static str,
    /// The passes that it has, of those that a method may lack ([`EffectKind::is_pass`]); a plan switches off all others.
    pub effects: &'static [EffectKind],
    /// The parameter that has the number of lens samples a pixel; `None` for a method that does not sample the lens.
    pub lens_samples: Option<&'static str>,
    /// Settings from rough and fast to fine and slow, as they follow the name of a candidate: what a comparison runs.
    pub steps: &'static [&'static str],
    /// The laws that it breaks by design.
    pub deviations: &'static [Deviation],
}

impl MethodInfo {
    /// A method of a library's user: without passes that it may lack, lens samples, steps or deviations. What it has of these is
    /// added: `MethodInfo { steps: &["kept=0.5", "kept=1"], ..MethodInfo::new("dim", "the picture, dimmed") }`.
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

/// What a method is there for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Role {
    /// What `auto` chooses.
    Default,
    /// The truth that other methods are measured by.
    Reference,
    /// A published method.
    Paper,
    /// A published method that others compare themselves with.
    Baseline,
    /// A method of a library's user.
    Custom,
}

impl Role {
    /// Its name in lists.
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

/// Called now and then with the share of the work that is done, 0 … 1, from any thread.
pub type Progress<'a> = dyn Fn(f32) + Sync + 'a;

/// A way to put a lens on a stack.
///
/// Only [`Method::info`] and [`Method::blur`] must be written. Everything else that the program asks of a method is here too, so that one
/// folder holds all of it.
pub trait Method: fmt::Debug + Sync {
    /// What it is.
    fn info(&self) -> MethodInfo;

    /// Its parameters: the `[method.NAME]` table of presets.
    fn parameters(&self) -> ParameterTable {
        ParameterTable::none()
    }

    /// The decisions about passes of its own, those of [`MethodInfo::effects`] that are no matter of the scene or the lens.
    ///
    /// # Errors
    /// Parameters that contradict one another.
    fn decide(&self, _inputs: &Inputs<'_>, _parameters: &Parameters) -> Result<Vec<Effect>, Error> {
        Ok(Vec::new())
    }

    /// What carrying out `plan` costs, where the method can say so from the scene's statistics.
    fn cost(&self, _plan: &Plan, _workload: &Workload<'_>) -> Option<Cost> {
        None
    }

    /// The method as one that can be asked for single pixels with any number of lens samples; `None` for one that cannot.
    fn lens_sampling(&self) -> Option<&dyn LensSampling> {
        None
    }

    /// The picture of `scene` as `plan` asks for it, of the scene's picture size; [`render`](super::render) calls it only where there
    /// is something to blur. The scene is given away: it is the larger part of all memory, and a method may work in it.
    ///
    /// # Errors
    /// When a device fails; on the CPU a method that has a plan succeeds.
    fn blur(&self, scene: Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error>;

    /// The method on a GPU; `None` for one that runs on the CPU alone.
    #[doc(hidden)]
    fn gpu(&self) -> Option<&dyn GpuBackend> {
        None
    }
}

impl dyn Method + '_ {
    /// Its name.
    pub fn name(&self) -> &'static str {
        self.info().name
    }

    /// Whether it samples the lens, so that a number of views means something to it.
    pub fn samples_lens(&self) -> bool {
        self.info().lens_samples.is_some()
    }

    /// Lens samples a pixel by its own parameters; `None` for a method that does not sample the lens.
    pub fn lens_samples(&self, parameters: &Parameters) -> Option<usize> {
        let key = self.info().lens_samples?;
        parameters.table()[key].as_u64().map(|samples| samples as usize)
    }
}

/// Methods are told apart by name.
impl PartialEq for dyn Method + '_ {
    fn eq(&self, other: &Self) -> bool {
        self.name() == other.name()
    }
}

impl Eq for dyn Method + '_ {}

/// A method is its name.
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

/// A method on a GPU: the same picture by the same plan.
#[doc(hidden)]
pub trait GpuBackend: fmt::Debug + Sync {
    /// The picture that [`Method::blur`] makes, to within what both round. The scene stays as it is: where the GPU fails, the CPU
    /// starts again from it.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Device`] when the device fails or has too little memory.
    fn blur(&self, gpu: &Gpu, scene: &Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error>;

    /// The shader that it runs.
    #[cfg(feature = "gpu")]
    fn shader(&self) -> &'static crate::gpu::Shader;
}

/// A method that samples the lens as often as it is asked to.
pub trait LensSampling {
    /// Prepares to render `scene` as `plan` has it, whatever number of views it names.
    fn begin<'p>(&self, scene: Scene, plan: &'p Plan) -> Box<dyn Sampler + 'p>;

    /// By how many dB 16 lens samples better the picture of one ray, and √2 times as many once more: means over scenes, for a
    /// first guess. Those of methods that follow rays, unless a method has its own.
    fn gain_db(&self) -> [f64; 2] {
        [15.0, 1.8]
    }
}

/// A lens-sampling method at work on a scene.
pub trait Sampler {
    /// What the picture with `views` lens samples has at `pixels`, `y · width + x` each, to within rounding. Intermediate results are
    /// kept for the next call with as many views.
    fn pixels(&mut self, views: usize, pixels: &[usize]) -> Vec<[f32; 4]>;

    /// The picture with `views` lens samples.
    fn picture(self: Box<Self>, views: usize, progress: &Progress<'_>) -> Image;
}

/// What a method is to do: a pure function of statistics and settings, and the only thing it reads beside the scene.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Plan {
    /// The method that carries it out.
    pub method: &'static dyn Method,
    /// Why this method.
    pub method_reason: String,
    /// Lens samples a pixel; `None` for a method that does not sample the lens. Where there is a target, the method's own number
    /// until the one that reaches it is found.
    pub views: Option<usize>,
    /// What the number of views is to reach, where it is not given.
    #[serde(rename = "goal")]
    pub target: Option<Target>,
    /// Why this number of views, or this target.
    pub views_reason: String,
    /// Where in the pixel the views lie, as a share of its width: 1 for samples at points, less for colours that are
    /// averages over the pixel already.
    pub jitter: f32,
    /// Width of the square that a fragment stands for, in picture pixels; 0 when its colour is an average over the pixel,
    /// which has softened every edge already.
    pub fragment_px: f32,
    /// What rays know of the lens beside its focus: the aperture's shape, the barrel, aberrations.
    pub optics: Optics,
    /// The same with all that was requested, whether it shows or not.
    #[serde(skip)]
    pub optics_requested: Optics,
    /// Smallest and largest signed CoC radius in picture pixels.
    pub coc_range_px: [f32; 2],
    /// How highlights are extrapolated, where they are.
    pub extrapolation: Extrapolation,
    /// Every effect, on or off.
    pub effects: Vec<Effect>,
    /// The method's own parameters.
    pub parameters: Parameters,
}

impl Plan {
    /// The most lens samples a pixel: the error of this many is below what a half float can hold.
    pub const MAX_VIEWS: usize = MAX_VIEWS;

    /// Lens samples a pixel, for a method that samples the lens.
    ///
    /// # Panics
    /// If the plan is for one that does not.
    pub fn lens_samples(&self) -> usize {
        self.views.expect("a plan for a method that samples the lens says how often")
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

    /// Whether the plan asks for `kind`.
    pub fn does(&self, kind: EffectKind) -> bool {
        self.effects.iter().any(|effect| effect.name == kind && effect.on)
    }

    /// The number that `kind` works with, if the plan asks for it and it has one.
    pub fn strength(&self, kind: EffectKind) -> Option<f32> {
        self.effects.iter().find(|effect| effect.name == kind && effect.on)?.strength
    }

    /// The same plan with `kind` switched on or off, whatever the statistics say.
    #[must_use]
    pub fn forced(mut self, kind: EffectKind, on: bool) -> Self {
        self.effects.iter_mut().filter(|effect| effect.name == kind).for_each(|effect| effect.force(on));
        self.with_lens_effects()
    }

    /// The plan with the optics that its effects leave.
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
