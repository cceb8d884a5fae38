//! The header guard: checks the sizes in an OpenEXR header before memory is allocated for them.
//!
//! Parses the raw header, because the EXR library accepts any size (a 1 KB file can claim 40 GB) and rejects unknown features
//! (new codecs) without naming them. Cost: one pass over the header.
//! Limits: a size is accepted if the file is long enough for its codec's best compression ratio. The memory limit is checked
//! later, when the requested channels are known, and before they are allocated.

use super::input::Opened;
use crate::error::Error;
use crate::memory::memory_limit_bytes;
use std::io::{self, BufRead, Read, Seek};

/// OpenEXR allows coordinates up to this far from the origin; beyond it sizes overflow 32-bit integers.
pub(super) const COORDINATE_LIMIT: i64 = 1 << 30;
/// A display window of more than this many times the data window's area is an error, not a crop.
const MAX_DISPLAY_RATIO: u64 = 4096;
/// The help for a damaged header.
const DAMAGED: &str = "the header is damaged: render or copy the file again";
/// Maximum size of an attribute value that is read here; larger ones are skipped.
const MAX_VALUE_BYTES: u64 = 16 << 20;
/// Maximum size of a name, with the null that ends it.
const MAX_TEXT_BYTES: u64 = 257;
/// Maximum tile size; no known program writes larger tiles.
const MAX_TILE_SIZE: u32 = 1 << 16;
/// Deflate expands by at most 1032; PXR24 adds a fourth byte to every three.
const DEFLATE_RATIO: u64 = 1400;
/// RLE expands 2 bytes to at most 128.
const RLE_RATIO: u64 = 64;
/// Minimum size of a chunk: its offset, its own header, one byte of content.
const MIN_CHUNK_BYTES: u64 = 17;

/// The headers of a file, before anything in them is believed.
#[derive(Debug)]
pub(super) struct RawHeader {
    /// The version of the format.
    pub(super) version: u32,
    /// Whether there may be several parts; every chunk then begins with the number of its part.
    pub(super) multi_part: bool,
    /// Whether the only part is tiled.
    pub(super) tiled: bool,
    /// Whether any part is deep.
    pub(super) deep: bool,
    /// The parts.
    pub(super) parts: Vec<RawPart>,
}

/// The fields of a part's header that are read here.
#[derive(Debug, Default)]
pub(super) struct RawPart {
    /// The type: `scanlineimage`, `tiledimage`, `deepscanline` or `deeptile`. A file of one part may have none.
    pub(super) kind: Option<String>,
    /// The number of the codec.
    pub(super) compression: Option<u8>,
    /// The inclusive corners of the data window.
    pub(super) data_window: Option<[i32; 4]>,
    display_window: Option<[i32; 4]>,
    /// Width and height of a tile.
    pub(super) tile: Option<[u32; 2]>,
    /// The byte that says which resolution levels there are, and how their sizes are rounded.
    pub(super) level_mode: u8,
    /// The number of chunks, which files of several parts and deep files state.
    pub(super) chunk_count: Option<u32>,
    channels: Vec<RawChannel>,
}

/// One channel of a part.
#[derive(Debug)]
struct RawChannel {
    name: String,
    sample_type: i32,
    sampling: [i32; 2],
}

/// Checks the header of an OpenEXR file; leaves the position at the first byte.
///
/// # Errors
/// Deep data, unknown codecs and subsampled channels are [`Error::unsupported`], impossible sizes and
/// anything that is not a header [`Error::input`].
pub(super) fn check(opened: &mut Opened) -> Result<(), Error> {
    let found = scan(opened).map_err(cut_short).and_then(|RawHeader { version, deep, parts, .. }| {
        if version != 2 {
            return Err(unknown_version(version));
        }
        if deep {
            return Err(deep_data());
        }
        parts.iter().try_for_each(|part| check_part(part, opened.len))
    });
    found.map_err(|error| error.in_file(&opened.name))?;
    opened.input.rewind().map_err(|error| cut_short(error).in_file(&opened.name))
}

