//! Measures the methods, fits their cost terms (`cost.rs` in each method's folder), and reports the error of predictions.
//!
//! `cargo run --release --example cost_model -- samples [MEASUREMENTS.csv]`
//!
//! A scene is a folder with a `preset.toml` and any of `stack.exr`, `stack_coverage.exr`, `stack_2x.exr` and `pinhole.exr`, each blurred by
//! several lenses; one generated scene is added. Seconds are processor seconds of the blur, the median of three alternating runs.
//! They are stored in the file given as second argument; a case that has a figure there is not run again.
//!
//! Errors are `predicted / measured − 1` for each scene, predicted by a fit without that scene, and by one to all of them; `X` and `X_hd` count
//! as one scene.

#![expect(clippy::print_stdout, reason = "the table is the result")]

#[path = "../benches/scene/mod.rs"]
mod scene;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use thinlens::compare::Candidate;
use thinlens::cost::{terms, timed};
use thinlens::error::Error;
use thinlens::methods::{self, METHODS, Plan, Registry};
use thinlens::output::atomic;
use thinlens::render::{Job, NamedPreset, prepare};
use thinlens::scene::{Scene, SceneStats};
use thinlens::settings::{ParameterValues, Preset, Settings, Values};
use thinlens::stack::Source;
use thinlens::usage::Stopwatch;

const INPUTS: [(&str, Option<usize>); 4] =
    [("stack.exr", None), ("pinhole.exr", None), ("stack_coverage.exr", None), ("stack_2x.exr", Some(2))];

/// Factors by which the preset's f-number is divided.
const WIDER: [f32; 2] = [1.0, 0.4];

/// The candidates that are measured; methods that trace rays are slow, so they have few views.
const CANDIDATES: &str = "shear:16 shear:64 shear:256 accumulate:2 accumulate:4 accumulate:32 recursive-gaussian:layers=4 \
    recursive-gaussian:layers=16 recursive-gaussian b-buffer point-splat point-splat:accelerated=false point-splat:hidden=false \
    layer-rays:2 layer-rays:4 layer-rays:32 layer-rays:4+cones=false layer-rays:4+iterations=6 layer-rays:4+delta_px=1 \
    opaque-blur opaque-blur:first_radius_px=0.85 opaque-blur:first_radius_px=3.4 \
    peel-rays:2 peel-rays:4 peel-rays:32 peel-rays:3+binary_steps=1+linear_steps=20 \
    pyramid-disocclusion pyramid-disocclusion:first_radius_px=0.85 pyramid-disocclusion:first_radius_px=3.4 \
    gather:64 gather:256 gather:1024 scatter";

/// Largest numbers of rays, and of pixels of sprites; a case with more is left out.
const MAX_RAYS: f64 = 9e6;
const MAX_SPRITES: f64 = 6e7;

/// One scene through one lens.
struct Case {
    group: String,
    name: String,
    scene: Scene,
    settings: Settings,
}

/// A measurement, with its amounts of work by term.
struct Sample {
    group: String,
    name: String,
    terms: Vec<(&'static str, f64)>,
    seconds: f64,
}

type Measurements = BTreeMap<String, f64>;

fn main() -> Result<(), Error> {
    let mut arguments = std::env::args().skip(1).map(PathBuf::from);
    let folder = arguments.next().unwrap_or_else(|| PathBuf::from("samples"));
    let file = arguments.next();
    let mut measurements = file.as_deref().map(read).unwrap_or_default();
    let mut samples: BTreeMap<&'static str, Vec<Sample>> = BTreeMap::new();
    let mut add = |case: Case| -> Result<(), Error> {
        for (method, sample) in measure(&case, &mut measurements)? {
            samples.entry(method).or_default().push(sample);
        }
        file.as_deref().map_or(Ok(()), |file| write(file, &measurements))
    };
    for folder in folders(&folder) {
        for input in INPUTS {
            for wider in WIDER {
                if let Some(case) = read_case(&folder, input, wider)? {
                    add(case)?;
                }
            }
        }
    }
    for (size, coc_px) in [((960, 540), 8.0), ((960, 540), 48.0), ((320, 180), 100.0), ((1920, 1080), 20.0)] {
        add(made(size, coc_px, 0))?;
    }
    for (size, lights) in [((640, 360), 300), ((960, 540), 5000)] {
        add(made(size, 24.0, lights))?;
    }
    for (kind, cpu_seconds, speed_up) in timed()? {
        println!("calibration, {kind:?}: {cpu_seconds:.4} CPU s, speed-up {speed_up:.2}");
    }
    println!("{:<29}{:^20}{:^20}", "", "fitted without it", "fitted to all");
    println!(
        "{:<22}{:>7}{:>10}{:>10}{:>10}{:>10}   worst",
        "method", "cases", "median", "90 %", "median", "90 %"
    );
    for method in names() {
        report(method, samples.get(method).map_or(&[], Vec::as_slice));
    }
    for method in names() {
        print_fit(method, samples.get(method).map_or(&[], Vec::as_slice));
    }
    Ok(())
}

fn names() -> impl Iterator<Item = &'static str> {
    std::iter::once("pinhole").chain(METHODS.iter().map(|method| method.info().name))
}

