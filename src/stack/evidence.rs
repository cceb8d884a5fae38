//! Evidence for and against an assumption about a picture, weighed by place.
//!
//! Both are summed around each pixel with a kernel that ends at [`RADIUS_PX`], so that no sample counts farther away. Where there is
//! little of both, the share of the whole picture takes over, which saturates: a few samples more do not change it at all.
//!
//! Cost: the kernel's width and height for each pixel, in vectors.

use crate::image::Plane;
use crate::parallel;
use pulp::{Arch, NullaryFnOnce};

/// Half of the kernel's width in pixels; from here on a sample does not count.
pub(super) const RADIUS_PX: usize = 8;
/// How far the kernel reaches from its middle.
const REACH: usize = RADIUS_PX - 1;
/// Evidence in the picture, as a share of its pixels, at which it counts as much as the opposite assumption.
const ENOUGH_SHARE: f64 = 0.003;
/// Steps of a sample's evidence. Sums of whole numbers do not depend on samples that left them.
const STEPS: f32 = 4096.0;

/// How evidence is weighed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Weighing {
    /// How much evidence against the assumption counts of evidence for it.
    pub(super) against: f32,
    /// Evidence around a pixel at which it counts as much as the whole picture's share, in samples at the pixel itself.
    pub(super) enough: f32,
    /// Share of the evidence up to which the assumption does not hold at all, and from which on it holds fully.
    pub(super) saturation: [f32; 2],
}

/// How far the assumption holds at each pixel of a picture of this width and height, 0 … 1. The evidence, for it and against it, is 0 … 1
/// for each pixel, row by row.
pub(super) fn shares(
    evidence: [&[f32]; 2],
    [width, height]: [usize; 2],
    Weighing { against, enough, saturation }: &Weighing,
) -> Plane {
    let saturated = |share: f32| smooth_step(*saturation, share);
    let evidence = evidence.map(in_steps);
    let all = evidence
        .each_ref()
        .map(|sums| sums.iter().map(|&sum| f64::from(sum)).sum::<f64>() / f64::from(STEPS));
    let prior = saturated(share_of_picture(all, *against, [width, height]));
    let [sums_for, sums_against] = evidence.map(|sums| spread(&sums, width, height));
    let of_kernel = 1.0 / (STEPS * (RADIUS_PX * RADIUS_PX) as f32);
    let share = |i: usize| {
        let (yes, no) = (sums_for[i] as f32 * of_kernel, against * sums_against[i] as f32 * of_kernel);
        saturated((yes + enough * prior) / (yes + no + enough))
    };
    Plane::from_fn(width, height, |x, y| share(y * width + x))
}

/// The share of the whole picture's evidence, before it saturates.
fn share_of_picture([all_for, all_against]: [f64; 2], against: f32, [width, height]: [usize; 2]) -> f32 {
    let all_against = f64::from(against) * all_against;
    let all = all_for + all_against + ENOUGH_SHARE * (width * height) as f64;
    (all_for / all.max(f64::MIN_POSITIVE)) as f32
}

/// Whether the assumption holds nowhere, by bounds that cost no more than the `evidence`, of single places: for it and against it, 0 … 1.
/// Where this is true, [`shares`] are 0.
pub(super) fn is_nowhere(
    evidence: impl Iterator<Item = ((usize, usize), [f32; 2])>,
    [width, height]: [usize; 2],
    Weighing { against, enough, saturation }: &Weighing,
) -> bool {
    let size = [width, height].map(|side| side.div_ceil(RADIUS_PX));
    let (mut tiles, mut all) = (vec![0.0_f32; size[0] * size[1]], [0.0; 2]);
    for ((x, y), place) in evidence {
        tiles[y / RADIUS_PX * size[0] + x / RADIUS_PX] += place[0];
        all.iter_mut().zip(place).for_each(|(sum, value)| *sum += f64::from(value));
    }
    // A kernel around a pixel lies within its tile and the eight around it, and counts no sample more than once.
    let around = |x: usize, y: usize| {
        let rows = y.saturating_sub(1)..(y + 2).min(size[1]);
        let columns = x.saturating_sub(1)..(x + 2).min(size[0]);
        rows.map(|row| tiles[row * size[0]..][columns.clone()].iter().sum::<f32>()).sum::<f32>()
    };
    let most = (0..tiles.len()).map(|i| around(i % size[0], i / size[0])).fold(0.0, f32::max);
    // A little less than the exact limit: steps round.
    let from = 0.99 * saturation[0];
    share_of_picture(all, *against, [width, height]) <= from && most / (most + enough) <= from
}

