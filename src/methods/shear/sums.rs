//! Sums over the views of an output row, and the means that they give.

use super::lanes::{Chunk, LANES};
use crate::methods::contract::LostRays;

/// A pixel is empty if no more than this number of its rays, weighted by coverage, hit anything.
pub(super) const MIN_HIT_VIEWS: f32 = 1e-3;

/// Red, green, blue and alpha of the pixels of a chunk, and the share of their rays that hit something in focus.
pub(super) type Means = [Chunk; 5];

/// The index of alpha in [`Means`].
pub(super) const ALPHA: usize = 3;

/// The index of the share of rays that hit something in focus, which is that of alpha's views.
pub(super) const FOCUSED: usize = 4;

/// Sums over views, one chunk for each 16 pixels.
#[derive(Debug, Clone)]
pub(super) struct Sums {
    pub(super) color: Vec<[Chunk; 3]>,
    /// Number of rays that hit something in focus, weighted by coverage.
    pub(super) focused: Vec<Chunk>,
    /// Number of rays that end in the background, weighted by transmittance.
    pub(super) transparent: Vec<Chunk>,
    /// Number of rays that end where the stack has nothing or with too little light to go on, weighted by transmittance.
    pub(super) lost: Vec<Chunk>,
}

impl Sums {
    /// No views, for `chunks` chunks.
    pub(super) fn blank(chunks: usize) -> Self {
        let blank = vec![Chunk::default(); chunks];
        let color = vec![[Chunk::default(); 3]; chunks];
        Self { color, focused: blank.clone(), transparent: blank.clone(), lost: blank }
    }

    /// Removes all views.
    pub(super) fn clear(&mut self) {
        self.chunks_mut().for_each(|chunk| *chunk = Chunk::default());
    }

    /// Adds the sums of `other`.
    pub(super) fn add(&mut self, other: &Self) {
        for (sum, other) in self.chunks_mut().zip(other.chunks()) {
            sum.0.iter_mut().zip(other.0).for_each(|(sum, other)| *sum += other);
        }
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
    pub(super) fn means(
        &self,
        others: &Self,
        chunk: usize,
        views: &[f32; LANES],
        lost_rays: LostRays,
    ) -> Means {
        let total = |of: fn(&Self, usize) -> &Chunk| {
            let (one, other) = (of(self, chunk), of(others, chunk));
            Chunk(std::array::from_fn(|lane| one.0[lane] + other.0[lane]))
        };
        let transparent = total(|sums, chunk| &sums.transparent[chunk]);
        let lost = total(|sums, chunk| &sums.lost[chunk]);
        let focused = total(|sums, chunk| &sums.focused[chunk]);
        let known = std::array::from_fn(|lane| views[lane] - lost.0[lane]);
        let weight: [f32; LANES] = match lost_rays {
            LostRays::LeftOut => known,
            LostRays::Black => *views,
        };
        let covered: [f32; LANES] = std::array::from_fn(|lane| weight[lane] - transparent.0[lane]);
        let mean = |sum: &[f32; LANES]| {
            let value = |lane: usize| sum[lane] / weight[lane];
            Chunk(std::array::from_fn(|lane| if covered[lane] > MIN_HIT_VIEWS { value(lane) } else { 0.0 }))
        };
        [
            mean(&total(|sums, chunk| &sums.color[chunk][0]).0),
            mean(&total(|sums, chunk| &sums.color[chunk][1]).0),
            mean(&total(|sums, chunk| &sums.color[chunk][2]).0),
            mean(&covered),
            Chunk(std::array::from_fn(|lane| focused.0[lane] / views[lane].max(MIN_HIT_VIEWS))),
        ]
    }
}
