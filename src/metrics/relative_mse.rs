//! Squared error of linear values relative to the reference, so that dark and bright regions have equal weight.

use super::{Rgb, mean};

/// Added to the squared reference, so that black pixels do not divide by 0.
const EPSILON: f64 = 0.01;

/// The mean of `(t − r)² / (r² + 0.01)`.
pub fn relative_mse(image: &Rgb, reference: &Rgb) -> f64 {
    mean(image, reference, |t, r| (t - r).powi(2) / (r * r + EPSILON))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;

    #[test]
    fn the_error_is_relative_to_the_reference() {
        let rgb = |value| [0; 3].map(|_| Plane::filled(4, 4, value));
        // (11 − 10)² / (100 + 0.01), and (0.1 − 0)² / 0.01.
        assert!((relative_mse(&rgb(11.0), &rgb(10.0)) - 1.0 / 100.01).abs() < 1e-9);
        assert!((relative_mse(&rgb(0.1), &rgb(0.0)) - 1.0).abs() < 1e-6);
    }
}
