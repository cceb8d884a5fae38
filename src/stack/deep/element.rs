//! The deep samples of one part of a file, a few rows at a time.

use super::super::depth::FarDepth;
use super::super::header::ExrFile;
use super::super::sanitise::Replaced;
use super::super::{Precision, Window};
use super::block::{self, ALPHA, Block, DEPTH, Layout};
use super::chunks::{self, Chunk, Grid};
use super::reduce::NEAREST_FRONT;
use super::sample::Sample;
use crate::error::Error;
use crate::parallel;
use exr::meta::attribute::SampleType;
use std::collections::VecDeque;
use std::ops::Range;

/// One deep picture of a file.
#[derive(Debug)]
pub(in crate::stack) struct DeepElement {
    file: ExrFile,
    layout: Layout,
    grid: Grid,
    chunks: Vec<Chunk>,
    /// Decoded rows of blocks, each from left to right.
    bands: VecDeque<Vec<Block>>,
    /// The row of blocks after those in `bands`.
    next: usize,
    replaced: Replaced,
}

impl DeepElement {
    /// The part of `file` with the samples that `layout` describes. `file` is positioned after its headers.
    ///
    /// # Errors
    /// Those of [`chunks::find`].
    pub(super) fn new(mut file: ExrFile, part: usize, layout: Layout) -> Result<Self, Error> {
        let grid = Grid::new(&file, part);
        let chunks = chunks::find(&mut file, part, &grid).map_err(|error| error.in_file(&file.name))?;
        let (bands, replaced) = (VecDeque::new(), Replaced::default());
        Ok(Self { file, layout, grid, chunks, bands, next: 0, replaced })
    }

    /// The pixels of the whole part.
    pub(in crate::stack) fn window(&self) -> Window {
        self.grid.window
    }

    /// Whether samples may be volumes.
    pub(in crate::stack) fn has_volumes(&self) -> bool {
        self.layout.roles[DEPTH + 1].is_some()
    }

    /// Numeric type of the colours.
    pub(in crate::stack) fn precision(&self) -> Precision {
        let is_half =
            |role: &Option<usize>| role.is_some_and(|index| self.layout.types[index] == SampleType::F16);
        if self.layout.roles[..ALPHA].iter().all(is_half) { Precision::Half } else { Precision::Float }
    }

    /// What was replaced in the rows that were loaded so far.
    pub(in crate::stack) fn replaced(&self) -> Replaced {
        self.replaced
    }

    /// Most samples of a pixel, from the tables of the blocks alone.
    ///
    /// # Errors
    /// A damaged file.
    pub(in crate::stack) fn most_samples(&mut self) -> Result<u32, Error> {
        let chunks = self.chunks.clone();
        let tables = self.read_all(&chunks, |chunk| (chunk.position, chunk.table_bytes))?;
        let of_block = |number: usize, table: Vec<u8>| -> Result<u32, Error> {
            let ends = block::sample_ends(&chunks[number], &self.layout, &table)?;
            let starts = std::iter::once(0).chain(ends.iter().copied());
            Ok(ends.iter().zip(starts).map(|(end, start)| end - start).max().unwrap_or(0))
        };
        let of_blocks = parallel::map_each(tables.into_iter(), &of_block);
        let of_blocks: Result<Vec<u32>, Error> = of_blocks.into_iter().collect();
        let of_blocks = of_blocks.map_err(|error| error.in_file(&self.file.name))?;
        Ok(of_blocks.into_iter().max().unwrap_or(0))
    }

    /// A bound for the bytes that the blocks of `rows` rows take, packed and decoded.
    pub(in crate::stack) fn largest_strip_bytes(&self, rows: usize) -> u64 {
        let bands = rows.div_ceil(self.grid.block_height) + 1;
        let of_block = |chunk: &Chunk| {
            let decoded = self.layout.samples(chunk).saturating_mul(self.layout.decoded_bytes());
            decoded.saturating_add(chunk.packed_bytes).saturating_add(chunk.sample_bytes)
        };
        let of_band = |band: &[Chunk]| band.iter().map(of_block).fold(0, u64::saturating_add);
        let of_bands: Vec<u64> = self.chunks.chunks(self.grid.columns().max(1)).map(of_band).collect();
        let of_strips = of_bands.windows(bands.min(of_bands.len()).max(1));
        of_strips.map(|strip| strip.iter().copied().fold(0, u64::saturating_add)).max().unwrap_or(0)
    }

    /// Loads the rows `rows` by their `y`, which follow those loaded before or begin among them, within `max_bytes` of decoded samples.
    /// Earlier rows are dropped.
    ///
    /// # Errors
    /// A damaged file; [`crate::error::ErrorKind::Limits`] for more samples than the limit allows.
    pub(in crate::stack) fn load(&mut self, rows: Range<i32>, max_bytes: u64) -> Result<(), Error> {
        let (end_of, top) = (|window: Window| window.y + window.height as i32, self.grid.window.y);
        self.bands.retain(|band| band.first().is_some_and(|block| end_of(block.window) > rows.start));
        let height = self.grid.block_height;
        let row_of = |y: i32| usize::try_from(i64::from(y) - i64::from(top)).unwrap_or(0);
        if self.bands.is_empty() {
            self.next = self.next.max(row_of(rows.start) / height);
        }
        let end = row_of(rows.end).div_ceil(height).min(self.grid.bands());
        if self.next < end {
            let columns = self.grid.columns();
            let chunks = self.chunks[self.next * columns..end * columns].to_vec();
            let mut blocks = self.decoded(&chunks, max_bytes)?.into_iter();
            for _ in self.next..end {
                let band: Vec<Block> = blocks.by_ref().take(columns).collect();
                band.iter().for_each(|block| self.replaced.add(block.replaced));
                self.bands.push_back(band);
            }
            self.next = end;
        }
        Ok(())
    }

