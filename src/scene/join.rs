//! The statistics of a picture from those of its parts.

use super::peel_stats::PeelStats;
use super::spread::Spread;
use super::stats::SceneStats;

impl SceneStats {
    /// The statistics of a picture whose upper rows have these statistics and whose lower rows have those of `below`.
    ///
    /// Counts and ranges are those of the whole picture; lights near the border of the parts are judged by one part alone. Where the
    /// fragments lie is not known of the whole: it has no blocks, which only the prediction of a time needs.
    #[must_use]
    pub(crate) fn joined(mut self, below: &Self) -> Self {
        let sizes = [self.picture_size, below.picture_size].map(|(width, height)| (width * height) as f64);
        self.antialiased = mean([self.antialiased, below.antialiased], sizes);
        self.peels = joined_peels(&self.peels, &below.peels, sizes);
        self.picture_size.1 += below.picture_size.1;
        self.coc_range_px = match (self.fragments, below.fragments) {
            (_, 0) => self.coc_range_px,
            (0, _) => below.coc_range_px,
            _ => range([self.coc_range_px, below.coc_range_px]),
        };
        self.layers = self.layers.max(below.layers);
        self.fragments += below.fragments;
        self.translucent_fragments += below.translucent_fragments;
        self.focused_fragments += below.focused_fragments;
        self.background_pixels += below.background_pixels;
        self.barely_blurred_lights += below.barely_blurred_lights;
        self.limited_fragments += below.limited_fragments;
        self.environment = match (self.environment, below.environment) {
            (Some(own), Some(below)) => Some(own.joined(below)),
            (own, below) => own.or(below),
        };
        for (sum, other) in self.bright.iter_mut().zip(&below.bright) {
            sum.fragments += other.fragments;
            sum.discs += other.discs;
            sum.disc_area_px += other.disc_area_px;
        }
        for (sum, other) in self.light.iter_mut().zip(&below.light) {
            sum.fragments += other.fragments;
            sum.light += other.light;
            sum.gaining_light += other.gaining_light;
        }
        self.spread = self.spread.joined(&below.spread, self.picture_size);
        self
    }
}

impl Spread {
    /// The statistics of both parts of a picture of this size, without blocks.
    fn joined(self, below: &Self, picture_size: (usize, usize)) -> Self {
        let mut sum = Self { blocks: Self::empty(picture_size, 0.0).blocks, ..self };
        for (step, other) in sum.steps.iter_mut().zip(&below.steps) {
            step.front.iter_mut().zip(other.front).for_each(|(sum, count)| *sum += count);
            step.behind.iter_mut().zip(other.behind).for_each(|(sum, count)| *sum += count);
        }
        for (sums, others) in [(&mut sum.changes, below.changes), (&mut sum.edges, below.edges)] {
            sums.iter_mut().zip(others).for_each(|(sum, other)| *sum += other);
        }
        sum
    }
}

/// Mean of two values with these weights.
fn mean(values: [f64; 2], weights: [f64; 2]) -> f64 {
    let sum = weights[0] + weights[1];
    if sum > 0.0 { (values[0] * weights[0] + values[1] * weights[1]) / sum } else { values[0] }
}

/// The range of both ranges.
fn range([[near, far], [other_near, other_far]]: [[f32; 2]; 2]) -> [f32; 2] {
    [near.min(other_near), far.max(other_far)]
}

/// The statistics of the peels of both parts, which have these numbers of pixels. A part may have fewer peels.
fn joined_peels(above: &[PeelStats], below: &[PeelStats], sizes: [f64; 2]) -> Vec<PeelStats> {
    let at = |peels: &[PeelStats], i: usize| peels.get(i).copied().unwrap_or_default();
    let joined = |i: usize| {
        let parts = [at(above, i), at(below, i)];
        let fragments = [parts[0].covered * sizes[0], parts[1].covered * sizes[1]];
        let of = |share: fn(&PeelStats) -> f64, weights| mean(parts.each_ref().map(share), weights);
        PeelStats {
            coc_range_px: match fragments {
                [_, 0.0] => parts[0].coc_range_px,
                [0.0, _] => parts[1].coc_range_px,
                _ => range(parts.map(|part| part.coc_range_px)),
            },
            covered: of(|part| part.covered, sizes),
            translucent: of(|part| part.translucent, fragments),
            in_focus: of(|part| part.in_focus, fragments),
            highlight_light: parts[0].highlight_light + parts[1].highlight_light,
            jumps: of(|part| part.jumps, fragments),
        }
    };
    (0..above.len().max(below.len())).map(joined).collect()
}

#[cfg(test)]
mod tests {
    use crate::image::Plane;
    use crate::scene::{Layer, Scene, SceneStats};
    use crate::stack::StackKind;

    /// Statistics of rows `from .. from + height` of a picture with radii of −6 to 9, a translucent column and a light.
    fn stats(from: usize, height: usize) -> SceneStats {
        let plane = |value: fn(usize, usize) -> f32| Plane::from_fn(64, height, |x, y| value(x, from + y));
        let color = plane(|x, y| if (x, y) == (20, 16) { 40.0 } else { 0.3 });
        let layer = Layer {
            color: [color.clone(), color.clone(), color],
            alpha: plane(|x, _| if x == 5 { 0.5 } else { 1.0 }),
            coc_px: plane(|x, y| if x < 32 { 9.0 } else { -6.0 + 0.1 * y as f32 }),
        };
        Scene::new(vec![layer], StackKind::Coverage, 1, 20.0).analyze()
    }

    #[test]
    fn two_halves_have_the_statistics_of_the_whole() {
        let (whole, joined) = (stats(0, 64), stats(0, 32).joined(&stats(32, 32)));
        assert_eq!(joined.coc_range_px, whole.coc_range_px);
        assert_eq!(joined.picture_size, whole.picture_size);
        let counts = |s: &SceneStats| [s.fragments, s.translucent_fragments, s.focused_fragments];
        assert_eq!(counts(&joined), counts(&whole));
        assert_eq!(joined.bright, whole.bright, "the light lies far from the border");
        assert_eq!(joined.spread.steps, whole.spread.steps);
        assert_eq!(joined.spread.changes, whole.spread.changes);
        let (joined, whole) = (joined.peels[0], whole.peels[0]);
        assert_eq!((joined.covered, joined.coc_range_px), (whole.covered, whole.coc_range_px));
        assert!((joined.translucent - whole.translucent).abs() < 1e-12, "{joined:?}");
        assert!((joined.highlight_light - whole.highlight_light).abs() < 1e-6, "{joined:?}");
    }

    #[test]
    fn a_part_without_fragments_does_not_widen_the_range() {
        let empty = Scene::new(
            vec![Layer {
                color: std::array::from_fn(|_| Plane::zeros(64, 32)),
                alpha: Plane::zeros(64, 32),
                coc_px: Plane::zeros(64, 32),
            }],
            StackKind::Coverage,
            1,
            20.0,
        );
        let above = empty.analyze().joined(&stats(8, 8));
        assert_eq!(above.coc_range_px, stats(8, 8).coc_range_px);
    }
}
