//! The stack as rays read it, on a GPU: lists of fragments a band of rows at a time, N-buffers whole, and lens samples.
//!
//! All are the CPU's own tables; `shaders/shared/ray_stack.wgsl` reads them.
//!
//! Memory: 20 bytes a fragment; the N-buffers of a picture must fit into one buffer.

use super::fragments::{Blocks, Fragments};
use super::nbuffer::NBuffer;
use super::ray_batches::Batches;
use crate::error::Error;
use crate::gpu::{Band, Buffer, Constant, Gpu, Mirrored, mirrored};
use crate::lens;
use crate::scene::OPAQUE_ALPHA;
use std::ops::Range;

/// Farther than any fragment: stands for infinity, which shaders need not know.
const ABSENT: f32 = 3e38;

/// Words of an N-buffer before what the method keeps beside it.
pub(in crate::methods) const NBUFFER_WORDS: usize = 2;

/// What [`RAY_STACK`] reads of the program.
pub(in crate::methods) const RAY_STACK_CONSTANTS: [(&str, Constant); 3] = [
    ("NBUFFER_WORDS", Constant::Uint(NBUFFER_WORDS as u32)),
    ("ABSENT", Constant::Float(ABSENT)),
    ("OPAQUE_ALPHA", Constant::Float(OPAQUE_ALPHA)),
];

/// What the stack is bound to, and how rays read it: after [`super::RAY_SUMS`], before a method's own.
pub(in crate::methods) const RAY_STACK: &str = include_str!("../../../shaders/shared/ray_stack.wgsl");

/// Bytes of the two colours of a fragment that lie together, and of all of it.
const FRAGMENT_BYTES: [usize; 2] = [8, 20];

mirrored! {
    /// The rows of the stack at hand, and those of the picture that are made of them.
    pub(in crate::methods) struct Stack {
        /// Columns of the picture.
        width: u32,
        /// Its first row that is made.
        row: u32,
        /// How many are.
        rows: u32,
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
        /// Blocks in a row.
        block_columns: u32,
        /// Rows of blocks.
        block_rows: u32,
        /// One over a block's side.
        blocks_per_sample: f32,
    }
}

mirrored! {
    /// A lens sample, in samples.
    pub(in crate::methods) struct View {
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

impl View {
    /// How many samples above or below its pixel the ray is at most between the CoC radii `range_px`.
    fn away(&self, range_px: [f32; 2]) -> f32 {
        let [near, far] = range_px.map(|coc| (self.start_y + coc * self.step_y).abs());
        near.max(far)
    }
}

/// The lens samples of a picture.
#[derive(Debug)]
pub(in crate::methods) struct RayViews {
    /// One [`View`] after the other.
    pub buffer: Buffer,
    /// How many rows of the picture above or below its pixel a ray looks at most.
    pub reach_rows: usize,
}

impl RayViews {
    /// `views`, at a place in the pixel that is `jitter` of theirs, of rays that look between the CoC radii `range_px`.
    pub(in crate::methods) fn new<'v>(
        gpu: &Gpu,
        views: impl Iterator<Item = &'v lens::View>,
        (jitter, supersample): (f32, f32),
        range_px: [f32; 2],
    ) -> Result<Self, Error> {
        let view = |view: &lens::View| {
            let start = jitter * supersample * view.jitter;
            let step = supersample * view.lens;
            View { start_x: start.x, start_y: start.y, step_x: step.x, step_y: step.y }
        };
        let views: Vec<View> = views.map(view).collect();
        let away = views.iter().map(|view| view.away(range_px)).fold(0.0, f32::max);
        let words: Vec<u32> = views.iter().flat_map(View::words).collect();
        let buffer = gpu.upload("lens samples", &words)?;
        Ok(Self { buffer, reach_rows: (away / supersample).ceil() as usize + 1 })
    }
}

/// A stack that rays go through.
#[derive(Debug, Clone, Copy)]
pub(in crate::methods) struct RayStack<'a> {
    /// Its fragments.
    pub fragments: &'a Fragments,
    /// What N-buffers are kept for.
    pub blocks: Blocks,
    /// Samples of a pixel along each axis.
    pub supersample: usize,
}

