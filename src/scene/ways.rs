//! Ways from a pixel in eight directions, each followed until a fragment lies behind a limit.
//!
//! The first fragments are looked for from [`LANES`] neighbouring pixels at once, in vectors; a way that goes on is followed alone. Both
//! skip squares of [`TILE`] pixels without a fragment behind the limit. Cost: the length of the ways, or an eighth of it where nothing is
//! behind.

use super::surroundings::{LANES, Surroundings, TILE};
use crate::image::MARGIN;
use pulp::{Arch, NullaryFnOnce};

/// Number of directions.
pub(super) const WAYS: usize = 8;

/// The directions, in columns and rows a step.
const DIRECTIONS: [(isize, isize); WAYS] =
    [(1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1)];

/// The ways from a pixel, up to where they have been followed.
#[derive(Debug)]
pub(super) struct Ways {
    from: (usize, usize),
    /// CoC radius of the fragment that each way has come to; `−∞` at its end.
    coc_px: [f32; WAYS],
    /// The steps to that fragment, or one more than the way's.
    step: [usize; WAYS],
    /// Length of each way in steps.
    steps: [usize; WAYS],
    /// The steps to the border.
    most: [usize; WAYS],
}

impl Ways {
    /// Makes the ways `distance_px` long, where they are shorter and the picture goes on.
    pub(super) fn extend(&mut self, distance_px: f32) {
        for (way, direction) in DIRECTIONS.into_iter().enumerate() {
            let steps = (distance_px / length(direction)) as usize;
            self.steps[way] = self.steps[way].max(steps).min(self.most[way]);
        }
    }

    /// CoC radii of the fragments that the ways have come to; `−∞` at their ends.
    pub(super) fn coc_px(&self) -> &[f32; WAYS] {
        &self.coc_px
    }

    /// Distances of these fragments in pixels; `∞` at the ends.
    pub(super) fn distances_px(&self) -> [f32; WAYS] {
        std::array::from_fn(|way| {
            let distance_px = self.step[way] as f32 * length(DIRECTIONS[way]);
            if self.coc_px[way] > f32::NEG_INFINITY { distance_px } else { f32::INFINITY }
        })
    }

    /// The place of the fragment that a way has come to.
    pub(super) fn place(&self, way: usize) -> (usize, usize) {
        let ((x, y), (dx, dy), step) = (self.from, DIRECTIONS[way], self.step[way] as isize);
        (x.wrapping_add_signed(step * dx), y.wrapping_add_signed(step * dy))
    }
}

/// The first fragments seen from [`LANES`] neighbouring pixels.
pub(super) struct FirstSeen {
    /// Place of the first of the pixels.
    from: (usize, usize),
    /// Width and height of the picture.
    size: (usize, usize),
    /// How far each pixel looks.
    distance_px: [f32; LANES],
    /// Their CoC radii by direction and pixel; `−∞` without a fragment.
    coc_px: [[f32; LANES]; WAYS],
    /// Their distances in steps.
    step: [[f32; LANES]; WAYS],
}

impl FirstSeen {
    /// The ways from a pixel up to these fragments; `None` without any.
    pub(super) fn ways(&self, lane: usize) -> Option<Ways> {
        let coc_px = self.coc_px.map(|coc_px| coc_px[lane]);
        if coc_px.iter().all(|coc_px| coc_px.is_infinite()) {
            return None;
        }
        let (x, y) = (self.from.0 + lane, self.from.1);
        let (width, height) = self.size;
        let most =
            DIRECTIONS.map(|(dx, dy)| steps_inside(x, dx, width).min(steps_inside(y, dy, height)) as usize);
        let mut ways = Ways { from: (x, y), coc_px, step: [1; WAYS], steps: [0; WAYS], most };
        ways.extend(self.distance_px[lane]);
        ways.step = std::array::from_fn(|way| match coc_px[way] {
            f32::NEG_INFINITY => ways.steps[way] + 1,
            _ => self.step[way][lane] as usize,
        });
        Some(ways)
    }
}

impl Surroundings {
    /// The first fragments behind `limit_px` that are seen from [`LANES`] pixels from `x, y` on, of which each looks as far as
    /// `distance_px`. A pixel whose limit is `∞` sees nothing.
    pub(super) fn first_seen(
        &self,
        from: (usize, usize),
        limit_px: [f32; LANES],
        distance_px: [f32; LANES],
    ) -> FirstSeen {
        let size = (self.coc_px.width(), self.coc_px.height());
        let (coc_px, step) = ([[f32::NEG_INFINITY; LANES]; WAYS], [[0.0; LANES]; WAYS]);
        let mut seen = FirstSeen { from, size, distance_px, coc_px, step };
        Arch::new().dispatch(Look { surroundings: self, limit_px, seen: &mut seen });
        seen
    }

    /// Follows each of the `ways` whose fragment is not behind `limit_px` to the next one that is.
    pub(super) fn follow(&self, ways: &mut Ways, limit_px: f32) {
        for way in 0..WAYS {
            if ways.coc_px[way] <= limit_px {
                self.follow_one(ways, way, limit_px);
            }
        }
    }

