//! The command line: the only code that knows clap. One file a subcommand.
//!
//! stdout is the result, stderr progress and decisions. Exit codes: 0 done, 1 failed, 2 usage.

mod args;
mod checks;
mod compare;
mod completions;
mod console;
mod demo;
mod devices;
mod flags;
mod inspect;
mod man;
mod methods;
mod plan;
mod presets;
mod render;
mod score;

use clap::{Args, CommandFactory, Parser, Subcommand};
use console::Console;
use std::io;
use std::process::ExitCode;
use thinlens::error::Error;

const EXAMPLES: &str = "\
Examples:
  thinlens demo
  thinlens inspect stack.exr --preset portrait
  thinlens render stack.exr -o out.exr --preset portrait --focus 6";

/// Depth of field for renders, after the render
///
/// Puts a real lens on a pinhole render that was kept as a stack of depth peels.
#[derive(Debug, Parser)]
#[command(version, after_help = EXAMPLES, max_term_width = 110)]
struct Cli {
    #[command(flatten)]
    global: GlobalArgs,
    #[command(subcommand)]
    command: Command,
}

/// Flags of every subcommand.
#[derive(Debug, Args)]
struct GlobalArgs {
    /// Number of threads; all cores by default
    #[arg(long, global = true, value_name = "N", help_heading = "Method",
          value_parser = clap::value_parser!(u16).range(1..))]
    threads: Option<u16>,
    /// Print warnings and errors only
    #[arg(long, short, global = true, help_heading = "Output")]
    quiet: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    Render(Box<render::RenderArgs>),
    Inspect(Box<inspect::InspectArgs>),
    Plan(Box<plan::PlanArgs>),
    Compare(Box<compare::CompareArgs>),
    Score(score::ScoreArgs),
    Methods(methods::MethodsArgs),
    Presets(presets::PresetsArgs),
    Devices(devices::DevicesArgs),
    Demo(demo::DemoArgs),
    Completions(completions::CompletionsArgs),
    Man(man::ManArgs),
}

/// Why a command ended early.
#[derive(Debug)]
enum Failure {
    /// It failed.
    Failed(Error),
    /// It was called wrongly.
    Usage(clap::Error),
    /// Whoever read our standard output has stopped: no reason to complain.
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
    /// From writing to standard output, the only I/O of this module that is not the library's.
    fn from(error: io::Error) -> Self {
        Error::output("standard output cannot be written").caused_by(error).into()
    }
}

/// Parses the command line, runs the command and says how it went.
pub(crate) fn run() -> ExitCode {
    let outcome = Cli::try_parse().map_err(Failure::Usage).and_then(|cli| {
        let console = Console::new(cli.global.quiet);
        with_threads(cli.global.threads, || cli.command.run(&console))
    });
    match outcome {
        Ok(()) | Err(Failure::BrokenPipe) => ExitCode::SUCCESS,
        Err(Failure::Failed(error)) => {
            console::error(&error);
            ExitCode::from(1)
        }
        Err(Failure::Usage(error)) => {
            // Help and version are errors to clap, with exit code 0. A closed pipe is no reason to complain here either.
            let _ = error.print();
            ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2))
        }
    }
}

/// Runs `work` inside one pool of `threads` threads, so that nothing below has to make one.
fn with_threads(
    threads: Option<u16>,
    work: impl FnOnce() -> Result<(), Failure> + Send,
) -> Result<(), Failure> {
    let threads = threads.map_or(0, usize::from);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|cause| {
        Error::limits("the threads cannot be started").caused_by(cause).help("ask for fewer with --threads")
    })?;
    pool.install(work)
}

impl Command {
    fn run(self, console: &Console) -> Result<(), Failure> {
        match self {
            Self::Render(args) => render::run(&args, console),
            Self::Inspect(args) => inspect::run(&args, console),
            Self::Plan(args) => plan::run(&args, console),
            Self::Compare(args) => compare::run(&args, console),
            Self::Score(args) => score::run(&args),
            Self::Methods(args) => methods::run(&args),
            Self::Presets(args) => presets::run(&args),
            Self::Devices(args) => devices::run(&args),
            Self::Demo(args) => demo::run(&args, console),
            Self::Completions(args) => completions::run(&args),
            Self::Man(args) => man::run(&args),
        }
    }
}

/// A usage error about the subcommand called `command`.
fn usage_error(command: &str, kind: clap::error::ErrorKind, message: &str) -> Failure {
    let mut cli = Cli::command();
    cli.build();
    let error = match cli.find_subcommand_mut(command) {
        Some(command) => command.error(kind, message),
        None => cli.error(kind, message),
    };
    Failure::Usage(error)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn every_first_line_of_help_is_under_60_characters() {
        fn check(command: &clap::Command) {
            for argument in command.get_arguments() {
                let help = argument.get_help().map(ToString::to_string).unwrap_or_default();
                let name = format!("{} {}", command.get_name(), argument.get_id());
                assert!(!help.is_empty() && help.chars().count() < 60, "{name}: {help}");
            }
            command.get_subcommands().for_each(check);
        }
        check(&Cli::command());
    }

    #[test]
    fn every_flag_stands_under_one_of_the_four_headings() {
        let headings = ["Input", "Lens", "Method", "Output"];
        for command in Cli::command().get_subcommands() {
            for argument in command.get_arguments().filter(|argument| !argument.is_positional()) {
                let heading = argument.get_help_heading().unwrap_or("none");
                assert!(
                    headings.contains(&heading),
                    "{} {}: {heading}",
                    command.get_name(),
                    argument.get_id()
                );
            }
        }
    }

    #[test]
    fn every_subcommand_that_works_on_files_shows_three_examples() {
        for command in Cli::command().get_subcommands() {
            let Some(text) = command.get_after_help() else { continue };
            let text = text.to_string();
            let lines: Vec<_> = text.lines().filter(|line| line.starts_with("  thinlens ")).collect();
            assert_eq!(lines.len(), 3, "{}", command.get_name());
            for line in lines {
                let words = line.split_whitespace();
                assert!(Cli::try_parse_from(words).is_ok(), "{line}");
            }
        }
    }

    /// The commands that a page of documentation shows: indented lines, and code in the cells of tables.
    fn commands(page: &str) -> impl Iterator<Item = &str> {
        let indented = page.lines().filter_map(|line| line.strip_prefix("    thinlens "));
        let quoted = page.split('`').filter_map(|code| code.strip_prefix("thinlens "));
        indented.chain(quoted).filter(|command| !command.contains("SHELL") && !command.contains("COMMAND"))
    }

    #[test]
    fn every_command_in_the_documentation_is_understood() {
        let pages = [
            include_str!("../../README.md"),
            include_str!("../../samples/fence/README.md"),
            include_str!("../../samples/table/README.md"),
        ];
        for page in pages {
            assert!(commands(page).count() > 0, "no command in: {page}");
            for command in commands(page) {
                let words = command.split_whitespace();
                let parsed = Cli::try_parse_from(std::iter::once("thinlens").chain(words));
                assert!(parsed.is_ok(), "thinlens {command}: {parsed:?}");
            }
        }
    }
}
