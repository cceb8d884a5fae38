//! SEQUENCE: many frames, each of them a job.
//!
//! [`FrameSet`] is a list of frame numbers, [`Pattern`] the name of a file in which the number varies, [`Shot`] the files of every frame.
//! [`decide`] takes once for the shot the decisions that could change from frame to frame, and [`run`] renders the frames, several at once
//! within a limit of memory. This module prints nothing; [`Work`] is what the caller does with a frame and its end.

mod run;
mod steady;

pub use run::{Limits, Readiness, Work, run};
pub use steady::{Steady, check_focus, decide, load as load_decisions, save as save_decisions};
