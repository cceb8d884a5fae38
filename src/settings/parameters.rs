//! Parameters of methods: how a method declares them, and how values from presets and flags reach the method.
//!
//! A parameter is declared once, in the folder of its method, by [`declare_parameters!`](crate::declare_parameters): name, type,
//! default, range and meaning. The type that the method reads, the preset's schema, every error message and `thinlens methods NAME`
//! follow from that. This module does not depend on any method.
//!
//! [`ParameterValues`] are the user's values, by method and not yet checked. [`ParameterTable::read`] checks them against the
//! declaration and returns the method's own type, wrapped as [`Parameters`].

use super::nearest;
use crate::error::Error;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value as Json;
use std::any::Any;
use std::fmt::Debug;
use std::sync::Arc;

/// The declaration of one parameter.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Parameter {
    /// Its key in `[method.NAME]`.
    pub name: &'static str,
    /// The default, as a preset writes it.
    pub default: String,
    /// The values that it accepts.
    pub kind: ParameterKind,
    /// What it does, with the equation that it is used in.
    pub description: &'static str,
}

/// The values that a parameter accepts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum ParameterKind {
    /// `true` or `false`.
    Flag,
    /// A whole number from the first to the second.
    Count(u32, u32),
    /// A whole number from the first to the second, or `"auto"`.
    CountOrAuto(u32, u32),
    /// A number from the first to the second.
    Number(f32, f32),
    /// A list of numbers, each from the first to the second, not all 0.
    Numbers(f32, f32),
}

impl ParameterKind {
    /// The kind in words, as in "must be …".
    pub fn in_words(&self) -> String {
        match self {
            Self::Flag => "true or false".to_owned(),
            Self::Count(from, to) => format!("a whole number from {from} to {to}"),
            Self::CountOrAuto(from, to) => format!("\"auto\", or a whole number from {from} to {to}"),
            Self::Number(from, to) => format!("a number from {from} to {to}"),
            Self::Numbers(from, to) => format!("a list of numbers from {from} to {to}, not all 0"),
        }
    }

    /// Whether `value` is of this kind; "auto" is `null`.
    pub fn allows(&self, value: &Json) -> bool {
        let between = |value: &Json, from: f32, to: f32| {
            // Compared as f32, like the bounds: as f64, 0.1 is less than 0.1f32.
            value.as_f64().is_some_and(|number| (from..=to).contains(&(number as f32)))
        };
        match *self {
            Self::Flag => value.is_boolean(),
            Self::Count(from, to) => value.is_u64() && between(value, from as f32, to as f32),
            Self::CountOrAuto(from, to) => value.is_null() || Self::Count(from, to).allows(value),
            Self::Number(from, to) => between(value, from, to),
            Self::Numbers(from, to) => value.as_array().is_some_and(|values| {
                values.iter().all(|value| between(value, from, to))
                    && values.iter().any(|value| value.as_f64() != Some(0.0))
            }),
        }
    }
}

impl Parameter {
    /// The expected value and the default, as in "must be …".
    pub fn expected(&self) -> String {
        format!("{} (the default is {})", self.kind.in_words(), self.default)
    }
}

/// A type that holds the parameters of one method; [`declare_parameters!`](crate::declare_parameters) implements it.
pub trait Declared:
    Any + Debug + Clone + Default + PartialEq + Send + Sync + Serialize + DeserializeOwned
{
    /// The parameters in the order of their declaration.
    fn declarations() -> Vec<Parameter>;
}

