//! Cones (section 4.4): what surrounds a hit, from a mipmap of its layer.
//!
//! The mipmaps of all layers are kept together: a texel lists the layers that have anything in it, with colour (premultiplied)
//! and coverage, so that memory follows the fragments and not the number of layers. Layers too near focus for a cone to
//! reach a level are not in it.

use super::layers::{Hit, Spacing};
use crate::methods::shared::Fragments;
use crate::scene::OPAQUE_ALPHA;
use glam::Vec2;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Mean distance λ among 32 lens samples on a disc, in units of its radius (section 4.4).
const SPACING_OF_32: f32 = 0.137;

/// Mean distance λ among `samples` lens samples on an aperture of `area` (π for a disc).
///
/// The paper gives λ for 32 samples only. Samples that are spread evenly lie apart by a constant times the root of their share
/// of the area, so `λ = 0.137 · √(area / n) / √(π / 32)`.
pub(super) fn sample_distance(samples: usize, area: f32) -> f32 {
    SPACING_OF_32 * (area / PI * 32.0 / samples as f32).sqrt()
}

/// Mipmap level whose texels are as wide as a cone of `diameter` samples: 0 for one that fits into a sample.
#[inline(always)]
pub(super) fn level(diameter: f32) -> f32 {
    diameter.max(1.0).log2()
}

/// The mipmaps of all layers, but for level 0, which is the stack.
#[derive(Debug)]
pub(super) struct Cones {
    /// Diameter of a cone in samples for each pixel of CoC radius.
    pub(super) per_coc_px: f32,
    pub(super) levels: Vec<Level>,
}

/// What one layer has in a texel: red, green, blue (premultiplied) and coverage.
pub(super) type Texel = (u32, [f32; 4]);

/// One level of all mipmaps.
#[derive(Debug)]
pub(super) struct Level {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Where each texel's list begins, and where the last one ends.
    pub(super) starts: Vec<usize>,
    /// The lists, each in the order of the layers.
    pub(super) texels: Vec<Texel>,
}

impl Cones {
    /// The mipmaps for cones of `per_coc_px` samples of diameter for each pixel of CoC radius.
    pub(super) fn new(fragments: &Fragments, spacing: Spacing, per_coc_px: f32) -> Self {
        let highest = |layer: usize| {
            let [near, far] = spacing.interval(layer);
            level(per_coc_px * near.abs().max(far.abs())).ceil() as usize
        };
        let top = highest(0).max(highest(spacing.count - 1));
        let mut levels: Vec<Level> = Vec::new();
        for number in 1..=top {
            let next = match levels.last() {
                None => Level::halved(fragments.size(), |x, y, add| {
                    let sample = y * fragments.size().0 + x;
                    add_sample(fragments, spacing, sample, &mut |layer, value| {
                        if highest(layer) >= number {
                            add((layer as u32, value));
                        }
                    });
                }),
                Some(finer) => Level::halved((finer.width, finer.height), |x, y, add| {
                    finer
                        .at(x, y)
                        .iter()
                        .filter(|(layer, _)| highest(*layer as usize) >= number)
                        .for_each(|&t| add(t));
                }),
            };
            levels.push(next);
        }
        Self { per_coc_px, levels }
    }

    /// What the cone of a ray that meets `layer` with `hit` at `position` sees there: colour and coverage. None where the
    /// cone is no wider than a sample.
    #[inline]
    pub(super) fn read(
        &self,
        fragments: &Fragments,
        hit: &Hit,
        position: Vec2,
        layer: usize,
    ) -> Option<[f32; 4]> {
        let level = level(self.per_coc_px * hit.at.abs()).min(self.levels.len() as f32);
        if level <= 0.0 {
            return None;
        }
        let finer = level.ceil() as usize - 1;
        let value = |number: usize| match number {
            0 => fragments.color(hit.sample, hit.fragment),
            _ => self.levels[number - 1].bilinear(position / (1 << number) as f32, layer as u32),
        };
        let (fine, coarse, share) = (value(finer), value(finer + 1), level - finer as f32);
        let mixed: [f32; 4] = std::array::from_fn(|k| fine[k] + share * (coarse[k] - fine[k]));
        // A cone that is blocked but for rounding shows all of its colour.
        let blocked = if mixed[3] >= OPAQUE_ALPHA { mixed[3] } else { 1.0 };
        Some(mixed.map(|value| value / blocked))
    }
}

/// Calls `add` with each layer that has something at `sample`, and its nearest fragment there.
fn add_sample(fragments: &Fragments, spacing: Spacing, sample: usize, add: &mut dyn FnMut(usize, [f32; 4])) {
    let mut next = 0;
    for (k, &coc) in fragments.coc_px(sample).iter().enumerate().take_while(|(_, coc)| coc.is_finite()) {
        let first = next;
        for layer in spacing.holding(coc).filter(|&layer| layer >= first) {
            add(layer, fragments.color(sample, k));
            next = layer + 1;
        }
    }
}

