//! One peel in CoC space.

use crate::image::Plane;
use crate::stack::LIGHT_ALPHA;

/// Fragments of at least this alpha hide everything behind them.
pub const OPAQUE_ALPHA: f32 = 0.999;

/// Largest number of layers of a scene with translucent fragments that a GPU renders: a ray remembers its last hit in each of them, in
/// memory of fixed size.
pub(crate) const MAX_TRANSLUCENT_LAYERS: usize = 32;

/// One peel in CoC space.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// Red, green, blue: scene-linear, premultiplied, finite.
    pub color: [Plane; 3],
    /// Coverage or opacity, 0 … 1; 0 for an empty sample.
    pub alpha: Plane,
    /// Signed CoC radius in picture pixels, negative in front of focus; finite.
    pub coc_px: Plane,
}

/// What a premultiplied colour is divided by to know how bright a fragment of this `alpha` is, above 0: light that hides nothing is as
/// bright as it is written.
pub(super) fn divisor(alpha: f32) -> f32 {
    if alpha > LIGHT_ALPHA { alpha } else { 1.0 }
}

impl Layer {
    /// Width in samples.
    pub fn width(&self) -> usize {
        self.alpha.width()
    }

    /// Height in samples.
    pub fn height(&self) -> usize {
        self.alpha.height()
    }

    /// Colour of column `x` of row `y`.
    pub fn color_at(&self, x: usize, y: usize) -> [f32; 3] {
        self.color.each_ref().map(|plane| plane.get(x, y))
    }

    /// Unpremultiplied colour of column `x` of row `y`; black without a fragment.
    pub(super) fn unpremultiplied_at(&self, x: usize, y: usize) -> [f32; 3] {
        let alpha = self.alpha.get(x, y);
        self.color_at(x, y).map(|value| if alpha > 0.0 { value / divisor(alpha) } else { 0.0 })
    }
}
