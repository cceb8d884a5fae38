//! Rows as runs: for each row and each bin, the stretches of fragments that move together.
//!
//! **Watertight rule**: an opaque fragment also joins the neighbouring bin when one of its four neighbours lies that way,
//! less than [`JOIN_PX`] off: the neighbour in its own peel or, where that is of another surface, in any other peel. Surfaces
//! then have no cracks where they pass from bin to bin, nor where something nearer begins and pushes them one peel back;
//! joining wider would thicken edges. A translucent fragment never joins twice: it would count twice.

use super::bins::{Bins, EMPTY};
use crate::scene::Layer;
use crate::scene::OPAQUE_ALPHA;
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;
use std::ops::RangeInclusive;

/// Neighbours in a peel belong to one surface when their CoC radii differ by less than this, in picture pixels.
pub(super) const JOIN_PX: f32 = 0.5;

/// A stretch of fragments of one row, one layer and one bin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Run {
    /// First column.
    pub(super) start: u32,
    /// Column past the last.
    pub(super) end: u32,
    /// Its layer.
    pub(super) layer: u8,
    /// Whether its fragments hide what is behind.
    pub(super) opaque: bool,
}

/// The runs of one row, sorted by bin and, within a bin, by layer and column.
#[derive(Debug, Clone, Default)]
pub(super) struct RowRuns {
    /// `starts[b] .. starts[b + 1]` are the runs of bin `b`.
    starts: Vec<u32>,
    runs: Vec<Run>,
}

impl RowRuns {
    /// The runs of bin `bin`.
    pub(super) fn of_bin(&self, bin: usize) -> &[Run] {
        &self.runs[self.starts[bin] as usize..self.starts[bin + 1] as usize]
    }
}

/// All rows, and where each bin occurs.
#[derive(Debug, Clone)]
pub(super) struct Runs {
    /// The rows from the top.
    pub(super) rows: Vec<RowRuns>,
    /// `runs_above[b][y]`: how many runs of bin `b` lie in the rows above row `y`.
    runs_above: Vec<Vec<u32>>,
}

impl Runs {
    /// Whether bin `bin` has a run in any of `rows`; rows past the border stand for the border row.
    pub(super) fn occurs(&self, bin: usize, rows: RangeInclusive<i32>) -> bool {
        let last = self.rows.len() as i32 - 1;
        let [first, last] = [*rows.start(), *rows.end()].map(|y| y.clamp(0, last) as usize);
        self.runs_above[bin][last + 1] > self.runs_above[bin][first]
    }
}

/// What the scan compares from column to column: the bin, and two bits for the neighbouring bins joined and one for opacity.
///
/// Equal keys are one run.
type Key = u16;

const NEARER: Key = 1;
const FARTHER: Key = 2;
const OPAQUE: Key = 4;
const BIN_SHIFT: u32 = 3;
const NO_KEY: Key = Key::MAX;

/// Finds the runs of `layers`.
pub(super) fn find(layers: &[Layer], bins: &Bins) -> Runs {
    let (width, height) = layers.first().map_or((0, 0), |s| (s.width(), s.height()));
    let indices: Vec<Vec<u16>> = layers.iter().map(|layer| bin_indices(layer, bins)).collect();
    let arch = Arch::new();
    let scratch = || (vec![0; width], vec![0; width], Vec::new());
    let rows: Vec<RowRuns> = (0..height)
        .into_par_iter()
        .map_init(scratch, |(keys, found, runs), y| {
            runs.clear();
            for layer in 0..layers.len() {
                arch.dispatch(RowKeys { layers, indices: &indices, layer, y, keys, found });
                scan(keys, layer as u8, runs);
            }
            sorted_by_bin(runs, bins.count())
        })
        .collect();
    let runs_above = (0..bins.count())
        .map(|bin| {
            let mut above = 0;
            let counts = rows.iter().map(|row| row.of_bin(bin).len() as u32);
            std::iter::once(0)
                .chain(counts.map(|count| {
                    above += count;
                    above
                }))
                .collect()
        })
        .collect();
    Runs { rows, runs_above }
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

/// Fills `keys` for row `y` of surface `layer`; to be compiled for each instruction set.
struct RowKeys<'a> {
    layers: &'a [Layer],
    indices: &'a [Vec<u16>],
    layer: usize,
    y: usize,
    keys: &'a mut [Key],
    /// Scratch: for each column, whether the neighbour at hand is found.
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
            let joined = if alpha >= OPAQUE_ALPHA { *key | OPAQUE } else { 0 };
            *key = if bin == EMPTY { NO_KEY } else { (bin << BIN_SHIFT) | joined };
        }
    }
}

