//! DECIDE, effect by effect: whether a scene calls for it, why, and what the other choice would change.
//!
//! Every decision is a pure function of [`Given`]. Numbers come from the facts; what only painting can tell is said to be unknown.

mod highlights;
mod lens;

pub(super) use highlights::highlight_threshold;

use super::plan::{Effect, EffectKind};
use super::{Abilities, Extrapolation, Facts};
use crate::lens::Optics;
use crate::settings::{MethodParameters, ShearParameters};
use crate::stack::StackKind;
use std::f32::consts::PI;

/// No fragment reaches beyond its own pixel below this CoC radius.
const BLUR_FROM_PX: f32 = 0.5;

/// Stacks of this many layers rarely lack a surface that a lens ray could meet.
const COMPLETE_LAYERS: usize = 3;

/// A smoothing of less variance than this, in squared pixels, is not worth the work.
pub const PREFILTER_LEAST_VARIANCE: f32 = 0.03;

/// From this CoC radius on a fragment is out of focus for every method: that is 1 px, and the bin that it may be rounded into.
const OUT_OF_FOCUS_FROM_PX: f32 = 1.5;

/// What the effects are decided from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Given<'a> {
    /// What the scene shows.
    pub(super) facts: &'a Facts,
    /// The methods' own parameters.
    pub(super) parameters: &'a MethodParameters,
    /// Lens samples a pixel, where their number is settled.
    pub(super) views: Option<usize>,
    /// See [`super::Plan::jitter`].
    pub(super) jitter: f32,
    /// The lens with all that was asked for.
    pub(super) optics: &'a Optics,
    /// How highlights are extrapolated.
    pub(super) extrapolation: Extrapolation,
}

impl EffectKind {
    /// Every effect, in the order of plans.
    pub const ALL: [Self; 17] = [
        Self::Blur,
        Self::Merge,
        Self::HighlightExtrapolation,
        Self::Highlights,
        Self::Fill,
        Self::Translucency,
        Self::OpenBackground,
        Self::Prefilter,
        Self::Resolve,
        Self::BladeCurvature,
        Self::Squeeze,
        Self::ApertureImage,
        Self::CatsEye,
        Self::SphericalAberration,
        Self::AxialColor,
        Self::LateralColor,
        Self::Vignetting,
    ];

    /// Its name in reports and flags.
    pub fn name(self) -> &'static str {
        match self {
            Self::Blur => "blur",
            Self::Merge => "merge",
            Self::HighlightExtrapolation => "highlight-extrapolation",
            Self::Highlights => "highlights",
            Self::Fill => "fill",
            Self::Translucency => "translucency",
            Self::OpenBackground => "open-background",
            Self::Prefilter => "prefilter",
            Self::Resolve => "resolve",
            Self::BladeCurvature => "blade-curvature",
            Self::Squeeze => "squeeze",
            Self::ApertureImage => "aperture-image",
            Self::CatsEye => "cats-eye",
            Self::SphericalAberration => "spherical-aberration",
            Self::AxialColor => "axial-color",
            Self::LateralColor => "lateral-color",
            Self::Vignetting => "vignetting",
        }
    }

    /// Whether it is a step that some methods have and others lack.
    pub(super) fn is_step(self) -> bool {
        match self {
            Self::Blur
            | Self::HighlightExtrapolation
            | Self::Translucency
            | Self::OpenBackground
            | Self::LateralColor
            | Self::Vignetting => false,
            Self::Merge
            | Self::Highlights
            | Self::Fill
            | Self::Prefilter
            | Self::Resolve
            | Self::BladeCurvature
            | Self::Squeeze
            | Self::ApertureImage
            | Self::CatsEye
            | Self::SphericalAberration
            | Self::AxialColor => true,
        }
    }

    /// Whether it is nothing where nothing is blurred.
    pub(super) fn goes_with_blur(self) -> bool {
        self.is_step() || self == Self::HighlightExtrapolation
    }
}

/// The threshold of exact discs, and every effect for a method with these `abilities`.
pub(super) fn decide(given: &Given<'_>, abilities: &Abilities) -> (f32, Vec<Effect>) {
    let (threshold, highlights) = highlights::highlights(given);
    let effects = [
        blur(given, abilities),
        merge(given.facts),
        highlights::highlight_extrapolation(given),
        highlights,
        fill(given),
        translucency(given.facts),
        open_background(given.facts),
        prefilter(given),
        resolve(given),
        lens::blade_curvature(given),
        lens::squeeze(given),
        lens::aperture_image(given),
        lens::cats_eye(given),
        lens::spherical_aberration(given),
        lens::axial_color(given),
        lens::lateral_color(given),
        lens::vignetting(given),
    ];
    let of_method = |effect: Effect| {
        if !effect.name.is_step() || abilities.effects.contains(&effect.name) {
            return effect;
        }
        let method = abilities.method;
        let change = format!("{method} cannot do it: see `thinlens methods` for those that can");
        new(effect.name, false, format!("{method} has no such step"), change)
    };
    (threshold, effects.into_iter().map(of_method).collect())
}

