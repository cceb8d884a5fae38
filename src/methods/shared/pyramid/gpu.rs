//! The levels of a pyramid on a GPU, for a band of rows: which rows of each level are stored and where, and the passes between
//! levels.
//!
//! Only the samples that the band depends on are stored. They equal those of the pyramid of the whole frame, so that bands have
//! no seams.

use super::super::planes::{Frame, TILE};
use super::{Edge, Grid, Taps};
use crate::error::Error;
use crate::gpu::{Band, Buffer, Gpu, mirrored, tiles};
use std::iter;
use std::ops::Range;

/// Text of `shaders/shared/pyramid.wgsl`.
pub(in crate::methods) const PYRAMID_WGSL: &str = include_str!("../../../../shaders/shared/pyramid.wgsl");

/// Text of `shaders/shared/first_level.wgsl`.
pub(in crate::methods) const FIRST_LEVEL_WGSL: &str =
    include_str!("../../../../shaders/shared/first_level.wgsl");

mirrored! {
    /// Two adjacent levels, and the rows that a pass makes of one of them.
    pub(in crate::methods) struct Step {
        /// Size of the finer level.
        fine_width: i32,
        fine_height: i32,
        /// Its first row that is stored, and the number of rows.
        fine_first: i32,
        fine_rows: i32,
        /// Index in the buffer where they begin.
        fine_start: i32,
        /// The same of the coarser level.
        coarse_width: i32,
        coarse_height: i32,
        coarse_first: i32,
        coarse_rows: i32,
        coarse_start: i32,
        /// The rows that the pass makes.
        from_row: i32,
        to_row: i32,
        /// 1 where the border is repeated, 0 where it is clear.
        repeats: u32,
        /// Analysis weights.
        outer: f32,
        inner: f32,
    }
}

/// Rows of a frame on either side that a row depends on through `levels` levels: `2 + 4 + … + 2^levels` by synthesis, `1 + 2 + …`
/// by analysis.
pub(in crate::methods) fn reach(levels: usize) -> usize {
    3 * (1 << levels) - 3
}

/// Number of corners whose 2 × 2 samples cover `length` samples along an axis, whether the first sample is even or odd.
pub(in crate::methods) fn corners(length: usize) -> usize {
    length / 2 + 1
}

/// The levels that some rows of a frame depend on.
#[derive(Debug)]
pub(in crate::methods) struct Levels {
    grid: Grid,
    channels: usize,
    /// Rows of each level that synthesis makes.
    made: Vec<Range<usize>>,
    /// Rows of each level that the band depends on; stored where the level is in the buffer.
    kept: Vec<Range<usize>>,
    /// Index in the buffer where each level begins.
    starts: Vec<usize>,
    values: usize,
}

impl Levels {
    /// The levels of `grid` for these rows of its frame, `channels` planes each.
    pub(in crate::methods) fn new(grid: Grid, rows: &Range<usize>, channels: usize) -> Self {
        let finest = rows.start + grid.origin.1..rows.end + grid.origin.1;
        Self::from_finest(grid, finest, channels, 1)
    }

    /// The levels of `grid` for these rows of level 0, `channels` planes each; those from `lowest` on are in the buffer.
    pub(in crate::methods) fn from_finest(
        grid: Grid,
        rows: Range<usize>,
        channels: usize,
        lowest: usize,
    ) -> Self {
        let made = made_rows(&grid, rows);
        let kept = kept_rows(&grid, &made);
        let mut values = 0;
        let sizes = grid.sizes.iter().zip(&kept).enumerate();
        let starts = sizes.map(|(level, (&(width, _), rows))| {
            let start = values;
            values += if level < lowest { 0 } else { channels * width * rows.len() };
            start
        });
        let starts = starts.collect();
        Self { grid, channels, made, kept, starts, values }
    }

    /// The number of levels above level 0.
    pub(in crate::methods) fn count(&self) -> usize {
        self.grid.sizes.len() - 1
    }

    /// Number of values of all levels together.
    pub(in crate::methods) fn values(&self) -> usize {
        self.values
    }

