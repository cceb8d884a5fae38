//! The memory that a stack and its render take, from the headers of its files alone.
//!
//! A render holds the decoded peels, which the method works in, and beside them tables and pictures whose size follows the number of pixels:
//! what `shear` and `accumulate` were measured to take at most. The estimate is a bound for these two methods, with a fixed number of lens
//! samples and without a second copy of the scene.

use super::decode::block_bytes;
use super::elements::Extent;
use super::header::ExrFile;
use super::input::Opened;
use super::layers::{channels_to_read, frame_of};
use super::names::PeelChannels;
use super::options::{Carry, ReadOptions};
use super::{Frame, Source, Window, camera, deep, merge_files, names, picture, windows};
use crate::error::Error;
use exr::meta::attribute::SampleType;

/// Bytes of one peel's sample: red, green, blue, alpha and depth.
const PEEL_BYTES: u64 = 20;

/// Planes that are made of what a peel reflects, for each of its samples: while the movement is found, and while the light that moves is
/// taken out of the layers.
const MOVED_PLANES: usize = 36;

/// Bytes for each sample of the data window that a render takes beside the decoded stack: what methods were measured to take, at most 84,
/// and the margin that an estimate needs.
const WORK_BYTES: u64 = 100;

/// Further bytes for each sample where the number of lens samples is searched for: for itself, and for each peel.
const SEARCH_BYTES: [u64; 2] = [20, 10];

/// Bytes that do not depend on the picture's size: the program, and a batch of compressed blocks.
const CONSTANT_BYTES: u64 = 64 << 20;

/// Decompressed blocks that a thread may hold: the block, and what its codec works in.
const BLOCKS_PER_THREAD: u64 = 2;

/// What a stack consists of, as far as its memory follows from it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Footprint {
    /// Width of the data window in samples.
    pub width: usize,
    /// Height of the data window in samples.
    pub height: usize,
    /// The `y` of its first row in the files.
    pub top: i32,
    /// Number of peels.
    pub peels: usize,
    /// Samples per picture pixel along each axis.
    pub supersample: usize,
    /// Decoded bytes of a sample of the data window: all peels, the beauty and the channels to copy.
    pub sample_bytes: u64,
    /// Bytes of the largest decompressed block of the files.
    pub block_bytes: u64,
    /// Whether the files can be read a few rows at a time.
    pub is_in_rows: bool,
}

impl Footprint {
    /// Bytes of the decoded stack.
    pub fn decoded_bytes(&self) -> u64 {
        self.samples(self.height).saturating_mul(self.sample_bytes)
    }

    /// A bound for the memory of a process that renders `rows` rows of samples with a fixed number of lens samples, in bytes.
    pub fn render_bytes(&self, rows: usize) -> u64 {
        let of_samples = self.samples(rows).saturating_mul(self.sample_bytes + WORK_BYTES);
        let of_blocks =
            self.block_bytes.saturating_mul(BLOCKS_PER_THREAD * rayon::current_num_threads() as u64);
        of_samples.saturating_add(of_blocks).saturating_add(CONSTANT_BYTES)
    }

    /// A bound for the memory of a process that renders `rows` rows of samples and searches for the number of lens samples, in bytes.
    pub fn search_bytes(&self, rows: usize) -> u64 {
        let [of_sample, of_peel] = SEARCH_BYTES;
        let more = self.samples(rows).saturating_mul(of_sample + of_peel * self.peels as u64);
        self.render_bytes(rows).saturating_add(more)
    }

    /// The largest number of rows of samples for which `bytes` of the number of rows is within `limit_bytes`.
    pub(crate) fn rows_within(&self, limit_bytes: u64, bytes: impl Fn(usize) -> u64) -> usize {
        let (fixed, of_row) = (bytes(0), bytes(1) - bytes(0));
        usize::try_from(limit_bytes.saturating_sub(fixed) / of_row.max(1)).unwrap_or(usize::MAX)
    }

    fn samples(&self, rows: usize) -> u64 {
        (self.width as u64).saturating_mul(rows as u64)
    }
}

