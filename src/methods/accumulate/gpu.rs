//! GPU backend of `accumulate`: one thread per pixel traces all rays of a batch in sequence, so that neighbouring threads take
//! similar paths.
//!
//! Rows of the stack are uploaded unchanged, one band at a time; the kernel `look` computes extents and tiles from them, `follow`
//! sums rays.
//!
//! Memory: 28 bytes per fragment, and per pixel that of [`Batches`]. Translucent scenes have 32 layers at most.

use super::Accumulate;
use super::tiles::{REACH_PX, SLABS, TILE};
use super::volume::Volume;
use crate::error::Error;
use crate::gpu::{Band, Buffer, Constant, Gpu, Kernel, Mirrored, Shader, Work, mirrored, tiles};
use crate::image::{Image, Plane};
use crate::lens::{Rays, View as LensView};
use crate::methods::contract::{GpuBackend, Plan, Progress};
use crate::methods::shared::{
    Batch, Batches, LENS_RAY_WGSL, LensRay, RAY_SUMS, RAY_SUMS_CONSTANT, REFLECTED_LIGHT_CONSTANTS,
    REFLECTED_LIGHT_WGSL, RayBindings, RayEnds, Reflecting, ReflectingBuffers, has_translucent,
    picture_of_batches,
};
use crate::scene::surface::{JOIN_PX, MAX_JOIN_PX, ROUGHNESS, SAME_HIT_PX};
use crate::scene::{Layer, MAX_TRANSLUCENT_LAYERS, OPAQUE_ALPHA, Scene};
use glam::Vec2;
use std::ops::Range;

/// Bytes per fragment: in the largest buffer (extents), and in all buffers.
const FRAGMENT_BYTES: [usize; 2] = [8, 28];

static SHADER: Shader = Shader {
    name: "accumulate",
    constants: &[
        RAY_SUMS_CONSTANT,
        REFLECTED_LIGHT_CONSTANTS[0],
        REFLECTED_LIGHT_CONSTANTS[1],
        REFLECTED_LIGHT_CONSTANTS[2],
        ("OPAQUE_ALPHA", Constant::Float(OPAQUE_ALPHA)),
        ("JOIN_PX", Constant::Float(JOIN_PX)),
        ("MAX_JOIN_PX", Constant::Float(MAX_JOIN_PX)),
        ("ROUGHNESS", Constant::Float(ROUGHNESS)),
        ("SAME_HIT_PX", Constant::Float(SAME_HIT_PX)),
        ("REACH_PX", Constant::Float(REACH_PX)),
        ("MAX_TRANSLUCENT_LAYERS", Constant::Uint(MAX_TRANSLUCENT_LAYERS as u32)),
        ("TILE", Constant::Int(TILE)),
        ("TILE_BITS", Constant::Uint(TILE.ilog2())),
        ("SLABS", Constant::Uint(SLABS)),
    ],
    parts: &[
        RAY_SUMS,
        LENS_RAY_WGSL,
        REFLECTED_LIGHT_WGSL,
        include_str!("../../../shaders/methods/accumulate.wgsl"),
    ],
    structs: &[Batch::LAYOUT, Frame::LAYOUT, View::LAYOUT, Reflecting::LAYOUT],
};

mirrored! {
    /// The rows of the stack that a band reads, and the lens.
    struct Frame {
        /// Width of the picture.
        width: u32,
        /// First row of the picture that the band makes.
        row: u32,
        /// Number of rows that the band makes.
        rows: u32,
        /// Number of layers.
        layers: u32,
        /// Samples per pixel along each axis.
        supersample: f32,
        /// Width of the stack in samples.
        columns: i32,
        /// First row of samples that is uploaded.
        top: i32,
        /// Last row of samples that is uploaded.
        bottom: i32,
        /// Minimum CoC depth of all fragments.
        nearest: f32,
        /// Maximum CoC depth of all fragments.
        farthest: f32,
        /// Slabs per pixel of CoC depth.
        slabs_per_px: f32,
        /// Where the optical axis meets the picture, in pixels.
        axis_x: f32,
        /// Its vertical component.
        axis_y: f32,
        /// Distance from there to the frame's corners.
        half_diagonal_px: f32,
        /// Offset of the barrel from the aperture as seen from the corners, in aperture radii.
        cats_eye: f32,
        /// Number of sets of views that rows take turns with.
        turns: u32,
        /// Views from one of these sets to the next.
        turn_views: u32,
    }
}

mirrored! {
    /// A lens sample, prepared for rays.
    struct View {
        /// Samples that a ray moves per pixel of CoC depth, horizontally.
        step_x: f32,
        /// Its vertical component.
        step_y: f32,
        /// Reciprocal of the step; 0 along an axis that the ray is perpendicular to.
        inverse_x: f32,
        /// Its vertical component.
        inverse_y: f32,
        /// Position in the pixel.
        jitter_x: f32,
        /// Its vertical component.
        jitter_y: f32,
        /// Shift of the ray by aberrations, in pixels.
        shift_x: f32,
        /// Its vertical component.
        shift_y: f32,
        /// Point on the aperture.
        lens_x: f32,
        /// Its vertical component.
        lens_y: f32,
    }
}

