//! The depths that a lens sees, and how much it blurs them: whether a setting is in another unit than the stack shows here.
//!
//! Cost: one read of alpha and depth.

use crate::lens::ThinLens;
use crate::stack::Stack;
use crate::stack::depth::DepthScale;
use rayon::prelude::*;

/// The depths of a stack's fragments, and the blur that a lens makes of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct DepthInUse {
    /// Planar depth of the nearest and of the farthest surface in depth units; the first is above the second where there is none.
    pub(crate) range: [f32; 2],
    /// Smallest and largest CoC radius of surfaces and background, without sign, in picture pixels.
    pub(crate) coc_px: [f32; 2],
    /// Number of fragments.
    pub(crate) fragments: u64,
    /// Number of those whose CoC radius is above a quarter of the frame's width.
    pub(crate) wide: u64,
    /// Width of the frame in picture pixels.
    pub(crate) width_px: f32,
}

impl DepthInUse {
    /// Share of the frame's width from which on a CoC radius counts as wide.
    const WIDE: f32 = 0.25;

    /// Those of `stack` with `lens`; `scale` has its depth units.
    pub(crate) fn of(stack: &Stack, lens: &ThinLens, scale: &DepthScale) -> Self {
        let nothing = Self::nothing(stack.frame.display.width as f32 / stack.supersample as f32);
        let [x0, y0] = stack.frame.data_origin_from_centre();
        let of_row = |peel: usize, y: usize| {
            let (peel, mut row) = (&stack.peels[peel], nothing);
            let mut depths = peel.depth.row(y).to_vec();
            scale.planar_row(&mut depths, y0 + y as f32, x0);
            let fragments = peel.alpha.row(y).iter().zip(depths).filter(|(alpha, _)| **alpha > 0.0);
            fragments.for_each(|(_, depth)| row.add(depth, lens));
            row
        };
        let of_peel = |peel: usize| {
            let rows = (0..stack.height()).into_par_iter();
            rows.map(|y| of_row(peel, y)).reduce(|| nothing, Self::joined)
        };
        (0..stack.peels.len()).map(of_peel).fold(nothing, Self::joined)
    }

    fn nothing(width_px: f32) -> Self {
        let none = [f32::INFINITY, f32::NEG_INFINITY];
        Self { range: none, coc_px: none, fragments: 0, wide: 0, width_px }
    }

    #[inline]
    fn add(&mut self, depth: f32, lens: &ThinLens) {
        let coc_px = lens.coc_radius_px(depth).abs();
        self.fragments += 1;
        self.wide += u64::from(coc_px > Self::WIDE * self.width_px);
        let wider = |[low, high]: [f32; 2], value: f32| [low.min(value), high.max(value)];
        self.coc_px = wider(self.coc_px, coc_px);
        if depth.is_finite() {
            self.range = wider(self.range, depth);
        }
    }

    /// Those of two parts of a frame together: ends and counts do not depend on the order.
    pub(crate) fn joined(self, other: Self) -> Self {
        let joined = |[a, b]: [f32; 2], [c, d]: [f32; 2]| [a.min(c), b.max(d)];
        Self {
            range: joined(self.range, other.range),
            coc_px: joined(self.coc_px, other.coc_px),
            fragments: self.fragments + other.fragments,
            wide: self.wide + other.wide,
            width_px: self.width_px,
        }
    }
}
