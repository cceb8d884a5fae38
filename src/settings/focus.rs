//! What the lens is focused on: one thing, or one after the other along a sequence of frames.

use serde::{Deserialize, Serialize};

/// What the lens is focused on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Focus {
    /// Planar distance in the stack's depth units.
    Distance(f32),
    /// What the picture shows at this pixel of the display window (x from the left, y from the top).
    Point([f32; 2]),
    /// The object of this name, by the cryptomatte in the file.
    Object(String),
    /// What the picture shows at its centre.
    Centre,
    /// One thing after the other: at least one key, in rising order of frame.
    Keys(Vec<FocusKey>),
}

/// What the lens is focused on at one frame of a sequence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FocusKey {
    /// Number of the frame.
    pub frame: i64,
    /// What is in focus there.
    pub focus: Focus,
    /// How focus leaves it for the next key.
    pub easing: Easing,
}

/// How focus goes from one key to the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Easing {
    /// At one speed.
    Linear,
    /// Slow at both ends.
    #[default]
    Smooth,
    /// Not before the next key, and there at once.
    Hold,
}

impl Easing {
    /// Every easing, by its name in presets.
    pub const ALL: [(&str, Self); 3] =
        [("linear", Self::Linear), ("smooth", Self::Smooth), ("hold", Self::Hold)];
}

impl Focus {
    /// Whether finding it takes the objects' mattes.
    pub fn looks_for_an_object(&self) -> bool {
        match self {
            Self::Object(_) => true,
            Self::Keys(keys) => keys.iter().any(|key| key.focus.looks_for_an_object()),
            Self::Distance(_) | Self::Point(_) | Self::Centre => false,
        }
    }
}
