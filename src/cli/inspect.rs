//! `thinlens inspect`.

use super::args::JobArgs;
use super::checks;
use super::console::{Console, kebab, print, print_json, sampling};
use super::drivers::prepare;
use super::failure::Failure;
use super::flags::keys_to_flags;
use clap::Args;
use serde_json::json;
use std::fmt::{self, Display, Write};
use std::path::PathBuf;
use thinlens::gpu::Device;
use thinlens::lens::{Sharpness, ThinLens};
use thinlens::methods::{Plan, Registry};
use thinlens::output::report::{LensReport, StackReport};
use thinlens::output::{atomic, focus_map};
use thinlens::probes::{PEELS_ENOUGH_DB, PeelsSeen, peels_seen};
use thinlens::render::{Job, Prepared};
use thinlens::scene::{FocusShares, PeelStats, SceneStats};
use thinlens::settings::{Focus, LensSettings, Listed, Origin, PictureSettings};
use thinlens::shown::shown;
use thinlens::stack::{Carry, Objects, Stack, Window, listed};

const EXAMPLES: &str = "\
Examples:
  thinlens inspect stack.exr
  thinlens inspect stack.exr --preset portrait --focus 6 --overlay focus.png
  thinlens inspect beauty.exr --depth-file depth.exr --depth-convention ray --json";

/// Show how a stack is read, and what a render would do
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct InspectArgs {
    #[command(flatten)]
    job: JobArgs,
    /// Write a picture of the focus zones
    ///
    /// Pixels in focus keep their colours; in front of focus they are tinted orange with dark lines, behind focus blue with light
    /// lines. The lines mark CoC radii of 1, 2, 4, 8, … px. A black and white line marks where a surface crosses the plane of focus:
    /// black in front of it, white behind it.
    #[arg(long, value_name = "FILE.png", help_heading = "Output")]
    overlay: Option<PathBuf>,
    /// Print JSON
    #[arg(long, help_heading = "Output")]
    json: bool,
}

/// Number of object names that are shown; the rest is counted.
const OBJECTS_SHOWN: usize = 8;

/// A prepared render, with the analyses that only `inspect` makes.
struct Inspected {
    prepared: Prepared,
    focus: FocusShares,
    peels: Option<PeelsSeen>,
    objects: Vec<Objects>,
}

pub(super) fn run(args: &InspectArgs, console: &Console, methods: &Registry) -> Result<(), Failure> {
    let mut job = Job { methods: methods.clone(), ..args.job.job(Carry::Unused)? };
    if let Some(path) = &args.overlay {
        checks::png(path)?;
        checks::output(path, job.files())?;
    }
    job.read_options.objects = true;
    let prepared = prepare(&job.held()?)?;
    let coc_px = prepared.scene.seen_coc_px();
    if let Some(path) = &args.overlay {
        focus_map::write(path, &prepared.scene, &coc_px, &prepared.stack.picture_frame())?;
        console.wrote(path);
    }
    let focus = FocusShares::from_coc(&coc_px);
    let peels = peels_seen(&prepared.scene, &prepared.plan);
    let objects = prepared.stack.objects();
    let inspected = Inspected { prepared, focus, peels, objects };
    if args.json {
        print_json(&to_json(&inspected))?;
    } else {
        let text = to_text(&inspected).expect("text is always written");
        print(&keys_to_flags(&text))?;
    }
    Ok(())
}

impl InspectArgs {
    /// The folders that temporary files are made in.
    pub(super) fn folders(&self) -> Vec<PathBuf> {
        self.overlay.iter().filter_map(|file| atomic::temporary_folder(file)).collect()
    }
}

fn to_json(Inspected { prepared, focus, peels, objects }: &Inspected) -> serde_json::Value {
    let Prepared { stack, summary, settings, lens, sharpness, stats, plan, device, .. } = prepared;
    let carried: Vec<_> = stack.carried.channels.iter().map(|channel| &channel.name).collect();
    json!({
        "stack": summary,
        "data_window": window_json(stack.frame.data),
        "display_window": window_json(stack.frame.display),
        "pixel_aspect": stack.frame.pixel_aspect,
        "other_channels": carried,
        "objects": objects,
        "findings": stack.findings,
        "lens": LensReport::new(settings, lens),
        "picture": settings.picture,
        "sharpness": sharpness,
        "focus_shares": focus,
        "peels_seen": peels,
        "facts": stats,
        "depth_range": depth_range(stats, lens),
        "plan": plan,
        "device": device,
    })
}

fn window_json(Window { x, y, width, height }: Window) -> serde_json::Value {
    json!({ "x": x, "y": y, "width": width, "height": height })
}

