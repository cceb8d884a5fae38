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

use std::fmt;
use std::path::Path;

/// The category of an error. Callers that act on errors (exit codes, skipping a frame) use this, not the text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ErrorKind {
    /// A file cannot be opened, read or interpreted.
    Input,
    /// A lens, preset or setting that is invalid.
    Settings,
    /// The input exceeds a limit.
    Limits,
    /// A valid file with an unsupported feature.
    Unsupported,
    /// The result cannot be written.
    Output,
    /// A graphics device that does not exist or failed.
    Device,
}

/// An error with its context. `Display` prints it in the form shown in the module's head, without the leading `error: `.
#[derive(Debug)]
pub struct Error {
    kind: ErrorKind,
    what: String,
    context: Vec<(&'static str, String)>,
    source: Option<Box<dyn std::error::Error + Send + Sync>>,
}

impl Error {
    /// An error of `kind`; `what` is a lower-case sentence without a full stop.
    pub fn new(kind: ErrorKind, what: impl Into<String>) -> Self {
        Self { kind, what: what.into(), context: Vec::new(), source: None }
    }

    /// [`ErrorKind::Input`].
    pub fn input(what: impl Into<String>) -> Self {
        Self::new(ErrorKind::Input, what)
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

    /// The category of the error.
    pub fn kind(&self) -> ErrorKind {
        self.kind
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.what)?;
        let (help, context): (Vec<_>, Vec<_>) = self.context.iter().partition(|(label, _)| *label == "help");
        for (label, text) in context {
            write!(f, "\n  {label}: {text}")?;
        }
        if let Some(source) = &self.source {
            write!(f, "\n  cause: {source}")?;
        }
        for (label, text) in help {
            write!(f, "\n  {label}: {text}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.source.as_deref().map(|source| source as _)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_prints_where_before_what_to_do() {
        let error = Error::input("no depth").help("enable the Z pass").in_file(Path::new("a.exr"));
        assert_eq!(error.to_string(), "no depth\n  in: a.exr\n  help: enable the Z pass");
        assert_eq!(error.on_one_line(), "no depth; in: a.exr; help: enable the Z pass");
    }
}
