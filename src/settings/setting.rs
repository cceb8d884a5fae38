//! The declaration of a setting: its names, unit, range, default and description.
//!
//! [`super::SETTINGS`] has all of them. A value is checked against its setting in [`Setting::check`] and nowhere else.

use crate::error::Error;
use std::fmt;
use std::path::PathBuf;

/// One setting: a row of [`super::SETTINGS`].
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct Setting {
    /// Its key in the library, which errors and findings use in backquotes.
    pub key: &'static str,
    /// The field of [`super::Values`] that holds it. Settings of one field exclude one another.
    pub field: &'static str,
    /// Its table in a preset.
    pub table: &'static str,
    /// Its key in that table.
    pub preset_key: &'static str,
    /// Its name in words.
    pub name: &'static str,
    /// Its unit, such as `mm`; empty for a number without a unit.
    pub unit: &'static str,
    /// The values that it accepts.
    pub kind: Kind,
    /// The meaning of its numbers, where the unit does not give it; may be empty.
    pub scale: &'static str,
    /// Its attribute in file headers.
    pub attribute: Option<&'static str>,
    /// How it is set on a command line.
    pub command_line: CommandLine,
    /// What applies where it is not set and has no default value; may be empty.
    pub otherwise: &'static str,
    pub(super) text: &'static str,
    pub(super) default: fn() -> Option<Value>,
}

/// How a setting is set on a command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CommandLine {
    /// By a flag.
    Flag {
        /// The flag without its dashes.
        name: &'static str,
        /// The name of its value in the help.
        value_name: &'static str,
    },
    /// It has no flag, for this reason.
    Never(&'static str),
}

/// The value of any setting.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// A number.
    Number(f32),
    /// Two numbers.
    Pair([f32; 2]),
    /// A whole number.
    Whole(u32),
    /// One of the words of its setting.
    Word(&'static str),
    /// A name that the user chooses.
    Name(String),
    /// The path of a file.
    File(PathBuf),
}

/// The values that a setting accepts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// A number.
    Number(Range),
    /// A number for red and one for blue.
    RedBlue(Range),
    /// A position in the picture, in pixels from the left and from the top.
    Pixel,
    /// A whole number from the first to the second.
    Whole(u32, u32),
    /// A number of things, or 0 with a meaning of its own.
    Count {
        /// The meaning of 0.
        zero: &'static str,
        /// The smallest number other than 0.
        min: u32,
        /// The largest number.
        max: u32,
        /// The things that are counted.
        of: &'static str,
    },
    /// One of these words.
    Word(&'static [Word]),
    /// A name that the user chooses.
    Name,
    /// The path of a file.
    File,
}

/// The numbers that a setting accepts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Range {
    /// Any finite number.
    Any,
    /// A finite number above 0.
    Positive,
    /// A number above 0, or infinity.
    PositiveOrInfinite,
    /// A finite number, 0 or more.
    NotNegative,
    /// A number from the first to the second.
    Within(f32, f32),
}

/// One of the words that a setting accepts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Word {
    /// The word as presets and headers write it.
    pub name: &'static str,
    /// Its meaning; empty where the word or its setting explains it.
    pub meaning: &'static str,
}

impl Range {
    /// Whether the range contains `number`.
    pub fn contains(self, number: f32) -> bool {
        match self {
            Self::Any => number.is_finite(),
            Self::Positive => number > 0.0 && number.is_finite(),
            Self::PositiveOrInfinite => number > 0.0,
            Self::NotNegative => number >= 0.0 && number.is_finite(),
            Self::Within(min, max) => (min..=max).contains(&number),
        }
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Any => f.write_str("any number"),
            Self::Positive => f.write_str("above 0"),
            Self::PositiveOrInfinite => f.write_str("above 0, or inf"),
            Self::NotNegative => f.write_str("0 or more"),
            Self::Within(min, max) => write!(f, "{min} to {max}"),
        }
    }
}

