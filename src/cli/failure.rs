//! The ways in which a command can fail.

use clap::error::ErrorKind;
use std::io;
use thinlens::error::Error;

/// Why a command failed.
#[derive(Debug)]
pub(super) enum Failure {
    /// An error of the library.
    Failed(Error),
    /// The command line cannot be parsed.
    Usage(clap::Error),
    /// The subcommand `command` was called with flags that cannot be combined.
    Misused { command: &'static str, kind: ErrorKind, message: String },
    /// The reader of standard output has closed it; this is not an error.
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
    /// An error of writing to standard output, the only I/O outside the library.
    fn from(error: io::Error) -> Self {
        Error::output("standard output cannot be written").caused_by(error).into()
    }
}

/// A usage error about the subcommand called `command`.
pub(super) fn usage_error(command: &'static str, kind: ErrorKind, message: &str) -> Failure {
    Failure::Misused { command, kind, message: message.to_owned() }
}
