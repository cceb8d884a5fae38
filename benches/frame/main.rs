//! What one frame costs in time and memory, as one table: each figure with its goal. BENCHMARKS.md says what the rows mean.
//!
//! `cargo bench --bench frame` makes a frame of 1080p and four peels and renders it with the program, a process a run, on the CPU with 64
//! views. After one round that is not counted come seven, every second one backwards; a figure is the median over the rounds, of
//! ratios within each. Environment variables:
//! - `THINLENS_STACK`, `THINLENS_PRESET`: another frame and its lens.
//! - `THINLENS_BEFORE`: an earlier program to compare the blur with.
//! - `THINLENS_RUNS`: another number of rounds.
//! - `PYTHON`: a Python with the package `OpenEXR`, `python3` if not set.

#![expect(clippy::print_stdout, reason = "the table is the result")]
#![expect(clippy::expect_used, reason = "a bench stops where it cannot measure")]

mod made;
mod table;
mod variants;

use serde_json::Value;
use std::collections::BTreeMap;
use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::Instant;
use thinlens::render::{Job, NamedPreset, prepare};
use thinlens::scene::Scene;
use thinlens::settings::{Preset, Values};
use thinlens::stack::Source;

/// The program that is measured.
const PROGRAM: &str = env!("CARGO_BIN_EXE_thinlens");

/// Largest CoC radii between which the growth of time is measured, in pixels.
const COC_PX: [f64; 2] = [16.0, 128.0];

/// What one run costs. CPU seconds are those of the program's own report.
#[derive(Debug, Clone, Default)]
struct Run {
    wall: f64,
    cpu: f64,
    stages: BTreeMap<String, f64>,
    peak_bytes: f64,
}

/// What is run in every round.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Case {
    /// The OpenEXR library, which decodes and encodes.
    Floor,
    TwoThreads,
    OneThread,
    /// The earlier program, on one thread.
    Before,
    /// The first peel alone, if its channels' names say which they are. All that follow are on one thread too.
    FirstPeel,
    SmallCoc,
    LargeCoc,
    FourKEqualCoc,
    FourKTwiceCoc,
}

type Round = BTreeMap<Case, Run>;

/// A render: who renders what, at which f-number if not the preset's, on how many threads.
#[derive(Debug, Clone)]
struct Task {
    program: PathBuf,
    stack: PathBuf,
    f_number: Option<f64>,
    threads: usize,
}

/// What the measurements are made with.
#[derive(Debug)]
struct Setup {
    folder: tempfile::TempDir,
    preset: Option<PathBuf>,
    python: String,
    /// Whether `python` has the package `OpenEXR`.
    has_floor: bool,
    tasks: BTreeMap<Case, Task>,
    /// The report of a render of the frame.
    report: Value,
    /// Largest CoC radius by case, in pixels.
    coc_px: BTreeMap<Case, f64>,
}

fn main() {
    let load_at_start = load_average();
    let setup = Setup::new();
    let rounds: usize = env::var("THINLENS_RUNS").ok().and_then(|text| text.parse().ok()).unwrap_or(7).max(1);
    setup.round(false);
    let runs: Vec<Round> = (0..rounds).map(|number| setup.round(number % 2 == 1)).collect();
    setup.check();
    table::print(&setup, &runs, [load_at_start, load_average()]);
}

