//! The compressed blocks of an OpenEXR file, in file order.
//!
//! The EXR library's reader is not used: it allocates the size that a block claims before it checks the file's length.

use super::header::decoder_error;
use super::input::Input;
use crate::error::Error;
use exr::block::chunk::{
    Chunk, CompressedBlock, CompressedScanLineBlock, CompressedTileBlock, TileCoordinates,
};
use exr::math::Vec2;
use exr::meta::header::Header;
use exr::meta::{BlockDescription, MetaData};
use std::io::{self, Read, Seek};
use std::mem;

/// Number of counters at the start of a DWA block, eight bytes each.
const DWA_COUNTERS: usize = 11;

/// The positions of the blocks, and the input.
#[derive(Debug)]
pub(super) struct Chunks {
    input: Input,
    /// Length of the input in bytes.
    len: u64,
    /// Current position in the input.
    position: u64,
    /// Offsets of the blocks, in file order.
    offsets: std::vec::IntoIter<u64>,
}

/// Which block it is, as its head says. [`super::decode`] checks it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Head {
    /// Index of its part.
    pub(super) part: usize,
    /// Where in the part it is.
    pub(super) place: Place,
}

/// Where a block is.
#[derive(Debug, Clone, Copy)]
pub(super) enum Place {
    /// The `y` of its first row.
    Row(i32),
    /// A tile.
    Tile(TileCoordinates),
}

impl Head {
    /// The block for the EXR library, with the bytes `content`, of which it leaves none.
    pub(super) fn take(self, content: &mut Vec<u8>) -> Chunk {
        let compressed_pixels_le = mem::take(content);
        let compressed_block = match self.place {
            Place::Row(y_coordinate) => {
                CompressedBlock::ScanLine(CompressedScanLineBlock { y_coordinate, compressed_pixels_le })
            }
            Place::Tile(coordinates) => {
                CompressedBlock::Tile(CompressedTileBlock { coordinates, compressed_pixels_le })
            }
        };
        Chunk { layer_index: self.part, compressed_block }
    }
}

impl Chunks {
    /// The blocks of the largest resolution level for which `requested` returns true: of this part, in this row of blocks. `input` is
    /// positioned after the header.
    ///
    /// # Errors
    /// The table of block offsets is truncated.
    pub(super) fn new(
        mut input: Input,
        len: u64,
        meta_data: &MetaData,
        requested: impl Fn(usize, usize) -> bool,
    ) -> Result<Self, Error> {
        let mut offsets = Vec::new();
        let mut position = input.stream_position().map_err(cut_short)?;
        for (part, header) in meta_data.headers.iter().enumerate() {
            let table_bytes = (header.chunk_count as u64).saturating_mul(8);
            if table_bytes > len.saturating_sub(position) {
                return Err(cut_short(io::ErrorKind::UnexpectedEof.into()));
            }
            position += table_bytes;
            let mut table = vec![0; header.chunk_count * 8];
            input.read_exact(&mut table).map_err(cut_short)?;
            let table = table.as_chunks().0.iter().map(|bytes| u64::from_le_bytes(*bytes));
            let blocks = header.blocks_increasing_y_order();
            let of_rows = table.zip(blocks).filter(|(_, tile)| {
                tile.location.is_largest_resolution_level() && requested(part, tile.location.tile_index.y())
            });
            offsets.extend(of_rows.map(|(offset, _)| offset));
        }
        offsets.sort_unstable();
        Ok(Self { input, len, position, offsets: offsets.into_iter() })
    }

    /// The next block, whose bytes replace those of `content`; `None` after the last.
    ///
    /// # Errors
    /// The block is outside the file, or belongs to no part.
    pub(super) fn next(
        &mut self,
        meta_data: &MetaData,
        content: &mut Vec<u8>,
    ) -> Option<Result<Head, Error>> {
        let offset = self.offsets.next()?;
        Some(self.read_at(offset, meta_data, content))
    }

    fn read_at(&mut self, offset: u64, meta_data: &MetaData, content: &mut Vec<u8>) -> Result<Head, Error> {
        if offset == 0 {
            return Err(Error::input("some blocks of pixels were not written")
                .help("the render was stopped or is still running: render it again"));
        }
        if offset >= self.len {
            return Err(cut_short(io::ErrorKind::UnexpectedEof.into()));
        }
        // Both are positions within a file, so they fit into 64 bits. A short distance stays within the buffer.
        self.input.seek_relative(offset as i64 - self.position as i64).map_err(cut_short)?;
        self.position = offset;
        let part = if meta_data.requirements.is_multilayer() { self.read_i32()? } else { 0 };
        let part = usize::try_from(part).ok().filter(|&part| part < meta_data.headers.len());
        let part = part.ok_or_else(|| damaged("it belongs to no part"))?;
        let place = match meta_data.headers[part].blocks {
            BlockDescription::ScanLines => Place::Row(self.read_i32()?),
            BlockDescription::Tiles(_) => {
                let words = [self.read_i32()?, self.read_i32()?, self.read_i32()?, self.read_i32()?];
                let [x, y, level_x, level_y] =
                    words.map(|word| usize::try_from(word).map_err(|_| damaged("its place is negative")));
                Place::Tile(TileCoordinates {
                    tile_index: Vec2(x?, y?),
                    level_index: Vec2(level_x?, level_y?),
                })
            }
        };
        self.read_content(content)?;
        Ok(Head { part, place })
    }

    fn read_i32(&mut self) -> Result<i32, Error> {
        let mut bytes = [0; 4];
        self.input.read_exact(&mut bytes).map_err(cut_short)?;
        self.position += 4;
        Ok(i32::from_le_bytes(bytes))
    }

    fn read_content(&mut self, content: &mut Vec<u8>) -> Result<(), Error> {
        let size = u64::try_from(self.read_i32()?).map_err(|_| damaged("its length is negative"))?;
        if size > self.len.saturating_sub(self.position) {
            return Err(cut_short(io::ErrorKind::UnexpectedEof.into()));
        }
        content.resize(size as usize, 0);
        self.input.read_exact(content).map_err(cut_short)?;
        self.position += size;
        Ok(())
    }
}

/// Checks the sizes in the head of a DWA block of `pixels`: the decoder allocates them without a check. A block that is not smaller when
/// compressed is stored raw, without sizes.
///
/// # Errors
/// A counter is larger than the block's pixels allow.
pub(super) fn check_dwa(content: &[u8], header: &Header, pixels: usize) -> Result<(), Error> {
    let size = header.max_block_pixel_size();
    // No size exceeds the block's 8×8 cells at eight bytes per sample.
    let [width, height] = [size.width(), size.height()].map(|side| side.next_multiple_of(8));
    let limit = width.saturating_mul(height).saturating_mul(header.channels.list.len()).saturating_mul(8);
    let (counters, _) = content.as_chunks();
    // The first counter is a version, the last one a compression method.
    let sizes = counters.iter().take(DWA_COUNTERS - 1).skip(1).map(|bytes| u64::from_le_bytes(*bytes));
    let raw = content.len() == pixels * header.channels.bytes_per_pixel;
    if raw || sizes.into_iter().all(|size| size <= limit as u64) {
        Ok(())
    } else {
        Err(damaged("its sizes exceed its pixels"))
    }
}

fn damaged(why: &'static str) -> Error {
    decoder_error("a block of pixels is damaged", exr::error::Error::Invalid(why.into()))
}

fn cut_short(error: io::Error) -> Error {
    Error::reading("the file is truncated: pixels are missing", error)
        .help("copy or render it again; it may still be being written")
}
