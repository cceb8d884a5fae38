//! Values no blur can carry, replaced where they are read: one NaN must not refuse, nor spread over, a frame.

use crate::finding::Finding;

/// Stands for `+∞`: the largest finite half.
const LARGEST: f32 = 65504.0;
/// How far alpha may leave 0 … 1 before it is worth a word: reconstruction filters overshoot by less.
const ALPHA_SLACK: f32 = 0.01;

/// How many values were replaced.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Replaced {
    /// Colour values that were NaN.
    pub(super) nan: usize,
    /// Colour values that were infinite.
    pub(super) infinite: usize,
    /// Alpha values that were NaN or clearly outside 0 … 1.
    pub(super) alpha: usize,
}

impl Replaced {
    /// Adds the counts of another part of the picture.
    pub(super) fn add(&mut self, other: Self) {
        self.nan += other.nan;
        self.infinite += other.infinite;
        self.alpha += other.alpha;
    }

    /// One warning for everything replaced, if anything was.
    pub(super) fn finding(self) -> Option<Finding> {
        let mut said = Vec::new();
        if self.nan > 0 {
            said.push(format!("{} colour values were NaN, set to 0", self.nan));
        }
        if self.infinite > 0 {
            said.push(format!("{} colour values were infinite, set to {LARGEST} or 0", self.infinite));
        }
        if self.alpha > 0 {
            said.push(format!("{} alpha values were not within 0 and 1, clamped", self.alpha));
        }
        (!said.is_empty()).then(|| Finding::warning("values", said.join("; ")))
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
    let sound = -ALPHA_SLACK..=1.0 + ALPHA_SLACK;
    let mut wrong = 0;
    for value in row {
        wrong += usize::from(!sound.contains(value));
        // Not `clamp`, which keeps NaN; `max` returns the other operand.
        *value = value.max(0.0);
        *value = value.min(1.0);
    }
    replaced.alpha += wrong;
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
