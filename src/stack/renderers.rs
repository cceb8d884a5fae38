//! Camera data that renderers write under names of their own. It fills what the standard attributes leave open.
//!
//! | program | attributes |
//! | --- | --- |
//! | V-Ray | `cameraFocalLength`, `cameraFNumber`, `cameraAperture` (mm), `cameraFov` (degrees), `cameraFocusDistance`, `cameraTargetDistance` |
//! | Unreal | `unreal/camera/…/focalLength`, `fstop`, `sensorWidth`, `fov`, `focalDistance` |
//! | USD | `focalLength`, `fStop`, `horizontalAperture`, `focusDistance`, after any path; `fStop` 0 is a pinhole |
//! | Blender | `Lens`: `85.00 mm` |
//! | cameras | `sensorAcquisitionRectangle` in photosites of `sensorPhotositePitch` µm |
//!
//! A field of view and a sensor give the focal length. Distances are in depth units; 1e9 and more say that there is none.

use super::attributes::{self as attribute, number};
use super::depth::BACKGROUND;
use super::writer::Writer;
use crate::finding::Finding;
use crate::settings::{Focus, Values};
use exr::meta::attribute::{AttributeValue, Text};

/// The names of a program for what a setting says: the last part of an attribute's name.
#[derive(Debug, Clone, Copy)]
struct Names {
    writer: Writer,
    focal_length_mm: &'static str,
    f_number: &'static str,
    sensor_width_mm: &'static str,
    fov_deg: &'static str,
    /// The first that is there is used.
    focus: &'static [&'static str],
}

const PROGRAMS: [Names; 3] = [
    Names {
        writer: Writer::VRay,
        focal_length_mm: "cameraFocalLength",
        f_number: "cameraFNumber",
        sensor_width_mm: "cameraAperture",
        fov_deg: "cameraFov",
        focus: &["cameraFocusDistance", "cameraTargetDistance"],
    },
    Names {
        writer: Writer::Unreal,
        focal_length_mm: "focalLength",
        f_number: "fstop",
        sensor_width_mm: "sensorWidth",
        fov_deg: "fov",
        focus: &["focalDistance", "focusDistance"],
    },
    Names {
        writer: Writer::Usd,
        focal_length_mm: "focalLength",
        f_number: "fStop",
        sensor_width_mm: "horizontalAperture",
        fov_deg: "",
        focus: &["focusDistance"],
    },
];

/// Fills what `values` leave open with the camera data of renderers in `attributes`; a note that says what was filled.
pub(super) fn complete(values: &mut Values, attributes: &[(Text, AttributeValue)]) -> Option<Finding> {
    let mut used: Vec<String> = Vec::new();
    let mut fill = |slot: &mut Option<f32>, name: String, value: Option<f32>| {
        if let (None, Some(value)) = (&slot, value) {
            *slot = Some(value);
            used.push(name);
        }
    };
    let (photosites, width_mm) = acquisition_width(attributes);
    fill(&mut values.sensor_width_mm, photosites.to_owned(), width_mm);
    if Writer::Blender.wrote(attributes) {
        fill(&mut values.focal_length_mm, "Lens".to_owned(), blender_lens_mm(attributes));
    }
    for program in PROGRAMS.iter().filter(|program| program.writer.wrote(attributes)) {
        let find = |name: &str| found(attributes, name);
        let positive = |name: &str| find(name).filter(|(_, value)| *value > 0.0 && value.is_finite());
        let mut take = |slot: &mut Option<f32>, from: Option<(String, f32)>| {
            let (name, value) = from.unzip();
            fill(slot, name.unwrap_or_default(), value);
        };
        take(&mut values.sensor_width_mm, positive(program.sensor_width_mm));
        take(&mut values.focal_length_mm, positive(program.focal_length_mm));
        let width_mm = values.sensor_width_mm;
        let of_fov =
            positive(program.fov_deg).and_then(|(name, fov)| Some((name, focal_length_mm(fov, width_mm?)?)));
        take(&mut values.focal_length_mm, of_fov);
        let pinhole =
            || find(program.f_number).filter(|(_, stop)| *stop == 0.0 && program.writer == Writer::Usd);
        let f_number = positive(program.f_number);
        take(&mut values.f_number, f_number.or_else(|| pinhole().map(|(name, _)| (name, f32::INFINITY))));
        let is_set = |(_, distance): &(String, f32)| *distance < BACKGROUND;
        let distance = program.focus.iter().find_map(|name| positive(name).filter(is_set));
        let mut focus = None;
        // V-Ray writes the f-number of physical cameras alone: the target of another is no focus.
        let has_focus = program.writer != Writer::VRay || positive(program.f_number).is_some();
        if values.focus.is_none() && has_focus {
            take(&mut focus, distance);
            values.focus = focus.map(Focus::Distance);
        }
    }
    let text = format!("{} of the header: the renderer's camera", used.join(", "));
    (!used.is_empty()).then(|| Finding::note("camera", text))
}

