//! What is opaque and ends the rays of a view in a row: noted while its spans are looked through, front to back, and added to the sums
//! when all of them are.
//!
//! Whether a chunk has rays left is as good as random, so that a processor that must decide it before it adds waits for nearly every
//! decision. Noting needs none: each chunk of a span is written to the end of a list, which becomes longer only if rays are left. A ray
//! that is noted here passed nothing translucent in its view, so that sums have the bits that adding at once would give.
//!
//! Memory: a hit and what it hits for each pixel at most, as each has one ray.

use super::canvas::Canvas;
use super::lanes::{Chunk, LANES, Mask};
use super::sums::Sums;
use super::values::{ONES, Source, Weights, add_weighted};
use pulp::Simd;
use std::ops::Range;

/// The hits of a view that are not added yet.
#[derive(Debug, Clone)]
pub(super) struct OpaqueHits {
    /// The hits in order, and room for the most that there can be.
    hits: Vec<Hit>,
    /// Number of hits.
    count: usize,
    /// What they hit.
    sources: Vec<Source>,
}

/// Rays of a chunk that hit something.
#[derive(Debug, Clone, Copy, Default)]
struct Hit {
    /// An index of [`OpaqueHits::sources`].
    source: u32,
    chunk: u32,
    /// The lanes of the rays.
    lanes: Mask,
}

impl OpaqueHits {
    /// No hits in a row of `chunks` chunks.
    pub(super) fn new(chunks: usize) -> Self {
        // A hit ends a ray, and all chunks of a span are written.
        let hits = vec![Hit::default(); chunks * LANES + chunks];
        Self { hits, count: 0, sources: Vec::new() }
    }

    /// Notes what of `source` rays hit at `columns` that are not `occluded`, and occludes them. Returns the number of chunks of which no ray
    /// is left.
    #[inline(always)]
    pub(super) fn note(&mut self, occluded: &mut [Mask], columns: &Range<usize>, source: Source) -> usize {
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
            hits[count] = Hit { source: index as u32, chunk: (first + i) as u32, lanes };
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

    /// Adds all hits to `sums` and forgets them.
    #[inline(always)]
    pub(super) fn add_to<S: Simd>(&mut self, simd: S, sums: &mut Sums, canvas: &Canvas<'_>) {
        let mut repeated = [Chunk::default(); 4];
        for hit in &self.hits[..self.count] {
            let source = &self.sources[hit.source as usize];
            let (chunk, block) = (hit.chunk as usize, &canvas.bins.blocks()[usize::from(source.block)]);
            let values = source.values(canvas.layers, chunk, &mut repeated);
            add_weighted(simd, (sums, chunk), block, &values, Weights { passing: &ONES, lanes: hit.lanes });
        }
        self.count = 0;
        self.sources.clear();
    }
}
