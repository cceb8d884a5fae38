//! Ways from pixels in eight directions, each followed until a fragment lies behind a limit.
//!
//! Neighbouring pixels look around at once, in vectors: after as many steps in a direction they are neighbours again. Squares of
//! pixels ([`Tiles`]) without a fragment behind the limit are skipped. Cost: the length of the ways, or a thirtieth of it where nothing is
//! behind.

use super::surroundings::{Surroundings, Tiles};
use super::vector::Vector;
use crate::image::MARGIN;
use pulp::Simd;

/// Number of directions.
pub(super) const WAYS: usize = 8;

/// The directions, in columns and rows a step.
const DIRECTIONS: [(isize, isize); WAYS] =
    [(1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1)];

/// The ways from neighbouring pixels of a row, by direction, up to where they have been followed.
#[derive(Debug)]
pub(super) struct Ways<S: Simd> {
    simd: S,
    /// Place of the first of the pixels.
    from: (usize, usize),
    /// CoC radius of the fragment that each way has come to; `−∞` at its end.
    coc_px: [Vector<S>; WAYS],
    /// The steps up to there.
    step: [Vector<S>; WAYS],
    /// Length of each way in steps.
    steps: [Vector<S>; WAYS],
    /// The steps to the border.
    most: [Vector<S>; WAYS],
}

impl<S: Simd> Ways<S> {
    /// The ways from the pixels from `x, y` on, of no length, in a picture of `width` × `height` pixels.
    #[inline(always)]
    pub(super) fn new(simd: S, (x, y): (usize, usize), (width, height): (usize, usize)) -> Self {
        let [nothing, none] = [f32::NEG_INFINITY, 0.0].map(|value| [Vector::all(simd, value); WAYS]);
        let mut most = none;
        for (most, (dx, dy)) in most.iter_mut().zip(DIRECTIONS) {
            let rows = steps_inside(y, dy, height);
            let mut of_pixels = [0.0; MARGIN];
            for (lane, steps) in of_pixels.iter_mut().enumerate() {
                *steps = rows.min(steps_inside(x + lane, dx, width)) as f32;
            }
            *most = Vector::load(simd, &of_pixels);
        }
        Self { simd, from: (x, y), coc_px: nothing, step: none, steps: none, most }
    }

    /// Makes the ways of each pixel `distance_px` long, where they are shorter and the picture goes on.
    #[inline(always)]
    pub(super) fn extend(&mut self, distance_px: Vector<S>) {
        for (way, direction) in DIRECTIONS.into_iter().enumerate() {
            let wanted = distance_px / Vector::all(self.simd, length(direction));
            self.steps[way] = wanted.smaller(self.most[way]).larger(self.steps[way]);
        }
    }

    /// CoC radii of the fragments that the ways have come to; `−∞` at their ends.
    #[inline(always)]
    pub(super) fn coc_px(&self) -> [Vector<S>; WAYS] {
        self.coc_px
    }

    /// Distances of these fragments in pixels; `∞` at the ends.
    #[inline(always)]
    pub(super) fn distances_px(&self) -> [Vector<S>; WAYS] {
        let [nothing, infinity] =
            [f32::NEG_INFINITY, f32::INFINITY].map(|value| Vector::all(self.simd, value));
        let mut distances_px = self.step;
        for (way, distance_px) in distances_px.iter_mut().enumerate() {
            let length = Vector::all(self.simd, length(DIRECTIONS[way]));
            *distance_px = self.coc_px[way].is_above(nothing).select(*distance_px * length, infinity);
        }
        distances_px
    }

    /// Distance in pixels of the nearest of these fragments; `∞` without any.
    #[inline(always)]
    pub(super) fn nearest_px(&self) -> Vector<S> {
        let infinity = Vector::all(self.simd, f32::INFINITY);
        self.distances_px().into_iter().fold(infinity, Vector::smaller)
    }

    /// For each of the pixels, the place of the fragment that its way in a direction has come to.
    #[inline(always)]
    pub(super) fn places(&self, way: usize) -> impl Fn(usize) -> (usize, usize) {
        let mut step = [0.0; MARGIN];
        self.step[way].store(&mut step);
        let ((x, y), (dx, dy)) = (self.from, DIRECTIONS[way]);
        move |lane| {
            let step = step[lane] as isize;
            ((x + lane).wrapping_add_signed(step * dx), y.wrapping_add_signed(step * dy))
        }
    }

