//! The one table of settings: lens, aperture, aberrations, depth and picture.
//!
//! A row declares everything about a setting: key, type and default, table and key in presets, unit, range, header attribute,
//! flag, and in its comment what it does. The comment's first line is the help of `-h`, without a full stop and under 60
//! characters; further paragraphs follow in `--help`. A key in backquotes is shown as a flag there.
//!
//! A new setting needs one row, and its use. A value is checked against its setting in [`Setting::check`] and nowhere else.

use super::choices::{AlphaMode, Border, DepthConvention, EnvironmentAxes, Lobe, SensorDistance, StackKind};
use super::declare::{back, default_of, group, pick, resolved, resolved_type, settings};
use super::effort::Effort;
use super::focus::Focus;
use super::keys::NumberKey;
use super::origin::{Origin, Sourced};
use super::setting::{Kind, Range, Setting, SettingType, Value};
use super::switches::Switches;
use crate::error::Error;
use serde::Serialize;
use std::path::PathBuf;

/// A number within `range`, called `name` in words.
const fn number(name: &'static str, range: Range) -> Setting {
    Setting::new(Kind::Number(range), name)
}

/// Range of aberrations, in micrometres at the sensor.
const UM: Range = Range::Within(-5000.0, 5000.0);

/// Why the parameters of the highlight extrapolation have no flag.
const IN_PRESETS: &str = "a choice for a kind of source, made in a preset";

/// `row`, completed by its position in the table.
const fn row(key: &'static str, table: &'static str, text: &'static str, row: Setting) -> Setting {
    let preset_key = if row.preset_key.is_empty() { key } else { row.preset_key };
    Setting { key, field: key, table, preset_key, text, ..row }
}

