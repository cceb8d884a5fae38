//! Peak signal-to-noise ratio of display values.

use super::{MSE_FLOOR, Rgb, mean};

/// `−10 · log10(mean (t − r)²)` in dB, for values of 0 … 1; at most 200.
///
/// Both pictures are of one size; see [`super::display`] for how linear ones become display values.
pub fn psnr_db(image: &Rgb, reference: &Rgb) -> f64 {
    -10.0 * mean(image, reference, |t, r| (t - r).powi(2)).max(MSE_FLOOR).log10()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;

    #[test]
    fn an_error_of_a_tenth_everywhere_is_twenty_decibels() {
        let rgb = |value| [0; 3].map(|_| Plane::filled(5, 3, value));
        assert!((psnr_db(&rgb(0.6), &rgb(0.5)) - 20.0).abs() < 1e-5);
    }

    #[test]
    fn one_channel_in_three_wrong_costs_a_third_of_the_error() {
        let mut image = [0; 3].map(|_| Plane::filled(5, 3, 0.5));
        let reference = image.clone();
        image[2] = Plane::filled(5, 3, 0.6);
        assert!((psnr_db(&image, &reference) - (20.0 + 10.0 * 3.0_f64.log10())).abs() < 1e-5);
    }
}
