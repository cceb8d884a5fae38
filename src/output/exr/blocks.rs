//! The blocks of a file of scan lines: compressed in the caller's thread pool, written from the top to the bottom.
//!
//! Each thread takes the next block, compresses it, and hands it over; whoever hands over the block that is to be written next writes it,
//! and those after it that are ready. ZIP and ZIPS blocks are packed by [`crate::zip_blocks`], others by the EXR library. Memory: for each
//! thread a block, and compressed blocks that wait for one before them, at most [`BLOCKS_PER_THREAD`].

use super::channels::Channel;
use crate::output::atomic::Target;
use crate::zip_blocks::Packer;
use exr::block::{BlockIndex, UncompressedBlock};
use exr::compression::Compression;
use exr::error::{Error, Result, UnitResult};
use exr::math::Vec2;
use exr::meta::header::Header;
use half::f16;
use rayon::prelude::*;
use std::io::SeekFrom;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Blocks per thread that are begun before all of them are written: so many that waiting for the last ones does not count.
const BLOCKS_PER_THREAD: usize = 64;

/// The blocks of a file that is being written, top to bottom.
pub(super) struct Blocks<'h> {
    header: &'h Header,
    /// Position of the table of offsets.
    table: u64,
    offsets: Vec<u64>,
    /// Number of rows that are written.
    top: usize,
}

impl<'h> Blocks<'h> {
    /// Writes an empty table of offsets.
    pub(super) fn begin(target: &mut dyn Target, header: &'h Header) -> Result<Self> {
        let table = target.stream_position()?;
        target.write_all(&vec![0; header.chunk_count * size_of::<u64>()])?;
        Ok(Self { header, table, offsets: Vec::with_capacity(header.chunk_count), top: 0 })
    }

    /// Number of rows that are written.
    pub(super) fn rows(&self) -> usize {
        self.top
    }

    /// Whether `rows` more rows are in the picture, and whole blocks or the last ones.
    pub(super) fn has_room_for(&self, rows: usize) -> bool {
        let (end, height) = (self.top + rows, self.header.layer_size.height());
        let is_whole = end.is_multiple_of(self.header.compression.scan_lines_per_block());
        rows > 0 && end <= height && (is_whole || end == height)
    }

    /// Writes the blocks of the next `rows` rows, all of which `channels` hold.
    pub(super) fn write(
        &mut self,
        target: &mut dyn Target,
        channels: &[Channel<'_>],
        rows: usize,
    ) -> UnitResult {
        let lines = self.header.compression.scan_lines_per_block();
        let (top, end) = (self.top, self.top + rows);
        let tops: Vec<usize> = (top..end).step_by(lines).collect();
        let threads = rayon::current_num_threads();
        let source = Source { header: self.header, channels, rows: top..end };
        for tops in tops.chunks(BLOCKS_PER_THREAD * threads) {
            let waiting = tops.iter().map(|_| None).collect();
            let ordered = Ordered {
                target,
                offsets: &mut self.offsets,
                waiting,
                next: 0,
                spare: Vec::new(),
                written: Ok(()),
            };
            let (ordered, begun) = (Mutex::new(ordered), AtomicUsize::new(0));
            let work = |_| {
                let (mut workspace, mut block) = (Workspace::default(), Vec::new());
                while let Some(&from) = tops.get(begun.fetch_add(1, Ordering::Relaxed)) {
                    block.clear();
                    let encoded = source.encode(from, &mut workspace, &mut block).map(|()| block);
                    let mut ordered = ordered.lock().unwrap_or_else(PoisonError::into_inner);
                    match ordered.hand_over((from - tops[0]) / lines, encoded) {
                        Some(spare) => block = spare,
                        None => break,
                    }
                }
            };
            (0..threads.min(tops.len())).into_par_iter().with_max_len(1).for_each(work);
            ordered.into_inner().unwrap_or_else(PoisonError::into_inner).written?;
        }
        self.top = end;
        Ok(())
    }

    /// Writes the offsets.
    pub(super) fn end(self, target: &mut dyn Target) -> UnitResult {
        target.seek(SeekFrom::Start(self.table))?;
        for offset in self.offsets {
            target.write_all(&offset.to_le_bytes())?;
        }
        target.seek(SeekFrom::End(0))?;
        Ok(())
    }
}

/// Blocks that are written in their order, whichever is ready first.
struct Ordered<'a> {
    target: &'a mut dyn Target,
    offsets: &'a mut Vec<u64>,
    /// For each block, its bytes or what went wrong, until its turn comes.
    waiting: Vec<Option<Result<Vec<u8>>>>,
    /// Index of the block that is written next.
    next: usize,
    /// Memory of blocks that are written.
    spare: Vec<Vec<u8>>,
    /// The first failure.
    written: UnitResult,
}