settings! {
    focus in "lens" {
        /// Distance in focus, in the stack's depth units
        focus_distance: Distance, number("focus distance", Range::PositiveOrInfinite)
            .unit("depth units").otherwise("the picture's centre")
            .attribute("thinlens.focus_distance").flag("focus", "DISTANCE");
        /// Focus on the surface at this pixel; the centre by default
        focus_point: Point, Setting::new(Kind::Pixel, "focus point")
            .unit("px").otherwise("the picture's centre").flag("focus-at", "X,Y");
        /// Focus on this object of the file's cryptomatte
        ///
        /// Its distance is the median over its visible pixels. `thinlens inspect` lists the objects of a file.
        focus_object: Object, Setting::new(Kind::Name, "focus object")
            .otherwise("the picture's centre").flag("focus-on", "NAME");
    }

    /// Lens, aperture and depth, each value with its origin.
    lens {
        "lens" {
            /// Focal length
            focal_length_mm: f32 = 50.0, number("focal length", Range::Positive)
                .unit("mm").attribute("thinlens.focal_length_mm").flag("focal-length", "MM");
            /// Focal length over aperture diameter; inf is a pinhole
            f_number: f32 = 2.8, number("f-number", Range::PositiveOrInfinite).scale("inf is a pinhole")
                .attribute("thinlens.f_number").flag("f-number", "N");
            /// Width of the sensor
            sensor_width_mm: f32 = 36.0, number("sensor width", Range::Positive)
                .unit("mm").attribute("thinlens.sensor_width_mm").flag("sensor-width", "MM");
            /// Distance of the sensor behind the lens
            ///
            /// focal-length: as in Blender and Mitsuba. thin-lens: at the image distance, as in a real camera, with more blur
            /// in close-ups.
            sensor_distance: SensorDistance = SensorDistance::FocalLength,
                Setting::new(Kind::Word(SensorDistance::WORDS), "sensor distance")
                    .attribute("thinlens.sensor_distance").flag("sensor-distance", "WHERE");
        }
        "aperture" {
            /// Number of aperture blades, 0 for a disc
            blades: u32 = 0, Setting::new(Kind::Count { zero: "disc", min: 3, max: 100, of: "blades" }, "blades")
                .attribute("thinlens.blades").flag("blades", "N");
            /// Rotation of the aperture, anticlockwise
            ///
            /// As seen in the picture behind focus: Cycles' aperture rotation.
            rotation_deg: f32 = 0.0, number("rotation", Range::Any)
                .unit("°").attribute("thinlens.rotation_deg").flag("rotation", "DEG");
            /// Curvature of the blades, 0 (straight) to 1 (round)
            blade_curvature: f32 = 0.0, number("blade curvature", Range::Within(0.0, 1.0))
                .scale("straight is 0, round is 1")
                .attribute("thinlens.blade_curvature").flag("blade-curvature", "CURVATURE");
            /// Height of the aperture over its width (anamorphic)
            ///
            /// The shape of blurred points through an anamorphic lens: with 2 they are twice as high as wide. Their height is that
            /// of the disc of the f-number. From 1 to 4.
            squeeze: f32 = 1.0, number("squeeze", Range::Within(1.0, 4.0))
                .scale("height over width").attribute("thinlens.squeeze").flag("squeeze", "RATIO");
            /// Picture of the aperture, instead of blades
            ///
            /// White lets light through. The picture's inscribed circle is the aperture, upright as in a blurred point behind
            /// focus.
            aperture_image: PathBuf, Setting::new(Kind::File, "aperture image")
                .preset_key("image").otherwise("none").flag("aperture-image", "FILE");
            /// Cat's eye: offset of the lens barrel in the corners
            ///
            /// Optical vignetting: seen from the frame's corners, a barrel as wide as the aperture is offset from it by this many
            /// aperture radii, and in proportion less towards the centre. From 0 to 1.2.
            cats_eye: f32 = 0.0, number("cat's eye", Range::Within(0.0, 1.2))
                .unit("aperture radii").scale("offset of the lens barrel in the corners, in aperture radii")
                .attribute("thinlens.cats_eye").flag("cats-eye", "RADII");
        }
        "lens" {
            /// Strength of the falloff of brightness, 0 to 1
            ///
            /// The falloff is the fourth power of the cosine of the field angle, times the share of the aperture that `cats_eye`
            /// leaves open; it is raised to this power.
            vignetting: f32 = 0.0, number("vignetting", Range::Within(0.0, 1.0))
                .scale("0 for none, 1 for the lens's own").attribute("thinlens.vignetting").flag("vignetting", "SHARE");
        }
        "aberrations" {
            /// Spherical aberration, in micrometres
            ///
            /// By how much the aperture's edge focuses nearer to the lens than its centre, along the axis at the sensor. Positive:
            /// soft discs behind focus, hard rings in front of it; negative: soap bubbles behind it.
            spherical_um: f32 = 0.0, number("spherical", UM)
                .unit("µm").scale("micrometres").attribute("thinlens.spherical_um").flag("spherical", "UM");
            /// Axial colour error of red and blue, in micrometres
            ///
            /// By how much they focus farther from the lens than green, along the axis at the sensor. Both positive: green fringes
            /// behind focus, magenta ones in front of it.
            axial_color_um: [f32; 2] = [0.0; 2], Setting::new(Kind::RedBlue(UM), "axial colour")
                .unit("µm").scale("micrometres of red and of blue")
                .attribute("thinlens.axial_color_um").flag("axial-color", "RED,BLUE");
            /// Lateral colour error of red and blue, in micrometres
            ///
            /// By how much they are shifted away from the axis against green in the frame's corners, at the sensor.
            lateral_color_um: [f32; 2] = [0.0; 2], Setting::new(Kind::RedBlue(UM), "lateral colour")
                .unit("µm").scale("micrometres of red and of blue")
                .attribute("thinlens.lateral_color_um").flag("lateral-color", "RED,BLUE");
        }
        "depth" {
            /// Length of one depth unit
            metres_per_unit: f32 = 1.0, number("depth unit", Range::Positive)
                .unit("m").attribute("thinlens.metres_per_unit").flag("metres-per-unit", "METRES");
            /// Distance of the near clip plane, where ray depth is 0
            near_clip: f32 = 0.0, number("near clip", Range::NotNegative)
                .unit("depth units").attribute("thinlens.near_clip").flag("near-clip", "DISTANCE");
            /// Planar distance of depth 0 (normalised depth)
            near: f32 = 0.0, number("depth 0 is at", Range::NotNegative)
                .unit("depth units").attribute("thinlens.near").flag("near", "DISTANCE");
            /// Planar distance of depth 1 (normalised depth)
            far: f32 = 1.0, number("depth 1 is at", Range::Positive)
                .unit("depth units").attribute("thinlens.far").flag("far", "DISTANCE");
        }
    }

    reading in "depth" {
        /// How depth is written
        convention: DepthConvention, Setting::new(Kind::Word(DepthConvention::WORDS), "depth convention")
            .otherwise("from the file")
            .attribute("thinlens.depth_convention").flag("depth-convention", "CONVENTION");
        /// Samples per picture pixel along each axis
        supersample: usize, Setting::new(Kind::Whole(1, 64), "supersample")
            .otherwise("1").attribute("thinlens.supersample").flag("supersample", "S");
        /// What the samples of the stack are
        ///
        /// Overrules what is found in the file. By itself, thinlens looks at the edges around each pixel: hard ones are of point
        /// samples, those with a rim of fractional alpha are of averages over the pixel.
        kind: StackKind, Setting::new(Kind::Word(StackKind::WORDS), "kind of the stack")
            .otherwise("from the edges around each pixel")
            .attribute("thinlens.kind").flag("kind", "KIND");
        /// How the input combines colour and alpha
        ///
        /// auto: OpenEXR and float pictures are premultiplied, PNG and other integer pictures are straight; a TIFF says which it is.
        alpha: AlphaMode, Setting::new(Kind::Word(AlphaMode::WORDS), "alpha")
            .otherwise("as the file's format has it").flag("alpha", "ALPHA");
        /// Anti-aliased picture that peel 0 takes its colour from
        ///
        /// For peels with one sample a pixel: the renderer's own anti-aliased beauty of the same frame. Pixels brighter than
        /// white keep the colour of the peels, in proportion up to twice white. On glossy scenes the peels' own colours can be
        /// nearer to a true render.
        beauty: PathBuf, Setting::new(Kind::File, "beauty").otherwise("none, or the file's group Peel0.Beauty")
            .flag("beauty", "FILE");
        /// Objects that hide what is behind them and are not seen
        ///
        /// A stack, a picture with depth or deep samples of the same frame. They take light away at their depth, along every lens
        /// ray, and the picture is transparent where they are in front: another picture can be put there.
        holdout: PathBuf, Setting::new(Kind::File, "holdout").otherwise("none").flag("holdout", "FILE");
    }

    /// Settings of the picture apart from its lens, each value with its origin.
    picture {
        "picture" {
            /// What lies beyond the frame; clamp by default
            ///
            /// Blur at the frame's edge mixes in what lies beyond it. Overscan is exact: pixels of the data window outside the
            /// frame are used, and this setting applies beyond them.
            border: Border = Border::Clamp, Setting::new(Kind::Word(Border::WORDS), "border").flag("border", "BORDER");
        }
        "environment" {
            /// Picture of what surfaces reflect from all around
            ///
            /// Longitude across, latitude down. The methods accumulate and layer-rays shade what surfaces reflect of it anew for each point of the lens,
            /// where the stack has normals, reflectance and reflected distance.
            environment: PathBuf, Setting::new(Kind::File, "environment")
                .preset_key("image").otherwise("none").flag("environment", "FILE");
            /// The world's axes in the environment's picture
            environment_axes: EnvironmentAxes, Setting::new(Kind::Word(EnvironmentAxes::WORDS), "environment axes")
                .preset_key("axes").otherwise("as the program that wrote the stack has them").flag("environment-axes", "AXES");
            /// Rotation of the environment, anticlockwise from above
            environment_rotation_deg: f32 = 0.0, number("environment rotation", Range::Any)
                .preset_key("rotation_deg").unit("°").flag("environment-rotation", "DEG");
            /// How rough surfaces spread the environment's light
            environment_lobe: Lobe = Lobe::Ggx, Setting::new(Kind::Word(Lobe::WORDS), "environment lobe")
                .preset_key("lobe").flag("environment-lobe", "LOBE");
        }
        "highlight-extrapolation" {
            /// Luminance above which highlights gain light
            ///
            /// Display-coded luminance λ₀ above which the highlights of a source that ends at white are extrapolated.
            extrapolation_threshold: f32 = 0.8, number("threshold", Range::Within(0.0, 0.999))
                .preset_key("threshold").scale("luminance as displayed, white is 1").no_flag(IN_PRESETS);
            /// Exponent β of the gain from the threshold to white
            extrapolation_falloff: f32 = 3.0, number("falloff", Range::Within(0.1, 100.0))
                .preset_key("falloff").scale("an exponent").no_flag(IN_PRESETS);
            /// Gain γ of white, a factor on its light
            extrapolation_gain: f32 = 2.0, number("gain", Range::Within(1.0, 1000.0))
                .preset_key("gain").scale("of the light of white").no_flag(IN_PRESETS);
        }
    }
}