fn to_text(Inspected { prepared, focus, peels, objects }: &Inspected) -> Result<String, fmt::Error> {
    let Prepared { stack, summary, settings, lens, sharpness, stats, plan, device, .. } = prepared;
    let mut text = String::new();
    write_stack(&mut text, stack, summary)?;
    objects.iter().try_for_each(|objects| write_objects(&mut text, objects))?;
    write_findings(&mut text, stack)?;
    write_lens(&mut text, &settings.lens, lens)?;
    write_picture(&mut text, &settings.picture)?;
    write_focus(&mut text, sharpness, focus)?;
    write_ranges(&mut text, stats, lens)?;
    write_peels(&mut text, &stats.peels)?;
    if let Some(peels) = peels {
        write_peels_seen(&mut text, peels)?;
    }
    write_plan(&mut text, plan)?;
    write_device(&mut text, device)?;
    Ok(text)
}

/// The device of the blur, and why it was chosen.
pub(super) fn write_device(text: &mut String, Device { name, reason, .. }: &Device) -> fmt::Result {
    line(text, "device", format!("{name}: {reason}"))
}

/// A name and its value.
fn line(text: &mut String, name: &str, value: impl Display) -> fmt::Result {
    writeln!(text, "  {name:<23} {}", shown(&value.to_string()))
}

fn write_stack(text: &mut String, stack: &Stack, summary: &StackReport) -> fmt::Result {
    let window = |Window { x, y, width, height }: Window| format!("{width}×{height} at {x},{y}");
    writeln!(text, "stack")?;
    line(text, "peels", summary.peels)?;
    line(text, "kind", &summary.kind)?;
    line(text, "depth", kebab(&stack.convention))?;
    line(text, "data window", window(stack.frame.data))?;
    line(text, "display window", window(stack.frame.display))?;
    line(text, "pixel aspect", stack.frame.pixel_aspect)?;
    line(text, "supersample", stack.supersample)?;
    line(text, "precision", kebab(&stack.precision))?;
    let carried: Vec<_> = stack.carried.channels.iter().map(|channel| channel.name.as_str()).collect();
    line(text, "other channels", if carried.is_empty() { "none".to_owned() } else { carried.join(" ") })
}

/// The objects that the lens can be focused on by name.
fn write_objects(text: &mut String, Objects { cryptomatte, names, unnamed, doubt }: &Objects) -> fmt::Result {
    let list = match doubt {
        None if names.is_empty() => "none visible".to_owned(),
        None => format!("{}: {}", names.len(), listed(names, OBJECTS_SHOWN)),
        Some(doubt) => {
            format!("{unnamed} without names: {doubt}; an object is still found by the hash of its name")
        }
    };
    line(text, "objects", format_args!("{cryptomatte}, {list}"))
}

fn write_findings(text: &mut String, stack: &Stack) -> fmt::Result {
    writeln!(text, "findings")?;
    for finding in &stack.findings {
        let mark = if finding.warning { "warning: " } else { "" };
        line(text, finding.about, format_args!("{mark}{}", finding.text))?;
    }
    Ok(())
}

