//! The plan: what will be simulated, what will not, and why.

use crate::lens::Aperture;
use crate::settings::MethodParameters;

/// An effect that a plan switches on or off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum EffectKind {
    /// Any blur at all; off, the picture is the input.
    Blur,
    /// Exact discs for bright fragments.
    Highlights,
    /// Guessed surfaces behind the last peel.
    Fill,
    /// Fragments that let light through.
    Translucency,
    /// Smoothing over the gaps between lens samples.
    Prefilter,
    /// Anti-aliasing of point-sampled, in-focus pixels.
    Resolve,
}

/// One decision, with its reason in words and numbers.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Effect {
    /// Which effect.
    pub name: EffectKind,
    /// Whether it will be simulated.
    pub on: bool,
    /// Why.
    pub reason: String,
}

/// What a method is to do: a pure function of facts and settings, and the only thing it reads beside the scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Name of the method.
    pub method: &'static str,
    /// Why this method.
    pub method_reason: String,
    /// Lens samples a pixel.
    pub views: usize,
    /// The aperture's shape.
    pub aperture: Aperture,
    /// Every effect, on or off.
    pub effects: Vec<Effect>,
    /// The methods' own parameters.
    pub parameters: MethodParameters,
}
