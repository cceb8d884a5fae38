//! What is to be read, and how.

use crate::settings::DepthConvention;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Which channels of the input travel to the output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Carry {
    /// Those that no peel uses.
    #[default]
    Unused,
    /// All, the peels included.
    All,
    /// None.
    None,
}

/// What the caller knows better than the files.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReadOptions {
    /// How depth is written; detected when `None`.
    pub convention: Option<DepthConvention>,
    /// Samples a picture pixel along each axis; from the header, else 1, when `None`.
    pub supersample: Option<usize>,
    /// Name of the colour channel group (`Combined`, `peel0` …), when the naming table does not know it.
    pub color_channel: Option<String>,
    /// Name of the depth channel, when the naming table does not know it.
    pub depth_channel: Option<String>,
    /// A file that holds the depth of a colour picture without any.
    pub depth_file: Option<PathBuf>,
    /// Which channels travel to the output.
    pub carry: Carry,
    /// Whether the channels of cryptomattes are kept beside those that travel: [`super::Stack::object`] looks into them.
    pub objects: bool,
    /// Refuse inputs that would take more than this many bytes once decoded; half the machine's memory when `None`.
    pub max_bytes: Option<u64>,
}

/// Where the bytes come from.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Source {
    /// A file.
    File(PathBuf),
    /// The content of a file, in memory.
    Memory {
        /// The name to show.
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

    /// The path or name to show.
    pub(super) fn name(&self) -> &Path {
        match self {
            Self::File(path) => path,
            Self::Memory { name, .. } => Path::new(name),
        }
    }
}
