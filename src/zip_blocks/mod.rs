//! The bytes of OpenEXR's ZIP and ZIPS blocks, both ways.
//!
//! A block is packed in three steps: bytes at even places go before those at odd ones, each byte is replaced by its difference from the
//! one before it, and the differences are deflated in the format of zlib, each half by itself. What packing does not make smaller is stored
//! as it is. RLE shares the first two steps. The bytes are those of the file: little-endian, row after row, channel after channel.
//!
//! A [`Packer`] keeps its memory from one block to the next. Cost: that of inflate or deflate for the most part.
//! Memory: unpacking takes a block; packing two, and the windows and tables of deflate for either half.

mod halves;
mod pack;
mod predictor;
mod unpack;

pub(crate) use halves::{Halves, are_zero};
pub(crate) use pack::Packer;
pub(crate) use unpack::{Damage, Shuffled, unpack};
