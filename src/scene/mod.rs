//! LOOK and DECIDE: the stack in CoC space, the facts it shows, and the plan that follows from them.

mod plan;

pub use plan::{Effect, EffectKind, Plan};

use crate::image::Plane;
use crate::stack::StackKind;

/// One peel in CoC space.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// Red, green, blue: scene-linear, premultiplied, finite.
    pub color: [Plane; 3],
    /// Coverage or opacity, 0 … 1; 0 where the peel is empty.
    pub alpha: Plane,
    /// Signed CoC radius in picture pixels, negative in front of focus; 0 where the peel is empty.
    pub coc_px: Plane,
}

/// A stack as the methods see it: fragments `(x, y, c)`, no depth, no units.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// The layers, nearest first.
    pub layers: Vec<Layer>,
    /// What the fragments stand for.
    pub kind: StackKind,
    /// Samples a picture pixel along each axis.
    pub supersample: usize,
}