    /// The decoded blocks of `chunks`.
    fn decoded(&mut self, chunks: &[Chunk], max_bytes: u64) -> Result<Vec<Block>, Error> {
        let samples: u64 = chunks.iter().map(|chunk| self.layout.samples(chunk)).fold(0, u64::saturating_add);
        // A block has all channels of its part, also those that are not decoded.
        let block = chunks.iter().map(|chunk| chunk.sample_bytes).max().unwrap_or(0);
        if samples.saturating_mul(self.layout.decoded_bytes()).saturating_add(block) > max_bytes {
            return Err(too_many(samples, max_bytes).in_file(&self.file.name));
        }
        let packed =
            self.read_all(chunks, |chunk| (chunk.position, chunk.table_bytes + chunk.packed_bytes))?;
        // Each block's bytes are freed once it is decoded.
        let decode = |number: usize, bytes: Vec<u8>| block::decode(&chunks[number], &self.layout, &bytes);
        let blocks = parallel::map_each(packed.into_iter(), &decode);
        let blocks: Result<Vec<Block>, Error> = blocks.into_iter().collect();
        blocks.map_err(|error| error.in_file(&self.file.name))
    }

    /// For each of `chunks`, the bytes at the position and of the size that `part` gives, which the file is known to have.
    fn read_all(
        &mut self,
        chunks: &[Chunk],
        part: impl Fn(&Chunk) -> (u64, u64),
    ) -> Result<Vec<Vec<u8>>, Error> {
        let read = |chunk| {
            let (position, count) = part(chunk);
            chunks::read_bytes(&mut self.file, position, count)
        };
        let bytes: Result<Vec<_>, Error> = chunks.iter().map(read).collect();
        bytes.map_err(|error| error.in_file(&self.file.name))
    }

    /// Appends the samples of pixel `x`, `y`, whose row is loaded, with distances that `far` makes.
    pub(in crate::stack) fn append(&self, x: i32, y: i32, far: &FarDepth, samples: &mut Vec<Sample>) {
        let Some(block) = self.block_at(x, y) else { return };
        let range = block.samples(x, y);
        let of = |role: usize| block.values(role, range.clone());
        let [red, green, blue] = [of(0), of(1), of(2)];
        let (alphas, depths, backs) = (of(ALPHA), of(DEPTH), of(DEPTH + 1));
        for i in 0..range.len() {
            let alpha = alphas.get(i).copied().unwrap_or(1.0);
            let (front, back) = distances(depths[i], backs.get(i).copied(), far);
            let sample = Sample { front, back, color: [red[i], green[i], blue[i]], alpha };
            if !sample.is_empty() {
                samples.push(sample);
            }
        }
    }

    /// The loaded block with pixel `x`, `y`.
    fn block_at(&self, x: i32, y: i32) -> Option<&Block> {
        let window = self.grid.window;
        let column = usize::try_from(x - window.x).ok().filter(|&column| column < window.width)?;
        let row = usize::try_from(y - window.y).ok().filter(|&row| row < window.height)?;
        let first = self.next - self.bands.len();
        let band = (row / self.grid.block_height).checked_sub(first)?;
        self.bands.get(band)?.get(column / self.grid.block_width)
    }
}

/// Where a sample begins and ends. A back that is not behind the front is that of a surface. A sample behind the camera is one before it,
/// of a program whose axis points backwards.
fn distances(depth: f32, back: Option<f32>, far: &FarDepth) -> (f32, f32) {
    let back = back.unwrap_or(depth);
    let (depth, back) = if depth < 0.0 && back <= 0.0 { (-depth, -back) } else { (depth, back) };
    let (front, back) = (far.of(depth), far.of(back));
    if front == f32::INFINITY && depth <= 0.0 && back < front {
        // The camera is within the volume.
        return (back * NEAREST_FRONT, back);
    }
    (front, if back < f32::INFINITY { back.max(front) } else { front })
}

fn too_many(samples: u64, max_bytes: u64) -> Error {
    Error::limits("the deep samples require more memory than the limit")
        .with("found", format!("{samples} samples in the rows of one block"))
        .with("limit", format!("{} MiB", max_bytes >> 20))
        .help("merge samples before writing the file, or allow more memory")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::DepthConvention;

    #[test]
    fn a_sample_lies_before_the_camera_whichever_way_the_axis_points() {
        let far = FarDepth::new(DepthConvention::Planar);
        let at = |depth: f32, back: Option<f32>| distances(depth, back, &far);
        assert_eq!(
            [at(2.0, None), at(2.0, Some(5.0)), at(2.0, Some(1.0))],
            [(2.0, 2.0), (2.0, 5.0), (2.0, 2.0)]
        );
        assert_eq!([at(-2.0, None), at(-2.0, Some(-5.0))], [(2.0, 2.0), (2.0, 5.0)]);
        assert_eq!(at(-1.0, Some(4.0)), (0.04, 4.0), "around the camera");
        for background in [f32::INFINITY, f32::NAN, 1e10, 0.0] {
            assert_eq!(at(background, None).0, f32::INFINITY, "{background}");
        }
    }
}
