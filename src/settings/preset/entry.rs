//! The entries of a preset, each with its location in the text, so that errors show the line. The schema is not known here.

use super::super::{Effort, Kind, Setting, Value, Written, nearest};
use crate::error::Error;
use crate::shown::escaped;
use serde_json::Value as Json;
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// The text of a preset and its name.
#[derive(Clone, Copy)]
pub(super) struct Document<'a> {
    pub(super) text: &'a str,
    pub(super) source: &'a str,
}

impl<'a> Document<'a> {
    /// The entries of a table in the order of the file, so that the first mistake is the one reported.
    pub(super) fn entries(self, table: &'a str, content: &'a DeTable<'a>) -> Vec<Entry<'a>> {
        let mut entries: Vec<_> = content
            .iter()
            .map(|(key, value)| Entry {
                document: self,
                table,
                key: key.get_ref(),
                key_span: key.span(),
                value,
            })
            .collect();
        entries.sort_by_key(|entry| entry.key_span.start);
        entries
    }

    /// An error about the bytes `span`.
    pub(super) fn error(self, what: impl Into<String>, span: Range<usize>) -> Error {
        Error::settings(what).at(&self.place(span))
    }

    /// The location of the bytes `span`: file, line and column, the line itself, and carets under them.
    pub(super) fn place(self, span: Range<usize>) -> String {
        let start = char_boundary(self.text, span.start);
        let line_start = self.text[..start].rfind('\n').map_or(0, |newline| newline + 1);
        let line_end = self.text[start..].find('\n').map_or(self.text.len(), |newline| start + newline);
        let line = self.text[..line_start].matches('\n').count() + 1;
        let before = &self.text[line_start..start];
        let end = char_boundary(self.text, span.end).clamp(start, line_end);
        // Tabs are kept, so that the carets align with the line above.
        let padding: String = before.chars().map(|c| if c == '\t' { '\t' } else { ' ' }).collect();
        let carets = "^".repeat(self.text[start..end].chars().count().max(1));
        let number = line.to_string();
        let margin = " ".repeat(number.len());
        format!(
            "{}:{line}:{}\n  {number} | {}\n  {margin} | {padding}{carets}",
            escaped(self.source),
            before.chars().count() + 1,
            self.text[line_start..line_end].trim_end(),
        )
    }
}

/// The largest index of `text` up to `index` at which a character starts.
fn char_boundary(text: &str, index: usize) -> usize {
    (0..=index.min(text.len())).rev().find(|&i| text.is_char_boundary(i)).unwrap_or(0)
}

/// One `key = value` of a preset with its location in the text.
pub(super) struct Entry<'a> {
    pub(super) document: Document<'a>,
    pub(super) table: &'a str,
    pub(super) key: &'a str,
    pub(super) key_span: Range<usize>,
    pub(super) value: &'a Spanned<DeValue<'a>>,
}

impl<'a> Entry<'a> {
    /// The error for a value that is not the `expected` one.
    pub(super) fn unsuitable(&self, expected: &str) -> Error {
        self.document.error(format!("'{}' must be {expected}", self.key), self.value.span())
    }