/// 0 up to `from`, 1 from `to` on, and smooth between.
pub(super) fn smooth_step([from, to]: [f32; 2], value: f32) -> f32 {
    let t = ((value - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Evidence in [`STEPS`].
fn in_steps(evidence: &[f32]) -> Vec<u32> {
    evidence.iter().map(|value| (value * STEPS).round() as u32).collect()
}

/// Sums with a triangle in each direction, of which the middle counts [`RADIUS_PX`]; nothing lies beyond the border.
fn spread(values: &[u32], width: usize, height: usize) -> Vec<u32> {
    let (arch, width) = (Arch::new(), width.max(1));
    let mut along_rows = vec![0; values.len()];
    parallel::for_each_with(
        along_rows.chunks_mut(width).zip(values.chunks(width)),
        &|| vec![0; width + 2 * REACH],
        &|padded, _, (sums, values)| {
            padded[REACH..][..width].copy_from_slice(values);
            let beside = |i| &padded[i..][..width];
            arch.dispatch(Triangle { sums, values: beside });
        },
    );
    let nothing = vec![0; width];
    let mut sums = vec![0; values.len()];
    parallel::for_each_row(&mut sums, width, &|y, sums| {
        let beside = |i: usize| match (y + i).checked_sub(REACH) {
            Some(row) if row < height => &along_rows[row * width..][..width],
            _ => &nothing,
        };
        arch.dispatch(Triangle { sums, values: beside });
    });
    sums
}

/// Adds `values(0)`, `values(1)`, … to `sums`, each as often as the triangle counts it.
struct Triangle<'a, F> {
    sums: &'a mut [u32],
    values: F,
}

impl<'v, F: Fn(usize) -> &'v [u32]> NullaryFnOnce for Triangle<'_, F> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for i in 0..=2 * REACH {
            let weight = (RADIUS_PX - i.abs_diff(REACH)) as u32;
            for (sum, value) in self.sums.iter_mut().zip((self.values)(i)) {
                *sum += weight * value;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_called_nowhere_has_no_share_anywhere() {
        let weighing = Weighing { against: 0.5, enough: 4.0, saturation: [0.35, 0.65] };
        let mut found = [0; 2];
        for count in 1..60 {
            // A cluster of evidence in a corner of a picture, with some against it.
            let places: Vec<(usize, usize)> = (0..count).map(|i| (3 + i % 7, 5 + i / 7)).collect();
            let [mut yes, no] = [vec![0.0; 128 * 64], vec![0.0; 128 * 64]];
            places.iter().for_each(|&(x, y)| yes[y * 128 + x] = 1.0);
            let shares = shares([&yes, &no], [128, 64], &weighing);
            let has_share = shares.values().iter().any(|&share| share > 0.0);
            let nowhere = is_nowhere(places.iter().map(|&place| (place, [1.0, 0.0])), [128, 64], &weighing);
            assert!(!(nowhere && has_share), "{count} places");
            found[usize::from(nowhere)] += 1;
        }
        assert!(found[0] > 0 && found[1] > 0, "both occur: {found:?}");
    }

    #[test]
    fn the_kernel_is_a_triangle_that_ends_at_its_radius() {
        let mut values = vec![0; 41 * 5];
        values[2 * 41 + 20] = 1;
        let sums = spread(&values, 41, 5);
        let row: Vec<u32> = (0..41).map(|x| sums[2 * 41 + x]).collect();
        for (x, sum) in row.iter().enumerate() {
            let expected = RADIUS_PX.saturating_sub(x.abs_diff(20)) * RADIUS_PX;
            assert_eq!(*sum as usize, expected, "column {x}");
        }
        // At a corner too.
        let mut values = vec![0; 41 * 5];
        values[4 * 41 + 40] = 1;
        let sums = spread(&values, 41, 5);
        for (x, y) in [(40, 4), (39, 3), (34, 0), (32, 4)] {
            let expected = (RADIUS_PX - (40 - x)) * (RADIUS_PX - (4 - y));
            assert_eq!(sums[y * 41 + x] as usize, expected, "column {x}, row {y}");
        }
    }
}
