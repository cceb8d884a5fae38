//! How much of the picture around a pixel its value depends on.

use super::parameters::ShearParameters;
use super::{near, prefilter};
use crate::methods::contract::Plan;
use crate::scene::EffectKind;

/// Radii of the prefilter's box beyond which its response is not visible: `e^(−√6 · 4)`, below a ten-thousandth of the light of the few
/// fragments that lie so far from the pixel.
const PREFILTER_RADII: f32 = 4.0;

/// Rows that lights, estimated colours and the anti-aliasing look at around a fragment.
const AROUND_A_FRAGMENT: usize = 16;

/// Rows above and below a pixel on which its value depends, where fragments contribute to pixels within `reach_px`.
///
/// The colour of a fragment that contributes is the mean over its surface, as far as the prefilter goes; near light is smoothed after that.
/// An estimated surface takes its colours from fragments that are again as far away as the blur reaches, and smooths them.
pub(super) fn rows(plan: &Plan, reach_px: usize) -> usize {
    let reach = reach_px as f32;
    let strength = plan.strength(EffectKind::Prefilter).unwrap_or(0.0);
    let views = plan.views.unwrap_or(ShearParameters::default().views);
    let filtered = PREFILTER_RADII * prefilter::radius_per_coc(views, strength) * reach;
    let filled = if plan.does(EffectKind::Fill) { 1.25 * reach } else { 0.0 };
    reach_px + (filtered + filled).ceil() as usize + near::MAX_RADIUS_PX as usize + AROUND_A_FRAGMENT
}
