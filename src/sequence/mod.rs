//! SEQUENCE: many frames, each of them a job.
//!
//! [`FrameSet`] is which frames are wanted, [`Pattern`] the name of a file in which the frame number varies, [`Shot`] the files of every frame.
//! [`decide`] takes once for the shot the decisions that could change from frame to frame, and [`run()`] renders the frames, several at once
//! within a limit of memory. This module prints nothing; [`Work`] is what the caller does with a frame and its end.

mod frame_set;
mod pattern;
mod pending;
mod run;
mod series;
mod shot;
mod steady;

pub use frame_set::{FrameSet, MOST_FRAMES};
pub use pattern::Pattern;
pub use pending::is_finished;
pub use run::{Limits, Readiness, Work, run};
pub use shot::{Shot, ShotFrame};
pub use steady::{LookedAt, Steady, check_focus, decide, load as load_decisions, save as save_decisions};
