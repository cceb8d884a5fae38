//! The sample budget: what decides the number of lens samples.

use serde::{Deserialize, Serialize};
use std::fmt;

/// What decides the number of lens samples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Effort {
    /// The number itself, per pixel.
    Views(usize),
    /// A target for the sampling error: PSNR in dB against the stack's own truth.
    TargetDb(f64),
    /// A limit for the wall seconds of the blur.
    TimeBudget(f64),
    /// A named target for the sampling error.
    Quality(Quality),
}

impl Effort {
    /// Smallest and largest target in dB: any picture reaches less, and half floats cannot represent more.
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

/// A named target for the sampling error, with a largest number of lens samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Quality {
    /// Shows where the blur lies.
    Draft,
    /// For an assessment of the picture.
    Preview,
    /// For delivery: the error is visible only side by side and enlarged.
    Final,
    /// For measurements: the error is below what eight bits show.
    Reference,
}

impl Quality {
    /// Every quality, from rough to fine.
    pub const ALL: [Self; 4] = [Self::Draft, Self::Preview, Self::Final, Self::Reference];

    /// Its name in presets and flags.
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

    /// Number of lens samples at which the search for the target ends.
    pub fn max_views(self) -> usize {
        match self {
            Self::Draft => 64,
            Self::Preview => 128,
            Self::Final => 256,
            Self::Reference => 4096,
        }
    }
}
