//! Depth layers of equal CoC growth, and the intersection of a ray with one.

use crate::methods::shared::Fragments;
use glam::Vec2;

/// A lens ray: at CoC radius `c` it passes sample position `start + c·step`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ray {
    /// Position in the plane of focus, in samples.
    pub start: Vec2,
    /// Displacement in samples per pixel of CoC radius.
    pub step: Vec2,
}

impl Ray {
    /// Position at CoC radius `c`.
    #[inline(always)]
    pub(super) fn at(&self, c: f32) -> Vec2 {
        self.start + c * self.step
    }

    /// CoC radii between which the ray is inside a frame of `size` samples. It must be inside at the plane of focus.
    #[inline]
    pub(super) fn frame_interval(&self, size: Vec2) -> [f32; 2] {
        let sides = |start: f32, step: f32, size: f32| {
            let (a, b) = (-start / step, (size - start) / step);
            // A ray with zero step never leaves. On the very border 0 / 0 is NaN, which `min` and `max` ignore.
            [a.min(b).min(0.0), a.max(b).max(0.0)]
        };
        let (x, y) = (sides(self.start.x, self.step.x, size.x), sides(self.start.y, self.step.y, size.y));
        [x[0].max(y[0]), x[1].min(y[1])]
    }
}

/// Division of CoC depth into layers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Spacing {
    near_px: f32,
    delta_px: f32,
    overlap: f32,
    /// Number of layers.
    pub count: usize,
}

impl Spacing {
    /// Layers of `delta_px` from the near to the far end of `coc_range_px`; each one extends into its neighbours by
    /// `overlap` of its depth.
    pub(super) fn new(coc_range_px: [f32; 2], delta_px: f32, overlap: f32) -> Self {
        let mut spacing = Self { near_px: coc_range_px[0], delta_px, overlap, count: usize::MAX };
        spacing.count = spacing.index(coc_range_px[1]) + 1;
        spacing
    }

    /// The layer of CoC radius `c` (eq. 4 in CoC space): `⌊(c − c_near) / δ⌋`.
    pub(super) fn index(&self, c: f32) -> usize {
        (((c - self.near_px) / self.delta_px) as usize).min(self.count.saturating_sub(1))
    }

    /// CoC radii of layer `index`, with the overlap into its neighbours.
    pub(super) fn interval(&self, index: usize) -> [f32; 2] {
        let side = |layers: f32| self.near_px + layers * self.delta_px;
        [side(index as f32 - self.overlap), side((index + 1) as f32 + self.overlap)]
    }

    /// The layers that contain CoC radius `c`.
    pub(super) fn containing(&self, c: f32) -> impl Iterator<Item = usize> + use<> {
        let (spacing, index) = (*self, self.index(c));
        (index.saturating_sub(1)..(index + 2).min(self.count)).filter(move |&layer| {
            let [near, far] = spacing.interval(layer);
            (near..=far).contains(&c)
        })
    }
}

/// A hit of a ray in a layer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Hit {
    /// CoC radius of the ray at the hit.
    pub at: f32,
    /// Sample at the hit.
    pub sample: usize,
    /// Index of the fragment in the sample's list.
    pub fragment: usize,
    /// CoC radius of that fragment.
    pub coc_px: f32,
}

/// A segment of a ray, to be tested against a layer's height field: the nearest fragments in an interval of CoC
/// radii.
#[derive(Debug)]
pub(super) struct Segment<'a> {
    /// The stack.
    pub fragments: &'a Fragments,
    /// The ray.
    pub ray: Ray,
    /// CoC radii of the layer.
    pub interval: [f32; 2],
    /// Fragments up to this CoC radius were hit before.
    pub passed_coc_px: f32,
}

impl Segment<'_> {
    /// The layer's fragment below the ray at `c`, as a hit at `c`.
    #[inline(always)]
    fn fragment_at(&self, c: f32) -> Option<Hit> {
        let sample = self.fragments.sample_at(self.ray.at(c));
        let [near, far] = self.interval;
        let list = self.fragments.coc_px(sample);
        let fragment = list.iter().position(|&coc| coc >= near && coc > self.passed_coc_px)?;
        let coc_px = list[fragment];
        (coc_px <= far).then_some(Hit { at: c, sample, fragment, coc_px })
    }

    /// Intersection of the ray with the height field, by false position (section 4.3).
    ///
    /// The surface is assumed to be straight between the ends of the search. Where the surface at the next point is
    /// nearer than the ray, the ray has hit it before that point, otherwise it hits it later. An empty sample counts
    /// as the layer's far bound before the surface and as its near bound after it, which keeps the search between the
    /// bounds.
    ///
    /// The final look-up, where the ray is as deep as the found surface, keeps a ray that has passed behind an edge
    /// from hitting it: at that depth the ray is over no fragment, or over the one that it hits.
    #[inline]
    pub(super) fn intersect(&self, iterations: usize) -> Option<Hit> {
        let [near, far] = self.interval;
        let (mut before, mut after) = (near, far);
        let first = self.fragment_at(before);
        let mut surface_found = first.is_some();
        let mut ahead = first.map_or(far, |hit| hit.coc_px) - before;
        let mut past = after - self.fragment_at(after).map_or(near, |hit| hit.coc_px);
        let mut at = crossing([before, after], ahead, past);
        for _ in 0..iterations {
            let guess = self.fragment_at(at);
            let height = guess.map_or(if surface_found { near } else { far }, |hit| hit.coc_px);
            if height > at {
                surface_found |= guess.is_some();
                (before, ahead) = (at, height - at);
            } else if height < at {
                (after, past) = (at, at - height);
            } else {
                return guess;
            }
            at = crossing([before, after], ahead, past);
        }
        self.fragment_at(at).and_then(|hit| self.fragment_at(hit.coc_px))
    }
}

