//! Points in square blocks of pixels, and the blocks that reach each region of the picture.

use super::super::layers::Light;
use super::super::splat::{Grid, Point};
use super::super::sprites::Centre;
use super::weights::WeightTable;
use crate::parallel;
use std::ops::Range;

/// Side of a block in pixels. The shader has two bits for a position in it and eight bits for the number of points:
/// at most 16 visible, 16 hidden and 4 reduced ones.
pub(super) const BLOCK: usize = 4;

/// Side of a region in pixels: all pixels of a region visit the same blocks.
pub(super) const REGION: usize = 64;

/// A point in the shader's format.
#[derive(Debug, Clone, Copy)]
struct Packed {
    /// Column of its block.
    column: usize,
    /// Reach in rows.
    reach: u32,
    light: [f32; 4],
    shape: [u32; 4],
}

/// The points of some rows of a picture, with their repetitions past its border.
#[derive(Debug)]
pub(super) struct Blocks {
    /// Content of each point.
    pub lights: Vec<[f32; 4]>,
    /// CoC radius, alpha, weight index and packed bits of each point.
    pub shapes: Vec<[u32; 4]>,
    /// Per block: first point; number of points in the low 8 bits, reach above.
    pub blocks: Vec<[u32; 2]>,
    /// Blocks per row.
    pub blocks_across: usize,
    /// Column and row of the first block's first pixel.
    pub origin: [i32; 2],
}

impl Blocks {
    /// The points of `grids` in the rows `rows`. Rows may lie outside of the picture of `size`, where points are
    /// repeated.
    pub(super) fn new<const N: usize>(
        grids: &[Grid<N>],
        rows: Range<i32>,
        size: (usize, usize),
        table: &WeightTable,
    ) -> Self {
        let points = rows.clone().flat_map(|y| points_in_row(grids, y, size).map(|(point, ..)| point));
        let margin = points.map(|point| border_reach(point, size)).max().unwrap_or(0).next_multiple_of(BLOCK);
        let row = |start: i32| {
            points_of_block_row(grids, start..(start + BLOCK as i32).min(rows.end), size, (margin, table))
        };
        let starts: Vec<i32> = rows.clone().step_by(BLOCK).collect();
        let block_rows: Vec<Vec<Packed>> = parallel::map(starts.len(), &|number| row(starts[number]));
        let mut blocks = Self {
            lights: Vec::new(),
            shapes: Vec::new(),
            blocks: Vec::new(),
            blocks_across: (2 * margin + size.0).div_ceil(BLOCK),
            origin: [-(margin as i32), rows.start],
        };
        block_rows.iter().for_each(|row| blocks.append(row));
        blocks
    }

    /// Appends a row of blocks.
    fn append(&mut self, points: &[Packed]) {
        let mut rest = points;
        for column in 0..self.blocks_across {
            let count = rest.iter().take_while(|point| point.column == column).count();
            let (block_points, rest_points) = rest.split_at(count);
            let reach = block_points.iter().map(|point| point.reach).max().unwrap_or(0);
            self.blocks.push([self.lights.len() as u32, count as u32 | reach << 8]);
            self.lights.extend(block_points.iter().map(|point| point.light));
            self.shapes.extend(block_points.iter().map(|point| point.shape));
            rest = rest_points;
        }
    }

    /// Maximum number of points in a block.
    pub(super) fn max_points(&self) -> usize {
        self.blocks.iter().map(|[_, packed]| packed & 255).max().unwrap_or(0) as usize
    }

    /// For each region of the picture rows `rows`, the range of blocks that contains all blocks that reach it:
    /// columns, then rows.
    pub(super) fn windows(&self, rows: Range<usize>, width: usize) -> Vec<[u32; 4]> {
        let regions_across = width.div_ceil(REGION);
        let mut windows = vec![[u32::MAX, 0, u32::MAX, 0]; regions_across * rows.len().div_ceil(REGION)];
        let [left, top] = [self.origin[0], self.origin[1] - rows.start as i32];
        for (at, &[_, packed]) in self.blocks.iter().enumerate().filter(|(_, block)| block[1] & 255 > 0) {
            let (x, y) = (at % self.blocks_across, at / self.blocks_across);
            let reach = (packed >> 8) as i32;
            for region_y in regions(top + (y * BLOCK) as i32, reach, rows.len()) {
                for region_x in regions(left + (x * BLOCK) as i32, reach, width) {
                    include_block(&mut windows[region_y * regions_across + region_x], x as u32, y as u32);
                }
            }
        }
        windows
    }
}

