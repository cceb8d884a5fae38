//! Bins of CoC radius: the slices in which the scene is sheared.
//!
//! All fragments of a bin move alike, by its centre's CoC radius, so a bin's width is an error in the radius. Widths follow the radius
//! ([`Scale`]): they are smallest in focus, where a sweep of the f-number has the smallest steps, reach a 16th of a pixel, and from
//! [`FOCUS_PX`] on grow to a plateau, and beyond [`WIDE_FROM_PX`] are a share of the radius. Bins are anchored at `c = 0`, and blocks of bins
//! as well, so that neither moves when the CoC range changes from frame to frame.

use super::{near, resolve};
use crate::scene::surface::SAME_HIT_PX;
use pulp::{Arch, NullaryFnOnce};
use std::ops::Range;

/// Width of the bins in focus, in picture pixels.
const LEAST_WIDTH_PX: f32 = 1.0 / 64.0;

/// Width of the bins near focus as a share of the plateau's: a 16th of a pixel for few views.
const FOCUS_SHARE_OF_PLATEAU: f32 = 1.0 / 8.0;

/// Width of the bins between these two as a share of their radius.
const FOCUS_SHARE: f32 = 0.04;

/// CoC radius up to which bins are narrow, in picture pixels.
const FOCUS_PX: f32 = 3.0;

/// Growth of a bin's width with its radius beyond that.
const GROWTH: f32 = 1.0 / 16.0;

/// Width of the plateau, in picture pixels, for few and for many views. Narrower bins are visible only at low noise.
const PLATEAU_PX: [f32; 2] = [0.5, 0.25];

/// The smallest number of views with the narrower plateau.
const MANY_VIEWS: usize = 128;

/// CoC radius at which the plateau ends, in picture pixels: the widths of wider bins are a share of their radius, for few views a 32nd.
const WIDE_FROM_PX: f32 = 16.0;

/// Width of the plateau for `views` views, in picture pixels.
pub(super) fn plateau_px(views: usize) -> f32 {
    PLATEAU_PX[usize::from(views >= MANY_VIEWS)]
}

/// Number of levels of blocks of bins: a block of level `l` has `2^l` bins.
pub(super) const LEVELS: usize = 5;

/// Number of bins of the largest blocks.
const LARGEST_BLOCK: i32 = 1 << (LEVELS - 1);

/// Width in picture pixels up to which there are blocks of several bins: hardly any view moves wider ones alike.
const WIDEST_BLOCK_PX: f32 = 2.0;

/// The bin index of a sample without a fragment.
pub(super) const EMPTY: u16 = u16::MAX;

/// Largest number of bins a range may have: a bin's index has twelve bits where rays remember it.
pub(super) const MAX_BINS: usize = 1 << 12;

/// A range of CoC radii in which the width of bins is `width_px + growth · (c − start_px)`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Piece {
    start_px: f32,
    /// Position of `start_px` on the scale.
    start: f32,
    width_px: f32,
    growth: f32,
}

impl Piece {
    /// The position of CoC radius `size`: the integral of the reciprocal of the width.
    fn position(&self, size: f32) -> f32 {
        let steps = (size - self.start_px) / self.width_px;
        self.start + if self.growth > 0.0 { (1.0 + self.growth * steps).ln() / self.growth } else { steps }
    }

    /// The CoC radius at `position`: the inverse of [`Piece::position`].
    fn radius(&self, position: f32) -> f32 {
        let steps = position - self.start;
        let widths =
            if self.growth > 0.0 { ((steps * self.growth).exp() - 1.0) / self.growth } else { steps };
        self.start_px + self.width_px * widths
    }
}

/// The scale of bins with a plateau: a strictly rising function of the CoC radius, on which bin `b` covers `b − ½ … b + ½`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Scale {
    pieces: [Piece; 6],
}

