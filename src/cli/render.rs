//! `thinlens render`.

use super::args::{DEFAULT_PROBES, JobArgs};
use super::console::Console;
use super::drivers::prepare;
use super::failure::Failure;
use super::outputs::OutputArgs;
use super::sequence::{self, FramesArgs, RunArgs};
use clap::Args;
use std::path::PathBuf;
use thinlens::error::Error;
use thinlens::methods::Registry;
use thinlens::probes::MIN_PROBES;
use thinlens::render::{Job, digest};

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
        return sequence::run(&shot, &job, (frames, output, run), *console);
    }
    run.check_single(frames)?;
    let job = args.job(methods)?;
    output.check(&job)?;
    // Of the files as they are before they are read.
    let digest = digest(&job, &output.encoding());
    let prepared = prepare(&job)?;
    console.findings(&prepared.stack.findings);
    console.plan(&prepared.plan);
    console.device(&prepared.device);
    let printed = prepared.stack.findings.len();
    let bar = console.progress("blurring");
    let mut rendered = prepared.blur(&|share| bar.set(share))?;
    drop(bar);
    rendered.set_digest(digest?);
    console.findings(&rendered.stack.findings[printed..]);
    if let Some(estimate) = &rendered.probe {
        console.estimate(estimate);
    }
    console.findings(&output.write(&job, &mut rendered)?);
    output.print_report(&job, &rendered)?;
    for file in output.files()? {
        console.wrote(file);
    }
    Ok(())
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
