//! What the user sees while a command runs: decisions, warnings and progress, all on standard error.
//!
//! Results go to standard output through `write!`, whose errors are kept: a closed pipe ends the program quietly.

use super::flags::spoken;
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

/// Standard error, as talkative as asked for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Console {
    quiet: bool,
}

impl Console {
    pub(super) fn new(quiet: bool) -> Self {
        Self { quiet }
    }

    /// A line about what is going on.
    pub(super) fn note(self, text: impl Display) {
        if !self.quiet {
            line(text);
        }
    }

    /// A line about a file that was written.
    pub(super) fn wrote(self, path: &Path) {
        self.note(format_args!("wrote {}", path.display()));
    }

    /// One line per conclusion that was drawn from the input.
    pub(super) fn findings(self, findings: &[Finding]) {
        for Finding { about, text, warning } in findings {
            if *warning {
                line(format_args!("warning: {about}: {text}"));
            } else {
                self.note(format_args!("{about}: {text}"));
            }
        }
    }

    /// Where the plan is carried out, and why there.
    pub(super) fn device(self, device: &Device) {
        self.note(format_args!("device: {}: {}", device.name, device.reason));
    }

    /// One line for the method, one for blur, and one per effect that is on or was switched.
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

    /// How fast this machine is: measured the first time, or `again`, and what there is to say about that.
    ///
    /// # Errors
    /// Those of measuring.
    pub(super) fn calibration(self, again: bool) -> Result<Calibration, Error> {
        let (calibration, remarks) = Calibration::load_or_measure(cache_folder().as_deref(), again)?;
        remarks.iter().for_each(|Remark(text)| self.note(format_args!("calibration: {text}")));
        Ok(calibration)
    }

    /// The sampling error that was found.
    pub(super) fn estimate(self, estimate: &ErrorEstimate) {
        let ErrorEstimate { pixels, rays_per_pixel, .. } = estimate;
        self.note(format_args!("sampling error: {estimate}, {pixels} pixels of {rays_per_pixel} rays each"));
    }

    /// A progress bar of 0 … 1, hidden unless standard error is a terminal.
    pub(super) fn progress(self, what: &'static str) -> Bar {
        let shown = !self.quiet && io::stderr().is_terminal();
        let target = if shown { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
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

/// Prints the error that ended the command.
pub(super) fn error(error: &Error) {
    line(format_args!("error: {error}"));
}

/// The name of an enum's value as reports and flags write it.
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

/// Prints `text` on standard output.
pub(super) fn print(text: &str) -> io::Result<()> {
    let mut stdout = io::stdout().lock();
    stdout.write_all(text.as_bytes())?;
    stdout.flush()
}

/// A line in the words of the command line.
fn line(text: impl Display) {
    // Where standard error is closed there is nobody left to tell.
    let _ = writeln!(io::stderr().lock(), "{}", spoken(&text.to_string()));
}

/// How a plan samples the lens, in words.
pub(super) fn sampling(plan: &Plan) -> String {
    let reason = &plan.views_reason;
    match (plan.target, plan.views) {
        (Some(Target::Error { psnr_db, max_views }), _) => {
            format!("as many as reach {psnr_db} dB, at most {max_views}: {reason}")
        }
        (Some(Target::Time { seconds }), _) => format!("as many as fit into {seconds} s: {reason}"),
        (None, Some(views)) => format!("{views}: {reason}"),
        (None, None) => format!("none: {reason}"),
    }
}
