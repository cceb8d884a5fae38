//! Image pyramids: levels of half the size each, computed by a four-tap analysis and expanded by a B-spline synthesis.
//!
//! Analysis: a coarse sample is a weighted mean of the four nearest samples along each axis, with the weights [`BOX`], or
//! [`SPLAT`], the transpose of the synthesis. Synthesis: biquadratic B-spline interpolation of Strengert, Kraus & Ertl 2006,
//! "Pyramid Methods in GPU-Based Image Processing": each axis weighs the nearest coarse sample by 3/4 and the next by 1/4.
//!
//! Sizes: the frame is centred in a [`Grid`] whose sides are multiples of 2^levels, so that every level has exactly half the size
//! and a mirrored frame of even size has the mirrored pyramid. An axis of one sample is not halved further: the grid of a thin
//! frame is thin, and the grid is less than twice the frame along either axis.
//!
//! Levels are computed row by row from a function that writes rows of the finer level, so that the finest level need not be
//! stored.
//!
//! GPU version: `shaders/shared/pyramid.wgsl`.

#[cfg(feature = "gpu")]
mod gpu;

#[cfg(feature = "gpu")]
pub(in crate::methods) use gpu::{FIRST_LEVEL_WGSL, Levels, PYRAMID_WGSL, Step, corners, reach};

use super::content::row_blocks;
use crate::image::Plane;
use crate::parallel;
use pulp::{Arch, NullaryFnOnce};
#[cfg(feature = "gpu")]
use std::ops::Range;

/// One row of each channel.
pub(in crate::methods) type Rows = Vec<Vec<f32>>;

/// Analysis weights of the two outer and the two inner samples.
pub(in crate::methods) type Taps = [f32; 2];

/// The 4×4 box of Kraus & Strengert 2007, "Pyramid Filters Based on Bilinear Interpolation".
pub(in crate::methods) const BOX: Taps = [0.25, 0.25];

/// Bilinear splat onto the coarser level; its variance is 3/4 of a squared sample of the finer level, as that of the synthesis.
pub(in crate::methods) const SPLAT: Taps = [0.125, 0.375];

/// Coarse rows per task: adjacent coarse rows share half of their fine rows.
const BLOCK: usize = 16;

/// What lies past the border of a level.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::methods) enum Edge {
    /// Transparent black.
    Clear,
    /// The nearest border sample.
    Repeat,
}

/// Position of a frame in the levels of its pyramid.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::methods) struct Grid {
    frame: (usize, usize),
    /// Column and row of level 0 where the frame begins.
    pub origin: (usize, usize),
    /// What lies past the border.
    pub edge: Edge,
    /// Width and height of each level, finest first.
    pub sizes: Vec<(usize, usize)>,
}

/// Number of levels after which a frame of this size is one sample and its neighbours.
pub(in crate::methods) fn max_levels((width, height): (usize, usize)) -> usize {
    width.max(height).next_power_of_two().trailing_zeros() as usize + 1
}

impl Grid {
    /// The grid of `levels` levels above the finest for a frame, with at least one sample of transparent black around it
    /// where the edge is clear.
    pub(in crate::methods) fn new(frame: (usize, usize), levels: usize, edge: Edge) -> Self {
        let border = if edge == Edge::Clear { 2 } else { 0 };
        let padded = |side: usize| {
            let side = side + border;
            let halvings = levels.min(side.next_power_of_two().trailing_zeros() as usize);
            side.next_multiple_of(1 << halvings)
        };
        let finest = (padded(frame.0), padded(frame.1));
        let sizes = (0..=levels)
            .scan(finest, |next, _| {
                let size = *next;
                *next = (size.0.div_ceil(2), size.1.div_ceil(2));
                Some(size)
            })
            .collect();
        Self { frame, origin: ((finest.0 - frame.0) / 2, (finest.1 - frame.1) / 2), edge, sizes }
    }

