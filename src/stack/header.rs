//! An OpenEXR file with a parsed and checked header, before any pixel is read.

use super::input::{Input, Opened};
use super::{Frame, Source, Window, attributes, guard};
use crate::error::Error;
use crate::finding::Finding;
use exr::meta::MetaData;
use exr::meta::attribute::{AttributeValue, IntegerBounds, SampleType, Text};
use exr::meta::header::Header;
use std::collections::BTreeSet;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// One channel of a file.
#[derive(Debug, Clone)]
pub(super) struct Channel {
    /// Full name: dotted prefix and, in files of several parts, the part's name; without that of the view that is read.
    pub(super) name: String,
    /// The same with the view's.
    pub(super) stored_name: String,
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
    /// What was concluded of the file as a whole.
    pub(super) findings: Vec<Finding>,
    /// The rows to read, by their `y`; all if `None`.
    pub(super) rows: Option<Range<i32>>,
}

impl ExrFile {
    /// Reads and checks the header.
    ///
    /// # Errors
    /// Those of [`guard::check`], and headers that the EXR library rejects.
    pub(super) fn open(mut opened: Opened) -> Result<Self, Error> {
        guard::check(&mut opened)?;
        let contradiction = contradicts_its_type(&mut opened)?;
        let Opened { name, len, mut input } = opened;
        let fail = |error| decoder_error("the OpenEXR header cannot be read", error).in_file(&name);
        let meta_data = match contradiction {
            Some(header_bytes) => without_type(&mut input, header_bytes),
            None => MetaData::read_from_buffered(input.by_ref(), false),
        };
        let meta_data = meta_data.map_err(fail)?;
        MetaData::validate(&meta_data.headers, false).map_err(fail)?;
        let channels = list_channels(&meta_data.headers);
        Ok(Self { name, input, len, meta_data, channels, findings: Vec::new(), rows: None })
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
        Ok(Self { name, input, len, meta_data, channels, findings: Vec::new(), rows: None })
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

    /// Whether it is a file on disk, which may have others beside it.
    pub(super) fn is_on_disk(&self) -> bool {
        matches!(self.input, Input::File(_))
    }

    /// The header of part `part`.
    pub(super) fn header(&self, part: usize) -> &Header {
        &self.meta_data.headers[part]
    }

    /// The name that the channel or group which is stored as `stored` has without its view; `stored` if there is none.
    pub(super) fn name_without_view(&self, stored: &str) -> String {
        let group = |name: &str| name.rsplit_once('.').map(|(group, _)| group.to_owned());
        let channel = self.channels.iter().find(|channel| channel.stored_name == stored);
        let of_group =
            || self.channels.iter().find(|channel| group(&channel.stored_name).as_deref() == Some(stored));
        let named = channel.map(|channel| channel.name.clone());
        named
            .or_else(|| of_group().map(|channel| group(&channel.name).unwrap_or_default()))
            .unwrap_or_else(|| stored.to_owned())
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

    /// The attributes of the parts that have channels, known and unknown; of several with one name the first part's.
    pub(super) fn attributes(&self) -> Vec<(Text, AttributeValue)> {
        let mut all: Vec<(Text, AttributeValue)> = Vec::new();
        let mut names = BTreeSet::new();
        let is_used = |part: &usize| self.channels.iter().any(|channel| channel.part == *part);
        for part in (0..self.meta_data.headers.len()).filter(is_used) {
            for (name, value) in self.header(part).all_named_attributes() {
                if names.insert(name.to_vec()) {
                    all.push((Text::from_slice_unchecked(name), value));
                }
            }
        }
        all
    }
}

/// Name of the attribute that says whether a part has scan lines or tiles.
const TYPE: &[u8] = b"type\0string\0";
/// The same under a name that says nothing.
const NO_TYPE: &[u8] = b"typ_\0string\0";

/// The bytes of a header whose only part has an unknown type, or not that of the file's flags, which count in files of one part.
fn contradicts_its_type(opened: &mut Opened) -> Result<Option<u64>, Error> {
    let found = guard::scan(opened).and_then(|raw| {
        let end = opened.input.stream_position()?;
        opened.input.rewind()?;
        Ok((raw, end))
    });
    let (raw, end) =
        found.map_err(|error| Error::reading("the header cannot be read", error).in_file(&opened.name))?;
    let expected = if raw.tiled { "tiledimage" } else { "scanlineimage" };
    let kind = raw.parts.first().and_then(|part| part.kind.as_deref());
    let contradicts = kind.is_some_and(|kind| kind.trim_end_matches('\0') != expected);
    Ok((!raw.multi_part && !raw.deep && contradicts).then_some(end))
}

/// The headers of a file of one part as if it had no type; leaves the position behind them.
fn without_type(input: &mut Input, header_bytes: u64) -> exr::error::Result<MetaData> {
    let mut bytes = Vec::new();
    input.take(header_bytes).read_to_end(&mut bytes)?;
    if let Some(at) = bytes.windows(TYPE.len()).position(|window| window == TYPE) {
        bytes[at..at + NO_TYPE.len()].copy_from_slice(NO_TYPE);
    }
    let mut meta_data = MetaData::read_from_buffered(bytes.as_slice(), false)?;
    for header in &mut meta_data.headers {
        header.own_attributes.other.retain(|name, _| !name.eq("typ_"));
    }
    Ok(meta_data)
}

/// The text of attribute `name` in the header of the OpenEXR file at `path`, which has one part of scan lines; `None` without it, where no
/// such file can be read, and for one that ends before or after its last block.
pub(crate) fn header_text(path: &Path, name: &str) -> Option<String> {
    let mut file = ExrFile::open(Opened::open(&Source::file(path)).ok()?).ok()?;
    let text = attributes::text(&file.attributes(), name)?;
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
            channels.push(Channel {
                stored_name: name.clone(),
                name,
                part,
                index,
                sample_type,
                quantize_linearly,
            });
        }
    }
    channels
}
