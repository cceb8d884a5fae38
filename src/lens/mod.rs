//! LENS: the thin lens, signed circles of confusion, the aperture's shape and its sample tables. Pure maths: this module
//! never sees a pixel's colour.

mod aperture;
mod views;

pub use aperture::Aperture;
pub use views::{View, views};

use crate::error::Error;
use crate::settings::SensorDistance;

/// A lens in the units of its settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LensSpec {
    /// Focal length in millimetres.
    pub focal_length_mm: f32,
    /// Focal length over aperture diameter.
    pub f_number: f32,
    /// Planar distance of what is in focus, in depth units.
    pub focus_distance: f32,
    /// Sensor width in millimetres.
    pub sensor_width_mm: f32,
    /// How far behind the lens the sensor stands.
    pub sensor_distance: SensorDistance,
    /// Length of one depth unit in metres.
    pub metres_per_unit: f32,
}

/// The one law from depth to blur: `c(z) = c_inf · (1 − z_f / z)`.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct ThinLens {
    /// CoC radius at infinity in picture pixels, positive.
    pub coc_infinity_px: f32,
    /// Planar distance in focus, in depth units.
    pub focus_distance: f32,
}

impl ThinLens {
    /// The lens of `spec` before a sensor `width_px` pixels wide.
    ///
    /// `c_inf = ½ · f / N · v / z_f · W / s`, with the sensor at `v = f` or `v = f z_f / (z_f − f)`; the second is
    /// `½ · f² / (N (z_f − f)) · W / s`.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Settings`] for a value that is not a positive number, and for a focus distance not beyond
    /// the focal length: such a lens forms no image. Checked here once, so that nothing below can fail.
    pub fn new(spec: &LensSpec, width_px: f32) -> Result<Self, Error> {
        for (name, value, flag) in [
            ("focal length", spec.focal_length_mm, "--focal-length"),
            ("sensor width", spec.sensor_width_mm, "--sensor-width"),
            ("length of a depth unit", spec.metres_per_unit, "metres_per_unit in the preset's [depth]"),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(Error::settings(format!("the {name} must be a positive number"))
                    .with("found", value.to_string())
                    .help(format!("set it with {flag}")));
            }
        }
        if spec.f_number.is_nan() || spec.f_number <= 0.0 {
            return Err(Error::settings("the f-number must be positive")
                .with("found", spec.f_number.to_string())
                .help(
                    "an f-number of 0 would be an infinitely wide lens; for a pinhole use --f-number inf",
                ));
        }
        let focal_length = spec.focal_length_mm * 1e-3 / spec.metres_per_unit;
        let focus = spec.focus_distance;
        if focus.is_nan() || focus <= focal_length {
            return Err(Error::settings(
                "the lens cannot focus this near: the focus distance must exceed the focal length",
            )
            .with("found", format!("focus distance {focus}, focal length {focal_length} (depth units)"))
            .help("raise --focus, lower --focal-length, or check metres_per_unit in the preset's [depth]"));
        }
        let image_distance = match spec.sensor_distance {
            SensorDistance::FocalLength => focal_length,
            // 1/v = 1/f − 1/z_f; for z_f → ∞ both models meet in v = f.
            SensorDistance::ThinLens => 1.0 / (1.0 / focal_length - 1.0 / focus),
        };
        let aperture_radius = 0.5 * focal_length / spec.f_number;
        let pixels_per_unit = width_px / (spec.sensor_width_mm * 1e-3 / spec.metres_per_unit);
        // Focused at infinity c_inf is 0 and the law has the form c = −k / z; a huge finite distance serves the same.
        let focus_distance = focus.min(1e12);
        let coc_infinity_px = aperture_radius * image_distance / focus_distance * pixels_per_unit;
        Ok(Self { coc_infinity_px, focus_distance })
    }

    /// Signed radius of the circle of confusion at planar depth `z`, in picture pixels.
    ///
    /// Negative in front of the focus plane; `z = ∞`, NaN, 0 and below count as background and give
    /// `coc_infinity_px` (METHODS section 1).
    pub fn coc_radius_px(&self, z: f32) -> f32 {
        if z > 0.0 { self.coc_infinity_px * (1.0 - self.focus_distance / z) } else { self.coc_infinity_px }
    }

    /// Planar depth whose CoC radius is `coc_radius_px`; `None` from `coc_infinity_px` on, where there is none.
    pub fn depth_planar(&self, coc_radius_px: f32) -> Option<f32> {
        (coc_radius_px < self.coc_infinity_px)
            .then(|| self.focus_distance / (1.0 - coc_radius_px / self.coc_infinity_px))
    }
}
