//! `recursive-gaussian` on a GPU.
//!
//! A pass runs along adjacent lines, so that neighbouring threads read neighbouring values. For rows, the first pass
//! transposes to columns and the last one transposes back. Running sums are whole numbers of steps, as there is no
//! f64: in f32 the error that a firefly leaves in the sum would be visible, and compilers may optimize compensated
//! sums away.
//!
//! A band reads as many rows as the reach of all blurs of a side together, or eight standard deviations: less than
//! `10⁻¹⁵` of the light comes from farther rows. 8K frames that are blurred over hundreds of pixels do not fit into
//! memory with that margin, and are refused.

mod lines;

use super::RecursiveGaussian;
use super::gaussian::{ExtendedBox, MIN_MAGNITUDE, PASSES};
use super::layers::{Layers, cascade_sigma_px, sigma_px};
use super::matting::{CompositeOrder, DepthPeel, Matte, Ramp};
use super::parameters::RecursiveGaussianParameters;
use crate::error::Error;
use crate::gpu::{Band, Buffer, Constant, Gpu, Kernel, Mirrored, Shader, Work, mirrored};
use crate::image::{Image, Plane};
use crate::methods::contract::{GpuBackend, Plan, Progress};
use crate::methods::shared::{
    Backdrop, COVERAGE_PLANES_WGSL, Frame, OTHER_COVERAGE_PLANES_WGSL, Planes, RowNeeds, at_pixels, peels,
    picture_before,
};
use crate::parallel;
use crate::scene::{OPAQUE_ALPHA, Scene};
use lines::{Lines, blur_passes};
use std::ops::Range;

/// Planes of content: red, green and blue.
const CHANNELS: usize = 3;

static SHADER: Shader = Shader {
    name: "recursive_gaussian",
    constants: &[
        ("OPAQUE_ALPHA", Constant::Float(OPAQUE_ALPHA)),
        ("MIN_MAGNITUDE", Constant::Float(MIN_MAGNITUDE)),
    ],
    parts: &[
        COVERAGE_PLANES_WGSL,
        OTHER_COVERAGE_PLANES_WGSL,
        include_str!("../../../../../shaders/methods/recursive_gaussian.wgsl"),
    ],
    structs: &[Frame::LAYOUT, Matting::LAYOUT, Lines::LAYOUT, Part::LAYOUT],
};

mirrored! {
    /// The matting functions of a layer, and parameters of a peel's pass.
    struct Matting {
        rise_from: f32,
        rise_to: f32,
        rise_slope: f32,
        own_from: f32,
        own_to: f32,
        own_slope: f32,
        fall_from: f32,
        fall_to: f32,
        fall_slope: f32,
        /// Whether the peel is the first one of the layer.
        first: u32,
    }
}

mirrored! {
    /// A range of the rows that a band reads.
    struct Part {
        first_row: i32,
        rows: i32,
    }
}

/// Standard deviations beyond which a Gaussian is taken as zero.
const MAX_DEVIATIONS: f32 = 8.0;

/// Maximum number of layers of a fragment: its own and both neighbours.
const LAYERS_OF_A_FRAGMENT: f32 = 3.0;

impl GpuBackend for RecursiveGaussian {
    fn blur(&self, gpu: &Gpu, scene: &Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let parameters = plan.parameters.get::<RecursiveGaussianParameters>();
        let (size, coc_infinity_px) = (scene.picture_size(), scene.coc_infinity_px);
        let layers = Layers::new(plan.coc_range_px, coc_infinity_px, parameters);
        let backdrop = Backdrop::new(scene, plan);
        let peels = peels(scene.clone()).into_iter().map(|peel| DepthPeel::new(peel, coc_infinity_px));
        let peels: Vec<DepthPeel> = peels.collect();
        let renderer = Renderer {
            gpu,
            kernels: Kernels::new(gpu)?,
            layers,
            cascaded: parameters.cascaded,
            max_value: max_value(&peels),
            peels,
        };
        let planes = 5 * (CHANNELS + 1);
        let needs = RowNeeds { planes: 6 * renderer.peels.len() + planes, values: 0 };
        let reach = reach(&renderer.layers, renderer.cascaded);
        picture_before(gpu, (size, backdrop.as_ref()), (reach, needs), progress, |band, progress| {
            renderer.band(size, band, progress)
        })
    }

