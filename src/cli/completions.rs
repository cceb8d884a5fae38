//! `thinlens completions`.

use super::console::print;
use super::{Failure, command};
use clap::Args;
use clap_complete::{Shell, generate};
use thinlens::methods::Registry;

/// Print a shell's completion script
#[derive(Debug, Args)]
pub(super) struct CompletionsArgs {
    /// The shell
    shell: Shell,
}

pub(super) fn run(args: &CompletionsArgs, methods: &Registry) -> Result<(), Failure> {
    let mut script = Vec::new();
    generate(args.shell, &mut command(methods), "thinlens", &mut script);
    print(&String::from_utf8_lossy(&script))?;
    Ok(())
}
