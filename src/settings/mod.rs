//! Every value the user can set, and where it came from.
//!
//! A value comes from: built-in default < camera data in the header < preset < flags. Each of these is one [`Values`];
//! [`Settings::resolve`] lays them over one another and keeps the [`Origin`] of each value that won.

mod effort;
mod focus;
mod parameters;
mod preset;

pub use effort::{Effort, Quality};
pub use focus::{Easing, Focus, FocusKey};
pub(crate) use parameters::at;
pub use parameters::{
    Declared, Parameter, ParameterKind, ParameterTable, ParameterValue, ParameterValues, Parameters, Place,
};
pub use preset::{BUILT_IN, BuiltIn, Preset};
#[doc(hidden)]
pub use serde;

use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

/// Where a value came from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase", tag = "from", content = "name")]
pub enum Origin {
    /// The built-in default.
    Default,
    /// An attribute of the input's header.
    Header,
    /// A preset, by name or file.
    Preset(String),
    /// A command-line flag.
    Flag,
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Default => f.write_str("default"),
            Self::Header => f.write_str("header"),
            Self::Preset(name) => write!(f, "preset {name}"),
            Self::Flag => f.write_str("flag"),
        }
    }
}

/// A value with its origin.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Sourced<T> {
    /// The value.
    pub value: T,
    /// Where it came from.
    pub origin: Origin,
}

/// How far behind the lens the sensor stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SensorDistance {
    /// At the focal length, whatever the focus: Blender and Mitsuba.
    FocalLength,
    /// At the image distance of the thin lens, `f·z_f / (z_f − f)`: a real camera.
    ThinLens,
}

/// The most blades that an aperture may have.
pub const MAX_BLADES: u32 = 100;

/// The least and the most curvature of blades: see [`Values::blade_curvature`].
pub const BLADE_CURVATURES: [f32; 2] = [0.0, 1.0];

/// The least and the most squeeze: see [`Values::squeeze`].
pub const SQUEEZES: [f32; 2] = [1.0, 4.0];

/// The least and the most cat's eye: see [`Values::cats_eye`].
pub const CATS_EYES: [f32; 2] = [0.0, 1.2];

/// The least and the most vignetting: see [`Values::vignetting`].
pub const VIGNETTINGS: [f32; 2] = [0.0, 1.0];

/// The least and the most of any aberration, in micrometres.
pub const ABERRATIONS_UM: [f32; 2] = [-5000.0, 5000.0];

/// How much light passes each point of an aperture, as a picture has it.
#[derive(Debug, Clone, PartialEq)]
pub struct Mask {
    /// Where it is from.
    pub name: String,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Light by row, in linear units.
    pub values: Vec<f32>,
}

/// What the picture is taken to show beyond its frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Border {
    /// Its last sample, for ever.
    Clamp,
    /// Itself, reflected.
    Mirror,
    /// Nothing.
    Transparent,
}

/// The least and the most of [`Values::extrapolation_threshold`].
pub const EXTRAPOLATION_THRESHOLDS: [f32; 2] = [0.0, 0.999];

/// The least and the most of [`Values::extrapolation_falloff`].
pub const EXTRAPOLATION_FALLOFFS: [f32; 2] = [0.1, 100.0];

/// The least and the most of [`Values::extrapolation_gain`].
pub const EXTRAPOLATION_GAINS: [f32; 2] = [1.0, 1000.0];

/// How depth is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DepthConvention {
    /// Distance from the lens plane along the optical axis (Blender).
    Planar,
    /// Distance along the ray, counted from the near clip plane (Mitsuba).
    Ray,
    /// One over planar depth.
    Inverse,
    /// 0 at the near plane to 1 at the far plane, linear in planar depth.
    Normalised,
}

