//! DECIDE, for what is bright: whether highlights are exact discs, and whether a clipped source gets back the light that it lost.

use super::{Given, new, percent};
use crate::scene::facts::{BrightStep, bright_step_floor};
use crate::scene::{Effect, EffectKind, Extrapolation, Facts};
use crate::settings::{MethodParameters, ShearParameters};
use crate::stack::ColorRange;

/// Exact discs may cover this many times the picture's area: past it they would cost more than the views themselves.
const HIGHLIGHT_COVER: f64 = 8.0;

/// Exact discs may be this many for each pixel of the picture.
const HIGHLIGHT_SHARE: f64 = 0.05;

pub(super) fn highlight_extrapolation(given: &Given<'_>) -> Effect {
    let Given { facts, extrapolation, .. } = given;
    let Extrapolation { threshold, gain, .. } = extrapolation;
    let new =
        |on, reason: String, change: String| new(EffectKind::HighlightExtrapolation, on, reason, change);
    if facts.color_range == ColorRange::Unbounded {
        let change = format!(
            "with it, blurred fragments of a displayed luminance above {threshold} would be up to {gain} times as bright"
        );
        return new(false, "the source is scene-linear: nothing was clipped".to_owned(), change);
    }
    let gained = extrapolation.gained(&facts.light);
    if gained.added <= 0.0 {
        let reason = match gained.fragments {
            0 => format!("no blurred fragment has a displayed luminance above {threshold}"),
            _ => format!("nothing would be gained: its gain is {gain}"),
        };
        return new(false, reason, "with it, nothing".to_owned());
    }
    let share = percent(gained.fragments, facts.fragments);
    let more = 100.0 * gained.added / gained.light;
    let reason = format!(
        "the source ends at white, and {} blurred fragments ({share:.1} %) have a displayed luminance above {threshold}: they gain \
         {more:.0} % of light",
        gained.fragments
    );
    let less = 100.0 * gained.added / (gained.light + gained.added);
    let change = format!(
        "without it, they would have {less:.0} % less light, and lights that were clipped be grey discs"
    );
    new(true, reason, change)
}

/// The blurred fragments that are brighter than `wanted`, to within half a stop.
fn brighter(facts: &Facts, wanted: f32) -> BrightStep {
    let steps = facts.bright.iter().enumerate().filter(|(step, _)| bright_step_floor(step + 1) > wanted);
    steps.fold(BrightStep::default(), |sum, (_, step)| BrightStep {
        fragments: sum.fragments + step.fragments,
        disc_area_px: sum.disc_area_px + step.disc_area_px,
    })
}

/// The threshold that keeps the discs within their budget, and the discs above it.
fn affordable(facts: &Facts, wanted: f32) -> (f32, BrightStep) {
    let pixels = (facts.picture_size.0 * facts.picture_size.1) as f64;
    let (mut discs, mut threshold) = (BrightStep::default(), f32::INFINITY);
    for (step, bright) in facts.bright.iter().enumerate().rev() {
        let with = BrightStep {
            fragments: discs.fragments + bright.fragments,
            disc_area_px: discs.disc_area_px + bright.disc_area_px,
        };
        let affordable = with.disc_area_px <= HIGHLIGHT_COVER * pixels
            && with.fragments as f64 <= HIGHLIGHT_SHARE * pixels * (facts.supersample as f64).powi(2);
        if bright_step_floor(step + 1) <= wanted || !affordable {
            break;
        }
        (discs, threshold) = (with, bright_step_floor(step).max(wanted));
    }
    (threshold, discs)
}

/// The threshold of exact discs, infinite for none, and the decision.
pub(super) fn highlights(given: &Given<'_>) -> (f32, Effect) {
    let facts = given.facts;
    let wanted = given.parameters.shear.highlight_threshold;
    let pixels = (facts.picture_size.0 * facts.picture_size.1).max(1) as f64;
    let off = |reason: &str| {
        let all = brighter(facts, if wanted > 0.0 { wanted } else { highlight_threshold(given.parameters) });
        let change = match all.fragments {
            0 => "with it, nothing: there is none to draw".to_owned(),
            count => format!(
                "with it, {count} discs of together {:.2} times the picture's area would be drawn",
                all.disc_area_px / pixels
            ),
        };
        (f32::INFINITY, new(EffectKind::Highlights, false, reason, change))
    };
    if wanted == 0.0 {
        return off("switched off: highlight_threshold is 0");
    }
    let (threshold, discs) = affordable(facts, wanted);
    if discs.fragments == 0 {
        return off(if brighter(facts, wanted).fragments > 0 {
            "the bright parts are areas, not points: the views carry them"
        } else {
            "no blurred fragment is brighter than the threshold"
        });
    }
    let raised = if threshold > wanted {
        format!(" (raised from {wanted} to stay within budget)")
    } else {
        String::new()
    };
    let reason = format!("{} blurred fragments brighter than {threshold:.2}{raised}", discs.fragments);
    (threshold, new(EffectKind::Highlights, true, reason, without_discs(discs, given.views)))
}

/// What the views alone would show of `discs`.
fn without_discs(discs: BrightStep, views: Option<usize>) -> String {
    let area = discs.disc_area_px / discs.fragments.max(1) as f64;
    let disc = format!("a disc of {area:.0} px, their mean,");
    match views {
        None => format!("without it, {disc} would be as many dots as there are views"),
        Some(views) if area <= views as f64 => {
            format!("without it, the {views} views would carry them: {disc} has no more pixels")
        }
        Some(views) => format!(
            "without it, {disc} would be {views} dots {:.1} times as bright as it",
            area / views as f64
        ),
    }
}

/// The threshold of discs that are asked for: the parameter, or its default where it is 0.
pub(in crate::scene) fn highlight_threshold(parameters: &MethodParameters) -> f32 {
    let own = parameters.shear.highlight_threshold;
    if own > 0.0 { own } else { ShearParameters::default().highlight_threshold }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lights_without_discs_are_dots_as_much_brighter_as_the_disc_is_larger_than_their_number() {
        let discs = BrightStep { fragments: 2, disc_area_px: 1280.0 };
        let text = without_discs(discs, Some(64));
        assert!(text.contains("64 dots 10.0 times as bright"), "640 px over 64 views: {text}");
        assert!(without_discs(discs, Some(1024)).contains("would carry them"), "more views than pixels");
    }
}
