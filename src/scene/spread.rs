//! Statistics of how far fragments spread, and where. The cost of a blur is predicted from them.
//!
//! They are taken in the pass of [`super::stats`], one row of one layer at a time, from every fourth row only: that is enough for a
//! prediction and costs a few milliseconds at 1080p. Counts and sums are estimates for all rows.

use super::surface;
use std::ops::Range;

/// Number of steps of [`Spread::steps`].
pub(super) const COC_STEPS: usize = 32;

/// Largest number of blocks along the longer side of the picture.
const MAX_BLOCKS: usize = 32;

/// Smallest side of a block in picture pixels.
const MIN_BLOCK_PX: usize = 16;

/// One row of this many is sampled.
const ROW_STRIDE: usize = 4;

/// Values that are processed at once.
const LANES: usize = 16;

/// Number of fragments with CoC radii of one step of size: in front of focus, and behind it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub(crate) struct CocStep {
    /// Of the nearest layer.
    pub front: [usize; 2],
    /// Of all other layers.
    pub behind: [usize; 2],
}

/// How far the fragments of a scene spread.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize)]
pub(crate) struct Spread {
    /// CoC radius at infinity, in picture pixels.
    pub coc_infinity_px: f32,
    /// Fragments by the size of their CoC, see [`coc_step`].
    pub steps: [CocStep; COC_STEPS],
    /// Number of changes of surface along rows, of the nearest layer and of all others: a pair of neighbours counts as
    /// 1 where only one of them is a fragment or their surfaces are wholly different, and as a fraction where they differ
    /// less: see [`surface::difference`].
    pub changes: [f64; 2],
    /// Number of pairs that count as 1.
    pub edges: [f64; 2],
    /// The picture in blocks; not part of reports.
    #[serde(skip)]
    pub blocks: Blocks,
}

/// CoC radii of step `step` of [`Spread::steps`] in picture pixels: step 0 is below half a pixel, then there are two steps per octave.
pub(super) fn coc_step(step: usize) -> Range<f64> {
    let bound = |half_octaves: usize| {
        0.5 * f64::from(1_u32 << (half_octaves / 2)) * if half_octaves.is_multiple_of(2) { 1.0 } else { 1.5 }
    };
    if step == 0 { 0.0..0.5 } else { bound(step - 1)..bound(step) }
}

/// The step that `coc_px` falls into.
#[inline(always)]
fn step_of(coc_px: f32) -> usize {
    // Without the sign, the exponent and the first bit of the mantissa number the half octaves.
    const HALF: u32 = 0.5_f32.to_bits() >> 22;
    (((coc_px.abs().to_bits() >> 22) + 1).saturating_sub(HALF) as usize).min(COC_STEPS - 1)
}

/// The picture in square blocks.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Blocks {
    /// Side of a block in picture pixels.
    pub side_px: usize,
    /// Blocks in a row.
    pub columns: usize,
    /// The blocks, row by row.
    pub blocks: Vec<Block>,
}

/// Statistics of one block. CoC radii are signed, in picture pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Block {
    /// CoC radius of the nearest fragment; infinite without any.
    pub near_px: f32,
    /// CoC radius of the farthest fragment; infinite without any.
    pub far_px: f32,
    /// Number of sampled fragments of the nearest layer.
    pub front: f64,
    /// Sum of their CoC radii.
    pub front_coc_px: f64,
    /// Sum of the absolute values of their CoC radii.
    pub front_size_px: f64,
}

impl Default for Block {
    fn default() -> Self {
        Self {
            near_px: f32::INFINITY,
            far_px: f32::NEG_INFINITY,
            front: 0.0,
            front_coc_px: 0.0,
            front_size_px: 0.0,
        }
    }
}

impl Blocks {
    /// Empty blocks for a picture of this size.
    fn empty((width, height): (usize, usize)) -> Self {
        let side_px = width.max(height).div_ceil(MAX_BLOCKS).next_multiple_of(MIN_BLOCK_PX);
        let side_px = side_px.max(MIN_BLOCK_PX);
        let columns = width.div_ceil(side_px);
        Self { side_px, columns, blocks: vec![Block::default(); columns * height.div_ceil(side_px)] }
    }

    /// Side of a block in samples.
    pub(super) fn side(picture_size: (usize, usize), supersample: usize) -> usize {
        Self::empty(picture_size).side_px * supersample
    }
}

