//! Keys: for each fragment its bin, and the neighbouring bins that it joins.
//!
//! **Watertight rule**: a fragment covers all bins from its own to half-way to each of its four neighbours that belong to the same surface
//! ([`surface::join_limit_px`]), rounded up on both sides. A view may step across a corner from one bin to the next, so that the way to the
//! neighbour beside and the way to the one above or below are added up: on a plane they reach half-way to the one across the corner. Where the fragment's own peel does not go on, the neighbour may lie in any
//! other peel, within [`surface::JOIN_PX`]. Surfaces then have no cracks where they cross from bin to bin, nor where a nearer surface
//! begins and they continue one peel farther back. Translucent fragments join like opaque ones; a ray that hits one surface in several
//! bins counts it once (see [`super::translucent_hits`]), for which a key says whether its surface continues in another peel.

use super::bins::{Bins, EMPTY};
use super::shown::Shown;
use crate::parallel;
use crate::scene::surface::{self, JOIN_PX, MAX_JOIN_PX};
use crate::scene::{Layer, OPAQUE_ALPHA};
use pulp::{Arch, NullaryFnOnce};
use std::ops::Range;

/// A fragment's bins and opacity, packed: its first bin from bit [`BIN_SHIFT`] on, the number of further bins from [`EXTRA_SHIFT`] on, and
/// the flags [`OPAQUE`] and [`CHANGES_PEEL`]. [`NO_KEY`] for a sample without a fragment.
pub(super) type Key = u32;

/// Lowest bit of the first bin.
pub(super) const BIN_SHIFT: u32 = 16;

/// Lowest bit of the number of further bins.
pub(super) const EXTRA_SHIFT: u32 = 2;

/// Mask of the number of further bins, before the shift.
pub(super) const EXTRA_MASK: Key = 0x3fff;

/// Flag of an opaque fragment.
pub(super) const OPAQUE: Key = 1;

/// Flag of a translucent fragment whose surface continues in another peel at one of its neighbours.
pub(super) const CHANGES_PEEL: Key = 2;

/// The key of a sample without a fragment.
pub(super) const NO_KEY: Key = Key::MAX;

/// Largest number of bins that a fragment is in: its own, and on either side those within [`MAX_JOIN_PX`], half of it along rows and half
/// along columns. Two pixels across focus have fewer than a hundred bins.
pub(super) const MAX_BINS_OF_FRAGMENT: usize = 2 * (MAX_JOIN_PX as usize * 50) + 1;

/// Samples around the picture that have no fragment, so that no neighbour lies outside.
const PAD: usize = 2;

/// The neighbours of a fragment in its column, and those in its row: columns and rows away.
const SIDES: [[[isize; 2]; 2]; 2] = [[[0, -1], [0, 1]], [[-1, 0], [1, 0]]];

/// The keys of some rows of a stack, computed row by row.
#[derive(Debug)]
pub(super) struct Keys<'a> {
    layers: &'a [Layer],
    padded: Vec<Padded>,
    /// The farthest bin.
    last_bin: u16,
    extent: Extent,
    arch: Arch,
}

/// How far fragments extend to the neighbours of their surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Extent {
    /// Half-way to nearer and to farther ones: for rays, which may hit the surface from either side and count it once.
    HalfWay,
    /// To farther neighbours: for what occludes a highlight, in which no fragment is in a nearer bin than its own.
    Occluder,
}

/// The bins and CoC radii of some rows of a layer, with [`PAD`] samples on each side.
#[derive(Debug)]
struct Padded {
    /// The row of the layer that comes after the padding above.
    first_row: usize,
    /// Samples from one row to the next.
    stride: usize,
    /// [`EMPTY`] where there is no fragment.
    bins: Vec<u16>,
    /// NaN where there is no fragment.
    coc_px: Vec<f32>,
}

impl Padded {
    /// Those of `rows` of layer `number`, and of the rows within [`PAD`] of them, as far as the keys of what is `shown` depend on them.
    fn new((number, layer): (usize, &Layer), bins: &Bins, shown: &Shown, rows: Range<usize>) -> Self {
        let (width, height) = (layer.width(), layer.height());
        let stride = width + 2 * PAD;
        let mut indices = vec![EMPTY; stride * (rows.len() + 2 * PAD)];
        let mut coc_px = vec![f32::NAN; stride * (rows.len() + 2 * PAD)];
        let places = indices.chunks_mut(stride).zip(coc_px.chunks_mut(stride));
        parallel::for_each(places, &|place, (indices, coc_px)| {
            let Some(y) = (rows.start + place).checked_sub(PAD).filter(|&y| y < height) else { return };
            for columns in shown.around(number, y) {
                let places = PAD + columns.start..PAD + columns.end;
                let (indices, coc_px) = (&mut indices[places.clone()], &mut coc_px[places]);
                let [alpha, coc] = [&layer.alpha, &layer.coc_px].map(|plane| &plane.row(y)[columns.clone()]);
                bins.fill_indices(coc, indices);
                let places = indices.iter_mut().zip(coc_px);
                for ((index, place), (&alpha, &coc)) in places.zip(alpha.iter().zip(coc)) {
                    let present = alpha > 0.0;
                    *index = if present { *index } else { EMPTY };
                    *place = if present { coc } else { f32::NAN };
                }
            }
        });
        Self { first_row: rows.start, stride, bins: indices, coc_px }
    }

