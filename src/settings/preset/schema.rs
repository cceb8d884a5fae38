//! What a preset may hold: [`SCHEMA`] is the one list of keys, how each is checked and where it goes. The `[method.NAME]` tables
//! are the methods' own and are checked by them, so that a new method needs no line here.

use super::super::{
    ABERRATIONS_UM, BLADE_CURVATURES, Border, CATS_EYES, DepthConvention, EXTRAPOLATION_FALLOFFS,
    EXTRAPOLATION_GAINS, EXTRAPOLATION_THRESHOLDS, Easing, Effort, Focus, Quality, SQUEEZES, SensorDistance,
    VIGNETTINGS, Values,
};
use super::entry::Entry;
use crate::error::Error;

/// A key that a preset may hold: its table, its name, and how its value is checked and kept.
pub(super) struct Key {
    pub(super) table: &'static str,
    pub(super) name: &'static str,
    pub(super) set: fn(&mut Values, &Entry<'_>) -> Result<(), Error>,
}

/// Every key outside the `[method.NAME]` tables.
pub(super) static SCHEMA: [Key; 33] = {
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
        key("lens", "focus_object", |v, e| e.focus(v, Focus::Object(e.text()?.to_owned()))),
        key("lens", "focus_keys", |v, e| e.focus(v, Focus::Keys(e.focus_keys()?))),
        key("lens", "sensor_width_mm", |v, e| e.positive().map(|x| v.sensor_width_mm = Some(x))),
        key("lens", "sensor_distance", |v, e| {
            e.one_of(&SENSOR_DISTANCES).map(|x| v.sensor_distance = Some(x))
        }),
        key("lens", "vignetting", |v, e| {
            e.within(VIGNETTINGS, "0 for none, 1 for the lens's own").map(|x| v.vignetting = Some(x))
        }),
        key("aperture", "blades", |v, e| e.blades().map(|x| v.blades = Some(x))),
        key("aperture", "rotation_deg", |v, e| e.finite().map(|x| v.rotation_deg = Some(x))),
        key("aperture", "blade_curvature", |v, e| {
            e.within(BLADE_CURVATURES, "straight is 0, round is 1").map(|x| v.blade_curvature = Some(x))
        }),
        key("aperture", "squeeze", |v, e| {
            e.within(SQUEEZES, "height over width").map(|x| v.squeeze = Some(x))
        }),
        key("aperture", "image", |v, e| e.text().map(|x| v.aperture_image = Some(x.into()))),
        key("aperture", "cats_eye", |v, e| {
            e.within(CATS_EYES, "how far the rim stands aside in the corners, in aperture radii")
                .map(|x| v.cats_eye = Some(x))
        }),
        key("aberrations", "spherical_um", |v, e| {
            e.within(ABERRATIONS_UM, "micrometres").map(|x| v.spherical_um = Some(x))
        }),
        key("aberrations", "axial_color_um", |v, e| {
            e.pair(ABERRATIONS_UM, RED_BLUE).map(|x| v.axial_color_um = Some(x))
        }),
        key("aberrations", "lateral_color_um", |v, e| {
            e.pair(ABERRATIONS_UM, RED_BLUE).map(|x| v.lateral_color_um = Some(x))
        }),
        key("depth", "convention", |v, e| e.one_of(&CONVENTIONS).map(|x| v.convention = x)),
        key("depth", "metres_per_unit", |v, e| e.positive().map(|x| v.metres_per_unit = Some(x))),
        key("depth", "near_clip", |v, e| e.not_negative().map(|x| v.near_clip = Some(x))),
        key("depth", "near", |v, e| e.not_negative().map(|x| v.near = Some(x))),
        key("depth", "far", |v, e| e.positive().map(|x| v.far = Some(x))),
        key("depth", "supersample", |v, e| e.count().map(|x| v.supersample = Some(x))),
        key("picture", "border", |v, e| e.one_of(&BORDERS).map(|x| v.border = Some(x))),
        key("highlight-extrapolation", "threshold", |v, e| {
            e.within(EXTRAPOLATION_THRESHOLDS, "luminance as displayed, white is 1")
                .map(|x| v.extrapolation_threshold = Some(x))
        }),
        key("highlight-extrapolation", "falloff", |v, e| {
            e.within(EXTRAPOLATION_FALLOFFS, "an exponent").map(|x| v.extrapolation_falloff = Some(x))
        }),
        key("highlight-extrapolation", "gain", |v, e| {
            e.within(EXTRAPOLATION_GAINS, "of the light of white").map(|x| v.extrapolation_gain = Some(x))
        }),
        key("method", "name", |v, e| e.text().map(|x| v.method = Some(x.to_owned()))),
        key("method", "views", |v, e| e.effort(v, Effort::Views(e.count()?))),
        key("method", "target_db", |v, e| e.effort(v, Effort::TargetDb(e.decibels()?))),
        key("method", "time_budget_s", |v, e| e.effort(v, Effort::TimeBudget(e.positive()?.into()))),
        key("method", "quality", |v, e| {
            e.effort(v, Effort::Quality(e.one_of(&Quality::ALL.map(|quality| (quality.name(), quality)))?))
        }),
    ]
};