/// A decision of the plan's own.
fn new(name: EffectKind, on: bool, reason: impl Into<String>, change: impl Into<String>) -> Effect {
    Effect { name, on, reason: reason.into(), change: change.into(), forced: false }
}

/// The larger of the two ends of the CoC range.
fn largest_coc_px(facts: &Facts) -> f32 {
    facts.coc_range_px[1].abs().max(facts.coc_range_px[0].abs())
}

/// `part` of `whole` in percent; 0 of nothing.
fn percent(part: usize, whole: usize) -> f64 {
    100.0 * part as f64 / whole.max(1) as f64
}

fn blur(given: &Given<'_>, abilities: &Abilities) -> Effect {
    let facts = given.facts;
    let shift = lens::longest_shift_px(given, abilities);
    let largest = largest_coc_px(facts) + shift;
    let [near, far] = facts.coc_range_px;
    if largest <= BLUR_FROM_PX {
        let reason =
            format!("the largest CoC radius is {largest:.2} px: nothing reaches beyond its own pixel");
        let share = 100.0 * share_astray(largest, given.jitter);
        let change = format!("with it, at most {share:.1} % of a pixel's lens rays would end in a neighbour");
        return new(EffectKind::Blur, false, reason, change);
    }
    let counts = facts.spread.steps.map(|step| step.front.iter().chain(&step.behind).sum::<usize>());
    let all: usize = counts.iter().sum();
    let share = percent(all - counts[0], all);
    let change = format!(
        "without it, about {share:.1} % of the fragments would be sharp and not up to {:.1} px wide",
        2.0 * largest
    );
    let astray = if shift > 0.0 { format!(", aberrations of up to {shift:.2} px") } else { String::new() };
    let reason = format!("CoC radii from {near:.1} (near) to {far:.1} px (far){astray}");
    new(EffectKind::Blur, true, reason, change)
}

/// The share of a pixel's lens rays that end outside of its square, where it and all around it have CoC radius `coc_px` and rays
/// start within `jitter` of the pixel's width: the mean over a disc, which no aperture outreaches.
fn share_astray(coc_px: f32, jitter: f32) -> f32 {
    /// Steps of the mean along radius and angle.
    const STEPS: usize = 64;
    // Rays that start evenly within the jitter and move by `offset` leave by this share.
    let leaves = |offset: f32| ((0.5 * jitter + offset.abs() - 0.5) / jitter).clamp(0.0, 1.0);
    let ring = |i: usize| {
        let radius = coc_px * ((i as f32 + 0.5) / STEPS as f32).sqrt();
        let at = |k: usize| (k as f32 + 0.5) / STEPS as f32 * 0.5 * PI;
        let stays = |angle: f32| (1.0 - leaves(radius * angle.cos())) * (1.0 - leaves(radius * angle.sin()));
        (0..STEPS).map(|k| 1.0 - stays(at(k))).sum::<f32>() / STEPS as f32
    };
    (0..STEPS).map(ring).sum::<f32>() / STEPS as f32
}

fn merge(facts: &Facts) -> Effect {
    match facts.supersample {
        1 => new(EffectKind::Merge, false, "one sample a pixel", "nothing could be merged"),
        s => new(
            EffectKind::Merge,
            true,
            format!("{s} × {s} samples a pixel become coverage peels"),
            "it cannot be left out: samples are no picture pixels",
        ),
    }
}

fn fill(given: &Given<'_>) -> Effect {
    let layers = given.facts.layers;
    let (on, reason) = if !given.parameters.shear.fill {
        (false, "switched off".to_owned())
    } else if layers >= COMPLETE_LAYERS {
        (false, format!("{layers} layers know what lies behind"))
    } else if given.facts.coc_range_px[0] > -BLUR_FROM_PX {
        (true, format!("{layers} layer(s): what far edges uncover is guessed from their surroundings"))
    } else {
        (true, format!("{layers} layer(s): what the near blur uncovers is guessed from its surroundings"))
    };
    let which = "rays that pass all layers; how many is not known before painting";
    let change = if on {
        format!("without it, nothing is found by {which}")
    } else {
        format!("with it, a guess is found by {which}")
    };
    new(EffectKind::Fill, on, reason, change)
}

