//! The flags of sequences: which frames there are, and how to go through them.

use super::frames::{Frames, job_at};
use super::progress::Protocol;
use crate::cli::console::Console;
use crate::cli::failure::{Failure, usage_error};
use crate::cli::outputs::OutputArgs;
use clap::Args;
use clap::error::ErrorKind;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use thinlens::error::Error;
use thinlens::render::Decisions;
use thinlens::sequence::{self, FrameSet, Shot};
use thinlens::stack::is_read_once;

/// Frames of a sequence.
#[derive(Debug, Args)]
#[command(next_help_heading = "Input")]
pub(in crate::cli) struct FramesArgs {
    /// Frames of a sequence, such as 1-100 or 1-9,20-30x2
    ///
    /// In names of files, #### stands for the frame number, as do %04d, $F4 and @@@@. All names with such a pattern advance together:
    /// inputs, --depth-file, --beauty, the output, --preview, --confidence and --report. In the list, 1-100x5 is every fifth frame, 1-100y5
    /// are the others, and 1-100:4 is every fourth frame, then every third, and so on. Default: all frames that are there.
    #[arg(long, value_name = "LIST", allow_hyphen_values = true, conflicts_with = "frame",
          value_parser = parse_frames)]
    pub(in crate::cli) frames: Option<FrameSet>,
    /// List of inputs, a line each, a frame each; - is stdin
    #[arg(long, value_name = "FILE", conflicts_with = "inputs")]
    pub(in crate::cli) files_from: Option<PathBuf>,
    /// What `thinlens plan` decided for the shot
    ///
    /// Machines that render parts of a shot decide alike only if they get the same decisions, or the same number of --views.
    #[arg(long, value_name = "FILE.toml")]
    pub(in crate::cli) decisions: Option<PathBuf>,
}

/// How to go through a sequence.
#[derive(Debug, Args)]
#[command(next_help_heading = "Output")]
pub(in crate::cli) struct RunArgs {
    /// Skip frames that are complete and up to date
    ///
    /// A frame is up to date if its picture was made from the same files, with the same settings, by the same version.
    #[arg(long)]
    pub(super) resume: bool,
    /// Stop at the first frame that fails
    #[arg(long)]
    pub(super) fail_fast: bool,
    /// Wait for frames that the renderer has not finished
    #[arg(long, requires = "frames")]
    pub(super) watch: bool,
    /// How to say how far a sequence is
    #[arg(long, value_name = "READER", default_value = "auto")]
    pub(super) progress: Protocol,
}

impl FramesArgs {
    /// The frames of `inputs`; `None` where these are one frame. `varies` is whether a name of an output is a pattern.
    ///
    /// # Errors
    /// Those of finding files.
    pub(in crate::cli) fn shot(&self, inputs: &[PathBuf], varies: bool) -> Result<Option<Shot>, Error> {
        let frames = self.frames.as_ref();
        if let Some(list) = &self.files_from {
            return Shot::of_files(&listed(list)?, frames).map(Some);
        }
        let shot = match Shot::find(inputs, frames)? {
            None if varies || frames.is_some() => Shot::of_files(inputs, frames).map(Some)?,
            shot => shot,
        };
        match inputs.iter().find(|input| shot.is_some() && is_read_once(input)) {
            Some(input) => Err(Error::settings("a pipe has one frame, and a sequence needs a file for each")
                .in_file(input)
                .help("name files, such as shot.####.exr, or a list of them with --files-from -")),
            None => Ok(shot),
        }
    }

    /// The folders that temporary files of `outputs` are made in: where they vary, those of the frames that are asked for.
    pub(in crate::cli) fn folders(&self, outputs: &OutputArgs) -> Vec<PathBuf> {
        let numbers: Vec<i64> = self.frames.iter().flat_map(FrameSet::iter).collect();
        let of = |number: &i64| outputs.at(*number).map(|outputs| outputs.folders()).unwrap_or_default();
        let ends = [numbers.first(), numbers.last()].map(|number| number.map(of).unwrap_or_default());
        if ends[0] == ends[1] {
            return [outputs.folders(), ends[0].clone()].concat();
        }
        numbers.iter().flat_map(of).collect::<BTreeSet<PathBuf>>().into_iter().collect()
    }

    /// The numbers of the frames of `shot`, in their order: also of those that are not there, which fail or are waited for.
    pub(super) fn numbers(&self, shot: &Shot) -> Vec<i64> {
        match &self.frames {
            Some(frames) => frames.iter().collect(),
            None => {
                shot.frames.iter().map(|frame| frame.number).chain(shot.missing.iter().copied()).collect()
            }
        }
    }

    /// What is decided for the shot: by the file that is given, or from some of the frames `numbers`.
    ///
    /// # Errors
    /// Those of the file; those of [`sequence::decide`].
    pub(super) fn decisions(
        &self,
        frames: &Frames<'_>,
        numbers: &[i64],
        console: Console,
    ) -> Result<Decisions, Error> {
        if let Some(file) = &self.decisions {
            return sequence::load_decisions(file);
        }
        let steady = sequence::decide(numbers, |number| job_at(number, frames.shot, &frames.job))?;
        console.findings(&[steady.finding()]);
        Ok(steady.decisions)
    }
}

impl RunArgs {
    /// Refuses flags without effect for a single frame.
    pub(in crate::cli) fn check_single(&self, frames: &FramesArgs) -> Result<(), Failure> {
        let flags = [
            ("--resume", self.resume),
            ("--fail-fast", self.fail_fast),
            ("--watch", self.watch),
            ("--progress", self.progress != Protocol::Auto),
            ("--decisions", frames.decisions.is_some()),
        ];
        match flags.into_iter().find(|(_, is_set)| *is_set) {
            None => Ok(()),
            Some((flag, _)) => {
                let message = format!(
                    "{flag} has no effect: this is one frame; a sequence has a pattern in the names of its files, such as shot.####.exr"
                );
                Err(usage_error("render", ErrorKind::ArgumentConflict, &message))
            }
        }
    }
}

/// Parses a list of frames.
fn parse_frames(text: &str) -> Result<FrameSet, String> {
    FrameSet::parse(text).map_err(|error| error.on_one_line())
}

/// The files that are listed in `list`, a line each; `-` is standard input. Empty lines are skipped.
fn listed(list: &Path) -> Result<Vec<PathBuf>, Error> {
    let is_stdin = list == Path::new("-");
    let text =
        if is_stdin { std::io::read_to_string(std::io::stdin()) } else { std::fs::read_to_string(list) };
    let text = text
        .map_err(|cause| Error::input("the list of files cannot be read").in_file(list).caused_by(cause))?;
    let files: Vec<PathBuf> =
        text.lines().filter(|line| !line.trim().is_empty()).map(PathBuf::from).collect();
    if files.is_empty() {
        return Err(Error::input("the list of files is empty")
            .in_file(list)
            .help("write the name of an input in each line"));
    }
    Ok(files)
}
