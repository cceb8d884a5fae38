//! Decompression of the blocks of a deep part: none, RLE, and ZIPS and ZIP, which [`crate::zip_blocks`] unpacks.
//!
//! Before memory is allocated, the size is checked against what the codec can make of the bytes that are there.

use crate::error::Error;
use crate::zip_blocks::{Damage, Shuffled, unpack};
use exr::meta::attribute::Compression;

/// RLE expands 2 bytes to at most 128.
const RLE_RATIO: usize = 64;

/// How the bytes of a block are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Packing {
    /// As they are.
    None,
    /// Runs of equal bytes.
    Rle,
    /// Deflate, in the format of zlib.
    Zip,
}

impl Packing {
    /// The packing of a codec that deep parts may have.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Unsupported`] for any other codec.
    pub(super) fn of(compression: Compression) -> Result<Self, Error> {
        match compression {
            Compression::Uncompressed => Ok(Self::None),
            Compression::RLE => Ok(Self::Rle),
            Compression::ZIP1 | Compression::ZIP16 => Ok(Self::Zip),
            other => Err(Error::unsupported("deep samples are not compressed this way")
                .with("found", format!("{other:?}"))
                .with("expected", "none, RLE, ZIPS, ZIP")
                .help("save the deep file again with ZIPS compression")),
        }
    }

    /// The `size` bytes that were packed into `packed`. What packing did not make smaller is stored as it is.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Input`] for bytes that are not `size` bytes, packed.
    pub(super) fn unpack(self, packed: &[u8], size: usize) -> Result<Vec<u8>, Error> {
        if packed.len() == size {
            return Ok(packed.to_vec());
        }
        let shuffled = match self {
            Self::None if size > packed.len() => Err(Damage::TooShort),
            Self::None => Err(Damage::WrongSize),
            Self::Rle => expand_runs(packed, size).map(Shuffled::from_differences),
            Self::Zip => unpack(packed, size),
        };
        let shuffled = shuffled.map_err(|damage| match damage {
            Damage::TooShort => damaged("a block of samples is smaller than its size allows"),
            Damage::Malformed | Damage::WrongSize => damaged("a block of samples cannot be decompressed"),
        })?;
        let mut bytes = vec![0; size];
        shuffled.halves().join(&mut bytes);
        Ok(bytes)
    }
}

/// An error about damaged samples.
pub(super) fn damaged(what: &str) -> Error {
    Error::input(what).help("the file is damaged or truncated: render or copy it again")
}

/// Exactly `size` bytes of runs: a count from 0 on, and a byte to be repeated once more than that; or a count below 0, and as many bytes.
fn expand_runs(packed: &[u8], size: usize) -> Result<Vec<u8>, Damage> {
    if size / RLE_RATIO > packed.len() {
        return Err(Damage::TooShort);
    }
    let mut bytes = Vec::with_capacity(size);
    let mut rest = packed;
    while let [count, tail @ ..] = rest {
        let count = count.cast_signed();
        let length = usize::from(count.unsigned_abs());
        let of_run = if count < 0 { length } else { 1 };
        let (run, tail) = tail.split_at_checked(of_run).ok_or(Damage::Malformed)?;
        match run {
            [byte] if count >= 0 => bytes.resize(bytes.len() + length + 1, *byte),
            _ => bytes.extend_from_slice(run),
        }
        if bytes.len() > size {
            return Err(Damage::Malformed);
        }
        rest = tail;
    }
    if bytes.len() == size { Ok(bytes) } else { Err(Damage::WrongSize) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write as _;

    /// `bytes` as OpenEXR shuffles them before packing.
    fn shuffled(bytes: &[u8]) -> Vec<u8> {
        let even = bytes.iter().step_by(2);
        let all: Vec<u8> = even.chain(bytes.iter().skip(1).step_by(2)).copied().collect();
        let differences = all.windows(2).map(|pair| pair[1].wrapping_sub(pair[0]).wrapping_add(128));
        all.iter().take(1).copied().chain(differences).collect()
    }

    #[test]
    fn zip_and_runs_give_back_the_bytes_that_were_packed() {
        let bytes: Vec<u8> = (0..=255).chain([7; 300]).chain([3]).collect();
        let mut zip = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::new(6));
        zip.write_all(&shuffled(&bytes)).unwrap();
        assert_eq!(Packing::Zip.unpack(&zip.finish().unwrap(), bytes.len()).unwrap(), bytes);
        // Every byte as a run of one, and as copies of at most 127.
        let runs: Vec<u8> = shuffled(&bytes).iter().flat_map(|&byte| [0, byte]).collect();
        assert_eq!(Packing::Rle.unpack(&runs, bytes.len()).unwrap(), bytes);
        let copies = shuffled(&bytes);
        let copies = copies.chunks(127).flat_map(|part| {
            let count = (-(part.len() as i8)).cast_unsigned();
            [vec![count], part.to_vec()].concat()
        });
        assert_eq!(Packing::Rle.unpack(&copies.collect::<Vec<u8>>(), bytes.len()).unwrap(), bytes);
    }

    #[test]
    fn bytes_that_did_not_shrink_are_stored_as_they_are() {
        for packing in [Packing::None, Packing::Rle, Packing::Zip] {
            assert_eq!(packing.unpack(&[5, 6, 7], 3).unwrap(), [5, 6, 7], "{packing:?}");
            assert!(packing.unpack(&[], 0).unwrap().is_empty());
        }
    }

    #[test]
    fn a_size_that_the_bytes_cannot_have_is_refused_before_it_is_allocated() {
        for packing in [Packing::None, Packing::Rle, Packing::Zip] {
            assert!(packing.unpack(&[1; 8], usize::MAX).is_err(), "{packing:?}");
            assert!(packing.unpack(&[1; 8], 9).is_err(), "{packing:?}: one byte more");
        }
        assert!(Packing::Rle.unpack(&[127, 1], 100).is_err(), "a run of 128 into 100");
        assert!(Packing::Rle.unpack(&[0x80], 200).is_err(), "a copy without bytes");
    }
}
