//! Numbers as people write them: with a unit (`85mm`, `4.5m`, `15°`), or in the notation of lenses (`f/2.8`).
//!
//! A number without a unit has the unit of its setting. Distances of a stack are in its depth units, whose length in metres is known only
//! when all settings are: a distance with a unit of length is kept in metres until then ([`super::Values::in_metres`]).

use super::setting::{Kind, Setting, Value};
use super::table::Values;
use crate::error::Error;

/// A value as it was written.
#[derive(Debug, Clone, PartialEq)]
pub struct Written {
    /// The value, in the unit of its setting or in metres.
    pub value: Value,
    /// Whether it is in metres instead of depth units.
    pub in_metres: bool,
}

/// The unit of settings that are distances in the stack.
const DEPTH_UNITS: &str = "depth units";

/// Units of length in metres, by their names in lower case.
const LENGTHS: [(&str, f64); 23] = [
    ("um", 1e-6),
    ("µm", 1e-6),
    ("μm", 1e-6),
    ("mm", 1e-3),
    ("cm", 1e-2),
    ("dm", 0.1),
    ("m", 1.0),
    ("meter", 1.0),
    ("meters", 1.0),
    ("metre", 1.0),
    ("metres", 1.0),
    ("km", 1e3),
    ("in", 0.0254),
    ("inch", 0.0254),
    ("inches", 0.0254),
    ("\"", 0.0254),
    ("″", 0.0254),
    ("ft", 0.3048),
    ("foot", 0.3048),
    ("feet", 0.3048),
    ("'", 0.3048),
    ("′", 0.3048),
    ("yd", 0.9144),
];

/// Units of angle in degrees.
const ANGLES: [(&str, f64); 5] =
    [("°", 1.0), ("deg", 1.0), ("degree", 1.0), ("degrees", 1.0), ("rad", 180.0 / std::f64::consts::PI)];

/// What stands before an f-number, in lower case.
const F_NUMBER_STARTS: [&str; 7] = ["f/", "f:", "f ", "ƒ/", "1:", "f", "ƒ"];

impl Setting {
    /// Reads a number for this setting, with its unit or another one; its range is not checked.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Settings`] for a text that is no number, and for a unit that does not fit, with what is expected.
    pub fn parse_number(&self, text: &str) -> Result<Written, Error> {
        let lower = text.trim().to_lowercase();
        let bare = self.without_start(&lower)?;
        let parts = split(bare, self.unit == "m").filter(|(_, unit)| !unit.starts_with(','));
        let (number, unit) = parts.ok_or_else(|| self.no_number(text))?;
        let written =
            |factor: f64, in_metres| Written { value: Value::Number((number * factor) as f32), in_metres };
        let scaled = |factors: &[(&str, f64)], of: f64| {
            let found = factors.iter().find(|(name, _)| *name == unit);
            found.map(|(_, factor)| factor / of)
        };
        let own = match self.unit {
            _ if unit.is_empty() => return Ok(written(1.0, false)),
            DEPTH_UNITS => match scaled(&LENGTHS, 1.0) {
                Some(factor) => return Ok(written(factor, true)),
                None => ["unit", "units", "u", "bu"].contains(&unit).then_some(1.0),
            },
            "mm" => scaled(&LENGTHS, 1e-3),
            "µm" => scaled(&LENGTHS, 1e-6),
            "m" => scaled(&LENGTHS, 1.0),
            "°" => scaled(&ANGLES, 1.0),
            _ => match unit {
                "%" if self.name != "f-number" => Some(0.01),
                "x" | "×" | ":1" if self.key == "squeeze" => Some(1.0),
                _ => None,
            },
        };
        own.map(|factor| written(factor, false)).ok_or_else(|| self.other_unit(text, unit))
    }