/// Checks the headers of an OpenEXR file with deep parts; leaves the position at the first byte.
///
/// # Errors
/// As [`check`].
pub(super) fn check_deep(opened: &mut Opened) -> Result<(), Error> {
    let found = scan(opened).map_err(cut_short).and_then(|RawHeader { version, parts, .. }| {
        if version != 2 {
            return Err(unknown_version(version));
        }
        parts.iter().try_for_each(|part| check_deep_part(part, opened.len))
    });
    found.map_err(|error| error.in_file(&opened.name))?;
    opened.input.rewind().map_err(|error| cut_short(error).in_file(&opened.name))
}

/// Whether `opened` is an OpenEXR file with a part that says that it is deep; leaves the position at the first byte.
///
/// # Errors
/// The file cannot be read. A damaged header is not deep.
pub(super) fn has_deep_part(opened: &mut Opened) -> Result<bool, Error> {
    if !opened.is_exr()? {
        return Ok(false);
    }
    let found = scan(opened).is_ok_and(|header| header.parts.iter().any(RawPart::is_deep));
    opened.input.rewind().map_err(|error| cut_short(error).in_file(&opened.name))?;
    Ok(found)
}

/// Half of the memory that this process may use.
pub(super) fn default_max_bytes() -> u64 {
    memory_limit_bytes() / 2
}

/// The error of a header that cannot be scanned: what of it is damaged, or that it ends early.
fn cut_short(cause: io::Error) -> Error {
    if cause.kind() == io::ErrorKind::InvalidData {
        return Error::input("the header is damaged").caused_by(cause).help("render or copy the file again");
    }
    Error::reading("the file is truncated within its header", cause).help("copy or render it again")
}

fn damaged(what: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what)
}

fn deep_data() -> Error {
    Error::unsupported("a file with deep samples is not a flat picture")
        .with("found", "deep samples (several fragments per pixel)")
        .help("give it as the stack, or flatten it to a picture and save that as a ZIP scanline OpenEXR")
}

pub(super) fn unknown_version(version: u32) -> Error {
    let found = format!("format version {version}");
    Error::unsupported("this is not an OpenEXR 2 file").with("found", found)
}

/// Reads the headers of all parts; leaves the position at the first byte after them.
///
/// # Errors
/// `UnexpectedEof` for a file that ends within its headers, `InvalidData` for what is no header, and those of the system.
pub(super) fn scan(opened: &mut Opened) -> io::Result<RawHeader> {
    let mut words = [0; 8];
    opened.input.read_exact(&mut words)?;
    let flags = u32::from_le_bytes([words[4], words[5], words[6], words[7]]);
    let mut parts = Vec::new();
    let multi_part = flags & (1 << 12) != 0;
    while let Some(part) = scan_part(opened)? {
        parts.push(part);
        if !multi_part {
            break;
        }
    }
    let deep = flags & (1 << 11) != 0;
    Ok(RawHeader {
        version: flags & 0xff,
        multi_part,
        tiled: flags & (1 << 9) != 0,
        deep: deep || parts.iter().any(RawPart::is_deep),
        parts,
    })
}

/// One part's header; `None` at the empty header that ends a multi-part list.
fn scan_part(opened: &mut Opened) -> io::Result<Option<RawPart>> {
    let mut part = RawPart::default();
    let mut empty = true;
    loop {
        let name = text(&mut opened.input)?;
        if name.is_empty() {
            return Ok(if empty { None } else { Some(part) });
        }
        empty = false;
        text(&mut opened.input)?;
        let mut size = [0; 4];
        opened.input.read_exact(&mut size)?;
        let size = i32::from_le_bytes(size);
        let size = u64::try_from(size)
            .map_err(|_| damaged(format!("the attribute {name} has a size of {size} bytes")))?;
        let position = opened.input.stream_position()?;
        if size > opened.len.saturating_sub(position) {
            let what = format!("the attribute {name} has {size} bytes, more than the rest of the file");
            return Err(io::Error::new(io::ErrorKind::UnexpectedEof, what));
        }
        let known = matches!(
            name.as_str(),
            "channels" | "chunkCount" | "compression" | "dataWindow" | "displayWindow" | "tiles" | "type"
        );
        if known && size <= MAX_VALUE_BYTES {
            let mut value = Vec::new();
            (&mut opened.input).take(size).read_to_end(&mut value)?;
            part.note(&name, &value).map_err(|_| damaged(format!("the value of the attribute {name}")))?;
        } else {
            opened.input.seek_relative(size as i64)?;
        }
    }
}

