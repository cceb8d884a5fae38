//! READ: files in, a [`Stack`] out.
//!
//! This module has all file formats and naming conventions of the input, and nothing about lenses: depth stays in the convention of
//! the file ([`Stack::convention`]). Every conclusion that a file does not state is reported as a [`Finding`].

mod agreement;
mod alpha;
mod antialiasing;
mod attributes;
mod background_share;
mod beauty;
mod camera;
mod camera_used;
mod carried;
mod channel_groups;
mod chroma;
mod chunks;
mod completeness;
mod convention;
mod cryptomatte;
mod decode;
mod deep;
#[doc(hidden)]
pub mod depth;
mod depth_specks;
mod depth_steps;
mod depth_values;
mod elements;
mod depth_names;
mod depth_picture;
mod environment;
mod evidence;
mod filtered_depth;
mod frame_number;
mod footprint;
mod framed;
mod guard;
mod header;
mod holdout;
mod held;
mod input;
mod join;
mod kind;
mod layers;
mod light;
mod merge_files;
mod merged_peels;
mod murmur;
mod names;
mod no_peel;
mod options;
mod order;
mod picture;
mod planes;
mod plausible;
mod position;
mod read;
mod renderers;
mod rim_depth;
mod sanitise;
mod shading;
mod silhouettes;
mod tiff_alpha;
mod windows;
mod views;
mod writer;
mod source;

pub use antialiasing::Antialiasing;
#[doc(hidden)]
pub use camera::camera_attributes;
pub(crate) use camera_used::correct_camera;
pub use completeness::is_complete;
#[cfg(feature = "cli")]
pub(crate) use cryptomatte::listed;
pub use cryptomatte::{Cryptomatte, ObjectMatte, Objects};
pub use environment::read_environment;
pub use footprint::{Footprint, footprint};
pub(crate) use frame_number::{Numbered, frame_number, frame_numbers};
pub use framed::{CheckedPicture, FramedImage};
pub(crate) use header::header_text;
pub use held::{Held, STDIN, is_read_once};
pub use light::LIGHT_ALPHA;
pub use options::{Carry, ReadOptions};
pub use read::{read, read_checked, read_framed, read_framed_picture, read_picture};
pub use shading::Shading;
pub use source::Source;
pub use views::{ALL_VIEWS, views};

use crate::finding::Finding;
use crate::image::Plane;
pub use crate::settings::{AlphaMode, StackKind};
use crate::settings::{DepthConvention, Values};
use std::fmt;

/// One depth-peel layer: the n-th hit of the ray through each pixel centre.
#[derive(Debug, Clone, PartialEq)]
pub struct Peel {
    /// Red, green, blue: scene-linear, premultiplied by `alpha`.
    pub color: [Plane; 3],
    /// Coverage or opacity, 0 … 1. Where it is 0 the peel is empty.
    pub alpha: Plane,
    /// Depth in the convention and units of the file.
    pub depth: Plane,
}

/// A rectangle of pixels. Its top left corner `x`, `y` may be negative.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
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

/// Data and display window: the planes of a stack cover the data window, the sensor covers the display window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// The window of the stored pixels: larger than the display window with overscan, smaller for a crop.
    pub data: Window,
    /// The frame of the picture, as wide as the sensor.
    pub display: Window,
    /// Width of a pixel divided by its height.
    pub pixel_aspect: f32,
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

/// Range of the colours of an input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum ColorRange {
    /// Scene-linear floats, without a maximum.
    Unbounded,
    /// Integers of a display-referred picture: values above white are clipped.
    UpToWhite,
}

/// A channel that is neither colour nor depth of a peel, to be written unchanged beside the picture.
#[derive(Debug, Clone)]
pub struct CarriedChannel {
    /// Full name, dotted prefix included.
    pub name: String,
    /// Samples of the data window, in the type of the file.
    #[doc(hidden)]
    pub samples: exr::image::FlatSamples,
    /// Whether the samples are perceptually linear (an EXR channel flag).
    pub quantize_linearly: bool,
}

/// Data copied unchanged from input to output.
#[derive(Debug, Clone, Default)]
pub struct Carried {
    /// Channels that no peel uses.
    pub channels: Vec<CarriedChannel>,
    /// Header attributes, known and unknown, that are valid for the output.
    #[doc(hidden)]
    pub attributes: Vec<(exr::meta::attribute::Text, exr::meta::attribute::AttributeValue)>,
}

