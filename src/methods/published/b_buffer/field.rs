//! The levels of a B-buffer: how contributions are divided among them, and how levels are combined.

use super::parameters::BBufferParameters;
#[cfg(feature = "gpu")]
use crate::gpu::mirrored;
use crate::methods::contract::Plan;
use crate::methods::shared::{Rows, max_levels};
use pulp::{Arch, NullaryFnOnce};

/// The side of the focal plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    Near,
    Far,
}

/// A B-buffer: the contributions on one side of the in-focus image, and how they are divided among levels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Field {
    pub side: Side,
    /// The coarsest level.
    pub coarsest: usize,
    /// CoC radius in pixels up to which a contribution is in focus and not in the field.
    pub in_focus_px: f32,
    /// Variance of the aperture in squared CoC radii, the mean of both axes.
    pub second_moment: f32,
}

#[cfg(feature = "gpu")]
mirrored! {
    /// How the share of a contribution that goes to a level of a field depends on its CoC radius.
    pub(super) struct LevelWeights {
        /// 1 behind focus, -1 in front of it.
        sign: f32,
        in_focus_px: f32,
        /// Squared CoC radius in pixels at which the share begins, and how fast it rises.
        rise_start_px2: f32,
        rise_slope: f32,
        /// Squared CoC radius in pixels at which the share ends, and how fast it falls to there.
        fall_end_px2: f32,
        fall_slope: f32,
        /// Squared CoC radius in pixels at which the share is 1.
        peak_px2: f32,
        /// 1 where the field has levels coarser than level 0.
        has_coarser: u32,
    }
}

/// Variance along each axis, in squared pixels, of a contribution that was reduced to level `n` and expanded again.
fn level_variance(n: usize) -> f32 {
    0.5 * ((2.0 * n as f32).exp2() - 1.0)
}

impl Field {
    pub(super) fn new(side: Side, plan: &Plan, frame: (usize, usize)) -> Self {
        let second_moment = plan.optics.aperture.second_moments().element_sum() * 0.5;
        let [nearest, farthest] = plan.coc_range_px;
        let largest = match side {
            Side::Near => nearest.min(0.0),
            Side::Far => farthest.max(0.0),
        };
        let limit = max_levels(frame);
        let coarsest =
            (0..limit).find(|&n| level_variance(n) >= second_moment * largest.powi(2)).unwrap_or(limit);
        Self {
            side,
            coarsest,
            in_focus_px: plan.parameters.get::<BBufferParameters>().in_focus_px,
            second_moment,
        }
    }

    /// Writes to `weights` the share of contributions of CoC radius `coc_px` that goes to level `n`.
    pub(super) fn weigh(&self, n: usize, coc_px: &[f32], weights: &mut [f32]) {
        let [rise, fall] = self.ramps(n);
        Arch::new().dispatch(WeighRow { field: *self, rise, fall, coc_px, weights });
    }

    /// Squared CoC radii at which the share of level `n` begins and ends, and the slopes there. The share of level 0 has no
    /// beginning and that of the coarsest level no end.
    fn ramps(&self, n: usize) -> [[f32; 2]; 2] {
        let [below, own, above] =
            [n.saturating_sub(1), n, n + 1].map(|n| level_variance(n) / self.second_moment);
        let rise = if n == 0 { [-1.0, 1.0] } else { [below, 1.0 / (own - below)] };
        let fall = if n == self.coarsest { [f32::MAX, 1.0] } else { [above, 1.0 / (above - own)] };
        [rise, fall]
    }

    /// The values by which [`Self::weigh`] and [`Self::finer_share`] weigh.
    #[cfg(feature = "gpu")]
    pub(super) fn level_weights(&self, n: usize) -> LevelWeights {
        let [[rise_start_px2, rise_slope], [fall_end_px2, fall_slope]] = self.ramps(n);
        LevelWeights {
            sign: if self.side == Side::Near { -1.0 } else { 1.0 },
            in_focus_px: self.in_focus_px,
            rise_start_px2,
            rise_slope,
            fall_end_px2,
            fall_slope,
            peak_px2: level_variance(n) / self.second_moment,
            has_coarser: u32::from(self.coarsest > 0),
        }
    }