fn folders(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut folders: Vec<PathBuf> = entries.filter(|path| path.join("preset.toml").is_file()).collect();
    folders.sort();
    folders
}

fn read_case(
    folder: &Path,
    (input, supersample): (&str, Option<usize>),
    wider: f32,
) -> Result<Option<Case>, Error> {
    let (file, preset) = (folder.join(input), folder.join("preset.toml"));
    // Only point-sampled stacks and pinhole pictures are blurred by several lenses.
    if !file.is_file() || (wider != 1.0 && input != "stack.exr" && input != "pinhole.exr") {
        return Ok(None);
    }
    let text = fs::read_to_string(&preset).map_err(|error| {
        Error::input("the scene's preset cannot be read").in_file(&preset).caused_by(error)
    })?;
    let name = preset.display().to_string();
    let preset = Preset::parse(&text, &name)?;
    let f_number = preset.values.f_number.unwrap_or(2.8) / wider;
    let prepared = prepare(&Job {
        sources: vec![Source::File(file)],
        preset: Some(NamedPreset { name, preset }),
        flags: Values { f_number: Some(f_number), supersample, ..Values::default() },
        ..Job::default()
    })?;
    let scene_name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Ok(Some(Case {
        group: scene_name.trim_end_matches("_hd").to_owned(),
        name: format!("{scene_name}/{input}/{wider}"),
        scene: prepared.scene,
        settings: prepared.settings,
    }))
}

/// The benches' scene with CoC radii up to `coc_px` and about `lights` lights.
fn made(size: (usize, usize), coc_px: f32, lights: usize) -> Case {
    let mut scene = scene::scaled(&scene::synthetic(size.0, size.1), coc_px);
    let every = (size.0 * size.1).checked_div(lights).unwrap_or(usize::MAX);
    for plane in scene.layers.iter_mut().take(1).flat_map(|layer| &mut layer.color) {
        plane.values_mut().iter_mut().skip(every / 2).step_by(every).for_each(|value| *value = 50.0);
    }
    Case {
        group: "made".to_owned(),
        name: format!("made/{} × {}/{coc_px}/{lights}", size.0, size.1),
        scene,
        settings: Settings::resolve(&[], ParameterValues::default()),
    }
}

/// Measures the candidates of `case` that are not in `measurements`, and returns the samples of all.
fn measure(case: &Case, measurements: &mut Measurements) -> Result<Vec<(&'static str, Sample)>, Error> {
    let (stats, registry) = (case.scene.analyze(), Registry::default());
    let mut plans = Vec::new();
    for text in CANDIDATES.split_whitespace() {
        let candidate = Candidate::parse(text, &registry)?;
        let plan = registry.plan(&stats, &candidate.settings(&case.settings)?)?;
        let terms = amounts(&stats, &plan);
        if is_affordable(&terms, plan.method.name()) {
            plans.push((candidate.method.name(), format!("{}|{candidate}", case.name), plan, terms));
        }
    }
    let blurless = Settings::resolve(&[], ParameterValues::default());
    let mut plan = registry.plan(&stats, &blurless)?.forced(thinlens::scene::EffectKind::Blur, false);
    plan.views = None;
    let terms = amounts(&stats, &plan);
    plans.push(("pinhole", format!("{}|pinhole", case.name), plan, terms));
    let mut runs: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for _ in 0..3 {
        for (_, name, plan, _) in plans.iter().filter(|(_, name, ..)| !measurements.contains_key(name)) {
            let runs = runs.entry(name).or_default();
            // A long run is hardly disturbed by other load, so it is not repeated.
            if runs.first().is_none_or(|seconds| *seconds < 0.2) {
                runs.push(run(&case.scene, plan)?);
            }
        }
    }
    measurements.extend(runs.into_iter().map(|(name, runs)| (name.to_owned(), median(runs))));
    let sample = |(method, name, _, terms): (_, String, _, _)| {
        let seconds = measurements[&name];
        (method, Sample { group: case.group.clone(), name, terms, seconds })
    };
    Ok(plans.into_iter().map(sample).collect())
}

/// The amounts of work of `plan`, by the terms' names.
fn amounts(stats: &SceneStats, plan: &Plan) -> Vec<(&'static str, f64)> {
    let cost = terms(stats, plan).expect("every built-in method says its cost");
    cost.terms.iter().map(|term| (term.name, term.amount)).collect()
}

