//! The A-buffer and the two B-buffers on a GPU.
//!
//! The rows of a peel that contribute to a level are found before culling. Culling only removes contributions, so these rows
//! include all that are needed.

use super::field::{Field, LevelWeights, Side};
use super::parameters::BBufferParameters;
use super::{BBuffer, ranges_px};
use crate::error::Error;
use crate::gpu::{Band, Buffer, Constant, Gpu, Kernel, Mirrored, Shader, Work, mirrored};
use crate::image::Image;
use crate::methods::contract::{GpuBackend, Plan, Progress};
use crate::methods::shared::{
    self, Backdrop, COVERAGE_PLANES_WGSL, Edge, FIRST_LEVEL_WGSL, Frame, Grid, Levels,
    OTHER_COVERAGE_PLANES_WGSL, PYRAMID_WGSL, Peel, Planes, RowNeeds, SPLAT, Step, at_pixels, corners,
    picture_before,
};
use crate::scene::{OPAQUE_ALPHA, Scene, surface};
use std::ops::Range;

/// Planes of content: red, green and blue.
const CHANNELS: usize = 3;

static SHADER: Shader = Shader {
    name: "b_buffer",
    constants: &[
        ("OPAQUE_ALPHA", Constant::Float(OPAQUE_ALPHA)),
        ("LEVEL_SHARE", Constant::Float(surface::LEVEL_SHARE)),
    ],
    parts: &[
        COVERAGE_PLANES_WGSL,
        OTHER_COVERAGE_PLANES_WGSL,
        PYRAMID_WGSL,
        FIRST_LEVEL_WGSL,
        include_str!("../../../../shaders/methods/b_buffer.wgsl"),
    ],
    structs: &[Step::LAYOUT, Frame::LAYOUT, LevelWeights::LAYOUT, PeelUniform::LAYOUT],
};

mirrored! {
    /// Inputs of a pass over a peel.
    struct PeelUniform {
        /// 1 for the nearest peel.
        is_nearest: u32,
        /// The first row of the pass.
        first_row: i32,
        same_surface_px: f32,
        in_focus_px: f32,
    }
}

impl GpuBackend for BBuffer {
    fn blur(&self, gpu: &Gpu, scene: &Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let size = scene.picture_size();
        let fields = [Side::Far, Side::Near].map(|side| Field::new(side, plan, size));
        // Level 1 always exists, because its buffer has to be bound.
        let coarsest = fields.iter().map(|field| field.coarsest).max().unwrap_or(0).max(1);
        let backdrop = Backdrop::new(scene, plan);
        let peels = shared::peels(scene.clone());
        let ranges_px = peels.iter().map(ranges_px).collect();
        let kernels = Kernels::new(gpu)?;
        let renderer = BandRenderer { gpu, plan, kernels, peels, ranges_px, fields, coarsest };
        let widest = Grid::new(size, coarsest, Edge::Repeat).sizes[0].0;
        let needs = RowNeeds {
            planes: 5 * renderer.peels.len() + 2 * (CHANNELS + 1),
            values: (CHANNELS + 2) * widest.div_ceil(2),
        };
        let reach = shared::reach(coarsest);
        picture_before(gpu, (size, backdrop.as_ref()), (reach, needs), progress, |band, progress| {
            renderer.band(size, band, progress)
        })
    }

    fn shader(&self) -> &'static Shader {
        &SHADER
    }
}

/// The entry points of the shader.
struct Kernels {
    cull: Kernel,
    clear: Kernel,
    splat: Kernel,
    reduce: Kernel,
    saturate_top: Kernel,
    combine_level: Kernel,
    clear_sums: Kernel,
    gather: Kernel,
    composite_field: Kernel,
    composite_in_focus: Kernel,
    normalise: Kernel,
}

impl Kernels {
    fn new(gpu: &Gpu) -> Result<Self, Error> {
        let kernel = |name| gpu.kernel(&SHADER, name);
        Ok(Self {
            cull: kernel("cull")?,
            clear: kernel("clear")?,
            splat: kernel("splat")?,
            reduce: kernel("reduce")?,
            saturate_top: kernel("saturate_top")?,
            combine_level: kernel("combine_level")?,
            clear_sums: kernel("clear_sums")?,
            gather: kernel("gather")?,
            composite_field: kernel("composite_field")?,
            composite_in_focus: kernel("composite_in_focus")?,
            normalise: kernel("normalise")?,
        })
    }
}

/// Renders bands.
struct BandRenderer<'a> {
    gpu: &'a Gpu,
    plan: &'a Plan,
    kernels: Kernels,
    peels: Vec<Peel>,
    /// For each peel, the range of signed CoC radii in each row.
    ranges_px: Vec<Vec<[f32; 2]>>,
    /// Behind focus, and in front of it.
    fields: [Field; 2],
    /// The coarsest level of either field.
    coarsest: usize,
}