impl Scale {
    fn new(plateau_px: f32) -> Self {
        let focus_px = plateau_px * FOCUS_SHARE_OF_PLATEAU;
        let (least_px, shared_px) = (LEAST_WIDTH_PX / FOCUS_SHARE, focus_px / FOCUS_SHARE);
        let plateau_from_px = FOCUS_PX + (plateau_px - focus_px) / GROWTH;
        let wide_px = WIDE_FROM_PX.max(plateau_from_px);
        let starts_and_growths = [
            (0.0, LEAST_WIDTH_PX, 0.0),
            (least_px, LEAST_WIDTH_PX, FOCUS_SHARE),
            (shared_px, focus_px, 0.0),
            (FOCUS_PX, focus_px, GROWTH),
            (plateau_from_px, plateau_px, 0.0),
            (wide_px, plateau_px, plateau_px / wide_px),
        ];
        let mut before: Option<Piece> = None;
        let pieces = starts_and_growths.map(|(start_px, width_px, growth)| {
            let start = before.map_or(0.0, |before| before.position(start_px));
            let piece = Piece { start_px, start, width_px, growth };
            before = Some(piece);
            piece
        });
        Self { pieces }
    }

    /// The last piece of which `begins` holds.
    fn piece(&self, begins: impl Fn(&Piece) -> bool) -> &Piece {
        self.pieces.iter().rfind(|piece| begins(piece)).unwrap_or(&self.pieces[0])
    }

    /// The position of CoC radius `c`.
    fn position(&self, c: f32) -> f32 {
        let size = c.abs();
        self.piece(|piece| piece.start_px <= size).position(size).copysign(c)
    }

    /// The CoC radius at `position`: the inverse of [`Scale::position`].
    fn radius(&self, position: f32) -> f32 {
        let steps = position.abs();
        self.piece(|piece| piece.start <= steps).radius(steps).copysign(position)
    }
}

/// CoC radius from which on there are this many cells per pixel. A cell is at most half as wide as the narrowest bin there, so that it
/// holds at most one bin's end and one comparison finds a bin.
const CELLS_PER_PX: [(f32, f32); 3] = [(0.0, 128.0), (1.25, 64.0), (4.0, 16.0)];

/// The position of CoC radius `c` on a scale of cells.
#[inline(always)]
fn cell_position(c: f32) -> f32 {
    let [(_, fine), (medium_px, medium), (coarse_px, coarse)] = CELLS_PER_PX;
    let size = c.abs();
    let cells = size.min(medium_px) * fine
        + (size.min(coarse_px) - medium_px).max(0.0) * medium
        + (size - coarse_px).max(0.0) * coarse;
    cells.copysign(c)
}

/// A block of bins.
#[derive(Debug, Clone, Copy)]
pub(super) struct Block {
    /// First and last bin.
    pub(super) bins: [u16; 2],
    /// How far its fragments count as in focus, see [`resolve::focus`].
    pub(super) focus: f32,
    /// How far its fragments count as near, see [`near::share`].
    pub(super) near: f32,
    /// Their CoC radius, without its sign, in picture pixels.
    pub(super) radius_px: f32,
}

/// The bins of a range of CoC radii, numbered from the nearest.
#[derive(Debug, Clone)]
pub(super) struct Bins {
    /// CoC radius at the centre of each bin.
    centers_px: Vec<f32>,
    /// CoC radius where each bin ends; infinite for the last one.
    ends_px: Vec<f32>,
    /// For each level, where its blocks begin in the order of all blocks; then the number of all blocks.
    first_block: [u16; LEVELS + 1],
    /// The blocks of all levels, in order.
    blocks: Vec<Block>,
    /// For each of the largest blocks, the highest level with blocks of these bins.
    highest_level: Vec<u8>,
    /// For each bin the nearest bin that may hold an earlier hit of the same translucent surface: see [`SAME_HIT_PX`].
    same_hit_from: Vec<u16>,
    /// For each cell of [`cell_position`] from the range's start on, the bin in which the cell begins.
    first_in_cell: Vec<u16>,
    /// Position of the range's start.
    start: f32,
}