fn is_affordable(terms: &[(&'static str, f64)], method: &str) -> bool {
    let amount = |term: &str| terms.iter().find(|(name, _)| *name == term).map_or(0.0, |(_, amount)| *amount);
    match method {
        "accumulate" | "layer-rays" | "peel-rays" => amount("rays") <= MAX_RAYS,
        "point-splat" => amount("area of sprites") <= MAX_SPRITES,
        _ => true,
    }
}

fn run(scene: &Scene, plan: &Plan) -> Result<f64, Error> {
    let scene = scene.clone();
    let watch = Stopwatch::start();
    methods::render(scene, plan, &|_| {})?;
    Ok(watch.cpu_seconds())
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Nanoseconds per unit of each term: a non-negative least-squares fit of the relative errors by coordinate descent.
fn fit(samples: &[&Sample]) -> Vec<f64> {
    let count = samples.first().map_or(0, |sample| sample.terms.len());
    let column = |sample: &Sample, k: usize| sample.terms[k].1 * 1e-9 / sample.seconds;
    let sum = |figure: &dyn Fn(&Sample) -> f64| samples.iter().map(|sample| figure(sample)).sum::<f64>();
    let products: Vec<Vec<f64>> = (0..count)
        .map(|k| (0..count).map(|l| sum(&|sample| column(sample, k) * column(sample, l))).collect())
        .collect();
    let targets: Vec<f64> = (0..count).map(|k| sum(&|sample| column(sample, k))).collect();
    let mut nanoseconds = vec![0.0; count];
    for _ in 0..20_000 {
        for k in (0..count).filter(|&k| products[k][k] > 0.0) {
            let others: f64 = (0..count).filter(|&l| l != k).map(|l| products[k][l] * nanoseconds[l]).sum();
            nanoseconds[k] = ((targets[k] - others) / products[k][k]).max(0.0);
        }
    }
    nanoseconds
}

/// `predicted / measured − 1`.
fn error(sample: &Sample, nanoseconds: &[f64]) -> f64 {
    let terms = sample.terms.iter().zip(nanoseconds).map(|((_, amount), nanoseconds)| amount * nanoseconds);
    terms.sum::<f64>() * 1e-9 / sample.seconds - 1.0
}

/// Prints the errors of predictions for each scene by a fit without that scene, and by a fit to all.
fn report(method: &str, samples: &[Sample]) {
    let all = fit(&samples.iter().collect::<Vec<_>>());
    let with_all = sorted(samples.iter().map(|sample| (error(sample, &all), sample.name.as_str())));
    let without_own = sorted(samples.iter().map(|sample| {
        let others: Vec<&Sample> = samples.iter().filter(|other| other.group != sample.group).collect();
        (error(sample, &fit(&others)), sample.name.as_str())
    }));
    let figures: Vec<String> = [&without_own, &with_all]
        .into_iter()
        .flat_map(|errors| [0.5, 0.9].map(|share| (errors, share)))
        .map(|(errors, share)| {
            let index = (share * errors.len() as f64) as usize;
            format!("{:>8.0} %", errors.get(index).map_or(f64::NAN, |(error, _)| 100.0 * error.abs()))
        })
        .collect();
    let worst =
        without_own.iter().rev().take(3).map(|(error, name)| format!("{name} {:+.0} %", 100.0 * error));
    let worst: Vec<String> = worst.collect();
    println!("{method:<22}{:>7}{}   {}", samples.len(), figures.concat(), worst.join(", "));
}

/// The errors with the names of their samples, the smallest first.
fn sorted<'a>(errors: impl Iterator<Item = (f64, &'a str)>) -> Vec<(f64, &'a str)> {
    let mut errors: Vec<_> = errors.collect();
    errors.sort_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
    errors
}

/// Prints the terms of a method as its `cost.rs` declares them.
fn print_fit(method: &str, samples: &[Sample]) {
    println!("{method}");
    let nanoseconds = fit(&samples.iter().collect::<Vec<_>>());
    let terms = samples.first().map_or(&[][..], |sample| &sample.terms);
    for ((name, _), nanoseconds) in terms.iter().zip(nanoseconds) {
        println!("            term(\"{name}\", {nanoseconds:.3}, …),");
    }
}

fn read(file: &Path) -> Measurements {
    let text = fs::read_to_string(file).unwrap_or_default();
    let lines = text.lines().filter_map(|line| line.rsplit_once(','));
    lines.filter_map(|(name, seconds)| Some((name.to_owned(), seconds.parse().ok()?))).collect()
}

fn write(file: &Path, measurements: &Measurements) -> Result<(), Error> {
    let lines = measurements.iter().map(|(name, seconds)| format!("{name},{seconds}\n"));
    atomic::write_text(file, &lines.collect::<String>())
}
