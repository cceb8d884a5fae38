//! Empty space: for each tile of samples, the CoC depths that have a fragment. A tile is analyzed when a ray first passes it, so
//! that rendering few rays costs little.

use crate::scene::Layer;
use crate::scene::surface::MAX_JOIN_PX;
use glam::IVec2;
use std::borrow::Borrow;
use std::sync::atomic::{AtomicU64, Ordering};

/// Side of a tile, in samples.
pub(super) const TILE: i32 = 8;

/// Maximum number of slabs of equal thickness that the CoC depths are divided into: one bit each.
pub(super) const SLABS: u32 = 62;

/// Set in a tile that was analyzed.
const ANALYZED: u64 = 1 << 63;

/// Set in a tile where the fragments of every sample are sorted nearest first.
const NEAREST_FIRST: u64 = 1 << 62;

/// A fragment extends half-way to a neighbour of its surface. No slab is thinner than this.
pub(super) const REACH_PX: f32 = 0.5 * MAX_JOIN_PX;

/// Occupancy of every tile.
#[derive(Debug)]
pub(super) struct Tiles {
    tiles: Vec<AtomicU64>,
    /// Columns and rows of tiles.
    size: IVec2,
    pub(super) slabs: Slabs,
}

/// The part of a ray's path over a tile that may hit fragments.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Passage {
    /// First and last CoC depth.
    pub(super) coc_interval: [f32; 2],
    /// Whether the fragments of each sample are sorted nearest first: once one is behind the ray's interval, all that follow are.
    pub(super) nearest_first: bool,
}

impl Tiles {
    /// The tiles of layers of `width × height` samples, with all fragments within `coc_range_px`; none analyzed yet.
    pub(super) fn new([width, height]: [i32; 2], coc_range_px: [f32; 2]) -> Self {
        let size = IVec2::new((width + TILE - 1) / TILE, (height + TILE - 1) / TILE).max(IVec2::ONE);
        let tiles = (0..size.x * size.y).map(|_| AtomicU64::new(0)).collect();
        Self { tiles, size, slabs: Slabs::from_coc_range(coc_range_px) }
    }

    /// The part of a ray's path over `tile` of `layers`, within the CoC depths `coc_interval`, that may hit fragments; `None` if
    /// there are none. Tiles past the border repeat those at the border.
    #[inline]
    pub(super) fn passage<L: Borrow<Layer>>(
        &self,
        layers: &[L],
        tile: IVec2,
        coc_interval: [f32; 2],
    ) -> Option<Passage> {
        let tile = tile.clamp(IVec2::ZERO, self.size - 1);
        let cell = &self.tiles[(tile.y * self.size.x + tile.x) as usize];
        let mut bits = cell.load(Ordering::Relaxed);
        if bits == 0 {
            bits = self.analyze(layers, tile);
            cell.store(bits, Ordering::Relaxed);
        }
        let occupied = bits & self.slabs.bits(coc_interval);
        let last = occupied.checked_ilog2()?;
        let first = occupied.trailing_zeros();
        let coc_interval =
            [coc_interval[0].max(self.slabs.begin(first)), coc_interval[1].min(self.slabs.end(last))];
        Some(Passage { coc_interval, nearest_first: bits & NEAREST_FIRST != 0 })
    }

    /// The bits of `tile`: occupied slabs, [`ANALYZED`], [`NEAREST_FIRST`].
    #[cold]
    fn analyze<L: Borrow<Layer>>(&self, layers: &[L], tile: IVec2) -> u64 {
        let [left, top] = [tile.x, tile.y].map(|at| at as usize * TILE as usize);
        let mut nearest = [[f32::NEG_INFINITY; TILE as usize]; TILE as usize];
        let (mut bits, mut ordered) = (0, true);
        for layer in layers {
            let layer = layer.borrow();
            let columns = left..(left + TILE as usize).min(layer.width());
            for (y, nearest) in (top..layer.height()).zip(&mut nearest) {
                let (alpha, coc) =
                    (&layer.alpha.row(y)[columns.clone()], &layer.coc_px.row(y)[columns.clone()]);
                for ((&alpha, &coc), nearest) in alpha.iter().zip(coc).zip(nearest) {
                    let present = alpha > 0.0;
                    bits |= u64::from(present) << self.slabs.index(coc);
                    ordered &= !present | (coc >= *nearest);
                    *nearest = if present { coc } else { *nearest };
                }
            }
        }
        // A fragment may extend into the slabs next to its own.
        let bits = (bits | bits << 1 | bits >> 1) & (u64::MAX >> (u64::BITS - SLABS));
        bits | ANALYZED | if ordered { NEAREST_FIRST } else { 0 }
    }
}

