//! The entries of a preset, each with its place in the text, so that an error shows the line.

use super::super::{Effort, Focus, FocusKey, ParameterValue, ParameterValues, Place, Values, nearest};
use super::schema::{FOCUS_KEY_PARTS, FocusKeyDraft, SCHEMA, known_keys, table_names};
use crate::error::Error;
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
    /// The entries of a table in the order of the file, so that its first mistake is the one reported.
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

    /// One of the `[[lens.focus_keys]]`, whose table is at `span`.
    fn focus_key(self, table: &'a DeTable<'a>, span: Range<usize>) -> Result<FocusKey, Error> {
        let mut draft = FocusKeyDraft::default();
        for entry in self.entries("lens.focus_keys", table) {
            let part = FOCUS_KEY_PARTS.iter().find(|part| part.name == entry.key);
            (part.ok_or_else(|| entry.unknown())?.set)(&mut draft, &entry)?;
        }
        let FocusKeyDraft { frame, focus, easing } = draft;
        let lacks = |what: &str, help: &str| {
            self.error(format!("a focus key has no {what}"), span.clone()).help(help)
        };
        let frame = frame.ok_or_else(|| lacks("frame", "say when: frame = 1"))?;
        let help = "say what is in focus: distance = 2.0, point = [x, y] or object = \"NAME\"";
        let focus = focus.ok_or_else(|| lacks("focus", help))?;
        Ok(FocusKey { frame, focus, easing })
    }

    /// An error about the bytes `span`.
    pub(super) fn error(self, what: impl Into<String>, span: Range<usize>) -> Error {
        Error::settings(what).with("in", self.place(span))
    }

    /// Where the bytes `span` are: file, line and column, the line itself, and carets under them.
    fn place(self, span: Range<usize>) -> String {
        let start = char_boundary(self.text, span.start);
        let line_start = self.text[..start].rfind('\n').map_or(0, |newline| newline + 1);
        let line_end = self.text[start..].find('\n').map_or(self.text.len(), |newline| start + newline);
        let line = self.text[..line_start].matches('\n').count() + 1;
        let before = &self.text[line_start..start];
        let end = char_boundary(self.text, span.end).clamp(start, line_end);
        // A tab stays a tab, so that the carets stand where the line does.
        let padding: String = before.chars().map(|c| if c == '\t' { '\t' } else { ' ' }).collect();
        let carets = "^".repeat(self.text[start..end].chars().count().max(1));
        let number = line.to_string();
        let margin = " ".repeat(number.len());
        format!(
            "{}:{line}:{}\n  {number} | {}\n  {margin} | {padding}{carets}",
            self.source,
            before.chars().count() + 1,
            self.text[line_start..line_end].trim_end(),
        )
    }
}

/// The last place of `text` up to `index` where a character starts.
fn char_boundary(text: &str, index: usize) -> usize {
    (0..=index.min(text.len())).rev().find(|&i| text.is_char_boundary(i)).unwrap_or(0)
}

/// One `key = value` of a preset with its place in the text.
pub(super) struct Entry<'a> {
    document: Document<'a>,
    table: &'a str,
    pub(super) key: &'a str,
    key_span: Range<usize>,
    value: &'a Spanned<DeValue<'a>>,
}

impl<'a> Entry<'a> {
    /// Checks the entry and keeps its value where it belongs.
    pub(super) fn read(&self, values: &mut Values, parameters: &mut ParameterValues) -> Result<(), Error> {
        if let Some(key) = SCHEMA.iter().find(|key| key.table == self.table && key.name == self.key) {
            return (key.set)(values, self);
        }
        if self.table != "method" || self.value.get_ref().as_table().is_none() {
            return Err(self.unknown());
        }
        let path = format!("method.{}", self.key);
        for entry in self.document.entries(&path, self.table()?) {
            parameters.push(entry.parameter(self));
        }
        Ok(())
    }

