//! Evidence for point samples and for averages over the pixel: the silhouettes around each pixel.
//!
//! A silhouette is where a peel's coverage or its depth changes from one sample to the next. Point samples meet there without a rim:
//! one is opaque, the next is empty or of another depth. Averages have a rim, one to three fragments of fractional alpha between two
//! different sides. Wide areas of fractional alpha (glass, smoke) are evidence for neither, nor are single fragments of it within
//! one surface.
//!
//! Both are weighed around each pixel ([`shares`]).
//!
//! Cost: a few comparisons per fragment, and the sums of the weighing; nothing for peels without fractional alpha.

use super::antialiasing::Antialiasing;
use super::depth::FarDepth;
use super::evidence::{Weighing, shares, smooth_step};
use super::{Peel, StackKind};
use crate::image::Plane;
use crate::parallel;
use crate::settings::DepthConvention;
use pulp::Arch;

/// Alpha within this distance of 0 or 1 is not fractional: half floats and lossy codecs round.
pub(super) const ALPHA_ROUNDING: f32 = 1e-3;
/// Alpha is fully fractional from this distance of 0 and 1 on.
const ALPHA_FRACTIONAL: f32 = 0.03;
/// Most samples across the rim of an averaged silhouette: a pixel's, and a filter's that is wider than the pixel.
pub(super) const RIM_SAMPLES: usize = 3;
/// Relative change of depth between two surfaces: none up to the first, full from the second on.
const DEPTH_JUMP: [f32; 2] = [0.02, 0.06];
/// A change of depth is a slope up to this many times that of the samples beside it.
const SLOPE_CHANGE: f32 = 2.0;
/// A hard silhouette counts half of one with a rim: of averages, those along pixels' borders are hard too, but point samples have no rims.
const WEIGHING: Weighing = Weighing { against: 0.5, enough: 3.0, saturation: [0.25, 0.75] };

/// Which colours of `peels`, all of one size and with depths in `convention`, are averages over the pixel.
pub(super) fn antialiasing(peels: &[Peel], convention: DepthConvention) -> Antialiasing {
    let Some(first) = peels.first() else { return StackKind::PointSampled.into() };
    if peels.iter().all(|peel| is_whole(&peel.alpha)) {
        return Antialiasing::POINT_SAMPLES;
    }
    let (width, height) = (first.alpha.width(), first.alpha.height());
    let lookups: Vec<Lookup<'_>> = peels.iter().map(|peel| Lookup::new(peel, convention)).collect();
    let rims = rims(&lookups, width, height);
    if rims.iter().all(|&rim| rim == 0.0) {
        return Antialiasing::POINT_SAMPLES;
    }
    let hard = hard_silhouettes(&lookups, &rims, width, height);
    Antialiasing::by_pixel(shares([&rims, &hard], [width, height], &WEIGHING))
}

/// Whether no alpha is fractional.
fn is_whole(alpha: &Plane) -> bool {
    let arch = Arch::new();
    let is_whole_row = |row: &[f32]| row.iter().fold(true, |all, &alpha| all & (fractional(alpha) == 0.0));
    parallel::all(alpha.height(), &|y| arch.dispatch(|| is_whole_row(alpha.row(y))))
}

/// How fractional an alpha is, 0 … 1.
#[inline(always)]
fn fractional(alpha: f32) -> f32 {
    let inside = alpha.min(1.0 - alpha);
    ((inside - ALPHA_ROUNDING) / (ALPHA_FRACTIONAL - ALPHA_ROUNDING)).clamp(0.0, 1.0)
}

