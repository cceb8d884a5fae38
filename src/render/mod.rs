//! One job from files to picture: read, lens, look, decide, blur.
//!
//! [`prepare`] is everything before the first blurred pixel, and what `thinlens inspect` shows; [`render`] carries the plan
//! out. Writing is the caller's: this module touches no output file and prints nothing.

mod paint;

use crate::cost::{self, Calibration, Remark};
use crate::error::Error;
use crate::finding::Finding;
use crate::gpu::{self, Device, DeviceChoice, Gpu, GpuUsage};
use crate::image::{Image, Plane};
use crate::lens::{LensSpec, Optics, SHARP_COC_PX, Sharpness, ThinLens};
use crate::methods::{self, Plan, Progress, Registry, Target};
use crate::output::report::{LensReport, PlanReport, Report, StackReport};
use crate::probes::{self, ErrorEstimate};
use crate::sample_budget::Outcome;
use crate::scene::{self, Focused, FrameNumber, Scene, SceneStats};
use crate::settings::{Border, DepthConvention, Focus, Mask, Origin, Preset, Settings, Switches, Values};
use crate::stack::depth::DepthScale;
use crate::stack::{self, Frame, ReadOptions, Source, Stack, Window};
use crate::usage::{self, Stage, StageClock};
use crate::{confidence, finish, output};
use paint::Painted;
use std::path::Path;
use std::sync::Arc;

/// A preset and the name it was asked for by.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedPreset {
    /// Name or path, as origins show it.
    pub name: String,
    /// What it sets.
    pub preset: Preset,
}

/// Everything that decides one picture.
///
/// Fields are added with new settings: make one by [`Job::new`], or end its expression with `..Job::default()`.
#[derive(Debug, Clone, Default)]
pub struct Job {
    /// The stack's files.
    pub sources: Vec<Source>,
    /// Which frame of a sequence they are, for focus keys; by the first file's name when `None`.
    pub frame: Option<i64>,
    /// How to read them; what the preset or the flags say about depth is added to it.
    pub read_options: ReadOptions,
    /// The methods to choose from.
    pub methods: Registry,
    /// The preset, if any.
    pub preset: Option<NamedPreset>,
    /// Values that outrank the preset.
    pub flags: Values,
    /// Parameters of the method that outrank the preset's, `KEY=VALUE` each.
    pub parameters: Vec<String>,
    /// Effects that are to be on or off whatever the scene calls for.
    pub switches: Switches,
    /// Where to carry out the plan.
    pub device: DeviceChoice,
    /// How many pixels of the picture to compare with the stack's truth, if any.
    pub verify: Option<usize>,
    /// Whether to say how much of each pixel the stack knows.
    pub confidence: bool,
}

impl Job {
    /// The stack in the files `sources`, with the default lens.
    pub fn new(sources: impl IntoIterator<Item = Source>) -> Self {
        Self { sources: sources.into_iter().collect(), ..Self::default() }
    }

    /// The job with `preset`, called `name` where origins are shown.
    #[must_use]
    pub fn with_preset(self, name: impl Into<String>, preset: Preset) -> Self {
        Self { preset: Some(NamedPreset { name: name.into(), preset }), ..self }
    }

    /// The job with `values`, which outrank the preset.
    #[must_use]
    pub fn with_values(self, values: Values) -> Self {
        Self { flags: values, ..self }
    }

    /// The job with `methods` to choose from.
    #[must_use]
    pub fn with_methods(self, methods: Registry) -> Self {
        Self { methods, ..self }
    }
}

/// A job up to its plan.
#[derive(Debug)]
#[non_exhaustive]
pub struct Prepared {
    /// What was read; its peels have moved into the scene.
    pub stack: Stack,
    /// What was read, in figures.
    pub summary: StackReport,
    /// Every value with its origin.
    pub settings: Settings,
    /// The methods that the job chose from.
    pub methods: Registry,
    /// The lens in picture pixels.
    pub lens: ThinLens,
    /// Between which depths it is sharp.
    pub sharpness: Sharpness,
    /// The stack in CoC space, with what lies beyond the frame ([`Scene::outside_px`]) and with what the plan has had done to it.
    pub scene: Scene,
    /// What the scene shows, what lies beyond the frame included.
    pub stats: SceneStats,
    /// What will be simulated, and why.
    pub plan: Plan,
    /// Where.
    pub device: Device,
    /// The adapter, if that is a GPU.
    pub gpu: Option<Gpu>,
    /// How many pixels of the picture to compare with the stack's truth, if any.
    pub verify: Option<usize>,
    /// Whether to say how much of each pixel the stack knows.
    pub confidence: bool,
    /// What it has cost.
    pub clock: StageClock,
}

