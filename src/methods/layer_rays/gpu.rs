//! Layer rays on a GPU: one thread a pixel, all rays of a go one after the other.
//!
//! Fragments, N-buffers and mipmaps are the CPU's own tables; what rays do with them is the shader's. N-buffers go up whole, fragments and
//! mipmaps a band of rows at a time.
//!
//! Memory: 20 bytes a fragment, and 20 for each texel of the mipmaps; 36 a pixel; the N-buffers, at most 64 of 65536 blocks a level, all of
//! which must fit into one buffer.

use super::cones::{Level, Texel as ConeTexel};
use super::cull::MOST_SLABS;
use super::{LayerRays, LayerTracer};
use crate::error::Error;
use crate::gpu::{Band, Buffer, Constant, Gpu, Kernel, Mirrored, Shader, Work, bands, mirrored, tiles};
use crate::image::Image;
use crate::methods::shared::{Go, Goes, RAY_SUMS, RAY_SUMS_CONSTANT, Tracer};
use crate::methods::{Progress, Twin};
use crate::scene::{OPAQUE_ALPHA, Plan, Scene};
use std::ops::Range;

/// Farther than any fragment: stands for infinity, which shaders need not know.
const ABSENT: f32 = 3e38;

/// Bytes of the two colours of a fragment that lie together, and of all of it and its share of the mipmaps.
const FRAGMENT_BYTES: [usize; 2] = [8, 28];

/// Words of a slab, of a layer, and of a mipmap level, before what they speak of.
const SLAB_WORDS: usize = 3;
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
        ("OPAQUE_ALPHA", Constant::Float(OPAQUE_ALPHA)),
        ("ABSENT", Constant::Float(ABSENT)),
        ("MOST_SLABS", Constant::Uint(MOST_SLABS as u32)),
        ("SLAB_WORDS", Constant::Uint(SLAB_WORDS as u32)),
        ("LAYER_WORDS", Constant::Uint(LAYER_WORDS as u32)),
        ("LEVEL_WORDS", Constant::Uint(LEVEL_WORDS as u32)),
    ],
    parts: &[RAY_SUMS, include_str!("../../../shaders/methods/layer_rays.wgsl")],
    structs: &[Go::LAYOUT, Frame::LAYOUT, View::LAYOUT, Texel::LAYOUT],
};

