//! Rows as runs: for each row and each bin, the stretches of fragments that move together.

use super::bins::Bins;
use super::keys::{BIN_SHIFT, EXTRA, EXTRA_SHIFT, Key, KeyRow, Keys, NO_KEY, OPAQUE};
use crate::scene::Layer;
use rayon::prelude::*;
use std::ops::RangeInclusive;

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

/// Finds the runs of `layers`.
pub(super) fn find(layers: &[Layer], bins: &Bins) -> Runs {
    let (width, height) = layers.first().map_or((0, 0), |s| (s.width(), s.height()));
    let keys = Keys::new(layers, bins);
    let scratch = || (KeyRow::new(width), Vec::new());
    let rows: Vec<RowRuns> = (0..height)
        .into_par_iter()
        .map_init(scratch, |(row, runs), y| {
            runs.clear();
            for layer in 0..layers.len() {
                keys.fill((layer, y), row);
                scan(&row.keys, layer as u8, runs);
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
        let (first, count) =
            if key == NO_KEY { (0, 0) } else { (key >> BIN_SHIFT, 1 + (key >> EXTRA_SHIFT & EXTRA)) };
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
