//! The table of settings is whole, and what it declares holds wherever a value enters.

#![expect(clippy::unwrap_used, reason = "a test stops at the first thing that fails")]

#[expect(dead_code, reason = "other tests use the rest")]
mod fixtures;

use exr::meta::attribute::AttributeValue;
use fixtures::{Part, stack_of};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use thinlens::image::Plane;
use thinlens::lens::{Field, Optics};
use thinlens::methods::METHODS;
use thinlens::render::{Job, prepare, render_stack};
use thinlens::settings::{
    CommandLine, DepthConvention, Effort, Focus, FocusKey, Kind, Origin, ParameterValues, Preset, Range,
    SETTINGS, Setting, Settings, Value, Values,
};
use thinlens::stack::{Frame, Peel, ReadOptions, Source, Stack, camera_attributes};

/// Values, of which every kind with a range refuses some.
fn candidates(setting: &Setting) -> Vec<Value> {
    let numbers = [f32::NAN, -1e9, -1.0, 0.0, 0.5, 1.5, 1e9, f32::INFINITY];
    match setting.kind {
        Kind::Number(_) => numbers.map(Value::Number).into(),
        Kind::RedBlue(_) | Kind::Pixel => numbers.map(|x| Value::Pair([0.25, x])).into(),
        Kind::Whole(..) | Kind::Count { .. } => [0, 1, 2, 101, u32::MAX].map(Value::Whole).into(),
        Kind::Word(_) => vec![Value::Word("sideways")],
        Kind::Name | Kind::File => Vec::new(),
    }
}

/// A value that `setting` allows, and not its default where it has another.
fn allowed(setting: &Setting) -> Value {
    let default = setting.default_value();
    let suits = |value: &Value| setting.kind.allows(value) && Some(value) != default.as_ref();
    match setting.kind {
        Kind::Word(words) => Value::Word(words.last().unwrap().name),
        Kind::Name => Value::Name("cow".to_owned()),
        Kind::File => Value::File("heart.png".into()),
        Kind::Count { max, .. } | Kind::Whole(_, max) => Value::Whole(max),
        _ => candidates(setting).into_iter().find(suits).unwrap(),
    }
}

/// A value that `setting` refuses; none for what may be any name.
fn refused(setting: &Setting) -> Option<Value> {
    candidates(setting).into_iter().find(|value| !setting.kind.allows(value))
}

/// `value` as a preset has it.
fn toml(value: &Value) -> String {
    match value {
        Value::Number(number) => format!("{number:?}").to_lowercase(),
        Value::Pair([first, second]) => format!("[{first:?}, {second:?}]").to_lowercase(),
        Value::Whole(number) => number.to_string(),
        Value::Word(word) => format!("'{word}'"),
        Value::Name(name) => format!("'{name}'"),
        Value::File(path) => format!("'{}'", path.display()),
    }
}

#[test]
fn every_setting_is_declared_in_full() {
    for setting in SETTINGS {
        let Setting { key, name, table, .. } = setting;
        let summary = setting.summary();
        assert!(!name.is_empty() && !table.is_empty(), "{key}");
        assert!(
            !summary.is_empty() && !summary.ends_with('.') && summary.chars().count() < 60,
            "{key}: {summary}"
        );
        assert!(setting.details().iter().all(|paragraph| paragraph.ends_with('.')), "{key}");
        match setting.default_value() {
            Some(value) => assert!(setting.kind.allows(&value), "{key}: default {value}"),
            None => assert!(!setting.otherwise.is_empty(), "{key} says nothing of what else holds"),
        }
        match setting.command_line {
            CommandLine::Flag { name, value_name } => {
                assert!(!name.is_empty() && !value_name.is_empty(), "{key}");
            }
            CommandLine::Never(reason) => assert!(!reason.is_empty(), "{key} has no flag and no reason"),
        }
    }
}

#[test]
fn no_two_settings_share_a_name() {
    let unique = |what: &str, names: Vec<String>| {
        let distinct: BTreeSet<_> = names.iter().collect();
        assert_eq!(distinct.len(), names.len(), "{what}: {names:?}");
    };
    let names = |of: fn(&Setting) -> Option<String>| SETTINGS.iter().filter_map(of).collect();
    unique("keys", names(|s| Some(s.key.to_owned())));
    unique("preset keys", names(|s| Some(format!("{}.{}", s.table, s.preset_key))));
    unique("attributes", names(|s| s.attribute.map(str::to_owned)));
    let flag = |setting: &Setting| match setting.command_line {
        CommandLine::Flag { name, .. } => Some(name.to_owned()),
        CommandLine::Never(_) => None,
    };
    unique("flags", names(flag));
    assert!(SETTINGS.iter().all(|s| s.attribute.is_none_or(|name| name.starts_with("thinlens."))));
}

