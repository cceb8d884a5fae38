//! The camera in a header, corrected to the lens that was used.
//!
//! A header travels from input to output. Where a preset or a flag overruled it, or where it holds the camera under a name that is not
//! read, it would say something else than the picture shows. The attributes of thinlens are written for every setting, the standard
//! ones are corrected, and attributes of renderers that contradict the lens are left out. What describes the geometry of the picture,
//! such as a field of view or a camera matrix, stays: a blur does not change it.

use super::attributes::number;
use super::camera::{STANDARD, camera_attributes};
use crate::finding::Finding;
use crate::settings::{Focus, LensSettings, Origin, Values};
use exr::math::Vec2;
use exr::meta::attribute::{AttributeValue, Text};

/// The names of renderers for what a setting says, by the key of the setting: in small letters, without the path before the last `/`,
/// `:` or `.` and without `_`, `-` and spaces. Lengths are in mm, distances in depth units or in metres.
const FOREIGN: [(&str, &[&str]); 4] = [
    (
        "focal_length_mm",
        &[
            "focallength",
            "focallengthmm",
            "camerafocallength",
            "lens",
            "lensfocallength",
            "pinholefocallength",
        ],
    ),
    ("f_number", &["fnumber", "fstop", "camerafnumber", "camerafstop", "aperturefstop"]),
    (
        "sensor_width_mm",
        &["sensorwidth", "cameraaperture", "horizontalaperture", "filmwidth", "camerafilmwidth"],
    ),
    (
        "focus_distance",
        &[
            "focusdistance",
            "focaldistance",
            "camerafocusdistance",
            "camerafocaldistance",
            "cameratargetdistance",
        ],
    ),
];

/// Standard attributes that follow from a setting in a way that is not known here, by the key of the setting. They stay only where the
/// header decided the setting.
const DEPENDENT: [(&str, &[&str]); 2] =
    [("f_number", &["tStop"]), ("sensor_width_mm", &["sensorPhotositePitch", "sensorAcquisitionRectangle"])];

/// Numbers of one quantity differ by less than this share of them, where one is rounded as in `85.00 mm` or `f/2.8`.
const ROUNDING: f32 = 0.005;

/// Attributes by name.
type Attributes = Vec<(Text, AttributeValue)>;

/// Makes `attributes` say that the lens is `lens`, focused at `focus_distance` in depth units; a finding about those that said
/// something else.
pub(crate) fn correct_camera(
    attributes: &mut Attributes,
    lens: &LensSettings,
    focus_distance: f32,
) -> Option<Finding> {
    let used = Values { focus: Some(Focus::Distance(focus_distance)), ..lens.values() };
    let before = attributes.clone();
    let own = camera_attributes(&used);
    attributes.retain(|(name, _)| !own.iter().any(|(written, _)| written == name));
    attributes.retain(|(name, value)| !contradicts(name, value, &used));
    for (key, names) in DEPENDENT {
        if !from_header(lens, key) {
            attributes.retain(|(name, _)| !names.iter().any(|dependent| name.eq(dependent)));
        }
    }
    for (name, value) in standard(&before, lens, focus_distance) {
        attributes.retain(|(other, _)| !other.eq(name));
        attributes.extend(value.and_then(|value| Some((Text::new_or_none(name)?, value))));
    }
    let finding = changed(&before, attributes, &own);
    attributes.extend(own);
    finding
}

/// Whether the header decided the setting `key`.
fn from_header(lens: &LensSettings, key: &str) -> bool {
    lens.listed().iter().any(|listed| listed.setting.key == key && *listed.origin == Origin::Header)
}

/// Whether an attribute of a renderer says something else than `used`.
fn contradicts(name: &Text, value: &AttributeValue, used: &Values) -> bool {
    let name = name.to_string();
    let last = name.rsplit(['/', ':', '.']).next().unwrap_or_default();
    let plain: String = last.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect();
    let Some((key, _)) = FOREIGN.iter().find(|(_, names)| names.contains(&plain.as_str())) else {
        return false;
    };
    let Some(found) = number(value).or_else(|| leading_number(value)) else { return false };
    let is = |expected: f32| found == expected || (found - expected).abs() <= ROUNDING * expected.abs();
    let unit = used.metres_per_unit.unwrap_or(1.0);
    !match (*key, &used.focus) {
        ("focal_length_mm", _) => used.focal_length_mm.is_some_and(is),
        ("f_number", _) => used.f_number.is_some_and(is),
        ("sensor_width_mm", _) => used.sensor_width_mm.is_some_and(is),
        (_, Some(Focus::Distance(distance))) => is(*distance) || is(distance * unit),
        _ => true,
    }
}

/// The number in a text such as `85.00 mm` or `f/2.8`.
fn leading_number(value: &AttributeValue) -> Option<f32> {
    let AttributeValue::Text(text) = value else { return None };
    let text = text.to_string();
    let text = text.trim().trim_start_matches(['f', 'F', '/', ' ']);
    let end = text.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(text.len());
    text[..end].parse().ok()
}

/// The standard attributes for `lens`: those that `before` has, and those whose value the user or the header gave. `None` where the
/// standard cannot hold the value.
fn standard(
    before: &Attributes,
    lens: &LensSettings,
    focus_distance: f32,
) -> Vec<(&'static str, Option<AttributeValue>)> {
    let there = |name: &str| before.iter().find(|(other, _)| other.eq(name)).map(|(_, value)| value);
    let finite = |number: f32| number.is_finite().then_some(AttributeValue::F32(number));
    let mut all = Vec::new();
    for (key, names) in STANDARD {
        let (given, value) = match key {
            "focal_length_mm" => (lens.focal_length_mm.origin != Origin::Default, lens.focal_length_mm.value),
            "f_number" => (lens.f_number.origin != Origin::Default, lens.f_number.value),
            _ => (false, lens.sensor_width_mm.value),
        };
        let present: Vec<_> = names.iter().copied().filter(|name| there(name).is_some()).collect();
        let added = if given && present.is_empty() { names.last().copied() } else { None };
        for name in present.into_iter().chain(added) {
            let corrected = match there(name) {
                Some(old) if number(old) == Some(value) => Some(old.clone()),
                Some(AttributeValue::FloatVec2(size)) => {
                    Some(AttributeValue::FloatVec2(scaled(*size, value)))
                }
                _ => finite(value),
            };
            all.push((name, corrected));
        }
    }
    if there("focus").is_some() || lens.metres_per_unit.origin != Origin::Default {
        all.push(("focus", finite(focus_distance * lens.metres_per_unit.value)));
    }
    all
}

/// The size of a sensor of this `width` with the proportions of `size`.
fn scaled(size: Vec2<f32>, width: f32) -> Vec2<f32> {
    let ratio = if size.x() > 0.0 { size.y() / size.x() } else { 0.0 };
    Vec2(width, width * ratio)
}

/// The finding about attributes of `before` that `after` lacks or has changed, apart from thinlens' `own` ones that only gained a value.
fn changed(before: &Attributes, after: &Attributes, own: &Attributes) -> Option<Finding> {
    let same = |name: &Text, value: &AttributeValue| {
        let kept = |all: &Attributes| all.iter().any(|(other, kept)| other == name && kept == value);
        kept(after) || kept(own)
    };
    let names: Vec<String> =
        before.iter().filter(|(name, value)| !same(name, value)).map(|(name, _)| name.to_string()).collect();
    let text = format!(
        "the output's header has the lens that was used: {} of the input said something else",
        names.join(", ")
    );
    (!names.is_empty()).then(|| Finding::note("header", text))
}
