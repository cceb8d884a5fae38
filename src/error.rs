//! The error type of the library: what was expected, what was found, where, and what to do.
//!
//! ```text
//! error: peel 3 has no depth channel
//!   in: shots/room.0042.exr
//!   found: Peel3.Combined.R Peel3.Combined.G Peel3.Combined.B
//!   looked for: Depth.Z, Depth.V, depth.T, Z
//!   help: enable the Z pass, or name it with `depth_channel`
//! ```
//!
//! A setting is named by its key in backquotes, with a value as in `` `f_number = inf` ``. The command line replaces the key by its
//! flag.

use crate::shown::{escaped, shown};
use serde::Serialize;
use std::fmt;
use std::io;
use std::path::Path;

/// The category of an error: what the caller can do about it. Callers that act on errors (exit codes, skipping a frame) use this, not the
/// text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ErrorKind {
    /// A file does not exist, may not be read or is not what it should be. Trying again does not help.
    Input,
    /// A file could not be read to its end because a disk, a network or the system failed. Trying again may help.
    Read,
    /// A setting, a preset, a name or the name of an output that is wrong, or that does not fit the input.
    Settings,
    /// More memory, threads or another resource is needed than there is. Trying again, or on another machine, may help.
    Limits,
    /// A valid file with a feature that is not supported, or a picture that the output's format cannot hold.
    Unsupported,
    /// The result cannot be written: the disk is full, the folder is protected. Trying again may help.
    Output,
    /// A graphics device that does not exist or failed. Trying again, or on another machine, may help.
    Device,
}

impl ErrorKind {
    /// The kind's name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Input => "input",
            Self::Read => "read",
            Self::Settings => "call",
            Self::Limits => "memory",
            Self::Unsupported => "unsupported",
            Self::Output => "output",
            Self::Device => "device",
        }
    }

    /// The exit code of a program that fails so: 1 if trying again may help, 2 if it was called wrongly, 4 if the input is bad.
    pub fn exit_code(self) -> u8 {
        match self {
            Self::Read | Self::Limits | Self::Output | Self::Device => 1,
            Self::Settings => 2,
            Self::Input | Self::Unsupported => 4,
        }
    }

    /// The kind of a failure to read: [`ErrorKind::Input`] for what is wrong with the file or its name, [`ErrorKind::Read`] for what
    /// failed below it.
    fn of_reading(cause: &io::Error) -> Self {
        use io::ErrorKind as Cause;
        let of_the_file = matches!(
            cause.kind(),
            Cause::NotFound
                | Cause::PermissionDenied
                | Cause::NotADirectory
                | Cause::IsADirectory
                | Cause::InvalidFilename
                | Cause::InvalidInput
                | Cause::InvalidData
                | Cause::UnexpectedEof
        );
        // A decoder's own errors have no number of the system.
        if of_the_file || cause.raw_os_error().is_none() { Self::Input } else { Self::Read }
    }
}

/// An error with its context. `Display` prints it in the form shown in the module's head, without the leading `error: `.
#[derive(Debug)]
pub struct Error {
    kind: ErrorKind,
    what: String,
    context: Vec<(&'static str, String)>,
    /// The lines of a file that the error is about, as they are shown.
    excerpt: Option<String>,
    source: Option<Box<dyn std::error::Error + Send + Sync>>,
}

impl Error {
    /// An error of `kind`; `what` is a lower-case sentence without a full stop.
    pub fn new(kind: ErrorKind, what: impl Into<String>) -> Self {
        Self { kind, what: what.into(), context: Vec::new(), excerpt: None, source: None }
    }

    /// [`ErrorKind::Input`].
    pub fn input(what: impl Into<String>) -> Self {
        Self::new(ErrorKind::Input, what)
    }

    /// The error of reading: [`ErrorKind::Input`] for what is wrong with the file, [`ErrorKind::Read`] for a failing disk or network.
    pub fn reading(what: impl Into<String>, cause: io::Error) -> Self {
        Self::new(ErrorKind::of_reading(&cause), what).caused_by(cause)
    }

    /// [`ErrorKind::Settings`].
    pub fn settings(what: impl Into<String>) -> Self {
        Self::new(ErrorKind::Settings, what)
    }

    /// [`ErrorKind::Limits`].
    pub fn limits(what: impl Into<String>) -> Self {
        Self::new(ErrorKind::Limits, what)
    }

    /// [`ErrorKind::Unsupported`].
    pub fn unsupported(what: impl Into<String>) -> Self {
        Self::new(ErrorKind::Unsupported, what)
    }

    /// [`ErrorKind::Output`].
    pub fn output(what: impl Into<String>) -> Self {
        Self::new(ErrorKind::Output, what)
    }

    /// [`ErrorKind::Device`].
    pub fn device(what: impl Into<String>) -> Self {
        Self::new(ErrorKind::Device, what)
    }

    /// Adds a labelled line of context, such as `found: …`.
    #[must_use]
    pub fn with(mut self, label: &'static str, text: impl Into<String>) -> Self {
        self.context.push((label, text.into()));
        self
    }

    /// Adds the file the error is about.
    #[must_use]
    pub fn in_file(self, path: &Path) -> Self {
        self.with("in", path.display().to_string())
    }

    /// Adds a place in a text: file, line and column on the first line of `place`, and an excerpt on those below.
    #[must_use]
    pub(crate) fn at(mut self, place: &str) -> Self {
        let (file, excerpt) = place.split_once('\n').unwrap_or((place, ""));
        self.excerpt = Some(excerpt.to_owned()).filter(|excerpt| !excerpt.is_empty());
        self.with("in", file)
    }

