//! What the rays of a view hit in a row: noted while its spans are looked through, front to back, and added to the sums afterwards.
//!
//! Whether a chunk has rays left is as good as random, so that a processor that must decide it before it adds waits for nearly every
//! decision. Noting needs none: each chunk of a span is written to the end of a list, which becomes longer only if rays are left. Hits are
//! added in the order in which they were noted, so that sums have the bits that adding at once would give.
//!
//! Memory: a hit for each ray that something opaque ends, one for each chunk and translucent span, and what they hit.

use super::canvas::Canvas;
use super::lanes::{Chunk, LANES, Mask};
use super::sums::Sums;
use super::values::{Source, Weights, add_weighted};
use pulp::Simd;
use std::ops::Range;

/// The hits of a view that are not added yet.
#[derive(Debug, Clone)]
pub(super) struct RowHits {
    /// The hits in order, and room for more.
    hits: Vec<Hit>,
    /// Number of hits.
    count: usize,
    /// How many more hits there is always room for: something opaque ends a ray once, and the chunks of a span are all written.
    room: usize,
    /// What they hit.
    sources: Vec<Source>,
    /// Transmittances of rays before they hit; the first are 1.
    passing: Vec<Chunk>,
}

/// Rays of a chunk that hit something.
#[derive(Debug, Clone, Copy, Default)]
struct Hit {
    /// An index of [`RowHits::sources`].
    source: u32,
    /// An index of [`RowHits::passing`].
    passing: u32,
    chunk: u32,
    /// The lanes of the rays.
    lanes: Mask,
}

impl RowHits {
    /// No hits in a row of `chunks` chunks.
    pub(super) fn new(chunks: usize) -> Self {
        let room = chunks * LANES + chunks;
        Self {
            hits: vec![Hit::default(); 2 * room],
            count: 0,
            room,
            sources: Vec::new(),
            passing: vec![Chunk([1.0; LANES])],
        }
    }

    /// Notes what of the opaque `source` rays hit at `columns` that are not `occluded`, and occludes them. Returns the number of chunks of
    /// which no ray is left.
    #[inline(always)]
    pub(super) fn note_opaque(
        &mut self,
        occluded: &mut [Mask],
        columns: &Range<usize>,
        source: Source,
    ) -> usize {
        let (first, last) = (columns.start / LANES, (columns.end - 1) / LANES);
        let start = Mask::MAX << (columns.start % LANES);
        let end = Mask::MAX >> (LANES - 1 - (columns.end - 1) % LANES);
        let occluded = &mut occluded[first..=last];
        let hits = &mut self.hits[self.count..][..occluded.len()];
        let index = self.sources.len();
        let (mut count, mut ended) = (0, 0);
        let mut note = |i: usize, occluded: &mut Mask, inside: Mask| {
            let lanes = inside & !*occluded;
            let now = *occluded | inside;
            *occluded = now;
            hits[count] = Hit { source: index as u32, passing: 0, chunk: (first + i) as u32, lanes };
            count += usize::from(lanes != 0);
            ended += usize::from((lanes != 0) & (now == Mask::MAX));
        };
        let between = occluded.len() - 1;
        if between == 0 {
            note(0, &mut occluded[0], start & end);
        } else {
            note(0, &mut occluded[0], start);
            for (i, occluded) in occluded[..between].iter_mut().enumerate().skip(1) {
                note(i, occluded, Mask::MAX);
            }
            note(between, &mut occluded[between], end);
        }
        self.count += count;
        self.sources.push(source);
        self.sources.truncate(index + usize::from(count > 0));
        ended
    }

    /// Notes that the rays of `chunk` in `lanes` hit `source` with transmittances `passing`.
    pub(super) fn note(&mut self, (chunk, lanes): (usize, Mask), source: Source, passing: &Chunk) {
        let hit = Hit {
            source: self.sources.len() as u32,
            passing: self.passing.len() as u32,
            chunk: chunk as u32,
            lanes,
        };
        self.hits[self.count] = hit;
        self.count += 1;
        if self.count + self.room > self.hits.len() {
            self.hits.resize(2 * self.hits.len(), Hit::default());
        }
        self.sources.push(source);
        self.passing.push(*passing);
    }

    /// Adds all hits to `sums` and forgets them.
    #[inline(always)]
    pub(super) fn add_to<S: Simd>(&mut self, simd: S, sums: &mut Sums, canvas: &Canvas<'_>) {
        let (blocks, keeps_near) = (canvas.bins.blocks(), !sums.near.is_empty());
        let mut repeated = [Chunk::default(); 4];
        for hit in &self.hits[..self.count] {
            let source = &self.sources[hit.source as usize];
            let (chunk, block) = (hit.chunk as usize, &blocks[usize::from(source.block)]);
            let [red, green, blue, alpha] = source.values(canvas.layers, chunk, &mut repeated);
            let passing = &self.passing[hit.passing as usize];
            let weights = |share: f32| Weights { passing, lanes: hit.lanes, share };
            let near = if keeps_near { block.near } else { 0.0 };
            if near < 1.0 {
                add_weighted(simd, &mut sums.color[chunk], [red, green, blue], weights(1.0 - near));
            }
            if near > 0.0 {
                let sums = &mut sums.near[chunk];
                add_weighted(simd, &mut sums.color, [red, green, blue], weights(near));
                add_weighted(simd, std::array::from_mut(&mut sums.share), [alpha], weights(near));
                let radius = weights(near * block.radius_px);
                add_weighted(simd, std::array::from_mut(&mut sums.radius_px), [alpha], radius);
            }
            if block.focus > 0.0 {
                let focused = std::array::from_mut(&mut sums.focused[chunk]);
                add_weighted(simd, focused, [alpha], weights(block.focus));
            }
        }
        self.count = 0;
        self.sources.clear();
        self.passing.truncate(1);
    }
}