impl Kind {
    /// Whether `value` is of this kind and within its range.
    pub fn allows(&self, value: &Value) -> bool {
        match (self, value) {
            (Self::Number(range), Value::Number(number)) => range.contains(*number),
            (Self::RedBlue(range), Value::Pair(pair)) => pair.iter().all(|number| range.contains(*number)),
            (Self::Pixel, Value::Pair(pair)) => pair.iter().all(|number| Range::Any.contains(*number)),
            (Self::Whole(min, max), Value::Whole(number)) => (min..=max).contains(&number),
            (Self::Count { min, max, .. }, Value::Whole(number)) => {
                *number == 0 || (min..=max).contains(&number)
            }
            (Self::Word(words), Value::Word(name)) => words.iter().any(|word| word.name == *name),
            (Self::Name, Value::Name(_)) | (Self::File, Value::File(_)) => true,
            _ => false,
        }
    }

    /// The range in a few words; `None` for a kind without one.
    pub fn range(&self) -> Option<String> {
        match self {
            Self::Number(range) | Self::RedBlue(range) => Some(range.to_string()),
            Self::Whole(min, max) => Some(format!("{min} to {max}")),
            Self::Count { min, max, .. } => Some(format!("0, or {min} to {max}")),
            Self::Pixel => Some("within the picture".to_owned()),
            Self::Word(words) => Some(words.iter().map(|word| word.name).collect::<Vec<_>>().join(", ")),
            Self::Name | Self::File => None,
        }
    }

    /// The kind in words, as in "must be …".
    pub(super) fn in_words(&self) -> String {
        match self {
            Self::Number(Range::Any) => "a number".to_owned(),
            Self::Number(Range::Positive) => "a positive number".to_owned(),
            Self::Number(Range::PositiveOrInfinite) => "a positive number, or inf".to_owned(),
            Self::Number(Range::NotNegative) => "a number, 0 or more".to_owned(),
            Self::Number(Range::Within(min, max)) => format!("a number from {min} to {max}"),
            Self::RedBlue(Range::Within(min, max)) => format!("two numbers from {min} to {max}"),
            Self::RedBlue(range) => format!("two numbers, each {range}"),
            Self::Pixel => "a pixel, [x, y]".to_owned(),
            Self::Whole(min, max) => format!("a whole number from {min} to {max}"),
            Self::Count { zero, min, max, of } => format!("0 for a {zero}, or from {min} to {max} {of}"),
            Self::Word(_) => format!("one of {}", self.range().unwrap_or_default()),
            Self::Name => "a name".to_owned(),
            Self::File => "the path of a file".to_owned(),
        }
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => number.fmt(f),
            Self::Pair([first, second]) => write!(f, "{first},{second}"),
            Self::Whole(number) => number.fmt(f),
            Self::Word(word) => f.write_str(word),
            Self::Name(name) => f.write_str(name),
            Self::File(path) => path.display().fmt(f),
        }
    }
}

impl Setting {
    /// A setting of `kind` with empty optional parts, for the methods below to fill. The table adds key, accessors and text.
    pub(super) const fn new(kind: Kind, name: &'static str) -> Self {
        Self {
            key: "",
            field: "",
            table: "",
            preset_key: "",
            name,
            unit: "",
            kind,
            scale: "",
            attribute: None,
            command_line: CommandLine::Never(""),
            otherwise: "",
            text: "",
            default: || None,
        }
    }

    /// With a unit.
    pub(super) const fn unit(self, unit: &'static str) -> Self {
        Self { unit, ..self }
    }

    /// With the meaning of its numbers.
    pub(super) const fn scale(self, scale: &'static str) -> Self {
        Self { scale, ..self }
    }

    /// With an attribute of headers.
    pub(super) const fn attribute(self, name: &'static str) -> Self {
        Self { attribute: Some(name), ..self }
    }