/// The footprint of the stack that [`super::read()`] would read from `sources` by `options`.
///
/// # Errors
/// Those of [`super::read()`] that headers show.
pub fn footprint(sources: &[Source], options: &ReadOptions) -> Result<Footprint, Error> {
    let Some((first, others)) = sources.split_first() else {
        return Err(Error::input("there is no input file").help("name a picture file"));
    };
    if merge_files::are_elements(sources, options)? {
        return of_elements(sources, options);
    }
    let (mut found, frame) = of_file(first, options)?;
    let mut windows = vec![frame.data];
    let without_carry = ReadOptions { carry: Carry::None, objects: false, ..options.clone() };
    for source in others.iter().filter(|_| options.depth_file.is_none()) {
        // A file of depth alone completes the peel of the first.
        let Some((more, own)) = of_peels(source, &without_carry)? else {
            found.is_in_rows &= has_rows_of(source, frame)?;
            continue;
        };
        // Rows are cut by the coordinates of each file.
        let offset = windows::offset(own, frame).unwrap_or([0, 0]);
        found.is_in_rows &= offset[1] == 0;
        windows.push(windows::moved(own.data, offset));
        found.peels += more.peels;
        found.sample_bytes += more.sample_bytes;
        found.block_bytes = found.block_bytes.max(more.block_bytes);
        found.is_in_rows &= more.is_in_rows;
    }
    if let Some(path) = &options.depth_file {
        found.is_in_rows &= has_rows_of(&options.held.source(path), frame)?;
    }
    if let Some(path) = &options.beauty {
        found.is_in_rows &= Opened::open(&options.held.source(path))?.is_exr()?;
    }
    let union = windows::union(&windows, frame.display);
    let data = windows::in_whole_pixels(union, frame.display, found.supersample);
    found.is_in_rows &= data == union;
    (found.width, found.height, found.top) = (data.width, data.height, data.y);
    if options.beauty.is_some() {
        found.sample_bytes += PEEL_BYTES - 4;
    }
    if let Some(path) = &options.holdout {
        // Both stacks, their fragments merged, and merged once more for what they show of their alpha.
        let own = ReadOptions { holdout: None, depth_file: None, beauty: None, ..without_carry };
        let more = footprint(&[options.held.source(path)], &own)?;
        found.peels += more.peels;
        found.sample_bytes = 3 * (found.sample_bytes + more.sample_bytes);
        found.block_bytes = found.block_bytes.max(more.block_bytes);
    }
    Ok(found)
}

/// The footprint of the elements of one picture, merged by depth. Flat ones stay in memory beside the merged peels.
fn of_elements(sources: &[Source], options: &ReadOptions) -> Result<Footprint, Error> {
    let options = ReadOptions { carry: Carry::None, objects: false, ..options.clone() };
    let elements = sources.iter().map(|source| match deep::is_deep(source)? {
        true => of_deep(source, &options),
        false => of_flat(source, &options),
    });
    let elements = elements.collect::<Result<Vec<(Extent, Footprint)>, Error>>()?;
    let all = elements.iter().map(|(extent, _)| *extent).reduce(Extent::with);
    let (Some(all), Some((_, first))) = (all, elements.first()) else {
        return Err(Error::input("there is no input file").help("name a picture file"));
    };
    let beside: u64 = elements.iter().map(|(_, flat)| flat.sample_bytes).sum();
    let threads = rayon::current_num_threads() as u64;
    let of_blocks = elements.iter().map(|(_, flat)| flat.block_bytes).max().unwrap_or(0);
    Ok(Footprint {
        width: all.window.width,
        height: all.window.height,
        top: all.window.y,
        peels: all.peels,
        supersample: first.supersample,
        sample_bytes: PEEL_BYTES * all.peels as u64 + beside,
        block_bytes: of_blocks.max(all.strip_bytes / (BLOCKS_PER_THREAD * threads)),
        is_in_rows: elements.iter().all(|(_, flat)| flat.is_in_rows),
    })
}

/// What a deep file has, and what of it stays in memory: nothing.
fn of_deep(source: &Source, options: &ReadOptions) -> Result<(Extent, Footprint), Error> {
    let (extent, attributes) = Extent::of_deep(deep::open(source, options)?)?;
    let Window { y: top, width, height, .. } = extent.window;
    let (camera, _) = camera::values(&attributes);
    let supersample = options.supersample.or(camera.supersample).unwrap_or(1).max(1);
    let (peels, sample_bytes, block_bytes, is_in_rows) = (extent.peels, 0, 0, true);
    let footprint =
        Footprint { width, height, top, peels, supersample, sample_bytes, block_bytes, is_in_rows };
    Ok((extent, footprint))
}