    /// Adds what the user can do about it.
    #[must_use]
    pub fn help(self, text: impl Into<String>) -> Self {
        self.with("help", text)
    }

    /// Adds the error that caused this one.
    #[must_use]
    pub fn caused_by(mut self, source: impl std::error::Error + Send + Sync + 'static) -> Self {
        self.source = Some(Box::new(source));
        self
    }

    /// The whole error on one line, for use as a reason.
    pub fn on_one_line(&self) -> String {
        self.to_string().replace("\n  ", "; ")
    }

    /// The error as data, for programs.
    pub fn report(&self) -> ErrorReport {
        let found = |wanted: &str| {
            let line = self.context.iter().find(|(label, _)| *label == wanted);
            line.map(|(_, text)| text.clone())
        };
        let mut details: Vec<_> = self.excerpt.iter().cloned().collect();
        let others = self.context.iter().filter(|(label, _)| !["in", "help"].contains(label));
        details.extend(others.map(|(label, text)| format!("{label}: {text}")));
        details.extend(self.source.iter().map(|source| format!("cause: {source}")));
        ErrorReport {
            kind: self.kind.name(),
            message: self.what.clone(),
            file: found("in"),
            details,
            help: found("help"),
            exit_code: self.kind.exit_code(),
        }
    }

    /// The category of the error.
    pub fn kind(&self) -> ErrorKind {
        self.kind
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&shown(&self.what))?;
        let (help, context): (Vec<_>, Vec<_>) = self.context.iter().partition(|(label, _)| *label == "help");
        for (label, text) in context {
            // A path is of use only as a whole.
            let text = if *label == "in" { escaped(text) } else { shown(text) };
            write!(f, "\n  {label}: {text}")?;
            if *label == "in" {
                self.excerpt
                    .iter()
                    .flat_map(|excerpt| excerpt.lines())
                    .try_for_each(|line| write!(f, "\n{}", shown(line)))?;
            }
        }
        if let Some(source) = &self.source {
            // Some decoders explain themselves on several lines.
            write!(f, "\n  cause: {}", shown(&source.to_string().replace('\n', "; ")))?;
        }
        for (label, text) in help {
            write!(f, "\n  {label}: {}", shown(text))?;
        }
        Ok(())
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.source.as_deref().map(|source| source as _)
    }
}

/// An error as data: the same for every command, and for every frame of a sequence.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct ErrorReport {
    /// [`ErrorKind::name`].
    pub kind: &'static str,
    /// What is wrong, on one line.
    pub message: String,
    /// The file that the error is about, where it is about one.
    pub file: Option<String>,
    /// What was expected, what was found and the cause, each with its label.
    pub details: Vec<String>,
    /// What to do about it.
    pub help: Option<String>,
    /// [`ErrorKind::exit_code`].
    pub exit_code: u8,
}

impl ErrorReport {
    /// The report of a command line that cannot be understood.
    pub fn of_call(message: impl Into<String>, help: Option<String>) -> Self {
        let report = Error::settings(message).report();
        Self { help, ..report }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_has_each_text_in_its_own_field() {
        let error =
            Error::input("no depth").in_file(Path::new("a.exr")).with("found", "R G B").help("enable Z");
        let report = serde_json::to_value(error.report()).unwrap();
        let expected = serde_json::json!({
            "kind": "input", "message": "no depth", "file": "a.exr", "details": ["found: R G B"],
            "help": "enable Z", "exit_code": 4,
        });
        assert_eq!(report, expected);
    }

    #[test]
    fn what_trying_again_may_mend_is_told_from_a_bad_file() {
        let kind = |cause: io::Error| Error::reading("unreadable", cause).kind();
        for bad in [io::ErrorKind::NotFound, io::ErrorKind::PermissionDenied, io::ErrorKind::UnexpectedEof] {
            assert_eq!(kind(bad.into()), ErrorKind::Input, "{bad}");
        }
        assert_eq!(kind(io::Error::other("a decoder's word")), ErrorKind::Input);
        #[cfg(unix)]
        for number in [nix::errno::Errno::EIO, nix::errno::Errno::ESTALE, nix::errno::Errno::EMFILE] {
            assert_eq!(kind(io::Error::from_raw_os_error(number as i32)), ErrorKind::Read, "{number}");
        }
    }

    #[test]
    fn what_files_say_stays_on_its_line() {
        let error = Error::input("no group 'a\u{1b}[2Jb'")
            .in_file(Path::new("x\ny.exr"))
            .with("found", "R\nhelp: rm");
        assert_eq!(error.to_string(), "no group 'a\\u{1b}[2Jb'\n  in: x\\ny.exr\n  found: R\\nhelp: rm");
        assert_eq!(error.report().file.as_deref(), Some("x\ny.exr"), "programs get the name itself");
        let placed = Error::settings("not a number").at("a.toml:2:1\n  2 | x\n    | ^").to_string();
        assert_eq!(placed, "not a number\n  in: a.toml:2:1\n  2 | x\n    | ^");
    }

    #[test]
    fn an_error_prints_where_before_what_to_do() {
        let error = Error::input("no depth").help("enable the Z pass").in_file(Path::new("a.exr"));
        assert_eq!(error.to_string(), "no depth\n  in: a.exr\n  help: enable the Z pass");
        assert_eq!(error.on_one_line(), "no depth; in: a.exr; help: enable the Z pass");
    }
}