/// A null-terminated text.
fn text(input: &mut impl BufRead) -> io::Result<String> {
    let mut bytes = Vec::new();
    input.take(MAX_TEXT_BYTES).read_until(0, &mut bytes)?;
    let length = bytes.len() as u64;
    match bytes.pop() {
        Some(0) => Ok(String::from_utf8_lossy(&bytes).into_owned()),
        Some(_) if length == MAX_TEXT_BYTES => {
            Err(damaged(format!("the name of an attribute has more than {} characters", MAX_TEXT_BYTES - 2)))
        }
        _ => Err(io::ErrorKind::UnexpectedEof.into()),
    }
}

impl RawPart {
    fn note(&mut self, name: &str, mut value: &[u8]) -> io::Result<()> {
        match name {
            "compression" => self.compression = value.first().copied(),
            "type" => self.kind = Some(String::from_utf8_lossy(value).into_owned()),
            "dataWindow" => self.data_window = Some(corners(&mut value)?),
            "displayWindow" => self.display_window = Some(corners(&mut value)?),
            "chunkCount" => self.chunk_count = Some(read_u32(&mut value)?),
            "tiles" => {
                self.tile = Some([read_u32(&mut value)?, read_u32(&mut value)?]);
                self.level_mode = value.first().copied().unwrap_or(0);
            }
            _ => {
                self.channels.clear();
                while value.first().is_some_and(|&byte| byte != 0) {
                    let name = text(&mut value)?;
                    let sample_type = read_u32(&mut value)? as i32;
                    read_u32(&mut value)?;
                    let sampling = [read_u32(&mut value)? as i32, read_u32(&mut value)? as i32];
                    self.channels.push(RawChannel { name, sample_type, sampling });
                }
            }
        }
        Ok(())
    }

    fn is_deep(&self) -> bool {
        self.kind.as_deref().is_some_and(|kind| kind.starts_with("deep"))
    }

    fn bytes_per_pixel(&self) -> u64 {
        self.channels.iter().map(|channel| if channel.sample_type == 1 { 2 } else { 4 }).sum()
    }
}

fn read_u32(value: &mut &[u8]) -> io::Result<u32> {
    let mut bytes = [0; 4];
    value.read_exact(&mut bytes)?;
    Ok(u32::from_le_bytes(bytes))
}

fn corners(value: &mut &[u8]) -> io::Result<[i32; 4]> {
    let words = [read_u32(value)?, read_u32(value)?, read_u32(value)?, read_u32(value)?];
    Ok(words.map(|word| word as i32))
}

/// Rows per chunk and best compression ratio of a codec; `None` if it is not supported.
pub(super) fn codec(number: u8) -> Option<(u64, u64)> {
    Some(match number {
        0 => (1, 1),
        1 => (1, RLE_RATIO),
        2 => (1, DEFLATE_RATIO),
        3 | 5 => (16, DEFLATE_RATIO),
        4 => (32, DEFLATE_RATIO),
        6 | 7 => (32, RLE_RATIO),
        8 => (32, RLE_RATIO * DEFLATE_RATIO),
        9 => (256, RLE_RATIO * DEFLATE_RATIO),
        _ => return None,
    })
}

fn check_part(part: &RawPart, file_bytes: u64) -> Result<(), Error> {
    if let Some(channel) = part.channels.iter().find(|channel| channel.sampling != [1, 1]) {
        let [x, y] = channel.sampling;
        return Err(Error::unsupported("subsampled channels are not supported")
            .with("found", format!("channel {} with one sample per {x}×{y} pixels", channel.name))
            .help("save the picture as RGBA, or luminance and chroma with one sample a pixel"));
    }
    let number = part.compression.ok_or_else(|| missing("compression"))?;
    let (chunk_rows, ratio) = codec(number).ok_or_else(|| unknown_codec(number))?;
    let [width, height] = check_windows(part)?;
    let [chunks_x, chunks_y] = match part.tile {
        Some(tile) if part.kind.as_deref().is_none_or(|kind| kind.starts_with("tile")) => {
            tile_count(tile, [width, height])?
        }
        _ => [1, height.div_ceil(chunk_rows)],
    };
    let bytes = (width * height).saturating_mul(part.bytes_per_pixel());
    let chunk_bytes = (chunks_x * chunks_y).saturating_mul(MIN_CHUNK_BYTES);
    if bytes / ratio > file_bytes || chunk_bytes > file_bytes {
        return Err(Error::input("the header has more pixels than the file can contain")
            .with(
                "found",
                format!("{width}×{height} pixels, {} channels, in {file_bytes} bytes", part.channels.len()),
            )
            .help("the file is damaged or truncated: render or copy it again"));
    }
    Ok(())
}

