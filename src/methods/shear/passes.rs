//! DECIDE for the passes of this method: highlights as exact discs, disocclusion fill, prefilter and resolve.

use super::parameters::ShearParameters;
use super::prefilter::MIN_VARIANCE;
use crate::error::Error;
use crate::scene::{BrightStep, Effect, EffectKind, Inputs, SceneStats, bright_step_floor, percent};
use std::f32::consts::PI;

/// Stacks of this many layers rarely lack a surface that a lens ray could hit.
const COMPLETE_LAYERS: usize = 3;

/// CoC radius in picture pixels up to which near blur is ignored: then only far edges disocclude surfaces that the stack lacks.
const NEAR_BLUR_FROM_PX: f32 = 0.5;

/// A fragment of at least this CoC radius is out of focus whatever bin it is rounded to: 1 px plus the bin width, in picture
/// pixels.
const OUT_OF_FOCUS_FROM_PX: f32 = 1.5;

/// The largest total area of exact discs, as a multiple of the picture's area. More discs would cost more than the views.
const HIGHLIGHT_COVER: f64 = 8.0;

/// The largest number of exact discs per pixel of the picture.
const HIGHLIGHT_SHARE: f64 = 0.05;

/// The decisions about this method's passes.
///
/// # Errors
/// [`crate::error::ErrorKind::Settings`] for a highlight threshold below white.
pub(super) fn decide(inputs: &Inputs<'_>, parameters: &ShearParameters) -> Result<Vec<Effect>, Error> {
    let threshold = parameters.highlight_threshold;
    if threshold != 0.0 && threshold.is_nan() | (threshold < bright_step_floor(0)) {
        return Err(Error::settings(
            "the highlight threshold must be 1 (white) or more, or 0 for no highlights",
        )
        .with("found", threshold.to_string())
        .help("set `highlight_threshold` in the preset's [method.shear]"));
    }
    Ok(vec![
        highlights(inputs, parameters),
        fill(inputs, parameters),
        prefilter(inputs, parameters),
        resolve(inputs, parameters),
    ])
}

/// The blurred fragments brighter than `threshold`, to within half a stop.
fn brighter(stats: &SceneStats, threshold: f32) -> BrightStep {
    let steps = stats.bright.iter().enumerate().filter(|(step, _)| bright_step_floor(step + 1) > threshold);
    steps.fold(BrightStep::default(), |sum, (_, step)| BrightStep {
        fragments: sum.fragments + step.fragments,
        discs: sum.discs + step.discs,
        disc_area_px: sum.disc_area_px + step.disc_area_px,
    })
}

/// The threshold that keeps the discs within their budget, and the discs above it.
fn affordable(stats: &SceneStats, requested: f32) -> (f32, BrightStep) {
    let pixels = (stats.picture_size.0 * stats.picture_size.1) as f64;
    let (mut discs, mut threshold) = (BrightStep::default(), f32::INFINITY);
    for (step, bright) in stats.bright.iter().enumerate().rev() {
        let with = BrightStep {
            fragments: discs.fragments + bright.fragments,
            discs: discs.discs + bright.discs,
            disc_area_px: discs.disc_area_px + bright.disc_area_px,
        };
        let affordable =
            with.disc_area_px <= HIGHLIGHT_COVER * pixels && with.discs <= HIGHLIGHT_SHARE * pixels;
        if bright_step_floor(step + 1) <= requested {
            break;
        }
        if !affordable {
            // Part of the step: the threshold moves continuously with the size of the discs.
            let share = share_of(bright, &discs, stats);
            let discs = BrightStep {
                fragments: discs.fragments + (share * bright.fragments as f64) as usize,
                discs: discs.discs + share * bright.discs,
                disc_area_px: discs.disc_area_px + share * bright.disc_area_px,
            };
            return (bright_step_floor(step + 1) * 0.5f32.powf(0.5 * share as f32), discs);
        }
        (discs, threshold) = (with, bright_step_floor(step).max(requested));
    }
    (threshold, discs)
}

/// The share of the discs of a step that the budget has room for beside `discs`.
fn share_of(step: &BrightStep, discs: &BrightStep, stats: &SceneStats) -> f64 {
    let pixels = (stats.picture_size.0 * stats.picture_size.1) as f64;
    let room = |budget: f64, taken: f64, asked: f64| ((budget - taken) / asked.max(1e-9)).clamp(0.0, 1.0);
    let by_area = room(HIGHLIGHT_COVER * pixels, discs.disc_area_px, step.disc_area_px);
    let by_count = room(HIGHLIGHT_SHARE * pixels, discs.discs, step.discs);
    by_area.min(by_count)
}

fn highlights(inputs: &Inputs<'_>, parameters: &ShearParameters) -> Effect {
    let stats = inputs.stats;
    let requested = parameters.highlight_threshold;
    let if_forced = if requested > 0.0 { requested } else { ShearParameters::default().highlight_threshold };
    let pixels = (stats.picture_size.0 * stats.picture_size.1).max(1) as f64;
    let off = |reason: &str| {
        let all = brighter(stats, if_forced);
        let change = if all.discs > 0.0 {
            format!(
                "with it, about {:.0} discs with a total of {:.2} times the picture's area would be drawn",
                all.discs.max(1.0),
                all.disc_area_px / pixels
            )
        } else {
            "with it, no effect: there is no disc to draw".to_owned()
        };
        Effect::new(EffectKind::Highlights, false, reason, change).with_strength(if_forced)
    };
    if requested == 0.0 {
        return off("switched off: highlight_threshold is 0");
    }
    let (threshold, discs) = affordable(stats, requested);
    if discs.discs <= 0.0 {
        return off(if brighter(stats, requested).fragments > 0 {
            "the bright parts are areas, not points: views are enough to render them"
        } else {
            "no blurred fragment is brighter than the threshold"
        });
    }
    let raised = if threshold > requested {
        format!(" (raised from {requested} to stay within budget)")
    } else {
        String::new()
    };
    let lights = discs.discs.max(1.0);
    let reason = format!(
        "{} blurred fragments brighter than {threshold:.2}{raised}, about {lights:.0} lights",
        discs.fragments
    );
    let change = without_discs(discs, inputs.views);
    let effect = Effect::new(EffectKind::Highlights, true, reason, change);
    effect.with_strength(threshold).with_strength_if_forced(requested)
}

