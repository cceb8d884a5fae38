//! Filling of holes: a pyramid whose finest levels belong to a band, and whose coarse levels belong to the whole frame.

use super::buffers::{Pyramid, Source};
use super::shader::{Means, PART_VALUES, SHADER};
use crate::error::Error;
use crate::gpu::{Buffer, Gpu, Kernel, Work};
use crate::methods::shared::{BOX, Grid, Levels, SubImages};
use std::ops::Range;

/// The finest level that is stored for the whole frame, or the coarsest where there are fewer. It has 1/64 of the samples of the
/// frame.
const SPLIT_LEVEL: usize = 3;

/// The entry points that fill.
struct Kernels {
    pull_first: Kernel,
    pull: Kernel,
    copy: Kernel,
    total: Kernel,
    fill: Kernel,
    push: Kernel,
}

impl Kernels {
    fn new(gpu: &Gpu) -> Result<Self, Error> {
        let kernel = |name| gpu.kernel(&SHADER, name);
        Ok(Self {
            pull_first: kernel("pull_first")?,
            pull: kernel("pull")?,
            copy: kernel("copy")?,
            total: kernel("total")?,
            fill: kernel("fill")?,
            push: kernel("push")?,
        })
    }
}

/// The levels of the whole frame from which the holes of a sub-image are filled.
pub(super) struct FrameLevels {
    values: Buffer,
    /// Whether any pixel is not nearer than the sub-image.
    pub has_content: bool,
}

/// Fills the holes of sub-images.
pub(super) struct Holes<'a> {
    gpu: &'a Gpu,
    kernels: Kernels,
    images: &'a SubImages,
    grid: &'a Grid,
    /// Number of planes of content.
    channels: usize,
    /// The levels of the whole frame.
    pub frame_levels: Levels,
    /// The finest of them. The levels of a band end with it.
    pub split_level: usize,
}

impl<'a> Holes<'a> {
    pub(super) fn new(
        gpu: &'a Gpu,
        images: &'a SubImages,
        grid: &'a Grid,
        channels: usize,
    ) -> Result<Self, Error> {
        let split_level = SPLIT_LEVEL.min(grid.sizes.len() - 1);
        // Channels: content, CoC radius and known share.
        let frame_levels = Levels::from_finest(grid.clone(), 0..grid.sizes[0].1, channels + 2, split_level);
        Ok(Self { gpu, kernels: Kernels::new(gpu)?, images, grid, channels, frame_levels, split_level })
    }

    /// The levels of a band for these rows of level 0.
    pub(super) fn band_levels(&self, rows: Range<usize>) -> Levels {
        Levels::from_finest(self.grid.up_to(self.split_level), rows, self.channels + 2, 1)
    }

    /// The levels of the whole frame, empty.
    pub(super) fn unfilled(&self) -> Result<FrameLevels, Error> {
        let values = self.gpu.zeros::<f32>("the levels of the whole frame", self.frame_levels.values())?;
        Ok(FrameLevels { values, has_content: false })
    }

    /// Computes the levels of a band from the pixels that are not nearer than sub-image `i`.
    pub(super) fn pull(
        &self,
        work: &mut Work<'_>,
        i: i32,
        Pyramid { levels, values }: Pyramid<'_>,
        Source { frame, planes }: &Source,
    ) -> Result<(), Error> {
        let matting = self.gpu.uniform(&self.images.matting(i))?;
        let (step, [across, down, _]) = levels.analysis(self.gpu, 0, BOX)?;
        let bindings =
            [(0, &step), (1, values), (2, frame), (3, &matting), (4, &planes.colors), (5, &planes.rest)];
        work.pass(&self.kernels.pull_first, &bindings, [across, down, 1])?;
        self.pull_levels(work, Pyramid { levels, values }, 1..levels.count(), frame)
    }

    /// Computes, for each of the levels `finer`, the next coarser one.
    fn pull_levels(
        &self,
        work: &mut Work<'_>,
        Pyramid { levels, values }: Pyramid<'_>,
        finer: Range<usize>,
        frame: &Buffer,
    ) -> Result<(), Error> {
        for level in finer {
            let (step, [across, down, _]) = levels.analysis(self.gpu, level, BOX)?;
            let bindings = [(0, &step), (1, values), (2, frame)];
            work.pass(&self.kernels.pull, &bindings, [across, down, 1])?;
        }
        Ok(())
    }

