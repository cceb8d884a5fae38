//! Options of reading.

use super::Held;
use crate::settings::{AlphaMode, DepthConvention, StackKind};
use std::ops::Range;
use std::path::PathBuf;

/// Which channels of the input are copied to the output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Carry {
    /// Channels that no peel uses.
    #[default]
    Unused,
    /// All channels, those of the peels included.
    All,
    /// No channels.
    None,
}

/// Options that override what the files state, and limits.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReadOptions {
    /// The depth convention; detected if `None`.
    pub convention: Option<DepthConvention>,
    /// Samples per picture pixel along each axis; if `None`, from the header, else 1.
    pub supersample: Option<usize>,
    /// What the samples of the stack are; if `None`, from the header, else from the edges around each pixel.
    pub kind: Option<StackKind>,
    /// Planar distance of normalised depth 0; if `None`, from the header. Together with `far` it says whether depth 0 or depth 1 is near.
    pub near: Option<f32>,
    /// Planar distance of normalised depth 1; if `None`, from the header.
    pub far: Option<f32>,
    /// How the colours are combined with alpha; if `None`, as the format has it: straight in integer pictures, else premultiplied.
    pub alpha: Option<AlphaMode>,
    /// Name of the colour channel group (`Combined`, `peel0` …), if the naming table does not have it.
    pub color_channel: Option<String>,
    /// Name of the depth channel, if the naming table does not have it.
    pub depth_channel: Option<String>,
    /// The view of a stereo file that is read, by its name; `None` for a file of one view.
    pub view: Option<String>,
    /// A file with the depth of the colour picture.
    pub depth_file: Option<PathBuf>,
    /// The renderer's own anti-aliased picture of a point-sampled stack: peel 0 takes its colour.
    pub beauty: Option<PathBuf>,
    /// A stack, a picture with depth or deep samples that hide what is behind them and are not seen.
    pub holdout: Option<PathBuf>,
    /// Whether the files are elements of one picture, whose fragments are merged by depth, and not its peels. Several files with deep
    /// samples always are.
    pub merge: bool,
    /// Which channels are copied to the output.
    pub carry: Carry,
    /// Whether the channels of cryptomattes are read as well, as [`super::Stack::object`] requires.
    pub objects: bool,
    /// Maximum size of the decoded input in bytes; half of the machine's memory if `None`.
    pub max_bytes: Option<u64>,
    /// The contents of files that can be read only once, which are used in place of these files.
    pub held: Held,
    /// The rows to read, by their `y` in the files; all if `None`. The stack is a crop of the picture: its data window has these rows only.
    /// For OpenEXR only.
    pub rows: Option<Range<i32>>,
}
