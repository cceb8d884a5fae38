//! A frame of a run: whether it is ready, whether it is there already, and how it is rendered.

use super::args::RunArgs;
use super::frames::{Frame, Frames};
use super::tally::{Ending, Tally};
use crate::cli::console::Console;
use crate::cli::picture::{self, Decided, Watcher};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use thinlens::error::Error;
use thinlens::render::memory_bytes;
use thinlens::sequence::{Pattern, Readiness, Work, check_focus, is_finished};

/// How often the first frame of a sequence is looked for.
const POLL: Duration = Duration::from_millis(250);

/// The run of a sequence.
#[derive(Debug)]
pub(super) struct Run<'a> {
    frames: Frames<'a>,
    args: &'a RunArgs,
    tally: Mutex<Tally>,
}

impl<'a> Run<'a> {
    /// The run of `frames` that `args` ask for, which `tally` follows.
    pub(super) fn new(frames: Frames<'a>, args: &'a RunArgs, tally: Tally) -> Self {
        Self { frames, args, tally: Mutex::new(tally) }
    }

    fn tally(&self) -> MutexGuard<'_, Tally> {
        self.tally.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The frames so far, after the run.
    pub(super) fn into_tally(self) -> Tally {
        self.tally.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Waits until all files of one of the frames `numbers` are complete.
///
/// # Errors
/// A pattern that cannot be read.
pub(super) fn wait_for_any(frames: &Frames<'_>, numbers: &[i64], console: Console) -> Result<(), Error> {
    let mut said = false;
    while !numbers.is_empty() {
        for number in numbers {
            if is_ready(&frames.frame(*number)?) {
                return Ok(());
            }
        }
        if !said {
            console.note("waiting for the first frame");
            said = true;
        }
        std::thread::sleep(POLL);
    }
    Ok(())
}

/// Whether all files that `frame` reads are complete.
fn is_ready(frame: &Frame) -> bool {
    frame.job.files().all(is_finished)
}

/// Says nothing of a frame while it is made.
struct Quiet;

impl Watcher for Quiet {
    fn decided(&self, decided: &Decided<'_>) -> Result<(), Error> {
        check_focus(decided.focus)
    }

    fn blurred(&self, _share: f32) {}
}

impl Work for Run<'_> {
    type Frame = i64;
    type Done = Ending;

    fn readiness(&self, number: &i64) -> Readiness {
        // A frame that cannot be read fails when it is rendered, and says why.
        let Ok(frame) = self.frames.frame(*number) else { return Readiness::Ready(0) };
        if self.args.watch && !is_ready(&frame) {
            return Readiness::Waiting;
        }
        Readiness::Ready(memory_bytes(&frame.job).unwrap_or(0))
    }

    fn render(&self, number: &i64) -> Result<Ending, Error> {
        let frame = self.frames.frame(*number)?;
        frame.outputs.create_folders(self.frames.outputs)?;
        frame.outputs.check_inputs(&frame.job)?;
        // Of the files as they are before they are read.
        let digest = frame.digest();
        if self.args.resume && digest.as_ref().is_ok_and(|digest| frame.is_up_to_date(digest)) {
            return Ok(Ending::Skipped);
        }
        let rendered = picture::render(&frame.job, &frame.outputs, digest, &Quiet)?;
        Ok(Ending::Rendered { seconds: rendered.clock.seconds().total, findings: rendered.stack.findings })
    }

    fn ended(&self, number: i64, result: Result<Ending, Error>) {
        let output = Pattern::file_at(&self.frames.outputs.output, number).unwrap_or_default();
        self.tally().ended(number, &output, result);
    }
}
