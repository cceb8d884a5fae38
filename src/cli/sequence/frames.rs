//! The frames of a run: the job of each, and its files.

use crate::cli::outputs::OutputArgs;
use std::path::{Path, PathBuf};
use thinlens::error::Error;
use thinlens::render::Job;
use thinlens::sequence::{Pattern, ShotFrame};
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
    /// The frame `shot` of a run in which all others have `job` and `outputs` too: the names of their files are patterns.
    ///
    /// # Errors
    /// A pattern that cannot be read.
    pub(super) fn new(shot: &ShotFrame, job: &Job, outputs: &OutputArgs) -> Result<Self, Error> {
        let number = shot.number;
        let mut job =
            Job { frame: Some(number), sources: shot.inputs.iter().map(Source::file).collect(), ..job.clone() };
        let options = &mut job.read_options;
        for file in [&mut options.depth_file, &mut options.beauty, &mut job.flags.beauty].into_iter().flatten() {
            *file = at(file, number)?;
        }
        Ok(Self { number, job, outputs: outputs.at(number)? })
    }

    /// Every file that it reads.
    pub(super) fn inputs(&self) -> impl Iterator<Item = &Path> {
        let Job { sources, read_options, flags, .. } = &self.job;
        let files = sources.iter().map(Source::name);
        let others = [&read_options.depth_file, &read_options.beauty, &flags.beauty];
        files.chain(others.into_iter().flatten().map(PathBuf::as_path))
    }
}

/// The file of frame `number` where `path` is a pattern, else `path`.
///
/// # Errors
/// A pattern that cannot be read.
pub(in crate::cli) fn at(path: &Path, number: i64) -> Result<PathBuf, Error> {
    Ok(Pattern::parse(path)?.map_or_else(|| path.to_owned(), |pattern| pattern.at(number)))
}
