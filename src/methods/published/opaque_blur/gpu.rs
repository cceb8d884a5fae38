//! The opaque image blur on a GPU: one pyramid a sub-image, in which synthesis takes the place of analysis.

use super::{NOTHING, OpaqueBlur, sub_images};
use crate::error::Error;
use crate::gpu::{Band, Buffer, Constant, Gpu, Kernel, Mirrored, Shader, Work};
use crate::image::{Image, Plane};
use crate::methods::contract::Plan;
use crate::methods::contract::{GpuBackend, Progress};
use crate::methods::shared::{
    self, BOX, COVERAGE_PLANES_WGSL, Edge, FIRST_LEVEL_WGSL, Frame, Grid, Levels, Matting, PYRAMID_WGSL,
    Planes, RowNeeds, SUB_IMAGES_WGSL, Step, SubImages, VISIBLE_WGSL, Visible, at_pixels, corners,
    picture_in_bands,
};
use crate::scene::Scene;

static SHADER: Shader = Shader {
    name: "opaque_blur",
    constants: &[("NOTHING", Constant::Float(NOTHING))],
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
        // Source, result and CoC radii; a pyramid has a third of the samples of its level 0.
        let widest = Grid::new(size, max_levels, Edge::Clear).sizes[0].0;
        let needs = RowNeeds { planes: 2 * channels + 2, values: (channels + 2) * widest.div_ceil(2) };
        let painter = Painter { gpu, kernels: Kernels::new(gpu)?, images: &images, visible: &visible, size };
        let reach = shared::reach(max_levels);
        picture_in_bands(gpu, (size, channels > 3), (reach, needs), progress, |band, progress| {
            painter.band(band, progress)
        })
    }

    fn shader(&self) -> &'static Shader {
        &SHADER
    }
}

/// The entry points.
struct Kernels {
    matte: Kernel,
    reduce: Kernel,
    glow: Kernel,
    lay: Kernel,
    lay_sharp: Kernel,
    normalise: Kernel,
}

impl Kernels {
    fn new(gpu: &Gpu) -> Result<Self, Error> {
        let kernel = |name| gpu.kernel(&SHADER, name);
        Ok(Self {
            matte: kernel("matte")?,
            reduce: kernel("reduce")?,
            glow: kernel("glow")?,
            lay: kernel("lay")?,
            lay_sharp: kernel("lay_sharp")?,
            normalise: kernel("normalise")?,
        })
    }
}

/// What every band is made from.
struct Painter<'a> {
    gpu: &'a Gpu,
    kernels: Kernels,
    images: &'a SubImages,
    visible: &'a Visible,
    size: (usize, usize),
}

/// The buffers of a band.
struct Canvas<'a> {
    band: &'a Band,
    source: Planes,
    levels: Buffer,
    result: Planes,
}

impl Painter<'_> {
    /// Content, and then coverage, of a band's rows.
    fn band(&self, band: &Band, progress: &Progress<'_>) -> Result<Planes, Error> {
        let channels = self.visible.content.len();
        let images: Vec<(i32, Levels)> =
            self.images.far_to_near().map(|i| (i, self.levels(i, band))).collect();
        let planes: Vec<&Plane> = self.visible.content.iter().chain([&self.visible.coc_px]).collect();
        let values = images.iter().map(|(_, levels)| levels.values()).max().unwrap_or(0);
        let canvas = Canvas {
            band,
            source: Planes::upload(self.gpu, &planes, &band.source)?,
            levels: self.gpu.zeros::<f32>("the levels of the pyramid", values)?,
            result: Planes::zeros(self.gpu, channels + 1, self.size.0 * band.rows.len())?,
        };
        for (done, (i, levels)) in images.iter().enumerate() {
            self.lay(*i, levels, &canvas)?;
            progress((done + 1) as f32 / (images.len() + 1) as f32);
        }
        if let Some((_, levels)) = images.first() {
            let frame = self.gpu.uniform(&self.frame(levels, band))?;
            let Planes { colors, rest } = &canvas.result;
            let bindings = [(2, &frame), (6, colors), (7, rest)];
            self.gpu.submit(|work| self.at_pixels(work, &self.kernels.normalise, &bindings, &canvas))?;
        }
        Ok(canvas.result)
    }

    fn levels(&self, i: i32, band: &Band) -> Levels {
        let grid = Grid::new(self.size, i.unsigned_abs() as usize, Edge::Clear);
        Levels::new(grid, &band.rows, self.visible.content.len() + 2)
    }

    fn frame(&self, levels: &Levels, band: &Band) -> Frame {
        levels.frame(band, self.visible.content.len())
    }

    /// Mattes sub-image `i`, blurs it opaquely and lays it over the result.
    fn lay(&self, i: i32, levels: &Levels, canvas: &Canvas<'_>) -> Result<(), Error> {
        let Canvas { source, result, .. } = canvas;
        let frame = self.gpu.uniform(&self.frame(levels, canvas.band))?;
        let matting = self.gpu.uniform(&self.images.matting(i))?;
        let picture = [(2, &frame), (3, &matting), (4, &source.colors), (5, &source.rest)];
        let results = [(6, &result.colors), (7, &result.rest)];
        if levels.count() == 0 {
            let bindings = [&picture[..], &results].concat();
            return self.gpu.submit(|work| self.at_pixels(work, &self.kernels.lay_sharp, &bindings, canvas));
        }
        let (step, [across, down, _]) = levels.analysis(self.gpu, 0, BOX)?;
        let pyramid = [(0, &step), (1, &canvas.levels)];
        // Of the source, laying reads CoC radii alone.
        let laid = [&pyramid[..], &[(2, &frame), (3, &matting), (5, &source.rest)], &results].concat();
        self.gpu.submit(|work| {
            work.pass(&self.kernels.matte, &[&pyramid[..], &picture].concat(), [across, down, 1])?;
            self.blur_and_glow(work, levels, &frame, &canvas.levels)?;
            let fours = (corners(self.size.0), corners(canvas.band.rows.len()));
            at_pixels(work, &self.kernels.lay, &laid, fours)
        })
    }

    /// Level 1 of the blurred content, the blurred alpha and the glow of alpha, from the matted level 1.
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
        canvas: &Canvas<'_>,
    ) -> Result<(), Error> {
        at_pixels(work, kernel, bindings, (self.size.0, canvas.band.rows.len()))
    }
}
