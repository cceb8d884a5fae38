//! Splatting of points over the pixels of a picture (sections 3.3 and 3.4).
//!
//! Bands of picture rows are computed in parallel. A band scans the rows of points that reach it in a fixed order, by
//! row distance and then from left to right, so the result does not depend on the number of threads. A row of a
//! sprite is a span of weights over blocks of pixels. In most blocks the point falls into one layer as a whole.

use super::layers::{LANES, Layers, Light, Limits, Sum, add, blend};
use super::sprites::{Border, Centre, Place, Sprite, Sprites};
use crate::image::Plane;
use crate::parallel;
use pulp::{Arch, NullaryFnOnce};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Rows of a band: they share the sprite rows that they need.
const BAND_ROWS: usize = 8;

/// Rows of points per partial sum. One running sum over thousands of small terms would have a visible f32 error.
const ROWS_PER_SUM: usize = 32;

/// A point to be splatted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Point<const N: usize> {
    /// Column of its pixel, or of the left one of its four.
    pub column: i32,
    /// Its blur.
    pub sprite: Sprite,
    /// Its contribution.
    pub light: Light<N>,
}

/// Rows of points.
#[derive(Debug)]
pub(super) struct Grid<const N: usize> {
    /// Positions of the points in their pixels.
    pub centre: Centre,
    /// Points of each row, from left to right.
    pub rows: Vec<Vec<Point<N>>>,
}

impl<const N: usize> Grid<N> {
    /// The row of points whose first picture row is `y`, or the repeated row past the frame's border.
    pub(super) fn row_at(&self, y: i32, height: usize) -> Option<usize> {
        let (spacing, rows) = (self.centre.spacing(), self.rows.len());
        let row = y.div_euclid(spacing as i32);
        let is_row = y.rem_euclid(spacing as i32) == 0 && rows > 0;
        // A grid is repeated below the picture only if it ends at the picture's last row.
        let is_known = row < rows as i32 || rows * spacing == height;
        (is_row && is_known).then(|| (row.max(0) as usize).min(rows - 1))
    }

    /// Maximum reach of each row's points, in rows.
    fn reaches(&self) -> Vec<i32> {
        let reach =
            |row: usize| self.rows[row].iter().map(|point| point.reach(self.centre)).max().unwrap_or(-1);
        parallel::map(self.rows.len(), &reach)
    }
}

/// Splats `grids` into the layers given by `limits`; returns the content planes of the picture, and its coverage.
pub(super) fn splat<const N: usize>(
    grids: &[Grid<N>],
    sprites: &Sprites,
    limits: &[Limits],
    (width, height): (usize, usize),
    progress: &(dyn Fn(f32) + Sync),
) -> (Vec<Plane>, Plane) {
    let mut planes = vec![Plane::zeros(width, height); N + 1];
    let reaches: Vec<Vec<i32>> = grids.iter().map(Grid::reaches).collect();
    let mut chunks: Vec<_> =
        planes.iter_mut().map(|plane| plane.values_mut().chunks_mut(BAND_ROWS * width)).collect();
    let bands: Vec<Vec<&mut [f32]>> = (0..height.div_ceil(BAND_ROWS))
        .map(|_| chunks.iter_mut().filter_map(Iterator::next).collect())
        .collect();
    let done = AtomicUsize::new(0);
    let count = bands.len();
    parallel::for_each_with(
        bands.into_iter(),
        &|| Scratch::new((width, height)),
        &|scratch, band, mut rows_of_planes| {
            let rows = band * BAND_ROWS..((band + 1) * BAND_ROWS).min(height);
            scratch.clear(rows.len());
            for (grid, reaches) in grids.iter().zip(&reaches) {
                scratch.splat_grid(grid, reaches, sprites, (limits, rows.clone()));
            }
            scratch.blend(&mut rows_of_planes, width);
            progress((done.fetch_add(1, Ordering::Relaxed) + 1) as f32 / count as f32);
        },
    );
    let coverage = planes.pop().unwrap_or_default();
    (planes, coverage)
}

/// One row of a sprite, padded with a block of zeros at either end.
#[derive(Debug, Clone, Default)]
struct SpriteRow {
    /// Column of the first weight, relative to the sprite's own.
    first: i32,
    /// Round in which the row was computed.
    round: usize,
    padded: Vec<f32>,
}

/// Buffers that a thread reuses for all bands.
struct Scratch<const N: usize> {
    size: (usize, usize),
    blocks: usize,
    /// Partial sums of some rows of points, and total sums.
    partial: Vec<Layers<N>>,
    total: Vec<Layers<N>>,
    /// Indexed by [`Point::shape`].
    sprite_rows: Vec<SpriteRow>,
    weights: Vec<f32>,
    round: usize,
}

impl<const N: usize> Point<N> {
    /// Reach in rows from its pixel, or from the upper ones of its four.
    #[inline(always)]
    pub(super) fn reach(&self, centre: Centre) -> i32 {
        self.sprite.reach() + i32::from(centre == Centre::Corner)
    }

    /// Index of the point's sprite row: points at a border have sprites of their own.
    #[inline(always)]
    fn shape(&self, border: Border) -> usize {
        4 * usize::from(self.sprite.0) + 2 * usize::from(border.left) + usize::from(border.right)
    }

