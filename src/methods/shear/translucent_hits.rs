//! Surfaces that a ray has hit before.
//!
//! Neighbouring fragments of a surface overlap in CoC depth, so that a ray may hit several of them, and it counts a surface once: a ray
//! remembers, for each layer, the bin of its last translucent hit, and a hit of the same layer within
//! [`SAME_HIT_PX`](crate::scene::surface::SAME_HIT_PX) is not composited again, but remembered. A fragment whose surface continues in
//! another peel compares with the last hits of the other layers as well, but for those at its own source pixel: two fragments of one sample
//! are two surfaces.

use super::bins::{Block, MAX_BINS};
use super::canvas::Step;
use super::lanes::{LANE_BITS, LANES, Mask};
use super::spans::Span;

/// The last translucent hits of the rays of a row.
#[derive(Debug, Default)]
pub(super) struct TranslucentHits {
    /// `[layer][chunk][lane]`: the view's stamp, and in the lowest bits the last bin of the block in which it was hit.
    last: Vec<[u32; LANES]>,
    chunks: usize,
    /// Number of the current view above the bits of a bin: an entry of an earlier view is smaller.
    stamp: u32,
}

/// A hit of a translucent span.
#[derive(Clone, Copy)]
pub(super) struct Hit {
    layer: usize,
    /// Nearest bin of an earlier hit of the same surface.
    same_from: u32,
    /// The last bin of the block.
    bin: u32,
    /// For a surface that continues in other layers: the first bin whose fragments lie at the same source pixels.
    same_pixel_from: Option<u32>,
}

impl Hit {
    #[inline(always)]
    pub(super) fn new(same_from: u16, (step, block): (&Step, &Block), span: &Span) -> Self {
        Self {
            layer: span.layer as usize,
            same_from: same_from.into(),
            bin: block.bins[1].into(),
            same_pixel_from: span.changes_peel.then_some(step.moved_alike_from.into()),
        }
    }
}

impl TranslucentHits {
    /// Memory for `chunks` chunks of rays in `layers` layers.
    pub(super) fn prepare(&mut self, layers: usize, chunks: usize) {
        if self.last.len() != layers * chunks {
            *self = Self { last: vec![[0; LANES]; layers * chunks], chunks, stamp: 0 };
        }
    }

    /// Forgets all hits.
    #[inline(always)]
    pub(super) fn start_view(&mut self) {
        let step = MAX_BINS as u32;
        if self.stamp > u32::MAX - 2 * step {
            self.last.fill([0; LANES]);
            self.stamp = 0;
        }
        self.stamp += step;
    }

    /// The rays of `chunk`, of those in `lanes`, for which `hit` is in a surface that they hit before; remembers it.
    #[inline(always)]
    pub(super) fn hit_before(&mut self, chunk: usize, lanes: Mask, hit: &Hit) -> Mask {
        let same_from = self.stamp | hit.same_from;
        let mut bits = [0u32; LANES];
        if let Some(same_pixel_from) = hit.same_pixel_from {
            let same_pixel_from = self.stamp | same_pixel_from;
            for other in self.last.iter().skip(chunk).step_by(self.chunks) {
                for ((bits, &last), bit) in bits.iter_mut().zip(other).zip(LANE_BITS) {
                    *bits |= if (last >= same_from) & (last < same_pixel_from) { bit } else { 0 };
                }
            }
        }
        let (now, lanes) = (self.stamp | hit.bin, u32::from(lanes));
        let own = &mut self.last[hit.layer * self.chunks + chunk];
        for ((bits, last), bit) in bits.iter_mut().zip(own).zip(LANE_BITS) {
            *bits |= if *last >= same_from { bit } else { 0 };
            *last = if lanes & bit != 0 { now } else { *last };
        }
        bits.iter().fold(0, |all, bits| all | bits) as Mask
    }
}