    fn shader(&self) -> &'static Shader {
        &SHADER
    }
}

/// Reach of all blurs together in pixels, up to [`MAX_DEVIATIONS`].
fn reach(layers: &Layers, cascaded: bool) -> usize {
    let max_layer = layers.front.max(layers.back);
    let box_reach = |sigma_px: f32| ExtendedBox::from_sigma(sigma_px).reach();
    let box_reaches = if cascaded {
        (1..=max_layer).map(|layer| box_reach(cascade_sigma_px(layer))).sum()
    } else {
        box_reach(sigma_px(max_layer))
    };
    box_reaches.min((MAX_DEVIATIONS * sigma_px(max_layer)).ceil() as usize)
}

/// Upper bound of all values of composites.
fn max_value(peels: &[DepthPeel]) -> f32 {
    let max_of_row =
        |plane: &Plane, y: usize| plane.row(y).iter().map(|value| value.abs()).fold(0.0, f32::max);
    let max_value = |plane: &Plane| {
        let rows = parallel::map(plane.height(), &|y| max_of_row(plane, y));
        rows.into_iter().fold(0.0, f32::max)
    };
    let from_peel = |peel: &DepthPeel| peel.planes.content.iter().map(max_value).fold(1.0, f32::max);
    LAYERS_OF_A_FRAGMENT * peels.iter().map(from_peel).sum::<f32>()
}

impl Matting {
    fn new(Matte { rise, own, fall }: &Matte, first: bool) -> Self {
        // Shaders have no infinity. No finite depth is past the largest finite value either.
        let finite = |value: f32| value.clamp(f32::MIN, f32::MAX);
        let values = |ramp: &Ramp| [ramp.from, ramp.to, ramp.slope].map(finite);
        let [rise_from, rise_to, rise_slope] = values(rise);
        let [own_from, own_to, own_slope] = values(own);
        let [fall_from, fall_to, fall_slope] = values(fall);
        Self {
            rise_from,
            rise_to,
            rise_slope,
            own_from,
            own_to,
            own_slope,
            fall_from,
            fall_to,
            fall_slope,
            first: u32::from(first),
        }
    }
}

/// The entry points.
struct Kernels {
    visibility: Kernel,
    add_share: Kernel,
    compose_over: Kernel,
    compose_under: Kernel,
    box_pass: Kernel,
    finish: Kernel,
}

impl Kernels {
    fn new(gpu: &Gpu) -> Result<Self, Error> {
        let kernel = |name| gpu.kernel(&SHADER, name);
        Ok(Self {
            visibility: kernel("update_visibility")?,
            add_share: kernel("add_share")?,
            compose_over: kernel("compose_over")?,
            compose_under: kernel("compose_under")?,
            box_pass: kernel("box_pass")?,
            finish: kernel("finish")?,
        })
    }
}

/// State shared by all bands.
struct Renderer<'a> {
    gpu: &'a Gpu,
    kernels: Kernels,
    layers: Layers,
    cascaded: bool,
    /// Upper bound of all values of composites.
    max_value: f32,
    peels: Vec<DepthPeel>,
}

/// The buffers of a band.
struct BandBuffers<'a> {
    band: &'a Band,
    width: usize,
    /// Position of the rows that are read.
    frame: Buffer,
    peels: Vec<Planes>,
    /// Visibility of each peel.
    visibility: Vec<Buffer>,
    /// The current layer.
    layer: Planes,
    /// Intermediate planes of blurs.
    scratch: Planes,
}

