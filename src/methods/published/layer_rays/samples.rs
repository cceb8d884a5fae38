//! Lens samples that differ from pixel to pixel (section 4.5).
//!
//! The paper chooses a window of a Halton sequence for each pixel, or combines its samples with a texel of noise in 16 ways,
//! as that was cheaper on its hardware. Here a pixel chooses among the eight mirror images and quarter turns of one set, lens
//! and place in the pixel alike: each is as evenly spread as the set itself, for every CoC. (A turn by any other angle would
//! move the lens against the square of the pixel, and with it what the two make together: 2 dB worse near focus.)

use crate::lens::{Aperture, View, views};
use glam::Vec2;

/// The mirror images and quarter turns of a square, the square itself first.
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

/// The lens samples of every pixel.
#[derive(Debug)]
pub(super) struct Samples {
    pub(super) sets: Vec<Vec<View>>,
}

impl Samples {
    /// Sets of `count` samples of `aperture`: several where they are to differ from pixel to pixel.
    pub(super) fn new(count: usize, aperture: Aperture, jitter: bool) -> Self {
        let disc = views(count, Aperture::DISC);
        let set = |moved: fn(Vec2) -> Vec2| {
            let view = |view: &View| View {
                lens: aperture.warp_disc(moved(view.lens)),
                jitter: moved(view.jitter),
                ..*view
            };
            disc.iter().map(view).collect()
        };
        let number = if jitter { SYMMETRIES.len() } else { 1 };
        Self { sets: SYMMETRIES[..number].iter().map(|&moved| set(moved)).collect() }
    }

    /// The samples of pixel `x, y`.
    pub(super) fn of(&self, x: usize, y: usize) -> &[View] {
        &self.sets[hash(x as u32, y as u32) as usize % self.sets.len()]
    }
}

/// A number that looks drawn by chance, of the pixel alone (Jarzynski & Olano 2020, pcg2d).
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
    fn every_pixel_has_a_mirror_image_or_quarter_turn_of_the_same_samples() {
        let base = views(32, Aperture::DISC);
        let disc = Samples::new(32, Aperture::DISC, true);
        for (x, y) in [(0, 0), (1, 0), (0, 1), (4095, 2047)] {
            let found = disc.of(x, y);
            let is_it = |moved: &fn(Vec2) -> Vec2| {
                let pairs = base.iter().zip(found);
                pairs.clone().all(|(base, view)| (view.lens - moved(base.lens)).length() < 1e-6)
                    && pairs.clone().all(|(base, view)| view.jitter == moved(base.jitter))
            };
            assert!(SYMMETRIES.iter().any(is_it), "{x}, {y}: lens and pixel are not moved alike");
        }
        let blades = Aperture::new(5, 20.0).unwrap();
        let samples = Samples::new(64, blades, true);
        let all = (0..40).flat_map(|x| samples.of(x, 3));
        assert!(
            all.into_iter().all(|view| blades.depth_inside(view.lens, 1.0) > -1e-4),
            "outside the aperture"
        );
    }

    #[test]
    fn neighbours_differ_unless_jitter_is_off() {
        let sets = |jitter| {
            let samples = Samples::new(16, Aperture::DISC, jitter);
            let mut firsts: Vec<_> =
                (0..100).map(|x| samples.of(x, 9)[0].lens.to_array().map(f32::to_bits)).collect();
            firsts.sort_unstable();
            firsts.dedup();
            firsts.len()
        };
        // Of eight sets, 100 pixels chosen by chance miss one with a probability of (7/8)¹⁰⁰.
        assert_eq!(sets(true), 8);
        assert_eq!(sets(false), 1);
    }
}
