//! The kind of a stack: what its fragments represent, detected from alpha and depth.
//!
//! | kind | sign |
//! | --- | --- |
//! | supersampled | a setting or the header |
//! | beauty and depth | one peel |
//! | renderer's own anti-aliased peels | fractional alpha, partly with background depth: colour was filtered, depth was not |
//! | coverage peels | fractional alpha in the first peel, with depth |
//! | point-sampled peels | otherwise |

use super::depth::{foreground, is_background};
use super::{Peel, StackKind};
use crate::finding::Finding;
use crate::image::Plane;
use crate::settings::DepthConvention;
use rayon::prelude::*;
use std::ops::Range;

/// Alpha within this distance of 0 or 1 is not fractional: half floats and lossy codecs round.
const ALPHA_ROUNDING: f32 = 1e-3;
/// A smaller share of fractional pixels is noise: stray samples of a stochastic renderer.
const FRACTIONAL_SHARE: f64 = 1e-3;
/// Above this share of fractional fragments without depth, depth was not filtered with colour.
const DEPTHLESS_SHARE: f64 = 0.05;
/// Above this share of pixels in which a peel is nearer than the previous one, the order is wrong.
const DISORDER_SHARE: f64 = 0.5;

/// Counts of one peel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PeelCounts {
    /// Pixels with depth.
    with_depth: usize,
    /// Pixels with fractional alpha and depth.
    fractional: usize,
    /// Pixels with fractional alpha and background depth.
    depthless: usize,
    /// Pixels in which both this peel and the previous one have depth.
    behind_another: usize,
    /// Those of them in which this peel is nearer.
    disordered: usize,
    /// Smallest and largest depth; `[∞, −∞]` if no pixel has depth.
    range: [f32; 2],
}

/// Counts of all peels.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct StackStats {
    peels: Vec<PeelCounts>,
    pixels: usize,
    /// Smallest and largest depth value that is not background.
    pub(super) depth_range: Option<[f32; 2]>,
}

impl PeelCounts {
    const NONE: Self = Self {
        with_depth: 0,
        fractional: 0,
        depthless: 0,
        behind_another: 0,
        disordered: 0,
        range: [f32::INFINITY, f32::NEG_INFINITY],
    };

    fn plus(self, other: Self) -> Self {
        Self {
            with_depth: self.with_depth + other.with_depth,
            fractional: self.fractional + other.fractional,
            depthless: self.depthless + other.depthless,
            behind_another: self.behind_another + other.behind_another,
            disordered: self.disordered + other.disordered,
            range: [self.range[0].min(other.range[0]), self.range[1].max(other.range[1])],
        }
    }
}

/// Counts what the kind is detected from. All peels have one size.
pub(super) fn analyze(peels: &[Peel], convention: DepthConvention) -> StackStats {
    let nearer_is_larger = convention == DepthConvention::Inverse;
    let test =
        DepthTest { foreground: foreground(convention), sign: if nearer_is_larger { -1.0 } else { 1.0 } };
    let stats: Vec<PeelCounts> = (0..peels.len())
        .map(|i| {
            let before = i.checked_sub(1).map(|before| &peels[before].depth);
            let count = |y| {
                let (alpha, depth) = (peels[i].alpha.row(y), peels[i].depth.row(y));
                test.count_row(alpha, depth, before.map(|before| before.row(y)))
            };
            let rows = (0..peels[i].depth.height()).into_par_iter();
            rows.with_min_len(64).map(count).reduce(|| PeelCounts::NONE, PeelCounts::plus)
        })
        .collect();
    let all = stats.iter().copied().fold(PeelCounts::NONE, PeelCounts::plus);
    let [low, high] = all.range;
    let range = if nearer_is_larger { [-high, -low] } else { [low, high] };
    let pixels = peels.first().map_or(0, |peel| peel.depth.values().len());
    StackStats { peels: stats, pixels, depth_range: (all.with_depth > 0).then_some(range) }
}

/// Tests whether a depth is foreground, and which of two depths is farther.
struct DepthTest {
    foreground: Range<f32>,
    /// −1 where a larger value is nearer.
    sign: f32,
}

impl DepthTest {
    /// The counts of one row; without branches, so that the loops are vectorized.
    fn count_row(&self, alpha: &[f32], depth: &[f32], before: Option<&[f32]>) -> PeelCounts {
        let mut stats = PeelCounts::NONE;
        let (mut with_depth, mut fractional, mut depthless) = (0u32, 0u32, 0u32);
        for (&alpha, &depth) in alpha.iter().zip(depth) {
            let known = self.is_foreground(depth);
            let partial = (alpha > ALPHA_ROUNDING) & (alpha < 1.0 - ALPHA_ROUNDING);
            with_depth += u32::from(known);
            fractional += u32::from(partial & known);
            depthless += u32::from(partial & !known);
        }
        let (mut both, mut disordered) = (0u32, 0u32);
        for (&depth, &front) in depth.iter().zip(before.unwrap_or_default()) {
            let known = self.is_foreground(depth) & self.is_foreground(front);
            both += u32::from(known);
            disordered += u32::from(known & (self.sign * depth < self.sign * front));
        }
        stats.behind_another = both as usize;
        stats.disordered = disordered as usize;
        stats.with_depth = with_depth as usize;
        stats.fractional = fractional as usize;
        stats.depthless = depthless as usize;
        stats.range = self.range(depth);
        stats
    }

