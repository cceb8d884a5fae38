//! Where there is nothing to meet: for each tile of samples, the CoC depths that have a fragment.

use super::volume::JOIN_PX;
use crate::scene::Layer;
use glam::IVec2;
use rayon::prelude::*;
use std::borrow::Borrow;

/// Side of a tile, in samples.
pub(super) const TILE: i32 = 8;

/// Slabs of equal thickness that the CoC depths are cut into at most: one bit each.
const SLABS: u32 = u64::BITS;

/// A fragment reaches less than half the way to a neighbour that joins it; no slab is thinner than that.
const REACH_PX: f32 = 0.5 * JOIN_PX;

/// One bit for each tile and slab, set where there may be a fragment.
#[derive(Debug)]
pub(super) struct Occupancy {
    tiles: Vec<u64>,
    /// Columns and rows of tiles.
    size: IVec2,
    slabs: Slabs,
}

/// The CoC depths from `nearest` on, in slabs.
#[derive(Debug, Clone, Copy)]
struct Slabs {
    nearest: f32,
    per_px: f32,
}

impl Slabs {
    fn of([nearest, farthest]: [f32; 2]) -> Self {
        Self { nearest, per_px: (SLABS as f32 / (farthest - nearest)).min(1.0 / REACH_PX) }
    }

    /// The slab of CoC depth `coc`; beyond the ends, the last one.
    fn index(self, coc: f32) -> u32 {
        (((coc - self.nearest) * self.per_px) as u32).min(SLABS - 1)
    }

    /// The bits of the slabs that `from ..= to` touches.
    fn bits(self, [from, to]: [f32; 2]) -> u64 {
        (u64::MAX << self.index(from)) & (u64::MAX >> (SLABS - 1 - self.index(to)))
    }

    /// The bits of the slabs that a fragment of CoC depth `coc` may reach into: its own and the two beside it.
    fn bits_of_fragment(self, coc: f32) -> u64 {
        let own = self.index(coc);
        (0b11 << own) | (1 << own >> 1)
    }

    /// Where slab `index` begins; a little before, for rounding.
    fn begin(self, index: u32) -> f32 {
        self.nearest + (index as f32 - 0.01) / self.per_px
    }

    /// Where slab `index` ends; a little behind, for rounding.
    fn end(self, index: u32) -> f32 {
        self.nearest + (index as f32 + 1.01) / self.per_px
    }
}

impl Occupancy {
    /// Of `layers`, whose fragments lie within `coc_range_px`.
    pub(super) fn new<L: Borrow<Layer> + Sync>(layers: &[L], coc_range_px: [f32; 2]) -> Self {
        let slabs = Slabs::of(coc_range_px);
        let (width, height) =
            layers.first().map_or((1, 1), |layer| (layer.borrow().width(), layer.borrow().height()));
        let side = TILE as usize;
        let (columns, rows) = (width.div_ceil(side), height.div_ceil(side));
        let mut tiles = vec![0; columns * rows];
        tiles.par_chunks_mut(columns).enumerate().for_each(|(row, tiles)| {
            for layer in layers {
                for y in row * side..((row + 1) * side).min(height) {
                    add_row(tiles, layer.borrow(), y, slabs);
                }
            }
        });
        Self { tiles, size: IVec2::new(columns as i32, rows as i32), slabs }
    }

    /// The part of `stay`, CoC depths from where to where, in which the tile `tile` may have fragments, if any. Tiles past the border
    /// have those of the border.
    #[inline]
    pub(super) fn within(&self, tile: IVec2, stay: [f32; 2]) -> Option<[f32; 2]> {
        let tile = tile.clamp(IVec2::ZERO, self.size - 1);
        let occupied = self.tiles[(tile.y * self.size.x + tile.x) as usize] & self.slabs.bits(stay);
        let last = occupied.checked_ilog2()?;
        let first = occupied.trailing_zeros();
        Some([stay[0].max(self.slabs.begin(first)), stay[1].min(self.slabs.end(last))])
    }
}

/// Adds row `y` of `layer` to the `tiles` that it passes.
fn add_row(tiles: &mut [u64], layer: &Layer, y: usize, slabs: Slabs) {
    let side = TILE as usize;
    let samples = layer.alpha.row(y).chunks(side).zip(layer.coc_px.row(y).chunks(side));
    for (tile, (alpha, coc)) in tiles.iter_mut().zip(samples) {
        for (&alpha, &coc) in alpha.iter().zip(coc) {
            *tile |= if alpha > 0.0 { slabs.bits_of_fragment(coc) } else { 0 };
        }
    }
}
