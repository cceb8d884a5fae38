//! Inputs that can be read only once: standard input, pipes and devices. They are read into memory, from where they can be read again.

use super::Source;
use super::input::is_known_format;
use crate::error::Error;
use crate::memory::shown_bytes;
use std::fs::File;
use std::io::{self, IsTerminal, Read};
use std::path::{Path, PathBuf};

/// The name of standard input among the names of files.
pub const STDIN: &str = "-";

/// How standard input is called in messages.
const STDIN_NAME: &str = "standard input";

/// Bytes of the head of an input, by which its format is known.
const HEAD_BYTES: u64 = 64;

/// The contents of inputs that can be read only once, by the names that the user gave them.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Held {
    inputs: Vec<(PathBuf, Source)>,
}

impl Held {
    /// Reads the input at `path` into memory, at most `max_bytes` of it, if it can be read only once: `-`, which is standard input, a
    /// pipe (as of a process substitution) or a device. Of an input in an unknown format only the head is read.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Settings`] for an input that is named twice and a standard input that is a terminal,
    /// [`crate::error::ErrorKind::Input`] for an empty one, [`crate::error::ErrorKind::Limits`] for one of more than `max_bytes`, and those
    /// of the system.
    pub fn hold(&mut self, path: &Path, max_bytes: u64) -> Result<(), Error> {
        if !is_read_once(path) {
            return Ok(());
        }
        if self.inputs.iter().any(|(held, _)| held == path) {
            return Err(Error::settings(format!("{} is named twice as an input", name_of(path)))
                .help("it can be read only once: save the picture to a file"));
        }
        let bytes = if path == Path::new(STDIN) {
            let stdin = io::stdin();
            if stdin.is_terminal() {
                return Err(Error::settings("standard input is a terminal, not a picture")
                    .help("send a picture to it: cat stack.exr | thinlens …, or name a file"));
            }
            read(path, &mut stdin.lock(), max_bytes)?
        } else {
            let mut file = File::open(path).map_err(|error| unreadable(path, error))?;
            read(path, &mut file, max_bytes)?
        };
        self.inputs.push((path.to_owned(), Source::memory(name_of(path), bytes)));
        Ok(())
    }

    /// The source of the input that the user called `path`: its content if it is held, else the file.
    pub fn source(&self, path: &Path) -> Source {
        let held = self.inputs.iter().find(|(held, _)| held == path);
        held.map_or_else(|| Source::file(path), |(_, source)| source.clone())
    }

    /// The size of all contents in bytes.
    pub fn bytes(&self) -> u64 {
        let sizes = self.inputs.iter().map(|(_, source)| match source {
            Source::Memory { bytes, .. } => bytes.len() as u64,
            Source::File(_) => 0,
        });
        sizes.sum()
    }
}

/// Whether the input at `path` can be read only once.
pub fn is_read_once(path: &Path) -> bool {
    // A file that does not exist or may not be examined is left to its reader.
    path == Path::new(STDIN)
        || path.metadata().is_ok_and(|metadata| !metadata.is_file() && !metadata.is_dir())
}

/// How the input at `path` is called in messages.
fn name_of(path: &Path) -> String {
    if path == Path::new(STDIN) { STDIN_NAME.to_owned() } else { path.display().to_string() }
}

fn unreadable(path: &Path, cause: io::Error) -> Error {
    let error = Error::reading("the input cannot be read", cause).in_file(Path::new(&name_of(path)));
    error.help("if it is a pipe, the program before it may have failed")
}

fn read(path: &Path, input: &mut dyn Read, max_bytes: u64) -> Result<Vec<u8>, Error> {
    let fail = |error| unreadable(path, error);
    let mut bytes = Vec::new();
    input.take(HEAD_BYTES).read_to_end(&mut bytes).map_err(fail)?;
    if bytes.is_empty() {
        return Err(Error::input(format!("{} is empty", name_of(path)))
            .help("the program that should have written the picture may have failed"));
    }
    if !is_known_format(&bytes) {
        return Ok(bytes);
    }
    let left = max_bytes.saturating_sub(bytes.len() as u64);
    let more = input.take(left.saturating_add(1)).read_to_end(&mut bytes).map_err(fail)?;
    if more as u64 > left {
        return Err(Error::limits("the input requires more memory than the limit")
            .in_file(Path::new(&name_of(path)))
            .with("found", format!("more than {}", shown_bytes(max_bytes)))
            .help("save it to a file, which is not kept in memory, or allow more with `memory`"));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MIB: u64 = 1 << 20;

    fn exr(bytes: usize) -> Vec<u8> {
        let mut content = vec![7; bytes];
        content[..4].copy_from_slice(&[0x76, 0x2f, 0x31, 0x01]);
        content
    }

    #[test]
    fn an_input_is_held_up_to_the_limit() {
        let held = |size: usize, limit: u64| read(Path::new("pipe"), &mut exr(size).as_slice(), limit);
        assert_eq!(held(1000, 1000).unwrap().len(), 1000);
        let error = held(1001, 1000).unwrap_err();
        assert!(error.to_string().contains("more memory than the limit\n  in: pipe"), "{error}");
        assert_eq!(held(20, 1000).unwrap(), exr(20), "an input that ends within its head");
    }

    #[test]
    fn of_an_unknown_format_the_head_is_enough_and_an_empty_input_is_refused() {
        let endless = read(Path::new("/dev/zero"), &mut io::repeat(0), MIB).unwrap();
        assert_eq!(endless.len() as u64, HEAD_BYTES);
        let error = read(Path::new(STDIN), &mut io::empty(), MIB).unwrap_err();
        assert!(error.to_string().starts_with("standard input is empty\n  help:"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn a_pipe_is_held_and_a_file_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file.exr");
        std::fs::write(&file, exr(100)).unwrap();
        let mut held = Held::default();
        held.hold(&file, MIB).unwrap();
        assert_eq!((held.source(&file), held.bytes()), (Source::file(&file), 0));
        assert!(is_read_once(Path::new("/dev/null")) && is_read_once(Path::new("-")));
        assert!(!is_read_once(folder.path()) && !is_read_once(Path::new("no/such")));
        let error = held.hold(Path::new("/dev/null"), MIB).unwrap_err();
        assert!(error.to_string().contains("/dev/null is empty"), "{error}");
    }
}
