//! `thinlens man`.

use super::console::print;
use super::{Failure, command, usage_error};
use clap::Args;
use clap::error::ErrorKind;
use clap_mangen::Man;
use thinlens::methods::Registry;

/// Print a manual page
#[derive(Debug, Args)]
pub(super) struct ManArgs {
    /// A subcommand; the page of the whole program without it
    command: Option<String>,
}

pub(super) fn run(args: &ManArgs, methods: &Registry) -> Result<(), Failure> {
    let mut cli = command(methods);
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
