//! What a program that runs thinlens reads: exit codes, lines of progress, frames that come late.

use super::program::{STACK, names, run, stderr, thinlens};
use super::{all, ended_with, lines, render, shot, statuses};
use std::fs;
use std::process::Stdio;
use std::thread::sleep;
use std::time::Duration;

/// Cuts the input of frame `number` short.
fn damage(folder: &std::path::Path, number: i64) {
    let path = folder.join(format!("shot.{number:04}.exr"));
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
}

#[test]
fn one_bad_frame_stops_no_other_and_its_reason_is_in_every_list() {
    let folder = shot(&[1, 2, 3]);
    damage(folder.path(), 2);
    let output = render(folder.path(), &["--json"]);
    ended_with(&output, 3);
    assert_eq!(names(&folder.path().join("out")), ["f.0001.exr", "f.0003.exr"]);
    assert!(stderr(&output).contains("failed frames: 2: "), "{}", stderr(&output));
    let lines = lines(&output);
    let failed = lines.iter().find(|line| line["status"] == "failed").unwrap();
    assert_eq!((&failed["frame"], &failed["error"]["exit_code"]), (&2.into(), &4.into()));
    assert!(failed["error"]["file"].as_str().unwrap().contains("shot.0002.exr"), "{failed}");
    let shot = &lines.last().unwrap()["shot"];
    assert_eq!((&shot["failed"], &shot["failures"][0]["frame"]), (&1.into(), &2.into()), "{shot}");
}

#[test]
fn where_all_frames_fail_the_exit_code_is_that_of_their_errors() {
    let folder = shot(&[1, 2]);
    damage(folder.path(), 1);
    damage(folder.path(), 2);
    ended_with(&render(folder.path(), &[]), 4);
}

#[test]
fn a_wrong_call_is_said_once_and_a_plan_without_a_good_frame_fails_and_writes_nothing() {
    let folder = shot(&[1, 2, 3]);
    let wrong = render(folder.path(), &["--method", "gather", "--force", "fill"]);
    ended_with(&wrong, 2);
    assert_eq!(stderr(&wrong).matches("cannot be forced").count(), 1, "{}", stderr(&wrong));
    (1..=3).for_each(|number| damage(folder.path(), number));
    let plan = ["plan", "shot.####.exr", "--focus", "6", "--decisions", "shot.toml"];
    ended_with(&run(folder.path(), &plan), 4);
    assert!(!folder.path().join("shot.toml").exists());
}

#[test]
fn a_run_that_should_stop_at_a_failure_starts_no_frame_after_it() {
    let folder = shot(&[1, 2, 3, 4, 5, 6]);
    damage(folder.path(), 1);
    let output = render(folder.path(), &["--fail-fast", "--json", "--threads", "1"]);
    ended_with(&output, 3);
    assert_eq!(statuses(&output), all(&[1], "failed"));
    assert_eq!(lines(&output).last().unwrap()["shot"]["not_started"], 5);
}

#[test]
fn progress_is_said_in_the_words_of_the_farm_engine() {
    let folder = shot(&[1, 2]);
    damage(folder.path(), 2);
    let output = render(folder.path(), &["--progress", "openjd"]);
    ended_with(&output, 3);
    let text = String::from_utf8(output.stdout).unwrap();
    for line in ["openjd_progress: 50.0", "openjd_progress: 100.0", "openjd_status: ", "openjd_fail: "] {
        assert!(text.lines().any(|found| found.starts_with(line)), "{line}: {text}");
    }
    let percentages = render(folder.path(), &["--progress", "opencue", "--frames", "1"]);
    assert!(String::from_utf8(percentages.stdout).unwrap().starts_with("100 % frame 1: "));
    let silent = render(folder.path(), &["--progress", "none", "--frames", "1"]);
    ended_with(&silent, 0);
    assert!(silent.stdout.is_empty());
}

#[test]
fn a_frame_that_is_half_written_is_waited_for() {
    let folder = shot(&[1]);
    let late = folder.path().join("shot.0002.exr");
    let bytes = fs::read(STACK).unwrap();
    fs::write(&late, &bytes[..bytes.len() / 2]).unwrap();
    let arguments = ["render", "shot.####.exr", "--frames", "1-3", "--watch", "-o", "out/f.####.exr"];
    let lens = ["--focus", "6", "--views", "4"];
    let mut command = thinlens(folder.path(), &[&arguments[..], &lens].concat());
    let child = command.stderr(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let first = folder.path().join("out/f.0001.exr");
    for _ in 0..600 {
        if first.is_file() {
            break;
        }
        sleep(Duration::from_millis(50));
    }
    assert!(first.is_file(), "the first frame is there");
    fs::write(&late, &bytes).unwrap();
    fs::write(folder.path().join("shot.0003.exr"), &bytes).unwrap();
    let output = child.wait_with_output().unwrap();
    ended_with(&output, 0);
    assert_eq!(names(&folder.path().join("out")), ["f.0001.exr", "f.0002.exr", "f.0003.exr"]);
}

#[test]
fn a_warning_that_many_frames_have_is_printed_once_and_with_their_numbers_at_the_end() {
    let folder = shot(&[1, 2, 3]);
    let more = ["--views", "4", "--focal-length", "600", "--f-number", "0.1", "--border", "mirror"];
    let arguments = ["render", "shot.####.exr", "-o", "out/f.####.exr", "--focus", "2"];
    let output = run(folder.path(), &[&arguments[..], &more].concat());
    ended_with(&output, 0);
    let text = stderr(&output);
    let count = |what: &str| text.lines().filter(|line| line.contains(what)).count();
    assert_eq!(count("was limited to"), 2, "{text}");
    assert_eq!(count("warning: frames 1-3: coc: "), 1, "{text}");
}
