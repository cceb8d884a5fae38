//! DECIDE, effect by effect: whether a scene calls for it, why, and what the other choice would change.
//!
//! Every decision is a pure function of [`Given`]. Numbers come from the facts; what only painting can tell is said to be unknown.

use super::facts::{BrightStep, bright_step_floor};
use super::plan::{Effect, EffectKind};
use super::{Abilities, Extrapolation, Facts};
use crate::lens::Optics;
use crate::settings::{MethodParameters, ShearParameters};
use crate::stack::{ColorRange, StackKind};
use glam::Vec2;
use std::f32::consts::PI;

/// No fragment reaches beyond its own pixel below this CoC radius.
const BLUR_FROM_PX: f32 = 0.5;

/// Exact discs may cover this many times the picture's area: past it they would cost more than the views themselves.
const HIGHLIGHT_COVER: f64 = 8.0;

/// Exact discs may be this many for each pixel of the picture.
const HIGHLIGHT_SHARE: f64 = 0.05;

/// Stacks of this many layers rarely lack a surface that a lens ray could meet.
const COMPLETE_LAYERS: usize = 3;

/// A smoothing of less variance than this, in squared pixels, is not worth the work.
pub const PREFILTER_LEAST_VARIANCE: f32 = 0.03;

/// From this CoC radius on a fragment is out of focus for every method: that is 1 px, and the bin that it may be rounded into.
const OUT_OF_FOCUS_FROM_PX: f32 = 1.5;

/// A change of the aperture's outline by less than this shows nowhere: in pixels, at the largest CoC radius.
const LEAST_OUTLINE_PX: f32 = 0.01;

