//! What is seen beside a pixel, behind its own surface: in eight directions, the nearest first.
//!
//! Each direction is followed until a fragment lies behind the limit. Squares of [`TILE`] pixels without such a fragment are skipped.

use super::Layer;
use crate::image::Plane;
use crate::stack::LIGHT_ALPHA;
use rayon::prelude::*;

/// The directions, in columns and rows a step.
const DIRECTIONS: [(isize, isize); 8] =
    [(1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1)];

/// Levels of the maxima: the last has cells of 512 pixels.
const LEVELS: usize = 9;

/// The level whose cells are skipped where nothing in them lies behind the limit.
const TILE_LEVEL: usize = 3;

/// Side of such a cell in pixels.
const TILE: usize = 1 << TILE_LEVEL;

/// How much farther away a fragment may be than the rays through its edge reach, in picture pixels: between the two it fades.
pub(super) const FADE_PX: [f32; 2] = [1.0, 2.0];

/// A fragment beside a pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    /// Distance from the pixel.
    pub(super) distance_px: f32,
    /// Its CoC radius.
    pub(super) coc_px: f32,
    /// Its place.
    pub(super) place: (usize, usize),
}

/// A way from a pixel in one direction, up to where it has been followed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Way {
    from: (usize, usize),
    direction: (isize, isize),
    step: usize,
    steps: usize,
}

impl Way {
    /// Makes the way `distance_px` long, if it is shorter.
    pub(super) fn extend(&mut self, distance_px: f32) {
        self.steps = self.steps.max((distance_px / length(self.direction)) as usize);
    }
}

/// The CoC radii of a layer, arranged for looking around.
pub(super) struct Surroundings {
    /// CoC radii in picture pixels; `−∞` without a fragment, and where light without alpha is all.
    coc_px: Plane,
    /// Largest CoC radius in each square of [`TILE`] pixels.
    tiles: Plane,
    /// Largest CoC radius in each cell of 2, 4, 8 … pixels and the eight cells around it.
    around: Vec<Plane>,
}

impl Surroundings {
    /// The surroundings of all pixels of `layer`.
    pub(super) fn new(layer: &Layer) -> Self {
        let mut coc_px = layer.coc_px.clone();
        coc_px.values_mut().par_iter_mut().zip(layer.alpha.values()).for_each(|(coc, alpha)| {
            if *alpha <= LIGHT_ALPHA {
                *coc = f32::NEG_INFINITY;
            }
        });
        let mut levels = vec![halved(&coc_px)];
        while levels.len() < LEVELS {
            let next = levels.last().map_or_else(Plane::default, halved);
            levels.push(next);
        }
        let around = levels.iter().map(dilated).collect();
        let tiles = levels.swap_remove(TILE_LEVEL - 1);
        Self { coc_px, tiles, around }
    }

    /// Width of the layer in pixels.
    pub(super) fn width(&self) -> usize {
        self.coc_px.width()
    }

    /// The largest difference in CoC radius, in picture pixels, from `coc_px` to fragments behind it that may be as near to a pixel as rays
    /// reach that pass its surface there; `None` without such fragments.
    pub(super) fn reach_px(&self, (x, y): (usize, usize), coc_px: f32, gap_px: f32) -> Option<f32> {
        let mut reach_px = None;
        for (level, largest) in self.around.iter().enumerate() {
            let behind_px = largest.get(x >> (level + 1), y >> (level + 1)) - coc_px;
            // What the finer levels do not contain is at least half a cell's side away.
            let nearest_px = if level == 0 { 0 } else { 1 << level };
            if behind_px > gap_px && behind_px + FADE_PX[1] >= nearest_px as f32 {
                reach_px = Some(behind_px);
            }
        }
        reach_px
    }

    /// The ways from a place, up to `distance_px` long.
    pub(super) fn ways(place: (usize, usize), distance_px: f32) -> [Way; 8] {
        let mut ways = DIRECTIONS.map(|direction| Way { from: place, direction, step: 1, steps: 0 });
        ways.iter_mut().for_each(|way| way.extend(distance_px));
        ways
    }

