//! The schema of presets: the settings of [`SETTINGS`], the keys of [`OTHERS`], and the `[method.NAME]` tables, which the
//! methods declare and check, so that a new method needs no change here.

use super::super::{
    Effort, Focus, KEYED, KeyedSetting, ParameterValue, ParameterValues, Place, Quality, SETTINGS, Setting,
    Switches, Values, nearest,
};
use super::entry::{Entry, json};
use super::keys::{FOCUS_KEY_PARTS, FOCUS_KEYS, NUMBER_KEY_PARTS, focus_keys, number_keys};
use crate::error::Error;
use std::ops::Range;
use toml::de::DeTable;

/// A key of presets: its table, its name, and how its value is checked and stored.
struct Key {
    table: &'static str,
    name: &'static str,
    set: fn(&mut Values, &Entry<'_>) -> Result<(), Error>,
}

/// Every key outside the `[method.NAME]` tables that is not in [`SETTINGS`].
static OTHERS: [Key; 8] = {
    const fn key(
        table: &'static str,
        name: &'static str,
        set: fn(&mut Values, &Entry<'_>) -> Result<(), Error>,
    ) -> Key {
        Key { table, name, set }
    }
    [
        key("lens", "focus_keys", |v, e| {
            e.first_focus(v)?;
            focus_keys(e, |part| part.unknown()).map(|keys| v.focus = Some(Focus::Keys(keys)))
        }),
        key("effects", "force", |v, e| e.names().map(|names| switches(v).force = names)),
        key("effects", "without", |v, e| e.names().map(|names| switches(v).without = names)),
        key("method", "name", |v, e| e.text().map(|x| v.method = Some(x.to_owned()))),
        key("method", "views", |v, e| e.effort(v, Effort::Views(e.count()?))),
        key("method", "target_db", |v, e| e.effort(v, Effort::TargetDb(e.decibels()?))),
        key("method", "time_budget_s", |v, e| e.effort(v, Effort::TimeBudget(e.positive()?.into()))),
        key("method", "quality", |v, e| {
            e.effort(v, Effort::Quality(e.one_of(&Quality::ALL.map(|quality| (quality.name(), quality)))?))
        }),
    ]
};

fn switches(values: &mut Values) -> &mut Switches {
    values.switches.get_or_insert_with(Switches::default)
}

/// The setting with the key `key` in `table`.
fn setting(table: &str, key: &str) -> Option<&'static Setting> {
    SETTINGS.iter().find(|setting| setting.table == table && setting.preset_key == key)
}

/// Every key outside the `[method.NAME]` tables, with its table.
fn keys() -> impl Iterator<Item = (&'static str, &'static str)> {
    let settings = SETTINGS.iter().map(|setting| (setting.table, setting.preset_key));
    let lists = KEYED.iter().map(|keyed| ("lens", keyed.list));
    settings.chain(lists).chain(OTHERS.iter().map(|key| (key.table, key.name)))
}

impl<'a> Entry<'a> {
    /// Checks the entry and stores its value in `values` or `parameters`.
    pub(super) fn read(&self, values: &mut Values, parameters: &mut ParameterValues) -> Result<(), Error> {
        if let Some(setting) = setting(self.table, self.key) {
            return self.read_setting(setting, values);
        }
        if let Some(keyed) = KEYED.iter().find(|keyed| self.table == "lens" && keyed.list == self.key) {
            return self.read_keys(keyed, values);
        }
        if let Some(key) = OTHERS.iter().find(|key| key.table == self.table && key.name == self.key) {
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

    /// Checks the value of `setting` and stores it.
    fn read_setting(&self, setting: &'static Setting, values: &mut Values) -> Result<(), Error> {
        let written = self.written(setting)?;
        if setting.field == "focus" {
            self.first_focus(values)?;
        }
        if let Some(keyed) = KEYED.iter().find(|keyed| keyed.key == setting.key) {
            self.number_or_keys(keyed, values)?;
        }
        values.set_written(setting, &written);
        Ok(())
    }

    /// Checks the list of keys of `keyed` and stores it.
    fn read_keys(&self, keyed: &KeyedSetting, values: &mut Values) -> Result<(), Error> {
        self.number_or_keys(keyed, values)?;
        let keys = number_keys(self, keyed, |part| part.unknown())?;
        *(keyed.keys_mut)(values) = Some(keys);
        Ok(())
    }

    /// Checks that no other entry has set `keyed` or its keys.
    fn number_or_keys(&self, keyed: &KeyedSetting, values: &Values) -> Result<(), Error> {
        if (keyed.keys)(values).is_none() && keyed.setting().get(values).is_none() {
            return Ok(());
        }
        let what = format!("'{}' and '{}' exclude one another", keyed.key, keyed.list);
        Err(self.document.error(what, self.key_span.clone()).help("keep one of them"))
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
        } else if let Some((table, key)) = keys().find(|(_, key)| *key == self.key) {
            format!("'{key}' belongs in [{table}]")
        } else if let Some(near) = nearest(self.key, &known) {
            format!("did you mean '{near}'?")
        } else if self.table.is_empty() {
            format!("the tables are [{}]", known.join("], ["))
        } else if self.table == "method" {
            format!(
                "the keys of [method] are {}; parameters of a method are in [method.NAME]",
                known.join(", ")
            )
        } else {
            format!("the keys of [{}] are {}", self.table, known.join(", "))
        };
        self.document.error(format!("unknown key '{}'{place}", self.key), self.key_span.clone()).help(help)
    }

    pub(super) fn table(&self) -> Result<&'a DeTable<'a>, Error> {
        let name =
            if self.table.is_empty() { self.key.to_owned() } else { format!("{}.{}", self.table, self.key) };
        let table = self.value.get_ref().as_table();
        table.ok_or_else(|| {
            // At the root, an entry that is no table is most likely a key of a table in the wrong place.
            let misplaced = self.table.is_empty() && !table_names().contains(&self.key);
            if misplaced { self.unknown() } else { self.unsuitable(&format!("a table, [{name}]")) }
        })
    }

    /// Checks that no other entry has set the focus.
    fn first_focus(&self, values: &Values) -> Result<(), Error> {
        if values.focus.is_none() {
            return Ok(());
        }
        let what = "'focus_distance', 'focus_point', 'focus_object' and 'focus_keys' exclude one another";
        Err(self.document.error(what, self.key_span.clone()).help("keep one of them"))
    }

    /// Stores `effort`, unless another key has set one.
    fn effort(&self, values: &mut Values, effort: Effort) -> Result<(), Error> {
        if values.effort.is_some() {
            let what = "'views', 'target_db', 'time_budget_s' and 'quality' exclude one another";
            return Err(self.document.error(what, self.key_span.clone()).help("keep one of them"));
        }
        values.effort = Some(effort);
        Ok(())
    }
}

/// The tables of a preset.
pub(super) fn table_names() -> Vec<&'static str> {
    let mut names = Vec::new();
    for (table, _) in keys() {
        if !names.contains(&table) {
            names.push(table);
        }
    }
    names
}

/// Every key of the table called `table`; `""` is the root.
fn known_keys(table: &str) -> Vec<String> {
    match table {
        "" => table_names().into_iter().map(str::to_owned).collect(),
        FOCUS_KEYS => FOCUS_KEY_PARTS.iter().map(|part| part.name.to_owned()).collect(),
        _ if KEYED.iter().any(|keyed| keyed.path == table) => {
            NUMBER_KEY_PARTS.iter().map(|part| part.name.to_owned()).collect()
        }
        _ => keys().filter(|(of, _)| *of == table).map(|(_, key)| key.to_owned()).collect(),
    }
}
