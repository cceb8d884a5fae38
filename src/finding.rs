//! Conclusions that are reported to the user: every assumption about the input is one.

/// A conclusion with its reason.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
#[non_exhaustive]
pub struct Finding {
    /// Its subject: `depth`, `kind`, `peels` …
    pub about: &'static str,
    /// The conclusion and its reason.
    pub text: String,
    /// Whether it is printed as a warning.
    pub warning: bool,
}

impl Finding {
    /// A conclusion that is printed as a note.
    pub fn note(about: &'static str, text: impl Into<String>) -> Self {
        Self { about, text: text.into(), warning: false }
    }

    /// A conclusion that is printed as a warning.
    pub fn warning(about: &'static str, text: impl Into<String>) -> Self {
        Self { about, text: text.into(), warning: true }
    }
}
