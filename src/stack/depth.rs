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
