//! LENS: the thin lens, signed circles of confusion, the aperture's shape and its sample tables. Pure maths: this module
//! does not use the colours of pixels.

mod aperture;
mod field;
mod pull;
mod image;
mod optics;
mod radial;
mod barrel;
mod sharpness;
mod views;

pub(crate) use aperture::Outline;
pub use aperture::{Aperture, aperture_radius};
pub(crate) use barrel::{BarrelShares, Falloff};
pub use field::Field;
pub use glam::Vec2;
pub use image::ApertureImage;
pub use optics::{Optics, Rays};
pub(crate) use pull::Pull;
pub(crate) use radial::{Landing, Radial};
pub use sharpness::{SHARP_COC_PX, Sharpness};
pub(crate) use views::ROW_SETS;
pub use views::{View, views};

use crate::error::Error;
use crate::settings::{Focus, SensorDistance, Values};

/// A lens in the units of its settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LensSpec {
    /// Focal length in millimetres.
    pub focal_length_mm: f32,
    /// Focal length over aperture diameter.
    pub f_number: f32,
    /// Planar distance in focus, in depth units.
    pub focus_distance: f32,
    /// Sensor width in millimetres.
    pub sensor_width_mm: f32,
    /// Distance of the sensor behind the lens.
    pub sensor_distance: SensorDistance,
    /// Length of one depth unit in metres.
    pub metres_per_unit: f32,
}

/// The law from depth to blur, `c(z) = c_inf · (1 − z_f / z)`.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct ThinLens {
    /// CoC radius at infinity in picture pixels, positive.
    pub coc_infinity_px: f32,
    /// Planar distance in focus, in depth units.
    pub focus_distance: f32,
    /// How open the lens is: the CoC radius at infinity, or where focus lies beyond a hundred focal lengths that of a point at a hundred,
    /// in picture pixels, positive.
    pub opening_px: f32,
}

/// Distance at which [`ThinLens::opening_px`] is taken where focus lies farther, in focal lengths.
const OPENING_FOCAL_LENGTHS: f64 = 100.0;

/// Smallest and largest focal length in sensor widths: all but flat fields of view, and telescopes.
const FOCAL_LENGTHS: [f32; 2] = [1e-3, 1e6];

impl LensSpec {
    /// Refuses a focal length that is out of proportion to the sensor.
    fn check_angle(&self) -> Result<(), Error> {
        let sensor_widths = self.focal_length_mm / self.sensor_width_mm;
        let [shortest, longest] = FOCAL_LENGTHS;
        if (shortest..=longest).contains(&sensor_widths) {
            return Ok(());
        }
        Err(Error::settings(format!(
            "the focal length must be from {shortest} to {longest} times the width of the sensor"
        ))
        .with("found", format!("{} mm and {} mm", self.focal_length_mm, self.sensor_width_mm))
        .help("correct `focal_length_mm` or `sensor_width_mm`"))
    }

    /// The spec as a layer of settings.
    fn values(&self) -> Values {
        Values {
            focal_length_mm: Some(self.focal_length_mm),
            f_number: Some(self.f_number),
            focus: Some(Focus::Distance(self.focus_distance)),
            sensor_width_mm: Some(self.sensor_width_mm),
            metres_per_unit: Some(self.metres_per_unit),
            ..Values::default()
        }
    }
}