impl Block {
    fn add(&mut self, other: &Self, is_front: bool) {
        self.near_px = self.near_px.min(other.near_px);
        self.far_px = self.far_px.max(other.far_px);
        if is_front {
            self.front += other.front;
            self.front_coc_px += other.front_coc_px;
            self.front_size_px += other.front_size_px;
        }
    }
}

impl Spread {
    /// The statistics of no rows, for a picture of this size.
    pub(super) fn empty(picture_size: (usize, usize), coc_infinity_px: f32) -> Self {
        Self { coc_infinity_px, blocks: Blocks::empty(picture_size), ..Self::default() }
    }

    /// Adds row `y` of a layer, the nearest or another one.
    pub(super) fn add(&mut self, row: &RowSpread, y: usize, is_front: bool, supersample: usize) {
        for (step, counted) in self.steps.iter_mut().zip(&row.steps) {
            let counts = if is_front { &mut step.front } else { &mut step.behind };
            counts.iter_mut().zip(counted).for_each(|(sum, &count)| *sum += ROW_STRIDE * count as usize);
        }
        self.changes[usize::from(!is_front)] += ROW_STRIDE as f64 * f64::from(row.changes);
        self.edges[usize::from(!is_front)] += ROW_STRIDE as f64 * f64::from(row.edges);
        let at = y / (self.blocks.side_px * supersample) * self.blocks.columns;
        let blocks = self.blocks.blocks.iter_mut().skip(at);
        blocks.zip(&row.blocks).for_each(|(block, row)| block.add(row, is_front));
    }
}

/// Statistics of one row of one layer.
#[derive(Debug, Clone, Default)]
pub(super) struct RowSpread {
    steps: [[u32; 2]; COC_STEPS],
    changes: f32,
    edges: f32,
    blocks: Vec<Block>,
}

impl RowSpread {
    /// Whether row `y` is sampled.
    pub(super) fn is_sampled(y: usize) -> bool {
        y.is_multiple_of(ROW_STRIDE)
    }

    /// The statistics of a row, in blocks of `side` samples. Inlined so that it is compiled for each instruction set.
    #[inline(always)]
    pub(super) fn from_samples(alpha: &[f32], coc_px: &[f32], side: usize) -> Self {
        let mut row = Self::default();
        for (&alpha, &coc) in alpha.iter().zip(coc_px) {
            row.steps[step_of(coc)][usize::from(coc > 0.0)] += u32::from(alpha > 0.0);
        }
        [row.changes, row.edges] = changes(alpha, coc_px);
        row.blocks =
            alpha.chunks(side).zip(coc_px.chunks(side)).map(|(alpha, coc)| block(alpha, coc)).collect();
        row
    }
}

/// Statistics of the samples of one row that lie in one block.
#[inline(always)]
fn block(alpha: &[f32], coc_px: &[f32]) -> Block {
    let (mut near, mut far) = ([f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]);
    let (mut count, mut sum, mut size) = ([0.0_f32; LANES], [0.0_f32; LANES], [0.0_f32; LANES]);
    let mut add = |alpha: &[f32; LANES], coc: &[f32; LANES]| {
        for lane in 0..LANES {
            let (present, coc) = (alpha[lane] > 0.0, coc[lane]);
            near[lane] = if present & (coc < near[lane]) { coc } else { near[lane] };
            far[lane] = if present & (coc > far[lane]) { coc } else { far[lane] };
            count[lane] += if present { 1.0 } else { 0.0 };
            sum[lane] += if present { coc } else { 0.0 };
            size[lane] += if present { coc.abs() } else { 0.0 };
        }
    };
    let ((alphas, alpha_rest), (cocs, coc_rest)) = (alpha.as_chunks::<LANES>(), coc_px.as_chunks::<LANES>());
    alphas.iter().zip(cocs).for_each(|(alpha, coc)| add(alpha, coc));
    add(&padded(alpha_rest), &padded(coc_rest));
    let total = |lanes: [f32; LANES]| f64::from(lanes.iter().sum::<f32>());
    Block {
        near_px: near.into_iter().fold(f32::INFINITY, f32::min),
        far_px: far.into_iter().fold(f32::NEG_INFINITY, f32::max),
        front: total(count),
        front_coc_px: total(sum),
        front_size_px: total(size),
    }
}

