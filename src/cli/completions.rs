//! `thinlens completions`.

use super::console::print;
use super::{Cli, Failure};
use clap::{Args, CommandFactory};
use clap_complete::{Shell, generate};

/// Print a shell's completion script
#[derive(Debug, Args)]
pub(super) struct CompletionsArgs {
    /// The shell
    shell: Shell,
}

pub(super) fn run(args: &CompletionsArgs) -> Result<(), Failure> {
    let mut script = Vec::new();
    generate(args.shell, &mut Cli::command(), "thinlens", &mut script);
    print(&String::from_utf8_lossy(&script))?;
    Ok(())
}
