//! Presets: a TOML file becomes a layer of [`Values`].
//!
//! [`SCHEMA`] is the one list of keys: what may be written, how it is checked and where it goes. The `[method.NAME]`
//! tables follow from the declarations of [`MethodParameters`], so that a new method needs no line here.

use super::{DepthConvention, Effort, Focus, MethodParameters, Quality, SensorDistance, Values, nearest};
use crate::error::Error;
use serde_json::Value as Json;
use std::ops::Range;
use std::path::Path;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

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
pub static BUILT_IN: [BuiltIn; 6] = [
    BuiltIn { name: "portrait", text: include_str!("../../presets/portrait.toml") },
    BuiltIn { name: "landscape", text: include_str!("../../presets/landscape.toml") },
    BuiltIn { name: "macro", text: include_str!("../../presets/macro.toml") },
    BuiltIn { name: "cine", text: include_str!("../../presets/cine.toml") },
    BuiltIn { name: "phone-like", text: include_str!("../../presets/phone-like.toml") },
    BuiltIn { name: "pinhole", text: include_str!("../../presets/pinhole.toml") },
];

impl BuiltIn {
    /// The preset called `name`.
    ///
    /// # Errors
    /// An unknown name, with the nearest known one.
    pub fn by_name(name: &str) -> Result<Self, Error> {
        let found = BUILT_IN.into_iter().find(|preset| preset.name == name);
        found.ok_or_else(|| {
            let names = BUILT_IN.map(|preset| preset.name);
            let known = match nearest(name, &names) {
                Some(near) => format!("did you mean '{near}'? "),
                None => format!("the presets are {}; ", names.join(", ")),
            };
            Error::settings(format!("there is no preset called '{name}'")).help(format!(
                "{known}`thinlens presets` lists them, and a preset of your own is given by its path"
            ))
        })
    }

    /// What the preset is for: the first line of its head comment.
    pub fn summary(&self) -> &'static str {
        self.text.lines().next().unwrap_or_default().trim_start_matches('#').trim()
    }
}

impl Preset {
    /// Loads the preset that ships as `name`, else the file at the path `name`.
    ///
    /// # Errors
    /// A name that is neither, and all errors of [`Preset::parse`].
    pub fn load(name: &str) -> Result<Self, Error> {
        if let Some(built_in) = BUILT_IN.iter().find(|preset| preset.name == name) {
            return Self::parse(built_in.text, name);
        }
        let path = Path::new(name);
        let means_a_file = path.extension().is_some() || path.components().count() > 1 || path.exists();
        if !means_a_file {
            BuiltIn::by_name(name)?;
        }
        let text = std::fs::read_to_string(path).map_err(|cause| {
            Error::settings("the preset file cannot be read")
                .in_file(path)
                .caused_by(cause)
                .help("give the path of a TOML file, or a name that `thinlens presets` lists")
        })?;
        Self::parse(&text, name)
    }

    /// Reads a preset from TOML; `source` names it in errors.
    ///
    /// # Errors
    /// A syntax error, an unknown key (with the nearest known one) or a value of the wrong type, each with its line.
    pub fn parse(text: &str, source: &str) -> Result<Self, Error> {
        let document = Document { text, source };
        let root = DeTable::parse(text).map_err(|error| {
            document.error(format!("not valid TOML: {}", error.message()), error.span().unwrap_or(0..0))
        })?;
        let mut values = Values::default();
        let mut parameters = default_parameters();
        for table in document.entries("", root.get_ref()) {
            if !table_names().contains(&table.key) {
                return Err(table.unknown());
            }
            for entry in document.entries(table.key, table.table()?) {
                entry.read(&mut values, &mut parameters)?;
            }
        }
        let parameters = serde_json::from_value(parameters).map_err(|cause| {
            Error::settings("a method's parameters cannot be read").with("in", source).caused_by(cause)
        })?;
        Ok(Self { values, parameters })
    }
}

