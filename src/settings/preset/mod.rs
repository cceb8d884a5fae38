//! Presets: a TOML file becomes a layer of [`Values`].
//!
//! [`entry`] reads values and makes errors with their location, [`keys`] reads lists of keys along a sequence, [`schema`] has the known keys,
//! and [`written`] writes a preset that reads back as the same.

mod entry;
mod keys;
mod schema;
mod written;

use super::{ParameterValues, Values, nearest};
use crate::error::Error;
use entry::Document;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use toml::de::DeTable;

/// The longest text that is read as a preset.
const MAX_BYTES: u64 = 4 << 20;

/// The content of a preset.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Preset {
    /// The settings.
    pub values: Values,
    /// The `[method.NAME]` tables, which the methods check.
    pub parameters: ParameterValues,
}

/// A built-in preset.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct BuiltIn {
    /// Its name.
    pub name: &'static str,
    /// The TOML text.
    pub text: &'static str,
}

/// Every built-in preset.
pub static BUILT_IN: [BuiltIn; 11] = [
    BuiltIn { name: "portrait", text: include_str!("../../../presets/portrait.toml") },
    BuiltIn { name: "landscape", text: include_str!("../../../presets/landscape.toml") },
    BuiltIn { name: "macro", text: include_str!("../../../presets/macro.toml") },
    BuiltIn { name: "product", text: include_str!("../../../presets/product.toml") },
    BuiltIn { name: "miniature", text: include_str!("../../../presets/miniature.toml") },
    BuiltIn { name: "cine", text: include_str!("../../../presets/cine.toml") },
    BuiltIn { name: "anamorphic", text: include_str!("../../../presets/anamorphic.toml") },
    BuiltIn { name: "swirl", text: include_str!("../../../presets/swirl.toml") },
    BuiltIn { name: "soap-bubble", text: include_str!("../../../presets/soap-bubble.toml") },
    BuiltIn { name: "phone-like", text: include_str!("../../../presets/phone-like.toml") },
    BuiltIn { name: "pinhole", text: include_str!("../../../presets/pinhole.toml") },
];

impl BuiltIn {
    /// The preset called `name`.
    ///
    /// # Errors
    /// An unknown name, with the nearest known one.
    pub fn by_name(name: &str) -> Result<Self, Error> {
        let found = BUILT_IN.into_iter().find(|preset| preset.name == name);
        found.ok_or_else(|| {
            let names = BUILT_IN.map(|preset| preset.name);
            let known = match nearest(name, &names) {
                Some(near) => format!("did you mean '{near}'? "),
                None => format!("the presets are {}; ", names.join(", ")),
            };
            Error::settings(format!("there is no preset called '{name}'")).help(format!(
                "{known}`thinlens presets` lists them; for a preset of your own, give its path"
            ))
        })
    }

    /// The purpose of the preset: the first line of its head comment.
    pub fn summary(&self) -> &'static str {
        self.text.lines().next().unwrap_or_default().trim_start_matches('#').trim()
    }
}

impl Preset {
    /// Loads the built-in preset `name`, otherwise the file at the path `name`.
    ///
    /// # Errors
    /// A name that is neither, and all errors of [`Preset::parse`].
    pub fn load(name: &str) -> Result<Self, Error> {
        if let Some(built_in) = BUILT_IN.iter().find(|preset| preset.name == name) {
            return Self::parse(built_in.text, name);
        }
        let path = Path::new(name);
        let is_path = path.extension().is_some() || path.components().count() > 1 || path.exists();
        if !is_path {
            BuiltIn::by_name(name)?;
        }
        let text = read_text(path).map_err(|cause| {
            Error::settings("the preset file cannot be read")
                .in_file(path)
                .caused_by(cause)
                .help("give the path of a TOML file, or a name that `thinlens presets` lists")
        })?;
        let mut preset = Self::parse(&text, name)?;
        let beside =
            |image: PathBuf| path.parent().map_or_else(|| image.clone(), |folder| folder.join(&image));
        preset.values.aperture_image = preset.values.aperture_image.take().map(beside);
        preset.values.environment = preset.values.environment.take().map(beside);
        preset.values.beauty = preset.values.beauty.take().map(beside);
        preset.values.holdout = preset.values.holdout.take().map(beside);
        Ok(preset)
    }

    /// Reads a preset from TOML; `source` names it in errors.
    ///
    /// # Errors
    /// A syntax error, an unknown key (with the nearest known one) or a value of the wrong type, each with its line.
    pub fn parse(text: &str, source: &str) -> Result<Self, Error> {
        let document = Document { text, source };
        let root = DeTable::parse(text).map_err(|error| {
            document.error(format!("not valid TOML: {}", error.message()), error.span().unwrap_or(0..0))
        })?;
        let mut values = Values::default();
        let mut parameters = ParameterValues::default();
        for table in document.entries("", root.get_ref()) {
            if !schema::table_names().contains(&table.key) {
                return Err(table.unknown());
            }
            for entry in document.entries(table.key, table.table()?) {
                entry.read(&mut values, &mut parameters)?;
            }
        }
        Ok(Self { values, parameters })
    }
}

