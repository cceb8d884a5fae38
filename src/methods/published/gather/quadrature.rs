//! The pixels of a disc to visit, and how many pixels each stands for.

use crate::lens::{Aperture, views};
use glam::IVec2;
use std::f32::consts::{PI, TAU};

/// At most about `count` pixels of the disc of radius `radius_px` + 0.5, as offsets from its centre, each with the number of
/// pixels that it stands for: 1 for all of them where the disc has at most `count` pixels.
///
/// Of a larger disc, the inner part of radius `r₀` is visited whole, and the rest with density `r₀/r` at radius `r`. A pixel
/// there contributes only if its own disc has radius `r` or more, so every scale of discs gets its share of the samples. With the
/// outer radius `R`, `π r₀² + 2π r₀ (R − r₀) = count` gives `r₀ = R − √(R² − count/π)`.
pub(super) fn quadrature(radius_px: f32, count: usize) -> Vec<(IVec2, f32)> {
    let outer = radius_px + 0.5;
    let inner = outer - (outer * outer - count as f32 / PI).max(0.0).sqrt();
    let reach = inner as i32;
    let is_inner = |offset: IVec2| offset.as_vec2().length() <= inner;
    let mut samples: Vec<(IVec2, f32)> = (-reach..=reach)
        .flat_map(|y| (-reach..=reach).map(move |x| IVec2::new(x, y)))
        .filter(|&offset| is_inner(offset))
        .map(|offset| (offset, 1.0))
        .collect();
    if inner < outer {
        // The radius of a disc of the same area as the pixels visited so far.
        let core = (samples.len() as f32 / PI).sqrt();
        let rest = count.saturating_sub(samples.len());
        for view in views(rest, Aperture::DISC) {
            // For points uniform over a disc, the squared radius is uniform. So the radius here is uniform, and density falls as
            // 1/r.
            let radius = core + (outer - core) * view.lens.length_squared();
            let offset = (view.lens.normalize_or_zero() * radius).round().as_ivec2();
            if !is_inner(offset) {
                samples.push((offset, TAU * radius * (outer - core) / rest as f32));
            }
        }
        samples.sort_by_key(|(offset, _)| (offset.y, offset.x));
    }
    samples
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pixel_of_a_small_disc_is_visited() {
        let samples = quadrature(2.0, 64);
        // Within a radius of 2.5 lie 5 × 5 pixels without the corners.
        assert_eq!(samples.len(), 21, "{samples:?}");
        assert!(samples.iter().all(|&(_, area)| area == 1.0), "each stands for itself");
    }

    #[test]
    fn a_disc_within_a_pixel_is_that_pixel() {
        assert_eq!(quadrature(0.49, 64), [(IVec2::ZERO, 1.0)]);
    }

    #[test]
    fn the_samples_of_a_large_disc_stand_for_its_whole_area() {
        for (radius, count) in [(32.0, 64), (32.0, 1024), (200.0, 64), (10.0, 100), (37.0, 4096)] {
            let samples = quadrature(radius, count);
            let total: f32 = samples.iter().map(|(_, area)| area).sum();
            let area = PI * (radius + 0.5f32).powi(2);
            assert!(
                (total / area - 1.0).abs() < 0.02,
                "{count} for {radius} px stand for {total}, not {area}"
            );
            assert!(samples.len() <= count, "no more than requested");
        }
    }

    #[test]
    fn the_centre_is_always_visited_and_stands_for_itself() {
        for count in [1, 2, 64] {
            let samples = quadrature(1000.0, count);
            let own = samples.iter().filter(|(offset, _)| *offset == IVec2::ZERO);
            assert_eq!(own.map(|(_, area)| *area).collect::<Vec<_>>(), [1.0], "{count} samples");
        }
    }

    #[test]
    fn the_inner_half_of_the_radius_gets_half_of_the_samples() {
        // Uniform density would give it a quarter.
        let samples = quadrature(32.0, 256);
        let within = samples.iter().filter(|(offset, _)| offset.as_vec2().length() <= 16.0).count();
        assert!(
            (0.4..0.6).contains(&(within as f32 / samples.len() as f32)),
            "{within} of {}",
            samples.len()
        );
    }
}