    /// Nearest and farthest foreground depth, with the sign that makes values grow with distance.
    fn range(&self, depth: &[f32]) -> [f32; 2] {
        // Each lane has its own minimum and maximum, so that no iteration depends on the previous one.
        const LANES: usize = 16;
        let [none_low, none_high] = PeelCounts::NONE.range;
        let (mut low, mut high) = ([none_low; LANES], [none_high; LANES]);
        let mut widen = |values: &[f32]| {
            for ((low, high), &depth) in low.iter_mut().zip(&mut high).zip(values) {
                let (known, far) = (self.is_foreground(depth), self.sign * depth);
                *low = if known & (far < *low) { far } else { *low };
                *high = if known & (far > *high) { far } else { *high };
            }
        };
        let (whole, rest) = depth.as_chunks::<LANES>();
        whole.iter().for_each(|values| widen(values));
        widen(rest);
        [low.into_iter().fold(none_low, f32::min), high.into_iter().fold(none_high, f32::max)]
    }

    fn is_foreground(&self, depth: f32) -> bool {
        (depth >= self.foreground.start) & (depth < self.foreground.end)
    }
}

/// The kind of a stack with `supersample` samples per pixel along each axis, and the reason.
pub(super) fn detect(stats: &StackStats, supersample: usize) -> (StackKind, Finding) {
    let first = stats.peels.first().copied().unwrap_or(PeelCounts::NONE);
    let all = stats.peels.iter().copied().fold(PeelCounts::NONE, PeelCounts::plus);
    let share = |count: usize, of: usize| count as f64 / of.max(1) as f64;
    let percent = |share: f64| format!("{:.1} %", share * 100.0);
    let depthless = share(all.depthless, all.depthless + all.fractional);
    let fractional = share(first.fractional, stats.pixels);
    let some_fractional = share(all.depthless + all.fractional, stats.pixels) > FRACTIONAL_SHARE;
    let note = |kind, text: String| (kind, Finding::note("kind", text));
    if supersample > 1 {
        let text = format!(
            "supersampled peels: {supersample}×{supersample} samples per picture pixel, as specified"
        );
        note(StackKind::Supersampled, text)
    } else if stats.peels.len() <= 1 {
        let text = "one picture with depth: surfaces behind it are unknown, so the background behind blurred foregrounds is estimated";
        note(StackKind::BeautyDepth, text.to_owned())
    } else if some_fractional && depthless > DEPTHLESS_SHARE {
        let text = format!(
            "the renderer's own anti-aliased peels: {} of the fragments with fractional alpha have no depth, which is \
             taken from a neighbour; for cleaner edges export point-sampled peels at 2× or more, or coverage peels",
            percent(depthless)
        );
        (StackKind::RendererAntialiased, Finding::warning("kind", text))
    } else if fractional > FRACTIONAL_SHARE {
        let text =
            format!("coverage peels: alpha is fractional in {} of the first peel", percent(fractional));
        note(StackKind::Coverage, text)
    } else {
        let text = format!(
            "point-sampled peels: alpha is 0 or 1 in all but {} of the first peel",
            percent(fractional)
        );
        note(StackKind::PointSampled, text)
    }
}

/// A warning if the peels are not ordered nearest first.
pub(super) fn disorder(stats: &StackStats) -> Option<Finding> {
    stats.peels.iter().enumerate().find_map(|(i, peel)| {
        let share = peel.disordered as f64 / peel.behind_another.max(1) as f64;
        (share > DISORDER_SHARE).then(|| {
            let before = i - 1;
            let text = format!(
                "peel {i} is nearer than peel {before} in {:.0} % of the pixels that both have: order the peels nearest first",
                share * 100.0
            );
            Finding::warning("peels", text)
        })
    })
}

