//! The frames of a run: the job of each, and its files.

use crate::cli::outputs::OutputArgs;
use std::path::PathBuf;
use thinlens::error::Error;
use thinlens::output::digest_of;
use thinlens::render::{Decisions, Job, digest};
use thinlens::sequence::{Pattern, Shot};
use thinlens::stack::Source;

/// What all frames of a run have in common; the names of files in it may be patterns.
#[derive(Debug)]
pub(super) struct Frames<'a> {
    /// Where the frames are.
    pub(super) shot: &'a Shot,
    /// What to do with each.
    pub(super) job: Job,
    /// Where to.
    pub(super) outputs: &'a OutputArgs,
}

impl Frames<'_> {
    /// Frame `number`.
    ///
    /// # Errors
    /// A pattern that cannot be read.
    pub(super) fn frame(&self, number: i64) -> Result<Frame, Error> {
        Ok(Frame { job: job_at(number, self.shot, &self.job)?, outputs: self.outputs.at(number)? })
    }

    /// The same with what was decided for the shot.
    pub(super) fn pinned(self, decisions: &Decisions) -> Self {
        Self { job: decisions.pin(&self.job), ..self }
    }
}

/// A frame: its job and the files that it writes.
#[derive(Debug)]
pub(super) struct Frame {
    /// What to render.
    pub(super) job: Job,
    /// Where to.
    pub(super) outputs: OutputArgs,
}

impl Frame {
    /// What determines its picture: see [`digest`].
    ///
    /// # Errors
    /// An input that cannot be examined.
    pub(super) fn digest(&self) -> Result<String, Error> {
        digest(&self.job, &self.outputs.encoding())
    }

    /// Whether all its files are there, and its picture is whole and has this `digest`.
    pub(super) fn is_up_to_date(&self, digest: &str) -> bool {
        let picture = &self.outputs.output;
        let is_there = |file: &PathBuf| file.is_file();
        let all = self.outputs.files().is_ok_and(|mut files| files.all(is_there));
        all && digest_of(picture).is_some_and(|written| written == digest)
    }
}

/// The job of frame `number` of `shot`: `job` with the files that the names in it are patterns of.
///
/// # Errors
/// A pattern that cannot be read.
pub(super) fn job_at(number: i64, shot: &Shot, job: &Job) -> Result<Job, Error> {
    let sources = shot.inputs_at(number).into_iter().map(Source::File).collect();
    let mut job = Job { frame: Some(number), sources, ..job.clone() };
    let of_preset = job.preset.as_mut().map(|named| &mut named.preset.values);
    let of_preset =
        of_preset.into_iter().flat_map(|values| [values.beauty.as_mut(), values.holdout.as_mut()]);
    let files = [job.read_options.depth_file.as_mut(), job.flags.beauty.as_mut(), job.flags.holdout.as_mut()];
    for file in files.into_iter().chain(of_preset).flatten() {
        *file = Pattern::file_at(file, number)?;
    }
    Ok(job)
}
