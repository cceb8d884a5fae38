//! Metrics of the difference between two pictures.
//!
//! All figures are of red, green and blue together; alpha is not compared. NaN counts as 0 in both pictures, so that a
//! single NaN counts as a black pixel and does not make the whole figure NaN.

mod flip;
mod log_psnr;
mod psnr;
mod relative_mse;
mod ssim;

pub use flip::{flip, hdr_flip};
pub use log_psnr::log_psnr_db;
pub use psnr::psnr_db;
pub use relative_mse::relative_mse;
pub use ssim::ssim;

use crate::error::Error;
use crate::image::{Image, Plane, srgb_encode};
use crate::parallel;

/// Lower bound of mean squared errors: equal pictures have 200 dB instead of an infinite value.
const MSE_FLOOR: f64 = 1e-20;

/// A border is reduced until this many pixels remain on either side of the centre.
const KEPT_BY_BORDER_PX: usize = 32;

/// Three planes: red, green, blue.
pub type Rgb = [Plane; 3];

/// All figures of one comparison.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct Score {
    /// [`psnr_db`] of sRGB values clipped to 0 … 1; 200 for equal pictures.
    pub psnr_db: f64,
    /// [`ssim()`] of sRGB values clipped to 0 … 1; `None` for a picture smaller than its window.
    pub ssim: Option<f64>,
    /// Mean of [`flip()`] of linear values clipped to 0 … 1.
    pub flip: f64,
    /// [`relative_mse()`] of linear values.
    pub relative_mse: f64,
    /// [`log_psnr_db`] of linear values.
    pub log_psnr_db: f64,
}

/// Two pictures that can be compared.
#[derive(Debug, Clone, PartialEq)]
pub struct Pair {
    image: Rgb,
    reference: Rgb,
}

impl Pair {
    /// `image` and `reference`, leaving out `border_px` pixels on every side.
    ///
    /// A border that would leave less than 64 pixels of the shorter side is reduced so that 64 remain; a smaller picture
    /// is compared whole.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Input`] for pictures that differ in size or have no pixels.
    pub fn new(image: &Image, reference: &Image, border_px: usize) -> Result<Self, Error> {
        check_size((image.width(), image.height()), reference)?;
        let room = (image.width().min(image.height()) / 2).saturating_sub(KEPT_BY_BORDER_PX);
        let border = border_px.min(room);
        Ok(Self { image: crop(image, border), reference: crop(reference, border) })
    }

    /// All figures except for [`Pair::hdr_flip`].
    pub fn score(&self) -> Score {
        let (shown, shown_reference) = (display(&self.image), display(&self.reference));
        Score {
            psnr_db: psnr_db(&shown, &shown_reference),
            ssim: ssim(&shown, &shown_reference),
            flip: mean_of(&self.flip_map()),
            relative_mse: relative_mse(&self.image, &self.reference),
            log_psnr_db: log_psnr_db(&self.image, &self.reference),
        }
    }

    /// [`flip()`] at each pixel.
    pub fn flip_map(&self) -> Plane {
        flip(&self.image, &self.reference)
    }

    /// The mean of [`hdr_flip()`], which takes about as long as twelve other metrics.
    pub fn hdr_flip(&self) -> f64 {
        mean_of(&hdr_flip(&self.image, &self.reference))
    }
}

/// Checks that a picture of width and height `size` can be compared with `reference`.
///
/// # Errors
/// [`crate::error::ErrorKind::Input`] for sizes that differ, or without pixels.
pub fn check_size(size: (usize, usize), reference: &Image) -> Result<(), Error> {
    let text = |(width, height): (usize, usize)| format!("{width}×{height}");
    let reference_size = (reference.width(), reference.height());
    if size != reference_size {
        return Err(Error::input("the pictures differ in size")
            .with("image", text(size))
            .with("reference", text(reference_size))
            .help("compare renders of one resolution; with display windows of one size, what both show is compared"));
    }
    if size.0 * size.1 == 0 {
        return Err(Error::input("the pictures have no pixels").with("size", text(size)));
    }
    Ok(())
}

