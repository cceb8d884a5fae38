//! The surface of the first peel, and what it hides from the whole lens.

use super::depths::Depths;
use super::grid::{BLOCK, Grid, Place};
use crate::methods::shear::bins::Bins;
use crate::parallel;
use crate::scene::{Layer, OPAQUE_ALPHA, surface};
use pulp::{Arch, NullaryFnOnce};
use std::ops::Range;

/// Upper limit of how much farther than the difference of their CoC radii a view moves two bins against one another: less than a pixel, as
/// both shifts are rounded, and what 32-bit floats lack.
const ROUNDING_PX: f32 = 1.25;

/// Distance of the centres of two bins below which their shifts differ by a pixel at most.
const NARROW_PX: f32 = 0.99;

/// A square of blocks of the first peel.
#[derive(Debug, Clone, Copy)]
struct Square {
    /// Whether a sample in it is not opaque, or does not belong to one surface with the next one to the right or below.
    has_holes: bool,
    /// The least and the largest CoC radius of its samples, in pixels.
    coc_px: [f32; 2],
}

impl Square {
    fn union(self, other: Self) -> Self {
        let [[least, largest], [other_least, other_largest]] = [self.coc_px, other.coc_px];
        Self {
            has_holes: self.has_holes | other.has_holes,
            coc_px: [least.min(other_least), largest.max(other_largest)],
        }
    }
}

/// The first peel, by squares of blocks.
pub(super) struct Front {
    grid: Grid,
    /// For each level `l` the squares of `2^l` blocks' sides, by their first block; those that reach past the border have no meaning.
    levels: Vec<Vec<Square>>,
}

impl Front {
    /// The first peel `layer`.
    pub(super) fn new(layer: &Layer) -> Self {
        let Depths { grid, coc_px } = Depths::new(layer);
        let holes = parallel::flat_map(grid.rows, &|row| holes(layer, row));
        let blocks = holes.into_iter().zip(coc_px).map(|(has_holes, coc_px)| Square { has_holes, coc_px });
        let mut levels: Vec<Vec<Square>> = vec![blocks.collect()];
        while 1 << levels.len() <= grid.columns.min(grid.rows) {
            let (below, side) = (&levels[levels.len() - 1], 1 << (levels.len() - 1));
            levels.push(grid.map(|[x, y]| {
                let at = |right: usize, down: usize| {
                    let [x, y] = [(x + right).min(grid.columns - 1), (y + down).min(grid.rows - 1)];
                    below[y * grid.columns + x]
                };
                at(0, 0).union(at(side, 0)).union(at(0, side)).union(at(side, side))
            }));
        }
        Self { grid, levels }
    }

    /// Whether it hides from every view what the block at `place` has in the `bins` from the first to the last given.
    pub(super) fn hides(&self, place: Place, [nearest, farthest]: [u16; 2], bins: &Bins) -> bool {
        let center_px = |bin: u16| bins.centers_px()[usize::from(bin)];
        let mut radius = 1;
        loop {
            let Square { has_holes, coc_px } = self.square(self.grid.window(place, radius));
            if has_holes {
                return false;
            }
            let [first, last] = coc_px.map(|coc_px| bins.index(coc_px));
            if last > nearest || !bins.are_within(NARROW_PX, [first, last]) {
                return false;
            }
            let moved_px = center_px(farthest) - center_px(first) + ROUNDING_PX;
            let needed = (moved_px / BLOCK as f32).ceil() as usize;
            if needed <= radius {
                return true;
            }
            radius = needed;
        }
    }

    /// That of the blocks in `columns` and `rows`.
    fn square(&self, [columns, rows]: [Range<usize>; 2]) -> Square {
        let level = (columns.len().min(rows.len()).ilog2() as usize).min(self.levels.len() - 1);
        let side = 1 << level;
        let starts = |blocks: &Range<usize>| {
            let (first, last) = (blocks.start, blocks.end - side);
            (first..last).step_by(side).chain([last])
        };
        let squares = starts(&rows).flat_map(|y| starts(&columns).map(move |x| y * self.grid.columns + x));
        let none = Square { has_holes: false, coc_px: [f32::INFINITY, f32::NEG_INFINITY] };
        squares.map(|square| self.levels[level][square]).fold(none, Square::union)
    }
}

/// For each block of row `row` of the blocks of `layer`, whether it has holes: see [`Square::has_holes`].
fn holes(layer: &Layer, row: usize) -> Vec<bool> {
    let (width, top, arch) = (layer.width(), row * BLOCK, Arch::new());
    let count = BLOCK.min(layer.height() - top);
    let samples = Samples::new(layer, top..top + count);
    // For each column, 1 while every sample is joined to its next ones.
    let mut joined = vec![1; width];
    for y in 0..count {
        let beside = [0, 1, 2, 3].map(|x| samples.row([x, y + 1], width));
        let below = [0, 1, 2, 3].map(|down| samples.row([1, y + down], width));
        for along in [beside, below] {
            arch.dispatch(Join { along, joined: &mut joined });
        }
    }
    joined.chunks(BLOCK).map(|joined| joined.contains(&0)).collect()
}

/// CoC radii of some rows of the first peel, with one row more before them and two after, one column more before and two after; past the
/// border those of the border. NaN where they are not opaque.
struct Samples {
    coc_px: Vec<f32>,
    /// Samples from one row to the next.
    stride: usize,
}

impl Samples {
    fn new(layer: &Layer, rows: Range<usize>) -> Self {
        let (width, last) = (layer.width(), layer.height() - 1);
        let stride = width + 3;
        let mut coc_px = vec![f32::NAN; stride * (rows.len() + 3)];
        for (i, row) in coc_px.chunks_mut(stride).enumerate() {
            let y = (rows.start + i).saturating_sub(1).min(last);
            for (to, (&alpha, &coc_px)) in
                row[1..].iter_mut().zip(layer.alpha.row(y).iter().zip(layer.coc_px.row(y)))
            {
                *to = if alpha >= OPAQUE_ALPHA { coc_px } else { f32::NAN };
            }
            row[0] = row[1];
            row.copy_within(width..=width, width + 1);
            row.copy_within(width..=width, width + 2);
        }
        Self { coc_px, stride }
    }

    /// `count` samples from a column and a row on; the first are those before the border.
    fn row(&self, [column, row]: [usize; 2], count: usize) -> &[f32] {
        &self.coc_px[row * self.stride + column..][..count]
    }
}

/// Clears `joined` where the two middle samples of four `along` a row or a column do not belong to one surface; compiled for each
/// instruction set.
struct Join<'a> {
    along: [&'a [f32]; 4],
    joined: &'a mut [u16],
}

impl NullaryFnOnce for Join<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let along = self.along.map(|samples| &samples[..self.joined.len()]);
        for (x, joined) in self.joined.iter_mut().enumerate() {
            *joined &= u16::from(surface::goes_on(along.map(|samples| samples[x])));
        }
    }
}
