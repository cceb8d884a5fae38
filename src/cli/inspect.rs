//! `thinlens inspect`.

use super::Failure;
use super::args::JobArgs;
use super::console::{kebab, print, print_json, sampling};
use clap::Args;
use serde_json::json;
use std::fmt::{self, Display, Write};
use thinlens::lens::ThinLens;
use thinlens::output::report::{LensReport, StackReport};
use thinlens::render::{Prepared, prepare};
use thinlens::scene::{Facts, Plan};
use thinlens::settings::{Focus, LensSettings, Sourced};
use thinlens::stack::{Carry, Stack, Window};

const EXAMPLES: &str = "\
Examples:
  thinlens inspect stack.exr
  thinlens inspect stack.exr --preset portrait --focus 6
  thinlens inspect beauty.exr --depth-file depth.exr --depth-convention ray --json";

/// Show what was understood of a stack, and what a render would do
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct InspectArgs {
    #[command(flatten)]
    job: JobArgs,
    /// Print JSON
    #[arg(long, help_heading = "Output")]
    json: bool,
}

pub(super) fn run(args: &InspectArgs) -> Result<(), Failure> {
    let prepared = prepare(&args.job.job(Carry::Unused)?)?;
    if args.json {
        print_json(&to_json(&prepared))?;
    } else {
        let text = to_text(&prepared).expect("text is always written");
        print(&text)?;
    }
    Ok(())
}

fn to_json(prepared: &Prepared) -> serde_json::Value {
    let Prepared { stack, summary, settings, lens, facts, plan, device, .. } = prepared;
    let carried: Vec<_> = stack.carried.channels.iter().map(|channel| &channel.name).collect();
    json!({
        "stack": summary,
        "data_window": window_json(stack.frame.data),
        "display_window": window_json(stack.frame.display),
        "pixel_aspect": stack.frame.pixel_aspect,
        "other_channels": carried,
        "findings": stack.findings,
        "lens": LensReport::new(settings, lens),
        "facts": facts,
        "depth_range": depth_range(facts, lens),
        "plan": plan,
        "device": device,
    })
}

fn window_json(Window { x, y, width, height }: Window) -> serde_json::Value {
    json!({ "x": x, "y": y, "width": width, "height": height })
}

fn to_text(prepared: &Prepared) -> Result<String, fmt::Error> {
    let Prepared { stack, summary, settings, lens, facts, plan, device, .. } = prepared;
    let mut text = String::new();
    write_stack(&mut text, stack, summary)?;
    write_lens(&mut text, &settings.lens, lens)?;
    write_ranges(&mut text, facts, lens)?;
    write_plan(&mut text, plan)?;
    line(&mut text, "device", &device.name)?;
    Ok(text)
}

/// A name, and what there is to say about it.
fn line(text: &mut String, name: &str, value: impl Display) -> fmt::Result {
    writeln!(text, "  {name:<16} {value}")
}

fn write_stack(text: &mut String, stack: &Stack, summary: &StackReport) -> fmt::Result {
    let window = |Window { x, y, width, height }: Window| format!("{width}×{height} at {x},{y}");
    writeln!(text, "stack")?;
    line(text, "peels", summary.peels)?;
    line(text, "kind", kebab(&stack.kind))?;
    line(text, "depth", kebab(&stack.convention))?;
    line(text, "data window", window(stack.frame.data))?;
    line(text, "display window", window(stack.frame.display))?;
    line(text, "pixel aspect", stack.frame.pixel_aspect)?;
    line(text, "supersample", stack.supersample)?;
    line(text, "precision", kebab(&stack.precision))?;
    let carried: Vec<_> = stack.carried.channels.iter().map(|channel| channel.name.as_str()).collect();
    line(text, "other channels", if carried.is_empty() { "none".to_owned() } else { carried.join(" ") })?;
    writeln!(text, "findings")?;
    for finding in &stack.findings {
        let mark = if finding.warning { "warning: " } else { "" };
        line(text, finding.about, format_args!("{mark}{}", finding.text))?;
    }
    Ok(())
}

