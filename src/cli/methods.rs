//! `thinlens methods`.

use super::Failure;
use super::console::{print, print_json};
use clap::Args;
use thinlens::methods::{METHODS, MethodInfo};

/// List the methods
#[derive(Debug, Args)]
pub(super) struct MethodsArgs {
    /// Print JSON
    #[arg(long, help_heading = "Output")]
    json: bool,
}

pub(super) fn run(args: &MethodsArgs) -> Result<(), Failure> {
    let methods = METHODS.map(|method| method.info());
    if args.json {
        print_json(&methods)?;
    } else {
        print(&table(&methods))?;
    }
    Ok(())
}

fn table(methods: &[MethodInfo]) -> String {
    let width = |column: fn(&MethodInfo) -> &str| methods.iter().map(|m| column(m).chars().count()).max();
    let name_width = width(|method| method.name).unwrap_or(0);
    let role_width = width(|method| method.role).unwrap_or(0);
    let rows = methods.iter().map(|MethodInfo { name, role, summary, source }| {
        format!("{name:<name_width$}  {role:<role_width$}  {summary} ({source})\n")
    });
    rows.collect()
}