impl View {
    fn from_lens_view(view: &LensView, volume: &Volume<&Layer>) -> Self {
        let step = view.lens * volume.supersample;
        let inverse = LensRay::new(Vec2::ZERO, step).inverse;
        Self {
            step_x: step.x,
            step_y: step.y,
            inverse_x: inverse.x,
            inverse_y: inverse.y,
            jitter_x: view.jitter.x,
            jitter_y: view.jitter.y,
            shift_x: view.shift.x,
            shift_y: view.shift.y,
            lens_x: view.lens.x,
            lens_y: view.lens.y,
        }
    }

    /// Maximum number of samples that a ray passes between the CoC depths `range_px`.
    fn cells(&self, range_px: [f32; 2]) -> f32 {
        (range_px[1] - range_px[0]) * (self.step_x.abs() + self.step_y.abs()) + 2.0
    }

    /// Maximum distance of a ray from its pixel, in rows, between the CoC depths `range_px`.
    fn rows_away(&self, supersample: f32, range_px: [f32; 2]) -> f32 {
        let rows = |coc: f32| (self.jitter_y + self.shift_y + coc * self.step_y / supersample).abs();
        rows(range_px[0]).max(rows(range_px[1]))
    }
}

/// The lens samples of all sets of rays, in all turns.
struct Lens {
    views: Buffer,
    /// Range of each set in `views` in the first turn, and the channels that the set renders.
    sets: Vec<(Range<usize>, &'static [usize])>,
    /// Number of turns, and of views from one turn to the next.
    turns: usize,
    turn_views: usize,
    /// Maximum distance of rays from their pixel, in rows.
    reach_rows: usize,
    /// Maximum number of loop iterations of a ray.
    rounds: usize,
}

impl Lens {
    fn new(gpu: &Gpu, volume: &Volume<&Layer>, turns: &[Rays]) -> Result<Self, Error> {
        // Without cat's eye the barrel does not depend on the pixel: occluded views are dropped here, the same in all turns.
        let passes = |view: &&LensView| {
            volume.optics.cats_eye > 0.0 || volume.optics.within_barrel(view.lens, Vec2::ZERO) >= 0.0
        };
        let (mut views, mut sets, mut turn_views) = (Vec::new(), Vec::new(), 0);
        for rays in turns {
            sets.clear();
            let first_of_turn = views.len();
            for (set, channels) in rays.sets() {
                let first = views.len() - first_of_turn;
                views.extend(set.iter().filter(passes).map(|view| View::from_lens_view(view, volume)));
                sets.push((first..views.len() - first_of_turn, channels));
            }
            turn_views = views.len() - first_of_turn;
        }
        let range_px = volume.ends().range_px(volume.coc_range_px);
        let away = views.iter().map(|view: &View| view.rows_away(volume.supersample, range_px));
        // Two rows more: whether the surface of a fragment goes on depends on the samples up to two away.
        let reach_rows = away.fold(0.0, f32::max).ceil() as usize + 2;
        let cells = views.iter().map(|view| view.cells(volume.coc_range_px)).fold(0.0, f32::max);
        // A sample takes one iteration and one per layer; a ray passes no more tiles than samples. A translucent hit looks at those before.
        let layers = volume.layers.len();
        let rounds = cells.ceil() as usize * (2 + layers) + layers * layers.min(MAX_TRANSLUCENT_LAYERS);
        let words: Vec<u32> = views.iter().flat_map(View::words).collect();
        let (views, turns) = (gpu.upload("lens samples", &words)?, turns.len());
        Ok(Self { views, sets, turns, turn_views, reach_rows, rounds })
    }
}

/// The rows of the stack that a band reads, on the GPU.
struct Rows {
    frame: Buffer,
    colors: [Buffer; 4],
    coc_px: Buffer,
    extents: Buffer,
    tiles: Buffer,
}

impl Rows {
    fn new(
        gpu: &Gpu,
        (volume, lens): (&Volume<&Layer>, &Lens),
        width: usize,
        band: &Band,
    ) -> Result<Self, Error> {
        let supersample = volume.supersample as usize;
        let samples = band.source.start * supersample..band.source.end * supersample;
        let upload =
            |label, plane: &dyn Fn(&Layer) -> &Plane| upload(gpu, label, &volume.layers, &samples, plane);
        let colors = [
            upload("red", &|layer| &layer.color[0])?,
            upload("green", &|layer| &layer.color[1])?,
            upload("blue", &|layer| &layer.color[2])?,
            upload("alpha", &|layer| &layer.alpha)?,
        ];
        let coc_px = upload("CoC radii", &|layer| &layer.coc_px)?;
        let frame = gpu.uniform(&frame((volume, lens), width, band, &samples))?;
        let tile = TILE as usize;
        let [columns, rows] =
            [(volume.size[0] as usize).div_ceil(tile), samples.end.div_ceil(tile) - samples.start / tile];
        let fragments = volume.size[0] as usize * samples.len() * volume.layers.len();
        let extents = gpu.zeros::<[f32; 2]>("extents", fragments)?;
        let tiles = gpu.zeros::<[u32; 2]>("tiles", columns * rows)?;
        let analyze = gpu.kernel(&SHADER, "look")?;
        let bindings = [(3, &frame), (8, &colors[3]), (9, &coc_px), (12, &extents), (13, &tiles)];
        gpu.submit(|work| work.pass(&analyze, &bindings, [columns as u32, rows as u32, 1]))?;
        Ok(Self { frame, colors, coc_px, extents, tiles })
    }
}

/// Uploads rows `samples` of one plane of all `layers`.
fn upload(
    gpu: &Gpu,
    label: &str,
    layers: &[&Layer],
    samples: &Range<usize>,
    plane: &dyn Fn(&Layer) -> &Plane,
) -> Result<Buffer, Error> {
    let rows = |layer: &&'_ Layer| {
        let plane = plane(layer);
        samples.start * plane.width()..samples.end * plane.width()
    };
    let parts: Vec<&[f32]> = layers.iter().map(|layer| &plane(layer).values()[rows(layer)]).collect();
    gpu.upload_all(label, &parts)
}

