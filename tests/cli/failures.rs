//! What a wrapper reads when a command fails: the exit code, and with `--json` the error on standard output.

use super::program::{STACK, names, run, stderr, thinlens};
use std::fs;
use std::path::Path;
use std::process::Output;

const LENS: [&str; 6] = ["--focal-length", "50", "--f-number", "2", "--focus", "6"];

/// The error that a failed run printed on standard output, where there is nothing else.
fn error_of(output: &Output) -> serde_json::Value {
    let mut json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let error = json["error"].take();
    assert_eq!(error["exit_code"], output.status.code().unwrap(), "{error}");
    error
}

/// The arguments of a render of `stack` into `output`.
fn render<'a>(stack: &'a str, output: &'a str) -> Vec<&'a str> {
    [&["render", stack, "-o", output][..], &LENS].concat()
}

/// Runs every subcommand that has `--json` on the files that it takes, with `arguments` behind.
fn with_json(folder: &Path, stack: &str, arguments: &[&str]) -> Vec<Output> {
    let commands: [&[&str]; 4] = [
        &["render", stack, "-o", "out.exr", "--json"],
        &["inspect", stack, "--json"],
        &["plan", stack, "--uncalibrated", "--json"],
        &["compare", stack, "--methods", "gather", "--json"],
    ];
    commands.iter().map(|command| run(folder, &[command, &LENS[..], arguments].concat())).collect()
}

#[test]
fn a_missing_input_is_input_4_in_json_of_every_command_with_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let mut outputs = with_json(folder.path(), "no-such.exr", &[]);
    outputs.push(run(folder.path(), &["score", "no-such.exr", STACK, "--json"]));
    for output in outputs {
        let error = error_of(&output);
        assert_eq!((&error["kind"], &error["file"]), (&"input".into(), &"no-such.exr".into()), "{error}");
        assert_eq!(error["exit_code"], 4);
        assert!(stderr(&output).contains(error["message"].as_str().unwrap()), "{}", stderr(&output));
    }
}

#[test]
fn a_wrong_value_is_call_2_in_json_of_every_command_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    for (wrong, helps) in [
        (&["--preset", "portrai"][..], "did you mean 'portrait'?"),
        (&["--without", "blurr"], "did you mean 'blur'?"),
    ] {
        for output in with_json(folder.path(), STACK, wrong) {
            let error = error_of(&output);
            assert_eq!((&error["kind"], &error["exit_code"]), (&"call".into(), &2.into()), "{error}");
            assert!(error["help"].as_str().unwrap().contains(helps), "{error}");
        }
    }
}

#[test]
fn a_command_line_that_cannot_be_understood_is_call_2_in_json_with_the_tip() {
    let folder = tempfile::tempdir().unwrap();
    for (arguments, words) in [
        (&["render", STACK, "--json"][..], "--output <FILE>"),
        (&["render", STACK, "-o", "a.png", "--json", "--codec", "piz"], "--codec has no effect"),
        (&["rendr", "--json"], "rendr"),
        (&["--json"], "--json"),
    ] {
        let output = run(folder.path(), arguments);
        let error = error_of(&output);
        assert_eq!((&error["kind"], &error["exit_code"]), (&"call".into(), &2.into()), "{error}");
        assert!(error["message"].as_str().unwrap().contains(words), "{error}");
        assert!(!error["message"].as_str().unwrap().contains('\n'), "one line: {error}");
    }
    let error = error_of(&run(folder.path(), &["score", "a.exr", "b.exr", "--jsn", "--json"]));
    assert!(error["help"].as_str().unwrap().contains("--json"), "{error}");
}

#[test]
fn a_place_in_a_preset_is_a_file_and_the_keys_of_an_error_are_flags_in_json_too() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("my.toml"), "[lens]\nf_numbr = 2\n").unwrap();
    let preset = ["render", STACK, "-o", "out.exr", "--preset", "my.toml", "--json"];
    let error = error_of(&run(folder.path(), &preset));
    assert_eq!(error["file"], "my.toml:2:1", "{error}");
    let near = ["render", STACK, "-o", "out.exr", "--preset", "portrait", "--focus", "0.02", "--json"];
    let error = error_of(&run(folder.path(), &near));
    assert!(error["help"].as_str().unwrap().contains("raise --focus"), "{error}");
}

#[test]
fn without_json_a_failure_leaves_standard_output_empty() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(run(folder.path(), &render("no-such.exr", "out.exr")).stdout, b"");
}

#[test]
fn a_picture_that_its_reader_did_not_take_is_a_failure_that_trying_again_may_mend() {
    let folder = tempfile::tempdir().unwrap();
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let arguments = [&render(STACK, "-")[..], &["--views", "4"]].concat();
    let output = thinlens(folder.path(), &arguments).stdout(writer).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("the reader of the output has closed it"), "{}", stderr(&output));
}

#[test]
fn a_report_that_its_reader_did_not_take_is_no_failure_once_the_picture_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let arguments = [&render(STACK, "out.exr")[..], &["--views", "4", "--json"]].concat();
    let output = thinlens(folder.path(), &arguments).stdout(writer).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert_eq!(names(folder.path()), ["out.exr"]);
}

#[test]
fn an_output_folder_with_a_file_in_its_way_is_a_wrong_call_in_every_command_that_writes_folders() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("file"), "kept").unwrap();
    let compare = ["compare", STACK, "--methods", "gather", "--preset", "portrait", "-o", "file"];
    for command in [&["demo", "-o", "file"][..], &["export", "mitsuba", "-o", "file"], &compare] {
        let output = run(folder.path(), command);
        assert_eq!(output.status.code(), Some(2), "{command:?}: {}", stderr(&output));
        assert!(stderr(&output).contains("a file is in the way"), "{}", stderr(&output));
    }
    assert_eq!(names(folder.path()), ["file"]);
}
