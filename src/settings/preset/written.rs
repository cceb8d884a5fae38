//! A preset as TOML text, from which [`Preset::parse`] reads the same preset.

use super::super::{
    Effort, Focus, FocusKey, Json, KEYED, NumberKey, ParameterValues, SETTINGS, Setting, Value, Values,
};
use super::{Preset, schema};
use std::path::Path;

/// A line of the text: its table, its key, its value.
type Line = (String, String, String);

impl Preset {
    /// The preset as TOML, in the order of the schema. The text is ASCII: other characters are escaped.
    pub fn to_toml(&self) -> String {
        let lines: Vec<Line> = settings(&self.values)
            .chain(keys(&self.values))
            .chain(switches(&self.values))
            .chain(method(&self.values))
            .collect();
        let tables = schema::table_names().into_iter().map(str::to_owned);
        let sections = tables.map(|table| section(&table, &lines)).chain(parameters(&self.parameters));
        sections.filter(|text| !text.is_empty()).collect::<Vec<_>>().join("\n")
    }
}

/// The lines of `table` under its head; empty without lines.
fn section(table: &str, lines: &[Line]) -> String {
    let own: String = lines
        .iter()
        .filter(|(of, ..)| of == table)
        .map(|(_, key, value)| format!("{key} = {value}\n"))
        .collect();
    if own.is_empty() { own } else { format!("[{table}]\n{own}") }
}

fn settings(values: &Values) -> impl Iterator<Item = Line> {
    SETTINGS.iter().filter_map(|setting: &Setting| {
        let value = setting.get(values)?;
        let in_metres = values.in_metres.contains(&setting.key);
        let line = if in_metres { text(&format!("{value} m")) } else { written(&value) };
        Some((setting.table.to_owned(), setting.preset_key.to_owned(), line))
    })
}

/// The lists of keys.
fn keys(values: &Values) -> impl Iterator<Item = Line> {
    let focus = match &values.focus {
        Some(Focus::Keys(keys)) => Some(("focus_keys", keys.iter().map(focus_key).collect::<Vec<_>>())),
        _ => None,
    };
    let numbers = KEYED.iter().filter_map(|keyed| {
        let keys = (keyed.keys)(values).as_ref()?;
        Some((keyed.list, keys.iter().map(number_key).collect()))
    });
    let lists = focus.into_iter().chain(numbers);
    lists.map(|(list, keys)| ("lens".to_owned(), list.to_owned(), format!("[{}]", keys.join(", "))))
}

fn focus_key(key: &FocusKey) -> String {
    let focus = match &key.focus {
        Focus::Distance(distance) => format!("distance = {distance:?}"),
        Focus::Point(point) => format!("point = {point:?}"),
        Focus::Object(name) => format!("object = {}", text(name)),
        // No list has such keys.
        Focus::Centre | Focus::Keys(_) => String::new(),
    };
    format!("{{ frame = {}, {focus}, easing = \"{}\" }}", key.frame, key.easing.name())
}

fn number_key(key: &NumberKey) -> String {
    format!("{{ frame = {}, value = {:?}, easing = \"{}\" }}", key.frame, key.value, key.easing.name())
}

fn switches(values: &Values) -> impl Iterator<Item = Line> {
    let lists = values.switches.iter().flat_map(|s| [("force", &s.force), ("without", &s.without)]);
    lists.filter(|(_, names)| !names.is_empty()).map(|(key, names)| {
        let names: Vec<_> = names.iter().map(|name| text(name)).collect();
        ("effects".to_owned(), key.to_owned(), format!("[{}]", names.join(", ")))
    })
}

fn method(values: &Values) -> impl Iterator<Item = Line> {
    let name = values.method.as_deref().map(|name| ("name", text(name)));
    let effort = values.effort.map(|effort| match effort {
        Effort::Views(views) => ("views", views.to_string()),
        Effort::TargetDb(target) => ("target_db", format!("{target:?}")),
        Effort::TimeBudget(seconds) => ("time_budget_s", format!("{seconds:?}")),
        Effort::Quality(quality) => ("quality", text(quality.name())),
    });
    let lines = name.into_iter().chain(effort);
    lines.map(|(key, value)| ("method".to_owned(), key.to_owned(), value))
}

/// The `[method.NAME]` tables, each with the last value of every parameter.
fn parameters(values: &ParameterValues) -> Vec<String> {
    let mut lines: Vec<Line> = Vec::new();
    for value in values.iter() {
        let table = format!("method.{}", value.method);
        lines.retain(|(of, key, _)| (of, key) != (&table, &value.key));
        lines.push((table, value.key.clone(), parameter(&value.value)));
    }
    let mut tables: Vec<&String> = Vec::new();
    for (table, ..) in &lines {
        if !tables.contains(&table) {
            tables.push(table);
        }
    }
    tables.into_iter().map(|table| section(table, &lines)).collect()
}

/// A parameter's value; "auto" is `null`. JSON's numbers, flags and lists are TOML's.
fn parameter(value: &Json) -> String {
    match value {
        Json::Null => text("auto"),
        Json::String(other) => text(other),
        other => other.to_string(),
    }
}

