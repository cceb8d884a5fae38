//! Accuracy against a true thin lens, and what causes the error, for every stack of a folder of scenes.
//!
//! `cargo run --release --example accuracy -- samples [VIEWS …]`
//!
//! A scene is a folder with a `preset.toml`, a `reference.exr` rendered with the lens on, and any of the stacks in [`INPUTS`]. A stack
//! with overscan is cropped to its display window. The first table has PSNR in dB of sRGB-encoded, clipped values over the whole picture.
//! The second divides the squared error at the last number of views among the causes of [`Cause`]; each cell has the cause's share of the
//! pixels, its share of the squared error, and the PSNR of these pixels alone.

#![expect(clippy::print_stdout, reason = "the tables are the result")]

mod budget;
mod causes;
mod distance;
mod front;
mod reach;

use budget::{Budget, Part};
use causes::{Cause, causes};
use std::path::{Path, PathBuf};
use thinlens::error::Error;
use thinlens::metrics::score;
use thinlens::render::{Job, NamedPreset, prepare};
use thinlens::settings::{Effort, Preset, Values};
use thinlens::stack::{FramedImage, Source, read_framed_picture};

/// The stacks of a scene, and the samples per pixel along each axis where the file does not say.
const INPUTS: [(&str, Option<usize>); 5] = [
    ("stack.exr", None),
    ("stack_coverage.exr", None),
    ("stack_coverage_overscan.exr", None),
    ("stack_2x.exr", Some(2)),
    ("pinhole.exr", None),
];

fn main() -> Result<(), Error> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| "samples".to_owned()));
    let views: Vec<usize> = arguments.filter_map(|views| views.parse().ok()).collect();
    let views = if views.is_empty() { vec![16, 64, 256] } else { views };
    let mut budgets = Vec::new();
    println!("{:<40}{}", "dB at", views.iter().map(|n| format!("{n:>7} views")).collect::<String>());
    for scene in scenes(&folder) {
        let reference = read_framed_picture(&scene.join("reference.exr"))?;
        for (name, supersample) in INPUTS {
            let input = scene.join(name);
            if !input.is_file() {
                continue;
            }
            let label = input.strip_prefix(&folder).unwrap_or(&input).display().to_string();
            let (mut line, mut last) = (format!("{label:<40}"), None);
            for &views in &views {
                let compared = compared(&job(&scene, &input, supersample, views)?, &reference)?;
                line += &format!("{:>13.2}", compared.psnr_db);
                last = Some(compared.budget);
            }
            println!("{line}");
            budgets.extend(last.map(|budget| (label, budget)));
        }
    }
    println!();
    print_budgets(&budgets, views.last().copied().unwrap_or_default());
    Ok(())
}

/// A picture against the reference.
struct Compared {
    psnr_db: f64,
    budget: Budget,
}

/// Renders `job` and compares what its display window shows with `reference`.
///
/// # Errors
/// Those of the render, and a picture that differs in size from `reference`.
fn compared(job: &Job, reference: &FramedImage) -> Result<Compared, Error> {
    let prepared = prepare(job)?;
    let causes = causes(&prepared.scene);
    let rendered = prepared.blur(&|_| {})?;
    let [part, of_reference] = rendered.frame.shared_with(&reference.frame)?;
    let width = rendered.image.width();
    let image = FramedImage { image: rendered.image, frame: rendered.frame }.part(part);
    let reference = reference.clone().part(of_reference);
    let psnr_db = score(&image, &reference, 0)?.psnr_db;
    let [left, top] = [part.x, part.y].map(|start| start.unsigned_abs() as usize);
    let cause_at = |x: usize, y: usize| causes[(y + top) * width + x + left];
    Ok(Compared { psnr_db, budget: Budget::new(&image, &reference, cause_at) })
}

fn print_budgets(budgets: &[(String, Budget)], views: usize) {
    let names: String = Cause::ALL.iter().map(|cause| format!("{:>22}", cause.name())).collect();
    println!("{:<40}{names}", format!("pixels, error, dB at {views} views"));
    for (label, budget) in budgets {
        let cell = |cause: &Cause| match budget.part(*cause) {
            Some(Part { pixels, error, psnr_db }) => {
                format!("{:>7.1} %{:>5.0} %{psnr_db:>6.1}", 100.0 * pixels, 100.0 * error)
            }
            None => format!("{:>22}", "–"),
        };
        println!("{label:<40}{}", Cause::ALL.iter().map(cell).collect::<String>());
    }
}

/// The scenes in `folder`, sorted by name.
fn scenes(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut scenes: Vec<PathBuf> = entries.filter(|path| path.join("reference.exr").is_file()).collect();
    scenes.sort();
    scenes
}

fn job(scene: &Path, input: &Path, supersample: Option<usize>, views: usize) -> Result<Job, Error> {
    let path = scene.join("preset.toml");
    let name = path.display().to_string();
    let text = std::fs::read_to_string(&path)
        .map_err(|error| Error::input("the scene's preset cannot be read").in_file(&path).caused_by(error))?;
    Ok(Job {
        sources: vec![Source::File(input.to_owned())],
        preset: Some(NamedPreset { preset: Preset::parse(&text, &name)?, name }),
        flags: Values { effort: Some(Effort::Views(views)), supersample, ..Values::default() },
        ..Job::default()
    })
}
