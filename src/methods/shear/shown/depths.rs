//! The CoC radii of layers, by blocks.

use super::grid::{BLOCK, Grid, Place};
use crate::methods::shear::bins::Bins;
use crate::parallel;
use crate::scene::Layer;
use crate::scene::surface::{JOIN_PX, MAX_JOIN_PX};
use pulp::{Arch, NullaryFnOnce};

/// The CoC radii of a layer's fragments, by blocks.
pub(super) struct Depths {
    pub(super) grid: Grid,
    /// The least and the largest in a block, in pixels; infinite where it has no fragment.
    pub(super) coc_px: Vec<[f32; 2]>,
}

impl Depths {
    /// Those of `layer`.
    pub(super) fn new(layer: &Layer) -> Self {
        let (width, height, grid) = (layer.width(), layer.height(), Grid::of(layer));
        let of_row = |row: usize| {
            let mut least = vec![f32::INFINITY; grid.columns * BLOCK];
            let mut largest = vec![f32::NEG_INFINITY; grid.columns * BLOCK];
            for y in row * BLOCK..((row + 1) * BLOCK).min(height) {
                Arch::new().dispatch(Widen {
                    alpha: layer.alpha.row(y),
                    coc_px: layer.coc_px.row(y),
                    least: &mut least[..width],
                    largest: &mut largest[..width],
                });
            }
            let blocks = least.chunks(BLOCK).zip(largest.chunks(BLOCK));
            let extremes = |(least, largest): (&[f32], &[f32])| {
                [
                    least.iter().copied().fold(f32::INFINITY, f32::min),
                    largest.iter().copied().fold(f32::NEG_INFINITY, f32::max),
                ]
            };
            blocks.map(extremes).collect()
        };
        Self { grid, coc_px: parallel::flat_map(grid.rows, &of_row) }
    }

    /// The nearest and the farthest of `bins` that a fragment of the block at `place` may be in; `None` without fragments.
    pub(super) fn bins(&self, place @ [x, y]: Place, bins: &Bins) -> Option<[u16; 2]> {
        let [least, largest] = self.coc_px[y * self.grid.columns + x];
        if least > largest {
            return None;
        }
        let around = self.grid.around(place, 1).map(|block| self.coc_px[block]);
        let [least_around, largest_around] = around
            .fold([least, largest], |[low, high], [least, largest]| [low.min(least), high.max(largest)]);
        // A fragment joins neighbours of its own peel within the larger limit, of others within the smaller one.
        let nearest = least_around.min(least - JOIN_PX).max(least - MAX_JOIN_PX);
        let farthest = largest_around.max(largest + JOIN_PX).min(largest + MAX_JOIN_PX);
        Some([bins.index(nearest), bins.index(farthest)])
    }
}

/// Widens `least` and `largest` to the CoC radii of a row's fragments; compiled for each instruction set.
struct Widen<'a> {
    alpha: &'a [f32],
    coc_px: &'a [f32],
    least: &'a mut [f32],
    largest: &'a mut [f32],
}

impl NullaryFnOnce for Widen<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let samples = self.alpha.iter().zip(self.coc_px);
        for ((&alpha, &coc_px), (least, largest)) in samples.zip(self.least.iter_mut().zip(self.largest)) {
            let present = alpha > 0.0;
            *least = if present & (coc_px < *least) { coc_px } else { *least };
            *largest = if present & (coc_px > *largest) { coc_px } else { *largest };
        }
    }
}