/// What a file without deep parts has, and what of it stays in memory.
fn of_flat(source: &Source, options: &ReadOptions) -> Result<(Extent, Footprint), Error> {
    let (footprint, frame) = of_file(source, options)?;
    let window = frame.data;
    Ok((Extent { window, peels: footprint.peels, strip_bytes: 0 }, footprint))
}

/// Whether the depth in `source` can be read by the rows of a picture with this `frame`.
fn has_rows_of(source: &Source, frame: Frame) -> Result<bool, Error> {
    let mut opened = Opened::open(source)?;
    if !opened.is_exr()? {
        return Ok(false);
    }
    let own = ExrFile::open(opened)?.frame(0);
    Ok(windows::offset(own, frame).is_none_or(|[_, down]| down == 0))
}

/// The footprint of the peels in `source` and their frame; `None` for a file of depth alone.
fn of_peels(source: &Source, options: &ReadOptions) -> Result<Option<(Footprint, Frame)>, Error> {
    let mut opened = Opened::open(source)?;
    if !opened.is_exr()? {
        return Ok(None);
    }
    let file = ExrFile::open(opened)?;
    if !names::has_color(&file.names()) {
        return Ok(None);
    }
    of_exr(&file.of_requested_view(options)?, options).map(Some)
}

fn of_file(source: &Source, options: &ReadOptions) -> Result<(Footprint, Frame), Error> {
    let mut opened = Opened::open(source)?;
    if opened.is_exr()? {
        return of_exr(&ExrFile::open(opened)?.of_requested_view(options)?, options);
    }
    let (width, height) = picture::size(opened)?;
    let supersample = options.supersample.unwrap_or(1);
    let sample_bytes = PEEL_BYTES;
    let of_picture = Footprint {
        width,
        height,
        top: 0,
        peels: 1,
        supersample,
        sample_bytes,
        block_bytes: 0,
        is_in_rows: false,
    };
    Ok((of_picture, Frame::from_size(width, height)))
}

fn of_exr(file: &ExrFile, options: &ReadOptions) -> Result<(Footprint, Frame), Error> {
    let (assigned, carried) = channels_to_read(file, options)?;
    let frame = frame_of(file, &assigned.peels)
        .ok_or_else(|| Error::input("the file has no peel").in_file(&file.name))?;
    let size_of = |index: &usize| if file.channels[*index].sample_type == SampleType::F16 { 2 } else { 4 };
    let peels = assigned.peels.len();
    let beauty = if assigned.beauty.is_some() { PEEL_BYTES - 4 } else { 0 };
    // Channels that depth is made of or compared with, while they are read.
    let of_depth = |peel: &PeelChannels| peel.same_as_depth.len() + 2 * usize::from(peel.position.is_some());
    let of_depth: usize = assigned.peels.iter().map(of_depth).sum();
    // What is read of reflections, and the planes that are made of it.
    let with_shading = assigned.peels.iter().filter_map(|peel| peel.shading.as_ref());
    let of_shading: usize = with_shading.map(|shading| shading.indices().count() + MOVED_PLANES).sum();
    let (camera, _) = camera::values(&file.attributes());
    let of_peels = Footprint {
        width: frame.data.width,
        height: frame.data.height,
        top: frame.data.y,
        peels,
        supersample: options.supersample.or(camera.supersample).unwrap_or(1).max(1),
        sample_bytes: PEEL_BYTES * peels as u64
            + beauty
            + 4 * (of_depth + of_shading) as u64
            + carried.iter().map(size_of).sum::<u64>(),
        block_bytes: file.meta_data.headers.iter().map(block_bytes).max().unwrap_or(0),
        is_in_rows: true,
    };
    Ok((of_peels, frame))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rows_within_a_limit_are_the_most_that_fit() {
        let footprint = Footprint {
            width: 1000,
            height: 5000,
            top: 0,
            peels: 2,
            supersample: 1,
            sample_bytes: 40,
            block_bytes: 1 << 20,
            is_in_rows: true,
        };
        let limit = 1 << 30;
        let rows = footprint.rows_within(limit, |rows| footprint.render_bytes(rows));
        assert!(footprint.render_bytes(rows) <= limit && footprint.render_bytes(rows + 1) > limit, "{rows}");
        assert_eq!(
            footprint.rows_within(1 << 20, |rows| footprint.render_bytes(rows)),
            0,
            "not even the program"
        );
        assert!(footprint.search_bytes(rows) > footprint.render_bytes(rows));
    }
}
