//! `thinlens presets`.

use super::console::print;
use super::failure::Failure;
use clap::{Args, Subcommand};
use thinlens::settings::{BUILT_IN, BuiltIn};

const EXAMPLES: &str = "\
Examples:
  thinlens presets
  thinlens presets show portrait
  thinlens render stack.exr -o out.exr --preset portrait";

/// List the lens presets, or show one
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct PresetsArgs {
    #[command(subcommand)]
    command: Option<PresetsCommand>,
}

#[derive(Debug, Subcommand)]
enum PresetsCommand {
    /// List the presets
    List,
    /// Print a preset's TOML, as a template for your own
    Show {
        /// Name of the preset
        name: String,
    },
}

pub(super) fn run(args: &PresetsArgs) -> Result<(), Failure> {
    match &args.command {
        None | Some(PresetsCommand::List) => {
            let width = BUILT_IN.iter().map(|preset| preset.name.len()).max().unwrap_or(0);
            let line = |preset: BuiltIn| format!("{:<width$}  {}\n", preset.name, preset.summary());
            print(&BUILT_IN.map(line).concat())?;
        }
        Some(PresetsCommand::Show { name }) => print(BuiltIn::by_name(name)?.text)?,
    }
    Ok(())
}
