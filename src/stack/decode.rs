//! OpenEXR pixels: compressed blocks in, planes out.
//!
//! Blocks are read in file order and decompressed in the caller's thread pool, a batch at a time, each into its
//! rows of the planes. Memory: the planes and one batch of blocks. Only requested channels are converted.
//! Of a file that is cropped to some of its rows, only the blocks that meet them are read. Limits: only the largest resolution level is
//! read.

use super::Window;
use super::chunks::{self, Chunks};
use super::guard;
use super::header::{ExrFile, decoder_error};
use super::sanitise::{self, Replaced};
use crate::error::Error;
use crate::image::Plane;
use exr::block::UncompressedBlock;
use exr::block::chunk::{Chunk, CompressedBlock};
use exr::image::FlatSamples;
use exr::meta::attribute::{Compression, SampleType};
use exr::meta::header::Header;
use exr::meta::{BlockDescription, MetaData};
use half::f16;
use half::slice::{HalfBitsSliceExt, HalfFloatSliceExt};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Maximum compressed bytes of a batch; a batch has at least one block.
const BATCH_BYTES: usize = 32 << 20;

/// The part of the memory limit that the decompressed blocks of a batch may take, unless one block takes more.
const BLOCKS_SHARE: u64 = 8;

/// The use of a channel, which determines its conversion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Use {
    /// Red, green or blue: values that are not finite are replaced.
    Color,
    /// Coverage or opacity: clamped to 0 … 1.
    Alpha,
    /// Depth: every value is kept.
    Depth,
    /// Copied to the output in its own type.
    Carry,
}

/// A decoded channel.
#[derive(Debug)]
pub(super) enum Decoded {
    /// A channel of a peel, converted to `f32`.
    Plane(Plane),
    /// A channel for [`Use::Carry`].
    Samples(FlatSamples),
}

/// The rows of one requested channel within one row of blocks.
struct Strip<'a> {
    /// Index in the part's channel list.
    channel: usize,
    usage: Use,
    rows: Rows<'a>,
}

/// The strips of each row of blocks of a part.
type Bands<'a> = Vec<Mutex<Vec<Strip<'a>>>>;

