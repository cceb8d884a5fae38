//! Sub-images with disocclusion on a GPU: for each, a pyramid that fills holes and one that blurs.
//!
//! Level 0 of neither is stored. A hole may be filled from anywhere in the frame, so the coarse levels of the filling pyramid are
//! those of the whole frame (`holes.rs`). The rows that a band reads are then limited by the blur and the finest filling levels.
//! If there are several bands, the levels of the whole frame are first collected from all bands, for every sub-image. A band that
//! is the whole frame processes one sub-image after the other.
//!
//! Limits: level 3 of the whole frame, or the coarsest where there are fewer, has to fit into one buffer. If no blur exceeds the
//! first radius, that is level 1, which has a quarter of all samples.

mod buffers;
mod holes;
mod shader;

use super::{PyramidDisocclusion, sub_images};
use crate::error::Error;
use crate::gpu::{Band, Buffer, Gpu, Kernel, Shader, Work};
use crate::image::{Image, Plane};
use crate::methods::contract::{GpuBackend, Plan, Progress};
use crate::methods::shared::{
    self, BOX, Frame, Grid, Levels, Planes, RowNeeds, SubImages, Visible, at_pixels, bands_of, corners,
    picture_of_bands,
};
use crate::scene::Scene;
use buffers::{Pyramid, Source};
use holes::{FrameLevels, Holes};
use shader::SHADER;

/// Share of the progress for filling holes, where that is done before everything else.
const FILLING_SHARE: f32 = 0.3;

impl GpuBackend for PyramidDisocclusion {
    fn blur(&self, gpu: &Gpu, scene: &Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let size = scene.picture_size();
        let (images, grid) = sub_images(scene, plan);
        let visible = shared::visible(scene.clone(), plan);
        let channels = visible.content.len();
        let holes = Holes::new(gpu, &images, &grid, channels)?;
        let reach = shared::reach(grid.sizes.len() - 1) + shared::reach(holes.split_level);
        let bands = bands_of(gpu, size, (reach, needs(&grid, size, channels)))?;
        let renderer = BandRenderer {
            gpu,
            kernels: Kernels::new(gpu)?,
            images: &images,
            visible: &visible,
            grid: &grid,
            holes,
        };
        let filling_share = if bands.len() > 1 { FILLING_SHARE } else { 0.0 };
        let fill_all = || renderer.fill_all(&bands, &|share| progress(filling_share * share));
        let filled = (bands.len() > 1).then(fill_all).transpose()?;
        let progress = |share: f32| progress(filling_share + (1.0 - filling_share) * share);
        picture_of_bands(gpu, (size, channels > 3), &bands, &progress, |band, progress| {
            renderer.band(band, filled.as_deref(), progress)
        })
    }

    fn shader(&self) -> &'static Shader {
        &SHADER
    }
}

/// Memory that a row of a band needs: source and result, and two pyramids of less than a third of the samples of their level 0.
fn needs(grid: &Grid, (_, height): (usize, usize), channels: usize) -> RowNeeds {
    let (widest, highest) = grid.sizes[0];
    // The other pyramid is counted as planes: the grid is less than twice as wide as the frame.
    let planes = 3 * (channels + 1);
    RowNeeds { planes, values: (channels + 2) * (widest * highest).div_ceil(3 * height) }
}

/// The entry points that render.
struct Kernels {
    matte: Kernel,
    reduce: Kernel,
    expand: Kernel,
    composite: Kernel,
    composite_in_focus: Kernel,
    normalise: Kernel,
}

impl Kernels {
    fn new(gpu: &Gpu) -> Result<Self, Error> {
        let kernel = |name| gpu.kernel(&SHADER, name);
        Ok(Self {
            matte: kernel("matte")?,
            reduce: kernel("reduce")?,
            expand: kernel("expand")?,
            composite: kernel("composite")?,
            composite_in_focus: kernel("composite_in_focus")?,
            normalise: kernel("normalise")?,
        })
    }
}

/// Renders bands.
struct BandRenderer<'a> {
    gpu: &'a Gpu,
    kernels: Kernels,
    images: &'a SubImages,
    visible: &'a Visible,
    grid: &'a Grid,
    holes: Holes<'a>,
}

