//! What the fragments of a stack stand for, recognised by their alpha and depth.
//!
//! | kind | sign |
//! | --- | --- |
//! | supersampled | said so, by flag or header |
//! | beauty and depth | one peel |
//! | renderer's own anti-aliased peels | fractional alpha, part of it where depth is background: colour was filtered, depth was not |
//! | coverage peels | fractional alpha in the first peel, with depth |
//! | point-sampled peels | otherwise |

use super::depth::{foreground, is_background};
use super::{Peel, StackKind};
use crate::finding::Finding;
use crate::image::Plane;
use crate::settings::DepthConvention;
use rayon::prelude::*;
use std::ops::Range;

/// Alpha this close to 0 or 1 is not fractional: half floats and lossy codecs round.
const ALPHA_ROUNDING: f32 = 1e-3;
/// Fewer fractional pixels than this share of the picture are chance (a stochastic renderer's stray sample).
const FRACTIONAL_SHARE: f64 = 1e-3;
/// Beyond this share of fractional fragments without depth, depth was not filtered along with colour.
const DEPTHLESS_SHARE: f64 = 0.05;
/// Beyond this share of pixels where a peel lies before the one in front of it, the order is wrong.
const DISORDER_SHARE: f64 = 0.5;

/// What was counted in one peel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PeelStats {
    /// Pixels with depth.
    with_depth: usize,
    /// Fractional alpha with depth.
    fractional: usize,
    /// Fractional alpha where depth is background.
    depthless: usize,
    /// Pixels where both this peel and the one before it have depth.
    behind_another: usize,
    /// Of these, where this peel is the nearer.
    disordered: usize,
    /// Smallest and largest depth; the largest first and the smallest last if there is none.
    range: [f32; 2],
}

/// What was counted in all peels.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SceneStats {
    peels: Vec<PeelStats>,
    pixels: usize,
    /// Smallest and largest depth value that is no background.
    pub(super) depth_range: Option<[f32; 2]>,
}

impl PeelStats {
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

/// Counts what the kind is recognised by. All peels are of one size.
pub(super) fn look(peels: &[Peel], convention: DepthConvention) -> SceneStats {
    let nearer_is_larger = convention == DepthConvention::Inverse;
    let sight = Sight { foreground: foreground(convention), sign: if nearer_is_larger { -1.0 } else { 1.0 } };
    let stats: Vec<PeelStats> = (0..peels.len())
        .map(|i| {
            let before = i.checked_sub(1).map(|before| &peels[before].depth);
            let count = |y| {
                let (alpha, depth) = (peels[i].alpha.row(y), peels[i].depth.row(y));
                sight.look_at_row(alpha, depth, before.map(|before| before.row(y)))
            };
            let rows = (0..peels[i].depth.height()).into_par_iter();
            rows.with_min_len(64).map(count).reduce(|| PeelStats::NONE, PeelStats::plus)
        })
        .collect();
    let all = stats.iter().copied().fold(PeelStats::NONE, PeelStats::plus);
    let [low, high] = all.range;
    let range = if nearer_is_larger { [-high, -low] } else { [low, high] };
    let pixels = peels.first().map_or(0, |peel| peel.depth.values().len());
    SceneStats { peels: stats, pixels, depth_range: (all.with_depth > 0).then_some(range) }
}

/// How to tell what is seen, and what is farther.
struct Sight {
    foreground: Range<f32>,
    /// −1 where a larger value is nearer.
    sign: f32,
}

impl Sight {
    /// Counts in one row; branch-free, so that it becomes vector code.
    fn look_at_row(&self, alpha: &[f32], depth: &[f32], before: Option<&[f32]>) -> PeelStats {
        let mut stats = PeelStats::NONE;
        let (mut with_depth, mut fractional, mut depthless) = (0u32, 0u32, 0u32);
        for (&alpha, &depth) in alpha.iter().zip(depth) {
            let seen = self.sees(depth);
            let partial = (alpha > ALPHA_ROUNDING) & (alpha < 1.0 - ALPHA_ROUNDING);
            with_depth += u32::from(seen);
            fractional += u32::from(partial & seen);
            depthless += u32::from(partial & !seen);
        }
        let (mut both, mut disordered) = (0u32, 0u32);
        for (&depth, &front) in depth.iter().zip(before.unwrap_or_default()) {
            let seen = self.sees(depth) & self.sees(front);
            both += u32::from(seen);
            disordered += u32::from(seen & (self.sign * depth < self.sign * front));
        }
        stats.behind_another = both as usize;
        stats.disordered = disordered as usize;
        stats.with_depth = with_depth as usize;
        stats.fractional = fractional as usize;
        stats.depthless = depthless as usize;
        stats.range = self.range(depth);
        stats
    }

    /// Nearest and farthest of what is seen, as values that grow with distance.
    fn range(&self, depth: &[f32]) -> [f32; 2] {
        // Each lane has its own extremes: a single one would make every step wait for the last.
        const LANES: usize = 16;
        let [none_low, none_high] = PeelStats::NONE.range;
        let (mut low, mut high) = ([none_low; LANES], [none_high; LANES]);
        let mut widen = |values: &[f32]| {
            for ((low, high), &depth) in low.iter_mut().zip(&mut high).zip(values) {
                let (seen, far) = (self.sees(depth), self.sign * depth);
                *low = if seen & (far < *low) { far } else { *low };
                *high = if seen & (far > *high) { far } else { *high };
            }
        };
        let (whole, rest) = depth.as_chunks::<LANES>();
        whole.iter().for_each(|values| widen(values));
        widen(rest);
        [low.into_iter().fold(none_low, f32::min), high.into_iter().fold(none_high, f32::max)]
    }

