//! Sequences, as a user runs them: which frames are rendered, what they have in common, what happens to those that fail.

#![cfg(feature = "cli")]
#![expect(clippy::unwrap_used, reason = "a test stops at the first failure")]

mod frames;
#[path = "../program/mod.rs"]
mod program;
mod resume;
mod steady;
mod wrapper;

use program::{STACK, run, stderr};
use std::fs;
use std::path::Path;
use std::process::Output;
use tempfile::TempDir;

/// A folder with the frames `numbers` of a static shot, `shot.0001.exr` and so on, and a folder for the results.
fn shot(numbers: &[i64]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for number in numbers {
        fs::copy(STACK, folder.path().join(format!("shot.{number:04}.exr"))).unwrap();
    }
    fs::create_dir(folder.path().join("out")).unwrap();
    folder
}

/// Renders all frames of the shot in `folder` to `out/`, with few lens samples, and with `more` flags.
fn render(folder: &Path, more: &[&str]) -> Output {
    let fixed = ["render", "shot.####.exr", "-o", "out/f.####.exr", "--focus", "6", "--views", "4"];
    run(folder, &[&fixed[..], more].concat())
}

/// The lines of JSON that a run printed.
fn lines(output: &Output) -> Vec<serde_json::Value> {
    let text = String::from_utf8(output.stdout.clone()).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Frame number and status of every line of `output` but the last.
fn statuses(output: &Output) -> Vec<(i64, String)> {
    let lines = lines(output);
    let (_, frames) = lines.split_last().unwrap();
    let status = |line: &serde_json::Value| {
        (line["frame"].as_i64().unwrap(), line["status"].as_str().unwrap().to_owned())
    };
    let mut all: Vec<_> = frames.iter().map(status).collect();
    all.sort();
    all
}

/// `numbers`, all with `status`.
fn all(numbers: &[i64], status: &str) -> Vec<(i64, String)> {
    numbers.iter().map(|number| (*number, status.to_owned())).collect()
}

/// Checks the exit code of `output`.
fn ended_with(output: &Output, code: i32) {
    assert_eq!(output.status.code(), Some(code), "{}", stderr(output));
}
