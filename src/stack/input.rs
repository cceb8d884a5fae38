//! Input bytes: a file on disk or one embedded in the program.

use super::Source;
use crate::error::Error;
use std::fs::File;
use std::io::{self, BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The first bytes of every OpenEXR file.
const EXR_MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

/// Whether a file that starts with `head` is in a format that can be read.
pub(super) fn is_known_format(head: &[u8]) -> bool {
    head.starts_with(&EXR_MAGIC) || image::guess_format(head).is_ok()
}

/// A seekable byte stream.
#[derive(Debug)]
pub(super) enum Input {
    /// A file.
    File(BufReader<File>),
    /// Memory.
    Memory(Cursor<Arc<[u8]>>),
}

/// An opened source, positioned at its first byte.
#[derive(Debug)]
pub(super) struct Opened {
    /// The path or name for messages.
    pub(super) name: PathBuf,
    /// Length in bytes.
    pub(super) len: u64,
    /// The bytes.
    pub(super) input: Input,
}

impl Read for Input {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::File(file) => file.read(buffer),
            Self::Memory(memory) => memory.read(buffer),
        }
    }
}

impl io::BufRead for Input {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        match self {
            Self::File(file) => file.fill_buf(),
            Self::Memory(memory) => memory.fill_buf(),
        }
    }

    fn consume(&mut self, count: usize) {
        match self {
            Self::File(file) => file.consume(count),
            Self::Memory(memory) => memory.consume(count),
        }
    }
}

impl Seek for Input {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match self {
            Self::File(file) => file.seek(to),
            Self::Memory(memory) => memory.seek(to),
        }
    }

    // A file keeps its buffer over these two, as it does not over `seek`.
    fn seek_relative(&mut self, distance: i64) -> io::Result<()> {
        match self {
            Self::File(file) => file.seek_relative(distance),
            Self::Memory(memory) => memory.seek_relative(distance),
        }
    }

    fn stream_position(&mut self) -> io::Result<u64> {
        match self {
            Self::File(file) => file.stream_position(),
            Self::Memory(memory) => memory.stream_position(),
        }
    }
}

impl Opened {
    /// Opens `source`, which may be empty.
    ///
    /// # Errors
    /// A missing file, a folder, no permission.
    pub(super) fn open_even_empty(source: &Source) -> Result<Self, Error> {
        match source {
            Source::File(path) => open_file(path),
            Source::Memory { name, bytes } => Ok(Self {
                name: PathBuf::from(name),
                len: bytes.len() as u64,
                input: Input::Memory(Cursor::new(Arc::clone(bytes))),
            }),
        }
    }

    /// Opens `source`.
    ///
    /// # Errors
    /// As [`Opened::open_even_empty`], and an empty file.
    pub(super) fn open(source: &Source) -> Result<Self, Error> {
        let opened = Self::open_even_empty(source)?;
        if opened.len == 0 {
            let help = "the program that wrote it may have failed or may still be writing: render it again";
            return Err(Error::input("the file is empty").in_file(&opened.name).help(help));
        }
        Ok(opened)
    }

    /// Whether the file starts with the OpenEXR magic number; leaves the position at the first byte.
    ///
    /// # Errors
    /// The file cannot be read.
    pub(super) fn is_exr(&mut self) -> Result<bool, Error> {
        Ok(self.first_bytes()?.starts_with(&EXR_MAGIC))
    }

    /// Up to 16 bytes from the start; leaves the position at the first byte.
    ///
    /// # Errors
    /// The file cannot be read.
    pub(super) fn first_bytes(&mut self) -> Result<Vec<u8>, Error> {
        let mut head = Vec::new();
        let result = (&mut self.input).take(16).read_to_end(&mut head).and_then(|_| self.input.rewind());
        match result {
            Ok(()) => Ok(head),
            Err(error) => Err(Error::reading("the file cannot be read", error).in_file(&self.name)),
        }
    }
}

fn open_file(path: &Path) -> Result<Opened, Error> {
    let fail = |what: &str, error: io::Error| Error::reading(what, error).in_file(path);
    let file = File::open(path).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => fail("no such file", error),
        io::ErrorKind::PermissionDenied => fail("no permission to read the file", error),
        _ => fail("the file cannot be opened", error),
    })?;
    let metadata = file.metadata().map_err(|error| fail("the file cannot be read", error))?;
    if metadata.is_dir() {
        let help = "name the picture files in it";
        return Err(Error::input("this is a folder, not a picture").in_file(path).help(help));
    }
    if !metadata.is_file() {
        let help = "a pipe or device can be read only once, and this input is read again: save the picture to a file";
        return Err(Error::input("this is not a regular file").in_file(path).help(help));
    }
    Ok(Opened {
        name: path.to_owned(),
        len: metadata.len(),
        input: Input::File(BufReader::with_capacity(1 << 16, file)),
    })
}