/// A job carried out.
#[derive(Debug)]
#[non_exhaustive]
pub struct Rendered {
    /// The picture, of the size of the frame's data window.
    pub image: Image,
    /// Data and display window in picture pixels.
    pub frame: Frame,
    /// What was read; its peels are gone.
    pub stack: Stack,
    /// What was read, in figures.
    pub summary: StackReport,
    /// Every value with its origin.
    pub settings: Settings,
    /// The lens in picture pixels.
    pub lens: ThinLens,
    /// What was simulated, and why.
    pub plan: Plan,
    /// Where.
    pub device: Device,
    /// What a GPU spent its time on, if one was at work.
    pub gpu_usage: Option<GpuUsage>,
    /// How the number of lens samples was found, if it was not given.
    pub outcome: Option<Outcome>,
    /// The sampling error, if it was to be verified.
    pub probe: Option<ErrorEstimate>,
    /// The share of each pixel's light that comes from what the stack knows, if that was asked for.
    pub confidence: Option<Plane>,
    /// What it has cost; writing goes on its account too.
    pub clock: StageClock,
}

/// Reads the job's stack and decides what to do with it.
///
/// # Errors
/// Those of reading, of the lens and of the plan; a setting out of its range and an unknown method or effect, before anything is
/// read.
pub fn prepare(job: &Job) -> Result<Prepared, Error> {
    prepare_with(job, &Gpu::open)
}

/// The same with `open` to open a GPU, where the job calls for one.
///
/// # Errors
/// Those of [`prepare`].
pub(crate) fn prepare_with(job: &Job, open: gpu::Open<'_>) -> Result<Prepared, Error> {
    let mut clock = StageClock::start();
    let demanded = checked(job, open)?;
    clock.skip();
    let stack = stack::read(&job.sources, &read_options(job))?;
    clock.lap(Stage::Read);
    plan_stack(stack, job, clock, (demanded, open))
}

/// Decides what to do with `stack`, which was read before or made of planes in memory ([`Stack::from_peels`]).
///
/// What `job` says of reading does not count: its sources, its read options, and the values `convention` and `supersample`, of
/// which the stack has its own. Focus keys need [`Job::frame`].
///
/// # Errors
/// Those of the lens and of the plan; a setting out of its range, an unknown method or effect.
pub fn prepare_stack(stack: Stack, job: &Job) -> Result<Prepared, Error> {
    let clock = StageClock::start();
    let demanded = checked(job, &Gpu::open)?;
    plan_stack(stack, job, clock, (demanded, &Gpu::open))
}

/// Checks what can be checked without a stack; the GPU that the job insists on.
fn checked(job: &Job, open: gpu::Open<'_>) -> Result<Option<Gpu>, Error> {
    user_layers(job).try_for_each(|(_, values)| values.check())?;
    check_methods(job)?;
    let demanded = gpu::demanded(job.device, open)?;
    methods::requested(&job.switches)?;
    Ok(demanded)
}

/// The job up to its plan, from its stack on; `gpu` is the one that the job insists on, and how to open another.
fn plan_stack(
    mut stack: Stack,
    job: &Job,
    mut clock: StageClock,
    (demanded, open): (Option<Gpu>, gpu::Open<'_>),
) -> Result<Prepared, Error> {
    clock.skip();
    let settings = resolve(job, &stack.camera)?;
    let summary = StackReport::from(&stack);
    let (lens, sharpness) = lens(&mut stack, &settings, frame_number(job))?;
    if !job.read_options.objects {
        // What was kept to find the focus by has served.
        stack.mattes = Vec::new();
    }
    let (scene, stats, plan) = decide(&mut stack, &settings, &lens, &job.methods)?;
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
        stats,
        plan,
        device,
        gpu,
        verify,
        confidence,
        clock,
    })
}

