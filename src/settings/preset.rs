//! Presets: a TOML file becomes a layer of [`Values`].

use super::{MethodParameters, Values};
use crate::error::Error;

/// A preset as read.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Preset {
    /// What it sets.
    pub values: Values,
    /// The `[method.NAME]` tables.
    pub parameters: MethodParameters,
}

/// A preset that ships inside the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BuiltIn {
    /// The name of `--preset`.
    pub name: &'static str,
    /// The TOML text.
    pub text: &'static str,
}

/// Every preset that ships inside the program.
pub static BUILT_IN: [BuiltIn; 0] = [];

impl Preset {
    /// Reads a preset from TOML; `source` names it in errors.
    ///
    /// # Errors
    /// A syntax error, an unknown key (with the nearest known one) or a value of the wrong type, each with its line.
    pub fn parse(text: &str, source: &str) -> Result<Self, Error> {
        let _ = (text, source);
        Err(Error::unsupported("presets are not written yet"))
    }
}
