//! Lens samples.

use super::Aperture;
use glam::Vec2;

/// One lens sample: a point on the aperture and a place within the pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Point on the aperture, in units of its radius.
    pub lens: Vec2,
    /// Offset from the pixel centre, −½ … ½.
    pub jitter: Vec2,
}

/// `count` views of `aperture`.
pub fn views(count: usize, aperture: Aperture) -> Vec<View> {
    let _ = (count, aperture);
    Vec::new()
}
