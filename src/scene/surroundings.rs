//! What is around a pixel, behind its own surface: the largest CoC radii of squares of pixels.
//!
//! Squares of pixels ([`Tiles`]) without a fragment behind a limit are skipped when one looks for it; squares of 2 to 512 pixels with those
//! around them say whether a fragment behind a pixel's surface is in reach of its rays. Cost: three passes over the layer. Memory: a
//! plane of CoC radii, and two thirds of one.

use super::Layer;
use crate::image::{MARGIN, Plane};
use crate::parallel;
use crate::stack::LIGHT_ALPHA;

/// Number of neighbouring pixels of a row that look around together.
pub(super) const LANES: usize = MARGIN;

/// The level whose cells are as wide as such a group.
const GROUP_LEVEL: usize = LANES.ilog2() as usize - 1;

/// Levels of the maxima: the last has cells of 512 pixels.
const LEVELS: usize = 9;

/// The levels whose cells are skipped where nothing in them lies behind the limit.
const COARSE_LEVEL: usize = 5;
const FINE_LEVEL: usize = 3;

/// The largest CoC radius in each square of `TILE` pixels and those right of it that [`LANES`] pixels meet on `TILE` steps.
pub(super) struct Tiles<const TILE: usize>(Plane);

impl<const TILE: usize> Tiles<TILE> {
    /// From the largest one in each square.
    fn new(mut squares: Plane) -> Self {
        // So many columns meet the most squares where the first is the last one of its square.
        let columns = LANES + TILE - 1;
        let most = 1 + (columns - 1).div_ceil(TILE);
        let width = squares.width().max(1);
        parallel::for_each_row(squares.values_mut(), width, &|_, row| {
            for x in 0..row.len() {
                row[x] = row[x..(x + most).min(row.len())].iter().copied().fold(f32::NEG_INFINITY, larger);
            }
        });
        Self(squares)
    }

    /// The largest from the square of column `x`, row `y` on; left of the picture, from the first one.
    #[inline(always)]
    pub(super) fn largest_from(&self, x: isize, y: usize) -> f32 {
        self.0.get(x.max(0) as usize / TILE, y / TILE)
    }
}

/// How much farther away a fragment may be than the rays through its edge reach, in picture pixels: between the two it fades.
pub(super) const FADE_PX: [f32; 2] = [1.0, 2.0];

/// The CoC radii of a layer, arranged for looking around.
pub(super) struct Surroundings {
    /// CoC radii in picture pixels; `−∞` without a fragment, and where light without alpha is all.
    pub(super) coc_px: Plane,
    /// What is skipped first, and what within it.
    pub(super) coarse_tiles: Tiles<{ 1 << COARSE_LEVEL }>,
    pub(super) fine_tiles: Tiles<{ 1 << FINE_LEVEL }>,
    /// Largest CoC radius in each cell of 2, 4, 8 … pixels and the eight cells around it.
    around: Vec<Plane>,
}

impl Surroundings {
    /// The surroundings of all pixels of `layer`.
    pub(super) fn new(layer: &Layer) -> Self {
        let mut coc_px = layer.coc_px.clone();
        parallel::for_each_block(coc_px.values_mut(), &|block, coc_px| {
            let samples = coc_px.iter_mut().zip(&layer.alpha.values()[block]);
            samples.filter(|(_, alpha)| **alpha <= LIGHT_ALPHA).for_each(|(coc, _)| *coc = f32::NEG_INFINITY);
        });
        let mut levels = vec![halved(&coc_px)];
        while levels.len() < LEVELS {
            let next = levels.last().map_or_else(Plane::default, halved);
            levels.push(next);
        }
        let around = levels.iter().map(dilated).collect();
        let [coarse, fine] = [COARSE_LEVEL, FINE_LEVEL].map(|level| std::mem::take(&mut levels[level - 1]));
        Self { coc_px, coarse_tiles: Tiles::new(coarse), fine_tiles: Tiles::new(fine), around }
    }

    /// For [`LANES`] pixels from `x, y` on, whose last fragments have CoC radii `last_px`: the largest CoC radius of fragments that lie more
    /// than `gap_px` behind and may be as near as rays reach that pass the last fragment there; `−∞` without such fragments. `x` is a
    /// multiple of [`LANES`].
    #[inline(always)]
    pub(super) fn farthest_in_reach(
        &self,
        (x, y): (usize, usize),
        last_px: &[f32; LANES],
        gap_px: f32,
    ) -> [f32; LANES] {
        let mut farthest_px = [f32::NEG_INFINITY; LANES];
        let nearest_last_px = smallest(last_px);
        let row = |level: usize| &self.around[level].row(y >> (level + 1))[x >> (level + 1)..];
        for level in 0..LEVELS {
            // What the finer levels do not contain is at least half a cell's side away.
            let nearest_px = if level == 0 { 0.0 } else { (1 << level) as f32 };
            let is_in_reach = |behind_px: f32| behind_px > gap_px && behind_px + FADE_PX[1] >= nearest_px;
            // A cell with those around it holds the finer ones of all its pixels.
            if !is_in_reach(row(level.max(GROUP_LEVEL))[0] - nearest_last_px) {
                continue;
            }
            let cells = row(level);
            for (lane, (farthest_px, last_px)) in farthest_px.iter_mut().zip(last_px).enumerate() {
                // Past the border, where there is no cell, nothing is hidden.
                let largest_px = cells[(lane >> (level + 1)).min(cells.len() - 1)];
                if is_in_reach(largest_px - last_px) {
                    *farthest_px = largest_px;
                }
            }
        }
        farthest_px
    }
}

