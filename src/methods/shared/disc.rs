//! Blur discs on the pixel grid: the aperture's shape at a CoC radius, with an antialiased edge one pixel wide.

use crate::lens::Aperture;
use glam::Vec2;

/// Up to this radius in pixels the area of a disc is tabulated, above it computed: the relative difference there is below 1e-3.
const COUNTED_TO_PX: f32 = 16.0;

/// Table entries per pixel of radius.
const COUNTS_PER_PX: f32 = 16.0;

/// The area of a disc of radius `radius_px` with an antialiased edge: the mean area over edges moved up to half a pixel to either
/// side.
///
/// With `a` the apothem of the unit aperture and `A` its area, `A · mean (r + t/a)² = A · (r² + 1/(12 a²))`.
pub(in crate::methods) fn soft_area(aperture: Aperture, radius_px: f32) -> f64 {
    let apothem = f64::from(aperture.apothem());
    f64::from(aperture.area()) * (f64::from(radius_px).powi(2) + 1.0 / (12.0 * apothem * apothem))
}

/// Area in pixels of discs of any radius. A pixel with its centre at depth `d` inside the disc's edge counts
/// `clamp(d + ½, 0, 1)`, so that pixels on the edge count in part.
#[derive(Debug)]
pub(in crate::methods) struct DiscAreas {
    aperture: Aperture,
    /// Areas at radii `i /` [`COUNTS_PER_PX`], ascending from 0.
    counted: Vec<f32>,
}

impl DiscAreas {
    /// Tabulates the discs of `aperture`.
    pub(in crate::methods) fn new(aperture: Aperture) -> Self {
        let last = (COUNTED_TO_PX * COUNTS_PER_PX) as i32;
        let reach = COUNTED_TO_PX as i32 + 1;
        let apothem = aperture.apothem();
        let mut counted = vec![0.0; last as usize + 1];
        for (x, y) in (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (x, y))) {
            // The polygon side nearest to the pixel is the same at every radius.
            let from_centre = apothem - aperture.depth_inside(Vec2::new(x as f32, y as f32), 1.0);
            for (i, sum) in counted.iter_mut().enumerate() {
                let depth = i as f32 / COUNTS_PER_PX * apothem - from_centre;
                *sum += (depth + 0.5).clamp(0.0, 1.0);
            }
        }
        Self { aperture, counted }
    }

    /// Area in pixels of the disc of CoC radius `coc_px`, of either sign; ½ or more.
    pub(in crate::methods) fn area(&self, coc_px: f32) -> f32 {
        let position = coc_px.abs() * COUNTS_PER_PX;
        let below = position as usize;
        match self.counted.get(below..below + 2) {
            Some(&[low, high]) => low + (high - low) * (position - below as f32),
            _ => soft_area(self.aperture, coc_px.abs()) as f32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_area_is_the_sum_over_the_pixels_of_a_disc() {
        for blades in [0, 3, 6] {
            let aperture = Aperture::new(blades, 20.0).unwrap();
            let areas = DiscAreas::new(aperture);
            for coc in [0.0f32, -0.3, 0.7, -2.25, 5.1, -13.3, 15.9, 16.1, 30.0] {
                let reach = coc.abs() as i32 + 2;
                let sum: f32 = (-reach..=reach)
                    .flat_map(|y| (-reach..=reach).map(move |x| Vec2::new(x as f32, y as f32)))
                    .map(|offset| (aperture.depth_inside(offset, coc) + 0.5).clamp(0.0, 1.0))
                    .sum();
                // Linear interpolation between table entries 1/16 px apart: the error is the curvature times the squared
                // distance.
                assert!((areas.area(coc) / sum - 1.0).abs() < 6e-3, "{blades} blades, {coc}: {sum}");
            }
        }
    }
}
