//! How much work a picture is worth: what decides the number of lens samples.

use serde::{Deserialize, Serialize};
use std::fmt;

/// What decides the number of lens samples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Effort {
    /// That number itself, a pixel.
    Views(usize),
    /// A sampling error: PSNR in dB against the stack's own truth.
    TargetDb(f64),
    /// Wall seconds that the blur may take.
    TimeBudget(f64),
    /// A named sampling error.
    Quality(Quality),
}

impl Effort {
    /// The least and the most that a target may be, in dB: below, any picture will do; above, half floats hold no more.
    pub const TARGETS_DB: [f64; 2] = [10.0, 80.0];
}

impl fmt::Display for Effort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Views(views) => write!(f, "`views = {views}`"),
            Self::TargetDb(psnr_db) => write!(f, "`target_db = {psnr_db}`"),
            Self::TimeBudget(seconds) => write!(f, "`time_budget_s = {seconds}`"),
            Self::Quality(quality) => write!(f, "`quality = {}`", quality.name()),
        }
    }
}

/// A named sampling error, with the most lens samples that it is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Quality {
    /// To see where the blur lies.
    Draft,
    /// To judge the picture.
    Preview,
    /// To deliver: what is left shows only side by side, enlarged.
    Final,
    /// To measure by: less than eight bits can show.
    Reference,
}

impl Quality {
    /// Every quality, from rough to fine.
    pub const ALL: [Self; 4] = [Self::Draft, Self::Preview, Self::Final, Self::Reference];

    /// The name that it is asked for by.
    pub fn name(self) -> &'static str {
        match self {
            Self::Draft => "draft",
            Self::Preview => "preview",
            Self::Final => "final",
            Self::Reference => "reference",
        }
    }

    /// PSNR in dB against the stack's own truth.
    pub fn target_db(self) -> f64 {
        match self {
            Self::Draft => 35.0,
            Self::Preview => 40.0,
            Self::Final => 45.0,
            Self::Reference => 55.0,
        }
    }

    /// Lens samples past which the target is given up.
    pub fn max_views(self) -> usize {
        match self {
            Self::Draft => 64,
            Self::Preview => 128,
            Self::Final => 256,
            Self::Reference => 4096,
        }
    }
}
