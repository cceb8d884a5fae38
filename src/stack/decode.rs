//! OpenEXR pixels: compressed blocks in, planes out.
//!
//! Blocks are read in file order and decompressed in the caller's thread pool, each into its rows of the planes: ZIP and ZIPS here, other
//! codecs by the EXR library. Memory: the planes, of which pages that hold zeros alone take none, and a block for each thread, packed and
//! unpacked. Only requested channels are converted. Of a file that is cropped to some of its rows, only the blocks that meet them are read.
//! Limits: only the largest resolution level is read; samples are taken as they are in the file, on machines that are little-endian like it.

use super::Window;
use super::chunks::{self, Chunks, Head, Place};
use super::guard;
use super::header::{ExrFile, decoder_error};
use super::sanitise::{self, Replaced};
use crate::error::Error;
use crate::image::Plane;
use crate::zip_blocks::{Damage, Halves, are_zero, unpack};
use exr::block::UncompressedBlock;
use exr::image::FlatSamples;
use exr::meta::attribute::{Compression, SampleType};
use exr::meta::header::Header;
use exr::meta::{BlockDescription, MetaData};
use half::f16;
use half::slice::{HalfBitsSliceExt, HalfFloatSliceExt};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The part of the memory limit that decompressed blocks may take, unless one block takes more.
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
    /// Blocks beside one another write to the same rows. All values are 0 before.
    rows: Mutex<Rows<'a>>,
}

