//! Output of a running command: decisions, warnings and progress on standard error, results on standard output.
//!
//! Results are written without `print!`, which panics on a closed pipe; a closed pipe ends the program without an error.

use super::flags::keys_to_flags;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::fmt::Display;
use std::io::{self, IsTerminal, Write};
use std::path::Path;
use thinlens::cost::{Calibration, Remark, cache_folder};
use thinlens::error::Error;
use thinlens::finding::Finding;
use thinlens::gpu::Device;
use thinlens::methods::{Plan, Target};
use thinlens::probes::ErrorEstimate;
use thinlens::scene::EffectKind;
use thinlens::shown::{escaped, shown};
use thinlens::stack::{Frame, Window};

/// Messages on standard error; with `quiet`, warnings and errors only.
#[derive(Debug, Clone, Copy)]
pub(super) struct Console {
    quiet: bool,
}

impl Console {
    pub(super) fn new(quiet: bool) -> Self {
        Self { quiet }
    }

    /// Prints a line, unless quiet.
    pub(super) fn note(self, text: impl Display) {
        if !self.quiet {
            line(&shown(&text.to_string()));
        }
    }

    /// Prints that a file was written.
    pub(super) fn wrote(self, path: &Path) {
        if !self.quiet {
            line(&escaped(&format!("wrote {}", path.display())));
        }
    }

    /// Prints which part of two pictures is compared, if it is not all of both.
    pub(super) fn compared(self, parts: [Window; 2], frames: [&Frame; 2]) {
        let is_whole = |(part, frame): (Window, &Frame)| {
            (part.width, part.height) == (frame.data.width, frame.data.height)
        };
        if !parts.into_iter().zip(frames).all(is_whole) {
            let [Window { x, y, width, height }, _] = parts;
            self.note(format_args!(
                "compared: {width}×{height} pixels that both pictures show of the display window, from column {x} and row {y} on"
            ));
        }
    }

    /// Prints what was replaced in the picture `file`, if anything.
    pub(super) fn replaced(self, file: &Path, replaced: Option<Finding>) {
        let named =
            |finding: Finding| Finding { text: format!("{}: {}", file.display(), finding.text), ..finding };
        self.findings(&replaced.map(named).into_iter().collect::<Vec<_>>());
    }

    /// Prints one line per finding about the input.
    pub(super) fn findings(self, findings: &[Finding]) {
        for Finding { about, text, warning: warns } in findings {
            if *warns {
                warning(format_args!("{about}: {text}"));
            } else {
                self.note(format_args!("{about}: {text}"));
            }
        }
    }

    /// Prints the device of the blur and why it was chosen.
    pub(super) fn device(self, device: &Device) {
        self.note(format_args!("device: {}: {}", device.name, device.reason));
    }

    /// Prints one line for the method, one for blur, and one per effect that is on or was switched by the user.
    pub(super) fn plan(self, plan: &Plan) {
        self.note(format_args!("method: {}: {}", plan.method, plan.method_reason));
        self.note(format_args!("views: {}", sampling(plan)));
        for effect in
            plan.effects.iter().filter(|effect| effect.on || effect.forced || effect.name == EffectKind::Blur)
        {
            let off = if effect.on { "" } else { "off, " };
            self.note(format_args!("{}: {off}{}", effect.name.name(), effect.reason));
        }
    }

    /// The calibration of this machine: loaded, or measured the first time and with `again`. Prints the remarks about it.
    ///
    /// # Errors
    /// Those of the measurement.
    pub(super) fn calibration(self, again: bool) -> Result<Calibration, Error> {
        let (calibration, remarks) = Calibration::load_or_measure(cache_folder().as_deref(), again)?;
        remarks.iter().for_each(|Remark(text)| self.note(format_args!("calibration: {text}")));
        Ok(calibration)
    }

    /// Prints the estimated sampling error.
    pub(super) fn estimate(self, estimate: &ErrorEstimate) {
        let ErrorEstimate { pixels, rays_per_pixel, .. } = estimate;
        self.note(format_args!(
            "sampling error: {estimate}, measured at {pixels} pixels with {rays_per_pixel} rays each"
        ));
    }

    /// Whether progress bars are shown.
    pub(super) fn shows_bars(self) -> bool {
        !self.quiet && io::stderr().is_terminal()
    }

    /// A progress bar of 0 … 1, hidden unless standard error is a terminal.
    pub(super) fn progress(self, what: &'static str) -> Bar {
        let target =
            if self.shows_bars() { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let bar = ProgressBar::with_draw_target(Some(Bar::STEPS), target).with_message(what);
        if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {percent:>3} %") {
            bar.set_style(style);
        }
        Bar(bar)
    }
}

/// A progress bar that clears itself when dropped.
#[derive(Debug)]
pub(super) struct Bar(ProgressBar);

impl Bar {
    const STEPS: u64 = 1000;

    /// Shows that `share` of the work is done.
    pub(super) fn set(&self, share: f32) {
        self.0.set_position((share.clamp(0.0, 1.0) * Self::STEPS as f32) as u64);
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

/// Prints a warning.
pub(super) fn warning(text: impl Display) {
    line(&shown(&format!("warning: {text}")));
}

/// Prints the error that ended frame `number` of a sequence.
pub(super) fn frame_error(number: i64, error: &Error) {
    line(&format!("error: frame {number}: {error}"));
}

/// Prints the error that ended the command.
pub(super) fn error(error: &Error) {
    line(&format!("error: {error}"));
}

/// The serialized name of an enum's value, as in reports and flags.
pub(super) fn kebab(value: &impl serde::Serialize) -> String {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(name)) => name,
        _ => "unnamed".to_owned(),
    }
}

/// Prints `value` on standard output as indented JSON.
pub(super) fn print_json(value: &impl serde::Serialize) -> io::Result<()> {
    let mut text = serde_json::to_string_pretty(value).map_err(io::Error::other)?;
    text.push('\n');
    print(&text)
}

/// Prints `value` on standard output as a line of JSON.
pub(super) fn print_json_line(value: &impl serde::Serialize) -> io::Result<()> {
    let mut text = serde_json::to_string(value).map_err(io::Error::other)?;
    text.push('\n');
    print(&text)
}

/// Prints `text` on standard output.
pub(super) fn print(text: &str) -> io::Result<()> {
    let mut stdout = io::stdout().lock();
    stdout.write_all(text.as_bytes())?;
    stdout.flush()
}

/// Prints `text`, which has no control characters, on standard error, with keys of settings replaced by flags.
fn line(text: &str) {
    // A closed standard error has no reader: its error is dropped.
    let _ = writeln!(io::stderr().lock(), "{}", keys_to_flags(text));
}

/// The number of lens samples of a plan, or its target, with the reason.
pub(super) fn sampling(plan: &Plan) -> String {
    let reason = &plan.views_reason;
    match (plan.target, plan.views) {
        (Some(Target::Error { psnr_db, max_views }), _) => {
            format!("enough for {psnr_db} dB, at most {max_views}: {reason}")
        }
        (Some(Target::Time { seconds }), _) => format!("as many as fit into {seconds} s: {reason}"),
        (None, Some(views)) => format!("{views}: {reason}"),
        (None, None) => format!("none: {reason}"),
    }
}
