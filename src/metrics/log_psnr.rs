//! Peak signal-to-noise ratio of logarithmic values. It includes differences that clipping to display values hides, above all in
//! highlights.

use super::{MSE_FLOOR, Rgb, mean};

/// `10 · log10(p² / mean (log2(1 + t) − log2(1 + r))²)` in dB, with the peak `p` the largest `log2(1 + r)`.
///
/// Negative values count as 0. A black reference has no peak, and the result is −∞.
pub fn log_psnr_db(image: &Rgb, reference: &Rgb) -> f64 {
    let log = |value: f64| value.max(0.0).ln_1p() / std::f64::consts::LN_2;
    let brightest = reference.iter().flat_map(|plane| plane.values()).fold(0.0_f32, |a, &b| a.max(b));
    let mse = mean(image, reference, |t, r| (log(t) - log(r)).powi(2)).max(MSE_FLOOR);
    10.0 * (log(f64::from(brightest)).powi(2) / mse).log10()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;

    #[test]
    fn a_stop_too_bright_at_a_peak_of_four_stops_is_twelve_decibels() {
        // log2(1 + 15) = 4, log2(1 + 31) = 5: p² / mse = 16.
        let rgb = |value| [0; 3].map(|_| Plane::filled(4, 4, value));
        assert!((log_psnr_db(&rgb(31.0), &rgb(15.0)) - 10.0 * 16.0_f64.log10()).abs() < 1e-9);
    }
}
