//! Blocks of samples.

use crate::parallel;
use crate::scene::Layer;
use std::ops::Range;

/// Columns and rows of a block.
pub(super) const BLOCK: usize = 8;

/// Blocks of a picture, row by row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    pub(super) columns: usize,
    pub(super) rows: usize,
}

/// The column and the row of a block.
pub(super) type Place = [usize; 2];

impl Grid {
    /// The blocks of `layer`.
    pub(super) fn of(layer: &Layer) -> Self {
        Self { columns: layer.width().div_ceil(BLOCK), rows: layer.height().div_ceil(BLOCK) }
    }

    /// `value` of all blocks.
    pub(super) fn map<T: Send>(self, value: impl Fn(Place) -> T + Sync) -> Vec<T> {
        parallel::flat_map(self.rows, &|y| (0..self.columns).map(|x| value([x, y])).collect())
    }

    /// The columns and the rows that are at most `radius` away from `place`.
    pub(super) fn window(self, [x, y]: Place, radius: usize) -> [Range<usize>; 2] {
        let around = |at: usize, count: usize| at.saturating_sub(radius)..(at + radius + 1).min(count);
        [around(x, self.columns), around(y, self.rows)]
    }

    /// The indices of the blocks there.
    pub(super) fn around(self, place: Place, radius: usize) -> impl Iterator<Item = usize> {
        let [columns, rows] = self.window(place, radius);
        rows.flat_map(move |y| columns.clone().map(move |x| y * self.columns + x))
    }
}