    /// Replaces the shares of level `n` in `weights` by those that the same contributions have in the next finer level.
    pub(super) fn finer_share(&self, n: usize, coc_px: &[f32], weights: &mut [f32]) {
        let peak_px2 = level_variance(n) / self.second_moment;
        for (weight, &coc) in weights.iter_mut().zip(coc_px) {
            *weight = if *weight > 0.0 && coc * coc < peak_px2 { 1.0 - *weight } else { 0.0 };
        }
    }

    /// Whether contributions of CoC radii between `near` and `far` may have a share in level `n`.
    pub(super) fn may_have(&self, n: usize, [near, far]: [f32; 2]) -> bool {
        let [min_px, max_px] = match self.side {
            Side::Near => [-far, -near],
            Side::Far => [near, far],
        };
        let peak_px2 = |n: usize| level_variance(n) / self.second_moment;
        max_px > self.in_focus_px
            && (n == 0 || max_px.powi(2) > peak_px2(n - 1))
            && (n == self.coarsest || min_px <= 0.0 || min_px.powi(2) < peak_px2(n + 1))
    }

    /// Combines the rows `own` of a level with the `expanded` rows of the coarser levels, in place; the last row is occupancy.
    ///
    /// The nearer of the two is kept, and the farther fills the remaining occupancy up to one. Behind focus, `in_finer` stays
    /// free as well: the occupancy that the surfaces of this level have in the next finer one. Otherwise these surfaces would mix
    /// with what they hide before they are complete.
    pub(super) fn combine(&self, own: &[&[f32]], in_finer: Option<&[f32]>, expanded: &mut Rows) {
        let (Some((own_occupancy, own)), Some((occupancy, expanded))) =
            (own.split_last(), expanded.split_last_mut())
        else {
            return;
        };
        let share_of = |value: f32, remaining: f32| {
            if value > remaining.max(0.0) { remaining.max(0.0) / value } else { 1.0 }
        };
        let shares: Vec<[f32; 2]> = own_occupancy
            .iter()
            .zip(&*occupancy)
            .enumerate()
            .map(|(x, (&own, &coarser))| match self.side {
                Side::Far => {
                    let kept = share_of(own, 1.0);
                    [kept, share_of(coarser, 1.0 - own * kept - in_finer.map_or(0.0, |finer| finer[x]))]
                }
                Side::Near => [share_of(own, 1.0 - coarser), 1.0],
            })
            .collect();
        for (row, own) in expanded.iter_mut().zip(own) {
            add_scaled(row, own, &shares);
        }
        add_scaled(occupancy, own_occupancy, &shares);
    }
}

/// Adds `own` to `expanded`, each scaled by its share.
fn add_scaled(expanded: &mut [f32], own: &[f32], shares: &[[f32; 2]]) {
    for ((value, &own), [share_of_own, share]) in expanded.iter_mut().zip(own).zip(shares) {
        *value = share_of_own * own + share * *value;
    }
}

/// Weighs one row; compiled for each instruction set.
struct WeighRow<'a> {
    field: Field,
    rise: [f32; 2],
    fall: [f32; 2],
    coc_px: &'a [f32],
    weights: &'a mut [f32],
}

