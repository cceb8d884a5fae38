//! A sequence against as many single renders: wall time, CPU seconds and memory.
//!
//! `cargo bench --bench sequence` renders 100 frames of a sample; `THINLENS_STACK` names another stack, `THINLENS_PRESET` its lens, and
//! `THINLENS_FRAMES` another number of frames. All frames are the same file. The sum of stages is the time that reading, deciding, blurring
//! and writing took in the single renders, without the start of the program.

#![expect(clippy::print_stdout, reason = "the figures are the result")]
#![expect(clippy::expect_used, reason = "a bench stops where it cannot measure")]

use serde_json::Value;
use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

fn main() {
    let frames: usize = env::var("THINLENS_FRAMES").ok().and_then(|text| text.parse().ok()).unwrap_or(100);
    let folder = tempfile::tempdir().expect("a folder");
    let sample = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/samples/fence"));
    let stack = env::var_os("THINLENS_STACK").map_or_else(|| sample.join("stack.exr"), PathBuf::from);
    let preset = env::var_os("THINLENS_PRESET").map_or_else(|| sample.join("preset.toml"), PathBuf::from);
    for number in 1..=frames {
        fs::copy(&stack, folder.path().join(format!("shot.{number:04}.exr"))).expect("a frame");
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from) as f64;
    println!("{frames} frames of {}, {cores} cores", stack.display());
    println!("                     wall s    CPU s   wall × cores ÷ CPU   peak MiB");
    let print = |name: &str, figures: &Figures| {
        let Figures { wall, cpu, peak_bytes } = figures;
        let ratio = wall * cores / cpu;
        let peak = peak_bytes / f64::from(1 << 20);
        println!("{name:<18} {wall:8.2} {cpu:8.2}   {ratio:18.2}   {peak:8.0}");
    };
    let (single, stages) = single(folder.path(), &preset, frames);
    print("single renders", &single);
    print("sum of stages", &stages);
    for memory in ["", "1GiB", "512MiB"] {
        let name = if memory.is_empty() { "sequence".to_owned() } else { format!("sequence, {memory}") };
        print(&name, &sequence(folder.path(), &preset, memory));
    }
}

/// What a run costs.
#[derive(Debug, Default)]
struct Figures {
    wall: f64,
    cpu: f64,
    peak_bytes: f64,
}

/// The program in `folder`, with what all runs have in common.
fn thinlens(folder: &Path, preset: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_thinlens"));
    command.current_dir(folder).args(arguments).arg("--preset").arg(preset);
    command.args(["--device", "cpu", "--quiet", "--json", "--quality", "final"]);
    command
}

/// Runs `command` and reads the last line of its JSON, or all of it.
fn json(mut command: Command) -> Value {
    let output = command.output().expect("the program starts");
    let text = String::from_utf8(output.stdout).expect("text");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let last = text.lines().last().filter(|line| line.starts_with("{\"shot\""));
    serde_json::from_str(last.unwrap_or(&text)).expect("JSON")
}

/// The single renders of all frames, and the sum of their stages.
fn single(folder: &Path, preset: &Path, frames: usize) -> (Figures, Figures) {
    let number = |value: &Value| value.as_f64().unwrap_or(0.0);
    let (mut whole, mut stages) = (Figures::default(), Figures::default());
    let start = Instant::now();
    for frame in 1..=frames {
        let (input, output) = (format!("shot.{frame:04}.exr"), format!("single.{frame:04}.exr"));
        let report = json(thinlens(folder, preset, &["render", &input, "-o", &output]));
        whole.cpu += number(&report["cpu_seconds"]);
        whole.peak_bytes = whole.peak_bytes.max(number(&report["peak_memory_bytes"]));
        for stage in ["read", "plan", "blur", "write"] {
            stages.wall += number(&report["seconds"][stage]);
            stages.cpu += number(&report["cpu_seconds_by_stage"][stage]);
        }
    }
    whole.wall = start.elapsed().as_secs_f64();
    stages.peak_bytes = whole.peak_bytes;
    (whole, stages)
}

/// The frames as a sequence, within `memory` if it is not empty.
fn sequence(folder: &Path, preset: &Path, memory: &str) -> Figures {
    let mut command = thinlens(folder, preset, &["render", "shot.####.exr", "-o", "sequence.####.exr"]);
    if !memory.is_empty() {
        command.args(["--memory", memory]);
    }
    let start = Instant::now();
    let shot = json(command)["shot"].take();
    let number = |key: &str| shot[key].as_f64().unwrap_or(0.0);
    Figures {
        wall: start.elapsed().as_secs_f64(),
        cpu: number("cpu_seconds"),
        peak_bytes: number("peak_memory_bytes"),
    }
}
