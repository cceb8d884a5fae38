//! The frames of a run: the job of each, and its files.

use crate::cli::outputs::OutputArgs;
use std::path::{Path, PathBuf};
use thinlens::error::Error;
use thinlens::output::digest_of;
use thinlens::render::{Decisions, Job, digest};
use thinlens::sequence::{Pattern, is_finished};
use thinlens::stack::Source;

/// A frame: its job and the files that it writes.
#[derive(Debug)]
pub(super) struct Frame {
    /// Its number.
    pub(super) number: i64,
    /// What to render.
    pub(super) job: Job,
    /// Where to.
    pub(super) outputs: OutputArgs,
}

impl Frame {
    /// The frame `number`, whose stack is in `inputs`, of a run in which all others have `job` and `outputs` too: the names of other files
    /// are patterns.
    ///
    /// # Errors
    /// A pattern that cannot be read.
    pub(super) fn new(
        number: i64,
        inputs: Vec<PathBuf>,
        job: &Job,
        outputs: &OutputArgs,
    ) -> Result<Self, Error> {
        Ok(Self { number, job: job_at(number, inputs, job)?, outputs: outputs.at(number)? })
    }

    /// The frame with what was decided for its shot.
    pub(super) fn pinned(self, decisions: &Decisions) -> Self {
        Self { job: decisions.pin(&self.job), ..self }
    }

    /// What determines its picture: see [`digest`].
    ///
    /// # Errors
    /// An input that cannot be examined.
    pub(super) fn digest(&self) -> Result<String, Error> {
        digest(&self.job, &self.outputs.encoding())
    }

    /// Whether all its files are there as a whole, and its picture has this `digest`.
    pub(super) fn is_up_to_date(&self, digest: &str) -> bool {
        let picture = &self.outputs.output;
        let is_there = |file: &PathBuf| file.is_file();
        let all = self.outputs.files().is_ok_and(|mut files| files.all(is_there));
        all && is_finished(picture) && digest_of(picture).is_some_and(|written| written == digest)
    }
}

/// The job of frame `number`, whose stack is in `inputs`: `job` with the files that the names in it are patterns of.
///
/// # Errors
/// A pattern that cannot be read.
pub(super) fn job_at(number: i64, inputs: Vec<PathBuf>, job: &Job) -> Result<Job, Error> {
    let sources = inputs.into_iter().map(Source::File).collect();
    let mut job = Job { frame: Some(number), sources, ..job.clone() };
    for file in [&mut job.read_options.depth_file, &mut job.flags.beauty].into_iter().flatten() {
        *file = at(file, number)?;
    }
    Ok(job)
}

/// The file of frame `number` where `path` is a pattern, else `path`.
///
/// # Errors
/// A pattern that cannot be read.
pub(in crate::cli) fn at(path: &Path, number: i64) -> Result<PathBuf, Error> {
    Ok(Pattern::parse(path)?.map_or_else(|| path.to_owned(), |pattern| pattern.at(number)))
}
