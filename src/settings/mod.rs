//! Every value the user can set, and where it came from.
//!
//! A value comes from: built-in default < camera data in the header < preset < flags. Each of these is one [`Values`];
//! [`Settings::resolve`] lays them over one another and keeps the [`Origin`] of each value that won.
//!
//! [`SETTINGS`] is the one table of settings. What it says of a setting decides how presets, headers and command lines set it,
//! what is refused, and what is shown.

mod choices;
mod declare;
mod effort;
mod focus;
mod origin;
mod parameters;
mod preset;
mod setting;
mod table;

pub use choices::{Border, DepthConvention, SensorDistance};
pub use effort::{Effort, Quality};
pub use focus::{Easing, Focus, FocusKey};
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
pub use table::{LensSettings, Listed, PictureSettings, SETTINGS, Values};

use declare::pick;
use serde::Serialize;
use std::sync::Arc;

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

/// All values, each with its origin.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
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
pub(crate) fn nearest<'a>(word: &str, candidates: &'a [impl AsRef<str>]) -> Option<&'a str> {
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
        let effort = pick(layers, |values| &values.effort);
        Self {
            lens: LensSettings::resolve(layers),
            picture: PictureSettings::resolve(layers),
            method: pick(layers, |values| &values.method).unwrap_or(Sourced::default_of("auto".to_owned())),
            effort: effort.map_or(Sourced::default_of(None), Sourced::given),
            parameters,
            switches: Switches::default(),
            mask: None,
        }
    }
}
