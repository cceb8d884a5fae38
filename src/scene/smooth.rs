//! Colours of an estimated surface, smoothed the more the farther the fragments are that they come from.
//!
//! A colour that comes from afar is known in a few directions only, and would show them as streaks. It is the mean of the estimated
//! fragments of the same surface around it, over a width that grows with the distance: from a pyramid, continuously.

use super::surface::{CELL_PX, CELL_SHARE};
use crate::parallel;

/// An estimated fragment.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Guess {
    /// Unpremultiplied colour.
    pub(super) color: [f32; 3],
    /// CoC radius in picture pixels.
    pub(super) coc_px: f32,
    /// Coverage, 0 … 1; nothing is estimated where it is 0.
    pub(super) alpha: f32,
    /// Distance to the nearest fragment of its surface, in pixels.
    pub(super) distance_px: f32,
}

/// The estimated fragments of a row, with their columns.
pub(super) type Row = Vec<(usize, Guess)>;

/// Half-width of the mean as a share of the distance.
const WIDTH_SHARE: f32 = 0.25;

/// Largest number of levels of the pyramid.
const LEVELS: usize = 7;

/// The fragments of a cell: sums of their colours and CoC radii, and their number.
#[derive(Debug, Clone, Copy, Default)]
struct Cell {
    color: [f32; 3],
    /// In the finished pyramid the mean of the CoC radii.
    coc_px: f32,
    count: f32,
}

impl Cell {
    fn add(&mut self, color: [f32; 3], coc_px: f32, count: f32) {
        self.color.iter_mut().zip(color).for_each(|(sum, value)| *sum += value);
        self.coc_px += coc_px;
        self.count += count;
    }
}

/// One level: `width × height` cells, row by row.
struct Level {
    width: usize,
    height: usize,
    cells: Vec<Cell>,
}

/// A pyramid over estimated fragments, from cells of two pixels on.
pub(super) struct Smooth(Vec<Level>);

impl Smooth {
    /// The pyramid of `rows` of `width` pixels.
    pub(super) fn new(rows: &[&[(usize, Guess)]], width: usize) -> Self {
        let mut levels = vec![finest(rows, width)];
        while let Some(last) = levels.last()
            && last.width.max(last.height) > 1
            && levels.len() < LEVELS
        {
            levels.push(coarser(last));
        }
        for cell in levels.iter_mut().flat_map(|level| &mut level.cells).filter(|cell| cell.count > 0.0) {
            cell.coc_px /= cell.count;
        }
        Self(levels)
    }

    /// The smoothed colour of the fragment `guess` at a place, unpremultiplied.
    pub(super) fn color(&self, place: (usize, usize), guess: &Guess) -> [f32; 3] {
        let level = (WIDTH_SHARE * guess.distance_px).max(1.0).log2();
        let finer = (level as usize).min(self.0.len() - 1);
        let share = (level - finer as f32).min(1.0);
        let near = if finer == 0 { guess.color } else { self.0[finer - 1].mean(finer, place, guess) };
        if share <= 0.0 {
            return near;
        }
        let far = self.0[finer].mean(finer + 1, place, guess);
        std::array::from_fn(|k| near[k] + share * (far[k] - near[k]))
    }
}

impl Level {
    /// The mean colour around a place of the fragments on the surface of `guess`; this is level number `level`, of cells of
    /// `2^level` pixels.
    fn mean(&self, level: usize, (x, y): (usize, usize), guess: &Guess) -> [f32; 3] {
        let size = (1 << level) as f32;
        let [x, y] = [x, y].map(|at| (at as f32 + 0.5) / size - 0.5);
        let cell_px = CELL_PX.max(CELL_SHARE * guess.coc_px.abs());
        // The fragment itself has a little weight, so that there is always a mean.
        const OWN: f32 = 1e-4;
        let (mut sum, mut total) = (guess.color.map(|value| OWN * value), OWN);
        for (row, weight_y) in taps(y, self.height) {
            for (column, weight_x) in taps(x, self.width) {
                let cell = &self.cells[row * self.width + column];
                if cell.count <= 0.0 {
                    continue;
                }
                let apart = (cell.coc_px - guess.coc_px).abs() / cell_px;
                let weight = weight_x * weight_y * (1.0 - 0.5 * apart).max(0.0) / (size * size);
                sum.iter_mut().zip(cell.color).for_each(|(sum, value)| *sum += weight * value);
                total += weight * cell.count;
            }
        }
        sum.map(|sum| sum / total)
    }
}