/// [`Pair::score`] of `image` against `reference`.
///
/// # Errors
/// Those of [`Pair::new`].
pub fn score(image: &Image, reference: &Image, border_px: usize) -> Result<Score, Error> {
    Ok(Pair::new(image, reference, border_px)?.score())
}

fn mean_of(plane: &Plane) -> f64 {
    plane.values().iter().map(|&value| f64::from(value)).sum::<f64>() / plane.values().len() as f64
}

/// The colour of `image` without `border` pixels on every side, and without NaN.
fn crop(image: &Image, border: usize) -> Rgb {
    let (width, height) = (image.width() - 2 * border, image.height() - 2 * border);
    [0, 1, 2].map(|channel| {
        let plane = &image.planes[channel];
        Plane::from_fn(width, height, |x, y| {
            let value = plane.get(x + border, y + border);
            if value.is_nan() { 0.0 } else { value }
        })
    })
}

/// Linear values as shown on a display: clipped to 0 … 1 and sRGB-encoded.
pub fn display(linear: &Rgb) -> Rgb {
    linear.each_ref().map(|plane| {
        let mut shown = plane.clone();
        parallel::for_each_block(shown.values_mut(), &|_, values| {
            values.iter_mut().for_each(|value| *value = displayed(*value));
        });
        shown
    })
}

/// A linear value as shown on a display: clipped to 0 … 1 and sRGB-encoded.
pub fn displayed(linear: f32) -> f32 {
    srgb_encode(linear.clamp(0.0, 1.0))
}

/// The mean of `error(value, reference value)` over all samples, summed in double precision, row by row in a fixed order.
fn mean(image: &Rgb, reference: &Rgb, error: impl Fn(f64, f64) -> f64 + Sync) -> f64 {
    let mut sum = 0.0;
    let mut count = 0;
    for (plane, reference) in image.iter().zip(reference) {
        let rows: Vec<f64> = parallel::map(plane.height(), &|y| {
            let pairs = plane.row(y).iter().zip(reference.row(y));
            pairs.map(|(&value, &reference)| error(f64::from(value), f64::from(reference))).sum()
        });
        sum += rows.iter().sum::<f64>();
        count += plane.values().len();
    }
    sum / count as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(value: f32) -> Image {
        Image::from_fn(100, 90, |_, _| [value, value, value, 1.0])
    }

    #[test]
    fn equal_pictures_have_no_error() {
        let score = score(&grey(0.3), &grey(0.3), 0).unwrap();
        assert_eq!(score.psnr_db, 200.0);
        assert_eq!(score.relative_mse, 0.0);
        assert_eq!(score.flip, 0.0);
        assert!((score.ssim.unwrap() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn pictures_of_two_sizes_are_refused_with_both_sizes() {
        let text = score(&grey(0.0), &Image::transparent(3, 4), 0).unwrap_err().to_string();
        assert!(text.contains("100×90") && text.contains("3×4"), "{text}");
        assert!(score(&Image::transparent(0, 0), &Image::transparent(0, 0), 0).is_err());
    }

    #[test]
    fn pixels_in_the_border_are_not_compared() {
        let mut image = grey(0.5);
        image.planes[0].set(4, 40, 9.0);
        assert_eq!(score(&image, &grey(0.5), 5).unwrap().psnr_db, 200.0);
        assert!(score(&image, &grey(0.5), 4).unwrap().psnr_db < 100.0);
    }

    #[test]
    fn a_border_is_limited_so_that_the_centre_remains() {
        // The border of 100×90 pixels is at most 90 / 2 − 32 = 13 pixels.
        let mut image = grey(0.5);
        image.planes[0].set(13, 13, 9.0);
        assert!(score(&image, &grey(0.5), 1000).unwrap().psnr_db < 100.0);
        assert_eq!(score(&Image::transparent(8, 8), &Image::transparent(8, 8), 3).unwrap().psnr_db, 200.0);
    }

    #[test]
    fn a_nan_counts_as_black() {
        let (mut broken, mut black) = (grey(0.5), grey(0.5));
        broken.planes[1].set(7, 7, f32::NAN);
        black.planes[1].set(7, 7, 0.0);
        assert_eq!(score(&broken, &grey(0.5), 0).unwrap(), score(&black, &grey(0.5), 0).unwrap());
    }
}
