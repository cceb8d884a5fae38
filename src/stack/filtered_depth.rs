//! Depth that the renderer's pixel filter has blended: at a silhouette, a mean of the depths of two surfaces.
//!
//! A filter weighs depths by coverage, and background as the number that stands for it, often 0. The mean is the depth of no surface:
//! a rim of its blur would lie beside every silhouette, and a mean with 0 lies close to the lens. Such a depth is replaced by that of
//! the surface that covers more of the pixel: the one of the two whose number is nearer to it.
//!
//! A surface is where neighbours have similar depths, or where one is nearer or farther than all around it: a post of one pixel. Evidence
//! of a filter are depths of no surface between those of two, against it silhouettes without such a depth. Both are weighed by place
//! ([`shares`]), the picture's share counts much: a renderer filters depth everywhere or nowhere.
//!
//! All is done with the numbers of the file, because a filter means those, whatever the convention.
//!
//! Cost: one pass over the depths, and some sixty samples for each at a silhouette.

use super::Peel;
use super::depth::{BACKGROUND, foreground};
use super::evidence::{Weighing, is_nowhere, shares, smooth_step};
use crate::finding::Finding;
use crate::image::Plane;
use crate::parallel;
use crate::settings::DepthConvention;
use std::ops::Range;

/// The number for an infinite depth: farther than any background that a file writes.
const INFINITE: f32 = 1e30;
/// Relative difference of depths: one surface up to the first, two from the second on.
const JUMP: [f32; 2] = [0.02, 0.06];
/// Number of similar neighbours, of eight: no surface up to the first, a surface from the second on. A blended depth along an edge has two.
const SIMILAR: [f32; 2] = [2.0, 3.0];
/// The same for evidence: a side of a straight silhouette has five, noise and hair have fewer.
const WIDE: [f32; 2] = [3.5, 4.5];
/// Half the side of the square in which the surfaces of a blended depth lie, in pixels: the reach of common filters.
const REACH: isize = 2;
/// A depth is almost that of background 0 below this share of the greatest within [`REACH`].
const ALMOST_ZERO: f32 = 0.05;
/// Steps beyond the two sides of a blended depth are at most this share of the step between them: none is a slope.
const SLOPE: [f32; 2] = [0.25, 0.5];
/// A silhouette without a blended depth counts half of one with it: some edges lie along pixels' borders.
const WEIGHING: Weighing = Weighing { against: 0.5, enough: 24.0, saturation: [0.35, 0.65] };

/// Replaces the blended depths of `peel`, in `convention`, by those of the surfaces, and says how many.
pub(super) fn unblend(peel: &mut Peel, convention: DepthConvention) -> Option<Finding> {
    let coding = Coding::new(convention);
    let mut numbers = Numbers::new(&peel.depth, &coding);
    let places = numbers.uneven();
    if places.is_empty() {
        return None;
    }
    if coding.is_zero_near() {
        numbers.clear_almost_zero(&places);
    }
    let surfaces = Surfaces::new(numbers, &places);
    let filtered = surfaces.filtered(&places)?;
    let replaced: Vec<Option<f32>> = parallel::map_in_blocks(places.len(), |i| {
        let (x, y) = places[i];
        let number = coding.number(peel.depth.get(x, y));
        let (target, share) = surfaces.target((x, y), number)?;
        let share = share * filtered.get(x, y);
        (share > 0.0).then(|| coding.mixed(number, target, share))
    });
    let mut count = 0;
    for (&(x, y), depth) in places.iter().zip(&replaced) {
        if let Some(depth) = *depth {
            peel.depth.set(x, y, depth);
            count += 1;
        }
    }
    let text = format!(
        "filtered, as colour is: {count} depths that lie between those of two surfaces have that of the surface that covers more of \
         the pixel; unfiltered depth is more exact"
    );
    (count > 0).then(|| Finding::note("depth", text))
}