/// The layers on one side of focus, composited from the outermost towards focus.
struct FocusSide {
    composite: Planes,
    order: CompositeOrder,
    /// Range of the rows read by the band that may have content.
    rows: Range<usize>,
}

impl Renderer<'_> {
    /// Renders the rows of a band.
    fn band(&self, size: (usize, usize), band: &Band, progress: &Progress<'_>) -> Result<Planes, Error> {
        let buffers = self.buffers(size, band)?;
        self.find_visibility(&buffers)?;
        let focus_side =
            |order| Ok::<_, Error>(FocusSide { composite: self.empty_planes(&buffers)?, order, rows: 0..0 });
        let (mut front, mut back) = (focus_side(CompositeOrder::Under)?, focus_side(CompositeOrder::Over)?);
        for layer in -self.layers.front..0 {
            self.add(&mut front, layer, &buffers)?;
            progress((layer + self.layers.front) as f32 / self.layers.count() as f32);
        }
        for layer in (0..=self.layers.back).rev() {
            self.add(&mut back, layer, &buffers)?;
            progress((self.layers.count() as i32 - layer - 1) as f32 / self.layers.count() as f32);
        }
        let (sides, all_rows) = ([&front.composite, &back.composite], 0..band.source.len());
        self.gpu
            .submit(|work| self.compose(work, sides, &self.kernels.compose_under, &all_rows, &buffers))?;
        self.finish(size, &front.composite, &buffers)
    }

    fn buffers<'b>(&self, size: (usize, usize), band: &'b Band) -> Result<BandBuffers<'b>, Error> {
        let (gpu, source) = (self.gpu, &band.source);
        let pixels = size.0 * source.len();
        let peels = self.peels.iter().map(|peel| Planes::from_peel(gpu, &peel.planes, &peel.depth, source));
        let zeros = self.peels.iter().skip(1).map(|_| gpu.zeros::<f32>("visibility", pixels));
        let ones = gpu.upload("visibility", &vec![1.0f32; pixels]);
        let empty_planes = || Planes::zeros(gpu, CHANNELS + 1, pixels);
        let whole = Band { rows: source.clone(), source: source.clone() };
        Ok(BandBuffers {
            band,
            width: size.0,
            frame: gpu.uniform(&Frame::new(size, &whole, CHANNELS))?,
            peels: peels.collect::<Result<_, _>>()?,
            visibility: [ones].into_iter().chain(zeros).collect::<Result<_, _>>()?,
            layer: empty_planes()?,
            scratch: empty_planes()?,
        })
    }

    /// Empty coverage planes for the rows that are read.
    fn empty_planes(&self, buffers: &BandBuffers<'_>) -> Result<Planes, Error> {
        Planes::zeros(self.gpu, CHANNELS + 1, buffers.width * buffers.band.source.len())
    }

    /// Computes the visibility of each peel behind those before it.
    fn find_visibility(&self, buffers: &BandBuffers<'_>) -> Result<(), Error> {
        let BandBuffers { frame, peels, visibility, .. } = buffers;
        let all_rows = 0..buffers.band.source.len();
        self.gpu.submit(|work| {
            for (peel, visibility) in peels.iter().zip(visibility.windows(2)) {
                let bindings = [(2, frame), (5, &peel.rest), (10, &visibility[0]), (11, &visibility[1])];
                self.dispatch_rows(work, &self.kernels.visibility, &bindings, &all_rows, buffers)?;
            }
            Ok(())
        })
    }

    /// Adds the next layer towards focus, as on the CPU.
    fn add(&self, focus_side: &mut FocusSide, layer: i32, buffers: &BandBuffers<'_>) -> Result<(), Error> {
        let cascaded = self.cascaded || layer == 0;
        let kernel = match focus_side.order {
            CompositeOrder::Over => &self.kernels.compose_over,
            CompositeOrder::Under => &self.kernels.compose_under,
        };
        let matte = Matte::new(&self.layers, layer);
        let mut layer_rows = self.layer_rows(&matte, buffers);
        self.gpu.submit(|work| {
            if !cascaded {
                layer_rows = widened(&layer_rows, sigma_px(layer), buffers);
            }
            self.matte(work, &matte, &layer_rows, buffers)?;
            if !cascaded {
                self.blur(work, &buffers.layer, sigma_px(layer), &layer_rows, buffers)?;
            }
            self.compose(work, [&focus_side.composite, &buffers.layer], kernel, &layer_rows, buffers)?;
            focus_side.rows = hull(&focus_side.rows, &layer_rows);
            if cascaded {
                focus_side.rows = widened(&focus_side.rows, cascade_sigma_px(layer), buffers);
                self.blur(work, &focus_side.composite, cascade_sigma_px(layer), &focus_side.rows, buffers)?;
            }
            Ok(())
        })
    }

    /// Range of the rows read by the band in which a layer may have content.
    fn layer_rows(&self, matte: &Matte, buffers: &BandBuffers<'_>) -> Range<usize> {
        let source = &buffers.band.source;
        let overlaps =
            |&y: &usize| self.peels.iter().any(|peel| matte.overlaps(peel.row_ranges[source.start + y]));
        let mut rows = (0..source.len()).filter(overlaps);
        let Some(first) = rows.next() else { return 0..0 };
        first..rows.next_back().unwrap_or(first) + 1
    }

    /// Mattes these rows of a layer out of the peels.
    fn matte(
        &self,
        work: &mut Work<'_>,
        matte: &Matte,
        rows: &Range<usize>,
        buffers: &BandBuffers<'_>,
    ) -> Result<(), Error> {
        let BandBuffers { frame, peels, visibility, layer, band, .. } = buffers;
        let overlaps = |peel: &DepthPeel| {
            peel.row_ranges[band.source.clone()].iter().any(|&range| matte.overlaps(range))
        };
        let overlapping = self.peels.iter().enumerate().filter(|(_, peel)| overlaps(peel));
        for (count, (i, _)) in overlapping.enumerate() {
            let matting = self.gpu.uniform(&Matting::new(matte, count == 0))?;
            let bindings = [
                (2, frame),
                (3, &matting),
                (4, &peels[i].colors),
                (5, &peels[i].rest),
                (8, &layer.colors),
                (9, &layer.rest),
                (10, &visibility[i]),
            ];
            self.dispatch_rows(work, &self.kernels.add_share, &bindings, rows, buffers)?;
        }
        Ok(())
    }

    /// Composites these rows of a composite with a layer, in front of it or behind it.
    fn compose(
        &self,
        work: &mut Work<'_>,
        [composite, layer]: [&Planes; 2],
        kernel: &Kernel,
        rows: &Range<usize>,
        buffers: &BandBuffers<'_>,
    ) -> Result<(), Error> {
        let bindings = [
            (2, &buffers.frame),
            (6, &composite.colors),
            (7, &composite.rest),
            (8, &layer.colors),
            (9, &layer.rest),
        ];
        self.dispatch_rows(work, kernel, &bindings, rows, buffers)
    }

    /// Blurs these rows of content and coverage alike, rows first; within the blur's reach beyond them all values are
    /// zero.
    fn blur(
        &self,
        work: &mut Work<'_>,
        composite: &Planes,
        sigma_px: f32,
        rows: &Range<usize>,
        buffers: &BandBuffers<'_>,
    ) -> Result<(), Error> {
        if sigma_px <= 0.0 || rows.is_empty() {
            return Ok(());
        }
        let filter = ExtendedBox::from_sigma(sigma_px);
        let passes = blur_passes(&filter, (buffers.width, buffers.band.source.len()), rows, self.max_value);
        let Planes { colors, rest: others } = &buffers.scratch;
        self.passes(work, [&composite.colors, colors], &passes, CHANNELS)?;
        self.passes(work, [&composite.rest, others], &passes, 1)
    }

    /// Blurs `count` planes; the passes alternate between two buffers, and the result is in the first one.
    fn passes(
        &self,
        work: &mut Work<'_>,
        [planes, scratch]: [&Buffer; 2],
        passes: &[Lines; 2 * PASSES],
        count: usize,
    ) -> Result<(), Error> {
        /// Threads of a workgroup.
        const LANES: u32 = 64;
        for (pass, lines) in passes.iter().enumerate() {
            let uniform = self.gpu.uniform(lines)?;
            let [lines_across, chunks] = [(lines.count, LANES), (lines.length, lines.chunk as u32)]
                .map(|(all, part)| (all as u32).div_ceil(part));
            let [from, to] = if pass % 2 == 0 { [planes, scratch] } else { [scratch, planes] };
            let bindings = [(12, from), (13, to), (14, &uniform)];
            work.pass(&self.kernels.box_pass, &bindings, [lines_across, chunks, count as u32])?;
        }
        Ok(())
    }

    /// Dispatches `kernel` for every pixel of these rows of those that the band reads.
    fn dispatch_rows(
        &self,
        work: &mut Work<'_>,
        kernel: &Kernel,
        bindings: &[(u32, &Buffer)],
        rows: &Range<usize>,
        buffers: &BandBuffers<'_>,
    ) -> Result<(), Error> {
        if rows.is_empty() {
            return Ok(());
        }
        let part = self.gpu.uniform(&Part { first_row: rows.start as i32, rows: rows.len() as i32 })?;
        let bindings = [bindings, &[(15, &part)]].concat();
        at_pixels(work, kernel, &bindings, (buffers.width, rows.len()))
    }

    /// The rows that the band renders, divided by coverage.
    fn finish(
        &self,
        size: (usize, usize),
        composite: &Planes,
        buffers: &BandBuffers<'_>,
    ) -> Result<Planes, Error> {
        let made = (size.0, buffers.band.rows.len());
        let result = Planes::zeros(self.gpu, CHANNELS + 1, made.0 * made.1)?;
        let frame = self.gpu.uniform(&Frame::new(size, buffers.band, CHANNELS))?;
        let bindings = [
            (2, &frame),
            (6, &result.colors),
            (7, &result.rest),
            (8, &composite.colors),
            (9, &composite.rest),
        ];
        self.gpu.submit(|work| at_pixels(work, &self.kernels.finish, &bindings, made))?;
        Ok(result)
    }
}

