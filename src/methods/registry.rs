//! The registry of methods: the built-in ones, and those that a user of the library adds.

use super::contract::{Method, Plan, Role};
use super::decide::{check_effort, plan_for, prepare};
use super::{accumulate, published, shear};
use crate::error::Error;
use crate::scene::{Scene, SceneStats};
use crate::settings::{Effort, ParameterValues, Quality, Settings, at, nearest};

/// The built-in methods, in the order of listings.
pub static METHODS: [&dyn Method; 11] = [
    &shear::Shear,
    &accumulate::Accumulate,
    &published::recursive_gaussian::RecursiveGaussian,
    &published::b_buffer::BBuffer,
    &published::point_splat::PointSplat,
    &published::layer_rays::LayerRays,
    &published::opaque_blur::OpaqueBlur,
    &published::peel_rays::PeelRays,
    &published::pyramid_disocclusion::PyramidDisocclusion,
    &published::gather::Gather,
    &published::scatter::Scatter,
];

/// The methods that a job can name.
#[derive(Debug, Clone)]
pub struct Registry {
    methods: Vec<&'static dyn Method>,
}

impl Default for Registry {
    /// The built-in methods.
    fn default() -> Self {
        Self { methods: METHODS.to_vec() }
    }
}

impl Registry {
    /// Adds a method; it replaces a method of the same name.
    #[must_use]
    pub fn with(mut self, method: &'static dyn Method) -> Self {
        match self.methods.iter_mut().find(|known| known.name() == method.name()) {
            Some(known) => *known = method,
            None => self.methods.push(method),
        }
        self
    }

