//! Camera data in the header of an OpenEXR file: ours first (`thinlens.…`), then the standard attributes.

use crate::finding::Finding;
use crate::settings::{
    ABERRATIONS_UM, BLADE_CURVATURES, CATS_EYES, DepthConvention, Focus, MAX_BLADES, SQUEEZES,
    SensorDistance, VIGNETTINGS, Values,
};
use exr::meta::attribute::{AttributeValue, Text};

/// Attributes of one header, looked up by name.
struct Lookup<'a> {
    attributes: &'a [(Text, AttributeValue)],
    findings: Vec<Finding>,
}

/// Which values of an attribute make sense.
#[derive(Clone, Copy)]
enum Range {
    Positive,
    NotNegative,
    /// From the first to the second.
    Within([f32; 2]),
    Any,
}

/// The settings that `attributes` hold. What makes no sense is left out, with a warning.
pub(super) fn values(attributes: &[(Text, AttributeValue)]) -> (Values, Vec<Finding>) {
    let mut from = Lookup { attributes, findings: Vec::new() };
    let metres_per_unit = from.number("thinlens.metres_per_unit", Range::Positive);
    let focus_distance = from.number("thinlens.focus_distance", Range::Positive).or_else(|| {
        // The standard says metres.
        from.number("focus", Range::Positive).map(|metres| metres / metres_per_unit.unwrap_or(1.0))
    });
    let nominal = |from: &mut Lookup<'_>| {
        let effective = from.number("effectiveFocalLength", Range::Positive);
        effective.or_else(|| from.number("nominalFocalLength", Range::Positive))
    };
    let values = Values {
        focal_length_mm: from
            .number("thinlens.focal_length_mm", Range::Positive)
            .or_else(|| nominal(&mut from)),
        f_number: from
            .number("thinlens.f_number", Range::Positive)
            .or_else(|| from.number("aperture", Range::Positive)),
        focus: focus_distance.map(Focus::Distance),
        sensor_width_mm: from
            .number("thinlens.sensor_width_mm", Range::Positive)
            .or_else(|| from.number("sensorOverallDimensions", Range::Positive)),
        sensor_distance: from.word(
            "thinlens.sensor_distance",
            &[("focal_length", SensorDistance::FocalLength), ("thin_lens", SensorDistance::ThinLens)],
        ),
        blades: from.blades("thinlens.blades"),
        rotation_deg: from.number("thinlens.rotation_deg", Range::Any),
        blade_curvature: from.number("thinlens.blade_curvature", Range::Within(BLADE_CURVATURES)),
        squeeze: from.number("thinlens.squeeze", Range::Within(SQUEEZES)),
        aperture_image: None,
        cats_eye: from.number("thinlens.cats_eye", Range::Within(CATS_EYES)),
        vignetting: from.number("thinlens.vignetting", Range::Within(VIGNETTINGS)),
        spherical_um: from.number("thinlens.spherical_um", Range::Within(ABERRATIONS_UM)),
        axial_color_um: from.pair("thinlens.axial_color_um", ABERRATIONS_UM),
        lateral_color_um: from.pair("thinlens.lateral_color_um", ABERRATIONS_UM),
        convention: from.word(
            "thinlens.depth_convention",
            &[
                ("planar", DepthConvention::Planar),
                ("ray", DepthConvention::Ray),
                ("inverse", DepthConvention::Inverse),
                ("normalised", DepthConvention::Normalised),
            ],
        ),
        metres_per_unit,
        near_clip: from.number("thinlens.near_clip", Range::NotNegative),
        near: from.number("thinlens.near", Range::NotNegative),
        far: from.number("thinlens.far", Range::Positive),
        supersample: from.whole("thinlens.supersample").filter(|&samples| samples > 0).map(usize::from),
        // What is no matter of the camera.
        ..Values::default()
    };
    (values, from.findings)
}

