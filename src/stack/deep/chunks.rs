//! Where the blocks of a deep part are in its file.
//!
//! A block starts with its place and three sizes: of the packed table of sample counts, of the packed samples, and of the samples.

use super::super::Window;
use super::super::header::ExrFile;
use super::unpack::damaged;
use crate::error::Error;
use exr::meta::BlockDescription;
use std::io::{self, Read, Seek, SeekFrom};

/// How a part is divided into blocks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    /// The data window of the whole part.
    pub(super) window: Window,
    /// Width of a block.
    pub(super) block_width: usize,
    /// Height of a block.
    pub(super) block_height: usize,
    is_tiled: bool,
}

/// One block of a file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Chunk {
    /// Where its table of sample counts begins.
    pub(super) position: u64,
    /// Size of the packed table in bytes.
    pub(super) table_bytes: u64,
    /// Size of the packed samples in bytes.
    pub(super) packed_bytes: u64,
    /// Size of the samples in bytes.
    pub(super) sample_bytes: u64,
    /// Its pixels.
    pub(super) window: Window,
}

impl Grid {
    /// The grid of part `part`.
    pub(super) fn new(file: &ExrFile, part: usize) -> Self {
        let header = file.header(part);
        let window = file.whole_window(part);
        let (block_width, block_height, is_tiled) = match header.blocks {
            BlockDescription::ScanLines => (window.width, header.compression.scan_lines_per_block(), false),
            BlockDescription::Tiles(tiles) => (tiles.tile_size.width(), tiles.tile_size.height(), true),
        };
        Self { window, block_width: block_width.max(1), block_height: block_height.max(1), is_tiled }
    }

    /// Number of blocks beside one another.
    pub(super) fn columns(&self) -> usize {
        self.window.width.div_ceil(self.block_width)
    }

    /// Number of rows of blocks.
    pub(super) fn bands(&self) -> usize {
        self.window.height.div_ceil(self.block_height)
    }

    /// The pixels of the block in this column and row of blocks.
    fn block(&self, column: usize, band: usize) -> Window {
        let [left, top] = [column * self.block_width, band * self.block_height];
        // Coordinates are below 2^30 (see `guard`).
        Window {
            x: self.window.x + left as i32,
            y: self.window.y + top as i32,
            width: self.block_width.min(self.window.width - left),
            height: self.block_height.min(self.window.height - top),
        }
    }
}

/// The blocks of full resolution of part `part`, row of blocks after row of blocks. `file` is positioned after its headers.
///
/// # Errors
/// A truncated or damaged file, and blocks that are missing or occur twice.
pub(super) fn find(file: &mut ExrFile, part: usize, grid: &Grid) -> Result<Vec<Chunk>, Error> {
    let offsets = offsets(file, part, grid)?;
    let mut found: Vec<Option<Chunk>> = vec![None; grid.columns() * grid.bands()];
    let mut position = file.input.stream_position().map_err(cut_short)?;
    for offset in offsets {
        if offset == 0 {
            return Err(Error::input("some blocks of samples were not written")
                .help("the render was stopped or is still running: render it again"));
        }
        if offset >= file.len {
            return Err(cut_short(io::ErrorKind::UnexpectedEof.into()));
        }
        // Both are positions within a file. A short distance stays within the buffer.
        file.input.seek_relative(offset as i64 - position as i64).map_err(cut_short)?;
        let (at, chunk) = head(file, part, grid)?;
        position = chunk.position;
        let slot = found.get_mut(at).filter(|slot| slot.is_none());
        *slot.ok_or_else(|| damaged("a block of samples has an invalid or repeated position"))? = Some(chunk);
    }
    let missing = || damaged("blocks of samples are missing");
    found.into_iter().collect::<Option<Vec<_>>>().ok_or_else(missing)
}