    /// All methods, in the order of listings.
    pub fn iter(&self) -> impl Iterator<Item = &'static dyn Method> {
        self.methods.iter().copied()
    }

    /// The names of the methods that satisfy `condition`.
    pub fn names_where(
        &self,
        condition: impl Fn(&'static dyn Method) -> bool,
    ) -> impl Iterator<Item = &'static str> {
        self.iter().filter(move |&method| condition(method)).map(|method| method.name())
    }

    /// The method called `name`; `auto` is the method for final quality.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Settings`] for an unknown name, with the nearest known name.
    pub fn by_name(&self, name: &str) -> Result<&'static dyn Method, Error> {
        if name == "auto" {
            return self.of_quality(Quality::Final);
        }
        self.named(name).ok_or_else(|| self.unknown(name))
    }

    /// The method called `name`, which is not `auto`.
    fn named(&self, name: &str) -> Option<&'static dyn Method> {
        self.iter().find(|method| method.name() == name)
    }

    /// The error for a method that does not exist, with the nearest known name.
    fn unknown(&self, name: &str) -> Error {
        let known: Vec<&str> = self.names_where(|_| true).collect();
        let help = match nearest(name, &known) {
            Some(near) => format!("did you mean '{near}'? `thinlens methods` lists the methods"),
            None => format!("the methods are {}", known.join(", ")),
        };
        Error::settings(format!("there is no method called '{name}'")).help(help)
    }

    /// The method that `auto` selects at `quality`: the reference for reference quality, otherwise the default.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Settings`] for a registry without such a method; the built-in methods have both.
    fn of_quality(&self, quality: Quality) -> Result<&'static dyn Method, Error> {
        let role = if quality == Quality::Reference { Role::Reference } else { Role::Default };
        self.iter().find(|method| method.info().role == role).ok_or_else(|| {
            Error::settings(format!("there is no method whose role is '{}'", role.name()))
                .help("name a method instead of auto")
        })
    }

    /// The method that `settings` request; `auto` is the method for the requested quality.
    ///
    /// # Errors
    /// Those of [`Registry::by_name`].
    pub fn chosen(&self, settings: &Settings) -> Result<&'static dyn Method, Error> {
        match (settings.method.value.as_str(), settings.effort.value) {
            ("auto", Some(Effort::Quality(quality))) => self.of_quality(quality),
            (name, _) => self.by_name(name),
        }
    }

    /// Checks every parameter that `values` set, for all methods.
    ///
    /// # Errors
    /// An unknown method or key, with the nearest known name, and a value that a parameter does not accept, each with its
    /// position in the preset.
    pub fn check(&self, values: &ParameterValues) -> Result<(), Error> {
        values.iter().try_for_each(|value| {
            let method = self.named(&value.method).ok_or_else(|| {
                at(self.unknown(&value.method), value.place.as_ref().map(|place| &place.method))
            })?;
            method.parameters().read(&value.method, values).map(drop)
        })
    }

    /// Makes the plan of the method that `settings` request, for a scene with the statistics `stats`.
    ///
    /// # Errors
    /// Those of [`Registry::by_name`] and [`plan_for`], and a flag that the method does not support.
    pub fn plan(&self, stats: &SceneStats, settings: &Settings) -> Result<Plan, Error> {
        let method = self.chosen(settings)?;
        check_effort(method, settings, self.names_where(|method| method.lens_sampling().is_some()))?;
        plan_for(method, stats, settings)
    }

    /// Analyzes `scene`, makes its plan as [`Registry::plan`] does, and applies what the plan does to the scene before the method
    /// runs (highlight extrapolation).
    ///
    /// # Errors
    /// Those of [`Registry::plan`].
    pub fn prepare(&self, scene: Scene, settings: &Settings) -> Result<(Scene, SceneStats, Plan), Error> {
        prepare(scene, |stats| self.plan(stats, settings))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Preset;

    /// The result of checking a preset.
    fn checked(text: &str) -> Result<(), String> {
        let preset = Preset::parse(text, "my.toml").unwrap();
        Registry::default().check(&preset.parameters).map_err(|error| error.to_string())
    }

    #[test]
    fn a_preset_may_have_tables_of_several_methods() {
        let text = "[method.shear]\nviews = 32\nfill = false
            [method.recursive-gaussian]\nlayers = 9\n[method.point-splat]\nintensity = [1, 0.5]";
        assert_eq!(checked(text), Ok(()));
    }

    #[test]
    fn an_error_in_a_methods_table_is_shown_with_its_position() {
        for (text, expected, place) in [
            ("[method.shear]\nprefiltre = 1.0", "did you mean 'prefilter'?", "my.toml:2:1"),
            ("[method.shaer]\nviews = 2", "did you mean 'shear'?", "my.toml:1:9"),
            ("[method.shear]\nfill = 1", "must be true or false", "my.toml:2:8"),
            (
                "[method.shear]\nprefilter = -1",
                "must be a number from 0 to 16 (the default is 1.4)",
                "my.toml:2:13",
            ),
            (
                "[method.layer-rays]\ndelta_px = 0",
                "must be a number from 0.1 to 1000 (the default is 3.0)",
                "my.toml:2:12",
            ),
            (
                "[method.layer-rays]\nrays = 0",
                "must be a whole number from 1 to 65536 (the default is 32)",
                "my.toml:2:8",
            ),
            (
                "[method.recursive-gaussian]\nlayers = 513",
                "must be \"auto\", or a whole number from 1 to 512 (the default is \"auto\")",
                "my.toml:2:10",
            ),
            (
                "[method.point-splat]\nintensity = [0, 0]",
                "must be a list of numbers from 0 to 1000, not all 0",
                "my.toml:2:13",
            ),
            ("[method.scatter]\nsaturation = 'much'", "must be a number", "my.toml:2:14"),
        ] {
            let message = checked(text).unwrap_err();
            assert!(message.contains(expected) && message.contains(place), "{text}: {message}");
            assert!(message.contains('^'), "{message}");
        }
    }

    #[test]
    fn an_unknown_method_is_refused_with_the_nearest_name() {
        let error = Registry::default().by_name("sheer").unwrap_err().to_string();
        assert!(error.contains("did you mean 'shear'?"), "{error}");
    }

    #[test]
    fn auto_is_the_default_method_and_the_reference_at_reference_quality() {
        let methods = Registry::default();
        let name = |quality| methods.of_quality(quality).unwrap().name();
        assert_eq!(Quality::ALL.map(name), ["shear", "shear", "shear", "accumulate"]);
        assert_eq!(methods.by_name("auto").unwrap().name(), "shear");
    }

    #[test]
    fn a_method_replaces_one_of_the_same_name() {
        let methods = Registry::default().with(&shear::Shear);
        assert_eq!(methods.iter().count(), METHODS.len());
    }
}
