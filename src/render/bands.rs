//! A frame that does not fit into memory, rendered in bands of rows.
//!
//! What is decided of a picture is decided once, in a first pass over its rows (`survey.rs`). Then each band is read with as many rows of
//! its surroundings as its pixels depend on, blurred by the one plan, and its rows are written before the next band is read. A band starts at
//! a multiple of the rows over which views take turns, so that its pixels have the views of the whole frame.
//!
//! Cost: the first pass, and the surroundings of every band. Limits: OpenEXR in and out; methods that say how far a pixel depends on its
//! surroundings ([`crate::methods::Method::rows_around`]); neither the sampling error nor the confidence mask, which need a second copy.

use super::job::{self, Job, limit_bytes};
use super::layout::{Band, Layout};
use super::survey::{self, Survey};
use super::{Rendered, paint, stages};
use crate::error::Error;
use crate::finding::Finding;
use crate::finish;
use crate::gpu::{self, Device, Gpu};
use crate::image::Image;
use crate::lens::{Optics, ROW_SETS};
use crate::memory::shown_bytes;
use crate::methods::{self, Plan, Progress, Target};
use crate::output::Made;
use crate::output::exr::{self, Codec, ExrOptions, Rows};
use crate::scene::{EffectKind, Scene};
use crate::settings::{Border, Effort, Focus};
use crate::stack::{self, Carried, Footprint, Stack};
use crate::usage::{Stage, StageClock};
use ::exr::image::FlatSamples;
use std::ops::Range;
use std::path::Path;

/// Rows beyond those that a method needs: what a stack concludes of a pixel depends on fewer.
const READING_ROWS: usize = 16;

/// Fewest rows of a picture that are surveyed at a time.
const FEWEST_SURVEYED: usize = 64;

/// A frame with its plan, to be rendered in bands.
#[derive(Debug)]
#[non_exhaustive]
pub struct Bands {
    job: Job,
    footprint: Footprint,
    layout: Layout,
    survey: Survey,
    device: Device,
    gpu: Option<Gpu>,
    clock: StageClock,
}

/// The frame of `job` in bands, where it does not fit into [`Job::memory`] as a whole, for an EXR compressed by `codec`; `None` where it
/// fits. Reads the frame once and decides what to simulate.
///
/// # Errors
/// Those of [`super::prepare`]; [`crate::error::ErrorKind::Limits`] for a frame that has to fit into memory and does not, with the memory
/// that it takes.
pub fn in_bands(job: &Job, codec: Codec) -> Result<Option<Bands>, Error> {
    in_bands_with(job, codec, &Gpu::open)
}

/// As [`in_bands`], with `open` to open a GPU where the job needs one.
///
/// # Errors
/// Those of [`in_bands`].
pub(crate) fn in_bands_with(job: &Job, codec: Codec, open: gpu::Open<'_>) -> Result<Option<Bands>, Error> {
    let mut clock = StageClock::start();
    let (footprint, limit) = (footprint(job)?, limit_bytes(job));
    let whole = whole_bytes(job, &footprint);
    if whole <= limit {
        return Ok(None);
    }
    check(job, &footprint).map_err(|error| with_sizes(error, limit, whole))?;
    let demanded = gpu::demanded(job.device, open)?;
    clock.skip();
    let step = footprint.supersample * codec.block_rows().max(ROW_SETS);
    let part_step = step.next_multiple_of(FEWEST_SURVEYED * footprint.supersample);
    let bytes = |rows: usize| job_bytes(job, &footprint, rows);
    let parts = Layout::within(limit, &footprint, (0, part_step), bytes)?;
    let mut survey = survey::survey(job, &footprint, parts.rows)?;
    check_plan(&survey.plan).map_err(|error| with_sizes(error, limit, whole))?;
    let layout = layout(limit, &footprint, &survey, step)?;
    survey.stack.findings.push(finding(&footprint, &layout, limit));
    let (device, gpu) = paint::device(job.device, demanded, &survey.plan, open)?;
    clock.lap(Stage::Plan);
    Ok(Some(Bands { job: job.clone(), footprint, layout, survey, device, gpu, clock }))
}

/// Whether the frame of `job` fits into [`Job::memory`] as a whole, from the headers of its files.
///
/// # Errors
/// Those that headers show, and a setting out of its range.
pub fn fits_into_memory(job: &Job) -> Result<bool, Error> {
    Ok(whole_bytes(job, &footprint(job)?) <= limit_bytes(job))
}

fn footprint(job: &Job) -> Result<Footprint, Error> {
    job::check(job)?;
    stack::footprint(&job.sources, &job::read_options(job))
}

/// A bound for the memory that `job` takes, in bytes: as a whole if it fits into [`limit_bytes`], else in bands, which take all of that.
///
/// # Errors
/// Those of [`fits_into_memory`].
pub fn memory_bytes(job: &Job) -> Result<u64, Error> {
    Ok(whole_bytes(job, &footprint(job)?).min(limit_bytes(job)))
}