/// Checks the sizes of a part that may be deep. A pixel of it has four bytes at least, that count its samples.
fn check_deep_part(part: &RawPart, file_bytes: u64) -> Result<(), Error> {
    let [width, height] = check_windows(part)?;
    let tile = part.tile.filter(|_| part.kind.as_deref().is_none_or(|kind| kind.ends_with("tile")));
    if let Some(tile) = tile {
        tile_count(tile, [width, height])?;
    }
    if !part.is_deep() {
        return Ok(());
    }
    if let Some(channel) = part.channels.iter().find(|channel| channel.sampling != [1, 1]) {
        return Err(Error::input("a deep channel is subsampled").with("found", channel.name.clone()));
    }
    if (width * height).saturating_mul(4) / DEFLATE_RATIO > file_bytes {
        return Err(Error::input("the header has more pixels than the file can contain")
            .with("found", format!("{width}×{height} deep pixels in {file_bytes} bytes"))
            .help("the file is damaged or truncated: render or copy it again"));
    }
    Ok(())
}

/// Width and height of the data window. Neither window is impossible.
fn check_windows(part: &RawPart) -> Result<[u64; 2], Error> {
    let [width, height] = window_size(part.data_window.ok_or_else(|| missing("dataWindow"))?, "data")?;
    let [display_width, display_height] =
        window_size(part.display_window.ok_or_else(|| missing("displayWindow"))?, "display")?;
    if display_width * display_height > (width * height).saturating_mul(MAX_DISPLAY_RATIO).max(1 << 26) {
        return Err(Error::input("the display window is too large for the data window")
            .with(
                "found",
                format!("data window of {width}×{height} pixels, display window of {display_width}×{display_height}"),
            )
            .help(DAMAGED));
    }
    Ok([width, height])
}

/// The numbers of tiles beside and below one another.
fn tile_count(tile: [u32; 2], [width, height]: [u64; 2]) -> Result<[u64; 2], Error> {
    if tile.iter().any(|&side| side == 0 || side > MAX_TILE_SIZE) {
        let found = format!("{}×{} pixels", tile[0], tile[1]);
        return Err(Error::input("the tile size is invalid").with("found", found));
    }
    Ok([width.div_ceil(u64::from(tile[0])), height.div_ceil(u64::from(tile[1]))])
}

/// Width and height of the window between two inclusive corners. Their product fits into 64 bits.
pub(super) fn window_size(corners: [i32; 4], which: &str) -> Result<[u64; 2], Error> {
    let [x0, y0, x1, y1] = corners.map(i64::from);
    if corners.iter().any(|c| i64::from(*c).abs() >= COORDINATE_LIMIT) || x1 < x0 || y1 < y0 {
        return Err(Error::input(format!("the {which} window is invalid"))
            .with("found", format!("({x0}, {y0}) to ({x1}, {y1})"))
            .help(DAMAGED));
    }
    Ok([(x1 - x0 + 1) as u64, (y1 - y0 + 1) as u64])
}

pub(super) fn missing(attribute: &str) -> Error {
    Error::input(format!("the header has no {attribute}"))
        .help("the file is damaged: render or copy it again")
}

pub(super) fn unknown_codec(number: u8) -> Error {
    let found = match number {
        10 | 11 => "HTJ2K".to_owned(),
        12 => "ZSTD".to_owned(),
        _ => format!("codec number {number}"),
    };
    Error::unsupported("this compression is not supported")
        .with("found", found)
        .with("expected", "none, RLE, ZIPS, ZIP, PIZ, PXR24, B44, B44A, DWAA, DWAB")
        .help("save the file again with ZIP (scanline) compression")
}