fn frame(
    (volume, lens): (&Volume<&Layer>, &Lens),
    width: usize,
    band: &Band,
    samples: &Range<usize>,
) -> Frame {
    let [nearest, farthest] = volume.coc_range_px;
    Frame {
        width: width as u32,
        row: band.rows.start as u32,
        rows: band.rows.len() as u32,
        layers: volume.layers.len() as u32,
        supersample: volume.supersample,
        columns: volume.size[0],
        top: samples.start as i32,
        bottom: samples.end as i32 - 1,
        nearest,
        farthest,
        slabs_per_px: volume.tiles.slabs.per_px,
        axis_x: volume.field.axis_px.x,
        axis_y: volume.field.axis_px.y,
        half_diagonal_px: volume.field.half_diagonal_px,
        cats_eye: volume.optics.cats_eye,
        turns: lens.turns as u32,
        turn_views: lens.turn_views as u32,
    }
}

impl Volume<&Layer> {
    /// Where rays begin and end.
    fn ends(&self) -> RayEnds<'_> {
        RayEnds { jitter: &self.jitter, background: self.background.as_deref(), lost_rays: self.lost_rays }
    }

    /// Maximum number of rows of a picture of `width` columns in a band on `gpu`.
    fn max_rows(&self, gpu: &Gpu, width: usize) -> usize {
        let fragments = (self.supersample as usize).pow(2) * self.layers.len();
        Batches::max_rows(gpu, width, FRAGMENT_BYTES.map(|bytes| bytes * fragments), self.ends())
    }
}

impl GpuBackend for Accumulate {
    fn blur(&self, gpu: &Gpu, scene: &Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let volume = Volume::new(scene, plan);
        let translucent = has_translucent(&volume.layers)?;
        let lens = Lens::new(gpu, &volume, &plan.optics.rays_in_turns(plan.lens_samples()))?;
        let reflecting = ReflectingBuffers::new(gpu, volume.reflected.as_ref())?;
        let constants =
            [("TRANSLUCENT", f64::from(translucent)), ("REFLECTS", f64::from(reflecting.reflects))];
        let follow = gpu.kernel_with(&SHADER, "follow", &constants)?;
        let (width, height) = scene.picture_size();
        picture_of_batches(
            (width, height),
            [lens.reach_rows, volume.max_rows(gpu, width)],
            progress,
            |band, progress| {
                let rows = Rows::new(gpu, (&volume, &lens), width, band)?;
                let batches = Batches::new(gpu, &SHADER, (width, band), volume.ends())?;
                let groups = tiles(width, band.rows.len(), TILE as usize);
                trace((&follow, groups), (&rows, &lens, &reflecting), &batches, progress)?;
                Ok(batches)
            },
        )
    }

    fn shader(&self) -> &'static Shader {
        &SHADER
    }
}

/// Traces all rays through `rows` by `groups` workgroups of the kernel `follow`.
fn trace(
    (follow, groups): (&Kernel, [u32; 3]),
    (rows, lens, reflecting): (&Rows, &Lens, &ReflectingBuffers),
    batches: &Batches<'_>,
    progress: &dyn Fn(f32),
) -> Result<(), Error> {
    let [red, green, blue, alpha] = &rows.colors;
    let stack = [(3, &rows.frame), (4, &lens.views), (5, red), (6, green), (7, blue), (8, alpha)];
    let traversal = [(9, &rows.coc_px), (10, &rows.extents), (11, &rows.tiles)];
    let done = std::cell::Cell::new(0);
    for (views, channels) in &lens.sets {
        let ask = |work: &mut Work<'_>, rays: RayBindings<'_>| {
            let reflecting = reflecting.bindings();
            let bindings: Vec<_> = rays.into_iter().chain(stack).chain(traversal).chain(reflecting).collect();
            work.pass(follow, &bindings, groups)
        };
        batches.follow((views.clone(), lens.rounds), ask, |views| {
            done.set(done.get() + views);
            progress(done.get() as f32 / lens.turn_views as f32);
        })?;
        batches.resolve(channels, |_, _| Ok(()))?;
    }
    Ok(())
}
