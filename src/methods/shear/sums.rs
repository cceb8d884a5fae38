//! Sums over the views of an output row, and the means that they give.

use super::lanes::Chunk;
use crate::methods::contract::LostRays;

/// No more than this number of a pixel's rays, weighted by coverage, is rounding.
pub(super) const MIN_HIT_VIEWS: f32 = 1e-3;

/// Red, green, blue and alpha of the pixels of a chunk; the share of their rays that hit something in focus; and what they gather from near
/// surfaces ([`super::near::NearLight`]): the share of rays that these stop, their CoC radius times that share, red, green and blue.
pub(super) type Means = [Chunk; 10];

/// The index of alpha in [`Means`].
pub(super) const ALPHA: usize = 3;

/// The index of the share of rays that hit something in focus, which is that of alpha's views.
pub(super) const FOCUSED: usize = 4;

/// The index of the share of rays that near surfaces stop in [`Means`].
pub(super) const NEAR_SHARE: usize = 5;

/// The index of the CoC radius of near surfaces in [`Means`], which is that of alpha's views.
pub(super) const NEAR_RADIUS: usize = 6;

/// The index of the red of near surfaces in [`Means`].
pub(super) const NEAR_COLOR: usize = 7;

/// What rays gather from near surfaces.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct NearSums {
    /// Number of rays that they stop, weighted by coverage.
    pub(super) share: Chunk,
    /// The same, times their CoC radius in pixels.
    pub(super) radius_px: Chunk,
    pub(super) color: [Chunk; 3],
}

impl NearSums {
    /// Adds the sums of `other`.
    #[inline(always)]
    fn add(&mut self, other: &Self) {
        self.share.add(&other.share);
        self.radius_px.add(&other.radius_px);
        for (sum, other) in self.color.iter_mut().zip(&other.color) {
            sum.add(other);
        }
    }
}

/// Sums over views, one chunk for each 16 pixels.
#[derive(Debug, Clone)]
pub(super) struct Sums {
    /// Colour of what is not near.
    pub(super) color: Vec<[Chunk; 3]>,
    /// What is near; empty if it is not kept apart.
    pub(super) near: Vec<NearSums>,
    /// Number of rays that hit something in focus, weighted by coverage.
    pub(super) focused: Vec<Chunk>,
    /// Number of rays that end in the background, weighted by transmittance.
    pub(super) transparent: Vec<Chunk>,
    /// Number of rays that end where the stack has nothing or with too little light to go on, weighted by transmittance.
    pub(super) lost: Vec<Chunk>,
}

impl Sums {
    /// No views, for `chunks` chunks; `near` says whether near surfaces are kept apart.
    pub(super) fn blank(chunks: usize, near: bool) -> Self {
        let blank = vec![Chunk::default(); chunks];
        let color = vec![[Chunk::default(); 3]; chunks];
        let near = vec![NearSums::default(); if near { chunks } else { 0 }];
        Self { color, near, focused: blank.clone(), transparent: blank.clone(), lost: blank }
    }

    /// Removes all views.
    pub(super) fn clear(&mut self) {
        self.chunks_mut().for_each(|chunk| *chunk = Chunk::default());
        self.near.fill(NearSums::default());
    }

    /// Adds the sums of `other`.
    pub(super) fn add(&mut self, other: &Self) {
        for (sum, other) in self.chunks_mut().zip(other.chunks()) {
            sum.add(other);
        }
        self.near.iter_mut().zip(&other.near).for_each(|(sum, other)| sum.add(other));
    }

    fn chunks(&self) -> impl Iterator<Item = &Chunk> {
        let color = self.color.as_flattened().iter();
        color.chain(&self.focused).chain(&self.transparent).chain(&self.lost)
    }

    fn chunks_mut(&mut self) -> impl Iterator<Item = &mut Chunk> {
        let color = self.color.as_flattened_mut().iter_mut();
        color.chain(&mut self.focused).chain(&mut self.transparent).chain(&mut self.lost)
    }

    /// The means of chunk `chunk` over these sums and those of `others`, which have `views` views together at each pixel; lost rays count
    /// as `lost_rays` says.
    #[inline(always)]
    pub(super) fn means(&self, others: &Self, chunk: usize, views: &Chunk, lost_rays: LostRays) -> Means {
        let total = |mut sum: Chunk, other: &Chunk| {
            sum.add(other);
            sum
        };
        let transparent = total(self.transparent[chunk], &others.transparent[chunk]);
        let lost = total(self.lost[chunk], &others.lost[chunk]);
        let focused = total(self.focused[chunk], &others.focused[chunk]);
        let weight = match lost_rays {
            LostRays::LeftOut => Chunk::from_fn(|lane| views.0[lane] - lost.0[lane]),
            LostRays::Black => *views,
        };
        let covered = Chunk::from_fn(|lane| weight.0[lane] - transparent.0[lane]);
        // Light without alpha has colour where nothing is covered.
        let mean_where = |enough: &Chunk, sum: &Chunk| {
            Chunk::from_fn(|lane| {
                let mean = sum.0[lane] / weight.0[lane];
                if enough.0[lane] > MIN_HIT_VIEWS { mean } else { 0.0 }
            })
        };
        let mean = |sum: &Chunk| mean_where(&weight, sum);
        let mut near = NearSums::default();
        for sums in [self, others] {
            if let Some(sums) = sums.near.get(chunk) {
                near.add(sums);
            }
        }
        let [red, green, blue] = &near.color;
        let (color, other) = (&self.color[chunk], &others.color[chunk]);
        [
            mean(&total(total(color[0], &other[0]), red)),
            mean(&total(total(color[1], &other[1]), green)),
            mean(&total(total(color[2], &other[2]), blue)),
            mean_where(&covered, &covered),
            Chunk::from_fn(|lane| focused.0[lane] / views.0[lane].max(MIN_HIT_VIEWS)),
            mean(&near.share),
            mean(&near.radius_px),
            mean(red),
            mean(green),
            mean(blue),
        ]
    }
}
