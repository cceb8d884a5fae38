//! What the lens is focused on: one target, or keys of a focus pull along a sequence of frames.

use super::keys::{Easing, Keyed};
use serde::{Deserialize, Serialize};

/// What the lens is focused on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Focus {
    /// Planar distance in the stack's depth units.
    Distance(f32),
    /// The visible surface at this pixel of the display window (x from the left, y from the top).
    Point([f32; 2]),
    /// The object of this name in the file's cryptomatte.
    Object(String),
    /// The visible surface at the picture's centre.
    Centre,
    /// A focus pull: at least one key, in rising order of frame.
    Keys(Vec<FocusKey>),
}

/// What the lens is focused on at one frame of a sequence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FocusKey {
    /// Number of the frame.
    pub frame: i64,
    /// What is in focus at that frame.
    pub focus: Focus,
    /// Interpolation from this key to the next.
    pub easing: Easing,
}

impl Keyed for FocusKey {
    fn frame(&self) -> i64 {
        self.frame
    }

    fn easing(&self) -> Easing {
        self.easing
    }
}

impl Focus {
    /// Whether finding its distance needs the objects' mattes.
    pub fn needs_mattes(&self) -> bool {
        match self {
            Self::Object(_) => true,
            Self::Keys(keys) => keys.iter().any(|key| key.focus.needs_mattes()),
            Self::Distance(_) | Self::Point(_) | Self::Centre => false,
        }
    }
}
