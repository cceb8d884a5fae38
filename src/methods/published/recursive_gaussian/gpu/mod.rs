//! The cascade on a GPU.
//!
//! A pass runs along lines that lie side by side, so that neighbouring threads read neighbouring values; of rows, the first pass makes
//! columns and the last one rows again. Its running sums are whole numbers of steps, as there is no double precision: of single precision, what a firefly
//! leaves behind when it leaves the sum would show, and compensated sums are what compilers are free to undo.
//!
//! A band reads as many rows as all blurs of a side together carry a sample, or eight standard deviations: past that, less than
//! `10⁻¹⁵` of its light comes. Frames of 8K that are blurred over hundreds of pixels leave no room for that, and are refused.

mod lines;

use super::RecursiveGaussian;
use super::gaussian::{ExtendedBox, LEAST, PASSES};
use super::layers::{Layers, cascade_sigma_px, sigma_px};
use super::matting::{DepthPeel, Matte, Ramp, Side};
use super::parameters::RecursiveGaussianParameters;
use crate::error::Error;
use crate::gpu::{Band, Buffer, Constant, Gpu, Kernel, Mirrored, Shader, Work, mirrored};
use crate::image::{Image, Plane};
use crate::methods::contract::Plan;
use crate::methods::contract::{GpuBackend, Progress};
use crate::methods::shared::{
    COVERAGE_PLANES_WGSL, Frame, OTHER_COVERAGE_PLANES_WGSL, Planes, RowNeeds, at_pixels, peels,
    picture_in_bands,
};
use crate::scene::{EffectKind, OPAQUE_ALPHA, Scene};
use lines::{Lines, blur_passes};
use rayon::prelude::*;
use std::ops::Range;

static SHADER: Shader = Shader {
    name: "recursive_gaussian",
    constants: &[("OPAQUE_ALPHA", Constant::Float(OPAQUE_ALPHA)), ("LEAST", Constant::Float(LEAST))],
    parts: &[
        COVERAGE_PLANES_WGSL,
        OTHER_COVERAGE_PLANES_WGSL,
        include_str!("../../../../../shaders/methods/recursive_gaussian.wgsl"),
    ],
    structs: &[Frame::LAYOUT, Matting::LAYOUT, Lines::LAYOUT, Part::LAYOUT],
};

mirrored! {
    /// The matting functions of a layer, and what a pass has to know of a peel.
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
        /// Whether the peel is opaque where it covers: all but the backdrop of an open background are.
        shows: u32,
        /// Whether it is the first of the layer.
        first: u32,
    }
}

mirrored! {
    /// Some of the rows that a band reads.
    struct Part {
        first_row: i32,
        rows: i32,
    }
}

/// Standard deviations past which a Gaussian is nothing.
const MAX_DEVIATIONS: f32 = 8.0;

/// Layers that a fragment is in, at most: its own and both neighbours.
const LAYERS_OF_A_FRAGMENT: f32 = 3.0;

impl GpuBackend for RecursiveGaussian {
    fn blur(&self, gpu: &Gpu, scene: &Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let parameters = plan.parameters.get::<RecursiveGaussianParameters>();
        let (size, coc_infinity_px) = (scene.picture_size(), scene.coc_infinity_px);
        let layers = Layers::new(plan.coc_range_px, coc_infinity_px, parameters);
        let peels = peels(scene.clone(), plan).into_iter().map(|peel| DepthPeel::new(peel, coc_infinity_px));
        let peels: Vec<DepthPeel> = peels.collect();
        let open = plan.does(EffectKind::TransparentBackground);
        let painter = Painter {
            gpu,
            kernels: Kernels::new(gpu)?,
            layers,
            cascaded: parameters.cascaded,
            brightest: brightest(&peels),
            peels,
            open,
        };
        let planes = 5 * (painter.channels() + 1);
        let needs = RowNeeds { planes: 6 * painter.peels.len() + planes, values: 0 };
        let reach = reach(&painter.layers, painter.cascaded);
        picture_in_bands(gpu, (size, open), (reach, needs), progress, |band, progress| {
            painter.band(size, band, progress)
        })
    }

    fn shader(&self) -> &'static Shader {
        &SHADER
    }
}

