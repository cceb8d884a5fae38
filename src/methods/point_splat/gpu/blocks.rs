//! Points in square blocks of pixels, and which blocks reach which regions of the picture.

use super::super::splat::{Grid, Point};
use super::super::sprites::Centre;
use super::weights::Table;
use rayon::prelude::*;
use std::ops::Range;

/// Pixels along the side of a block. The shader's two bits hold a place in it, its eight bits the number of points: 16 visible,
/// 16 hidden and 4 reduced ones at most.
pub(super) const BLOCK: usize = 4;

/// Pixels along the side of a region: those of a region look at the same blocks.
pub(super) const REGION: usize = 64;

/// A point as the shader reads it.
#[derive(Debug, Clone, Copy)]
struct Packed {
    /// Column of its block.
    column: usize,
    /// How far it reaches.
    reach: u32,
    light: [f32; 4],
    shape: [u32; 4],
}

impl Packed {
    /// `point` of a grid about `centre`, in row `line` of its block.
    fn new<const N: usize>(point: &Point<N>, centre: Centre, line: usize, table: &Table) -> Self {
        let column = point.column as usize;
        let corner = u32::from(centre == Centre::Corner);
        let place = (column % BLOCK) as u32 | (line as u32) << 2;
        let flags = corner | u32::from(point.light.hidden) << 1 | u32::from(point.sprite.0 & 1) << 2;
        let packed = place | flags << 4 | (point.sprite.reach() as u32) << 7;
        let content = &point.light.content;
        Self {
            column: column / BLOCK,
            reach: point.reach(centre) as u32,
            light: std::array::from_fn(|k| content.get(k).copied().unwrap_or(0.0)),
            shape: [
                point.light.coc_px.to_bits(),
                point.light.alpha.to_bits(),
                table.own(point, centre),
                packed,
            ],
        }
    }
}

/// The points of some rows of a picture.
#[derive(Debug, Default)]
pub(super) struct Blocks {
    /// Content of each point.
    pub lights: Vec<[f32; 4]>,
    /// The rest of it.
    pub shapes: Vec<[u32; 4]>,
    /// First point of each block, and their number below how far they reach.
    pub blocks: Vec<[u32; 2]>,
    /// Blocks beside one another.
    pub across: usize,
}

impl Blocks {
    /// The points of `grids` in the picture rows `source`, of pictures `width` wide.
    pub(super) fn new<const N: usize>(
        grids: &[Grid<N>],
        source: Range<usize>,
        width: usize,
        table: &Table,
    ) -> Self {
        let starts: Vec<usize> = source.clone().step_by(BLOCK).collect();
        let row = |start: usize| sorted(grids, start..(start + BLOCK).min(source.end), table);
        let rows: Vec<Vec<Packed>> = starts.into_par_iter().map(row).collect();
        let mut blocks = Self { across: width.div_ceil(BLOCK), ..Self::default() };
        rows.iter().for_each(|row| blocks.append(row));
        blocks
    }

    /// Adds a row of blocks.
    fn append(&mut self, points: &[Packed]) {
        let mut rest = points;
        for column in 0..self.across {
            let count = rest.iter().take_while(|point| point.column == column).count();
            let (own, others) = rest.split_at(count);
            let reach = own.iter().map(|point| point.reach).max().unwrap_or(0);
            self.blocks.push([self.lights.len() as u32, count as u32 | reach << 8]);
            self.lights.extend(own.iter().map(|point| point.light));
            self.shapes.extend(own.iter().map(|point| point.shape));
            rest = others;
        }
    }

    /// For each region of the picture rows `rows`, the blocks among which all are that reach it: columns, then rows. `source` is
    /// the first picture row of the blocks.
    pub(super) fn windows(&self, source: usize, rows: Range<usize>, width: usize) -> Vec<[u32; 4]> {
        let across = width.div_ceil(REGION);
        let mut windows = vec![[u32::MAX, 0, u32::MAX, 0]; across * rows.len().div_ceil(REGION)];
        for (at, &[_, packed]) in self.blocks.iter().enumerate() {
            let (x, y, reach) = (at % self.across, at / self.across, (packed >> 8) as usize);
            // From the band's first row; what ends above it reaches none.
            let below = (source + (y + 1) * BLOCK + reach).saturating_sub(rows.start).min(rows.len());
            if packed & 255 == 0 || below == 0 {
                continue;
            }
            let above = (source + y * BLOCK).saturating_sub(rows.start + reach);
            let columns = (x * BLOCK).saturating_sub(reach)..((x + 1) * BLOCK + reach).min(width);
            for region_y in above / REGION..below.div_ceil(REGION) {
                for region_x in columns.start / REGION..columns.end.div_ceil(REGION) {
                    widen(&mut windows[region_y * across + region_x], x as u32, y as u32);
                }
            }
        }
        windows
    }
}