/// The regions of `count` pixels that a block starting at pixel `start` reaches.
fn regions(start: i32, reach: i32, count: usize) -> Range<usize> {
    let from = (start - reach).max(0) as usize;
    let to = ((start + BLOCK as i32 + reach).max(0) as usize).min(count);
    if from < to { from / REGION..to.div_ceil(REGION) } else { 0..0 }
}

/// Extends a window to include block `x, y`.
fn include_block([from_x, to_x, from_y, to_y]: &mut [u32; 4], x: u32, y: u32) {
    (*from_x, *to_x) = ((*from_x).min(x), (*to_x).max(x + 1));
    (*from_y, *to_y) = ((*from_y).min(y), (*to_y).max(y + 1));
}

/// The points whose first row is `y`, in the picture or past its border, with their grids' centres.
fn points_in_row<const N: usize>(
    grids: &[Grid<N>],
    y: i32,
    (_, height): (usize, usize),
) -> impl Iterator<Item = (&Point<N>, Centre)> {
    let rows_past_border = (-y).max(y - height as i32 + 1).max(0);
    let rows = grids.iter().filter_map(move |grid| Some((grid, grid.row_at(y, height)?)));
    let points = rows.flat_map(|(grid, row)| grid.rows[row].iter().map(|point| (point, grid.centre)));
    points.filter(move |(point, centre)| point.reach(*centre) >= rows_past_border)
}

/// Number of points in row `y` of a picture, with repetitions to its left and right.
pub(super) fn count_in_row<const N: usize>(grids: &[Grid<N>], y: usize, size: (usize, usize)) -> usize {
    points_in_row(grids, y as i32, size)
        .map(|(point, centre)| repeated_columns(point, centre, size).count())
        .sum()
}

/// Number of columns past the picture's border from which a point's repetitions reach the picture.
fn border_reach<const N: usize>(point: &Point<N>, (width, _): (usize, usize)) -> usize {
    (point.sprite.reach() as usize).min(width) + 1
}

/// The columns of a point and of its repetitions past the picture's border.
fn repeated_columns<const N: usize>(
    point: &Point<N>,
    centre: Centre,
    size: (usize, usize),
) -> impl Iterator<Item = i32> + use<N> {
    let (spacing, own_column) = (centre.spacing() as i32, point.column);
    let border = point.border(centre, size.0);
    let [left, right] = [border.left, border.right]
        .map(|is_repeated| if is_repeated { border_reach(point, size) as i32 / spacing } else { 0 });
    (-left..=right).map(move |repetition| own_column + repetition * spacing)
}

/// The points of a row of blocks, block by block, and in a block each grid row by row. The first block begins
/// `margin` columns left of the picture.
fn points_of_block_row<const N: usize>(
    grids: &[Grid<N>],
    rows: Range<i32>,
    size: (usize, usize),
    (margin, table): (usize, &WeightTable),
) -> Vec<Packed> {
    let mut points = Vec::new();
    for y in rows.clone() {
        for (point, centre) in points_in_row(grids, y, size) {
            let places = repeated_columns(point, centre, size)
                .map(|column| [(column + margin as i32) as usize, (y - rows.start) as usize]);
            points.extend(places.map(|place| pack(point, centre, place, table)));
        }
    }
    // A stable sort: points of a block keep their order.
    points.sort_by_key(|point| point.column);
    points
}

