//! Camera data in the header of an OpenEXR file: attributes of thinlens first (`thinlens.…`), then the standard attributes, then those of
//! renderers ([`renderers`]).
//!
//! The table of settings declares the attributes of thinlens and their ranges.

use super::attributes::{number, text};
use super::renderers;
use super::writer::Writer;
use crate::finding::Finding;
use crate::settings::{Focus, Kind, SETTINGS, Setting, Value, Values};
use exr::math::Vec2;
use exr::meta::attribute::{AttributeValue, Text};

/// Standard attributes that are used if the `thinlens.…` attribute is missing, in order of preference, by the key of the setting. The
/// standard `focus` is in metres and is read separately.
pub(super) const STANDARD: [(&str, &[&str]); 3] = [
    ("focal_length_mm", &["pinholeFocalLength", "effectiveFocalLength", "nominalFocalLength"]),
    ("f_number", &["aperture"]),
    ("sensor_width_mm", &["sensorAcquisitionDimensions", "sensorOverallDimensions"]),
];

/// The unit of Unreal's depth in metres.
const CENTIMETRE: f32 = 0.01;

/// Attributes of one header, looked up by name.
struct Lookup<'a> {
    attributes: &'a [(Text, AttributeValue)],
    findings: Vec<Finding>,
}

/// The settings in `attributes`. Values that a setting does not allow are left out, with a warning.
pub(super) fn values(attributes: &[(Text, AttributeValue)]) -> (Values, Vec<Finding>) {
    let mut from = Lookup { attributes, findings: Vec::new() };
    let mut values = Values::default();
    for setting in SETTINGS {
        let own = setting.attribute.and_then(|name| from.setting(name, setting, false));
        let standard =
            STANDARD.iter().find(|(key, _)| *key == setting.key).map_or(&[][..], |(_, names)| names);
        let found = own.or_else(|| standard.iter().find_map(|name| from.standard(name, setting)));
        if let Some(value) = found {
            setting.set(&mut values, &value);
        }
    }
    if values.metres_per_unit.is_none() && Writer::Unreal.wrote(attributes) {
        values.metres_per_unit = Some(CENTIMETRE);
        from.findings.push(Finding::note("camera", "written by Unreal: a depth unit is a centimetre"));
    }
    if values.focus.is_none() {
        values.focus = from.standard_focus(values.metres_per_unit.unwrap_or(1.0));
    }
    from.findings.extend(renderers::complete(&mut values, attributes));
    (values, from.findings)
}

/// The header attributes for `values`, as this module reads them. Settings without an attribute are left out.
pub fn camera_attributes(values: &Values) -> Vec<(Text, AttributeValue)> {
    let attribute = |(name, value): (&'static str, Value)| {
        let value = match value {
            Value::Number(number) => AttributeValue::F32(number),
            Value::Pair([x, y]) => AttributeValue::FloatVec2(Vec2(x, y)),
            Value::Whole(number) => AttributeValue::I32(i32::try_from(number).ok()?),
            Value::Word(word) => AttributeValue::Text(Text::new_or_none(word)?),
            Value::Name(_) | Value::File(_) => return None,
        };
        Some((Text::new_or_none(name)?, value))
    };
    values.attributes().into_iter().filter_map(attribute).collect()
}

impl Lookup<'_> {
    /// The value of a standard attribute. An f-number of 0 is a pinhole where a program for USD wrote it.
    fn standard(&mut self, name: &str, setting: &Setting) -> Option<Value> {
        let value =
            || self.attributes.iter().find(|(found, _)| found.eq(name)).and_then(|(_, value)| number(value));
        if setting.key == "f_number" && value() == Some(0.0) && Writer::Usd.wrote(self.attributes) {
            self.findings.push(Finding::note(
                "camera",
                format!("{name} = 0 in the header is a pinhole, as USD defines it"),
            ));
            return Some(Value::Number(f32::INFINITY));
        }
        self.setting(name, setting, true)
    }

    /// The value of attribute `name`, if `setting` allows it; with `finite`, infinite values are not allowed.
    fn setting(&mut self, name: &str, setting: &Setting, finite: bool) -> Option<Value> {
        let (_, found) = self.attributes.iter().find(|(found, _)| found.eq(name))?;
        let value = match setting.kind {
            Kind::Number(_) => number(found).filter(|x| !finite || x.is_finite()).map(Value::Number),
            Kind::RedBlue(_) | Kind::Pixel => pair(found).map(Value::Pair),
            Kind::Whole(..) | Kind::Count { .. } => whole(found).map(Value::Whole),
            Kind::Word(words) => {
                let text = text(self.attributes, name)?;
                words
                    .iter()
                    .find(|word| text.eq_ignore_ascii_case(word.name))
                    .map(|word| Value::Word(word.name))
            }
            Kind::Name | Kind::File => None,
        };
        let value = value.filter(|value| setting.kind.allows(value));
        if value.is_none() {
            self.ignore(name, found, &setting.expected());
        }
        value
    }

    /// The standard `focus` attribute, converted from metres to depth units.
    fn standard_focus(&mut self, metres_per_unit: f32) -> Option<Focus> {
        let setting = Setting::by_key("focus_distance")?;
        match self.setting("focus", setting, false) {
            Some(Value::Number(metres)) => Some(Focus::Distance(metres / metres_per_unit)),
            _ => None,
        }
    }

    fn ignore(&mut self, name: &str, found: &AttributeValue, expected: &str) {
        let found = match found {
            AttributeValue::Text(text) => text.to_string(),
            AttributeValue::FloatVec2(pair) => format!("{},{}", pair.x(), pair.y()),
            found => number(found).map_or_else(|| "not a number".to_owned(), |number| number.to_string()),
        };
        self.findings.push(Finding::warning(
            "camera",
            format!("{name} = {found} in the header is ignored: it must be {expected}"),
        ));
    }
}

