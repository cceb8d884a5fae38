//! Smoothing over the gaps between samples: a sample that stands for many pixels brings their mean, not its own colour.
//!
//! Means are taken only over pixels blurred alike, so that nothing leaks across an edge in depth; where all are, they are
//! plain boxes. It is what the pyramid does for those who filter on one.

use crate::image::Plane;
use rayon::prelude::*;

/// Widths of the boxes, in pixels, each made of three of the one before.
const WIDTHS: [usize; 4] = [1, 3, 9, 27];

/// Which box a sample that stands for `area_px` pixels reads: the widest that is no wider than the gap around it.
pub(super) fn box_for(area_px: f32) -> usize {
    WIDTHS.iter().rposition(|&width| (width * width) as f32 <= area_px).unwrap_or(0)
}

/// `content` as it is, and its means over all boxes up to number `last`.
pub(super) fn boxes(content: Vec<Plane>, coc_px: &Plane, last: usize) -> Vec<Vec<Plane>> {
    let mut boxes = vec![content];
    for &width in &WIDTHS[..last] {
        let before = &boxes[boxes.len() - 1];
        let wider = before.iter().map(|plane| mean_of_nine(plane, coc_px, width)).collect();
        boxes.push(wider);
    }
    boxes
}

/// Whether two pixels are blurred alike: on one side of focus, by radii an eighth apart at most.
#[inline(always)]
fn alike(a: f32, b: f32) -> bool {
    (a - b).abs() * 16.0 <= (a + b).abs()
}

/// The mean of a pixel and those `step` away along rows, columns and diagonals that are in the frame and blurred alike.
fn mean_of_nine(plane: &Plane, coc_px: &Plane, step: usize) -> Plane {
    let (width, height) = (plane.width(), plane.height());
    let mut means = Plane::zeros(width, height);
    means.values_mut().par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        let own = coc_px.row(y);
        let mut counts = vec![0.0f32; width];
        let rows = [y.checked_sub(step), Some(y), Some(y + step).filter(|&y| y < height)];
        for (values, coc) in rows.into_iter().flatten().map(|y| (plane.row(y), coc_px.row(y))) {
            let mut add = |to: usize, from: usize| {
                let count = width.saturating_sub(to.max(from));
                let sums = row[to.min(width)..].iter_mut().zip(counts[to.min(width)..].iter_mut());
                let others = values[from.min(width)..].iter().zip(&coc[from.min(width)..]);
                for (((sum, tally), own), (&value, &coc)) in
                    sums.zip(&own[to.min(width)..]).zip(others).take(count)
                {
                    let weight = if alike(*own, coc) { 1.0 } else { 0.0 };
                    *sum += weight * value;
                    *tally += weight;
                }
            };
            add(step, 0);
            add(0, 0);
            add(0, step);
        }
        row.iter_mut().zip(counts).for_each(|(sum, count)| *sum /= count);
    });
    means
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_is_no_wider_than_the_gap() {
        assert_eq!([1.0, 8.9, 9.0, 80.0, 81.0, 1e6].map(box_for), [0, 0, 1, 1, 2, 3]);
    }

    #[test]
    fn a_point_becomes_a_box() {
        let point = Plane::from_fn(15, 15, |x, y| if (x, y) == (7, 7) { 81.0 } else { 0.0 });
        let boxes = boxes(vec![point], &Plane::filled(15, 15, 20.0), 2);
        let expected =
            Plane::from_fn(15, 15, |x, y| if x.abs_diff(7) <= 4 && y.abs_diff(7) <= 4 { 1.0 } else { 0.0 });
        for (value, expected) in boxes[2][0].values().iter().zip(expected.values()) {
            assert!((value - expected).abs() < 1e-5, "{value}, expected {expected}");
        }
    }

    #[test]
    fn nothing_is_smoothed_across_an_edge_in_depth() {
        let step = |left: f32, right: f32| Plane::from_fn(30, 4, |x, _| if x < 11 { left } else { right });
        for (left, right) in [(-20.0, 20.0), (20.0, 30.0), (0.0, 20.0)] {
            let boxes = boxes(vec![step(1.0, 5.0)], &step(left, right), 3);
            for (value, expected) in boxes[3][0].values().iter().zip(step(1.0, 5.0).values()) {
                assert!((value - expected).abs() < 1e-5, "{left} beside {right}: {value}");
            }
        }
    }
}