enum Rows<'a> {
    Float(&'a mut [f32]),
    Half(&'a mut [f16]),
    Uint(&'a mut [u32]),
}

/// The division of a part into blocks.
#[derive(Clone)]
struct Grid {
    width: usize,
    /// Rows of the part.
    height: usize,
    /// The rows that are read, counted from the top of the part.
    rows: Range<usize>,
    block_width: usize,
    block_height: usize,
}

impl Grid {
    fn new(file: &ExrFile, part: usize) -> Self {
        let header = file.header(part);
        let (width, height) = (header.layer_size.width(), header.layer_size.height());
        let (block_width, block_height) = match header.blocks {
            BlockDescription::ScanLines => (width, header.compression.scan_lines_per_block()),
            BlockDescription::Tiles(tiles) => (tiles.tile_size.width(), tiles.tile_size.height()),
        };
        Self { width, height, rows: file.rows(part), block_width, block_height }
    }

    /// The number of pixels of the block in this column and row of blocks; those at the right and lower edge may be smaller.
    fn pixels_of(&self, column: usize, band: usize) -> usize {
        let width = self.width.saturating_sub(column * self.block_width).min(self.block_width);
        width * self.height.saturating_sub(band * self.block_height).min(self.block_height)
    }

    fn columns(&self) -> usize {
        self.width.div_ceil(self.block_width)
    }

    /// The rows of blocks that meet the rows that are read.
    fn bands(&self) -> Range<usize> {
        if self.rows.is_empty() {
            return 0..0;
        }
        self.rows.start / self.block_height..self.rows.end.div_ceil(self.block_height)
    }

    /// The rows of the row of blocks `band` that are read.
    fn rows_of(&self, band: usize) -> Range<usize> {
        let top = band * self.block_height;
        top.max(self.rows.start)..(top + self.block_height).min(self.rows.end)
    }
}

/// Decodes the `requested` channels (indices into [`ExrFile::channels`]), in that order.
///
/// # Errors
/// [`Error::limits`] if more than `max_bytes` are required; damaged or missing blocks.
pub(super) fn decode(
    file: ExrFile,
    requested: &[(usize, Use)],
    max_bytes: Option<u64>,
) -> Result<(Vec<Decoded>, Replaced), Error> {
    let name = file.name.clone();
    decode_unnamed(file, requested, max_bytes).map_err(|error| error.in_file(&name))
}

fn decode_unnamed(
    file: ExrFile,
    requested: &[(usize, Use)],
    max_bytes: Option<u64>,
) -> Result<(Vec<Decoded>, Replaced), Error> {
    check_budget(&file, requested, max_bytes)?;
    let mut decoded: Vec<Decoded> =
        requested.iter().map(|&(channel, usage)| empty(&file, channel, usage)).collect();
    let grids: Vec<Grid> = (0..file.meta_data.headers.len()).map(|part| Grid::new(&file, part)).collect();
    let mut bands: Vec<Bands<'_>> = grids.iter().map(|_| Vec::new()).collect();
    for (&(channel, usage), output) in requested.iter().zip(&mut decoded) {
        let channel = &file.channels[channel];
        let grid = &grids[channel.part];
        let part_bands = &mut bands[channel.part];
        part_bands.resize_with(grid.bands().len(), Mutex::default);
        for (band, rows) in part_bands.iter_mut().zip(cut(output, grid)) {
            let strips = band.get_mut().unwrap_or_else(PoisonError::into_inner);
            strips.push(Strip { channel: channel.index, usage, rows });
        }
    }
    let most_blocks = most_blocks(&file, max_bytes);
    let replaced = fill(file, &grids, &bands, most_blocks)?;
    drop(bands);
    Ok((decoded, replaced))
}

fn check_budget(file: &ExrFile, requested: &[(usize, Use)], max_bytes: Option<u64>) -> Result<(), Error> {
    let limit = max_bytes.unwrap_or_else(guard::default_max_bytes);
    let window_of = |channel: usize| file.frame(file.channels[channel].part).data;
    let planes = requested.iter().fold(0u64, |sum, &(channel, _)| {
        let size = window_of(channel);
        let pixels = (size.width as u64).saturating_mul(size.height as u64);
        sum.saturating_add(pixels.saturating_mul(4))
    });
    // A block has all channels of its part, also those that are not requested.
    let parts = requested.iter().map(|&(channel, _)| file.channels[channel].part);
    let block = parts.map(|part| block_bytes(file.header(part))).max().unwrap_or(0);
    let bytes = planes.saturating_add(block);
    if bytes <= limit {
        return Ok(());
    }
    let size = requested.first().map(|&(channel, _)| window_of(channel));
    let (width, height) = size.map_or((0, 0), |size| (size.width, size.height));
    Err(Error::limits("the picture requires more memory than the limit")
        .with("found", format!("{width}×{height} pixels, {} channels: {} MiB", requested.len(), bytes >> 20))
        .with("limit", format!("{} MiB", limit >> 20))
        .help("crop or scale the picture, or leave out channels that are not needed"))
}

fn empty(file: &ExrFile, channel: usize, usage: Use) -> Decoded {
    let channel = &file.channels[channel];
    let Window { width, height, .. } = file.frame(channel.part).data;
    let samples = width * height;
    match (usage, channel.sample_type) {
        (Use::Carry, SampleType::F16) => Decoded::Samples(FlatSamples::F16(vec![f16::ZERO; samples])),
        (Use::Carry, SampleType::F32) => Decoded::Samples(FlatSamples::F32(vec![0.0; samples])),
        (Use::Carry, SampleType::U32) => Decoded::Samples(FlatSamples::U32(vec![0; samples])),
        _ => Decoded::Plane(Plane::zeros(width, height)),
    }
}

/// The rows of `decoded` of each row of blocks of `grid`.
fn cut<'a>(decoded: &'a mut Decoded, grid: &Grid) -> Vec<Rows<'a>> {
    match decoded {
        Decoded::Plane(plane) => cut_values(plane.values_mut(), grid, Rows::Float),
        Decoded::Samples(FlatSamples::F16(values)) => cut_values(values, grid, Rows::Half),
        Decoded::Samples(FlatSamples::F32(values)) => cut_values(values, grid, Rows::Float),
        Decoded::Samples(FlatSamples::U32(values)) => cut_values(values, grid, Rows::Uint),
    }
}

