//! What was concluded on the way, to be shown to the user: nothing guesses without saying so.

/// A conclusion with its reason.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
#[non_exhaustive]
pub struct Finding {
    /// What it is about: `depth`, `kind`, `peels` …
    pub about: &'static str,
    /// What was concluded, and why.
    pub text: String,
    /// Whether the user should look: shown as a warning.
    pub warning: bool,
}

impl Finding {
    /// A conclusion worth a line.
    pub fn note(about: &'static str, text: impl Into<String>) -> Self {
        Self { about, text: text.into(), warning: false }
    }

    /// A conclusion the user should look at.
    pub fn warning(about: &'static str, text: impl Into<String>) -> Self {
        Self { about, text: text.into(), warning: true }
    }
}
