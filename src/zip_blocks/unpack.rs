//! From a packed block to its bytes.

use super::halves::Halves;
use super::predictor::integrate;
use zune_inflate::{DeflateDecoder, DeflateOptions};

/// Deflate expands by at most 1032.
const DEFLATE_RATIO: usize = 1032;

/// What is wrong with a packed block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Damage {
    /// It has fewer bytes than are needed for its size.
    TooShort,
    /// It is no zlib data, ends early, or has a wrong checksum.
    Malformed,
    /// It unpacks to another number of bytes.
    WrongSize,
}

/// The bytes of a block, those at even places before those at odd ones.
#[derive(Debug)]
pub(crate) struct Shuffled(Vec<u8>);

impl Shuffled {
    /// The bytes that differ by `differences`.
    pub(crate) fn from_differences(mut differences: Vec<u8>) -> Self {
        integrate(&mut differences);
        Self(differences)
    }

    /// The bytes.
    pub(crate) fn halves(&self) -> Halves<'_> {
        Halves::of(&self.0)
    }
}

/// The `size` bytes that were packed into `packed`. Bytes after the end of the zlib data are not looked at.
///
/// # Errors
/// `packed` is not `size` bytes, packed. No more memory is allocated than deflate can make of it.
pub(crate) fn unpack(packed: &[u8], size: usize) -> Result<Shuffled, Damage> {
    if size / DEFLATE_RATIO > packed.len() {
        return Err(Damage::TooShort);
    }
    let options = DeflateOptions::default().set_limit(size).set_size_hint(size);
    let differences = DeflateDecoder::new_with_options(packed, options).decode_zlib();
    let differences = differences.map_err(|_| Damage::Malformed)?;
    if differences.len() != size {
        return Err(Damage::WrongSize);
    }
    Ok(Shuffled::from_differences(differences))
}
