//! What holes are filled with: a pyramid whose finest levels a band has of its own, and whose coarse levels are the whole frame's.

use super::super::MIN_KNOWN;
use super::{Pyramid, SHADER, Source};
use crate::error::Error;
use crate::gpu::{Buffer, Gpu, Kernel, Work, mirrored};
use crate::methods::shared::{BOX, Grid, Levels, SubImages};
use std::ops::Range;

/// The finest level that is the whole frame's, where there are as many: it has a 64th of the frame's samples.
const LOWEST: usize = 3;

/// Values of a level that are summed at a time, and the threads that do so.
pub(super) const PART_VALUES: u32 = 4096;
pub(super) const PART_THREADS: u32 = 256;

mirrored! {
    /// Means of what is known.
    pub(super) struct Means {
        red: f32,
        green: f32,
        blue: f32,
        alpha: f32,
        coc_px: f32,
    }
}

impl Means {
    /// From sums of content, of CoC radii and of how much is known; none where nothing is.
    fn of(totals: &[f64]) -> Option<Self> {
        let (&known, values) = totals.split_last().filter(|(known, _)| **known > MIN_KNOWN)?;
        let means: Vec<f32> = values.iter().map(|total| (total / known) as f32).collect();
        let (&coc_px, content) = means.split_last()?;
        let mean = |channel: usize| content.get(channel).copied().unwrap_or(0.0);
        Some(Self { red: mean(0), green: mean(1), blue: mean(2), alpha: mean(3), coc_px })
    }
}

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

/// The whole frame's levels of what the holes of a sub-image are filled with.
pub(super) struct Filled {
    values: Buffer,
    /// Whether anything is not nearer than the sub-image.
    pub shows: bool,
}

/// Fills the holes of sub-images.
pub(super) struct Holes<'a> {
    gpu: &'a Gpu,
    kernels: Kernels,
    images: &'a SubImages,
    grid: &'a Grid,
    /// Planes of content.
    channels: usize,
    /// The whole frame's levels.
    pub whole: Levels,
    /// The finest of them: bands have those up to it.
    pub lowest: usize,
}

impl<'a> Holes<'a> {
    pub(super) fn new(
        gpu: &'a Gpu,
        images: &'a SubImages,
        grid: &'a Grid,
        channels: usize,
    ) -> Result<Self, Error> {
        let lowest = LOWEST.min(grid.sizes.len() - 1);
        // Content, CoC radius and how much is known.
        let whole = Levels::from_finest(grid.clone(), 0..grid.sizes[0].1, channels + 2, lowest);
        Ok(Self { gpu, kernels: Kernels::new(gpu)?, images, grid, channels, whole, lowest })
    }

    /// A band's own levels for these rows of level 0.
    pub(super) fn levels_of(&self, rows: Range<usize>) -> Levels {
        Levels::from_finest(self.grid.up_to(self.lowest), rows, self.channels + 2, 1)
    }

    /// The whole frame's levels with nothing in them.
    pub(super) fn unfilled(&self) -> Result<Filled, Error> {
        let values = self.gpu.zeros::<f32>("the levels of the whole frame", self.whole.values())?;
        Ok(Filled { values, shows: false })
    }

    /// Makes a band's own levels of what is known behind all that is nearer than sub-image `i`.
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
        self.pull_on(work, Pyramid { levels, values }, 1..levels.count(), frame)
    }

    /// Makes the level above each of `below`.
    fn pull_on(
        &self,
        work: &mut Work<'_>,
        Pyramid { levels, values }: Pyramid<'_>,
        below: Range<usize>,
        frame: &Buffer,
    ) -> Result<(), Error> {
        for level in below {
            let (step, [across, down, _]) = levels.analysis(self.gpu, level, BOX)?;
            let bindings = [(0, &step), (1, values), (2, frame)];
            work.pass(&self.kernels.pull, &bindings, [across, down, 1])?;
        }
        Ok(())
    }

    /// Gives the coarsest of a band's own levels to the whole frame's.
    pub(super) fn hand_up(
        &self,
        work: &mut Work<'_>,
        own: Pyramid<'_>,
        Filled { values, .. }: &Filled,
    ) -> Result<(), Error> {
        self.copy(work, own, Pyramid { levels: &self.whole, values }, own.levels)
    }

    /// Makes a band's own levels of the whole frame's and of what they know themselves.
    pub(super) fn hand_down(
        &self,
        work: &mut Work<'_>,
        Filled { values, .. }: &Filled,
        own: Pyramid<'_>,
        frame: &Buffer,
    ) -> Result<(), Error> {
        self.copy(work, Pyramid { levels: &self.whole, values }, own, own.levels)?;
        self.push(work, own, 1..self.lowest, frame)
    }

    /// Copies the level that both pyramids have, as many rows of it as `fewer` has.
    fn copy(
        &self,
        work: &mut Work<'_>,
        from: Pyramid<'_>,
        to: Pyramid<'_>,
        fewer: &Levels,
    ) -> Result<(), Error> {
        let step = |levels: &Levels| levels.each_of(self.gpu, self.lowest);
        let (_, [across, down, _]) = step(fewer)?;
        let [(source, _), (target, _)] = [step(from.levels)?, step(to.levels)?];
        let bindings = [(0, &target), (1, to.values), (8, &source), (9, from.values)];
        work.pass(&self.kernels.copy, &bindings, [across, down, self.channels as u32 + 2])
    }

    /// Makes the whole frame's levels of the finest of them.
    pub(super) fn fill(&self, Filled { values, .. }: Filled, frame: &Buffer) -> Result<Filled, Error> {
        let Self { gpu, whole, kernels, .. } = self;
        let pyramid = Pyramid { levels: whole, values: &values };
        let top = whole.count();
        let (step, groups) = whole.each_of(gpu, top)?;
        gpu.submit(|work| self.pull_on(work, pyramid, self.lowest..top, frame))?;
        let means = Means::of(&self.totals(&step, &values)?);
        if let Some(means) = &means {
            let means = gpu.uniform(means)?;
            gpu.submit(|work| {
                let bindings = [(0, &step), (1, &values), (2, frame), (10, &means)];
                work.pass(&kernels.fill, &bindings, groups)?;
                self.push(work, pyramid, self.lowest..top, frame)
            })?;
        }
        Ok(Filled { shows: means.is_some(), values })
    }

    /// Sums of all channels of the coarsest level, that of `step`.
    fn totals(&self, step: &Buffer, values: &Buffer) -> Result<Vec<f64>, Error> {
        let (width, height) = self.grid.sizes[self.whole.count()];
        let (parts, channels) = ((width * height).div_ceil(PART_VALUES as usize), self.channels + 2);
        let totals = self.gpu.zeros::<f32>("sums", channels * parts)?;
        let bindings = [(0, step), (1, values), (11, &totals)];
        let groups = [parts as u32, channels as u32, 1];
        self.gpu.submit(|work| work.pass(&self.kernels.total, &bindings, groups))?;
        let sums: Vec<f32> = self.gpu.read(&totals)?;
        Ok(sums.chunks(parts).map(|parts| parts.iter().map(|&sum| f64::from(sum)).sum()).collect())
    }

    /// Completes `levels`, from the coarsest down.
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