impl Setup {
    /// Makes the stacks, and finds the f-numbers for the wanted CoC radii.
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name);
        let (stack, preset) = match env::var_os("THINLENS_STACK") {
            Some(stack) => (PathBuf::from(stack), env::var_os("THINLENS_PRESET").map(PathBuf::from)),
            None => {
                variants::write_all(&made::frame(), &path("made.exr"));
                fs::write(path("made.toml"), made::PRESET).expect("the preset is written");
                (path("made.exr"), Some(path("made.toml")))
            }
        };
        let frame = variants::read_all(&stack);
        variants::write_all(&variants::first_peel(&frame), &path("first_peel.exr"));
        variants::write_all(&variants::tiled(frame), &path("4k.exr"));
        let python = env::var("PYTHON").unwrap_or_else(|_| "python3".to_owned());
        let import = Command::new(&python).args(["-c", "import OpenEXR"]).output();
        let has_floor = import.is_ok_and(|output| output.status.success());
        let (first_peel, four_k) = (path("first_peel.exr"), path("4k.exr"));
        let mut setup = Self {
            folder,
            preset,
            python,
            has_floor,
            tasks: BTreeMap::new(),
            report: Value::Null,
            coc_px: BTreeMap::new(),
        };
        let task = |stack: &Path, f_number| Task {
            program: PathBuf::from(PROGRAM),
            stack: stack.to_owned(),
            f_number,
            threads: 1,
        };
        let frame = task(&stack, None);
        setup.report = setup.render(Case::OneThread, &frame).1;
        let peels =
            setup.report["stack"]["peels"].as_u64().expect("the report says how many peels there are");
        assert!(peels > 1, "the frame has one peel: there are no hidden ones to leave out");
        let coc_px = largest_coc_px(&setup.scene(&frame));
        // The CoC radius is inversely proportional to the f-number, and grows with the picture's width on an equal sensor.
        let f_number = setup.report["lens"]["f_number"]["value"].as_f64().expect("a lens has an f-number");
        let with_coc = |wanted: f64| task(&stack, Some(f_number * coc_px / wanted));
        setup.tasks = BTreeMap::from([
            (Case::TwoThreads, Task { threads: 2, ..frame.clone() }),
            (Case::OneThread, frame.clone()),
            (Case::FirstPeel, task(&first_peel, None)),
            (Case::SmallCoc, with_coc(COC_PX[0])),
            (Case::LargeCoc, with_coc(COC_PX[1])),
            (Case::FourKEqualCoc, task(&four_k, Some(2.0 * f_number))),
            (Case::FourKTwiceCoc, task(&four_k, Some(f_number))),
        ]);
        if let Some(program) = env::var_os("THINLENS_BEFORE") {
            setup.tasks.insert(Case::Before, Task { program: PathBuf::from(program), ..frame });
        }
        for (case, task) in setup.tasks.clone() {
            let scene = setup.scene(&task);
            setup.coc_px.insert(case, largest_coc_px(&scene));
            if case == Case::FirstPeel && scene.layers.len() > 1 {
                setup.tasks.remove(&case);
            }
        }
        setup
    }

    /// Runs every case once, in order or backwards.
    fn round(&self, backwards: bool) -> Round {
        let mut cases: Vec<Case> = self.tasks.keys().copied().collect();
        if self.has_floor {
            cases.insert(0, Case::Floor);
        }
        if backwards {
            cases.reverse();
        }
        let run = |case: Case| match self.tasks.get(&case) {
            Some(task) => self.render(case, task).0,
            None => self.floor(),
        };
        cases.into_iter().map(|case| (case, run(case))).collect()
    }

    /// The picture that a case renders.
    fn picture(&self, case: Case) -> PathBuf {
        self.folder.path().join(format!("{case:?}.exr"))
    }

    /// Renders `task`, and returns the costs and the report.
    fn render(&self, case: Case, task: &Task) -> (Run, Value) {
        let report = self.folder.path().join("report.json");
        let mut command = self.command(task);
        command.arg("-o").arg(self.picture(case)).arg("--report").arg(&report);
        let start = Instant::now();
        succeeded(&mut command);
        let wall = start.elapsed().as_secs_f64();
        let text = fs::read_to_string(&report).expect("the report is there");
        let report: Value = serde_json::from_str(&text).expect("the report is JSON");
        let number = |value: &Value| value.as_f64().expect("the report says what the run cost");
        let stages = report["cpu_seconds_by_stage"].as_object().expect("the report has stages");
        let run = Run {
            wall,
            cpu: number(&report["cpu_seconds"]),
            stages: stages.iter().map(|(stage, value)| (stage.clone(), number(value))).collect(),
            peak_bytes: number(&report["peak_memory_bytes"]),
        };
        (run, report)
    }

    /// What `task` blurs. The library reads it: `thinlens plan` would measure sampling errors too, which takes minutes.
    fn scene(&self, task: &Task) -> Scene {
        let preset = self.preset.as_ref().map(|path| {
            let (name, text) =
                (path.display().to_string(), fs::read_to_string(path).expect("the preset's file"));
            let preset = Preset::parse(&text, &name).unwrap_or_else(|error| panic!("{error}"));
            NamedPreset { name, preset }
        });
        let flags = Values { f_number: task.f_number.map(|f_number| f_number as f32), ..Values::default() };
        let sources = vec![Source::File(task.stack.clone())];
        let prepared = prepare(&Job { sources, preset, flags, ..Job::default() });
        prepared.unwrap_or_else(|error| panic!("{error}")).scene
    }

    /// The program with what all its runs have in common.
    fn command(&self, task: &Task) -> Command {
        let mut command = Command::new(&task.program);
        command.arg("render").arg(&task.stack).args(["--device", "cpu", "--views", "64", "--quiet"]);
        command.args(["--threads", &task.threads.to_string()]);
        if let Some(preset) = &self.preset {
            command.arg("--preset").arg(preset);
        }
        if let Some(f_number) = task.f_number {
            command.args(["--f-number", &f_number.to_string()]);
        }
        command
    }

    /// Decodes the stack and encodes the picture of [`Case::OneThread`] by the OpenEXR library.
    fn floor(&self) -> Run {
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/frame/floor.py");
        let (stack, picture) = (&self.tasks[&Case::OneThread].stack, self.picture(Case::OneThread));
        let output = self.folder.path().join("floor.exr");
        let output = succeeded(Command::new(&self.python).arg(script).arg(stack).arg(picture).arg(output));
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        let seconds = text.split_whitespace().map(|number| number.parse::<f64>().expect("seconds"));
        Run { wall: seconds.sum(), ..Run::default() }
    }

    /// Stops unless the measured runs did what their rows say.
    fn check(&self) {
        let [one, two] = [Case::OneThread, Case::TwoThreads].map(|case| self.picture(case));
        assert!(variants::are_equal(&one, &two), "one thread and two make different pictures");
    }
}

/// The largest CoC radius, in pixels.
fn largest_coc_px(scene: &Scene) -> f64 {
    let [near, far] = scene.analyze().coc_range_px;
    f64::from(near.abs().max(far.abs()))
}

/// Runs `command`, which must succeed.
fn succeeded(command: &mut Command) -> Output {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?} does not start: {error}"));
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

/// Mean number of processes that ran or waited in the last minute, where the system says so.
fn load_average() -> Option<f64> {
    fs::read_to_string("/proc/loadavg").ok()?.split_whitespace().next()?.parse().ok()
}
