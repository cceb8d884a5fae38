//! `thinlens man`.

use super::console::print;
use super::failure::{Failure, usage_error};
use clap::error::ErrorKind;
use clap::{Args, Command};
use clap_mangen::Man;

/// Print a manual page
#[derive(Debug, Args)]
pub(super) struct ManArgs {
    /// Subcommand; default: the page of the whole program
    command: Option<String>,
}

/// Prints the manual page of `cli`, or of one of its subcommands.
pub(super) fn run(args: &ManArgs, mut cli: Command) -> Result<(), Failure> {
    cli.build();
    let page_of = match &args.command {
        None => cli,
        Some(name) => cli.find_subcommand(name).cloned().ok_or_else(|| {
            usage_error("man", ErrorKind::InvalidSubcommand, &format!("there is no subcommand '{name}'"))
        })?,
    };
    let mut page = Vec::new();
    Man::new(page_of).render(&mut page)?;
    print(&String::from_utf8_lossy(&page))?;
    Ok(())
}
