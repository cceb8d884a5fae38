//! `thinlens completions`.

use super::console::print;
use super::failure::Failure;
use clap::builder::PossibleValuesParser;
use clap::{Args, Command};
use clap_complete::{Shell, generate};
use thinlens::methods::Registry;
use thinlens::scene::EffectKind;
use thinlens::settings::BUILT_IN;

/// Print a shell's completion script
#[derive(Debug, Args)]
pub(super) struct CompletionsArgs {
    /// Shell that the script is for
    shell: Shell,
}

/// Prints the script for `cli`, with the names of `methods`.
pub(super) fn run(args: &CompletionsArgs, cli: Command, methods: &Registry) -> Result<(), Failure> {
    let mut script = Vec::new();
    generate(args.shell, &mut with_names(cli, methods), "thinlens", &mut script);
    print(&presets_or_files(args.shell, &String::from_utf8_lossy(&script)))?;
    Ok(())
}

/// Subcommand, argument and the values that it is completed with. The parser checks these later, and says what is near a wrong one.
type Names = (Option<&'static str>, &'static str, Vec<&'static str>);

/// `cli` with the names of presets, effects, methods and subcommands as values.
fn with_names(cli: Command, methods: &Registry) -> Command {
    let effects = EffectKind::ALL.map(EffectKind::name).to_vec();
    let method_names: Vec<_> = methods.names_where(|_| true).collect();
    let commands = cli.get_subcommands().map(|command| command.get_name().to_owned()).collect();
    let names: [Names; 5] = [
        (None, "preset", preset_names()),
        (None, "force", effects.clone()),
        (None, "without", effects),
        (Some("methods"), "name", method_names.clone()),
        (Some("compare"), "methods", [&["all"], &method_names[..]].concat()),
    ];
    let named = names.into_iter().fold(cli, |cli, (of, argument, names)| {
        cli.mut_subcommands(|command| match of {
            Some(of) if of != command.get_name() => command,
            _ => with_values(command, argument, names.clone()),
        })
    });
    let show = |show: Command| with_values(show, "name", preset_names());
    named
        .mut_subcommand("presets", |presets| presets.mut_subcommand("show", show))
        .mut_subcommand("man", |man| with_values(man, "command", commands))
}

/// `command` with `values` for its argument called `argument`, if it has that.
fn with_values<T: Into<clap::builder::Str>>(
    command: Command,
    argument: &'static str,
    values: Vec<T>,
) -> Command {
    if command.get_arguments().any(|one| one.get_id() == argument) {
        let values = values.into_iter().map(clap::builder::PossibleValue::new);
        command.mut_arg(argument, |one| one.value_parser(PossibleValuesParser::new(values)))
    } else {
        command
    }
}

fn preset_names() -> Vec<&'static str> {
    BUILT_IN.iter().map(|preset| preset.name).collect()
}

/// `script` in which `--preset`, whose value is a name or a file, is completed with both.
fn presets_or_files(shell: Shell, script: &str) -> String {
    let names = preset_names().join(" ");
    let (of_names, of_both) = match shell {
        Shell::Bash => (
            format!("COMPREPLY=($(compgen -W \"{names}\" -- \"${{cur}}\"))"),
            format!(
                "compopt -o filenames 2>/dev/null\n                    COMPREPLY=($(compgen -W \"{names}\" -- \"${{cur}}\") $(compgen -f -- \"${{cur}}\"))"
            ),
        ),
        Shell::Zsh => (format!(":NAME|FILE:({names})"), format!(":NAME|FILE:{{compadd -- {names}; _files}}")),
        Shell::Fish => {
            let files = |line: &str| match line.contains(" -l preset ") {
                true => line.replacen(" -r -f -a ", " -r -F -a ", 1),
                false => line.to_owned(),
            };
            return script.split_inclusive('\n').map(files).collect();
        }
        _ => return script.to_owned(),
    };
    script.replace(&of_names, &of_both)
}
