//! Depth in the steps of 8 bits, in a file of more bits: it went through a picture.
//!
//! In such a picture most pixels have the depth of the next one in their row and of the next one in their column; a slope that changes
//! evenly from pixel to pixel is no sign of it.
//!
//! Cost: one read of depth at most; it ends where there are too many values.

use super::Peel;
use super::depth::foreground;
use crate::finding::Finding;
use crate::image::Plane;
use crate::settings::DepthConvention;
use std::collections::BTreeSet;
use std::ops::Range;

/// Values that 8 bits have.
const CODES: usize = 256;
/// Fewest values that are steps: as many cards do not stand at even distances.
const FEWEST: usize = 32;
/// Least step, as a share of the largest depth, that is worth a word: half floats have finer ones.
const COARSE: f32 = 0.002;
/// How far a value may lie from its step, in steps.
const ROUNDING: f32 = 0.1;

/// A warning where the depths of the first of `peels` are at most 256, at even distances.
pub(super) fn doubt(peels: &[Peel], convention: DepthConvention) -> Option<Finding> {
    let foreground = foreground(convention);
    let mut values = BTreeSet::new();
    let mut last = f32::NAN;
    for &depth in peels.first()?.depth.values() {
        // Foreground is not negative, so the order of bits is that of depths.
        if depth != last
            && foreground.contains(&depth)
            && values.insert(depth.to_bits())
            && values.len() > CODES
        {
            return None;
        }
        last = depth;
    }
    let values: Vec<f32> = values.into_iter().map(f32::from_bits).collect();
    let (low, high) = (*values.first()?, *values.last()?);
    let step = values.windows(2).map(|pair| pair[1] - pair[0]).fold(f32::INFINITY, f32::min);
    let steps = (high - low) / step;
    let is_even = |value: &f32| {
        let at = (value - low) / step;
        (at - at.round()).abs() <= ROUNDING
    };
    let are_steps = values.len() >= FEWEST
        && is_flat(&peels.first()?.depth, &foreground)
        && steps < CODES as f32 - 0.5
        && steps < 2.0 * values.len() as f32
        && step >= COARSE * high
        && values.iter().all(is_even);
    let text = format!(
        "depth from {low} to {high} has {} values in even steps, as of 8 bits: they are visible in the blur; save it with 16 bits or more",
        values.len()
    );
    are_steps.then(|| Finding::warning("depth", text))
}

/// Whether most pixels of the foreground have the depth of the next one in their row, and most that of the next one in their column.
fn is_flat(depth: &Plane, foreground: &Range<f32>) -> bool {
    let add = |[equal, all]: [usize; 2], (a, b): (&f32, &f32)| {
        let known = foreground.contains(a) && foreground.contains(b);
        [equal + usize::from(known && a == b), all + usize::from(known)]
    };
    let (mut in_rows, mut in_columns) = ([0; 2], [0; 2]);
    for y in 0..depth.height() {
        let row = depth.row(y);
        in_rows = row.iter().zip(row.iter().skip(1)).fold(in_rows, add);
        let above = depth.row(y.saturating_sub(1));
        in_columns = above.iter().zip(row).take(if y > 0 { row.len() } else { 0 }).fold(in_columns, add);
    }
    [in_rows, in_columns].into_iter().all(|[equal, all]| 2 * equal >= all)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn doubted(depth: impl Fn(f32) -> f32) -> bool {
        doubted_at(|x, y| depth((x + y) as f32 / 698.0))
    }

    fn doubted_at(depth: impl Fn(usize, usize) -> f32) -> bool {
        let plane = Plane::from_fn(400, 300, depth);
        let peel = Peel { color: std::array::from_fn(|_| plane.clone()), alpha: plane.clone(), depth: plane };
        doubt(&[peel], DepthConvention::Planar).is_some_and(|finding| finding.warning)
    }

    #[test]
    fn a_ramp_in_even_steps_is_doubted_and_a_smooth_or_half_float_one_is_not() {
        assert!(doubted(|at| 2.0 + 10.0 * (at * 255.0).round() / 255.0));
        assert!(!doubted(|at| 2.0 + 10.0 * at));
        assert!(!doubted(|at| half::f16::from_f32(2.0 + 0.4 * at).to_f32()));
        assert!(!doubted(|at| 2.0 + (at * 9.0).round()), "ten cards");
        assert!(!doubted(|_| 3.0));
        assert!(!doubted_at(|x, _| 2.0 + 0.25 * (x % 200) as f32), "a slope, a step a column");
        let part = |x: usize| if x < 100 { 2.0 + 0.25 * x as f32 } else { 1e10 };
        assert!(!doubted_at(|x, _| part(x)), "such a slope before background");
        assert!(!doubted_at(|_, y| 2.0 + 0.25 * (y % 200) as f32), "a slope, a step a row");
    }
}
