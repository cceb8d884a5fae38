//! Pictures as data URIs, for self-contained pages.

pub(crate) use super::png::Rgb8;

use crate::error::Error;
use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, ImageResult};

/// JPEG quality from 1 to 100, without visible loss.
const JPEG_QUALITY: u8 = 90;

/// `picture` as PNG, with the strongest compression.
///
/// # Errors
/// A picture without pixels, or of a size that PNG cannot hold.
pub(crate) fn png(picture: &Rgb8) -> Result<String, Error> {
    let mut file = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut file, CompressionType::Best, FilterType::Adaptive);
    encode(encoder, picture)?;
    Ok(uri("png", &file))
}

/// `picture` as JPEG.
///
/// # Errors
/// A picture without pixels, or wider or higher than 65535.
pub(crate) fn jpeg(picture: &Rgb8) -> Result<String, Error> {
    let mut file = Vec::new();
    encode(JpegEncoder::new_with_quality(&mut file, JPEG_QUALITY), picture)?;
    Ok(uri("jpeg", &file))
}

/// `picture` as PNG or JPEG, whichever is smaller.
///
/// # Errors
/// Those of [`png()`] and [`jpeg`].
pub(crate) fn smaller(picture: &Rgb8) -> Result<String, Error> {
    let [png, jpeg] = [png(picture)?, jpeg(picture)?];
    Ok(if png.len() < jpeg.len() { png } else { jpeg })
}

fn encode(encoder: impl ImageEncoder, picture: &Rgb8) -> Result<(), Error> {
    let side = |length: usize| u32::try_from(length).unwrap_or(u32::MAX);
    let (width, height) = (side(picture.width), side(picture.height));
    let written: ImageResult<()> =
        encoder.write_image(&picture.bytes, width, height, ExtendedColorType::Rgb8);
    written.map_err(|cause| {
        Error::output("a picture cannot be encoded for the page")
            .with("size", format!("{width}×{height}"))
            .caused_by(cause)
    })
}

fn uri(format: &str, file: &[u8]) -> String {
    format!("data:image/{format};base64,{}", BASE64_STANDARD.encode(file))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decoded(uri: &str) -> image::RgbImage {
        let (_, text) = uri.split_once(";base64,").unwrap();
        image::load_from_memory(&BASE64_STANDARD.decode(text).unwrap()).unwrap().to_rgb8()
    }

    fn noise() -> Rgb8 {
        let mut rng = fastrand::Rng::with_seed(1);
        Rgb8 { width: 16, height: 8, bytes: std::iter::repeat_with(|| rng.u8(..)).take(16 * 8 * 3).collect() }
    }

    #[test]
    fn a_png_has_the_picture_bit_for_bit() {
        let uri = png(&noise()).unwrap();
        assert!(uri.starts_with("data:image/png;base64,"), "{uri}");
        assert_eq!(decoded(&uri).into_raw(), noise().bytes);
    }

    #[test]
    fn a_jpeg_is_close_to_the_picture() {
        let grey = Rgb8 { width: 9, height: 5, bytes: vec![100; 9 * 5 * 3] };
        let image = decoded(&jpeg(&grey).unwrap());
        assert_eq!(image.dimensions(), (9, 5));
        assert!(image.into_raw().iter().all(|value| value.abs_diff(100) <= 2));
    }

    #[test]
    fn the_smaller_of_png_and_jpeg_is_chosen() {
        let flat = Rgb8 { width: 64, height: 64, bytes: vec![0; 64 * 64 * 3] };
        assert!(smaller(&flat).unwrap().starts_with("data:image/png"));
        let soft = (0..128 * 128 * 3).map(|i| noise().bytes[i / 3 % 97] / 4 + 90).collect();
        let soft = Rgb8 { width: 128, height: 128, bytes: soft };
        assert_eq!(smaller(&soft).unwrap().len(), png(&soft).unwrap().len().min(jpeg(&soft).unwrap().len()));
    }

    #[test]
    fn a_picture_without_pixels_is_refused() {
        assert!(png(&Rgb8 { width: 0, height: 0, bytes: Vec::new() }).is_err());
    }
}
