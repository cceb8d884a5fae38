//! How far a run is, in the words of what runs it: a person, or the engine of a farm.

use crate::cli::console::print;
use clap::ValueEnum;

/// Who reads the progress of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(super) enum Protocol {
    /// A bar on a terminal, else a line a frame
    #[default]
    Auto,
    /// Lines of Open Job Description on stdout
    Openjd,
    /// Short lines with a percentage on stdout, for OpenCue
    Opencue,
    /// A line a frame, and no bar
    None,
}

/// The state of a run after a frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line<'a> {
    /// Frames that have ended.
    pub(super) done: usize,
    /// All frames.
    pub(super) total: usize,
    /// What became of the last one.
    pub(super) text: &'a str,
}

impl Protocol {
    /// Says how far the run is.
    pub(super) fn say(self, line: &Line<'_>) {
        let percent = 100.0 * line.done as f64 / line.total.max(1) as f64;
        match self {
            Self::Auto | Self::None => {}
            Self::Openjd => {
                send(&format!("openjd_progress: {percent:.1}\nopenjd_status: {}\n", line.text));
            }
            Self::Opencue => send(&format!("{percent:.0} % {}\n", line.text)),
        }
    }

    /// Says why the run failed; `failures` is empty if it did not.
    pub(super) fn end(self, failures: &str) {
        if self == Self::Openjd && !failures.is_empty() {
            send(&format!("openjd_fail: {failures}\n"));
        }
    }
}

/// Prints on standard output. A reader that has gone needs no progress: the error is dropped, and the frames go on.
fn send(text: &str) {
    let _ = print(text);
}
