//! An OpenEXR file with a parsed and checked header, before any pixel is read.

use super::input::{Input, Opened};
use super::{Frame, Source, Window, camera, guard};
use crate::error::Error;
use exr::meta::MetaData;
use exr::meta::attribute::{AttributeValue, IntegerBounds, SampleType, Text};
use exr::meta::header::Header;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// One channel of a file.
#[derive(Debug, Clone)]
pub(super) struct Channel {
    /// Full name: dotted prefix and, in files of several parts, the part's name.
    pub(super) name: String,
    /// Index of its part.
    pub(super) part: usize,
    /// Its index in the part's channel list.
    pub(super) index: usize,
    /// Its numeric type.
    pub(super) sample_type: SampleType,
    /// See [`super::CarriedChannel::quantize_linearly`].
    pub(super) quantize_linearly: bool,
}

/// A file with its header read.
#[derive(Debug)]
pub(super) struct ExrFile {
    /// The path or name for messages.
    pub(super) name: PathBuf,
    /// Positioned at the first byte after the headers.
    pub(super) input: Input,
    /// Length of the file in bytes.
    pub(super) len: u64,
    /// The headers.
    pub(super) meta_data: MetaData,
    /// The channels of all parts.
    pub(super) channels: Vec<Channel>,
    /// The rows to read, by their `y`; all if `None`.
    rows: Option<Range<i32>>,
}

impl ExrFile {
    /// Reads and checks the header.
    ///
    /// # Errors
    /// Those of [`guard::check`], and headers that the EXR library rejects.
    pub(super) fn open(mut opened: Opened) -> Result<Self, Error> {
        guard::check(&mut opened)?;
        let Opened { name, len, mut input } = opened;
        let fail = |error| decoder_error("the OpenEXR header cannot be read", error).in_file(&name);
        let meta_data = MetaData::read_from_buffered(input.by_ref(), false).map_err(fail)?;
        MetaData::validate(&meta_data.headers, false).map_err(fail)?;
        let channels = list_channels(&meta_data.headers);
        Ok(Self { name, input, len, meta_data, channels, rows: None })
    }

    /// Reads and checks the header of a file with deep parts.
    ///
    /// # Errors
    /// Those of [`guard::check_deep`], and headers that the EXR library rejects.
    pub(super) fn open_deep(mut opened: Opened) -> Result<Self, Error> {
        guard::check_deep(&mut opened)?;
        let Opened { name, len, mut input } = opened;
        let fail = |error| decoder_error("the OpenEXR header cannot be read", error).in_file(&name);
        // The library's own checks refuse everything deep.
        let meta_data = MetaData::read_from_buffered(input.by_ref(), false).map_err(fail)?;
        let channels = list_channels(&meta_data.headers);
        Ok(Self { name, input, len, meta_data, channels, rows: None })
    }

    /// The file as if its data windows ended at `rows`, by their `y`; the whole file if `None`.
    #[must_use]
    pub(super) fn cropped(self, rows: Option<Range<i32>>) -> Self {
        Self { rows, ..self }
    }

    /// The rows of part `part` that are read, counted from the top of its data window.
    pub(super) fn rows(&self, part: usize) -> Range<usize> {
        let stored = window(self.header(part).data_window());
        let place = |y: i32| (i64::from(y) - i64::from(stored.y)).clamp(0, stored.height as i64) as usize;
        self.rows
            .as_ref()
            .map_or(0..stored.height, |rows| place(rows.start)..place(rows.end).max(place(rows.start)))
    }

    /// The header of part `part`.
    pub(super) fn header(&self, part: usize) -> &Header {
        &self.meta_data.headers[part]
    }

    /// The channels' full names.
    pub(super) fn names(&self) -> Vec<&str> {
        self.channels.iter().map(|channel| channel.name.as_str()).collect()
    }

    /// The data window of part `part`, whatever rows are read.
    pub(super) fn whole_window(&self, part: usize) -> Window {
        window(self.header(part).data_window())
    }

