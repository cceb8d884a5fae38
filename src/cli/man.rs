//! `thinlens man`.

use super::console::print;
use super::failure::{Failure, usage_error};
use clap::error::ErrorKind;
use clap::{Args, Command};
use clap_mangen::Man;
use std::fmt::Write;

/// Print a manual page
#[derive(Debug, Args)]
pub(super) struct ManArgs {
    /// Subcommand; default: the page of the whole program
    command: Option<String>,
}

/// The exit codes: a heading and a text each.
const EXIT_STATUS: [(&str, &str); 6] = [
    ("0", "Done. A listing that its reader closed early counts as done."),
    ("1", "Failed, and may succeed when tried again: the disk, the memory, the graphics card."),
    ("2", "Called wrongly: a flag, its value, a preset, a name, the place of the output."),
    ("3", "Some frames of a sequence failed; the others are there."),
    ("4", "The input is bad: missing, unreadable, damaged or not supported. Trying again does not help."),
    (
        "128 + n",
        "Ended by signal n: 129 by SIGHUP, 130 by SIGINT, 143 by SIGTERM. Temporary files are removed.",
    ),
];

/// The variables of the environment that the program, or what it is made of, reads.
const ENVIRONMENT: [(&str, &str); 7] = [
    (
        "THINLENS_CACHE_DIR",
        "Folder for the measured speed of this machine. Default: thinlens in the user's cache folder (XDG_CACHE_HOME, or .cache in HOME; \
         on Windows LOCALAPPDATA).",
    ),
    ("RAYON_NUM_THREADS", "Number of threads where --threads does not give it."),
    ("NO_COLOR", "If it is set and not empty, help and usage errors have no colours."),
    ("CLICOLOR, CLICOLOR_FORCE, TERM", "Whether help and usage errors have colours."),
    ("COLUMNS", "Width of help where it is not printed to a terminal."),
    (
        "VK_DRIVER_FILES, VK_ADD_DRIVER_FILES",
        "Vulkan drivers to use. If set, drivers are loaded even where no card is seen.",
    ),
    ("TMPDIR", "Folder for files that no output is beside."),
];

/// Prints the manual page of `cli`, or of one of its subcommands.
pub(super) fn run(args: &ManArgs, mut cli: Command) -> Result<(), Failure> {
    cli.build();
    let pages: Vec<String> = cli.get_subcommands().map(|command| page_name(command.get_name())).collect();
    let page_of = match &args.command {
        None => cli,
        Some(name) => cli.find_subcommand(name).cloned().ok_or_else(|| {
            usage_error("man", ErrorKind::InvalidSubcommand, &format!("there is no subcommand '{name}'"))
        })?,
    };
    let mut others = vec!["thinlens".to_owned()];
    others.extend(pages);
    let own = args.command.as_deref().map_or("thinlens".to_owned(), page_name);
    others.retain(|page| *page != own && *page != page_name("help"));
    let mut page = Vec::new();
    Man::new(page_of).render(&mut page)?;
    print(&(String::from_utf8_lossy(&page).into_owned() + &closing_sections(&others)))?;
    Ok(())
}

/// The name of the page of `command`.
fn page_name(command: &str) -> String {
    format!("thinlens-{command}")
}

/// The sections that every page ends with.
fn closing_sections(others: &[String]) -> String {
    let mut text = section("EXIT STATUS", &EXIT_STATUS) + &section("ENVIRONMENT", &ENVIRONMENT);
    let others: Vec<_> = others.iter().map(|page| format!("\\fB{}\\fR(1)", escaped(page))).collect();
    let _ = writeln!(text, ".SH \"SEE ALSO\"\n{}", others.join(",\n"));
    text
}

/// A section of headings, each with its text.
fn section(title: &str, entries: &[(&str, &str)]) -> String {
    let entry =
        |(heading, text): &(&str, &str)| format!(".TP\n\\fB{}\\fR\n{}\n", escaped(heading), escaped(text));
    format!(".SH \"{title}\"\n{}", entries.iter().map(entry).collect::<String>())
}

/// `text` with hyphens that can be copied as such. No line begins with a control character.
fn escaped(text: &str) -> String {
    text.replace('\\', "\\\\").replace('-', "\\-")
}