fn write_lens(text: &mut String, set: &LensSettings, lens: &ThinLens) -> fmt::Result {
    fn sourced<T>(text: &mut String, name: &str, value: impl Display, from: &Sourced<T>) -> fmt::Result {
        line(text, name, format_args!("{:<24} {}", value.to_string(), from.origin))
    }
    let focus = match set.focus.value {
        Focus::Distance(distance) => format!("{distance} depth units"),
        Focus::Point([x, y]) => format!("{} depth units, at {x},{y}", lens.focus_distance),
        Focus::Centre => format!("{} depth units, centre", lens.focus_distance),
    };
    let blades = if set.blades.value == 0 { "disc".to_owned() } else { set.blades.value.to_string() };
    writeln!(text, "lens")?;
    sourced(text, "focal length", format_args!("{} mm", set.focal_length_mm.value), &set.focal_length_mm)?;
    sourced(text, "f-number", set.f_number.value, &set.f_number)?;
    sourced(text, "focus", focus, &set.focus)?;
    sourced(text, "sensor width", format_args!("{} mm", set.sensor_width_mm.value), &set.sensor_width_mm)?;
    sourced(text, "sensor distance", kebab(&set.sensor_distance.value), &set.sensor_distance)?;
    sourced(text, "blades", blades, &set.blades)?;
    sourced(text, "rotation", format_args!("{}°", set.rotation_deg.value), &set.rotation_deg)?;
    sourced(text, "depth unit", format_args!("{} m", set.metres_per_unit.value), &set.metres_per_unit)?;
    sourced(text, "near clip", format_args!("{} depth units", set.near_clip.value), &set.near_clip)?;
    sourced(text, "depth 0 is at", format_args!("{} depth units", set.near.value), &set.near)?;
    sourced(text, "depth 1 is at", format_args!("{} depth units", set.far.value), &set.far)?;
    line(text, "CoC at infinity", format_args!("{:.2} px radius", lens.coc_infinity_px))
}

/// Planar depth of the nearest and the farthest fragment; `None` for background.
fn depth_range(facts: &Facts, lens: &ThinLens) -> [Option<f32>; 2] {
    facts.coc_range_px.map(|coc_px| lens.depth_planar(coc_px))
}

fn write_ranges(text: &mut String, facts: &Facts, lens: &ThinLens) -> fmt::Result {
    writeln!(text, "ranges")?;
    if facts.fragments == 0 {
        return line(text, "depth", "the stack is empty");
    }
    let [nearest, farthest] = depth_range(facts, lens)
        .map(|depth| depth.map_or("background".to_owned(), |depth| format!("{depth:.3}")));
    let [near, far] = facts.coc_range_px;
    line(text, "depth", format_args!("{nearest} … {farthest}"))?;
    line(text, "CoC radius", format_args!("{near:.2} … {far:.2} px"))
}

/// What will be simulated and what not, why, and what the other choice would change.
pub(super) fn write_plan(text: &mut String, plan: &Plan) -> fmt::Result {
    writeln!(text, "plan")?;
    line(text, "method", format_args!("{}: {}", plan.method, plan.method_reason))?;
    line(text, "views", sampling(plan))?;
    for effect in &plan.effects {
        let state = if effect.on { "on " } else { "off" };
        let mut rows = wrapped(&effect.reason).into_iter().chain(wrapped(&effect.change));
        line(text, effect.name.name(), format_args!("{state}  {}", rows.next().unwrap_or_default()))?;
        rows.try_for_each(|row| line(text, "", format_args!("     {row}")))?;
    }
    Ok(())
}

/// `text` in rows that fit beside an effect's name.
fn wrapped(text: &str) -> Vec<String> {
    /// Characters of a row, which make 119 columns.
    const LENGTH: usize = 95;
    let mut rows: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match rows.last_mut().filter(|row| row.chars().count() + 1 + word.chars().count() <= LENGTH) {
            Some(row) => row.extend([" ", word]),
            None => rows.push(word.to_owned()),
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_as_long_as_they_may_be_and_keep_every_word() {
        let text = "twelve chars ".repeat(30);
        let rows = wrapped(&text);
        assert_eq!(rows.join(" "), text.trim_end());
        assert!(rows.iter().all(|row| row.len() <= 95) && rows.len() == 5, "390 characters: {rows:?}");
    }
}