/// How a number gets from one key to the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Interpolation {
    /// The number changes evenly.
    Linear,
    /// Its reciprocal changes evenly.
    Reciprocal,
}

/// A setting that may have keys along a sequence of frames.
#[derive(Debug, Clone, Copy)]
pub(crate) struct KeyedSetting {
    /// The key of the setting.
    pub(crate) key: &'static str,
    /// The key of the list in a preset's `[lens]`.
    pub(crate) list: &'static str,
    /// The same with its table.
    pub(crate) path: &'static str,
    /// The setting in words.
    pub(crate) name: &'static str,
    /// How its number gets from one key to the next.
    pub(crate) interpolation: Interpolation,
    /// Its keys in a layer.
    pub(crate) keys: fn(&Values) -> &Option<Vec<NumberKey>>,
    /// The same, to be changed.
    pub(crate) keys_mut: fn(&mut Values) -> &mut Option<Vec<NumberKey>>,
}

/// Every setting that may have keys, apart from the focus.
///
/// The reciprocal of an f-number is the diameter of the aperture, in focal lengths: with it, blur changes evenly, from and to a pinhole
/// (f/inf) too.
pub(crate) static KEYED: [KeyedSetting; 2] = [
    KeyedSetting {
        key: "f_number",
        list: "f_number_keys",
        path: "lens.f_number_keys",
        name: "f-number",
        interpolation: Interpolation::Reciprocal,
        keys: |values| &values.f_number_keys,
        keys_mut: |values| &mut values.f_number_keys,
    },
    KeyedSetting {
        key: "focal_length_mm",
        list: "focal_length_keys",
        path: "lens.focal_length_keys",
        name: "focal length",
        interpolation: Interpolation::Linear,
        keys: |values| &values.focal_length_keys,
        keys_mut: |values| &mut values.focal_length_keys,
    },
];

