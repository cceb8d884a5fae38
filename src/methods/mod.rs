//! BLUR: one trait, one registry, one file a method.
//!
//! A method reads a [`Scene`] and a [`Plan`] and returns a picture. It does no I/O, prints nothing, and decides nothing
//! that the plan could have decided. What several methods share is in `shared/`.

mod accumulate;
mod b_buffer;
mod gather;
mod laws;
mod layer_rays;
mod opaque_blur;
mod peel_rays;
mod point_splat;
mod pyramid_disocclusion;
mod recursive_gaussian;
mod scatter;
mod shared;
mod shear;

pub use accumulate::Volume;
pub use laws::{Deviation, Law};

use crate::error::Error;
use crate::gpu::Gpu;
use crate::image::{Image, Plane};
use crate::scene::{Abilities, EffectKind, Facts, Goal, Plan, Scene};
use crate::settings::{Effort, MethodParameters, Origin, Quality, Settings, Sourced, nearest};
use rayon::prelude::*;
use std::fmt;
use std::sync::atomic::{AtomicUsize, Ordering};

/// What a method is, for `thinlens methods`, the README and the laws.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct MethodInfo {
    /// The name of `--method`.
    pub name: &'static str,
    /// Where it comes from.
    pub source: &'static str,
    /// Default, reference, paper or baseline.
    pub role: &'static str,
    /// One sentence.
    pub summary: &'static str,
    /// The steps beside the blur itself that it has; a plan switches off all others.
    pub effects: &'static [EffectKind],
    /// Settings from rough and quick to fine and slow, as they follow the name of a contender: what a comparison runs.
    pub steps: &'static [&'static str],
    /// The laws that it breaks by design.
    pub deviations: &'static [Deviation],
}

/// Called now and then with the share of the work that is done, 0 … 1, from any thread.
pub type Progress<'a> = dyn Fn(f32) + Sync + 'a;

/// A way to put a lens on a stack.
pub trait Method: fmt::Debug + Sync {
    /// What it is.
    fn info(&self) -> MethodInfo;

    /// Lens samples a pixel where `--views` does not say; `None` for a method that does not sample the lens.
    fn lens_samples(&self, _parameters: &MethodParameters) -> Option<usize> {
        None
    }

    /// The method as one that can be asked for single pixels with any number of lens samples; `None` for one that cannot.
    fn lens_sampling(&self) -> Option<&dyn LensSampling> {
        None
    }

    /// The picture of `scene` as `plan` asks for it, of the scene's picture size; [`render`] calls it only where there is
    /// something to blur. The scene is given away: it is the larger part of all memory, and a method may work in it.
    ///
    /// # Errors
    /// When a device fails; on the CPU a method that has a plan succeeds.
    fn blur(&self, scene: Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error>;

    /// The method on a GPU; `None` for one that runs on the CPU alone.
    fn twin(&self) -> Option<&dyn Twin> {
        None
    }
}

/// A method on a GPU: the same picture by the same plan.
pub trait Twin: fmt::Debug + Sync {
    /// The picture that [`Method::blur`] makes, to within what both round. The scene stays as it is: where the GPU fails, it is
    /// needed once more.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Device`] when the device fails or has not the room.
    fn blur(&self, gpu: &Gpu, scene: &Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error>;

    /// The shader that it runs.
    #[cfg(feature = "gpu")]
    fn shader(&self) -> &'static crate::gpu::Shader;
}

/// A method that samples the lens as often as it is asked to.
pub trait LensSampling {
    /// Gets to work on `scene` as `plan` has it, whatever number of views it names.
    fn begin<'p>(&self, scene: Scene, plan: &'p Plan) -> Box<dyn Sampler + 'p>;

    /// By how many dB 16 lens samples better the picture of one ray, and √2 times as many once more: means over scenes, for a
    /// first guess. Those of methods that follow rays, unless a method has its own.
    fn gain_db(&self) -> [f64; 2] {
        [15.0, 1.8]
    }
}

/// A lens-sampling method at work on a scene.
pub trait Sampler {
    /// What the picture with `views` lens samples has at `pixels`, `y · width + x` each, to within rounding. What it takes is kept
    /// for the next call with as many views.
    fn pixels(&mut self, views: usize, pixels: &[usize]) -> Vec<[f32; 4]>;

