//! An input file: a path, or bytes with a name.

use std::path::{Path, PathBuf};
use std::sync::Arc;

/// An input file.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Source {
    /// A file on disk.
    File(PathBuf),
    /// The content of a file, in memory.
    Memory {
        /// The name for messages.
        name: String,
        /// The file's bytes.
        bytes: Arc<[u8]>,
    },
}

impl Source {
    /// The file at `path`.
    pub fn file(path: impl Into<PathBuf>) -> Self {
        Self::File(path.into())
    }

    /// The bytes of a file, called `name` in messages.
    pub fn memory(name: impl Into<String>, bytes: impl Into<Arc<[u8]>>) -> Self {
        Self::Memory { name: name.into(), bytes: bytes.into() }
    }

    /// The name without folders.
    pub(crate) fn base_name(&self) -> String {
        let name = self.name();
        name.file_name().unwrap_or(name.as_os_str()).to_string_lossy().into_owned()
    }

    /// The path or name, as text.
    pub fn shown(&self) -> String {
        self.name().display().to_string()
    }

    /// The path or name to show.
    pub(super) fn name(&self) -> &Path {
        match self {
            Self::File(path) => path,
            Self::Memory { name, .. } => Path::new(name),
        }
    }
}