    /// The entry as a parameter of `method`, not yet checked.
    fn parameter(&self, method: &Entry<'_>) -> ParameterValue {
        let place = |span: Range<usize>| self.document.place(span);
        ParameterValue {
            method: method.key.to_owned(),
            key: self.key.to_owned(),
            value: json(self.value.get_ref()),
            place: Some(Place {
                method: place(method.key_span.clone()),
                key: place(self.key_span.clone()),
                value: place(self.value.span()),
            }),
        }
    }

    pub(super) fn unknown(&self) -> Error {
        let place = if self.table.is_empty() { String::new() } else { format!(" in [{}]", self.table) };
        let known = known_keys(self.table);
        // `focus_distance` among focus keys is their `distance`.
        let short = known.iter().find(|known| self.key.strip_suffix(known.as_str()) == Some("focus_"));
        let help = if let Some(short) = short {
            format!("did you mean '{short}'?")
        } else if let Some(key) = SCHEMA.iter().find(|key| key.name == self.key) {
            format!("'{}' belongs in [{}]", self.key, key.table)
        } else if let Some(near) = nearest(self.key, &known) {
            format!("did you mean '{near}'?")
        } else if self.table.is_empty() {
            format!("the tables are [{}]", known.join("], ["))
        } else {
            format!("the keys of [{}] are {}", self.table, known.join(", "))
        };
        self.document.error(format!("unknown key '{}'{place}", self.key), self.key_span.clone()).help(help)
    }

    /// The error for a value that is not `wanted`.
    fn unsuitable(&self, wanted: &str) -> Error {
        self.document.error(format!("'{}' must be {wanted}", self.key), self.value.span())
    }

    pub(super) fn table(&self) -> Result<&'a DeTable<'a>, Error> {
        let name =
            if self.table.is_empty() { self.key.to_owned() } else { format!("{}.{}", self.table, self.key) };
        let table = self.value.get_ref().as_table();
        table.ok_or_else(|| {
            // A key of a table, written above all tables, is the likelier mistake.
            let misplaced = self.table.is_empty() && !table_names().contains(&self.key);
            if misplaced { self.unknown() } else { self.unsuitable(&format!("a table, [{name}]")) }
        })
    }

