//! `layer-rays` on a GPU: one thread per pixel traces all rays of a batch in sequence.
//!
//! Fragments, N-buffers and mipmaps are the CPU's tables; the shader traces rays through them. Mipmaps are uploaded
//! like fragments, one band of rows at a time.
//!
//! Memory: 20 bytes per fragment and per mipmap texel; 36 per pixel, and 12 more where the background is visible; the
//! N-buffers, at most 64 with 65536 blocks per level, must fit into one buffer.

use super::cones::{Level, Texel as ConeTexel};
use super::cull::MAX_SLABS;
use super::{LayerRays, LayerTracer};
use crate::error::Error;
use crate::gpu::{Band, Buffer, Constant, Gpu, Kernel, Mirrored, Shader, Work, mirrored, tiles};
use crate::image::Image;
use crate::methods::contract::{GpuBackend, Plan, Progress};
use crate::methods::shared::{
    Batch, Batches, LENS_RAY_WGSL, LensRay, NBUFFER_WORDS, RAY_STACK, RAY_STACK_CONSTANTS, RAY_SUMS,
    RAY_SUMS_CONSTANT, REFLECTED_LIGHT_CONSTANTS, REFLECTED_LIGHT_WGSL, RayBindings, RayEnds, RayStack,
    RayViews, Reflecting, ReflectingBuffers, Stack, StackRows, Tracer, View, bits, nbuffer_words,
    picture_of_batches,
};
use crate::scene::Scene;
use std::ops::Range;

/// Average bytes of mipmap per fragment.
const MIPMAP_BYTES: usize = 8;

/// u32 words per slab, per layer and per mipmap level in the tables' headers.
const SLAB_WORDS: usize = NBUFFER_WORDS + 1;
const LAYER_WORDS: usize = 3;
const LEVEL_WORDS: usize = 5;

/// Bytes of one layer in a texel.
const TEXEL_BYTES: usize = 20;

/// Rows of a mipmap level at either end of a band of which rays read only a part.
const PARTIAL_ROWS: usize = 2;

/// Side of a workgroup, in pixels.
const SIDE: usize = 8;

static SHADER: Shader = Shader {
    name: "layer-rays",
    constants: &[
        RAY_SUMS_CONSTANT,
        RAY_STACK_CONSTANTS[0],
        RAY_STACK_CONSTANTS[1],
        RAY_STACK_CONSTANTS[2],
        ("MAX_SLABS", Constant::Uint(MAX_SLABS as u32)),
        ("SLAB_WORDS", Constant::Uint(SLAB_WORDS as u32)),
        ("LAYER_WORDS", Constant::Uint(LAYER_WORDS as u32)),
        ("LEVEL_WORDS", Constant::Uint(LEVEL_WORDS as u32)),
        ("STEEP", Constant::Float(LensRay::STEEP)),
        REFLECTED_LIGHT_CONSTANTS[0],
        REFLECTED_LIGHT_CONSTANTS[1],
    ],
    parts: &[
        RAY_SUMS,
        RAY_STACK,
        LENS_RAY_WGSL,
        REFLECTED_LIGHT_WGSL,
        include_str!("../../../../shaders/methods/layer_rays.wgsl"),
    ],
    structs: &[Batch::LAYOUT, Stack::LAYOUT, View::LAYOUT, Frame::LAYOUT, Texel::LAYOUT, Reflecting::LAYOUT],
};

mirrored! {
    /// Sizes of the tables, and how rays are traced.
    struct Frame {
        /// Views per set.
        views: u32,
        /// Number of sets.
        sets: u32,
        /// Number of layers.
        layers: u32,
        /// Layers per N-buffer.
        layers_per_slab: u32,
        /// Number of N-buffers.
        slabs: u32,
        /// Mipmap levels above the stack.
        levels: u32,
        /// Cone diameter in samples per pixel of CoC radius.
        cone_per_coc_px: f32,
        /// Iterations of false position.
        iterations: u32,
        /// Whether rays that leave the frame are discarded.
        discard_outside: u32,
    }
}

mirrored! {
    /// One layer in a mipmap texel.
    struct Texel {
        /// Index of the layer.
        layer: u32,
        /// Red, premultiplied.
        red: f32,
        /// Green.
        green: f32,
        /// Blue.
        blue: f32,
        /// Coverage.
        alpha: f32,
    }
}

