//! `thinlens demo`.

use super::Failure;
use super::console::{Console, print};
use super::report::{Outcome, report};
use super::write::{self, Codec, ExrOptions};
use clap::Args;
use std::path::{Path, PathBuf};
use std::time::Instant;
use thinlens::error::Error;
use thinlens::image::Image;
use thinlens::render::{Job, NamedPreset, Rendered, render};
use thinlens::settings::{Preset, Values};
use thinlens::stack::{Source, read_picture};

static STACK: &[u8] = include_bytes!("../../samples/fence/stack.exr");
static PRESET: &str = include_str!("../../samples/fence/preset.toml");
static REFERENCE: &[u8] = include_bytes!("../../samples/fence/reference.exr");

const EXAMPLES: &str = "\
Examples:
  thinlens demo
  thinlens demo -o /tmp/demo
  thinlens demo --threads 1";

/// Render a sample that is on board
///
/// Writes fence.exr, fence.png, side-by-side.png (pinhole and result) and report.json.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct DemoArgs {
    /// Where to write; created if need be
    #[arg(long, short, value_name = "DIR", default_value = "thinlens-demo", help_heading = "Output")]
    output: PathBuf,
}

pub(super) fn run(args: &DemoArgs, console: &Console) -> Result<(), Failure> {
    let start = Instant::now();
    std::fs::create_dir_all(&args.output).map_err(|cause| {
        Error::output("the demo's folder cannot be created")
            .in_file(&args.output)
            .caused_by(cause)
            .help("name another one with -o")
    })?;
    let job = job()?;
    let rendered = show_progress(&job, console)?;
    let pinhole = pinhole(&job)?;

    let write_start = Instant::now();
    let file = |name: &str| args.output.join(name);
    let written = [file("fence.exr"), file("fence.png"), file("side-by-side.png"), file("report.json")];
    write_pictures(&written, &rendered, &pinhole)?;
    let outcome = Outcome {
        inputs: &[PathBuf::from("samples/fence/stack.exr")],
        output: &written[0],
        rendered: &rendered,
        write_seconds: write_start.elapsed().as_secs_f64(),
        total_seconds: start.elapsed().as_secs_f64(),
    };
    write::report(&written[3], &report(&outcome))?;
    let psnr_db = write::score(&rendered.image, &reference()?, 0)?.psnr_db;
    print(&summary(&written, &rendered, psnr_db))?;
    Ok(())
}

fn job() -> Result<Job, Error> {
    let name = "samples/fence/preset.toml";
    Ok(Job {
        sources: vec![Source::Embedded { name: "samples/fence/stack.exr", bytes: STACK }],
        preset: Some(NamedPreset { name: name.to_owned(), preset: Preset::parse(PRESET, name)? }),
        ..Job::default()
    })
}

fn show_progress(job: &Job, console: &Console) -> Result<Rendered, Error> {
    let bar = console.progress("blurring");
    render(job, &|share| bar.set(share))
}

/// The same stack without a lens.
fn pinhole(job: &Job) -> Result<Image, Error> {
    let flags = Values { f_number: Some(f32::INFINITY), ..Values::default() };
    Ok(render(&Job { flags, ..job.clone() }, &|_| ())?.image)
}

fn write_pictures(
    [exr, png, side_by_side, _]: &[PathBuf; 4],
    rendered: &Rendered,
    pinhole: &Image,
) -> Result<(), Error> {
    let Rendered { image, stack, .. } = rendered;
    let options = ExrOptions { precision: stack.precision, codec: Codec::Zip };
    write::exr(exr, image, &stack.frame, &stack.carried, options)?;
    write::png(png, image, 0.0)?;
    write::png_side_by_side(side_by_side, &[pinhole, image], 0.0)
}

/// The sample as a true thin lens saw it.
fn reference() -> Result<Image, Error> {
    let no_room = |cause| Error::output("no temporary file can be made").caused_by(cause);
    let file = tempfile::Builder::new().suffix(".exr").tempfile().map_err(no_room)?;
    std::fs::write(file.path(), REFERENCE).map_err(no_room)?;
    read_picture(file.path())
}

fn summary(written: &[PathBuf], rendered: &Rendered, psnr_db: f64) -> String {
    let wrote = |path: &PathBuf| format!("wrote {}\n", Path::display(path));
    let files: String = written.iter().map(wrote).collect();
    format!(
        "{files}{}×{} pixels, {} peels, method {}, {} views\nread {:.3} s, plan {:.3} s, blur {:.3} s\nPSNR {psnr_db:.1} \
         dB against a true thin-lens render of the scene\n",
        rendered.image.width(),
        rendered.image.height(),
        rendered.stack.peels,
        rendered.plan.method,
        rendered.plan.views,
        rendered.seconds.read,
        rendered.seconds.plan,
        rendered.seconds.blur,
    )
}
