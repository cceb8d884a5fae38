//! Replacement of NaN, infinite and out-of-range values while reading. A single NaN must neither make a frame fail nor spread with the
//! blur.

use crate::finding::Finding;

/// Replaces `+∞`: the largest finite half float.
const LARGEST: f32 = 65504.0;
/// Alpha outside 0 … 1 by more than this is reported; reconstruction filters overshoot by less.
const ALPHA_SLACK: f32 = 0.01;

/// Numbers of replaced values.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Replaced {
    /// Colour values that were NaN.
    pub(super) nan: usize,
    /// Colour values that were infinite.
    pub(super) infinite: usize,
    /// Alpha values that were NaN or outside 0 … 1 by more than [`ALPHA_SLACK`].
    pub(super) alpha: usize,
}

impl Replaced {
    /// Adds the counts of another part of the picture.
    pub(super) fn add(&mut self, other: Self) {
        self.nan += other.nan;
        self.infinite += other.infinite;
        self.alpha += other.alpha;
    }

    /// A warning about the replaced values, if there are any.
    pub(super) fn finding(self) -> Option<Finding> {
        let mut parts = Vec::new();
        if self.nan > 0 {
            parts.push(format!("{} colour values were NaN, set to 0", self.nan));
        }
        if self.infinite > 0 {
            parts.push(format!("{} colour values were infinite, set to {LARGEST} or 0", self.infinite));
        }
        if self.alpha > 0 {
            parts.push(format!("{} alpha values were outside 0 … 1, clamped", self.alpha));
        }
        (!parts.is_empty()).then(|| Finding::warning("values", parts.join("; ")))
    }
}

/// Replaces NaN by 0, `+∞` by the largest half and `−∞` by 0; negative finite colour stays.
pub(super) fn color(row: &mut [f32], replaced: &mut Replaced) {
    if row.iter().fold(true, |finite, value| finite & value.is_finite()) {
        return;
    }
    for value in row {
        if value.is_nan() {
            *value = 0.0;
            replaced.nan += 1;
        } else if value.is_infinite() {
            *value = if *value > 0.0 { LARGEST } else { 0.0 };
            replaced.infinite += 1;
        }
    }
}

/// Clamps alpha to 0 … 1, NaN to 0.
pub(super) fn alpha(row: &mut [f32], replaced: &mut Replaced) {
    let tolerated = -ALPHA_SLACK..=1.0 + ALPHA_SLACK;
    let mut invalid = 0;
    for value in row {
        invalid += usize::from(!tolerated.contains(value));
        // Not `clamp`, which keeps NaN: `max` with NaN returns the other operand.
        *value = value.max(0.0);
        *value = value.min(1.0);
    }
    replaced.alpha += invalid;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colour_that_is_not_finite_is_replaced_and_negative_colour_stays() {
        let mut row = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -0.5, 2.0];
        let mut replaced = Replaced::default();
        color(&mut row, &mut replaced);
        assert_eq!(row, [0.0, 65504.0, 0.0, -0.5, 2.0]);
        assert_eq!(replaced, Replaced { nan: 1, infinite: 2, alpha: 0 });
    }

    #[test]
    fn alpha_is_clamped_and_a_filter_overshoot_is_not_counted() {
        let mut row = [f32::NAN, -3.0, 1.005, 0.25, f32::INFINITY];
        let mut replaced = Replaced::default();
        alpha(&mut row, &mut replaced);
        assert_eq!(row, [0.0, 0.0, 1.0, 0.25, 1.0]);
        assert_eq!(replaced.alpha, 3);
    }
}
