//! N-buffers: the minimum over any window of a grid, in a few look-ups.
//!
//! Décoret 2005, "N-Buffers for efficient depth map query": level `n` holds at each cell the minimum over the square of
//! `2ⁿ` cells that begins there, clipped to the grid. Any square is the union of four overlapping squares of one
//! level, any rectangle of as many as it is longer than wide. Maxima are the minima of the negated values.
//!
//! Memory: cells × levels.

use std::ops::Range;

/// A rectangle of cells; not empty.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::methods) struct Window {
    /// Columns.
    pub x: Range<usize>,
    /// Rows.
    pub y: Range<usize>,
}

/// Minima over squares of a grid.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::methods) struct NBuffer {
    width: usize,
    height: usize,
    /// `[level][row][column]`; level 0 is the grid itself.
    levels: Vec<Vec<f32>>,
}

impl NBuffer {
    /// The N-buffer of `width × height` `values`, row by row, for windows of up to `longest` cells; larger windows take more
    /// look-ups.
    pub(in crate::methods) fn new(width: usize, values: Vec<f32>, longest: usize) -> Self {
        let height = values.len() / width.max(1);
        let mut levels = vec![values];
        while (2 << (levels.len() - 1)) <= longest.min(width.max(height)) {
            levels.push(doubled(&levels[levels.len() - 1], width, 1 << (levels.len() - 1)));
        }
        Self { width, height, levels }
    }

    /// The minimum over `window`, which has to lie within the grid.
    #[inline]
    pub(in crate::methods) fn least(&self, window: &Window) -> f32 {
        let shorter = window.x.len().min(window.y.len());
        let level = (shorter.ilog2() as usize).min(self.levels.len() - 1);
        let (values, side) = (&self.levels[level], 1 << level);
        let mut minimum = f32::INFINITY;
        for y in starts(&window.y, side) {
            for x in starts(&window.x, side) {
                minimum = minimum.min(values[y * self.width + x]);
            }
        }
        minimum
    }

    /// All minima, `[level][row][column]`; level 0 is the grid itself.
    #[cfg(feature = "gpu")]
    pub(in crate::methods) fn levels(&self) -> &[Vec<f32>] {
        &self.levels
    }

    /// Width and height in cells.
    pub(in crate::methods) fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }
}

/// Starts of squares of `side` that together cover `range`; the last one ends at its end.
#[inline]
fn starts(range: &Range<usize>, side: usize) -> impl Iterator<Item = usize> + use<> {
    let last = range.end - side;
    range.clone().step_by(side).map(move |start| start.min(last))
}

/// Minima over squares twice as wide as `side`, from those over squares of `side`.
fn doubled(values: &[f32], width: usize, side: usize) -> Vec<f32> {
    let height = values.len() / width;
    let mut result = Vec::with_capacity(values.len());
    for y in 0..height {
        let below = (y + side).min(height - 1);
        for x in 0..width {
            let right = (x + side).min(width - 1);
            let upper = values[y * width + x].min(values[y * width + right]);
            let lower = values[below * width + x].min(values[below * width + right]);
            result.push(upper.min(lower));
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_minimum_of_any_window_is_that_over_all_of_its_cells() {
        for (width, height) in [(1, 1), (1, 6), (13, 9), (16, 3)] {
            let value = |i: usize| ((i * 7919) % 101) as f32 - 50.0;
            let values: Vec<f32> = (0..width * height).map(value).collect();
            for longest in [1, 3, 64] {
                let buffer = NBuffer::new(width, values.clone(), longest);
                for (x0, y0) in (0..width * height).map(|i| (i % width, i / width)) {
                    for (x1, y1) in (x0..width).flat_map(|x| (y0..height).map(move |y| (x + 1, y + 1))) {
                        let all = (y0..y1).flat_map(|y| (x0..x1).map(move |x| y * width + x));
                        let expected = all.map(|i| values[i]).fold(f32::INFINITY, f32::min);
                        let window = Window { x: x0..x1, y: y0..y1 };
                        assert_eq!(buffer.least(&window), expected, "{window:?}, longest {longest}");
                    }
                }
            }
        }
    }
}
