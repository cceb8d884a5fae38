//! Lens samples that differ from pixel to pixel (section 4.5).
//!
//! The paper chooses a window of a Halton sequence for each pixel, or shifts its samples by a texel of noise, as that was
//! cheaper on its hardware. Here a pixel chooses among turns of one set: each is the same well-spread set, within the same
//! aperture.

use crate::lens::{Aperture, View, views};
use glam::Vec2;
use std::f32::consts::TAU;

/// Sets to choose among.
const SETS: usize = 64;

/// Most samples of all sets together; with so many a pixel, sets hardly differ in what they give.
const MOST_SAMPLES: usize = 1 << 18;

/// The lens samples of every pixel.
#[derive(Debug)]
pub(super) struct Samples {
    sets: Vec<Vec<View>>,
}

impl Samples {
    /// Sets of `count` samples of `aperture`: several where they are to differ from pixel to pixel.
    pub(super) fn new(count: usize, aperture: Aperture, jitter: bool) -> Self {
        let number = if jitter { (MOST_SAMPLES / count).clamp(2, SETS) } else { 1 };
        let disc = views(count, Aperture::Disc);
        let set = |turn: usize| {
            let angle = Vec2::from_angle(TAU * turn as f32 / number as f32);
            let turned = |view: &View| View { lens: aperture.from_disc(angle.rotate(view.lens)), ..*view };
            disc.iter().map(turned).collect()
        };
        Self { sets: (0..number).map(set).collect() }
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
    fn every_pixel_has_a_turn_of_the_same_samples_within_the_aperture() {
        let disc = Samples::new(32, Aperture::Disc, true);
        let base = views(32, Aperture::Disc);
        for (x, y) in [(0, 0), (1, 0), (0, 1), (4095, 2047)] {
            let turned = disc.of(x, y);
            let angle = base[5].lens.angle_to(turned[5].lens);
            for (base, view) in base.iter().zip(turned) {
                let expected = Vec2::from_angle(angle).rotate(base.lens);
                assert!(
                    (view.lens - expected).length() < 1e-5,
                    "{x}, {y}: {view:?} is not turned as the others"
                );
                assert_eq!(view.jitter, base.jitter, "{x}, {y}: the place in the pixel stays");
            }
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
            let samples = Samples::new(16, Aperture::Disc, jitter);
            let mut firsts: Vec<_> =
                (0..100).map(|x| samples.of(x, 9)[0].lens.to_array().map(f32::to_bits)).collect();
            firsts.sort_unstable();
            firsts.dedup();
            firsts.len()
        };
        // Of 64 sets, 100 pixels chosen by chance have 64 · (1 − (63/64)¹⁰⁰) = 51, give or take.
        assert!((40..=60).contains(&sets(true)), "{} sets", sets(true));
        assert_eq!(sets(false), 1);
    }
}
