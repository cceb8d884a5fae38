//! Whether depth, focus and lens are in one unit: a warning where the blur says that they are not.
//!
//! A lens that blurs nothing, or everything, or across a quarter of the frame, is possible. With a scene in centimetres that is read as metres
//! it is the rule. The warning has the depths that are in use and, where one fits, the likely unit.

use crate::finding::Finding;
use crate::scene::DepthInUse;
use crate::settings::{Focus, Settings};

/// Units that scenes are made in, in metres, likelier ones first.
const UNITS: [(&str, f32); 5] =
    [("centimetre", 0.01), ("millimetre", 0.001), ("metre", 1.0), ("foot", 0.3048), ("inch", 0.0254)];
/// Distances of most pictures, in metres.
const USUAL_METRES: [f32; 2] = [0.3, 100.0];
/// An f-number below this is set to see blur.
const FAST_F_NUMBER: f32 = 4.0;
/// CoC radius in pixels below which nothing is blurred, if it is a small share of the frame's width or the depths are unusual.
const NO_BLUR_PX: f32 = 0.5;
/// Such a share.
const NO_BLUR_SHARE: f32 = 1e-3;
/// CoC radius in pixels, and as a share of the frame's width, from which on something is blurred.
const BLUR: (f32, f32) = (2.0, 1.0 / 400.0);
/// Share of the fragments with a CoC radius above a quarter of the frame that is worth a warning.
const WIDE_SHARE: f64 = 0.01;
/// Focus lies this many times nearer or farther than all depths.
const OUTSIDE: f32 = 10.0;
/// How far a focus distance in another unit may lie outside of the depths.
const NEARLY: f32 = 1.5;

/// What the warning is about.
#[derive(Debug, Clone, Copy)]
struct Setting {
    focus: f32,
    is_given: bool,
    f_number: f32,
    metres_per_unit: f32,
}

/// A warning if the depths `in_use`, with focus at `focus` depth units, are not in the units of `settings`.
pub(super) fn doubt(in_use: &DepthInUse, settings: &Settings, focus: f32) -> Option<Finding> {
    let lens = &settings.lens;
    doubt_of(
        in_use,
        Setting {
            focus,
            is_given: matches!(lens.focus.value, Focus::Distance(_)),
            f_number: lens.f_number.value,
            metres_per_unit: lens.metres_per_unit.value,
        },
    )
}

fn doubt_of(in_use: &DepthInUse, set: Setting) -> Option<Finding> {
    let [near, far] = in_use.range;
    if near > far || !set.f_number.is_finite() {
        return None;
    }
    let fact = fact(in_use, set)?;
    let text = format!(
        "{fact}; the depths in use are {} to {}, focus {}, in units of {} m: {}",
        short(near),
        short(far),
        short(set.focus),
        set.metres_per_unit,
        advice(in_use, set)
    );
    Some(Finding::warning("units", text))
}

/// What is unusual, if anything is.
fn fact(in_use: &DepthInUse, set: Setting) -> Option<String> {
    let [near, far] = in_use.range;
    let [least_px, most_px] = in_use.coc_px;
    let (width_px, focus) = (in_use.width_px, set.focus);
    let blur_px = BLUR.0.max(BLUR.1 * width_px);
    if is_outside(in_use, focus) && least_px >= NO_BLUR_PX {
        let factor = if focus > far { focus / far } else { near / focus };
        let blur = if least_px >= blur_px {
            format!("everything is blurred, by a CoC radius of at least {} px", short(least_px))
        } else {
            format!("the largest CoC radius is {} px", short(most_px))
        };
        return Some(format!("focus lies outside of the depths by a factor of {}: {blur}", short(factor)));
    }
    let is_fast = set.f_number < FAST_F_NUMBER && far > near;
    let is_unusual = likely_by_size(in_use, set).is_some();
    let (few_px, small_share) = (most_px < NO_BLUR_PX, most_px < NO_BLUR_SHARE * width_px);
    // A small picture of usual depths has a blur of few pixels, and one of much of its width.
    if is_fast && (few_px && small_share || is_unusual && (few_px || small_share)) {
        return Some(format!(
            "nothing is blurred: the largest CoC radius is {} px at f/{}",
            short(most_px),
            set.f_number
        ));
    }
    if in_use.wide as f64 >= WIDE_SHARE * in_use.fragments.max(1) as f64 && in_use.wide > 0 {
        return Some(format!(
            "the CoC radius is up to {} px, and above a quarter of the frame's {width_px} px for {:.0} % of the fragments",
            short(most_px),
            100.0 * in_use.wide as f64 / in_use.fragments as f64
        ));
    }
    let is_off = focus < near || focus > far;
    (is_off && least_px >= blur_px)
        .then(|| format!("everything is blurred, by a CoC radius of at least {} px", short(least_px)))
}

/// Whether `focus` is far nearer or farther than all depths.
fn is_outside(in_use: &DepthInUse, focus: f32) -> bool {
    let [near, far] = in_use.range;
    focus > OUTSIDE * far || focus * OUTSIDE < near
}