/// The small whole number that an attribute holds.
fn whole(value: &AttributeValue) -> Option<u32> {
    let number = number(value)?;
    let is_whole = number.fract() == 0.0 && (0.0..=f32::from(u16::MAX)).contains(&number);
    is_whole.then_some(number as u32)
}

/// The two numbers that an attribute holds.
fn pair(value: &AttributeValue) -> Option<[f32; 2]> {
    match value {
        AttributeValue::FloatVec2(pair) => Some([pair.x(), pair.y()]),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::SensorDistance;

    fn read(attributes: &[(&str, AttributeValue)]) -> (Values, Vec<Finding>) {
        let attributes: Vec<_> =
            attributes.iter().map(|(name, value)| (Text::new_or_panic(name), value.clone())).collect();
        values(&attributes)
    }

    #[test]
    fn attributes_of_thinlens_override_the_standard_ones() {
        let (values, findings) = read(&[
            ("aperture", AttributeValue::F32(8.0)),
            ("thinlens.f_number", AttributeValue::F32(1.4)),
            ("thinlens.blades", AttributeValue::I32(6)),
            ("thinlens.sensor_distance", AttributeValue::Text(Text::from("thin_lens"))),
        ]);
        assert_eq!(values.f_number, Some(1.4));
        assert_eq!(values.blades, Some(6));
        assert_eq!(values.sensor_distance, Some(SensorDistance::ThinLens));
        assert!(findings.is_empty());
    }

    #[test]
    fn the_standard_focus_is_in_metres() {
        let (values, _) = read(&[
            ("focus", AttributeValue::F32(6.0)),
            ("thinlens.metres_per_unit", AttributeValue::F32(0.01)),
            ("nominalFocalLength", AttributeValue::F32(85.0)),
            ("sensorOverallDimensions", AttributeValue::FloatVec2(Vec2(23.5, 15.6))),
        ]);
        assert_eq!(values.focus, Some(Focus::Distance(600.0)));
        assert_eq!(values.focal_length_mm, Some(85.0));
        assert_eq!(values.sensor_width_mm, Some(23.5));
    }

    #[test]
    fn an_impossible_number_of_blades_is_ignored_with_a_warning() {
        for (blades, expected) in
            [(0, Some(0)), (1, None), (2, None), (3, Some(3)), (100, Some(100)), (101, None)]
        {
            let (values, findings) = read(&[("thinlens.blades", AttributeValue::I32(blades))]);
            assert_eq!(
                (values.blades, findings.len()),
                (expected, usize::from(expected.is_none())),
                "{blades}"
            );
        }
    }

    #[test]
    fn invalid_camera_data_is_ignored_with_a_warning() {
        let (values, findings) = read(&[
            ("thinlens.focal_length_mm", AttributeValue::F32(f32::NAN)),
            ("aperture", AttributeValue::F32(-2.0)),
            ("thinlens.blades", AttributeValue::F32(5.5)),
            ("thinlens.blade_curvature", AttributeValue::F32(1.5)),
            ("thinlens.squeeze", AttributeValue::F32(0.5)),
            ("thinlens.depth_convention", AttributeValue::Text(Text::from("sideways"))),
        ]);
        assert_eq!(values, Values::default());
        assert_eq!(findings.len(), 6);
        assert!(findings.iter().all(|finding| finding.warning));
    }
}