/// CoC radius where the straight line between the ends is zero, for a ray that is `ahead` before the surface at the
/// first end and `past` behind it at the second.
#[inline(always)]
fn crossing([before, after]: [f32; 2], ahead: f32, past: f32) -> f32 {
    let total = ahead + past;
    let share = if total > 0.0 { ahead / total } else { 0.0 };
    (before + (after - before) * share).clamp(before, after)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods::shared::noise;

    const THREE: [f32; 2] = [0.0, 3.0];

    fn intersect(fragments: &Fragments, ray: Ray, iterations: usize) -> Option<Hit> {
        Segment { fragments, ray, interval: THREE, passed_coc_px: f32::NEG_INFINITY }.intersect(iterations)
    }

    #[test]
    fn the_index_of_a_layer_follows_equation_4() {
        // Eq. 4: l = ⌊K d_f / δ · (1/d_near − 1/d)⌋, where K is the CoC radius at infinity.
        let (at_infinity, focus, nearest, delta) = (40.0, 2.0, 0.7, 3.0);
        let coc = |depth: f32| at_infinity * (1.0 - focus / depth);
        let spacing = Spacing::new([coc(nearest), coc(1e3)], delta, 0.1);
        for depth in [0.7, 0.75, 0.9, 1.3, 2.0, 2.5, 9.0, 400.0] {
            let equation = at_infinity * focus / delta * (1.0 / nearest - 1.0 / depth);
            assert_eq!(spacing.index(coc(depth)), equation.floor() as usize, "depth {depth}");
        }
    }

    #[test]
    fn layers_extend_a_tenth_into_their_neighbours() {
        let spacing = Spacing::new([-6.0, 4.0], 2.0, 0.1);
        assert_eq!(spacing.count, 6, "the last holds the far end alone");
        let containing = |c| spacing.containing(c).collect::<Vec<_>>();
        assert_eq!([containing(-6.0), containing(-4.1), containing(-3.7)], [vec![0], vec![0, 1], vec![1]]);
        let [near, far] = spacing.interval(1);
        assert!((near + 4.2).abs() < 1e-6 && (far + 1.8).abs() < 1e-6, "a fifth of a pixel on either side");
    }

    #[test]
    fn false_position_hits_a_plane_exactly() {
        // A level surface at 1.25 is 1.25 and 1.75 from the ends, so the first guess is exact.
        let fragments = Fragments::from_lists((40, 40), |_, _| vec![1.25]);
        let ray = Ray { start: Vec2::new(20.5, 20.5), step: Vec2::new(0.7, -0.6) };
        let hit = intersect(&fragments, ray, 1).unwrap();
        assert_eq!((hit.at, hit.coc_px), (1.25, 1.25));
        assert_eq!(hit.sample, fragments.sample_at(ray.at(1.25)));
    }

    #[test]
    fn three_iterations_of_false_position_hit_a_curved_surface() {
        // Over x = 200 c the surface is 1 + (x / 600)² = 1 + c²/9. The ray intersects it at c = (9 − √45) / 2.
        let fragments = Fragments::from_lists((640, 1), |x, _| vec![1.0 + (x as f32 / 600.0).powi(2)]);
        let ray = Ray { start: Vec2::new(0.0, 0.5), step: Vec2::new(200.0, 0.0) };
        let hit = intersect(&fragments, ray, 3).unwrap();
        let expected = 0.5 * (9.0 - 45f32.sqrt());
        // Guesses 1.5, 1.2, 1.154, 1.147 by hand; a sample is 0.005 of c wide.
        assert!((hit.at - expected).abs() < 0.008, "{} instead of {expected}", hit.at);
    }

    #[test]
    fn every_hit_lies_in_the_layer_and_on_a_fragment() {
        let height = |x, y| 5.0 * noise(x, y, 1) - 1.0;
        let fragments = Fragments::from_lists((24, 24), |x, y| vec![height(x, y), height(x, y) + 2.0]);
        let mut hits = 0;
        for i in 0..4000 {
            let random = |k| noise(i, k, 7);
            let start = Vec2::new(24.0 * random(0), 24.0 * random(1));
            let ray = Ray { start, step: Vec2::new(4.0 * random(2) - 2.0, 4.0 * random(3) - 2.0) };
            for hit in [1, 3, 9].into_iter().filter_map(|iterations| intersect(&fragments, ray, iterations)) {
                hits += 1;
                assert!((0.0..=3.0).contains(&hit.at) && (0.0..=3.0).contains(&hit.coc_px), "{hit:?}");
                assert_eq!(hit.coc_px, fragments.coc_px(hit.sample)[hit.fragment], "{hit:?}");
            }
        }
        assert!(hits > 5000, "{hits} hits");
    }

    #[test]
    fn the_frame_interval_is_bounded_by_the_frame_edges() {
        let ray = Ray { start: Vec2::new(2.0, 3.0), step: Vec2::new(0.5, -1.0) };
        // x reaches 0 at −4 and 10 at 16, y reaches 10 at −7 and 0 at 3.
        assert_eq!(ray.frame_interval(Vec2::splat(10.0)), [-4.0, 3.0]);
        let still = Ray { step: Vec2::ZERO, ..ray };
        assert_eq!(still.frame_interval(Vec2::splat(10.0)), [f32::NEG_INFINITY, f32::INFINITY]);
    }
}
