//! How far what a stack shows at one pixel reaches into others.

use std::f32::consts::PI;

/// How evenly a boundary at `distance_px` divides the rays of a lens cone of radius `radius_px`: 1 at the boundary, 0 from the radius on.
///
/// Twice the area of the segment that the boundary, a straight line, cuts off a disc, as a share of the disc.
pub(crate) fn split(distance_px: f32, radius_px: f32) -> f32 {
    if distance_px >= radius_px {
        return 0.0;
    }
    let t = (distance_px / radius_px).max(0.0);
    2.0 * (t.acos() - t * (1.0 - t * t).sqrt()) / PI
}

/// Columns of the picture, `width` wide, that a disc of `radius_px` around column `x` covers in a row `rows_px` from its centre.
pub(crate) fn columns(x: usize, width: usize, radius_px: f32, rows_px: f32) -> std::ops::Range<usize> {
    let half = (radius_px * radius_px - rows_px * rows_px).max(0.0).sqrt() as usize;
    x.saturating_sub(half)..(x + half + 1).min(width)
}

/// Rows of the picture, `height` high, that a disc of `radius_px` around row `y` covers.
pub(crate) fn rows(y: usize, height: usize, radius_px: f32) -> std::ops::Range<usize> {
    columns(y, height, radius_px, 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_boundary_through_the_axis_divides_rays_evenly_and_one_beyond_the_cone_does_not() {
        assert!((split(0.0, 5.0) - 1.0).abs() < 1e-6);
        assert_eq!((split(5.0, 5.0), split(1.0, 0.0)), (0.0, 0.0));
        // At half the radius the segment is π/3 − √3/4 of π.
        assert!((split(2.0, 4.0) - 2.0 * (1.0 / 3.0 - 3f32.sqrt() / (4.0 * PI))).abs() < 1e-6);
    }

    #[test]
    fn the_rows_and_columns_of_a_disc_hold_its_pixels_and_no_others() {
        let (size, centre, radius) = (12, 3, 4.5f32);
        for y in 0..size {
            for x in 0..size {
                let [dx, dy] = [x, y].map(|at| at as f32 - centre as f32);
                let covered =
                    rows(centre, size, radius).contains(&y) && columns(centre, size, radius, dy).contains(&x);
                assert_eq!(covered, dx.hypot(dy) <= radius, "{x}, {y}");
            }
        }
    }
}
