//! What a preset may hold: [`SCHEMA`] is the one list of keys, how each is checked and where it goes. The `[method.NAME]` tables
//! follow from the declarations of [`MethodParameters`], so that a new method needs no line here.

use super::super::{
    BLADE_CURVATURES, Border, DepthConvention, EXTRAPOLATION_FALLOFFS, EXTRAPOLATION_GAINS,
    EXTRAPOLATION_THRESHOLDS, Effort, Focus, MethodParameters, Quality, SQUEEZES, SensorDistance, Values,
};
use super::entry::Entry;
use crate::error::Error;
use serde_json::Value as Json;

/// A key that a preset may hold: its table, its name, and how its value is checked and kept.
pub(super) struct Key {
    pub(super) table: &'static str,
    pub(super) name: &'static str,
    pub(super) set: fn(&mut Values, &Entry<'_>) -> Result<(), Error>,
}

/// Every key outside the `[method.NAME]` tables.
pub(super) static SCHEMA: [Key; 25] = {
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
        key("aperture", "blade_curvature", |v, e| {
            e.within(BLADE_CURVATURES, "straight is 0, round is 1").map(|x| v.blade_curvature = Some(x))
        }),
        key("aperture", "squeeze", |v, e| {
            e.within(SQUEEZES, "height over width").map(|x| v.squeeze = Some(x))
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

/// The `[method.NAME]` tables with every parameter at its default.
pub(super) fn default_parameters() -> Json {
    serde_json::to_value(MethodParameters::default()).expect("parameters are numbers, flags and lists")
}

/// Every key that the table called `table` may hold; `""` is the root.
pub(super) fn known_keys(table: &str) -> Vec<String> {
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
