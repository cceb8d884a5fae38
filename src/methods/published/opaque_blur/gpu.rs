//! The opaque image blur on a GPU: one pyramid per sub-image, in which synthesis overwrites analysis.

use super::{MIN_ALPHA, OpaqueBlur, sub_images};
use crate::error::Error;
use crate::gpu::{Band, Buffer, Constant, Gpu, Kernel, Mirrored, Shader, Work};
use crate::image::{Image, Plane};
use crate::methods::contract::{GpuBackend, Plan, Progress};
use crate::methods::shared::{
    self, BOX, COVERAGE_PLANES_WGSL, Edge, FIRST_LEVEL_WGSL, Frame, Grid, Levels, Matting, PYRAMID_WGSL,
    Planes, RowNeeds, SUB_IMAGES_WGSL, Step, SubImages, VISIBLE_WGSL, Visible, at_pixels, corners,
    picture_in_bands,
};
use crate::scene::Scene;

static SHADER: Shader = Shader {
    name: "opaque_blur",
    constants: &[("MIN_ALPHA", Constant::Float(MIN_ALPHA))],
    parts: &[
        COVERAGE_PLANES_WGSL,
        VISIBLE_WGSL,
        PYRAMID_WGSL,
        FIRST_LEVEL_WGSL,
        SUB_IMAGES_WGSL,
        include_str!("../../../../shaders/methods/opaque_blur.wgsl"),
    ],
    structs: &[Step::LAYOUT, Frame::LAYOUT, Matting::LAYOUT],
};

impl GpuBackend for OpaqueBlur {
    fn blur(&self, gpu: &Gpu, scene: &Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let size = scene.picture_size();
        let images = sub_images(scene, plan);
        let visible = shared::visible(scene.clone(), plan);
        let channels = visible.content.len();
        let max_levels = images.max_levels();
        // Planes: source, result and CoC radii. A pyramid has a third of the samples of its level 0.
        let widest = Grid::new(size, max_levels, Edge::Clear).sizes[0].0;
        let needs = RowNeeds { planes: 2 * channels + 2, values: (channels + 2) * widest.div_ceil(2) };
        let renderer =
            BandRenderer { gpu, kernels: Kernels::new(gpu)?, images: &images, visible: &visible, size };
        let reach = shared::reach(max_levels);
        picture_in_bands(gpu, (size, channels > 3), (reach, needs), progress, |band, progress| {
            renderer.band(band, progress)
        })
    }

    fn shader(&self) -> &'static Shader {
        &SHADER
    }
}

/// The entry points of the shader.
struct Kernels {
    matte: Kernel,
    reduce: Kernel,
    glow: Kernel,
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
            glow: kernel("glow")?,
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
    size: (usize, usize),
}

/// The buffers of a band.
struct BandBuffers<'a> {
    band: &'a Band,
    source: Planes,
    levels: Buffer,
    result: Planes,
}

impl BandRenderer<'_> {
    /// Content and, last, coverage of the rows of a band.
    fn band(&self, band: &Band, progress: &Progress<'_>) -> Result<Planes, Error> {
        let channels = self.visible.content.len();
        let images: Vec<(i32, Levels)> =
            self.images.far_to_near().map(|i| (i, self.levels(i, band))).collect();
        let planes: Vec<&Plane> = self.visible.content.iter().chain([&self.visible.coc_px]).collect();
        let values = images.iter().map(|(_, levels)| levels.values()).max().unwrap_or(0);
        let buffers = BandBuffers {
            band,
            source: Planes::upload(self.gpu, &planes, &band.source)?,
            levels: self.gpu.zeros::<f32>("the levels of the pyramid", values)?,
            result: Planes::zeros(self.gpu, channels + 1, self.size.0 * band.rows.len())?,
        };
        for (done, (i, levels)) in images.iter().enumerate() {
            self.composite(*i, levels, &buffers)?;
            progress((done + 1) as f32 / (images.len() + 1) as f32);
        }
        if let Some((_, levels)) = images.first() {
            let frame = self.gpu.uniform(&self.frame(levels, band))?;
            let Planes { colors, rest } = &buffers.result;
            let bindings = [(2, &frame), (6, colors), (7, rest)];
            self.gpu.submit(|work| self.at_pixels(work, &self.kernels.normalise, &bindings, &buffers))?;
        }
        Ok(buffers.result)
    }

    fn levels(&self, i: i32, band: &Band) -> Levels {
        let grid = Grid::new(self.size, i.unsigned_abs() as usize, Edge::Clear);
        Levels::new(grid, &band.rows, self.visible.content.len() + 2)
    }

    fn frame(&self, levels: &Levels, band: &Band) -> Frame {
        levels.frame(band, self.visible.content.len())
    }

    /// Mattes sub-image `i`, applies the opaque blur and composites it over the result.
    fn composite(&self, i: i32, levels: &Levels, buffers: &BandBuffers<'_>) -> Result<(), Error> {
        let BandBuffers { source, result, .. } = buffers;
        let frame = self.gpu.uniform(&self.frame(levels, buffers.band))?;
        let matting = self.gpu.uniform(&self.images.matting(i))?;
        let picture = [(2, &frame), (3, &matting), (4, &source.colors), (5, &source.rest)];
        let results = [(6, &result.colors), (7, &result.rest)];
        if levels.count() == 0 {
            let bindings = [&picture[..], &results].concat();
            let kernel = &self.kernels.composite_in_focus;
            return self.gpu.submit(|work| self.at_pixels(work, kernel, &bindings, buffers));
        }
        let (step, [across, down, _]) = levels.analysis(self.gpu, 0, BOX)?;
        let pyramid = [(0, &step), (1, &buffers.levels)];
        // Of the source, compositing reads only CoC radii.
        let composited = [&pyramid[..], &[(2, &frame), (3, &matting), (5, &source.rest)], &results].concat();
        self.gpu.submit(|work| {
            work.pass(&self.kernels.matte, &[&pyramid[..], &picture].concat(), [across, down, 1])?;
            self.blur_and_glow(work, levels, &frame, &buffers.levels)?;
            let blocks = (corners(self.size.0), corners(buffers.band.rows.len()));
            at_pixels(work, &self.kernels.composite, &composited, blocks)
        })
    }

    /// Computes level 1 of the blurred content, the blurred alpha and the glow of alpha, from the matted level 1, in place.
    fn blur_and_glow(
        &self,
        work: &mut Work<'_>,
        levels: &Levels,
        frame: &Buffer,
        pyramid: &Buffer,
    ) -> Result<(), Error> {
        for level in 1..levels.count() {
            let (step, groups) = levels.analysis(self.gpu, level, BOX)?;
            work.pass(&self.kernels.reduce, &[(0, &step), (1, pyramid)], groups)?;
        }
        for level in (1..levels.count()).rev() {
            let (step, groups) = levels.synthesis(self.gpu, level)?;
            work.pass(&self.kernels.glow, &[(0, &step), (1, pyramid), (2, frame)], groups)?;
        }
        Ok(())
    }

    fn at_pixels(
        &self,
        work: &mut Work<'_>,
        kernel: &Kernel,
        bindings: &[(u32, &Buffer)],
        buffers: &BandBuffers<'_>,
    ) -> Result<(), Error> {
        at_pixels(work, kernel, bindings, (self.size.0, buffers.band.rows.len()))
    }
}