/// A key that a preset may hold: its table, its name, and how its value is checked and kept.
struct Key {
    table: &'static str,
    name: &'static str,
    set: fn(&mut Values, &Entry<'_>) -> Result<(), Error>,
}

/// Every key outside the `[method.NAME]` tables.
static SCHEMA: [Key; 19] = {
    const fn key(
        table: &'static str,
        name: &'static str,
        set: fn(&mut Values, &Entry<'_>) -> Result<(), Error>,
    ) -> Key {
        Key { table, name, set }
    }
    [
        key("lens", "focal_length_mm", |v, e| e.positive().map(|x| v.focal_length_mm = Some(x))),
        key("lens", "f_number", |v, e| e.positive_or_inf().map(|x| v.f_number = Some(x))),
        key("lens", "focus_distance", |v, e| e.focus(v, Focus::Distance(e.positive_or_inf()?))),
        key("lens", "focus_point", |v, e| e.focus(v, Focus::Point(e.point()?))),
        key("lens", "sensor_width_mm", |v, e| e.positive().map(|x| v.sensor_width_mm = Some(x))),
        key("lens", "sensor_distance", |v, e| {
            e.one_of(&SENSOR_DISTANCES).map(|x| v.sensor_distance = Some(x))
        }),
        key("aperture", "blades", |v, e| e.blades().map(|x| v.blades = Some(x))),
        key("aperture", "rotation_deg", |v, e| e.finite().map(|x| v.rotation_deg = Some(x))),
        key("depth", "convention", |v, e| e.one_of(&CONVENTIONS).map(|x| v.convention = x)),
        key("depth", "metres_per_unit", |v, e| e.positive().map(|x| v.metres_per_unit = Some(x))),
        key("depth", "near_clip", |v, e| e.not_negative().map(|x| v.near_clip = Some(x))),
        key("depth", "near", |v, e| e.not_negative().map(|x| v.near = Some(x))),
        key("depth", "far", |v, e| e.positive().map(|x| v.far = Some(x))),
        key("depth", "supersample", |v, e| e.count().map(|x| v.supersample = Some(x))),
        key("method", "name", |v, e| e.text().map(|x| v.method = Some(x.to_owned()))),
        key("method", "views", |v, e| e.effort(v, Effort::Views(e.count()?))),
        key("method", "target_db", |v, e| e.effort(v, Effort::TargetDb(e.decibels()?))),
        key("method", "time_budget_s", |v, e| e.effort(v, Effort::TimeBudget(e.positive()?.into()))),
        key("method", "quality", |v, e| {
            e.effort(v, Effort::Quality(e.one_of(&Quality::ALL.map(|quality| (quality.name(), quality)))?))
        }),
    ]
};

const SENSOR_DISTANCES: [(&str, SensorDistance); 2] =
    [("focal_length", SensorDistance::FocalLength), ("thin_lens", SensorDistance::ThinLens)];

const CONVENTIONS: [(&str, Option<DepthConvention>); 5] = [
    ("auto", None),
    ("planar", Some(DepthConvention::Planar)),
    ("ray", Some(DepthConvention::Ray)),
    ("inverse", Some(DepthConvention::Inverse)),
    ("normalised", Some(DepthConvention::Normalised)),
];

/// The tables of a preset, in the order of [`SCHEMA`].
fn table_names() -> Vec<&'static str> {
    let mut names: Vec<_> = SCHEMA.iter().map(|key| key.table).collect();
    names.dedup();
    names
}

/// The `[method.NAME]` tables with every parameter at its default.
fn default_parameters() -> Json {
    serde_json::to_value(MethodParameters::default()).expect("parameters are numbers, flags and lists")
}

/// Every key that the table called `table` may hold; `""` is the root.
fn known_keys(table: &str) -> Vec<String> {
    let parameters = default_parameters();
    let members = |json: &Json| json.as_object().map(|map| map.keys().cloned().collect()).unwrap_or_default();
    match (table, table.strip_prefix("method.")) {
        ("", _) => table_names().into_iter().map(str::to_owned).collect(),
        (_, Some(method)) => members(&parameters[method]),
        _ => {
            let keys = SCHEMA.iter().filter(|key| key.table == table).map(|key| key.name.to_owned());
            let methods: Vec<String> = if table == "method" { members(&parameters) } else { Vec::new() };
            keys.chain(methods).collect()
        }
    }
}

/// The text of a preset and its name.
#[derive(Clone, Copy)]
struct Document<'a> {
    text: &'a str,
    source: &'a str,
}