/// The positions of the blocks of full resolution of part `part`, in the order of the file.
fn offsets(file: &mut ExrFile, part: usize, grid: &Grid) -> Result<Vec<u64>, Error> {
    let counts: Vec<usize> =
        file.meta_data.headers[..=part].iter().map(|header| header.chunk_count).collect();
    let full = grid.columns().saturating_mul(grid.bands());
    let before: u64 = counts[..part].iter().fold(0, |sum: u64, &count| sum.saturating_add(count as u64));
    let start = file.input.stream_position().map_err(cut_short)?;
    let [skipped, own] = [before, full as u64].map(|count| count.saturating_mul(8));
    if own.saturating_add(skipped) > file.len.saturating_sub(start) {
        return Err(cut_short(io::ErrorKind::UnexpectedEof.into()));
    }
    file.input.seek_relative(skipped as i64).map_err(cut_short)?;
    // Blocks of smaller resolution levels come after those of the full one.
    let mut table = vec![0; 8 * full];
    file.input.read_exact(&mut table).map_err(cut_short)?;
    let mut offsets: Vec<u64> = table.as_chunks().0.iter().map(|bytes| u64::from_le_bytes(*bytes)).collect();
    offsets.sort_unstable();
    Ok(offsets)
}

/// Reads the head of the block at the current position: its number, and what it holds.
fn head(file: &mut ExrFile, part: usize, grid: &Grid) -> Result<(usize, Chunk), Error> {
    let misplaced = || damaged("a block of samples has an invalid or repeated position");
    if file.meta_data.requirements.is_multilayer() && usize::try_from(read_i32(file)?).ok() != Some(part) {
        return Err(damaged("a block of samples belongs to another part"));
    }
    let (column, band) = if grid.is_tiled {
        let tile = [read_i32(file)?, read_i32(file)?, read_i32(file)?, read_i32(file)?];
        let [column, band, level_x, level_y] = tile.map(|word| usize::try_from(word).ok());
        if (level_x, level_y) != (Some(0), Some(0)) {
            return Err(misplaced());
        }
        (column.ok_or_else(misplaced)?, band.ok_or_else(misplaced)?)
    } else {
        let row = usize::try_from(i64::from(read_i32(file)?) - i64::from(grid.window.y));
        let row = row.ok().filter(|row| row % grid.block_height == 0).ok_or_else(misplaced)?;
        (0, row / grid.block_height)
    };
    if column >= grid.columns() || band >= grid.bands() {
        return Err(misplaced());
    }
    let [table_bytes, packed_bytes, sample_bytes] = [read_u64(file)?, read_u64(file)?, read_u64(file)?];
    let position = file.input.stream_position().map_err(cut_short)?;
    if table_bytes.saturating_add(packed_bytes) > file.len.saturating_sub(position) {
        return Err(cut_short(io::ErrorKind::UnexpectedEof.into()));
    }
    let window = grid.block(column, band);
    let chunk = Chunk { position, table_bytes, packed_bytes, sample_bytes, window };
    Ok((band * grid.columns() + column, chunk))
}

/// The `count` bytes from `position` on, which the file is known to have.
///
/// # Errors
/// Those of reading.
pub(super) fn read_bytes(file: &mut ExrFile, position: u64, count: u64) -> Result<Vec<u8>, Error> {
    let now = file.input.stream_position().map_err(cut_short)?;
    // A short distance stays within the buffer.
    let distance = i64::try_from(position).ok().zip(i64::try_from(now).ok());
    match distance {
        Some((to, from)) => file.input.seek_relative(to - from).map_err(cut_short)?,
        None => drop(file.input.seek(SeekFrom::Start(position)).map_err(cut_short)?),
    }
    let mut bytes = vec![0; count as usize];
    file.input.read_exact(&mut bytes).map_err(cut_short)?;
    Ok(bytes)
}

fn read_i32(file: &mut ExrFile) -> Result<i32, Error> {
    let mut bytes = [0; 4];
    file.input.read_exact(&mut bytes).map_err(cut_short)?;
    Ok(i32::from_le_bytes(bytes))
}

fn read_u64(file: &mut ExrFile) -> Result<u64, Error> {
    let mut bytes = [0; 8];
    file.input.read_exact(&mut bytes).map_err(cut_short)?;
    Ok(u64::from_le_bytes(bytes))
}

fn cut_short(cause: io::Error) -> Error {
    Error::reading("the file is truncated: samples are missing", cause)
        .help("copy or render it again; it may still be being written")
}
