//! `thinlens plan` of a sequence: what the shot decides, and how long it will take.

use super::args::FramesArgs;
use super::frames::job_at;
use super::tally::in_words;
use crate::cli::console::{Console, print, print_json};
use crate::cli::failure::Failure;
use serde_json::json;
use thinlens::cost::{Calibration, predict};
use thinlens::render::Job;
use thinlens::sequence::{self, FrameSet, LookedAt, Shot, Steady};

/// Decides for `shot`, whose frames all have `job` but for what their names say; prints it, and writes the decisions where `frames` say.
///
/// # Errors
/// Those of [`sequence::decide`] and of the file.
pub(in crate::cli) fn run(
    shot: &Shot,
    job: &Job,
    frames: &FramesArgs,
    (console, calibration, json): (Console, &Calibration, bool),
) -> Result<(), Failure> {
    console.findings(&shot.findings);
    let numbers = frames.numbers(shot);
    let mut steady = sequence::decide(&numbers, |number| job_at(number, shot, job))?;
    if let Some(error) = steady.error.take_if(|_| steady.looked_at.is_empty()) {
        return Err(error.into());
    }
    if let Some(path) = &frames.decisions {
        sequence::save_decisions(&steady.decisions, path)?;
        console.wrote(path);
    }
    let [read, blur] = seconds_a_frame(&steady, calibration);
    let whole = blur.map(|blur| (read.unwrap_or(0.0) + blur) * numbers.len() as f64);
    let list = FrameSet::from_numbers(numbers.iter().copied()).to_string();
    if json {
        let looked_at: Vec<i64> = steady.looked_at.iter().map(|frame| frame.number).collect();
        print_json(&json!({
            "frames": numbers.len(), "list": list, "missing": shot.missing, "looked_at": looked_at,
            "decisions": steady.decisions, "read_seconds": read, "blur_seconds": blur, "shot_seconds": whole,
        }))?;
        return Ok(());
    }
    let mut text = format!("frames: {} ({list})\n", numbers.len());
    text += &format!("shot: {}\n", steady.finding().text);
    if let (Some(read), Some(blur), Some(whole)) = (read, blur, whole) {
        let whole = in_words(whole);
        text += &format!(
            "time: {read:.2} s to read a frame, {blur:.2} s predicted to blur it; about {whole} for the shot\n"
        );
    }
    print(&text)?;
    Ok(())
}

/// Seconds to read the slowest frame that was looked at, and the largest prediction for the blur of one with the number of views that all
/// have.
fn seconds_a_frame(steady: &Steady, calibration: &Calibration) -> [Option<f64>; 2] {
    let blur = |frame: &LookedAt| {
        let plan = match steady.decisions.views {
            Some(views) => frame.plan.with_views(views),
            None => frame.plan.clone(),
        };
        predict(frame.stats.as_ref()?, &plan, calibration).map(|cost| cost.seconds)
    };
    let read = steady.looked_at.iter().map(|frame| frame.read_seconds).reduce(f64::max);
    [read, steady.looked_at.iter().filter_map(blur).reduce(f64::max)]
}
