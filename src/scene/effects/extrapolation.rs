//! The decision about highlights of a source that ends at white.

use super::inputs::{Inputs, percent};
use super::words::{Effect, EffectKind, NO_EFFECT};
use crate::scene::extrapolation::Extrapolation;
use crate::stack::ColorRange;

pub(super) fn highlight_extrapolation(inputs: &Inputs<'_>) -> Effect {
    let Inputs { stats, extrapolation, .. } = inputs;
    let Extrapolation { threshold, gain, .. } = extrapolation;
    let new = |on, reason: String, change: String| {
        Effect::new(EffectKind::HighlightExtrapolation, on, reason, change)
    };
    if stats.color_range == ColorRange::Unbounded {
        let change = format!(
            "with it, blurred fragments with a displayed luminance above {threshold} would be up to {gain} times as bright"
        );
        return new(false, "the source is scene-linear: nothing was clipped".to_owned(), change);
    }
    let gained = extrapolation.gained(&stats.light);
    if gained.added <= 0.0 {
        let reason = match gained.fragments {
            0 => format!("no blurred fragment has a displayed luminance above {threshold}"),
            _ => format!("the gain is {gain}, which adds no light"),
        };
        return new(false, reason, NO_EFFECT.to_owned());
    }
    let share = percent(gained.fragments, stats.fragments);
    let more = 100.0 * gained.added / gained.light;
    let reason = format!(
        "the source ends at white, and {} blurred fragments ({share:.1} %) have a displayed luminance above {threshold}: they gain \
         {more:.0} % of light",
        gained.fragments
    );
    let less = 100.0 * gained.added / (gained.light + gained.added);
    let change = format!(
        "without it, they would have {less:.0} % less light, and clipped lights would become grey discs"
    );
    new(true, reason, change)
}
