//! How a picture was made: the lens that was used, the settings, the source. The headers of outputs say it.

use super::digest_of::DIGEST;
use crate::finding::Finding;
use crate::lens::ThinLens;
use crate::methods::Plan;
use crate::settings::{
    Effort, Focus, LensSettings, Origin, ParameterValues, Preset, Settings, Switches, Values,
};
use crate::stack::{self, Source};
use exr::meta::attribute::{AttributeValue, Text};

/// The attribute with the number of lens samples: a whole number in an EXR.
const VIEWS: &str = "thinlens.views";

/// How a picture was made.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Made {
    /// The lens, each value with its origin.
    pub lens: LensSettings,
    /// Planar distance in focus, in depth units.
    pub focus_distance: f32,
    /// The settings that were not left at their defaults, with the focus as a distance and the number of lens samples that was found:
    /// with this preset, the same stack gives the same picture. Switches of effects are among them.
    pub settings: Preset,
    /// Name of the method.
    pub method: &'static str,
    /// Lens samples per pixel; `None` for a method that does not sample the lens.
    pub views: Option<usize>,
    /// The effects that were on, by name.
    pub effects: Vec<&'static str>,
    /// The base names of the files that were read.
    pub sources: Vec<String>,
    /// The digest of everything that determines the picture, if the caller had it computed.
    pub digest: Option<String>,
}

impl Made {
    /// A picture that `plan` made with `settings` and `lens`. `reading` are settings of how the stack was read.
    pub(crate) fn new(settings: &Settings, lens: &ThinLens, plan: &Plan, reading: Values) -> Self {
        let focus_distance = lens.focus_distance;
        let (method, views) = (plan.method.name(), plan.views);
        let chosen = Values {
            focus: Some(Focus::Distance(focus_distance)),
            method: Some(method.to_owned()),
            effort: views.map(Effort::Views),
            switches: (settings.switches != Switches::default()).then(|| settings.switches.clone()),
            ..with_origin(settings, reading)
        };
        let mut parameters = ParameterValues::default();
        settings.parameters.iter().filter(|value| value.method == method).for_each(|value| {
            parameters.set(method, value.key.clone(), value.value.clone());
        });
        Self {
            lens: settings.lens.clone(),
            focus_distance,
            settings: Preset { values: chosen, parameters },
            method,
            views,
            effects: plan
                .effects
                .iter()
                .filter(|effect| effect.on)
                .map(|effect| effect.name.name())
                .collect(),
            sources: Vec::new(),
            digest: None,
        }
    }

    /// The same, made of the files `sources`.
    pub(crate) fn of(self, sources: &[Source]) -> Self {
        Self { sources: sources.iter().map(Source::base_name).collect(), ..self }
    }

    /// What is known beside the lens, by the name in a header.
    pub fn texts(&self) -> Vec<(&'static str, String)> {
        let known = [
            ("thinlens.version", Some(env!("CARGO_PKG_VERSION").to_owned())),
            ("thinlens.method", Some(self.method.to_owned())),
            (VIEWS, self.views.map(|views| views.to_string())),
            ("thinlens.effects", Some(self.effects.join(", "))),
            ("thinlens.source", (!self.sources.is_empty()).then(|| self.sources.join(", "))),
            ("thinlens.settings", Some(self.settings.to_toml())),
            (DIGEST, self.digest.clone()),
        ];
        known.into_iter().filter_map(|(name, text)| Some((name, text?))).collect()
    }

    /// Makes the header attributes `attributes`, which come from the input, those of this picture; a finding about those of the input
    /// that said something else of the lens.
    pub fn apply(&self, attributes: &mut Vec<(Text, AttributeValue)>) -> Option<Finding> {
        let finding = stack::correct_camera(attributes, &self.lens, self.focus_distance);
        // How depth was read, where it overrules the header: depth channels may travel to the output.
        let reading = Values { convention: self.settings.values.convention, ..Values::default() };
        for (name, value) in stack::camera_attributes(&reading) {
            attributes.retain(|(other, _)| *other != name);
            attributes.push((name, value));
        }
        for (name, text) in self.texts() {
            attributes.retain(|(other, _)| !other.eq(name));
            let value = match (name, self.views.and_then(|views| i32::try_from(views).ok())) {
                (VIEWS, Some(views)) => AttributeValue::I32(views),
                _ => AttributeValue::Text(Text::from_slice_unchecked(text.as_bytes())),
            };
            attributes.push((Text::from_slice_unchecked(name.as_bytes()), value));
        }
        finding
    }
}

/// `reading`, with the values of `settings` that are not defaults. Files have their full paths, because a preset's files are searched
/// for beside it.
fn with_origin(settings: &Settings, reading: Values) -> Values {
    let mut values = reading;
    let (lens, picture) = (settings.lens.listed(), settings.picture.listed());
    for listed in lens.iter().chain(&picture).filter(|listed| *listed.origin != Origin::Default) {
        if let Some(value) = &listed.value {
            listed.setting.set(&mut values, value);
        }
    }
    let files =
        [&mut values.aperture_image, &mut values.environment, &mut values.beauty, &mut values.holdout];
    for path in files.into_iter().flatten() {
        if let Ok(full) = std::path::absolute(&*path) {
            *path = full;
        }
    }
    values
}
