//! DECIDE, for each effect: whether the scene needs it, why, and what the opposite choice would change.
//!
//! This module decides the effects of the scene and of its lens. A method decides about its own passes in its own folder. Every decision
//! is a pure function of [`Inputs`]. Numbers come from the statistics; a number that only the rendered picture has is stated as unknown.

mod extrapolation;
mod inputs;
mod lens;
mod scene;
mod words;

pub use inputs::Inputs;
pub(crate) use inputs::percent;
pub use words::{Effect, EffectKind};

/// The decisions about the scene and its lens, which hold for every method.
pub(crate) fn decide(inputs: &Inputs<'_>) -> Vec<Effect> {
    vec![
        scene::blur(inputs),
        scene::merge(inputs.stats),
        extrapolation::highlight_extrapolation(inputs),
        scene::translucency(inputs.stats),
        scene::transparent_background(inputs.stats),
        scene::reflections(inputs.stats),
        scene::environment(inputs.stats),
        lens::blade_curvature(inputs),
        lens::squeeze(inputs),
        lens::aperture_image(inputs),
        lens::cats_eye(inputs),
        lens::spherical_aberration(inputs),
        lens::axial_color(inputs),
        lens::lateral_color(inputs),
        lens::vignetting(inputs),
    ]
}
