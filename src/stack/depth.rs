//! Depth conventions, and what each of them says in planar depth.

use crate::settings::DepthConvention;

/// What converting a depth needs beside the convention.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthScale {
    /// How the depth is written.
    pub convention: DepthConvention,
    /// Depth units that the renderer leaves out in front of its first count ([`DepthConvention::Ray`]).
    pub near_clip: f32,
    /// Planar depth of 0 and of 1 ([`DepthConvention::Normalised`]).
    pub near_far: [f32; 2],
    /// Distance of the sensor in samples, `focal length / sensor width · display width` ([`DepthConvention::Ray`]).
    pub focal_px: f32,
}

impl DepthScale {
    /// Temporary.
    pub fn planar(&self, value: f32, x: f32, y: f32) -> f32 {
        let mut row = [value];
        self.planar_row(&mut row, y, x);
        row[0]
    }
    /// Temporary.
    pub fn planar_row(&self, depth: &mut [f32], y: f32, x0: f32) {
        for (i, d) in depth.iter_mut().enumerate() {
            let x = x0 + i as f32;
            let v = *d;
            *d = if !(v > 0.0 && v < 1e9) { f32::INFINITY } else if self.convention == DepthConvention::Ray {
                v * self.focal_px / (self.focal_px * self.focal_px + x * x + y * y).sqrt() + self.near_clip
            } else { v };
        }
    }
}