#[test]
fn every_setting_keeps_what_it_allows_and_settings_of_one_field_exclude_one_another() {
    for setting in SETTINGS {
        let given = allowed(setting);
        let mut values = Values::default();
        setting.set(&mut values, &given);
        assert_eq!(setting.get(&values), Some(given.clone()), "{}", setting.key);
        assert!(values.check().is_ok(), "{}", setting.key);
        for other in SETTINGS.iter().filter(|other| other.key != setting.key) {
            assert_eq!(other.get(&values), None, "{} sets {}", setting.key, other.key);
        }
        let preset = format!("[{}]\n{} = {}", setting.table, setting.preset_key, toml(&given));
        assert_eq!(Preset::parse(&preset, "p").unwrap().values, values, "{preset}");
    }
}

#[test]
fn a_value_out_of_range_is_refused_alike_in_a_preset_in_a_header_and_by_code() {
    for setting in SETTINGS {
        let Some(value) = refused(setting) else { continue };
        let wanted = format!("must be {}", setting.expected());
        let preset = format!("[{}]\n{} = {}", setting.table, setting.preset_key, toml(&value));
        let error = Preset::parse(&preset, "p").unwrap_err().to_string();
        assert!(error.contains(&format!("'{}' {wanted}", setting.preset_key)), "{error}");
        if let Some(name) = setting.attribute {
            let attribute = match &value {
                Value::Pair([x, y]) => AttributeValue::FloatVec2(exr::math::Vec2(*x, *y)),
                Value::Whole(number) => AttributeValue::I32(i32::try_from(*number).unwrap_or(i32::MAX)),
                Value::Word(word) => AttributeValue::Text((*word).into()),
                Value::Number(number) => AttributeValue::F32(*number),
                Value::Name(_) | Value::File(_) => continue,
            };
            let stack = stack_of(vec![Part::flat((1, 1), "R=1 G=1 B=1 Z=1").attribute(name, attribute)]);
            let said = stack.findings.iter().find(|finding| finding.about == "camera").unwrap();
            assert!(said.warning && said.text.contains(name) && said.text.contains(&wanted), "{}", said.text);
            assert_eq!(setting.get(&stack.camera), None, "{name} is ignored");
        }
        let mut values = Values::default();
        setting.set(&mut values, &value);
        if setting.get(&values).is_none() {
            continue; // A word that is none cannot be said by code.
        }
        let job = Job { sources: vec![Source::File("no/such.exr".into())], flags: values, ..Job::default() };
        let error = prepare(&job).unwrap_err().to_string();
        assert!(
            error.starts_with(&format!("`{}` {wanted}", setting.key)),
            "before anything is read: {error}"
        );
    }
}

#[test]
fn a_focus_key_is_checked_as_a_focus() {
    let key = FocusKey { frame: 7, focus: Focus::Distance(-1.0), easing: thinlens::settings::Easing::Hold };
    let values = Values { focus: Some(Focus::Keys(vec![key])), ..Values::default() };
    let error = values.check().unwrap_err().to_string();
    assert!(error.contains("`focus_distance` must be") && error.contains("frame 7"), "{error}");
}

#[test]
fn settings_made_by_code_are_checked_where_the_lens_is_made_of_them() {
    let mut settings = Settings::resolve(&[], ParameterValues::default());
    settings.lens.cats_eye.value = 7.0;
    let error = Optics::new(&settings, &Field::from_picture_size(36, 24)).unwrap_err().to_string();
    assert!(error.contains("`cats_eye` must be a number from 0 to 1.2"), "{error}");
}

#[test]
fn the_settings_of_a_lens_are_read_back_from_the_attributes_that_they_are_written_to() {
    let with_attribute = || SETTINGS.iter().filter(|setting| setting.attribute.is_some());
    let mut values = Values::default();
    with_attribute().for_each(|setting| setting.set(&mut values, &allowed(setting)));
    // A fixture of one pixel has one sample. A pinhole is a lens too.
    (values.supersample, values.f_number) = (Some(1), Some(f32::INFINITY));
    let written = camera_attributes(&values);
    assert_eq!(written.len(), with_attribute().count());
    let part = written.into_iter().fold(Part::flat((1, 1), "R=1 G=1 B=1 Z=1"), |part, (name, value)| {
        let setting = SETTINGS.iter().find(|setting| setting.attribute.is_some_and(|own| name.eq(own)));
        part.attribute(setting.unwrap().attribute.unwrap(), value)
    });
    let stack = stack_of(vec![part]);
    assert_eq!(stack.camera, values);
}

