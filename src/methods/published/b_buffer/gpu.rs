//! The A-buffer and the two B-buffers on a GPU.
//!
//! The rows of a peel that have contributions to a level are found before culling, which can only make them fewer.

use super::field::{Field, Side, Weighing};
use super::parameters::BBufferParameters;
use super::{BBuffer, ranges_px};
use crate::error::Error;
use crate::gpu::{Band, Buffer, Constant, Gpu, Kernel, Mirrored, Shader, Work, mirrored};
use crate::image::Image;
use crate::methods::contract::Plan;
use crate::methods::contract::{GpuBackend, Progress};
use crate::methods::shared::{
    self, COVERAGE_PLANES_WGSL, Edge, FIRST_LEVEL_WGSL, Frame, Grid, Levels, OTHER_COVERAGE_PLANES_WGSL,
    PYRAMID_WGSL, Peel, Planes, RowNeeds, SPLAT, Step, at_pixels, corners, picture_in_bands,
};
use crate::scene::{EffectKind, OPAQUE_ALPHA, Scene, surface};
use std::ops::Range;

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
    structs: &[Step::LAYOUT, Frame::LAYOUT, Weighing::LAYOUT, PeelStats::LAYOUT],
};

mirrored! {
    /// What a pass has to know of a peel.
    struct PeelStats {
        /// Whether it is opaque where it covers: all but the backdrop of an open background are.
        shows: u32,
        /// Whether it is the nearest.
        first: u32,
        /// The first row that the pass looks at.
        first_row: i32,
        same_surface_px: f32,
        in_focus_px: f32,
    }
}

impl GpuBackend for BBuffer {
    fn blur(&self, gpu: &Gpu, scene: &Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let size = scene.picture_size();
        let fields = [Side::Far, Side::Near].map(|side| Field::new(side, plan, size));
        // Level 1 is there to be bound even where nothing goes to it.
        let top = fields.iter().map(|field| field.top).max().unwrap_or(0).max(1);
        let peels = shared::peels(scene.clone(), plan);
        let ranges_px = peels.iter().map(ranges_px).collect();
        let open = plan.does(EffectKind::TransparentBackground);
        let painter = Painter { gpu, plan, kernels: Kernels::new(gpu)?, peels, ranges_px, fields, top, open };
        let channels = painter.channels();
        let widest = Grid::new(size, top, Edge::Repeat).sizes[0].0;
        let needs = RowNeeds {
            planes: 5 * painter.peels.len() + 2 * (channels + 1),
            values: (channels + 2) * widest.div_ceil(2),
        };
        let reach = shared::reach(top);
        picture_in_bands(gpu, (size, open), (reach, needs), progress, |band, progress| {
            painter.band(size, band, progress)
        })
    }

    fn shader(&self) -> &'static Shader {
        &SHADER
    }
}

/// The entry points.
struct Kernels {
    cull: Kernel,
    clear: Kernel,
    splat: Kernel,
    reduce: Kernel,
    saturate_top: Kernel,
    unite_level: Kernel,
    clear_sums: Kernel,
    gather: Kernel,
    lay: Kernel,
    lay_in_focus: Kernel,
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
            unite_level: kernel("unite_level")?,
            clear_sums: kernel("clear_sums")?,
            gather: kernel("gather")?,
            lay: kernel("lay")?,
            lay_in_focus: kernel("lay_in_focus")?,
            normalise: kernel("normalise")?,
        })
    }
}

/// What every band is made from.
struct Painter<'a> {
    gpu: &'a Gpu,
    plan: &'a Plan,
    kernels: Kernels,
    peels: Vec<Peel>,
    /// Of each peel, the range of CoC radii in each row.
    ranges_px: Vec<Vec<[f32; 2]>>,
    /// Behind focus, and in front of it.
    fields: [Field; 2],
    /// The coarsest level of either.
    top: usize,
    open: bool,
}

/// The buffers of a band.
struct Canvas<'a> {
    band: &'a Band,
    width: usize,
    levels: Levels,
    frame: Buffer,
    peels: Vec<Planes>,
    pyramid: Buffer,
    sums: Planes,
    result: Planes,
}