/// [`Spread::changes`] and [`Spread::edges`] of one row.
#[inline(always)]
fn changes(alpha: &[f32], coc_px: &[f32]) -> [f32; 2] {
    let (mut sum, mut whole) = ([0.0_f32; LANES], [0.0_f32; LANES]);
    let mut add = |alpha: [&[f32; LANES]; 2], coc: [&[f32; LANES]; 2]| {
        for lane in 0..LANES {
            let present = alpha.map(|alpha| alpha[lane] > 0.0);
            let change = surface::difference(coc[0][lane], coc[1][lane]);
            let change = if present[0] & present[1] { change } else { f32::from(present[0] ^ present[1]) };
            sum[lane] += change;
            whole[lane] += if change >= 1.0 { 1.0 } else { 0.0 };
        }
    };
    let Some(last) = alpha.len().checked_sub(1) else { return [0.0; 2] };
    let (alphas, coc) = ([&alpha[..last], &alpha[1..]], [&coc_px[..last], &coc_px[1..]]);
    let (alpha_chunks, coc_chunks) =
        (alphas.map(<[f32]>::as_chunks::<LANES>), coc.map(<[f32]>::as_chunks::<LANES>));
    for i in 0..alpha_chunks[0].0.len() {
        add(alpha_chunks.map(|(chunks, _)| &chunks[i]), coc_chunks.map(|(chunks, _)| &chunks[i]));
    }
    let (alpha_rest, coc_rest) =
        (alpha_chunks.map(|(_, rest)| padded(rest)), coc_chunks.map(|(_, rest)| padded(rest)));
    add(alpha_rest.each_ref(), coc_rest.each_ref());
    [sum.iter().sum(), whole.iter().sum()]
}

/// `rest`, padded with zeros to a full set of lanes.
#[inline(always)]
fn padded(rest: &[f32]) -> [f32; LANES] {
    let mut lanes = [0.0; LANES];
    lanes[..rest.len()].copy_from_slice(rest);
    lanes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_radius_falls_into_the_step_that_contains_it() {
        for i in 0..20_000 {
            let coc = 0.01 * i as f32;
            let span = coc_step(step_of(-coc));
            assert!(span.contains(&f64::from(coc)), "{coc} in {span:?}");
        }
        assert_eq!(step_of(f32::MAX), COC_STEPS - 1, "the last one is open");
    }

    #[test]
    fn a_row_is_counted_block_by_block() {
        // 40 samples, blocks of 16: −2 in the first block, 3 in the second, a single 5 in the third.
        let alpha: Vec<f32> = (0..40).map(|x| f32::from(u8::from(x < 32 || x == 39))).collect();
        let coc: Vec<f32> = (0..40).map(|x| [-2.0, 3.0, 5.0][x / 16]).collect();
        let row = RowSpread::from_samples(&alpha, &coc, 16);
        let ends: Vec<_> =
            row.blocks.iter().map(|block| (block.near_px, block.far_px, block.front)).collect();
        assert_eq!(ends, [(-2.0, -2.0, 16.0), (3.0, 3.0, 16.0), (5.0, 5.0, 1.0)]);
        assert_eq!(row.blocks[0].front_coc_px, -32.0);
        assert_eq!(row.blocks[0].front_size_px, 32.0);
        assert_eq!((row.changes, row.edges), (3.0, 3.0), "−2 | 3 | empty | 5");
        assert_eq!([-2.0, 3.0, 5.0].map(|coc| row.steps[step_of(coc)]), [[16, 0], [0, 16], [0, 1]]);
    }

    #[test]
    fn every_sampled_row_counts_for_four() {
        let mut spread = Spread::empty((40, 8), 1.0);
        let row = RowSpread::from_samples(&[1.0; 40], &[-2.0; 40], 16);
        assert_eq!((0..8).map(RowSpread::is_sampled).filter(|sampled| *sampled).count(), 2, "of eight");
        spread.add(&row, 0, true, 1);
        spread.add(&row, 4, true, 1);
        spread.add(&row, 4, false, 1);
        assert_eq!(spread.steps[step_of(-2.0)], CocStep { front: [320, 0], behind: [160, 0] });
    }

    #[test]
    fn neighbours_on_a_slope_count_in_proportion_to_their_difference() {
        let coc: Vec<f32> = (0..33).map(|x| 0.125 * x as f32).collect();
        let row = RowSpread::from_samples(&[1.0; 33], &coc, 64);
        assert_eq!((row.changes, row.edges), (8.0, 0.0), "32 pairs, each a quarter of half a pixel");
    }

    #[test]
    fn a_row_of_one_sample_has_no_pairs() {
        assert_eq!(changes(&[1.0], &[2.0]), [0.0; 2]);
        assert_eq!(changes(&[], &[]), [0.0; 2]);
    }
}
