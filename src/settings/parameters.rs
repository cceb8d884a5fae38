//! The methods' own parameters: the `[method.NAME]` tables of a preset.
//!
//! A parameter is declared once, with its default, its range and its meaning; the type that methods read, the preset's
//! schema, every error message and `thinlens methods NAME` follow from that.

use super::nearest;
use crate::error::Error;
use serde::{Deserialize, Serialize};
use serde_json::Value as Json;

/// What is known of a parameter beside its value.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Parameter {
    /// Its key in `[method.NAME]`.
    pub name: &'static str,
    /// The value that it has unless a preset sets it, as a preset would have it.
    pub default: String,
    /// What it may be.
    pub kind: ParameterKind,
    /// What it does, with the equation that it enters.
    pub description: &'static str,
}

/// What a parameter may be.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
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
            // A value that stands for a float is compared as one: 0.1 is not less than 0.1f32.
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
    /// What the parameter must be, and its default: as in "must be …".
    pub fn wanted(&self) -> String {
        format!("{} (the default is {})", self.kind.in_words(), self.default)
    }
}

/// Declares the parameters of every method: for each a type with its defaults, and the table of [`Parameter`]s.
macro_rules! methods {
    ($(
        $(#[doc = $about:literal])+
        $method:ident $title:literal $type:ident {
            $( $(#[doc = $doc:literal])+ $key:ident: $value:ty = $default:expr, $kind:ident $(($from:literal, $to:literal))?; )*
        }
    )+) => {
        /// Parameters of every method that has any, each in its own table.
        #[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct MethodParameters {
            $( $(#[doc = $about])+ #[serde(rename = $title)] pub $method: $type, )+
        }

        $(
            $(#[doc = $about])+
            #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
            #[serde(default, deny_unknown_fields)]
            pub struct $type {
                $( $(#[doc = $doc])+ pub $key: $value, )*
            }

            impl Default for $type {
                fn default() -> Self {
                    Self { $( $key: $default, )* }
                }
            }
        )+

        impl MethodParameters {
            /// The parameters of the method called `method`; none for a name that has no table.
            pub fn of(method: &str) -> Vec<Parameter> {
                match method {
                    $( $title => vec![ $( Parameter {
                        name: stringify!($key),
                        default: format!("{:?}", $type::default().$key).replace("None", "\"auto\""),
                        kind: ParameterKind::$kind $(($from, $to))?,
                        description: concat!($($doc),+).trim_ascii(),
                    }, )* ], )+
                    _ => Vec::new(),
                }
            }
        }
    };
}

methods! {
    /// Parameters of `shear`.
    shear "shear" ShearParameters {
        /// Lens samples a pixel when `--views` does not say.
        views: usize = 64, Count(1, 65536);
        /// Radius of the prefilter as a share of the gap between lens samples; 0 switches it off.
        prefilter: f32 = 1.4, Number(0.0, 16.0);
        /// Weight of the resolve filter's four neighbours on point-sampled, in-focus pixels; 0 switches it off.
        resolve: f32 = 0.08, Number(0.0, 0.2);
        /// Brightness, 1 or more, above which a fragment is drawn as an exact disc; 0 switches highlights off.
        highlight_threshold: f32 = 1.0, Number(0.0, 65504.0);
        /// Whether surfaces that the stack lacks may be guessed.
        fill: bool = true, Flag;
    }

    /// Parameters of `accumulate`.
    accumulate "accumulate" AccumulateParameters {
        /// Lens rays a pixel when `--views` does not say.
        rays: usize = 1024, Count(1, 65536);
    }

    /// Parameters of `recursive-gaussian`.
    recursive_gaussian "recursive-gaussian" RecursiveGaussianParameters {
        /// Whether layers are blurred in one cascade (eq. 13) or each on its own (eq. 11).
        cascaded: bool = true, Flag;
        /// Number of depth layers K; "auto" makes as many as the stack's range of CoC asks for.
        layers: Option<usize> = None, CountOrAuto(1, 512);
        /// CoC diameter of a layer over the standard deviation of its Gaussian (eq. 10).
        coc_per_sigma: f32 = 4.0, Number(1.0, 16.0);
        /// Where two layers meet, on the way from the nearer one's CoC radius, 0, to the farther one's, 1 (eq. 9).
        anchor: f32 = 0.5, Number(0.0, 1.0);
    }

    /// Parameters of `b-buffer`.
    b_buffer "b-buffer" BBufferParameters {
        /// Contributions within this of the winner's CoC radius, in pixels, or within half of it, are culled as parts of the same surface.
        same_surface_px: f32 = 0.5, Number(0.0, 64.0);
        /// Largest CoC radius, in pixels, that still counts as in focus.
        in_focus_px: f32 = 0.5, Number(0.1, 8.0);
    }

    /// Parameters of `point-splat`.
    point_splat "point-splat" PointSplatParameters {
        /// Whether what the visible image hides is splatted too (section 3.2).
        hidden: bool = true, Flag;
        /// Least distance behind the visible pixel, as a share of the depth buffer's range, of a hidden fragment (section 3.2).
        epsilon: f32 = 0.05, Number(0.0, 1.0);
        /// Least depth change around a pixel that has a hidden fragment, on the same scale (eq. 4).
        edge: f32 = 0.01, Number(0.0, 1.0);
        /// Share of a pixel's CoC within which another belongs to the same layer (eq. 6).
        delta: f32 = 0.4, Number(0.01, 10.0);
        /// Intensity of a sprite from its centre to its rim, at even distances (section 3.3).
        intensity: Vec<f32> = vec![1.0], Numbers(0.0, 1000.0);
        /// Whether what is blurred and not near an edge is splatted at a quarter of the resolution (section 5).
        accelerated: bool = true, Flag;
    }

    /// Parameters of `layer-rays`.
    layer_rays "layer-rays" LayerRaysParameters {
        /// Lens rays a pixel when `--views` does not say.
        rays: usize = 32, Count(1, 65536);
        /// Growth of the CoC radius from layer to layer, δ, in pixels (eq. 4).
        delta_px: f32 = 3.0, Number(0.1, 1000.0);
        /// Share of its depth by which a layer reaches into its neighbours (section 4.2).
        overlap: f32 = 0.1, Number(0.0, 0.5);
        /// Steps of the false-position search in a layer (section 4.3).
        iterations: usize = 3, Count(1, 64);
        /// Whether rays are thickened to cones (section 4.4).
        cones: bool = true, Flag;
        /// Whether lens samples differ from pixel to pixel (section 4.5).
        jitter: bool = true, Flag;
        /// Whether rays that are stopped outside the frame are discarded (section 4.3); else the border's samples go on for ever.
        discard: bool = true, Flag;
    }

    /// Parameters of `opaque-blur`.
    opaque_blur "opaque-blur" OpaqueBlurParameters {
        /// Blur radius of the first sub-image in pixels; each further one's is twice the one before (eq. 1).
        first_radius_px: f32 = 1.7, Number(0.5, 16.0);
    }

    /// Parameters of `peel-rays`.
    peel_rays "peel-rays" PeelRaysParameters {
        /// Lens rays a pixel when `--views` does not say.
        rays: usize = 256, Count(1, 65536);
        /// Steps of the linear search along a ray.
        linear_steps: usize = 100, Count(1, 4096);
        /// Steps of the binary search that follows.
        binary_steps: usize = 5, Count(0, 32);
    }

    /// Parameters of `pyramid-disocclusion`.
    pyramid_disocclusion "pyramid-disocclusion" PyramidDisocclusionParameters {
        /// Blur radius of the first sub-image in pixels; each further one's is twice the one before.
        first_radius_px: f32 = 1.7, Number(0.5, 16.0);
    }

    /// Parameters of `gather`.
    gather "gather" GatherParameters {
        /// Samples a pixel when `--views` does not say.
        samples: usize = 1024, Count(1, 65536);
    }

    /// Parameters of `scatter`.
    scatter "scatter" ScatterParameters {
        /// Sprites whose coverage adds up to this hide what is behind them.
        saturation: f32 = 1.0, Number(0.1, 10.0);
    }
}

impl MethodParameters {
    /// The table of the method called `method`; `null` for a name that has none.
    ///
    /// # Panics
    /// Never: JSON holds every kind of parameter.
    pub fn table(&self, method: &str) -> Json {
        let mut tables = serde_json::to_value(self).expect("parameters are numbers, flags and lists");
        tables[method].take()
    }

    /// Sets one parameter of the method called `method`, as `KEY=VALUE` with the value as a preset would have it; quotes around
    /// `auto` may be left out.
    ///
    /// # Errors
    /// What is no such pair, an unknown key (with the nearest known one) and a value that the parameter cannot have.
    ///
    /// # Panics
    /// Never: what a parameter's kind allows, its type holds.
    pub fn set(&mut self, method: &str, setting: &str) -> Result<(), Error> {
        let known = Self::of(method);
        let keys: Vec<&str> = known.iter().map(|parameter| parameter.name).collect();
        let Some((key, text)) = setting.split_once('=') else {
            return Err(Error::settings("a parameter is set by KEY=VALUE").with("found", setting).help(
                format!("`thinlens methods {method}` shows the parameters of {method}, each with its range"),
            ));
        };
        let Some(parameter) = known.iter().find(|parameter| parameter.name == key) else {
            let help = match nearest(key, &keys) {
                Some(near) => format!("did you mean '{near}'?"),
                None => format!("the parameters of {method} are {}", keys.join(", ")),
            };
            return Err(Error::settings(format!("{method} has no parameter '{key}'")).help(help));
        };
        let value = match text.trim_matches('"') {
            "auto" => Some(Json::Null),
            text => serde_json::from_str(text).ok(),
        };
        let Some(value) = value.filter(|value| parameter.kind.allows(value)) else {
            let what = format!("'{key}' of {method} must be {}", parameter.wanted());
            return Err(Error::settings(what).with("found", text));
        };
        let mut tables = serde_json::to_value(&*self).expect("parameters are numbers, flags and lists");
        tables[method][key] = value;
        *self = serde_json::from_value(tables).expect("what a parameter's kind allows, its type holds");
        Ok(())
    }

    /// Checks every parameter of the method called `method`.
    ///
    /// # Errors
    /// The first that is not what it must be, with its table, value, range and default.
    pub fn check(&self, method: &str) -> Result<(), Error> {
        let values = self.table(method);
        for parameter in Self::of(method) {
            let value = &values[parameter.name];
            if !parameter.kind.allows(value) {
                let what =
                    format!("'{}' of [method.{method}] must be {}", parameter.name, parameter.wanted());
                return Err(Error::settings(what).with("found", value.to_string()));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parameter_is_set_by_its_key_and_a_value_as_in_a_preset() {
        let mut parameters = MethodParameters::default();
        parameters.set("layer-rays", "cones=false").unwrap();
        parameters.set("recursive-gaussian", "layers=16").unwrap();
        parameters.set("scatter", "saturation=0.5").unwrap();
        parameters.set("point-splat", "intensity=[0.5,1]").unwrap();
        assert!(!parameters.layer_rays.cones);
        assert_eq!(parameters.recursive_gaussian.layers, Some(16));
        assert_eq!(parameters.scatter.saturation, 0.5);
        assert_eq!(parameters.point_splat.intensity, [0.5, 1.0]);
        for auto in ["layers=auto", "layers=\"auto\""] {
            parameters.set("recursive-gaussian", auto).unwrap();
            assert_eq!(parameters.recursive_gaussian.layers, None, "{auto}");
        }
    }

    #[test]
    fn a_parameter_that_cannot_be_set_says_why() {
        let message = |setting| MethodParameters::default().set("scatter", setting).unwrap_err().to_string();
        assert!(message("saturation").contains("KEY=VALUE"));
        assert!(message("saturatoin=1").contains("did you mean 'saturation'?"));
        assert!(message("saturation=0").contains("must be a number from 0.1 to 10"));
        assert!(message("saturation=auto").contains("must be a number"), "auto is not for every parameter");
        assert!(message("saturation=much").contains("must be a number"));
    }
}