/// How far in pixels the blurs carry a sample, as far as it matters.
fn reach(layers: &Layers, cascaded: bool) -> usize {
    let most = layers.front.max(layers.back);
    let carried = |sigma_px: f32| ExtendedBox::from_sigma(sigma_px).reach();
    let all = if cascaded {
        (1..=most).map(|layer| carried(cascade_sigma_px(layer))).sum()
    } else {
        carried(sigma_px(most))
    };
    all.min((MAX_DEVIATIONS * sigma_px(most)).ceil() as usize)
}

/// What no value of any covered exceeds.
fn brightest(peels: &[DepthPeel]) -> f32 {
    let brightest =
        |plane: &Plane| plane.values().par_iter().map(|value| value.abs()).reduce(|| 0.0, f32::max);
    let from_peel = |peel: &DepthPeel| peel.covered.content.iter().map(brightest).fold(1.0, f32::max);
    LAYERS_OF_A_FRAGMENT * peels.iter().map(from_peel).sum::<f32>()
}

impl Matting {
    fn new(Matte { rise, own, fall }: &Matte, shows: bool, first: bool) -> Self {
        // Shaders know no infinity; no finite depth is past the greatest one either.
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
            shows: u32::from(shows),
            first: u32::from(first),
        }
    }
}

/// The entry points.
struct Kernels {
    see: Kernel,
    share: Kernel,
    before: Kernel,
    behind: Kernel,
    pass_along: Kernel,
    finish: Kernel,
}

impl Kernels {
    fn new(gpu: &Gpu) -> Result<Self, Error> {
        let kernel = |name| gpu.kernel(&SHADER, name);
        Ok(Self {
            see: kernel("see")?,
            share: kernel("share")?,
            before: kernel("before")?,
            behind: kernel("behind")?,
            pass_along: kernel("pass_along")?,
            finish: kernel("finish")?,
        })
    }
}

/// What every band is made from.
struct Painter<'a> {
    gpu: &'a Gpu,
    kernels: Kernels,
    layers: Layers,
    cascaded: bool,
    /// What no value of any covered exceeds.
    brightest: f32,
    peels: Vec<DepthPeel>,
    open: bool,
}

/// The buffers of a band.
struct Canvas<'a> {
    band: &'a Band,
    width: usize,
    /// Where the rows that are read lie.
    frame: Buffer,
    peels: Vec<Planes>,
    /// How much of each peel is seen.
    seen: Vec<Buffer>,
    /// The layer at hand.
    layer: Planes,
    /// Where blurs go in between.
    between: Planes,
}

/// The layers on one side of focus, composed from the outermost towards focus as far as they were added.
struct Half {
    covered: Planes,
    side: Side,
    /// The rows, of those that the band reads, in which there may be anything.
    rows: Range<usize>,
}