    /// Rows of level 0 for these rows of the frame; the first and last row of the frame include the rows past its border.
    #[cfg(feature = "gpu")]
    pub(in crate::methods) fn rows_with_border(&self, rows: &Range<usize>) -> Range<usize> {
        let start = if rows.start == 0 { 0 } else { rows.start + self.origin.1 };
        let end = if rows.end == self.frame.1 { self.sizes[0].1 } else { rows.end + self.origin.1 };
        start..end
    }

    /// The same without the levels above `level`.
    #[cfg(feature = "gpu")]
    pub(in crate::methods) fn up_to(&self, level: usize) -> Self {
        Self { sizes: self.sizes[..=level].to_vec(), ..self.clone() }
    }

    /// The frame's row for row `y` of level 0; `None` past a clear border.
    pub(in crate::methods) fn frame_row(&self, y: usize) -> Option<usize> {
        let inside = (self.origin.1..self.origin.1 + self.frame.1).contains(&y);
        (inside || self.edge == Edge::Repeat)
            .then(|| y.saturating_sub(self.origin.1).min(self.frame.1.saturating_sub(1)))
    }

    /// Composites the frame's part of a row of level 0 (content and, last, alpha) over a row of the frame.
    pub(in crate::methods) fn lay_row_over(&self, row: &[Vec<f32>], behind: &mut [&mut [f32]]) {
        let Some(alpha) = row.last() else { return };
        let alpha = self.frame_part(alpha);
        for (front, behind) in row.iter().zip(behind) {
            for ((back, &front), &alpha) in behind.iter_mut().zip(self.frame_part(front)).zip(alpha) {
                *back = front + (1.0 - alpha) * *back;
            }
        }
    }

    /// Fills the parts of a row of level 0 outside the frame; the frame's part has to be written.
    pub(in crate::methods) fn complete(&self, row: &mut [f32]) {
        let (start, end) = (self.origin.0, self.origin.0 + self.frame.0);
        let [left, right] = match self.edge {
            Edge::Clear => [0.0; 2],
            Edge::Repeat => [row[start], row[end - 1]],
        };
        row[..start].fill(left);
        row[end..].fill(right);
    }