impl<'a> Document<'a> {
    /// The entries of a table in the order of the file, so that its first mistake is the one reported.
    fn entries(self, table: &'a str, content: &'a DeTable<'a>) -> Vec<Entry<'a>> {
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

    /// An error about the bytes `span`: file, line and column, the line itself, and carets under the place.
    fn error(self, what: impl Into<String>, span: Range<usize>) -> Error {
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
        Error::settings(what).with(
            "in",
            format!(
                "{}:{line}:{}\n  {number} | {}\n  {margin} | {padding}{carets}",
                self.source,
                before.chars().count() + 1,
                self.text[line_start..line_end].trim_end(),
            ),
        )
    }
}

/// The last place of `text` up to `index` where a character starts.
fn char_boundary(text: &str, index: usize) -> usize {
    (0..=index.min(text.len())).rev().find(|&i| text.is_char_boundary(i)).unwrap_or(0)
}

/// One `key = value` of a preset with its place in the text.
struct Entry<'a> {
    document: Document<'a>,
    table: &'a str,
    key: &'a str,
    key_span: Range<usize>,
    value: &'a Spanned<DeValue<'a>>,
}

impl<'a> Entry<'a> {
    /// Checks the entry and keeps its value where it belongs.
    fn read(&self, values: &mut Values, parameters: &mut Json) -> Result<(), Error> {
        if let Some(key) = SCHEMA.iter().find(|key| key.table == self.table && key.name == self.key) {
            return (key.set)(values, self);
        }
        match parameters.get_mut(self.key) {
            Some(method) if self.table == "method" => {
                let path = format!("method.{}", self.key);
                self.document
                    .entries(&path, self.table()?)
                    .iter()
                    .try_for_each(|entry| entry.read_parameter(self.key, method))
            }
            _ => Err(self.unknown()),
        }
    }

    /// Checks one parameter of `method`, and keeps its value among that method's `parameters`.
    fn read_parameter(&self, method: &str, parameters: &mut Json) -> Result<(), Error> {
        let known = MethodParameters::of(method);
        let parameter = known.iter().find(|known| known.name == self.key).ok_or_else(|| self.unknown())?;
        let value = json(self.value.get_ref()).filter(|value| parameter.kind.allows(value));
        parameters[self.key] = value.ok_or_else(|| self.unsuitable(&parameter.wanted()))?;
        Ok(())
    }