impl Bins {
    /// The bins that cover `range_px`, with this plateau.
    ///
    /// # Panics
    /// If there are more than [`MAX_BINS`], which the limit of CoC radii excludes ([`crate::scene::coc_limit_px`]).
    pub(super) fn new(range_px: [f32; 2], plateau_px: f32) -> Self {
        let scale = Scale::new(plateau_px);
        let [first, last] = range_px.map(|c| (scale.position(c) + 0.5).floor() as i32);
        // Blocks begin at multiples of the largest one, whatever the range.
        let first = first.div_euclid(LARGEST_BLOCK) * LARGEST_BLOCK;
        let centers_px: Vec<f32> = (first..=last).map(|b| scale.radius(b as f32)).collect();
        assert!(centers_px.len() <= MAX_BINS, "CoC radii {range_px:?} make {} bins", centers_px.len());
        let ends_px: Vec<f32> = (first..=last)
            .map(|b| if b == last { f32::INFINITY } else { scale.radius(b as f32 + 0.5) })
            .collect();
        let same_hit_from = (0..centers_px.len())
            .map(|bin| {
                // By a bin's width more, so that wide bins always include the one before.
                let before = bin.saturating_sub(1);
                let nearest_px = centers_px[bin] - SAME_HIT_PX - (centers_px[bin] - centers_px[before]);
                centers_px.partition_point(|&center| center < nearest_px).min(before) as u16
            })
            .collect();
        let start = cell_position(range_px[0]);
        let cells = (cell_position(range_px[1]) - start) as usize + 1;
        let ends: Vec<f32> = ends_px.iter().map(|&end| cell_position(end)).collect();
        let first_in_cell =
            (0..cells).map(|cell| ends.partition_point(|&end| end <= start + cell as f32) as u16).collect();
        let (blocks, highest_level) = (blocks(&centers_px), highest_level(&centers_px));
        let first_block = first_block(centers_px.len());
        Self { centers_px, ends_px, first_block, blocks, highest_level, same_hit_from, first_in_cell, start }
    }

    /// Number of bins.
    pub(super) fn count(&self) -> usize {
        self.centers_px.len()
    }

    /// CoC radius at the centre of each bin, nearest first.
    pub(super) fn centers_px(&self) -> &[f32] {
        &self.centers_px
    }

    /// Whether the centres of neighbours are less than `width_px` apart, from the first to the last of `bins`.
    pub(super) fn are_within(&self, width_px: f32, [first, last]: [u16; 2]) -> bool {
        let centers_px = &self.centers_px[first.into()..=last.into()];
        let mut gaps_px = centers_px.windows(2).map(|pair| pair[1] - pair[0]);
        // They grow away from focus, so that one of the outer two is the largest.
        gaps_px.next().into_iter().chain(gaps_px.next_back()).all(|gap_px| gap_px < width_px)
    }

    /// Whether some of them count as near, at least in part: see [`near::share`].
    pub(super) fn have_near(&self) -> bool {
        self.centers_px.first().is_some_and(|&coc_px| near::share(coc_px) > 0.0)
    }

    /// The blocks of all levels: those of level 0, which are the bins, then those of level 1 and so on.
    pub(super) fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// The blocks of level `level`, in the order of all blocks.
    pub(super) fn blocks_of_level(&self, level: usize) -> Range<usize> {
        self.first_block[level].into()..self.first_block[level + 1].into()
    }

    /// The highest level with a block that begins with `bin`: blocks are aligned to multiples of their size.
    pub(super) fn highest_level(&self, bin: usize) -> usize {
        let aligned = bin.trailing_zeros() as usize;
        aligned.min(self.highest_level[bin / LARGEST_BLOCK as usize].into())
    }

