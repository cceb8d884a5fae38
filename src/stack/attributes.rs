//! Values of attributes of a header.

use exr::meta::attribute::{AttributeValue, Text};

/// The text of attribute `name`; `None` if it is missing or not a text.
pub(super) fn text(attributes: &[(Text, AttributeValue)], name: &str) -> Option<String> {
    attributes.iter().find(|(found, _)| found.eq(name)).and_then(|(_, value)| match value {
        AttributeValue::Text(text) => Some(text.to_string()),
        _ => None,
    })
}

/// The number that an attribute holds.
pub(super) fn number(value: &AttributeValue) -> Option<f32> {
    match value {
        AttributeValue::F32(number) => Some(*number),
        AttributeValue::F64(number) => Some(*number as f32),
        AttributeValue::I32(number) => Some(*number as f32),
        AttributeValue::FloatVec2(size) => Some(size.x()),
        AttributeValue::Rational((over, under)) => Some((f64::from(*over) / f64::from(*under)) as f32),
        AttributeValue::Text(text) => text.to_string().trim().parse().ok(),
        _ => None,
    }
}
