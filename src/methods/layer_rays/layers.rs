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
        self.over(at)
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