/// Evidence of averages in every pixel, 0 … 1, row by row: that of the peel with most of it.
fn rims(peels: &[Lookup<'_>], width: usize, height: usize) -> Vec<f32> {
    let mut rims = vec![0.0; width * height];
    parallel::for_each_row(&mut rims, width, &|y, row| {
        for peel in peels {
            row.iter_mut().enumerate().for_each(|(x, rim)| *rim = peel.rim(x, y).max(*rim));
        }
    });
    rims
}

/// Evidence of point samples in every pixel, 0 … 1, row by row: that of the peel with most of it, as far as no rim is at either side of
/// the silhouette in any peel.
fn hard_silhouettes(peels: &[Lookup<'_>], rims: &[f32], width: usize, height: usize) -> Vec<f32> {
    let mut hard = vec![0.0; width * height];
    parallel::for_each_row(&mut hard, width, &|y, row| {
        for peel in peels {
            let uneven = peel.uneven(y);
            for (x, hard) in row.iter_mut().enumerate().filter(|(x, _)| uneven[*x]) {
                *hard = peel.hard(x, y).max(*hard);
            }
        }
        for (x, hard) in row.iter_mut().enumerate() {
            let at = |x: usize, y: usize| rims[y * width + x];
            let beside = at(x.saturating_sub(1), y).max(at(x, y.saturating_sub(1)));
            *hard *= 1.0 - at(x, y).max(beside);
        }
    });
    hard
}

/// One sample of a peel.
#[derive(Debug, Clone, Copy)]
struct Sample {
    /// How fractional its alpha is.
    fractional: f32,
    /// Whether it covers more than half of its pixel.
    covers: bool,
    /// Depth that grows with the distance; `+∞` for background.
    depth: f32,
}

impl Sample {
    /// How different the surfaces of two samples are, which are there or not, 0 … 1.
    fn differs(self, other: Self) -> f32 {
        match (self.covers, other.covers) {
            (true, true) => smooth_step(DEPTH_JUMP, relative_step(self.depth, other.depth)),
            (false, false) => 0.0,
            _ => 1.0,
        }
    }

    /// How different the surface of this fragment of a rim is from that of a sample beside the rim, 0 … 1.
    fn differs_from_side(self, side: Self) -> f32 {
        if side.covers { smooth_step(DEPTH_JUMP, relative_step(self.depth, side.depth)) } else { 1.0 }
    }
}

/// Difference of two depths as a share of the larger one.
#[inline]
fn relative_step(a: f32, b: f32) -> f32 {
    let (near, far) = if a < b { (a, b) } else { (b, a) };
    if near == far { 0.0 } else { 1.0 - near / far }
}

/// The samples of one peel, repeated past its border.
struct Lookup<'a> {
    peel: &'a Peel,
    far: FarDepth,
}

impl<'a> Lookup<'a> {
    fn new(peel: &'a Peel, convention: DepthConvention) -> Self {
        Self { peel, far: FarDepth::new(convention) }
    }

    fn sample(&self, x: isize, y: isize) -> Sample {
        let Peel { alpha, depth, .. } = self.peel;
        let within = |at: isize, size: usize| at.clamp(0, size as isize - 1) as usize;
        let (x, y) = (within(x, alpha.width()), within(y, alpha.height()));
        let alpha = alpha.get(x, y);
        Sample { fractional: fractional(alpha), covers: alpha > 0.5, depth: self.far.of(depth.get(x, y)) }
    }

    /// How much of a rim there is at a pixel, 0 … 1.
    fn rim(&self, x: usize, y: usize) -> f32 {
        if fractional(self.peel.alpha.get(x, y)) == 0.0 {
            return 0.0;
        }
        let (x, y) = (x as isize, y as isize);
        let reach = RIM_SAMPLES as isize;
        let line = |dx: isize, dy: isize| -> [Sample; 2 * RIM_SAMPLES + 1] {
            std::array::from_fn(|i| {
                let step = i as isize - reach;
                self.sample(x + step * dx, y + step * dy)
            })
        };
        rim_across(&line(1, 0)).max(rim_across(&line(0, 1)))
    }

    /// How hard the silhouette is between a pixel and the one on its left, or the one above, 0 … 1.
    fn hard(&self, x: usize, y: usize) -> f32 {
        let across = |dx: usize, dy: usize| {
            if x < dx || y < dy {
                return 0.0;
            }
            let (before, here) = ((x - dx, y - dy), (x, y));
            let is_within = |x: usize, y: usize| x < self.peel.alpha.width() && y < self.peel.alpha.height();
            let first = (x >= 2 * dx && y >= 2 * dy).then(|| (x - 2 * dx, y - 2 * dy));
            let last = Some((x + dx, y + dy)).filter(|&(x, y)| is_within(x, y));
            let at = |(x, y): (usize, usize)| self.sample(x as isize, y as isize);
            hard_between([at(before), at(here)], [first, last].map(|place| place.map(at)))
        };
        across(1, 0).max(across(0, 1))
    }

    /// Whether there may be a silhouette between the pixels of row `y` and those on their left or above.
    fn uneven(&self, y: usize) -> Vec<bool> {
        let Peel { alpha, depth, .. } = self.peel;
        let far = |y: usize| -> Vec<f32> { depth.row(y).iter().map(|&depth| self.far.of(depth)).collect() };
        let (here, depth_here) = (alpha.row(y), far(y));
        let mut uneven = vec![false; here.len()];
        if let (Some(rest), Some(last)) = (uneven.get_mut(1..), here.len().checked_sub(1)) {
            mark_uneven(rest, [&here[..last], &here[1..]], [&depth_here[..last], &depth_here[1..]]);
        }
        if let Some(above) = y.checked_sub(1) {
            mark_uneven(&mut uneven, [alpha.row(above), here], [&far(above), &depth_here]);
        }
        uneven
    }
}

/// Marks the pairs of samples that are neither both empty nor both there without a change of depth. Without branches, so that the loop is
/// vectorized.
fn mark_uneven(uneven: &mut [bool], alphas: [&[f32]; 2], depths: [&[f32]; 2]) {
    let depths = depths[0].iter().zip(depths[1]);
    let pairs = alphas[0].iter().zip(alphas[1]).zip(depths);
    for (uneven, ((&from, &to), (&depth_from, &depth_to))) in uneven.iter_mut().zip(pairs) {
        let nearer = if depth_from < depth_to { depth_from } else { depth_to };
        let farther = if depth_from < depth_to { depth_to } else { depth_from };
        let both = (from > 0.5) & (to > 0.5) & (nearer >= farther * (1.0 - DEPTH_JUMP[0]));
        let neither = (from <= ALPHA_ROUNDING) & (to <= ALPHA_ROUNDING);
        *uneven |= !(both | neither);
    }
}

/// How much of a rim there is at the middle of `line`: the fractional fragments around it are few, and lie between different sides or
/// before both.
fn rim_across(line: &[Sample; 2 * RIM_SAMPLES + 1]) -> f32 {
    let middle = RIM_SAMPLES;
    let runs =
        (1..=RIM_SAMPLES).flat_map(|length| (middle + 1 - length..=middle).map(move |from| (from, length)));
    let rim = |(from, length): (usize, usize)| {
        let run = &line[from..from + length];
        let (left, right) = (line[from - 1], line[from + length]);
        let least = run.iter().map(|sample| sample.fractional).fold(1.0, f32::min);
        let ends = (1.0 - left.fractional) * (1.0 - right.fractional);
        let [own_left, own_right] = [left, right].map(|side| line[middle].differs_from_side(side));
        least * ends * left.differs(right).max(own_left.min(own_right))
    };
    runs.map(rim).fold(0.0, f32::max)
}

/// How hard the silhouette is between two samples, 0 … 1; `before` and `after` are those beside them in their line, in the picture.
fn hard_between([from, to]: [Sample; 2], [before, after]: [Option<Sample>; 2]) -> f32 {
    let ends = (1.0 - from.fractional) * (1.0 - to.fractional);
    if !(from.covers && to.covers) {
        return ends * from.differs(to);
    }
    let beside = [(before, from), (after, to)].into_iter();
    let covered = beside.filter_map(|(beside, here)| Some((beside.filter(|sample| sample.covers)?, here)));
    let slope = covered.map(|(a, b)| relative_step(a.depth, b.depth)).reduce(f32::min).unwrap_or(0.0);
    ends * smooth_step(DEPTH_JUMP, relative_step(from.depth, to.depth) - SLOPE_CHANGE * slope)
}

#[cfg(test)]
mod tests {
    use super::super::evidence::RADIUS_PX;
    use super::*;
    use crate::image::Plane;

    const SIZE: [usize; 2] = [96, 64];
    const EMPTY: (f32, f32) = (0.0, f32::INFINITY);

    /// A peel of fragments `(alpha, depth)`.
    fn peel(fragment: impl Fn(usize, usize) -> (f32, f32)) -> Peel {
        let plane = |value: &dyn Fn((f32, f32)) -> f32| {
            Plane::from_fn(SIZE[0], SIZE[1], |x, y| value(fragment(x, y)))
        };
        let alpha = plane(&|(alpha, _)| alpha);
        Peel { color: std::array::from_fn(|_| alpha.clone()), depth: plane(&|(_, depth)| depth), alpha }
    }

    /// Share of pixel `x, y` that a disc of radius 18 around `centre` covers, from 8 × 8 samples, or from its middle alone.
    fn disc(centre: [f32; 2], averaged: bool) -> impl Fn(usize, usize) -> f32 {
        let samples: u8 = if averaged { 8 } else { 1 };
        move |x, y| {
            let at = |place: usize, i: u8| place as f32 + (f32::from(i) + 0.5) / f32::from(samples);
            let inside = |i: u8, j: u8| (at(x, i) - centre[0]).hypot(at(y, j) - centre[1]) < 18.0;
            let count =
                (0..samples).flat_map(|i| (0..samples).map(move |j| (i, j))).filter(|&(i, j)| inside(i, j));
            count.count() as f32 / f32::from(samples).powi(2)
        }
    }

    /// A surface that covers `share` of each pixel at depth 3, before a wall at depth 12.
    fn before_wall(share: impl Fn(usize, usize) -> f32) -> [Peel; 2] {
        let front = peel(|x, y| match share(x, y) {
            share if share > 0.0 => (share, 3.0),
            _ => (1.0, 12.0),
        });
        let back = peel(|x, y| if share(x, y) > 0.0 { (1.0, 12.0) } else { EMPTY });
        [front, back]
    }

    fn found(peels: &[Peel]) -> Antialiasing {
        antialiasing(peels, DepthConvention::Planar)
    }

    fn pixels() -> impl Iterator<Item = (usize, usize)> {
        (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (x, y)))
    }

    #[test]
    fn hard_silhouettes_are_of_point_samples_and_those_with_a_rim_of_averages() {
        let point = before_wall(disc([50.0, 30.0], false));
        assert_eq!(found(&point), Antialiasing::POINT_SAMPLES);
        let averaged = found(&before_wall(disc([50.0, 30.0], true)));
        assert!(averaged.mean() > 0.98, "{}", averaged.in_words());
        let sky = |z: f32| if z == 12.0 { f32::INFINITY } else { z };
        let before_sky = before_wall(disc([50.0, 30.0], true)).map(|peel| {
            let depth = Plane::from_fn(SIZE[0], SIZE[1], |x, y| sky(peel.depth.get(x, y)));
            Peel { depth, ..peel }
        });
        assert!(found(&before_sky).mean() > 0.98, "{}", found(&before_sky).in_words());
    }

    #[test]
    fn each_half_of_a_mixed_picture_is_decided_by_its_own_silhouettes() {
        let (left, right) = (disc([22.0, 32.0], true), disc([74.0, 32.0], false));
        let found = found(&before_wall(|x, y| left(x, y).max(right(x, y))));
        for y in 24..40 {
            assert!(found.at(40, y) > 0.9, "left disc's edge in row {y}: {}", found.at(40, y));
            assert!(found.at(56, y) < 0.2, "right disc's edge in row {y}: {}", found.at(56, y));
        }
    }

    #[test]
    fn a_few_translucent_fragments_leave_point_samples_as_they_are() {
        // One in a thousand, of a surface of its own.
        let disc = disc([50.0, 30.0], false);
        let front = peel(|x, y| match (x + 96 * y) % 1000 {
            500 => (0.5, 2.0),
            _ if disc(x, y) > 0.0 => (1.0, 3.0),
            _ => (1.0, 12.0),
        });
        let back =
            peel(|x, y| if (x + 96 * y) % 1000 == 500 || disc(x, y) > 0.0 { (1.0, 12.0) } else { EMPTY });
        assert_eq!(found(&[front, back]), Antialiasing::POINT_SAMPLES);
    }

    #[test]
    fn glass_and_holes_in_one_surface_are_evidence_for_nothing() {
        let glass = |x: usize, y: usize| (10..70).contains(&x) && (10..50).contains(&y);
        let front = peel(|x, y| if glass(x, y) { (0.4, 2.0) } else { (1.0, 12.0) });
        let back = peel(|x, y| if glass(x, y) { (1.0, 12.0) } else { EMPTY });
        assert_eq!(found(&[front, back]), Antialiasing::POINT_SAMPLES);
        let worn = peel(|x, y| if y == 20 && x > 30 { (0.5, 3.0) } else { (1.0, 3.0) });
        assert_eq!(found(&[worn, peel(|_, _| (1.0, 12.0))]), Antialiasing::POINT_SAMPLES);
    }

    #[test]
    fn a_slope_up_to_the_horizon_is_no_silhouette() {
        // A plane in space: the reciprocal of depth is linear in rows. A rim far away asks for the evidence.
        let ground =
            |x: usize, y: usize| if x == 90 && y == 60 { (0.5, 1.0) } else { (1.0, 10.0 / (y as f32 + 0.5)) };
        let ground = peel(ground);
        let lookup = Lookup::new(&ground, DepthConvention::Planar);
        for (x, y) in pixels().filter(|&(x, y)| x < 80 && y > 0) {
            assert!(lookup.hard(x, y) == 0.0, "{x}, {y}: {}", lookup.hard(x, y));
        }
    }

    #[test]
    fn one_fragment_changes_nothing_farther_away_than_the_kernel_reaches() {
        let share = disc([50.0, 30.0], true);
        let [mut front, back] = before_wall(share);
        let before = found(&[front.clone(), back.clone()]);
        front.alpha.set(50, 48, 1.0);
        let after = found(&[front, back]);
        let mut changed = 0;
        for (x, y) in pixels() {
            let off = (after.at(x, y) - before.at(x, y)).abs();
            let near = x.abs_diff(50) <= RADIUS_PX && y.abs_diff(48) <= RADIUS_PX;
            assert!(near || off < 1e-3, "{x}, {y}: {off}");
            changed += usize::from(off > 0.0);
        }
        assert!(changed < 17 * 17, "{changed} pixels: the picture's share is saturated");
    }

    #[test]
    fn a_rim_that_fades_in_has_its_effect_by_degrees() {
        let share = disc([50.0, 30.0], true);
        let faded = |degree: f32| {
            let rim = |x, y| match share(x, y) {
                share if share > 0.0 && share < 1.0 => 1.0 - degree * (1.0 - share),
                share => share,
            };
            found(&before_wall(rim)).mean()
        };
        // Alpha is fractional from a few hundredths on.
        let means: Vec<f64> = (0..=1000).map(|i| faded(i as f32 / 10_000.0)).collect();
        let steps = means.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        assert!(means[0] == 0.0 && means[1000] > 0.9, "{} to {}", means[0], means[1000]);
        let largest = steps.fold(0.0, f64::max);
        assert!(largest < 0.05, "{largest}");
    }
}