/// The numbers of a convention, ordered as a filter means them: background is 0, or its depth of at least [`BACKGROUND`] where the file has
/// it farther than all surfaces. A mean with that depth may be at least [`BACKGROUND`] too.
struct Coding {
    convention: DepthConvention,
    foreground: Range<f32>,
    /// Added to every depth, so that a normalised depth of 0 has neighbours at a finite ratio.
    offset: f32,
}

impl Coding {
    fn new(convention: DepthConvention) -> Self {
        /// A ten-thousandth of the depth range.
        const NORMALISED_OFFSET: f32 = 1e-4;
        let offset = if convention == DepthConvention::Normalised { NORMALISED_OFFSET } else { 0.0 };
        Self { convention, foreground: foreground(convention), offset }
    }

    /// Whether a mean with a background of 0 is nearer to the lens than the surface.
    fn is_zero_near(&self) -> bool {
        matches!(self.convention, DepthConvention::Planar | DepthConvention::Ray)
    }

    /// The number for `depth`; at least 0, and finite.
    #[inline]
    fn number(&self, depth: f32) -> f32 {
        let is_low = depth <= 0.0 || self.convention == DepthConvention::Inverse;
        match self.foreground.contains(&depth) {
            true => depth + self.offset,
            false if is_low => 0.0,
            // Infinity and NaN are infinite.
            false => least(depth, INFINITE),
        }
    }

    /// The depth that lies at `share` of the way from `number` to `target`, in CoC radius where that is known to be linear in the
    /// reciprocal of the number.
    fn mixed(&self, number: f32, target: f32, share: f32) -> f32 {
        if share >= 1.0 {
            return target - self.offset;
        }
        if !self.is_zero_near() {
            return number + share * (target - number) - self.offset;
        }
        let reciprocal = |number: f32| if is_background(number) { 0.0 } else { number.recip() };
        let mean = (1.0 - share) * reciprocal(number) + share * reciprocal(target);
        if mean > 0.0 { mean.recip() } else { BACKGROUND }
    }
}

/// Whether a number of [`Coding`] stands for background.
#[inline]
fn is_background(number: f32) -> bool {
    number <= 0.0 || number >= BACKGROUND
}