fn cut_values<'a, T>(
    mut values: &'a mut [T],
    grid: &Grid,
    rows: impl Fn(&'a mut [T]) -> Rows<'a>,
) -> Vec<Rows<'a>> {
    let lengths = grid.bands().map(|band| grid.rows_of(band).len() * grid.width);
    lengths
        .map(|length| {
            let (first, rest) = std::mem::take(&mut values).split_at_mut(length);
            values = rest;
            rows(first)
        })
        .collect()
}

/// Bytes of a decompressed block of the part with this header.
pub(super) fn block_bytes(header: &Header) -> u64 {
    let size = header.max_block_pixel_size();
    let pixels = (size.width() as u64).saturating_mul(size.height() as u64);
    pixels.saturating_mul(header.channels.bytes_per_pixel as u64)
}

/// The number of blocks of a batch: a few for each thread, and fewer where they are large.
fn most_blocks(file: &ExrFile, max_bytes: Option<u64>) -> usize {
    let largest = file.meta_data.headers.iter().map(block_bytes).max().unwrap_or(0).max(1);
    let limit = max_bytes.unwrap_or_else(guard::default_max_bytes) / BLOCKS_SHARE;
    let fitting = usize::try_from(limit / largest).unwrap_or(usize::MAX);
    (4 * rayon::current_num_threads()).min(fitting).max(1)
}

