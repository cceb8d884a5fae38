//! Depth that is written as a picture: three channels that are equal, or the first alone.

use super::depth::BACKGROUND;
use crate::error::Error;
use crate::image::Plane;

/// By how much channels may differ that are equal but for rounding or a lossy codec, as a share of the largest depth.
const ROUNDING: f32 = 0.02;
/// Share of the pixels that may differ by more, as at the edges of a lossy picture.
const MAX_DIFFERENT: f64 = 0.05;

/// Checks that `depth`, the red channel `name` of a picture, is equal to the `others`, green and blue. A channel of one value everywhere
/// says nothing: some programs fill the red one only.
///
/// # Errors
/// A picture in colours: their shades are no distances.
pub(super) fn check_equal(depth: &Plane, others: &[Plane], name: &str) -> Result<(), Error> {
    let share = others.iter().map(|other| different(depth.values(), other.values())).fold(0.0, f64::max);
    if share <= MAX_DIFFERENT {
        return Ok(());
    }
    let found =
        format!("{name} differs from the green or blue beside it in {:.0} % of the pixels", 100.0 * share);
    Err(Error::input("the depth is a picture in colours")
        .with("found", found)
        .help("write depth as one channel, or name the right one with `depth_channel`"))
}

/// The share of values of `other` that are not those of `depth`; 0 where `other` is one value everywhere.
fn different(depth: &[f32], other: &[f32]) -> f64 {
    let largest =
        depth.iter().copied().filter(|depth| depth.abs() < BACKGROUND).fold(0.0, |a: f32, b| a.max(b.abs()));
    let first = other.first().map_or(0, |value| value.to_bits());
    if depth.len() != other.len() || depth.is_empty() || other.iter().all(|value| value.to_bits() == first) {
        return 0.0;
    }
    let differs = |(a, b): (&f32, &f32)| {
        let (a, b) = (*a, *b);
        let is_near = (a - b).abs() <= ROUNDING * largest;
        a.to_bits() != b.to_bits() && !(a.is_nan() && b.is_nan()) && !is_near
    };
    depth.iter().zip(other).filter(|pair| differs(*pair)).count() as f64 / depth.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(value: impl Fn(usize) -> f32) -> Plane {
        let mut plane = Plane::zeros(100, 1);
        plane.values_mut().iter_mut().enumerate().for_each(|(x, out)| *out = value(x));
        plane
    }

    #[test]
    fn equal_channels_and_empty_ones_are_depth_and_colours_are_not() {
        let depth = plane(|x| x as f32 + 1.0);
        let rounded = plane(|x| (x as f32 + 1.0) * 1.001);
        let colours = plane(|x| 100.0 - x as f32);
        assert!(check_equal(&depth, &[depth.clone(), rounded], "depth.R").is_ok());
        assert!(check_equal(&depth, &[plane(|_| 0.0), plane(|_| 0.0)], "depth.R").is_ok());
        assert!(check_equal(&depth, &[], "Z").is_ok());
        let error =
            check_equal(&depth, &[depth.clone(), colours], "depth.R").expect_err("a heat map").to_string();
        assert!(error.contains("depth.R") && error.contains("`depth_channel`"), "{error}");
    }
}