/// The cells around a cell coordinate, of `size` cells, with their weights: a parabola 1.5 cells wide on either side.
fn taps(at: f32, size: usize) -> impl Iterator<Item = (usize, f32)> {
    let first = (at - 0.5).floor() as isize;
    (first..first + 3).filter_map(move |cell| {
        let index = usize::try_from(cell).ok().filter(|&index| index < size)?;
        let apart = (at - cell as f32) / 1.5;
        Some((index, (1.0 - apart * apart).max(0.0)))
    })
}

/// The level of cells of two pixels.
fn finest(rows: &[&[(usize, Guess)]], width: usize) -> Level {
    let (width, height) = (width.div_ceil(2), rows.len().div_ceil(2));
    let mut cells = vec![Cell::default(); width * height];
    parallel::for_each_row(&mut cells, width, &|y, cells| {
        for (x, guess) in rows.iter().skip(2 * y).take(2).copied().flatten() {
            cells[x / 2].add(guess.color, guess.coc_px, 1.0);
        }
    });
    Level { width, height, cells }
}

/// The next coarser level.
fn coarser(level: &Level) -> Level {
    let (width, height) = (level.width.div_ceil(2), level.height.div_ceil(2));
    let mut cells = vec![Cell::default(); width * height];
    let finer = level.cells.chunks(2 * level.width.max(1));
    parallel::for_each(cells.chunks_mut(width.max(1)).zip(finer), &|_, (cells, finer)| {
        for (i, child) in finer.iter().enumerate() {
            cells[i % level.width / 2].add(child.color, child.coc_px, child.count);
        }
    });
    Level { width, height, cells }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The smoothed red of the fragment at `x, 32` of 64 × 64 fragments.
    fn smoothed(guess: impl Fn(usize, usize) -> Guess, x: usize) -> f32 {
        let rows: Vec<Vec<(usize, Guess)>> =
            (0..64).map(|y| (0..64).map(|x| (x, guess(x, y))).collect()).collect();
        let rows: Vec<&[(usize, Guess)]> = rows.iter().map(Vec::as_slice).collect();
        Smooth::new(&rows, 64).color((x, 32), &guess(x, 32))[0]
    }

    fn guess(red: f32, coc_px: f32, distance_px: f32) -> Guess {
        Guess { color: [red, 0.0, 0.0], coc_px, alpha: 1.0, distance_px }
    }

    #[test]
    fn one_colour_stays_and_a_fragment_beside_its_source_keeps_its_own() {
        for distance in [1.0, 3.0, 10.0, 40.0, 1000.0] {
            assert!((smoothed(|_, _| guess(0.7, 4.0, distance), 20) - 0.7).abs() < 1e-5, "{distance} px");
        }
        let dots = |x: usize, _: usize| guess(f32::from(u8::from(x.is_multiple_of(2))), 4.0, 1.0);
        assert_eq!([smoothed(dots, 20), smoothed(dots, 21)], [1.0, 0.0]);
    }

    #[test]
    fn streaks_from_afar_are_smoothed_and_another_surface_is_not_mixed_in() {
        let streaks = |x: usize, _: usize| guess(f32::from(u8::from(x.is_multiple_of(4))), 4.0, 40.0);
        for x in 20..40 {
            assert!((smoothed(streaks, x) - 0.25).abs() < 0.05, "column {x}: {}", smoothed(streaks, x));
        }
        let sides = |x: usize, _: usize| if x < 32 { guess(1.0, 2.0, 8.0) } else { guess(0.0, 12.0, 8.0) };
        assert!(smoothed(sides, 30) > 0.99 && smoothed(sides, 33) < 0.01);
    }

    #[test]
    fn the_width_grows_with_the_distance_by_degrees() {
        let edge = |distance: f32| smoothed(|x, _| guess(f32::from(u8::from(x < 32)), 4.0, distance), 31);
        let reds: Vec<f32> = (0..400).map(|i| edge(1.01_f32.powi(i))).collect();
        let steps = reds.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        assert!(steps.fold(0.0, f32::max) < 0.02);
    }
}