impl Painter<'_> {
    /// Planes of content.
    fn channels(&self) -> usize {
        if self.open { 4 } else { 3 }
    }

    /// Content of a band's rows.
    fn band(&self, size: (usize, usize), band: &Band, progress: &Progress<'_>) -> Result<Planes, Error> {
        let canvas = self.canvas(size, band)?;
        self.see(&canvas)?;
        let half = |side| Ok::<_, Error>(Half { covered: self.covered(&canvas)?, side, rows: 0..0 });
        let (mut front, mut back) = (half(Side::Behind)?, half(Side::Before)?);
        for layer in -self.layers.front..0 {
            self.add(&mut front, layer, &canvas)?;
            progress((layer + self.layers.front) as f32 / self.layers.count() as f32);
        }
        for layer in (0..=self.layers.back).rev() {
            self.add(&mut back, layer, &canvas)?;
            progress((self.layers.count() as i32 - layer - 1) as f32 / self.layers.count() as f32);
        }
        let (halves, all) = ([&front.covered, &back.covered], 0..band.source.len());
        self.gpu.submit(|work| self.compose(work, halves, &self.kernels.behind, &all, &canvas))?;
        self.finish(size, &front.covered, &canvas)
    }

    fn canvas<'b>(&self, size: (usize, usize), band: &'b Band) -> Result<Canvas<'b>, Error> {
        let (gpu, source) = (self.gpu, &band.source);
        let pixels = size.0 * source.len();
        let peels = self.peels.iter().map(|peel| Planes::from_peel(gpu, &peel.covered, &peel.depth, source));
        let unseen = self.peels.iter().skip(1).map(|_| gpu.zeros::<f32>("what is seen", pixels));
        let all = gpu.upload("what is seen", &vec![1.0f32; pixels]);
        let covered = || Planes::zeros(gpu, self.channels() + 1, pixels);
        let whole = Band { rows: source.clone(), source: source.clone() };
        Ok(Canvas {
            band,
            width: size.0,
            frame: gpu.uniform(&Frame::new(size, &whole, self.channels()))?,
            peels: peels.collect::<Result<_, _>>()?,
            seen: [all].into_iter().chain(unseen).collect::<Result<_, _>>()?,
            layer: covered()?,
            between: covered()?,
        })
    }

    /// A covered of the rows that are read, of which nothing is known.
    fn covered(&self, canvas: &Canvas<'_>) -> Result<Planes, Error> {
        Planes::zeros(self.gpu, self.channels() + 1, canvas.width * canvas.band.source.len())
    }

    /// Finds how much of each peel is seen through those before it.
    fn see(&self, canvas: &Canvas<'_>) -> Result<(), Error> {
        let Canvas { frame, peels, seen, .. } = canvas;
        let all = 0..canvas.band.source.len();
        self.gpu.submit(|work| {
            for (peel, seen) in peels.iter().zip(seen.windows(2)) {
                let bindings = [(2, frame), (5, &peel.rest), (10, &seen[0]), (11, &seen[1])];
                self.at_rows(work, &self.kernels.see, &bindings, &all, canvas)?;
            }
            Ok(())
        })
    }

    /// Adds the next layer towards focus, as on the CPU.
    fn add(&self, half: &mut Half, layer: i32, canvas: &Canvas<'_>) -> Result<(), Error> {
        let cascaded = self.cascaded || layer == 0;
        let kernel = match half.side {
            Side::Before => &self.kernels.before,
            Side::Behind => &self.kernels.behind,
        };
        let matte = Matte::new(&self.layers, layer);
        let mut own = self.rows_of(&matte, canvas);
        self.gpu.submit(|work| {
            if !cascaded {
                own = wider(&own, sigma_px(layer), canvas);
            }
            self.matte(work, &matte, &own, canvas)?;
            if !cascaded {
                self.blur(work, &canvas.layer, sigma_px(layer), &own, canvas)?;
            }
            self.compose(work, [&half.covered, &canvas.layer], kernel, &own, canvas)?;
            half.rows = both(&half.rows, &own);
            if cascaded {
                half.rows = wider(&half.rows, cascade_sigma_px(layer), canvas);
                self.blur(work, &half.covered, cascade_sigma_px(layer), &half.rows, canvas)?;
            }
            Ok(())
        })
    }

    /// From the first to the last of the rows that the band reads in which there may be anything of a layer.
    fn rows_of(&self, matte: &Matte, canvas: &Canvas<'_>) -> Range<usize> {
        let source = &canvas.band.source;
        let meets = |&y: &usize| self.peels.iter().any(|peel| matte.meets(peel.spans[source.start + y]));
        let mut rows = (0..source.len()).filter(meets);
        let Some(first) = rows.next() else { return 0..0 };
        first..rows.next_back().unwrap_or(first) + 1
    }

    /// Makes these rows of a layer of the peels.
    fn matte(
        &self,
        work: &mut Work<'_>,
        matte: &Matte,
        rows: &Range<usize>,
        canvas: &Canvas<'_>,
    ) -> Result<(), Error> {
        let Canvas { frame, peels, seen, layer, band, .. } = canvas;
        let spans = |peel: &DepthPeel| peel.spans[band.source.clone()].iter().any(|&span| matte.meets(span));
        let met = self.peels.iter().enumerate().filter(|(_, peel)| spans(peel));
        for (count, (i, _)) in met.enumerate() {
            let shows = !self.open || i + 1 < self.peels.len();
            let matting = self.gpu.uniform(&Matting::new(matte, shows, count == 0))?;
            let bindings = [
                (2, frame),
                (3, &matting),
                (4, &peels[i].colors),
                (5, &peels[i].rest),
                (8, &layer.colors),
                (9, &layer.rest),
                (10, &seen[i]),
            ];
            self.at_rows(work, &self.kernels.share, &bindings, rows, canvas)?;
        }
        Ok(())
    }

    /// Composes these rows of a covered with a layer, before or behind it.
    fn compose(
        &self,
        work: &mut Work<'_>,
        [covered, layer]: [&Planes; 2],
        kernel: &Kernel,
        rows: &Range<usize>,
        canvas: &Canvas<'_>,
    ) -> Result<(), Error> {
        let bindings = [
            (2, &canvas.frame),
            (6, &covered.colors),
            (7, &covered.rest),
            (8, &layer.colors),
            (9, &layer.rest),
        ];
        self.at_rows(work, kernel, &bindings, rows, canvas)
    }

    /// Blurs these rows of content and coverage alike, rows first; past them there is nothing, as far as the blur reaches.
    fn blur(
        &self,
        work: &mut Work<'_>,
        covered: &Planes,
        sigma_px: f32,
        rows: &Range<usize>,
        canvas: &Canvas<'_>,
    ) -> Result<(), Error> {
        if sigma_px <= 0.0 || rows.is_empty() {
            return Ok(());
        }
        let filter = ExtendedBox::from_sigma(sigma_px);
        let passes = blur_passes(&filter, (canvas.width, canvas.band.source.len()), rows, self.brightest);
        let rest = self.channels() + 1 - 3;
        let Planes { colors, rest: others } = &canvas.between;
        self.passes(work, [&covered.colors, colors], &passes, 3)?;
        self.passes(work, [&covered.rest, others], &passes, rest)
    }

    /// Blurs `count` planes; they go back and forth, and end where they began.
    fn passes(
        &self,
        work: &mut Work<'_>,
        [planes, between]: [&Buffer; 2],
        passes: &[Lines; 2 * PASSES],
        count: usize,
    ) -> Result<(), Error> {
        /// Threads of a workgroup.
        const LANES: u32 = 64;
        for (pass, lines) in passes.iter().enumerate() {
            let uniform = self.gpu.uniform(lines)?;
            let [lines_across, chunks] = [(lines.count, LANES), (lines.length, lines.chunk as u32)]
                .map(|(all, part)| (all as u32).div_ceil(part));
            let [from, to] = if pass % 2 == 0 { [planes, between] } else { [between, planes] };
            let bindings = [(12, from), (13, to), (14, &uniform)];
            work.pass(&self.kernels.pass_along, &bindings, [lines_across, chunks, count as u32])?;
        }
        Ok(())
    }

    /// Asks for `kernel` at every pixel of these rows of those that the band reads.
    fn at_rows(
        &self,
        work: &mut Work<'_>,
        kernel: &Kernel,
        bindings: &[(u32, &Buffer)],
        rows: &Range<usize>,
        canvas: &Canvas<'_>,
    ) -> Result<(), Error> {
        if rows.is_empty() {
            return Ok(());
        }
        let part = self.gpu.uniform(&Part { first_row: rows.start as i32, rows: rows.len() as i32 })?;
        let bindings = [bindings, &[(15, &part)]].concat();
        at_pixels(work, kernel, &bindings, (canvas.width, rows.len()))
    }

    /// The rows that the band makes, divided by coverage.
    fn finish(&self, size: (usize, usize), covered: &Planes, canvas: &Canvas<'_>) -> Result<Planes, Error> {
        let made = (size.0, canvas.band.rows.len());
        let result = Planes::zeros(self.gpu, self.channels() + 1, made.0 * made.1)?;
        let frame = self.gpu.uniform(&Frame::new(size, canvas.band, self.channels()))?;
        let bindings =
            [(2, &frame), (6, &result.colors), (7, &result.rest), (8, &covered.colors), (9, &covered.rest)];
        self.gpu.submit(|work| at_pixels(work, &self.kernels.finish, &bindings, made))?;
        Ok(result)
    }
}

/// From the first to the last of two ranges of rows, of which either may be empty.
fn both(one: &Range<usize>, other: &Range<usize>) -> Range<usize> {
    match (one.is_empty(), other.is_empty()) {
        (true, _) => other.clone(),
        (_, true) => one.clone(),
        _ => one.start.min(other.start)..one.end.max(other.end),
    }
}

/// The rows in which there may be anything after a blur.
fn wider(rows: &Range<usize>, sigma_px: f32, canvas: &Canvas<'_>) -> Range<usize> {
    let reach = ExtendedBox::from_sigma(sigma_px).reach();
    if rows.is_empty() || sigma_px <= 0.0 {
        return rows.clone();
    }
    rows.start.saturating_sub(reach)..(rows.end + reach).min(canvas.band.source.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cascade_reaches_as_far_as_its_blurs_together_or_eight_deviations() {
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
