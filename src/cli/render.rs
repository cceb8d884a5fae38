//! `thinlens render`.

use super::args::{DEFAULT_PROBES, JobArgs};
use super::console::{Bar, Console};
use super::failure::Failure;
use super::outputs::OutputArgs;
use super::picture::{self, Decided, Watcher};
use super::sequence::{self, FramesArgs, RunArgs};
use clap::Args;
use std::path::PathBuf;
use std::sync::OnceLock;
use thinlens::error::Error;
use thinlens::methods::Registry;
use thinlens::probes::MIN_PROBES;
use thinlens::render::{Job, Rendered, digest};
use thinlens::settings::Focus;
use thinlens::stack::{self, ALL_VIEWS};

const EXAMPLES: &str = "\
Examples:
  thinlens render stack.exr -o out.exr --focal-length 85 --f-number 1.4 --focus 6
  thinlens render beauty.exr --depth-file depth.exr -o out.png --preset portrait --focus-at 960,540
  thinlens render shot.####.exr --frames 1-100 -o out.####.exr --preset pull.toml --resume";

/// Render a stack, or a sequence of them, with depth of field
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct RenderArgs {
    #[command(flatten)]
    job: JobArgs,
    #[command(flatten)]
    frames: FramesArgs,
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    run: RunArgs,
    /// Measure the sampling error at this many pixels
    ///
    /// Compares the picture, at randomly chosen pixels, with the mean of very many lens rays through the stack, and reports the
    /// estimated PSNR of the whole picture with its 95 % interval. Errors of the stack itself, such as missing surfaces, are not
    /// included.
    #[arg(
        long,
        value_name = "PIXELS",
        num_args = 0..=1,
        default_missing_value = DEFAULT_PROBES,
        value_parser = clap::value_parser!(u32).range(MIN_PROBES as i64..),
        help_heading = "Output"
    )]
    verify: Option<u32>,
}

pub(super) fn run(args: &RenderArgs, console: &Console, methods: &Registry) -> Result<(), Failure> {
    let RenderArgs { frames, output, run, .. } = args;
    if let Some(shot) = frames.shot(args.job.inputs(), output.varies()?)? {
        let job = args.job(methods)?;
        if job.read_options.view.as_deref() == Some(ALL_VIEWS) {
            return Err(Error::settings(format!("`view = {ALL_VIEWS}` is for a single frame"))
                .help("render the sequence once for each view, with `focus_distance` or its keys for both to have one focus")
                .into());
        }
        return sequence::run(&shot, job, (frames, output, run), *console);
    }
    run.check_single(frames)?;
    let job = args.job(methods)?;
    if job.read_options.view.as_deref() == Some(ALL_VIEWS) {
        return each_view(job, output, console);
    }
    let output = match &job.read_options.view {
        Some(view) => &output.naming_view(view),
        None => output,
    };
    output.check(&job)?;
    let job = job.held()?;
    one_picture(&job, output, console).map(|_| ())
}

/// Renders the picture of `job`.
fn one_picture(job: &Job, output: &OutputArgs, console: &Console) -> Result<Rendered, Failure> {
    // Of the files as they are before they are read.
    let digest = digest(job, &output.encoding());
    let teller = Teller { console: *console, printed: OnceLock::new(), bar: console.progress("blurring") };
    let rendered = picture::render(job, output, digest, &teller)?;
    teller.finish(&rendered);
    output.print_report(job, &rendered)?;
    for file in output.files()? {
        console.wrote(file);
    }
    Ok(rendered)
}

/// Renders each view of the job's first file, in files of their own; the first view's focus is that of all.
fn each_view(mut job: Job, output: &OutputArgs, console: &Console) -> Result<(), Failure> {
    let views = job.sources.first().map(stack::views).transpose()?.unwrap_or_default();
    if views.is_empty() {
        return Err(Error::settings("the file has one view").help("leave out `view`").into());
    }
    let outputs: Vec<OutputArgs> =
        views.iter().map(|view| output.of_view(view)).collect::<Result<_, Error>>()?;
    outputs.iter().try_for_each(|output| output.check(&job))?;
    for (view, output) in views.into_iter().zip(&outputs) {
        job.read_options.view = Some(view);
        let rendered = one_picture(&job, output, console)?;
        let distance = rendered.lens.focus_distance;
        job.flags.focus = Some(Focus::Distance(distance));
    }
    Ok(())
}

/// Prints what is decided of a picture, and shows how far its blur is.
struct Teller {
    console: Console,
    /// Number of findings that were printed before the blur.
    printed: OnceLock<usize>,
    bar: Bar,
}

impl Watcher for Teller {
    fn decided(&self, decided: &Decided<'_>) -> Result<(), Error> {
        let findings = &decided.stack.findings;
        self.console.findings(findings);
        self.console.plan(decided.plan);
        self.console.device(decided.device);
        self.printed.get_or_init(|| findings.len());
        Ok(())
    }

    fn blurred(&self, share: f32) {
        self.bar.set(share);
    }
}

impl Teller {
    /// Prints what was found during the blur and after it.
    fn finish(self, rendered: &Rendered) {
        drop(self.bar);
        let printed = self.printed.get().copied().unwrap_or_default();
        self.console.findings(rendered.stack.findings.get(printed..).unwrap_or_default());
        if let Some(estimate) = &rendered.probe {
            self.console.estimate(estimate);
        }
    }
}

impl RenderArgs {
    /// The folders that temporary files are made in.
    pub(super) fn folders(&self) -> Vec<PathBuf> {
        self.frames.folders(&self.output)
    }

    /// The job of the picture, or what the jobs of all frames have in common.
    fn job(&self, methods: &Registry) -> Result<Job, Error> {
        Ok(Job {
            verify: self.verify.map(|pixels| pixels as usize),
            confidence: self.output.has_mask(),
            methods: methods.clone(),
            ..self.job.job(self.output.carry())?
        })
    }
}
