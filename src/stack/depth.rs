//! Depth conventions and their conversion to planar depth.
//!
//! | convention | planar depth of a value `v` | background |
//! | --- | --- | --- |
//! | planar | `v` | `v >= 1e9` (Blender writes 1e10), `v <= 0`, infinite, NaN |
//! | ray | `v · F / √(F² + x² + y²) + near_clip` | as planar: Mitsuba writes 0 |
//! | inverse | `1 / v` | `v < 1e-9`, infinite, NaN |
//! | normalised | `near + min(v, 1) · (far − near)`: values above 1 are the far plane | `v < 0`, infinite, NaN |
//!
//! A planar depth that is not in front of the lens (`z <= 0`) is background as well.

use crate::settings::DepthConvention;
use std::ops::Range;

/// Depths from this value on are background: the ray hit nothing.
pub const BACKGROUND: f32 = 1e9;

/// Added to a normalised depth, so that 0 has neighbours at a finite ratio: a ten-thousandth of the depth range.
pub(super) const NORMALISED_OFFSET: f32 = 1e-4;

/// The parameters of the conversion to planar depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthScale {
    /// The convention of the input depth.
    pub convention: DepthConvention,
    /// Distance of the near clipping plane, which ray depth is measured from ([`DepthConvention::Ray`]).
    pub near_clip: f32,
    /// Planar depth of 0 and of 1 ([`DepthConvention::Normalised`]).
    pub near_far: [f32; 2],
    /// Distance of the sensor in samples: `focal length / sensor width · display width` ([`DepthConvention::Ray`]).
    pub focal_px: f32,
}

/// The range of values that are not background in `convention`. NaN is in no range and therefore background.
pub(super) fn foreground(convention: DepthConvention) -> Range<f32> {
    /// The smallest positive number: a range that starts here excludes 0.
    const ABOVE_ZERO: f32 = f32::from_bits(1);
    match convention {
        DepthConvention::Planar | DepthConvention::Ray => ABOVE_ZERO..BACKGROUND,
        DepthConvention::Inverse => 1.0 / BACKGROUND..f32::INFINITY,
        DepthConvention::Normalised => 0.0..f32::INFINITY,
    }
}

/// Whether `value` is background in `convention`.
pub fn is_background(convention: DepthConvention, value: f32) -> bool {
    !foreground(convention).contains(&value)
}

/// Turns depths of a convention into numbers that grow with the distance, without the parameters of the conversion. For comparisons.
#[derive(Debug, Clone)]
pub(super) struct FarDepth {
    foreground: Range<f32>,
    is_inverse: bool,
    /// Added to every depth: see [`NORMALISED_OFFSET`].
    offset: f32,
}

impl FarDepth {
    pub(super) fn new(convention: DepthConvention) -> Self {
        let offset = if convention == DepthConvention::Normalised { NORMALISED_OFFSET } else { 0.0 };
        let is_inverse = convention == DepthConvention::Inverse;
        Self { foreground: foreground(convention), is_inverse, offset }
    }

    /// A number that grows with the distance of `value`; `+∞` for background.
    #[inline]
    pub(super) fn of(&self, value: f32) -> f32 {
        self.known(value, if self.is_inverse { value.recip() } else { value + self.offset })
    }

    /// The number `number` of `value`, or that of background.
    #[inline(always)]
    fn known(&self, value: f32, number: f32) -> f32 {
        let Range { start, end } = self.foreground;
        if (value >= start) & (value < end) { number } else { f32::INFINITY }
    }

    /// Fills `far` with the numbers of a row of `values`.
    pub(super) fn fill_row(&self, values: &[f32], far: &mut [f32]) {
        let row = far.iter_mut().zip(values);
        // A copy, and one loop for each without branches inside, so that both are vectorized.
        let copy = self.clone();
        if self.is_inverse {
            row.for_each(|(far, &value)| *far = copy.known(value, value.recip()));
        } else {
            row.for_each(|(far, &value)| *far = copy.known(value, value + copy.offset));
        }
    }
}

impl DepthScale {
    /// Planar depth of `value` at `x`, `y` samples from the optical axis; `+∞` for background (module head).
    pub fn planar(&self, value: f32, x_from_centre_px: f32, y_from_centre_px: f32) -> f32 {
        if is_background(self.convention, value) {
            return f32::INFINITY;
        }
        let z = match self.convention {
            DepthConvention::Planar => value,
            DepthConvention::Ray => {
                self.planar_of_ray(value, x_from_centre_px, y_from_centre_px * y_from_centre_px)
            }
            DepthConvention::Inverse => 1.0 / value,
            DepthConvention::Normalised => self.planar_of_normalised(value),
        };
        in_front(z)
    }

