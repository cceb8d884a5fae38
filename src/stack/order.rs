//! The order of a stack's fragments, and the range of their depths.
//!
//! Methods composite the fragments of a pixel in the order of their peels, nearest first. Peels that were named or rendered in another
//! order are not: their fragments are sorted, pixel by pixel.

use super::Peel;
use super::depth::{FarDepth, foreground};
use crate::finding::Finding;
use crate::parallel;
use crate::settings::DepthConvention;
use pulp::{Arch, NullaryFnOnce};

/// A fragment is in order up to this much nearer than one before it, as a share of its distance: half floats round depth.
const DEPTH_ROUNDING: f32 = 1e-3;
/// Share of the pixels with two fragments, above which the order is worth a warning.
const WARNED_SHARE: f64 = 0.05;

/// Smallest and largest depth that is not background; `None` if all is background. In the values of `convention`.
pub(super) fn depth_range(peels: &[Peel], convention: DepthConvention) -> Option<[f32; 2]> {
    let foreground = foreground(convention);
    let known = |depth: f32| (depth >= foreground.start) & (depth < foreground.end);
    let none = || [f32::INFINITY, f32::NEG_INFINITY];
    let of_values = |values: &[f32]| {
        // Each lane has its own minimum and maximum, so that no iteration depends on the previous one.
        const LANES: usize = 16;
        let [mut low, mut high] = none().map(|end| [end; LANES]);
        for values in values.chunks(LANES) {
            for ((low, high), &depth) in low.iter_mut().zip(&mut high).zip(values) {
                *low = if known(depth) & (depth < *low) { depth } else { *low };
                *high = if known(depth) & (depth > *high) { depth } else { *high };
            }
        }
        [low.into_iter().fold(none()[0], f32::min), high.into_iter().fold(none()[1], f32::max)]
    };
    let wider = |a: [f32; 2], b: [f32; 2]| [a[0].min(b[0]), a[1].max(b[1])];
    let of_peel = |peel: &Peel| {
        let rows = parallel::map(peel.depth.height(), &|y| of_values(peel.depth.row(y)));
        rows.into_iter().fold(none(), wider)
    };
    let range = peels.iter().map(of_peel).fold(none(), wider);
    (range[0] <= range[1]).then_some(range)
}

/// Fragments of one peel, against the peels before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Behind {
    /// Pixels in which this peel and one before it have a fragment.
    both: usize,
    /// Those of them in which that of this peel is nearer.
    nearer: usize,
}

/// Sorts the fragments of each pixel that are not in order, nearest first. Says so, as a warning where they are many, and returns these
/// pixels.
pub(super) fn sort(
    peels: &mut [Peel],
    convention: DepthConvention,
) -> (Option<Finding>, Vec<(usize, usize)>) {
    let far = FarDepth::new(convention);
    let (behind, disordered) = disorder(peels, &far);
    disordered.iter().for_each(|&(x, y)| sort_pixel(peels, &far, x, y));
    let finding = if disordered.is_empty() { None } else { finding(&behind, disordered.len()) };
    (finding, disordered)
}

/// What is said of `pixels` pixels whose fragments were sorted, in peels with these counts.
fn finding(behind: &[Behind], pixels: usize) -> Option<Finding> {
    let share = |behind: &Behind| behind.nearer as f64 / behind.both.max(1) as f64;
    let worst = (0..behind.len()).max_by(|&a, &b| share(&behind[a]).total_cmp(&share(&behind[b])))?;
    let text = format!(
        "peel {worst} is nearer than a peel before it in {:.1} % of the pixels that both have; the fragments of {pixels} \
         pixels were sorted nearest first: give the peels in that order",
        100.0 * share(&behind[worst]),
    );
    let warned = share(&behind[worst]) >= WARNED_SHARE;
    Some(if warned { Finding::warning("peels", text) } else { Finding::note("peels", text) })
}