    fn follow_one(&self, ways: &mut Ways, way: usize, limit_px: f32) {
        let ((dx, dy), steps) = (DIRECTIONS[way], ways.steps[way]);
        let (coc_px, tiles) = (self.coc_px.values(), self.tiles.values());
        let stride = dy * self.coc_px.width() as isize + dx;
        ways.coc_px[way] = f32::NEG_INFINITY;
        while ways.step[way] <= steps {
            let (x, y) = ways.place(way);
            let end = ways.step[way]
                + steps_in_tile(x, dx).min(steps_in_tile(y, dy)).min(steps + 1 - ways.step[way]);
            if tiles[y / TILE * self.tiles.width() + x / TILE] > limit_px {
                let mut at = y * self.coc_px.width() + x;
                for step in ways.step[way]..end {
                    if coc_px[at] > limit_px {
                        (ways.step[way], ways.coc_px[way]) = (step, coc_px[at]);
                        return;
                    }
                    at = at.wrapping_add_signed(stride);
                }
            }
            ways.step[way] = end;
        }
    }
}

/// Looks for the first fragments seen from neighbouring pixels.
struct Look<'a> {
    surroundings: &'a Surroundings,
    limit_px: [f32; LANES],
    seen: &'a mut FirstSeen,
}

impl NullaryFnOnce for Look<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let longest_px =
            self.seen.distance_px.iter().fold(0.0, |longest, px| if *px > longest { *px } else { longest });
        for (way, direction) in DIRECTIONS.into_iter().enumerate() {
            self.surroundings.look(direction, (self.limit_px, longest_px), self.seen, way);
        }
    }
}

impl Surroundings {
    /// Looks in one direction.
    #[inline(always)]
    fn look(
        &self,
        direction: (isize, isize),
        (mut limit_px, longest_px): ([f32; LANES], f32),
        seen: &mut FirstSeen,
        way: usize,
    ) {
        let ((dx, dy), (x, y)) = (direction, seen.from);
        let (width, height) = seen.size;
        let rows = steps_inside(y, dy, height);
        let mut steps = [0.0; LANES];
        #[expect(
            clippy::needless_range_loop,
            reason = "iterators are not inlined here, which takes twice the time"
        )]
        for lane in 0..LANES {
            let inside = rows.min(steps_inside(x + lane, dx, width)) as f32;
            let wanted = seen.distance_px[lane] / length(direction);
            steps[lane] = if wanted < inside { wanted } else { inside };
        }
        let inside = rows.min(steps_inside(x, dx, width).max(steps_inside(x + LANES - 1, dx, width)));
        let last = ((longest_px / length(direction)) as usize).min(inside as usize);
        let (mut coc_px, mut step_of) = ([f32::NEG_INFINITY; LANES], [0.0; LANES]);
        let mut step = 1;
        while step <= last {
            for lane in 0..LANES {
                limit_px[lane] = if steps[lane] < step as f32 { f32::INFINITY } else { limit_px[lane] };
            }
            if !any_below(&limit_px, f32::INFINITY) {
                break;
            }
            let [left, row] = [along(x, step, dx), along(y, step, dy)];
            let end = (step + if dy == 0 { TILE } else { steps_in_tile(row as usize, dy) }).min(last + 1);
            if any_below(&limit_px, self.tiles_between(row as usize, left, along(x, end - 1, dx))) {
                for step in step..end {
                    let first = (MARGIN as isize + along(x, step, dx)) as usize;
                    let row = self.coc_px.row_with_margins(along(y, step, dy) as usize);
                    let fragments: &[f32; LANES] =
                        row[first..].first_chunk().expect("the margin has room for a group");
                    let step = step as f32;
                    for lane in 0..LANES {
                        let is_hit = (fragments[lane] > limit_px[lane]) & (step <= steps[lane]);
                        coc_px[lane] = if is_hit { fragments[lane] } else { coc_px[lane] };
                        step_of[lane] = if is_hit { step } else { step_of[lane] };
                        limit_px[lane] = if is_hit { f32::INFINITY } else { limit_px[lane] };
                    }
                }
            }
            step = end;
        }
        (seen.coc_px[way], seen.step[way]) = (coc_px, step_of);
    }

    /// The largest CoC radius in the tiles of row `y` that meet [`LANES`] pixels which move from column `from` to column `to`.
    #[inline(always)]
    fn tiles_between(&self, y: usize, from: isize, to: isize) -> f32 {
        let first = from.min(to).max(0) as usize / TILE;
        let last = ((from.max(to) + LANES as isize - 1) as usize).min(self.coc_px.width() - 1) / TILE;
        let mut largest = f32::NEG_INFINITY;
        for &tile in &self.tiles.row(y / TILE)[first..=last] {
            largest = if tile > largest { tile } else { largest };
        }
        largest
    }
}