    /// The frame's part of a row of level 0.
    pub(in crate::methods) fn frame_part<'a>(&self, row: &'a [f32]) -> &'a [f32] {
        &row[self.origin.0..][..self.frame.0]
    }

    /// The frame's part of a row of level 0, mutable.
    pub(in crate::methods) fn frame_part_mut<'a>(&self, row: &'a mut [f32]) -> &'a mut [f32] {
        &mut row[self.origin.0..][..self.frame.0]
    }

    /// Level 1 of `channels` planes: `row(y, rows)` writes row `y` of the frame into the frame's part of each row of level 0.
    pub(in crate::methods) fn reduce_frame(
        &self,
        channels: usize,
        taps: Taps,
        row: &(dyn Fn(usize, &mut Rows) + Sync),
    ) -> Vec<Plane> {
        self.reduce(0, channels, taps, &|y, rows| match self.frame_row(y) {
            Some(y) => {
                row(y, rows);
                rows.iter_mut().for_each(|row| self.complete(row));
            }
            None => rows.iter_mut().for_each(|row| row.fill(0.0)),
        })
    }

    /// The level above `level` from that level's planes.
    pub(in crate::methods) fn reduce_level(&self, level: usize, planes: &[Plane], taps: Taps) -> Vec<Plane> {
        self.reduce(level, planes.len(), taps, &|y, rows| {
            rows.iter_mut().zip(planes).for_each(|(row, plane)| row.copy_from_slice(plane.row(y)));
        })
    }

    /// The level above `level`: `row(y, rows)` writes row `y` of `level`.
    pub(in crate::methods) fn reduce(
        &self,
        level: usize,
        channels: usize,
        taps: Taps,
        row: &(dyn Fn(usize, &mut Rows) + Sync),
    ) -> Vec<Plane> {
        let ((fine_width, fine_height), (width, height)) = (self.sizes[level], self.sizes[level + 1]);
        let mut planes = vec![Plane::zeros(width, height); channels];
        let arch = Arch::new();
        let new_rows = || vec![vec![0.0; fine_width]; channels];
        parallel::for_each(row_blocks(&mut planes, BLOCK).into_iter(), &|block, mut coarse| {
            // Fine row y is at index y % 4: the four rows of a coarse row have different indices.
            let mut ring: [Rows; 4] = std::array::from_fn(|_| new_rows());
            let mut column_sums = vec![0.0; fine_width];
            let first = 2 * (block * BLOCK) as isize - 1;
            let mut written = first;
            for line in 0..coarse[0].len() / width {
                let start = first + 2 * line as isize;
                for y in written..start + 4 {
                    let rows = &mut ring[y.rem_euclid(4) as usize];
                    let inside = (0..fine_height as isize).contains(&y);
                    match self.edge {
                        Edge::Clear if !inside => rows.iter_mut().for_each(|row| row.fill(0.0)),
                        _ => row(y.clamp(0, fine_height as isize - 1) as usize, rows),
                    }
                }
                written = start + 4;
                for (channel, coarse) in coarse.iter_mut().enumerate() {
                    let fine =
                        std::array::from_fn(|k| &*ring[(start + k as isize).rem_euclid(4) as usize][channel]);
                    let coarse = &mut coarse[line * width..][..width];
                    let edge = self.edge;
                    arch.dispatch(ReduceRow { fine, taps, edge, column_sums: &mut column_sums, coarse });
                }
            }
        });
        planes
    }

    /// The planes of `level`, expanded from those of the level above, `coarse`; `finish(y, rows)` then modifies each row.
    pub(in crate::methods) fn expand(
        &self,
        level: usize,
        coarse: &[Plane],
        finish: &(dyn Fn(usize, &mut Rows) + Sync),
    ) -> Vec<Plane> {
        let (width, height) = self.sizes[level];
        let mut planes = vec![Plane::zeros(width, height); coarse.len()];
        parallel::for_each_with(
            row_blocks(&mut planes, 1).into_iter(),
            &|| (vec![vec![0.0; width]; coarse.len()], Vec::new()),
            &|(rows, blend), y, mut fine| {
                self.expand_row(coarse, y, blend, rows);
                finish(y, rows);
                fine.iter_mut().zip(rows).for_each(|(fine, row)| fine.copy_from_slice(row));
            },
        );
        planes
    }

    /// Row `y` of a level, expanded from the planes of the level above; `blend` is scratch memory.
    pub(in crate::methods) fn expand_row(
        &self,
        coarse: &[Plane],
        y: usize,
        blend: &mut Vec<f32>,
        rows: &mut Rows,
    ) {
        let arch = Arch::new();
        for (plane, row) in coarse.iter().zip(rows) {
            blend.resize(plane.width(), 0.0);
            let nearest = (y / 2).min(plane.height() - 1);
            let next = if y.is_multiple_of(2) { nearest.checked_sub(1) } else { Some(nearest + 1) };
            let next = next.filter(|&next| next < plane.height()).map(|next| plane.row(next));
            let next = next.or((self.edge == Edge::Repeat).then(|| plane.row(nearest)));
            arch.dispatch(ExpandRow { nearest: plane.row(nearest), next, edge: self.edge, blend, row });
        }
    }
}

/// Computes one coarse row from four fine ones; compiled for each instruction set.
struct ReduceRow<'a> {
    fine: [&'a [f32]; 4],
    taps: Taps,
    edge: Edge,
    column_sums: &'a mut [f32],
    coarse: &'a mut [f32],
}