    /// The nearest bin that may hold an earlier hit of the translucent surface that a ray hits in `bin`.
    pub(super) fn same_hit_from(&self, bin: usize) -> u16 {
        self.same_hit_from[bin]
    }

    /// The bin of CoC radius `c`, which lies in the range.
    pub(super) fn index(&self, c: f32) -> u16 {
        self.index_from(self.cell(c), c)
    }

    /// Fills `indices` with the bins of the radii `coc_px`, which lie in the range, or have any bin.
    pub(super) fn fill_indices(&self, coc_px: &[f32], indices: &mut [u16]) {
        Arch::new().dispatch(FillIndices { bins: self, coc_px, indices });
    }

    /// The cell of CoC radius `c`, see [`Bins::first_in_cell`].
    #[inline(always)]
    fn cell(&self, c: f32) -> u32 {
        // 32 bits, to which processors convert in one instruction.
        ((cell_position(c) - self.start) as u32).min(self.first_in_cell.len() as u32 - 1)
    }

    /// The bin of CoC radius `c` in `cell`.
    #[inline(always)]
    fn index_from(&self, cell: u32, c: f32) -> u16 {
        let bin = self.first_in_cell[cell as usize];
        bin + u16::from(c >= self.ends_px[usize::from(bin)])
    }
}

/// See [`Bins::fill_indices`]; compiled for each instruction set.
struct FillIndices<'a> {
    bins: &'a Bins,
    coc_px: &'a [f32],
    indices: &'a mut [u16],
}

impl NullaryFnOnce for FillIndices<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        /// Cells that are computed together before their bins are looked up.
        const TOGETHER: usize = 64;
        let mut cells = [0; TOGETHER];
        for (coc_px, indices) in self.coc_px.chunks(TOGETHER).zip(self.indices.chunks_mut(TOGETHER)) {
            cells.iter_mut().zip(coc_px).for_each(|(cell, &c)| *cell = self.bins.cell(c));
            for ((index, &cell), &c) in indices.iter_mut().zip(&cells).zip(coc_px) {
                *index = self.bins.index_from(cell, c);
            }
        }
    }
}

/// See [`Bins::first_block`].
fn first_block(bins: usize) -> [u16; LEVELS + 1] {
    let mut first = [0; LEVELS + 1];
    for level in 0..LEVELS {
        first[level + 1] = first[level] + bins.div_ceil(1 << level) as u16;
    }
    first
}

/// See [`Bins::blocks`].
fn blocks(centers_px: &[f32]) -> Vec<Block> {
    let count = centers_px.len();
    let of_level = |level: usize| {
        (0..count).step_by(1 << level).map(move |first| {
            let (middle, last) = (first + (1 << level) / 2, first + (1 << level) - 1);
            let coc_px = centers_px[middle.min(count - 1)];
            let (focus, near) = (resolve::focus(coc_px), near::share(coc_px));
            Block { bins: [first as u16, last.min(count - 1) as u16], focus, near, radius_px: coc_px.abs() }
        })
    };
    (0..LEVELS).flat_map(of_level).collect()
}

