//! Running the real program in a folder of its own.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

/// A small stack that the program can render, and its lens.
pub(crate) const STACK: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/samples/fence/stack.exr");

/// Where the program keeps its calibration in tests, and not in the user's own folder.
const CACHE: &str = concat!(env!("CARGO_TARGET_TMPDIR"), "/calibration");

/// The program, about to run in `folder`.
pub(crate) fn thinlens(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_thinlens"));
    command.current_dir(folder).args(arguments).stdin(Stdio::null()).env("THINLENS_CACHE_DIR", CACHE);
    command
}

/// Runs the program in `folder`.
pub(crate) fn run(folder: &Path, arguments: &[&str]) -> Output {
    thinlens(folder, arguments).output().unwrap()
}

/// What the program said on standard error.
pub(crate) fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// The names of all files in `folder`, sorted.
pub(crate) fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}