impl NullaryFnOnce for ReduceRow<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { fine: [a, b, c, d], taps: [outer, inner], edge, column_sums: sums, coarse } = self;
        for (x, sum) in sums.iter_mut().enumerate() {
            *sum = outer * (a[x] + d[x]) + inner * (b[x] + c[x]);
        }
        let last = sums.len() - 1;
        let [before, after] = match edge {
            Edge::Clear => [0.0; 2],
            Edge::Repeat => [sums[0], sums[last]],
        };
        if coarse.len() == 1 {
            // An axis of one or two samples has its border on both sides.
            let second = sums.get(1).copied().unwrap_or(after);
            coarse[0] = inner * (sums[0] + second) + outer * (before + after);
            return;
        }
        let middle = coarse.len() - 1;
        coarse[0] = inner * (sums[0] + sums[1]) + outer * (before + sums[2]);
        coarse[middle] = inner * (sums[last - 1] + sums[last]) + outer * (sums[last - 2] + after);
        // Two windows of pairs, one sample apart: contiguous loads are vectorised.
        let (pairs, shifted) = (sums[2..].chunks_exact(2), sums[1..].chunks_exact(2));
        let shifted = shifted.clone().zip(shifted.skip(1));
        for ((value, pair), (left, right)) in coarse[1..middle].iter_mut().zip(pairs).zip(shifted) {
            *value = inner * (pair[0] + pair[1]) + outer * (left[0] + right[1]);
        }
    }
}

/// Computes one fine row from the two nearest coarse ones; compiled for each instruction set.
struct ExpandRow<'a> {
    nearest: &'a [f32],
    next: Option<&'a [f32]>,
    edge: Edge,
    blend: &'a mut [f32],
    row: &'a mut [f32],
}

