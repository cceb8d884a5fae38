//! What is opaque and ends the rays of a view in a row: noted while its spans are looked through, front to back, and added to the sums
//! when all of them are.
//!
//! More than half of the chunks that spans cover have no rays left. Noting does not branch on it: each chunk of a span is written
//! to the end of a list, which becomes longer only if rays are left. A ray that is noted here passed nothing translucent in its view, so
//! that sums have the bits that adding at once would give.
//!
//! Memory: a hit and what it hits for each pixel at most, as each has one ray.

use super::canvas::Canvas;
use super::lanes::{LANES, Mask, chunks_of};
use super::sums::Sums;
use super::values::{Hit, Source, add_opaque};
use pulp::Simd;
use std::ops::Range;

/// The hits of a view that are not added yet.
#[derive(Debug, Clone)]
pub(super) struct OpaqueHits {
    /// The hits in order, and room for the most that there can be.
    hits: Vec<Hit>,
    /// Number of hits.
    count: usize,
    /// What they hit, each with the number of hits up to its last one.
    sources: Vec<(Source, usize)>,
}

/// What [`OpaqueHits::note`] leaves of the rays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct RaysLeft {
    /// Number of chunks that had rays and have none.
    pub(super) ended_chunks: usize,
    /// Whether there are attenuated rays at its columns.
    pub(super) attenuated: bool,
}

impl OpaqueHits {
    /// No hits in a row of `chunks` chunks.
    pub(super) fn new(chunks: usize) -> Self {
        // A hit ends a ray, and all chunks of a span are written.
        let hits = vec![Hit::default(); chunks * LANES + chunks];
        Self { hits, count: 0, sources: Vec::new() }
    }

    /// Notes what of `source` rays hit at `columns` that are neither `occluded` nor `attenuated`, and occludes them.
    #[inline(always)]
    pub(super) fn note(
        &mut self,
        occluded: &mut [Mask],
        attenuated: &[Mask],
        columns: &Range<usize>,
        source: Source,
    ) -> RaysLeft {
        let chunks = chunks_of(columns);
        let (first, between) = (chunks.start, chunks.len() - 1);
        let start = Mask::MAX << (columns.start % LANES);
        let end = Mask::MAX >> (LANES - 1 - (columns.end - 1) % LANES);
        let (occluded, attenuated) = (&mut occluded[chunks.clone()], &attenuated[chunks]);
        let hits = &mut self.hits[self.count..][..occluded.len()];
        let (mut count, mut ended_chunks, mut left) = (0, 0, 0);
        let mut note = |i: usize, inside: Mask| {
            let free = inside & !occluded[i];
            let lanes = free & !attenuated[i];
            let now = occluded[i] | lanes;
            occluded[i] = now;
            hits[count] = Hit { chunk: (first + i) as u32, lanes };
            count += usize::from(lanes != 0);
            ended_chunks += usize::from((lanes != 0) & (now == Mask::MAX));
            left |= free & attenuated[i];
        };
        if between == 0 {
            note(0, start & end);
        } else {
            note(0, start);
            (1..between).for_each(|i| note(i, Mask::MAX));
            note(between, end);
        }
        self.count += count;
        let sources = self.sources.len();
        self.sources.push((source, self.count));
        self.sources.truncate(sources + usize::from(count > 0));
        RaysLeft { ended_chunks, attenuated: left != 0 }
    }

    /// Adds all hits to `sums` and forgets them.
    #[inline(always)]
    pub(super) fn add_to<S: Simd>(&mut self, simd: S, sums: &mut Sums, canvas: &Canvas<'_>) {
        let mut first = 0;
        for &(source, end) in &self.sources {
            add_opaque(simd, sums, canvas, &source, &self.hits[first..end]);
            first = end;
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
        // Rays that are not noted: one among others, and a chunk's all.
        let mut attenuated = vec![0; CHUNKS];
        (attenuated[1], attenuated[4]) = (1 << 4, Mask::MAX);
        let is_attenuated = |x: usize| attenuated[x / LANES] >> (x % LANES) & 1 == 1;
        let mut first_block = vec![None; CHUNKS * LANES];
        // One column at either end of a chunk, a whole chunk, several, all, and nothing that is left.
        for (block, covered) in [15..16, 16..17, 32..48, 3..52, 39..80, 0..80, 7..9].into_iter().enumerate() {
            let source = Source::new(&span, block as u16, 0, SourceColumn::Shifted(0));
            let full = |occluded: &[Mask]| occluded.iter().filter(|&&mask| mask == Mask::MAX).count();
            let before = full(&occluded);
            let left = hits.note(&mut occluded, &attenuated, &covered, source);
            assert_eq!(left.ended_chunks, full(&occluded) - before, "chunks ended by {covered:?}");
            assert_eq!(left.attenuated, covered.clone().any(is_attenuated), "rays left at {covered:?}");
            covered
                .filter(|&x| !is_attenuated(x))
                .for_each(|x| first_block[x] = first_block[x].or(Some(block as u16)));
        }
        assert_eq!(occluded, [Mask::MAX, !(1 << 4), Mask::MAX, Mask::MAX, 0]);
        let mut hit_by = vec![None; CHUNKS * LANES];
        let mut noted = hits.hits[..hits.count].iter();
        for (already, (source, end)) in
            hits.sources.iter().scan(0, |end, of| Some((std::mem::replace(end, of.1), of)))
        {
            for hit in noted.by_ref().take(end - already) {
                for lane in (0..LANES).filter(|lane| hit.lanes >> lane & 1 == 1) {
                    let before = hit_by[hit.chunk as usize * LANES + lane].replace(source.block);
                    assert_eq!(before, None, "one hit a ray");
                }
            }
        }
        assert_eq!(noted.len(), 0, "every hit has its source");
        assert_eq!(hit_by, first_block);
        assert_eq!(hits.sources.len(), 6, "what nothing hits is not kept");
    }
}
