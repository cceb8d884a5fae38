//! Depth layers of equal growth of CoC, and what a ray finds in one.

use crate::methods::shared::Fragments;
use glam::Vec2;

/// A lens ray: at CoC radius `c` it is over sample position `start + c·step`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ray {
    /// Where it passes the plane of focus, in samples.
    pub start: Vec2,
    /// How far it moves, in samples, for each pixel of CoC radius.
    pub step: Vec2,
}

impl Ray {
    /// Where it is at CoC radius `c`.
    #[inline(always)]
    pub(super) fn at(&self, c: f32) -> Vec2 {
        self.start + c * self.step
    }

    /// CoC radii between which it is within a frame of `size` samples; it passes the plane of focus within it.
    #[inline]
    pub(super) fn stay(&self, size: Vec2) -> [f32; 2] {
        let sides = |start: f32, step: f32, size: f32| {
            let (a, b) = (-start / step, (size - start) / step);
            // A ray that stands still never leaves: 0 / 0 on the very border is no number, and so no bound.
            [a.min(b).min(0.0), a.max(b).max(0.0)]
        };
        let (x, y) = (sides(self.start.x, self.step.x, size.x), sides(self.start.y, self.step.y, size.y));
        [x[0].max(y[0]), x[1].min(y[1])]
    }
}

/// How CoC depth is divided into layers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Spacing {
    near_px: f32,
    delta_px: f32,
    overlap: f32,
    /// How many layers there are.
    pub count: usize,
}

impl Spacing {
    /// Layers of `delta_px` from the near to the far end of `coc_range_px`, reaching into one another by a share of
    /// `overlap`.
    pub(super) fn new(coc_range_px: [f32; 2], delta_px: f32, overlap: f32) -> Self {
        let mut spacing = Self { near_px: coc_range_px[0], delta_px, overlap, count: usize::MAX };
        spacing.count = spacing.index(coc_range_px[1]) + 1;
        spacing
    }

    /// The layer of CoC radius `c` (eq. 4 in CoC space): `⌊(c − c_near) / δ⌋`.
    pub(super) fn index(&self, c: f32) -> usize {
        (((c - self.near_px) / self.delta_px) as usize).min(self.count.saturating_sub(1))
    }

    /// CoC radii that layer `index` holds, with what it shares with its neighbours.
    pub(super) fn interval(&self, index: usize) -> [f32; 2] {
        let side = |layers: f32| self.near_px + layers * self.delta_px;
        [side(index as f32 - self.overlap), side((index + 1) as f32 + self.overlap)]
    }

    /// The layers that hold CoC radius `c`.
    pub(super) fn holding(&self, c: f32) -> impl Iterator<Item = usize> + use<> {
        let (spacing, own) = (*self, self.index(c));
        (own.saturating_sub(1)..(own + 2).min(self.count)).filter(move |&layer| {
            let [near, far] = spacing.interval(layer);
            (near..=far).contains(&c)
        })
    }
}

/// Where a ray meets a layer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Hit {
    /// CoC radius at which it does.
    pub at: f32,
    /// The sample that it is over there.
    pub sample: usize,
    /// Which of the sample's fragments it meets.
    pub fragment: usize,
    /// CoC radius of that fragment.
    pub coc_px: f32,
}

/// A part of a ray that is tested against a layer's height field: the nearest fragments in an interval of CoC radii.
#[derive(Debug)]
pub(super) struct Segment<'a> {
    /// The stack.
    pub fragments: &'a Fragments,
    /// The ray.
    pub ray: Ray,
    /// The interval.
    pub interval: [f32; 2],
    /// Fragments up to this CoC radius have been met before.
    pub behind: f32,
}

impl Segment<'_> {
    /// The layer's fragment where the ray is at `c`, as if it were met there.
    #[inline(always)]
    fn over(&self, c: f32) -> Option<Hit> {
        let sample = self.fragments.sample_at(self.ray.at(c));
        let [near, far] = self.interval;
        let list = self.fragments.coc_px(sample);
        let fragment = list.iter().position(|&coc| coc >= near && coc > self.behind)?;
        let coc_px = list[fragment];
        (coc_px <= far).then_some(Hit { at: c, sample, fragment, coc_px })
    }

    /// Where the ray meets the height field, by false position (section 4.3).
    ///
    /// The surface is taken to be straight between the ends of the search; where the surface at the point that follows is
    /// nearer than the ray, the ray has met it before, otherwise it meets it later. An empty sample counts as the layer's
    /// far bound before the surface and as its near bound after it, which keeps the search between the bounds.
    ///
    /// A last look, where the ray is as deep as the surface that was found, keeps a ray that has slipped behind an edge from
    /// being stopped by it: there it is over nothing, or over what it does meet.
    #[inline]
    pub(super) fn meet(&self, iterations: usize) -> Option<Hit> {
        let [near, far] = self.interval;
        let (mut before, mut after) = (near, far);
        let first = self.over(before);
        let mut begun = first.is_some();
        let mut ahead = first.map_or(far, |hit| hit.coc_px) - before;
        let mut past = after - self.over(after).map_or(near, |hit| hit.coc_px);
        let mut at = crossing([before, after], ahead, past);
        for _ in 0..iterations {
            let found = self.over(at);
            let height = found.map_or(if begun { near } else { far }, |hit| hit.coc_px);
            if height > at {
                begun |= found.is_some();
                (before, ahead) = (at, height - at);
            } else if height < at {
                (after, past) = (at, at - height);
            } else {
                return found;
            }
            at = crossing([before, after], ahead, past);
        }
        self.over(at).and_then(|hit| self.over(hit.coc_px))
    }
}