    fn unknown(&self) -> Error {
        let place = if self.table.is_empty() { String::new() } else { format!(" in [{}]", self.table) };
        let known = known_keys(self.table);
        let help = if let Some(key) = SCHEMA.iter().find(|key| key.name == self.key) {
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

    fn table(&self) -> Result<&'a DeTable<'a>, Error> {
        let name =
            if self.table.is_empty() { self.key.to_owned() } else { format!("{}.{}", self.table, self.key) };
        let table = self.value.get_ref().as_table();
        table.ok_or_else(|| {
            // A key of a table, written above all tables, is the likelier mistake.
            let misplaced = self.table.is_empty() && !table_names().contains(&self.key);
            if misplaced { self.unknown() } else { self.unsuitable(&format!("a table, [{name}]")) }
        })
    }

    fn text(&self) -> Result<&'a str, Error> {
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

    fn count(&self) -> Result<usize, Error> {
        self.whole(1, "1 or more").map(|count| count as usize)
    }

    fn blades(&self) -> Result<u32, Error> {
        let wanted = "0 for a disc or at least 3";
        let blades = self.whole(0, wanted)?;
        if matches!(blades, 1 | 2) {
            Err(self.unsuitable(&format!("a whole number, {wanted}")))
        } else {
            Ok(blades)
        }
    }

    fn positive(&self) -> Result<f32, Error> {
        self.number_where("a positive number", |x| x > 0.0 && x.is_finite())
    }

    fn positive_or_inf(&self) -> Result<f32, Error> {
        self.number_where("a positive number, or inf", |x| x > 0.0)
    }

    fn not_negative(&self) -> Result<f32, Error> {
        self.number_where("a number, 0 or more", |x| x >= 0.0 && x.is_finite())
    }

    fn finite(&self) -> Result<f32, Error> {
        self.number_where("a number", f32::is_finite)
    }

    /// A number, whole or not, that satisfies `suits`.
    fn number_where(&self, wanted: &str, suits: impl Fn(f32) -> bool) -> Result<f32, Error> {
        number(self.value.get_ref()).filter(|&x| suits(x)).ok_or_else(|| self.unsuitable(wanted))
    }

    fn point(&self) -> Result<[f32; 2], Error> {
        let wanted = || self.unsuitable("a pixel, [x, y]");
        let items = self.value.get_ref().as_array().ok_or_else(wanted)?;
        let numbers: Vec<f32> =
            items.iter().filter_map(|item| number(item.get_ref())).filter(|x| x.is_finite()).collect();
        let point = numbers.try_into().map_err(|_| wanted())?;
        if items.len() == 2 { Ok(point) } else { Err(wanted()) }
    }

    /// Keeps `focus`, unless another key has set one.
    fn focus(&self, values: &mut Values, focus: Focus) -> Result<(), Error> {
        if values.focus.is_some() {
            let what = "'focus_distance' and 'focus_point' exclude each other";
            return Err(self.document.error(what, self.key_span.clone()).help("keep one of the two"));
        }
        values.focus = Some(focus);
        Ok(())
    }

    /// Keeps `effort`, unless another key has set one.
    fn effort(&self, values: &mut Values, effort: Effort) -> Result<(), Error> {
        if values.effort.is_some() {
            let what = "'views', 'target_db', 'time_budget_s' and 'quality' exclude one another";
            return Err(self.document.error(what, self.key_span.clone()).help("keep one of them"));
        }
        values.effort = Some(effort);
        Ok(())
    }

    fn decibels(&self) -> Result<f64, Error> {
        let [least, most] = Effort::TARGETS_DB;
        let wanted = format!("a number of decibels from {least} to {most}");
        self.number_where(&wanted, |x| (least..=most).contains(&f64::from(x))).map(f64::from)
    }

    fn one_of<T: Copy>(&self, choices: &[(&str, T)]) -> Result<T, Error> {
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

/// A parameter's value: a flag, a number, a list of numbers; `null` for the text "auto".
fn json(value: &DeValue<'_>) -> Option<Json> {
    match value {
        DeValue::Boolean(flag) => Some(Json::from(*flag)),
        DeValue::Integer(digits) => i64::from_str_radix(digits.as_str(), digits.radix()).ok().map(Json::from),
        DeValue::Float(digits) => digits.as_str().parse::<f64>().ok().map(Json::from),
        DeValue::String(text) => (text == "auto").then_some(Json::Null),
        DeValue::Array(items) => items.iter().map(|item| json(item.get_ref())).collect(),
        DeValue::Table(_) | DeValue::Datetime(_) => None,
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Preset, Error> {
        Preset::parse(text, "my.toml")
    }

    fn message(text: &str) -> String {
        parse(text).unwrap_err().to_string()
    }

    #[test]
    fn every_key_of_the_schema_is_read() {
        let text = "
            [lens]
            focal_length_mm = 85.0
            f_number = 1.4
            focus_point = [10, 20.5]
            sensor_width_mm = 36.0
            sensor_distance = 'thin_lens'
            [aperture]
            blades = 6
            rotation_deg = -15.5
            [depth]
            convention = 'ray'
            metres_per_unit = 0.01
            near_clip = 0.1
            near = 1
            far = 100
            supersample = 2
            [method]
            name = 'shear'
            views = 32";
        let expected = Values {
            focal_length_mm: Some(85.0),
            f_number: Some(1.4),
            focus: Some(Focus::Point([10.0, 20.5])),
            sensor_width_mm: Some(36.0),
            sensor_distance: Some(SensorDistance::ThinLens),
            blades: Some(6),
            rotation_deg: Some(-15.5),
            convention: Some(DepthConvention::Ray),
            metres_per_unit: Some(0.01),
            near_clip: Some(0.1),
            near: Some(1.0),
            far: Some(100.0),
            supersample: Some(2),
            method: Some("shear".to_owned()),
            effort: Some(Effort::Views(32)),
        };
        assert_eq!(parse(text).unwrap().values, expected);
    }

    #[test]
    fn a_whole_number_serves_where_a_number_is_wanted() {
        assert_eq!(parse("[lens]\nfocal_length_mm = 85").unwrap().values.focal_length_mm, Some(85.0));
    }

    #[test]
    fn the_convention_auto_leaves_the_convention_open() {
        assert_eq!(parse("[depth]\nconvention = 'auto'").unwrap().values.convention, None);
    }

    #[test]
    fn an_infinite_f_number_is_a_pinhole() {
        assert_eq!(parse("[lens]\nf_number = inf").unwrap().values.f_number, Some(f32::INFINITY));
    }

    #[test]
    fn the_parameters_of_a_method_keep_their_defaults_where_the_preset_is_silent() {
        let text = "[method.shear]\nviews = 32\nfill = false
            [method.recursive-gaussian]\nlayers = 9\n[method.point-splat]\nintensity = [1, 0.5]";
        let parameters = parse(text).unwrap().parameters;
        let mut expected = MethodParameters::default();
        expected.recursive_gaussian.layers = Some(9);
        expected.point_splat.intensity = vec![1.0, 0.5];
        expected.shear.views = 32;
        expected.shear.fill = false;
        assert_eq!(parameters, expected);
    }

    #[test]
    fn an_unknown_key_is_shown_with_its_place_and_the_nearest_key() {
        assert_eq!(
            message("[lens]\nfnumber = 1.4"),
            "unknown key 'fnumber' in [lens]\n  in: my.toml:2:1\n  2 | fnumber = 1.4\n    | ^^^^^^^\n  help: did you mean \
             'f_number'?"
        );
    }

    #[test]
    fn an_unknown_key_near_to_none_lists_the_keys_of_its_table() {
        let message = message("[aperture]\nvignette = 1");
        assert!(message.contains("the keys of [aperture] are blades, rotation_deg"), "{message}");
    }

    #[test]
    fn an_unknown_key_of_a_method_has_its_nearest_key_too() {
        let message = message("[method.shear]\nprefiltre = 1.0");
        assert!(message.contains("unknown key 'prefiltre' in [method.shear]"), "{message}");
        assert!(message.contains("did you mean 'prefilter'?"), "{message}");
    }

    #[test]
    fn a_key_in_the_wrong_table_is_sent_to_its_own() {
        assert!(message("[aperture]\nf_number = 2").contains("'f_number' belongs in [lens]"));
        assert!(message("f_number = 2").contains("'f_number' belongs in [lens]"));
    }

    #[test]
    fn an_unknown_table_has_its_nearest_table() {
        assert!(message("[lense]\nf_number = 2").contains("did you mean 'lens'?"));
        assert!(message("[method.shaer]\nviews = 2").contains("did you mean 'shear'?"));
    }

    #[test]
    fn a_value_of_the_wrong_kind_is_refused_with_carets_under_the_value() {
        for (line, wanted) in [
            ("[lens]\nf_number = 'wide'", "must be a positive number, or inf"),
            ("[lens]\nfocal_length_mm = -85", "must be a positive number"),
            ("[lens]\nfocal_length_mm = nan", "must be a positive number"),
            ("[lens]\nfocus_point = [1]", "must be a pixel, [x, y]"),
            ("[lens]\nsensor_distance = 'far'", "must be one of focal_length, thin_lens"),
            ("[aperture]\nblades = 2", "must be a whole number, 0 for a disc or at least 3"),
            ("[aperture]\nblades = 5.5", "must be a whole number"),
            ("[method]\nviews = 0", "must be a whole number, 1 or more"),
            ("[method.shear]\nfill = 1", "must be true or false"),
            ("[method.shear]\nprefilter = -1", "must be a number from 0 to 16 (the default is 1.4)"),
            (
                "[method.layer-rays]\ndelta_px = 0",
                "'delta_px' must be a number from 0.1 to 1000 (the default is 3.0)",
            ),
            ("[method.layer-rays]\nrays = 0", "must be a whole number from 1 to 65536 (the default is 32)"),
            (
                "[method.recursive-gaussian]\nlayers = 513",
                "must be \"auto\", or a whole number from 1 to 512 (the default is \"auto\")",
            ),
            (
                "[method.point-splat]\nintensity = [0, 0]",
                "must be a list of numbers from 0 to 1000, not all 0",
            ),
            ("lens = 3", "must be a table, [lens]"),
        ] {
            let message = message(line);
            assert!(message.contains(wanted) && message.contains('^'), "{line}: {message}");
        }
    }

    #[test]
    fn two_ways_to_focus_exclude_each_other() {
        let message = message("[lens]\nfocus_distance = 2\nfocus_point = [1, 2]");
        assert!(message.contains("exclude each other") && message.contains("my.toml:3:1"), "{message}");
    }

    #[test]
    fn broken_toml_is_shown_with_its_place() {
        let message = message("[lens]\nf_number = \n");
        assert!(message.contains("not valid TOML") && message.contains("my.toml:2:"), "{message}");
    }

    #[test]
    fn the_preset_in_the_readme_is_valid() {
        let readme = include_str!("../../README.md");
        let (_, rest) = readme.split_once("    [lens]").unwrap();
        let (block, _) = rest.split_once("\nThe flags").unwrap();
        let preset = Preset::parse(&format!("[lens]{block}"), "README.md").unwrap();
        assert_eq!(preset.values.effort, Some(Effort::Views(64)));
    }

    #[test]
    fn every_preset_on_board_is_valid_says_where_it_comes_from_and_leaves_the_focus_open() {
        for built_in in BUILT_IN {
            let preset = Preset::load(built_in.name).unwrap();
            assert_eq!(preset.values.focus, None, "{}", built_in.name);
            assert!(built_in.text.starts_with("# "), "{}", built_in.name);
            assert!(!built_in.summary().is_empty(), "{}", built_in.name);
        }
    }

    #[test]
    fn an_unknown_preset_has_its_nearest_name() {
        let message = Preset::load("potrait").unwrap_err().to_string();
        assert!(message.contains("did you mean 'portrait'?"), "{message}");
        assert!(message.contains("thinlens presets"), "{message}");
    }

    #[test]
    fn a_missing_preset_file_is_named() {
        let message = Preset::load("no/such.toml").unwrap_err().to_string();
        assert!(message.contains("in: no/such.toml"), "{message}");
    }
}
