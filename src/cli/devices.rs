//! `thinlens devices`.

use super::console::{print, print_json};
use super::drivers::survey;
use super::failure::Failure;
use clap::Args;
use std::fmt::Write;
use thinlens::gpu::{Adapter, Survey};

const EXAMPLES: &str = "\
Examples:
  thinlens devices
  thinlens devices --json
  thinlens render stack.exr -o out.exr --device cpu";

/// List the devices, and which one auto chooses
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct DevicesArgs {
    /// Print JSON
    #[arg(long, help_heading = "Output")]
    json: bool,
}

pub(super) fn run(args: &DevicesArgs) -> Result<(), Failure> {
    let survey = survey();
    if args.json {
        print_json(&survey)?;
    } else {
        print(&in_words(&survey))?;
    }
    Ok(())
}

fn in_words(survey: &Survey) -> String {
    let Survey { processor, threads, adapters, looked_for, auto, auto_reason } = survey;
    let mut text = format!("cpu   {processor}, {threads} threads\n");
    for adapter in adapters {
        text += &adapter_in_words(adapter);
    }
    if adapters.is_empty() {
        let _ = writeln!(text, "gpu   none: {looked_for}");
    }
    let _ = writeln!(text, "auto  {}: {auto_reason}", auto.name());
    text
}

fn adapter_in_words(adapter: &Adapter) -> String {
    let mib = |bytes: u64| bytes >> 20;
    let timestamps = if adapter.has_timestamps { "timestamps" } else { "no timestamps" };
    format!(
        "gpu   {adapter}\n      driver {}; at most {} MiB per binding, {} MiB per buffer, {} threads per workgroup; {timestamps}\n",
        adapter.driver,
        mib(adapter.max_binding_bytes),
        mib(adapter.max_buffer_bytes),
        adapter.max_workgroup_threads
    )
}
