//! Lens rays for pictures that no method of the program makes.

use std::f64::consts::TAU;

/// A ray of a pixel: its point of the unit disc, and its place in the pixel from −½ to ½.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ray {
    pub(super) lens: [f64; 2],
    pub(super) place: [f64; 2],
}

/// `count` rays, evenly spread over the round lens and the pixel: Roberts's additive recurrence in four dimensions.
pub(super) fn rays(count: usize) -> Vec<Ray> {
    /// The positive root of x⁵ = x + 1.
    const ROOT: f64 = 1.167_303_978_261_418_7;
    let fraction = |i: usize, power: i32| ((i as f64 + 0.5) * ROOT.powi(-power)).fract();
    let ray = |i| {
        let (radius, angle) = (fraction(i, 1).sqrt(), TAU * fraction(i, 2));
        Ray {
            lens: [radius * angle.cos(), radius * angle.sin()],
            place: [fraction(i, 3) - 0.5, fraction(i, 4) - 0.5],
        }
    };
    (0..count).map(ray).collect()
}

/// Mean over `rays` of `value` at the sample that each meets at the CoC radius `coc_px`, seen from pixel `x, y`; samples past the
/// border are those of the border.
pub(super) fn mean_of_samples(
    rays: &[Ray],
    (x, y): (usize, usize),
    coc_px: f64,
    (width, height): (usize, usize),
    value: impl Fn(usize, usize) -> f64,
) -> f64 {
    let sample = |at: usize, axis: usize, ray: &Ray, size: usize| {
        let met = (at as f64 + coc_px * ray.lens[axis] + ray.place[axis]).round();
        met.clamp(0.0, size as f64 - 1.0) as usize
    };
    rays.iter().map(|ray| value(sample(x, 0, ray, width), sample(y, 1, ray, height))).sum::<f64>()
        / rays.len() as f64
}