    /// Follows each way whose fragment is not behind the limit of its pixel to the next one of the `surroundings` that is. The ways of a
    /// pixel whose limit is `∞` stay as they are; such are all past the picture's border. Limits never fall from one call to the next, so that
    /// nothing that a way has passed is behind one.
    #[inline(always)]
    pub(super) fn follow(&mut self, surroundings: &Surroundings, limit_px: Vector<S>) {
        for way in 0..WAYS {
            self.follow_one(surroundings, way, limit_px);
        }
    }

    /// Follows the ways in one direction.
    #[inline(always)]
    fn follow_one(&mut self, surroundings: &Surroundings, way: usize, limit_px: Vector<S>) {
        let (simd, (x, y), (dx, dy)) = (self.simd, self.from, DIRECTIONS[way]);
        let [nothing, none, infinity] =
            [f32::NEG_INFINITY, 0.0, f32::INFINITY].map(|value| Vector::all(simd, value));
        let (behind, until) = (self.step[way], self.steps[way]);
        let goes_on = self.coc_px[way].is_at_most(limit_px) & limit_px.is_below(infinity);
        let mut coc_px = goes_on.select(nothing, self.coc_px[way]);
        let mut found = goes_on.select(until, behind);
        let is_left = goes_on & behind.is_below(until);
        if !is_left.any() {
            (self.coc_px[way], self.step[way]) = (coc_px, found);
            return;
        }
        let mut limit_px = is_left.select(limit_px, infinity);
        let mut nearest_px = limit_px.least();
        let (first, last) = (is_left.select(behind, infinity).least(), is_left.select(until, none).most());
        let (mut step, last) = (first as usize + 1, last as usize);
        let (coarse, fine) = (&surroundings.coarse_tiles, &surroundings.fine_tiles);
        while step <= last && nearest_px < f32::INFINITY {
            let (place, left) = ((along(x, step, dx), along(y, step, dy)), last + 1 - step);
            let (steps, largest_px) = coarse.ahead(place, (dx, dy), left);
            if largest_px <= nearest_px {
                step += steps;
                continue;
            }
            let (steps, largest_px) = fine.ahead(place, (dx, dy), left);
            if largest_px <= nearest_px {
                step += steps;
                continue;
            }
            let end = step + steps;
            for step in step..end {
                let first = (MARGIN as isize + along(x, step, dx)) as usize;
                let row = surroundings.coc_px.row_with_margins(along(y, step, dy) as usize);
                let (fragments, step) = (Vector::load(simd, &row[first..]), Vector::all(simd, step as f32));
                let is_hit = fragments.is_above(limit_px) & step.is_at_most(until);
                coc_px = is_hit.select(fragments, coc_px);
                found = is_hit.select(step, found);
                limit_px = is_hit.select(infinity, limit_px);
            }
            step = end;
            limit_px = until.is_below(Vector::all(simd, step as f32)).select(infinity, limit_px);
            nearest_px = limit_px.least();
        }
        (self.coc_px[way], self.step[way]) = (coc_px, found);
    }
}

impl<const TILE: usize> Tiles<TILE> {
    /// The steps, `most` at most, in which neighbouring pixels that are at `x, y` and go on in a `direction` stay in the rows of their tiles,
    /// and the largest CoC radius in the tiles that they meet.
    #[inline(always)]
    fn ahead(&self, (x, y): (isize, isize), (dx, dy): (isize, isize), most: usize) -> (usize, f32) {
        let steps = steps_in_tile::<TILE>(y as usize, dy).min(most);
        let left = x.min(x + dx * (steps as isize - 1));
        (steps, self.largest_from(left, y as usize))
    }
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

/// The steps of `step` each from row `at` to the first one outside its tile.
#[inline(always)]
fn steps_in_tile<const TILE: usize>(at: usize, step: isize) -> usize {
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
    use pulp::{Arch, WithSimd};

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

    /// By direction, the place of the fragment that a way has come to.
    type Places = [Option<(usize, usize)>; WAYS];

    /// The places to which the ways from [`MARGIN`] pixels from a place on come, by stage and pixel. In a stage they are made as long as its
    /// distances and followed up to its limits.
    struct Walk<'a, const N: usize> {
        surroundings: &'a Surroundings,
        from: (usize, usize),
        stages: &'a [([f32; MARGIN], [f32; MARGIN]); N],
    }

