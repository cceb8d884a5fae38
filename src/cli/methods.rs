//! `thinlens methods`.

use super::console::{print, print_json};
use super::failure::Failure;
use clap::Args;
use std::fmt::Write;
use thinlens::methods::{Deviation, Method, MethodInfo, Registry};
use thinlens::settings::Parameter;

/// List the methods, or describe one of them
#[derive(Debug, Args)]
pub(super) struct MethodsArgs {
    /// Method to describe with its parameters and limits
    name: Option<String>,

    /// Print JSON
    #[arg(long, help_heading = "Output")]
    json: bool,
}

/// Everything that is printed about a method.
#[derive(Debug, serde::Serialize)]
struct Description {
    #[serde(flatten)]
    info: MethodInfo,
    samples_the_lens: bool,
    /// Devices that it runs on.
    runs_on: &'static [&'static str],
    parameters: Vec<Parameter>,
}

pub(super) fn run(args: &MethodsArgs, methods: &Registry) -> Result<(), Failure> {
    let described: Vec<Description> = match &args.name {
        Some(name) => vec![describe(methods.by_name(name)?)],
        None => methods.iter().map(describe).collect(),
    };
    match (args.json, &args.name) {
        (true, _) => print_json(&described)?,
        (false, Some(_)) => print(&described.iter().map(in_full).collect::<String>())?,
        (false, None) => print(&table(&described))?,
    }
    Ok(())
}

fn describe(method: &'static dyn Method) -> Description {
    Description {
        info: method.info(),
        samples_the_lens: method.samples_lens(),
        runs_on: if method.gpu().is_some() { &["cpu", "gpu"] } else { &["cpu"] },
        parameters: method.parameters().declarations(),
    }
}

fn table(methods: &[Description]) -> String {
    let width = |column: fn(&MethodInfo) -> &str| {
        methods.iter().map(|method| column(&method.info).chars().count()).max().unwrap_or(0)
    };
    let name_width = width(|info| info.name);
    let role_width = width(|info| info.role.name());
    let rows = methods.iter().map(|method| {
        let MethodInfo { name, role, summary, source, .. } = method.info;
        let devices = method.runs_on.join(", ");
        format!("{name:<name_width$}  {role:<role_width$}  {devices:<8}  {summary} ({source})\n")
    });
    rows.collect()
}

/// The full description of a method, as a preset that sets every parameter to its default.
fn in_full(method: &Description) -> String {
    let MethodInfo { name, role, summary, source, deviations, .. } = method.info;
    let devices = method.runs_on.join(", ");
    let mut text = format!(
        "# {name} ({role}): {summary}\n# {source}\n# Runs on: {devices}\n\n[method]\nname = \"{name}\"\n"
    );
    if !method.parameters.is_empty() {
        let _ = write!(text, "\n[method.{name}]\n");
    }
    for Parameter { name, default, kind, description } in &method.parameters {
        let _ = write!(text, "# {description} May be {}.\n{name} = {default}\n", kind.in_words());
    }
    if !deviations.is_empty() {
        text += "\n# By design, the method deviates from these laws of the blur:\n";
    }
    for Deviation { law, within: [min, max], reason } in deviations {
        let law_name = super::console::kebab(law);
        let _ = writeln!(text, "# {law_name}: {reason} ({}: {min} … {max})", law.figure());
    }
    text
}
