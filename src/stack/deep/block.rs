//! One decoded block: for each of its pixels, how many samples it has, and their values.

use super::super::Window;
use super::super::sanitise::{self, Replaced};
use super::chunks::Chunk;
use super::unpack::{Packing, damaged};
use crate::error::Error;
use exr::meta::attribute::SampleType;
use half::f16;
use half::slice::HalfFloatSliceExt;
use std::ops::Range;

/// Channels that are decoded: red, green, blue, alpha, depth, and the depth of the back.
pub(super) const ROLES: usize = 6;
/// Index of alpha among the roles; the colours are before it.
pub(super) const ALPHA: usize = 3;
/// Index of depth among the roles; that of the back follows.
pub(super) const DEPTH: usize = 4;

/// How the samples of a part are stored.
#[derive(Debug, Clone)]
pub(super) struct Layout {
    /// How they are packed.
    pub(super) packing: Packing,
    /// The types of all channels, in the order of the file.
    pub(super) types: Vec<SampleType>,
    /// The channel of each role, where there is one.
    pub(super) roles: [Option<usize>; ROLES],
}

/// The decoded samples of a block.
#[derive(Debug)]
pub(super) struct Block {
    /// Its pixels.
    pub(super) window: Window,
    /// For each pixel, the number of samples up to and with its own, row after row.
    ends: Vec<u32>,
    /// The values of each role, pixel after pixel; empty where it has no channel.
    values: [Vec<f32>; ROLES],
    /// What was replaced.
    pub(super) replaced: Replaced,
}

impl Layout {
    /// Bytes of one stored sample.
    fn stored_bytes(&self) -> usize {
        self.types.iter().map(|kind| kind.bytes_per_sample()).sum()
    }

    /// The number of samples that a block says to have. [`decode`] checks it.
    pub(super) fn samples(&self, chunk: &Chunk) -> u64 {
        chunk.sample_bytes / (self.stored_bytes() as u64).max(1)
    }

    /// Bytes of one decoded sample.
    pub(super) fn decoded_bytes(&self) -> u64 {
        4 * self.roles.iter().flatten().count() as u64
    }
}

impl Block {
    /// The places of the values of pixel `x`, `y`, which is in the window.
    pub(super) fn samples(&self, x: i32, y: i32) -> Range<usize> {
        let [column, row] = [x - self.window.x, y - self.window.y].map(|at| usize::try_from(at).unwrap_or(0));
        let pixel = row * self.window.width + column;
        let start = pixel.checked_sub(1).map_or(0, |before| self.ends[before]);
        start as usize..self.ends[pixel] as usize
    }

    /// The values of role `role` of these samples; empty where the file does not have it.
    pub(super) fn values(&self, role: usize, samples: Range<usize>) -> &[f32] {
        self.values[role].get(samples).unwrap_or_default()
    }
}

/// For each pixel of a block, the number of samples up to and with its own, row after row, from its packed table.
///
/// The table starts again at 0 in each row.
///
/// # Errors
/// A table that cannot be decompressed, is not ascending, or counts more samples than `chunk` has bytes for.
pub(super) fn sample_ends(chunk: &Chunk, layout: &Layout, table: &[u8]) -> Result<Vec<u32>, Error> {
    let Window { width, height, .. } = chunk.window;
    let size = 4 * width * height;
    // The OpenEXR library writes the tables of tiles at the edges as long as those of whole tiles, where they are not packed.
    let table = layout.packing.unpack(table.get(..size).unwrap_or(table), size)?;
    let (entries, _) = table.as_chunks();
    let mut ends = Vec::with_capacity(width * height);
    let mut before = 0_u32;
    for row in entries.chunks(width) {
        let mut last = 0;
        for entry in row {
            let count = u32::from_le_bytes(*entry);
            let end = before.checked_add(count).filter(|_| count >= last && count <= i32::MAX as u32);
            ends.push(end.ok_or_else(|| damaged("a table of sample counts is not ascending"))?);
            last = count;
        }
        before = ends.last().copied().unwrap_or(0);
    }
    match u64::from(before).checked_mul(layout.stored_bytes() as u64) {
        Some(bytes) if bytes == chunk.sample_bytes => Ok(ends),
        _ => Err(damaged("a block has another number of samples than its table counts")),
    }
}