#[test]
fn resolved_settings_are_listed_with_their_origins() {
    let values = Values { blades: Some(5), focus: Some(Focus::Distance(2.0)), ..Values::default() };
    let settings = Settings::resolve(&[(Origin::Header, &values)], ParameterValues::default());
    let lens = settings.lens.listed();
    let of = |key: &str| lens.iter().find(|listed| listed.setting.key == key).unwrap();
    assert_eq!((of("blades").value.clone(), of("blades").origin), (Some(Value::Whole(5)), &Origin::Header));
    assert_eq!(of("focus_distance").value, Some(Value::Number(2.0)));
    assert_eq!(of("focus_point").value, None);
    assert_eq!(
        (of("squeeze").value.clone(), of("squeeze").origin),
        (Some(Value::Number(1.0)), &Origin::Default)
    );
    let picture = settings.picture.listed();
    let resolved = lens.iter().chain(&picture).map(|listed| listed.setting.key);
    let missing: Vec<_> =
        SETTINGS.iter().map(|s| s.key).filter(|key| !resolved.clone().any(|k| k == *key)).collect();
    assert_eq!(
        missing,
        ["convention", "supersample", "kind", "alpha", "beauty", "holdout"],
        "these are about reading, and belong to the stack"
    );
}

/// The rows of docs/settings.md, as the table of settings has them.
fn documented() -> String {
    let mut rows = String::new();
    let mut table = "";
    for setting in in_order_of_tables() {
        if setting.table != table {
            table = setting.table;
            rows += &format!(
                "\n## [{table}]\n\n| key | flag | header attribute | unit | range | default | meaning |\n\
                 | --- | --- | --- | --- | --- | --- | --- |\n"
            );
        }
        let flag = match setting.command_line {
            CommandLine::Flag { name, value_name } => format!("`--{name} {value_name}`"),
            CommandLine::Never(_) => "-".to_owned(),
        };
        let attribute = setting.attribute.map_or_else(|| "-".to_owned(), |name| format!("`{name}`"));
        let or_none = |text: &str| if text.is_empty() { "-".to_owned() } else { text.to_owned() };
        rows += &format!(
            "| `{}` | {flag} | {attribute} | {} | {} | {} | {} |\n",
            setting.preset_key,
            or_none(setting.unit),
            setting.kind.range().unwrap_or_else(|| "-".to_owned()),
            setting.default_in_words(),
            setting.summary(),
        );
    }
    rows
}

/// The settings with those of one table together, tables in the order in which they come first.
fn in_order_of_tables() -> Vec<&'static Setting> {
    let mut settings: Vec<_> = SETTINGS.iter().collect();
    settings.sort_by_key(|setting| SETTINGS.iter().position(|first| first.table == setting.table));
    settings
}

#[test]
fn the_documented_table_is_the_declared_one() {
    let page = include_str!("../docs/settings.md");
    let documented = documented();
    assert!(page.ends_with(&documented), "docs/settings.md must end with:\n{documented}");
}

/// Modules of the library whose texts name settings by their keys.
const SPEAK_OF_KEYS: [&str; 15] = [
    "confidence.rs",
    "cost",
    "error.rs",
    "finish.rs",
    "gpu",
    "image.rs",
    "lens",
    "metrics",
    "output",
    "probes",
    "render",
    "sample_budget.rs",
    "scene",
    "settings",
    "stack",
];

#[test]
fn texts_of_the_library_name_no_flag() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut left: Vec<PathBuf> = SPEAK_OF_KEYS.map(|module| source.join(module)).into();
    while let Some(path) = left.pop() {
        if path.is_dir() {
            left.extend(fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().path()));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let text = fs::read_to_string(&path).unwrap();
            let code = text.lines().filter(|line| !line.trim_start().starts_with("//"));
            for line in code {
                let mut words = line.split(|c: char| !c.is_ascii_lowercase() && c != '-');
                let flag = words.find(|word| word.starts_with("--") && word.len() > 2);
                assert_eq!(flag, None, "{}: {line}", path.display());
            }
        }
    }
}

