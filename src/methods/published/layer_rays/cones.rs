//! Cones (section 4.4): colour around a hit, from a mipmap of the hit layer.
//!
//! The mipmaps of all layers share one structure: each texel lists the layers that have content in it, with colour
//! (premultiplied) and coverage. Memory therefore grows with the fragments, not with the number of layers. A layer
//! has no texels on levels that its cones do not reach, as near focus.

use super::layers::{Hit, Spacing};
use crate::methods::shared::Fragments;
use crate::parallel;
use crate::scene::OPAQUE_ALPHA;
use glam::Vec2;
use std::f32::consts::PI;

/// Mean distance λ between 32 lens samples on a disc, in units of its radius (section 4.4).
const SPACING_OF_32: f32 = 0.137;

/// Mean distance λ between `samples` lens samples on an aperture of `area` (π for a disc).
///
/// The paper gives λ for 32 samples only. The distance between evenly spread samples is proportional to the square
/// root of the area per sample, so `λ = 0.137 · √(area / n) / √(π / 32)`.
pub(super) fn sample_distance(samples: usize, area: f32) -> f32 {
    SPACING_OF_32 * (area / PI * 32.0 / samples as f32).sqrt()
}

/// Mipmap level whose texels are as wide as a cone of `diameter` samples; 0 for a cone that fits into a sample.
#[inline(always)]
pub(super) fn level(diameter: f32) -> f32 {
    diameter.max(1.0).log2()
}

/// Mipmaps of all layers, without level 0, which is the stack: of `N` values, the fourth of which is the coverage of colours.
#[derive(Debug)]
pub(super) struct Cones<const N: usize> {
    /// Cone diameter in samples per pixel of CoC radius.
    pub(super) per_coc_px: f32,
    pub(super) levels: Vec<Level<N>>,
}

/// One layer in a texel: its index, and its values: red, green, blue (premultiplied) and coverage, or what [`super::gloss`] mixes.
pub(super) type Texel<const N: usize> = (u32, [f32; N]);

/// One level of all mipmaps.
#[derive(Debug)]
pub(super) struct Level<const N: usize> {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Start of each texel's list, and the end of the last one.
    pub(super) starts: Vec<usize>,
    /// The lists, each ordered by layer.
    pub(super) texels: Vec<Texel<N>>,
}

/// The values of fragment `k` of a sample, as `value(sample, k)`.
pub(super) trait Value<const N: usize>: Fn(usize, usize) -> [f32; N] + Sync {}

impl<const N: usize, F: Fn(usize, usize) -> [f32; N] + Sync> Value<N> for F {}

impl<const N: usize> Cones<N> {
    /// Builds the mipmaps of each fragment's `value` for cones of `per_coc_px` samples of diameter per pixel of CoC radius.
    pub(super) fn new(
        fragments: &Fragments,
        spacing: Spacing,
        per_coc_px: f32,
        value: impl Value<N>,
    ) -> Self {
        let max_level = |layer: usize| {
            let [near, far] = spacing.interval(layer);
            level(per_coc_px * near.abs().max(far.abs())).ceil() as usize
        };
        let top_level = max_level(0).max(max_level(spacing.count - 1));
        let mut levels: Vec<Level<N>> = Vec::new();
        for number in 1..=top_level {
            let next = match levels.last() {
                None => Level::coarser(fragments.size(), |x, y, add| {
                    let sample = y * fragments.size().0 + x;
                    for_each_layer(fragments, spacing, sample, &mut |layer, fragment| {
                        if max_level(layer) >= number {
                            add((layer as u32, value(sample, fragment)));
                        }
                    });
                }),
                Some(finer) => Level::coarser((finer.width, finer.height), |x, y, add| {
                    finer
                        .at(x, y)
                        .iter()
                        .filter(|(layer, _)| max_level(*layer as usize) >= number)
                        .for_each(|&t| add(t));
                }),
            };
            levels.push(next);
        }
        Self { per_coc_px, levels }
    }

    /// Mean of each value of `layer` within the cone of a ray that has `hit` at `position`. `None` where the cone is no wider than a sample.
    #[inline]
    pub(super) fn mean(
        &self,
        hit: &Hit,
        position: Vec2,
        layer: usize,
        value: impl Value<N>,
    ) -> Option<[f32; N]> {
        let level = level(self.per_coc_px * hit.at.abs()).min(self.levels.len() as f32);
        if level <= 0.0 {
            return None;
        }
        let finer = level.ceil() as usize - 1;
        let value = |number: usize| match number {
            0 => value(hit.sample, hit.fragment),
            _ => self.levels[number - 1].bilinear(position / (1 << number) as f32, layer as u32),
        };
        let (fine, coarse, share) = (value(finer), value(finer + 1), level - finer as f32);
        Some(std::array::from_fn(|k| fine[k] + share * (coarse[k] - fine[k])))
    }
}

impl Cones<4> {
    /// The mipmaps of colour and coverage.
    pub(super) fn of_colors(fragments: &Fragments, spacing: Spacing, per_coc_px: f32) -> Self {
        Self::new(fragments, spacing, per_coc_px, |sample, k| fragments.color(sample, k))
    }