    pub(super) fn text(&self) -> Result<&'a str, Error> {
        self.value.get_ref().as_str().ok_or_else(|| self.unsuitable("a text in quotes"))
    }

    /// A whole number of at least `least`.
    fn whole(&self, least: u32, wanted: &str) -> Result<u32, Error> {
        let number = match self.value.get_ref() {
            DeValue::Integer(digits) => u32::from_str_radix(digits.as_str(), digits.radix()).ok(),
            _ => None,
        };
        let wanted = || self.unsuitable(&format!("a whole number, {wanted}"));
        number.filter(|&number| number >= least).ok_or_else(wanted)
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
        self.whole(1, "1 or more").map(|count| count as usize)
    }

    pub(super) fn blades(&self) -> Result<u32, Error> {
        let wanted = "0 for a disc or at least 3";
        let blades = self.whole(0, wanted)?;
        if matches!(blades, 1 | 2) {
            Err(self.unsuitable(&format!("a whole number, {wanted}")))
        } else {
            Ok(blades)
        }
    }

    pub(super) fn positive(&self) -> Result<f32, Error> {
        self.number_where("a positive number", |x| x > 0.0 && x.is_finite())
    }

    pub(super) fn positive_or_inf(&self) -> Result<f32, Error> {
        self.number_where("a positive number, or inf", |x| x > 0.0)
    }

    pub(super) fn not_negative(&self) -> Result<f32, Error> {
        self.number_where("a number, 0 or more", |x| x >= 0.0 && x.is_finite())
    }

    /// A number from the first to the second of `ends`.
    pub(super) fn within(&self, [least, most]: [f32; 2], meaning: &str) -> Result<f32, Error> {
        let wanted = format!("a number from {least} to {most}: {meaning}");
        self.number_where(&wanted, |x| (least..=most).contains(&x))
    }

    /// Two numbers from the first to the second of `ends`.
    pub(super) fn pair(&self, [least, most]: [f32; 2], meaning: &str) -> Result<[f32; 2], Error> {
        let wanted = format!("two numbers from {least} to {most}: {meaning}");
        self.two_numbers(&wanted, |x| (least..=most).contains(&x))
    }

    pub(super) fn finite(&self) -> Result<f32, Error> {
        self.number_where("a number", f32::is_finite)
    }

    /// A number, whole or not, that satisfies `suits`.
    fn number_where(&self, wanted: &str, suits: impl Fn(f32) -> bool) -> Result<f32, Error> {
        number(self.value.get_ref()).filter(|&x| suits(x)).ok_or_else(|| self.unsuitable(wanted))
    }

    pub(super) fn point(&self) -> Result<[f32; 2], Error> {
        self.two_numbers("a pixel, [x, y]", f32::is_finite)
    }

    /// A list of two numbers that satisfy `suits`.
    fn two_numbers(&self, wanted: &str, suits: impl Fn(f32) -> bool) -> Result<[f32; 2], Error> {
        let wanted = || self.unsuitable(wanted);
        let items = self.value.get_ref().as_array().ok_or_else(wanted)?;
        let numbers: Vec<f32> =
            items.iter().filter_map(|item| number(item.get_ref())).filter(|&x| suits(x)).collect();
        let point = numbers.try_into().map_err(|_| wanted())?;
        if items.len() == 2 { Ok(point) } else { Err(wanted()) }
    }

    /// Keeps `focus`, unless another key has set one.
    pub(super) fn focus(&self, values: &mut Values, focus: Focus) -> Result<(), Error> {
        if values.focus.is_some() {
            let what = "'focus_distance', 'focus_point', 'focus_object' and 'focus_keys' exclude one another";
            return Err(self.document.error(what, self.key_span.clone()).help("keep one of them"));
        }
        values.focus = Some(focus);
        Ok(())
    }

    /// Keeps what `key` focuses on, unless another line has said it.
    pub(super) fn key_focus(&self, key: &mut FocusKeyDraft, focus: Focus) -> Result<(), Error> {
        if key.focus.is_some() {
            let what = "'distance', 'point' and 'object' exclude one another";
            let help = "keep one of them, or make another [[lens.focus_keys]] of it";
            return Err(self.document.error(what, self.key_span.clone()).help(help));
        }
        key.focus = Some(focus);
        Ok(())
    }

    /// A list of what is in focus at which frame.
    pub(super) fn focus_keys(&self) -> Result<Vec<FocusKey>, Error> {
        let wanted = "at least one table, [[lens.focus_keys]]";
        let items = self.value.get_ref().as_array().filter(|items| !items.is_empty());
        let items = items.ok_or_else(|| self.unsuitable(wanted))?;
        let mut keys: Vec<FocusKey> = Vec::new();
        for item in items {
            let table = item.get_ref().as_table().ok_or_else(|| self.unsuitable(wanted))?;
            let key = self.document.focus_key(table, item.span())?;
            if let Some(last) = keys.last().filter(|last| last.frame >= key.frame) {
                let what = format!("frame {} comes after frame {}", key.frame, last.frame);
                let help = "put the focus keys in rising order of frame, each frame once";
                return Err(self.document.error(what, item.span()).help(help));
            }
            keys.push(key);
        }
        Ok(keys)
    }

    /// Keeps `effort`, unless another key has set one.
    pub(super) fn effort(&self, values: &mut Values, effort: Effort) -> Result<(), Error> {
        if values.effort.is_some() {
            let what = "'views', 'target_db', 'time_budget_s' and 'quality' exclude one another";
            return Err(self.document.error(what, self.key_span.clone()).help("keep one of them"));
        }
        values.effort = Some(effort);
        Ok(())
    }

    pub(super) fn decibels(&self) -> Result<f64, Error> {
        let [least, most] = Effort::TARGETS_DB;
        let wanted = format!("a number of decibels from {least} to {most}");
        self.number_where(&wanted, |x| (least..=most).contains(&f64::from(x))).map(f64::from)
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

/// A parameter's value: a flag, a number, a list of numbers, `null` for the text "auto"; a text for what no parameter can be.
fn json(value: &DeValue<'_>) -> Json {
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
