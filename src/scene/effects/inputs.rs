//! What effects are decided from.

use super::words::EffectKind;
use crate::lens::Optics;
use crate::scene::extrapolation::Extrapolation;
use crate::scene::stats::SceneStats;

/// What effects are decided from: every decision is a pure function of this.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct Inputs<'a> {
    /// The scene's statistics.
    pub stats: &'a SceneStats,
    /// Lens samples a pixel, where their number is known already.
    pub views: Option<usize>,
    /// Where in the pixel the views lie, as a share of its width.
    pub jitter: f32,
    /// The lens with all that was requested.
    pub optics: &'a Optics,
    /// How highlights are extrapolated.
    pub extrapolation: Extrapolation,
    /// The passes that the method has.
    pub passes: &'a [EffectKind],
}

impl Inputs<'_> {
    /// The larger of the two ends of the CoC range.
    pub fn max_coc_px(&self) -> f32 {
        let [near, far] = self.stats.coc_range_px;
        far.abs().max(near.abs())
    }

    /// The longest shift of a ray by the aberrations that the method follows.
    pub fn longest_shift_px(&self) -> f32 {
        let able = |kind| self.passes.contains(&kind);
        let spherical_px = if able(EffectKind::SphericalAberration) { self.optics.spherical_px } else { 0.0 };
        let axial_px = if able(EffectKind::AxialColor) { self.optics.axial_px } else { [0.0; 3] };
        Optics { spherical_px, axial_px, ..self.optics.clone() }.longest_shift_px()
    }
}

/// `part` of `whole` in percent; 0 of nothing.
pub(crate) fn percent(part: usize, whole: usize) -> f64 {
    100.0 * part as f64 / whole.max(1) as f64
}