    /// Colour and coverage of `layer` within the cone of a ray that has `hit` at `position`. `None` where the cone is
    /// no wider than a sample.
    #[inline]
    pub(super) fn lookup(
        &self,
        fragments: &Fragments,
        hit: &Hit,
        position: Vec2,
        layer: usize,
    ) -> Option<[f32; 4]> {
        let mixed = self.mean(hit, position, layer, |sample, k| fragments.color(sample, k))?;
        // Removes the rounding error of a cone that is fully covered.
        let divisor = if mixed[3] >= OPAQUE_ALPHA { mixed[3] } else { 1.0 };
        Some(mixed.map(|value| value / divisor))
    }
}

/// Calls `add` with each layer that has a fragment at `sample`, and the number of the nearest such fragment.
fn for_each_layer(fragments: &Fragments, spacing: Spacing, sample: usize, add: &mut dyn FnMut(usize, usize)) {
    let mut next = 0;
    for (k, &coc) in fragments.coc_px(sample).iter().enumerate().take_while(|(_, coc)| coc.is_finite()) {
        let first = next;
        for layer in spacing.containing(coc).filter(|&layer| layer >= first) {
            add(layer, k);
            next = layer + 1;
        }
    }
}

impl<const N: usize> Level<N> {
    /// The next coarser level of one of `size`; `list(x, y, add)` adds the content of one texel of the finer level.
    fn coarser(
        (width, height): (usize, usize),
        list: impl Fn(usize, usize, &mut dyn FnMut(Texel<N>)) + Sync,
    ) -> Self {
        let half = (width.div_ceil(2), height.div_ceil(2));
        let row = |y: usize| {
            let (mut texels, mut lengths): (Vec<Texel<N>>, _) = (Vec::new(), Vec::with_capacity(half.0));
            for x in 0..half.0 {
                let first = texels.len();
                let (x1, y1) = ((2 * x + 2).min(width), (2 * y + 2).min(height));
                let weight = 1.0 / ((x1 - 2 * x) * (y1 - 2 * y)) as f32;
                for (x, y) in (2 * y..y1).flat_map(|y| (2 * x..x1).map(move |x| (x, y))) {
                    list(x, y, &mut |(layer, value)| {
                        let index = first + texels[first..].partition_point(|texel| texel.0 < layer);
                        if texels.get(index).is_none_or(|texel| texel.0 != layer) {
                            texels.insert(index, (layer, [0.0; N]));
                        }
                        texels[index].1.iter_mut().zip(value).for_each(|(sum, value)| *sum += weight * value);
                    });
                }
                lengths.push(texels.len() - first);
            }
            (texels, lengths)
        };
        let rows = parallel::map(half.1, &row);
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

    /// The list of one texel.
    #[inline(always)]
    fn at(&self, x: usize, y: usize) -> &[Texel<N>] {
        let index = y * self.width + x;
        &self.texels[self.starts[index]..self.starts[index + 1]]
    }

    /// Bilinear sample of `layer` at `position`, in texels.
    #[inline]
    fn bilinear(&self, position: Vec2, layer: u32) -> [f32; N] {
        let last = Vec2::new((self.width - 1) as f32, (self.height - 1) as f32);
        let position = (position - 0.5).clamp(Vec2::ZERO, last);
        let (x, y) = (position.x as usize, position.y as usize);
        let (right, below) = ((x + 1).min(self.width - 1), (y + 1).min(self.height - 1));
        let share = position.fract();
        let mut sum = [0.0; N];
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
    fn the_distance_of_lens_samples_is_that_of_the_paper() {
        assert!((sample_distance(32, PI) - 0.137).abs() < 1e-6, "32 on a disc");
        assert!(
            (sample_distance(128, PI) - 0.0685).abs() < 1e-6,
            "four times the samples: half the distance"
        );
    }

    #[test]
    fn the_level_of_a_cone_has_texels_of_its_width() {
        // Section 4.4: 32 samples and a CoC radius of 32 px give a cone of 4.4 px and level 2.1.
        let diameter = sample_distance(32, PI) * 32.0;
        assert!((diameter - 4.4).abs() < 0.05, "{diameter} px");
        assert!((level(diameter) - 2.1).abs() < 0.05, "level {}", level(diameter));
        assert_eq!([level(0.0), level(1.0), level(8.0)], [0.0, 0.0, 3.0]);
    }

    #[test]
    fn a_cone_sees_one_layer_and_its_coverage() {
        // Left: every other column of a near layer in front of a far one. Right: the near layer everywhere.
        let near = |x: usize| x >= 32 || x.is_multiple_of(2);
        let list = |x: usize, _| if near(x) { vec![32.0, 40.0] } else { vec![40.0] };
        let fragments = Fragments::from_lists((64, 64), list);
        let spacing = Spacing::new([32.0, 40.0], 3.0, 0.1);
        let cones = Cones::of_colors(&fragments, spacing, 0.137);
        let read = |x: f32| {
            let hit = Hit { at: 32.0, sample: 0, fragment: 0, coc_px: 32.0 };
            cones.lookup(&fragments, &hit, Vec2::new(x, 32.0), 0).unwrap()
        };
        assert_eq!(read(16.0), [16.0, 16.0, 16.0, 0.5], "half covered, premultiplied");
        assert_eq!(read(48.0), [32.0, 32.0, 32.0, 1.0], "fully covered");
        let focused = Hit { at: 7.0, sample: 0, fragment: 0, coc_px: 7.0 };
        assert_eq!(cones.lookup(&fragments, &focused, Vec2::splat(9.0), 0), None, "thinner than a sample");
    }
}