/// Packs `point` of a grid about `centre`, at a column and a row relative to the first block.
fn pack<const N: usize>(point: &Point<N>, centre: Centre, [x, y]: [usize; 2], table: &WeightTable) -> Packed {
    let place = (x % BLOCK) as u32 | (y as u32) << 2;
    let corner = u32::from(centre == Centre::Corner);
    let flags = corner | u32::from(point.light.hidden) << 1 | u32::from(point.sprite.0 & 1) << 2;
    let rest = place | flags << 4 | (point.sprite.reach() as u32) << 7;
    let Light { content, alpha, coc_px, .. } = &point.light;
    Packed {
        column: x / BLOCK,
        reach: point.reach(centre) as u32,
        light: std::array::from_fn(|k| content.get(k).copied().unwrap_or(0.0)),
        shape: [coc_px.to_bits(), alpha.to_bits(), table.centre_index(point, centre), rest],
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::sprites::Sprite;
    use super::*;

    /// A grid of points of CoC radius `coc_px(x, y)`, without points where that is NaN.
    fn grid(width: usize, height: usize, coc_px: impl Fn(usize, usize) -> f32) -> Grid<1> {
        let point = |x: usize, coc_px: f32| Point {
            column: x as i32,
            sprite: Sprite::from_coc_px(coc_px),
            light: Light { content: [x as f32], alpha: 1.0, coc_px, hidden: false },
        };
        let row = |y: usize| {
            let columns = (0..width).map(|x| (x, coc_px(x, y))).filter(|(_, coc_px)| !coc_px.is_nan());
            columns.map(|(x, coc_px)| point(x, coc_px)).collect()
        };
        Grid { centre: Centre::Pixel, rows: (0..height).map(row).collect() }
    }

    fn blocks(grid: &Grid<1>, rows: Range<i32>, width: usize) -> Blocks {
        let points = grid.rows.iter().flatten().map(|point| (point, grid.centre));
        let size = (width, grid.rows.len());
        Blocks::new(std::slice::from_ref(grid), rows, size, &WeightTable::new(points, size))
    }

    fn counts(blocks: &Blocks) -> Vec<u32> {
        blocks.blocks.iter().map(|block| block[1] & 255).collect()
    }

    #[test]
    fn every_point_is_in_the_block_of_its_pixel_row_by_row() {
        let inner = |x, y| if (1..6).contains(&x) && x != 2 { y as f32 } else { f32::NAN };
        let blocks = blocks(&grid(7, 9, inner), 1..7, 7);
        // A margin for radius 6, which reaches 7 pixels plus half a corner, left and right; four rows, and two.
        assert_eq!((blocks.blocks_across, blocks.origin), (6, [-8, 1]));
        assert_eq!(counts(&blocks), [0, 0, 8, 8, 0, 0, 0, 0, 4, 4, 0, 0]);
        let columns: Vec<f32> = blocks.lights[..4].iter().map(|light| light[0]).collect();
        assert_eq!(columns, [1.0, 3.0, 1.0, 3.0]);
        // CoC radius 4 in the last row of the first blocks, 6 in the last row: 4.7 and 6.7 pixels.
        assert_eq!([blocks.blocks[2][1] >> 8, blocks.blocks[8][1] >> 8], [5, 7]);
        assert_eq!(blocks.max_points(), 8);
    }

    #[test]
    fn a_point_at_the_border_is_repeated_past_it_as_far_as_it_reaches_back() {
        // Radius 2 reaches 3 pixels.
        let corner = |x, y| if (x, y) == (0, 0) { 2.0 } else { f32::NAN };
        let blocks = blocks(&grid(9, 9, corner), -8..9, 9);
        // Five blocks per row, from four pixels outside. The point and four repetitions to its left; the same in
        // three rows above.
        assert_eq!(counts(&blocks)[..5], [0; 5]);
        assert_eq!(counts(&blocks)[5..15], [12, 3, 0, 0, 0, 4, 1, 0, 0, 0]);
        assert_eq!(count_in_row(&[grid(9, 9, corner)], 0, (9, 9)), 5);
    }

    #[test]
    fn a_window_has_every_block_that_reaches_its_region_and_is_empty_otherwise() {
        let far = |x, y| match (x, y) {
            (70, 2) => 8.0,
            (150, 100) => 30.0,
            _ => f32::NAN,
        };
        let blocks = blocks(&grid(200, 128, far), 0..128, 200);
        let windows = blocks.windows(0..128, 200);
        let none = [u32::MAX, 0, u32::MAX, 0];
        // A margin of 32 pixels is eight blocks. 70 ± 9 is in the first two regions; 150 ± 31 in two more, and not
        // above row 64.
        assert_eq!(windows[..4], [[25, 26, 0, 1], [25, 26, 0, 1], none, none]);
        assert_eq!(windows[4..], [none, [45, 46, 25, 26], [45, 46, 25, 26], none]);
        assert_eq!(blocks.windows(90..128, 200), [none, [45, 46, 25, 26], [45, 46, 25, 26], none]);
    }
}
