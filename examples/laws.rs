//! The table of docs/laws.md: what every method keeps of the laws that make the engine local and continuous.
//!
//! `cargo run --release --example laws [-- [--no-gpu] [LAW …]]`
//!
//! Measures every law of `tests/continuity` on the CPU and, where there is an adapter, on a GPU. LAW is the name of a law, such as
//! `tilted-pane`, or `temporal`; without one, all are measured.

#![expect(clippy::print_stdout, clippy::unwrap_used, reason = "the table is the result")]

#[path = "../tests/continuity/laws/mod.rs"]
mod laws;

use laws::engine::Engine;
use laws::temporal::{self, Changes};
use laws::{Figure, Measured, cracks, elements, focus, impulse, locality, panes, peels, sweeps};

/// Every law, in the order of the table.
const LAWS: [&Measured; 15] = [
    &panes::TILTED_PANE,
    &panes::SHEET_OF_TWO_PEELS,
    &elements::LONE_ELEMENT,
    &elements::SOFT_DISC,
    &elements::ONE_COLOR,
    &locality::LOCALITY,
    &cracks::STEEP_RAMP,
    &cracks::RELIEF,
    &sweeps::EVEN_SWEEP,
    &sweeps::FROZEN_FRAMES,
    &impulse::PEAK,
    &focus::NEAR_FOCUS,
    &focus::STEP_NEAR_FOCUS,
    &peels::MANY_PEELS,
    &peels::PEEL_ORDER,
];

/// Lens samples a pixel of the moving pictures.
const VIEWS: usize = 64;

/// Rays a pixel of the true ones.
const RAYS: usize = 1024;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (flags, names): (Vec<&str>, Vec<&str>) =
        arguments.iter().map(String::as_str).partition(|a| a.starts_with("--"));
    let gpu = if flags.contains(&"--no-gpu") { Vec::new() } else { Engine::on_gpu() };
    if gpu.is_empty() {
        println!("Measured on the CPU only: there was no GPU, or it was left out.\n");
    }
    let engines = [Engine::on_cpu(), gpu].concat();
    let asked = |name: &str| names.is_empty() || names.contains(&name);
    println!(
        "| law | method | back end | bound | worst seen | where |\n| --- | --- | --- | --- | --- | --- |"
    );
    for law in LAWS.into_iter().filter(|law| asked(&name(law))) {
        engines
            .iter()
            .filter(|engine| law.concerns(engine))
            .for_each(|engine| println!("{}", row(law, engine)));
    }
    if asked("temporal") {
        println!(
            "\n| sequence | method | back end | error of the change | of a block's | largest over mean | frozen frames |\n| --- | --- | --- | --- | --- | --- | --- |"
        );
        print_temporal(&engines);
    }
}

/// Name of a law, as reports have it.
fn name(law: &Measured) -> String {
    serde_json::to_value(law.law).unwrap().as_str().unwrap().to_owned()
}

/// The row of `law` on `engine`.
fn row(law: &Measured, engine: &Engine) -> String {
    let figures = (law.figures)(engine);
    let worst = worst(&figures).unwrap();
    let kept = match law.deviation(engine) {
        _ if worst.value <= law.bound => "",
        Some(_) => " (declared)",
        None => " **broken**",
    };
    let [method, backend] = [engine.method.name(), engine.backend()];
    let seen = format!("{}{kept}", shown(worst.value));
    format!("| {} | {method} | {backend} | {} | {seen} | {} |", name(law), shown(law.bound), worst.case)
}

/// The worst of `figures`; a figure that is no number is the worst.
fn worst(figures: &[Figure]) -> Option<&Figure> {
    let rank = |figure: &Figure| if figure.value.is_nan() { f64::INFINITY } else { figure.value };
    figures.iter().max_by(|a, b| rank(a).total_cmp(&rank(b)))
}

/// A figure in as few digits as tell it apart.
fn shown(value: f64) -> String {
    match value {
        0.0 => "0".to_owned(),
        _ if value.abs() < 1e-3 => format!("{value:.0e}"),
        _ if value < 1.0 => format!("{value:.4}"),
        _ => format!("{value:.2}"),
    }
}

fn print_temporal(engines: &[Engine]) {
    let print = |sequence: &str, method: &str, backend: &str, changes: &Changes| {
        let Changes { error, error_of_blocks, largest_over_mean, frozen } = changes;
        println!(
            "| {sequence} | {method} | {backend} | {error:.2} | {error_of_blocks:.2} | {largest_over_mean:.2} | {frozen} |"
        );
    };
    for sequence in temporal::sequences(RAYS) {
        print(sequence.name, "the truth", "", &sequence.true_changes());
        for engine in engines.iter().filter(|engine| engine.method.lens_sampling().is_some()) {
            print(sequence.name, engine.method.name(), engine.backend(), &sequence.changes(engine, VIEWS));
        }
    }
}