/// Sets the depth of fragments with fractional alpha and no depth to that of a neighbour in their peel, or removes them.
///
/// The neighbour is the first of eight that has both depth and alpha; sides before corners.
pub(super) fn repair_depth(peels: &mut [Peel], convention: DepthConvention) -> Option<Finding> {
    let (mut repaired, mut dropped) = (0, 0);
    for peel in peels {
        let depth = peel.depth.clone();
        for y in 0..depth.height() {
            for x in 0..depth.width() {
                let alpha = peel.alpha.get(x, y);
                let partial = alpha > 0.0 && alpha < 1.0 - ALPHA_ROUNDING;
                if !partial || !is_background(convention, depth.get(x, y)) {
                    continue;
                }
                match neighbour_depth(&peel.alpha, &depth, x, y, convention) {
                    Some(found) => {
                        peel.depth.set(x, y, found);
                        repaired += 1;
                    }
                    None => {
                        peel.color.iter_mut().for_each(|plane| plane.set(x, y, 0.0));
                        peel.alpha.set(x, y, 0.0);
                        dropped += 1;
                    }
                }
            }
        }
    }
    let text = format!(
        "{repaired} fragments without depth have that of a neighbour, {dropped} without such a neighbour were removed"
    );
    (repaired + dropped > 0).then(|| Finding::note("depth", text))
}

fn neighbour_depth(
    alpha: &Plane,
    depth: &Plane,
    x: usize,
    y: usize,
    convention: DepthConvention,
) -> Option<f32> {
    const AROUND: [(isize, isize); 8] =
        [(0, -1), (-1, 0), (1, 0), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)];
    AROUND.iter().find_map(|&(dx, dy)| {
        let x = x.checked_add_signed(dx).filter(|&x| x < depth.width())?;
        let y = y.checked_add_signed(dy).filter(|&y| y < depth.height())?;
        let found = depth.get(x, y);
        (alpha.get(x, y) > 0.0 && !is_background(convention, found)).then_some(found)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A row of fragments, `(alpha, depth)` each; colour is alpha.
    fn peel(fragments: &[(f32, f32)]) -> Peel {
        let plane = |value: &dyn Fn((f32, f32)) -> f32| {
            Plane::from_fn(fragments.len(), 1, |x, _| value(fragments[x]))
        };
        let alpha = plane(&|(alpha, _)| alpha);
        Peel { color: std::array::from_fn(|_| alpha.clone()), depth: plane(&|(_, depth)| depth), alpha }
    }

    fn kind_of(peels: &[Peel]) -> StackKind {
        detect(&analyze(peels, DepthConvention::Planar), 1).0
    }

    #[test]
    fn one_peel_is_a_beauty_pass_with_depth() {
        assert_eq!(kind_of(&[peel(&[(0.5, 1.0)])]), StackKind::BeautyDepth);
    }

    #[test]
    fn alpha_of_0_or_1_means_point_samples_and_fractional_alpha_in_the_first_peel_means_coverage() {
        let back = peel(&[(1.0, 5.0), (0.0, 1e10)]);
        assert_eq!(kind_of(&[peel(&[(1.0, 1.0), (1.0, 1e10)]), back.clone()]), StackKind::PointSampled);
        assert_eq!(kind_of(&[peel(&[(0.25, 1.0), (1.0, 3.0)]), back]), StackKind::Coverage);
    }

    #[test]
    fn fractional_alpha_without_depth_means_a_renderers_own_anti_aliasing() {
        let peels = [peel(&[(1.0, 1.0), (1.0, 1.0)]), peel(&[(0.5, 1e10), (0.5, 4.0)])];
        assert_eq!(kind_of(&peels), StackKind::RendererAntialiased);
    }

    #[test]
    fn a_fragment_without_depth_takes_that_of_a_neighbour_or_is_removed() {
        let mut peels = [peel(&[(0.5, 1e10), (0.5, 4.0), (0.0, 1e10), (0.0, 1e10), (0.5, 1e10)])];
        repair_depth(&mut peels, DepthConvention::Planar);
        assert_eq!(peels[0].depth.row(0)[..2], [4.0, 4.0]);
        assert_eq!(peels[0].alpha.row(0), [0.5, 0.5, 0.0, 0.0, 0.0]);
        assert_eq!(peels[0].color[0].row(0), [0.5, 0.5, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn an_opaque_sky_without_depth_is_kept() {
        let mut peels = [peel(&[(1.0, 1e10), (1.0, 3.0)])];
        let before = peels.clone();
        assert_eq!(repair_depth(&mut peels, DepthConvention::Planar), None);
        assert_eq!(peels, before);
    }

    #[test]
    fn peels_ordered_far_to_near_are_detected_in_every_convention() {
        let (near, far) = (peel(&[(1.0, 1.0)]), peel(&[(1.0, 5.0)]));
        let disordered = |peels: &[Peel], convention| disorder(&analyze(peels, convention)).is_some();
        assert!(!disordered(&[near.clone(), far.clone()], DepthConvention::Planar));
        assert!(disordered(&[far.clone(), near.clone()], DepthConvention::Planar));
        assert!(disordered(&[near, far], DepthConvention::Inverse));
    }
}
