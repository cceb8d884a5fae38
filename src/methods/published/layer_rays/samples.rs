//! Lens samples that differ from pixel to pixel (section 4.5).
//!
//! The paper takes a window of a Halton sequence for each pixel, or combines its samples with a noise texel in 16
//! ways because that was cheaper on its hardware. Here each pixel takes one of the eight mirror images and quarter
//! turns of one sample set, applied to lens position and pixel position alike. Each image is as evenly spread as the
//! set itself, for every CoC. (Rotations by other angles turn the lens against the pixel square and disturb their
//! joint distribution: 2 dB worse near focus.)

use crate::lens::{Aperture, View, views};
use glam::Vec2;

/// The mirror images and quarter turns of a square; the identity first.
const SYMMETRIES: [fn(Vec2) -> Vec2; 8] = [
    |v| v,
    |v| Vec2::new(-v.y, v.x),
    |v| -v,
    |v| Vec2::new(v.y, -v.x),
    |v| Vec2::new(-v.x, v.y),
    |v| Vec2::new(v.x, -v.y),
    |v| Vec2::new(v.y, v.x),
    |v| Vec2::new(-v.y, -v.x),
];

/// Lens samples of every pixel.
#[derive(Debug)]
pub(super) struct LensSamples {
    pub(super) sets: Vec<Vec<View>>,
}

impl LensSamples {
    /// Sets of `count` samples of `aperture`: eight with `jitter`, otherwise one.
    pub(super) fn new(count: usize, aperture: Aperture, jitter: bool) -> Self {
        let disc = views(count, Aperture::DISC);
        let set = |symmetry: fn(Vec2) -> Vec2| {
            let view = |view: &View| View {
                lens: aperture.warp_disc(symmetry(view.lens)),
                jitter: symmetry(view.jitter),
                ..*view
            };
            disc.iter().map(view).collect()
        };
        let set_count = if jitter { SYMMETRIES.len() } else { 1 };
        Self { sets: SYMMETRIES[..set_count].iter().map(|&symmetry| set(symmetry)).collect() }
    }

    /// The samples of pixel `x, y`.
    pub(super) fn at_pixel(&self, x: usize, y: usize) -> &[View] {
        &self.sets[hash(x as u32, y as u32) as usize % self.sets.len()]
    }
}

/// Pseudo-random number of a pixel (Jarzynski & Olano 2020, pcg2d).
fn hash(x: u32, y: u32) -> u32 {
    let step = |value: u32| value.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    let (mut x, mut y) = (step(x), step(y));
    x = x.wrapping_add(y.wrapping_mul(1_664_525));
    y = y.wrapping_add(x.wrapping_mul(1_664_525));
    (x, y) = (x ^ (x >> 16), y ^ (y >> 16));
    x = x.wrapping_add(y.wrapping_mul(1_664_525));
    x ^ (x >> 16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pixel_has_a_symmetric_image_of_the_same_samples() {
        let base = views(32, Aperture::DISC);
        let disc = LensSamples::new(32, Aperture::DISC, true);
        for (x, y) in [(0, 0), (1, 0), (0, 1), (4095, 2047)] {
            let found = disc.at_pixel(x, y);
            let matches = |symmetry: &fn(Vec2) -> Vec2| {
                let pairs = base.iter().zip(found);
                pairs.clone().all(|(base, view)| (view.lens - symmetry(base.lens)).length() < 1e-6)
                    && pairs.clone().all(|(base, view)| view.jitter == symmetry(base.jitter))
            };
            assert!(SYMMETRIES.iter().any(matches), "{x}, {y}: lens and pixel have different symmetries");
        }
        let blades = Aperture::new(5, 20.0).unwrap();
        let samples = LensSamples::new(64, blades, true);
        let all = (0..40).flat_map(|x| samples.at_pixel(x, 3));
        assert!(
            all.into_iter().all(|view| blades.depth_inside(view.lens, 1.0) > -1e-4),
            "outside the aperture"
        );
    }

    #[test]
    fn samples_differ_between_pixels_unless_jitter_is_off() {
        let sets = |jitter| {
            let samples = LensSamples::new(16, Aperture::DISC, jitter);
            let mut first_samples: Vec<_> =
                (0..100).map(|x| samples.at_pixel(x, 9)[0].lens.to_array().map(f32::to_bits)).collect();
            first_samples.sort_unstable();
            first_samples.dedup();
            first_samples.len()
        };
        // With eight sets, 100 random pixels miss a given one with probability (7/8)¹⁰⁰.
        assert_eq!(sets(true), 8);
        assert_eq!(sets(false), 1);
    }
}
