//! Depth that cannot be depth: nothing but background, or distances counted backwards along the view.
//!
//! One background value beside depth is no matter, whatever it is: 0, −1, 1e10, infinite or NaN. What is concluded here is of all the
//! depths that are seen, and by what they can mean at all, not by how many there are of a kind.
//!
//! Cost: one read of alpha and depth.

use super::Peel;
use super::depth::BACKGROUND;
use crate::error::Error;
use crate::finding::Finding;
use crate::image::Plane;
use crate::parallel;
use crate::settings::DepthConvention;
use pulp::{Arch, NullaryFnOnce};

/// The number that programs write where there is no depth.
const NONE: f32 = -1.0;
/// The largest half float, which stands for background where depth was converted.
const HALF_MAX: f32 = 65504.0;
/// Share of the fragments with a negative depth beside positive ones that is worth a warning.
const WARNED_SHARE: f64 = 0.01;

/// Smallest and largest of some values; empty at first.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Ends {
    low: f32,
    high: f32,
}

impl Ends {
    const NOTHING: Self = Self { low: f32::INFINITY, high: f32::NEG_INFINITY };

    fn joined(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    fn is_empty(self) -> bool {
        self.low > self.high
    }

    /// Whether there is one value, and no other.
    fn is_one(self) -> bool {
        self.low == self.high
    }
}

/// The depths of the fragments of a stack, by what they can be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DepthValues {
    /// Number of fragments.
    fragments: u64,
    /// Number of those that are 0.
    zero: u64,
    /// Number of those that are −1.
    none: u64,
    /// Number of those that are NaN.
    nan: u64,
    /// Number of distances.
    positive_count: u64,
    /// Number of negative ones that may be distances, −1 not among them.
    negative_count: u64,
    /// Distances: above 0, and below any background.
    positive: Ends,
    /// The same below 0, −1 among them.
    negative: Ends,
}

/// The depths of one row.
struct OfRow<'a> {
    alpha: &'a [f32],
    depth: &'a [f32],
}

impl NullaryFnOnce for OfRow<'_> {
    type Output = DepthValues;

    #[inline(always)]
    fn call(self) -> DepthValues {
        let Self { alpha, depth } = self;
        // Each lane has ends of its own, so that no iteration depends on the previous one.
        const LANES: usize = 16;
        let nothing = [[f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]];
        let ([mut low, mut high], [mut negative_low, mut negative_high]) = (nothing, nothing);
        let (mut counts, mut positive_count) = ([0_u32; 5], 0_u32);
        for (alpha, depth) in alpha.chunks(LANES).zip(depth.chunks(LANES)) {
            for (lane, (&alpha, &depth)) in alpha.iter().zip(depth).enumerate() {
                let present = alpha > 0.0;
                let positive = present & (depth > 0.0) & (depth < BACKGROUND);
                let negative = present & (depth < 0.0) & (depth > -BACKGROUND);
                let is_none = depth == NONE;
                counts[0] += u32::from(present);
                counts[1] += u32::from(present & (depth == 0.0));
                counts[2] += u32::from(present & is_none);
                counts[3] += u32::from(present & depth.is_nan());
                counts[4] += u32::from(negative & !is_none);
                positive_count += u32::from(positive);
                low[lane] = if positive & (depth < low[lane]) { depth } else { low[lane] };
                high[lane] = if positive & (depth > high[lane]) { depth } else { high[lane] };
                negative_low[lane] =
                    if negative & (depth < negative_low[lane]) { depth } else { negative_low[lane] };
                negative_high[lane] =
                    if negative & (depth > negative_high[lane]) { depth } else { negative_high[lane] };
            }
        }
        let [fragments, zero, none, nan, negative_count] = counts.map(u64::from);
        let ends = |low: [f32; LANES], high: [f32; LANES]| Ends {
            low: low.into_iter().fold(f32::INFINITY, f32::min),
            high: high.into_iter().fold(f32::NEG_INFINITY, f32::max),
        };
        DepthValues {
            fragments,
            zero,
            none,
            nan,
            positive_count: u64::from(positive_count),
            negative_count,
            positive: ends(low, high),
            negative: ends(negative_low, negative_high),
        }
    }
}

