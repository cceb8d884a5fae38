//! From the bytes of a block to a packed one.
//!
//! Bytes at even places hold the last digits of numbers, which hardly repeat, and those at odd places the first ones, which do. Each half is
//! deflated by itself, with its own effort and its own codes, and the second stream follows the first where a byte begins: to a reader they
//! are one.

use super::halves::{Halves, split};
use super::predictor::differentiate;
use flate2::{Compress, Compression, FlushCompress};
use simd_adler32::adler32;

/// Effort of deflate for the bytes at even places, and for those at odd ones: with zlib-rs files of rendered objects become as large as those of
/// the EXR library's level 4, in half its time; what has no noise becomes up to a tenth larger.
const LEVELS: [u32; 2] = [2, 3];

/// What a zlib stream begins with: deflate with a window of 32 KiB, little effort (RFC 1950, 2.2).
const ZLIB_HEADER: [u8; 2] = [0x78, 0x5e];

/// Packs blocks, in memory that it keeps. A block has the same bytes whatever was packed before it.
#[derive(Debug)]
pub(crate) struct Packer {
    /// For each half.
    deflate: [Compress; 2],
    /// The block's bytes, even places before odd ones.
    shuffled: Vec<u8>,
    /// Number of bytes that are in `shuffled`.
    filled: usize,
    differences: Vec<u8>,
}

impl Default for Packer {
    fn default() -> Self {
        let deflate = LEVELS.map(|level| Compress::new(Compression::new(level), false));
        Self { deflate, shuffled: Vec::new(), filled: 0, differences: Vec::new() }
    }
}

impl Packer {
    /// Begins a block of `size` bytes.
    pub(crate) fn begin(&mut self, size: usize) {
        self.shuffled.resize(size, 0);
        self.differences.resize(size, 0);
        self.filled = 0;
    }

    /// The next bytes of the block.
    ///
    /// # Panics
    /// If they are more than its size.
    pub(crate) fn put(&mut self, bytes: &[u8]) {
        split(bytes, self.filled, &mut self.shuffled);
        self.filled += bytes.len();
    }

    /// Appends the packed block to `packed`: as it is, if packing does not make it smaller.
    pub(crate) fn append_to(&mut self, packed: &mut Vec<u8>) {
        let (start, size) = (packed.len(), self.shuffled.len());
        differentiate(&self.shuffled, &mut self.differences);
        packed.reserve(size);
        packed.extend_from_slice(&ZLIB_HEADER);
        let (even, odd) = self.differences.split_at(size.div_ceil(2));
        let halves = [(even, FlushCompress::Sync), (odd, FlushCompress::Finish)];
        let is_whole = self.deflate.iter_mut().zip(halves).all(|(deflate, (half, flush))| {
            deflate.reset();
            // What finds no room is not smaller than the block.
            deflate.compress_vec(half, packed, flush).is_ok()
        });
        packed.extend_from_slice(&adler32(&self.differences.as_slice()).to_be_bytes());
        if !is_whole || packed.len() - start >= size {
            packed.resize(start + size, 0);
            Halves::of(&self.shuffled).join(&mut packed[start..]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Damage, unpack};
    use super::*;

    /// `bytes` as a block, put in parts of `step` bytes.
    fn packed(packer: &mut Packer, bytes: &[u8], step: usize) -> Vec<u8> {
        let mut packed = vec![9];
        packer.begin(bytes.len());
        bytes.chunks(step).for_each(|part| packer.put(part));
        packer.append_to(&mut packed);
        assert_eq!(packed.remove(0), 9, "what was there stays");
        packed
    }

    fn unpacked(packed: &[u8], size: usize) -> Result<Vec<u8>, Damage> {
        let shuffled = unpack(packed, size)?;
        let mut bytes = vec![0; size];
        shuffled.halves().join(&mut bytes);
        Ok(bytes)
    }

    #[test]
    fn what_is_packed_is_unpacked_and_does_not_depend_on_what_came_before() {
        let mut packer = Packer::default();
        for size in [100_000, 64, 4097, 99_999] {
            let bytes: Vec<u8> = (0..size).map(|i| (i / 7) as u8).collect();
            let block = packed(&mut packer, &bytes, 1000);
            assert!(block.len() < size, "{size} bytes");
            assert_eq!(block, packed(&mut Packer::default(), &bytes, 33), "{size} bytes");
            assert_eq!(unpacked(&block, size).unwrap(), bytes);
        }
    }

    #[test]
    fn what_does_not_become_smaller_is_stored_as_it_is() {
        let mut random = fastrand::Rng::with_seed(5);
        let noise: Vec<u8> = (0..5001).map(|_| random.u8(..)).collect();
        for bytes in [&noise[..], &noise[..2], &noise[..1], &[]] {
            assert_eq!(packed(&mut Packer::default(), bytes, 100), bytes);
        }
    }

    #[test]
    fn halves_of_any_kind_are_one_stream_to_a_reader() {
        let mut random = fastrand::Rng::with_seed(7);
        let mut packer = Packer::default();
        // How many of the bytes at even places, and of those at odd ones, are noise: the block that is as large packed lies between.
        for noise in
            (0..=2000).step_by(100).flat_map(|even| [[even, 0], [0, even], [even, 2000 - even], [even; 2]])
        {
            let byte = |i: usize| if i / 2 < noise[i % 2] { random.u8(..) } else { (i / 400) as u8 };
            let bytes: Vec<u8> = (0..4000).map(byte).collect();
            let block = packed(&mut packer, &bytes, 4000);
            assert!(block.len() <= bytes.len(), "{noise:?}: {} bytes", block.len());
            if block.len() < bytes.len() {
                assert_eq!(unpacked(&block, bytes.len()).unwrap(), bytes, "{noise:?}");
            } else {
                assert_eq!(block, bytes, "{noise:?}");
            }
        }
    }

    #[test]
    fn damage_is_found() {
        let bytes = vec![7; 3000];
        let block = packed(&mut Packer::default(), &bytes, 3000);
        let damage = |block: &[u8], size: usize| unpacked(block, size).unwrap_err();
        assert_eq!(damage(&block, usize::MAX), Damage::TooShort, "nothing is allocated");
        assert!(unpacked(&block, 2999).is_err(), "more bytes");
        assert_eq!(damage(&block, 3001), Damage::WrongSize, "fewer");
        assert_eq!(damage(&[], 1), Damage::Malformed);
        let mut wrong_checksum = block.clone();
        *wrong_checksum.last_mut().unwrap() ^= 1;
        assert_eq!(damage(&wrong_checksum, 3000), Damage::Malformed);
        for end in 0..block.len() {
            assert!(unpacked(&block[..end], 3000).is_err(), "{end} bytes of {}", block.len());
        }
        assert_eq!(unpacked(&[&block[..], &[1, 2, 3]].concat(), 3000).unwrap(), bytes, "bytes follow it");
    }
}
