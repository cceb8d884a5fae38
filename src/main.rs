//! The `thinlens` program: the command line of [`thinlens::cli`] with the built-in methods.

use std::process::ExitCode;
use thinlens::methods::Registry;

fn main() -> ExitCode {
    thinlens::cli::run(&Registry::default())
}
