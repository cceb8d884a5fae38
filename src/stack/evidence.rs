//! Evidence for and against an assumption about a picture, weighed by place.
//!
//! Both are summed around each pixel with a kernel that ends at [`RADIUS_PX`], so that no sample counts farther away. Where there is
//! little of both, the share of the whole picture takes over, which saturates: a few samples more do not change it at all.
//!
//! Cost: sums that do not depend on the kernel's size.

use crate::image::Plane;
use rayon::prelude::*;

/// Half of the kernel's width in pixels; from here on a sample does not count.
pub(super) const RADIUS_PX: usize = 8;
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
    let [all_for, all_against] = evidence
        .each_ref()
        .map(|sums| sums.iter().map(|&sum| f64::from(sum)).sum::<f64>() / f64::from(STEPS));
    let all_against = f64::from(*against) * all_against;
    let prior = saturated(
        (all_for / (all_for + all_against + ENOUGH_SHARE * (width * height) as f64).max(f64::MIN_POSITIVE))
            as f32,
    );
    let [sums_for, sums_against] = evidence.map(|sums| spread(&sums, width, height));
    let of_kernel = 1.0 / (STEPS * (RADIUS_PX * RADIUS_PX) as f32);
    let share = |i: usize| {
        let (yes, no) = (sums_for[i] as f32 * of_kernel, against * sums_against[i] as f32 * of_kernel);
        saturated((yes + enough * prior) / (yes + no + enough))
    };
    Plane::from_fn(width, height, |x, y| share(y * width + x))
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

/// Sums with a triangle in each direction, of which the middle counts [`RADIUS_PX`].
fn spread(values: &[u32], width: usize, height: usize) -> Vec<u32> {
    let mut sums = values.to_vec();
    sums.par_chunks_mut(width.max(1)).for_each(triangle);
    let mut columns: Vec<u32> = transposed(&sums, width, height);
    columns.par_chunks_mut(height.max(1)).for_each(triangle);
    transposed(&columns, height, width)
}

/// Two boxes of [`RADIUS_PX`] values, the first before each place and the second after it; nothing lies beyond the ends.
fn triangle(line: &mut [u32]) {
    let past_end = RADIUS_PX - 1;
    let first = trailing_sums(line.iter().copied().chain([0; RADIUS_PX - 1]));
    let second = trailing_sums(first.iter().copied());
    line.iter_mut().zip(&second[past_end..]).for_each(|(value, sum)| *value = *sum);
}

/// For each of `values` the sum of the last [`RADIUS_PX`] up to it.
fn trailing_sums(values: impl Iterator<Item = u32>) -> Vec<u32> {
    let (mut window, mut sum) = ([0; RADIUS_PX], 0);
    let sums = values.enumerate().map(|(i, value)| {
        let leaving = std::mem::replace(&mut window[i % RADIUS_PX], value);
        sum = sum + value - leaving;
        sum
    });
    sums.collect()
}

fn transposed(values: &[u32], width: usize, height: usize) -> Vec<u32> {
    let mut turned = vec![0; values.len()];
    turned.par_chunks_mut(height.max(1)).enumerate().for_each(|(x, column)| {
        column.iter_mut().enumerate().for_each(|(y, value)| *value = values[y * width + x]);
    });
    turned
}

#[cfg(test)]
mod tests {
    use super::*;

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
    }
}