    /// The next fragment of a way behind `coc_px`; `None` at its end. The way stays there.
    pub(super) fn follow(&self, way: &mut Way, coc_px: f32) -> Option<Seen> {
        let (dx, dy) = way.direction;
        while way.step <= way.steps {
            let step = way.step as isize;
            let x = way.from.0.checked_add_signed(step * dx).filter(|&x| x < self.coc_px.width())?;
            let y = way.from.1.checked_add_signed(step * dy).filter(|&y| y < self.coc_px.height())?;
            if self.tiles.get(x / TILE, y / TILE) <= coc_px {
                way.step += steps_in_tile(x, dx).min(steps_in_tile(y, dy));
                continue;
            }
            let here = self.coc_px.get(x, y);
            if here > coc_px {
                let distance_px = way.step as f32 * length(way.direction);
                return Some(Seen { distance_px, coc_px: here, place: (x, y) });
            }
            way.step += 1;
        }
        None
    }
}

/// Length of a step in pixels.
fn length((dx, dy): (isize, isize)) -> f32 {
    if dx != 0 && dy != 0 { std::f32::consts::SQRT_2 } else { 1.0 }
}

/// The steps of `step` each from `at` to the first place outside its tile.
fn steps_in_tile(at: usize, step: isize) -> usize {
    match step {
        1.. => TILE - at % TILE,
        0 => TILE,
        _ => at % TILE + 1,
    }
}

/// The largest of each four values of `plane`.
fn halved(plane: &Plane) -> Plane {
    let (width, height) = (plane.width().div_ceil(2), plane.height().div_ceil(2));
    let mut half = Plane::zeros(width, height);
    half.values_mut().par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
        let rows = [plane.row(2 * y), plane.row((2 * y + 1).min(plane.height() - 1))];
        for (x, value) in row.iter_mut().enumerate() {
            let right = (2 * x + 1).min(plane.width() - 1);
            *value = rows.iter().fold(f32::NEG_INFINITY, |most, row| most.max(row[2 * x]).max(row[right]));
        }
    });
    half
}

/// The largest of each value of `plane` and the eight around it.
fn dilated(plane: &Plane) -> Plane {
    let (width, height) = (plane.width(), plane.height());
    let mut wide = Plane::zeros(width, height);
    wide.values_mut().par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
        for (x, value) in row.iter_mut().enumerate() {
            let columns = x.saturating_sub(1)..(x + 2).min(width);
            let rows = y.saturating_sub(1)..(y + 2).min(height);
            let all = rows.flat_map(|y| plane.row(y)[columns.clone()].iter().copied());
            *value = all.fold(f32::NEG_INFINITY, f32::max);
        }
    });
    wide
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

    #[test]
    fn a_way_meets_the_same_fragments_as_pixel_after_pixel() {
        let coc = |x: usize, y: usize| ((x * 37 + y * 61 + x * y) % 101) as f32 / 5.0;
        let surroundings = Surroundings::new(&layer(coc));
        for place in [(0, 0), (100, 50), (199, 99), (63, 64), (7, 92)] {
            for mut way in Surroundings::ways(place, 70.0) {
                let (dx, dy) = way.direction;
                let found = surroundings.follow(&mut way, 19.5).map(|seen| seen.place);
                let steps = (70.0 / length((dx, dy))) as isize;
                let along = (1..=steps).map_while(|step| {
                    let x = place.0.checked_add_signed(step * dx)?;
                    let y = place.1.checked_add_signed(step * dy)?;
                    (x < 200 && y < 100).then_some((x, y))
                });
                assert_eq!(found, along.into_iter().find(|&(x, y)| coc(x, y) > 19.5), "{place:?} {dx} {dy}");
            }
        }
    }

    #[test]
    fn fragments_are_in_reach_where_they_are_as_near_as_far_behind() {
        let step = Surroundings::new(&layer(|x, _| if x < 100 { 0.0 } else { 20.0 }));
        assert_eq!(step.reach_px((85, 50), 0.0, 1.0), Some(20.0), "15 px away, 20 px behind");
        assert_eq!(step.reach_px((20, 50), 0.0, 1.0), None, "80 px away");
        assert_eq!(step.reach_px((110, 50), 20.0, 1.0), None, "nothing is behind");
        let slope = Surroundings::new(&layer(|x, _| 0.1 * x as f32));
        assert_eq!(slope.reach_px((100, 50), 10.0, 1.0), None, "a slope hides nothing");
        let hole = Surroundings::new(&layer(|x, _| if x < 100 { 0.0 } else { f32::NAN }));
        assert_eq!(hole.reach_px((99, 50), 0.0, 1.0), None, "a sample without a fragment is nothing behind");
    }
}