/// A place that keeps more of its light than this is as bright as ever.
const MOST_LIGHT: f32 = 0.999;

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
    let (threshold, highlights) = highlights(given);
    let effects = [
        blur(given, abilities),
        merge(given.facts),
        highlight_extrapolation(given),
        highlights,
        fill(given),
        translucency(given.facts),
        open_background(given.facts),
        prefilter(given),
        resolve(given),
        blade_curvature(given),
        squeeze(given),
        aperture_image(given),
        cats_eye(given),
        spherical_aberration(given),
        axial_color(given),
        lateral_color(given),
        vignetting(given),
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

fn blade_curvature(given: &Given<'_>) -> Effect {
    let aperture = given.optics.aperture;
    let (curved, straight) = (aperture, aperture.simplified(false, true));
    let bulge_px = (curved.apothem() - straight.apothem()) * largest_coc_px(given.facts);
    let (on, reason) = if curved == straight {
        (false, "the aperture is a disc or has straight sides".to_owned())
    } else {
        (
            bulge_px > LEAST_OUTLINE_PX,
            format!("at the largest CoC radius the sides bulge by {bulge_px:.2} px"),
        )
    };
    let larger = 100.0 * (curved.area() / straight.area() - 1.0);
    let change = match (curved == straight, on) {
        (true, _) => "with it, nothing".to_owned(),
        (false, true) => format!("without it, every blurred point would have lost {larger:.1} % of its area"),
        (false, false) => format!("with it, every blurred point would be {larger:.1} % larger"),
    };
    new(EffectKind::BladeCurvature, on, reason, change)
}

fn squeeze(given: &Given<'_>) -> Effect {
    let ratio = given.optics.aperture.squeeze();
    let narrower_px = (1.0 - 1.0 / ratio) * largest_coc_px(given.facts);
    let on = narrower_px > LEAST_OUTLINE_PX;
    let (reason, change) = if ratio == 1.0 {
        ("the aperture is as wide as high".to_owned(), "with it, nothing".to_owned())
    } else {
        let reason =
            format!("at the largest CoC radius the aperture is {narrower_px:.2} px narrower on either side");
        let without = if on { "without it" } else { "as it is" };
        (reason, format!("{without}, every blurred point is {ratio} times too wide"))
    };
    new(EffectKind::Squeeze, on, reason, change)
}

fn aperture_image(given: &Given<'_>) -> Effect {
    let Some(image) = &given.optics.image else {
        return new(
            EffectKind::ApertureImage,
            false,
            "no picture of the aperture is given",
            "with it, nothing",
        );
    };
    let light = 100.0 * image.mean();
    let reason = format!("its picture lets {light:.0} % of the light of a full disc through");
    let change = "without it, every blurred point would have the outline of the blades, or of a disc";
    new(EffectKind::ApertureImage, largest_coc_px(given.facts) > LEAST_OUTLINE_PX, reason, change)
}

fn cats_eye(given: &Given<'_>) -> Effect {
    let rim = given.optics.cats_eye;
    if rim == 0.0 {
        return new(
            EffectKind::CatsEye,
            false,
            "the rim cuts nothing off: cats_eye is 0",
            "with it, nothing",
        );
    }
    let cut_px = rim * largest_coc_px(given.facts);
    let left = 100.0 * given.optics.rim_share(Vec2::X);
    let reason = format!(
        "the rim leaves {left:.0} % of the aperture in the corners, and cuts off up to {cut_px:.2} px"
    );
    let change = "without it, blurred points would be as round in the corners as in the middle";
    new(EffectKind::CatsEye, cut_px > LEAST_OUTLINE_PX, reason, change)
}

/// How far a lens with spherical aberration alone moves a ray.
fn spherical_shift_px(optics: &Optics) -> f32 {
    Optics { axial_px: [0.0; 3], ..optics.clone() }.longest_shift_px()
}

fn spherical_aberration(given: &Given<'_>) -> Effect {
    let kind = EffectKind::SphericalAberration;
    let size = given.optics.spherical_px;
    if size == 0.0 {
        return new(kind, false, "the whole aperture focuses in one place", "with it, nothing");
    }
    let shift = spherical_shift_px(given.optics);
    let [soft, hard] = if size > 0.0 { ["behind", "in front of"] } else { ["in front of", "behind"] };
    let reason = format!("rays land up to {shift:.2} px astray: soft discs {soft} focus, rings {hard} it");
    let change = format!(
        "without it, discs would be even, and what is in focus sharper by {:.2} px",
        size.abs() / 6.0
    );
    new(kind, shift > LEAST_OUTLINE_PX, reason, change)
}

fn axial_color(given: &Given<'_>) -> Effect {
    let kind = EffectKind::AxialColor;
    if !given.optics.has_axial_color() {
        return new(kind, false, "all colours focus in one place", "with it, nothing");
    }
    let [red, _, blue] = given.optics.axial_px;
    let reason = format!(
        "where green is in focus, the CoC radius of red is {red:.2} px and that of blue {blue:.2} px"
    );
    let change = "without it, no colour fringes, and one set of lens samples in place of three";
    new(kind, red.abs().max(blue.abs()) > LEAST_OUTLINE_PX, reason, change)
}

fn lateral_color(given: &Given<'_>) -> Effect {
    let [red, _, blue] = given.optics.lateral_px;
    if red == 0.0 && blue == 0.0 {
        return new(EffectKind::LateralColor, false, "all colours are one size", "with it, nothing");
    }
    let reason = format!("in the corners red lies {red:.2} px and blue {blue:.2} px farther out than green");
    let change = "without it, no colour fringes towards the corners";
    // However small, it shows beside a light.
    new(EffectKind::LateralColor, true, reason, change)
}

fn vignetting(given: &Given<'_>) -> Effect {
    let (optics, field) = (given.optics, given.facts.field);
    if optics.vignetting == 0.0 {
        let full = Optics { vignetting: 1.0, ..optics.clone() };
        let left = 100.0 * full.brightness(&field, field.far_out());
        let change = format!("at its full strength, the corners would keep {left:.0} % of their light");
        return new(
            EffectKind::Vignetting,
            false,
            "brightness is that of a corrected lens: vignetting is 0",
            change,
        );
    }
    let left = optics.brightness(&field, field.far_out());
    let reason = format!("the corners keep {:.1} % of their light", 100.0 * left);
    let change = "without it, they would be as bright as the middle";
    new(EffectKind::Vignetting, left < MOST_LIGHT, reason, change)
}

/// How far the aberrations that a method with these `abilities` follows move a ray.
fn longest_shift_px(given: &Given<'_>, abilities: &Abilities) -> f32 {
    let able = |kind| abilities.effects.contains(&kind);
    let spherical_px = if able(EffectKind::SphericalAberration) { given.optics.spherical_px } else { 0.0 };
    let axial_px = if able(EffectKind::AxialColor) { given.optics.axial_px } else { [0.0; 3] };
    Optics { spherical_px, axial_px, ..given.optics.clone() }.longest_shift_px()
}

fn blur(given: &Given<'_>, abilities: &Abilities) -> Effect {
    let facts = given.facts;
    let shift = longest_shift_px(given, abilities);
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

fn highlight_extrapolation(given: &Given<'_>) -> Effect {
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
fn highlights(given: &Given<'_>) -> (f32, Effect) {
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
pub(super) fn highlight_threshold(parameters: &MethodParameters) -> f32 {
    let own = parameters.shear.highlight_threshold;
    if own > 0.0 { own } else { ShearParameters::default().highlight_threshold }
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

    #[test]
    fn lights_without_discs_are_dots_as_much_brighter_as_the_disc_is_larger_than_their_number() {
        let discs = BrightStep { fragments: 2, disc_area_px: 1280.0 };
        let text = without_discs(discs, Some(64));
        assert!(text.contains("64 dots 10.0 times as bright"), "640 px over 64 views: {text}");
        assert!(without_discs(discs, Some(1024)).contains("would carry them"), "more views than pixels");
    }
}