impl Painter<'_> {
    /// Planes of content.
    fn channels(&self) -> usize {
        if self.open { 4 } else { 3 }
    }

    /// Content, and then coverage, of a band's rows.
    fn band(&self, size: (usize, usize), band: &Band, progress: &Progress<'_>) -> Result<Planes, Error> {
        let canvas = self.canvas(size, band)?;
        self.cull(&canvas)?;
        progress(0.2);
        let [far, near] = &self.fields;
        self.lay_field(far, &canvas)?;
        progress(0.6);
        self.lay_in_focus(&canvas)?;
        self.lay_field(near, &canvas)?;
        let Planes { colors, rest } = &canvas.result;
        let bindings = [(2, &canvas.frame), (6, colors), (7, rest)];
        let made = (canvas.width, band.rows.len());
        self.gpu.submit(|work| at_pixels(work, &self.kernels.normalise, &bindings, made))?;
        Ok(canvas.result)
    }

    fn canvas<'b>(&self, size: (usize, usize), band: &'b Band) -> Result<Canvas<'b>, Error> {
        let (gpu, channels) = (self.gpu, self.channels());
        let levels = Levels::new(Grid::new(size, self.top, Edge::Repeat), &band.rows, channels + 2);
        let peels =
            self.peels.iter().map(|peel| Planes::from_peel(gpu, &peel.covered, &peel.coc_px, &band.source));
        Ok(Canvas {
            band,
            width: size.0,
            frame: gpu.uniform(&levels.frame(band, channels))?,
            peels: peels.collect::<Result<_, _>>()?,
            pyramid: gpu.zeros::<f32>("the levels of the pyramid", levels.values())?,
            sums: Planes::zeros(gpu, channels + 1, size.0 * band.source.len())?,
            result: Planes::zeros(gpu, channels + 1, size.0 * band.rows.len())?,
            levels,
        })
    }

    /// What a pass that begins at a row has to know of peel `i`.
    fn stats(&self, i: usize, first_row: usize) -> Result<Buffer, Error> {
        let parameters = self.plan.parameters.get::<BBufferParameters>();
        self.gpu.uniform(&PeelStats {
            shows: u32::from(!self.open || i + 1 < self.peels.len()),
            first: u32::from(i == 0),
            first_row: first_row as i32,
            same_surface_px: parameters.same_surface_px,
            in_focus_px: parameters.in_focus_px,
        })
    }

    /// From the first to the last of `rows` in which peel `i` has CoC radii that are `wanted`.
    fn rows_with(
        &self,
        i: usize,
        rows: &Range<usize>,
        wanted: impl Fn([f32; 2]) -> bool,
    ) -> Option<Range<usize>> {
        let mut found = rows.clone().filter(|&y| wanted(self.ranges_px[i][y]));
        let first = found.next()?;
        Some(first..found.next_back().unwrap_or(first) + 1)
    }

    /// Takes from the peels what the A-buffer need not keep.
    fn cull(&self, canvas: &Canvas<'_>) -> Result<(), Error> {
        let source = (canvas.width, canvas.band.source.len());
        self.gpu.submit(|work| {
            for (i, Planes { colors, rest }) in canvas.peels.iter().enumerate() {
                let stats = self.stats(i, 0)?;
                let bindings =
                    [(2, &canvas.frame), (4, colors), (5, rest), (8, &canvas.sums.colors), (10, &stats)];
                at_pixels(work, &self.kernels.cull, &bindings, source)?;
            }
            Ok(())
        })
    }

    /// Lays the contributions of `field` over the result.
    fn lay_field(&self, field: &Field, canvas: &Canvas<'_>) -> Result<(), Error> {
        for n in (1..=field.top).rev() {
            self.gpu.submit(|work| self.add_level(work, field, n, canvas))?;
        }
        self.gpu.submit(|work| {
            self.gather(work, field, canvas)?;
            let weighing = self.gpu.uniform(&field.weighing(0))?;
            let (step, _) = canvas.levels.synthesis(self.gpu, 0)?;
            let Canvas { sums, result, .. } = canvas;
            let bindings = [
                (0, &step),
                (1, &canvas.pyramid),
                (2, &canvas.frame),
                (3, &weighing),
                (6, &result.colors),
                (7, &result.rest),
                (8, &sums.colors),
                (9, &sums.rest),
            ];
            let fours = (corners(canvas.width), corners(canvas.band.rows.len()));
            at_pixels(work, &self.kernels.lay, &bindings, fours)
        })
    }

    /// Makes level `n` of what goes there and of the level above it.
    fn add_level(
        &self,
        work: &mut Work<'_>,
        field: &Field,
        n: usize,
        canvas: &Canvas<'_>,
    ) -> Result<(), Error> {
        let Canvas { levels, pyramid, frame, .. } = canvas;
        let (step, groups) = levels.analysis(self.gpu, 0, SPLAT)?;
        work.pass(&self.kernels.clear, &[(0, &step), (1, pyramid)], groups)?;
        let weighing = self.gpu.uniform(&field.weighing(n))?;
        for i in 0..canvas.peels.len() {
            self.splat(work, field, (n, i), &weighing, canvas)?;
        }
        for level in 1..n {
            let (step, groups) = levels.analysis(self.gpu, level, SPLAT)?;
            work.pass(&self.kernels.reduce, &[(0, &step), (1, pyramid)], groups)?;
        }
        if n == field.top {
            let (step, groups) = levels.each_of(self.gpu, n)?;
            return work.pass(&self.kernels.saturate_top, &[(0, &step), (1, pyramid), (2, frame)], groups);
        }
        let (step, [across, down, _]) = levels.synthesis(self.gpu, n)?;
        let bindings = [(0, &step), (1, pyramid), (2, frame), (3, &weighing)];
        work.pass(&self.kernels.unite_level, &bindings, [across, down, 1])
    }

    /// Adds to level 1 what of peel `i` goes to level `n`.
    fn splat(
        &self,
        work: &mut Work<'_>,
        field: &Field,
        (n, i): (usize, usize),
        weighing: &Buffer,
        canvas: &Canvas<'_>,
    ) -> Result<(), Error> {
        let has = |range| field.has(n, range);
        let Some(rows) = self.rows_with(i, &canvas.band.source, has) else { return Ok(()) };
        let (step, [across, down, _]) = canvas.levels.analysis_of_rows(self.gpu, SPLAT, &rows)?;
        let (stats, Planes { colors, rest }) = (self.stats(i, rows.start)?, &canvas.peels[i]);
        let bindings = [
            (0, &step),
            (1, &canvas.pyramid),
            (2, &canvas.frame),
            (3, weighing),
            (4, colors),
            (5, rest),
            (10, &stats),
        ];
        work.pass(&self.kernels.splat, &bindings, [across, down, 1])
    }

    /// Sums what of `field` goes to level 0.
    fn gather(&self, work: &mut Work<'_>, field: &Field, canvas: &Canvas<'_>) -> Result<(), Error> {
        let Canvas { frame, sums, width, band, .. } = canvas;
        let sums = [(8, &sums.colors), (9, &sums.rest)];
        let clear = [&[(2, frame)], &sums[..]].concat();
        at_pixels(work, &self.kernels.clear_sums, &clear, (*width, band.source.len()))?;
        let weighing = self.gpu.uniform(&field.weighing(0))?;
        for (i, Planes { colors, rest }) in canvas.peels.iter().enumerate() {
            let Some(rows) = self.rows_with(i, &band.rows, |range| field.has(0, range)) else { continue };
            let stats = self.stats(i, rows.start)?;
            let peel = [(2, frame), (3, &weighing), (4, colors), (5, rest), (10, &stats)];
            let bindings = [&peel[..], &sums].concat();
            at_pixels(work, &self.kernels.gather, &bindings, (*width, rows.len()))?;
        }
        Ok(())
    }

    /// Lays the contributions in focus over the result, farthest first.
    fn lay_in_focus(&self, canvas: &Canvas<'_>) -> Result<(), Error> {
        let in_focus_px = self.plan.parameters.get::<BBufferParameters>().in_focus_px;
        let wanted = |[near, far]: [f32; 2]| near <= in_focus_px && far >= -in_focus_px;
        let Canvas { frame, result, .. } = canvas;
        self.gpu.submit(|work| {
            for (i, Planes { colors, rest }) in canvas.peels.iter().enumerate().rev() {
                let Some(rows) = self.rows_with(i, &canvas.band.rows, wanted) else { continue };
                let stats = self.stats(i, rows.start)?;
                let bindings = [
                    (2, frame),
                    (4, colors),
                    (5, rest),
                    (6, &result.colors),
                    (7, &result.rest),
                    (10, &stats),
                ];
                at_pixels(work, &self.kernels.lay_in_focus, &bindings, (canvas.width, rows.len()))?;
            }
            Ok(())
        })
    }
}