impl Prepared {
    /// Carries out the plan, and if that was asked for compares the picture with the stack's truth and says how much of it the
    /// stack knows: the scene is then kept in memory twice.
    ///
    /// # Errors
    /// Those of the method.
    pub fn blur(self, progress: &Progress<'_>) -> Result<Rendered, Error> {
        let Self {
            mut stack, summary, settings, lens, scene, stats, plan, mut device, gpu, mut clock, ..
        } = self;
        let outside_px = scene.outside_px;
        let calibration = calibration(&plan, &mut stack)?;
        let kept = (self.verify.is_some() || self.confidence).then(|| scene.clone());
        let field = scene.field;
        clock.skip();
        let Painted { image, outcome, fault } = match &gpu {
            Some(gpu) => paint::on_gpu(gpu, scene, &plan, progress)?,
            None => paint::on_cpu(scene, (&stats, &plan), &calibration, progress)?,
        };
        clock.lap(Stage::Blur);
        stack.findings.extend(outcome.as_ref().map(Outcome::finding));
        if let Some(fault) = fault {
            let fault = fault.on_one_line();
            stack
                .findings
                .push(Finding::warning("device", format!("the frame was done on the CPU: {fault}")));
            device = Device::cpu(fault);
        }
        let gpu_usage = gpu.and_then(|gpu| gpu.usage().ok());
        let views = outcome.as_ref().map(|outcome| outcome.views).or(plan.views);
        let plan = Plan { views, ..plan };
        clock.skip();
        let verified = kept.as_ref().zip(self.verify);
        let probe =
            verified.map(|(scene, probes)| probes::verify(&image, scene, &plan, probes, probes::SEED));
        if probe.is_some() {
            clock.lap(Stage::Verify);
        }
        let image = finish::finish(image, &plan, field);
        clock.lap(Stage::Blur);
        let known = kept.filter(|_| self.confidence);
        let known = known.map(|scene| confidence::confidence(scene, &plan, progress)).transpose()?;
        if known.is_some() {
            clock.lap(Stage::Confidence);
        }
        let frame = picture_frame(&stack.frame, stack.supersample);
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
            clock,
        })
    }
}

/// Carries out `job` from files to picture.
///
/// # Errors
/// Those of [`prepare`] and of the method.
pub fn render(job: &Job, progress: &Progress<'_>) -> Result<Rendered, Error> {
    prepare(job)?.blur(progress)
}

/// Carries out `job` on `stack`, which was read before or made of planes in memory.
///
/// # Errors
/// Those of [`prepare_stack`] and of the method.
pub fn render_stack(stack: Stack, job: &Job, progress: &Progress<'_>) -> Result<Rendered, Error> {
    prepare_stack(stack, job)?.blur(progress)
}

impl Rendered {
    /// The sampling error, where it was measured: on its own account, or to find the number of lens samples.
    pub fn sampling_error(&self) -> Option<ErrorEstimate> {
        self.probe.or_else(|| self.outcome.as_ref()?.estimate())
    }

    /// The report of the run so far, which read `input` and wrote `output`, and nothing else.
    pub fn report(&self, input: Vec<String>, output: String) -> Report {
        Report {
            version: env!("CARGO_PKG_VERSION"),
            input,
            output,
            method: self.plan.method.name(),
            device: output::report::Device {
                kind: self.device.kind.name(),
                name: self.device.name.clone(),
                reason: self.device.reason.clone(),
                gpu: self.gpu_usage.as_ref().and_then(|usage| serde_json::to_value(usage).ok()),
            },
            lens: LensReport::new(&self.settings, &self.lens),
            picture: self.settings.picture.clone(),
            stack: self.summary.clone(),
            plan: PlanReport::from(&self.plan),
            views: self.plan.views,
            dial: self.outcome.as_ref().and_then(|outcome| serde_json::to_value(outcome).ok()),
            seconds: self.clock.seconds(),
            cpu_seconds: self.clock.cpu_seconds().total,
            cpu_seconds_by_stage: self.clock.cpu_seconds(),
            threads: rayon::current_num_threads(),
            peak_memory_bytes: usage::peak_memory_bytes(),
            confidence: None,
            probe: self.sampling_error().and_then(|estimate| serde_json::to_value(estimate).ok()),
            findings: self.stack.findings.clone(),
            warnings: Report::warnings(&self.stack.findings),
        }
    }
}

/// The lens that `settings` put on `stack`, frame `frame` of its sequence, and between which depths it is sharp.
fn lens(
    stack: &mut Stack,
    settings: &Settings,
    frame: Option<FrameNumber>,
) -> Result<(ThinLens, Sharpness), Error> {
    let scale = depth_scale(stack, settings)?;
    let focus = &settings.lens.focus.value;
    let Focused { distance, reason } = scene::focus_distance(stack, &scale, focus, frame)?;
    stack.findings.extend(reason.map(|reason| Finding::note("focus", reason)));
    let picture_width = stack.frame.display.width as f32 / stack.supersample as f32;
    let spec = lens_spec(settings, distance);
    let lens = ThinLens::new(&spec, picture_width)?;
    Ok((lens, spec.sharpness(picture_width, SHARP_COC_PX)))
}