/// The values at the ends of what `setting` accepts.
fn ends(setting: &Setting) -> Vec<Value> {
    let least = f32::from_bits(1);
    let numbers = |range: Range| match range {
        Range::Any => vec![f32::MIN, -least, 0.0, f32::MAX],
        Range::Positive => vec![least, f32::MIN_POSITIVE, f32::MAX],
        Range::PositiveOrInfinite => vec![least, f32::MIN_POSITIVE, f32::MAX, f32::INFINITY],
        Range::NotNegative => vec![0.0, least, f32::MAX],
        Range::Within(min, max) => vec![min, max],
    };
    let pairs = |ends: Vec<f32>| {
        let pair = |first: f32| ends.iter().map(move |&second| Value::Pair([first, second]));
        ends.iter().flat_map(|&first| pair(first)).collect()
    };
    match setting.kind {
        Kind::Number(range) => numbers(range).into_iter().map(Value::Number).collect(),
        Kind::RedBlue(range) => pairs(numbers(range)),
        Kind::Pixel => pairs(numbers(Range::Any)),
        Kind::Whole(min, max) => [min, max].map(Value::Whole).into(),
        Kind::Count { min, max, .. } => [0, min, max].map(Value::Whole).into(),
        Kind::Word(words) => words.iter().map(|word| Value::Word(word.name)).collect(),
        Kind::Name => vec![Value::Name(String::new())],
        Kind::File => vec![Value::File(PathBuf::new())],
    }
}

/// Two small peels whose depths, from 0.2 to 0.9, mean something in every convention, read as `values` say.
fn small_stack(values: &Values, convention: DepthConvention) -> Result<Stack, thinlens::error::Error> {
    let plane = |value: &dyn Fn(usize, usize) -> f32| Plane::from_fn(12, 8, value);
    let peel = |alpha: f32, near: f32| Peel {
        color: std::array::from_fn(|k| plane(&|x, y| alpha * ((x + y + k) % 3) as f32)),
        alpha: plane(&|x, _| if x == 3 { 0.0 } else { alpha }),
        depth: plane(&|x, y| if y == 0 { f32::INFINITY } else { near + 0.03 * x as f32 }),
    };
    let options = ReadOptions {
        convention: values.convention.or(Some(convention)),
        supersample: values.supersample,
        kind: values.kind,
        alpha: values.alpha,
        ..ReadOptions::default()
    };
    Stack::from_peels(vec![peel(0.5, 0.2), peel(1.0, 0.5)], Frame::from_size(12, 8), &options)
}

/// The picture of the small stack with `values` is finite, or it is refused with a reason.
fn renders_or_is_refused(values: &Values, convention: DepthConvention, what: &str) {
    let job = Job { flags: values.clone(), ..Job::default() };
    let outcome = small_stack(values, convention).and_then(|stack| render_stack(stack, &job, &|_| {}));
    match outcome {
        Err(error) => assert!(error.to_string().len() > 20, "{what}: {error}"),
        Ok(rendered) => {
            let finite = |plane: &Plane| plane.values().iter().all(|value| value.is_finite());
            assert!(rendered.image.planes.iter().all(finite), "{what}: not finite");
        }
    }
}

/// Lenses on which the ends of one setting are tried: without aberrations, and with all that there are.
fn lenses() -> [Values; 2] {
    let effort = Some(Effort::Views(8));
    let strong = Values {
        spherical_um: Some(5000.0),
        axial_color_um: Some([5000.0, -5000.0]),
        lateral_color_um: Some([-5000.0, 5000.0]),
        cats_eye: Some(1.2),
        vignetting: Some(1.0),
        effort,
        ..Values::default()
    };
    [Values { effort, ..Values::default() }, strong]
}

#[test]
fn a_setting_at_either_end_of_its_range_renders_or_is_refused_with_a_reason() {
    let conventions = [
        DepthConvention::Planar,
        DepthConvention::Ray,
        DepthConvention::Inverse,
        DepthConvention::Normalised,
    ];
    for setting in SETTINGS {
        for value in ends(setting) {
            for (lens, convention) in
                lenses().into_iter().flat_map(|lens| conventions.map(|c| (lens.clone(), c)))
            {
                let mut values = lens;
                setting.set(&mut values, &value);
                let what = format!("{} = {value}, {convention:?}", setting.key);
                renders_or_is_refused(&values, convention, &what);
            }
        }
    }
}

#[test]
fn every_method_renders_or_refuses_a_lens_at_the_ends_of_its_settings() {
    for (method, setting) in
        METHODS.iter().flat_map(|method| SETTINGS.iter().map(move |setting| (method, setting)))
    {
        for value in ends(setting) {
            let name = method.info().name;
            let effort = method.samples_lens().then_some(Effort::Views(4));
            let mut values = Values { method: Some(name.to_owned()), effort, ..Values::default() };
            setting.set(&mut values, &value);
            renders_or_is_refused(
                &values,
                DepthConvention::Planar,
                &format!("{name}, {} = {value}", setting.key),
            );
        }
    }
}