/// Settings with their values and the origins of these.
fn write_settings(text: &mut String, listed: &[Listed<'_>]) -> fmt::Result {
    let set = listed.iter().filter_map(|listed| Some((listed, listed.value.as_ref()?)));
    for (Listed { setting, origin, .. }, value) in set {
        sourced(text, setting.name, &setting.in_words(value), origin)?;
    }
    Ok(())
}

/// A name, a value and its origin.
fn sourced(text: &mut String, name: &str, value: &str, origin: &Origin) -> fmt::Result {
    line(text, name, format_args!("{value:<24} {origin}"))
}

fn write_lens(text: &mut String, set: &LensSettings, lens: &ThinLens) -> fmt::Result {
    let focus = match &set.focus.value {
        Focus::Distance(distance) => format!("{distance} depth units"),
        Focus::Point([x, y]) => format!("{} depth units, at {x},{y}", lens.focus_distance),
        Focus::Object(name) => format!("{} depth units, '{name}'", lens.focus_distance),
        Focus::Centre => format!("{} depth units, centre", lens.focus_distance),
        Focus::Keys(keys) => format!("{} depth units, from {} focus keys", lens.focus_distance, keys.len()),
    };
    writeln!(text, "lens")?;
    sourced(text, "focus", &focus, &set.focus.origin)?;
    let mut listed = set.listed();
    listed.retain(|listed| listed.setting.field != "focus");
    write_settings(text, &listed)?;
    line(text, "CoC at infinity", format_args!("{:.2} px radius", lens.coc_infinity_px))
}

/// The settings of the picture, under the names of their tables in a preset.
fn write_picture(text: &mut String, set: &PictureSettings) -> fmt::Result {
    let listed = set.listed();
    for group in listed.chunk_by(|a, b| a.setting.table == b.setting.table) {
        let table = group.first().map_or("", |listed| listed.setting.table);
        writeln!(text, "{}", table.replace('-', " "))?;
        write_settings(text, group)?;
    }
    Ok(())
}

/// The depths that are sharp, and the shares of the picture in front of, in and behind focus.
fn write_focus(text: &mut String, sharpness: &Sharpness, focus: &FocusShares) -> fmt::Result {
    let Sharpness { coc_radius_px, hyperfocal_distance, near_limit, far_limit } = sharpness;
    let FocusShares { in_front, in_focus, behind, empty } = focus;
    writeln!(text, "focus")?;
    let sharp =
        format_args!("{near_limit:.4} … {far_limit:.4} depth units: CoC radius up to {coc_radius_px} px");
    line(text, "sharp", sharp)?;
    let effect = "focused at this distance or farther, everything up to infinity is sharp";
    line(text, "hyperfocal", format_args!("{hyperfocal_distance:.4} depth units: {effect}"))?;
    let [in_front, in_focus, behind, empty] = [in_front, in_focus, behind, empty].map(|share| 100.0 * share);
    let without_surface =
        if empty > 0.0 { format!(", {empty:.1} % without a surface") } else { String::new() };
    let shares = format_args!(
        "{in_front:.1} % in front, {in_focus:.1} % in focus, {behind:.1} % behind{without_surface}"
    );
    line(text, "shares of the picture", shares)
}

/// Planar depths of the nearest and the farthest fragment; `None` for background.
fn depth_range(stats: &SceneStats, lens: &ThinLens) -> [Option<f32>; 2] {
    stats.coc_range_px.map(|coc_px| lens.depth_planar(coc_px))
}

fn write_ranges(text: &mut String, stats: &SceneStats, lens: &ThinLens) -> fmt::Result {
    writeln!(text, "ranges")?;
    if stats.fragments == 0 {
        return line(text, "depth", "the stack is empty");
    }
    let [nearest, farthest] = depth_range(stats, lens)
        .map(|depth| depth.map_or("background".to_owned(), |depth| format!("{depth:.3}")));
    let [near, far] = stats.coc_range_px;
    line(text, "depth", format_args!("{nearest} … {farthest}"))?;
    line(text, "CoC radius", format_args!("{near:.2} … {far:.2} px"))?;
    let Some(reflections) = &stats.reflections else { return Ok(()) };
    let share = |count: usize| 100.0 * count as f64 / stats.fragments as f64;
    let [reflecting, moving] = [reflections.reflecting_fragments, reflections.moving_fragments].map(share);
    let largest = reflections.largest_movement_px;
    line(
        text,
        "reflections",
        format_args!(
            "{reflecting:.1} % of the fragments; the lens moves what {moving:.1} % show, by up to {largest:.2} px"
        ),
    )
}

/// The statistics of each peel, one line each.
pub(super) fn write_peels(text: &mut String, peels: &[PeelStats]) -> fmt::Result {
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    writeln!(
        text,
        "peels  {:>20}{:>10}{:>13}{:>10}{:>9}{:>20}",
        "CoC radius, px", "covered", "translucent", "in focus", "jumps", "light of highlights"
    )?;
    for (number, peel) in peels.iter().enumerate() {
        let PeelStats { coc_range_px: [near, far], covered, translucent, in_focus, .. } = *peel;
        let range = format!("{near:.1} … {far:.1}");
        let [covered, translucent, in_focus, jumps] =
            [covered, translucent, in_focus, peel.jumps].map(percent);
        writeln!(
            text,
            "  {:<5}{range:>20}{covered:>10}{translucent:>13}{in_focus:>10}{jumps:>9}{:>20.1}",
            number + 1,
            peel.highlight_light
        )?;
    }
    Ok(())
}

/// The number of peels that the lens sees, and how many to export.
fn write_peels_seen(text: &mut String, peels: &PeelsSeen) -> fmt::Result {
    let PeelsSeen { layers, needed, psnr_db, lost_rays, .. } = peels;
    let differences = psnr_db.iter().enumerate().map(|(k, db)| {
        let db = db.map_or("no measurable difference".to_owned(), |db| format!("{db:.1} dB"));
        format!("{db} with {}", k + 1)
    });
    let differences = differences.collect::<Vec<_>>().join(", ");
    line(text, "peels needed", format_args!("{needed} of {layers}; against all of them: {differences}"))?;
    let lost = 100.0 * lost_rays;
    let advice = if peels.needs_more_layers() {
        format!("export more peels: {lost:.2} % of the lens rays pass the last one and hit nothing")
    } else if needed < layers {
        format!("export {needed}: their picture reaches {PEELS_ENOUGH_DB} dB against that of all peels")
    } else {
        format!("export all {layers}: {lost:.2} % of the lens rays pass the last one and hit nothing")
    };
    line(text, "advice", advice)
}

/// The method, the number of views, and every effect with its reason and what the opposite choice would change.
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

/// `text` wrapped into rows that fit beside an effect's name.
fn wrapped(text: &str) -> Vec<String> {
    /// Maximum characters of a row: 119 columns with the indent.
    const LENGTH: usize = 88;
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
    fn rows_are_filled_up_to_their_maximum_length_and_keep_every_word() {
        let text = "twelve chars ".repeat(30);
        let rows = wrapped(&text);
        assert_eq!(rows.join(" "), text.trim_end());
        assert!(rows.iter().all(|row| row.len() <= 88) && rows.len() == 5, "390 characters: {rows:?}");
    }
}