/// See [`Bins::highest_level`].
fn highest_level(centers_px: &[f32]) -> Vec<u8> {
    let of_group = |bins: &[f32]| {
        let width_px = (bins[bins.len() - 1] - bins[0]) / (bins.len() - 1).max(1) as f32;
        let fits = |level: &u8| width_px * f32::from(1u8 << level) <= WIDEST_BLOCK_PX;
        (1..LEVELS as u8).rev().find(fits).unwrap_or(0)
    };
    centers_px.chunks(LARGEST_BLOCK as usize).map(of_group).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_radius_lies_in_the_bin_whose_centre_is_nearest_on_the_scale() {
        for plateau_px in [0.5, 0.25] {
            let (bins, scale) = (Bins::new([-151.3, 48.2], plateau_px), Scale::new(plateau_px));
            let first = ((scale.position(-151.3) + 0.5).floor() / LARGEST_BLOCK as f32).floor()
                * LARGEST_BLOCK as f32;
            for i in 0..20_000 {
                let c = -151.3 + 199.5 * i as f32 / 20_000.0;
                let expected = scale.position(c) - first;
                let off = (f32::from(bins.index(c)) - expected).abs();
                assert!(off <= 0.501, "c = {c}: bin {}, position {expected}", bins.index(c));
            }
        }
    }

    #[test]
    fn radii_have_the_same_bins_one_by_one_and_together() {
        let bins = Bins::new([-40.0, 100.0], 0.25);
        let coc_px: Vec<f32> = (0..1000).map(|i| -40.0 + 0.14 * i as f32).collect();
        for count in [0, 1, 63, 64, 65, 1000] {
            let mut indices = vec![EMPTY; count];
            bins.fill_indices(&coc_px[..count], &mut indices);
            let expected: Vec<u16> = coc_px[..count].iter().map(|&c| bins.index(c)).collect();
            assert_eq!(indices, expected, "{count} radii");
        }
    }

    #[test]
    fn a_bin_is_as_wide_as_the_law_of_widths_says() {
        let bins = Bins::new([-40.0, 100.0], 0.5);
        let width_px = |c: f32| {
            let bin = bins.index(c) as usize;
            bins.ends_px[bin] - bins.ends_px[bin - 1]
        };
        for (c, expected) in [
            (0.0, 1.0 / 64.0),
            (-0.6, 0.024),
            (2.0, 0.0625),
            (-2.9, 0.0625),
            (4.0, 0.125),
            (11.0, 0.5),
            (-12.0, 0.5),
            (64.0, 2.0),
        ] {
            assert!(
                (width_px(c) / expected - 1.0).abs() < 0.1,
                "at {c}: {}, expected {expected}",
                width_px(c)
            );
        }
    }

    #[test]
    fn focus_is_the_centre_of_a_bin_and_bins_do_not_move_with_the_range() {
        let (narrow, wide) = (Bins::new([-1.0, 1.0], 0.5), Bins::new([-100.0, 30.0], 0.5));
        assert_eq!(narrow.centers_px()[narrow.index(0.005) as usize], 0.0, "bin of focus");
        let center_px = |bins: &Bins, c| bins.centers_px()[bins.index(c) as usize];
        for c in [-0.9, -0.3, 0.2, 0.8] {
            assert_eq!(center_px(&narrow, c), center_px(&wide, c), "c = {c}");
        }
    }

    #[test]
    fn a_range_of_one_radius_has_one_block_of_bins_at_most() {
        let bins = Bins::new([3.0, 3.0], 0.5);
        assert_eq!(
            bins.index(3.0) as usize,
            bins.count() - 1,
            "the last one; those before complete its block"
        );
        assert!(bins.count() <= LARGEST_BLOCK as usize);
    }

    #[test]
    fn radius_inverts_position() {
        let scale = Scale::new(0.25);
        for b in [-250.0, -33.0, -1.5, 0.0, 0.5, 19.9, 31.9, 48.1, 76.0, 90.0, 180.0] {
            assert!((scale.position(scale.radius(b)) - b).abs() < 1e-2, "position {b}");
        }
    }

    #[test]
    fn the_same_surface_is_looked_for_a_pixel_and_a_bin_before() {
        let bins = Bins::new([-60.0, 60.0], 0.5);
        for (c, reach_px) in [(0.0, 1.0156), (2.0, 1.0625), (12.0, 1.5), (50.0, 2.6)] {
            let bin = bins.index(c) as usize;
            let from = bins.same_hit_from(bin) as usize;
            let reach = bins.centers_px()[bin] - bins.centers_px()[from];
            assert!(from < bin && reach <= reach_px + 0.05, "at {c}: {reach} px");
            let next = bins.centers_px()[bin] - bins.centers_px()[from - 1];
            assert!(next > reach_px - 0.05, "at {c}: {next} px are too far");
        }
    }
}
