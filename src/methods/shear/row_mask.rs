//! One bit for each pixel of a row.

use super::lanes::{LANES, Mask};
use std::ops::Range;

/// Pixels of a word.
const WORD: usize = u64::BITS as usize;

/// Chunks of a word.
pub(super) const CHUNKS_OF_WORD: usize = WORD / LANES;

/// One bit for each pixel of a row, and for those past its end that complete its last word.
#[derive(Debug, Clone)]
pub(super) struct RowMask {
    words: Vec<u64>,
}

impl RowMask {
    /// No bit, for a row of `width` pixels.
    pub(super) fn none(width: usize) -> Self {
        Self { words: vec![0; width.div_ceil(WORD)] }
    }

    /// The pixels past the end of a row of `width` pixels.
    pub(super) fn past_end(width: usize) -> Self {
        let mut mask = Self::none(width);
        mask.mark(&(width..mask.words.len() * WORD));
        mask
    }

    /// Sets the bits of `columns`.
    pub(super) fn mark(&mut self, columns: &Range<usize>) {
        if !columns.is_empty() {
            words_of(columns).for_each(|(word, covered)| self.words[word] |= covered);
        }
    }

    /// Sets the bit of each pixel for which `holds(x)`, and removes that of others.
    pub(super) fn set_where(&mut self, holds: impl Fn(usize) -> bool) {
        for (word, first) in self.words.iter_mut().zip((0..).step_by(WORD)) {
            *word = (0..WORD).fold(0, |bits, i| bits | u64::from(holds(first + i)) << i);
        }
    }

    /// Removes all bits.
    pub(super) fn clear(&mut self) {
        self.words.fill(0);
    }

    /// Sets the bits of `other`, of a row of the same width, and no others.
    pub(super) fn copy_from(&mut self, other: &Self) {
        self.words.copy_from_slice(&other.words);
    }

    /// Number of pixels without a bit.
    #[inline(always)]
    pub(super) fn count_without(&self) -> usize {
        self.words.iter().map(|word| word.count_zeros() as usize).sum()
    }

    /// The bits of chunk `chunk`.
    #[inline(always)]
    pub(super) fn chunk(&self, chunk: usize) -> Mask {
        (self.words[chunk / CHUNKS_OF_WORD] >> (chunk % CHUNKS_OF_WORD * LANES)) as Mask
    }

    /// Sets the bits `lanes` of chunk `chunk`.
    #[inline(always)]
    pub(super) fn add(&mut self, chunk: usize, lanes: Mask) {
        self.words[chunk / CHUNKS_OF_WORD] |= u64::from(lanes) << (chunk % CHUNKS_OF_WORD * LANES);
    }

    /// Word `word`, the bits of [`CHUNKS_OF_WORD`] chunks.
    #[inline(always)]
    pub(super) fn word(&self, word: usize) -> u64 {
        self.words[word]
    }

    /// Word `word`, to change.
    #[inline(always)]
    pub(super) fn word_mut(&mut self, word: usize) -> &mut u64 {
        &mut self.words[word]
    }
}

/// The words that have any of `columns`, which are not empty, and which bits of each.
#[inline(always)]
pub(super) fn words_of(columns: &Range<usize>) -> impl Iterator<Item = (usize, u64)> + use<> {
    let (first, last) = (columns.start / WORD, (columns.end - 1) / WORD);
    let (from, to) = (u64::MAX << (columns.start % WORD), u64::MAX >> (WORD - 1 - (columns.end - 1) % WORD));
    (first..=last).map(move |word| {
        let (from, to) =
            (if word == first { from } else { u64::MAX }, if word == last { to } else { u64::MAX });
        (word, from & to)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_those_of_the_columns_however_they_are_looked_up() {
        for width in [1, 16, 63, 64, 65, 130] {
            let past_end = RowMask::past_end(width);
            assert_eq!(past_end.count_without(), width);
            for start in 0..width {
                for end in start..=width {
                    let (mut marked, mut set, mut by_chunk) =
                        (RowMask::none(width), past_end.clone(), RowMask::none(width));
                    marked.mark(&(start..end));
                    set.set_where(|x| (start..end).contains(&x));
                    (start..end).for_each(|x| by_chunk.add(x / LANES, 1 << (x % LANES)));
                    assert_eq!(marked.words, set.words, "{start}..{end} of {width}");
                    assert_eq!(marked.words, by_chunk.words, "{start}..{end} of {width}");
                    let is_set = |x: usize| marked.chunk(x / LANES) >> (x % LANES) & 1 == 1;
                    assert!((0..width).all(|x| is_set(x) == (start..end).contains(&x)));
                }
            }
        }
    }
}