    /// The picture with `views` lens samples.
    fn picture(self: Box<Self>, views: usize, progress: &Progress<'_>) -> Image;
}

/// Every method, in the order they are listed.
pub static METHODS: [&dyn Method; 11] = [
    &shear::Shear,
    &accumulate::Accumulate,
    &recursive_gaussian::RecursiveGaussian,
    &b_buffer::BBuffer,
    &point_splat::PointSplat,
    &layer_rays::LayerRays,
    &opaque_blur::OpaqueBlur,
    &peel_rays::PeelRays,
    &pyramid_disocclusion::PyramidDisocclusion,
    &gather::Gather,
    &scatter::Scatter,
];

/// The method called `name`; `auto` is the one of final quality.
///
/// # Errors
/// [`crate::error::ErrorKind::Settings`] for an unknown name, with the nearest known one.
pub fn by_name(name: &str) -> Result<&'static dyn Method, Error> {
    let wanted = if name == "auto" { Quality::Final.method() } else { name };
    METHODS.into_iter().find(|method| method.info().name == wanted).ok_or_else(|| {
        let known = METHODS.map(|method| method.info().name);
        let help = match nearest(name, &known) {
            Some(near) => format!("did you mean '{near}'? `thinlens methods` lists them"),
            None => format!("use auto, or one of {}", known.join(", ")),
        };
        Error::settings(format!("there is no method called '{name}'")).help(help)
    })
}

/// The method that `settings` ask for; `auto` is the one of the quality asked for.
///
/// # Errors
/// Those of [`by_name`].
pub fn chosen(settings: &Settings) -> Result<&'static dyn Method, Error> {
    match (settings.method.value.as_str(), settings.effort.value) {
        ("auto", Some(Effort::Quality(quality))) => by_name(quality.method()),
        (name, _) => by_name(name),
    }
}

/// Checks that `method` can follow an `effort` that a flag asks for. (A preset's is for whichever method can.)
fn check_effort(method: &dyn Method, effort: &Sourced<Option<Effort>>) -> Result<(), Error> {
    let Some(asked) = effort.value.filter(|_| effort.origin == Origin::Flag) else { return Ok(()) };
    let name = method.info().name;
    if method.lens_samples(&MethodParameters::default()).is_none() {
        return Err(Error::settings(format!("{name} does not sample the lens"))
            .with("found", asked.to_string())
            .help(format!("leave it out; `thinlens methods {name}` shows what the method has")));
    }
    if matches!(asked, Effort::Views(_)) || method.lens_sampling().is_some() {
        return Ok(());
    }
    let able = METHODS.iter().filter(|method| method.lens_sampling().is_some());
    let able: Vec<&str> = able.map(|method| method.info().name).collect();
    Err(Error::settings(format!("{name} cannot look for the number of samples that {asked} takes"))
        .help(format!("ask for a number with --views, or for a method that can: {}", able.join(", "))))
}

/// Decides what the method that `settings` ask for is to do about a scene that shows `facts`.
///
/// # Errors
/// Those of [`by_name`] and of [`Plan::decide`], and a flag that asks of the method what it cannot do.
pub fn plan(facts: &Facts, settings: &Settings) -> Result<Plan, Error> {
    let method = chosen(settings)?;
    check_effort(method, &settings.effort)?;
    let MethodInfo { name, effects, .. } = method.info();
    let lens_samples = method.lens_samples(&settings.parameters);
    let seeks = method.lens_sampling().is_some();
    Plan::decide(facts, settings, Abilities { method: name, effects, lens_samples, seeks })
}

/// Looks at `scene` and decides, as [`plan()`] does, and does to the scene what the plan asks to be done to it before any method sees
/// it. The facts are then those of the scene as it is given back, but for [`Facts::light`], which that was decided from.
///
/// # Errors
/// Those of [`plan()`].
pub fn settle(scene: Scene, settings: &Settings) -> Result<(Scene, Facts, Plan), Error> {
    let facts = scene.facts();
    let decided = plan(&facts, settings)?;
    if !decided.does(EffectKind::HighlightExtrapolation) {
        return Ok((scene, facts, decided));
    }
    let scene = scene.extrapolated(&decided);
    let facts = Facts { light: facts.light, ..scene.facts() };
    let decided = plan(&facts, settings)?;
    Ok((scene, facts, decided))
}

/// Carries out `plan`: the picture of `scene`, of its picture size.
///
/// # Errors
/// Those of the method.
pub fn render(scene: Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
    if !plan.does(EffectKind::Blur) {
        return Ok(scene.into_pinhole());
    }
    by_name(plan.method)?.blur(scene, plan, progress)
}

/// Why `plan` cannot be carried out on a GPU, if it cannot.
pub fn bound_to_cpu(plan: &Plan) -> Option<String> {
    let Plan { method, goal, .. } = plan;
    let has_twin = by_name(method).is_ok_and(|method| method.twin().is_some());
    match goal {
        _ if !has_twin => Some(format!("{method} runs on the CPU alone")),
        Some(Goal::TimeBudget { .. }) => Some("only on the CPU is it known how long views take".to_owned()),
        _ => None,
    }
}

