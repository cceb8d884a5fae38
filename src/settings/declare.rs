//! Macros that turn the declaration of a setting into its field in [`super::Values`], its field with an origin, and its row in
//! [`super::SETTINGS`].

use super::origin::{Origin, Sourced};

/// The value of a field in the highest of `layers` that sets it; later layers are higher.
pub(super) fn pick<V, T: Clone>(
    layers: &[(Origin, &V)],
    field: impl Fn(&V) -> &Option<T>,
) -> Option<Sourced<T>> {
    let set = |(origin, values): &(Origin, &V)| {
        field(values).clone().map(|value| Sourced { value, origin: origin.clone() })
    };
    layers.iter().rev().find_map(set)
}

/// The type of a resolved setting: its own type if it has a default, otherwise an option.
macro_rules! resolved_type {
    ($type:ty) => { Option<$type> };
    ($type:ty = $default:expr) => { $type };
}

/// The resolved value of a setting.
macro_rules! resolved {
    ($layers:expr, $key:ident) => {
        pick($layers, |values| &values.$key).map_or(Sourced::from_default(None), Sourced::into_option)
    };
    ($layers:expr, $key:ident = $default:expr) => {
        pick($layers, |values| &values.$key).unwrap_or_else(|| Sourced::from_default($default))
    };
}

/// A resolved setting as a field of [`super::Values`].
macro_rules! back {
    ($settings:expr, $key:ident) => {
        $settings.$key.value.clone()
    };
    ($settings:expr, $key:ident = $default:expr) => {
        Some($settings.$key.value.to_owned())
    };
}

/// The default of a setting as a [`Value`](super::Value).
macro_rules! default_of {
    ($type:ty) => {
        || None
    };
    ($type:ty = $default:expr) => {
        || Some(<$type as SettingType>::to_value(&$default))
    };
}