/// The counts of every peel, and the pixels that are not in order.
fn disorder(peels: &[Peel], far: &FarDepth) -> (Vec<Behind>, Vec<(usize, usize)>) {
    let (width, height) = peels.first().map_or((0, 0), |peel| (peel.depth.width(), peel.depth.height()));
    type Row = (Vec<Behind>, Vec<(usize, usize)>);
    let rows: Vec<Row> = parallel::map(height, &|y| disorder_of_row(peels, far, width, y));
    let mut behind = vec![Behind::default(); peels.len()];
    let mut disordered = Vec::new();
    for (counts, pixels) in rows {
        for (sum, count) in behind.iter_mut().zip(counts) {
            sum.both += count.both;
            sum.nearer += count.nearer;
        }
        disordered.extend(pixels);
    }
    (behind, disordered)
}

fn disorder_of_row(
    peels: &[Peel],
    far: &FarDepth,
    width: usize,
    y: usize,
) -> (Vec<Behind>, Vec<(usize, usize)>) {
    // Depth of the farthest fragment so far, in front of everything where there is none.
    let mut farthest = vec![f32::NEG_INFINITY; width];
    let mut is_disordered = vec![false; width];
    let mut depth = vec![0.0; width];
    let of_peel = |peel: &Peel| {
        far.fill_row(peel.depth.row(y), &mut depth);
        let (farthest, is_disordered) = (&mut farthest[..], &mut is_disordered[..]);
        Arch::new().dispatch(CountRow { farthest, is_disordered, alpha: peel.alpha.row(y), depth: &depth })
    };
    let counts: Vec<Behind> = peels.iter().map(of_peel).collect();
    if counts.iter().all(|behind| behind.nearer == 0) {
        return (counts, Vec::new());
    }
    let pixels = is_disordered.iter().enumerate().filter(|(_, disordered)| **disordered).map(|(x, _)| (x, y));
    (counts, pixels.collect())
}

/// Counts a row of a peel of these depths ([`FarDepth`]) against the `farthest` fragments so far, and updates them; compiled for each
/// instruction set.
struct CountRow<'a> {
    farthest: &'a mut [f32],
    is_disordered: &'a mut [bool],
    alpha: &'a [f32],
    depth: &'a [f32],
}

impl NullaryFnOnce for CountRow<'_> {
    type Output = Behind;

    #[inline(always)]
    fn call(self) -> Behind {
        let (mut both, mut nearer) = (0_u32, 0_u32);
        let so_far = self.farthest.iter_mut().zip(self.is_disordered);
        for ((farthest, disordered), (&alpha, &depth)) in so_far.zip(self.alpha.iter().zip(self.depth)) {
            let present = alpha > 0.0;
            let swapped = present & (depth < *farthest * (1.0 - DEPTH_ROUNDING));
            both += u32::from(present & (*farthest > f32::NEG_INFINITY));
            nearer += u32::from(swapped);
            *disordered |= swapped;
            *farthest = if present & (depth > *farthest) { depth } else { *farthest };
        }
        Behind { both: both as usize, nearer: nearer as usize }
    }
}

