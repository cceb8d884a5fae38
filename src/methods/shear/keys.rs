//! Keys: for each fragment its bin, and the neighbouring bins that it joins.
//!
//! **Watertight rule**: an opaque fragment also joins the next nearer or farther bin if one of its four neighbours lies on that
//! side and differs by less than [`surface::JOIN_PX`] in CoC radius. The neighbour is the one in the fragment's own peel or, where that
//! belongs to another surface, in any other peel. Surfaces then have no cracks where they cross from bin to bin, nor where a
//! nearer surface begins and they continue one peel farther back. A larger limit would thicken edges. A translucent fragment is
//! in one bin only: in two it would be composited twice.

use super::bins::{Bins, EMPTY};
use crate::scene::{Layer, OPAQUE_ALPHA, surface};
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

/// A fragment's bins and opacity, packed: its first bin from bit [`BIN_SHIFT`] on, the number of further bins in two bits from
/// [`EXTRA_SHIFT`] on, and the flag [`OPAQUE`]. [`NO_KEY`] for a sample without a fragment.
pub(super) type Key = u16;

/// Lowest bit of the first bin.
pub(super) const BIN_SHIFT: u32 = 3;

/// Lowest bit of the number of further bins.
pub(super) const EXTRA_SHIFT: u32 = 1;

/// Mask of the number of further bins, before the shift.
pub(super) const EXTRA_MASK: Key = 3;

/// Flag of an opaque fragment.
pub(super) const OPAQUE: Key = 1;

/// The key of a sample without a fragment.
pub(super) const NO_KEY: Key = Key::MAX;

/// The keys of a stack, computed row by row.
#[derive(Debug)]
pub(super) struct Keys<'a> {
    layers: &'a [Layer],
    /// For each layer, the bin of every sample.
    indices: Vec<Vec<u16>>,
    arch: Arch,
}

impl<'a> Keys<'a> {
    /// The keys of the fragments of `layers` in `bins`.
    pub(super) fn new(layers: &'a [Layer], bins: &Bins) -> Self {
        let indices = layers.iter().map(|layer| bin_indices(layer, bins)).collect();
        Self { layers, indices, arch: Arch::new() }
    }

    /// Fills `row` with the keys of row `y` of layer `layer`.
    pub(super) fn fill(&self, (layer, y): (usize, usize), row: &mut KeyRow) {
        let Self { layers, indices, arch } = self;
        let KeyRow { keys, found } = row;
        arch.dispatch(RowKeys { layers, indices, layer, y, keys, found });
    }
}

/// Memory for a row of keys.
#[derive(Debug)]
pub(super) struct KeyRow {
    /// The keys.
    pub(super) keys: Vec<Key>,
    /// Scratch: for each column, 1 if the current neighbour has been found.
    found: Vec<Key>,
}

impl KeyRow {
    /// Memory for `width` samples.
    pub(super) fn new(width: usize) -> Self {
        Self { keys: vec![NO_KEY; width], found: vec![0; width] }
    }
}

/// The bin of every fragment, [`EMPTY`] where there is none.
fn bin_indices(layer: &Layer, bins: &Bins) -> Vec<u16> {
    let width = layer.width();
    let mut indices = vec![EMPTY; width * layer.height()];
    indices.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        let fragments = layer.alpha.row(y).iter().zip(layer.coc_px.row(y));
        for (index, (&alpha, &coc)) in row.iter_mut().zip(fragments) {
            if alpha > 0.0 {
                *index = bins.index(coc);
            }
        }
    });
    indices
}

/// Fills `keys` for row `y` of layer `layer`; compiled for each instruction set.
struct RowKeys<'a> {
    layers: &'a [Layer],
    indices: &'a [Vec<u16>],
    layer: usize,
    y: usize,
    keys: &'a mut [Key],
    found: &'a mut [Key],
}