/// Bins and CoC radii of a stretch of a row.
type Row<'a> = (&'a [u16], &'a [f32]);

/// Columns whose neighbours in other peels are looked at together.
const STRETCH: usize = 32;

/// Joins the fragments `here`, of peel `layer`, to their neighbours on one side, of which `there(peel)` are those in `peel`.
///
/// A surface goes on in its own peel; only where another one begins there may it go on in any other peel.
#[inline(always)]
fn join_surface<'a>(
    keys: &mut [Key],
    found: &mut [Key],
    here: Row<'a>,
    layer: usize,
    peels: usize,
    there: impl Fn(usize) -> Row<'a>,
) {
    let found = &mut found[..keys.len()];
    found.fill(0);
    join(keys, found, here, there(layer));
    for start in (0..keys.len()).step_by(STRETCH) {
        let columns = start..(start + STRETCH).min(keys.len());
        let fragments = here.0[columns.clone()].iter().zip(&found[columns.clone()]);
        let lost = fragments.fold(false, |lost, (&bin, &found)| lost | ((bin != EMPTY) & (found == 0)));
        if lost {
            let part = |row: Row<'a>| (&row.0[columns.clone()], &row.1[columns.clone()]);
            for peel in (0..peels).filter(|&peel| peel != layer) {
                join(&mut keys[columns.clone()], &mut found[columns.clone()], part(here), part(there(peel)));
            }
        }
    }
}

/// Marks in `keys` the bins that neighbours `there` make the fragments `here` join, unless the neighbour is already `found`.
#[inline(always)]
fn join(keys: &mut [Key], found: &mut [Key], here: Row<'_>, there: Row<'_>) {
    let fragments = here.0.iter().zip(here.1).zip(there.0.iter().zip(there.1));
    for ((key, found), ((&bin, &coc), (&other_bin, &other_coc))) in keys.iter_mut().zip(found).zip(fragments)
    {
        let near = ((other_coc - coc).abs() < JOIN_PX) & (other_bin != EMPTY) & (*found == 0);
        *key |= Key::from(near & (other_bin < bin)) * NEARER;
        *key |= Key::from(near & (other_bin > bin)) * FARTHER;
        *found |= Key::from(near);
    }
}

/// Finds the runs of one row of keys.
fn scan(keys: &[Key], layer: u8, found: &mut Vec<(u16, Run)>) {
    let mut open = OpenRuns::default();
    let mut last = NO_KEY;
    for (x, &key) in keys.iter().enumerate() {
        if key != last {
            open.change(key, x as u32, layer, found);
            last = key;
        }
    }
    open.change(NO_KEY, keys.len() as u32, layer, found);
}

/// The runs that are open at a column: of the fragments' bin and those it joins.
#[derive(Default)]
struct OpenRuns {
    /// Bins `first .. first + starts.len()`, with the column each run began at.
    first: u16,
    starts: [u32; 3],
    count: u16,
    opaque: bool,
}