/// The smallest of the values of a group.
#[inline(always)]
pub(super) fn smallest(values: &[f32; LANES]) -> f32 {
    let mut least = *values;
    for half in [8, 4, 2, 1] {
        for lane in 0..half {
            least[lane] = if least[lane + half] < least[lane] { least[lane + half] } else { least[lane] };
        }
    }
    least[0]
}

/// The largest of each four values of `plane`.
fn halved(plane: &Plane) -> Plane {
    let (width, height) = (plane.width().div_ceil(2), plane.height().div_ceil(2));
    let mut half = Plane::zeros(width, height);
    parallel::for_each_row(half.values_mut(), width, &|y, row| {
        let rows = [plane.row(2 * y), plane.row((2 * y + 1).min(plane.height() - 1))];
        for (value, (above, below)) in row.iter_mut().zip(rows[0].chunks(2).zip(rows[1].chunks(2))) {
            *value =
                larger(larger(above[0], above[above.len() - 1]), larger(below[0], below[below.len() - 1]));
        }
    });
    half
}

/// The largest of each value of `plane` and the eight around it.
fn dilated(plane: &Plane) -> Plane {
    let (width, height) = (plane.width(), plane.height());
    let mut wide = Plane::zeros(width, height);
    // The largest of three rows by column, with a column beyond either border.
    parallel::for_each_with(
        wide.values_mut().chunks_mut(width.max(1)),
        &|| vec![f32::NEG_INFINITY; width + 2],
        &|largest, y, row| {
            let [above, below] = [y.saturating_sub(1), (y + 1).min(height - 1)].map(|y| plane.row(y));
            let columns = above.iter().zip(plane.row(y)).zip(below);
            for (largest, ((above, here), below)) in largest[1..].iter_mut().zip(columns) {
                *largest = larger(larger(*above, *here), *below);
            }
            for (value, beside) in row.iter_mut().zip(largest.windows(3)) {
                *value = larger(larger(beside[0], beside[1]), beside[2]);
            }
        },
    );
    wide
}

/// The larger of two values that are numbers.
#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A layer of 200 × 100 pixels with CoC radii `coc_px(x, y)`, without a fragment where they are not finite.
    fn layer(coc_px: impl Fn(usize, usize) -> f32) -> Layer {
        let plane = |value: &dyn Fn(usize, usize) -> f32| Plane::from_fn(200, 100, value);
        Layer {
            color: std::array::from_fn(|_| plane(&|_, _| 0.0)),
            alpha: plane(&|x, y| if coc_px(x, y).is_finite() { 1.0 } else { 0.0 }),
            coc_px: plane(&|x, y| if coc_px(x, y).is_finite() { coc_px(x, y) } else { 0.0 }),
        }
    }

    /// The largest CoC radius in reach of a pixel whose last fragment has the CoC radius `last_px`, if there is one.
    fn farthest(surroundings: &Surroundings, (x, y): (usize, usize), last_px: f32) -> Option<f32> {
        let group = (x / LANES * LANES, y);
        let farthest_px = surroundings.farthest_in_reach(group, &[last_px; LANES], 1.0)[x % LANES];
        Some(farthest_px).filter(|px| px.is_finite())
    }

    #[test]
    fn a_square_and_those_around_it_hold_the_largest_of_all_their_pixels() {
        let coc = |x: usize, y: usize| ((x * 37 + y * 61 + x * y) % 101) as f32;
        let pixels = Plane::from_fn(37, 21, coc);
        let largest = |columns: std::ops::Range<usize>, rows: std::ops::Range<usize>| {
            let all = rows.flat_map(|y| columns.clone().map(move |x| coc(x.min(36), y.min(20))));
            all.fold(0.0, f32::max)
        };
        let squares = halved(&pixels);
        let around = dilated(&squares);
        for (x, y) in [(0, 0), (7, 3), (18, 10), (18, 0)] {
            assert_eq!(squares.get(x, y), largest(2 * x..2 * x + 2, 2 * y..2 * y + 2), "{x}, {y}");
            let [left, above] = [x, y].map(|at: usize| 2 * at.saturating_sub(1));
            assert_eq!(around.get(x, y), largest(left..2 * x + 4, above..2 * y + 4), "around {x}, {y}");
        }
    }

    #[test]
    fn fragments_are_in_reach_where_they_are_as_near_as_far_behind() {
        let step = Surroundings::new(&layer(|x, _| if x < 100 { 0.0 } else { 20.0 }));
        assert_eq!(farthest(&step, (85, 50), 0.0), Some(20.0), "15 px away, 20 px behind");
        assert_eq!(farthest(&step, (20, 50), 0.0), None, "80 px away");
        assert_eq!(farthest(&step, (110, 50), 20.0), None, "nothing is behind");
        let slope = Surroundings::new(&layer(|x, _| 0.1 * x as f32));
        assert_eq!(farthest(&slope, (100, 50), 10.0), None, "a slope hides nothing");
        let hole = Surroundings::new(&layer(|x, _| if x < 100 { 0.0 } else { f32::NAN }));
        assert_eq!(farthest(&hole, (99, 50), 0.0), None, "a sample without a fragment is nothing behind");
    }
}
