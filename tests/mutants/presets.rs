//! Presets with any values: a render of a small stack ends with a picture or an error.

use super::fixtures::{Part, exr_bytes, source};
use exr::image::FlatSamples;
use fastrand::Rng;
use std::panic::{AssertUnwindSafe, catch_unwind};
use thinlens::error::Error;
use thinlens::gpu::DeviceChoice;
use thinlens::methods::Registry;
use thinlens::render::{Job, render};
use thinlens::settings::{Kind, ParameterKind, Preset, SETTINGS, Setting, Value};

/// Presets that are tried.
const PRESETS: u64 = 5000;

/// Numbers that are at an edge of what a setting can hold, among plain ones.
const NUMBERS: [&str; 24] = [
    "0",
    "-0.0",
    "1",
    "2.8",
    "50",
    "0.5",
    "-1",
    "1e-45",
    "1e-38",
    "1e-7",
    "1e7",
    "1e38",
    "3.4e38",
    "-3.4e38",
    "inf",
    "-inf",
    "nan",
    "4",
    "0.999999",
    "1.2",
    "100",
    "4294967295",
    "9223372036854775807",
    "'85mm'",
];

fn any<'a>(rng: &mut Rng, all: &[&'a str]) -> &'a str {
    all[rng.usize(0..all.len())]
}

/// A value of `setting`, most often one of its type.
fn value(setting: &Setting, rng: &mut Rng) -> String {
    // Most values are within the range, so that some presets are rendered.
    let is_within = rng.u8(0..16) != 0;
    let allowed = |text: &&str| {
        let number = text.parse::<f32>().is_ok_and(|x| allows_number(setting.kind, x));
        let whole = text.parse::<u32>().is_ok_and(|x| setting.kind.allows(&Value::Whole(x)));
        number || whole
    };
    let within: Vec<&str> = NUMBERS.into_iter().filter(allowed).collect();
    let numbers = if is_within && !within.is_empty() { within } else { NUMBERS.to_vec() };
    let mut number = || any(rng, &numbers).to_owned();
    match setting.kind {
        Kind::Number(_) | Kind::Whole(..) | Kind::Count { .. } => number(),
        Kind::RedBlue(_) | Kind::Pixel => format!("[{}, {}]", number(), number()),
        Kind::Word(words) => format!("'{}'", words[rng.usize(0..words.len())].name),
        Kind::Name => "'cube'".to_owned(),
        Kind::File => "'no/such.png'".to_owned(),
    }
}

/// Whether settings of `kind` accept `number`, alone or in a pair.
fn allows_number(kind: Kind, number: f32) -> bool {
    kind.allows(&Value::Number(number)) || kind.allows(&Value::Pair([number; 2]))
}

/// A preset of a few random values for a random method.
fn preset(rng: &mut Rng, methods: &Registry) -> String {
    let mut tables: Vec<(&str, String)> = Vec::new();
    let focus = rng.usize(0..8);
    for (i, setting) in SETTINGS.iter().enumerate() {
        let is_focus = setting.field == "focus";
        // Files are not there, and would end most renders before they start.
        let is_wanted =
            if is_focus { i == focus } else { rng.u8(0..6) == 0 && !matches!(setting.kind, Kind::File) };
        if is_wanted {
            tables.push((setting.table, format!("{} = {}\n", setting.preset_key, value(setting, rng))));
        }
    }
    let names: Vec<&str> = methods.iter().map(|method| method.name()).collect();
    let method = any(rng, &names);
    tables.push(("method", format!("name = '{method}'\nviews = {}\n", any(rng, &["1", "2", "5", "16"]))));
    let mut text = String::new();
    for table in ["lens", "aperture", "aberrations", "depth", "picture", "highlight-extrapolation", "method"]
    {
        let lines: String =
            tables.iter().filter(|(of, _)| *of == table).map(|(_, line)| line.as_str()).collect();
        text += &format!("[{table}]\n{lines}");
    }
    let of_method = methods.iter().find(|other| other.name() == method).unwrap();
    text += &format!("[method.{method}]\n");
    for parameter in of_method.parameters().declarations() {
        if rng.u8(0..4) == 0 {
            text += &format!("{} = {}\n", parameter.name, parameter_value(parameter.kind, rng));
        }
    }
    text
}

/// A value of a parameter of `kind`, within its range or at an edge of its type.
fn parameter_value(kind: ParameterKind, rng: &mut Rng) -> String {
    let mut within = |min: f32, max: f32| match rng.u8(0..16) {
        0 | 1 => format!("{min:?}"),
        2 | 3 => format!("{max:?}"),
        4..=14 => format!("{:?}", min + (max - min) * rng.f32()),
        _ => any(rng, &NUMBERS).to_owned(),
    };
    match kind {
        ParameterKind::Flag => any(rng, &["true", "false", "0"]).to_owned(),
        ParameterKind::Count(min, max) | ParameterKind::CountOrAuto(min, max) => {
            any(rng, &[&min.to_string(), &max.to_string(), "'auto'", "-1", "7"]).to_owned()
        }
        ParameterKind::Number(min, max) => within(min, max),
        ParameterKind::Numbers(min, max) => format!("[{}, {}]", within(min, max), within(min, max)),
        _ => "0".to_owned(),
    }
}

#[test]
fn any_values_of_a_preset_give_a_picture_or_an_error() {
    let methods = Registry::default();
    let ramp: Vec<f32> = (0..48).map(|i| 1.0 + i as f32).collect();
    let part = Part::flat((8, 6), "R=0.5 G=0.25 B=4 A=1 Z=3").with("Z", FlatSamples::F32(ramp));
    let stack = exr_bytes(vec![part]);
    let mut rng = Rng::with_seed(20);
    let [mut pictures, mut refused] = [0, 0];
    for number in 0..PRESETS {
        let text = preset(&mut rng, &methods);
        let work = || {
            let preset = Preset::parse(&text, "random.toml")?;
            let job = Job { device: DeviceChoice::Cpu, ..Job::new([source(stack.clone())]) };
            let job =
                Job { memory: Some(64 << 20), frame: Some(1), ..job }.with_preset("random.toml", preset);
            let rendered = render(&job, &|_| ())?;
            let planes = rendered.image.planes.iter();
            assert!(planes.flat_map(|plane| plane.values()).all(|value| !value.is_nan()), "no NaN");
            Ok::<_, Error>(())
        };
        match catch_unwind(AssertUnwindSafe(work)) {
            Ok(Ok(())) => pictures += 1,
            Ok(Err(_)) => refused += 1,
            Err(_) => panic!("preset {number} ended in a panic:\n{text}"),
        }
    }
    println!("{pictures} pictures, {refused} refused");
    assert!(pictures > PRESETS / 20 && refused > PRESETS / 20, "{pictures} pictures, {refused} refused");
}
