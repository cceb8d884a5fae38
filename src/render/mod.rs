//! One job from files to picture: read, lens, analyze, decide, blur.
//!
//! [`prepare`] is everything before the first blurred pixel, and what `thinlens inspect` shows; [`render`] also carries the plan
//! out. The caller writes the picture: this module writes no output file and prints nothing.

mod bands;
mod decisions;
mod environment;
mod digest;
mod job;
mod layout;
mod paint;
mod rendered;
mod stages;
mod survey;
mod units;

#[cfg(feature = "cli")]
pub(crate) use bands::in_bands_with;
pub use bands::{Bands, fits_into_memory, in_bands, memory_bytes};
pub use decisions::Decisions;
pub use digest::digest;
pub use job::{Job, NamedPreset, limit_bytes as memory_limit_bytes};
pub use rendered::Rendered;

use crate::cost::{self, Calibration, Remark};
use crate::error::Error;
use crate::finding::Finding;
use crate::gpu::{self, Device, Gpu};
use crate::lens::{Sharpness, ThinLens};
use crate::methods::{Plan, Progress, Registry, Target};
use crate::output::Made;
use crate::output::report::StackReport;
use crate::probes;
use crate::sample_budget::{self, Outcome};
use crate::scene::{EffectKind, Scene, SceneStats};
use crate::settings::{Settings, Values};
use crate::stack::{self, Source, Stack};
use crate::usage::{Stage, StageClock};
use crate::{confidence, finish};
use paint::Painted;

/// A job with its plan, before the blur.
#[derive(Debug)]
#[non_exhaustive]
pub struct Prepared {
    /// The stack as read; its peels have moved into the scene.
    pub stack: Stack,
    /// Summary of the stack.
    pub summary: StackReport,
    /// Every value with its origin.
    pub settings: Settings,
    /// The methods that the job chose from.
    pub methods: Registry,
    /// The lens in picture pixels.
    pub lens: ThinLens,
    /// The depths between which it is sharp.
    pub sharpness: Sharpness,
    /// The stack in CoC space, extended beyond the frame ([`Scene::outside_px`]), with what the plan does before any method sees it.
    pub scene: Scene,
    /// What the scene shows of its alpha, as its red; `None` if that is all.
    shown: Option<Scene>,
    /// Statistics of the scene, including what lies beyond the frame.
    pub stats: SceneStats,
    /// What will be simulated, with reasons.
    pub plan: Plan,
    /// Device that carries out the plan.
    pub device: Device,
    /// The adapter, if the device is a GPU.
    pub gpu: Option<Gpu>,
    /// Number of pixels at which the sampling error is measured, if any.
    pub verify: Option<usize>,
    /// Whether to compute the confidence mask.
    pub confidence: bool,
    /// Time by stage.
    pub clock: StageClock,
    /// The files that the job names.
    sources: Vec<Source>,
    /// How the job reads them.
    reading: Values,
}

/// Reads the job's stack, analyzes it and decides what to simulate.
///
/// # Errors
/// Those of reading, of the lens and of the plan; a setting out of its range and an unknown method or effect, before anything is
/// read.
pub fn prepare(job: &Job) -> Result<Prepared, Error> {
    prepare_with(job, &Gpu::open)
}

/// As [`prepare`], with `open` to open a GPU where the job needs one.
///
/// # Errors
/// Those of [`prepare`].
pub(crate) fn prepare_with(job: &Job, open: gpu::Open<'_>) -> Result<Prepared, Error> {
    let mut clock = StageClock::start();
    job::check(job)?;
    let demanded = gpu::demanded(job.device, open)?;
    clock.skip();
    let stack = stack::read(&job.sources, &job::read_options(job))?;
    clock.lap(Stage::Read);
    plan_stack(stack, job, clock, (demanded, open))
}

/// Decides what to simulate for `stack`, which was read before or made of planes in memory ([`Stack::from_peels`]).
///
/// What `job` sets for reading has no effect: its sources, its read options, and the values `convention`, `supersample`,
/// `kind`, `alpha` and `beauty`; the stack has its own. Keys need [`Job::frame`].
///
/// # Errors
/// Those of the lens and of the plan; a setting out of its range, an unknown method or effect.
pub fn prepare_stack(stack: Stack, job: &Job) -> Result<Prepared, Error> {
    let clock = StageClock::start();
    job::check(job)?;
    let demanded = gpu::demanded(job.device, &Gpu::open)?;
    plan_stack(stack, job, clock, (demanded, &Gpu::open))
}

