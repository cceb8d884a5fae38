//! Reading: from paths to a [`Stack`].

use super::Stack;
use crate::error::Error;
use crate::image::Image;
use crate::settings::DepthConvention;
use std::path::{Path, PathBuf};

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
    /// Refuse inputs that would take more than this many bytes once decoded; half the machine's memory when `None`.
    pub max_bytes: Option<u64>,
}

/// Where the bytes come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Source {
    /// A file.
    File(PathBuf),
    /// A file embedded in the program.
    Embedded {
        /// The name to show.
        name: &'static str,
        /// Its content.
        bytes: &'static [u8],
    },
}

/// Reads one stack from `sources`: one multi-layer or multi-part EXR, one file a peel nearest first, or one picture with
/// its depth.
///
/// # Errors
/// What is missing or wrong, where, and how to name it by flag.
pub fn read(sources: &[Source], options: &ReadOptions) -> Result<Stack, Error> {
    let _ = (sources, options);
    Err(Error::unsupported("reading is not written yet"))
}

/// Reads the main picture of a file of any known format, scene-linear: what `score` compares.
///
/// # Errors
/// As [`read`].
pub fn read_picture(path: &Path) -> Result<Image, Error> {
    let _ = path;
    Err(Error::unsupported("reading is not written yet"))
}
