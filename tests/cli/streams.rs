//! Standard input, pipes and links in place of files.

#![cfg(unix)]

use super::program::{names, run, stderr, thinlens};
use std::fs::{self, File};
use std::path::Path;
use std::process::{Command, Output, Stdio};

/// A stack of a few pixels.
const STACK: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/cycles/stack.exr");

const LENS: [&str; 8] = ["--focal-length", "50", "--f-number", "2", "--focus", "6", "--views", "4"];

/// Runs the program in `folder` with the file `input` as standard input.
fn run_with_stdin(folder: &Path, input: &str, arguments: &[&str]) -> Output {
    thinlens(folder, arguments).stdin(File::open(input).unwrap()).output().unwrap()
}

/// Runs a line of a shell in which `$T` is the program and `$S` a stack; the exit code is that of the first failing part.
fn bash(folder: &Path, line: &str) -> Output {
    let mut command = Command::new("bash");
    command.args(["-c", &format!("set -o pipefail; {line}")]).current_dir(folder).stdin(Stdio::null());
    command.env("T", env!("CARGO_BIN_EXE_thinlens")).env("S", STACK).env("L", LENS.join(" "));
    command.env("THINLENS_CACHE_DIR", concat!(env!("CARGO_TARGET_TMPDIR"), "/calibration")).output().unwrap()
}

fn has_bash() -> bool {
    Command::new("bash").args(["-c", ":"]).status().is_ok_and(|status| status.success())
}

/// Asserts that `output` is a success that wrote `file` with the pixels of `plain`.
fn assert_same_picture(folder: &Path, output: &Output, file: &str) {
    assert_eq!(output.status.code(), Some(0), "{}", stderr(output));
    let picture = |name: &str| thinlens::stack::read_picture(&folder.join(name)).unwrap();
    assert_eq!(picture(file).planes, picture("plain.exr").planes, "{file}");
}

#[test]
fn a_stack_from_standard_input_gives_the_picture_of_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    assert_eq!(
        run(folder, &[&["render", STACK, "-o", "plain.exr"], &LENS[..]].concat()).status.code(),
        Some(0)
    );
    let output = run_with_stdin(folder, STACK, &[&["render", "-", "-o", "piped.exr"], &LENS[..]].concat());
    assert_same_picture(folder, &output, "piped.exr");
    let output = run_with_stdin(folder, STACK, &[&["render", "-", "-o", "-"], &LENS[..]].concat());
    fs::write(folder.join("both.exr"), &output.stdout).unwrap();
    assert_same_picture(folder, &output, "both.exr");
    for command in [&["inspect", "-"][..], &["plan", "-", "--uncalibrated"], &["score", "-", STACK]] {
        let output = run_with_stdin(folder, STACK, command);
        assert_eq!(output.status.code(), Some(0), "{command:?}: {}", stderr(&output));
    }
}

#[test]
fn pipes_of_a_shell_are_read_like_files_for_every_input() {
    if !has_bash() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    assert_eq!(
        run(folder, &[&["render", STACK, "-o", "plain.exr"], &LENS[..]].concat()).status.code(),
        Some(0)
    );
    for (line, file) in [
        ("cat $S | $T render - -o a.exr $L", "a.exr"),
        ("$T render <(cat $S) -o b.exr $L", "b.exr"),
        ("cat $S | $T render /dev/stdin -o c.exr $L", "c.exr"),
        ("mkfifo p.0042.exr; (cat $S > p.0042.exr &); $T render p.0042.exr -o d.exr $L", "d.exr"),
        ("$T render $S -o - $L | cat > e.exr", "e.exr"),
        ("$T render $S -o /dev/stdout $L | cat > f.exr", "f.exr"),
        ("$T render $S -o >(cat > g.exr) $L && wait $!", "g.exr"),
    ] {
        assert_same_picture(folder, &bash(folder, line), file);
    }
    let report =
        bash(folder, "$T render <(cat $S) -o h.exr $L --preset <(echo '[lens]') --beauty <(cat $S) --json");
    assert_eq!(report.status.code(), Some(0), "{}", stderr(&report));
}

#[test]
fn standard_input_without_a_picture_is_refused_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let text = folder.join("text");
    fs::write(&text, "hello").unwrap();
    for (input, inputs, code, words) in [
        ("/dev/null", &["-"][..], 4, "standard input is empty"),
        (text.to_str().unwrap(), &["-"], 4, "this is not a picture in a supported format"),
        ("/dev/zero", &["-"], 4, "this is not a picture in a supported format"),
        (STACK, &["-", "-"], 2, "standard input is named twice"),
        (STACK, &["-", "--depth-file", "-"], 2, "standard input is named twice"),
        (STACK, &["-", "--frames", "1-3"], 2, "a pipe has one frame"),
        (STACK, &["-", "--memory", "6kB"], 1, "the input requires more memory than the limit"),
    ] {
        let output =
            run_with_stdin(folder, input, &[&["render"], inputs, &["-o", "out.exr"], &LENS[..]].concat());
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(code), "{input} {inputs:?}: {said}");
        assert!(
            said.contains(words) && said.contains("help:") | said.contains("expected:"),
            "{input}: {said}"
        );
    }
    assert_eq!(names(folder), ["text"], "no picture");
}

#[test]
fn a_picture_that_its_reader_did_not_take_is_a_failure_and_a_listing_is_none() {
    if !has_bash() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let lost = bash(folder.path(), "$T render $S -o - $L | true; exit ${PIPESTATUS[0]}");
    assert_eq!(lost.status.code(), Some(1), "{}", stderr(&lost));
    assert!(stderr(&lost).contains("the reader of the output has closed it"), "{}", stderr(&lost));
    let listing = bash(folder.path(), "$T methods --json | true; exit ${PIPESTATUS[0]}");
    assert_eq!(listing.status.code(), Some(0), "{}", stderr(&listing));
}

#[test]
fn names_in_messages_cannot_control_the_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let name = "a\u{1b}[2J\nerror: b\u{7}.exr";
    let missing = run(folder.path(), &[&["render", name, "-o", "out.exr"], &LENS[..]].concat());
    fs::copy(STACK, folder.path().join(name)).unwrap();
    let twice = run(folder.path(), &[&["render", name, "-o", name], &LENS[..]].concat());
    for output in [missing, twice] {
        let said = stderr(&output);
        assert!(said.chars().all(|c| c == '\n' || !c.is_control()), "{said:?}");
        assert!(said.contains("a\\u{1b}[2J\\nerror: b\\u{7}.exr"), "{said}");
    }
}

#[test]
fn more_threads_than_a_machine_has_use_for_are_capped_with_a_note() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = [&["render", STACK, "-o", "out.exr", "--threads", "100000"], &LENS[..]].concat();
    let output = run(folder.path(), &arguments);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(stderr(&output).contains("instead of 100000"), "{}", stderr(&output));
}
