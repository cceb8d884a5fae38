//! The program as a user runs it.

#![cfg(feature = "cli")]
#![expect(clippy::unwrap_used, reason = "a test stops at the first failure")]

mod compare;
mod devices;
mod export;
mod failures;
mod faults;
mod inspect;
mod lens;
mod listings;
mod plan;
#[path = "../program/mod.rs"]
mod program;
mod render;
mod settings;
mod streams;
mod windows;
mod views;

use program::stderr;
use std::process::Output;

/// The standard output of a successful run.
fn stdout(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(0), "{}", stderr(output));
    String::from_utf8(output.stdout.clone()).unwrap()
}