    /// Rows of level 0 that the band depends on.
    pub(in crate::methods) fn finest_rows(&self) -> Range<usize> {
        self.kept[0].clone()
    }

    /// Position of a band in the frame, and of the frame in level 0.
    pub(in crate::methods) fn frame(&self, band: &Band, channels: usize) -> Frame {
        let Grid { frame, origin, .. } = self.grid;
        let [origin_x, origin_y] = [origin.0 as i32, origin.1 as i32];
        Frame { origin_x, origin_y, ..Frame::new(frame, band, channels) }
    }

    /// The pass that makes the level above `level`, and its workgroups.
    ///
    /// # Errors
    /// When the device fails.
    pub(in crate::methods) fn analysis(
        &self,
        gpu: &Gpu,
        level: usize,
        taps: Taps,
    ) -> Result<(Buffer, [u32; 3]), Error> {
        self.analysis_of(gpu, level, taps, self.kept[level + 1].clone())
    }

    /// The pass that makes the samples of level 1 that depend on these rows of the frame, and its workgroups.
    ///
    /// # Errors
    /// When the device fails.
    pub(in crate::methods) fn analysis_of_rows(
        &self,
        gpu: &Gpu,
        taps: Taps,
        rows: &Range<usize>,
    ) -> Result<(Buffer, [u32; 3]), Error> {
        let Grid { frame, origin, edge, .. } = self.grid;
        let repeats = |at_end: bool| at_end && edge == Edge::Repeat;
        let kept = &self.kept[1];
        let start = if repeats(rows.start == 0) { 0 } else { (rows.start + origin.1).saturating_sub(1) / 2 };
        let end = if repeats(rows.end == frame.1) { kept.end } else { (rows.end + origin.1) / 2 + 1 };
        let end = end.min(kept.end);
        self.analysis_of(gpu, 0, taps, start.max(kept.start).min(end)..end)
    }

    fn analysis_of(
        &self,
        gpu: &Gpu,
        level: usize,
        taps: Taps,
        rows: Range<usize>,
    ) -> Result<(Buffer, [u32; 3]), Error> {
        let step = gpu.uniform(&self.step(level, taps, &rows))?;
        let width = self.grid.sizes[level + 1].0;
        Ok((step, self.groups(width.div_ceil(2), rows.len().div_ceil(2))))
    }

    /// The pass that makes `level` from the level above it, and its workgroups.
    ///
    /// # Errors
    /// When the device fails.
    pub(in crate::methods) fn synthesis(&self, gpu: &Gpu, level: usize) -> Result<(Buffer, [u32; 3]), Error> {
        let rows = &self.made[level];
        let step = gpu.uniform(&self.step(level, [0.0; 2], rows))?;
        Ok((step, self.groups(corners(self.grid.sizes[level].0), corners(rows.len()))))
    }

    /// The pass that processes each sample of `level` independently, all channels at once; `level` is the coarser one of its
    /// [`Step`].
    ///
    /// # Errors
    /// When the device fails.
    pub(in crate::methods) fn each_of(&self, gpu: &Gpu, level: usize) -> Result<(Buffer, [u32; 3]), Error> {
        let rows = &self.kept[level];
        let step = gpu.uniform(&self.step(level - 1, [0.0; 2], rows))?;
        Ok((step, tiles(self.grid.sizes[level].0, rows.len(), TILE)))
    }

    fn groups(&self, width: usize, rows: usize) -> [u32; 3] {
        let [across, down, _] = tiles(width, rows, TILE);
        [across, down, self.channels as u32]
    }

    fn step(&self, fine: usize, [outer, inner]: Taps, rows: &Range<usize>) -> Step {
        let coarse = fine + 1;
        let [fine_size, coarse_size] = [fine, coarse].map(|level| self.grid.sizes[level]);
        Step {
            fine_width: fine_size.0 as i32,
            fine_height: fine_size.1 as i32,
            fine_first: self.kept[fine].start as i32,
            fine_rows: self.kept[fine].len() as i32,
            fine_start: self.starts[fine] as i32,
            coarse_width: coarse_size.0 as i32,
            coarse_height: coarse_size.1 as i32,
            coarse_first: self.kept[coarse].start as i32,
            coarse_rows: self.kept[coarse].len() as i32,
            coarse_start: self.starts[coarse] as i32,
            from_row: rows.start as i32,
            to_row: rows.end as i32,
            repeats: u32::from(self.grid.edge == Edge::Repeat),
            outer,
            inner,
        }
    }
}

