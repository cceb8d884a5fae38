//! DECIDE, for the lens: the aperture's shape, the lens barrel, aberrations and vignetting.

use super::inputs::Inputs;
use super::words::{Effect, EffectKind, NO_EFFECT};
use crate::lens::Optics;
use glam::Vec2;

/// Smallest visible change of the outline of blurred points, in pixels at the largest blur: less moves so few rays that pictures agree to 55
/// dB.
const MIN_OUTLINE_PX: f32 = 0.002;

/// Share of its light from which on a place shows no darkening.
const MAX_LIGHT: f32 = 0.999;

pub(super) fn blade_curvature(inputs: &Inputs<'_>) -> Effect {
    let aperture = inputs.optics.aperture;
    let (curved, straight) = (aperture, aperture.simplified(false, true));
    let bulge_px = (curved.apothem() - straight.apothem()) * inputs.max_blur_px();
    let (on, reason) = if curved == straight {
        (false, "the aperture is a disc or has straight sides".to_owned())
    } else {
        (bulge_px > MIN_OUTLINE_PX, format!("at the largest blur the sides bulge by {bulge_px:.2} px"))
    };
    let larger = 100.0 * (curved.area() / straight.area() - 1.0);
    let change = match (curved == straight, on) {
        (true, _) => NO_EFFECT.to_owned(),
        (false, true) => format!("without it, every blurred point would lose {larger:.1} % of its area"),
        (false, false) => format!("with it, every blurred point would be {larger:.1} % larger"),
    };
    Effect::new(EffectKind::BladeCurvature, on, reason, change)
}

pub(super) fn squeeze(inputs: &Inputs<'_>) -> Effect {
    let ratio = inputs.optics.aperture.squeeze();
    let larger = ratio.max(ratio.recip());
    let (shape, side) = if ratio < 1.0 { ("lower", "high") } else { ("narrower", "wide") };
    let less_px = (1.0 - 1.0 / larger) * inputs.max_blur_px();
    let on = less_px > MIN_OUTLINE_PX;
    let (reason, change) = if ratio == 1.0 {
        ("the aperture is as wide as high".to_owned(), NO_EFFECT.to_owned())
    } else {
        let reason = format!("at the largest blur the aperture is {less_px:.2} px {shape} on either side");
        let without = if on { "without it" } else { "with it off" };
        (reason, format!("{without}, every blurred point is {larger} times too {side}"))
    };
    Effect::new(EffectKind::Squeeze, on, reason, change)
}

pub(super) fn aperture_image(inputs: &Inputs<'_>) -> Effect {
    let Some(image) = &inputs.optics.image else {
        return Effect::new(EffectKind::ApertureImage, false, "there is no aperture image", NO_EFFECT);
    };
    let light = 100.0 * image.mean();
    let reason = format!("the aperture image transmits {light:.0} % of the light of a full disc");
    let change = "without it, every blurred point would have the outline of the blades, or of a disc";
    Effect::new(EffectKind::ApertureImage, inputs.max_blur_px() > MIN_OUTLINE_PX, reason, change)
}

pub(super) fn cats_eye(inputs: &Inputs<'_>) -> Effect {
    let barrel = inputs.optics.cats_eye;
    if barrel == 0.0 {
        let reason = "the lens barrel hides no part of the aperture: `cats_eye` is 0";
        return Effect::new(EffectKind::CatsEye, false, reason, NO_EFFECT);
    }
    let cut_px = barrel * inputs.max_blur_px();
    let open = 100.0 * inputs.optics.barrel_share(Vec2::X);
    let reason = format!(
        "the lens barrel leaves {open:.0} % of the aperture open in the corners, and cuts up to {cut_px:.2} px off \
         blurred points"
    );
    let change = "without it, blurred points would be as round in the corners as in the centre";
    Effect::new(EffectKind::CatsEye, cut_px > MIN_OUTLINE_PX, reason, change)
}

/// The longest shift of a ray by spherical aberration alone.
fn spherical_shift_px(optics: &Optics) -> f32 {
    Optics { axial_px: [0.0; 3], ..optics.clone() }.longest_shift_px()
}

pub(super) fn spherical_aberration(inputs: &Inputs<'_>) -> Effect {
    let kind = EffectKind::SphericalAberration;
    let size = inputs.optics.spherical_px;
    if size == 0.0 {
        return Effect::new(kind, false, "the whole aperture focuses at one distance", NO_EFFECT);
    }
    let shift = spherical_shift_px(inputs.optics);
    let [soft, hard] = if size > 0.0 { ["behind", "in front of"] } else { ["in front of", "behind"] };
    let reason = format!("rays are shifted by up to {shift:.2} px: soft discs {soft} focus, rings {hard} it");
    let change = format!(
        "without it, discs would be even, and surfaces in focus sharper by {:.2} px",
        size.abs() / 6.0
    );
    Effect::new(kind, shift > MIN_OUTLINE_PX, reason, change)
}

pub(super) fn axial_color(inputs: &Inputs<'_>) -> Effect {
    let kind = EffectKind::AxialColor;
    if !inputs.optics.has_axial_color() {
        return Effect::new(kind, false, "all colours focus at one distance", NO_EFFECT);
    }
    let [red, _, blue] = inputs.optics.axial_px;
    let reason = format!(
        "where green is in focus, the CoC radius of red is {red:.2} px and that of blue {blue:.2} px"
    );
    let change = "without it, no colour fringes, and one set of lens samples instead of three";
    Effect::new(kind, red.abs().max(blue.abs()) > MIN_OUTLINE_PX, reason, change)
}

pub(super) fn lateral_color(inputs: &Inputs<'_>) -> Effect {
    let [red, _, blue] = inputs.optics.lateral_px;
    if red == 0.0 && blue == 0.0 {
        return Effect::new(EffectKind::LateralColor, false, "all colours have one magnification", NO_EFFECT);
    }
    let reason = format!("in the corners red lies {red:.2} px and blue {blue:.2} px farther out than green");
    let change = "without it, no colour fringes towards the corners";
    // On for any strength: beside a bright light even a small shift is visible.
    Effect::new(EffectKind::LateralColor, true, reason, change)
}

pub(super) fn vignetting(inputs: &Inputs<'_>) -> Effect {
    let (optics, field) = (inputs.optics, inputs.stats.field);
    if optics.vignetting == 0.0 {
        let full = Optics { vignetting: 1.0, ..optics.clone() };
        let kept = 100.0 * full.brightness(&field, field.corner_place());
        let change = format!("with it at full strength, the corners would keep {kept:.0} % of their light");
        let reason = "the picture is evenly bright, as by a corrected lens: `vignetting` is 0";
        return Effect::new(EffectKind::Vignetting, false, reason, change);
    }
    let kept = optics.brightness(&field, field.corner_place());
    let reason = format!("the corners keep {:.1} % of their light", 100.0 * kept);
    let change = "without it, they would be as bright as the centre";
    Effect::new(EffectKind::Vignetting, kept < MAX_LIGHT, reason, change)
}
