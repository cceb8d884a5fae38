//! `thinlens demo`.

use super::checks;
use super::console::{Console, print};
use super::drivers::prepare;
use super::failure::Failure;
use clap::Args;
use std::path::PathBuf;
use thinlens::error::Error;
use thinlens::image::Image;
use thinlens::metrics;
use thinlens::output::exr::{self, Codec, ExrOptions};
use thinlens::output::png;
use thinlens::output::report::{self, Report};
use thinlens::render::{Job, NamedPreset, Rendered};
use thinlens::settings::{Preset, Values};
use thinlens::stack::{Source, read_picture};
use thinlens::usage::Stage;

const STACK_NAME: &str = "samples/terrace/stack.exr";
const PRESET_NAME: &str = "samples/terrace/preset.toml";
static STACK: &[u8] = include_bytes!("../../samples/terrace/stack.exr");
static PRESET: &str = include_str!("../../samples/terrace/preset.toml");
static REFERENCE: &[u8] = include_bytes!("../../samples/terrace/reference.exr");

const EXAMPLES: &str = "\
Examples:
  thinlens demo
  thinlens demo -o /tmp/demo
  thinlens demo --threads 1";

/// Render the built-in sample
///
/// Writes terrace.exr, terrace.png, side-by-side.png (pinhole, result, reference render with the lens on) and report.json.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct DemoArgs {
    /// Output folder; created if it does not exist
    #[arg(long, short, value_name = "DIR", default_value = "thinlens-demo", help_heading = "Output")]
    output: PathBuf,
}

pub(super) fn run(args: &DemoArgs, console: &Console) -> Result<(), Failure> {
    checks::folder(&args.output)?;
    let job = job()?;
    let (pinhole, reference) = (pinhole(&job)?, reference()?);
    let mut rendered = show_progress(&job, console)?;

    let files =
        ["terrace.exr", "terrace.png", "side-by-side.png", "report.json"].map(|name| args.output.join(name));
    rendered.clock.skip();
    write_pictures(&files, &rendered, [&pinhole, &reference])?;
    rendered.clock.lap(Stage::Write);
    let report = rendered.report(vec![STACK_NAME.to_owned()], files[0].display().to_string());
    report::write_json(&files[3], &report)?;
    let psnr_db = metrics::score(&rendered.image, &reference, 0)?.psnr_db;
    print(&summary(&files, &report, psnr_db))?;
    Ok(())
}

impl DemoArgs {
    /// The folders that temporary files are made in.
    pub(super) fn folders(&self) -> Vec<PathBuf> {
        vec![self.output.clone()]
    }
}

fn job() -> Result<Job, Error> {
    Ok(Job {
        sources: vec![Source::memory(STACK_NAME, STACK)],
        preset: Some(NamedPreset {
            name: PRESET_NAME.to_owned(),
            preset: Preset::parse(PRESET, PRESET_NAME)?,
        }),
        ..Job::default()
    })
}

fn show_progress(job: &Job, console: &Console) -> Result<Rendered, Error> {
    let bar = console.progress("blurring");
    prepare(job)?.blur(&|share| bar.set(share))
}

/// The stack without a lens.
fn pinhole(job: &Job) -> Result<Image, Error> {
    let flags = Values { f_number: Some(f32::INFINITY), ..Values::default() };
    Ok(prepare(&Job { flags, ..job.clone() })?.blur(&|_| ())?.image)
}

fn write_pictures(
    [exr, png, side_by_side, _]: &[PathBuf; 4],
    rendered: &Rendered,
    [pinhole, reference]: [&Image; 2],
) -> Result<(), Error> {
    let Rendered { image, frame, stack, .. } = rendered;
    let options = ExrOptions { precision: stack.precision, codec: Codec::default() };
    exr::write(exr, image, frame, &stack.carried, &options)?;
    png::write(png, image, 0.0)?;
    png::write_side_by_side(side_by_side, &[pinhole, image, reference], 0.0)
}

/// The scene rendered with the lens on.
fn reference() -> Result<Image, Error> {
    let failed = |cause| Error::output("a temporary file cannot be created").caused_by(cause);
    let file = tempfile::Builder::new().suffix(".exr").tempfile().map_err(failed)?;
    std::fs::write(file.path(), REFERENCE).map_err(failed)?;
    read_picture(file.path())
}

fn summary(files: &[PathBuf], report: &Report, psnr_db: f64) -> String {
    let wrote = |path: &PathBuf| format!("wrote {}\n", path.display());
    let files: String = files.iter().map(wrote).collect();
    let Report { stack, seconds, method, .. } = report;
    let views = report.views.map(|views| format!(", {views} views")).unwrap_or_default();
    format!(
        "{files}{}×{} pixels, {} peels, method {method}{views}\n\
         read {:.3} s, plan {:.3} s, blur {:.3} s, write {:.3} s\n\
         PSNR {psnr_db:.1} dB against a reference render with the lens on\n",
        stack.width, stack.height, stack.peels, seconds.read, seconds.plan, seconds.blur, seconds.write,
    )
}
