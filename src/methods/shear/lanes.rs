//! Pixels that are painted together.

use crate::image::MARGIN;
use pulp::Simd;
use std::ops::Range;

/// Lanes of a chunk: pixels that are processed together.
pub(super) const LANES: usize = MARGIN;

/// One bit for each lane of a chunk.
pub(super) type Mask = u16;

/// 16 neighbouring pixels of one channel.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(64))]
pub(super) struct Chunk(pub(super) [f32; LANES]);

impl Chunk {
    /// `value(lane)` in each lane.
    #[inline(always)]
    pub(super) fn from_fn(value: impl Fn(usize) -> f32) -> Self {
        // `std::array::from_fn` calls a function for it, which is compiled for one instruction set.
        let mut chunk = Self::default();
        for lane in 0..LANES {
            chunk.0[lane] = value(lane);
        }
        chunk
    }

    /// Adds `other`, pixel by pixel.
    #[inline(always)]
    pub(super) fn add(&mut self, other: &Self) {
        self.0.iter_mut().zip(other.0).for_each(|(sum, other)| *sum += other);
    }
}

/// Bit `i` in lane `i`.
pub(super) static LANE_BITS: [u32; LANES] =
    [1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768];

/// The lanes of vector `i` of a chunk that are set in `mask`.
#[inline(always)]
pub(super) fn lanes<S: Simd>(simd: S, mask: Mask, i: usize) -> S::m32s {
    let bits = S::as_simd_u32s(&LANE_BITS).0[i];
    simd.equal_u32s(simd.and_u32s(simd.splat_u32s(u32::from(mask)), bits), bits)
}

/// The chunks that have any of `columns`, which are not empty.
#[inline(always)]
pub(super) fn chunks_of(columns: &Range<usize>) -> Range<usize> {
    columns.start / LANES..(columns.end - 1) / LANES + 1
}

/// The lanes of chunk `chunk` that are among `columns`, of which it has some.
#[inline(always)]
pub(super) fn lanes_of(columns: &Range<usize>, chunk: usize) -> Mask {
    let [start, past] =
        [columns.start, columns.end - 1].map(|x| x.clamp(chunk * LANES, chunk * LANES + LANES - 1));
    Mask::MAX << (start % LANES) & Mask::MAX >> (LANES - 1 - past % LANES)
}

/// Whether `mask` has bit `lane`.
#[inline(always)]
pub(super) fn has(mask: Mask, lane: usize) -> bool {
    mask >> lane & 1 == 1
}