    /// With a flag.
    pub(super) const fn flag(self, name: &'static str, value_name: &'static str) -> Self {
        Self { command_line: CommandLine::Flag { name, value_name }, ..self }
    }

    /// Without a flag, for this reason.
    pub(super) const fn no_flag(self, reason: &'static str) -> Self {
        Self { command_line: CommandLine::Never(reason), ..self }
    }

    /// With another key in presets than in the library.
    pub(super) const fn preset_key(self, key: &'static str) -> Self {
        Self { preset_key: key, ..self }
    }

    /// With what applies where it is not set.
    pub(super) const fn otherwise(self, words: &'static str) -> Self {
        Self { otherwise: words, ..self }
    }

    /// What it does, in one line without a full stop.
    pub fn summary(&self) -> String {
        self.paragraphs().next().unwrap_or_default()
    }

    /// Further paragraphs about it.
    pub fn details(&self) -> Vec<String> {
        self.paragraphs().skip(1).collect()
    }

    fn paragraphs(&self) -> impl Iterator<Item = String> {
        self.text.split("\n\n").map(|lines| lines.split_whitespace().collect::<Vec<_>>().join(" "))
    }

    /// Its default value; `None` if it has none: see [`Self::otherwise`].
    pub fn default_value(&self) -> Option<Value> {
        (self.default)()
    }

    /// The default in words: the default value, or what applies where the setting is not set.
    pub fn default_in_words(&self) -> String {
        self.default_value().map_or_else(|| self.otherwise.to_owned(), |value| value.to_string())
    }

    /// The expected value, as in "must be …".
    pub fn expected(&self) -> String {
        let kind = self.kind.in_words();
        if self.scale.is_empty() { kind } else { format!("{kind}: {}", self.scale) }
    }

    /// `value` with its unit.
    pub fn in_words(&self, value: &Value) -> String {
        let text = match (self.kind, value) {
            (Kind::RedBlue(_), Value::Pair([red, blue])) => format!("red {red}, blue {blue}"),
            (Kind::Count { zero, .. }, Value::Whole(0)) => zero.to_owned(),
            _ => value.to_string(),
        };
        match self.unit {
            "" => text,
            "°" => format!("{text}°"),
            unit => format!("{text} {unit}"),
        }
    }

    /// Checks that it accepts `value`.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Settings`] if it does not, with the expected value.
    pub fn check(&self, value: &Value) -> Result<(), Error> {
        if self.kind.allows(value) {
            return Ok(());
        }
        let what = format!("`{}` must be {}", self.key, self.expected());
        let error = Error::settings(what).with("found", value.to_string());
        Err(match self.remedy(value) {
            Some(help) => error.help(help),
            None => error,
        })
    }
}

/// A type that a field of [`super::Values`] may have.
pub(super) trait SettingType: Sized {
    /// Converts it to the value of any setting.
    fn to_value(&self) -> Value;
    /// Converts such a value; `None` for a value of another type.
    fn from_value(value: &Value) -> Option<Self>;
}

/// Implements [`SettingType`] for the types in the variants of [`Value`].
macro_rules! setting_types {
    ($($type:ty: $variant:ident),+) => { $(
        impl SettingType for $type {
            fn to_value(&self) -> Value {
                Value::$variant(self.clone())
            }

            fn from_value(value: &Value) -> Option<Self> {
                match value {
                    Value::$variant(value) => Some(value.clone()),
                    _ => None,
                }
            }
        }
    )+ };
}

setting_types! { f32: Number, [f32; 2]: Pair, u32: Whole, String: Name, PathBuf: File }

impl SettingType for usize {
    fn to_value(&self) -> Value {
        Value::Whole(u32::try_from(*self).unwrap_or(u32::MAX))
    }

    fn from_value(value: &Value) -> Option<Self> {
        u32::from_value(value).and_then(|number| Self::try_from(number).ok())
    }
}