fn translucency(facts: &Facts) -> Effect {
    let count = facts.translucent_fragments;
    let reason = format!("{count} fragments let light through");
    let share = percent(count, facts.fragments);
    let change = match count {
        0 => "it cannot be put in: every alpha is 1".to_owned(),
        _ => format!("it cannot be left out: {share:.1} % of the fragments have an alpha below 1"),
    };
    new(EffectKind::Translucency, count > 0, reason, change)
}

fn open_background(facts: &Facts) -> Effect {
    let count = facts.open_samples;
    if count == 0 {
        return new(
            EffectKind::OpenBackground,
            false,
            "something is behind every pixel: lens rays that find nothing are left out of the mean",
            "with it, such rays would make the picture transparent; how many is not known before painting",
        );
    }
    let share = percent(count, facts.picture_size.0 * facts.picture_size.1 * facts.supersample.pow(2));
    new(
        EffectKind::OpenBackground,
        true,
        format!("{count} pixels show nothing at all: the picture keeps its transparency"),
        format!("without it, blurred edges before the {share:.1} % that show nothing would turn opaque"),
    )
}

/// How far apart the lens samples move what is blurred most, in pixels.
fn gap_px(facts: &Facts, views: usize) -> f32 {
    largest_coc_px(facts) * (PI / views as f32).sqrt()
}

fn prefilter(given: &Given<'_>) -> Effect {
    let strength = given.parameters.shear.prefilter;
    let Some(views) = given.views else {
        let change = "without it, what is blurred would be as many copies as there are views";
        return new(EffectKind::Prefilter, strength > 0.0, prefilter_reason(strength), change);
    };
    let gap = gap_px(given.facts, views);
    // A hair's breadth, so that no rounding makes a smoothing of what is thought to have none.
    let idle = (0.5 * strength * gap).powi(2) / 3.0 < 0.999 * PREFILTER_LEAST_VARIANCE;
    if strength > 0.0 && !idle {
        let change = format!("without it, what is blurred most would be {views} copies {gap:.2} px apart");
        return new(EffectKind::Prefilter, true, prefilter_reason(strength), change);
    }
    if strength <= 0.0 {
        let change = format!("with it, the gaps of up to {gap:.2} px between copies would be closed");
        return new(EffectKind::Prefilter, false, "switched off: prefilter is 0", change);
    }
    let reason = format!("{views} lens samples lie at most {gap:.2} px apart: there are no gaps to close");
    new(EffectKind::Prefilter, false, reason, "with it, nothing: no smoothing is as narrow")
}

fn prefilter_reason(strength: f32) -> String {
    format!("{strength} × half the gap between lens samples")
}

fn resolve(given: &Given<'_>) -> Effect {
    let facts = given.facts;
    let weight = given.parameters.shear.resolve;
    let [near, far] = facts.coc_range_px;
    if near >= OUT_OF_FOCUS_FROM_PX || far <= -OUT_OF_FOCUS_FROM_PX {
        let least = near.abs().min(far.abs());
        let reason = format!("nothing is in focus: the smallest CoC radius is {least:.1} px");
        return new(EffectKind::Resolve, false, reason, "with it, nothing");
    }
    let used = if weight > 0.0 { weight } else { ShearParameters::default().resolve };
    let by = format!("by up to {:.0} % of their difference from their neighbours", 400.0 * used);
    let share = percent(facts.focused_fragments, facts.fragments);
    let with = format!("with it, {share:.1} % of the fragments would be softened {by}");
    let off = |reason| new(EffectKind::Resolve, false, reason, with);
    if weight <= 0.0 {
        off("switched off: resolve is 0")
    } else if facts.kind != StackKind::PointSampled {
        off("the input is anti-aliased already")
    } else {
        let reason = format!("one sample a pixel, {} fragments in focus", facts.focused_fragments);
        let change = format!("without it, {share:.1} % of the fragments would not be softened {by}");
        new(EffectKind::Resolve, true, reason, change)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_go_astray_by_the_share_that_the_disc_reaches_over_the_side() {
        assert_eq!(share_astray(0.0, 1.0), 0.0, "a pinhole");
        assert_eq!(share_astray(0.25, 0.5), 0.0, "rays within half the pixel, moved by a quarter");
        // Small discs leave by either side alone: 2 · E|c·u_x| = 2 c · 4 / (3π).
        let c = 0.01;
        let expected = 2.0 * c * 4.0 / (3.0 * PI);
        assert!((share_astray(c, 1.0) / expected - 1.0).abs() < 0.01, "{}", share_astray(c, 1.0));
        assert!(share_astray(0.5, 1.0) < 0.45, "at half a pixel less than half");
    }
}