/// The samples of a block, from its packed table and samples.
///
/// # Errors
/// Those of [`sample_ends`], and samples that cannot be decompressed.
pub(super) fn decode(chunk: &Chunk, layout: &Layout, bytes: &[u8]) -> Result<Block, Error> {
    let window = chunk.window;
    let (table, packed) = bytes.split_at((chunk.table_bytes as usize).min(bytes.len()));
    let ends = sample_ends(chunk, layout, table)?;
    let total = ends.last().map_or(0, |&end| end as usize);
    // The number of samples was checked against this size.
    let stored = layout.packing.unpack(packed, chunk.sample_bytes as usize)?;
    let mut values: [Vec<f32>; ROLES] =
        layout.roles.map(|role| if role.is_some() { vec![0.0; total] } else { Vec::new() });
    let mut start = 0;
    for row in ends.chunks(window.width) {
        let end = row.last().map_or(start, |&end| end as usize);
        let mut at = start * layout.stored_bytes();
        for (channel, kind) in layout.types.iter().enumerate() {
            let bytes = &stored[at..at + (end - start) * kind.bytes_per_sample()];
            at += bytes.len();
            for (values, _) in values.iter_mut().zip(layout.roles).filter(|(_, role)| *role == Some(channel))
            {
                read_values(bytes, *kind, &mut values[start..end]);
            }
        }
        start = end;
    }
    let mut replaced = Replaced::default();
    values[..ALPHA].iter_mut().for_each(|values| sanitise::color(values, &mut replaced));
    sanitise::alpha(&mut values[ALPHA], &mut replaced);
    Ok(Block { window, ends, values, replaced })
}

/// Converts little-endian samples to `f32`.
fn read_values(bytes: &[u8], kind: SampleType, values: &mut [f32]) {
    let words = || bytes.as_chunks().0.iter();
    match kind {
        SampleType::F16 => {
            let halves: Vec<f16> =
                bytes.as_chunks().0.iter().map(|bytes| f16::from_le_bytes(*bytes)).collect();
            halves.convert_to_f32_slice(values);
        }
        SampleType::F32 => {
            values.iter_mut().zip(words()).for_each(|(v, bytes)| *v = f32::from_le_bytes(*bytes));
        }
        SampleType::U32 => {
            values.iter_mut().zip(words()).for_each(|(v, bytes)| *v = u32::from_le_bytes(*bytes) as f32);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout(types: &[SampleType], roles: [Option<usize>; ROLES]) -> Layout {
        Layout { packing: Packing::None, types: types.to_vec(), roles }
    }

    /// A block of 2 × 2 pixels with this many bytes of samples.
    fn chunk(sample_bytes: u64) -> Chunk {
        let window = Window { x: -1, y: 5, width: 2, height: 2 };
        Chunk { position: 0, table_bytes: 16, packed_bytes: sample_bytes, sample_bytes, window }
    }

    fn table(counts: [u32; 4]) -> Vec<u8> {
        counts.iter().flat_map(|count| count.to_le_bytes()).collect()
    }

    #[test]
    fn the_table_counts_within_each_row_and_the_block_through_all() {
        let layout = layout(&[SampleType::F32], [Some(0); ROLES]);
        let ends = sample_ends(&chunk(16), &layout, &table([1, 3, 0, 1])).unwrap();
        assert_eq!(ends, [1, 3, 3, 4]);
        for (counts, bytes) in [([2, 1, 0, 1], 8), ([1, 3, 0, 1], 20), ([1, u32::MAX, 0, 1], 16), ([0; 4], 4)]
        {
            assert!(sample_ends(&chunk(bytes), &layout, &table(counts)).is_err(), "{counts:?}");
        }
    }

    #[test]
    fn a_table_that_is_longer_than_its_pixels_need_is_not_packed() {
        let mut layout = layout(&[SampleType::F32], [Some(0); ROLES]);
        for packing in [Packing::None, Packing::Rle, Packing::Zip] {
            layout.packing = packing;
            let longer = [table([1, 3, 0, 1]), vec![9; 48]].concat();
            assert_eq!(sample_ends(&chunk(16), &layout, &longer).unwrap(), [1, 3, 3, 4], "{packing:?}");
        }
    }

    #[test]
    fn channels_of_a_row_are_stored_one_after_another() {
        // Depth as float in channel 0, alpha as half in channel 1, an index in channel 2.
        let types = [SampleType::F32, SampleType::F16, SampleType::U32];
        let layout = layout(&types, [None, None, Some(2), Some(1), Some(0), None]);
        let row = |depths: &[f32], alphas: &[f32], ids: &[u32]| {
            let depths = depths.iter().flat_map(|depth| depth.to_le_bytes());
            let alphas = alphas.iter().flat_map(|&alpha| f16::from_f32(alpha).to_le_bytes());
            depths.chain(alphas).chain(ids.iter().flat_map(|id| id.to_le_bytes())).collect::<Vec<u8>>()
        };
        let bytes =
            [row(&[1.0, 2.0, 3.0], &[0.25, 0.5, 1.0], &[7, 8, 9]), row(&[4.0], &[2.0], &[10])].concat();
        let chunk = chunk(bytes.len() as u64);
        let block = decode(&chunk, &layout, &[table([1, 3, 0, 1]), bytes].concat()).unwrap();
        assert_eq!(block.samples(0, 5), 1..3);
        assert_eq!(block.samples(-1, 6), 3..3, "empty");
        let of = |role: usize| block.values(role, 0..4);
        assert_eq!(of(DEPTH), [1.0, 2.0, 3.0, 4.0]);
        assert_eq!(of(ALPHA), [0.25, 0.5, 1.0, 1.0], "clamped");
        assert_eq!(of(2), [7.0, 8.0, 9.0, 10.0]);
        assert_eq!((block.values(0, 0..4).len(), block.replaced.alpha), (0, 1));
    }
}
