//! `thinlens render` of a sequence: which frames there are, what the shot decides, and the run.

mod args;
mod frames;
mod plan;
mod progress;
mod tally;
mod work;

pub(super) use args::{FramesArgs, RunArgs};
pub(super) use plan::run as plan;

use super::console::{Console, print_json_line};
use super::failure::Failure;
use super::outputs::OutputArgs;
use frames::Frames;
use serde::Serialize;
use tally::{Summary, Tally};
use thinlens::gpu;
use thinlens::output::report::write_json;
use thinlens::render::{Job, memory_limit_bytes};
use thinlens::sequence::{self, Limits, Shot};
use work::Run;

/// Renders the frames of `shot`, which all have `job` but for what their names say.
///
/// # Errors
/// Those of the call, before any frame is rendered; [`Failure::Frames`] where frames failed.
pub(super) fn run(
    shot: &Shot,
    job: Job,
    (frames, outputs, run): (&FramesArgs, &OutputArgs, &RunArgs),
    console: Console,
) -> Result<(), Failure> {
    outputs.check_varies()?;
    console.findings(&shot.findings);
    let numbers = frames.numbers(shot);
    let all = Frames { shot, job, outputs };
    if let Some(first) = numbers.first() {
        let first = all.frame(*first)?;
        first.outputs.create_folders(outputs)?;
        first.outputs.check(&first.job)?;
    }
    if run.watch {
        work::wait_for_any(&all, &numbers, console)?;
    }
    let decisions = frames.decisions(&all, &numbers, console)?;
    let all = all.pinned(&decisions);
    let limits = Limits {
        memory_bytes: memory_limit_bytes(&all.job),
        frames: frames_in_flight(&all.job),
        fail_fast: run.fail_fast,
    };
    let tally = Tally::new(console, run.progress, outputs.json, numbers.len());
    let work = Run::new(all, run, tally);
    let not_started = sequence::run(numbers, limits, &work).len();
    let summary = work.into_tally().finish(not_started);
    if let Some(path) = outputs.report_of_shot()? {
        write_json(path, &summary)?;
    }
    if outputs.json {
        // The exit code says the same to a reader that has gone.
        let _ = print_json_line(&Shots { shot: &summary });
    }
    match summary.exit_code() {
        0 => Ok(()),
        code => Err(Failure::Frames(code)),
    }
}

/// The last line of JSON of a run.
#[derive(Debug, Serialize)]
struct Shots<'a> {
    shot: &'a Summary,
}

/// Most frames of `job` in flight: one for each thread; on a GPU one that it blurs, and one that is read or written meanwhile.
fn frames_in_flight(job: &Job) -> usize {
    if gpu::may_be_chosen(job.device) { 2 } else { rayon::current_num_threads() }
}