impl NullaryFnOnce for ExpandRow<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { nearest, next, edge, blend, row } = self;
        match next {
            Some(next) => {
                for ((value, &nearest), &next) in blend.iter_mut().zip(nearest).zip(next) {
                    *value = 0.75 * nearest + 0.25 * next;
                }
            }
            None => blend.iter_mut().zip(nearest).for_each(|(value, &nearest)| *value = 0.75 * nearest),
        }
        let last = blend.len() - 1;
        let [before, after] = match edge {
            Edge::Clear => [0.0; 2],
            Edge::Repeat => [blend[0], blend[last]],
        };
        row[0] = 0.75 * blend[0] + 0.25 * before;
        if row.len() > 1 {
            for (pair, two) in row[1..].chunks_exact_mut(2).zip(blend.windows(2)) {
                pair[0] = 0.75 * two[0] + 0.25 * two[1];
                pair[1] = 0.75 * two[1] + 0.25 * two[0];
            }
            row[2 * last + 1] = 0.75 * blend[last] + 0.25 * after;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `plane` after analysis by `levels` levels and synthesis back.
    fn blurred(plane: &Plane, levels: usize, taps: Taps, edge: Edge) -> Plane {
        let frame = (plane.width(), plane.height());
        let grid = Grid::new(frame, levels, edge);
        let first = grid.reduce_frame(1, taps, &|y, rows| {
            grid.frame_part_mut(&mut rows[0]).copy_from_slice(plane.row(y));
        });
        let coarsest = (1..levels).fold(first, |finer, level| grid.reduce_level(level, &finer, taps));
        let finest =
            (0..levels).rev().fold(coarsest, |coarse, level| grid.expand(level, &coarse, &|_, _| ()));
        Plane::from_fn(frame.0, frame.1, |x, y| finest[0].get(x + grid.origin.0, y + grid.origin.1))
    }

    #[test]
    fn a_constant_picture_stays_constant_up_to_its_border_where_the_border_is_repeated() {
        for frame in [(1, 1), (1, 7), (9, 1), (17, 3), (40, 22), (31, 31)] {
            for (levels, taps) in [(1, BOX), (3, SPLAT), (3, BOX), (7, SPLAT), (12, BOX)] {
                let plane = blurred(&Plane::filled(frame.0, frame.1, 0.6), levels, taps, Edge::Repeat);
                let off = plane.values().iter().map(|value| (value - 0.6).abs()).fold(0.0, f32::max);
                assert!(off < 1e-6, "{frame:?}, {levels} levels: off by {off}");
            }
        }
    }

    #[test]
    fn past_a_clear_border_samples_are_transparent() {
        let plane = blurred(&Plane::filled(32, 32, 1.0), 2, BOX, Edge::Clear);
        assert!(plane.get(0, 0) < plane.get(0, 16) && plane.get(0, 16) < 0.9, "less towards a corner");
        // The two levels reach 3 and 6 pixels to either side.
        assert!((plane.get(16, 16) - 1.0).abs() < 1e-6, "the middle: {}", plane.get(16, 16));
    }

    /// Centroid and variance along x of the blur of a point at `at` of 128 × 128.
    fn moments(at: (usize, usize), levels: usize, taps: Taps) -> [f32; 2] {
        let point = Plane::from_fn(128, 128, |x, y| f32::from(u8::from((x, y) == at)));
        let plane = blurred(&point, levels, taps, Edge::Repeat);
        let mut sums = [0.0; 3];
        for y in 0..128 {
            for (x, &value) in plane.row(y).iter().enumerate() {
                let offset = x as f32 - at.0 as f32;
                sums.iter_mut()
                    .zip([1.0, offset, offset * offset])
                    .for_each(|(sum, weight)| *sum += value * weight);
            }
        }
        assert!((sums[0] - 1.0).abs() < 1e-5, "a point keeps its energy: {}", sums[0]);
        [sums[1], sums[2]]
    }

    #[test]
    fn splat_and_synthesis_of_n_levels_have_the_sum_of_their_filters_variances() {
        // [1 3 3 1] / 8 at ±½ and ±1½ samples: (2·3·¼ + 2·2¼) / 8 = ¾ of a squared sample, both ways, at each level:
        // 2 · ¾ · (1 + 4 + … ) = (4ⁿ − 1) / 2.
        for (levels, variance) in [(1, 1.5), (2, 7.5), (3, 31.5)] {
            for at in [(61, 64), (64, 61), (66, 66)] {
                let [place, spread] = moments(at, levels, SPLAT);
                assert!(place.abs() < 1e-4, "{levels} levels, {at:?}: moved by {place}");
                assert!((spread / variance - 1.0).abs() < 1e-4, "{levels} levels, {at:?}: {spread}");
            }
        }
    }

    #[test]
    fn a_coarse_sample_of_the_box_is_the_mean_of_sixteen_fine_ones() {
        let grid = Grid::new((8, 8), 1, Edge::Repeat);
        let level = grid.reduce_frame(1, BOX, &|y, rows| {
            rows[0].iter_mut().enumerate().for_each(|(x, value)| *value = (x + 10 * y) as f32);
        });
        // Columns 1 … 4 and rows 3 … 6: the mean of x is 2.5, of y 4.5.
        assert_eq!(level[0].get(1, 2), 47.5);
    }

    #[test]
    fn the_synthesis_weighs_the_nearest_three_to_one() {
        let grid = Grid::new((4, 4), 1, Edge::Repeat);
        let coarse = [Plane::from_fn(2, 2, |x, y| if (x, y) == (0, 0) { 16.0 } else { 0.0 })];
        let fine = grid.expand(0, &coarse, &|_, _| ());
        let row = |y| fine[0].row(y).to_vec();
        assert_eq!(row(0), [16.0, 12.0, 4.0, 0.0], "the border is repeated, then 3/4 and 1/4");
        assert_eq!(row(1), [12.0, 9.0, 3.0, 0.0], "3/4 of that");
    }

    #[test]
    fn grids_are_centred_and_no_larger_than_they_have_to_be() {
        let grid = Grid::new((1920, 1080), 6, Edge::Clear);
        assert_eq!((grid.sizes[0], grid.origin, grid.sizes[6]), ((1984, 1088), (32, 4), (31, 17)));
        let thin = Grid::new((5000, 1), 14, Edge::Repeat);
        assert_eq!(thin.sizes[0], (8192, 1), "an axis of one sample stays that");
        assert_eq!(thin.sizes[14], (1, 1));
    }
}