impl OpenRuns {
    /// Closes the runs that `key` does not go on with and opens those it begins.
    fn change(&mut self, key: Key, x: u32, layer: u8, found: &mut Vec<(u16, Run)>) {
        let opaque = key & OPAQUE != 0;
        let (first, count) = if key == NO_KEY {
            (0, 0)
        } else {
            let nearer = key & NEARER; // bit 0: a count of one
            let farther = (key & FARTHER) / FARTHER;
            ((key >> BIN_SHIFT) - nearer, 1 + nearer + farther)
        };
        let goes_on = |bin: u16| opaque == self.opaque && bin >= first && bin < first + count;
        for k in 0..self.count {
            let bin = self.first + k;
            if !goes_on(bin) {
                let run = Run { start: self.starts[k as usize], end: x, layer, opaque: self.opaque };
                found.push((bin, run));
            }
        }
        let mut starts = [x; 3];
        for k in 0..count {
            let bin = first + k;
            if opaque == self.opaque && bin >= self.first && bin < self.first + self.count {
                starts[k as usize] = self.starts[(bin - self.first) as usize];
            }
        }
        *self = Self { first, starts, count, opaque };
    }
}

/// A stable counting sort.
fn sorted_by_bin(found: &[(u16, Run)], bins: usize) -> RowRuns {
    let mut starts = vec![0u32; bins + 1];
    for (bin, _) in found {
        starts[*bin as usize + 1] += 1;
    }
    for bin in 0..bins {
        starts[bin + 1] += starts[bin];
    }
    let mut next = starts.clone();
    let mut runs = vec![Run { start: 0, end: 0, layer: 0, opaque: false }; found.len()];
    for (bin, run) in found {
        let place = &mut next[*bin as usize];
        runs[*place as usize] = *run;
        *place += 1;
    }
    RowRuns { starts, runs }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;

    fn layer(alpha: &[f32], coc: &[f32]) -> Layer {
        let plane = |values: &[f32]| Plane::from_fn(values.len(), 1, |x, _| values[x]);
        Layer { color: std::array::from_fn(|_| plane(alpha)), alpha: plane(alpha), coc_px: plane(coc) }
    }

    fn run(start: u32, end: u32, opaque: bool) -> Run {
        Run { start, end, layer: 0, opaque }
    }

    #[test]
    fn fragments_of_one_bin_are_one_run() {
        let runs = find(&[layer(&[1.0; 4], &[3.0; 4])], &Bins::new([3.0, 3.0], 0.5));
        assert_eq!(runs.rows[0].of_bin(0), [run(0, 4, true)], "the whole row");
    }

    #[test]
    fn a_slanted_surface_overlaps_itself_from_bin_to_bin() {
        let bins = Bins::new([0.0, 0.4], 0.5);
        let runs = find(&[layer(&[1.0; 4], &[0.0, 0.1, 0.3, 0.4])], &bins);
        assert_eq!(
            runs.rows[0].of_bin(0),
            [run(0, 3, true)],
            "the nearer part and one fragment of the farther"
        );
        assert_eq!(
            runs.rows[0].of_bin(1),
            [run(1, 4, true)],
            "the farther part and one fragment of the nearer"
        );
    }

    #[test]
    fn an_edge_in_depth_does_not_join() {
        let bins = Bins::new([0.0, 5.0], 0.5);
        let runs = find(&[layer(&[1.0; 4], &[0.0, 0.0, 5.0, 5.0])], &bins);
        assert_eq!(runs.rows[0].of_bin(0), [run(0, 2, true)], "in front");
        assert_eq!(runs.rows[0].of_bin(10), [run(2, 4, true)], "behind");
    }

    #[test]
    fn a_translucent_fragment_stays_in_its_bin() {
        let bins = Bins::new([0.0, 0.4], 0.5);
        let runs = find(&[layer(&[1.0, 0.5, 1.0], &[0.1, 0.2, 0.4])], &bins);
        let translucent =
            |bin| runs.rows[0].of_bin(bin).iter().filter(|run| !run.opaque).copied().collect::<Vec<_>>();
        assert_eq!(translucent(0), [run(1, 2, false)], "once in its own bin");
        assert_eq!(translucent(1), [], "not in its neighbour's");
    }

    #[test]
    fn empty_samples_end_runs() {
        let runs = find(&[layer(&[1.0, 0.0, 1.0], &[3.0; 3])], &Bins::new([3.0, 3.0], 0.5));
        assert_eq!(runs.rows[0].of_bin(0), [run(0, 1, true), run(2, 3, true)], "two runs");
    }
}
