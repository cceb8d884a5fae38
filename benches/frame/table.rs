//! The table of figures, in Markdown.

use super::{COC_PX, Case, PROGRAM, Round, Run, Setup, variants};
use std::fmt;

/// Load averages above these are warned of, at the beginning, when the compiler may just have run, and at the end, when
/// at most the program's two threads should have.
const HIGH_LOAD: [f64; 2] = [0.5, 1.5];

/// A figure's goal.
#[derive(Debug, Clone, Copy)]
enum Goal {
    AtMost(f64),
    AtLeast(f64),
}

impl fmt::Display for Goal {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AtMost(most) => write!(formatter, "≤ {most}"),
            Self::AtLeast(least) => write!(formatter, "≥ {least}"),
        }
    }
}

/// Prints with what was measured, and the table. `load` is the load average at the beginning and at the end.
pub(crate) fn print(setup: &Setup, rounds: &[Round], load: [Option<f64>; 2]) {
    print_conditions(setup, rounds.len(), load);
    println!("| figure | measured | lowest to highest | goal | reached |");
    println!("| --- | --- | --- | --- | --- |");
    let table = Table { setup, rounds };
    table.floor();
    println!("| CPU s at 64 views, one thread | {} | | | |", table.stages());
    table.ratio(
        "blur, CPU s ÷ the earlier program's",
        Goal::AtMost(0.75),
        (Case::OneThread, Case::Before, blur),
        "`THINLENS_BEFORE=path/to/thinlens` names an earlier program",
    );
    table.ratio(
        "first peel alone ÷ all peels, blur, CPU s",
        Goal::AtMost(1.0),
        (Case::FirstPeel, Case::OneThread, blur),
        "no channel names such as `Peel0.Depth.Z`",
    );
    table.circles();
    table.ratio(
        "threads 1 → 2, whole, wall: times as fast",
        Goal::AtLeast(1.9),
        (Case::OneThread, Case::TwoThreads, wall),
        "",
    );
    table.row("peak memory ÷ decoded stack, 2 threads", Goal::AtMost(1.2), |round| {
        round[&Case::TwoThreads].peak_bytes / decoded_bytes(setup)
    });
}

/// What the rows are made from.
struct Table<'a> {
    setup: &'a Setup,
    rounds: &'a [Round],
}