/// The buffers of a band.
struct BandBuffers<'a> {
    band: &'a Band,
    width: usize,
    levels: Levels,
    frame: Buffer,
    peels: Vec<Planes>,
    pyramid: Buffer,
    sums: Planes,
    result: Planes,
}

impl BandRenderer<'_> {
    /// Content and, last, coverage of the rows of a band.
    fn band(&self, size: (usize, usize), band: &Band, progress: &Progress<'_>) -> Result<Planes, Error> {
        let buffers = self.buffers(size, band)?;
        self.cull(&buffers)?;
        progress(0.2);
        let [far, near] = &self.fields;
        self.composite_field(far, &buffers)?;
        progress(0.6);
        self.composite_in_focus(&buffers)?;
        self.composite_field(near, &buffers)?;
        let Planes { colors, rest } = &buffers.result;
        let bindings = [(2, &buffers.frame), (6, colors), (7, rest)];
        let made = (buffers.width, band.rows.len());
        self.gpu.submit(|work| at_pixels(work, &self.kernels.normalise, &bindings, made))?;
        Ok(buffers.result)
    }

    /// The buffers of a band, with the peels uploaded.
    fn buffers<'b>(&self, size: (usize, usize), band: &'b Band) -> Result<BandBuffers<'b>, Error> {
        let gpu = self.gpu;
        let levels = Levels::new(Grid::new(size, self.coarsest, Edge::Repeat), &band.rows, CHANNELS + 2);
        let peels =
            self.peels.iter().map(|peel| Planes::from_peel(gpu, &peel.covered, &peel.coc_px, &band.source));
        Ok(BandBuffers {
            band,
            width: size.0,
            frame: gpu.uniform(&levels.frame(band, CHANNELS))?,
            peels: peels.collect::<Result<_, _>>()?,
            pyramid: gpu.zeros::<f32>("the levels of the pyramid", levels.values())?,
            sums: Planes::zeros(gpu, CHANNELS + 1, size.0 * band.source.len())?,
            result: Planes::zeros(gpu, CHANNELS + 1, size.0 * band.rows.len())?,
            levels,
        })
    }

    /// Inputs of a pass over peel `i` that begins at `first_row`.
    fn peel_uniform(&self, i: usize, first_row: usize) -> Result<Buffer, Error> {
        let parameters = self.plan.parameters.get::<BBufferParameters>();
        self.gpu.uniform(&PeelUniform {
            is_nearest: u32::from(i == 0),
            first_row: first_row as i32,
            same_surface_px: parameters.same_surface_px,
            in_focus_px: parameters.in_focus_px,
        })
    }

    /// The part of `rows` from the first to the last row in which peel `i` has a CoC range that `matches`; `None` without any.
    fn rows_with(
        &self,
        i: usize,
        rows: &Range<usize>,
        matches: impl Fn([f32; 2]) -> bool,
    ) -> Option<Range<usize>> {
        let mut found = rows.clone().filter(|&y| matches(self.ranges_px[i][y]));
        let first = found.next()?;
        Some(first..found.next_back().unwrap_or(first) + 1)
    }

    /// Removes from the peels the contributions that the A-buffer does not need.
    fn cull(&self, buffers: &BandBuffers<'_>) -> Result<(), Error> {
        let source = (buffers.width, buffers.band.source.len());
        self.gpu.submit(|work| {
            for (i, Planes { colors, rest }) in buffers.peels.iter().enumerate() {
                let peel = self.peel_uniform(i, 0)?;
                let bindings =
                    [(2, &buffers.frame), (4, colors), (5, rest), (8, &buffers.sums.colors), (10, &peel)];
                at_pixels(work, &self.kernels.cull, &bindings, source)?;
            }
            Ok(())
        })
    }

    /// Composites the contributions of `field` over the result.
    fn composite_field(&self, field: &Field, buffers: &BandBuffers<'_>) -> Result<(), Error> {
        for n in (1..=field.coarsest).rev() {
            self.gpu.submit(|work| self.add_level(work, field, n, buffers))?;
        }
        self.gpu.submit(|work| {
            self.gather(work, field, buffers)?;
            let level_weights = self.gpu.uniform(&field.level_weights(0))?;
            let (step, _) = buffers.levels.synthesis(self.gpu, 0)?;
            let BandBuffers { sums, result, .. } = buffers;
            let bindings = [
                (0, &step),
                (1, &buffers.pyramid),
                (2, &buffers.frame),
                (3, &level_weights),
                (6, &result.colors),
                (7, &result.rest),
                (8, &sums.colors),
                (9, &sums.rest),
            ];
            let blocks = (corners(buffers.width), corners(buffers.band.rows.len()));
            at_pixels(work, &self.kernels.composite_field, &bindings, blocks)
        })
    }

    /// Computes level `n` from the contributions that go there and from the next coarser level.
    fn add_level(
        &self,
        work: &mut Work<'_>,
        field: &Field,
        n: usize,
        buffers: &BandBuffers<'_>,
    ) -> Result<(), Error> {
        let BandBuffers { levels, pyramid, frame, .. } = buffers;
        let (step, groups) = levels.analysis(self.gpu, 0, SPLAT)?;
        work.pass(&self.kernels.clear, &[(0, &step), (1, pyramid)], groups)?;
        let level_weights = self.gpu.uniform(&field.level_weights(n))?;
        for i in 0..buffers.peels.len() {
            self.splat(work, field, (n, i), &level_weights, buffers)?;
        }
        for level in 1..n {
            let (step, groups) = levels.analysis(self.gpu, level, SPLAT)?;
            work.pass(&self.kernels.reduce, &[(0, &step), (1, pyramid)], groups)?;
        }
        if n == field.coarsest {
            let (step, groups) = levels.each_of(self.gpu, n)?;
            return work.pass(&self.kernels.saturate_top, &[(0, &step), (1, pyramid), (2, frame)], groups);
        }
        let (step, [across, down, _]) = levels.synthesis(self.gpu, n)?;
        let bindings = [(0, &step), (1, pyramid), (2, frame), (3, &level_weights)];
        work.pass(&self.kernels.combine_level, &bindings, [across, down, 1])
    }

    /// Adds to level 1 the contributions of peel `i` that go to level `n`.
    fn splat(
        &self,
        work: &mut Work<'_>,
        field: &Field,
        (n, i): (usize, usize),
        level_weights: &Buffer,
        buffers: &BandBuffers<'_>,
    ) -> Result<(), Error> {
        let may_have = |range_px| field.may_have(n, range_px);
        let Some(rows) = self.rows_with(i, &buffers.band.source, may_have) else { return Ok(()) };
        let (step, [across, down, _]) = buffers.levels.analysis_of_rows(self.gpu, SPLAT, &rows)?;
        let (peel, Planes { colors, rest }) = (self.peel_uniform(i, rows.start)?, &buffers.peels[i]);
        let bindings = [
            (0, &step),
            (1, &buffers.pyramid),
            (2, &buffers.frame),
            (3, level_weights),
            (4, colors),
            (5, rest),
            (10, &peel),
        ];
        work.pass(&self.kernels.splat, &bindings, [across, down, 1])
    }

    /// Sums the contributions of `field` that go to level 0.
    fn gather(&self, work: &mut Work<'_>, field: &Field, buffers: &BandBuffers<'_>) -> Result<(), Error> {
        let BandBuffers { frame, sums, width, band, .. } = buffers;
        let sums = [(8, &sums.colors), (9, &sums.rest)];
        let cleared = [&[(2, frame)], &sums[..]].concat();
        at_pixels(work, &self.kernels.clear_sums, &cleared, (*width, band.source.len()))?;
        let level_weights = self.gpu.uniform(&field.level_weights(0))?;
        for (i, Planes { colors, rest }) in buffers.peels.iter().enumerate() {
            let Some(rows) = self.rows_with(i, &band.rows, |range_px| field.may_have(0, range_px)) else {
                continue;
            };
            let peel = self.peel_uniform(i, rows.start)?;
            let inputs = [(2, frame), (3, &level_weights), (4, colors), (5, rest), (10, &peel)];
            let bindings = [&inputs[..], &sums].concat();
            at_pixels(work, &self.kernels.gather, &bindings, (*width, rows.len()))?;
        }
        Ok(())
    }

    /// Composites the contributions in focus over the result, farthest first.
    fn composite_in_focus(&self, buffers: &BandBuffers<'_>) -> Result<(), Error> {
        let in_focus_px = self.plan.parameters.get::<BBufferParameters>().in_focus_px;
        let has_in_focus = |[near, far]: [f32; 2]| near <= in_focus_px && far >= -in_focus_px;
        let BandBuffers { frame, result, .. } = buffers;
        self.gpu.submit(|work| {
            for (i, Planes { colors, rest }) in buffers.peels.iter().enumerate().rev() {
                let Some(rows) = self.rows_with(i, &buffers.band.rows, has_in_focus) else { continue };
                let peel = self.peel_uniform(i, rows.start)?;
                let bindings =
                    [(2, frame), (4, colors), (5, rest), (6, &result.colors), (7, &result.rest), (10, &peel)];
                at_pixels(work, &self.kernels.composite_in_focus, &bindings, (buffers.width, rows.len()))?;
            }
            Ok(())
        })
    }
}