/// From stack to plan. The pair is the GPU that the job requires, if any, and how to open another.
fn plan_stack(
    mut stack: Stack,
    job: &Job,
    mut clock: StageClock,
    (demanded, open): (Option<Gpu>, gpu::Open<'_>),
) -> Result<Prepared, Error> {
    clock.skip();
    let (settings, findings) = job::resolve(job, &stack.camera)?;
    stack.findings.extend(findings);
    stack.findings.extend(stages::default_lens(&stack, &settings));
    let summary = StackReport::from(&stack);
    let (lens, sharpness) = stages::lens(&mut stack, &settings, job::frame_number(job))?;
    let in_use = stages::depth_in_use(&stack, &settings, &lens)?;
    stack.findings.extend(units::doubt(&in_use, &settings, lens.focus_distance));
    if !job.read_options.objects {
        // Mattes were read to find the focus distance only.
        stack.mattes = Vec::new();
    }
    let shown = stages::shown(&mut stack, &settings, &lens)?;
    let (scene, stats, plan) = stages::decide(&mut stack, &settings, &lens, &job.methods)?;
    if job.confidence {
        confidence::check(&plan)?;
    }
    let (device, gpu) = paint::device(job.device, demanded, &plan, open)?;
    clock.lap(Stage::Plan);
    let (verify, confidence) = (job.verify, job.confidence);
    Ok(Prepared {
        stack,
        summary,
        settings,
        methods: job.methods.clone(),
        lens,
        sharpness,
        scene,
        shown,
        stats,
        plan,
        device,
        gpu,
        verify,
        confidence,
        clock,
        sources: job.sources.clone(),
        reading: job::reading(job),
    })
}

impl Prepared {
    /// The speed of this machine, if the plan needs it; measured the first time.
    ///
    /// # Errors
    /// Those of the measurement.
    pub fn calibration(&mut self) -> Result<Calibration, Error> {
        calibration(&self.plan, &mut self.stack)
    }

    /// Replaces a target in the plan by the number of lens samples that reaches it, as a render does.
    ///
    /// # Errors
    /// Those of the search; a time for a method whose time cannot be predicted.
    pub fn decide_views(&mut self, calibration: &Calibration) -> Result<(), Error> {
        let Self { scene, stats, plan, .. } = self;
        let (views, reason) = match plan.target.filter(|_| plan.does(EffectKind::Blur)) {
            None => return Ok(()),
            Some(Target::Error { psnr_db, max_views }) => {
                let outcome = sample_budget::find_views(scene.clone(), plan, (psnr_db, max_views))?;
                (outcome.views, outcome.statement)
            }
            Some(Target::Time { seconds }) => {
                let views = sample_budget::views_within(stats, plan, seconds, calibration)?;
                (views, format!("as many as are predicted to fit into {seconds} s"))
            }
        };
        *plan = Plan { views_reason: reason, ..plan.with_views(views) };
        Ok(())
    }

    /// Carries out the plan. If requested, also measures the sampling error and computes the confidence mask; the scene is then kept in
    /// memory twice.
    ///
    /// # Errors
    /// Those of the method.
    pub fn blur(self, progress: &Progress<'_>) -> Result<Rendered, Error> {
        let Self {
            mut stack,
            summary,
            settings,
            lens,
            scene,
            shown,
            stats,
            plan,
            mut device,
            gpu,
            mut clock,
            ..
        } = self;
        let (sources, reading) = (self.sources, self.reading);
        let outside_px = scene.outside_px;
        let calibration = calibration(&plan, &mut stack)?;
        let kept = (self.verify.is_some() || self.confidence).then(|| scene.clone());
        let field = scene.field;
        clock.skip();
        let Painted { mut image, outcome, fault } = match &gpu {
            Some(gpu) => paint::on_gpu(gpu, scene, &plan, progress)?,
            None => paint::on_cpu(scene, (&stats, &plan), &calibration, progress)?,
        };
        clock.lap(Stage::Blur);
        stack.findings.extend(outcome.as_ref().map(Outcome::finding));
        if let Some(fault) = fault {
            let fault = fault.on_one_line();
            stack
                .findings
                .push(Finding::warning("device", format!("the frame was rendered on the CPU: {fault}")));
            device = Device::cpu(fault);
        }
        let views = outcome.as_ref().map(|outcome| outcome.views).or(plan.views);
        let plan = Plan { views, ..plan };
        clock.skip();
        let verified = kept.as_ref().zip(self.verify);
        let probe =
            verified.map(|(scene, probes)| probes::verify(&image, scene, &plan, probes, probes::SEED));
        if probe.is_some() {
            clock.lap(Stage::Verify);
        }
        clock.skip();
        if let Some(shown) = shown {
            image.planes[3] = paint::shown_alpha(gpu.as_ref(), shown, &plan, progress)?;
        }
        let gpu_usage = gpu.and_then(|gpu| gpu.usage().ok());
        let image = finish::finish(image, &plan, field);
        clock.lap(Stage::Blur);
        let known = kept.filter(|_| self.confidence);
        let known = known.map(|scene| confidence::confidence(scene, &plan, progress)).transpose()?;
        if known.is_some() {
            clock.lap(Stage::Confidence);
        }
        let frame = stack.picture_frame();
        let made = Made::new(&settings, &lens, &plan, reading).of(&sources);
        let corrected = made.apply(&mut stack.carried.attributes);
        stack.findings.extend(corrected);
        Ok(Rendered {
            image: image.trimmed(outside_px),
            frame,
            stack,
            summary,
            settings,
            lens,
            plan,
            device,
            gpu_usage,
            outcome,
            probe,
            confidence: known.map(|known| known.trimmed(outside_px)),
            made,
            clock,
        })
    }
}

/// Renders `job` from files to picture.
///
/// # Errors
/// Those of [`prepare`] and of the method.
pub fn render(job: &Job, progress: &Progress<'_>) -> Result<Rendered, Error> {
    prepare(job)?.blur(progress)
}

/// Renders `job` for `stack`, which was read before or made of planes in memory.
///
/// # Errors
/// Those of [`prepare_stack`] and of the method.
pub fn render_stack(stack: Stack, job: &Job, progress: &Progress<'_>) -> Result<Rendered, Error> {
    prepare_stack(stack, job)?.blur(progress)
}

/// The speed of this machine, if `plan` needs it: measured the first time, outside any stage.
fn calibration(plan: &Plan, stack: &mut Stack) -> Result<Calibration, Error> {
    if !matches!(plan.target, Some(Target::Time { .. })) {
        return Ok(Calibration::assumed());
    }
    let (calibration, remarks) = Calibration::load_or_measure(cost::cache_folder().as_deref(), false)?;
    stack.findings.extend(remarks.into_iter().map(|Remark(text)| Finding::note("calibration", text)));
    Ok(calibration)
}
