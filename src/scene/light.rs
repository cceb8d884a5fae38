//! Histogram of light by luminance: its steps, and how much each fragment takes part in an extrapolation.

/// Luminance of a colour, 1 for white.
#[inline(always)]
pub(super) fn luminance([red, green, blue]: [f32; 3]) -> f32 {
    0.3 * red + 0.59 * green + 0.11 * blue
}

/// Share of the extrapolation's gain that applies to a fragment of this CoC radius.
#[inline(always)]
pub(super) fn share_of_gain(coc_px: f32) -> f32 {
    (coc_px.abs() - 1.0).clamp(0.0, 1.0)
}

/// Number of steps of [`super::SceneStats::light`]: one below 2⁻⁸, [`LIGHT_STEPS_AN_OCTAVE`] in each octave up to white, and one from
/// white on.
pub(super) const LIGHT_STEPS: usize = 2 + 8 * LIGHT_STEPS_AN_OCTAVE;

/// Steps of one octave: none is wider than a sixteenth of its luminance.
const LIGHT_STEPS_AN_OCTAVE: usize = 16;

/// Blurred fragments of one step of luminance.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub(crate) struct LightStep {
    /// Number of fragments.
    pub fragments: usize,
    /// Sum of their luminances, premultiplied by alpha.
    pub light: f64,
    /// The same sum, each luminance times the share of it that takes part in an extrapolation: see [`super::Extrapolation`].
    pub gaining_light: f64,
}

/// The exponent and the first bits of the mantissa of `luminance`. They number the steps, since an octave is one exponent.
#[inline(always)]
const fn light_bits(luminance: f32) -> u32 {
    const DROPPED: u32 = f32::MANTISSA_DIGITS - 1 - LIGHT_STEPS_AN_OCTAVE.ilog2();
    luminance.to_bits() >> DROPPED
}

/// Luminance of the first step of [`super::SceneStats::light`] after the darkest.
const MIN_LIGHT: f32 = 1.0 / 256.0;

/// The step of [`super::SceneStats::light`] that `luminance` falls into.
#[inline(always)]
pub(super) fn light_step(luminance: f32) -> usize {
    let bits = light_bits(luminance.max(0.0));
    ((bits + 1).saturating_sub(light_bits(MIN_LIGHT)) as usize).min(LIGHT_STEPS - 1)
}

/// Lower and upper luminance of step `step` of [`super::SceneStats::light`].
pub(super) fn light_step_bounds(step: usize) -> [f32; 2] {
    let from = |step: usize| {
        let (octave, part) = ((step - 1) / LIGHT_STEPS_AN_OCTAVE, (step - 1) % LIGHT_STEPS_AN_OCTAVE);
        MIN_LIGHT * (octave as f32).exp2() * (1.0 + part as f32 / LIGHT_STEPS_AN_OCTAVE as f32)
    };
    match step {
        0 => [0.0, MIN_LIGHT],
        step if step + 1 < LIGHT_STEPS => [from(step), from(step + 1)],
        _ => [1.0, 1.0],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_of_light_are_contiguous_up_to_white() {
        for step in 0..LIGHT_STEPS - 1 {
            let [from, to] = light_step_bounds(step);
            assert_eq!(light_step_bounds(step + 1)[0], to, "step {step}");
            assert_eq!((light_step(from), light_step(0.5 * (from + to))), (step, step), "{from} to {to}");
        }
        let white = luminance([1.0; 3]);
        assert_eq!([white, 1.0, 70.0].map(light_step), [LIGHT_STEPS - 1; 3], "white is the last");
        assert_eq!([-1.0, 0.0, 1e-30].map(light_step), [0; 3]);
    }
}