impl Level {
    /// The level above one of `size`, of which `list(x, y, add)` adds what there is in one texel.
    fn halved(
        (width, height): (usize, usize),
        list: impl Fn(usize, usize, &mut dyn FnMut(Texel)) + Sync,
    ) -> Self {
        let half = (width.div_ceil(2), height.div_ceil(2));
        let row = |y: usize| {
            let (mut texels, mut lengths): (Vec<Texel>, _) = (Vec::new(), Vec::with_capacity(half.0));
            for x in 0..half.0 {
                let first = texels.len();
                let (x1, y1) = ((2 * x + 2).min(width), (2 * y + 2).min(height));
                let weight = 1.0 / ((x1 - 2 * x) * (y1 - 2 * y)) as f32;
                for (x, y) in (2 * y..y1).flat_map(|y| (2 * x..x1).map(move |x| (x, y))) {
                    list(x, y, &mut |(layer, value)| {
                        let place = first + texels[first..].partition_point(|texel| texel.0 < layer);
                        if texels.get(place).is_none_or(|texel| texel.0 != layer) {
                            texels.insert(place, (layer, [0.0; 4]));
                        }
                        texels[place].1.iter_mut().zip(value).for_each(|(sum, value)| *sum += weight * value);
                    });
                }
                lengths.push(texels.len() - first);
            }
            (texels, lengths)
        };
        let rows: Vec<_> = (0..half.1).into_par_iter().map(row).collect();
        let mut starts = vec![0];
        let mut texels = Vec::with_capacity(rows.iter().map(|(texels, _)| texels.len()).sum());
        for (row, lengths) in rows {
            texels.extend(row);
            starts.extend(lengths.into_iter().scan(starts[starts.len() - 1], |end, length| {
                *end += length;
                Some(*end)
            }));
        }
        Self { width: half.0, height: half.1, starts, texels }
    }

    /// What there is in one texel.
    #[inline(always)]
    fn at(&self, x: usize, y: usize) -> &[Texel] {
        let index = y * self.width + x;
        &self.texels[self.starts[index]..self.starts[index + 1]]
    }

    /// What `layer` has at `position`, in texels: between the four nearest.
    #[inline]
    fn bilinear(&self, position: Vec2, layer: u32) -> [f32; 4] {
        let last = Vec2::new((self.width - 1) as f32, (self.height - 1) as f32);
        let position = (position - 0.5).clamp(Vec2::ZERO, last);
        let (x, y) = (position.x as usize, position.y as usize);
        let (right, below) = ((x + 1).min(self.width - 1), (y + 1).min(self.height - 1));
        let share = position.fract();
        let mut sum = [0.0; 4];
        for (x, y, weight) in [
            (x, y, (1.0 - share.x) * (1.0 - share.y)),
            (right, y, share.x * (1.0 - share.y)),
            (x, below, (1.0 - share.x) * share.y),
            (right, below, share.x * share.y),
        ] {
            if let Some((_, value)) = self.at(x, y).iter().find(|texel| texel.0 == layer) {
                sum.iter_mut().zip(value).for_each(|(sum, value)| *sum += weight * value);
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lens_samples_lie_apart_as_the_paper_says() {
        assert!((sample_distance(32, PI) - 0.137).abs() < 1e-6, "32 on a disc");
        assert!((sample_distance(128, PI) - 0.0685).abs() < 1e-6, "four times as many lie half as far apart");
    }

    #[test]
    fn the_level_of_a_cone_has_texels_as_wide_as_it_is() {
        // Section 4.4: 32 samples and a CoC radius of 32 px make a cone of 4.4 px and level 2.1.
        let diameter = sample_distance(32, PI) * 32.0;
        assert!((diameter - 4.4).abs() < 0.05, "{diameter} px");
        assert!((level(diameter) - 2.1).abs() < 0.05, "level {}", level(diameter));
        assert_eq!([level(0.0), level(1.0), level(8.0)], [0.0, 0.0, 3.0]);
    }

    #[test]
    fn a_cone_sees_its_layer_alone_and_what_share_of_it_is_there() {
        // Left, every other column of a near layer before a far one; right, the near layer whole.
        let near = |x: usize| x >= 32 || x.is_multiple_of(2);
        let list = |x: usize, _| if near(x) { vec![32.0, 40.0] } else { vec![40.0] };
        let fragments = Fragments::from_lists((64, 64), list);
        let spacing = Spacing::new([32.0, 40.0], 3.0, 0.1);
        let cones = Cones::new(&fragments, spacing, 0.137);
        let read = |x: f32| {
            let hit = Hit { at: 32.0, sample: 0, fragment: 0, coc_px: 32.0 };
            cones.read(&fragments, &hit, Vec2::new(x, 32.0), 0).unwrap()
        };
        assert_eq!(read(16.0), [16.0, 16.0, 16.0, 0.5], "half of it, premultiplied");
        assert_eq!(read(48.0), [32.0, 32.0, 32.0, 1.0], "all of it");
        let focused = Hit { at: 7.0, sample: 0, fragment: 0, coc_px: 7.0 };
        assert_eq!(cones.read(&fragments, &focused, Vec2::splat(9.0), 0), None, "thinner than a sample");
    }
}