/// Smallest range that contains two ranges of rows, either of which may be empty.
fn hull(one: &Range<usize>, other: &Range<usize>) -> Range<usize> {
    match (one.is_empty(), other.is_empty()) {
        (true, _) => other.clone(),
        (_, true) => one.clone(),
        _ => one.start.min(other.start)..one.end.max(other.end),
    }
}

/// The rows that may have content after a blur.
fn widened(rows: &Range<usize>, sigma_px: f32, buffers: &BandBuffers<'_>) -> Range<usize> {
    let reach = ExtendedBox::from_sigma(sigma_px).reach();
    if rows.is_empty() || sigma_px <= 0.0 {
        return rows.clone();
    }
    rows.start.saturating_sub(reach)..(rows.end + reach).min(buffers.band.source.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reach_of_a_cascade_is_that_of_its_blurs_up_to_eight_deviations() {
        let layers = |radius_px: f32| {
            let parameters = RecursiveGaussianParameters::default();
            Layers::new([-radius_px, 0.0], 1000.0, &parameters)
        };
        // σ̂ = 3, 2, 1 have boxes of radius 2, 1, 0: 4 · (3 + 2 + 1).
        assert_eq!(reach(&layers(3.6), true), 24);
        let wide = layers(200.0);
        assert_eq!(reach(&wide, true), (8.0 * sigma_px(wide.front)).ceil() as usize);
        assert_eq!(reach(&wide, false), ExtendedBox::from_sigma(sigma_px(wide.front)).reach());
    }
}