/// The text of attribute `name`, if it has one.
pub(super) fn text(attributes: &[(Text, AttributeValue)], name: &str) -> Option<String> {
    attributes.iter().find(|(found, _)| found.eq(name)).and_then(|(_, value)| match value {
        AttributeValue::Text(text) => Some(text.to_string()),
        _ => None,
    })
}

impl Lookup<'_> {
    fn number(&mut self, name: &'static str, range: Range) -> Option<f32> {
        let (_, value) = self.attributes.iter().find(|(found, _)| found.eq(name))?;
        let number = match value {
            AttributeValue::F32(number) => Some(*number),
            AttributeValue::F64(number) => Some(*number as f32),
            AttributeValue::I32(number) => Some(*number as f32),
            AttributeValue::FloatVec2(size) => Some(size.x()),
            AttributeValue::Rational((over, under)) => Some((f64::from(*over) / f64::from(*under)) as f32),
            AttributeValue::Text(text) => text.to_string().trim().parse().ok(),
            _ => None,
        };
        let sensible = number.filter(|number| {
            number.is_finite()
                && match range {
                    Range::Positive => *number > 0.0,
                    Range::NotNegative => *number >= 0.0,
                    Range::Within([least, most]) => (least..=most).contains(number),
                    Range::Any => true,
                }
        });
        if sensible.is_none() {
            let found = number.map_or_else(|| "no number".to_owned(), |number| number.to_string());
            self.ignore(name, &found);
        }
        sensible
    }

    /// Two numbers, each within `ends`.
    fn pair(&mut self, name: &'static str, [least, most]: [f32; 2]) -> Option<[f32; 2]> {
        let (_, value) = self.attributes.iter().find(|(found, _)| found.eq(name))?;
        let pair = match value {
            AttributeValue::FloatVec2(pair) => Some([pair.x(), pair.y()]),
            _ => None,
        };
        let sensible = pair.filter(|pair| pair.iter().all(|number| (least..=most).contains(number)));
        if sensible.is_none() {
            let found = pair.map_or_else(|| "no pair of numbers".to_owned(), |pair| format!("{pair:?}"));
            self.ignore(name, &found);
        }
        sensible
    }

    /// A number of blades: 0, or 3 and more.
    fn blades(&mut self, name: &'static str) -> Option<u32> {
        let blades = u32::from(self.whole(name)?);
        if matches!(blades, 0 | 3..=MAX_BLADES) {
            return Some(blades);
        }
        self.ignore(name, &blades.to_string());
        None
    }

    /// A small whole number.
    fn whole(&mut self, name: &'static str) -> Option<u16> {
        let number = self.number(name, Range::NotNegative)?;
        if number.fract() == 0.0 && number <= f32::from(u16::MAX) {
            Some(number as u16)
        } else {
            self.ignore(name, &number.to_string());
            None
        }
    }

    fn word<T: Copy>(&mut self, name: &'static str, words: &[(&str, T)]) -> Option<T> {
        let found = text(self.attributes, name)?;
        let known = words.iter().find(|(word, _)| found.eq_ignore_ascii_case(word)).map(|(_, value)| *value);
        if known.is_none() {
            self.ignore(name, &found);
        }
        known
    }

    fn ignore(&mut self, name: &str, found: &str) {
        self.findings.push(Finding::warning(
            "camera",
            format!("{name} = {found} in the header makes no sense: ignored"),
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::math::Vec2;

    fn read(attributes: &[(&str, AttributeValue)]) -> (Values, Vec<Finding>) {
        let attributes: Vec<_> =
            attributes.iter().map(|(name, value)| (Text::new_or_panic(name), value.clone())).collect();
        values(&attributes)
    }

    #[test]
    fn our_own_attributes_beat_the_standard_ones() {
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
    fn an_aperture_that_cannot_be_is_ignored_with_a_warning() {
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
    fn camera_data_that_makes_no_sense_is_ignored_with_a_warning() {
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
