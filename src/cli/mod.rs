//! The command line: the only code that uses clap. One file per subcommand.
//!
//! Results go to standard output; progress, decisions and errors go to standard error. Exit codes: 0 success, otherwise those of
//! [`ErrorKind::exit_code`](thinlens::error::ErrorKind::exit_code).

mod args;
mod checks;
mod compare;
mod completions;
mod console;
mod demo;
mod devices;
mod drivers;
mod export;
mod failure;
mod flags;
mod inspect;
mod man;
mod methods;
mod outputs;
mod picture;
mod plan;
mod presets;
mod render;
mod score;
mod sequence;
mod signals;

use clap::builder::PossibleValuesParser;
use clap::{Args, CommandFactory, FromArgMatches, Parser, Subcommand};
use console::Console;
use failure::Failure;
use signals::Signals;
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;
use thinlens::cost::cache_folder;
use thinlens::error::Error;
use thinlens::methods::Registry;
use thinlens::output::temporary;

const EXAMPLES: &str = "\
Examples:
  thinlens demo
  thinlens inspect stack.exr --preset portrait
  thinlens render stack.exr -o out.exr --preset portrait --focus 6";

/// Threads that are used at most for each core.
const THREADS_PER_CORE: usize = 4;

/// Threads that may be used on any machine.
const FEWEST_MOST_THREADS: usize = 64;

/// Depth of field for renders, after the render
///
/// Blurs a pinhole render, kept as a stack of depth peels, as a real lens would.
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
    /// Number of threads; default: all cores
    ///
    /// At most four for each core, or 64 if that is more: further ones take memory and save no time. The picture is the same with any
    /// number.
    #[arg(long, global = true, value_name = "N", help_heading = "Method",
          value_parser = clap::value_parser!(u64).range(1..))]
    threads: Option<u64>,
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
    Export(export::ExportArgs),
    Completions(completions::CompletionsArgs),
    Man(man::ManArgs),
}

/// Runs the program with the command line of this process and the methods of `methods`; returns its exit code.
pub fn run(methods: &Registry) -> ExitCode {
    run_with(std::env::args_os(), methods)
}

/// Runs the program with `arguments`, the first of which is its name, and the methods of `methods`; returns its exit code.
pub fn run_with(arguments: impl IntoIterator<Item = OsString>, methods: &Registry) -> ExitCode {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    let json = failure::wants_json(&arguments);
    let parsed = command(methods).try_get_matches_from(arguments);
    let parsed = parsed.and_then(|matches| Cli::from_arg_matches(&matches)).map_err(Failure::Usage);
    let outcome = parsed.and_then(|cli| {
        let console = Console::new(cli.global.quiet);
        let folders = cli.command.folders();
        remove_stale(&folders, console);
        let signals = Signals::handle(folders)
            .map_err(|cause| Error::limits("signals cannot be handled").caused_by(cause))?;
        let outcome =
            with_threads(threads(cli.global.threads, console), || cli.command.run(&console, methods));
        signals.wait_if_ending();
        outcome
    });
    match outcome {
        Ok(()) | Err(Failure::BrokenPipe) => ExitCode::SUCCESS,
        Err(Failure::Failed(error)) => failure::failed(&error, json),
        Err(Failure::Frames(code)) => ExitCode::from(code),
        Err(Failure::Usage(error)) => failure::misused(&error, json),
        Err(Failure::Misused { command, kind, message }) => {
            failure::misused(&usage_of(command, kind, message), json)
        }
    }
}

/// clap's error about the subcommand called `command`.
fn usage_of(command: &str, kind: clap::error::ErrorKind, message: String) -> clap::Error {
    let mut cli = Cli::command();
    cli.build();
    match cli.find_subcommand_mut(command) {
        Some(command) => command.error(kind, message),
        None => cli.error(kind, message),
    }
}

/// The number of threads that is used of `requested` ones, with a note where it is less; 0 for as many as there are cores.
fn threads(requested: Option<u64>, console: Console) -> usize {
    let Some(requested) = requested else { return 0 };
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let most = (THREADS_PER_CORE * cores).max(FEWEST_MOST_THREADS);
    let used = usize::try_from(requested).unwrap_or(usize::MAX).min(most);
    if (used as u64) < requested {
        console.note(format_args!("threads: {used} instead of {requested}: there are {cores} cores"));
    }
    used
}

/// Runs `work` inside a pool of `threads` threads; the library creates no pool of its own.
fn with_threads(threads: usize, work: impl FnOnce() -> Result<(), Failure> + Send) -> Result<(), Failure> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|cause| {
        Error::limits("the threads cannot be started")
            .caused_by(cause)
            .help("set a smaller number with --threads")
    })?;
    pool.install(work)
}

/// Removes what runs that were killed left in `folders`.
fn remove_stale(folders: &[PathBuf], console: Console) {
    for folder in folders {
        let removed = temporary::remove_stale(folder);
        if removed > 0 {
            console.note(format_args!(
                "removed {removed} temporary {} that earlier runs left in {}",
                if removed == 1 { "file" } else { "files" },
                folder.display()
            ));
        }
    }
}