/// Declares the parameters of a method: a type with one field each, its defaults, and its [`Declared`] implementation.
///
/// ```
/// thinlens::declare_parameters! {
///     /// Parameters of `box-blur`.
///     pub BoxBlurParameters {
///         /// Largest radius of the box in pixels.
///         max_radius_px: f32 = 32.0, Number(1.0, 256.0);
///         /// Whether the frame's border is repeated.
///         clamp: bool = true, Flag;
///     }
/// }
/// assert_eq!(BoxBlurParameters::default().max_radius_px, 32.0);
/// ```
///
/// A type is `bool` (`Flag`), `usize` (`Count(min, max)`), `Option<usize>` (`CountOrAuto(min, max)`, `None` is "auto"), `f32`
/// (`Number(min, max)`) or `Vec<f32>` (`Numbers(min, max)`).
#[macro_export]
macro_rules! declare_parameters {
    (
        $(#[doc = $about:literal])+
        $visibility:vis $type:ident {
            $( $(#[doc = $doc:literal])+ $key:ident: $value:ty = $default:expr, $kind:ident $(($from:literal, $to:literal))?; )*
        }
    ) => {
        $(#[doc = $about])+
        #[derive(Debug, Clone, PartialEq, $crate::settings::serde::Serialize, $crate::settings::serde::Deserialize)]
        #[serde(crate = "thinlens::settings::serde", default, deny_unknown_fields)]
        $visibility struct $type {
            $( $(#[doc = $doc])+ pub $key: $value, )*
        }

        impl Default for $type {
            fn default() -> Self {
                Self { $( $key: $default, )* }
            }
        }

        impl $crate::settings::Declared for $type {
            fn declarations() -> Vec<$crate::settings::Parameter> {
                let defaults = Self::default();
                vec![ $( $crate::settings::Parameter {
                    name: stringify!($key),
                    default: format!("{:?}", defaults.$key).replace("None", "\"auto\""),
                    kind: $crate::settings::ParameterKind::$kind $(($from, $to))?,
                    description: concat!($($doc),+).trim_ascii(),
                }, )* ]
            }
        }
    };
}

/// One value for a parameter from a preset or a flag, not yet checked.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ParameterValue {
    /// Name of the method.
    pub method: String,
    /// The parameter's key.
    pub key: String,
    /// The value; `null` is "auto", and a value that no parameter accepts is a text.
    pub value: Json,
    /// Its location in a preset, for errors.
    #[serde(skip)]
    pub(crate) place: Option<Place>,
}

/// Where a preset sets a parameter: file, line and column, the line itself and carets, as errors show it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Place {
    /// Location of the method's name, `[method.NAME]`.
    pub method: String,
    /// Location of the key.
    pub key: String,
    /// Location of the value.
    pub value: String,
}

/// Values for the parameters of any methods, in the order in which they were set: the last value of a key is used.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct ParameterValues(Vec<ParameterValue>);

impl ParameterValues {
    /// Sets parameter `key` of the method called `method`.
    pub fn set(&mut self, method: impl Into<String>, key: impl Into<String>, value: impl Into<Json>) {
        self.push(ParameterValue {
            method: method.into(),
            key: key.into(),
            value: value.into(),
            place: None,
        });
    }

    /// Adds a value, which takes precedence over those before it.
    pub fn push(&mut self, value: ParameterValue) {
        self.0.push(value);
    }

    /// Every value, in the order in which they were set.
    pub fn iter(&self) -> impl Iterator<Item = &ParameterValue> {
        self.0.iter()
    }
}

/// The content of a [`Parameters`]: any type that a method declares.
trait ParameterSet: Any + Debug + Send + Sync {
    fn as_any(&self) -> &dyn Any;
    fn table(&self) -> Json;
}

impl<T: Declared> ParameterSet for T {
    fn as_any(&self) -> &dyn Any {
        self
    }

    fn table(&self) -> Json {
        serde_json::to_value(self).expect("parameters are numbers, flags and lists")
    }
}

/// The parameters of one method, checked. The method gets them as its own type from [`Parameters::get`].
#[derive(Debug, Clone)]
pub struct Parameters(Arc<dyn ParameterSet>);

impl Parameters {
    /// Wraps the parameters of one method.
    pub fn new(parameters: impl Declared) -> Self {
        Self(Arc::new(parameters))
    }

    /// The parameters as the type that the method declared.
    ///
    /// # Panics
    /// If `T` is not the type of these parameters.
    pub fn get<T: Declared>(&self) -> &T {
        self.0.as_any().downcast_ref().expect("a plan has the parameters of its own method")
    }

    /// The parameters by key, as JSON; "auto" is `null`.
    pub fn table(&self) -> Json {
        self.0.table()
    }
}

impl PartialEq for Parameters {
    fn eq(&self, other: &Self) -> bool {
        self.table() == other.table()
    }
}

impl Serialize for Parameters {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.table().serialize(serializer)
    }
}

/// The declared parameters of a method.
#[derive(Debug, Clone, Copy)]
pub struct ParameterTable {
    declarations: fn() -> Vec<Parameter>,
    defaults: fn() -> Parameters,
    read: fn(Json) -> serde_json::Result<Parameters>,
}

/// The parameters of a method that has none.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
struct NoParameters {}

impl Declared for NoParameters {
    fn declarations() -> Vec<Parameter> {
        Vec::new()
    }
}

impl ParameterTable {
    /// The table of a method without parameters.
    pub fn none() -> Self {
        Self::of::<NoParameters>()
    }

    /// The table of the parameters that `T` declares.
    pub fn of<T: Declared>() -> Self {
        Self {
            declarations: T::declarations,
            defaults: || Parameters::new(T::default()),
            read: |table| serde_json::from_value::<T>(table).map(Parameters::new),
        }
    }

    /// The declarations, in order.
    pub fn declarations(&self) -> Vec<Parameter> {
        (self.declarations)()
    }

    /// Every parameter at its default.
    pub fn defaults(&self) -> Parameters {
        (self.defaults)()
    }

    /// The defaults, with the `values` for the method called `method`.
    ///
    /// # Errors
    /// An unknown key, with the nearest known one, and a value that the parameter does not accept.
    ///
    /// # Panics
    /// Never: the type of a parameter represents every value that its kind allows.
    pub fn read(&self, method: &str, values: &ParameterValues) -> Result<Parameters, Error> {
        let mut table = self.defaults().table();
        for value in values.iter().filter(|value| value.method == method) {
            self.check(value)?;
            table[&value.key] = value.value.clone();
        }
        Ok((self.read)(table).expect("a parameter's type represents every value that its kind allows"))
    }

    /// Parses `setting`, a `KEY=VALUE` with the value as a preset writes it, for the method called `method`. Quotes around `auto` may be
    /// left out.
    ///
    /// # Errors
    /// A text of another form, an unknown key, and a value that the parameter does not accept.
    pub fn parse(&self, method: &str, setting: &str) -> Result<ParameterValue, Error> {
        let Some((key, text)) = setting.split_once('=') else {
            return Err(Error::settings("a parameter is set by KEY=VALUE").with("found", setting).help(
                format!("`thinlens methods {method}` shows the parameters of {method}, each with its range"),
            ));
        };
        let value = match text.trim_matches('"') {
            "auto" => Json::Null,
            other => serde_json::from_str(other).unwrap_or_else(|_| Json::from(text)),
        };
        let value = ParameterValue { method: method.to_owned(), key: key.to_owned(), value, place: None };
        self.check(&value)?;
        Ok(value)
    }

    /// Checks key and value against the declarations.
    fn check(&self, value: &ParameterValue) -> Result<(), Error> {
        let ParameterValue { method, key, value, place } = value;
        let known = self.declarations();
        let Some(parameter) = known.iter().find(|parameter| parameter.name == key) else {
            let keys: Vec<&str> = known.iter().map(|parameter| parameter.name).collect();
            let help = match nearest(key, &keys) {
                Some(near) => format!("did you mean '{near}'?"),
                None if keys.is_empty() => format!("{method} has no parameters"),
                None => format!("the parameters of {method} are {}", keys.join(", ")),
            };
            let error = Error::settings(format!("{method} has no parameter '{key}'"));
            return Err(at(error, place.as_ref().map(|place| &place.key)).help(help));
        };
        if parameter.kind.allows(value) {
            return Ok(());
        }
        let error = Error::settings(format!("'{key}' of {method} must be {}", parameter.expected()));
        let found = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        let found = if value.is_null() { "auto".to_owned() } else { found };
        Err(match place {
            Some(place) => at(error, Some(&place.value)),
            None => error.with("found", found),
        })
    }
}

/// `error` with its location in a preset.
pub(crate) fn at(error: Error, place: Option<&String>) -> Error {
    match place {
        Some(place) => error.at(place),
        None => error,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    crate::declare_parameters! {
        /// Parameters of a method for these tests.
        MadeParameters {
            /// A share.
            share: f32 = 0.5, Number(0.1, 10.0);
            /// Layers; "auto" uses as many as are needed.
            layers: Option<usize> = None, CountOrAuto(1, 512);
            /// A profile.
            profile: Vec<f32> = vec![1.0], Numbers(0.0, 1000.0);
            /// Whether cones are traced.
            cones: bool = true, Flag;
        }
    }

    fn table() -> ParameterTable {
        ParameterTable::of::<MadeParameters>()
    }

    fn parsed(settings: &[&str]) -> MadeParameters {
        let mut values = ParameterValues::default();
        settings.iter().for_each(|setting| values.push(table().parse("made", setting).unwrap()));
        table().read("made", &values).unwrap().get::<MadeParameters>().clone()
    }

    #[test]
    fn a_parameter_is_set_by_its_key_and_a_value_as_in_a_preset() {
        let set = parsed(&["cones=false", "layers=16", "share=0.25", "profile=[0.5,1]"]);
        let expected =
            MadeParameters { cones: false, layers: Some(16), share: 0.25, profile: vec![0.5, 1.0] };
        assert_eq!(set, expected);
        for auto in ["layers=auto", "layers=\"auto\""] {
            assert_eq!(parsed(&["layers=16", auto]).layers, None, "the last one counts: {auto}");
        }
    }

    #[test]
    fn a_parameter_that_cannot_be_set_is_refused_with_a_reason() {
        let message = |setting| table().parse("made", setting).unwrap_err().to_string();
        assert!(message("share").contains("KEY=VALUE"));
        assert!(message("shrae=1").contains("did you mean 'share'?"));
        assert!(message("share=0").contains("must be a number from 0.1 to 10 (the default is 0.5)"));
        assert!(message("share=auto").contains("must be a number"), "only some parameters accept auto");
        assert!(message("share=much").contains("found: much"));
        assert!(message("profile=[0,0]").contains("not all 0"));
    }

    #[test]
    fn values_of_other_methods_are_ignored() {
        let mut values = ParameterValues::default();
        values.set("another", "share", 9000.0);
        assert_eq!(table().read("made", &values).unwrap(), table().defaults());
        values.set("made", "share", 9000.0);
        assert!(table().read("made", &values).is_err());
    }

    #[test]
    fn a_method_without_parameters_accepts_none() {
        let none = ParameterTable::none();
        assert_eq!(none.declarations(), []);
        assert!(none.parse("made", "share=1").unwrap_err().to_string().contains("has no parameters"));
    }
}
