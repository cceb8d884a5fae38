//! What a TIFF says of its alpha: the tag `ExtraSamples`, which the decoder does not show.

use crate::settings::AlphaMode;
use std::io::{self, Read, Seek, SeekFrom};

/// Tag of `ExtraSamples`.
const EXTRA_SAMPLES: u64 = 338;
/// Its value where colour is multiplied by alpha.
const ASSOCIATED: u64 = 1;
/// Its value where colour is not.
const UNASSOCIATED: u64 = 2;
/// Entries of the directory that are searched: files have some twenty.
const MOST_ENTRIES: u64 = 4096;

/// The byte order of a TIFF.
#[derive(Debug, Clone, Copy)]
struct Order {
    is_little: bool,
}

/// How the first picture of the TIFF in `input` combines colour and alpha; `None` where it does not say, or is no TIFF. Leaves `input` at
/// its first byte.
///
/// # Errors
/// The input cannot be read.
pub(super) fn alpha_mode(input: &mut (impl Read + Seek)) -> io::Result<Option<AlphaMode>> {
    let found = extra_sample(input);
    input.rewind()?;
    Ok(match found {
        Ok(Some(ASSOCIATED)) => Some(AlphaMode::Premultiplied),
        Ok(Some(UNASSOCIATED)) => Some(AlphaMode::Straight),
        // A damaged directory is the decoder's to name.
        _ => None,
    })
}

/// The first value of the tag in the first directory.
fn extra_sample(input: &mut (impl Read + Seek)) -> io::Result<Option<u64>> {
    let mut head = [0; 4];
    input.read_exact(&mut head)?;
    let (is_little, is_big_tiff) = match head {
        [b'I', b'I', 42, 0] => (true, false),
        [b'M', b'M', 0, 42] => (false, false),
        [b'I', b'I', 43, 0] => (true, true),
        [b'M', b'M', 0, 43] => (false, true),
        _ => return Ok(None),
    };
    let order = Order { is_little };
    if is_big_tiff {
        order.number(input, 4)?;
    }
    let wide = if is_big_tiff { 8 } else { 4 };
    let directory = order.number(input, wide)?;
    input.seek(SeekFrom::Start(directory))?;
    let entries = order.number(input, if is_big_tiff { 8 } else { 2 })?;
    for _ in 0..entries.min(MOST_ENTRIES) {
        let (tag, _type) = (order.number(input, 2)?, order.number(input, 2)?);
        let count = order.number(input, wide)?;
        if tag != EXTRA_SAMPLES {
            order.number(input, wide)?;
            continue;
        }
        // Sixteen-bit numbers, which lie in the entry itself if they fit.
        if count * 2 > wide as u64 {
            let at = order.number(input, wide)?;
            input.seek(SeekFrom::Start(at))?;
        }
        return order.number(input, 2).map(Some);
    }
    Ok(None)
}

impl Order {
    /// A number of `bytes` bytes, at most eight.
    fn number(self, input: &mut impl Read, bytes: usize) -> io::Result<u64> {
        let mut read = [0; 8];
        input.read_exact(&mut read[..bytes])?;
        let read = &read[..bytes];
        let joined = |number: u64, byte: &u8| number << 8 | u64::from(*byte);
        Ok(if self.is_little { read.iter().rev().fold(0, joined) } else { read.iter().fold(0, joined) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    /// A directory of two entries, the second of them `ExtraSamples` with `value`.
    fn tiff(is_little: bool, value: u16) -> Cursor<Vec<u8>> {
        let short = |number: u16| if is_little { number.to_le_bytes() } else { number.to_be_bytes() };
        let long = |number: u32| if is_little { number.to_le_bytes() } else { number.to_be_bytes() };
        let mut bytes = if is_little { b"II".to_vec() } else { b"MM".to_vec() };
        bytes.extend(short(42));
        bytes.extend(long(8));
        bytes.extend(short(2));
        for (tag, value) in [(256, 64), (338, value)] {
            bytes.extend([short(tag), short(3)].concat());
            bytes.extend(long(1));
            bytes.extend([short(value), short(0)].concat());
        }
        bytes.extend(long(0));
        Cursor::new(bytes)
    }

    #[test]
    fn the_tag_says_whether_colour_is_multiplied_by_alpha() {
        for is_little in [true, false] {
            let mode = |value| alpha_mode(&mut tiff(is_little, value)).unwrap();
            assert_eq!(mode(1), Some(AlphaMode::Premultiplied));
            assert_eq!(mode(2), Some(AlphaMode::Straight));
            assert_eq!(mode(0), None, "unspecified data");
        }
    }

    #[test]
    fn a_file_that_ends_early_or_is_no_tiff_says_nothing_and_is_rewound() {
        let mut short = Cursor::new(tiff(true, 1).into_inner()[..20].to_vec());
        assert_eq!(alpha_mode(&mut short).unwrap(), None);
        assert_eq!(short.position(), 0);
        assert_eq!(alpha_mode(&mut Cursor::new(b"\x89PNG....".to_vec())).unwrap(), None);
    }
}
