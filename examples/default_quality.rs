//! Default quality beside a fixed 64 views, for the stacks of a folder of scenes under their own lens and every built-in preset.
//!
//! `cargo run --release --example default_quality -- samples [WORD …]`
//!
//! Only lines that contain one of the words are measured, or all without words. With `THINLENS_QUALITY` the quality is another one than
//! `final`. A scene is a folder with a `preset.toml`, a `reference.exr` rendered with the lens on, and `stack.exr`, `pinhole.exr` or both;
//! built-in presets get the scene's focus distance.
//!
//! * `default`, `64`: PSNR in dB against the same method with 1024 views.
//! * `measured`: the error that the search reports, with its 95 % interval; `~` before what it expected without a measurement.
//! * `lens`: the same two against the reference, under the scene's own lens.
//! * `CPU s`: of the blur, search included; medians of alternating runs.
//!
//! The last column says `worse` where the default is both dearer, by more than a tenth, and less accurate than 64 views. The
//! line `pan` of a scene has the number of views of each frame of a camera that pans over it, with the error first measured.

#![expect(clippy::print_stdout, reason = "the table is the result")]

use std::path::{Path, PathBuf};
use thinlens::error::Error;
use thinlens::finish::finish;
use thinlens::image::{Image, Plane};
use thinlens::methods::{self, Plan, Target};
use thinlens::metrics::score;
use thinlens::render::{Job, NamedPreset, Prepared, prepare};
use thinlens::sample_budget::{self, Outcome};
use thinlens::scene::{EffectKind, Layer, Scene};
use thinlens::settings::{BUILT_IN, Effort, Origin, Preset, Quality, Settings, Sourced, Values};
use thinlens::stack::{Source, read_picture};
use thinlens::usage::Stopwatch;

/// Views of the picture that stands for the converged one.
const MANY_VIEWS: usize = 1024;

/// The fixed number of views to compare with.
const FIXED_VIEWS: usize = 64;

/// Runs of each picture whose time is taken.
const RUNS: usize = 3;

/// Frames of the pan, and columns from one to the next.
const PAN: [usize; 2] = [24, 3];