/// Sorts the fragments of one pixel by depth, within the peels that have one.
fn sort_pixel(peels: &mut [Peel], far: &FarDepth, x: usize, y: usize) {
    let used: Vec<usize> = (0..peels.len()).filter(|&i| peels[i].alpha.get(x, y) > 0.0).collect();
    let fragment = |peel: &Peel| {
        let color = peel.color.each_ref().map(|plane| plane.get(x, y));
        (color, peel.alpha.get(x, y), peel.depth.get(x, y))
    };
    let mut fragments: Vec<_> = used.iter().map(|&i| fragment(&peels[i])).collect();
    fragments.sort_by(|a, b| far.of(a.2).total_cmp(&far.of(b.2)));
    for (i, (color, alpha, depth)) in used.into_iter().zip(fragments) {
        let peel = &mut peels[i];
        peel.color.iter_mut().zip(color).for_each(|(plane, value)| plane.set(x, y, value));
        peel.alpha.set(x, y, alpha);
        peel.depth.set(x, y, depth);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;

    /// A row of fragments, `(alpha, depth)` each; colour is alpha times depth.
    fn peel(fragments: &[(f32, f32)]) -> Peel {
        let plane = |value: &dyn Fn((f32, f32)) -> f32| {
            Plane::from_fn(fragments.len(), 1, |x, _| value(fragments[x]))
        };
        Peel {
            color: std::array::from_fn(|_| plane(&|(alpha, depth)| alpha * depth)),
            alpha: plane(&|(alpha, _)| alpha),
            depth: plane(&|(_, depth)| depth),
        }
    }

    #[test]
    fn peels_in_another_order_are_sorted_in_every_convention() {
        let ordered = [peel(&[(1.0, 1.0); 3]), peel(&[(0.5, 5.0); 3])];
        let mut reversed = [ordered[1].clone(), ordered[0].clone()];
        assert!(sort(&mut ordered.clone(), DepthConvention::Planar).0.is_none());
        assert!(sort(&mut reversed.clone(), DepthConvention::Inverse).0.is_none());
        let finding = sort(&mut reversed, DepthConvention::Planar).0.unwrap();
        assert!(finding.warning && finding.text.contains("peel 1") && finding.text.contains("100.0 %"));
        assert_eq!(reversed, ordered, "colour, alpha and depth move together");
    }

    #[test]
    fn empty_samples_and_background_are_in_order_behind_everything() {
        // The empty sample keeps its place; the sky moves behind the surface.
        let mut peels = [peel(&[(0.0, 1.0), (1.0, 1e10)]), peel(&[(1.0, 3.0), (0.5, 3.0)])];
        let before = peels.clone();
        assert!(sort(&mut peels, DepthConvention::Planar).0.is_some());
        assert_eq!(peels[0].depth.row(0), [1.0, 3.0]);
        assert_eq!(peels[1].depth.row(0), [3.0, 1e10]);
        assert_eq!(peels[0].color[0].get(0, 0), before[0].color[0].get(0, 0));
    }

    #[test]
    fn disorder_is_worth_a_warning_from_a_twentieth_of_the_pixels_on() {
        let warned = |swapped: usize| {
            let front: Vec<_> = (0..100).map(|x| (1.0, if x < swapped { 5.0 } else { 1.0 })).collect();
            sort(&mut [peel(&front), peel(&[(1.0, 3.0); 100])], DepthConvention::Planar)
                .0
                .map(|found| found.warning)
        };
        assert_eq!([0, 4, 5].map(warned), [None, Some(false), Some(true)]);
    }

    #[test]
    fn depth_that_differs_by_rounding_stays_as_it_is() {
        let mut peels = [peel(&[(1.0, 5.0)]), peel(&[(1.0, 4.9976)])];
        assert!(sort(&mut peels, DepthConvention::Planar).0.is_none(), "half floats at 5 are 0.004 apart");
        assert_eq!(peels[0].depth.get(0, 0), 5.0);
    }

    #[test]
    fn a_peel_is_compared_with_all_before_it() {
        let peels = [peel(&[(1.0, 5.0)]), peel(&[(0.0, 0.0)]), peel(&[(1.0, 3.0)])];
        let (behind, disordered) = disorder(&peels, &FarDepth::new(DepthConvention::Planar));
        assert_eq!(behind[2], Behind { both: 1, nearer: 1 });
        assert_eq!(disordered, [(0, 0)]);
    }

    #[test]
    fn the_depth_range_leaves_background_out() {
        let peels = [peel(&[(1.0, 5.0), (1.0, 1e10)]), peel(&[(1.0, 0.0), (0.5, 7.0)])];
        assert_eq!(depth_range(&peels, DepthConvention::Planar), Some([5.0, 7.0]));
        assert_eq!(depth_range(&[peel(&[(1.0, 0.0)])], DepthConvention::Planar), None);
    }
}