/// The strips of each row of blocks of a part.
type Bands<'a> = Vec<Vec<Strip<'a>>>;

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
        part_bands.resize_with(grid.bands().len(), Vec::new);
        for (strips, rows) in part_bands.iter_mut().zip(cut(output, grid)) {
            strips.push(Strip { channel: channel.index, usage, rows: Mutex::new(rows) });
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

/// The number of blocks that are decoded at a time: one for each thread, and fewer where they are large.
fn most_blocks(file: &ExrFile, max_bytes: Option<u64>) -> usize {
    let largest = file.meta_data.headers.iter().map(block_bytes).max().unwrap_or(0).max(1);
    let limit = max_bytes.unwrap_or_else(guard::default_max_bytes) / BLOCKS_SHARE;
    let fitting = usize::try_from(limit / largest).unwrap_or(usize::MAX);
    rayon::current_num_threads().min(fitting).max(1)
}

/// The blocks that are still to be read.
struct Unread {
    chunks: Chunks,
    /// For each part, the blocks that were read.
    seen: Vec<Vec<bool>>,
    /// Number of blocks that were read.
    count: usize,
    /// Whether a block was damaged: no others are read then.
    failed: bool,
}

/// What a thread decodes a block in, again and again.
#[derive(Default)]
struct Workspace {
    /// The block as it is in the file.
    content: Vec<u8>,
    half_row: Vec<u16>,
}

/// Decodes all blocks of the parts that have bands, at most `most_blocks` at a time, into the strips.
///
/// Each thread reads a block, decodes it, reads the next: no thread waits for another but while that one reads. Of several damaged blocks
/// the first in the file is reported.
fn fill(file: ExrFile, grids: &[Grid], bands: &[Bands<'_>], most_blocks: usize) -> Result<Replaced, Error> {
    let ExrFile { input, len, meta_data, .. } = file;
    let seen =
        grids.iter().zip(bands).map(|(grid, bands)| vec![false; grid.columns() * bands.len()]).collect();
    let requested = |part: usize, band: usize| !bands[part].is_empty() && grids[part].bands().contains(&band);
    let chunks = Chunks::new(input, len, &meta_data, requested)?;
    let unread = Mutex::new(Unread { chunks, seen, count: 0, failed: false });
    // A function, so that the lock is held for its call and no longer.
    let next_block = |content: &mut Vec<u8>| unlocked(&unread).next(&meta_data, grids, content);
    let work = |_| {
        let (mut workspace, mut replaced) = (Workspace::default(), Replaced::default());
        while let Some((number, next)) = next_block(&mut workspace.content) {
            let placed = next.and_then(|(head, at)| {
                let strips = &bands[head.part][at.1 - grids[head.part].bands().start];
                place(head, at, strips, (&grids[head.part], &meta_data), &mut workspace)
            });
            match placed {
                Ok(more) => replaced.add(more),
                Err(error) => {
                    unlocked(&unread).failed = true;
                    return Err((number, error));
                }
            }
        }
        Ok(replaced)
    };
    let outcomes: Vec<_> = (0..most_blocks).into_par_iter().with_max_len(1).map(work).collect();
    let mut replaced = Replaced::default();
    let mut failures = Vec::new();
    for outcome in outcomes {
        match outcome {
            Ok(more) => replaced.add(more),
            Err(failure) => failures.push(failure),
        }
    }
    if let Some((_, error)) = failures.into_iter().min_by_key(|(number, _)| *number) {
        return Err(error);
    }
    let missing = unlocked(&unread).seen.iter().flatten().filter(|seen| !**seen).count();
    if missing > 0 {
        return Err(Error::input(format!("{missing} blocks of pixels are missing"))
            .help("the file is damaged or still being written: render or copy it again"));
    }
    Ok(replaced)
}

fn unlocked<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A block, and its column and row of blocks.
type Located = (Head, (usize, usize));

impl Unread {
    /// The number of the next block in the file, and the block, whose bytes replace those of `content`; `None` after the last, and after one
    /// that is damaged.
    fn next(
        &mut self,
        meta_data: &MetaData,
        grids: &[Grid],
        content: &mut Vec<u8>,
    ) -> Option<(usize, Result<Located, Error>)> {
        if self.failed {
            return None;
        }
        let head = self.chunks.next(meta_data, content)?;
        self.count += 1;
        let located = head.and_then(|head| Ok((head, locate(head, meta_data, grids, &mut self.seen)?)));
        Some((self.count, located))
    }
}

/// Column and band of a block. Each may occur only once.
fn locate(
    head: Head,
    meta_data: &MetaData,
    grids: &[Grid],
    seen: &mut [Vec<bool>],
) -> Result<(usize, usize), Error> {
    let part = head.part;
    let found = match head.place {
        Place::Row(y) => {
            let top = meta_data.headers[part].own_attributes.layer_position.y();
            let row = usize::try_from(i64::from(y) - i64::from(top)).ok();
            row.filter(|row| row % grids[part].block_height == 0)
                .map(|row| (0, row / grids[part].block_height))
        }
        Place::Tile(tile) if tile.is_largest_resolution_level() => {
            Some((tile.tile_index.x(), tile.tile_index.y()))
        }
        Place::Tile(_) => None,
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

/// The bytes of a decompressed block.
#[derive(Clone, Copy)]
enum Samples<'a> {
    /// Row after row.
    Plain(&'a [u8]),
    /// Even places apart from odd ones.
    Halves(Halves<'a>),
}

impl<'a> Samples<'a> {
    fn part(self, range: Range<usize>) -> Self {
        match self {
            Self::Plain(bytes) => Self::Plain(&bytes[range]),
            Self::Halves(halves) => Self::Halves(halves.part(range)),
        }
    }

    fn copy_to(self, bytes: &mut [u8]) {
        match self {
            Self::Plain(own) => bytes.copy_from_slice(own),
            Self::Halves(halves) => halves.join(bytes),
        }
    }

    fn is_zero(self) -> bool {
        match self {
            Self::Plain(bytes) => are_zero(bytes),
            Self::Halves(halves) => halves.is_zero(),
        }
    }
}

/// Decompresses the block in this column and row of blocks, which is in the workspace, into its strips.
fn place(
    head: Head,
    (column, band): (usize, usize),
    strips: &[Strip<'_>],
    (grid, meta_data): (&Grid, &MetaData),
    workspace: &mut Workspace,
) -> Result<Replaced, Error> {
    let header = &meta_data.headers[head.part];
    let Workspace { content, half_row } = workspace;
    let size = grid.pixels_of(column, band) * header.channels.bytes_per_pixel;
    let (decompressed, shuffled);
    let samples = match header.compression {
        Compression::ZIP1 | Compression::ZIP16 if content.len() == size => Samples::Plain(content),
        Compression::ZIP1 | Compression::ZIP16 => {
            shuffled = unpack(content, size).map_err(|damage| not_unpacked(header, damage))?;
            Samples::Halves(shuffled.halves())
        }
        compression => {
            if matches!(compression, Compression::DWAA(_) | Compression::DWAB(_)) {
                chunks::check_dwa(content, header, grid.pixels_of(column, band))?;
            }
            let block = UncompressedBlock::decompress_chunk(head.take(content), meta_data, false);
            decompressed = block.map_err(|error| decoder_error(NOT_DECOMPRESSED, error))?.data;
            Samples::Plain(&decompressed)
        }
    };
    let left = column * grid.block_width;
    let width = grid.block_width.min(grid.width - left);
    let rows = grid.rows_of(band);
    let skipped = rows.start - band * grid.block_height;
    let mut replaced = Replaced::default();
    half_row.resize(width, 0);
    for strip in strips {
        let channels = &header.channels.list;
        let before = channels[..strip.channel].iter().map(|channel| channel.sample_type.bytes_per_sample());
        let (offset, sample_type) = (before.sum::<usize>(), channels[strip.channel].sample_type);
        let mut strip_rows = unlocked(&strip.rows);
        for row in 0..rows.len() {
            let start = ((skipped + row) * header.channels.bytes_per_pixel + offset) * width;
            let samples = samples.part(start..start + sample_type.bytes_per_sample() * width);
            // Zeros are there: memory that is not written to takes no room.
            if samples.is_zero() {
                continue;
            }
            let at = row * grid.width + left..row * grid.width + left + width;
            match &mut *strip_rows {
                Rows::Float(values) => {
                    let values = &mut values[at];
                    read_floats(samples, sample_type, half_row, values);
                    match strip.usage {
                        Use::Color => sanitise::color(values, &mut replaced),
                        Use::Alpha => sanitise::alpha(values, &mut replaced),
                        Use::Depth | Use::Carry => {}
                    }
                }
                Rows::Half(values) => {
                    let bits: &mut [u16] = values[at].reinterpret_cast_mut();
                    samples.copy_to(bytemuck::cast_slice_mut(bits));
                }
                Rows::Uint(values) => samples.copy_to(bytemuck::cast_slice_mut(&mut values[at])),
            }
        }
    }
    Ok(replaced)
}

const NOT_DECOMPRESSED: &str = "a block of pixels cannot be decompressed";

/// The error of a ZIP or ZIPS block, in the words of the EXR library.
fn not_unpacked(header: &Header, damage: Damage) -> Error {
    let what = match damage {
        Damage::TooShort | Damage::Malformed => {
            format!("compressed {:?} data (invalid: zlib-compressed data malformed)", header.compression)
        }
        Damage::WrongSize => "decompressed data".to_owned(),
    };
    decoder_error(NOT_DECOMPRESSED, exr::error::Error::Invalid(what.into()))
}

/// Converts one row of samples to `f32`. `half_row` is scratch memory of the same length.
fn read_floats(samples: Samples<'_>, sample_type: SampleType, half_row: &mut [u16], values: &mut [f32]) {
    match sample_type {
        SampleType::F32 => samples.copy_to(bytemuck::cast_slice_mut(values)),
        SampleType::F16 => {
            samples.copy_to(bytemuck::cast_slice_mut(half_row));
            half_row.reinterpret_cast::<f16>().convert_to_f32_slice(values);
        }
        SampleType::U32 => {
            samples.copy_to(bytemuck::cast_slice_mut(values));
            values.iter_mut().for_each(|value| *value = value.to_bits() as f32);
        }
    }
}
