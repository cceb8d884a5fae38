//! Every value that the user can set, and its origin.
//!
//! The sources of values, in rising precedence, are the built-in default, camera data in the header, the preset, and flags. Each of them
//! is one [`Values`]; [`Settings::resolve`] layers them and keeps the [`Origin`] of each value.
//!
//! [`SETTINGS`] is the one table of settings. From a row follow how presets, headers and command lines set it,
//! which values are refused, and what is shown.

mod choices;
mod declare;
mod effort;
mod focus;
mod keys;
mod origin;
mod parameters;
mod preset;
mod setting;
mod switches;
mod table;
mod units;

pub use choices::{AlphaMode, Border, DepthConvention, EnvironmentAxes, Lobe, SensorDistance, StackKind};
pub use effort::{Effort, Quality};
pub use focus::{Focus, FocusKey};
pub(crate) use keys::Keyed;
pub use keys::{Easing, NumberKey};
pub use origin::{Origin, Sourced};
pub use parameters::{
    Declared, Parameter, ParameterKind, ParameterTable, ParameterValue, ParameterValues, Parameters,
};
pub(crate) use parameters::{Place, at};
pub use preset::{BUILT_IN, BuiltIn, Preset};
#[doc(hidden)]
pub use serde;
pub use serde_json::Value as Json;
pub use setting::{CommandLine, Kind, Range, Setting, Value, Word};
pub use switches::Switches;
pub(crate) use table::{Interpolation, KEYED, KeyedSetting};
pub use table::{LensSettings, Listed, PictureSettings, SETTINGS, Values};
pub use units::Written;

use declare::pick;
use serde::Serialize;
use std::sync::Arc;

/// The transmittance of an aperture, read from a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Mask {
    /// The picture's file, for errors.
    pub name: String,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Light row by row, in linear units.
    pub values: Vec<f32>,
}

/// The light of an environment, read from a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Surroundings {
    /// Width in texels.
    pub width: usize,
    /// Height in texels.
    pub height: usize,
    /// Red, green and blue row by row, in linear units.
    pub texels: Arc<[[f32; 3]]>,
}

/// All values, each with its origin.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Settings {
    /// Lens, aperture and depth.
    pub lens: LensSettings,
    /// Settings of the picture apart from its lens.
    pub picture: PictureSettings,
    /// See [`Values::method`].
    pub method: Sourced<String>,
    /// See [`Values::effort`]; `None` leaves the choice to the method.
    pub effort: Sourced<Option<Effort>>,
    /// Values for the methods' own parameters, which the method checks.
    pub parameters: ParameterValues,
    /// Effects that the user switches on or off, whatever the plan would choose.
    pub switches: Switches,
    /// The content of the aperture image, once it is read.
    #[serde(skip)]
    pub mask: Option<Arc<Mask>>,
    /// The content of the environment's picture, once it is read.
    #[serde(skip)]
    pub surroundings: Option<Surroundings>,
}

/// The candidate that `word` most likely stands for; `None` if none is similar.
pub(crate) fn nearest<'a>(word: &str, candidates: &'a [impl AsRef<str>]) -> Option<&'a str> {
    /// Jaro-Winkler similarity from which a word counts as a misspelling of another.
    const MIN_SIMILARITY: f64 = 0.8;
    let similarity = |candidate: &str| strsim::jaro_winkler(&word.to_lowercase(), &candidate.to_lowercase());
    candidates
        .iter()
        .map(|candidate| (similarity(candidate.as_ref()), candidate.as_ref()))
        .filter(|(similarity, _)| *similarity >= MIN_SIMILARITY)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, candidate)| candidate)
}

impl Settings {
    /// Resolves the settings from `layers` over the built-in defaults; later layers take precedence.
    pub fn resolve(layers: &[(Origin, &Values)], parameters: ParameterValues) -> Self {
        let effort = pick(layers, |values| &values.effort);
        Self {
            lens: LensSettings::resolve(layers),
            picture: PictureSettings::resolve(layers),
            method: pick(layers, |values| &values.method).unwrap_or(Sourced::from_default("auto".to_owned())),
            effort: effort.map_or(Sourced::from_default(None), Sourced::into_option),
            parameters,
            switches: pick(layers, |values| &values.switches).map(|s| s.value).unwrap_or_default(),
            mask: None,
            surroundings: None,
        }
    }
}