/// What changes if `discs` are rendered by the views alone.
fn without_discs(discs: BrightStep, views: Option<usize>) -> String {
    let area = discs.disc_area_px / discs.discs;
    let disc = format!("a disc of mean area ({area:.0} px)");
    match views {
        None => format!("without it, {disc} would be one dot per view"),
        Some(views) if area <= views as f64 => {
            format!("without it, the {views} views would be enough: {disc} has no more pixels")
        }
        Some(views) => format!(
            "without it, {disc} would be {views} dots {:.1} times as bright as the disc",
            area / views as f64
        ),
    }
}

fn fill(inputs: &Inputs<'_>, parameters: &ShearParameters) -> Effect {
    let layers = inputs.stats.layers;
    let (on, reason) = if !parameters.fill {
        (false, "switched off".to_owned())
    } else if layers >= COMPLETE_LAYERS {
        (false, format!("{layers} layers hold most surfaces that lens rays can hit"))
    } else if inputs.stats.coc_range_px[0] > -NEAR_BLUR_FROM_PX {
        (true, format!("{layers} layer(s): what far edges disocclude is estimated from its surroundings"))
    } else {
        (
            true,
            format!("{layers} layer(s): what the near blur disoccludes is estimated from its surroundings"),
        )
    };
    let rays = "rays that pass all layers; their number is not known before rendering";
    let change = if on {
        format!("without it, no surface is hit by {rays}")
    } else {
        format!("with it, an estimated surface is hit by {rays}")
    };
    Effect::new(EffectKind::Fill, on, reason, change)
}

/// Distance between neighbouring copies of the most blurred fragment, or of what a mirror shows, in picture pixels.
fn gap_px(inputs: &Inputs<'_>, views: usize) -> f32 {
    (inputs.max_coc_px() + inputs.largest_movement_px()) * (PI / views as f32).sqrt()
}

fn prefilter(inputs: &Inputs<'_>, parameters: &ShearParameters) -> Effect {
    let strength = parameters.prefilter;
    let if_forced = if strength > 0.0 { strength } else { ShearParameters::default().prefilter };
    let decided =
        |on, reason, change| Effect::new(EffectKind::Prefilter, on, reason, change).with_strength(if_forced);
    let filter = format!("{strength} × half the gap between lens samples");
    let Some(views) = inputs.views else {
        let change = "without it, blurred surfaces would show one copy per view".to_owned();
        return decided(strength > 0.0, filter, change);
    };
    let gap = gap_px(inputs, views);
    // A margin, so that rounding never applies a filter that the plan does not expect.
    let idle = (0.5 * strength * gap).powi(2) / 3.0 < 0.999 * MIN_VARIANCE;
    if strength > 0.0 && !idle {
        let change =
            format!("without it, the most blurred surface would show {views} copies {gap:.2} px apart");
        return decided(true, filter, change);
    }
    if strength <= 0.0 {
        let change = format!("with it, the gaps of up to {gap:.2} px between copies would be closed");
        return decided(false, "switched off: prefilter is 0".to_owned(), change);
    }
    let reason = format!("{views} lens samples lie at most {gap:.2} px apart: there are no gaps to close");
    decided(false, reason, "with it, no effect: the filter is too narrow".to_owned())
}

fn resolve(inputs: &Inputs<'_>, parameters: &ShearParameters) -> Effect {
    let stats = inputs.stats;
    let weight = parameters.resolve;
    let if_forced = if weight > 0.0 { weight } else { ShearParameters::default().resolve };
    let decided = |on, reason: String, change: String| {
        Effect::new(EffectKind::Resolve, on, reason, change).with_strength(if_forced)
    };
    let [near, far] = stats.coc_range_px;
    if near >= OUT_OF_FOCUS_FROM_PX || far <= -OUT_OF_FOCUS_FROM_PX {
        let smallest = near.abs().min(far.abs());
        let reason = format!("nothing is in focus: the smallest CoC radius is {smallest:.1} px");
        return decided(false, reason, "with it, no effect".to_owned());
    }
    let by = format!("by up to {:.0} % of their difference from their neighbours", 400.0 * if_forced);
    let share = percent(stats.focused_fragments, stats.fragments);
    let with = format!("with it, {share:.1} % of the fragments would be softened {by}");
    if weight <= 0.0 {
        decided(false, "switched off: resolve is 0".to_owned(), with)
    } else if stats.antialiased >= 1.0 {
        decided(false, "the input is anti-aliased already".to_owned(), with)
    } else {
        let reason = format!("one sample a pixel, {} fragments in focus", stats.focused_fragments);
        let change = format!("without it, {share:.1} % of the fragments would not be softened {by}");
        decided(true, reason, change)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_discs_dots_are_brighter_by_the_ratio_of_disc_area_to_views() {
        let discs = BrightStep { fragments: 2, discs: 2.0, disc_area_px: 1280.0 };
        let text = without_discs(discs, Some(64));
        assert!(text.contains("64 dots 10.0 times as bright"), "640 px over 64 views: {text}");
        assert!(without_discs(discs, Some(1024)).contains("would be enough"), "more views than pixels");
    }
}
