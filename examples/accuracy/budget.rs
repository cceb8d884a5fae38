//! The squared error of a picture, divided among classes of pixels.

use crate::causes::Cause;
use thinlens::image::Image;
use thinlens::metrics::displayed;

/// What is found of the pixels of one class.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Part {
    /// Share of the picture's pixels.
    pub(crate) pixels: f64,
    /// Share of the picture's squared error.
    pub(crate) error: f64,
    /// PSNR of these pixels alone, of sRGB-encoded, clipped values.
    pub(crate) psnr_db: f64,
}

/// The squared error of a picture by cause: number of pixels and sum over pixels and colours of squared differences of display values.
#[derive(Debug)]
pub(crate) struct Budget([(usize, f64); Cause::ALL.len()]);

impl Budget {
    /// The error of `image` against `reference`, of one size, by the cause of each pixel.
    pub(crate) fn new(image: &Image, reference: &Image, cause_at: impl Fn(usize, usize) -> Cause) -> Self {
        let mut sums = [(0, 0.0); Cause::ALL.len()];
        for y in 0..image.height() {
            for x in 0..image.width() {
                let (found, expected) = (image.pixel(x, y), reference.pixel(x, y));
                let difference = |c: usize| f64::from(displayed(found[c]) - displayed(expected[c]));
                let (pixels, error) = &mut sums[cause_at(x, y) as usize];
                *pixels += 1;
                *error += (0..3).map(|c| difference(c).powi(2)).sum::<f64>();
            }
        }
        Self(sums)
    }

    /// The part of `cause`; `None` if no pixel belongs to it.
    pub(crate) fn part(&self, cause: Cause) -> Option<Part> {
        let (pixels, error) = self.0[cause as usize];
        let whole = self.0.iter().fold((0, 0.0), |sum, part| (sum.0 + part.0, sum.1 + part.1));
        (pixels > 0).then(|| Part {
            pixels: pixels as f64 / whole.0 as f64,
            error: if whole.1 > 0.0 { error / whole.1 } else { 0.0 },
            psnr_db: -10.0 * (error / (3 * pixels) as f64).max(1e-20).log10(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_of_the_whole_picture_and_decibels_of_the_part() {
        // A tenth of display value in every fourth pixel, three tenths in another fourth: errors of 1 to 9.
        let reference = Image::transparent(4, 5);
        let error_of = |x: usize| [0.0, 0.1, 0.3, 0.0][x];
        let image = Image::from_fn(4, 5, |x, _| [thinlens::image::srgb_decode(error_of(x)); 4]);
        let cause = |x: usize, _: usize| match x {
            1 => Cause::Lights,
            2 => Cause::NearEdges,
            _ => Cause::Smooth,
        };
        let budget = Budget::new(&image, &reference, cause);
        let expected = [(Cause::Lights, 0.25, 0.1, 20.0), (Cause::NearEdges, 0.25, 0.9, 10.457_575)];
        for (cause, pixels, error, psnr_db) in expected {
            let part = budget.part(cause).unwrap();
            assert!((part.pixels - pixels).abs() < 1e-9, "{part:?}");
            assert!((part.error - error).abs() < 1e-5, "{part:?}");
            assert!((part.psnr_db - psnr_db).abs() < 1e-4, "{part:?}");
        }
        assert!(budget.part(Cause::Smooth).is_some_and(|part| part.pixels == 0.5 && part.error == 0.0));
        assert_eq!(budget.part(Cause::OffScreen), None);
    }
}
