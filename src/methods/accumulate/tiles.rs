//! Where there is nothing to meet: for each tile of samples, the CoC depths that have a fragment. A tile is looked at when a ray first
//! passes it, so that a few rays cost little.

use crate::scene::Layer;
use crate::scene::surface::JOIN_PX;
use glam::IVec2;
use std::borrow::Borrow;
use std::sync::atomic::{AtomicU64, Ordering};

/// Side of a tile, in samples.
pub(super) const TILE: i32 = 8;

/// Slabs of equal thickness that the CoC depths are cut into at most: one bit each.
pub(super) const SLABS: u32 = 62;

/// Set in a tile that was looked at.
const KNOWN: u64 = 1 << 63;

/// Set in a tile with all fragments nearest first.
const NEAREST_FIRST: u64 = 1 << 62;

/// A fragment reaches less than half the way to a neighbour that joins it; no slab is thinner than that.
const REACH_PX: f32 = 0.5 * JOIN_PX;

/// What is known of every tile.
#[derive(Debug)]
pub(super) struct Tiles {
    tiles: Vec<AtomicU64>,
    /// Columns and rows of tiles.
    size: IVec2,
    pub(super) slabs: Slabs,
}

/// The part of a ray's way over a tile in which there may be fragments.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Passage {
    /// CoC depths, from where to where.
    pub(super) stay: [f32; 2],
    /// Whether each sample has its fragments nearest first: past one behind a ray's stay there is then none before it.
    pub(super) nearest_first: bool,
}

impl Tiles {
    /// Of layers of `width × height` samples whose fragments lie within `coc_range_px`.
    pub(super) fn new([width, height]: [i32; 2], coc_range_px: [f32; 2]) -> Self {
        let size = IVec2::new((width + TILE - 1) / TILE, (height + TILE - 1) / TILE).max(IVec2::ONE);
        let tiles = (0..size.x * size.y).map(|_| AtomicU64::new(0)).collect();
        Self { tiles, size, slabs: Slabs::of(coc_range_px) }
    }

    /// What a ray finds on its way over `tile` of `layers` from CoC depth to CoC depth `stay`, if anything. Tiles past the border
    /// have what those at the border have.
    #[inline]
    pub(super) fn passage<L: Borrow<Layer>>(
        &self,
        layers: &[L],
        tile: IVec2,
        stay: [f32; 2],
    ) -> Option<Passage> {
        let tile = tile.clamp(IVec2::ZERO, self.size - 1);
        let cell = &self.tiles[(tile.y * self.size.x + tile.x) as usize];
        let mut bits = cell.load(Ordering::Relaxed);
        if bits == 0 {
            bits = self.look(layers, tile);
            cell.store(bits, Ordering::Relaxed);
        }
        let occupied = bits & self.slabs.bits(stay);
        let last = occupied.checked_ilog2()?;
        let first = occupied.trailing_zeros();
        let stay = [stay[0].max(self.slabs.begin(first)), stay[1].min(self.slabs.end(last))];
        Some(Passage { stay, nearest_first: bits & NEAREST_FIRST != 0 })
    }

    /// Looks at all fragments of `tile`.
    #[cold]
    fn look<L: Borrow<Layer>>(&self, layers: &[L], tile: IVec2) -> u64 {
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
        // A fragment may reach into the slabs beside its own.
        let bits = (bits | bits << 1 | bits >> 1) & (u64::MAX >> (u64::BITS - SLABS));
        bits | KNOWN | if ordered { NEAREST_FIRST } else { 0 }
    }
}

/// The CoC depths from `nearest` on, in slabs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slabs {
    nearest: f32,
    pub(super) per_px: f32,
}

impl Slabs {
    fn of([nearest, farthest]: [f32; 2]) -> Self {
        Self { nearest, per_px: (SLABS as f32 / (farthest - nearest)).min(1.0 / REACH_PX) }
    }

    /// The slab of CoC depth `coc`; beyond the ends, the last one.
    fn index(self, coc: f32) -> u32 {
        // Adding 2²³ leaves the whole part in the lowest bits: a cast checks for more, and costs more than all the rest.
        const WHOLE: f32 = 8_388_608.0;
        let slabs = ((coc - self.nearest) * self.per_px - 0.5).clamp(0.0, (SLABS - 1) as f32);
        (slabs + WHOLE).to_bits() & 63
    }

    /// The bits of the slabs that `from ..= to` touches.
    fn bits(self, [from, to]: [f32; 2]) -> u64 {
        (u64::MAX << self.index(from)) & (u64::MAX >> (63 - self.index(to)))
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
    fn a_ray_finds_what_lies_at_its_depth_and_nothing_else() {
        // One fragment at the picture's end, one in the second tile.
        let layers = [layer(|x, y| match (x, y) {
            (19, 11) => Some(30.0),
            (8, 3) => Some(-20.0),
            _ => None,
        })];
        let tiles = Tiles::new([20, 12], [-20.0, 30.0]);
        let passage = |x, y, stay| tiles.passage(&layers, IVec2::new(x, y), stay).map(|passage| passage.stay);
        assert_eq!(passage(0, 0, [-20.0, 30.0]), None, "an empty tile");
        assert_eq!(passage(1, 0, [-18.0, 30.0]), None, "behind it");
        let [from, to] = passage(1, 0, [-20.0, 30.0]).unwrap();
        assert!(from == -20.0 && (-19.75..-17.0).contains(&to), "around it: {from} … {to}");
        let [from, to] = passage(2, 1, [-20.0, 30.0]).unwrap();
        assert!((27.0..29.75).contains(&from) && to == 30.0, "around the other: {from} … {to}");
        assert_eq!(passage(5, 7, [-20.0, 30.0]), passage(2, 1, [-20.0, 30.0]), "the border goes on");
    }

    #[test]
    fn order_is_known_by_tile() {
        let layers = [layer(|x, _| Some(if x < 8 { 1.0 } else { 3.0 })), layer(|_, _| Some(2.0))];
        let tiles = Tiles::new([20, 12], [1.0, 3.0]);
        let ordered = |x| tiles.passage(&layers, IVec2::new(x, 0), [1.0, 3.0]).unwrap().nearest_first;
        assert_eq!([0, 1, 2].map(ordered), [true, false, false]);
    }

    #[test]
    fn one_depth_alone_is_found() {
        let layers = [layer(|_, _| Some(2.0))];
        let tiles = Tiles::new([20, 12], [2.0, 2.0]);
        let found = tiles.passage(&layers, IVec2::ZERO, [2.0, 2.0]).unwrap();
        assert_eq!(found, Passage { stay: [2.0, 2.0], nearest_first: true });
    }
}
