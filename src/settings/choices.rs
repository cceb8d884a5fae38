//! Settings whose value is one of a few words.

use super::setting::{SettingType, Value, Word};
use serde::{Deserialize, Serialize};

/// Distance of the sensor behind the lens.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum SensorDistance {
    /// The focal length for any focus, as in Blender and Mitsuba.
    FocalLength,
    /// The image distance of the thin lens, `f·z_f / (z_f − f)`, as in a real camera.
    ThinLens,
}

/// The assumed content beyond the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Border {
    /// The last sample, repeated.
    Clamp,
    /// The picture, reflected.
    Mirror,
    /// Empty.
    Transparent,
}

/// How depth is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum DepthConvention {
    /// Distance from the lens plane along the optical axis (Blender).
    Planar,
    /// Distance along the ray from the near clip plane (Mitsuba).
    Ray,
    /// Reciprocal of planar depth.
    Inverse,
    /// From 0 at the near plane to 1 at the far plane, linear in planar depth.
    Normalised,
}

/// How colour and alpha of the input are combined.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum AlphaMode {
    /// Colour is multiplied by alpha, as renderers write it.
    Premultiplied,
    /// Colour is not multiplied by alpha.
    Straight,
    /// Alpha is left out: every pixel is opaque.
    Opaque,
}

/// What the colours and the alpha of a stack's fragments represent.
///
/// As a setting it overrules what is found in the stack, everywhere. Unset, each place of the picture is decided by itself: see
/// [`crate::stack::Antialiasing`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum StackKind {
    /// Peels with one sample per pixel: alpha is 0, 1 or an opacity.
    #[serde(rename = "point")]
    PointSampled,
    /// Peels whose colours are averages over the pixel and whose alpha is the share of the pixel that they cover.
    Coverage,
    /// Point-sampled peels at a multiple of the picture's resolution.
    Supersampled,
    /// One anti-aliased picture with one depth sample per pixel, without surfaces behind it.
    #[serde(rename = "beauty")]
    BeautyDepth,
}

/// Which of the world's axes are where in the picture of an environment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum EnvironmentAxes {
    /// +y up, +z at the centre, +x at a quarter of the width: OpenEXR, Mitsuba.
    Opengl,
    /// +z up, +x at the centre, +y at a quarter of the width: Blender.
    Blender,
}

/// How rough surfaces spread the light of an environment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Lobe {
    /// Microfacets, whose α is the square of the roughness.
    Ggx,
    /// A power of the cosine, with the exponent `2 / α² − 2`.
    Phong,
}

/// Declares the words of an enum for presets, headers and command lines. `open` is a word that leaves the setting unset.
macro_rules! words {
    ($type:ident $(, open: $open:literal $open_meaning:literal)?; $($variant:ident $name:literal $meaning:literal),+) => {
        impl $type {
            /// The words of the setting.
            pub const WORDS: &'static [Word] = &[
                $( Word { name: $open, meaning: $open_meaning }, )?
                $( Word { name: $name, meaning: $meaning }, )+
            ];

            /// The word of this value.
            pub fn name(self) -> &'static str {
                match self {
                    $( Self::$variant => $name, )+
                }
            }
        }

        impl SettingType for $type {
            fn to_value(&self) -> Value {
                Value::Word(self.name())
            }

            fn from_value(value: &Value) -> Option<Self> {
                match value {
                    $( Value::Word($name) => Some(Self::$variant), )+
                    _ => None,
                }
            }
        }
    };
}

words! { SensorDistance; FocalLength "focal_length" "", ThinLens "thin_lens" "" }

words! { Border;
    Clamp "clamp" "The last pixel, repeated",
    Mirror "mirror" "The picture, reflected",
    Transparent "transparent" "Empty: blurred edges fade out"
}

words! { DepthConvention, open: "auto" "From the file";
    Planar "planar" "Along the optical axis (Blender)",
    Ray "ray" "Along the ray, from the near clip plane (Mitsuba)",
    Inverse "inverse" "Reciprocal of planar depth",
    Normalised "normalised" "0 at `near` to 1 at `far`"
}

words! { AlphaMode, open: "auto" "As the file's format has it";
    Premultiplied "premultiplied" "Colour is multiplied by alpha",
    Straight "straight" "Colour is not multiplied by alpha",
    Opaque "opaque" "Alpha is left out: every pixel is opaque"
}

words! { EnvironmentAxes, open: "auto" "As the program that wrote the stack has them";
    Opengl "opengl" "y up, z at the centre (OpenEXR, Mitsuba)",
    Blender "blender" "z up, x at the centre"
}

words! { Lobe;
    Ggx "ggx" "Microfacets",
    Phong "phong" "A power of the cosine"
}

words! { StackKind, open: "auto" "From the edges around each pixel";
    PointSampled "point" "Peels with one sample a pixel",
    Coverage "coverage" "Peels of averages over the pixel",
    Supersampled "supersampled" "Peels with `supersample` samples a pixel",
    BeautyDepth "beauty" "One anti-aliased picture with depth"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_in_reports_are_those_of_presets() {
        fn json(value: impl Serialize) -> serde_json::Value {
            serde_json::to_value(value).unwrap()
        }
        for value in [SensorDistance::FocalLength, SensorDistance::ThinLens] {
            assert_eq!(serde_json::to_value(value).unwrap(), value.name());
        }
        for value in [Border::Clamp, Border::Mirror, Border::Transparent] {
            assert_eq!(serde_json::to_value(value).unwrap(), value.name());
        }
        for value in [
            DepthConvention::Planar,
            DepthConvention::Ray,
            DepthConvention::Inverse,
            DepthConvention::Normalised,
        ] {
            assert_eq!(json(value), value.name());
        }
        for value in [AlphaMode::Premultiplied, AlphaMode::Straight, AlphaMode::Opaque] {
            assert_eq!(json(value), value.name());
        }
        for value in
            [StackKind::PointSampled, StackKind::Coverage, StackKind::Supersampled, StackKind::BeautyDepth]
        {
            assert_eq!(serde_json::to_value(value).unwrap(), value.name());
        }
    }
}