/// From stack to plan; the stack's peels move into the scene.
fn decide(
    stack: &mut Stack,
    settings: &Settings,
    lens: &ThinLens,
    methods: &Registry,
) -> Result<(Scene, SceneStats, Plan), Error> {
    let scene = Scene::from_stack(stack, lens, &depth_scale(stack, settings)?);
    if scene.limited_fragments > 0 {
        let (width, height) = scene.picture_size();
        let limit = scene::coc_limit_px(width, height);
        stack.findings.push(Finding::warning(
            "coc",
            format!(
                "{} fragments lie so near the lens that their CoC was limited to {limit} px",
                scene.limited_fragments
            ),
        ));
    }
    let astray_px = Optics::new(settings, &scene.field)?.max_displacement_px();
    let scene = bordered(scene, settings.picture.border.value, astray_px, &mut stack.findings);
    methods.prepare(scene, settings)
}

/// `scene` with what `border` says around it, and a finding of that.
fn bordered(scene: Scene, border: Border, astray_px: f32, findings: &mut Vec<Finding>) -> Scene {
    let content = match border {
        Border::Clamp => return scene,
        Border::Mirror => "its reflection",
        Border::Transparent => "nothing",
    };
    let reach_px = scene.reach_px(astray_px);
    let scene = scene.padded(border, reach_px);
    let [columns, rows] = scene.outside_px;
    findings.push(Finding::note(
        "border",
        format!(
            "{columns} columns and {rows} rows of {content} on either side of the frame, as far as it is seen"
        ),
    ));
    if columns.min(rows) < reach_px {
        let text = format!(
            "the blur reaches {reach_px} px beyond the frame, and past those rows the last one goes on"
        );
        findings.push(Finding::warning("border", text));
    }
    scene
}

/// How fast this machine is, if `plan` needs to know: measured at the first time, outside of any stage.
fn calibration(plan: &Plan, stack: &mut Stack) -> Result<Calibration, Error> {
    if !matches!(plan.target, Some(Target::Time { .. })) {
        return Ok(Calibration::assumed());
    }
    let (calibration, remarks) = Calibration::load_or_measure(cost::cache_folder().as_deref(), false)?;
    stack.findings.extend(remarks.into_iter().map(|Remark(text)| Finding::note("calibration", text)));
    Ok(calibration)
}

/// The layers that the user gave, lowest first.
fn user_layers(job: &Job) -> impl Iterator<Item = (Origin, &Values)> {
    let preset = job.preset.iter().map(|p| (Origin::Preset(p.name.clone()), &p.preset.values));
    preset.chain([(Origin::Flag, &job.flags)])
}

fn resolve(job: &Job, camera: &Values) -> Result<Settings, Error> {
    let layers: Vec<_> = [(Origin::Header, camera)].into_iter().chain(user_layers(job)).collect();
    let parameters = job.preset.as_ref().map(|p| p.preset.parameters.clone()).unwrap_or_default();
    let mut settings = Settings { switches: job.switches.clone(), ..Settings::resolve(&layers, parameters) };
    let method = job.methods.chosen(&settings)?;
    for setting in &job.parameters {
        settings.parameters.push(method.parameters().parse(method.name(), setting)?);
    }
    settings.mask = settings.lens.aperture_image.value.as_deref().map(mask).transpose()?.map(Arc::new);
    Ok(settings)
}

/// What the picture of an aperture at `path` shows: light by pixel, none where it is transparent.
fn mask(path: &Path) -> Result<Mask, Error> {
    let Image { planes: [red, green, blue, _] } = stack::read_picture(path)?;
    let light = red.values().iter().zip(green.values()).zip(blue.values());
    Ok(Mask {
        name: path.display().to_string(),
        width: red.width(),
        height: red.height(),
        values: light.map(|((red, green), blue)| (red + green + blue) / 3.0).collect(),
    })
}

/// The job's read options, with what its layers say about the file.
fn read_options(job: &Job) -> ReadOptions {
    let mut options = job.read_options.clone();
    for (_, values) in user_layers(job) {
        options.convention = values.convention.or(options.convention);
        options.supersample = values.supersample.or(options.supersample);
    }
    let focus = user_layers(job).filter_map(|(_, values)| values.focus.as_ref()).last();
    options.objects |= focus.is_some_and(Focus::needs_mattes);
    options
}

/// Which frame of a sequence the job is, if that is known.
fn frame_number(job: &Job) -> Option<FrameNumber> {
    let said = job.frame.map(|number| FrameNumber { number, from: "`frame`" });
    let named = || stack::frame_number(&job.sources);
    said.or_else(|| named().map(|number| FrameNumber { number, from: "the file's name" }))
}

