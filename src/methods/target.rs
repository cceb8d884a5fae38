//! What the number of lens samples has to reach, where the number is not fixed.

use crate::settings::Effort;
use serde::Serialize;

/// Maximum number of lens samples per pixel: the error of this many is below the precision of a half float.
pub(super) const MAX_VIEWS: usize = 1 << 16;

/// What the number of lens samples has to reach.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Target {
    /// A sampling error.
    #[serde(rename = "target_db")]
    Error {
        /// PSNR in dB against the converged picture of the same stack.
        psnr_db: f64,
        /// Number of lens samples at which the search ends.
        #[serde(rename = "most_views")]
        max_views: usize,
    },
    /// A time budget.
    #[serde(rename = "time_budget")]
    Time {
        /// Wall seconds of the blur.
        seconds: f64,
    },
}

impl Target {
    /// The target of `effort`; `None` for a fixed number of views.
    pub(super) fn from_effort(effort: Effort) -> Option<Self> {
        match effort {
            Effort::Views(_) => None,
            Effort::TargetDb(psnr_db) => Some(Self::Error { psnr_db, max_views: MAX_VIEWS }),
            Effort::TimeBudget(seconds) => Some(Self::Time { seconds }),
            Effort::Quality(quality) => {
                Some(Self::Error { psnr_db: quality.target_db(), max_views: quality.max_views() })
            }
        }
    }
}