/// One layer of settings: what it leaves open is `None`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Values {
    /// Focal length in millimetres.
    pub focal_length_mm: Option<f32>,
    /// Focal length over aperture diameter.
    pub f_number: Option<f32>,
    /// What is in focus.
    pub focus: Option<Focus>,
    /// Width of the display window on the sensor in millimetres.
    pub sensor_width_mm: Option<f32>,
    /// How far behind the lens the sensor stands.
    pub sensor_distance: Option<SensorDistance>,
    /// Number of aperture blades, 0 for a disc.
    pub blades: Option<u32>,
    /// Rotation of the aperture in degrees, anticlockwise as seen in the picture behind focus: Cycles' `aperture_rotation`.
    pub rotation_deg: Option<f32>,
    /// Curvature of the aperture's blades, 0 (straight) to 1 (the circle's own).
    pub blade_curvature: Option<f32>,
    /// Height of the aperture over its width, as an anamorphic lens shows it, its height unchanged: Cycles' `aperture_ratio`.
    pub squeeze: Option<f32>,
    /// Picture of the aperture, in place of blades.
    pub aperture_image: Option<PathBuf>,
    /// How far aside of the aperture the lens's rim stands, seen from the frame's corners, in aperture radii.
    pub cats_eye: Option<f32>,
    /// How much of the lens's falloff of brightness shows: the power to which it is raised.
    pub vignetting: Option<f32>,
    /// How much nearer to the lens the aperture's edge focuses than its middle, along the axis, in micrometres at the sensor.
    pub spherical_um: Option<f32>,
    /// How much farther from the lens than green red and blue focus, along the axis, in micrometres at the sensor.
    pub axial_color_um: Option<[f32; 2]>,
    /// How much farther from the axis than green red and blue show what is in the frame's corners, in micrometres at the sensor.
    pub lateral_color_um: Option<[f32; 2]>,
    /// How depth is written; `None` also when the preset says `auto`.
    pub convention: Option<DepthConvention>,
    /// Length of one depth unit in metres.
    pub metres_per_unit: Option<f32>,
    /// [`DepthConvention::Ray`] only: where the renderer starts to count, in depth units.
    pub near_clip: Option<f32>,
    /// [`DepthConvention::Normalised`] only: planar depth of 0, in depth units.
    pub near: Option<f32>,
    /// [`DepthConvention::Normalised`] only: planar depth of 1, in depth units.
    pub far: Option<f32>,
    /// Samples a picture pixel along each axis.
    pub supersample: Option<usize>,
    /// What lies beyond the frame.
    pub border: Option<Border>,
    /// Display-coded luminance λ₀ above which the highlights of a source that ends at white are extrapolated.
    pub extrapolation_threshold: Option<f32>,
    /// Exponent β by which the extrapolation sets in towards white.
    pub extrapolation_falloff: Option<f32>,
    /// Gain γ in light that white is extrapolated by.
    pub extrapolation_gain: Option<f32>,
    /// Name of the method, or `auto`.
    pub method: Option<String>,
    /// What decides the number of lens samples.
    pub effort: Option<Effort>,
}

/// What describes lens, aperture and depth, each value with its origin.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LensSettings {
    /// See [`Values::focal_length_mm`].
    pub focal_length_mm: Sourced<f32>,
    /// See [`Values::f_number`].
    pub f_number: Sourced<f32>,
    /// See [`Values::focus`].
    pub focus: Sourced<Focus>,
    /// See [`Values::sensor_width_mm`].
    pub sensor_width_mm: Sourced<f32>,
    /// See [`Values::sensor_distance`].
    pub sensor_distance: Sourced<SensorDistance>,
    /// See [`Values::blades`].
    pub blades: Sourced<u32>,
    /// See [`Values::rotation_deg`].
    pub rotation_deg: Sourced<f32>,
    /// See [`Values::blade_curvature`].
    pub blade_curvature: Sourced<f32>,
    /// See [`Values::squeeze`].
    pub squeeze: Sourced<f32>,
    /// See [`Values::aperture_image`].
    pub aperture_image: Sourced<Option<PathBuf>>,
    /// See [`Values::cats_eye`].
    pub cats_eye: Sourced<f32>,
    /// See [`Values::vignetting`].
    pub vignetting: Sourced<f32>,
    /// See [`Values::spherical_um`].
    pub spherical_um: Sourced<f32>,
    /// See [`Values::axial_color_um`].
    pub axial_color_um: Sourced<[f32; 2]>,
    /// See [`Values::lateral_color_um`].
    pub lateral_color_um: Sourced<[f32; 2]>,
    /// See [`Values::metres_per_unit`].
    pub metres_per_unit: Sourced<f32>,
    /// See [`Values::near_clip`].
    pub near_clip: Sourced<f32>,
    /// See [`Values::near`].
    pub near: Sourced<f32>,
    /// See [`Values::far`].
    pub far: Sourced<f32>,
}

/// What describes the picture beside its lens, each value with its origin.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PictureSettings {
    /// See [`Values::border`].
    pub border: Sourced<Border>,
    /// See [`Values::extrapolation_threshold`].
    pub extrapolation_threshold: Sourced<f32>,
    /// See [`Values::extrapolation_falloff`].
    pub extrapolation_falloff: Sourced<f32>,
    /// See [`Values::extrapolation_gain`].
    pub extrapolation_gain: Sourced<f32>,
}