/// Makes room for block `x, y` in a window.
fn widen([from_x, to_x, from_y, to_y]: &mut [u32; 4], x: u32, y: u32) {
    (*from_x, *to_x) = ((*from_x).min(x), (*to_x).max(x + 1));
    (*from_y, *to_y) = ((*from_y).min(y), (*to_y).max(y + 1));
}

/// The points of a row of blocks, block by block, each grid's row by row.
fn sorted<const N: usize>(grids: &[Grid<N>], rows: Range<usize>, table: &Table) -> Vec<Packed> {
    let mut points = Vec::new();
    for grid in grids {
        for y in rows.clone() {
            let packed = |point| Packed::new(point, grid.centre, y - rows.start, table);
            points.extend(grid.row(y).iter().map(packed));
        }
    }
    // Each row is in order already, and points of a block stay in theirs.
    points.sort_by_key(|point| point.column);
    points
}

#[cfg(test)]
mod tests {
    use super::super::super::layers::Light;
    use super::super::super::sprites::Sprite;
    use super::*;

    /// A grid of points of CoC radius `coc_px(x, y)`, none where that is not a number.
    fn grid(width: usize, height: usize, coc_px: impl Fn(usize, usize) -> f32) -> Grid<1> {
        let point = |x: usize, coc_px: f32| Point {
            column: x as i32,
            sprite: Sprite::of(coc_px),
            light: Light { content: [x as f32], alpha: 1.0, coc_px, hidden: false },
        };
        let row = |y: usize| {
            let columns = (0..width).map(|x| (x, coc_px(x, y))).filter(|(_, coc_px)| !coc_px.is_nan());
            columns.map(|(x, coc_px)| point(x, coc_px)).collect()
        };
        Grid { centre: Centre::Pixel, rows: (0..height).map(row).collect() }
    }

    fn blocks(grid: &Grid<1>, source: Range<usize>, width: usize) -> Blocks {
        let points = grid.rows.iter().flatten().map(|point| (point, grid.centre));
        let table = Table::new(points, (width, grid.rows.len()));
        Blocks::new(std::slice::from_ref(grid), source, width, &table)
    }

    #[test]
    fn every_point_is_in_the_block_of_its_pixel_row_by_row() {
        let blocks = blocks(&grid(6, 7, |x, y| if x == 1 { f32::NAN } else { y as f32 }), 1..7, 6);
        let counts: Vec<u32> = blocks.blocks.iter().map(|block| block[1] & 255).collect();
        // Four rows of three and two points, then two rows.
        assert_eq!((counts, blocks.across), (vec![12, 8, 6, 4], 2));
        let columns: Vec<f32> = blocks.lights[..6].iter().map(|light| light[0]).collect();
        assert_eq!(columns, [0.0, 2.0, 3.0, 0.0, 2.0, 3.0]);
        // CoC radius 6, in the last row: 6.7 pixels.
        assert_eq!(blocks.blocks.iter().map(|block| block[1] >> 8).collect::<Vec<_>>(), [5, 5, 7, 7]);
    }

    #[test]
    fn a_window_has_every_block_that_reaches_its_region_and_none_where_nothing_does() {
        let far = |x, y| match (x, y) {
            (70, 2) => 8.0,
            (150, 100) => 30.0,
            _ => f32::NAN,
        };
        let blocks = blocks(&grid(200, 128, far), 0..128, 200);
        let windows = blocks.windows(0, 0..128, 200);
        let none = [u32::MAX, 0, u32::MAX, 0];
        // 70 − 9 is in the first region; 150 ± 31 in two more, and not above row 64.
        assert_eq!(windows[..4], [[17, 18, 0, 1], [17, 18, 0, 1], none, none]);
        assert_eq!(windows[4..], [none, [37, 38, 25, 26], [37, 38, 25, 26], none]);
        assert_eq!(blocks.windows(0, 90..128, 200), [none, [37, 38, 25, 26], [37, 38, 25, 26], none]);
    }
}