    /// `text` without what stands before an f-number.
    fn without_start<'a>(&self, text: &'a str) -> Result<&'a str, Error> {
        if self.key != "f_number" {
            return Ok(text);
        }
        if text.starts_with('t') {
            let what = format!("`{}` is an f-number, and {text:?} is a T-stop", self.key);
            return Err(Error::settings(what)
                .help("a T-stop measures light; blur needs the f-number, which is on the lens too: f/2.8"));
        }
        let start = F_NUMBER_STARTS.iter().find_map(|start| text.strip_prefix(start));
        Ok(start.filter(|rest| !rest.is_empty()).map_or(text, str::trim_start))
    }

    fn no_number(&self, text: &str) -> Error {
        let error =
            Error::settings(format!("`{}` must be {}", self.key, self.expected())).with("found", text);
        match text.contains(',') {
            true => error.help(format!("write the number with a point: {}", text.replacen(',', ".", 1))),
            false => error,
        }
    }

    fn other_unit(&self, text: &str, unit: &str) -> Error {
        let own = match self.unit {
            "" => "a number without a unit",
            "m" | "mm" | "µm" => "a length in mm, cm, m, in or ft",
            DEPTH_UNITS => "a number of depth units, or a length in mm, cm, m, in or ft",
            "°" => "degrees: 30 or 30deg",
            other => other,
        };
        let what = format!("`{}` cannot have the unit '{unit}'", self.key);
        Error::settings(what).with("found", text).with("expected", own)
    }

    /// Why it does not accept `value`, where that is a frequent mistake.
    pub fn remedy(&self, value: &Value) -> Option<String> {
        match (self.kind, value) {
            (Kind::Number(_), Value::Number(number)) if *number < 0.0 && self.unit == DEPTH_UNITS => {
                Some(format!(
                    "distances are measured from the camera into the picture, whatever the axis of the program: {}",
                    -number
                ))
            }
            (Kind::Number(_), Value::Number(0.0)) if self.key == "focus_distance" => {
                Some("0 is the camera itself; for the surface at a pixel, `focus_point = [X, Y]`".to_owned())
            }
            _ => None,
        }
    }
}

impl Values {
    /// Converts distances in metres to depth units of `metres_per_unit`; returns the settings with their metres and depth units.
    pub(crate) fn metres_to_units(&mut self, metres_per_unit: f32) -> Vec<(&'static Setting, [f32; 2])> {
        let mut converted = Vec::new();
        for key in std::mem::take(&mut self.in_metres) {
            let setting = Setting::by_key(key);
            if let Some((setting, Value::Number(metres))) = setting.and_then(|s| Some((s, s.get(self)?))) {
                let units = metres / metres_per_unit;
                setting.set(self, &Value::Number(units));
                converted.push((setting, [metres, units]));
            }
        }
        converted
    }

    /// Stores `written`, a value of `setting`.
    pub fn set_written(&mut self, setting: &'static Setting, written: &Written) {
        setting.set(self, &written.value);
        self.in_metres.retain(|key| *key != setting.key);
        if written.in_metres {
            self.in_metres.push(setting.key);
        }
    }
}