/// A bound for the memory that `job` takes if its frame is rendered as a whole.
fn whole_bytes(job: &Job, footprint: &Footprint) -> u64 {
    let bytes = job_bytes(job, footprint, footprint.height);
    // The scene is kept for a second use.
    let is_kept = job.verify.is_some() || job.confidence;
    bytes.saturating_add(if is_kept { footprint.decoded_bytes() } else { 0 })
}

/// A bound for the memory that `job` takes for `rows` rows of samples, without a second use of its scene.
fn job_bytes(job: &Job, footprint: &Footprint, rows: usize) -> u64 {
    if may_search(job) { footprint.search_bytes(rows) } else { footprint.render_bytes(rows) }
}

/// Whether the number of lens samples may have to be searched for.
fn may_search(job: &Job) -> bool {
    let effort = job::user_layers(job).filter_map(|(_, values)| values.effort).last();
    !matches!(effort, Some(Effort::Views(_) | Effort::TimeBudget(_)))
}

/// Refuses what is not possible in bands, before anything is read.
fn check(job: &Job, footprint: &Footprint) -> Result<(), Error> {
    if !footprint.is_in_rows {
        return Err(Error::limits(
            "the frame does not fit into memory, and only OpenEXR can be read in bands",
        ));
    }
    if job.verify.is_some() {
        return Err(Error::limits("the sampling error is not measured in a frame that is rendered in bands")
            .help("leave `verify` out"));
    }
    if job::read_options(job).holdout.is_some() {
        return Err(
            Error::limits("a frame with a holdout is not rendered in bands").help("leave `holdout` out")
        );
    }
    if job::user_layers(job).any(|(_, values)| values.environment.is_some()) {
        return Err(Error::limits("an environment is not shaded in a frame that is rendered in bands")
            .help("leave `environment` out"));
    }
    if job.confidence {
        return Err(Error::limits("there is no confidence mask of a frame that is rendered in bands")
            .help("leave `confidence` out"));
    }
    Ok(())
}

/// Refuses what is not possible in bands and only the plan says.
fn check_plan(plan: &Plan) -> Result<(), Error> {
    if let Some(Target::Time { .. }) = plan.target {
        return Err(Error::limits("the time of a frame that is rendered in bands is not predicted")
            .help("give a number of lens samples with `views`, or a target with `target_db`"));
    }
    if plan.does(EffectKind::HighlightExtrapolation) {
        return Err(Error::limits("highlights are not extrapolated in a frame that is rendered in bands"));
    }
    if plan.method.rows_around(plan, 0).is_none() {
        let what = format!("{} needs the whole frame in memory", plan.method);
        return Err(Error::limits(what).help("use `method = shear`"));
    }
    Ok(())
}

/// `error` with the memory that there is and that the whole frame would take.
fn with_sizes(error: Error, limit: u64, whole: u64) -> Error {
    error
        .with("memory", shown_bytes(limit))
        .with("needed", format!("{} for the whole frame", shown_bytes(whole)))
        .help("or allow that much with `memory`")
}

/// The bands of the frame.
fn layout(limit: u64, footprint: &Footprint, survey: &Survey, step: usize) -> Result<Layout, Error> {
    let Survey { plan, reach_px, settings, .. } = survey;
    let around_px = plan.method.rows_around(plan, *reach_px).unwrap_or(*reach_px) + READING_ROWS;
    let beyond = if settings.picture.border.value == Border::Clamp { 0 } else { *reach_px };
    let beyond = beyond * footprint.supersample;
    let padded = Footprint { width: footprint.width + 2 * beyond, ..*footprint };
    let bytes = |rows: usize| padded.render_bytes(rows + 2 * beyond);
    Layout::within(limit, &padded, (around_px * footprint.supersample, step), bytes)
}

/// What is said of the bands.
fn finding(footprint: &Footprint, layout: &Layout, limit: u64) -> Finding {
    let samples = footprint.supersample;
    let (rows, around) = (layout.rows / samples, layout.around / samples);
    Finding::note(
        "memory",
        format!(
            "the stack takes {} decoded, the limit is {}: rendered in {} bands of {rows} rows, with {around} rows of their surroundings on \
             either side",
            shown_bytes(footprint.decoded_bytes()),
            shown_bytes(limit),
            layout.count()
        ),
    )
}

impl Bands {
    /// The stack without peels, with what was concluded of it, and that it is rendered in bands.
    pub fn stack(&self) -> &Stack {
        &self.survey.stack
    }

    /// What will be simulated, with reasons.
    pub fn plan(&self) -> &Plan {
        &self.survey.plan
    }

    /// What is in focus.
    pub fn focus(&self) -> &Focus {
        &self.survey.settings.lens.focus.value
    }

