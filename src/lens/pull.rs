//! Pulls: what a setting is between its keys along a sequence of frames.
//!
//! Between two keys of focus the *reciprocal* distance is interpolated, `1/z = (1 − e)/z₀ + e/z₁`. That is close to
//! turning a focus ring at constant speed: the lens moves by `f²/(z − f)` from its position for infinity, which is `f²/z` except in
//! close-ups, and by `c(z) = c_inf (1 − z_f/z)` every blur changes linearly with it. A pull to infinity is possible, too. The same law holds for
//! f-numbers, `1/N = (1 − e)/N₀ + e/N₁`: the diameter of the aperture, and with it every blur, changes linearly, and a pinhole (f/∞) is
//! possible. Focal lengths are interpolated as they are.

use crate::settings::{Easing, Interpolation, Keyed};

/// Where a frame lies among keys.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pull {
    /// Index of the key before the frame.
    pub from: usize,
    /// Index of the key after it; the same as `from` where the setting is constant.
    pub to: usize,
    /// Eased progress from one key to the other, 0 … 1.
    pub eased: f32,
}

impl Pull {
    /// The position of frame `frame` among `keys`, which are in rising order of frame; `None` without keys.
    ///
    /// Before the first key and after the last, the setting has the key's value.
    pub(crate) fn at(keys: &[impl Keyed], frame: i64) -> Option<Self> {
        let next = keys.partition_point(|key| key.frame() <= frame);
        let last = keys.len().checked_sub(1)?;
        let (from, to) = (next.saturating_sub(1), next.min(last));
        let span = keys[to].frame() as f64 - keys[from].frame() as f64;
        let progress = if span > 0.0 { (frame as f64 - keys[from].frame() as f64) / span } else { 0.0 };
        let eased = keys[from].easing().eased(progress) as f32;
        Some(if eased > 0.0 { Self { from, to, eased } } else { Self { from, to: from, eased } })
    }

    /// The value between the keys' values `from` and `to`; with [`Interpolation::Reciprocal`] they may be infinite.
    pub(crate) fn value(&self, interpolation: Interpolation, from: f32, to: f32) -> f32 {
        if self.from == self.to {
            return from;
        }
        let [from, to, eased] = [from, to, self.eased].map(f64::from);
        match interpolation {
            Interpolation::Linear => ((1.0 - eased) * from + eased * to) as f32,
            Interpolation::Reciprocal => ((1.0 - eased) / from + eased / to).recip() as f32,
        }
    }
}

impl Easing {
    /// Progress at the share `progress` of the time between two keys.
    fn eased(self, progress: f64) -> f64 {
        match self {
            Self::Linear => progress,
            Self::Smooth => progress * progress * (3.0 - 2.0 * progress),
            Self::Hold => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::NumberKey;

    /// Keys at `frames`, all with one easing.
    fn keys(frames: &[i64], easing: Easing) -> Vec<NumberKey> {
        frames.iter().map(|&frame| NumberKey { frame, value: 2.0, easing }).collect()
    }

    fn eased(easing: Easing, frame: i64) -> f32 {
        Pull::at(&keys(&[0, 8], easing), frame).unwrap().eased
    }

    #[test]
    fn before_the_first_key_and_after_the_last_nothing_changes() {
        let keys = keys(&[-3, 5], Easing::Linear);
        for (frame, key) in [(i64::MIN, 0), (-4, 0), (-3, 0), (5, 1), (6, 1), (i64::MAX, 1)] {
            let constant = Pull { from: key, to: key, eased: 0.0 };
            assert_eq!(Pull::at(&keys, frame), Some(constant), "{frame}");
        }
        assert_eq!(Pull::at(&keys, 1), Some(Pull { from: 0, to: 1, eased: 0.5 }));
        assert_eq!(Pull::at(&keys[..0], 1), None, "no key, no value");
    }

    #[test]
    fn linear_has_constant_speed_and_smooth_is_slow_at_both_ends() {
        assert_eq!([2, 4, 6].map(|frame| eased(Easing::Linear, frame)), [0.25, 0.5, 0.75]);
        // 3 t² − 2 t³ at a quarter: 3/16 − 2/64 = 5/32.
        assert_eq!([2, 4, 6].map(|frame| eased(Easing::Smooth, frame)), [0.15625, 0.5, 0.84375]);
        // At t = 1/8 progress is 3/64 − 2/512 = 11/256, about a third of linear progress; at 7/8 it is 1 − 11/256.
        assert_eq!([1, 7].map(|frame| eased(Easing::Smooth, frame)), [11.0 / 256.0, 245.0 / 256.0]);
    }

    #[test]
    fn hold_keeps_the_value_until_the_next_key() {
        let keys = keys(&[0, 8], Easing::Hold);
        let indices = |frame| Pull::at(&keys, frame).map(|pull| (pull.from, pull.to));
        assert_eq!([0, 7, 8].map(indices), [Some((0, 0)), Some((0, 0)), Some((1, 1))]);
    }

    #[test]
    fn the_easing_of_a_key_holds_until_the_next_key() {
        let mut keys = keys(&[0, 8, 16], Easing::Linear);
        keys[1].easing = Easing::Smooth;
        assert_eq!(Pull::at(&keys, 2), Some(Pull { from: 0, to: 1, eased: 0.25 }));
        assert_eq!(Pull::at(&keys, 10), Some(Pull { from: 1, to: 2, eased: 0.15625 }));
    }

    #[test]
    fn halfway_the_reciprocal_is_the_mean_of_reciprocals() {
        let halfway =
            |from, to| Pull { from: 0, to: 1, eased: 0.5 }.value(Interpolation::Reciprocal, from, to);
        assert_eq!(halfway(2.0, 6.0), 3.0, "2 · 2 · 6 / (2 + 6)");
        assert_eq!(halfway(2.0, f32::INFINITY), 4.0, "halfway to infinity the distance is doubled");
        assert_eq!(halfway(f32::INFINITY, f32::INFINITY), f32::INFINITY);
    }

    #[test]
    fn halfway_a_focal_length_is_the_mean() {
        let halfway = Pull { from: 0, to: 1, eased: 0.5 };
        assert_eq!(halfway.value(Interpolation::Linear, 24.0, 85.0), 54.5);
    }

    #[test]
    fn values_between_two_keys_rise_with_every_frame_and_end_at_the_keys() {
        for interpolation in [Interpolation::Linear, Interpolation::Reciprocal] {
            for easing in [Easing::Linear, Easing::Smooth] {
                let keys = keys(&[10, 30], easing);
                let at = |frame| {
                    let pull = Pull::at(&keys, frame).unwrap();
                    let [from, to] = [pull.from, pull.to].map(|key| [1.4, 16.0][key]);
                    pull.value(interpolation, from, to)
                };
                let values: Vec<f32> = (10..=30).map(at).collect();
                assert!(
                    values.windows(2).all(|pair| pair[0] < pair[1]),
                    "{interpolation:?} {easing:?}: {values:?}"
                );
                assert_eq!((values[0], values[20]), (1.4, 16.0));
            }
        }
    }

    #[test]
    fn at_a_key_the_value_is_exactly_the_keys() {
        let pull = Pull { from: 1, to: 1, eased: 0.0 };
        assert_eq!(pull.value(Interpolation::Reciprocal, 0.1, 0.1), 0.1);
        assert_eq!(pull.value(Interpolation::Linear, 0.1, 0.1), 0.1);
    }
}
