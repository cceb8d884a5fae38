//! Keys along a sequence of frames: what a setting is at some of them, and how it gets from one to the next.

use serde::{Deserialize, Serialize};

/// Interpolation from one key to the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Easing {
    /// Constant speed.
    Linear,
    /// Slow at both ends.
    #[default]
    Smooth,
    /// Constant until the next key.
    Hold,
}

impl Easing {
    /// Every easing, by its name in presets.
    pub const ALL: [(&str, Self); 3] =
        [("linear", Self::Linear), ("smooth", Self::Smooth), ("hold", Self::Hold)];

    /// The name in presets.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Smooth => "smooth",
            Self::Hold => "hold",
        }
    }
}

/// The number that a setting has at one frame of a sequence.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct NumberKey {
    /// Number of the frame.
    pub frame: i64,
    /// The setting's value at that frame.
    pub value: f32,
    /// Interpolation from this key to the next.
    pub easing: Easing,
}

/// What keys of any setting have in common.
pub(crate) trait Keyed {
    /// Number of the key's frame.
    fn frame(&self) -> i64;
    /// Interpolation from this key to the next.
    fn easing(&self) -> Easing;
}

impl Keyed for NumberKey {
    fn frame(&self) -> i64 {
        self.frame
    }

    fn easing(&self) -> Easing {
        self.easing
    }
}
