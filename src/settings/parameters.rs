//! The methods' own parameters: the `[method.NAME]` tables of a preset, with their defaults.

use serde::{Deserialize, Serialize};

/// Parameters of every method, each in its own table.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MethodParameters {
    /// `[method.shear]`.
    pub shear: ShearParameters,
    /// `[method.accumulate]`.
    pub accumulate: AccumulateParameters,
}

/// Parameters of `shear`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ShearParameters {
    /// Lens samples a pixel when `--views` does not say.
    pub views: usize,
    /// Radius of the prefilter as a share of the gap between lens samples; 0 switches it off.
    pub prefilter: f32,
    /// Weight of the resolve filter's four neighbours on point-sampled, in-focus pixels; 0 switches it off.
    pub resolve: f32,
    /// Brightness above which a fragment is drawn as an exact disc; 0 switches highlights off.
    pub highlight_threshold: f32,
    /// Whether surfaces that the stack lacks may be guessed.
    pub fill: bool,
}

impl Default for ShearParameters {
    fn default() -> Self {
        Self { views: 64, prefilter: 1.4, resolve: 0.08, highlight_threshold: 1.0, fill: true }
    }
}

/// Parameters of `accumulate`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AccumulateParameters {
    /// Lens rays a pixel when `--views` does not say.
    pub rays: usize,
}

impl Default for AccumulateParameters {
    fn default() -> Self {
        Self { rays: 1024 }
    }
}