/// Division of the CoC depths from `nearest` on into slabs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slabs {
    nearest: f32,
    pub(super) per_px: f32,
}

impl Slabs {
    fn from_coc_range([nearest, farthest]: [f32; 2]) -> Self {
        Self { nearest, per_px: (SLABS as f32 / (farthest - nearest)).min(1.0 / REACH_PX) }
    }

    /// The slab of CoC depth `coc`; beyond either end, the slab at that end.
    fn index(self, coc: f32) -> u32 {
        // Adding 2²³ leaves the integer part in the lowest bits. A cast also checks the range, which costs more than the rest.
        const WHOLE: f32 = 8_388_608.0;
        let slabs = ((coc - self.nearest) * self.per_px - 0.5).clamp(0.0, (SLABS - 1) as f32);
        (slabs + WHOLE).to_bits() & 63
    }

    /// The bits of the slabs that overlap `from ..= to`.
    fn bits(self, [from, to]: [f32; 2]) -> u64 {
        (u64::MAX << self.index(from)) & (u64::MAX >> (63 - self.index(to)))
    }

    /// Where slab `index` begins, with a margin for rounding.
    fn begin(self, index: u32) -> f32 {
        self.nearest + (index as f32 - 0.01) / self.per_px
    }

    /// Where slab `index` ends, with a margin for rounding.
    fn end(self, index: u32) -> f32 {
        self.nearest + (index as f32 + 1.01) / self.per_px
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;

    fn layer(coc: impl Fn(usize, usize) -> Option<f32>) -> Layer {
        let (width, height) = (20, 12);
        Layer {
            color: std::array::from_fn(|_| Plane::zeros(width, height)),
            alpha: Plane::from_fn(width, height, |x, y| f32::from(u8::from(coc(x, y).is_some()))),
            coc_px: Plane::from_fn(width, height, |x, y| coc(x, y).unwrap_or(0.0)),
        }
    }

    #[test]
    fn a_passage_covers_the_fragments_at_the_rays_depths_only() {
        // One fragment at the picture's end, one in the second tile.
        let layers = [layer(|x, y| match (x, y) {
            (19, 11) => Some(30.0),
            (8, 3) => Some(-20.0),
            _ => None,
        })];
        let tiles = Tiles::new([20, 12], [-20.0, 30.0]);
        let passage = |x, y, coc_interval| {
            tiles.passage(&layers, IVec2::new(x, y), coc_interval).map(|passage| passage.coc_interval)
        };
        assert_eq!(passage(0, 0, [-20.0, 30.0]), None, "an empty tile");
        assert_eq!(passage(1, 0, [-18.0, 30.0]), None, "behind it");
        let [from, to] = passage(1, 0, [-20.0, 30.0]).unwrap();
        assert!(from == -20.0 && (-19.75..-17.0).contains(&to), "around it: {from} … {to}");
        let [from, to] = passage(2, 1, [-20.0, 30.0]).unwrap();
        assert!((27.0..29.75).contains(&from) && to == 30.0, "around the other: {from} … {to}");
        assert_eq!(passage(5, 7, [-20.0, 30.0]), passage(2, 1, [-20.0, 30.0]), "the border is repeated");
    }

    #[test]
    fn the_order_of_fragments_is_recorded_per_tile() {
        let layers = [layer(|x, _| Some(if x < 8 { 1.0 } else { 3.0 })), layer(|_, _| Some(2.0))];
        let tiles = Tiles::new([20, 12], [1.0, 3.0]);
        let ordered = |x| tiles.passage(&layers, IVec2::new(x, 0), [1.0, 3.0]).unwrap().nearest_first;
        assert_eq!([0, 1, 2].map(ordered), [true, false, false]);
    }

    #[test]
    fn a_depth_range_of_zero_thickness_has_one_slab() {
        let layers = [layer(|_, _| Some(2.0))];
        let tiles = Tiles::new([20, 12], [2.0, 2.0]);
        let found = tiles.passage(&layers, IVec2::ZERO, [2.0, 2.0]).unwrap();
        assert_eq!(found, Passage { coc_interval: [2.0, 2.0], nearest_first: true });
    }
}