/// A depth-peel stack as read from its files.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Stack {
    /// The peels, nearest first, all of the data window's size.
    pub peels: Vec<Peel>,
    /// Data and display window, in the pixels of the planes.
    pub frame: Frame,
    /// The convention of [`Peel::depth`].
    pub convention: DepthConvention,
    /// Whether the file has normalised depth with 1 near and 0 far, as settings with `near` above `far` say: it was turned around.
    pub near_is_one: bool,
    /// What all fragments represent, if a setting or the header says so, or the number of peels or of samples per pixel does;
    /// `None` where each place of the picture is decided by itself.
    pub kind: Option<StackKind>,
    /// Which colours are point samples and which are averages over the pixel.
    pub antialiasing: Antialiasing,
    /// Samples per picture pixel along each axis: 1, or more for [`StackKind::Supersampled`].
    pub supersample: usize,
    /// What the fragments of each peel show of their alpha: all of it, or nothing of a holdout's. Empty without a holdout.
    pub shown: Vec<Plane>,
    /// What the surfaces of each peel reflect, where the file says so. Empty if it does for no peel.
    pub shading: Vec<Option<Shading>>,
    /// Numeric type of the colour channels.
    pub precision: Precision,
    /// Range of the colours.
    pub color_range: ColorRange,
    /// Camera data of the header: settings that the preset overrides.
    pub camera: Values,
    /// Channels and attributes to copy to the output.
    pub carried: Carried,
    /// The cryptomattes of the picture, objects first.
    pub cryptomattes: Vec<Cryptomatte>,
    /// Channels of cryptomattes that are requested but not copied to the output: see [`ReadOptions::objects`].
    pub mattes: Vec<CarriedChannel>,
    /// Conclusions and warnings of reading.
    pub findings: Vec<Finding>,
}

impl Window {
    /// Whether `inner` is within this window.
    pub fn contains(&self, inner: Self) -> bool {
        // The sum of an `i32` and a size fits into 64 bits.
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
    pub fn from_size(width: usize, height: usize) -> Self {
        let window = Window { x: 0, y: 0, width, height };
        Self { data: window, display: window, pixel_aspect: 1.0 }
    }

    /// Width of a pixel divided by its height; 1 within a thousandth of it, and where the ratio is not one that a picture has, from 1/8 to
    /// 8.
    pub fn usable_pixel_aspect(&self) -> f32 {
        let aspect = self.pixel_aspect;
        if (0.125..=8.0).contains(&aspect) && (aspect - 1.0).abs() >= 1e-3 { aspect } else { 1.0 }
    }

    /// This frame, in samples, in picture pixels of `supersample` samples along each axis.
    fn in_pixels(&self, supersample: usize) -> Self {
        let step = i32::try_from(supersample).unwrap_or(i32::MAX).max(1);
        let window = |window: Window| Window {
            x: window.x.div_euclid(step),
            y: window.y.div_euclid(step),
            width: window.width / supersample.max(1),
            height: window.height / supersample.max(1),
        };
        Self { data: window(self.data), display: window(self.display), pixel_aspect: self.pixel_aspect }
    }

    /// Position on the sensor of row `row` of the data window, down from the centre of the display window, in widths of a pixel.
    pub fn row_from_centre(&self, row: f32) -> f32 {
        (self.data_origin_from_centre()[1] + row) / self.usable_pixel_aspect()
    }

    /// Position of the data window's first pixel centre relative to the centre of the display window, in pixels right and down.
    pub fn data_origin_from_centre(&self) -> [f32; 2] {
        let (data, display) = (self.data, self.display);
        [
            (data.x - display.x) as f32 + 0.5 - 0.5 * display.width as f32,
            (data.y - display.y) as f32 + 0.5 - 0.5 * display.height as f32,
        ]
    }
}

impl Stack {
    /// Whether Blender wrote the file, which says nothing of its camera.
    pub(crate) fn is_by_blender(&self) -> bool {
        writer::Writer::Blender.wrote(&self.carried.attributes)
    }

    /// From the axes of the camera (x right, y up, z to the viewer) to those of the world, by rows, if the header says how the camera stands.
    pub fn world_from_camera(&self) -> Option<[[f32; 3]; 3]> {
        position::world_from_camera(&self.carried.attributes)
    }

    /// What the fragments represent, in words: the kind that applies everywhere, or the shares of the picture.
    pub fn kind_in_words(&self) -> String {
        self.kind.map_or_else(|| self.antialiasing.in_words(), |kind| kind.name().to_owned())
    }

    /// Data and display window of the picture, in picture pixels.
    pub fn picture_frame(&self) -> Frame {
        self.frame.in_pixels(self.supersample)
    }

    /// Width of the planes in samples.
    pub fn width(&self) -> usize {
        self.frame.data.width
    }

    /// Height of the planes in samples.
    pub fn height(&self) -> usize {
        self.frame.data.height
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_supersampled_frame_shrinks_to_picture_pixels() {
        let data = Window { x: -4, y: 2, width: 24, height: 12 };
        let display = Window { x: 0, y: 0, width: 16, height: 16 };
        let frame = Frame { data, display, pixel_aspect: 1.0 }.in_pixels(2);
        assert_eq!(frame.data, Window { x: -2, y: 1, width: 12, height: 6 });
        assert_eq!(frame.display, Window { x: 0, y: 0, width: 8, height: 8 });
    }
}