/// All values, each with its origin.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Settings {
    /// Lens, aperture and depth.
    pub lens: LensSettings,
    /// The picture beside its lens.
    pub picture: PictureSettings,
    /// See [`Values::method`].
    pub method: Sourced<String>,
    /// See [`Values::effort`]; `None` leaves it to the method.
    pub effort: Sourced<Option<Effort>>,
    /// Values for the methods' own parameters, which the method checks.
    pub parameters: ParameterValues,
    /// Effects that are to be on or off whatever the scene calls for.
    pub switches: Switches,
    /// What the aperture image shows, once it is read.
    #[serde(skip)]
    pub mask: Option<Arc<Mask>>,
}

/// Effects by their names in reports, switched by the user.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Switches {
    /// Those that are to be simulated.
    pub force: Vec<String>,
    /// Those that are not.
    pub without: Vec<String>,
}

/// The candidate that `word` was most likely meant to be, if any comes near.
pub fn nearest<'a>(word: &str, candidates: &'a [impl AsRef<str>]) -> Option<&'a str> {
    /// Jaro-Winkler similarity from which a word counts as a slip of another.
    const NEAR: f64 = 0.8;
    let likeness = |candidate: &str| strsim::jaro_winkler(&word.to_lowercase(), &candidate.to_lowercase());
    candidates
        .iter()
        .map(|candidate| (likeness(candidate.as_ref()), candidate.as_ref()))
        .filter(|(likeness, _)| *likeness >= NEAR)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, candidate)| candidate)
}

impl Settings {
    /// Lays `layers` over the built-in defaults, later ones on top.
    pub fn resolve(layers: &[(Origin, &Values)], parameters: ParameterValues) -> Self {
        fn pick<T: Clone>(
            layers: &[(Origin, &Values)],
            default: T,
            field: impl Fn(&Values) -> Option<T>,
        ) -> Sourced<T> {
            let set = |(origin, values): &(Origin, &Values)| {
                field(values).map(|value| Sourced { value, origin: origin.clone() })
            };
            layers.iter().rev().find_map(set).unwrap_or(Sourced { value: default, origin: Origin::Default })
        }
        Self {
            lens: LensSettings {
                focal_length_mm: pick(layers, 50.0, |v| v.focal_length_mm),
                f_number: pick(layers, 2.8, |v| v.f_number),
                focus: pick(layers, Focus::Centre, |v| v.focus.clone()),
                sensor_width_mm: pick(layers, 36.0, |v| v.sensor_width_mm),
                sensor_distance: pick(layers, SensorDistance::FocalLength, |v| v.sensor_distance),
                blades: pick(layers, 0, |v| v.blades),
                rotation_deg: pick(layers, 0.0, |v| v.rotation_deg),
                blade_curvature: pick(layers, 0.0, |v| v.blade_curvature),
                squeeze: pick(layers, 1.0, |v| v.squeeze),
                aperture_image: pick(layers, None, |v| v.aperture_image.clone().map(Some)),
                cats_eye: pick(layers, 0.0, |v| v.cats_eye),
                vignetting: pick(layers, 0.0, |v| v.vignetting),
                spherical_um: pick(layers, 0.0, |v| v.spherical_um),
                axial_color_um: pick(layers, [0.0; 2], |v| v.axial_color_um),
                lateral_color_um: pick(layers, [0.0; 2], |v| v.lateral_color_um),
                metres_per_unit: pick(layers, 1.0, |v| v.metres_per_unit),
                near_clip: pick(layers, 0.0, |v| v.near_clip),
                near: pick(layers, 0.0, |v| v.near),
                far: pick(layers, 1.0, |v| v.far),
            },
            picture: PictureSettings {
                border: pick(layers, Border::Clamp, |v| v.border),
                extrapolation_threshold: pick(layers, 0.8, |v| v.extrapolation_threshold),
                extrapolation_falloff: pick(layers, 3.0, |v| v.extrapolation_falloff),
                extrapolation_gain: pick(layers, 2.0, |v| v.extrapolation_gain),
            },
            method: pick(layers, "auto".to_owned(), |v| v.method.clone()),
            effort: pick(layers, None, |v| v.effort.map(Some)),
            parameters,
            switches: Switches::default(),
            mask: None,
        }
    }
}
