//! EXR: the picture as `R G B A` at the root, with channels and attributes copied from the input.
//!
//! The EXR library compresses single blocks and encodes attributes. The file itself is written here, so that
//! blocks are compressed in the caller's thread pool (the library creates a pool at every call) and equal
//! pictures give equal files. Cost: the compression. Memory: one band of blocks.

mod channels;
mod codec;
mod header;

pub use codec::Codec;

use super::atomic::{self, Target};
use crate::error::Error;
use crate::finding::Finding;
use crate::image::Image;
use crate::stack::{Carried, Frame, Precision};
use channels::Channel;
use exr::block::chunk::Chunk;
use exr::block::{BlockIndex, UncompressedBlock};
use exr::math::Vec2;
use exr::meta::header::Header;
use rayon::prelude::*;
use std::io::SeekFrom;
use std::path::Path;

/// Blocks per thread that are compressed before they are written: enough to balance the load within a band.
const BLOCKS_PER_THREAD: usize = 8;

/// Storage options of an EXR.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct ExrOptions {
    /// Numeric type of `R G B A`; carried channels keep their own.
    pub precision: Precision,
    /// Compression of all channels.
    pub codec: Codec,
}

impl ExrOptions {
    /// Options for `precision`, with the default compression.
    pub fn new(precision: Precision) -> Self {
        Self { precision, codec: Codec::default() }
    }
}

/// Writes `image` with its `frame` and the data `carried` from the input to the file `path` (`-`: standard output).
///
/// `image` has the size of `frame.data`. Half values beyond ±65504 are clamped. Returns findings about data that cannot be copied:
/// channels called `R`, `G`, `B` or `A` at the root (names of the picture's channels), channels of another size, and names or
/// values that the format does not allow.
///
/// # Errors
/// [`crate::error::ErrorKind::Settings`] for a picture of another size than its frame, [`crate::error::ErrorKind::Unsupported`] for a
/// frame that EXR cannot express, and the errors of [`atomic::write()`].
pub fn write(
    path: &Path,
    image: &Image,
    frame: &Frame,
    carried: &Carried,
    options: &ExrOptions,
) -> Result<Vec<Finding>, Error> {
    let (width, height) = (frame.data.width, frame.data.height);
    if image.planes.iter().any(|plane| (plane.width(), plane.height()) != (width, height)) {
        return Err(Error::settings("the picture and its data window differ in size")
            .in_file(path)
            .with("picture", format!("{}×{}", image.width(), image.height()))
            .with("data window", format!("{width}×{height}")));
    }
    let mut findings = Vec::new();
    let channels = channels::collect(image, frame, carried, options.precision, &mut findings);
    let header = header::describe(frame, &channels, options.codec.compression());
    let attributes = header::attributes(&header, carried, &mut findings);
    header.validate(false, &mut false, true).map_err(|error| encoding_error(path, error))?;
    atomic::write(path, |target| {
        header::write(target, &attributes)
            .and_then(|()| write_blocks(target, &header, &channels))
            .map_err(|error| encoding_error(path, error))
    })?;
    Ok(findings)
}

/// Writes the table of offsets and the blocks, top to bottom.
fn write_blocks(
    mut target: &mut dyn Target,
    header: &Header,
    channels: &[Channel<'_>],
) -> exr::error::UnitResult {
    let table = target.stream_position()?;
    let mut offsets = Vec::with_capacity(header.chunk_count);
    target.write_all(&vec![0; header.chunk_count * size_of::<u64>()])?;
    let band = BLOCKS_PER_THREAD * rayon::current_num_threads();
    for first in (0..header.chunk_count).step_by(band) {
        let last = header.chunk_count.min(first + band);
        let chunks: Vec<_> =
            (first..last).into_par_iter().map(|block| compress(block, header, channels)).collect();
        for chunk in chunks {
            offsets.push(target.stream_position()?);
            chunk?.write(&mut target, 1)?;
        }
    }
    target.seek(SeekFrom::Start(table))?;
    for offset in offsets {
        target.write_all(&offset.to_le_bytes())?;
    }
    target.seek(SeekFrom::End(0))?;
    Ok(())
}

/// The compressed block number `block`, counted from the top.
fn compress(block: usize, header: &Header, channels: &[Channel<'_>]) -> exr::error::Result<Chunk> {
    let Vec2(width, height) = header.layer_size;
    let lines = header.compression.scan_lines_per_block();
    let top = block * lines;
    let rows = top..height.min(top + lines);
    let mut data = Vec::with_capacity(rows.len() * width * header.channels.bytes_per_pixel);
    for y in rows.clone() {
        for channel in channels {
            channel.append_row(y, width, &mut data);
        }
    }
    let index = BlockIndex {
        layer: 0,
        pixel_position: Vec2(0, top),
        pixel_size: Vec2(width, rows.len()),
        level: Vec2(0, 0),
    };
    UncompressedBlock { index, data }.compress_to_chunk(std::slice::from_ref(header))
}

fn encoding_error(path: &Path, error: exr::error::Error) -> Error {
    match error {
        exr::error::Error::Io(error) => atomic::failed(path, error),
        other => Error::unsupported("the picture cannot be written as EXR").in_file(path).caused_by(other),
    }
}
