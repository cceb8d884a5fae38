//! What has become of the frames of a run: lines and a bar while it goes on, a summary at the end.

use super::progress::{Line, Protocol};
use crate::cli::console::{self, Console, print_json_line};
use crate::cli::failure::with_flags;
use crate::cli::flags::keys_to_flags;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;
use thinlens::error::{Error, ErrorReport};
use thinlens::finding::Finding;
use thinlens::sequence::FrameSet;

/// Exit code of a run of which some frames failed and others are there.
const SOME_FAILED: u8 = 3;

/// What became of a frame.
#[derive(Debug)]
pub(super) enum Ending {
    /// It was rendered, in this many seconds, with these findings.
    Rendered { seconds: f64, findings: Vec<Finding> },
    /// It was there already.
    Skipped,
}

/// A frame that has ended, for scripts.
#[derive(Debug, Serialize)]
struct FrameLine<'a> {
    frame: i64,
    status: &'static str,
    output: &'a Path,
    seconds: Option<f64>,
    error: Option<&'a ErrorReport>,
}

/// A frame that failed, and why.
#[derive(Debug, Serialize)]
struct Failed {
    frame: i64,
    error: ErrorReport,
}

/// The end of a run, for scripts.
#[derive(Debug, Serialize)]
pub(super) struct Summary {
    frames: usize,
    rendered: usize,
    skipped: usize,
    failed: usize,
    /// Frames that did not start, because another failed.
    not_started: usize,
    seconds: f64,
    cpu_seconds: f64,
    peak_memory_bytes: Option<u64>,
    failures: Vec<Failed>,
    /// Warnings, each with the frames that it is about.
    warnings: BTreeMap<String, String>,
    exit_code: u8,
}

/// The frames of a run so far.
#[derive(Debug)]
pub(super) struct Tally {
    console: Console,
    bar: ProgressBar,
    protocol: Protocol,
    json: bool,
    started: Instant,
    total: usize,
    rendered: usize,
    skipped: usize,
    failures: Vec<Failed>,
    warnings: BTreeMap<String, Vec<i64>>,
}