/// Whether one of the values is below a limit.
#[inline(always)]
fn any_below(values: &[f32; LANES], limit: f32) -> bool {
    let mut below = 0;
    for value in values {
        below |= u32::from(*value < limit);
    }
    below != 0
}

/// The column or row after `step` steps.
#[inline(always)]
fn along(from: usize, step: usize, change: isize) -> isize {
    from as isize + step as isize * change
}

/// Length of a step in pixels.
#[inline(always)]
fn length((dx, dy): (isize, isize)) -> f32 {
    if dx != 0 && dy != 0 { std::f32::consts::SQRT_2 } else { 1.0 }
}

/// The steps of `step` each from column or row `at` to the last one inside of a picture of `size` columns or rows.
#[inline(always)]
fn steps_inside(at: usize, step: isize, size: usize) -> i32 {
    match step {
        1.. => size as i32 - 1 - at as i32,
        0 => i32::MAX,
        _ => at as i32,
    }
}

/// The steps of `step` each from `at` to the first place outside its tile.
#[inline(always)]
fn steps_in_tile(at: usize, step: isize) -> usize {
    match step {
        1.. => TILE - at % TILE,
        0 => TILE,
        _ => at % TILE + 1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;
    use crate::scene::Layer;

    /// The surroundings in a layer of `width` × `height` fragments of these CoC radii.
    fn surroundings((width, height): (usize, usize), coc_px: impl Fn(usize, usize) -> f32) -> Surroundings {
        let zeros = || Plane::zeros(width, height);
        Surroundings::new(&Layer {
            color: std::array::from_fn(|_| zeros()),
            alpha: Plane::filled(width, height, 1.0),
            coc_px: Plane::from_fn(width, height, coc_px),
        })
    }

    /// The place of the first fragment behind `limit_px` within `distance_px`, pixel after pixel.
    fn first_behind(
        (x, y): (usize, usize),
        way: usize,
        distance_px: f32,
        is_behind: impl Fn(usize, usize) -> Option<bool>,
    ) -> Option<(usize, usize)> {
        let (dx, dy) = DIRECTIONS[way];
        let steps = (distance_px / length((dx, dy))) as isize;
        let along = (1..=steps).map_while(|step| {
            let (x, y) = (x.checked_add_signed(step * dx)?, y.checked_add_signed(step * dy)?);
            Some(((x, y), is_behind(x, y)?))
        });
        along.into_iter().find_map(|(place, is_behind)| is_behind.then_some(place))
    }

    #[test]
    fn ways_meet_the_same_fragments_as_pixel_after_pixel() {
        let coc = |x: usize, y: usize| ((x * 37 + y * 61 + x * y) % 101) as f32 / 5.0;
        let (width, height) = (200, 100);
        let surroundings = surroundings((width, height), coc);
        let place_of =
            |ways: &Ways, way: usize| (ways.coc_px[way] > f32::NEG_INFINITY).then(|| ways.place(way));
        for (x, y) in [(0, 0), (96, 50), (192, 99), (64, 64), (0, 92)] {
            // Each pixel has a limit and a distance of its own.
            let limit_px: [f32; LANES] = std::array::from_fn(|lane| 15.0 + lane as f32 / 4.0);
            let distance_px: [f32; LANES] = std::array::from_fn(|lane| 5.0 + 4.3 * lane as f32);
            let seen = surroundings.first_seen((x, y), limit_px, distance_px);
            for lane in 0..LANES.min(width - x) {
                let from = (x + lane, y);
                let expected = |way: usize, limit_px: f32, distance_px: f32| {
                    let behind = |x: usize, y: usize| (x < width && y < height).then(|| coc(x, y) > limit_px);
                    first_behind(from, way, distance_px, behind)
                };
                let Some(mut ways) = seen.ways(lane) else {
                    assert!((0..WAYS).all(|way| expected(way, limit_px[lane], distance_px[lane]).is_none()));
                    continue;
                };
                for way in 0..WAYS {
                    let first = expected(way, limit_px[lane], distance_px[lane]);
                    assert_eq!(place_of(&ways, way), first, "way {way} from {from:?}");
                }
                ways.extend(2.0 * distance_px[lane]);
                surroundings.follow(&mut ways, 19.5);
                for way in 0..WAYS {
                    let next = expected(way, 19.5, 2.0 * distance_px[lane]);
                    assert_eq!(place_of(&ways, way), next, "way {way} from {from:?}, farther");
                }
            }
        }
    }

    #[test]
    fn a_pixel_without_a_limit_sees_nothing() {
        let step = surroundings((64, 8), |x, _| if x < 32 { 0.0 } else { 20.0 });
        let mut limit_px = [1.0; LANES];
        limit_px[9] = f32::INFINITY;
        let seen = step.first_seen((16, 4), limit_px, [30.0; LANES]);
        assert!(seen.ways(9).is_none());
        assert_eq!(seen.ways(8).map(|ways| ways.place(0)), Some((32, 4)), "its neighbour sees the step");
    }
}