impl ThinLens {
    /// The lens of `spec` with a sensor `width_px` pixels wide.
    ///
    /// `c_inf = ½ · f / N · v / z_f · W / s`, with the sensor at `v = f` or `v = f z_f / (z_f − f)`; the second is
    /// `½ · f² / (N (z_f − f)) · W / s`.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Settings`] for a value out of its range, for a focal length that no lens for the sensor has, for a
    /// focus distance not beyond the focal length, where a lens forms no image, and for a blur too large to be a number.
    pub fn new(spec: &LensSpec, width_px: f32) -> Result<Self, Error> {
        spec.values().check()?;
        spec.check_angle()?;
        // Products of the ends of the settings' ranges fit into 64 bits.
        let focal_length = f64::from(spec.focal_length_mm) * 1e-3 / f64::from(spec.metres_per_unit);
        let focus = f64::from(spec.focus_distance);
        if spec.focus_distance <= focal_length as f32 {
            return Err(Error::settings(
                "the lens cannot focus this near: the focus distance must exceed the focal length",
            )
            .with("found", format!("focus distance {focus}, focal length {focal_length} (depth units)"))
            .help("raise `focus_distance`, lower `focal_length_mm`, or check `metres_per_unit`"));
        }
        let image_distance = match spec.sensor_distance {
            SensorDistance::FocalLength => focal_length,
            // 1/v = 1/f − 1/z_f; for z_f → ∞ both models meet in v = f.
            SensorDistance::ThinLens => 1.0 / (1.0 / focal_length - 1.0 / focus),
        };
        let aperture_radius = 0.5 * focal_length / f64::from(spec.f_number);
        let sensor_width = f64::from(spec.sensor_width_mm) * 1e-3 / f64::from(spec.metres_per_unit);
        // Focused at infinity, c_inf is 0 and the law is c = −k / z; a large finite focus distance gives the same radii.
        let focus_distance = focus.min(1e12);
        let pixels_per_unit = f64::from(width_px) / sensor_width;
        let coc_infinity_px = (aperture_radius * image_distance / focus_distance * pixels_per_unit) as f32;
        if !coc_infinity_px.is_finite() {
            return Err(Error::settings(
                "the lens blurs too much: the CoC radius at infinity is not a finite number",
            )
            .with("found", format!("`f_number = {}`, focus distance {focus}", spec.f_number))
            .help("raise `f_number` or `focus_distance`, or lower `focal_length_mm`"));
        }
        let near_focus = (focus_distance / (OPENING_FOCAL_LENGTHS * focal_length)).max(1.0) as f32;
        Ok(Self {
            coc_infinity_px,
            focus_distance: focus_distance as f32,
            opening_px: coc_infinity_px * near_focus,
        })
    }

    /// Signed radius of the circle of confusion at planar depth `z`, in picture pixels.
    ///
    /// Negative in front of the focus plane; `z = ∞`, NaN, 0 and below count as background and give
    /// `coc_infinity_px`.
    pub fn coc_radius_px(&self, z: f32) -> f32 {
        if z > 0.0 {
            // The ratio is infinite for the smallest depths, and no blur at all times that would be NaN.
            self.coc_infinity_px * (1.0 - (self.focus_distance / z).min(f32::MAX))
        } else {
            self.coc_infinity_px
        }
    }