/// Decodes all blocks of the parts that have bands, at most `most_blocks` at a time, into the strips.
fn fill(file: ExrFile, grids: &[Grid], bands: &[Bands<'_>], most_blocks: usize) -> Result<Replaced, Error> {
    let ExrFile { input, len, meta_data, .. } = file;
    let mut seen: Vec<Vec<bool>> =
        grids.iter().zip(bands).map(|(grid, bands)| vec![false; grid.columns() * bands.len()]).collect();
    let requested = |part: usize, band: usize| !bands[part].is_empty() && grids[part].bands().contains(&band);
    let mut chunks = Chunks::new(input, len, &meta_data, requested)?;
    let mut replaced = Replaced::default();
    loop {
        let mut batch = Vec::new();
        let mut bytes = 0;
        while batch.len() < most_blocks && bytes < BATCH_BYTES {
            let Some(chunk) = chunks.next(&meta_data) else { break };
            let chunk = chunk?;
            let at = locate(&chunk, &meta_data, grids, &mut seen)?;
            bytes += chunks::content(&chunk).len();
            batch.push((chunk, at));
        }
        if batch.is_empty() {
            break;
        }
        let done = batch.into_par_iter().map(|(chunk, (column, band))| {
            let part = chunk.layer_index;
            let strips = &bands[part][band - grids[part].bands().start];
            place(chunk, (column, band), strips, &grids[part], &meta_data)
        });
        for part in done.collect::<Vec<_>>() {
            replaced.add(part?);
        }
    }
    let missing = seen.iter().flatten().filter(|seen| !**seen).count();
    if missing > 0 {
        return Err(Error::input(format!("{missing} blocks of pixels are missing"))
            .help("the file is damaged or still being written: render or copy it again"));
    }
    Ok(replaced)
}

/// Column and band of a block. Each may occur only once.
fn locate(
    chunk: &Chunk,
    meta_data: &MetaData,
    grids: &[Grid],
    seen: &mut [Vec<bool>],
) -> Result<(usize, usize), Error> {
    let part = chunk.layer_index;
    let found = match &chunk.compressed_block {
        CompressedBlock::ScanLine(block) => {
            let top = meta_data.headers[part].own_attributes.layer_position.y();
            let row = usize::try_from(i64::from(block.y_coordinate) - i64::from(top)).ok();
            row.filter(|row| row % grids[part].block_height == 0)
                .map(|row| (0, row / grids[part].block_height))
        }
        CompressedBlock::Tile(tile) if tile.coordinates.is_largest_resolution_level() => {
            Some((tile.coordinates.tile_index.x(), tile.coordinates.tile_index.y()))
        }
        _ => None,
    };
    let (columns, bands) = (grids[part].columns(), grids[part].bands());
    let place = found.filter(|&(column, band)| column < columns && bands.contains(&band));
    let slot = place.and_then(|(column, band)| seen[part].get_mut((band - bands.start) * columns + column));
    match (place, slot) {
        (Some(place), Some(slot)) if !*slot => {
            *slot = true;
            Ok(place)
        }
        _ => Err(Error::input("a block of pixels has an invalid or repeated position")
            .help("the file is damaged: render or copy it again")),
    }
}

/// Decompresses the block in this column and row of blocks into its strips.
fn place(
    chunk: Chunk,
    (column, band): (usize, usize),
    strips: &Mutex<Vec<Strip<'_>>>,
    grid: &Grid,
    meta_data: &MetaData,
) -> Result<Replaced, Error> {
    let header = &meta_data.headers[chunk.layer_index];
    if matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_)) {
        chunks::check_dwa(chunks::content(&chunk), header, grid.pixels_of(column, band))?;
    }
    let block = UncompressedBlock::decompress_chunk(chunk, meta_data, false)
        .map_err(|error| decoder_error("a block of pixels cannot be decompressed", error))?;
    let mut offsets = Vec::with_capacity(header.channels.list.len());
    let mut bytes_per_pixel = 0;
    for channel in &header.channels.list {
        offsets.push((bytes_per_pixel, channel.sample_type));
        bytes_per_pixel += channel.sample_type.bytes_per_sample();
    }
    let (left, width) = (column * grid.block_width, block.index.pixel_size.width());
    let mut replaced = Replaced::default();
    let mut half_row = vec![0u16; width];
    let rows = grid.rows_of(band);
    let skipped = rows.start - band * grid.block_height;
    let mut strips = strips.lock().unwrap_or_else(PoisonError::into_inner);
    for strip in strips.iter_mut() {
        let (offset, sample_type) = offsets[strip.channel];
        let len = sample_type.bytes_per_sample() * width;
        let lines = block.data.chunks_exact(bytes_per_pixel * width).skip(skipped).take(rows.len());
        for (row, line) in lines.enumerate() {
            let bytes = &line[offset * width..][..len];
            let at = row * grid.width + left;
            match &mut strip.rows {
                Rows::Float(values) => {
                    let values = &mut values[at..at + width];
                    read_floats(bytes, sample_type, &mut half_row, values);
                    match strip.usage {
                        Use::Color => sanitise::color(values, &mut replaced),
                        Use::Alpha => sanitise::alpha(values, &mut replaced),
                        Use::Depth | Use::Carry => {}
                    }
                }
                Rows::Half(values) => {
                    bytemuck::cast_slice_mut(&mut half_row).copy_from_slice(bytes);
                    values[at..at + width].copy_from_slice(half_row.reinterpret_cast());
                }
                Rows::Uint(values) => {
                    bytemuck::cast_slice_mut::<u32, u8>(&mut values[at..at + width]).copy_from_slice(bytes);
                }
            }
        }
    }
    Ok(replaced)
}

/// Converts one row of samples in native byte order to `f32`. `half_row` is scratch memory of the same length.
fn read_floats(bytes: &[u8], sample_type: SampleType, half_row: &mut [u16], values: &mut [f32]) {
    match sample_type {
        SampleType::F32 => bytemuck::cast_slice_mut::<f32, u8>(values).copy_from_slice(bytes),
        SampleType::F16 => {
            bytemuck::cast_slice_mut::<u16, u8>(half_row).copy_from_slice(bytes);
            half_row.reinterpret_cast::<f16>().convert_to_f32_slice(values);
        }
        SampleType::U32 => {
            for (value, bytes) in values.iter_mut().zip(bytes.chunks_exact(4)) {
                *value = u32::from_ne_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]) as f32;
            }
        }
    }
}
