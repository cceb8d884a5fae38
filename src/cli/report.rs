//! What a render did, as `--report` and `--json` give it, and the parts that `inspect` shares with it.

use super::console::kebab;
use super::write;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use thinlens::lens::ThinLens;
use thinlens::render::{Rendered, StackInfo};
use thinlens::scene::Plan;
use thinlens::settings::Settings;
use thinlens::stack::Window;

/// A render that is done.
#[derive(Debug)]
pub(super) struct Outcome<'a> {
    pub(super) inputs: &'a [PathBuf],
    pub(super) output: &'a Path,
    pub(super) rendered: &'a Rendered,
    pub(super) write_seconds: f64,
    pub(super) total_seconds: f64,
}

/// The report of a render.
pub(super) fn report(outcome: &Outcome<'_>) -> Value {
    let Rendered { stack, settings, lens: thin_lens, plan: decided, device, seconds, .. } = outcome.rendered;
    let (cpu_seconds, peak_memory_bytes) = write::usage();
    let warnings: Vec<_> =
        stack.findings.iter().filter(|finding| finding.warning).map(|finding| &finding.text).collect();
    json!({
        "version": env!("CARGO_PKG_VERSION"),
        "input": outcome.inputs,
        "output": outcome.output,
        "method": decided.method,
        "device": device,
        "lens": lens(settings, thin_lens),
        "plan": plan(decided),
        "seconds": {
            "read": seconds.read,
            "plan": seconds.plan,
            "blur": seconds.blur,
            "write": outcome.write_seconds,
            "total": outcome.total_seconds,
        },
        "cpu_seconds": cpu_seconds,
        "peak_memory_bytes": peak_memory_bytes,
        "views": decided.views,
        "probe": null,
        "warnings": warnings,
    })
}

/// Every value of the lens with its origin, and the lens that follows from them.
pub(super) fn lens(settings: &Settings, lens: &ThinLens) -> Value {
    json!({
        "focal_length_mm": settings.focal_length_mm,
        "f_number": settings.f_number,
        "focus": settings.focus,
        "focus_distance": lens.focus_distance,
        "sensor_width_mm": settings.sensor_width_mm,
        "sensor_distance": settings.sensor_distance,
        "blades": settings.blades,
        "rotation_deg": settings.rotation_deg,
        "metres_per_unit": settings.metres_per_unit,
        "coc_infinity_px": lens.coc_infinity_px,
    })
}

/// The plan: the method, and every effect with its reason.
pub(super) fn plan(plan: &Plan) -> Value {
    json!({
        "method": plan.method,
        "method_reason": plan.method_reason,
        "views": plan.views,
        "effects": plan.effects,
        "parameters": plan.parameters,
    })
}

/// What was read.
pub(super) fn stack(stack: &StackInfo) -> Value {
    let carried: Vec<_> = stack.carried.channels.iter().map(|channel| &channel.name).collect();
    json!({
        "peels": stack.peels,
        "kind": kebab(&stack.kind),
        "convention": kebab(&stack.convention),
        "supersample": stack.supersample,
        "precision": kebab(&stack.precision),
        "data_window": window(stack.frame.data),
        "display_window": window(stack.frame.display),
        "pixel_aspect": stack.frame.pixel_aspect,
        "other_channels": carried,
    })
}

fn window(Window { x, y, width, height }: Window) -> Value {
    json!({ "x": x, "y": y, "width": width, "height": height })
}