/// The lesser of two numbers, which are never NaN.
#[inline]
fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The greater of two numbers, which are never NaN.
#[inline]
fn most(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// How different the surfaces of two numbers are, 0 … 1.
#[inline]
fn difference(a: f32, b: f32) -> f32 {
    let (low, high) = if a < b { (a, b) } else { (b, a) };
    if high <= low { 0.0 } else { smooth_step(JUMP, (high - low) / low) }
}

/// The numbers of a picture's depths, repeated past its border.
struct Numbers(Plane);

impl Numbers {
    fn new(depth: &Plane, coding: &Coding) -> Self {
        let mut numbers = depth.clone();
        parallel::for_each_block(numbers.values_mut(), &|_, values| {
            values.iter_mut().for_each(|depth| *depth = coding.number(*depth));
        });
        Self(numbers)
    }

    /// The number `dx` columns and `dy` rows from a place.
    #[inline]
    fn beside(&self, (x, y): (usize, usize), dx: isize, dy: isize) -> f32 {
        let within =
            |at: usize, step: isize, size: usize| at.saturating_add_signed(step).min(size.saturating_sub(1));
        self.0.get(within(x, dx, self.0.width()), within(y, dy, self.0.height()))
    }

    /// The places up to `reach` columns and rows from one, in the picture, without it.
    fn places_around(&self, (x, y): (usize, usize), reach: isize) -> impl Iterator<Item = (usize, usize)> {
        let at = move |dx: isize, dy: isize| {
            let place = x.checked_add_signed(dx).zip(y.checked_add_signed(dy));
            place.filter(|&place| place != (x, y) && place.0 < self.0.width() && place.1 < self.0.height())
        };
        (-reach..=reach).flat_map(move |dy| (-reach..=reach).filter_map(move |dx| at(dx, dy)))
    }

    /// The numbers up to `reach` columns and rows from a place, in the picture, without its own.
    fn around(&self, place: (usize, usize), reach: isize) -> impl Iterator<Item = f32> {
        self.places_around(place, reach).map(|(x, y)| self.0.get(x, y))
    }

    /// The places that differ from one of their eight neighbours, row by row.
    fn uneven(&self) -> Vec<(usize, usize)> {
        let of_row = |y: usize| {
            let row = |dy: isize| self.0.row(y.saturating_add_signed(dy).min(self.0.height() - 1));
            let rows = [row(-1), row(0), row(1)];
            let column = |x: usize, pick: fn(f32, f32) -> f32| pick(pick(rows[0][x], rows[1][x]), rows[2][x]);
            let low: Vec<f32> = (0..self.0.width()).map(|x| column(x, least)).collect();
            let high: Vec<f32> = (0..self.0.width()).map(|x| column(x, most)).collect();
            let is_uneven = |x: usize| {
                let (left, right) = (x.saturating_sub(1), (x + 1).min(low.len() - 1));
                most(most(high[left], high[x]), high[right])
                    > least(least(low[left], low[x]), low[right]) * (1.0 + JUMP[0])
            };
            (0..self.0.width()).filter(|&x| is_uneven(x)).map(|x| (x, y)).collect()
        };
        parallel::flat_map(self.0.height(), &of_row)
    }

    /// Number of a place's eight neighbours that are of its surface; all for background.
    fn similar(&self, place: (usize, usize)) -> f32 {
        let number = self.beside(place, 0, 0);
        let background = self.background(place);
        if background >= 1.0 {
            return 8.0;
        }
        let sum: f32 = self.around(place, 1).map(|other| 1.0 - difference(number, other)).sum();
        sum.max(8.0 * background)
    }

    /// How far a place is background, 0 … 1: less than the farthest number around is a mean with it.
    fn background(&self, place: (usize, usize)) -> f32 {
        match self.beside(place, 0, 0) {
            number if !is_background(number) => 0.0,
            number if number <= 0.0 => 1.0,
            number => 1.0 - difference(number, self.around(place, REACH).fold(number, most)),
        }
    }

    /// Sets the numbers of no surface that are almost 0 to 0, but beside a background that is far: there the others are the means.
    fn clear_almost_zero(&mut self, places: &[(usize, usize)]) {
        let is_almost_zero = |place: (usize, usize)| {
            let greatest = self.around(place, REACH).fold(0.0, most);
            greatest < BACKGROUND
                && self.beside(place, 0, 0) < ALMOST_ZERO * greatest
                && smooth_step(SIMILAR, self.similar(place)) < 0.5
        };
        let cleared = parallel::map_in_blocks(places.len(), |i| is_almost_zero(places[i]));
        let cleared = places.iter().zip(cleared).filter(|(_, is_cleared)| *is_cleared);
        cleared.for_each(|(&(x, y), _)| self.0.set(x, y, 0.0));
    }

    /// How far a place is nearer or farther than all around it, as a post of one pixel or a gap is, 0 … 1. Beside a background of 0 the
    /// nearest is a mean with it.
    fn stands_alone(&self, place: (usize, usize)) -> f32 {
        let number = self.beside(place, 0, 0);
        let low = self.around(place, 1).fold(f32::INFINITY, f32::min);
        let high = self.around(place, 1).fold(0.0, f32::max);
        let highest = if number >= high { 1.0 } else { 1.0 - difference(number, high) };
        let lowest = if number <= low { 1.0 } else { 1.0 - difference(number, low) };
        if self.around(place, REACH).any(|number| number <= 0.0) { highest } else { highest.max(lowest) }
    }
}

/// Which numbers of a picture are those of surfaces.
struct Surfaces {
    numbers: Numbers,
    /// How far each place has the number of a surface that goes on around it, 0 … 1.
    wide: Plane,
    /// How far each place has the number of any surface, 0 … 1.
    any: Plane,
}

impl Surfaces {
    /// The surfaces of `numbers`, which are uneven at `places` only.
    fn new(numbers: Numbers, places: &[(usize, usize)]) -> Self {
        let mut wide = Plane::filled(numbers.0.width(), numbers.0.height(), 1.0);
        let shares: Vec<[f32; 2]> = parallel::map_in_blocks(places.len(), |i| {
            let similar = numbers.similar(places[i]);
            let goes_on = smooth_step(SIMILAR, similar);
            let any = if goes_on < 1.0 { goes_on.max(numbers.stands_alone(places[i])) } else { goes_on };
            [smooth_step(WIDE, similar), any]
        });
        let mut any = wide.clone();
        for (&(x, y), [of_wide, of_any]) in places.iter().zip(shares) {
            wide.set(x, y, of_wide);
            any.set(x, y, of_any);
        }
        Self { numbers, wide, any }
    }

    /// How far depth is filtered around each pixel, 0 … 1; `None` if it is nowhere.
    fn filtered(&self, places: &[(usize, usize)]) -> Option<Plane> {
        let [width, height] = [self.wide.width(), self.wide.height()];
        let found: Vec<[f32; 2]> =
            parallel::map_in_blocks(places.len(), |i| [self.blended(places[i]), self.hard(places[i])]);
        let evidence = places.iter().zip(&found).map(|(&place, &[blended, hard])| (place, [blended, hard]));
        if is_nowhere(evidence, [width, height], &WEIGHING) {
            return None;
        }
        let [mut blended, mut hard] = [vec![0.0; width * height], vec![0.0; width * height]];
        for (&(x, y), [of_blended, of_hard]) in places.iter().zip(found) {
            blended[y * width + x] = of_blended;
            hard[y * width + x] = of_hard;
        }
        let filtered = shares([&blended, &hard], [width, height], &WEIGHING);
        filtered.values().iter().any(|&share| share > 0.0).then_some(filtered)
    }

    /// How far a place has the number of no surface, between those of two on either side of it, 0 … 1.
    fn blended(&self, place: (usize, usize)) -> f32 {
        let none = 1.0 - self.any.get(place.0, place.1);
        if none <= 0.0 {
            return 0.0;
        }
        let lines = [(1, 0), (0, 1), (1, 1), (1, -1)].into_iter();
        let pairs = lines.flat_map(|line| [(1, 1), (1, 2), (2, 1), (2, 2)].map(|steps| (line, steps)));
        none * pairs.map(|((dx, dy), steps)| self.between(place, [dx, dy], steps)).fold(0.0, f32::max)
    }

    /// How far a place lies between the surfaces `before` steps back along a line and `after` steps ahead, 0 … 1.
    fn between(&self, place: (usize, usize), [dx, dy]: [isize; 2], (before, after): (isize, isize)) -> f32 {
        let number = |step: isize| self.numbers.beside(place, step * dx, step * dy);
        let [here, back, ahead] = [number(0), number(-before), number(after)];
        if here <= back.min(ahead) || here >= back.max(ahead) {
            return 0.0;
        }
        let beyond = (number(-before - 1) - back).abs().max((number(after + 1) - ahead).abs());
        let slope = smooth_step(SLOPE, beyond / (ahead - back).abs());
        let wide = |step: isize| {
            let place = [(place.0, dx * step), (place.1, dy * step)];
            let [x, y] = place.map(|(at, step)| at.saturating_add_signed(step));
            self.wide.get(x.min(self.wide.width() - 1), y.min(self.wide.height() - 1))
        };
        (1.0 - slope) * wide(-before) * wide(after) * difference(here, back) * difference(here, ahead)
    }

    /// How hard a silhouette is between a place and the one on its right, or the one below, 0 … 1.
    fn hard(&self, place: (usize, usize)) -> f32 {
        let across = |dx: usize, dy: usize| {
            let (x, y) = (place.0 + dx, place.1 + dy);
            if x >= self.wide.width() || y >= self.wide.height() {
                return 0.0;
            }
            let number = |step: isize| self.numbers.beside(place, step * dx as isize, step * dy as isize);
            let step = (number(1) - number(0)).abs();
            let beside = (number(0) - number(-1)).abs().max((number(2) - number(1)).abs());
            let slope = smooth_step([0.5, 1.0], beside / step.max(f32::MIN_POSITIVE));
            let wide = self.wide.get(place.0, place.1) * self.wide.get(x, y);
            (1.0 - slope) * wide * difference(number(0), number(1))
        };
        across(1, 0).max(across(0, 1))
    }

    /// The number of the surface that replaces `number` at a place, and the share of it that is replaced where depth is filtered. `None`
    /// where there is no surface on either side of it.
    fn target(&self, place: (usize, usize), number: f32) -> Option<(f32, f32)> {
        let cleared = self.numbers.beside(place, 0, 0);
        if cleared < number {
            return Some((cleared, 1.0));
        }
        let none = 1.0 - self.any.get(place.0, place.1);
        if none <= 0.0 {
            return None;
        }
        let candidates = || {
            let surfaces =
                self.numbers.places_around(place, REACH).filter(|&(x, y)| self.any.get(x, y) > 0.5);
            surfaces.map(|(x, y)| self.numbers.0.get(x, y))
        };
        let is_between = candidates().any(|other| other < number) && candidates().any(|other| other > number);
        let distance = |other: f32| (other - number).abs();
        let nearest = candidates().min_by(|a, b| distance(*a).total_cmp(&distance(*b)))?;
        // Little of a surface is none: part of the way to the background is no depth of either.
        is_between.then_some((nearest, (2.0 * none).min(1.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 64;

    /// The share of pixel `x, y` that lies beyond a line at `angle` degrees through the middle of the picture, from 16 × 16 samples.
    fn beyond(angle: f32, x: usize, y: usize) -> f32 {
        let (sin, cos) = angle.to_radians().sin_cos();
        let at = |place: usize, i: u8| place as f32 + (f32::from(i) + 0.5) / 16.0 - 0.5 * SIZE as f32 - 0.31;
        let samples = (0..16).flat_map(|i| (0..16).map(move |j| (i, j)));
        let inside = samples.filter(|&(i, j)| at(x, i) * cos + at(y, j) * sin > 0.0).count();
        inside as f32 / 256.0
    }

    fn depths(depth: impl Fn(usize, usize) -> f32) -> Peel {
        let one = Plane::filled(SIZE, SIZE, 1.0);
        Peel {
            color: std::array::from_fn(|_| one.clone()),
            alpha: one,
            depth: Plane::from_fn(SIZE, SIZE, depth),
        }
    }

    /// The depths of `peel` after [`unblend`], and the number of those that it replaced.
    fn unblended(mut peel: Peel) -> (Plane, usize) {
        let before = peel.depth.clone();
        let finding = unblend(&mut peel, DepthConvention::Planar);
        let changed = before.values().iter().zip(peel.depth.values()).filter(|(a, b)| a != b).count();
        assert_eq!(changed > 0, finding.is_some(), "a change is said");
        (peel.depth, changed)
    }

    #[test]
    fn every_depth_between_two_planes_becomes_that_of_the_one_that_covers_more() {
        for angle in (0..180).step_by(15).map(|angle| angle as f32) {
            let share = |x, y| beyond(angle, x, y);
            let (found, changed) = unblended(depths(|x, y| 2.0 + 6.0 * share(x, y)));
            for (x, y) in (0..SIZE * SIZE).map(|i| (i % SIZE, i / SIZE)) {
                let (share, depth) = (share(x, y), found.get(x, y));
                let expected = if share > 0.5 { 8.0 } else { 2.0 };
                // Near a half either is right. A share of a few hundredths is within the tolerance of a surface.
                let is = |surface: f32| (depth - surface).abs() <= 0.06 * surface;
                let close = if (share - 0.5).abs() < 0.05 { is(2.0) || is(8.0) } else { is(expected) };
                assert!(close, "{angle}°, {x}, {y}: {depth} of {share}");
            }
            assert!(changed >= SIZE / 2, "{angle}°: {changed}");
        }
    }

    #[test]
    fn a_mean_with_a_background_of_zero_is_surface_or_background() {
        for angle in (0..180).step_by(15).map(|angle| angle as f32) {
            let (found, _) = unblended(depths(|x, y| 3.0 * beyond(angle, x, y)));
            let is_either = |depth: f32| depth <= 0.0 || (depth - 3.0).abs() <= 0.06 * 3.0;
            assert!(found.values().iter().all(|&depth| is_either(depth)), "{angle}°");
        }
    }

    #[test]
    fn a_mean_with_a_background_of_ten_to_the_tenth_is_surface_or_background() {
        const FAR: f32 = 1e10;
        for angle in (0..180).step_by(15).map(|angle| angle as f32) {
            let share = |x, y| beyond(angle, x, y);
            let (found, changed) = unblended(depths(|x, y| 3.0 * share(x, y) + FAR * (1.0 - share(x, y))));
            for (x, y) in (0..SIZE * SIZE).map(|i| (i % SIZE, i / SIZE)) {
                let (share, depth) = (share(x, y), found.get(x, y));
                let is_surface = (depth - 3.0).abs() <= 0.06 * 3.0;
                let is_expected = if share > 0.55 { is_surface } else { is_surface || depth >= BACKGROUND };
                assert!(
                    is_expected && (share > 0.45 || !is_surface),
                    "{angle}°, {x}, {y}: {depth} of {share}"
                );
            }
            assert!(changed >= SIZE / 2, "{angle}°: {changed}");
        }
    }

    #[test]
    fn unfiltered_depth_is_kept_bit_for_bit() {
        let hash = |x: usize, y: usize| {
            let mixed = (x as u32).wrapping_mul(0x9E37_79B9) ^ (y as u32).wrapping_mul(0x85EB_CA6B);
            ((mixed ^ (mixed >> 15)).wrapping_mul(0x2C1B_3C6D) >> 16) % 97
        };
        type Depth<'a> = &'a dyn Fn(usize, usize) -> f32;
        let scenes: [(&str, Depth<'_>); 7] = [
            ("an edge", &|x, y| if beyond(20.0, x, y) >= 0.5 { 8.0 } else { 2.0 }),
            ("a slope to the horizon", &|_, y| 10.0 / (y as f32 + 0.5)),
            ("a surface of two pixels between two", &|x, _| {
                [2.0, 4.0, 8.0][usize::from(x > 30) + usize::from(x > 32)]
            }),
            ("posts of one pixel", &|x, _| if x.is_multiple_of(9) { 1.5 } else { 7.0 }),
            ("noise", &|x, y| 5.0 + 0.05 * hash(x, y) as f32),
            ("leaves before infinity", &|x, y| if hash(x / 2, y / 2) < 40 { 2.0 } else { f32::INFINITY }),
            ("leaves before a background of ten to the tenth", &|x, y| {
                if hash(x, y / 3) < 40 { 2.0 } else { 1e10 }
            }),
        ];
        for (name, depth) in scenes {
            assert_eq!(unblended(depths(depth)).1, 0, "{name}");
        }
    }

    #[test]
    fn a_post_of_one_pixel_and_a_slope_are_kept_beside_filtered_edges() {
        let depth = |x: usize, y: usize| match x {
            0..31 => 2.0 + 6.0 * beyond(90.0, x, y),
            31 => 1.0,
            _ => 6.0 + 0.05 * y as f32,
        };
        let (found, changed) = unblended(depths(depth));
        assert!(changed > 20, "the edge is filtered: {changed}");
        for (x, y) in (0..SIZE * SIZE).map(|i| (31 + i % (SIZE - 31), i / SIZE)).filter(|&(_, y)| y < SIZE) {
            assert_eq!(found.get(x, y), depth(x, y), "{x}, {y}");
        }
    }

    #[test]
    fn a_depth_that_is_partly_replaced_moves_evenly_in_the_reciprocal() {
        let coding = Coding::new(DepthConvention::Planar);
        assert_eq!(coding.mixed(2.0, 4.0, 0.5), 1.0 / 0.375);
        assert_eq!(coding.mixed(2.0, 0.0, 0.5), 4.0, "background is infinitely far");
        assert_eq!(Coding::new(DepthConvention::Inverse).mixed(0.2, 0.4, 0.25), 0.25);
    }
}
