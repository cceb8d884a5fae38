//! Whether a file is all there: not still being written, not cut short.
//!
//! Reads the header, the table of offsets and the head of the last chunk, whatever the size of the picture. All that OpenEXR can be is
//! understood: parts, tiles, resolution levels, and deep data. Nothing is decompressed.

use super::Source;
use super::guard::{self, RawHeader, RawPart};
use super::input::Opened;
use crate::error::Error;
use std::io::{self, Read, Seek, SeekFrom};

/// The chunk that ends every PNG.
const PNG_END: [u8; 12] = [0, 0, 0, 0, b'I', b'E', b'N', b'D', 0xae, 0x42, 0x60, 0x82];
/// The first bytes of the formats whose end is known: OpenEXR and PNG.
const STARTS: [&[u8]; 2] = [&[0x76, 0x2f, 0x31, 0x01], &[0x89, b'P', b'N', b'G']];

/// Whether `source` holds a whole picture.
///
/// An OpenEXR file is whole if its header can be read, no offset of a chunk of full resolution is zero, and the file reaches the end of
/// its last chunk. Smaller resolution levels, which no render reads, may be missing: some programs never write them. A
/// PNG, if it ends as a PNG must. Of other formats only an empty file is known not to be whole.
///
/// # Errors
/// [`crate::error::ErrorKind::Input`] and [`crate::error::ErrorKind::Read`] for a file that cannot be opened or read, or is not what it
/// claims to be: what is missing may still come, what is wrong stays wrong.
pub fn is_complete(source: &Source) -> Result<bool, Error> {
    let mut opened = Opened::open_even_empty(source)?;
    let head = opened.first_bytes()?;
    // Some file systems show the length before the content.
    let is_blank = head.iter().all(|&byte| byte == 0);
    let is_cut = STARTS.iter().any(|start| start.len() > head.len() && start.starts_with(&head));
    let [exr, png] = STARTS.map(|start| head.starts_with(start));
    let found = match (exr, png) {
        (true, _) => exr_is_complete(&mut opened),
        (_, true) => {
            ends_in(&mut opened, &PNG_END).map_err(|cause| Error::reading("the file cannot be read", cause))
        }
        _ => Ok(!is_blank && !is_cut),
    };
    found.map_err(|error| error.in_file(&opened.name))
}

/// Whether the last bytes of the file are `end`.
fn ends_in<const N: usize>(opened: &mut Opened, end: &[u8; N]) -> io::Result<bool> {
    let Some(start) = opened.len.checked_sub(N as u64) else { return Ok(false) };
    let mut last = [0; N];
    opened.input.seek(SeekFrom::Start(start))?;
    opened.input.read_exact(&mut last)?;
    Ok(last == *end)
}

/// A file that ends early is not complete; every other failure is one.
fn unless_cut_short<T>(read: io::Result<T>) -> Result<Option<T>, Error> {
    match read {
        Ok(read) => Ok(Some(read)),
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(None),
        Err(error) => Err(Error::reading("the OpenEXR header cannot be read", error)),
    }
}

fn exr_is_complete(opened: &mut Opened) -> Result<bool, Error> {
    let Some(header) = unless_cut_short(guard::scan(opened))? else { return Ok(false) };
    if header.version != 2 {
        return Err(guard::unknown_version(header.version));
    }
    let counts = header.parts.iter().map(|part| chunk_counts(part, &header));
    let counts = counts.collect::<Result<Vec<_>, Error>>()?;
    match unless_cut_short(last_offset(opened, &counts))? {
        None | Some(None) => Ok(false),
        Some(Some(last)) => match unless_cut_short(chunk_end(opened, last, &header))? {
            None => Ok(false),
            Some(end) => Ok(end <= opened.len),
        },
    }
}

/// How many offsets a part has.
struct Counts {
    /// Chunks of full resolution, which come first.
    full: u64,
    /// Chunks of all resolution levels.
    all: u64,
}

