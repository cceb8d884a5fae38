//! Layer rays on a GPU: one thread a pixel, all rays of a go one after the other.
//!
//! Fragments, N-buffers and mipmaps are the CPU's own tables; what rays do with them is the shader's. Mipmaps go up as fragments do, a
//! band of rows at a time.
//!
//! Memory: 20 bytes a fragment, and 20 for each texel of the mipmaps; 36 a pixel; the N-buffers, at most 64 of 65536 blocks a level, all of
//! which must fit into one buffer.

use super::cones::{Level, Texel as ConeTexel};
use super::cull::MAX_SLABS;
use super::{LayerRays, LayerTracer};
use crate::error::Error;
use crate::gpu::{Band, Buffer, Constant, Gpu, Kernel, Mirrored, Shader, Work, mirrored, tiles};
use crate::image::Image;
use crate::methods::contract::Plan;
use crate::methods::contract::{GpuBackend, Progress};
use crate::methods::shared::{
    Batch, Batches, NBUFFER_WORDS, RAY_STACK, RAY_STACK_CONSTANTS, RAY_SUMS, RAY_SUMS_CONSTANT, RayStack,
    RayViews, Stack, StackRows, Tracer, View, bits, nbuffer_words, picture_of_batches,
};
use crate::scene::Scene;
use std::ops::Range;

/// Bytes of a fragment's share of the mipmaps.
const MIPMAP_BYTES: usize = 8;

/// Words of a slab, of a layer, and of a mipmap level, before what they speak of.
const SLAB_WORDS: usize = NBUFFER_WORDS + 1;
const LAYER_WORDS: usize = 3;
const LEVEL_WORDS: usize = 5;

/// Bytes of what one layer has in a texel.
const TEXEL_BYTES: usize = 20;

/// Rows of a mipmap level at either end of a band of which rays see no more than a part.
const PARTIAL_ROWS: usize = 2;

/// Side of a workgroup.
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
    ],
    parts: &[RAY_SUMS, RAY_STACK, include_str!("../../../../shaders/methods/layer_rays.wgsl")],
    structs: &[Batch::LAYOUT, Stack::LAYOUT, View::LAYOUT, Frame::LAYOUT, Texel::LAYOUT],
};

mirrored! {
    /// The layers, and how rays meet them.
    struct Frame {
        /// Views of a set.
        views: u32,
        /// Sets.
        sets: u32,
        /// Layers.
        layers: u32,
        /// How many share an N-buffer.
        layers_per_slab: u32,
        /// N-buffers.
        slabs: u32,
        /// Levels of the mipmaps above the stack.
        levels: u32,
        /// Diameter of a cone in samples for each pixel of CoC radius.
        cone_per_coc_px: f32,
        /// Steps of false position.
        iterations: u32,
        /// Whether rays that leave the frame are left out.
        discard_outside: u32,
    }
}

