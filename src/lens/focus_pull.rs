//! Focus pulls: the focus distance between keys along a sequence of frames.
//!
//! Between two keys the *reciprocal* distance is interpolated, `1/z = (1 − e)/z₀ + e/z₁`. That is close to
//! turning a focus ring at constant speed: the lens moves by `f²/(z − f)` from its position for infinity, which is `f²/z` except in
//! close-ups, and by `c(z) = c_inf (1 − z_f/z)` every blur changes linearly with it. A pull to infinity is possible, too.

use crate::settings::{Easing, FocusKey};

/// Where a frame lies among focus keys.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FocusPull {
    /// Index of the key before the frame.
    pub from: usize,
    /// Index of the key after it; the same as `from` where the focus is constant.
    pub to: usize,
    /// Eased progress from one key to the other, 0 … 1.
    pub eased: f32,
}

impl FocusPull {
    /// The position of frame `frame` among `keys`, which are in rising order of frame; `None` without keys.
    ///
    /// Before the first key and after the last, the focus is that of the key.
    pub(crate) fn at(keys: &[FocusKey], frame: i64) -> Option<Self> {
        let next = keys.partition_point(|key| key.frame <= frame);
        let last = keys.len().checked_sub(1)?;
        let (from, to) = (next.saturating_sub(1), next.min(last));
        let span = keys[to].frame as f64 - keys[from].frame as f64;
        let progress = if span > 0.0 { (frame as f64 - keys[from].frame as f64) / span } else { 0.0 };
        let eased = keys[from].easing.eased(progress) as f32;
        Some(if eased > 0.0 { Self { from, to, eased } } else { Self { from, to: from, eased } })
    }

    /// Focus distance between the keys' distances `from` and `to`, which may be infinite.
    pub(crate) fn distance(&self, from: f32, to: f32) -> f32 {
        if self.from == self.to {
            return from;
        }
        let eased = f64::from(self.eased);
        ((1.0 - eased) / f64::from(from) + eased / f64::from(to)).recip() as f32
    }
}

impl Easing {
    /// Progress of the focus at the share `progress` of the time between two keys.
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
    use crate::settings::Focus;

    /// Keys at `frames`, all with one easing.
    fn keys(frames: &[i64], easing: Easing) -> Vec<FocusKey> {
        frames.iter().map(|&frame| FocusKey { frame, focus: Focus::Centre, easing }).collect()
    }

    fn eased(easing: Easing, frame: i64) -> f32 {
        FocusPull::at(&keys(&[0, 8], easing), frame).unwrap().eased
    }

    #[test]
    fn before_the_first_key_and_after_the_last_focus_is_constant() {
        let keys = keys(&[-3, 5], Easing::Linear);
        for (frame, key) in [(i64::MIN, 0), (-4, 0), (-3, 0), (5, 1), (6, 1), (i64::MAX, 1)] {
            let constant = FocusPull { from: key, to: key, eased: 0.0 };
            assert_eq!(FocusPull::at(&keys, frame), Some(constant), "{frame}");
        }
        assert_eq!(FocusPull::at(&keys, 1), Some(FocusPull { from: 0, to: 1, eased: 0.5 }));
        assert_eq!(FocusPull::at(&[], 1), None, "no key, no focus");
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
    fn hold_keeps_the_focus_until_the_next_key() {
        let keys = keys(&[0, 8], Easing::Hold);
        let indices = |frame| FocusPull::at(&keys, frame).map(|pull| (pull.from, pull.to));
        assert_eq!([0, 7, 8].map(indices), [Some((0, 0)), Some((0, 0)), Some((1, 1))]);
    }

    #[test]
    fn the_easing_of_a_key_holds_until_the_next_key() {
        let mut keys = keys(&[0, 8, 16], Easing::Linear);
        keys[1].easing = Easing::Smooth;
        assert_eq!(FocusPull::at(&keys, 2), Some(FocusPull { from: 0, to: 1, eased: 0.25 }));
        assert_eq!(FocusPull::at(&keys, 10), Some(FocusPull { from: 1, to: 2, eased: 0.15625 }));
    }

    #[test]
    fn halfway_the_distance_is_the_harmonic_mean() {
        let halfway = FocusPull { from: 0, to: 1, eased: 0.5 };
        assert_eq!(halfway.distance(2.0, 6.0), 3.0, "2 · 2 · 6 / (2 + 6)");
        assert_eq!(halfway.distance(2.0, f32::INFINITY), 4.0, "halfway to infinity the distance is doubled");
        assert_eq!(halfway.distance(f32::INFINITY, f32::INFINITY), f32::INFINITY);
    }

    #[test]
    fn constant_focus_has_exactly_the_keys_distance() {
        let pull = FocusPull { from: 1, to: 1, eased: 0.0 };
        assert_eq!(pull.distance(0.1, 0.1), 0.1);
    }
}