/// The numbers of chunks of `part`.
fn chunk_counts(part: &RawPart, header: &RawHeader) -> Result<Counts, Error> {
    let stated = part.chunk_count.map(u64::from);
    let same = |count: u64| Counts { full: count, all: count };
    if let (Some(count), false) = (stated, is_tiled(part, header)) {
        return Ok(same(count));
    }
    let window = part.data_window.ok_or_else(|| guard::missing("dataWindow"))?;
    let [width, height] = guard::window_size(window, "data")?;
    if is_tiled(part, header) {
        let [tile_width, tile_height] = part.tile.ok_or_else(|| guard::missing("tiles"))?;
        let tile = [u64::from(tile_width.max(1)), u64::from(tile_height.max(1))];
        let [full, all] = [0, part.level_mode].map(|mode| tiles_of_all_levels([width, height], tile, mode));
        return Ok(Counts { full, all: stated.unwrap_or(all) });
    }
    let number = part.compression.ok_or_else(|| guard::missing("compression"))?;
    let (rows, _) = guard::codec(number).ok_or_else(|| guard::unknown_codec(number))?;
    Ok(same(height.div_ceil(rows)))
}

/// Whether `part` has tiles. The flag of the file speaks for its only part, whatever its type says.
fn is_tiled(part: &RawPart, header: &RawHeader) -> bool {
    match part.kind.as_deref() {
        Some(kind) if header.multi_part || header.deep => matches!(kind, "tiledimage" | "deeptile"),
        _ => header.tiled,
    }
}

/// Whether the chunks of `part` are deep.
fn is_deep(part: &RawPart, header: &RawHeader) -> bool {
    match part.kind.as_deref() {
        Some(kind) => kind.starts_with("deep"),
        None => header.deep,
    }
}

/// The number of tiles: of one level, of levels that halve both sides together, or of all pairs of halved sides.
fn tiles_of_all_levels(size: [u64; 2], tile: [u64; 2], mode: u8) -> u64 {
    let round_up = mode >> 4 != 0;
    let level_of = |longest: u64| match round_up {
        true => u64::from(longest.next_power_of_two().trailing_zeros()),
        false => u64::from(longest.ilog2()),
    };
    let tiles = |side: usize, level: u64| {
        let halved = if round_up { size[side].div_ceil(1 << level) } else { size[side] >> level };
        halved.max(1).div_ceil(tile[side])
    };
    let all = |side: usize| (0..=level_of(size[side])).map(|level| tiles(side, level)).sum::<u64>();
    match mode & 0xf {
        1 => (0..=level_of(size[0].max(size[1]))).map(|level| tiles(0, level) * tiles(1, level)).sum(),
        2 => all(0).saturating_mul(all(1)),
        _ => tiles(0, 0) * tiles(1, 0),
    }
}

/// The largest of all offsets; `None` if one of full resolution is zero, as it is before its chunk is written.
fn last_offset(opened: &mut Opened, parts: &[Counts]) -> io::Result<Option<u64>> {
    let mut last = 0;
    for part in parts {
        for number in 0..part.all {
            let mut offset = [0; 8];
            opened.input.read_exact(&mut offset)?;
            let offset = u64::from_le_bytes(offset);
            if offset == 0 && number < part.full {
                return Ok(None);
            }
            last = last.max(offset);
        }
    }
    Ok(Some(last))
}

/// Where the chunk at `offset` ends.
fn chunk_end(opened: &mut Opened, offset: u64, header: &RawHeader) -> io::Result<u64> {
    let input = &mut opened.input;
    input.seek(SeekFrom::Start(offset))?;
    let mut word = [0; 4];
    let part = match header.multi_part {
        true => {
            input.read_exact(&mut word)?;
            u32::from_le_bytes(word) as usize
        }
        false => 0,
    };
    let part = header.parts.get(part).ok_or(io::ErrorKind::InvalidData)?;
    let place_bytes = if is_tiled(part, header) { 16 } else { 4 };
    input.seek_relative(place_bytes)?;
    let content = if is_deep(part, header) {
        let mut sizes = [[0; 8]; 3];
        input.read_exact(sizes.as_flattened_mut())?;
        let [counts, samples, _unpacked] = sizes.map(u64::from_le_bytes);
        counts.saturating_add(samples)
    } else {
        input.read_exact(&mut word)?;
        u64::from(u32::from_le_bytes(word))
    };
    Ok(input.stream_position()?.saturating_add(content))
}