impl DepthValues {
    const NOTHING: Self = Self {
        fragments: 0,
        zero: 0,
        none: 0,
        nan: 0,
        positive_count: 0,
        negative_count: 0,
        positive: Ends::NOTHING,
        negative: Ends::NOTHING,
    };

    /// Those of `peels`.
    pub(super) fn of(peels: &[Peel]) -> Self {
        let arch = Arch::new();
        let of_rows = |peel: &Peel| -> Self {
            let of_row =
                |y: usize| arch.dispatch(OfRow { alpha: peel.alpha.row(y), depth: peel.depth.row(y) });
            let rows = parallel::map(peel.alpha.height(), &of_row);
            rows.into_iter().fold(Self::NOTHING, Self::joined)
        };
        peels.iter().map(of_rows).fold(Self::NOTHING, Self::joined)
    }

    /// Counts have no order, and ends do not round: the sum is the same whatever the order.
    fn joined(self, other: Self) -> Self {
        Self {
            fragments: self.fragments + other.fragments,
            zero: self.zero + other.zero,
            none: self.none + other.none,
            nan: self.nan + other.nan,
            positive_count: self.positive_count + other.positive_count,
            negative_count: self.negative_count + other.negative_count,
            positive: self.positive.joined(other.positive),
            negative: self.negative.joined(other.negative),
        }
    }

    /// Whether the depths are distances with a minus sign: some are negative, and none is positive apart from one value behind all of them,
    /// which is background.
    fn is_backwards(&self) -> bool {
        let behind = self.positive.is_one() && self.positive.low >= -self.negative.low;
        self.negative_count > 0 && (self.positive.is_empty() || behind)
    }

    /// Turns the depths of `peels`, whose values these are, around where they count backwards along the view, and says so.
    pub(super) fn turn_around(&self, peels: &mut [Peel], convention: DepthConvention) -> Option<Finding> {
        // A normalised depth below 0 is background.
        if !self.is_backwards() || convention == DepthConvention::Normalised {
            return None;
        }
        peels.iter_mut().for_each(|peel| turned(&mut peel.depth));
        let text = format!(
            "all distances are negative, from {} to {}, as along −z in camera space: they are used without their sign",
            self.negative.low, self.negative.high
        );
        Some(Finding::note("depth", text))
    }

    /// A warning about fragments whose depth is negative beside others with a positive one.
    pub(super) fn doubt(&self) -> Option<Finding> {
        // One negative value is a background like any other.
        let share = self.negative_count as f64 / self.fragments.max(1) as f64;
        let mixed = !self.is_backwards() && !self.positive.is_empty() && !self.negative.is_one();
        let text = format!(
            "{:.1} % of the depths are negative, from {} to {}, and count as background: check the depth pass",
            100.0 * share,
            self.negative.low,
            self.negative.high
        );
        (mixed && share >= WARNED_SHARE).then(|| Finding::warning("depth", text))
    }

    /// Checks that some depth is a distance. `writes_zero` says that the program which wrote the file has 0 for background.
    ///
    /// # Errors
    /// No depth but 0, −1 and NaN, which stand for no depth. A frame that shows background alone gets a warning, if its depths say so:
    /// they are far, or `writes_zero`.
    pub(super) fn check(&self, writes_zero: bool) -> Result<Option<Finding>, Error> {
        let is_far = self.positive.is_one() && self.positive.low == HALF_MAX;
        let is_distance = !self.positive.is_empty() && !is_far || self.negative_count > 0;
        if self.fragments == 0 || is_distance {
            return Ok(None);
        }
        let missing = self.zero + self.none + self.nan;
        if missing < self.fragments || writes_zero && self.zero == self.fragments {
            let text = "there is nothing but background: all of the picture lies at infinity";
            return Ok(Some(Finding::warning("depth", text)));
        }
        let kinds = [(self.zero, "0"), (self.none, "-1"), (self.nan, "NaN")];
        let found: Vec<&str> = kinds.into_iter().filter(|kind| kind.0 > 0).map(|kind| kind.1).collect();
        Err(Error::input(format!("the depth is {} everywhere: no depth was rendered", found.join(" or ")))
            .help("check the depth pass of the render, or name another channel with `depth_channel`"))
    }
}

