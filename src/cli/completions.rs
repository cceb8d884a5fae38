//! `thinlens completions`.

use super::console::print;
use super::failure::Failure;
use clap::{Args, Command};
use clap_complete::{Shell, generate};

/// Print a shell's completion script
#[derive(Debug, Args)]
pub(super) struct CompletionsArgs {
    /// Shell that the script is for
    shell: Shell,
}

/// Prints the script for `cli`.
pub(super) fn run(args: &CompletionsArgs, mut cli: Command) -> Result<(), Failure> {
    let mut script = Vec::new();
    generate(args.shell, &mut cli, "thinlens", &mut script);
    print(&String::from_utf8_lossy(&script))?;
    Ok(())
}