/// The first attribute whose name ends in `name` after a `/`, `:` or `.`, and its number.
fn found(attributes: &[(Text, AttributeValue)], name: &str) -> Option<(String, f32)> {
    if name.is_empty() {
        return None;
    }
    attributes.iter().find_map(|(text, value)| {
        let full = text.to_string();
        let last = full.rsplit(['/', ':', '.']).next().unwrap_or_default();
        if last == name { Some((full.clone(), number(value)?)) } else { None }
    })
}

/// The focal length of a lens that sees `fov_deg` on a sensor of this width.
fn focal_length_mm(fov_deg: f32, width_mm: f32) -> Option<f32> {
    (fov_deg < 180.0).then(|| 0.5 * width_mm / (0.5 * fov_deg.to_radians()).tan())
}

/// The focal length in Blender's `Lens`, such as `85.00 mm`.
fn blender_lens_mm(attributes: &[(Text, AttributeValue)]) -> Option<f32> {
    let text = attribute::text(attributes, "Lens")?;
    let number: f32 = text.trim().trim_end_matches("mm").trim().parse().ok()?;
    (number > 0.0 && number.is_finite()).then_some(number)
}

/// The attribute's name, and the width in mm of the part of the sensor that the picture shows.
fn acquisition_width(attributes: &[(Text, AttributeValue)]) -> (&'static str, Option<f32>) {
    const NAME: &str = "sensorAcquisitionRectangle";
    let find = |name: &str| attributes.iter().find(|(found, _)| found.eq(name)).map(|(_, value)| value);
    let pitch_um =
        find("sensorPhotositePitch").and_then(number).filter(|pitch| *pitch > 0.0 && pitch.is_finite());
    let width = match (find(NAME), pitch_um) {
        (Some(AttributeValue::IntegerBounds(bounds)), Some(pitch)) if bounds.size.width() > 0 => {
            Some(bounds.size.width() as f32 * pitch / 1000.0)
        }
        _ => None,
    };
    (NAME, width)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn completed(attributes: &[(&str, AttributeValue)]) -> Values {
        let attributes: Vec<_> =
            attributes.iter().map(|(name, value)| (Text::new_or_panic(name), value.clone())).collect();
        let mut values = Values::default();
        complete(&mut values, &attributes);
        values
    }

    #[test]
    fn a_field_of_view_and_a_sensor_give_the_focal_length() {
        let number = AttributeValue::F32;
        let values = completed(&[
            ("vrayInfo/camera", AttributeValue::Text(Text::from("cam"))),
            ("cameraAperture", number(36.0)),
            ("cameraFov", number(90.0)),
            ("cameraTargetDistance", number(508.0)),
        ]);
        assert!((values.focal_length_mm.expect("of the field of view") - 18.0).abs() < 1e-4);
        assert_eq!((values.sensor_width_mm, values.f_number, values.focus), (Some(36.0), None, None));
    }

    #[test]
    fn the_target_of_a_physical_camera_is_its_focus_unless_it_is_infinitely_far() {
        let focus = |distance: f32| {
            completed(&[
                ("vrayInfo/camera", AttributeValue::Text(Text::from("cam"))),
                ("cameraFNumber", AttributeValue::F32(8.0)),
                ("cameraTargetDistance", AttributeValue::F32(distance)),
            ])
            .focus
        };
        assert_eq!(focus(6.5), Some(Focus::Distance(6.5)));
        assert_eq!(focus(1e18), None);
    }

    #[test]
    fn an_f_stop_of_0_is_a_pinhole_of_usd_alone() {
        let stop = ("karma:fStop", AttributeValue::F32(0.0));
        assert_eq!(completed(&[stop]).f_number, Some(f32::INFINITY));
        assert_eq!(completed(&[("unreal/camera/FinalImage/fstop", AttributeValue::F32(0.0))]).f_number, None);
    }
}