    impl<const N: usize> WithSimd for Walk<'_, N> {
        type Output = [[Places; MARGIN]; N];

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
            let size = (self.surroundings.coc_px.width(), self.surroundings.coc_px.height());
            let mut all = [[[None; WAYS]; MARGIN]; N];
            for first in (0..MARGIN).step_by(S::F32_LANES) {
                let mut ways = Ways::new(simd, (self.from.0 + first, self.from.1), size);
                for ((limit_px, distance_px), all) in self.stages.iter().zip(&mut all) {
                    ways.extend(Vector::load(simd, &distance_px[first..]));
                    ways.follow(self.surroundings, Vector::load(simd, &limit_px[first..]));
                    for way in 0..WAYS {
                        let (mut coc_px, place) = ([0.0; MARGIN], ways.places(way));
                        ways.coc_px()[way].store(&mut coc_px);
                        for (lane, places) in all[first..][..S::F32_LANES].iter_mut().enumerate() {
                            places[way] = (coc_px[lane] > f32::NEG_INFINITY).then(|| place(lane));
                        }
                    }
                }
            }
            all
        }
    }

    /// [`Walk`], the same with every instruction set.
    fn followed<const N: usize>(
        surroundings: &Surroundings,
        from: (usize, usize),
        stages: &[([f32; MARGIN], [f32; MARGIN]); N],
    ) -> [[Places; MARGIN]; N] {
        let walk = |arch: Arch| arch.dispatch(Walk { surroundings, from, stages });
        let scalar = walk(Arch::Scalar);
        assert_eq!(walk(Arch::new()), scalar, "this machine's instructions and scalar ones");
        scalar
    }

    /// Asserts that the ways from [`MARGIN`] pixels from a place on meet what is met pixel after pixel, in three stages, and returns how
    /// many meet something.
    fn met(
        (width, height): (usize, usize),
        (x, y): (usize, usize),
        coc: impl Fn(usize, usize) -> f32,
    ) -> usize {
        let surroundings = surroundings((width, height), &coc);
        // Each pixel has a limit and a distance of its own; there are none past the border.
        let limits = |limit_px: fn(usize) -> f32| {
            std::array::from_fn(|lane| if x + lane < width { limit_px(lane) } else { f32::INFINITY })
        };
        let limit_px = limits(|lane| 15.0 + lane as f32 / 4.0);
        let distance_px: [f32; MARGIN] = std::array::from_fn(|lane| 5.0 + 4.3 * lane as f32);
        let far_px = distance_px.map(|distance_px| 2.0 * distance_px);
        // The last one does not make the ways shorter.
        let stages = [(limit_px, distance_px), (limit_px, far_px), (limits(|_| 19.5), distance_px)];
        let mut count = 0;
        for (stage, places) in followed(&surroundings, (x, y), &stages).into_iter().enumerate() {
            let (limit_px, distance_px) = (stages[stage].0, if stage == 0 { distance_px } else { far_px });
            for (lane, places) in places.into_iter().take(width - x).enumerate() {
                let behind =
                    |x: usize, y: usize| (x < width && y < height).then(|| coc(x, y) > limit_px[lane]);
                let expected =
                    std::array::from_fn(|way| first_behind((x + lane, y), way, distance_px[lane], behind));
                assert_eq!(places, expected, "stage {stage} from column {x} + {lane}, row {y}");
                count += places.iter().flatten().count();
            }
        }
        count
    }

    #[test]
    fn ways_meet_the_same_fragments_as_pixel_after_pixel() {
        let coc = |x: usize, y: usize| ((x * 37 + y * 61 + x * y) % 101) as f32 / 5.0;
        for from in [(0, 0), (96, 50), (192, 99), (64, 64), (0, 92)] {
            assert!(met((200, 100), from, coc) > 0);
        }
    }

    #[test]
    fn a_lone_fragment_is_met_wherever_it_lies() {
        // All other squares are skipped.
        let mut count = 0;
        for place in (0..140).flat_map(|x| (0..74).map(move |y| (x, y))) {
            count += met((140, 74), (64, 36), |x, y| if (x, y) == place { 20.0 } else { 0.0 });
        }
        // Right and left, above and below, and along the diagonals.
        assert!(count > 1000, "{count} meetings");
    }

    #[test]
    fn a_pixel_without_a_limit_sees_nothing() {
        let step = surroundings((64, 8), |x, _| if x < 32 { 0.0 } else { 20.0 });
        let mut limit_px = [1.0; MARGIN];
        limit_px[9] = f32::INFINITY;
        let [places] = followed(&step, (16, 4), &[(limit_px, [30.0; MARGIN])]);
        assert_eq!(places[9], [None; WAYS]);
        assert_eq!(places[8][0], Some((32, 4)), "its neighbour sees the step");
    }
}