/// What the two numbers of a colour error are.
const RED_BLUE: &str = "micrometres of red and of blue";

/// A key that each of the `[[lens.focus_keys]]` may hold: its name, and how its value is checked and kept.
pub(super) struct FocusKeyPart {
    pub(super) name: &'static str,
    pub(super) set: fn(&mut FocusKeyDraft, &Entry<'_>) -> Result<(), Error>,
}

/// One of the `[[lens.focus_keys]]` as far as it is read.
#[derive(Default)]
pub(super) struct FocusKeyDraft {
    pub(super) frame: Option<i64>,
    pub(super) focus: Option<Focus>,
    pub(super) easing: Easing,
}

/// Every key of the `[[lens.focus_keys]]`.
pub(super) static FOCUS_KEY_PARTS: [FocusKeyPart; 5] = [
    FocusKeyPart { name: "frame", set: |key, e| e.integer().map(|x| key.frame = Some(x)) },
    FocusKeyPart { name: "distance", set: |key, e| e.key_focus(key, Focus::Distance(e.positive_or_inf()?)) },
    FocusKeyPart { name: "point", set: |key, e| e.key_focus(key, Focus::Point(e.point()?)) },
    FocusKeyPart { name: "object", set: |key, e| e.key_focus(key, Focus::Object(e.text()?.to_owned())) },
    FocusKeyPart { name: "easing", set: |key, e| e.one_of(&Easing::ALL).map(|x| key.easing = x) },
];

const SENSOR_DISTANCES: [(&str, SensorDistance); 2] =
    [("focal_length", SensorDistance::FocalLength), ("thin_lens", SensorDistance::ThinLens)];

const BORDERS: [(&str, Border); 3] =
    [("clamp", Border::Clamp), ("mirror", Border::Mirror), ("transparent", Border::Transparent)];

const CONVENTIONS: [(&str, Option<DepthConvention>); 5] = [
    ("auto", None),
    ("planar", Some(DepthConvention::Planar)),
    ("ray", Some(DepthConvention::Ray)),
    ("inverse", Some(DepthConvention::Inverse)),
    ("normalised", Some(DepthConvention::Normalised)),
];

/// The tables of a preset, in the order of [`SCHEMA`].
pub(super) fn table_names() -> Vec<&'static str> {
    let mut names: Vec<_> = SCHEMA.iter().map(|key| key.table).collect();
    names.dedup();
    names
}

/// Every key that the table called `table` may hold; `""` is the root.
pub(super) fn known_keys(table: &str) -> Vec<String> {
    match table {
        "" => table_names().into_iter().map(str::to_owned).collect(),
        "lens.focus_keys" => FOCUS_KEY_PARTS.iter().map(|part| part.name.to_owned()).collect(),
        _ => SCHEMA.iter().filter(|key| key.table == table).map(|key| key.name.to_owned()).collect(),
    }
}
