//! What is opaque and ends the rays of a view in a row: noted while its spans are looked through, front to back, and added to the sums
//! when all of them are.
//!
//! More than half of the chunks that spans cover have no rays left. Noting does not branch on it: each chunk of a span is written
//! to the end of a list, which becomes longer only if rays are left. A ray that is noted here passed nothing translucent in its view, so
//! that sums have the bits that adding at once would give.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods::shear::spans::Span;
    use crate::methods::shear::values::SourceColumn;

    const CHUNKS: usize = 5;

    #[test]
    fn each_ray_is_hit_once_by_the_first_span_that_covers_its_column() {
        let span = Span { start: 0, end: 1, layer: 0, opaque: true, changes_peel: false };
        let (mut hits, mut occluded) = (OpaqueHits::new(CHUNKS), vec![0; CHUNKS]);
        let mut first_block = vec![None; CHUNKS * LANES];
        // One column at either end of a chunk, a whole chunk, several, all, and nothing that is left.
        for (block, covered) in [15..16, 16..17, 32..48, 3..52, 39..80, 0..80, 7..9].into_iter().enumerate() {
            let source = Source::new(&span, block as u16, 0, SourceColumn::Shifted(0));
            let full = |occluded: &[Mask]| occluded.iter().filter(|&&mask| mask == Mask::MAX).count();
            let before = full(&occluded);
            let ended = hits.note(&mut occluded, &covered, source);
            assert_eq!(ended, full(&occluded) - before, "chunks ended by {covered:?}");
            covered.for_each(|x| first_block[x] = first_block[x].or(Some(block as u16)));
        }
        assert_eq!(occluded, [Mask::MAX; CHUNKS]);
        let mut hit_by = vec![None; CHUNKS * LANES];
        for hit in &hits.hits[..hits.count] {
            for lane in (0..LANES).filter(|lane| hit.lanes >> lane & 1 == 1) {
                let block = hits.sources[hit.source as usize].block;
                let before = hit_by[hit.chunk as usize * LANES + lane].replace(block);
                assert_eq!(before, None, "one hit a ray");
            }
        }
        assert_eq!(hit_by, first_block);
        assert_eq!(hits.sources.len(), 6, "what nothing hits is not kept");
    }
}
