//! Values with their origin.

use serde::Serialize;
use std::fmt;

/// The origin of a value.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase", tag = "from", content = "name")]
#[non_exhaustive]
pub enum Origin {
    /// The built-in default.
    Default,
    /// An attribute of the input's header.
    Header,
    /// A preset, by its name or file.
    Preset(String),
    /// A command-line flag.
    Flag,
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Default => f.write_str("default"),
            Self::Header => f.write_str("header"),
            Self::Preset(name) => write!(f, "preset {name}"),
            Self::Flag => f.write_str("flag"),
        }
    }
}

/// A value with its origin.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Sourced<T> {
    /// The value.
    pub value: T,
    /// Its origin.
    pub origin: Origin,
}

impl<T> Sourced<T> {
    /// A built-in default.
    pub(super) fn from_default(value: T) -> Self {
        Self { value, origin: Origin::Default }
    }

    /// The same value as that of an optional setting.
    pub(super) fn into_option(self) -> Sourced<Option<T>> {
        Sourced { value: Some(self.value), origin: self.origin }
    }
}
