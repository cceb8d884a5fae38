//! Highlights that a clipped source has lost, extrapolated (section 4, eq. 8).

use super::hidden::Fragment;
use crate::settings::PointSplatParameters;

/// How bright pixels are made brighter.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extrapolation {
    /// Luminance λ₀ from which they are.
    pub threshold: f32,
    /// Falloff β.
    pub falloff: f32,
    /// Gain γ at luminance 1.
    pub gain: f32,
}

impl Extrapolation {
    /// The extrapolation that is asked for, if any.
    pub(super) fn new(parameters: &PointSplatParameters) -> Option<Self> {
        parameters.extrapolate_highlights.then_some(Self {
            threshold: parameters.highlight_threshold,
            falloff: parameters.highlight_falloff,
            gain: parameters.highlight_gain,
        })
    }

    /// `fragment` with its light extrapolated: the luminance of its colour decides, not of its share of the pixel.
    pub(super) fn apply<const N: usize>(&self, mut fragment: Fragment<N>) -> Fragment<N> {
        // The fourth plane of an open background is the content's own alpha.
        let opacity = fragment.content.get(3).copied().unwrap_or(fragment.weight);
        if opacity > 0.0 {
            let [red, green, blue] = [0, 1, 2].map(|k| fragment.content[k] / opacity);
            let gain = self.gain_at(0.3 * red + 0.59 * green + 0.11 * blue);
            fragment.content.iter_mut().take(3).for_each(|value| *value *= gain);
        }
        fragment
    }

    /// Factor on a colour of luminance λ, `(1 − λ_nᵝ) + λ_nᵝ γ` above the threshold.
    ///
    /// A clipped source ends at 1; beyond it nothing was lost that would have to be guessed, and the gain stays that of 1.
    fn gain_at(&self, luminance: f32) -> f32 {
        let normalised = (luminance.min(1.0) - self.threshold) / (1.0 - self.threshold);
        if normalised <= 0.0 {
            return 1.0;
        }
        let share = normalised.powf(self.falloff);
        (1.0 - share) + share * self.gain
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAPER: Extrapolation = Extrapolation { threshold: 0.8, falloff: 3.0, gain: 2.0 };

    #[test]
    fn only_what_is_brighter_than_the_threshold_gains() {
        assert_eq!(PAPER.gain_at(0.8), 1.0, "at the threshold");
        assert_eq!(PAPER.gain_at(-3.0), 1.0, "below it");
        // λ_n = ½, its cube ⅛: 7/8 + 2/8.
        assert!((PAPER.gain_at(0.9) - 1.125).abs() < 1e-5, "halfway to white");
        assert_eq!(PAPER.gain_at(1.0), 2.0, "white gains γ");
        assert_eq!(PAPER.gain_at(500.0), 2.0, "and what was never clipped no more than white");
    }

    #[test]
    fn luminance_is_that_of_the_colour_whatever_its_coverage() {
        // Half a pixel of white: premultiplied ½.
        let half = Fragment { content: [0.5; 3], weight: 0.5, coc_px: 3.0 };
        assert_eq!(PAPER.apply(half).content, [1.0; 3], "doubled, as white is");
        let open = Fragment { content: [0.5, 0.5, 0.5, 0.5], weight: 1.0, coc_px: 3.0 };
        assert_eq!(PAPER.apply(open).content, [1.0, 1.0, 1.0, 0.5], "its own alpha stays");
    }
}