fn check_methods(job: &Job) -> Result<(), Error> {
    user_layers(job)
        .filter_map(|(_, values)| values.method.as_deref())
        .try_for_each(|name| job.methods.by_name(name).map(drop))?;
    job.preset.iter().try_for_each(|named| job.methods.check(&named.preset.parameters))
}

/// Everything that turns the stack's depth into planar depth.
fn depth_scale(stack: &Stack, settings: &Settings) -> Result<DepthScale, Error> {
    let [near, far] = [settings.lens.near.value, settings.lens.far.value];
    if stack.convention == DepthConvention::Normalised && far <= near {
        return Err(Error::settings("the far end of normalised depth must lie beyond its near end")
            .with("found", format!("near {near}, far {far}"))
            .help("set the distances of depth 0 and depth 1, `near` and `far`"));
    }
    let focal_lengths = settings.lens.focal_length_mm.value / settings.lens.sensor_width_mm.value;
    Ok(DepthScale {
        convention: stack.convention,
        near_clip: settings.lens.near_clip.value,
        near_far: [near, far],
        focal_px: focal_lengths * stack.frame.display.width as f32,
    })
}

fn lens_spec(settings: &Settings, focus_distance: f32) -> LensSpec {
    LensSpec {
        focal_length_mm: settings.lens.focal_length_mm.value,
        f_number: settings.lens.f_number.value,
        focus_distance,
        sensor_width_mm: settings.lens.sensor_width_mm.value,
        sensor_distance: settings.lens.sensor_distance.value,
        metres_per_unit: settings.lens.metres_per_unit.value,
    }
}

/// `frame` in picture pixels, from samples.
fn picture_frame(frame: &Frame, supersample: usize) -> Frame {
    let step = i32::try_from(supersample).unwrap_or(i32::MAX).max(1);
    let window = |window: Window| Window {
        x: window.x.div_euclid(step),
        y: window.y.div_euclid(step),
        width: window.width / supersample.max(1),
        height: window.height / supersample.max(1),
    };
    Frame { data: window(frame.data), display: window(frame.display), pixel_aspect: frame.pixel_aspect }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn preset(values: Values) -> Option<NamedPreset> {
        Some(NamedPreset { name: "p".to_owned(), preset: Preset { values, ..Preset::default() } })
    }

    #[test]
    fn flags_outrank_the_preset_and_the_preset_the_header() {
        let camera = Values { f_number: Some(1.0), focal_length_mm: Some(20.0), ..Values::default() };
        let job = Job {
            preset: preset(Values { f_number: Some(2.0), blades: Some(5), ..Values::default() }),
            flags: Values { f_number: Some(4.0), ..Values::default() },
            ..Job::default()
        };
        let settings = resolve(&job, &camera).unwrap();
        assert_eq!((settings.lens.f_number.value, settings.lens.f_number.origin), (4.0, Origin::Flag));
        assert_eq!(
            (settings.lens.blades.value, settings.lens.blades.origin),
            (5, Origin::Preset("p".to_owned()))
        );
        assert_eq!(
            (settings.lens.focal_length_mm.value, settings.lens.focal_length_mm.origin),
            (20.0, Origin::Header)
        );
    }

    #[test]
    fn the_depth_convention_of_a_flag_outranks_the_presets() {
        let convention = |convention| Values { convention, ..Values::default() };
        let mut job = Job { preset: preset(convention(Some(DepthConvention::Ray))), ..Job::default() };
        assert_eq!(read_options(&job).convention, Some(DepthConvention::Ray));
        job.flags = convention(Some(DepthConvention::Planar));
        assert_eq!(read_options(&job).convention, Some(DepthConvention::Planar));
    }

    #[test]
    fn an_unknown_method_is_refused_before_anything_is_read() {
        let job = Job {
            sources: vec![Source::File("no/such.exr".into())],
            preset: preset(Values { method: Some("sheer".to_owned()), ..Values::default() }),
            ..Job::default()
        };
        let message = prepare(&job).unwrap_err().to_string();
        assert!(message.contains("'sheer'") && message.contains("did you mean 'shear'?"), "{message}");
    }

    #[test]
    fn a_supersampled_frame_shrinks_to_picture_pixels() {
        let data = Window { x: -4, y: 2, width: 24, height: 12 };
        let display = Window { x: 0, y: 0, width: 16, height: 16 };
        let frame = picture_frame(&Frame { data, display, pixel_aspect: 1.0 }, 2);
        assert_eq!(frame.data, Window { x: -2, y: 1, width: 12, height: 6 });
        assert_eq!(frame.display, Window { x: 0, y: 0, width: 8, height: 8 });
    }
}