    /// Copies the coarsest level of a band into the levels of the whole frame.
    pub(super) fn copy_to_frame(
        &self,
        work: &mut Work<'_>,
        own: Pyramid<'_>,
        FrameLevels { values, .. }: &FrameLevels,
    ) -> Result<(), Error> {
        self.copy(work, own, Pyramid { levels: &self.frame_levels, values }, own.levels)
    }

    /// Fills the levels of a band from those of the whole frame.
    pub(super) fn fill_band(
        &self,
        work: &mut Work<'_>,
        FrameLevels { values, .. }: &FrameLevels,
        own: Pyramid<'_>,
        frame: &Buffer,
    ) -> Result<(), Error> {
        self.copy(work, Pyramid { levels: &self.frame_levels, values }, own, own.levels)?;
        self.push(work, own, 1..self.split_level, frame)
    }

    /// Copies the level that both pyramids have: those of its rows that `fewer` has.
    fn copy(
        &self,
        work: &mut Work<'_>,
        from: Pyramid<'_>,
        to: Pyramid<'_>,
        fewer: &Levels,
    ) -> Result<(), Error> {
        let step = |levels: &Levels| levels.each_of(self.gpu, self.split_level);
        let (_, [across, down, _]) = step(fewer)?;
        let [(source, _), (target, _)] = [step(from.levels)?, step(to.levels)?];
        let bindings = [(0, &target), (1, to.values), (8, &source), (9, from.values)];
        work.pass(&self.kernels.copy, &bindings, [across, down, self.channels as u32 + 2])
    }

    /// Computes the levels of the whole frame from the finest of them, and fills them.
    pub(super) fn fill(
        &self,
        FrameLevels { values, .. }: FrameLevels,
        frame: &Buffer,
    ) -> Result<FrameLevels, Error> {
        let Self { gpu, frame_levels, kernels, .. } = self;
        let pyramid = Pyramid { levels: frame_levels, values: &values };
        let top = frame_levels.count();
        let (step, groups) = frame_levels.each_of(gpu, top)?;
        gpu.submit(|work| self.pull_levels(work, pyramid, self.split_level..top, frame))?;
        let means = Means::from_totals(&self.totals(&step, &values)?);
        if let Some(means) = &means {
            let means = gpu.uniform(means)?;
            gpu.submit(|work| {
                let bindings = [(0, &step), (1, &values), (2, frame), (10, &means)];
                work.pass(&kernels.fill, &bindings, groups)?;
                self.push(work, pyramid, self.split_level..top, frame)
            })?;
        }
        Ok(FrameLevels { has_content: means.is_some(), values })
    }

    /// The sum of each channel over the coarsest level, which is the coarse level of `step`.
    fn totals(&self, step: &Buffer, values: &Buffer) -> Result<Vec<f64>, Error> {
        let (width, height) = self.grid.sizes[self.frame_levels.count()];
        let (parts, channels) = ((width * height).div_ceil(PART_VALUES as usize), self.channels + 2);
        let totals = self.gpu.zeros::<f32>("sums", channels * parts)?;
        let bindings = [(0, step), (1, values), (11, &totals)];
        let groups = [parts as u32, channels as u32, 1];
        self.gpu.submit(|work| work.pass(&self.kernels.total, &bindings, groups))?;
        let sums: Vec<f32> = self.gpu.read(&totals)?;
        Ok(sums.chunks(parts).map(|parts| parts.iter().map(|&sum| f64::from(sum)).sum()).collect())
    }

    /// Fills `levels`, the coarsest first, each from the next coarser one.
    fn push(
        &self,
        work: &mut Work<'_>,
        pyramid: Pyramid<'_>,
        levels: Range<usize>,
        frame: &Buffer,
    ) -> Result<(), Error> {
        for level in levels.rev() {
            let (step, [across, down, _]) = pyramid.levels.synthesis(self.gpu, level)?;
            let bindings = [(0, &step), (1, pyramid.values), (2, frame)];
            work.pass(&self.kernels.push, &bindings, [across, down, self.channels as u32 + 1])?;
        }
        Ok(())
    }
}
