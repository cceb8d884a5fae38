//! The depth of field: the range of depths whose blur is within an accepted CoC radius, in closed form.
//!
//! With the lens's law `c(z) = c_inf (1 − z_f / z)` and an accepted CoC radius `t`, `c = ∓t` at
//! `z = z_f c_inf / (c_inf ± t)`. Everything follows from one product, `P = ½ · f / N · f · W / s` in pixels times depth units, because
//! `c_inf = P / (z_f − o)` in both models of the sensor: `o` is 0 for a sensor at the focal length and `f` for one at the image
//! distance. A lens focused at the hyperfocal distance `P / t + o` is sharp from half of that to infinity (`c_inf = t`).

use super::LensSpec;
use crate::settings::SensorDistance;

/// CoC radius in picture pixels up to which a point counts as sharp: a smaller disc hardly exceeds its own pixel.
pub const SHARP_COC_PX: f32 = 1.0;

/// The depth of field of a lens, in depth units.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct Sharpness {
    /// CoC radius that counts as sharp, in picture pixels.
    pub coc_radius_px: f32,
    /// The nearest focus distance at which infinity is sharp; 0, or the focal length, for a pinhole.
    pub hyperfocal_distance: f32,
    /// Smallest planar depth that is sharp.
    pub near_limit: f32,
    /// Largest planar depth that is sharp; infinite for focus distances from the hyperfocal distance on, `null` in JSON.
    pub far_limit: f32,
}

impl LensSpec {
    /// The range of depths that this lens, with a sensor `width_px` pixels wide, blurs to a CoC radius of at most `coc_radius_px`.
    ///
    /// Valid for all values that [`super::ThinLens::new`] accepts, including a focus at infinity and an infinite f-number.
    pub fn sharpness(&self, width_px: f32, coc_radius_px: f32) -> Sharpness {
        let unit_mm = f64::from(self.metres_per_unit) * 1e3;
        let focal_length = f64::from(self.focal_length_mm) / unit_mm;
        let sensor_width = f64::from(self.sensor_width_mm) / unit_mm;
        let aperture_radius = 0.5 * focal_length / f64::from(self.f_number);
        let product = aperture_radius * focal_length * f64::from(width_px) / sensor_width;
        let offset = match self.sensor_distance {
            SensorDistance::FocalLength => 0.0,
            SensorDistance::ThinLens => focal_length,
        };
        let accepted = f64::from(coc_radius_px);
        let hyperfocal = product / accepted + offset;
        let focus = f64::from(self.focus_distance);
        // z_f c_inf / (c_inf ± t), with numerator and denominator divided by the focus distance, which may be infinite.
        let blur = product / accepted;
        let relative = 1.0 - offset / focus;
        let near = blur / (blur / focus + relative);
        let far = if focus < hyperfocal { blur / (blur / focus - relative) } else { f64::INFINITY };
        Sharpness {
            coc_radius_px,
            hyperfocal_distance: hyperfocal as f32,
            near_limit: near as f32,
            far_limit: far as f32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::ThinLens;

    const WIDTH_PX: f32 = 640.0;
    const SENSORS: [SensorDistance; 2] = [SensorDistance::FocalLength, SensorDistance::ThinLens];

    fn spec(sensor_distance: SensorDistance, focus_distance: f32) -> LensSpec {
        LensSpec {
            focal_length_mm: 50.0,
            f_number: 2.0,
            focus_distance,
            sensor_width_mm: 36.0,
            sensor_distance,
            metres_per_unit: 1.0,
        }
    }

    fn near(found: f32, expected: f32, what: &str) {
        assert!((found / expected - 1.0).abs() < 1e-4, "{what}: {found}, expected {expected}");
    }

    #[test]
    fn the_hyperfocal_distance_matches_the_textbook_formula() {
        // f² / (N · 2t · s / W), plus one focal length for a real camera: 0.0025 / (2 · 2 · 5.625e-5) = 11.11 m.
        let expected = 0.05 * 0.05 / (2.0 * 2.0 * 0.036 / WIDTH_PX);
        for (sensor, more) in SENSORS.into_iter().zip([0.0, 0.05]) {
            let found = spec(sensor, 3.0).sharpness(WIDTH_PX, 1.0).hyperfocal_distance;
            near(found, expected + more, "hyperfocal distance");
        }
    }

    #[test]
    fn focused_at_the_hyperfocal_distance_the_lens_is_sharp_from_half_of_it_to_infinity() {
        for sensor in SENSORS {
            let hyperfocal = spec(sensor, 3.0).sharpness(WIDTH_PX, 1.0).hyperfocal_distance;
            let there = spec(sensor, hyperfocal).sharpness(WIDTH_PX, 1.0);
            near(there.near_limit, 0.5 * hyperfocal, "near limit");
            assert!(there.far_limit > 1e5 * hyperfocal, "far limit {}", there.far_limit);
            let beyond = spec(sensor, 1.5 * hyperfocal).sharpness(WIDTH_PX, 1.0);
            assert_eq!(beyond.far_limit, f32::INFINITY, "infinity stays sharp");
            // c_inf = t (H − o) / (1.5 H − o): 1.5 H / (1 + (1.5 H − o) / (H − o)), of which o is 0.5 %.
            assert!(beyond.near_limit > 0.599 * hyperfocal, "but the near limit moves away");
        }
    }

    #[test]
    fn at_the_limits_the_radius_is_the_accepted_one() {
        for sensor in SENSORS {
            for accepted in [0.5, 1.0, 4.0] {
                let spec = spec(sensor, 2.0);
                let lens = ThinLens::new(&spec, WIDTH_PX).unwrap();
                let Sharpness { near_limit, far_limit, .. } = spec.sharpness(WIDTH_PX, accepted);
                near(-lens.coc_radius_px(near_limit), accepted, "CoC radius at the near limit");
                near(lens.coc_radius_px(far_limit), accepted, "CoC radius at the far limit");
            }
        }
    }

    #[test]
    fn focused_at_infinity_the_lens_is_sharp_from_the_hyperfocal_distance_on() {
        let found = spec(SensorDistance::FocalLength, f32::INFINITY).sharpness(WIDTH_PX, 1.0);
        near(found.near_limit, found.hyperfocal_distance, "near limit");
        assert_eq!(found.far_limit, f32::INFINITY);
    }

    #[test]
    fn a_pinhole_is_sharp_everywhere() {
        let pinhole = LensSpec { f_number: f32::INFINITY, ..spec(SensorDistance::ThinLens, 3.0) };
        let found = pinhole.sharpness(WIDTH_PX, 1.0);
        assert_eq!((found.near_limit, found.far_limit), (0.0, f32::INFINITY));
    }

    #[test]
    fn limits_are_in_the_units_of_depth() {
        let metres = spec(SensorDistance::ThinLens, 2.0).sharpness(WIDTH_PX, 1.0);
        let spec = LensSpec { metres_per_unit: 0.01, ..spec(SensorDistance::ThinLens, 200.0) };
        let centimetres = spec.sharpness(WIDTH_PX, 1.0);
        near(centimetres.near_limit, 100.0 * metres.near_limit, "near limit");
        near(centimetres.far_limit, 100.0 * metres.far_limit, "far limit");
        near(centimetres.hyperfocal_distance, 100.0 * metres.hyperfocal_distance, "hyperfocal distance");
    }
}
