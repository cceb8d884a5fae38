//! A lens ray through the samples of a stack.

use glam::{IVec2, Vec2};

/// A ray: at CoC depth `c` it is at sample position `start + c·step`.
#[derive(Debug, Clone, Copy)]
pub(in crate::methods) struct LensRay {
    pub(in crate::methods) start: Vec2,
    pub(in crate::methods) step: Vec2,
    /// `1 / step`; 0 along an axis that the ray is perpendicular to.
    pub(in crate::methods) inverse: Vec2,
    /// CoC depth at which the ray leaves a sample along an axis that it is perpendicular to: infinity; 0 on other axes.
    perpendicular_exit: Vec2,
    /// Direction on each axis: −1 or 1.
    heading: IVec2,
}

impl LensRay {
    /// Below this step a ray crosses no sample boundary within any CoC that occurs.
    pub(in crate::methods) const STEEP: f32 = 1e-7;

    pub(in crate::methods) fn new(start: Vec2, step: Vec2) -> Self {
        let moves = step.abs().cmpgt(Vec2::splat(Self::STEEP));
        Self {
            start,
            step,
            inverse: Vec2::select(moves, step.recip(), Vec2::ZERO),
            perpendicular_exit: Vec2::select(moves, Vec2::ZERO, Vec2::INFINITY),
            heading: IVec2::select(step.cmpgt(Vec2::ZERO), IVec2::ONE, IVec2::NEG_ONE),
        }
    }

    /// The sample at CoC depth `coc`.
    pub(in crate::methods) fn cell(&self, coc: f32) -> IVec2 {
        let position = self.start + coc * self.step;
        // `floor` is a call into the C library on processors before SSE 4.1, which took a tenth of the time.
        let towards_zero = position.as_ivec2();
        towards_zero - IVec2::select(towards_zero.as_vec2().cmpgt(position), IVec2::ONE, IVec2::ZERO)
    }

    /// CoC depth at which the ray leaves the square of `side` samples that begins at `first`, and the direction in which it
    /// leaves.
    #[inline]
    pub(in crate::methods) fn leaves(&self, first: IVec2, side: i32) -> (f32, IVec2) {
        let edge = first + side * self.heading.max(IVec2::ZERO);
        let leave = (edge.as_vec2() - self.start) * self.inverse + self.perpendicular_exit;
        if leave.x <= leave.y {
            (leave.x, IVec2::new(self.heading.x, 0))
        } else {
            (leave.y, IVec2::new(0, self.heading.y))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_leaves_a_square_on_the_side_of_its_direction() {
        let leaves = |x: f32, y: f32, side: i32| {
            LensRay::new(Vec2::splat(0.25), Vec2::new(x, y)).leaves(IVec2::ZERO, side)
        };
        assert_eq!(
            leaves(0.5, 0.0, 1),
            (1.5, IVec2::X),
            "three quarters of a cell at half a cell per unit of c"
        );
        assert_eq!(leaves(0.0, -0.5, 1), (0.5, IVec2::NEG_Y), "a quarter of a cell the other way");
        assert_eq!(leaves(0.5, 0.5, 8), (15.5, IVec2::X), "of eight cells");
        assert_eq!(leaves(0.0, 0.0, 1).0, f32::INFINITY, "never");
    }
}