impl Tally {
    /// A run of `total` frames.
    pub(super) fn new(console: Console, protocol: Protocol, json: bool, total: usize) -> Self {
        let shown = protocol == Protocol::Auto && console.shows_bars();
        let target = if shown { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let bar = ProgressBar::with_draw_target(Some(total as u64), target);
        if let Ok(style) = ProgressStyle::with_template("{pos} of {len} frames {wide_bar} {msg}") {
            bar.set_style(style);
        }
        Self {
            console,
            bar,
            protocol,
            json,
            started: Instant::now(),
            total,
            rendered: 0,
            skipped: 0,
            failures: Vec::new(),
            warnings: BTreeMap::new(),
        }
    }

    /// Takes note of the end of frame `number`, whose picture is `output`.
    pub(super) fn ended(&mut self, number: i64, output: &Path, result: Result<Ending, Error>) {
        let (status, seconds, error) = match result {
            Ok(Ending::Rendered { seconds, findings }) => {
                self.rendered += 1;
                self.warn(number, &findings);
                ("rendered", Some(seconds), None)
            }
            Ok(Ending::Skipped) => {
                self.skipped += 1;
                ("skipped", None, None)
            }
            Err(error) => {
                self.bar.suspend(|| console::frame_error(number, &error));
                self.failures.push(Failed { frame: number, error: with_flags(error.report()) });
                ("failed", None, self.failures.last().map(|failed| &failed.error))
            }
        };
        if self.json {
            // A closed standard output has no reader.
            let _ = print_json_line(&FrameLine { frame: number, status, output, seconds, error });
        }
        let done = self.done();
        self.bar.set_position(done as u64);
        let left = self.seconds_left().map(|left| format!(", {} left", in_words(left))).unwrap_or_default();
        self.bar.set_message(format!("{:.2} frames/s{left}", self.rendered as f64 / self.seconds()));
        let text = match (status, seconds) {
            ("rendered", Some(seconds)) => format!("wrote {} in {seconds:.2} s", output.display()),
            ("skipped", _) => format!("{} is complete and up to date", output.display()),
            _ => "failed".to_owned(),
        };
        let line = format!("frame {number}: {text} ({done} of {}{left})", self.total);
        if self.bar.is_hidden() {
            self.console.note(&line);
        }
        self.protocol.say(&Line { done, total: self.total, text: &line });
    }

    /// Prints warnings that no frame has had before, and notes which frames have them.
    fn warn(&mut self, number: i64, findings: &[Finding]) {
        for Finding { about, text, .. } in findings.iter().filter(|finding| finding.warning) {
            let text = keys_to_flags(&format!("{about}: {text}"));
            let frames = self.warnings.entry(text.clone()).or_default();
            frames.push(number);
            if frames.len() == 1 {
                self.bar.suspend(|| console::warning(format_args!("frame {number}: {text}")));
            }
        }
    }

    fn done(&self) -> usize {
        self.rendered + self.skipped + self.failures.len()
    }

    /// Seconds since the start.
    fn seconds(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    /// Seconds that the rest will take, if it takes as long a frame as the rendered ones have; `None` before the first.
    fn seconds_left(&self) -> Option<f64> {
        let rest = self.total - self.done();
        let each = self.seconds() / self.rendered as f64;
        (self.rendered > 0 && rest > 0).then_some(each * rest as f64)
    }

    /// The end of the run, printed; `not_started` frames did not start.
    pub(super) fn finish(self, not_started: usize) -> Summary {
        self.bar.finish_and_clear();
        let Self { rendered, skipped, total, .. } = self;
        let exit_code = exit_code_of(&self.failures, not_started, rendered + skipped);
        let warnings = self.warnings.into_iter();
        let summary = Summary {
            frames: total,
            rendered,
            skipped,
            failed: self.failures.len(),
            not_started,
            seconds: self.started.elapsed().as_secs_f64(),
            cpu_seconds: thinlens::usage::cpu_seconds(),
            peak_memory_bytes: thinlens::usage::peak_memory_bytes(),
            failures: self.failures,
            warnings: warnings.map(|(text, frames)| (text, list(frames))).collect(),
            exit_code,
        };
        summary.print(self.console);
        self.protocol.end(&summary.failures_in_words());
        summary
    }
}

impl Summary {
    /// The exit code of the run.
    pub(super) fn exit_code(&self) -> u8 {
        self.exit_code
    }

    fn print(&self, console: Console) {
        let Self { frames, rendered, skipped, failed, not_started, seconds, cpu_seconds, .. } = self;
        let mut text = format!("{rendered} of {frames} frames rendered");
        for (count, what) in
            [(skipped, "were up to date"), (failed, "failed"), (not_started, "did not start")]
        {
            if *count > 0 {
                text += &format!(", {count} {what}");
            }
        }
        let took = in_words(*seconds);
        console.note(format_args!("{text}; {took}, {cpu_seconds:.1} s of processor time"));
        for (text, frames) in &self.warnings {
            if frames.contains([',', '-']) {
                console::warning(format_args!("frames {frames}: {text}"));
            }
        }
        if *failed > 0 {
            console::warning(self.failures_in_words());
        }
    }

    /// The frames that failed, by reason, each with the first of the files that it is about; empty if none did.
    fn failures_in_words(&self) -> String {
        let mut by_reason: BTreeMap<&str, (Vec<i64>, Option<&str>)> = BTreeMap::new();
        for Failed { frame, error } in &self.failures {
            let (frames, file) = by_reason.entry(&error.message).or_default();
            frames.push(*frame);
            *file = file.or(error.file.as_deref());
        }
        let in_words = |(reason, (frames, file)): (&str, (Vec<i64>, Option<&str>))| {
            let file = file.map(|file| format!(" ({file})")).unwrap_or_default();
            format!("{}: {reason}{file}", list(frames))
        };
        let reasons: Vec<String> = by_reason.into_iter().map(in_words).collect();
        if reasons.is_empty() { String::new() } else { format!("failed frames: {}", reasons.join("; ")) }
    }
}

/// The exit code of a run in which `good` frames are there, and `failures` and `not_started` are not.
///
/// Where no frame is there, it is the code of the failures: trying again helps if it helps any of them.
fn exit_code_of(failures: &[Failed], not_started: usize, good: usize) -> u8 {
    match (failures.iter().map(|failed| failed.error.exit_code).min(), good + not_started) {
        (None, _) => 0,
        (Some(code), 0) => code,
        (Some(_), _) => SOME_FAILED,
    }
}

/// Frame numbers as a list that `--frames` accepts.
fn list(frames: impl IntoIterator<Item = i64>) -> String {
    let mut frames: Vec<i64> = frames.into_iter().collect();
    frames.sort_unstable();
    FrameSet::from_numbers(frames).to_string()
}

/// A duration in its two largest units.
pub(super) fn in_words(seconds: f64) -> String {
    if seconds < 59.95 {
        return format!("{seconds:.1} s");
    }
    let whole = seconds.round() as u64;
    match (whole / 3600, whole / 60 % 60, whole % 60) {
        (0, minutes, seconds) => format!("{minutes} min {seconds:02} s"),
        (hours, minutes, _) => format!("{hours} h {minutes:02} min"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn failed(frame: i64, error: Error) -> Failed {
        Failed { frame, error: error.report() }
    }

    #[test]
    fn the_exit_code_says_whether_trying_again_helps() {
        let bad = || failed(1, Error::input("bad"));
        let full = || failed(2, Error::output("full"));
        assert_eq!(exit_code_of(&[], 0, 5), 0);
        assert_eq!(exit_code_of(&[], 0, 0), 0, "nothing to do");
        assert_eq!(exit_code_of(&[bad()], 0, 5), 3);
        assert_eq!(exit_code_of(&[bad()], 4, 0), 3, "others were not tried");
        assert_eq!(exit_code_of(&[bad()], 0, 0), 4);
        assert_eq!(exit_code_of(&[bad(), full()], 0, 0), 1, "the full disk may have been cleared");
    }

    #[test]
    fn a_duration_has_its_two_largest_units() {
        assert_eq!(
            [0.04, 59.9, 60.0, 61.0, 3599.9, 7322.0].map(in_words),
            ["0.0 s", "59.9 s", "1 min 00 s", "1 min 01 s", "1 h 00 min", "2 h 02 min"]
        );
    }

    #[test]
    fn frames_are_listed_as_the_flag_takes_them() {
        assert_eq!(list([3, 1, 2, 9]), "1-3,9");
    }
}