/// What to do: the likely unit with its setting, or what there is to check.
fn advice(in_use: &DepthInUse, set: Setting) -> String {
    let [near, far] = in_use.range;
    let is_within = |focus: f32| focus >= near / NEARLY && focus <= far * NEARLY;
    let is_unusual = is_outside(in_use, set.focus) || likely_by_size(in_use, set).is_some();
    if set.is_given && is_unusual && !is_within(set.focus) {
        // A focus distance that was typed in metres.
        let metres = set.focus;
        let in_units = |&&(_, unit): &&(&str, f32)| unit != set.metres_per_unit && is_within(metres / unit);
        if let Some((name, unit)) = UNITS.iter().find(in_units) {
            return format!(
                "if a unit is a {name} and focus is meant in metres, set `metres_per_unit = {unit}` and `focus_distance = {}`",
                short(metres / unit)
            );
        }
    }
    match likely_by_size(in_use, set) {
        Some((name, unit)) => {
            format!("if a unit is a {name}, set `metres_per_unit = {unit}`; focus is in these units too")
        }
        None => "check `metres_per_unit`, and `focus_distance`, which is in these units".to_owned(),
    }
}

/// The unit with which depths at unusual distances would lie at usual ones.
fn likely_by_size(in_use: &DepthInUse, set: Setting) -> Option<(&'static str, f32)> {
    let middle = (in_use.range[0] * in_use.range[1]).sqrt();
    let is_usual = |unit: f32| middle * unit >= USUAL_METRES[0] && middle * unit <= USUAL_METRES[1];
    if is_usual(set.metres_per_unit) {
        return None;
    }
    UNITS.into_iter().find(|&(_, unit)| is_usual(unit))
}

/// A number in at most four digits, where it is not longer in whole.
fn short(number: f32) -> String {
    let magnitude = number.abs();
    let rounded = match magnitude {
        magnitude if !(1e-3..1e6).contains(&magnitude) && magnitude > 0.0 => return format!("{number:.2e}"),
        magnitude if magnitude < 0.1 => format!("{number:.4}"),
        magnitude if magnitude < 10.0 => format!("{number:.2}"),
        magnitude if magnitude < 100.0 => format!("{number:.1}"),
        _ => return format!("{number:.0}"),
    };
    rounded.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::{LensSpec, ThinLens};
    use crate::settings::SensorDistance;

    /// The warning for surfaces from `near` to `far` units, with a 135 mm lens at f/1 on a 36 mm sensor of 160 px.
    fn doubted(range: [f32; 2], focus: f32, metres_per_unit: f32) -> Option<String> {
        let spec = LensSpec {
            focal_length_mm: 135.0,
            f_number: 1.0,
            focus_distance: focus,
            sensor_width_mm: 36.0,
            sensor_distance: SensorDistance::FocalLength,
            metres_per_unit,
        };
        let lens = ThinLens::new(&spec, 160.0).unwrap();
        let cocs = range.map(|depth| lens.coc_radius_px(depth).abs());
        let least = if (range[0]..=range[1]).contains(&focus) { 0.0 } else { cocs[0].min(cocs[1]) };
        let most = cocs[0].max(cocs[1]);
        let wide = u64::from(most > 40.0) * 100;
        let in_use = DepthInUse { range, coc_px: [least, most], fragments: 100, wide, width_px: 160.0 };
        let set = Setting { focus, is_given: true, f_number: 1.0, metres_per_unit };
        doubt_of(&in_use, set).map(|finding| finding.text)
    }

    #[test]
    fn metres_are_not_doubted() {
        assert_eq!(doubted([3.0, 12.0], 3.0, 1.0), None);
        assert_eq!(doubted([300.0, 1200.0], 300.0, 0.01), None);
    }

    #[test]
    fn a_small_picture_of_usual_depths_is_not_doubted_and_a_large_one_without_blur_is() {
        let doubted = |most_px, width_px| {
            let in_use =
                DepthInUse { range: [3.0, 12.0], coc_px: [0.0, most_px], fragments: 100, wide: 0, width_px };
            let set = Setting { focus: 3.0, is_given: true, f_number: 2.8, metres_per_unit: 1.0 };
            doubt_of(&in_use, set).is_some()
        };
        assert!(!doubted(0.15, 48.0));
        assert!(doubted(0.15, 1920.0) && !doubted(6.0, 1920.0));
    }

    #[test]
    fn centimetres_read_as_metres_are_named_whatever_focus_is() {
        let in_focus = doubted([300.0, 1200.0], 300.0, 1.0).unwrap();
        assert!(in_focus.starts_with("nothing is blurred"), "{in_focus}");
        let typed = doubted([300.0, 1200.0], 3.0, 1.0).unwrap();
        assert!(typed.contains("by a factor of 100"), "{typed}");
        assert!(typed.contains("`focus_distance = 300`"), "{typed}");
        for text in [in_focus, typed] {
            assert!(text.contains("300 to 1200") && text.contains("`metres_per_unit = 0.01`"), "{text}");
        }
    }

    #[test]
    fn metres_read_as_centimetres_blur_across_the_frame() {
        let text = doubted([16.0, 40.0], 20.0, 0.01).unwrap();
        assert!(
            text.contains("above a quarter of the frame") && text.contains("`metres_per_unit = 1`"),
            "{text}"
        );
    }

    #[test]
    fn focus_beside_the_depths_is_said_where_it_shows() {
        let text = doubted([3.0, 12.0], 2.0, 1.0).unwrap();
        assert!(text.starts_with("everything is blurred"), "{text}");
        assert!(
            text.ends_with("check `metres_per_unit`, and `focus_distance`, which is in these units"),
            "{text}"
        );
        assert_eq!(doubted([3.0, 12.0], 2.9, 1.0), None);
    }

    #[test]
    fn numbers_are_short() {
        let shown = [0.0, 0.034, 3.0, 12.5, 1200.0, 2.5e7, 2e-5].map(short);
        assert_eq!(shown, ["0", "0.034", "3", "12.5", "1200", "2.50e7", "2.00e-5"]);
    }
}
