//! The ways in which a command can fail, how each is told, and its exit code.

use super::console::{self, print_json};
use super::flags::keys_to_flags;
use clap::error::ErrorKind;
use serde::Serialize;
use std::ffi::OsString;
use std::io;
use std::process::ExitCode;
use thinlens::error::{Error, ErrorReport};

/// Why a command failed.
#[derive(Debug)]
pub(super) enum Failure {
    /// An error of the library.
    Failed(Error),
    /// The command line cannot be parsed.
    Usage(clap::Error),
    /// The subcommand `command` was called with flags that cannot be combined.
    Misused { command: &'static str, kind: ErrorKind, message: String },
    /// Frames of a sequence failed, which has been told; the exit code of the run.
    Frames(u8),
    /// The reader of a listing on standard output has closed it; this is not an error.
    BrokenPipe,
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::Failed(error)
    }
}

impl From<io::Error> for Failure {
    /// An error of writing a listing to standard output, the only I/O outside the library.
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::BrokenPipe => Self::BrokenPipe,
            _ => Self::Failed(Error::output("standard output cannot be written").caused_by(error)),
        }
    }
}

/// A usage error about the subcommand called `command`.
pub(super) fn usage_error(command: &'static str, kind: ErrorKind, message: &str) -> Failure {
    Failure::Misused { command, kind, message: message.to_owned() }
}

/// Whether `arguments` ask for JSON, also where they are wrong otherwise.
pub(super) fn wants_json(arguments: &[OsString]) -> bool {
    arguments.iter().take_while(|argument| *argument != "--").any(|argument| argument == "--json")
}

/// Prints the error that ended a command, with `json` on standard output as well; returns its exit code.
pub(super) fn failed(error: &Error, json: bool) -> ExitCode {
    console::error(error);
    if json {
        print_report(error.report());
    }
    ExitCode::from(error.kind().exit_code())
}

/// Prints a usage error, with `json` on standard output as well; returns its exit code. Help and version are clap errors too, with
/// exit code 0.
pub(super) fn misused(error: &clap::Error, json: bool) -> ExitCode {
    // A closed pipe is not an error.
    let _ = error.print();
    let is_error = error.exit_code() != 0;
    if is_error && json {
        print_report(report_of_call(error));
    }
    ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2))
}

/// A failed command, as `--json` shows it.
#[derive(Debug, Serialize)]
struct Failed {
    error: ErrorReport,
}

fn print_report(error: ErrorReport) {
    // Who does not read standard output has the exit code and standard error.
    let _ = print_json(&Failed { error: with_flags(error) });
}

/// `report` with the keys of settings replaced by flags.
pub(super) fn with_flags(mut report: ErrorReport) -> ErrorReport {
    let texts = [&mut report.message].into_iter().chain(&mut report.details).chain(&mut report.help);
    texts.for_each(|text| *text = keys_to_flags(text));
    report
}

/// What clap says of a wrong command line: the first paragraph without its head, and the tip.
fn report_of_call(error: &clap::Error) -> ErrorReport {
    let text = error.render().to_string();
    let tip = text.lines().find_map(|line| line.trim_start().strip_prefix("tip: ")).map(str::to_owned);
    if error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        return ErrorReport::of_call("there is no subcommand", tip);
    }
    let paragraph = text.split("\n\n").next().unwrap_or_default();
    let message = paragraph.strip_prefix("error: ").unwrap_or(paragraph);
    let message: Vec<&str> = message.split_whitespace().collect();
    ErrorReport::of_call(message.join(" "), tip)
}