    /// The device that carries out the plan.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// Renders the bands and writes them as an EXR to the file `path`, which appears whole or not at all; `digest` ([`super::digest()`]) goes
    /// into its header, if it is known. What is returned has no picture: it is in the file.
    ///
    /// # Errors
    /// Those of reading, of the method and of [`exr::write_rows`].
    pub fn write(
        mut self,
        path: &Path,
        options: &ExrOptions,
        digest: Option<String>,
        progress: &Progress<'_>,
    ) -> Result<Rendered, Error> {
        let made = self.made(digest);
        let frame = self.survey.stack.picture_frame();
        let layout = self.layout;
        let mut bands = (0..layout.count()).map(|i| (i, layout.band(i)));
        let share = 1.0 / self.layout.count().max(1) as f32;
        let written = exr::write_rows(path, &frame, options, || {
            self.clock.lap(Stage::Write);
            let rows =
                bands.next().map(|(i, band)| self.rows(&band, &|done| progress((i as f32 + done) * share)));
            self.clock.skip();
            let mut rows = rows.transpose()?;
            rows.iter_mut().for_each(|rows| drop(made.apply(&mut rows.carried.attributes)));
            Ok(rows)
        });
        let findings = written?;
        self.clock.lap(Stage::Write);
        Ok(self.rendered(findings, made))
    }

    /// The rows of one band.
    fn rows(&mut self, band: &Band, progress: &Progress<'_>) -> Result<Rows, Error> {
        self.clock.skip();
        let convention = Some(self.survey.stack.convention);
        let mut stack = survey::read_rows(&self.job, &self.footprint, band.read.clone(), convention)?;
        self.clock.lap(Stage::Read);
        let scene = self.scene(&mut stack)?;
        self.clock.lap(Stage::Plan);
        let (outside_px, field) = (scene.outside_px, scene.field);
        let image = self.blurred(scene, progress)?;
        let image = finish::finish(image, &self.survey.plan, field).trimmed(outside_px);
        let kept = band.kept.start - band.read.start..band.kept.end - band.read.start;
        let samples = self.footprint.supersample;
        let size = (image.width(), kept.len() / samples);
        let image = image.part([0, kept.start / samples], size);
        let width = stack.width();
        self.clock.lap(Stage::Blur);
        Ok(Rows { image, carried: carried(stack.carried, width, &kept) })
    }

    /// The scene of a band, as methods see it.
    fn scene(&self, stack: &mut Stack) -> Result<Scene, Error> {
        let Survey { settings, lens, .. } = &self.survey;
        let scene = stages::scene(stack, settings, lens)?;
        let astray_px = Optics::new(settings, &scene.field)?.max_displacement_px();
        Ok(stages::bordered(scene, settings.picture.border.value, astray_px, &mut Vec::new()))
    }

    /// The picture of a band. A band that the GPU loses is rendered on the CPU, with a warning, and so are those after it.
    fn blurred(&mut self, scene: Scene, progress: &Progress<'_>) -> Result<Image, Error> {
        let plan = &self.survey.plan;
        let Some(gpu) = &self.gpu else { return methods::render(scene, plan, progress) };
        let (image, fault) = methods::render_on(gpu, scene, plan, progress)?;
        if let Some(fault) = fault {
            let fault = fault.on_one_line();
            let text = format!("a band and those after it were rendered on the CPU: {fault}");
            self.survey.stack.findings.push(Finding::warning("device", text));
            (self.device, self.gpu) = (Device::cpu(fault), None);
        }
        Ok(image)
    }

    /// How the picture is made, for its header.
    fn made(&self, digest: Option<String>) -> Made {
        let Survey { settings, lens, plan, .. } = &self.survey;
        let made = Made::new(settings, lens, plan, job::reading(&self.job)).of(&self.job.sources);
        Made { digest, ..made }
    }

    fn rendered(self, findings: Vec<Finding>, made: Made) -> Rendered {
        let Self { survey, device, gpu, clock, .. } = self;
        let Survey { mut stack, summary, settings, lens, plan, outcome, .. } = survey;
        stack.findings.extend(findings);
        stack.findings.extend(made.apply(&mut stack.carried.attributes));
        Rendered {
            image: Image::default(),
            frame: stack.picture_frame(),
            stack,
            summary,
            settings,
            lens,
            plan,
            device,
            gpu_usage: gpu.and_then(|gpu| gpu.usage().ok()),
            outcome,
            probe: None,
            confidence: None,
            made,
            clock,
        }
    }
}

/// The rows `kept` of channels that are `width` samples wide.
fn carried(carried: Carried, width: usize, kept: &Range<usize>) -> Carried {
    let samples = kept.start * width..kept.end * width;
    let mut carried = carried;
    for channel in &mut carried.channels {
        match &mut channel.samples {
            FlatSamples::F16(values) => keep(values, &samples),
            FlatSamples::F32(values) => keep(values, &samples),
            FlatSamples::U32(values) => keep(values, &samples),
        }
    }
    carried
}

/// Drops all of `values` but those of `range`.
fn keep<T>(values: &mut Vec<T>, range: &Range<usize>) {
    values.truncate(range.end);
    values.drain(..range.start);
}