/// The rows of a stack that a band reads.
#[derive(Debug)]
pub(in crate::methods) struct StackRows {
    stack: Buffer,
    coc_px: Buffer,
    /// Red and green, and blue and alpha.
    colors: [Buffer; 2],
}

impl RayStack<'_> {
    /// Width and height of the picture.
    pub(in crate::methods) fn picture_size(&self) -> (usize, usize) {
        let (columns, height) = self.fragments.size();
        (columns / self.supersample, height / self.supersample)
    }

    /// Rows of the picture that `gpu` holds at once, if there are `beside` bytes beside each fragment.
    pub(in crate::methods) fn max_rows(&self, gpu: &Gpu, beside: usize) -> usize {
        let [largest, all] = FRAGMENT_BYTES;
        let fragments = self.supersample.pow(2) * self.fragments.depth();
        Batches::max_rows(gpu, self.picture_size().0, [largest, all + beside].map(|bytes| bytes * fragments))
    }

    /// The rows of samples that `band` reads.
    pub(in crate::methods) fn samples(&self, band: &Band) -> Range<usize> {
        band.source.start * self.supersample..band.source.end * self.supersample
    }

    /// Uploads the rows that `band` reads.
    pub(in crate::methods) fn rows(&self, gpu: &Gpu, band: &Band) -> Result<StackRows, Error> {
        let samples = self.samples(band);
        let coc_px = self.fragments.coc_px_of_rows(samples.clone());
        let coc_px: Vec<f32> = coc_px.iter().map(|coc| coc.min(ABSENT)).collect();
        let colors = self.fragments.color_of_rows(samples);
        let pair = |first: usize| -> Vec<[f32; 2]> {
            colors.iter().map(|color| [color[first], color[first + 1]]).collect()
        };
        Ok(StackRows {
            stack: gpu.uniform(&self.stack(band))?,
            coc_px: gpu.upload("CoC radii", &coc_px)?,
            colors: [gpu.upload("red and green", &pair(0))?, gpu.upload("blue and alpha", &pair(2))?],
        })
    }

    fn stack(&self, band: &Band) -> Stack {
        let (columns, height) = self.fragments.size();
        let samples = self.samples(band);
        Stack {
            width: self.picture_size().0 as u32,
            row: band.rows.start as u32,
            rows: band.rows.len() as u32,
            supersample: self.supersample as f32,
            columns: columns as u32,
            height: height as u32,
            top: samples.start as u32,
            bottom: samples.end as u32 - 1,
            depth: self.fragments.depth() as u32,
            block_columns: self.blocks.columns as u32,
            block_rows: self.blocks.rows as u32,
            blocks_per_sample: 1.0 / self.blocks.side as f32,
        }
    }
}

impl StackRows {
    /// The rows, by the numbers that [`RAY_STACK`] binds them to.
    pub(in crate::methods) fn bindings(&self) -> [(u32, &Buffer); 4] {
        let [red_green, blue_alpha] = &self.colors;
        [(3, &self.stack), (5, &self.coc_px), (6, red_green), (7, blue_alpha)]
    }
}

/// `buffers` as the shader has them, with the method's `own` words between what speaks of them and their values.
pub(in crate::methods) fn nbuffer_words(buffers: &[Option<&NBuffer>], own: Vec<u32>) -> Vec<u32> {
    let begin = NBUFFER_WORDS * buffers.len() + own.len();
    let (mut words, mut values) = (Vec::with_capacity(begin), Vec::new());
    for buffer in buffers {
        let levels = buffer.map_or(&[][..], NBuffer::levels);
        words.extend([begin + values.len(), levels.len()].map(|word| word as u32));
        values.extend(levels.iter().flatten().map(|&value| bits(value)));
    }
    words.into_iter().chain(own).chain(values).collect()
}

/// The bits of `value`, with the farthest number for infinity.
pub(in crate::methods) fn bits(value: f32) -> u32 {
    value.clamp(-ABSENT, ABSENT).to_bits()
}
