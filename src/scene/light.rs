//! Light by luminance: in which steps fragments are counted, and which of them take part in an extrapolation.

/// Luminance of a colour, 1 for white.
#[inline(always)]
pub(super) fn luminance([red, green, blue]: [f32; 3]) -> f32 {
    0.3 * red + 0.59 * green + 0.11 * blue
}

/// The share of its gain that a fragment of this CoC radius has.
#[inline(always)]
pub(super) fn share_of_gain(coc_px: f32) -> f32 {
    (coc_px.abs() - 1.0).clamp(0.0, 1.0)
}

/// Steps of luminance of [`super::SceneStats::light`]: one below 2⁻⁸, [`LIGHT_STEPS_AN_OCTAVE`] in each octave up to white, and white.
pub(super) const LIGHT_STEPS: usize = 2 + 8 * LIGHT_STEPS_AN_OCTAVE;

/// So many that none is wider than a sixteenth.
const LIGHT_STEPS_AN_OCTAVE: usize = 16;

/// Blurred fragments of one step of luminance.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub(crate) struct LightStep {
    /// How many there are.
    pub fragments: usize,
    /// Their light: the sum of their luminances, each by its coverage.
    pub light: f64,
    /// The same, of each as much as takes part in an extrapolation: see [`super::Extrapolation`].
    pub gaining_light: f64,
}

/// The exponent and the first bits of the mantissa of `luminance`, which number the steps of an octave.
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

/// The luminances between which step `step` of [`super::SceneStats::light`] lies.
pub(super) fn light_step_ends(step: usize) -> [f32; 2] {
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
    fn steps_of_light_follow_one_another_up_to_white() {
        for step in 0..LIGHT_STEPS - 1 {
            let [from, to] = light_step_ends(step);
            assert_eq!(light_step_ends(step + 1)[0], to, "step {step}");
            assert_eq!((light_step(from), light_step(0.5 * (from + to))), (step, step), "{from} to {to}");
        }
        let white = luminance([1.0; 3]);
        assert_eq!([white, 1.0, 70.0].map(light_step), [LIGHT_STEPS - 1; 3], "white is the last");
        assert_eq!([-1.0, 0.0, 1e-30].map(light_step), [0; 3]);
    }
}
