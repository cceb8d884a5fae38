//! Accuracy and cost of every method on a folder of scenes.
//!
//! `cargo run --release --example survey -- samples [METHOD | METHOD:VIEWS …]`
//!
//! With `THINLENS_PICTURES=FOLDER` it writes each picture there as a PNG, next to the reference.
//!
//! A scene is a folder with a `stack.exr`, a `preset.toml` and a `reference.exr` rendered with the lens on. Figures are PSNR
//! in dB and SSIM of sRGB-encoded, clipped values over the whole picture; CPU and wall seconds are those of the blur alone, in one run.

#![expect(clippy::print_stdout, reason = "the table is the result")]

use std::path::{Path, PathBuf};
use thinlens::error::Error;
use thinlens::image::Image;
use thinlens::methods::METHODS;
use thinlens::metrics::score;
use thinlens::output::png;
use thinlens::render::{Job, NamedPreset, prepare};
use thinlens::settings::{Effort, Preset, Values};
use thinlens::stack::{Source, read_picture};

fn main() -> Result<(), Error> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| "samples".to_owned()));
    let mut methods: Vec<String> = arguments.collect();
    if methods.is_empty() {
        methods = METHODS.iter().map(|method| method.info().name.to_owned()).collect();
    }
    println!("{:<12}{:<26}{:>8}{:>8}{:>10}{:>10}", "scene", "method", "dB", "SSIM", "CPU s", "wall s");
    for scene in scenes(&folder) {
        let reference = read_picture(&scene.join("reference.exr"))?;
        let name = scene.file_name().unwrap_or_default().to_string_lossy().into_owned();
        for method in &methods {
            let (image, cpu, wall) = blur(&scene, method)?;
            let score = score(&image, &reference, 0)?;
            println!(
                "{name:<12}{method:<26}{:>8.2}{:>8.4}{cpu:>10.2}{wall:>10.2}",
                score.psnr_db,
                score.ssim.unwrap_or(f64::NAN)
            );
            if let Ok(pictures) = std::env::var("THINLENS_PICTURES") {
                let file = Path::new(&pictures).join(format!("{name}-{}.png", method.replace(':', "-")));
                png::write_side_by_side(&file, &[&image, &reference], 0.0)?;
            }
        }
    }
    Ok(())
}

/// The scenes in `folder` that have a stack, sorted by name.
fn scenes(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let is_scene = |path: &PathBuf| path.join("reference.exr").is_file() && path.join("stack.exr").is_file();
    let mut scenes: Vec<PathBuf> = entries.filter(is_scene).collect();
    scenes.sort();
    scenes
}

/// The picture of a scene's stack by `method`, which is `NAME` or `NAME:VIEWS`, with CPU and wall seconds of the blur.
fn blur(scene: &Path, method: &str) -> Result<(Image, f64, f64), Error> {
    let (method, views) = match method.split_once(':') {
        Some((method, views)) => (method, views.parse().ok()),
        None => (method, None),
    };
    let path = scene.join("preset.toml");
    let name = path.display().to_string();
    let job = Job {
        sources: vec![Source::File(scene.join("stack.exr"))],
        preset: Some(NamedPreset { preset: Preset::load(&name)?, name }),
        flags: Values {
            effort: views.map(Effort::Views),
            method: Some(method.to_owned()),
            ..Values::default()
        },
        ..Job::default()
    };
    let rendered = prepare(&job)?.blur(&|_| {})?;
    let (cpu, wall) = (rendered.clock.cpu_seconds().blur, rendered.clock.seconds().blur);
    Ok((rendered.image, cpu, wall))
}