/// Rows of each level that synthesis of these rows of level 0 needs.
fn made_rows(grid: &Grid, own: Range<usize>) -> Vec<Range<usize>> {
    let coarser = grid.sizes.iter().skip(1).scan(own.clone(), |rows, &(_, height)| {
        // An even row needs the coarse row before its own, an odd one the one after it.
        let start = rows.start.div_ceil(2).saturating_sub(1).min(height - 1);
        *rows = start..(rows.end / 2 + 1).min(height);
        Some(rows.clone())
    });
    iter::once(own).chain(coarser).collect()
}

/// Rows of each level that synthesis makes or that analysis of the level above needs.
fn kept_rows(grid: &Grid, made: &[Range<usize>]) -> Vec<Range<usize>> {
    let mut kept = made.to_vec();
    for level in (0..kept.len() - 1).rev() {
        let Range { start, end } = kept[level + 1];
        let needed = (2 * start).saturating_sub(1)..(2 * end + 1).min(grid.sizes[level].1);
        let own = &made[level];
        kept[level] = own.start.min(needed.start)..own.end.max(needed.end);
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_band_reads_no_more_rows_than_reach_says() {
        for (height, levels) in [(1, 3), (2, 1), (57, 2), (157, 3), (157, 9), (1080, 6)] {
            for edge in [Edge::Clear, Edge::Repeat] {
                let grid = Grid::new((33, height), levels, edge);
                for rows in [0..1, height / 2..height / 2 + 1, height - 1..height, height / 3..height] {
                    let finest = rows.start + grid.origin.1..rows.end + grid.origin.1;
                    let made = made_rows(&grid, finest);
                    let kept = kept_rows(&grid, &made);
                    let first = kept[0].start.saturating_sub(grid.origin.1);
                    let end = kept[0].end.saturating_sub(grid.origin.1).min(height);
                    assert!(first + reach(levels) >= rows.start, "{height} rows, {levels} levels: {first}");
                    assert!(end <= rows.end + reach(levels), "{height} rows, {levels} levels: {end}");
                }
            }
        }
    }

    #[test]
    fn the_whole_frame_stores_all_rows_of_every_level() {
        let grid = Grid::new((40, 32), 3, Edge::Repeat);
        let levels = Levels::new(grid, &(0..32), 5);
        assert_eq!(levels.kept, [0..32, 0..16, 0..8, 0..4]);
        assert_eq!((levels.starts[2], levels.values()), (5 * 20 * 16, 5 * (20 * 16 + 10 * 8 + 5 * 4)));
    }

    #[test]
    fn bands_together_have_every_row_of_every_level() {
        for (height, levels) in [(1, 3), (7, 1), (157, 4), (61, 7), (1080, 9)] {
            let grid = Grid::new((33, height), levels, Edge::Repeat);
            for count in [1, 3, 7] {
                let rows = (0..count).map(|i| i * height / count..(i + 1) * height / count);
                let bands = rows.filter(|rows| !rows.is_empty());
                let bands = bands.map(|rows| {
                    Levels::from_finest(grid.up_to(levels.min(3)), grid.rows_with_border(&rows), 1, 1)
                });
                let bands: Vec<Levels> = bands.collect();
                for level in 0..=levels.min(3) {
                    let has = |row| bands.iter().any(|band| band.kept[level].contains(&row));
                    assert!((0..grid.sizes[level].1).all(has), "{height} rows, level {level}, {count} bands");
                }
            }
        }
    }

    #[test]
    fn a_row_is_expanded_from_its_coarse_row_and_the_next_one() {
        let grid = Grid::new((8, 32), 1, Edge::Repeat);
        let coarse = |row: usize| made_rows(&grid, row..row + 1)[1].clone();
        assert_eq!([8, 9, 0, 31].map(coarse), [3..5, 4..6, 0..1, 15..16]);
    }
}