    /// [`DepthScale::planar`] of a row of samples, in place. The first sample is at `x0_from_centre` from the optical axis.
    pub fn planar_row(&self, depth: &mut [f32], y_from_centre: f32, x0_from_centre: f32) {
        // One loop per convention without branches inside, so that each is vectorized.
        let foreground = foreground(self.convention);
        let known =
            |value: f32, z: f32| if foreground.contains(&value) { in_front(z) } else { f32::INFINITY };
        match self.convention {
            DepthConvention::Planar => depth.iter_mut().for_each(|value| *value = known(*value, *value)),
            DepthConvention::Inverse => {
                depth.iter_mut().for_each(|value| *value = known(*value, 1.0 / *value));
            }
            DepthConvention::Normalised => {
                depth.iter_mut().for_each(|value| *value = known(*value, self.planar_of_normalised(*value)));
            }
            DepthConvention::Ray => {
                let y_squared = y_from_centre * y_from_centre;
                for (i, value) in depth.iter_mut().enumerate() {
                    // Conversion from i32 to f32 is vectorized, from usize it is not.
                    let x = x0_from_centre + i as i32 as f32;
                    *value = known(*value, self.planar_of_ray(*value, x, y_squared));
                }
            }
        }
    }

    fn planar_of_ray(&self, distance: f32, x: f32, y_squared: f32) -> f32 {
        let focal = self.focal_px;
        distance * (focal / (focal * focal + x * x + y_squared).sqrt()) + self.near_clip
    }

    fn planar_of_normalised(&self, value: f32) -> f32 {
        let [near, far] = self.near_far;
        near + value.min(1.0) * (far - near)
    }
}

/// `z` if it is in front of the lens, else `+∞`.
fn in_front(z: f32) -> f32 {
    if z > 0.0 { z } else { f32::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [DepthConvention; 4] = [
        DepthConvention::Planar,
        DepthConvention::Ray,
        DepthConvention::Inverse,
        DepthConvention::Normalised,
    ];

    fn scale(convention: DepthConvention) -> DepthScale {
        DepthScale { convention, near_clip: 0.5, near_far: [2.0, 12.0], focal_px: 30.0 }
    }

    #[test]
    fn a_row_has_the_numbers_of_its_values_one_by_one() {
        let values =
            [f32::NAN, -1.0, -0.0, 0.0, 1e-40, 1e-9, 0.5, 1.0, 7.0, BACKGROUND, f32::MAX, f32::INFINITY];
        for convention in ALL {
            let far = FarDepth::new(convention);
            let mut row = [f32::NAN; 12];
            far.fill_row(&values, &mut row);
            assert_eq!(row, values.map(|value| far.of(value)), "{convention:?}");
            let background = values.map(|value| is_background(convention, value));
            assert_eq!(row.map(|number| number == f32::INFINITY), background, "{convention:?}");
        }
    }

    #[test]
    fn ray_depth_is_multiplied_by_the_cosine_and_starts_at_the_near_clip() {
        // x = 40, F = 30: the ray is 50 long, cosθ = 3/5. 10 · 3/5 + 0.5 = 6.5.
        assert_eq!(scale(DepthConvention::Ray).planar(10.0, 40.0, 0.0), 6.5);
        assert_eq!(scale(DepthConvention::Ray).planar(10.0, 0.0, 0.0), 10.5);
    }

    #[test]
    fn inverse_and_normalised_depth_become_planar() {
        assert_eq!(scale(DepthConvention::Inverse).planar(0.25, 0.0, 0.0), 4.0);
        assert_eq!(scale(DepthConvention::Normalised).planar(0.5, 0.0, 0.0), 7.0);
        assert_eq!(scale(DepthConvention::Normalised).planar(0.0, 0.0, 0.0), 2.0);
    }

    #[test]
    fn normalised_depth_above_one_is_the_far_plane() {
        assert_eq!(scale(DepthConvention::Normalised).planar(1.0, 0.0, 0.0), 12.0);
        assert_eq!(scale(DepthConvention::Normalised).planar(3.0, 0.0, 0.0), 12.0);
    }

    #[test]
    fn every_encoding_of_background_is_infinitely_far() {
        for convention in ALL {
            for value in [f32::INFINITY, f32::NAN, f32::NEG_INFINITY, -1.0] {
                assert_eq!(
                    scale(convention).planar(value, 1.0, 2.0),
                    f32::INFINITY,
                    "{convention:?} {value}"
                );
            }
        }
        for convention in [DepthConvention::Planar, DepthConvention::Ray, DepthConvention::Inverse] {
            assert_eq!(scale(convention).planar(0.0, 1.0, 2.0), f32::INFINITY, "{convention:?} 0");
        }
        for convention in [DepthConvention::Planar, DepthConvention::Ray] {
            assert_eq!(scale(convention).planar(1e10, 1.0, 2.0), f32::INFINITY, "{convention:?} 1e10");
        }
    }

    #[test]
    fn a_row_is_converted_as_its_single_values() {
        let values = [0.3, 7.0, 0.0, f32::NAN, 1e10, -2.0, 1.0, 2e-10, 55.5];
        for convention in ALL {
            let mut row = values;
            scale(convention).planar_row(&mut row, 3.5, -4.5);
            for (i, value) in values.into_iter().enumerate() {
                assert_eq!(
                    row[i],
                    scale(convention).planar(value, -4.5 + i as f32, 3.5),
                    "{convention:?} {value}"
                );
            }
        }
    }
}