impl NullaryFnOnce for WeighRow<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { field, rise: [start, rise], fall: [end, fall], coc_px, weights } = self;
        let sign = if field.side == Side::Near { -1.0 } else { 1.0 };
        for (weight, &coc) in weights.iter_mut().zip(coc_px) {
            let squared = coc * coc;
            let share =
                ((squared - start) * rise).clamp(0.0, 1.0).min(((end - squared) * fall).clamp(0.0, 1.0));
            *weight = if sign * coc > field.in_focus_px { share } else { 0.0 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(side: Side) -> Field {
        Field { side, coarsest: 4, in_focus_px: 0.5, second_moment: 0.25 }
    }

    fn weight(field: Field, n: usize, coc_px: f32) -> f32 {
        let mut weights = [0.0];
        field.weigh(n, &[coc_px], &mut weights);
        weights[0]
    }

    #[test]
    fn shares_add_up_to_one_and_their_mean_variance_is_that_of_the_disc() {
        for coc in [0.6, 1.0, 2.0, 2.5, 3.7, 9.0, 20.0f32] {
            let shares: Vec<f32> = (0..=4).map(|n| weight(field(Side::Far), n, coc)).collect();
            let variance: f32 = shares.iter().enumerate().map(|(n, share)| share * level_variance(n)).sum();
            assert!((shares.iter().sum::<f32>() - 1.0).abs() < 1e-5, "c = {coc}: {shares:?}");
            assert!((variance / (coc * coc / 4.0) - 1.0).abs() < 1e-4, "c = {coc}: {variance}");
            assert!(shares.iter().filter(|&&share| share > 0.0).count() <= 2, "c = {coc}: {shares:?}");
        }
    }

    #[test]
    fn a_field_takes_only_its_own_side() {
        for (coc, near, far) in
            [(-3.0, true, false), (3.0, false, true), (0.5, false, false), (-0.5, false, false)]
        {
            let takes = |side| (0..=4).any(|n| weight(field(side), n, coc) > 0.0);
            assert_eq!((takes(Side::Near), takes(Side::Far)), (near, far), "c = {coc}");
        }
    }

    #[test]
    fn rows_with_a_share_are_never_skipped() {
        for side in [Side::Near, Side::Far] {
            for coc in [-40.0, -22.0, -5.0, -0.6, 0.0, 0.7, 2.6, 11.0, 30.0f32] {
                for n in 0..=4 {
                    let share = weight(field(side), n, coc);
                    assert!(
                        share <= 0.0 || field(side).may_have(n, [coc, coc]),
                        "{side:?}, level {n}, c = {coc}"
                    );
                    assert!(
                        share <= 0.0 || field(side).may_have(n, [-50.0, 50.0]),
                        "{side:?}, level {n}, wide"
                    );
                }
            }
        }
    }

    #[test]
    fn the_nearer_level_is_kept_and_the_farther_fills_the_remaining_occupancy() {
        // Colours 2 and 4, occupancies 0.75 and 0.5: the sum is over one by a quarter.
        let combined = |side| {
            let mut rows = vec![vec![4.0 * 0.5], vec![0.5]];
            field(side).combine(&[&[2.0 * 0.75], &[0.75]], None, &mut rows);
            [rows[0][0], rows[1][0]]
        };
        assert_eq!(combined(Side::Far), [2.0 * 0.75 + 4.0 * 0.25, 1.0], "finer first");
        assert_eq!(combined(Side::Near), [2.0 * 0.5 + 4.0 * 0.5, 1.0], "coarser first");
    }

    #[test]
    fn an_empty_finer_level_adds_nothing_where_rounding_brings_the_coarser_one_over_one() {
        // The remaining occupancy is negative.
        let mut rows = vec![vec![0.5], vec![1.0 + 1e-6]];
        field(Side::Near).combine(&[&[0.0], &[0.0]], None, &mut rows);
        assert_eq!([rows[0][0], rows[1][0]], [0.5, 1.0 + 1e-6]);
    }

    #[test]
    fn occupancy_over_one_is_normalised() {
        for side in [Side::Near, Side::Far] {
            let mut rows = vec![vec![0.0], vec![0.0]];
            field(side).combine(&[&[6.0], &[2.0]], None, &mut rows);
            assert_eq!([rows[0][0], rows[1][0]], [3.0, 1.0], "{side:?}");
        }
    }
}