impl Command {
    /// The folders that temporary files are made in.
    fn folders(&self) -> Vec<PathBuf> {
        let mut folders = match self {
            Self::Render(args) => args.folders(),
            Self::Inspect(args) => args.folders(),
            Self::Plan(args) => args.folders(),
            Self::Compare(args) => args.folders(),
            Self::Score(args) => args.folders(),
            Self::Demo(args) => args.folders(),
            Self::Export(args) => args.folders(),
            Self::Methods(_) | Self::Presets(_) | Self::Devices(_) | Self::Completions(_) | Self::Man(_) => {
                return Vec::new();
            }
        };
        // Where the speed of this machine is kept.
        folders.extend(cache_folder());
        folders.sort_unstable();
        folders.dedup();
        folders
    }

    fn run(self, console: &Console, methods: &Registry) -> Result<(), Failure> {
        match self {
            Self::Render(args) => render::run(&args, console, methods),
            Self::Inspect(args) => inspect::run(&args, console, methods),
            Self::Plan(args) => plan::run(&args, console, methods),
            Self::Compare(args) => compare::run(&args, console, methods),
            Self::Score(args) => score::run(&args),
            Self::Methods(args) => methods::run(&args, methods),
            Self::Presets(args) => presets::run(&args),
            Self::Devices(args) => devices::run(&args),
            Self::Demo(args) => demo::run(&args, console),
            Self::Export(args) => export::run(&args, console),
            Self::Completions(args) => completions::run(&args, command(methods), methods),
            Self::Man(args) => man::run(&args, command(methods)),
        }
    }
}

/// The command line `cli`, where a list of files takes the place of inputs.
fn without_required_inputs(cli: clap::Command) -> clap::Command {
    cli.mut_subcommands(|command| {
        if command.get_arguments().any(|argument| argument.get_id() == "files_from") {
            command.mut_arg("inputs", |inputs| inputs.required(false).required_unless_present("files_from"))
        } else {
            command
        }
    })
}

/// The command line, with the names of `methods` as the values of `--method`.
fn command(methods: &Registry) -> clap::Command {
    let names: Vec<&str> = std::iter::once("auto").chain(methods.names_where(|_| true)).collect();
    let cli = without_required_inputs(Cli::command());
    cli.mut_subcommands(|command| {
        if command.get_arguments().any(|argument| argument.get_id() == "method") {
            command.mut_arg("method", |method| method.value_parser(PossibleValuesParser::new(&names)))
        } else {
            command
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::path::{Path, PathBuf};

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn every_flag_that_a_key_of_the_library_becomes_is_one_of_a_render() {
        let cli = Cli::command();
        let render = cli.find_subcommand("render").unwrap();
        for (key, name) in flags::OTHER_FLAGS {
            let known = render.get_arguments().any(|argument| argument.get_long() == Some(name));
            assert!(known, "{key}: --{name}");
        }
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
    fn every_flag_is_under_one_of_the_four_headings() {
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

    /// README.md and every page of docs/ and samples/, by name.
    fn pages() -> Vec<(String, String)> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let entries = |folder: &Path| -> Vec<PathBuf> {
            let entries = fs::read_dir(folder).unwrap();
            entries.map(|entry| entry.unwrap().path()).collect()
        };
        let samples = entries(&root.join("samples")).into_iter().map(|folder| folder.join("README.md"));
        let more = [root.join("README.md"), root.join("samples/README.md")];
        let files = entries(&root.join("docs")).into_iter().chain(samples).chain(more);
        let pages = files.filter(|file| file.is_file() && file.extension().is_some_and(|e| e == "md"));
        pages.map(|file| (file.display().to_string(), fs::read_to_string(&file).unwrap())).collect()
    }

    /// The commands that a page of documentation shows: indented lines, and code in the cells of tables.
    fn commands(page: &str) -> impl Iterator<Item = &str> {
        let indented = page.lines().filter(|line| line.starts_with("    ")).map(str::trim_start);
        let commands = indented.chain(page.split('`')).filter_map(|code| code.strip_prefix("thinlens "));
        commands.filter(|command| !command.contains("SHELL") && !command.contains("COMMAND"))
    }

    #[test]
    fn every_command_in_the_documentation_is_understood() {
        for (name, page) in pages() {
            for command in commands(&page) {
                let words = command.split_whitespace().map(|word| word.trim_matches(['"', '\'']));
                let words = words.take_while(|word| ![">", "|", "||", "&&", "#"].contains(word));
                let parsed = Cli::try_parse_from(std::iter::once("thinlens").chain(words));
                // Help is an error to clap, with exit code 0.
                let error = parsed.err().filter(|error| error.exit_code() != 0);
                assert!(error.is_none(), "{name}: thinlens {command}: {error:?}");
            }
        }
    }

    #[test]
    fn the_readme_every_page_by_task_and_every_sample_are_read_for_commands() {
        let pages = pages();
        for end in ["/README.md", "docs/lens.md", "docs/batch.md", "samples/fence/README.md"] {
            let (_, page) = pages.iter().find(|(name, _)| name.ends_with(end)).expect(end);
            assert!(commands(page).count() > 0, "no command in {end}");
        }
    }
}
