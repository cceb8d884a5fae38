//! The stack for rays on a GPU: lists of fragments (one band at a time), N-buffers (of the whole picture), and lens samples.
//!
//! All tables are computed on the CPU; `shaders/shared/ray_stack.wgsl` reads them.
//!
//! Memory: 20 bytes per fragment. The N-buffers of a picture have to fit into one buffer.

use super::fragments::{Blocks, Fragments};
use super::nbuffer::NBuffer;
use super::ray_batches::{Batches, RayEnds};
use crate::error::Error;
use crate::gpu::{Band, Buffer, Constant, Gpu, Mirrored, mirrored};
use crate::lens;
use crate::scene::OPAQUE_ALPHA;
use std::ops::Range;

/// Larger than any CoC radius: replaces infinity, which WGSL does not guarantee.
const ABSENT: f32 = 3e38;

/// Header words per N-buffer: index of its values, number of its levels.
pub(in crate::methods) const NBUFFER_WORDS: usize = 2;

/// Constants that [`RAY_STACK`] needs.
pub(in crate::methods) const RAY_STACK_CONSTANTS: [(&str, Constant); 3] = [
    ("NBUFFER_WORDS", Constant::Uint(NBUFFER_WORDS as u32)),
    ("ABSENT", Constant::Float(ABSENT)),
    ("OPAQUE_ALPHA", Constant::Float(OPAQUE_ALPHA)),
];

/// Text of `shaders/shared/ray_stack.wgsl`: bindings of the stack, and functions on it. It comes after [`super::RAY_SUMS`] and
/// before a method's own text.
pub(in crate::methods) const RAY_STACK: &str = include_str!("../../../shaders/shared/ray_stack.wgsl");

/// Bytes per fragment: in the largest buffer (two colour channels), and in all buffers.
const FRAGMENT_BYTES: [usize; 2] = [8, 20];

mirrored! {
    /// The rows of the stack that a band reads, and the rows of the picture that it makes.
    pub(in crate::methods) struct Stack {
        /// Width of the picture.
        width: u32,
        /// First row of the picture that the band makes.
        row: u32,
        /// Number of rows that the band makes.
        rows: u32,
        /// Samples per pixel along each axis.
        supersample: f32,
        /// Width of the stack in samples.
        columns: u32,
        /// Height of the whole stack in samples.
        height: u32,
        /// First row of samples that is uploaded.
        top: u32,
        /// Last row of samples that is uploaded.
        bottom: u32,
        /// Maximum number of fragments per sample.
        depth: u32,
        /// Blocks per row of blocks.
        block_columns: u32,
        /// Rows of blocks.
        block_rows: u32,
        /// Reciprocal of a block's side in samples.
        blocks_per_sample: f32,
    }
}

mirrored! {
    /// A lens sample, in samples.
    pub(in crate::methods) struct View {
        /// Position in the pixel.
        start_x: f32,
        /// Its vertical component.
        start_y: f32,
        /// Step per pixel of CoC radius.
        step_x: f32,
        /// Its vertical component.
        step_y: f32,
    }
}

impl View {
    /// Maximum vertical distance of the ray from its pixel, in samples, between the CoC radii `range_px`.
    fn max_distance(&self, range_px: [f32; 2]) -> f32 {
        let [near, far] = range_px.map(|coc| (self.start_y + coc * self.step_y).abs());
        near.max(far)
    }
}

/// The lens samples of a picture.
#[derive(Debug)]
pub(in crate::methods) struct RayViews {
    /// Array of [`View`]s.
    pub buffer: Buffer,
    /// Maximum distance, in rows of the picture, from a pixel to samples that its rays read.
    pub reach_rows: usize,
}

impl RayViews {
    /// Uploads `views`, with pixel positions scaled by `jitter`, for rays between the CoC radii `range_px`.
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
        let distance = views.iter().map(|view| view.max_distance(range_px)).fold(0.0, f32::max);
        let words: Vec<u32> = views.iter().flat_map(View::words).collect();
        let buffer = gpu.upload("lens samples", &words)?;
        Ok(Self { buffer, reach_rows: (distance / supersample).ceil() as usize + 1 })
    }
}

/// A stack that rays are traced through.
#[derive(Debug, Clone, Copy)]
pub(in crate::methods) struct RayStack<'a> {
    /// Its fragments.
    pub fragments: &'a Fragments,
    /// The grid of the N-buffers.
    pub blocks: Blocks,
    /// Samples per pixel along each axis.
    pub supersample: usize,
}

/// The rows of a stack that a band reads, on the GPU.
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

    /// Maximum number of rows of the picture in a band on `gpu`, if a method needs `additional_bytes` more per fragment.
    pub(in crate::methods) fn max_rows(
        &self,
        gpu: &Gpu,
        additional_bytes: usize,
        ends: RayEnds<'_>,
    ) -> usize {
        let [largest, all] = FRAGMENT_BYTES;
        let fragments = self.supersample.pow(2) * self.fragments.depth();
        let bytes_per_pixel = [largest, all + additional_bytes].map(|bytes| bytes * fragments);
        Batches::max_rows(gpu, self.picture_size().0, bytes_per_pixel, ends)
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
    /// The buffers with their binding numbers in [`RAY_STACK`].
    pub(in crate::methods) fn bindings(&self) -> [(u32, &Buffer); 4] {
        let [red_green, blue_alpha] = &self.colors;
        [(3, &self.stack), (5, &self.coc_px), (6, red_green), (7, blue_alpha)]
    }
}

/// `buffers` in the layout of the shader: headers, then the method's `own` words, then values.
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

/// The bits of `value`, with ±[`ABSENT`] in place of infinity.
pub(in crate::methods) fn bits(value: f32) -> u32 {
    value.clamp(-ABSENT, ABSENT).to_bits()
}
