//! Which frames a run has, and where they are written.

use super::program::{STACK, names, run, stderr};
use super::{all, ended_with, render, shot, statuses};
use std::fs;
use std::io::Write;
use std::process::Stdio;

#[test]
fn every_frame_that_is_there_is_rendered_to_a_file_of_its_own() {
    let folder = shot(&[1, 2, 4]);
    let output = render(folder.path(), &[]);
    ended_with(&output, 0);
    assert_eq!(names(&folder.path().join("out")), ["f.0001.exr", "f.0002.exr", "f.0004.exr"]);
    assert!(stderr(&output).contains("not there: 3"), "{}", stderr(&output));
}

#[test]
fn a_list_of_frames_names_those_to_render() {
    let folder = shot(&[1, 2, 3, 4, 5]);
    ended_with(&render(folder.path(), &["--frames", "1-5x2"]), 0);
    assert_eq!(names(&folder.path().join("out")), ["f.0001.exr", "f.0003.exr", "f.0005.exr"]);
}

#[test]
fn a_frame_that_is_asked_for_and_not_there_fails_and_the_others_are_rendered() {
    let folder = shot(&[1, 2]);
    let output = render(folder.path(), &["--frames", "1-3", "--json"]);
    ended_with(&output, 3);
    assert_eq!(statuses(&output), [all(&[1, 2], "rendered"), all(&[3], "failed")].concat());
}

#[test]
fn names_are_patterns_of_every_notation_and_negative_frames_keep_their_sign() {
    let folder = tempfile::tempdir().unwrap();
    for number in [-2, 3] {
        fs::copy(STACK, folder.path().join(format!("s.{number:04}.exr"))).unwrap();
    }
    for (notation, name) in [("%04d", "a"), ("$F4", "b"), ("@@@@", "c"), ("####", "d")] {
        let (input, output) = (format!("s.{notation}.exr"), format!("{name}.{notation}.png"));
        let arguments = ["render", &input, "-o", &output, "--focus", "6", "--views", "1"];
        ended_with(&run(folder.path(), &arguments), 0);
        let written: Vec<_> =
            names(folder.path()).into_iter().filter(|file| file.starts_with(name)).collect();
        assert_eq!(written.len(), 2, "{notation}: {written:?}");
        assert!(written.contains(&format!("{name}.0003.png")), "{written:?}");
    }
}

#[test]
fn a_wildcard_a_folder_and_a_list_on_standard_input_are_sequences_too() {
    for how in ["shot.*.exr", "."] {
        let folder = shot(&[1, 2]);
        let arguments = ["render", how, "-o", "out/f.####.exr", "--focus", "6", "--views", "1"];
        ended_with(&run(folder.path(), &arguments), 0);
        assert_eq!(names(&folder.path().join("out")), ["f.0001.exr", "f.0002.exr"], "{how}");
    }
    let folder = shot(&[1, 2]);
    let arguments = ["render", "--files-from", "-", "-o", "out/f.####.exr", "--focus", "6", "--views", "1"];
    let mut command = super::program::thinlens(folder.path(), &arguments);
    let mut child = command.stdin(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    child.stdin.take().unwrap().write_all(b"shot.0002.exr\n\nshot.0001.exr\n").unwrap();
    ended_with(&child.wait_with_output().unwrap(), 0);
    assert_eq!(names(&folder.path().join("out")), ["f.0001.exr", "f.0002.exr"]);
}

#[test]
fn files_that_the_shell_lists_are_frames_where_the_output_is_a_pattern() {
    let folder = shot(&[7, 8]);
    let arguments = ["render", "shot.0007.exr", "shot.0008.exr", "-o", "out/f.####.exr"];
    ended_with(&run(folder.path(), &[&arguments[..], &["--focus", "6", "--views", "1"]].concat()), 0);
    assert_eq!(names(&folder.path().join("out")), ["f.0007.exr", "f.0008.exr"]);
}

#[test]
fn a_report_a_preview_and_a_mask_of_every_frame_have_patterns_and_a_report_without_is_of_the_shot() {
    let folder = shot(&[1, 2]);
    let more =
        ["--preview", "out/p.####.png", "--confidence", "out/m.####.png", "--report", "out/r.####.json"];
    ended_with(&render(folder.path(), &more), 0);
    let files = names(&folder.path().join("out"));
    assert_eq!(files.len(), 8, "{files:?}");
    ended_with(&render(folder.path(), &["--report", "shot.json"]), 0);
    let report = fs::read_to_string(folder.path().join("shot.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    assert_eq!((&report["frames"], &report["rendered"]), (&2.into(), &2.into()), "{report}");
}

#[test]
fn a_frame_may_have_a_folder_of_its_own_which_is_created() {
    let folder = shot(&[1, 2]);
    let arguments = ["render", "shot.####.exr", "-o", "out/####/f.exr", "--focus", "6", "--views", "1"];
    ended_with(&run(folder.path(), &arguments), 0);
    assert_eq!(names(&folder.path().join("out")), ["0001", "0002"]);
    assert_eq!(names(&folder.path().join("out/0002")), ["f.exr"]);
}

#[test]
fn no_frame_is_written_over_its_input_whichever_comes_first() {
    let folder = shot(&[1, 2]);
    let before = fs::read(folder.path().join("shot.0002.exr")).unwrap();
    let arguments = ["render", "shot.####.exr", "--frames", "0-2", "-o", "shot.####.exr", "--focus", "6"];
    ended_with(&run(folder.path(), &[&arguments[..], &["--views", "1"]].concat()), 2);
    assert!(fs::read(folder.path().join("shot.0002.exr")).unwrap() == before);
}

#[test]
fn one_file_for_all_frames_is_refused() {
    let folder = shot(&[1, 2]);
    let arguments = ["render", "shot.####.exr", "-o", "out/f.exr", "--focus", "6", "--views", "4"];
    let output = run(folder.path(), &arguments);
    ended_with(&output, 2);
    assert!(stderr(&output).contains("out/f.####.exr"), "{}", stderr(&output));
    let preview = render(folder.path(), &["--preview", "p.png"]);
    ended_with(&preview, 2);
    assert_eq!(names(&folder.path().join("out")), [""; 0], "nothing was rendered");
}

#[test]
fn the_flags_of_sequences_are_refused_for_one_frame() {
    let folder = shot(&[1]);
    for flag in [&["--resume"][..], &["--fail-fast"], &["--progress", "openjd"]] {
        let arguments = [&["render", "shot.0001.exr", "-o", "a.exr", "--focus", "6"][..], flag].concat();
        let output = run(folder.path(), &arguments);
        ended_with(&output, 2);
        assert!(stderr(&output).contains(flag[0]), "{}", stderr(&output));
    }
}
