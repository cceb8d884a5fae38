//! Accuracy against a true thin lens, for every stack of a folder of scenes.
//!
//! `cargo run --release --example accuracy -- samples [VIEWS …]`
//!
//! A scene is a folder with a `preset.toml`, a `reference.exr` rendered with the lens on, and any of `stack.exr`,
//! `stack_coverage.exr`, `stack_2x.exr` and `pinhole.exr`. Figures are PSNR in dB of sRGB-encoded, clipped values over the whole picture.

#![expect(clippy::print_stdout, reason = "the table is the result")]

use std::path::{Path, PathBuf};
use thinlens::error::Error;
use thinlens::metrics::score;
use thinlens::render::{Job, NamedPreset, render};
use thinlens::settings::{Effort, Preset, Values};
use thinlens::stack::{Source, read_picture};

const INPUTS: [(&str, Option<usize>); 4] =
    [("stack.exr", None), ("stack_coverage.exr", None), ("stack_2x.exr", Some(2)), ("pinhole.exr", None)];

fn main() -> Result<(), Error> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| "samples".to_owned()));
    let views: Vec<usize> = arguments.filter_map(|views| views.parse().ok()).collect();
    let views = if views.is_empty() { vec![16, 64, 256] } else { views };
    println!("{:<32}{}", "dB at", views.iter().map(|n| format!("{n:>7} views")).collect::<String>());
    for scene in scenes(&folder) {
        let reference = read_picture(&scene.join("reference.exr"))?;
        for (name, supersample) in INPUTS {
            let input = scene.join(name);
            if !input.is_file() {
                continue;
            }
            let mut line = format!("{:<32}", input.strip_prefix(&folder).unwrap_or(&input).display());
            for &views in &views {
                let job = job(&scene, &input, supersample, views)?;
                let image = render(&job, &|_| {})?.image;
                line += &format!("{:>13.2}", score(&image, &reference, 0)?.psnr_db);
            }
            println!("{line}");
        }
    }
    Ok(())
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