/// Depths without their minus sign; positive ones become background.
fn turned(depth: &mut Plane) {
    let turn = |value: &mut f32| *value = if *value > 0.0 { f32::INFINITY } else { -*value };
    parallel::for_each_block(depth.values_mut(), &|_, values| values.iter_mut().for_each(turn));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn peel(depths: &[f32]) -> Peel {
        let alpha = Plane::filled(depths.len(), 1, 1.0);
        let depth = Plane::from_values(depths.len(), 1, depths);
        Peel { color: std::array::from_fn(|_| alpha.clone()), alpha, depth }
    }

    fn refused(depths: &[f32]) -> Option<String> {
        DepthValues::of(&[peel(depths)]).check(false).err().map(|error| error.to_string())
    }

    #[test]
    fn depth_that_is_nowhere_a_distance_is_refused_by_what_it_is() {
        assert!(refused(&[0.0, 0.0]).is_some_and(|text| text.contains("is 0 everywhere")));
        assert!(refused(&[-1.0, -1.0]).is_some_and(|text| text.contains("is -1 everywhere")));
        assert!(refused(&[0.0, f32::NAN]).is_some_and(|text| text.contains("0 or NaN everywhere")));
        for background in [0.0, -1.0, 1e10, f32::INFINITY, f32::NAN, f32::NEG_INFINITY] {
            assert_eq!(refused(&[background, 3.0]), None, "one distance is enough, beside {background}");
        }
    }

    #[test]
    fn a_frame_of_sky_is_a_warning_and_an_empty_one_is_nothing() {
        let found =
            |depths: &[f32], writes_zero| DepthValues::of(&[peel(depths)]).check(writes_zero).unwrap();
        assert!(found(&[1e10, f32::INFINITY, 65504.0], false).is_some_and(|finding| finding.warning));
        assert!(found(&[0.0, 0.0], true).is_some_and(|finding| finding.warning));
        let empty = Peel { alpha: Plane::zeros(2, 1), ..peel(&[0.0, 0.0]) };
        assert_eq!(DepthValues::of(&[empty]).check(false).unwrap(), None);
    }

    #[test]
    fn distances_along_minus_z_lose_their_sign_and_keep_their_background() {
        for (background, turned) in
            [(0.0, 0.0), (f32::NEG_INFINITY, f32::INFINITY), (-1e10, 1e10), (1000.0, f32::INFINITY)]
        {
            let mut peels = [peel(&[-3.0, background, -1.0, -12.0])];
            let values = DepthValues::of(&peels);
            let finding = values.turn_around(&mut peels, DepthConvention::Planar).unwrap();
            assert!(finding.text.contains("-12") && !finding.warning);
            assert_eq!(peels[0].depth.row(0), [3.0, turned, 1.0, 12.0]);
        }
    }

    #[test]
    fn minus_one_or_another_value_beside_depth_is_background() {
        for background in [-1.0, -9999.0] {
            let mut peels = [peel(&[3.0, background, 12.0, background])];
            let (before, values) = (peels.clone(), DepthValues::of(&peels));
            assert_eq!(values.turn_around(&mut peels, DepthConvention::Planar), None);
            assert_eq!((values.doubt(), &peels), (None, &before));
        }
        assert!(DepthValues::of(&[peel(&[3.0, -2.0, 12.0, -4.0])]).doubt().is_some_and(|f| f.warning));
    }
}