/// Where a ray that is `ahead` before the surface at the first end and `past` behind it at the second crosses the straight
/// line between.
#[inline(always)]
fn crossing([before, after]: [f32; 2], ahead: f32, past: f32) -> f32 {
    let whole = ahead + past;
    let share = if whole > 0.0 { ahead / whole } else { 0.0 };
    (before + (after - before) * share).clamp(before, after)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods::shared::noise;

    const THREE: [f32; 2] = [0.0, 3.0];

    fn meet(fragments: &Fragments, ray: Ray, iterations: usize) -> Option<Hit> {
        Segment { fragments, ray, interval: THREE, behind: f32::NEG_INFINITY }.meet(iterations)
    }

    #[test]
    fn a_layers_index_is_that_of_the_papers_equation() {
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
    fn layers_reach_a_tenth_into_their_neighbours() {
        let spacing = Spacing::new([-6.0, 4.0], 2.0, 0.1);
        assert_eq!(spacing.count, 6, "the last holds the far end alone");
        let holding = |c| spacing.holding(c).collect::<Vec<_>>();
        assert_eq!([holding(-6.0), holding(-4.1), holding(-3.7)], [vec![0], vec![0, 1], vec![1]]);
        let [near, far] = spacing.interval(1);
        assert!((near + 4.2).abs() < 1e-6 && (far + 1.8).abs() < 1e-6, "a fifth of a pixel on either side");
    }

    #[test]
    fn false_position_meets_a_plane_exactly() {
        // Level at 1.25: both ends lie 1.25 and 1.75 from it, so the first guess is the plane itself.
        let fragments = Fragments::from_lists((40, 40), |_, _| vec![1.25]);
        let ray = Ray { start: Vec2::new(20.5, 20.5), step: Vec2::new(0.7, -0.6) };
        let hit = meet(&fragments, ray, 1).unwrap();
        assert_eq!((hit.at, hit.coc_px), (1.25, 1.25));
        assert_eq!(hit.sample, fragments.sample_at(ray.at(1.25)));
    }

    #[test]
    fn three_steps_of_false_position_meet_a_curved_surface() {
        // Over x = 200 c the surface is 1 + (x / 600)² = 1 + c²/9, which the ray meets at c = (9 − √45) / 2.
        let fragments = Fragments::from_lists((640, 1), |x, _| vec![1.0 + (x as f32 / 600.0).powi(2)]);
        let ray = Ray { start: Vec2::new(0.0, 0.5), step: Vec2::new(200.0, 0.0) };
        let hit = meet(&fragments, ray, 3).unwrap();
        let expected = 0.5 * (9.0 - 45f32.sqrt());
        // Guesses 1.5, 1.2, 1.154, 1.147 by hand; a sample is 0.005 of c wide.
        assert!((hit.at - expected).abs() < 0.008, "{} instead of {expected}", hit.at);
    }

    #[test]
    fn no_hit_lies_outside_the_layer_or_on_nothing() {
        let height = |x, y| 5.0 * noise(x, y, 1) - 1.0;
        let fragments = Fragments::from_lists((24, 24), |x, y| vec![height(x, y), height(x, y) + 2.0]);
        let mut hits = 0;
        for i in 0..4000 {
            let random = |k| noise(i, k, 7);
            let start = Vec2::new(24.0 * random(0), 24.0 * random(1));
            let ray = Ray { start, step: Vec2::new(4.0 * random(2) - 2.0, 4.0 * random(3) - 2.0) };
            for hit in [1, 3, 9].into_iter().filter_map(|iterations| meet(&fragments, ray, iterations)) {
                hits += 1;
                assert!((0.0..=3.0).contains(&hit.at) && (0.0..=3.0).contains(&hit.coc_px), "{hit:?}");
                assert_eq!(hit.coc_px, fragments.coc_px(hit.sample)[hit.fragment], "{hit:?}");
            }
        }
        assert!(hits > 5000, "{hits} hits");
    }

    #[test]
    fn a_ray_is_in_the_frame_between_where_its_line_enters_and_leaves() {
        let ray = Ray { start: Vec2::new(2.0, 3.0), step: Vec2::new(0.5, -1.0) };
        // x reaches 0 at −4 and 10 at 16, y reaches 10 at −7 and 0 at 3.
        assert_eq!(ray.stay(Vec2::splat(10.0)), [-4.0, 3.0]);
        let still = Ray { step: Vec2::ZERO, ..ray };
        assert_eq!(still.stay(Vec2::splat(10.0)), [f32::NEG_INFINITY, f32::INFINITY]);
    }
}
