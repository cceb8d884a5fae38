//! PNG: 8-bit sRGB previews for viewing. Pipelines read the EXR.

use super::{Made, atomic};
use crate::error::Error;
use crate::image::{Image, Plane, srgb_encode};
use crate::parallel;
use png::{BitDepth, ColorType, Compression, EncodingError, Filter};
use std::path::Path;

/// Width of the strip between pictures side by side, in pixels.
const GAP_PX: usize = 8;

/// Grey of that strip, as an 8-bit value.
const GAP_GREY: u8 = 32;

/// An opaque picture with 8 bits per value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Rgb8 {
    /// Width in pixels.
    pub(crate) width: usize,
    /// Height in pixels.
    pub(crate) height: usize,
    /// Red, green and blue of each pixel, row by row.
    pub(crate) bytes: Vec<u8>,
}

/// Keyword and text of a text chunk.
type Chunk = (&'static str, String);

/// 8-bit pixels to encode.
struct Pixels {
    width: usize,
    height: usize,
    color: ColorType,
    bytes: Vec<u8>,
}

/// Writes `image` with an exposure of `exposure_stops` as sRGB to the file `path` (`-`: standard output).
///
/// Values are clipped to 0 … 1; NaN is black. An opaque picture is written as RGB, any other as RGBA with the colour
/// divided by alpha, because PNG has straight alpha; colour where alpha is 0 is lost.
///
/// # Errors
/// As [`atomic::write()`].
pub fn write(path: &Path, image: &Image, exposure_stops: f32) -> Result<(), Error> {
    write_with_texts(path, image, exposure_stops, &[])
}

/// As [`write()`], with text chunks that say how the picture was made ([`Made::texts`]).
///
/// # Errors
/// As [`atomic::write()`].
pub fn write_made(path: &Path, image: &Image, exposure_stops: f32, made: &Made) -> Result<(), Error> {
    write_with_texts(path, image, exposure_stops, &made.texts())
}

fn write_with_texts(path: &Path, image: &Image, exposure_stops: f32, texts: &[Chunk]) -> Result<(), Error> {
    let gain = exposure_stops.exp2();
    let opaque = image.planes[3].values().iter().all(|&alpha| to_8_bit(alpha) == u8::MAX);
    let (color, channels) = if opaque { (ColorType::Rgb, 3) } else { (ColorType::Rgba, 4) };
    let mut bytes = vec![0; image.width() * image.height() * channels];
    parallel::for_each_row(&mut bytes, image.width() * channels, &|y, row| {
        for (x, out) in row.chunks_exact_mut(channels).enumerate() {
            let [r, g, b, alpha] = image.pixel(x, y);
            let straight = if opaque || alpha <= 0.0 { gain } else { gain / alpha.min(1.0) };
            let pixel = [encode(r * straight), encode(g * straight), encode(b * straight), to_8_bit(alpha)];
            out.copy_from_slice(&pixel[..channels]);
        }
    });
    let pixels = Pixels { width: image.width(), height: image.height(), color, bytes };
    write_chunks(path, &pixels, texts)
}

/// Writes `images` from left to right, over black, aligned at the top, with a narrow grey strip between them.
///
/// # Errors
/// As [`atomic::write()`], and for no picture.
pub fn write_side_by_side(path: &Path, images: &[&Image], exposure_stops: f32) -> Result<(), Error> {
    let gain = exposure_stops.exp2();
    let height = images.iter().map(|image| image.height()).max().unwrap_or(0);
    let width = images.iter().map(|image| image.width() + GAP_PX).sum::<usize>().saturating_sub(GAP_PX);
    let mut bytes = vec![GAP_GREY; width * height * 3];
    parallel::for_each_row(&mut bytes, width * 3, &|y, row| {
        let mut left = 0;
        for image in images.iter() {
            if y < image.height() {
                for x in 0..image.width() {
                    let [r, g, b, _] = image.pixel(x, y);
                    let at = (left + x) * 3;
                    row[at..at + 3].copy_from_slice(&[r, g, b].map(|value| encode(value * gain)));
                }
            }
            left += image.width() + GAP_PX;
        }
    });
    write_pixels(path, &Pixels { width, height, color: ColorType::Rgb, bytes })
}

/// Writes `plane`, 0 … 1, in false colour: from black for 0 through purple and orange to pale yellow for 1
/// (matplotlib's magma, which is perceptually uniform).
///
/// # Errors
/// As [`atomic::write()`].
#[cfg(feature = "cli")]
pub fn write_false_color(path: &Path, plane: &Plane) -> Result<(), Error> {
    let (width, height) = (plane.width(), plane.height());
    write_pixels(path, &Pixels { width, height, color: ColorType::Rgb, bytes: false_color(plane) })
}

/// Writes `plane`, 0 … 1, as a grey mask: 8 bits per value, linear, not sRGB.
///
/// # Errors
/// As [`atomic::write()`].
pub fn write_mask(path: &Path, plane: &Plane) -> Result<(), Error> {
    let (width, height) = (plane.width(), plane.height());
    let bytes = plane.values().iter().copied().map(to_8_bit).collect();
    write_pixels(path, &Pixels { width, height, color: ColorType::Grayscale, bytes })
}

/// Writes `picture` unchanged.
///
/// # Errors
/// As [`atomic::write()`], and for a picture without pixels.
pub(super) fn write_rgb(path: &Path, picture: Rgb8) -> Result<(), Error> {
    let Rgb8 { width, height, bytes } = picture;
    write_pixels(path, &Pixels { width, height, color: ColorType::Rgb, bytes })
}

/// The colours of [`write_false_color`]: 8-bit red, green and blue of each pixel, row by row.
#[cfg(feature = "cli")]
pub(crate) fn false_color(plane: &Plane) -> Vec<u8> {
    let mut bytes = vec![0; plane.width() * plane.height() * 3];
    parallel::for_each_row(&mut bytes, plane.width() * 3, &|y, row| {
        for (pixel, value) in row.chunks_exact_mut(3).zip(plane.row(y)) {
            pixel.copy_from_slice(&colorous::MAGMA.eval_continuous(f64::from(*value)).as_array());
        }
    });
    bytes
}

fn write_pixels(path: &Path, pixels: &Pixels) -> Result<(), Error> {
    write_chunks(path, pixels, &[])
}

fn write_chunks(path: &Path, pixels: &Pixels, texts: &[Chunk]) -> Result<(), Error> {
    let side = |length: usize| {
        u32::try_from(length).ok().filter(|&length| length > 0).ok_or_else(|| {
            Error::unsupported("PNG cannot hold a picture of this size")
                .in_file(path)
                .with("size", format!("{}×{}", pixels.width, pixels.height))
        })
    };
    let size = (side(pixels.width)?, side(pixels.height)?);
    atomic::write(path, |target| {
        encode_chunks(target, size, pixels, texts).map_err(|error| match error {
            EncodingError::IoError(error) => atomic::failed(path, error),
            other => {
                Error::unsupported("the picture cannot be written as PNG").in_file(path).caused_by(other)
            }
        })
    })
}

/// Writes the chunks of a picture of this width and height, texts before pixels.
fn encode_chunks(
    target: &mut dyn atomic::Target,
    (width, height): (u32, u32),
    pixels: &Pixels,
    texts: &[Chunk],
) -> Result<(), EncodingError> {
    let mut encoder = png::Encoder::new(target, width, height);
    encoder.set_color(pixels.color);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(Compression::Fast);
    encoder.set_filter(Filter::Adaptive);
    for (keyword, text) in texts.iter().map(|(keyword, text)| ((*keyword).to_owned(), text.clone())) {
        // A tEXt chunk is ASCII here, because programs decode other bytes of it differently; an iTXt chunk is UTF-8.
        if text.is_ascii() {
            encoder.add_text_chunk(keyword, text)?;
        } else {
            encoder.add_itxt_chunk(keyword, text)?;
        }
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&pixels.bytes)?;
    writer.finish()
}

/// Encodes a linear value as 8-bit sRGB.
fn encode(linear: f32) -> u8 {
    to_8_bit(srgb_encode(linear))
}

/// 0 … 1 to 0 … 255, rounded and clipped; NaN is 0.
fn to_8_bit(value: f32) -> u8 {
    (value * 255.0).round() as u8
}
