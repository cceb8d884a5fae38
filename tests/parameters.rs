//! Every parameter of every method changes the picture.

#![expect(clippy::unwrap_used, reason = "a test stops at the first thing that fails")]

use serde_json::{Value, json};
use thinlens::image::{Image, Plane};
use thinlens::methods::{self, METHODS};
use thinlens::scene::{Layer, Scene};
use thinlens::settings::{Origin, ParameterKind, ParameterValues, Settings, Values};
use thinlens::stack::StackKind;

/// Values for the parameters of which not every value changes the picture of [`scene`]: method, key, value, and other
/// parameters that have to be set. For all other parameters [`another`] value is tested.
fn other_values() -> Vec<(&'static str, &'static str, Value, Value)> {
    let none = json!({});
    let with = |method, key, value: Value| (method, key, value, none.clone());
    vec![
        with("shear", "views", json!(16)),
        with("shear", "prefilter", json!(0.0)),
        with("shear", "resolve", json!(0.0)),
        with("shear", "highlight_threshold", json!(0.0)),
        ("shear", "fill", json!(false), json!({ "resolve": 0.0 })),
        with("accumulate", "rays", json!(16)),
        with("recursive-gaussian", "cascaded", json!(false)),
        with("recursive-gaussian", "layers", json!(3)),
        with("recursive-gaussian", "coc_per_sigma", json!(3.0)),
        with("recursive-gaussian", "anchor", json!(0.0)),
        with("b-buffer", "same_surface_px", json!(8.0)),
        with("b-buffer", "in_focus_px", json!(2.0)),
        with("point-splat", "hidden", json!(false)),
        with("point-splat", "epsilon", json!(0.9)),
        with("point-splat", "edge", json!(0.9)),
        with("point-splat", "delta", json!(0.1)),
        with("point-splat", "intensity", json!([0.2, 1.0])),
        with("point-splat", "accelerated", json!(false)),
        with("layer-rays", "rays", json!(8)),
        with("layer-rays", "delta_px", json!(9.0)),
        with("layer-rays", "overlap", json!(0.4)),
        with("layer-rays", "iterations", json!(1)),
        with("layer-rays", "cones", json!(false)),
        with("layer-rays", "jitter", json!(false)),
        with("layer-rays", "discard", json!(false)),
        with("opaque-blur", "first_radius_px", json!(1.0)),
        with("peel-rays", "rays", json!(16)),
        with("peel-rays", "linear_steps", json!(5)),
        with("peel-rays", "binary_steps", json!(0)),
        with("pyramid-disocclusion", "first_radius_px", json!(1.0)),
        with("gather", "samples", json!(16)),
        with("scatter", "saturation", json!(0.5)),
    ]
}

/// A value of a parameter that differs from its default.
fn another(kind: &ParameterKind, default: &Value) -> Value {
    let differs = |value: &Value| value.as_f64() != default.as_f64();
    match *kind {
        ParameterKind::Flag => json!(default != &json!(true)),
        ParameterKind::Count(from, to) | ParameterKind::CountOrAuto(from, to) => {
            [json!(from), json!(to)].into_iter().find(differs).unwrap()
        }
        ParameterKind::Number(from, to) => [json!(from), json!(to)].into_iter().find(differs).unwrap(),
        ParameterKind::Numbers(_, to) => json!([to, to / 2.0]),
        ref other => panic!("there is no other value for {other:?}"),
    }
}

/// Two peels with content for every parameter: near bars, a floor through focus, a far wall, highlights.
fn scene() -> Scene {
    let (width, height) = (64, 48);
    let noise = |x: usize, y: usize, k: usize| {
        let bits = (x * 73_856_093) ^ (y * 19_349_663) ^ (k * 83_492_791);
        ((bits ^ (bits >> 13)).wrapping_mul(0x5bd1_e995) % 1024) as f32 / 1024.0
    };
    let bar = |x: usize| x % 24 < 8;
    let background_px =
        |x: usize, y: usize| if (x / 8).is_multiple_of(2) { 14.0 - 0.5 * y as f32 } else { 11.0 };
    let coc = |x, y, peel| match (bar(x), peel) {
        (true, 0) => -10.0,
        (true, _) | (false, 0) => background_px(x, y),
        (false, _) => 14.5,
    };
    let value = |x: usize, y: usize, k: usize| {
        let light = if (x + 5 * y).is_multiple_of(97) { 3.0 } else { 0.0 };
        0.97 * noise(x / 2, y / 2, k) + light
    };
    let layers = (0..2).map(|peel| Layer {
        color: std::array::from_fn(|k| Plane::from_fn(width, height, |x, y| value(x, y, 3 * peel + k))),
        alpha: Plane::filled(width, height, 1.0),
        coc_px: Plane::from_fn(width, height, |x, y| coc(x, y, peel)),
    });
    Scene::new(layers.collect(), StackKind::PointSampled, 1, 20.0)
}

fn blur(method: &str, changes: &[&Value]) -> Image {
    let mut parameters = ParameterValues::default();
    for (key, value) in changes.iter().flat_map(|change| change.as_object().unwrap()) {
        parameters.set(method, key, value.clone());
    }
    let values = Values { method: Some(method.to_owned()), ..Values::default() };
    let settings = Settings::resolve(&[(Origin::Flag, &values)], parameters);
    let scene = scene();
    let plan = methods::Registry::default().plan(&scene.analyze(), &settings).unwrap();
    methods::render(scene, &plan, &|_| {}).unwrap()
}

#[test]
fn every_parameter_changes_the_picture() {
    let others = other_values();
    for method in METHODS {
        let table = method.parameters();
        let method = method.info().name;
        for parameter in table.declarations() {
            let declared = others.iter().find(|(owner, key, ..)| (*owner, *key) == (method, parameter.name));
            let default = &table.defaults().table()[parameter.name];
            let (key, value, with) = match declared {
                Some((_, key, value, with)) => (*key, value.clone(), with.clone()),
                None => (parameter.name, another(&parameter.kind, default), json!({})),
            };
            let changed = blur(method, &[&with, &json!({ key: value })]);
            assert!(blur(method, &[&with]) != changed, "{method}: {key} = {value} changes nothing");
        }
    }
}

#[test]
fn every_parameter_has_a_default_within_its_range_and_a_description() {
    for method in METHODS {
        let (table, method) = (method.parameters(), method.info().name);
        let defaults = table.defaults().table();
        let declared = table.declarations();
        assert!(!declared.is_empty(), "{method} has no table of parameters");
        for parameter in declared {
            assert!(
                parameter.kind.allows(&defaults[parameter.name]),
                "{method}: the default of {} is outside of its range",
                parameter.name
            );
            assert!(parameter.description.ends_with('.'), "{method}: {} is not described", parameter.name);
        }
    }
}