mirrored! {
    /// What one layer has in a texel of a mipmap.
    struct Texel {
        /// Which.
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
    /// The stack that rays go through.
    fn stack(&self) -> RayStack<'_> {
        RayStack {
            fragments: &self.fragments,
            blocks: self.cull.blocks,
            supersample: self.supersample as usize,
        }
    }

    /// The lens samples of all sets.
    fn views(&self, gpu: &Gpu) -> Result<RayViews, Error> {
        let [near, _] = self.spacing.interval(0);
        let [_, far] = self.spacing.interval(self.spacing.count - 1);
        RayViews::new(gpu, self.samples.sets.iter().flatten(), (self.jitter, self.supersample), [near, far])
    }

    /// Rounds of loops that a ray takes at most: in each layer a look-up in the N-buffer, and the search with some look-ups in the
    /// lists of samples.
    fn rounds(&self) -> usize {
        const IN_AN_NBUFFER: usize = 16;
        const LOOKS_BESIDE_ITERATIONS: usize = 4;
        let looks = self.iterations + LOOKS_BESIDE_ITERATIONS;
        self.spacing.count * (IN_AN_NBUFFER + looks * (1 + self.fragments.depth()))
    }

    /// N-buffers, how far rays go in them, and bounds of layers, as the shader has them.
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
    fn levels(&self) -> &[Level] {
        self.cones.as_ref().map_or(&[], |cones| &cones.levels)
    }

    /// The rows of each level that rays over `samples` see: where lists begin, and the lists.
    fn mipmaps(&self, samples: &Range<usize>) -> [Vec<u32>; 2] {
        let levels = self.levels();
        let (mut headers, mut starts, mut texels) = (Vec::new(), Vec::new(), Vec::new());
        for (level, number) in levels.iter().zip(1..) {
            let rows = level.rows_of(number, samples);
            let [first, end] = [rows.start * level.width, rows.end * level.width];
            let begin = LEVEL_WORDS * levels.len() + starts.len();
            headers.extend(
                [level.width, rows.start, rows.end - 1, level.height - 1, begin].map(|word| word as u32),
            );
            let before = texels.len() / Texel::LAYOUT.members.len();
            let lists = &level.starts[first..=end];
            starts.extend(lists.iter().map(|start| (start - lists[0] + before) as u32));
            texels.extend(level.texels[lists[0]..level.starts[end]].iter().flat_map(words));
        }
        headers.extend(starts);
        // A buffer that has not even one cannot be bound.
        texels.resize(texels.len().max(Texel::LAYOUT.members.len()), 0);
        [headers, texels]
    }

    /// Rows of the picture that `gpu` holds at once.
    fn max_rows(&self, gpu: &Gpu) -> usize {
        let by_fragments = self.stack().max_rows(gpu, MIPMAP_BYTES);
        let (mut row, mut ends) = (1.0, 0);
        for (level, number) in self.levels().iter().zip(1..) {
            let most = level.max_bytes_of_row();
            row += most as f64 / f64::from(1 << number);
            ends += 2 * PARTIAL_ROWS * most;
        }
        let rows = gpu.max_binding_bytes().saturating_sub(ends as u64) as f64 / row;
        by_fragments.min(rows as usize / self.supersample as usize)
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

impl Level {
    /// The rows that rays over `samples` see of level `number`.
    fn rows_of(&self, number: usize, samples: &Range<usize>) -> Range<usize> {
        let first = (samples.start >> number).saturating_sub(PARTIAL_ROWS - 1);
        first..((samples.end >> number) + PARTIAL_ROWS).min(self.height)
    }

    /// Bytes of the fullest row, of its lists or of where they begin.
    fn max_bytes_of_row(&self) -> usize {
        let row = |y: usize| self.starts[(y + 1) * self.width] - self.starts[y * self.width];
        let most = (0..self.height).map(row).max().unwrap_or(0);
        (most * TEXEL_BYTES).max((self.width + 1) * size_of::<u32>())
    }
}

fn words(&(layer, [red, green, blue, alpha]): &ConeTexel) -> Vec<u32> {
    Texel { layer, red, green, blue, alpha }.words()
}

/// What is the same for all bands.
struct Tables<'g> {
    gpu: &'g Gpu,
    tracer: &'g LayerTracer,
    frame: Buffer,
    views: RayViews,
    culling: Buffer,
    follow: Kernel,
    central: Kernel,
}

impl<'g> Tables<'g> {
    fn new(gpu: &'g Gpu, tracer: &'g LayerTracer) -> Result<Self, Error> {
        Ok(Self {
            gpu,
            tracer,
            frame: gpu.uniform(&tracer.frame())?,
            views: tracer.views(gpu)?,
            culling: gpu.upload("N-buffers", &tracer.culling())?,
            follow: gpu
                .kernel(&SHADER, if tracer.levels().is_empty() { "follow" } else { "follow_cones" })?,
            central: gpu.kernel(&SHADER, "central")?,
        })
    }

    /// Makes the rows of `band`.
    fn make(&self, band: &Band, progress: &dyn Fn(f32)) -> Result<Batches<'g>, Error> {
        let rows = Rows::new(self, band)?;
        let (width, height) = (self.tracer.stack().picture_size().0, band.rows.len());
        let goes = Batches::new(self.gpu, &SHADER, width * height, self.tracer.transparent_background)?;
        let groups = tiles(width, height, SIDE);
        let own = rows.bindings(self);
        let follow = |work: &mut Work<'_>, sums: [(u32, &Buffer); 2]| {
            let bindings: Vec<_> = sums.into_iter().chain(own).chain([(4, &self.views.buffer)]).collect();
            work.pass(&self.follow, &bindings, groups)
        };
        let count = self.tracer.samples.sets[0].len();
        let done = std::cell::Cell::new(0);
        goes.follow((0..count, self.tracer.rounds()), follow, |views| {
            done.set(done.get() + views);
            progress(done.get() as f32 / count as f32);
        })?;
        let central = |work: &mut Work<'_>, sums: [(u32, &Buffer); 2]| {
            let bindings: Vec<_> = sums.into_iter().chain(own).collect();
            work.pass(&self.central, &bindings, groups)
        };
        goes.resolve(&[0, 1, 2, 3], central)?;
        Ok(goes)
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

    fn bindings<'a>(&'a self, tables: &'a Tables<'_>) -> [(u32, &'a Buffer); 8] {
        let [stack, coc_px, red_green, blue_alpha] = self.stack.bindings();
        let [starts, texels] = [(10, &self.starts), (11, &self.texels)];
        [stack, coc_px, red_green, blue_alpha, (8, &tables.culling), (9, &tables.frame), starts, texels]
    }
}

impl GpuBackend for LayerRays {
    fn blur(&self, gpu: &Gpu, scene: &Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let tracer = LayerTracer::new(scene.clone(), plan, plan.lens_samples());
        let tables = Tables::new(gpu, &tracer)?;
        let rows = [tables.views.reach_rows, tracer.max_rows(gpu)];
        picture_of_batches(scene.picture_size(), rows, progress, |band, progress| tables.make(band, progress))
    }

    fn shader(&self) -> &'static Shader {
        &SHADER
    }
}