    /// The first sample of row `y`, moved by `columns` and `rows`.
    #[inline(always)]
    fn start(&self, y: usize, [columns, rows]: [isize; 2]) -> usize {
        let row = (y - self.first_row + PAD).wrapping_add_signed(rows);
        (row * self.stride + PAD).wrapping_add_signed(columns)
    }
}

impl<'a> Keys<'a> {
    /// The keys of the fragments in `rows` of `layers` that are `shown`, which extend by `extent` in `bins`.
    pub(super) fn new(
        layers: &'a [Layer],
        bins: &Bins,
        (extent, shown): (Extent, &Shown),
        rows: Range<usize>,
    ) -> Self {
        let padded =
            layers.iter().enumerate().map(|layer| Padded::new(layer, bins, shown, rows.clone())).collect();
        Self { layers, padded, last_bin: (bins.count() - 1) as u16, extent, arch: Arch::new() }
    }

    /// Makes `row` the keys of `columns` of row `y` of layer `layer`.
    pub(super) fn fill(&self, (layer, y): (usize, usize), columns: Range<usize>, row: &mut Vec<Key>) {
        self.arch.dispatch(RowKeys { keys: self, layer, y, columns, row });
    }
}

/// Columns whose keys are computed together: where all fragments of these have their neighbours in their own peel, the others are not looked
/// at.
const BLOCK: usize = 64;

/// How far the fragments of some columns extend.
struct Joins {
    /// For the neighbours of a fragment's surface in its column and for those in its row: how many bins nearer and farther they are.
    nearer: [[u16; BLOCK]; 2],
    farther: [[u16; BLOCK]; 2],
    /// Whether the current neighbour has been found.
    found: [u16; BLOCK],
    /// Whether any neighbour lies in another peel.
    changes_peel: [u16; BLOCK],
}

impl Joins {
    /// Without neighbours.
    const NONE: Self = Self {
        nearer: [[0; BLOCK]; 2],
        farther: [[0; BLOCK]; 2],
        found: [0; BLOCK],
        changes_peel: [0; BLOCK],
    };
}

/// Fills `row` for `columns` of row `y` of layer `layer`; compiled for each instruction set.
struct RowKeys<'a, 'b> {
    keys: &'a Keys<'b>,
    layer: usize,
    y: usize,
    columns: Range<usize>,
    row: &'a mut Vec<Key>,
}

impl NullaryFnOnce for RowKeys<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { keys, layer, y, columns, row } = self;
        row.resize(columns.len(), NO_KEY);
        for (out, first) in row.chunks_mut(BLOCK).zip(columns.step_by(BLOCK)) {
            keys.fill_block((layer, y), first, out);
        }
    }
}

impl Keys<'_> {
    /// Fills `out` with the keys from column `first` of row `y` of layer `layer` on, of at most [`BLOCK`] columns.
    #[inline(always)]
    fn fill_block(&self, (layer, y): (usize, usize), first: usize, out: &mut [Key]) {
        let Self { layers, padded, last_bin, extent, .. } = self;
        let (own, alphas) = (&padded[layer], &layers[layer].alpha.row(y)[first..first + out.len()]);
        if !alphas.iter().fold(false, |any, &alpha| any | (alpha > 0.0)) {
            return out.fill(NO_KEY);
        }
        let count = out.len();
        let part = |peel: &Padded, side: [isize; 2]| {
            let start = peel.start(y, side) + first;
            start..start + count
        };
        let (mut joins, here) = (Joins::NONE, Samples::of(own, part(own, [0, 0])));
        for (axis, [dx, dy]) in
            SIDES.iter().enumerate().flat_map(|(axis, sides)| sides.map(|side| (axis, side)))
        {
            let neighbours = Samples::of(own, part(own, [dx, dy]));
            let before = &own.coc_px[part(own, [-dx, -dy])];
            let after = &own.coc_px[part(own, [2 * dx, 2 * dy])];
            let Found { every } = join_own(&mut joins, axis, here, neighbours, before, after);
            if every {
                continue;
            }
            for peel in padded.iter().enumerate().filter(|(peel, _)| *peel != layer).map(|(_, peel)| peel) {
                join_other(&mut joins, axis, here, Samples::of(peel, part(peel, [dx, dy])));
            }
        }
        pack(out, &joins, here.bins, (*last_bin, *extent), alphas);
    }
}