    /// The window of the pixels that are read of part `part`: its data window, or the rows of it.
    fn data_window(&self, part: usize) -> Window {
        let (stored, rows) = (window(self.header(part).data_window()), self.rows(part));
        // Coordinates are below 2^30 (see `guard`).
        Window { y: stored.y + rows.start as i32, height: rows.len(), ..stored }
    }

    /// Data window, display window and pixel aspect of part `part`.
    pub(super) fn frame(&self, part: usize) -> Frame {
        let shared = &self.header(part).shared_attributes;
        Frame {
            data: self.data_window(part),
            display: window(shared.display_window),
            pixel_aspect: shared.pixel_aspect,
        }
    }

    /// The custom attributes of all parts.
    pub(super) fn attributes_of_all_parts(&self) -> impl Iterator<Item = (Text, &AttributeValue)> {
        let others = self.meta_data.headers.iter().flat_map(|header| &header.own_attributes.other);
        others.map(|(name, value)| (name.clone(), value))
    }

    /// The position after the last block, from the table of blocks. The file has one part of scan lines.
    fn end_of_blocks(&mut self) -> io::Result<u64> {
        let mut last = 0;
        for _ in 0..self.header(0).chunk_count {
            let mut offset = [0; 8];
            self.input.read_exact(&mut offset)?;
            let offset = u64::from_le_bytes(offset);
            if offset == 0 {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            last = last.max(offset);
        }
        // Each block starts with its first row and its size in bytes.
        self.input.seek(SeekFrom::Start(last.saturating_add(4)))?;
        let mut size = [0; 4];
        self.input.read_exact(&mut size)?;
        Ok(last.saturating_add(8).saturating_add(u64::from(u32::from_le_bytes(size))))
    }

    /// The attributes of the first part, known and unknown.
    pub(super) fn attributes(&self) -> Vec<(Text, AttributeValue)> {
        let named = self.header(0).all_named_attributes();
        named.map(|(name, value)| (Text::from_slice_unchecked(name), value)).collect()
    }
}

/// The text of attribute `name` in the header of the OpenEXR file at `path`, which has one part of scan lines; `None` without it, where no
/// such file can be read, and for one that ends before or after its last block.
pub(crate) fn header_text(path: &Path, name: &str) -> Option<String> {
    let mut file = ExrFile::open(Opened::open(&Source::file(path)).ok()?).ok()?;
    let text = camera::text(&file.attributes(), name)?;
    (file.end_of_blocks().ok()? == file.len).then_some(text)
}

/// The EXR library's error as an error of this library.
pub(super) fn decoder_error(what: &str, error: exr::error::Error) -> Error {
    match error {
        exr::error::Error::NotSupported(_) => {
            Error::unsupported(what).caused_by(error).help("save the file again as a ZIP scanline OpenEXR")
        }
        exr::error::Error::Io(error) => Error::reading(what, error)
            .help("the file is truncated, or the disk failed: render or copy the file again"),
        _ => Error::input(what)
            .caused_by(error)
            .help("the file is damaged or truncated: render or copy it again"),
    }
}

fn window(bounds: IntegerBounds) -> Window {
    Window {
        x: bounds.position.x(),
        y: bounds.position.y(),
        width: bounds.size.width(),
        height: bounds.size.height(),
    }
}

fn list_channels(headers: &[Header]) -> Vec<Channel> {
    let mut channels = Vec::new();
    for (part, header) in headers.iter().enumerate() {
        let part_name = header.own_attributes.layer_name.as_ref().filter(|_| headers.len() > 1);
        let prefix = part_name.map(|name| format!("{name}.")).filter(|prefix| prefix.len() > 1);
        for (index, channel) in header.channels.list.iter().enumerate() {
            let own = channel.name.to_string();
            let name = match &prefix {
                Some(prefix) if !own.starts_with(prefix.as_str()) => format!("{prefix}{own}"),
                _ => own,
            };
            let (sample_type, quantize_linearly) = (channel.sample_type, channel.quantize_linearly);
            channels.push(Channel { name, part, index, sample_type, quantize_linearly });
        }
    }
    channels
}