    /// Planar depth whose CoC radius is `coc_radius_px`; `None` from `coc_infinity_px` on, which no depth has.
    pub fn depth_planar(&self, coc_radius_px: f32) -> Option<f32> {
        (coc_radius_px < self.coc_infinity_px)
            .then(|| self.focus_distance / (1.0 - coc_radius_px / self.coc_infinity_px))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH_PX: f32 = 640.0;

    fn spec(sensor_distance: SensorDistance) -> LensSpec {
        LensSpec {
            focal_length_mm: 100.0,
            f_number: 2.8,
            focus_distance: 0.4,
            sensor_width_mm: 36.0,
            sensor_distance,
            metres_per_unit: 1.0,
        }
    }

    fn lens(sensor_distance: SensorDistance) -> ThinLens {
        ThinLens::new(&spec(sensor_distance), WIDTH_PX).unwrap()
    }

    #[test]
    fn with_the_sensor_at_the_focal_length_blur_is_that_of_renderers() {
        // Diameter (W f / s) (f / N) |z − z_f| / (z z_f), lengths in metres: Blender's and Mitsuba's.
        for z in [0.3f32, 0.39, 0.5, 3.0] {
            let diameter = WIDTH_PX * 0.1 / 0.036 * (0.1 / 2.8) * (z - 0.4) / (z * 0.4);
            let radius = lens(SensorDistance::FocalLength).coc_radius_px(z);
            assert!((2.0 * radius / diameter - 1.0).abs() < 1e-5, "z = {z}: {radius}, diameter {diameter}");
        }
    }

    #[test]
    fn a_real_camera_blurs_more_by_its_bellows_factor() {
        // The image of an object at z_f lies at v = f z_f / (z_f − f) = 4/3 f.
        let [renderer, camera] = [SensorDistance::FocalLength, SensorDistance::ThinLens].map(lens);
        let factor = camera.coc_infinity_px / renderer.coc_infinity_px;
        assert!((factor - 4.0 / 3.0).abs() < 1e-5, "{factor}");
        // And equals ½ f² / (N (z_f − f)) · W / s.
        let expected = 0.5 * 0.01 / (2.8 * 0.3) * WIDTH_PX / 0.036;
        assert!((camera.coc_infinity_px / expected - 1.0).abs() < 1e-5, "{} px", camera.coc_infinity_px);
    }

    #[test]
    fn the_radius_is_zero_in_focus_negative_in_front_and_rises_with_depth() {
        let lens = lens(SensorDistance::FocalLength);
        assert_eq!(lens.coc_radius_px(lens.focus_distance), 0.0, "in focus");
        let radii: Vec<f32> = (1..2000).map(|i| lens.coc_radius_px(i as f32 * 0.01)).collect();
        assert!(radii.windows(2).all(|pair| pair[0] < pair[1]), "rising");
        assert!(radii[0] < 0.0, "negative in front");
        for background in [f32::INFINITY, f32::NAN, 0.0, -1.0] {
            assert_eq!(
                lens.coc_radius_px(background),
                lens.coc_infinity_px,
                "depth {background} is background"
            );
        }
    }

    #[test]
    fn depth_follows_from_blur_up_to_infinity() {
        let lens = lens(SensorDistance::ThinLens);
        for z in [0.05, 0.3, 0.4, 0.41, 2.0, 50.0] {
            let back = lens.depth_planar(lens.coc_radius_px(z)).unwrap();
            assert!((back / z - 1.0).abs() < 1e-3, "depth {z} became {back}");
        }
        assert_eq!(lens.depth_planar(lens.coc_infinity_px), None, "nothing is farther than infinity");
    }

    #[test]
    fn a_lens_focused_at_infinity_blurs_by_the_inverse_of_depth() {
        let spec = LensSpec { focus_distance: f32::INFINITY, ..spec(SensorDistance::FocalLength) };
        let lens = ThinLens::new(&spec, WIDTH_PX).unwrap();
        // c = −½ (f / N) f (W / s) / z
        let expected = -0.5 * (0.1 / 2.8) * 0.1 * WIDTH_PX / 0.036 / 7.0;
        assert!((lens.coc_radius_px(7.0) / expected - 1.0).abs() < 1e-3, "{}", lens.coc_radius_px(7.0));
    }

    #[test]
    fn units_cancel() {
        let centimetres =
            LensSpec { focus_distance: 40.0, metres_per_unit: 0.01, ..spec(SensorDistance::ThinLens) };
        let lens_cm = ThinLens::new(&centimetres, WIDTH_PX).unwrap();
        let off = lens_cm.coc_radius_px(120.0) / lens(SensorDistance::ThinLens).coc_radius_px(1.2) - 1.0;
        assert!(off.abs() < 1e-5, "off by {off}");
    }

    #[test]
    fn a_lens_at_the_ends_of_numbers_has_finite_radii_or_is_refused() {
        let base = spec(SensorDistance::FocalLength);
        let refused = ThinLens::new(&LensSpec { f_number: 1e-40, ..base }, WIDTH_PX).unwrap_err().to_string();
        assert!(refused.contains("raise `f_number`"), "{refused}");
        for spec in [
            LensSpec { metres_per_unit: 1e38, ..base },
            LensSpec { f_number: f32::INFINITY, ..base },
            LensSpec { focus_distance: f32::MAX, ..base },
        ] {
            let lens = ThinLens::new(&spec, WIDTH_PX).unwrap();
            for z in [1e-45, 1.0, f32::MAX, f32::INFINITY] {
                assert!(!lens.coc_radius_px(z).is_nan(), "{spec:?} at {z}");
            }
        }
    }

    #[test]
    fn impossible_lenses_are_refused() {
        let base = spec(SensorDistance::FocalLength);
        for (spec, word) in [
            (LensSpec { f_number: 0.0, ..base }, "`f_number` must be a positive number"),
            (LensSpec { f_number: f32::NAN, ..base }, "`f_number`"),
            (LensSpec { focus_distance: 0.1, ..base }, "focus"),
            (LensSpec { focus_distance: f32::NAN, ..base }, "focus"),
            (LensSpec { focal_length_mm: -1.0, ..base }, "`focal_length_mm`"),
            (LensSpec { sensor_width_mm: 0.0, ..base }, "`sensor_width_mm`"),
            (LensSpec { sensor_width_mm: 1e-6, ..base }, "times the width of the sensor"),
            (LensSpec { focal_length_mm: 1e-3, ..base }, "times the width of the sensor"),
            (LensSpec { metres_per_unit: f32::INFINITY, ..base }, "`metres_per_unit`"),
        ] {
            let error = ThinLens::new(&spec, WIDTH_PX).unwrap_err().to_string();
            assert!(error.contains(word), "{error}, about {word}");
        }
    }
}
