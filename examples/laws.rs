//! The table of docs/laws.md: what every method keeps of the laws that make the engine local and continuous.
//!
//! `cargo run --release --example laws [-- [--no-gpu] [--record] [LAW …]]`
//!
//! Measures every law of `tests/continuity` on the CPU and, where there is an adapter, on a GPU. LAW is the name of a law, such as
//! `tilted-pane`, or `sequences`; without one, all are measured. With `--record` it prints the lines of `tests/continuity/before.tsv`,
//! which holds the figures of an engine that breaks the laws.

#![expect(clippy::print_stdout, clippy::unwrap_used, reason = "the table is the result")]

#[path = "../tests/continuity/laws/mod.rs"]
mod laws;

use laws::engine::Engine;
use laws::temporal::{self, Changes, Sequence};
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

/// Figures of the engine before it was made local and continuous: law, method, back end and figure, separated by tabs.
const BEFORE: &str = include_str!("../tests/continuity/before.tsv");

/// One row of a table: what one engine keeps of one law.
struct Row {
    law: String,
    engine: Engine,
    /// Bound of the figure.
    bound: String,
    /// The worst figure, or all of a sequence.
    seen: String,
    /// Whether the law is kept, and where not.
    remark: String,
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (flags, names): (Vec<&str>, Vec<&str>) =
        arguments.iter().map(String::as_str).partition(|argument| argument.starts_with("--"));
    let (records, leaves_gpu_out) = (flags.contains(&"--record"), flags.contains(&"--no-gpu"));
    let gpu = if leaves_gpu_out { Vec::new() } else { Engine::on_gpu() };
    let has_gpu = !gpu.is_empty();
    let engines = [Engine::on_cpu(), gpu].concat();
    let is_asked = |name: &str| names.is_empty() || names.contains(&name);
    let laws = LAWS.into_iter().filter(|law| is_asked(&name(law)));
    let of_laws = laws.flat_map(|law| {
        engines.iter().filter(|engine| law.concerns(engine)).map(move |engine| law_row(law, engine))
    });
    if records {
        of_laws
            .chain(sequence_rows(&engines, is_asked("sequences")))
            .for_each(|row| println!("{}", row.record()));
        return;
    }
    if !has_gpu {
        println!("Measured on the CPU only: there is no GPU, or it was left out.\n");
    }
    println!("| law | method | back end | bound | before | worst seen | |\n|{}", " --- |".repeat(7));
    of_laws.for_each(|row| println!("{}", row.markdown()));
    println!("\n| sequence | method | back end | true | before | seen | |\n|{}", " --- |".repeat(7));
    sequence_rows(&engines, is_asked("sequences")).for_each(|row| println!("{}", row.markdown()));
}

/// Name of a law, as reports have it.
fn name(law: &Measured) -> String {
    serde_json::to_value(law.law).unwrap().as_str().unwrap().to_owned()
}

impl Row {
    fn record(&self) -> String {
        format!("{}\t{}\t{}\t{}", self.law, self.engine.method.name(), self.engine.backend(), self.seen)
    }

    fn markdown(&self) -> String {
        let Self { law, engine, bound, seen, remark } = self;
        let [method, backend] = [engine.method.name(), engine.backend()];
        let key = format!("{law}\t{method}\t{backend}\t");
        let before = BEFORE.lines().find_map(|line| line.strip_prefix(&key)).unwrap_or("");
        format!("| {law} | {method} | {backend} | {bound} | {before} | {seen} | {remark} |")
    }
}

/// The row of `law` on `engine`.
fn law_row(law: &Measured, engine: &Engine) -> Row {
    let figures = (law.figures)(engine);
    let worst = worst(&figures).unwrap();
    let remark = match law.deviation(engine) {
        _ if worst.value <= law.bound => String::new(),
        Some(deviation) => format!("by design: {}", deviation.reason),
        None => format!("**broken**: {}", worst.case),
    };
    let (bound, seen) = (shown(law.bound), shown(worst.value));
    Row { law: name(law), engine: *engine, bound, seen, remark }
}

/// The rows of the moving pictures, measured as they are asked for; none where they are not.
fn sequence_rows(engines: &[Engine], are_asked: bool) -> impl Iterator<Item = Row> {
    let sequences = if are_asked { temporal::sequences(RAYS) } else { Vec::new() };
    let sampling = engines.iter().filter(|engine| engine.method.lens_sampling().is_some());
    let rows = move |sequence: Sequence| {
        let bound = shown_changes(&sequence.true_changes());
        let row = move |engine: &Engine| Row {
            law: sequence.name.to_owned(),
            engine: *engine,
            bound: bound.clone(),
            seen: shown_changes(&sequence.changes(engine, VIEWS)),
            remark: String::new(),
        };
        sampling.clone().map(row)
    };
    sequences.into_iter().flat_map(rows)
}

fn shown_changes(changes: &Changes) -> String {
    let Changes { error, error_of_blocks, largest_over_mean, frozen } = changes;
    format!("{error:.2}, {error_of_blocks:.2}, {largest_over_mean:.2}, {frozen}")
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