fn main() -> Result<(), Error> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| "samples".to_owned()));
    let words: Vec<String> = arguments.collect();
    let is_wanted = |name: &str| words.is_empty() || words.iter().any(|word| name.contains(word.as_str()));
    let quality = std::env::var("THINLENS_QUALITY").unwrap_or_default();
    let quality = Quality::ALL.into_iter().find(|known| known.name() == quality).unwrap_or(Quality::Final);
    println!(
        "{:<34}{:>6}{:>9}{:>8}  {:<26}{:>15}{:>18}",
        "stack, lens", "views", "default", "64", "measured", "lens", "CPU s, 64: CPU s"
    );
    for scene in scenes(&folder) {
        let own = own_preset(&scene)?;
        let reference = read_picture(&scene.join("reference.exr"))?;
        for input in ["stack.exr", "pinhole.exr"].map(|name| scene.join(name)) {
            let lenses = BUILT_IN.iter().map(|preset| preset.name);
            for lens in std::iter::once("own").chain(lenses) {
                let shown = input.strip_prefix(&folder).unwrap_or(&input).display();
                let name = format!("{shown} {lens}");
                if !input.is_file() || !is_wanted(&name) {
                    continue;
                }
                let prepared = prepare(&job(&input, lens, &own)?)?;
                let against = (lens == "own").then_some(&reference);
                println!("{name:<34}{}", line(&prepared, quality, against)?);
            }
        }
        let name = format!("{} pan", scene.strip_prefix(&folder).unwrap_or(&scene).display());
        if is_wanted(&name) {
            let prepared = prepare(&job(&scene.join("stack.exr"), "own", &own)?)?;
            println!("{name:<34}{}", pan(&prepared, quality)?);
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

fn own_preset(scene: &Path) -> Result<NamedPreset, Error> {
    let name = scene.join("preset.toml").display().to_string();
    Ok(NamedPreset { preset: Preset::load(&name)?, name })
}

/// The picture of `input` through the built-in preset `lens` at the focus and in the units of the scene's `own` preset, or through that.
fn job(input: &Path, lens: &str, own: &NamedPreset) -> Result<Job, Error> {
    let job = Job::new([Source::File(input.to_owned())]);
    if lens == "own" {
        return Ok(Job { preset: Some(own.clone()), ..job });
    }
    let Values { focus, convention, metres_per_unit, .. } = own.preset.values.clone();
    let values = Values { focus, convention, metres_per_unit, ..Values::default() };
    Ok(job.with_preset(lens, Preset::load(lens)?).with_values(values))
}

/// The settings of `prepared` with another effort.
fn settings(prepared: &Prepared, effort: Effort) -> Settings {
    let mut settings = prepared.settings.clone();
    settings.effort = Sourced { value: Some(effort), origin: Origin::Flag };
    settings
}

/// The plan of `prepared` with another effort.
fn plan(prepared: &Prepared, effort: Effort) -> Result<Plan, Error> {
    prepared.methods.plan(&prepared.stats, &settings(prepared, effort))
}

/// The default picture, search included, and what the search found.
fn default_picture(scene: Scene, plan: &Plan) -> Result<(Image, Option<Outcome>), Error> {
    match plan.target.filter(|_| plan.does(EffectKind::Blur)) {
        Some(Target::Error { psnr_db, max_views }) => {
            let found = sample_budget::render_to_target(scene, plan, (psnr_db, max_views), &|_| {})?;
            Ok((found.0, Some(found.1)))
        }
        _ => Ok((methods::render(scene, plan, &|_| {})?, None)),
    }
}

/// One line of the table, without its name.
fn line(prepared: &Prepared, quality: Quality, reference: Option<&Image>) -> Result<String, Error> {
    let scene = &prepared.scene;
    let [default, fixed, many] =
        [Effort::Quality(quality), Effort::Views(FIXED_VIEWS), Effort::Views(MANY_VIEWS)]
            .map(|effort| plan(prepared, effort));
    let [default, fixed, many] = [default?, fixed?, many?];
    let (mut seconds, mut pictures) = ([Vec::new(), Vec::new()], None);
    for _ in 0..RUNS {
        let (scenes, mut watch) = ([scene.clone(), scene.clone()], Stopwatch::start());
        let [first, second] = scenes;
        let by_default = default_picture(first, &default)?;
        seconds[0].push(watch.cpu_seconds());
        watch = Stopwatch::start();
        let by_fixed = methods::render(second, &fixed, &|_| {})?;
        seconds[1].push(watch.cpu_seconds());
        pictures = Some((by_default, by_fixed));
    }
    let Some(((by_default, outcome), by_fixed)) = pictures else { return Ok(String::new()) };
    let converged = finished(methods::render(scene.clone(), &many, &|_| {})?, &many, scene);
    let (by_default, by_fixed) = (finished(by_default, &default, scene), finished(by_fixed, &fixed, scene));
    let psnr_db = |image: &Image, against: &Image| Ok::<f64, Error>(score(image, against, 0)?.psnr_db);
    let [found_db, fixed_db] = [psnr_db(&by_default, &converged)?, psnr_db(&by_fixed, &converged)?];
    let lens = match reference {
        Some(reference) => {
            format!("{:.2} {:.2}", psnr_db(&by_default, reference)?, psnr_db(&by_fixed, reference)?)
        }
        None => String::new(),
    };
    let [found_s, fixed_s] = seconds.map(median);
    let worse = if found_s > 1.1 * fixed_s && found_db < fixed_db { "worse" } else { "" };
    let views = outcome.as_ref().map_or(0, |outcome| outcome.views);
    let measured = outcome.as_ref().map_or_else(String::new, said);
    Ok(format!(
        "{views:>6}{found_db:>9.2}{fixed_db:>8.2}  {measured:<26}{lens:>15}{found_s:>10.3}{fixed_s:>8.3} {worse}"
    ))
}

/// The error that the search reports.
fn said(outcome: &Outcome) -> String {
    let expected = outcome.expected_db.map_or_else(String::new, |db| format!("~{db:.1}"));
    outcome.estimate().map_or(expected.clone(), |estimate| format!("{} {expected}", estimate.summary()))
}

/// `blurred` as the file has it.
fn finished(blurred: Image, plan: &Plan, scene: &Scene) -> Image {
    finish(blurred, plan, scene.field).trimmed(scene.outside_px)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// The numbers of views of a camera that pans over the scene, as one text.
fn pan(prepared: &Prepared, quality: Quality) -> Result<String, Error> {
    let [frames, step_px] = PAN;
    let scene = &prepared.scene;
    let width = scene.width().saturating_sub(frames * step_px * scene.supersample);
    let mut numbers = Vec::new();
    for frame in 0..frames {
        let from = frame * step_px * scene.supersample;
        let cut = |plane: &Plane| Plane::from_fn(width, plane.height(), |x, y| plane.get(from + x, y));
        let layers = scene.layers.iter().map(|layer| Layer {
            color: layer.color.each_ref().map(cut),
            alpha: cut(&layer.alpha),
            coc_px: cut(&layer.coc_px),
        });
        let frame = Scene::new(layers.collect(), scene.kind, scene.supersample, scene.coc_infinity_px);
        let settings = settings(prepared, Effort::Quality(quality));
        let plan = prepared.methods.plan(&frame.analyze(), &settings)?;
        if let Some(Target::Error { psnr_db, max_views }) = plan.target {
            let outcome = sample_budget::find_views(frame, &plan, (psnr_db, max_views))?;
            let measured = outcome.tried.first().and_then(|trial| trial.estimate.psnr_db);
            numbers.push(format!("{} ({:.1})", outcome.views, measured.unwrap_or(f64::NAN)));
        }
    }
    Ok(numbers.join(" "))
}