impl KeyedSetting {
    /// The setting.
    pub(crate) fn setting(&self) -> &'static Setting {
        Setting::by_key(self.key).expect("each keyed setting is in the table")
    }

    /// Checks its keys in `values`.
    fn check(&self, values: &Values) -> Result<(), Error> {
        let Some(keys) = (self.keys)(values) else { return Ok(()) };
        if self.setting().get(values).is_some() {
            let what = format!("`{}` and `{}` exclude one another", self.key, self.list);
            return Err(Error::settings(what).help("keep one of them"));
        }
        if keys.is_empty() || keys.windows(2).any(|pair| pair[0].frame >= pair[1].frame) {
            let what = format!("`{}` must be one key or more, in rising order of frame", self.list);
            return Err(Error::settings(what));
        }
        keys.iter().try_for_each(|key| {
            let checked = self.setting().check(&Value::Number(key.value));
            checked.map_err(|error| error.with("key", format!("of frame {}", key.frame)))
        })
    }
}

/// A setting with its value and the value's origin.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Listed<'a> {
    /// The setting.
    pub setting: &'static Setting,
    /// Its value; `None` if it is not set and has no default.
    pub value: Option<Value>,
    /// The origin of the value.
    pub origin: &'a Origin,
}

impl Setting {
    /// The setting with the key `key`.
    pub fn by_key(key: &str) -> Option<&'static Self> {
        SETTINGS.iter().find(|setting| setting.key == key)
    }
}

impl PartialEq for Setting {
    /// Compares the keys, since settings are rows of one table.
    fn eq(&self, other: &Self) -> bool {
        self.key == other.key
    }
}

impl Values {
    /// Checks every value that is set.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Settings`] for the first value that its setting does not accept, with the expected value.
    pub fn check(&self) -> Result<(), Error> {
        let set = SETTINGS.iter().filter_map(|setting| Some((setting, setting.get(self)?)));
        for (setting, value) in set {
            setting.check(&value)?;
        }
        KEYED.iter().try_for_each(|keyed| keyed.check(self))?;
        let keys = self.focus.iter().filter_map(|focus| match focus {
            Focus::Keys(keys) => Some(keys),
            _ => None,
        });
        keys.flatten().try_for_each(|key| {
            let focus = Self { focus: Some(key.focus.clone()), ..Self::default() };
            focus.check().map_err(|error| error.with("focus key", format!("of frame {}", key.frame)))
        })
    }

    /// Whether any value has keys along a sequence of frames.
    pub fn has_keys(&self) -> bool {
        matches!(self.focus, Some(Focus::Keys(_))) || KEYED.iter().any(|keyed| (keyed.keys)(self).is_some())
    }

    /// The attributes of these values in a file's header, by name; [`crate::stack`] reads them back.
    pub fn attributes(&self) -> Vec<(&'static str, Value)> {
        let attribute = |setting: &'static Setting| Some((setting.attribute?, setting.get(self)?));
        SETTINGS.iter().filter_map(attribute).collect()
    }
}