/// Declares a struct of resolved settings; the field in brackets has no row of its own.
macro_rules! group {
    (
        $(#[doc = $about:literal])+
        $name:ident {
            $([ $(#[doc = $plain_doc:literal])+ $plain:ident: $plain_type:ty = $plain_default:expr ])?
            $( $(#[doc = $doc:literal])+ $key:ident: $type:ty $(= $default:expr)?; )+
        }
    ) => {
        $(#[doc = $about])+
        #[derive(Debug, Clone, PartialEq, Serialize)]
        #[non_exhaustive]
        pub struct $name {
            $( $(#[doc = $plain_doc])+ pub $plain: Sourced<$plain_type>, )?
            $( $(#[doc = $doc])+ pub $key: Sourced<resolved_type!($type $(= $default)?)>, )+
        }

        impl $name {
            /// Resolves the settings from `layers` over the built-in defaults; later layers take precedence.
            pub(super) fn resolve(layers: &[(Origin, &Values)]) -> Self {
                Self {
                    $( $plain: resolved!(layers, $plain = $plain_default), )?
                    $( $key: resolved!(layers, $key $(= $default)?), )+
                }
            }

            /// The settings as one layer.
            pub fn values(&self) -> Values {
                Values {
                    $( $plain: back!(self, $plain = $plain_default), )?
                    $( $key: back!(self, $key $(= $default)?), )+
                    ..Values::default()
                }
            }

            /// The origin of a field's value.
            fn origin(&self, field: &str) -> Option<&Origin> {
                $( if field == stringify!($plain) { return Some(&self.$plain.origin); } )?
                match field {
                    $( stringify!($key) => Some(&self.$key.origin), )+
                    _ => None,
                }
            }

            /// Every setting with its value and the value's origin, in the order of the table.
            pub fn listed(&self) -> Vec<Listed<'_>> {
                let values = self.values();
                let listed = |setting: &'static Setting| {
                    Some(Listed { setting, value: setting.get(&values), origin: self.origin(setting.field)? })
                };
                SETTINGS.iter().filter_map(listed).collect()
            }

            /// Checks every value. [`super::Settings::resolve`] makes settings without a check.
            ///
            /// # Errors
            /// Those of [`Values::check`].
            pub fn check(&self) -> Result<(), Error> {
                self.values().check()
            }
        }
    };
}

/// Declares every setting: [`super::Values`], the structs of resolved settings, and [`super::SETTINGS`].
macro_rules! settings {
    (
        focus in $focus_table:literal {
            $( $(#[doc = $focus_doc:literal])+ $focus_key:ident: $variant:ident, $focus_row:expr; )+
        }
        $(#[doc = $lens_about:literal])+
        lens { $( $lens_table:literal {
            $( $(#[doc = $lens_doc:literal])+ $lens:ident: $lens_type:ty $(= $lens_default:expr)?, $lens_row:expr; )+
        } )+ }
        reading in $reading_table:literal {
            $( $(#[doc = $reading_doc:literal])+ $reading:ident: $reading_type:ty, $reading_row:expr; )+
        }
        $(#[doc = $picture_about:literal])+
        picture { $( $picture_table:literal {
            $( $(#[doc = $picture_doc:literal])+ $picture:ident: $picture_type:ty $(= $picture_default:expr)?, $picture_row:expr; )+
        } )+ }
    ) => {
        /// One layer of settings; an unset value is `None`.
        ///
        /// Every new setting adds a field: end an expression with `..Values::default()`.
        #[derive(Debug, Clone, Default, PartialEq)]
        pub struct Values {
            /// What is in focus.
            pub focus: Option<Focus>,
            $( $( $(#[doc = $lens_doc])+ pub $lens: Option<$lens_type>, )+ )+
            $( $(#[doc = $reading_doc])+ pub $reading: Option<$reading_type>, )+
            $( $( $(#[doc = $picture_doc])+ pub $picture: Option<$picture_type>, )+ )+
            /// Name of the method, or `auto`.
            pub method: Option<String>,
            /// The sample budget: what decides the number of lens samples.
            pub effort: Option<Effort>,
            /// Keys of the f-number along a sequence of frames, in rising order of frame, in place of [`Self::f_number`].
            pub f_number_keys: Option<Vec<NumberKey>>,
            /// Keys of the focal length in mm, in rising order of frame, in place of [`Self::focal_length_mm`].
            pub focal_length_keys: Option<Vec<NumberKey>>,
            /// Effects that are forced on or left out.
            pub switches: Option<Switches>,
            /// Keys of the distances of this layer that are in metres, and not in depth units.
            pub in_metres: Vec<&'static str>,
        }

        group! {
            $(#[doc = $lens_about])+
            LensSettings {
                [
                    /// What is in focus.
                    focus: Focus = Focus::Centre
                ]
                $( $( $(#[doc = $lens_doc])+ $lens: $lens_type $(= $lens_default)?; )+ )+
            }
        }

        group! {
            $(#[doc = $picture_about])+
            PictureSettings {
                $( $( $(#[doc = $picture_doc])+ $picture: $picture_type $(= $picture_default)?; )+ )+
            }
        }

        /// Every setting of lens, aperture, aberrations, depth and picture.
        pub static SETTINGS: &[Setting] = &[
            $( Setting {
                field: "focus",
                ..row(stringify!($focus_key), $focus_table, concat!($($focus_doc, "\n"),+), $focus_row)
            }, )+
            $( $( Setting {
                default: default_of!($lens_type $(= $lens_default)?),
                ..row(stringify!($lens), $lens_table, concat!($($lens_doc, "\n"),+), $lens_row)
            }, )+ )+
            $( row(stringify!($reading), $reading_table, concat!($($reading_doc, "\n"),+), $reading_row), )+
            $( $( Setting {
                default: default_of!($picture_type $(= $picture_default)?),
                ..row(stringify!($picture), $picture_table, concat!($($picture_doc, "\n"),+), $picture_row)
            }, )+ )+
        ];

        impl Setting {
            /// Its value in `values`.
            pub fn get(&self, values: &Values) -> Option<Value> {
                match self.key {
                    $( stringify!($focus_key) => match &values.focus {
                        Some(Focus::$variant(focus)) => Some(focus.to_value()),
                        _ => None,
                    }, )+
                    $( $( stringify!($lens) => values.$lens.as_ref().map(SettingType::to_value), )+ )+
                    $( stringify!($reading) => values.$reading.as_ref().map(SettingType::to_value), )+
                    $( $( stringify!($picture) => values.$picture.as_ref().map(SettingType::to_value), )+ )+
                    _ => None,
                }
            }

            /// Stores `value`, which is of [`Setting::kind`], in `values`; a value of another kind unsets it.
            pub fn set(&self, values: &mut Values, value: &Value) {
                match self.key {
                    $( stringify!($focus_key) => values.focus = SettingType::from_value(value).map(Focus::$variant), )+
                    $( $( stringify!($lens) => values.$lens = SettingType::from_value(value), )+ )+
                    $( stringify!($reading) => values.$reading = SettingType::from_value(value), )+
                    $( $( stringify!($picture) => values.$picture = SettingType::from_value(value), )+ )+
                    _ => {}
                }
            }
        }
    };
}

pub(super) use {back, default_of, group, resolved, resolved_type, settings};