/// The buffers of a band.
struct BandBuffers<'a> {
    band: &'a Band,
    source: Source,
    /// The levels of the band that fill holes.
    filling: Buffer,
    /// The levels that blur.
    blurring: Buffer,
    result: Planes,
}

/// A sub-image of a band: the levels of the band that fill its holes, and those that blur it.
struct BandSubImage {
    i: i32,
    filling: Levels,
    blurring: Levels,
}

impl BandRenderer<'_> {
    /// The levels of the whole frame from which holes are filled, for each sub-image but the nearest, which has no holes.
    fn fill_all(&self, bands: &[Band], progress: &Progress<'_>) -> Result<Vec<FrameLevels>, Error> {
        let with_holes = || self.images.far_to_near().filter(|&i| !self.images.is_nearest(i));
        let all = with_holes().map(|_| self.holes.unfilled()).collect::<Result<Vec<_>, _>>()?;
        for (done, band) in bands.iter().enumerate() {
            let source = self.source(band)?;
            let levels = self.holes.band_levels(self.grid.rows_with_border(&band.rows));
            let values = self.gpu.zeros::<f32>("the levels of the pyramid", levels.values())?;
            let own = Pyramid { levels: &levels, values: &values };
            for (i, frame_levels) in with_holes().zip(&all) {
                self.gpu.submit(|work| {
                    self.holes.pull(work, i, own, &source)?;
                    self.holes.copy_to_frame(work, own, frame_levels)
                })?;
            }
            // Otherwise the sources of all bands would be in memory at once.
            self.gpu.finish()?;
            progress((done + 1) as f32 / bands.len() as f32);
        }
        let frame = self.gpu.uniform(&self.frame(&bands[0]))?;
        all.into_iter().map(|frame_levels| self.holes.fill(frame_levels, &frame)).collect()
    }

    /// Content and, last, coverage of the rows of a band; `filled` has the levels from [`Self::fill_all`], where they exist
    /// already.
    fn band(
        &self,
        band: &Band,
        filled: Option<&[FrameLevels]>,
        progress: &Progress<'_>,
    ) -> Result<Planes, Error> {
        let sub_images: Vec<BandSubImage> =
            self.images.far_to_near().map(|i| self.sub_image(i, band, filled.is_none())).collect();
        let buffers = self.buffers(band, &sub_images)?;
        for (done, sub_image) in sub_images.iter().enumerate() {
            let own = Pyramid { levels: &sub_image.filling, values: &buffers.filling };
            let filled = filled.and_then(|filled| filled.get(done));
            if self.disocclude(sub_image.i, own, filled, &buffers.source)? {
                self.composite(sub_image, &buffers)?;
            }
            progress((done + 1) as f32 / (sub_images.len() + 1) as f32);
        }
        let Planes { colors, rest } = &buffers.result;
        let bindings = [(2, &buffers.source.frame), (6, colors), (7, rest)];
        let made = (self.width(), band.rows.len());
        self.gpu.submit(|work| at_pixels(work, &self.kernels.normalise, &bindings, made))?;
        Ok(buffers.result)
    }

    fn width(&self) -> usize {
        self.visible.coc_px.width()
    }

    fn frame(&self, band: &Band) -> Frame {
        self.holes.frame_levels.frame(band, self.visible.content.len())
    }

    /// Uploads the visible picture of a band.
    fn source(&self, band: &Band) -> Result<Source, Error> {
        let planes: Vec<&Plane> = self.visible.content.iter().chain([&self.visible.coc_px]).collect();
        Ok(Source {
            frame: self.gpu.uniform(&self.frame(band))?,
            planes: Planes::upload(self.gpu, &planes, &band.source)?,
        })
    }

    /// Sub-image `i` of a band; `whole` says whether the band is the whole frame.
    fn sub_image(&self, i: i32, band: &Band, whole: bool) -> BandSubImage {
        let channels = self.visible.content.len() + 1;
        let blurring = Levels::new(self.grid.up_to(i.unsigned_abs() as usize), &band.rows, channels);
        let rows = if whole { self.grid.rows_with_border(&band.rows) } else { blurring.finest_rows() };
        BandSubImage { i, filling: self.holes.band_levels(rows), blurring }
    }

    /// The buffers of a band, each large enough for every sub-image.
    fn buffers<'b>(&self, band: &'b Band, sub_images: &[BandSubImage]) -> Result<BandBuffers<'b>, Error> {
        let max = |values: fn(&BandSubImage) -> usize| sub_images.iter().map(values).max().unwrap_or(0);
        let levels = |values| self.gpu.zeros::<f32>("the levels of the pyramid", values);
        let made = self.width() * band.rows.len();
        Ok(BandBuffers {
            band,
            source: self.source(band)?,
            filling: levels(max(|sub_image| sub_image.filling.values()))?,
            blurring: levels(max(|sub_image| sub_image.blurring.values()))?,
            result: Planes::zeros(self.gpu, self.visible.content.len() + 1, made)?,
        })
    }

    /// Fills the holes of sub-image `i` down to level 1; false where all pixels are nearer.
    fn disocclude(
        &self,
        i: i32,
        own: Pyramid<'_>,
        filled: Option<&FrameLevels>,
        source: &Source,
    ) -> Result<bool, Error> {
        if self.images.is_nearest(i) {
            // The nearest sub-image has no holes.
            return Ok(true);
        }
        self.gpu.submit(|work| self.holes.pull(work, i, own, source))?;
        let filled_here;
        let filled = match filled {
            Some(filled) => filled,
            None => {
                let frame_levels = self.holes.unfilled()?;
                self.gpu.submit(|work| self.holes.copy_to_frame(work, own, &frame_levels))?;
                filled_here = self.holes.fill(frame_levels, &source.frame)?;
                &filled_here
            }
        };
        if filled.has_content {
            self.gpu.submit(|work| self.holes.fill_band(work, filled, own, &source.frame))?;
        }
        Ok(filled.has_content)
    }

    /// Mattes a sub-image of the disoccluded picture, blurs it and composites it over the result.
    fn composite(&self, sub_image: &BandSubImage, buffers: &BandBuffers<'_>) -> Result<(), Error> {
        let BandBuffers { source: Source { frame, planes }, blurring, result, .. } = buffers;
        let matting = self.gpu.uniform(&self.images.matting(sub_image.i))?;
        let (filled, _) = sub_image.filling.synthesis(self.gpu, 0)?;
        let picture = [
            (2, frame),
            (3, &matting),
            (4, &planes.colors),
            (5, &planes.rest),
            (8, &filled),
            (9, &buffers.filling),
        ];
        let results = [(6, &result.colors), (7, &result.rest)];
        let blocks = (corners(self.width()), corners(buffers.band.rows.len()));
        if sub_image.i == 0 {
            let bindings = [&picture[..], &results].concat();
            let kernel = &self.kernels.composite_in_focus;
            return self.gpu.submit(|work| at_pixels(work, kernel, &bindings, blocks));
        }
        let (step, [across, down, _]) = sub_image.blurring.analysis(self.gpu, 0, BOX)?;
        let matted = [&[(0, &step), (1, blurring)], &picture[..]].concat();
        let (step, _) = sub_image.blurring.synthesis(self.gpu, 0)?;
        let composited = [&[(0, &step), (1, blurring), (2, frame)], &results[..]].concat();
        self.gpu.submit(|work| {
            work.pass(&self.kernels.matte, &matted, [across, down, 1])?;
            self.blur(work, Pyramid { levels: &sub_image.blurring, values: blurring })?;
            at_pixels(work, &self.kernels.composite, &composited, blocks)
        })
    }

    /// Computes level 1 of the blurred sub-image from the matted level 1, in place.
    fn blur(&self, work: &mut Work<'_>, Pyramid { levels, values }: Pyramid<'_>) -> Result<(), Error> {
        for level in 1..levels.count() {
            let (step, groups) = levels.analysis(self.gpu, level, BOX)?;
            work.pass(&self.kernels.reduce, &[(0, &step), (1, values)], groups)?;
        }
        for level in (1..levels.count()).rev() {
            let (step, groups) = levels.synthesis(self.gpu, level)?;
            work.pass(&self.kernels.expand, &[(0, &step), (1, values)], groups)?;
        }
        Ok(())
    }
}