impl Table<'_> {
    /// Prints the row of the whole command against the OpenEXR library.
    fn floor(&self) {
        let how =
            format!("`{}` has no package `OpenEXR`; `pip install OpenEXR`, or `PYTHON=…`", self.setup.python);
        self.ratio(
            "whole, 2 threads, wall ÷ OpenEXR's decoding and encoding, 1 thread, wall",
            Goal::AtMost(1.3),
            (Case::TwoThreads, Case::Floor, wall),
            &how,
        );
    }

    /// Prints the rows of growing circles of confusion and of more pixels.
    fn circles(&self) {
        let reached = |case| format!("{:.1}", self.setup.coc_px[&case]);
        let [small, large] = [Case::SmallCoc, Case::LargeCoc];
        for (what, cost) in [("whole", cpu as fn(&Run) -> f64), ("blur", blur)] {
            let wanted = format!("CoC {} → {} px", COC_PX[0], COC_PX[1]);
            let figure = format!("{wanted} (reached {} → {}), {what}, CPU s", reached(small), reached(large));
            self.ratio(&figure, Goal::AtMost(1.3), (large, small, cost), "");
        }
        for (case, goal) in [(Case::FourKEqualCoc, 4.2), (Case::FourKTwiceCoc, 5.0)] {
            let coc = format!("CoC {} → {} px", reached(Case::OneThread), reached(case));
            let figure = format!("four times the pixels, {coc}, whole, CPU s");
            self.ratio(&figure, Goal::AtMost(goal), (case, Case::OneThread, cpu), "");
        }
    }

    /// Prints the row of one case's cost over another's, or why there is none where one of them was not run.
    fn ratio(
        &self,
        figure: &str,
        goal: Goal,
        (over, under, cost): (Case, Case, fn(&Run) -> f64),
        missing: &str,
    ) {
        if self.rounds.iter().all(|round| round.contains_key(&over) && round.contains_key(&under)) {
            self.row(figure, goal, |round| cost(&round[&over]) / cost(&round[&under]));
        } else {
            println!("| {figure} | not measured: {missing} | | {goal} | |");
        }
    }

    /// Prints the row of a figure of each round.
    fn row(&self, figure: &str, goal: Goal, of_round: impl Fn(&Round) -> f64) {
        let mut values: Vec<f64> = self.rounds.iter().map(of_round).collect();
        values.sort_by(f64::total_cmp);
        let (middle, lowest, highest) = (values[values.len() / 2], values[0], values[values.len() - 1]);
        let reached = match goal {
            Goal::AtMost(most) => middle <= most,
            Goal::AtLeast(least) => middle >= least,
        };
        let reached = if reached { "yes" } else { "no" };
        println!("| {figure} | {middle:.2} | {lowest:.2} to {highest:.2} | {goal} | {reached} |");
    }

    /// The median CPU seconds of the frame on one thread, of all and of each stage.
    fn stages(&self) -> String {
        let middle = |seconds: &dyn Fn(&Run) -> f64| {
            let runs = self.rounds.iter().map(|round| &round[&Case::OneThread]);
            let mut values: Vec<f64> = runs.map(seconds).collect();
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        let stages = ["read", "plan", "blur", "write"];
        let each = stages.map(|stage| format!("{stage} {:.3}", middle(&|run| run.stages[stage])));
        format!("whole {:.3}: {}", middle(&cpu), each.join(", "))
    }
}

fn print_conditions(setup: &Setup, rounds: usize, load: [Option<f64>; 2]) {
    let report = &setup.report;
    let number = |key: &str| report["stack"][key].as_u64().unwrap_or(0);
    println!(
        "{} × {} pixels, {} peels, {} of the input, CoC radii up to {:.1} px; {} with {} threads; medians of {rounds} rounds; \
         load average {} at the beginning, {} at the end.",
        number("width"),
        number("height"),
        number("peels"),
        report["stack"]["precision"].as_str().unwrap_or("?"),
        setup.coc_px[&Case::OneThread],
        report["device"]["name"].as_str().unwrap_or("unknown processor"),
        std::thread::available_parallelism().map_or(1, usize::from),
        shown(load[0]),
        shown(load[1]),
    );
    if load.iter().zip(HIGH_LOAD).any(|(load, high)| load.is_some_and(|load| load > high)) {
        println!(
            "\nWARNING: other programs ran. Measure again on a quiet machine, once the load average is near 0."
        );
    }
    if let Some(before) = setup.tasks.get(&Case::Before) {
        let [ours, theirs] = [Case::OneThread, Case::Before].map(|case| setup.picture(case));
        let compared = if variants::are_equal(&ours, &theirs) { "equal to" } else { "DIFFERENT from" };
        println!(
            "\nThe picture of {PROGRAM} is {compared} that of {}, bit by bit.",
            before.program.display()
        );
    }
    println!();
}

fn shown(load: Option<f64>) -> String {
    load.map_or_else(|| "unknown".to_owned(), |load| format!("{load:.2}"))
}

fn wall(run: &Run) -> f64 {
    run.wall
}

fn cpu(run: &Run) -> f64 {
    run.cpu
}

fn blur(run: &Run) -> f64 {
    run.stages["blur"]
}

/// Bytes of colour, alpha and depth of all peels, as 32-bit floats.
fn decoded_bytes(setup: &Setup) -> f64 {
    let number = |key: &str| setup.report["stack"][key].as_f64().expect("the report describes the stack");
    number("peels") * 5.0 * size_of::<f32>() as f64 * number("width") * number("height")
}
