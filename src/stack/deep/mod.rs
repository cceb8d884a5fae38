//! Deep OpenEXR: any number of samples a pixel, each a surface or a volume.
//!
//! `file.rs` opens a file and says which channels are what, `chunks.rs` finds its blocks, `unpack.rs` decompresses and `block.rs` decodes
//! them; `element.rs` gives the samples of one part, a few rows at a time. `tidy.rs` sorts the samples of a pixel, splits and merges volumes,
//! and `reduce.rs` turns them into at most as many fragments as a stack has peels. The EXR library reads headers only: it refuses deep
//! samples.
//!
//! Memory: the rows that are loaded. No size is believed before the file is long enough for it.

mod block;
mod chunks;
mod element;
mod file;
mod reduce;
mod sample;
mod tidy;
mod unpack;

pub(super) use element::DeepElement;
pub(super) use file::{DeepFile, is_deep, open};
pub(super) use reduce::reduce;
pub(super) use sample::{Fragment, Sample};
pub(super) use tidy::Tidier;
