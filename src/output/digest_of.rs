//! The digest in the header of a picture that was written before.

use crate::stack;
use std::fs::File;
use std::io::{BufReader, Read as _, Seek as _, SeekFrom};
use std::path::Path;

/// The attribute of an EXR and the text chunk of a PNG that hold the digest.
pub(super) const DIGEST: &str = "thinlens.digest";

/// The first bytes of a PNG.
const PNG_MAGIC: [u8; 8] = *b"\x89PNG\r\n\x1a\n";

/// The last chunk of a PNG: no content, its name, its check sum.
const PNG_END: [u8; 12] = *b"\0\0\0\0IEND\xae\x42\x60\x82";

/// The digest in the header of the picture at `path`; `None` without one, for a file that is not complete, and where no EXR or PNG can
/// be read.
///
/// Pixels are not read: the cost is that of the header.
pub fn digest_of(path: &Path) -> Option<String> {
    if is_png(path)? { png_digest(path) } else { stack::header_text(path, DIGEST) }
}

fn is_png(path: &Path) -> Option<bool> {
    let mut head = [0; PNG_MAGIC.len()];
    File::open(path).ok()?.read_exact(&mut head).ok()?;
    Some(head == PNG_MAGIC)
}

/// The text in the chunk before the pixels of a PNG that has its last chunk.
fn png_digest(path: &Path) -> Option<String> {
    let mut file = BufReader::new(File::open(path).ok()?);
    let mut end = [0; PNG_END.len()];
    file.seek(SeekFrom::End(-(PNG_END.len() as i64))).ok()?;
    file.read_exact(&mut end).ok()?;
    file.rewind().ok()?;
    if end != PNG_END {
        return None;
    }
    let reader = png::Decoder::new(file).read_info().ok()?;
    let texts = &reader.info().uncompressed_latin1_text;
    texts.iter().find(|chunk| chunk.keyword == DIGEST).map(|chunk| chunk.text.clone())
}