/// Bins and CoC radii of part of a row.
#[derive(Clone, Copy)]
struct Samples<'a> {
    bins: &'a [u16],
    coc_px: &'a [f32],
}

impl<'a> Samples<'a> {
    #[inline(always)]
    fn of(peel: &'a Padded, part: Range<usize>) -> Self {
        Self { bins: &peel.bins[part.clone()], coc_px: &peel.coc_px[part] }
    }
}

/// Whether every fragment has a neighbour of its surface on one side.
struct Found {
    every: bool,
}

/// Joins the fragments `here` to the `neighbours` in their own peel on one side, and sets `joins.found`. `before` and `after` are the CoC
/// radii of the samples on the other side, and of those beyond the neighbours.
#[inline(always)]
fn join_own(
    joins: &mut Joins,
    axis: usize,
    here: Samples<'_>,
    neighbours: Samples<'_>,
    before: &[f32],
    after: &[f32],
) -> Found {
    let count = here.bins.len();
    let (nearer, farther) = (&mut joins.nearer[axis][..count], &mut joins.farther[axis][..count]);
    let found = &mut joins.found[..count];
    let (bins, coc, before) = (&here.bins[..count], &here.coc_px[..count], &before[..count]);
    let (other_bins, other_coc, after) =
        (&neighbours.bins[..count], &neighbours.coc_px[..count], &after[..count]);
    let mut lacking = false;
    for x in 0..count {
        let joined = surface::goes_on([before[x], coc[x], other_coc[x], after[x]]);
        extend((&mut nearer[x], &mut farther[x]), bins[x], other_bins[x], joined);
        found[x] = u16::from(joined);
        lacking |= !joined & (bins[x] != EMPTY);
    }
    Found { every: !lacking }
}

/// Joins the fragments `here` whose surface was not `found` in their own peel to their `neighbours` in another peel.
#[inline(always)]
fn join_other(joins: &mut Joins, axis: usize, here: Samples<'_>, neighbours: Samples<'_>) {
    let count = here.bins.len();
    let (nearer, farther) = (&mut joins.nearer[axis][..count], &mut joins.farther[axis][..count]);
    let (found, changes_peel) = (&mut joins.found[..count], &mut joins.changes_peel[..count]);
    let (bins, coc) = (&here.bins[..count], &here.coc_px[..count]);
    let (other_bins, other_coc) = (&neighbours.bins[..count], &neighbours.coc_px[..count]);
    for x in 0..count {
        let joined = ((other_coc[x] - coc[x]).abs() < JOIN_PX) & (found[x] == 0);
        extend((&mut nearer[x], &mut farther[x]), bins[x], other_bins[x], joined);
        found[x] |= u16::from(joined);
        changes_peel[x] |= u16::from(joined);
    }
}

/// Extends a fragment of bin `bin` towards a neighbour of bin `other`.
#[inline(always)]
fn extend((nearer, farther): (&mut u16, &mut u16), bin: u16, other: u16, joined: bool) {
    let [to_nearer, to_farther] = [bin.saturating_sub(other), other.saturating_sub(bin)];
    *nearer = (*nearer).max(if joined { to_nearer } else { 0 });
    *farther = (*farther).max(if joined { to_farther } else { 0 });
}

/// Packs the `keys` of fragments in `bins`, of which `last_bin` is the farthest, with these `alphas`; they extend by `extent` to where they
/// join.
#[inline(always)]
fn pack(keys: &mut [Key], joins: &Joins, bins: &[u16], (last_bin, extent): (u16, Extent), alphas: &[f32]) {
    let count = keys.len();
    let [[nearer_above, nearer_beside], [farther_above, farther_beside]] =
        [&joins.nearer, &joins.farther].map(|axes| [&axes[0][..count], &axes[1][..count]]);
    let changes = &joins.changes_peel[..count];
    let (bins, alphas) = (&bins[..count], &alphas[..count]);
    for (x, key) in keys.iter_mut().enumerate() {
        let flags = if alphas[x] >= OPAQUE_ALPHA { OPAQUE } else { Key::from(changes[x]) * CHANGES_PEEL };
        // Half-way, and past the nearest bin and past the last one there is none to join.
        let half_way = |above: u16, beside: u16| (above + beside + 1) >> 1;
        let (nearer, farther) = match extent {
            Extent::HalfWay => {
                (half_way(nearer_above[x], nearer_beside[x]), half_way(farther_above[x], farther_beside[x]))
            }
            Extent::Occluder => (0, farther_above[x].max(farther_beside[x])),
        };
        let (nearer, farther) = (nearer.min(bins[x]), farther.min(last_bin.saturating_sub(bins[x])));
        let first = Key::from(bins[x] - nearer);
        let packed = (first << BIN_SHIFT) | (Key::from(nearer + farther) << EXTRA_SHIFT) | flags;
        *key = if bins[x] == EMPTY { NO_KEY } else { packed };
    }
}