/// The number at the start of `text` and the unit behind it, which may be empty. With `bare_unit`, a unit alone is one of it.
fn split(text: &str, bare_unit: bool) -> Option<(f64, &str)> {
    for word in ["infinity", "inf", "∞"] {
        if let Some(unit) = text.strip_prefix(word) {
            return Some((f64::INFINITY, unit.trim()));
        }
    }
    let is_part = |c: char| c.is_ascii_digit() || matches!(c, '+' | '-' | '.' | 'e');
    // The longest start that is a number: in `1e3m` the letter belongs to the number.
    let ends = text.char_indices().take_while(|(_, c)| is_part(*c)).map(|(i, c)| i + c.len_utf8());
    let ends: Vec<usize> = ends.collect();
    let number =
        ends.iter().rev().find_map(|&end| Some((text[..end].parse::<f64>().ok()?, text[end..].trim())));
    number.or_else(|| (bare_unit && LENGTHS.iter().any(|(name, _)| *name == text)).then_some((1.0, text)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn number(key: &str, text: &str) -> Result<(f32, bool), String> {
        let written = Setting::by_key(key).unwrap().parse_number(text).map_err(|error| error.to_string())?;
        let Value::Number(number) = written.value else { panic!("{key}: {:?}", written.value) };
        Ok((number, written.in_metres))
    }

    #[test]
    fn lens_values_are_read_as_people_write_them() {
        for (key, text, expected) in [
            ("f_number", "2.8", 2.8),
            ("f_number", "f/2.8", 2.8),
            ("f_number", "F2.8", 2.8),
            ("f_number", "f/ 2.8", 2.8),
            ("f_number", "1:2.8", 2.8),
            ("f_number", "ƒ/8", 8.0),
            ("f_number", "f/inf", f32::INFINITY),
            ("f_number", "inf", f32::INFINITY),
            ("focal_length_mm", "85mm", 85.0),
            ("focal_length_mm", "85 MM", 85.0),
            ("focal_length_mm", "8.5cm", 85.0),
            ("focal_length_mm", "0.085m", 85.0),
            ("focal_length_mm", "1in", 25.4),
            ("sensor_width_mm", "36mm", 36.0),
            ("metres_per_unit", "cm", 0.01),
            ("metres_per_unit", "1cm", 0.01),
            ("metres_per_unit", "0.01", 0.01),
            ("rotation_deg", "-15.5°", -15.5),
            ("rotation_deg", "30deg", 30.0),
            ("spherical_um", "-80um", -80.0),
            ("spherical_um", "0.08mm", 80.0),
            ("blade_curvature", "50%", 0.5),
            ("squeeze", "1.33x", 1.33),
            ("focus_distance", "1e3", 1000.0),
            ("focus_distance", "+4", 4.0),
            ("focus_distance", "∞", f32::INFINITY),
        ] {
            assert_eq!(number(key, text), Ok((expected, false)), "{key} = {text}");
        }
        for (text, metres) in
            [("4.5m", 4.5), ("450cm", 4.5), ("4500 mm", 4.5), ("10ft", 3.048), ("6'", 1.8288)]
        {
            assert_eq!(number("focus_distance", text), Ok((metres, true)), "{text}");
        }
    }

    #[test]
    fn what_is_no_number_or_has_another_unit_is_refused_with_what_is_expected() {
        for (key, text, words) in [
            ("f_number", "wide", "must be a positive number, or inf"),
            ("f_number", "f/", "must be a positive number"),
            ("f_number", "T2.8", "T-stop"),
            ("f_number", "2,8", "write the number with a point: 2.8"),
            ("f_number", "2.8mm", "cannot have the unit 'mm'"),
            ("focal_length_mm", "85s", "a length in mm, cm, m, in or ft"),
            ("focal_length_mm", "mm", "must be a positive number"),
            ("focus_distance", "4.5 parsec", "cannot have the unit 'parsec'"),
            ("focus_distance", "", "must be a positive number"),
            ("rotation_deg", "1m", "degrees"),
        ] {
            let message = number(key, text).unwrap_err();
            assert!(message.contains(words), "{key} = {text}: {message}");
        }
    }

    #[test]
    fn metres_become_depth_units_of_any_length() {
        let focus = Setting::by_key("focus_distance").unwrap();
        for (metres_per_unit, units) in [(1.0, 4.5), (0.01, 450.0), (0.3048, 14.763_78)] {
            let mut values = Values::default();
            values.set_written(focus, &focus.parse_number("450cm").unwrap());
            assert_eq!(values.metres_to_units(metres_per_unit), [(focus, [4.5, units])]);
            assert_eq!(focus.get(&values), Some(Value::Number(units)));
            assert!(values.metres_to_units(metres_per_unit).is_empty(), "once");
        }
        let mut values = Values::default();
        values.set_written(focus, &focus.parse_number("4.5m").unwrap());
        values.set_written(focus, &focus.parse_number("7").unwrap());
        assert!(values.metres_to_units(0.01).is_empty(), "the last word counts");
    }
}
