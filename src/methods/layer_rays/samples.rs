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