fn written(value: &Value) -> String {
    match value {
        // With a point or an exponent, as TOML's floats have them.
        Value::Number(number) => format!("{number:?}"),
        Value::Pair(pair) => format!("{pair:?}"),
        Value::Whole(number) => number.to_string(),
        Value::Word(word) => text(word),
        Value::Name(name) => text(name),
        Value::File(path) => file(path),
    }
}

fn file(path: &Path) -> String {
    text(&path.to_string_lossy())
}

/// `content` in quotes, with escapes for quotes, backslashes, and all that is not printable ASCII.
fn text(content: &str) -> String {
    let escaped = content.chars().map(|c| match c {
        '"' | '\\' => format!("\\{c}"),
        ' '..='~' => c.to_string(),
        other => format!("\\U{:08X}", other as u32),
    });
    format!("\"{}\"", escaped.collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::super::super::{Easing, Kind, Quality, Switches};
    use super::*;

    fn read_back(preset: &Preset) -> Preset {
        let text = preset.to_toml();
        Preset::parse(&text, "written.toml").unwrap_or_else(|error| panic!("{error}\n{text}"))
    }

    /// A value that `setting` allows and that is hard to write: a number without a short decimal, a name with quotes.
    fn example(setting: &Setting) -> Value {
        let numbers = [f32::INFINITY, 1e30, 0.1 + 0.2, 1.0 / 3.0, 4.0 / 3.0];
        let name = "a \"quoted\" \\ n\u{e4}me\n";
        match setting.kind {
            Kind::Number(_) => {
                let allowed = numbers.into_iter().map(Value::Number).find(|value| setting.kind.allows(value));
                allowed.unwrap()
            }
            Kind::RedBlue(_) | Kind::Pixel => Value::Pair([-1.0 / 3.0, 1e-7]),
            Kind::Count { max, .. } | Kind::Whole(_, max) => Value::Whole(max),
            Kind::Word(words) => Value::Word(words.last().unwrap().name),
            Kind::Name => Value::Name(name.to_owned()),
            Kind::File => Value::File("/tmp/f\u{fc}r \"x\".png".into()),
        }
    }

    #[test]
    fn every_setting_reads_back_as_it_was_written() {
        for setting in SETTINGS {
            let mut values = Values::default();
            setting.set(&mut values, &example(setting));
            let preset = Preset { values, ..Preset::default() };
            assert_ne!(preset, Preset::default(), "{}", setting.key);
            assert_eq!(read_back(&preset), preset, "{}", setting.key);
        }
    }

    #[test]
    fn every_effort_reads_back_as_it_was_written() {
        let efforts = [
            Effort::Views(7),
            Effort::TargetDb(42.5),
            Effort::TimeBudget(1e-3_f32.into()),
            Effort::Quality(Quality::Draft),
        ];
        for effort in efforts {
            let values =
                Values { effort: Some(effort), method: Some("shear".to_owned()), ..Values::default() };
            let preset = Preset { values, ..Preset::default() };
            assert_eq!(read_back(&preset), preset);
        }
    }

    #[test]
    fn keys_switches_and_parameters_read_back_as_they_were_written() {
        let focus = |frame, focus| FocusKey { frame, focus, easing: Easing::Hold };
        let number = |frame, value| NumberKey { frame, value, easing: Easing::Linear };
        let focus_keys = vec![
            focus(-3, Focus::Distance(f32::INFINITY)),
            focus(1, Focus::Point([0.1, 7.0])),
            focus(9, Focus::Object("c\u{f6}w".to_owned())),
        ];
        let values = Values {
            focus: Some(Focus::Keys(focus_keys)),
            f_number_keys: Some(vec![number(1, 1.4), number(2, f32::INFINITY)]),
            focal_length_keys: Some(vec![number(-1, 24.0)]),
            switches: Some(Switches { force: vec!["fill".to_owned()], without: vec!["resolve".to_owned()] }),
            ..Values::default()
        };
        let mut parameters = ParameterValues::default();
        for (key, value) in [("a", Json::from(0.1)), ("b", Json::Null), ("c", Json::from(vec![1.0, 0.5]))] {
            parameters.set("shear", key, value);
        }
        parameters.set("gather", "d", true);
        let preset = Preset { values: values.clone(), parameters };
        let read = read_back(&preset);
        assert_eq!(read.values, values);
        let plain = |preset: &Preset| {
            preset
                .parameters
                .iter()
                .map(|v| (v.method.clone(), v.key.clone(), v.value.clone()))
                .collect::<Vec<_>>()
        };
        let sorted = |mut all: Vec<(String, String, Json)>| {
            all.sort_by(|a, b| (&a.0, &a.1).cmp(&(&b.0, &b.1)));
            all
        };
        assert_eq!(sorted(plain(&read)), sorted(plain(&preset)));
    }

    #[test]
    fn the_last_value_of_a_parameter_is_written() {
        let mut parameters = ParameterValues::default();
        parameters.set("shear", "a", 1);
        parameters.set("shear", "a", 2);
        let text = Preset { parameters, ..Preset::default() }.to_toml();
        assert_eq!(text, "[method.shear]\na = 2\n");
        assert_eq!(Preset::default().to_toml(), "");
    }
}