/// The text of the file at `path`, which may be a pipe.
fn read_text(path: &Path) -> io::Result<String> {
    let mut text = String::new();
    File::open(path)?.take(MAX_BYTES + 1).read_to_string(&mut text)?;
    if text.len() as u64 > MAX_BYTES {
        return Err(io::Error::new(
            io::ErrorKind::InvalidData,
            format!("it has more than {MAX_BYTES} bytes"),
        ));
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::super::{Border, DepthConvention, Easing, Effort, Focus, FocusKey, SensorDistance};
    use super::*;

    fn parse(text: &str) -> Result<Preset, Error> {
        Preset::parse(text, "my.toml")
    }

    fn message(text: &str) -> String {
        parse(text).unwrap_err().to_string()
    }

    #[test]
    fn every_key_of_the_schema_is_read() {
        let text = "
            [lens]
            focal_length_mm = 85.0
            f_number = 1.4
            focus_point = [10, 20.5]
            sensor_width_mm = 36.0
            sensor_distance = 'thin_lens'
            vignetting = 0.5
            [aperture]
            blades = 6
            rotation_deg = -15.5
            blade_curvature = 0.5
            squeeze = 1.33
            image = 'heart.png'
            cats_eye = 0.6
            [aberrations]
            spherical_um = -80
            axial_color_um = [30, 45.5]
            lateral_color_um = [-4, 6]
            [depth]
            convention = 'ray'
            metres_per_unit = 0.01
            near_clip = 0.1
            near = 1
            far = 100
            supersample = 2
            [picture]
            border = 'mirror'
            [highlight-extrapolation]
            threshold = 0.75
            falloff = 2
            gain = 4.5";
        let expected = Values {
            focal_length_mm: Some(85.0),
            f_number: Some(1.4),
            focus: Some(Focus::Point([10.0, 20.5])),
            sensor_width_mm: Some(36.0),
            sensor_distance: Some(SensorDistance::ThinLens),
            blades: Some(6),
            rotation_deg: Some(-15.5),
            blade_curvature: Some(0.5),
            squeeze: Some(1.33),
            aperture_image: Some("heart.png".into()),
            cats_eye: Some(0.6),
            vignetting: Some(0.5),
            spherical_um: Some(-80.0),
            axial_color_um: Some([30.0, 45.5]),
            lateral_color_um: Some([-4.0, 6.0]),
            convention: Some(DepthConvention::Ray),
            metres_per_unit: Some(0.01),
            near_clip: Some(0.1),
            near: Some(1.0),
            far: Some(100.0),
            supersample: Some(2),
            border: Some(Border::Mirror),
            extrapolation_threshold: Some(0.75),
            extrapolation_falloff: Some(2.0),
            extrapolation_gain: Some(4.5),
            ..Values::default()
        };
        assert_eq!(parse(text).unwrap().values, expected);
        let method = parse("[method]\nname = 'shear'\nviews = 32").unwrap().values;
        assert_eq!((method.method.as_deref(), method.effort), (Some("shear"), Some(Effort::Views(32))));
    }

    #[test]
    fn a_whole_number_is_accepted_as_a_number() {
        assert_eq!(parse("[lens]\nfocal_length_mm = 85").unwrap().values.focal_length_mm, Some(85.0));
    }

    #[test]
    fn the_convention_auto_leaves_the_convention_unset() {
        assert_eq!(parse("[depth]\nconvention = 'auto'").unwrap().values.convention, None);
    }

    #[test]
    fn an_infinite_f_number_is_a_pinhole() {
        assert_eq!(parse("[lens]\nf_number = inf").unwrap().values.f_number, Some(f32::INFINITY));
    }

    #[test]
    fn the_table_of_a_method_is_kept_for_the_method_to_check() {
        let parameters =
            parse("[method.any]\nviews = 32\nshape = [1, 0.5]\nlayers = 'auto'").unwrap().parameters;
        let kept: Vec<_> =
            parameters.iter().map(|value| (value.key.as_str(), value.value.to_string())).collect();
        let kept: Vec<_> = kept.iter().map(|(key, value)| (*key, value.as_str())).collect();
        assert_eq!(kept, [("views", "32"), ("shape", "[1,0.5]"), ("layers", "null")]);
        let place = parameters.iter().next().and_then(|value| value.place.clone()).unwrap();
        assert!(place.method.contains("my.toml:1:9") && place.value.contains("my.toml:2:9"), "{place:?}");
    }

    #[test]
    fn an_unknown_key_is_shown_with_its_location_and_the_nearest_key() {
        assert_eq!(
            message("[lens]\nfnumber = 1.4"),
            "unknown key 'fnumber' in [lens]\n  in: my.toml:2:1\n  2 | fnumber = 1.4\n    | ^^^^^^^\n  help: did you mean \
             'f_number'?"
        );
    }

    #[test]
    fn an_unknown_key_without_a_near_one_lists_the_keys_of_its_table() {
        let message = message("[aperture]\nvignette = 1");
        assert!(
            message.contains("the keys of [aperture] are blades, rotation_deg, blade_curvature, squeeze"),
            "{message}"
        );
    }

    #[test]
    fn a_key_in_the_wrong_table_is_refused_with_its_own_table() {
        assert!(message("[aperture]\nf_number = 2").contains("'f_number' belongs in [lens]"));
        assert!(message("f_number = 2").contains("'f_number' belongs in [lens]"));
    }

    #[test]
    fn an_unknown_table_is_refused_with_the_nearest_table() {
        assert!(message("[lense]\nf_number = 2").contains("did you mean 'lens'?"));
    }

    #[test]
    fn a_value_of_the_wrong_kind_is_refused_with_carets_under_the_value() {
        for (line, expected) in [
            ("[lens]\nf_number = 'wide'", "must be a positive number, or inf"),
            ("[lens]\nfocal_length_mm = -85", "must be a positive number"),
            ("[lens]\nfocal_length_mm = nan", "must be a positive number"),
            ("[lens]\nfocus_point = [1]", "must be a pixel, [x, y]"),
            ("[lens]\nsensor_distance = 'far'", "must be one of focal_length, thin_lens"),
            ("[aperture]\nblades = 2", "must be 0 for a disc, or from 3 to 100 blades"),
            ("[aperture]\nblades = 5.5", "must be 0 for a disc, or from 3 to 100 blades"),
            ("[aperture]\nblade_curvature = 2", "must be a number from 0 to 1"),
            ("[aperture]\nsqueeze = 0.5", "must be a number from 1 to 4: height over width"),
            ("[picture]\nborder = 'wrap'", "must be one of clamp, mirror, transparent"),
            ("[highlight-extrapolation]\nthreshold = 1", "must be a number from 0 to 0.999: luminance"),
            ("[highlight-extrapolation]\nfalloff = 0", "must be a number from 0.1 to 100"),
            ("[highlight-extrapolation]\ngain = 0.5", "must be a number from 1 to 1000"),
            ("[method]\nviews = 0", "must be a whole number, 1 or more"),
            ("lens = 3", "must be a table, [lens]"),
        ] {
            let message = message(line);
            assert!(message.contains(expected) && message.contains('^'), "{line}: {message}");
        }
    }

    #[test]
    fn two_ways_to_focus_exclude_each_other() {
        let message = message("[lens]\nfocus_distance = 2\nfocus_point = [1, 2]");
        assert!(message.contains("exclude one another") && message.contains("my.toml:3:1"), "{message}");
    }

    #[test]
    fn an_object_is_focused_on_by_its_name() {
        let focus = parse("[lens]\nfocus_object = '/obj/cow:shape'").unwrap().values.focus;
        assert_eq!(focus, Some(Focus::Object("/obj/cow:shape".to_owned())));
    }

    #[test]
    fn focus_keys_are_read_in_order_and_are_smooth_by_default() {
        let text = "
            [lens]
            f_number = 2
            [[lens.focus_keys]]
            frame = -10
            distance = 2
            [[lens.focus_keys]]
            frame = 1
            point = [960, 540]
            easing = 'hold'
            [[lens.focus_keys]]
            frame = 48
            object = 'cow'
            easing = 'linear'";
        let key = |frame, focus, easing| FocusKey { frame, focus, easing };
        let expected = vec![
            key(-10, Focus::Distance(2.0), Easing::Smooth),
            key(1, Focus::Point([960.0, 540.0]), Easing::Hold),
            key(48, Focus::Object("cow".to_owned()), Easing::Linear),
        ];
        assert_eq!(parse(text).unwrap().values.focus, Some(Focus::Keys(expected)));
        let inline = "[lens]\nfocus_keys = [{ frame = 1, distance = inf }]";
        let expected = vec![key(1, Focus::Distance(f32::INFINITY), Easing::Smooth)];
        assert_eq!(parse(inline).unwrap().values.focus, Some(Focus::Keys(expected)), "as an inline table");
    }

    #[test]
    fn a_mistake_in_a_focus_key_is_shown_with_its_location() {
        let key = |lines: &str| message(&format!("[[lens.focus_keys]]\n{lines}"));
        for (lines, expected, place) in [
            ("frame = 1\ndistanse = 2", "did you mean 'distance'?", "my.toml:3:1"),
            ("frame = 1\nfocus_distance = 2", "did you mean 'distance'?", "my.toml:3:1"),
            (
                "frame = 1\nspeed = 2",
                "the keys of [lens.focus_keys] are frame, distance, point",
                "my.toml:3:1",
            ),
            ("frame = 1\nblades = 2", "'blades' belongs in [aperture]", "my.toml:3:1"),
            ("frame = 1.5\ndistance = 2", "'frame' must be a whole number", "my.toml:2:9"),
            ("frame = 1\ndistance = 0", "'distance' must be a positive number, or inf", "my.toml:3:12"),
            ("frame = 1\ndistance = 2\neasing = 'smoth'", "did you mean 'smooth'?", "my.toml:4:10"),
            ("frame = 1\ndistance = 2\nobject = 'a'", "exclude one another", "my.toml:4:1"),
            ("distance = 2", "a focus key has no frame", "my.toml:1:1"),
            ("frame = 1", "a focus key has no focus", "my.toml:1:1"),
            (
                "frame = 3\ndistance = 2\n[[lens.focus_keys]]\nframe = 3\ndistance = 4",
                "rising order",
                "my.toml:4:1",
            ),
        ] {
            let message = key(lines);
            assert!(message.contains(expected) && message.contains(place), "{lines}: {message}");
        }
    }

    #[test]
    fn focus_keys_are_a_list_of_at_least_one() {
        for text in ["[lens]\nfocus_keys = []", "[lens]\nfocus_keys = 3", "[lens.focus_keys]\nframe = 1"] {
            let message = message(text);
            assert!(
                message.contains("'focus_keys' must be at least one table, [[lens.focus_keys]]"),
                "{message}"
            );
        }
        let both = message("[lens]\nfocus_distance = 2\n[[lens.focus_keys]]\nframe = 1\ndistance = 2");
        assert!(both.contains("exclude one another"), "{both}");
    }

    #[test]
    fn invalid_toml_is_shown_with_its_location() {
        let message = message("[lens]\nf_number = \n");
        assert!(message.contains("not valid TOML") && message.contains("my.toml:2:"), "{message}");
    }

    #[test]
    fn the_preset_in_the_documentation_is_valid() {
        let page = include_str!("../../../docs/lens.md");
        let (_, rest) = page.split_once("    [lens]").unwrap();
        let (block, _) = rest.split_once("\nThe flags").unwrap();
        let preset = Preset::parse(&format!("[lens]{block}"), "lens.md").unwrap();
        assert_eq!(preset.values.effort, Some(Effort::Views(64)));
    }

    #[test]
    fn the_focus_pull_in_the_documentation_is_valid() {
        let page = include_str!("../../../docs/focus.md");
        let (_, rest) = page.split_once("    [[lens.focus_keys]]").unwrap();
        let (block, _) = rest.split_once("\nBetween two keys").unwrap();
        let preset = Preset::parse(&format!("[[lens.focus_keys]]{block}"), "focus.md").unwrap();
        let Some(Focus::Keys(keys)) = preset.values.focus else { panic!("no keys") };
        assert_eq!(keys.iter().map(|key| key.frame).collect::<Vec<_>>(), [1, 48]);
    }

    #[test]
    fn every_built_in_preset_is_valid_has_a_summary_and_leaves_the_focus_unset() {
        for built_in in BUILT_IN {
            let preset = Preset::load(built_in.name).unwrap();
            assert_eq!(preset.values.focus, None, "{}", built_in.name);
            assert!(built_in.text.starts_with("# "), "{}", built_in.name);
            assert!(!built_in.summary().is_empty(), "{}", built_in.name);
        }
    }

    #[test]
    fn an_unknown_preset_is_refused_with_the_nearest_name() {
        let message = Preset::load("potrait").unwrap_err().to_string();
        assert!(message.contains("did you mean 'portrait'?"), "{message}");
        assert!(message.contains("thinlens presets"), "{message}");
    }

    #[cfg(unix)]
    #[test]
    fn an_endless_preset_is_refused() {
        let message = Preset::load("/dev/zero").unwrap_err().to_string();
        assert!(
            message.contains("in: /dev/zero") && message.contains("more than 4194304 bytes"),
            "{message}"
        );
    }

    #[test]
    fn a_missing_preset_file_is_named() {
        let message = Preset::load("no/such.toml").unwrap_err().to_string();
        assert!(message.contains("in: no/such.toml"), "{message}");
    }
}