impl Ordered<'_> {
    /// Takes block `index`, and writes those whose turn it is. Returns memory for another block; `None` if writing failed.
    fn hand_over(&mut self, index: usize, block: Result<Vec<u8>>) -> Option<Vec<u8>> {
        self.waiting[index] = Some(block);
        while self.written.is_ok()
            && let Some(block) = self.waiting.get_mut(self.next).and_then(Option::take)
        {
            self.next += 1;
            self.written = block.and_then(|block| self.write(block));
        }
        self.written.is_ok().then(|| self.spare.pop().unwrap_or_default())
    }

    fn write(&mut self, block: Vec<u8>) -> UnitResult {
        self.offsets.push(self.target.stream_position()?);
        self.target.write_all(&block)?;
        self.spare.push(block);
        Ok(())
    }
}

/// What a thread compresses blocks in, again and again.
#[derive(Default)]
struct Workspace {
    packer: Packer,
    halves: Vec<f16>,
}

/// What blocks are made of.
struct Source<'a> {
    header: &'a Header,
    /// They hold the picture's rows `rows`.
    channels: &'a [Channel<'a>],
    rows: Range<usize>,
}

impl Source<'_> {
    /// Appends the block whose first row is `from` to `encoded`: the `y` of this row, the number of bytes, and the compressed bytes.
    fn encode(&self, from: usize, workspace: &mut Workspace, encoded: &mut Vec<u8>) -> UnitResult {
        let Self { header, channels, rows } = self;
        let Workspace { packer, halves } = workspace;
        let (width, compression) = (header.layer_size.width(), header.compression);
        let of_block = from..rows.end.min(from + compression.scan_lines_per_block());
        let size = of_block.len() * width * header.channels.bytes_per_pixel;
        let mut put_rows = |put: &mut dyn FnMut(&[u8])| {
            for y in of_block.clone() {
                channels.iter().for_each(|channel| put(channel.row(y - rows.start, width, halves)));
            }
        };
        if matches!(compression, Compression::ZIP1 | Compression::ZIP16) {
            packer.begin(size);
            put_rows(&mut |row| packer.put(row));
            // Coordinates are below 2^30: the header is valid.
            let y = from as i32 + header.own_attributes.layer_position.y();
            encoded.extend(y.to_le_bytes());
            encoded.extend([0; size_of::<i32>()]);
            let head_bytes = encoded.len();
            packer.append_to(encoded);
            let packed_bytes = i32::try_from(encoded.len() - head_bytes);
            let packed_bytes =
                packed_bytes.map_err(|_| Error::NotSupported("blocks of more than 2 GiB".into()))?;
            encoded[head_bytes - size_of::<i32>()..head_bytes].copy_from_slice(&packed_bytes.to_le_bytes());
            return Ok(());
        }
        let mut data = Vec::with_capacity(size);
        put_rows(&mut |row| data.extend_from_slice(row));
        let index = BlockIndex {
            layer: 0,
            pixel_position: Vec2(0, from),
            pixel_size: Vec2(width, of_block.len()),
            level: Vec2(0, 0),
        };
        UncompressedBlock { index, data }.compress_to_chunk(std::slice::from_ref(*header))?.write(encoded, 1)
    }
}
