//! The inputs of every decision about an effect.

use super::words::EffectKind;
use crate::lens::Optics;
use crate::scene::extrapolation::Extrapolation;
use crate::scene::stats::SceneStats;

/// The inputs of a decision. Every decision is a pure function of them.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct Inputs<'a> {
    /// The scene's statistics.
    pub stats: &'a SceneStats,
    /// Lens samples per pixel; `None` while the number is not known.
    pub views: Option<usize>,
    /// Width of the part of the pixel that views start from, as a share of the pixel's width.
    pub jitter: f32,
    /// The lens with everything that was requested.
    pub optics: &'a Optics,
    /// Parameters of the highlight extrapolation.
    pub extrapolation: Extrapolation,
    /// The passes that the method has.
    pub passes: &'a [EffectKind],
}

impl Inputs<'_> {
    /// The largest absolute CoC radius.
    pub fn max_coc_px(&self) -> f32 {
        let [near, far] = self.stats.coc_range_px;
        far.abs().max(near.abs())
    }

    /// The largest radius of a blurred point: the CoC radius, and what aberrations add.
    pub fn max_blur_px(&self) -> f32 {
        self.max_coc_px() + self.longest_shift_px()
    }

    /// The largest movement of what surfaces reflect, in picture pixels, of which the method moves any; 0 without one.
    pub fn largest_movement_px(&self) -> f32 {
        let has = |kind| self.passes.contains(&kind);
        let moved = self.stats.reflections.filter(|found| found.moving_fragments > 0);
        let moved = moved.filter(|_| has(EffectKind::Reflections)).map(|found| found.largest_movement_px);
        let shaded = self.stats.environment.filter(|_| has(EffectKind::Environment));
        moved.into_iter().chain(shaded.map(|found| found.largest_movement_px)).fold(0.0, f32::max)
    }

    /// The longest shift of a ray by the aberrations that the method simulates.
    pub fn longest_shift_px(&self) -> f32 {
        let has = |kind| self.passes.contains(&kind);
        let spherical_px = if has(EffectKind::SphericalAberration) { self.optics.spherical_px } else { 0.0 };
        let axial_px = if has(EffectKind::AxialColor) { self.optics.axial_px } else { [0.0; 3] };
        Optics { spherical_px, axial_px, ..self.optics.clone() }.longest_shift_px()
    }
}

/// `part` of `whole` in percent; 0 where `whole` is 0.
pub(crate) fn percent(part: usize, whole: usize) -> f64 {
    100.0 * part as f64 / whole.max(1) as f64
}
