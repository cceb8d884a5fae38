//! EXR: the picture as `R G B A` at the root, with channels and attributes copied from the input.
//!
//! The EXR library encodes attributes, and blocks of codecs other than ZIP and ZIPS. The file itself is written here, so that
//! blocks are compressed in the caller's thread pool (the library creates a pool at every call) and equal
//! pictures give equal files. Cost: the compression.

mod blocks;
mod channels;
mod codec;
mod header;

pub use codec::Codec;

use super::atomic;
use crate::error::Error;
use crate::finding::Finding;
use crate::image::Image;
use crate::stack::{Carried, Frame, Precision, Window};
use blocks::Blocks;
use channels::Channel;
use exr::meta::header::Header;
use std::path::Path;

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
    let (header, attributes) = head(path, (frame, &channels), carried, options, &mut findings)?;
    atomic::write(path, |target| {
        let written = header::write(target, &attributes).and_then(|()| {
            let mut blocks = Blocks::begin(target, &header)?;
            blocks.write(target, &channels, height)?;
            blocks.end(target)
        });
        written.map_err(|error| encoding_error(path, error))
    })?;
    Ok(findings)
}

/// Some rows of a picture, and of the channels carried with it.
#[derive(Debug)]
pub struct Rows {
    /// The rows, as wide as the picture.
    pub image: Image,
    /// Channels of the same rows; the attributes of the first rows are those of the file.
    pub carried: Carried,
}

/// Writes a picture with this `frame` as [`write()`] does, from its rows: `next` gives those that follow, from the top on, and `None` after the
/// last. The file has the bytes that [`write()`] would have written, and appears whole or not at all; only the rows of one call are in memory.
///
/// All but the last have a number of rows that [`Codec::block_rows`] divides.
///
/// # Errors
/// Those of `next` and of [`write()`]; rows of another width, or too few or too many of them.
pub fn write_rows(
    path: &Path,
    frame: &Frame,
    options: &ExrOptions,
    mut next: impl FnMut() -> Result<Option<Rows>, Error>,
) -> Result<Vec<Finding>, Error> {
    let mut findings = Vec::new();
    let Some(mut rows) = next()? else { return Err(wrong_rows(path, frame, 0)) };
    let channels = collect(&rows, frame, options, &mut findings);
    let (header, attributes) = head(path, (frame, &channels), &rows.carried, options, &mut findings)?;
    drop(channels);
    atomic::write(path, |target| {
        let failed = |error| encoding_error(path, error);
        header::write(target, &attributes).map_err(failed)?;
        let mut blocks = Blocks::begin(target, &header).map_err(failed)?;
        loop {
            let (width, height) = (rows.image.width(), rows.image.height());
            if width != frame.data.width || !blocks.has_room_for(height) {
                return Err(wrong_rows(path, frame, blocks.rows() + height));
            }
            let channels = collect(&rows, frame, options, &mut Vec::new());
            blocks.write(target, &channels, height).map_err(failed)?;
            match next()? {
                Some(more) => rows = more,
                None if blocks.rows() == frame.data.height => return blocks.end(target).map_err(failed),
                None => return Err(wrong_rows(path, frame, blocks.rows())),
            }
        }
    })?;
    Ok(findings)
}

/// The channels of `rows` of a picture with this `frame`.
fn collect<'a>(
    rows: &'a Rows,
    frame: &Frame,
    options: &ExrOptions,
    findings: &mut Vec<Finding>,
) -> Vec<Channel<'a>> {
    let data = Window { height: rows.image.height(), ..frame.data };
    channels::collect(&rows.image, &Frame { data, ..*frame }, &rows.carried, options.precision, findings)
}

fn wrong_rows(path: &Path, frame: &Frame, rows: usize) -> Error {
    Error::output("the rows are not those of the picture")
        .in_file(path)
        .with(
            "expected",
            format!("{} rows of {} pixels, in whole blocks", frame.data.height, frame.data.width),
        )
        .with("found", format!("{rows} rows"))
}

/// The header of a file with these channels, for compressing blocks and for writing.
fn head(
    path: &Path,
    (frame, channels): (&Frame, &[Channel<'_>]),
    carried: &Carried,
    options: &ExrOptions,
    findings: &mut Vec<Finding>,
) -> Result<(Header, header::Attributes), Error> {
    let header = header::describe(frame, channels, options.codec.compression());
    let attributes = header::attributes(&header, carried, findings);
    header.validate(false, &mut false, true).map_err(|error| encoding_error(path, error))?;
    Ok((header, attributes))
}

fn encoding_error(path: &Path, error: exr::error::Error) -> Error {
    match error {
        exr::error::Error::Io(error) => atomic::failed(path, error),
        other => Error::unsupported("the picture cannot be written as EXR").in_file(path).caused_by(other),
    }
}
