//! Buffers that filling and rendering both read.

use crate::gpu::Buffer;
use crate::methods::shared::{Levels, Planes};

/// The visible picture of a band, and the position of its pixels.
pub(super) struct Source {
    pub frame: Buffer,
    pub planes: Planes,
}

/// Levels, and the buffer that holds them.
#[derive(Clone, Copy)]
pub(super) struct Pyramid<'a> {
    pub levels: &'a Levels,
    pub values: &'a Buffer,
}