impl LayerTracer {
    /// The stack that rays are traced through.
    fn stack(&self) -> RayStack<'_> {
        RayStack {
            fragments: &self.fragments,
            blocks: self.cull.blocks,
            supersample: self.supersample as usize,
        }
    }

    /// Where rays begin and end.
    fn ends(&self) -> RayEnds<'_> {
        RayEnds { jitter: &self.jitter, background: self.background.as_deref(), lost_rays: self.lost_rays }
    }

    /// The lens samples of all sets.
    fn views(&self, gpu: &Gpu) -> Result<RayViews, Error> {
        let [near, _] = self.spacing.interval(0);
        let [_, far] = self.spacing.interval(self.spacing.count - 1);
        let range_px = self.ends().range_px([near, far]);
        RayViews::new(gpu, self.samples.sets.iter().flatten(), self.supersample, range_px)
    }

    /// Maximum loop iterations per ray: for each layer, one N-buffer look-up, and the search with several look-ups in
    /// sample lists.
    fn rounds(&self) -> usize {
        const PER_NBUFFER: usize = 16;
        const LOOKUPS_BESIDE_ITERATIONS: usize = 4;
        let lookups = self.iterations + LOOKUPS_BESIDE_ITERATIONS;
        self.spacing.count * (PER_NBUFFER + lookups * (1 + self.fragments.depth()))
    }

    /// N-buffers, their reaches, and the bounds of layers, in the shader's format.
    fn culling(&self) -> Vec<u32> {
        let slabs: Vec<_> = self.cull.slabs.iter().map(Option::as_ref).collect();
        let reaches = (0..slabs.len()).map(|slab| bits(self.cull.reach(slab)));
        let layers = (0..self.spacing.count).flat_map(|layer| {
            let [near, far] = self.spacing.interval(layer).map(bits);
            [near, far, (layer / self.cull.layers_per_slab) as u32]
        });
        nbuffer_words(&slabs, reaches.chain(layers).collect())
    }

    /// The levels of the mipmaps.
    fn levels(&self) -> &[Level<4>] {
        self.cones.as_ref().map_or(&[], |cones| &cones.levels)
    }

    /// The rows of each level that rays over `samples` read: headers with the starts of lists, and the lists.
    fn mipmaps(&self, samples: &Range<usize>) -> [Vec<u32>; 2] {
        let levels = self.levels();
        let (mut headers, mut starts, mut texels) = (Vec::new(), Vec::new(), Vec::new());
        for (level, number) in levels.iter().zip(1..) {
            let rows = level.rows_of(number, samples);
            let [first, end] = [rows.start * level.width, rows.end * level.width];
            let starts_at = LEVEL_WORDS * levels.len() + starts.len();
            headers.extend(
                [level.width, rows.start, rows.end - 1, level.height - 1, starts_at].map(|word| word as u32),
            );
            let before = texels.len() / Texel::LAYOUT.members.len();
            let lists = &level.starts[first..=end];
            starts.extend(lists.iter().map(|start| (start - lists[0] + before) as u32));
            texels.extend(level.texels[lists[0]..level.starts[end]].iter().flat_map(words));
        }
        headers.extend(starts);
        // An empty buffer cannot be bound.
        texels.resize(texels.len().max(Texel::LAYOUT.members.len()), 0);
        [headers, texels]
    }

    /// Maximum picture rows that fit on `gpu` at once.
    fn max_rows(&self, gpu: &Gpu) -> usize {
        let rows_by_fragments = self.stack().max_rows(gpu, MIPMAP_BYTES, self.ends());
        let (mut bytes_per_row, mut end_bytes) = (1.0, 0);
        for (level, number) in self.levels().iter().zip(1..) {
            let max_bytes = level.max_bytes_of_row();
            bytes_per_row += max_bytes as f64 / f64::from(1 << number);
            end_bytes += 2 * PARTIAL_ROWS * max_bytes;
        }
        let rows = gpu.max_binding_bytes().saturating_sub(end_bytes as u64) as f64 / bytes_per_row;
        rows_by_fragments.min(rows as usize / self.supersample as usize)
    }

    fn frame(&self) -> Frame {
        let Self { samples, spacing, cull, cones, .. } = self;
        Frame {
            views: samples.sets[0].len() as u32,
            sets: samples.sets.len() as u32,
            layers: spacing.count as u32,
            layers_per_slab: cull.layers_per_slab as u32,
            slabs: cull.slabs.len() as u32,
            levels: self.levels().len() as u32,
            cone_per_coc_px: cones.as_ref().map_or(0.0, |cones| cones.per_coc_px),
            iterations: self.iterations as u32,
            discard_outside: self.discard.into(),
        }
    }
}

impl Level<4> {
    /// The rows of level `number` that rays over `samples` read.
    fn rows_of(&self, number: usize, samples: &Range<usize>) -> Range<usize> {
        let first = (samples.start >> number).saturating_sub(PARTIAL_ROWS - 1);
        first..((samples.end >> number) + PARTIAL_ROWS).min(self.height)
    }

