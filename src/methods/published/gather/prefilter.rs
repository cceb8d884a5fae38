//! Box means of the picture: a sample that stands for many pixels reads their mean instead of its own colour.
//!
//! This removes the noise of sparse samples, as a pyramid does in methods that filter on one. A mean includes only pixels of
//! similar blur, so that nothing leaks across an edge in depth. Where all pixels have similar blur, it is a plain box.

use crate::image::Plane;
use crate::parallel;

/// Widths of the boxes in pixels. Each is computed from three by three boxes of the width before it.
const WIDTHS_PX: [usize; 4] = [1, 3, 9, 27];

/// Index of the box that a sample that stands for `area_px` pixels reads: the widest whose area is at most that.
pub(super) fn box_for(area_px: f32) -> usize {
    WIDTHS_PX.iter().rposition(|&width| (width * width) as f32 <= area_px).unwrap_or(0)
}

/// `content` unchanged, then its means over all boxes up to number `max_box`.
pub(super) fn boxes(content: Vec<Plane>, coc_px: &Plane, max_box: usize) -> Vec<Vec<Plane>> {
    let mut boxes = vec![content];
    for &width in &WIDTHS_PX[..max_box] {
        let narrower = &boxes[boxes.len() - 1];
        let wider = narrower.iter().map(|plane| mean_of_nine(plane, coc_px, width)).collect();
        boxes.push(wider);
    }
    boxes
}

/// Whether two signed CoC radii are similar: on one side of focus, and at most an eighth apart.
#[inline(always)]
fn similar(a: f32, b: f32) -> bool {
    (a - b).abs() * 16.0 <= (a + b).abs()
}

/// The mean of a pixel and its eight neighbours `step` pixels away that are in the frame and have similar blur.
fn mean_of_nine(plane: &Plane, coc_px: &Plane, step: usize) -> Plane {
    let (width, height) = (plane.width(), plane.height());
    let mut means = Plane::zeros(width, height);
    parallel::for_each_row(means.values_mut(), width, &|y, row| {
        let own = coc_px.row(y);
        let mut total_weights = vec![0.0f32; width];
        let rows = [y.checked_sub(step), Some(y), Some(y + step).filter(|&y| y < height)];
        for (values, coc) in rows.into_iter().flatten().map(|y| (plane.row(y), coc_px.row(y))) {
            let mut add = |to: usize, from: usize| {
                let count = width.saturating_sub(to.max(from));
                let sums = row[to.min(width)..].iter_mut().zip(total_weights[to.min(width)..].iter_mut());
                let others = values[from.min(width)..].iter().zip(&coc[from.min(width)..]);
                for (((sum, total_weight), own), (&value, &coc)) in
                    sums.zip(&own[to.min(width)..]).zip(others).take(count)
                {
                    let weight = if similar(*own, coc) { 1.0 } else { 0.0 };
                    *sum += weight * value;
                    *total_weight += weight;
                }
            };
            add(step, 0);
            add(0, 0);
            add(0, step);
        }
        row.iter_mut().zip(total_weights).for_each(|(sum, count)| *sum /= count);
    });
    means
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_is_no_larger_than_the_area_of_the_sample() {
        assert_eq!([1.0, 8.9, 9.0, 80.0, 81.0, 1e6].map(box_for), [0, 0, 1, 1, 2, 3]);
    }

    #[test]
    fn the_mean_of_a_single_bright_pixel_is_a_box() {
        let point = Plane::from_fn(15, 15, |x, y| if (x, y) == (7, 7) { 81.0 } else { 0.0 });
        let boxes = boxes(vec![point], &Plane::filled(15, 15, 20.0), 2);
        let expected =
            Plane::from_fn(15, 15, |x, y| if x.abs_diff(7) <= 4 && y.abs_diff(7) <= 4 { 1.0 } else { 0.0 });
        for (value, expected) in boxes[2][0].values().iter().zip(expected.values()) {
            assert!((value - expected).abs() < 1e-5, "{value}, expected {expected}");
        }
    }

    #[test]
    fn a_mean_excludes_pixels_across_an_edge_in_depth() {
        let step = |left: f32, right: f32| Plane::from_fn(30, 4, |x, _| if x < 11 { left } else { right });
        for (left, right) in [(-20.0, 20.0), (20.0, 30.0), (0.0, 20.0)] {
            let boxes = boxes(vec![step(1.0, 5.0)], &step(left, right), 3);
            for (value, expected) in boxes[3][0].values().iter().zip(step(1.0, 5.0).values()) {
                assert!((value - expected).abs() < 1e-5, "{left} beside {right}: {value}");
            }
        }
    }
}