    fn sees(&self, depth: f32) -> bool {
        (depth >= self.foreground.start) & (depth < self.foreground.end)
    }
}

/// The kind of a stack of `supersample` samples a pixel, and why.
pub(super) fn recognise(stats: &SceneStats, supersample: usize) -> (StackKind, Finding) {
    let first = stats.peels.first().copied().unwrap_or(PeelStats::NONE);
    let all = stats.peels.iter().copied().fold(PeelStats::NONE, PeelStats::plus);
    let share = |count: usize, of: usize| count as f64 / of.max(1) as f64;
    let percent = |share: f64| format!("{:.1} %", share * 100.0);
    let depthless = share(all.depthless, all.depthless + all.fractional);
    let fractional = share(first.fractional, stats.pixels);
    let some_fractional = share(all.depthless + all.fractional, stats.pixels) > FRACTIONAL_SHARE;
    let note = |kind, text: String| (kind, Finding::note("kind", text));
    if supersample > 1 {
        let text =
            format!("supersampled peels: {supersample}×{supersample} samples a picture pixel, as said");
        note(StackKind::Supersampled, text)
    } else if stats.peels.len() <= 1 {
        let text = "one picture with depth: nothing is known behind it, so blurred foregrounds show a guess";
        note(StackKind::BeautyDepth, text.to_owned())
    } else if some_fractional && depthless > DEPTHLESS_SHARE {
        let text = format!(
            "the renderer's own anti-aliased peels: {} of the fragments with fractional alpha have no depth, theirs is \
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

/// A warning if the peels are not nearest first.
pub(super) fn disorder(stats: &SceneStats) -> Option<Finding> {
    stats.peels.iter().enumerate().find_map(|(i, peel)| {
        let share = peel.disordered as f64 / peel.behind_another.max(1) as f64;
        (share > DISORDER_SHARE).then(|| {
            let before = i - 1;
            let text = format!(
                "peel {i} is nearer than peel {before} in {:.0} % of the pixels they share: give the peels nearest first",
                share * 100.0
            );
            Finding::warning("peels", text)
        })
    })
}

/// Gives fragments with fractional alpha and no depth the depth of a neighbour in their peel, or drops them.
///
/// The neighbour is one of eight that has both depth and alpha; sides come before corners.
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
    let text =
        format!("{repaired} fragments without depth took a neighbour's, {dropped} had none and were dropped");
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
        recognise(&look(peels, DepthConvention::Planar), 1).0
    }

    #[test]
    fn one_peel_is_a_beauty_with_depth() {
        assert_eq!(kind_of(&[peel(&[(0.5, 1.0)])]), StackKind::BeautyDepth);
    }

    #[test]
    fn whole_alphas_are_point_samples_and_fractions_in_front_are_coverage() {
        let back = peel(&[(1.0, 5.0), (0.0, 1e10)]);
        assert_eq!(kind_of(&[peel(&[(1.0, 1.0), (1.0, 1e10)]), back.clone()]), StackKind::PointSampled);
        assert_eq!(kind_of(&[peel(&[(0.25, 1.0), (1.0, 3.0)]), back]), StackKind::Coverage);
    }

    #[test]
    fn fractional_alpha_without_depth_is_a_renderers_own_anti_aliasing() {
        let peels = [peel(&[(1.0, 1.0), (1.0, 1.0)]), peel(&[(0.5, 1e10), (0.5, 4.0)])];
        assert_eq!(kind_of(&peels), StackKind::RendererAntialiased);
    }

    #[test]
    fn a_fragment_without_depth_takes_its_neighbours_or_goes() {
        let mut peels = [peel(&[(0.5, 1e10), (0.5, 4.0), (0.0, 1e10), (0.0, 1e10), (0.5, 1e10)])];
        repair_depth(&mut peels, DepthConvention::Planar);
        assert_eq!(peels[0].depth.row(0)[..2], [4.0, 4.0]);
        assert_eq!(peels[0].alpha.row(0), [0.5, 0.5, 0.0, 0.0, 0.0]);
        assert_eq!(peels[0].color[0].row(0), [0.5, 0.5, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn an_opaque_sky_needs_no_depth() {
        let mut peels = [peel(&[(1.0, 1e10), (1.0, 3.0)])];
        let before = peels.clone();
        assert_eq!(repair_depth(&mut peels, DepthConvention::Planar), None);
        assert_eq!(peels, before);
    }

    #[test]
    fn peels_far_before_near_are_noticed_in_every_convention() {
        let (near, far) = (peel(&[(1.0, 1.0)]), peel(&[(1.0, 5.0)]));
        let disordered = |peels: &[Peel], convention| disorder(&look(peels, convention)).is_some();
        assert!(!disordered(&[near.clone(), far.clone()], DepthConvention::Planar));
        assert!(disordered(&[far.clone(), near.clone()], DepthConvention::Planar));
        assert!(disordered(&[near, far], DepthConvention::Inverse));
    }
}