    /// Bytes of the largest row, either of its lists or of their starts.
    fn max_bytes_of_row(&self) -> usize {
        let texels_of_row = |y: usize| self.starts[(y + 1) * self.width] - self.starts[y * self.width];
        let max_texels = (0..self.height).map(texels_of_row).max().unwrap_or(0);
        (max_texels * TEXEL_BYTES).max((self.width + 1) * size_of::<u32>())
    }
}

fn words(&(layer, [red, green, blue, alpha]): &ConeTexel<4>) -> Vec<u32> {
    Texel { layer, red, green, blue, alpha }.words()
}

/// Tables shared by all bands.
struct Tables<'g> {
    gpu: &'g Gpu,
    tracer: &'g LayerTracer,
    frame: Buffer,
    views: RayViews,
    culling: Buffer,
    reflecting: ReflectingBuffers,
    follow: Kernel,
    central: Kernel,
}

impl<'g> Tables<'g> {
    fn new(gpu: &'g Gpu, tracer: &'g LayerTracer) -> Result<Self, Error> {
        let reflecting = ReflectingBuffers::new(gpu, tracer.reflected.as_ref())?;
        let constants = [("REFLECTS", f64::from(reflecting.reflects))];
        let follow = if tracer.levels().is_empty() { "follow" } else { "follow_cones" };
        Ok(Self {
            gpu,
            tracer,
            frame: gpu.uniform(&tracer.frame())?,
            views: tracer.views(gpu)?,
            culling: gpu.upload("N-buffers", &tracer.culling())?,
            follow: gpu.kernel_with(&SHADER, follow, &constants)?,
            central: gpu.kernel_with(&SHADER, "central", &constants)?,
            reflecting,
        })
    }

    /// Renders the rows of `band`.
    fn render(&self, band: &Band, progress: &dyn Fn(f32)) -> Result<Batches<'g>, Error> {
        let rows = Rows::new(self, band)?;
        let (width, height) = (self.tracer.stack().picture_size().0, band.rows.len());
        let batches = Batches::new(self.gpu, &SHADER, (width, band), self.tracer.ends())?;
        let groups = tiles(width, height, SIDE);
        let own = rows.bindings(self);
        let follow = |work: &mut Work<'_>, rays: RayBindings<'_>| {
            let bindings: Vec<_> = rays.into_iter().chain(own).chain([(4, &self.views.buffer)]).collect();
            work.pass(&self.follow, &bindings, groups)
        };
        let count = self.tracer.samples.sets[0].len();
        let done = std::cell::Cell::new(0);
        batches.follow((0..count, self.tracer.rounds()), follow, |views| {
            done.set(done.get() + views);
            progress(done.get() as f32 / count as f32);
        })?;
        let central = |work: &mut Work<'_>, rays: RayBindings<'_>| {
            let bindings: Vec<_> = rays.into_iter().chain(own).collect();
            work.pass(&self.central, &bindings, groups)
        };
        batches.resolve(&[0, 1, 2, 3], central)?;
        Ok(batches)
    }
}

/// The rows of stack and mipmaps that a band reads.
struct Rows {
    stack: StackRows,
    starts: Buffer,
    texels: Buffer,
}

impl Rows {
    fn new(tables: &Tables<'_>, band: &Band) -> Result<Self, Error> {
        let (gpu, stack) = (tables.gpu, tables.tracer.stack());
        let [starts, texels] = tables.tracer.mipmaps(&stack.samples(band));
        Ok(Self {
            stack: stack.rows(gpu, band)?,
            starts: gpu.upload("lists of mipmaps", &starts)?,
            texels: gpu.upload("mipmaps", &texels)?,
        })
    }

    fn bindings<'a>(&'a self, tables: &'a Tables<'_>) -> [(u32, &'a Buffer); 11] {
        let [stack, coc_px, red_green, blue_alpha] = self.stack.bindings();
        let [starts, texels] = [(10, &self.starts), (11, &self.texels)];
        let [reflecting, at, fragments] = tables.reflecting.bindings();
        let (culling, frame) = ((8, &tables.culling), (9, &tables.frame));
        [stack, coc_px, red_green, blue_alpha, culling, frame, starts, texels, reflecting, at, fragments]
    }
}

impl GpuBackend for LayerRays {
    fn blur(&self, gpu: &Gpu, scene: &Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let tracer = LayerTracer::new(scene.clone(), plan, plan.lens_samples());
        let tables = Tables::new(gpu, &tracer)?;
        let rows = [tables.views.reach_rows, tracer.max_rows(gpu)];
        picture_of_batches(scene.picture_size(), rows, progress, |band, progress| {
            tables.render(band, progress)
        })
    }

    fn shader(&self) -> &'static Shader {
        &SHADER
    }
}