/// Carries out `plan` as [`render`] does, on `gpu`; where that fails, on the CPU after all, and says what failed.
///
/// # Errors
/// Those of the method on the CPU.
pub fn render_on(
    gpu: &Gpu,
    scene: Scene,
    plan: &Plan,
    progress: &Progress<'_>,
) -> Result<(Image, Option<Error>), Error> {
    let twin = by_name(plan.method)?.twin().filter(|_| plan.does(EffectKind::Blur));
    let fault = match twin.map(|twin| twin.blur(gpu, &scene, plan, progress)) {
        Some(Ok(image)) => return Ok((image, None)),
        Some(Err(fault)) => Some(fault),
        None => None,
    };
    render(scene, plan, progress).map(|image| (image, fault))
}

/// Makes `N` planes of one size row by row, rows in parallel, reporting progress. `row(scratch, y, planes)` writes row `y`
/// of each plane; `scratch` makes what a thread keeps from row to row.
fn planes_from_rows<const N: usize, T>(
    (width, height): (usize, usize),
    progress: &Progress<'_>,
    scratch: impl Fn() -> T + Sync + Send,
    row: impl Fn(&mut T, usize, &mut [&mut [f32]; N]) + Sync + Send,
) -> [Plane; N] {
    let mut planes: [Plane; N] = std::array::from_fn(|_| Plane::zeros(width, height));
    let mut rests = planes.each_mut().map(Plane::values_mut);
    let rows: Vec<[&mut [f32]; N]> = (0..height)
        .map(|_| {
            rests.each_mut().map(|rest| {
                let (first, others) = std::mem::take(rest).split_at_mut(width);
                *rest = others;
                first
            })
        })
        .collect();
    let done = AtomicUsize::new(0);
    rows.into_par_iter().enumerate().for_each_init(scratch, |scratch, (y, mut planes)| {
        row(scratch, y, &mut planes);
        progress((done.fetch_add(1, Ordering::Relaxed) + 1) as f32 / height as f32);
    });
    planes
}

/// A pixel of whose rays no more than this share hit anything shows nothing.
const LEAST_HIT: f64 = 1e-9;

/// What the rays of one pixel bring home, summed in double precision: thousands of samples would drift in single.
#[derive(Debug, Clone, Copy, Default)]
struct RaySum {
    color: [f64; 3],
    missed: f64,
    /// Rays that count for nothing, as nobody knows what they would have found.
    discarded: f64,
}

impl RaySum {
    /// Adds premultiplied `color` seen through `transmitted`.
    fn add(&mut self, color: [f32; 3], transmitted: f32) {
        self.color.iter_mut().zip(color).for_each(|(sum, value)| *sum += f64::from(value * transmitted));
    }

    /// The pixel after `rays` rays: light that found nothing is transparent where the background is open, and left out of
    /// the mean where it is closed.
    fn mean(&self, rays: usize, open_background: bool) -> [f32; 4] {
        let known = rays as f64 - self.discarded;
        let hit = known - self.missed;
        let weight = if open_background { known } else { hit };
        if hit <= LEAST_HIT * rays as f64 {
            return [0.0; 4];
        }
        let [r, g, b] = self.color.map(|sum| (sum / weight) as f32);
        [r, g, b, (hit / weight) as f32]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checked(method: &str, effort: Effort, origin: Origin) -> Result<(), String> {
        let effort = Sourced { value: Some(effort), origin };
        check_effort(by_name(method).unwrap(), &effort).map_err(|error| error.to_string())
    }

    #[test]
    fn a_flag_that_a_method_cannot_follow_is_refused_and_a_presets_value_is_not() {
        let refused = |method, effort| checked(method, effort, Origin::Flag).unwrap_err();
        assert!(refused("scatter", Effort::Views(32)).contains("scatter does not sample the lens"));
        let target = refused("gather", Effort::TargetDb(40.0));
        assert!(
            target.contains("`target_db = 40`")
                && target.contains("shear, accumulate, layer-rays, peel-rays")
        );
        assert_eq!(checked("gather", Effort::Views(32), Origin::Flag), Ok(()));
        assert_eq!(checked("peel-rays", Effort::TimeBudget(1.0), Origin::Flag), Ok(()));
        assert_eq!(checked("scatter", Effort::TargetDb(40.0), Origin::Header), Ok(()), "for whichever can");
    }
}
