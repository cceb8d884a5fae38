//! Structural similarity, Wang, Bovik, Sheikh & Simoncelli 2004, with their Gaussian window: 11×11, σ = 1.5.
//!
//! The window is separable: it is applied down a band of rows, then along the row. The two variances are needed only as a sum, so
//! four moments are filtered, not five. Cost: 88 multiplications per sample. Memory: one row per thread.

use super::Rgb;
use crate::image::Plane;
use crate::parallel;

/// Half the window's width: 3.5 σ, rounded.
const RADIUS: usize = 5;

/// The window's width.
const WINDOW: usize = 2 * RADIUS + 1;

/// Standard deviation of the window in pixels.
const SIGMA: f64 = 1.5;

/// `(0.01 L)²` for values of 0 … L = 1.
const C1: f64 = 0.01 * 0.01;

/// `(0.03 L)²` for values of 0 … L = 1.
const C2: f64 = 0.03 * 0.03;

/// Filtered means of `t`, `r`, `t² + r²` and `t r`, one row.
type Moments = [Vec<f64>; 4];

/// Mean structural similarity of two pictures of values 0 … 1, over all channels and all pixels whose window lies within
/// the picture; `None` if there is no such pixel.
pub fn ssim(image: &Rgb, reference: &Rgb) -> Option<f64> {
    let (width, height) = (image[0].width(), image[0].height());
    if width < WINDOW || height < WINDOW {
        return None;
    }
    let (columns, rows) = (width - 2 * RADIUS, height - 2 * RADIUS);
    let weights = weights();
    let sum: f64 = image
        .iter()
        .zip(reference)
        .map(|(t, r)| {
            let moments = || [0; 4].map(|_| vec![0.0; width]);
            let sums: Vec<f64> = parallel::map_with(rows, &moments, &|moments, top| {
                down(t, r, top, &weights, moments);
                along(moments, columns, &weights)
            });
            sums.iter().sum::<f64>()
        })
        .sum();
    Some(sum / (columns * rows * image.len()) as f64)
}

/// The window along one axis; sums to 1.
fn weights() -> [f64; WINDOW] {
    let raw: [f64; WINDOW] =
        std::array::from_fn(|i| (-(i as f64 - RADIUS as f64).powi(2) / (2.0 * SIGMA * SIGMA)).exp());
    let sum: f64 = raw.iter().sum();
    raw.map(|weight| weight / sum)
}

/// Filters the rows from `top` on down into `moments`.
fn down(t: &Plane, r: &Plane, top: usize, weights: &[f64; WINDOW], moments: &mut Moments) {
    let [mean_t, mean_r, squares, product] = moments;
    for moment in [&mut *mean_t, &mut *mean_r, &mut *squares, &mut *product] {
        moment.fill(0.0);
    }
    for (i, &weight) in weights.iter().enumerate() {
        let sources = t.row(top + i).iter().zip(r.row(top + i));
        let targets =
            mean_t.iter_mut().zip(mean_r.iter_mut()).zip(squares.iter_mut().zip(product.iter_mut()));
        for ((&t, &r), ((mean_t, mean_r), (squares, product))) in sources.zip(targets) {
            let (t, r) = (f64::from(t), f64::from(r));
            *mean_t += weight * t;
            *mean_r += weight * r;
            *squares += weight * (t * t + r * r);
            *product += weight * (t * r);
        }
    }
}

/// Filters `moments` along the row and sums the similarity of its `columns` windows.
fn along(moments: &Moments, columns: usize, weights: &[f64; WINDOW]) -> f64 {
    (0..columns)
        .map(|x| {
            let [mean_t, mean_r, squares, product] = moments.each_ref().map(|moment| {
                moment[x..x + WINDOW].iter().zip(weights).map(|(value, weight)| value * weight).sum::<f64>()
            });
            let means = mean_t * mean_r;
            let mean_squares = mean_t * mean_t + mean_r * mean_r;
            let luminance = (2.0 * means + C1) / (mean_squares + C1);
            let structure = (2.0 * (product - means) + C2) / (squares - mean_squares + C2);
            luminance * structure
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(value: f32) -> Rgb {
        [0; 3].map(|_| Plane::filled(15, 12, value))
    }

    #[test]
    fn flat_pictures_differ_in_luminance_alone() {
        // Variances are 0: SSIM = (2 a b + C1) / (a² + b² + C1).
        let expected = (2.0 * 0.5 * 0.25 + C1) / (0.25 + 0.0625 + C1);
        assert!((ssim(&flat(0.5), &flat(0.25)).unwrap() - expected).abs() < 1e-12);
    }

    #[test]
    fn similarity_is_symmetric() {
        let wave = |k: usize| [k; 3].map(|k| Plane::from_fn(20, 13, |x, y| ((x * k + y) % 7) as f32 / 7.0));
        let (a, b) = (wave(2), wave(3));
        assert!((ssim(&a, &b).unwrap() - ssim(&b, &a).unwrap()).abs() < 1e-12);
    }

    #[test]
    fn a_picture_smaller_than_the_window_has_no_similarity() {
        let rgb = |width, height| [0; 3].map(|_| Plane::zeros(width, height));
        assert_eq!(ssim(&rgb(10, 50), &rgb(10, 50)), None);
        assert_eq!(ssim(&rgb(50, 10), &rgb(50, 10)), None);
        assert_eq!(ssim(&rgb(11, 11), &rgb(11, 11)), Some(1.0));
    }
}
