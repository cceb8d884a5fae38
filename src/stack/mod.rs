//! READ: files in, a [`Stack`] out.
//!
//! Knows every file format and naming convention of the input, and nothing of lenses: depth stays in the convention it
//! was written in, with a note of which one that is ([`Stack::convention`]). Nothing here guesses without saying so: every
//! conclusion drawn from a file is a [`Finding`].

mod camera;
mod carried;
mod chunks;
mod convention;
mod cryptomatte;
mod decode;
#[doc(hidden)]
pub mod depth;
mod frame_number;
mod guard;
mod header;
mod input;
mod kind;
mod layers;
mod murmur;
mod names;
mod options;
mod picture;
mod planes;
mod read;
mod sanitise;

#[doc(hidden)]
pub use camera::camera_attributes;
#[cfg(feature = "cli")]
pub(crate) use cryptomatte::listed;
pub use cryptomatte::{Cryptomatte, ObjectMatte, Objects};
pub(crate) use frame_number::frame_number;
pub use options::{Carry, ReadOptions, Source};
pub use read::{read, read_picture};

use crate::finding::Finding;
use crate::image::Plane;
use crate::settings::{DepthConvention, Values};
use std::fmt;

/// One depth-peel layer: what a ray through each pixel centre meets at its `n`-th hit.
#[derive(Debug, Clone, PartialEq)]
pub struct Peel {
    /// Red, green, blue: scene-linear, premultiplied by `alpha`.
    pub color: [Plane; 3],
    /// Coverage or opacity, 0 … 1. Where it is 0 the peel is empty.
    pub alpha: Plane,
    /// Depth in the stack's convention and units, as it stood in the file.
    pub depth: Plane,
}

/// A rectangle of pixels; `x`, `y` is its top left corner and may be negative.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Left edge.
    pub x: i32,
    /// Top edge.
    pub y: i32,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
}

/// Where the pixels lie: the planes of a stack are the data window, the sensor is the display window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// The pixels present, overscan and crop included.
    pub data: Window,
    /// The picture's frame, as wide as the sensor.
    pub display: Window,
    /// Width of a pixel divided by its height.
    pub pixel_aspect: f32,
}

/// What a stack's fragments stand for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum StackKind {
    /// One anti-aliased picture with one depth sample a pixel; nothing is known behind it.
    BeautyDepth,
    /// Peels with one sample a pixel: alpha is 0 or 1.
    PointSampled,
    /// Peels whose alpha is the share of the pixel they cover.
    Coverage,
    /// Point-sampled peels at a multiple of the picture's resolution.
    Supersampled,
    /// A renderer's own anti-aliased peels: peel 0 mixes front with back, deeper peels have alpha without depth.
    RendererAntialiased,
}

/// Numeric type of the input's colour channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Precision {
    /// 16-bit floating point.
    Half,
    /// 32-bit floating point.
    Float,
}

/// How bright the colours of an input can be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum ColorRange {
    /// Scene-linear floats: whatever was there.
    Unbounded,
    /// Integers of a picture made for a display: all that was brighter was clipped to white.
    UpToWhite,
}

/// A channel that is neither colour nor depth of a peel, kept as it was to be written beside the picture.
#[derive(Debug, Clone)]
pub struct CarriedChannel {
    /// Full name, dotted prefix included.
    pub name: String,
    /// Samples of the data window in their own type.
    #[doc(hidden)]
    pub samples: exr::image::FlatSamples,
    /// Whether the samples are perceptually linear (an EXR channel flag).
    pub quantize_linearly: bool,
}

/// What travels from input to output untouched.
#[derive(Debug, Clone, Default)]
pub struct Carried {
    /// Channels that no peel uses.
    pub channels: Vec<CarriedChannel>,
    /// Header attributes, known and unknown, that still hold for the output.
    #[doc(hidden)]
    pub attributes: Vec<(exr::meta::attribute::Text, exr::meta::attribute::AttributeValue)>,
}

/// A depth-peel stack as it was read.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Stack {
    /// The peels, nearest first, all of the data window's size.
    pub peels: Vec<Peel>,
    /// Data and display window, in the pixels of the planes.
    pub frame: Frame,
    /// How [`Peel::depth`] is to be read.
    pub convention: DepthConvention,
    /// What the fragments stand for.
    pub kind: StackKind,
    /// Samples a picture pixel along each axis: 1, or S for [`StackKind::Supersampled`].
    pub supersample: usize,
    /// Numeric type of the colour channels.
    pub precision: Precision,
    /// How bright colours can be.
    pub color_range: ColorRange,
    /// Camera data found in the header; a layer of settings below the preset.
    pub camera: Values,
    /// Channels and attributes to hand on.
    pub carried: Carried,
    /// The cryptomattes of the picture, objects first.
    pub cryptomattes: Vec<Cryptomatte>,
    /// Their channels where these are not handed on but asked for: see [`ReadOptions::objects`].
    pub mattes: Vec<CarriedChannel>,
    /// What was concluded while reading.
    pub findings: Vec<Finding>,
}

impl Window {
    /// Whether `inner` lies within this window.
    pub fn contains(&self, inner: Self) -> bool {
        // 64 bits hold any sum of an `i32` and a size.
        let end = |start: i32, size: usize| i64::from(start) + size as i64;
        inner.x >= self.x
            && inner.y >= self.y
            && end(inner.x, inner.width) <= end(self.x, self.width)
            && end(inner.y, inner.height) <= end(self.y, self.height)
    }
}

impl fmt::Display for Window {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}×{} at ({}, {})", self.width, self.height, self.x, self.y)
    }
}

impl Frame {
    /// The frame of a picture of `width` × `height` square pixels, without overscan or crop.
    pub fn of_size(width: usize, height: usize) -> Self {
        let window = Window { x: 0, y: 0, width, height };
        Self { data: window, display: window, pixel_aspect: 1.0 }
    }

    /// Place of the data window's first pixel centre, from the centre of the display window, in pixels right and down.
    pub fn data_origin_from_centre(&self) -> [f32; 2] {
        let (data, display) = (self.data, self.display);
        [
            (data.x - display.x) as f32 + 0.5 - 0.5 * display.width as f32,
            (data.y - display.y) as f32 + 0.5 - 0.5 * display.height as f32,
        ]
    }
}

impl Stack {
    /// Width of the planes in samples.
    pub fn width(&self) -> usize {
        self.frame.data.width
    }

    /// Height of the planes in samples.
    pub fn height(&self) -> usize {
        self.frame.data.height
    }
}