mirrored! {
    /// The rows of the stack at hand, and how rays meet them.
    struct Frame {
        /// Columns of the picture.
        width: u32,
        /// Its first row that is made.
        row: u32,
        /// How many are.
        rows: u32,
        /// Views of a set.
        views: u32,
        /// Sets.
        sets: u32,
        /// Samples of a pixel along each axis.
        supersample: f32,
        /// Columns of the stack, in samples.
        columns: u32,
        /// Rows of the whole stack.
        height: u32,
        /// Its first row at hand.
        top: u32,
        /// Its last row at hand.
        bottom: u32,
        /// Fragments that a sample may have.
        depth: u32,
        /// Layers.
        layers: u32,
        /// How many share an N-buffer.
        layers_per_slab: u32,
        /// N-buffers.
        slabs: u32,
        /// Blocks in a row.
        block_columns: u32,
        /// Rows of blocks.
        block_rows: u32,
        /// One over a block's side.
        blocks_per_sample: f32,
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
    /// A lens sample, in samples.
    struct View {
        /// Where in the pixel.
        start_x: f32,
        /// The same, down.
        start_y: f32,
        /// How far it moves for each pixel of CoC radius.
        step_x: f32,
        /// The same, down.
        step_y: f32,
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

/// The bits of `value`, with the farthest number for infinity.
fn bits(value: f32) -> u32 {
    value.clamp(-ABSENT, ABSENT).to_bits()
}

impl LayerTracer {
    /// The lens samples of all sets.
    fn views(&self) -> Vec<View> {
        let view = |view: &crate::lens::View| {
            let start = self.jitter * self.supersample * view.jitter;
            let step = self.supersample * view.lens;
            View { start_x: start.x, start_y: start.y, step_x: step.x, step_y: step.y }
        };
        self.samples.sets.iter().flatten().map(view).collect()
    }

    /// How many samples above or below its pixel a ray looks at most.
    fn reach(&self, views: &[View]) -> f32 {
        let [near, _] = self.spacing.interval(0);
        let [_, far] = self.spacing.interval(self.spacing.count - 1);
        let away = |view: &View| {
            let [near, far] = [near, far].map(|coc| (view.start_y + coc * view.step_y).abs());
            near.max(far)
        };
        views.iter().map(away).fold(0.0, f32::max)
    }

    /// Rounds of loops that a ray takes at most: in each layer a look-up in the N-buffer, and the search with some look-ups in the
    /// lists of samples.
    fn rounds(&self) -> usize {
        const IN_AN_NBUFFER: usize = 16;
        const LOOKS_BESIDE_ITERATIONS: usize = 4;
        let looks = self.iterations + LOOKS_BESIDE_ITERATIONS;
        self.spacing.count * (IN_AN_NBUFFER + looks * (1 + self.fragments.depth()))
    }

    /// N-buffers and bounds of layers, as the shader has them.
    fn culling(&self) -> Vec<u32> {
        let layers = (0..self.spacing.count).flat_map(|layer| {
            let [near, far] = self.spacing.interval(layer).map(bits);
            [near, far, (layer / self.cull.layers_per_slab) as u32]
        });
        let header = SLAB_WORDS * self.cull.slabs.len() + LAYER_WORDS * self.spacing.count;
        let (mut words, mut values) = (Vec::with_capacity(header), Vec::new());
        for (i, slab) in self.cull.slabs.iter().enumerate() {
            let levels = slab.as_ref().map_or(&[][..], |buffer| buffer.levels());
            words.extend([(header + values.len()) as u32, levels.len() as u32, bits(self.cull.reach(i))]);
            values.extend(levels.iter().flatten().map(|&value| bits(value)));
        }
        words.into_iter().chain(layers).chain(values).collect()
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
    fn most_rows(&self, gpu: &Gpu, width: usize) -> usize {
        let supersample = self.supersample as usize;
        let fragments = supersample.pow(2) * self.fragments.depth();
        let by_fragments = Goes::most_rows(gpu, width, FRAGMENT_BYTES.map(|bytes| bytes * fragments));
        let (mut row, mut ends) = (1.0, 0);
        for (level, number) in self.levels().iter().zip(1..) {
            let most = level.most_bytes_of_row();
            row += most as f64 / f64::from(1 << number);
            ends += 2 * PARTIAL_ROWS * most;
        }
        let rows = gpu.most_binding_bytes().saturating_sub(ends as u64) as f64 / row;
        by_fragments.min(rows as usize / supersample)
    }
}

impl Level {
    /// The rows that rays over `samples` see of level `number`.
    fn rows_of(&self, number: usize, samples: &Range<usize>) -> Range<usize> {
        let first = (samples.start >> number).saturating_sub(PARTIAL_ROWS - 1);
        first..((samples.end >> number) + PARTIAL_ROWS).min(self.height)
    }

    /// Bytes of the fullest row, of its lists or of where they begin.
    fn most_bytes_of_row(&self) -> usize {
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
    views: Buffer,
    culling: Buffer,
    /// How many rows of the picture above or below its pixel a ray looks at most.
    reach_rows: usize,
    follow: Kernel,
    central: Kernel,
}

impl<'g> Tables<'g> {
    fn new(gpu: &'g Gpu, tracer: &'g LayerTracer) -> Result<Self, Error> {
        let views = tracer.views();
        let words: Vec<u32> = views.iter().flat_map(View::words).collect();
        Ok(Self {
            gpu,
            tracer,
            views: gpu.upload("lens samples", &words)?,
            culling: gpu.upload("N-buffers", &tracer.culling())?,
            reach_rows: (tracer.reach(&views) / tracer.supersample).ceil() as usize + 1,
            follow: gpu
                .kernel(&SHADER, if tracer.levels().is_empty() { "follow" } else { "follow_cones" })?,
            central: gpu.kernel(&SHADER, "central")?,
        })
    }

    fn frame(&self, width: usize, band: &Band, samples: &Range<usize>) -> Frame {
        let LayerTracer { samples: views, fragments, spacing, cull, cones, .. } = self.tracer;
        let (columns, height) = fragments.size();
        Frame {
            width: width as u32,
            row: band.rows.start as u32,
            rows: band.rows.len() as u32,
            views: views.sets[0].len() as u32,
            sets: views.sets.len() as u32,
            supersample: self.tracer.supersample,
            columns: columns as u32,
            height: height as u32,
            top: samples.start as u32,
            bottom: samples.end as u32 - 1,
            depth: fragments.depth() as u32,
            layers: spacing.count as u32,
            layers_per_slab: cull.layers_per_slab as u32,
            slabs: cull.slabs.len() as u32,
            block_columns: cull.blocks.columns as u32,
            block_rows: cull.blocks.rows as u32,
            blocks_per_sample: 1.0 / cull.blocks.side as f32,
            levels: self.tracer.levels().len() as u32,
            cone_per_coc_px: cones.as_ref().map_or(0.0, |cones| cones.per_coc_px),
            iterations: self.tracer.iterations as u32,
            discard_outside: self.tracer.discard.into(),
        }
    }

    /// Makes the rows of `band` of a picture of `width` columns.
    fn make(&self, width: usize, band: &Band, progress: &dyn Fn(f32)) -> Result<Goes<'g>, Error> {
        let rows = Rows::new(self, width, band)?;
        let (gpu, height) = (self.gpu, band.rows.len());
        let goes = Goes::new(gpu, &SHADER, width * height, self.tracer.open_background)?;
        let groups = tiles(width, height, SIDE);
        let own = rows.bindings(self);
        let follow = |work: &mut Work<'_>, sums: [(u32, &Buffer); 2]| {
            let bindings: Vec<_> = sums.into_iter().chain(own).chain([(4, &self.views)]).collect();
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

/// The rows of the stack that a band reads.
struct Rows {
    frame: Buffer,
    coc_px: Buffer,
    /// Red and green, and blue and alpha.
    colors: [Buffer; 2],
    starts: Buffer,
    texels: Buffer,
}

impl Rows {
    fn new(tables: &Tables<'_>, width: usize, band: &Band) -> Result<Self, Error> {
        let (gpu, tracer) = (tables.gpu, tables.tracer);
        let supersample = tracer.supersample as usize;
        let samples = band.source.start * supersample..band.source.end * supersample;
        let coc_px = tracer.fragments.coc_px_of_rows(samples.clone());
        let coc_px: Vec<f32> = coc_px.iter().map(|coc| coc.min(ABSENT)).collect();
        let colors = tracer.fragments.color_of_rows(samples.clone());
        let pair = |first: usize| -> Vec<[f32; 2]> {
            colors.iter().map(|color| [color[first], color[first + 1]]).collect()
        };
        let [starts, texels] = tracer.mipmaps(&samples);
        Ok(Self {
            frame: gpu.uniform(&tables.frame(width, band, &samples))?,
            coc_px: gpu.upload("CoC radii", &coc_px)?,
            colors: [gpu.upload("red and green", &pair(0))?, gpu.upload("blue and alpha", &pair(2))?],
            starts: gpu.upload("lists of mipmaps", &starts)?,
            texels: gpu.upload("mipmaps", &texels)?,
        })
    }

    fn bindings<'a>(&'a self, tables: &'a Tables<'_>) -> [(u32, &'a Buffer); 7] {
        let [red_green, blue_alpha] = &self.colors;
        [
            (3, &self.frame),
            (5, &self.coc_px),
            (6, red_green),
            (7, blue_alpha),
            (8, &tables.culling),
            (9, &self.starts),
            (10, &self.texels),
        ]
    }
}

impl Twin for LayerRays {
    fn blur(&self, gpu: &Gpu, scene: &Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let (width, height) = scene.picture_size();
        let tracer = LayerTracer::new(scene.clone(), plan, plan.lens_samples());
        let tables = Tables::new(gpu, &tracer)?;
        let mut image = Image::transparent(width, height);
        let bands = bands(height, tables.reach_rows, tracer.most_rows(gpu, width))?;
        for (i, band) in bands.iter().enumerate() {
            let progress = |share: f32| progress((i as f32 + share) / bands.len() as f32);
            tables.make(width, band, &progress)?.read_into(&mut image, band)?;
        }
        Ok(image)
    }

    fn shader(&self) -> &'static Shader {
        &SHADER
    }
}