    pub(super) fn text(&self) -> Result<&'a str, Error> {
        self.value.get_ref().as_str().ok_or_else(|| self.unsuitable("a text in quotes"))
    }

    /// A list of texts.
    pub(super) fn names(&self) -> Result<Vec<String>, Error> {
        let items = self.value.get_ref().as_array();
        let names = items.and_then(|items| {
            let name = |item: &Spanned<DeValue<'_>>| item.get_ref().as_str().map(str::to_owned);
            items.iter().map(name).collect()
        });
        names.ok_or_else(|| self.unsuitable("a list of texts in quotes"))
    }

    /// A whole number, 0 or more.
    fn natural(&self) -> Option<u32> {
        match self.value.get_ref() {
            DeValue::Integer(digits) => u32::from_str_radix(digits.as_str(), digits.radix()).ok(),
            _ => None,
        }
    }

    /// A whole number, negative or not.
    pub(super) fn integer(&self) -> Result<i64, Error> {
        let number = match self.value.get_ref() {
            DeValue::Integer(digits) => i64::from_str_radix(digits.as_str(), digits.radix()).ok(),
            _ => None,
        };
        number.ok_or_else(|| self.unsuitable("a whole number"))
    }

    pub(super) fn count(&self) -> Result<usize, Error> {
        let count = self.natural().filter(|&count| count > 0);
        count.map(|count| count as usize).ok_or_else(|| self.unsuitable("a whole number, 1 or more"))
    }

    /// A number, whole or not, that satisfies `is_valid`.
    fn number_where(&self, expected: &str, is_valid: impl Fn(f32) -> bool) -> Result<f32, Error> {
        number(self.value.get_ref()).filter(|&x| is_valid(x)).ok_or_else(|| self.unsuitable(expected))
    }

    /// A list of two numbers.
    fn two_numbers(&self) -> Option<[f32; 2]> {
        let items = self.value.get_ref().as_array()?;
        let numbers: Option<Vec<f32>> = items.iter().map(|item| number(item.get_ref())).collect();
        numbers?.try_into().ok()
    }

    /// A value that `setting` allows; a number may be a text with a unit.
    pub(super) fn written(&self, setting: &Setting) -> Result<Written, Error> {
        let (Kind::Number(_), Some(text)) = (setting.kind, self.value.get_ref().as_str()) else {
            return Ok(Written { value: self.setting(setting)?, in_metres: false });
        };
        let written =
            setting.parse_number(text).map_err(|error| error.at(&self.document.place(self.value.span())))?;
        if setting.kind.allows(&written.value) {
            Ok(written)
        } else {
            Err(self.refused(setting, &written.value))
        }
    }

    /// The error for a value that `setting` does not allow.
    fn refused(&self, setting: &Setting, value: &Value) -> Error {
        let error = self.unsuitable(&setting.expected());
        match setting.remedy(value) {
            Some(help) => error.help(help),
            None => error,
        }
    }

    /// A value that `setting` allows.
    pub(super) fn setting(&self, setting: &Setting) -> Result<Value, Error> {
        let value = match setting.kind {
            Kind::Number(_) => number(self.value.get_ref()).map(Value::Number),
            Kind::RedBlue(_) | Kind::Pixel => self.two_numbers().map(Value::Pair),
            Kind::Whole(..) | Kind::Count { .. } => self.natural().map(Value::Whole),
            Kind::Word(words) => {
                let names: Vec<_> = words.iter().map(|word| (word.name, word.name)).collect();
                Some(Value::Word(self.one_of(&names)?))
            }
            Kind::Name => Some(Value::Name(self.text()?.to_owned())),
            Kind::File => {
                Some(self.text()?).filter(|path| !path.is_empty()).map(|path| Value::File(path.into()))
            }
        };
        match value {
            Some(value) if setting.kind.allows(&value) => Ok(value),
            Some(value) => Err(self.refused(setting, &value)),
            None => Err(self.unsuitable(&setting.expected())),
        }
    }

    /// A positive number.
    pub(super) fn positive(&self) -> Result<f32, Error> {
        self.number_where("a positive number", |x| x > 0.0 && x.is_finite())
    }

    pub(super) fn decibels(&self) -> Result<f64, Error> {
        let [min, max] = Effort::TARGETS_DB;
        let expected = format!("a number of decibels from {min} to {max}");
        self.number_where(&expected, |x| (min..=max).contains(&f64::from(x))).map(f64::from)
    }

    pub(super) fn one_of<T: Copy>(&self, choices: &[(&str, T)]) -> Result<T, Error> {
        let names: Vec<&str> = choices.iter().map(|(name, _)| *name).collect();
        let text = self.text()?;
        let found = choices.iter().find(|(name, _)| *name == text);
        found.map(|(_, choice)| *choice).ok_or_else(|| {
            let error = self.unsuitable(&format!("one of {}", names.join(", ")));
            match nearest(text, &names) {
                Some(near) => error.help(format!("did you mean '{near}'?")),
                None => error,
            }
        })
    }
}

/// A parameter's value: a flag, a number, a list of numbers, `null` for the text "auto"; a text for a value that no parameter accepts.
pub(super) fn json(value: &DeValue<'_>) -> Json {
    let known = match value {
        DeValue::Boolean(flag) => Some(Json::from(*flag)),
        DeValue::Integer(digits) => i64::from_str_radix(digits.as_str(), digits.radix()).ok().map(Json::from),
        DeValue::Float(digits) => digits.as_str().parse::<f64>().ok().map(Json::from),
        DeValue::String(text) if text == "auto" => Some(Json::Null),
        DeValue::Array(items) => Some(items.iter().map(|item| json(item.get_ref())).collect()),
        DeValue::String(_) | DeValue::Table(_) | DeValue::Datetime(_) => None,
    };
    known.unwrap_or_else(|| Json::from("another kind of value"))
}

fn number(value: &DeValue<'_>) -> Option<f32> {
    match value {
        DeValue::Integer(digits) => {
            i64::from_str_radix(digits.as_str(), digits.radix()).ok().map(|x| x as f32)
        }
        DeValue::Float(digits) => digits.as_str().parse().ok(),
        _ => None,
    }
}