impl<'a> NullaryFnOnce for RowKeys<'a> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { layers, indices, layer, y, keys, found } = self;
        let (width, height) = (keys.len(), layers[layer].height());
        let row = |layer: usize, y: usize| {
            (&indices[layer][y * width..(y + 1) * width], layers[layer].coc_px.row(y))
        };
        let here = row(layer, y);
        let (bins, last) = (here.0, width - 1);
        let (tail, head) =
            (|row: Row<'a>| (&row.0[1..], &row.1[1..]), |row: Row<'a>| (&row.0[..last], &row.1[..last]));
        keys.fill(0);
        if y > 0 {
            join_surface(keys, found, here, layer, layers.len(), |peel| row(peel, y - 1));
        }
        if y + 1 < height {
            join_surface(keys, found, here, layer, layers.len(), |peel| row(peel, y + 1));
        }
        join_surface(&mut keys[1..], found, tail(here), layer, layers.len(), |peel| head(row(peel, y)));
        join_surface(&mut keys[..last], found, head(here), layer, layers.len(), |peel| tail(row(peel, y)));
        for ((key, &bin), &alpha) in keys.iter_mut().zip(bins).zip(layers[layer].alpha.row(y)) {
            let opaque = Key::from(alpha >= OPAQUE_ALPHA);
            let joined = *key * opaque;
            let (nearer, farther) = (joined & NEARER, (joined & FARTHER) / FARTHER);
            let packed =
                ((bin - nearer) << BIN_SHIFT) | ((nearer + farther) << EXTRA_SHIFT) | (opaque * OPAQUE);
            *key = if bin == EMPTY { NO_KEY } else { packed };
        }
    }
}

/// Bins and CoC radii of part of a row.
type Row<'a> = (&'a [u16], &'a [f32]);

/// Flag of a fragment that joins the bin before its own.
const NEARER: Key = 1;

/// Flag of a fragment that joins the bin after its own.
const FARTHER: Key = 2;

/// Columns that are searched together in other peels.
const CHUNK_COLUMNS: usize = 32;

/// Joins the fragments `here`, of peel `layer`, to their neighbours on one side; `neighbours(peel)` are those in `peel`.
///
/// A surface continues in its own peel. The other peels are searched only where another surface begins in its own.
#[inline(always)]
fn join_surface<'a>(
    keys: &mut [Key],
    found: &mut [Key],
    here: Row<'a>,
    layer: usize,
    peels: usize,
    neighbours: impl Fn(usize) -> Row<'a>,
) {
    let found = &mut found[..keys.len()];
    found.fill(0);
    join(keys, found, here, neighbours(layer));
    for start in (0..keys.len()).step_by(CHUNK_COLUMNS) {
        let columns = start..(start + CHUNK_COLUMNS).min(keys.len());
        let fragments = here.0[columns.clone()].iter().zip(&found[columns.clone()]);
        let missing =
            fragments.fold(false, |missing, (&bin, &found)| missing | ((bin != EMPTY) & (found == 0)));
        if missing {
            let part = |row: Row<'a>| (&row.0[columns.clone()], &row.1[columns.clone()]);
            for peel in (0..peels).filter(|&peel| peel != layer) {
                join(
                    &mut keys[columns.clone()],
                    &mut found[columns.clone()],
                    part(here),
                    part(neighbours(peel)),
                );
            }
        }
    }
}

/// Sets in `keys` the flags of the bins that the fragments `here` join because of `neighbours`, except where a neighbour was
/// `found` before.
#[inline(always)]
fn join(keys: &mut [Key], found: &mut [Key], here: Row<'_>, neighbours: Row<'_>) {
    let fragments = here.0.iter().zip(here.1).zip(neighbours.0.iter().zip(neighbours.1));
    for ((key, found), ((&bin, &coc), (&other_bin, &other_coc))) in keys.iter_mut().zip(found).zip(fragments)
    {
        let near = surface::joins(coc, other_coc) & (other_bin != EMPTY) & (*found == 0);
        *key |= Key::from(near & (other_bin < bin)) * NEARER;
        *key |= Key::from(near & (other_bin > bin)) * FARTHER;
        *found |= Key::from(near);
    }
}