    /// On which sides it is repeated past the border of a picture `width` wide.
    #[inline(always)]
    pub(super) fn border(&self, centre: Centre, width: usize) -> Border {
        Border { left: self.column == 0, right: self.column as usize + centre.spacing() == width }
    }
}

impl<const N: usize> Scratch<N> {
    fn new((width, height): (usize, usize)) -> Self {
        Self {
            size: (width, height),
            blocks: width.div_ceil(LANES),
            partial: Vec::new(),
            total: Vec::new(),
            sprite_rows: Vec::new(),
            weights: Vec::new(),
            round: 0,
        }
    }

    /// Clears the sums for a band of `rows` rows.
    fn clear(&mut self, rows: usize) {
        for sums in [&mut self.partial, &mut self.total] {
            sums.clear();
            sums.resize(rows * self.blocks, [Sum::NONE; 3]);
        }
    }

    /// Splats all points of `grid` that reach the picture rows `rows`.
    fn splat_grid(
        &mut self,
        grid: &Grid<N>,
        reaches: &[i32],
        sprites: &Sprites,
        (limits, rows): (&[Limits], std::ops::Range<usize>),
    ) {
        let (width, height) = self.size;
        // At more than one picture height, repeated rows add no new term.
        let farthest = reaches.iter().copied().max().unwrap_or(-1).min(height as i32);
        for (count, down) in (-farthest..=farthest).enumerate() {
            self.round += 1;
            for (line, y) in rows.clone().enumerate() {
                let Some(source) = grid.row_at(y as i32 + down, height) else { continue };
                if reaches[source] < down.abs() {
                    continue;
                }
                let points = &grid.rows[source];
                self.update_sprite_rows(points, (sprites, grid.centre), down);
                Arch::new().dispatch(SplatRow {
                    points,
                    centre: grid.centre,
                    width,
                    sprite_rows: &self.sprite_rows,
                    limits: &limits[y * self.blocks..][..self.blocks],
                    sums: &mut self.partial[line * self.blocks..][..self.blocks],
                    row_distance: down.abs(),
                });
            }
            if count % ROWS_PER_SUM == ROWS_PER_SUM - 1 {
                self.flush();
            }
        }
        self.flush();
    }

    /// Computes the sprite rows that `points`, `down` rows below, need and this round does not have yet.
    fn update_sprite_rows(&mut self, points: &[Point<N>], (sprites, centre): (&Sprites, Centre), down: i32) {
        let (width, _) = self.size;
        for point in points.iter().filter(|point| point.reach(centre) >= down.abs()) {
            let border = point.border(centre, width);
            let shape = point.shape(border);
            if shape >= self.sprite_rows.len() {
                self.sprite_rows.resize(shape + 1, SpriteRow::default());
            }
            let row = &mut self.sprite_rows[shape];
            if row.round == self.round {
                continue;
            }
            row.round = self.round;
            let place = Place { centre, down: -down, border };
            row.first = sprites.row(point.sprite, &place, width as i32, &mut self.weights);
            row.padded.clear();
            row.padded.extend([0.0; LANES]);
            row.padded.extend(&self.weights);
            row.padded.extend([0.0; LANES]);
        }
    }

    fn flush(&mut self) {
        for (total, partial) in self.total.iter_mut().zip(&mut self.partial) {
            for (total, partial) in total.iter_mut().zip(partial) {
                total.add_sum(partial);
                *partial = Sum::NONE;
            }
        }
    }

    /// Blends the layers of the band's pixels into the rows of content and, last, coverage.
    fn blend(&self, planes: &mut [&mut [f32]], width: usize) {
        let rows = planes.first().map_or(0, |plane| plane.len() / width);
        for (y, x) in (0..rows).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let blended = blend(&self.total[y * self.blocks + x / LANES], x % LANES);
            let (content, coverage) = blended.unwrap_or(([0.0; N], 0.0));
            let values = content.into_iter().chain([coverage]);
            planes.iter_mut().zip(values).for_each(|(plane, value)| plane[y * width + x] = value);
        }
    }
}

/// Splats a row of points into a row of pixels; compiled for each instruction set.
struct SplatRow<'a, const N: usize> {
    points: &'a [Point<N>],
    centre: Centre,
    /// Width of the picture.
    width: usize,
    sprite_rows: &'a [SpriteRow],
    limits: &'a [Limits],
    sums: &'a mut [Layers<N>],
    /// Distance of the two rows.
    row_distance: i32,
}

impl<const N: usize> NullaryFnOnce for SplatRow<'_, N> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { points, centre, width, sprite_rows, limits, sums, row_distance } = self;
        let pixels = (sums.len() * LANES) as i32;
        for point in points.iter().filter(|point| point.reach(centre) >= row_distance) {
            let shape = point.shape(point.border(centre, width));
            let SpriteRow { first, padded, .. } = &sprite_rows[shape];
            let begin = point.column + first;
            let end = begin + (padded.len() - 2 * LANES) as i32;
            let (from, to) = (begin.max(0), end.min(pixels));
            if from >= to {
                continue;
            }
            let blocks = from as usize / LANES..=(to as usize - 1) / LANES;
            for block in blocks {
                let weights = ((block * LANES + LANES) as i32 - begin) as usize;
                let Some(weights) = padded[weights..].first_chunk() else { continue };
                add(&mut sums[block], weights, &point.light, &limits[block]);
            }
        }
    }
}
