//! How a command ends that does not end well.

use clap::error::ErrorKind;
use std::io;
use thinlens::error::Error;

/// Why a command ended early.
#[derive(Debug)]
pub(super) enum Failure {
    /// It failed.
    Failed(Error),
    /// The command line cannot be parsed.
    Usage(clap::Error),
    /// The subcommand `command` was called with flags that do not go together.
    Misused { command: &'static str, kind: ErrorKind, message: String },
    /// Whoever read our standard output has stopped: no reason to complain.
    BrokenPipe,
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        let cause = std::error::Error::source(&error).and_then(|cause| cause.downcast_ref::<io::Error>());
        match cause.map(io::Error::kind) {
            Some(io::ErrorKind::BrokenPipe) => Self::BrokenPipe,
            _ => Self::Failed(error),
        }
    }
}

impl From<io::Error> for Failure {
    /// From writing to standard output, the only I/O of the program that is not the library's.
    fn from(error: io::Error) -> Self {
        Error::output("standard output cannot be written").caused_by(error).into()
    }
}

/// A usage error about the subcommand called `command`.
pub(super) fn usage_error(command: &'static str, kind: ErrorKind, message: &str) -> Failure {
    Failure::Misused { command, kind, message: message.to_owned() }
}
