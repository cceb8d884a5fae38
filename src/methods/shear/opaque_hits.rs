//! What is opaque and ends the rays of a view in a row: noted while its spans are looked through, front to back, and added to the sums
//! when all of them are.
//!
//! Rays are looked up for 64 pixels at a time: most spans lie within one word, so that their length decides no branch. Each chunk of a word
//! that has rays left is written to the end of a list, which becomes longer only if the chunk has some. A ray that is noted here passed
//! nothing translucent in its view, so that sums have the bits that adding at once would give.
//!
//! Memory: a hit and what it hits for each pixel at most, as each has one ray.

use super::canvas::Canvas;
use super::lanes::{LANES, Mask};
use super::row_mask::{CHUNKS_OF_WORD, RowMask, words_of};
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

/// What [`OpaqueHits::note`] did to the rays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct RaysLeft {
    /// Number of rays that it ended.
    pub(super) ended: usize,
    /// Whether there are attenuated rays at its columns.
    pub(super) attenuated: bool,
}

impl OpaqueHits {
    /// No hits in a row of `chunks` chunks.
    pub(super) fn new(chunks: usize) -> Self {
        // A hit ends a ray, and all chunks of a word are written.
        let hits = vec![Hit::default(); chunks * LANES + CHUNKS_OF_WORD];
        Self { hits, count: 0, sources: Vec::new() }
    }

    /// Notes what of `source` rays hit at `columns` that are neither `occluded` nor `attenuated`, and occludes them.
    #[inline(always)]
    pub(super) fn note(
        &mut self,
        occluded: &mut RowMask,
        attenuated: &RowMask,
        columns: &Range<usize>,
        source: Source,
    ) -> RaysLeft {
        let (mut count, mut ended, mut left) = (self.count, 0, 0);
        for (word, covered) in words_of(columns) {
            let occluded = occluded.word_mut(word);
            let free = covered & !*occluded;
            if free == 0 {
                continue;
            }
            let attenuated = attenuated.word(word);
            let rays = free & !attenuated;
            *occluded |= rays;
            ended += rays.count_ones() as usize;
            left |= free & attenuated;
            let hits = &mut self.hits[count..][..CHUNKS_OF_WORD];
            let mut more = 0;
            for chunk in 0..CHUNKS_OF_WORD {
                let lanes = (rays >> (chunk * LANES)) as Mask;
                hits[more] = Hit { chunk: (word * CHUNKS_OF_WORD + chunk) as u32, lanes };
                more += usize::from(lanes != 0);
            }
            count += more;
        }
        if count > self.count {
            self.count = count;
            self.sources.push((source, count));
        }
        RaysLeft { ended, attenuated: left != 0 }
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
        let (mut hits, mut occluded) = (OpaqueHits::new(CHUNKS), RowMask::none(CHUNKS * LANES));
        // Rays that are not noted: one among others, and a chunk's all.
        let mut attenuated = RowMask::none(CHUNKS * LANES);
        attenuated.add(1, 1 << 4);
        attenuated.add(4, Mask::MAX);
        let is_attenuated = |x: usize| attenuated.chunk(x / LANES) >> (x % LANES) & 1 == 1;
        let mut first_block = vec![None; CHUNKS * LANES];
        // One column at either end of a chunk, a whole chunk, several, all, and nothing that is left.
        for (block, covered) in [15..16, 16..17, 32..48, 3..52, 39..80, 0..80, 7..9].into_iter().enumerate() {
            let source = Source::new(&span, block as u16, 0, SourceColumn::Shifted(0));
            let before = occluded.count_without();
            let left = hits.note(&mut occluded, &attenuated, &covered, source);
            assert_eq!(left.ended, before - occluded.count_without(), "rays ended by {covered:?}");
            assert_eq!(left.attenuated, covered.clone().any(is_attenuated), "rays left at {covered:?}");
            covered
                .filter(|&x| !is_attenuated(x))
                .for_each(|x| first_block[x] = first_block[x].or(Some(block as u16)));
        }
        let by_chunk: Vec<Mask> = (0..CHUNKS).map(|chunk| occluded.chunk(chunk)).collect();
        assert_eq!(by_chunk, [Mask::MAX, !(1 << 4), Mask::MAX, Mask::MAX, 0]);
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
