//! DECIDE, for the lens: how often it is sampled, or what that is to reach.

use super::{Abilities, Plan};
use crate::error::Error;
use crate::settings::{Effort, Quality, Settings};

/// What the number of lens samples is to reach.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Goal {
    /// A sampling error.
    TargetDb {
        /// PSNR in dB against the stack's own truth.
        psnr_db: f64,
        /// Lens samples past which it is given up.
        most_views: usize,
    },
    /// A time.
    TimeBudget {
        /// Wall seconds of the blur.
        seconds: f64,
    },
}

/// How the lens is to be sampled.
pub(super) struct Sampling {
    /// Lens samples a pixel; none for a method that does not sample the lens.
    pub(super) views: Option<usize>,
    /// What they are to reach, where their number is not given.
    pub(super) goal: Option<Goal>,
    /// Why.
    pub(super) reason: String,
}

impl Sampling {
    /// What `settings` ask for, as far as a method with these `abilities` can follow.
    pub(super) fn decide(settings: &Settings, abilities: Abilities) -> Result<Self, Error> {
        let Abilities { method, lens_samples, seeks, .. } = abilities;
        let Some(own) = lens_samples else {
            return Ok(Self {
                views: None,
                goal: None,
                reason: format!("{method} does not sample the lens"),
            });
        };
        let its_own = || format!("{method}'s own number");
        let (effort, reason) = match settings.effort.value {
            Some(effort) => (Some(effort), format!("{effort}, asked for by {}", settings.effort.origin)),
            None if settings.method.value == "auto" => {
                (Some(Effort::Quality(Quality::Final)), "auto is of final quality".to_owned())
            }
            None => (None, its_own()),
        };
        let (goal, reason) = match effort.and_then(Goal::of) {
            Some(_) if !seeks => (None, its_own()),
            goal => (goal, reason),
        };
        let views = if let Some(Effort::Views(views)) = effort { views } else { own };
        if views == 0 || views > Plan::MAX_VIEWS {
            return Err(Error::settings(format!(
                "the number of views must be from 1 to {}",
                Plan::MAX_VIEWS
            ))
            .with("found", views.to_string())
            .help("set it with --views, or in the preset's [method]"));
        }
        Ok(Self { views: Some(views), goal, reason })
    }
}

impl Goal {
    /// The goal of `effort`; none for a number of views.
    fn of(effort: Effort) -> Option<Self> {
        match effort {
            Effort::Views(_) => None,
            Effort::TargetDb(psnr_db) => Some(Self::TargetDb { psnr_db, most_views: Plan::MAX_VIEWS }),
            Effort::TimeBudget(seconds) => Some(Self::TimeBudget { seconds }),
            Effort::Quality(quality) => {
                Some(Self::TargetDb { psnr_db: quality.target_db(), most_views: quality.most_views() })
            }
        }
    }
}
