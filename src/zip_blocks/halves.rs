//! Bytes at even places, and those at odd ones.

use std::ops::Range;

/// Places that are compared with zero at a time: enough for vectors, few enough to end early.
const GROUP: usize = 64;

/// Bytes of which those at even places are apart from those at odd ones.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Halves<'a> {
    even: &'a [u8],
    odd: &'a [u8],
}

impl<'a> Halves<'a> {
    /// The halves of as many bytes as `shuffled` has, the even places first.
    pub(super) fn of(shuffled: &'a [u8]) -> Self {
        let (even, odd) = shuffled.split_at(shuffled.len().div_ceil(2));
        Self { even, odd }
    }

    /// The bytes at the places `range`.
    ///
    /// # Panics
    /// If there are no such places.
    pub(crate) fn part(self, range: Range<usize>) -> Self {
        let (even, odd) = (range.start.div_ceil(2)..range.end.div_ceil(2), range.start / 2..range.end / 2);
        let (even, odd) = (&self.even[even], &self.odd[odd]);
        if range.start.is_multiple_of(2) { Self { even, odd } } else { Self { even: odd, odd: even } }
    }

    /// Writes the bytes to `bytes`, which has their number.
    pub(crate) fn join(self, bytes: &mut [u8]) {
        let (pairs, rest) = bytes.as_chunks_mut();
        for (pair, (even, odd)) in pairs.iter_mut().zip(self.even.iter().zip(self.odd)) {
            *pair = [*even, *odd];
        }
        rest.iter_mut().zip(self.even.last()).for_each(|(byte, last)| *byte = *last);
    }

    /// Whether every byte is 0.
    pub(crate) fn is_zero(self) -> bool {
        are_zero(self.even) && are_zero(self.odd)
    }
}

/// Whether each of `bytes` is 0. Ends soon where they are not.
pub(crate) fn are_zero(bytes: &[u8]) -> bool {
    bytes.chunks(GROUP).all(|group| group.iter().fold(0, |any, byte| any | byte) == 0)
}

/// Writes `bytes`, which begin at place `start`, to their places in `shuffled`, the halves of all bytes.
pub(super) fn split(bytes: &[u8], start: usize, shuffled: &mut [u8]) {
    let (even, odd) = shuffled.split_at_mut(shuffled.len().div_ceil(2));
    let (even, odd) = (&mut even[start.div_ceil(2)..], &mut odd[start / 2..]);
    let (first, second) = if start.is_multiple_of(2) { (even, odd) } else { (odd, even) };
    let (pairs, rest) = bytes.as_chunks::<2>();
    for (pair, (first, second)) in pairs.iter().zip(first.iter_mut().zip(second)) {
        [*first, *second] = *pair;
    }
    rest.iter().zip(&mut first[pairs.len()..]).for_each(|(byte, last)| *last = *byte);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_split_anywhere_is_joined_again_anywhere() {
        for size in [0, 1, 2, 3, 8, 37] {
            let bytes: Vec<u8> = (1..=size as u8).collect();
            let mut shuffled = vec![0; size];
            for cut in 0..=size {
                shuffled.fill(0);
                split(&bytes[..cut], 0, &mut shuffled);
                split(&bytes[cut..], cut, &mut shuffled);
                let even = bytes.iter().step_by(2);
                let expected: Vec<u8> = even.chain(bytes.iter().skip(1).step_by(2)).copied().collect();
                assert_eq!(shuffled, expected, "{size} bytes cut at {cut}");
                for end in cut..=size {
                    let mut part = vec![0; end - cut];
                    Halves::of(&shuffled).part(cut..end).join(&mut part);
                    assert_eq!(part, bytes[cut..end], "{cut} to {end} of {size}");
                }
            }
        }
    }

    #[test]
    fn one_byte_anywhere_is_not_zero() {
        for place in 0..200 {
            let mut shuffled = [0; 200];
            shuffled[place] = 1;
            assert!(!Halves::of(&shuffled).is_zero(), "{place}");
        }
        assert!(Halves::of(&[0; 200]).is_zero() && Halves::of(&[]).is_zero());
    }
}
