//! Rows as spans: for each row and each bin, the ranges of columns whose fragments move together.
//!
//! A view often moves several neighbouring bins alike, near focus most of them. Spans are therefore also kept for blocks of 2, 4, 8 and 16
//! bins, aligned to multiples of their size; a block's spans are the unions of its bins' spans. With one shift all fragments of a block lie
//! at the same output pixels, where the layers are in order, so that painting a block gives the picture of its bins.

use super::bins::{Bins, LEVELS};
use super::keys::{
    BIN_SHIFT, CHANGES_PEEL, EXTRA_MASK, EXTRA_SHIFT, Extent, Key, Keys, MAX_BINS_OF_FRAGMENT, NO_KEY, OPAQUE,
};
use super::shown::Shown;
use crate::parallel;
use crate::scene::Layer;
use std::ops::{Range, RangeInclusive};

/// Rows whose keys are computed together: few enough that their bins stay in the cache.
const STRIP: usize = 32;

/// Neighbouring fragments of one row, one layer and one bin or block of bins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Span {
    /// First column.
    pub(super) start: u32,
    /// Column past the last.
    pub(super) end: u32,
    /// Index of the layer.
    pub(super) layer: u16,
    /// Whether its fragments are opaque.
    pub(super) opaque: bool,
    /// Whether its fragments are translucent and continue in another layer: see [`CHANGES_PEEL`].
    pub(super) changes_peel: bool,
}

impl Span {
    /// Whether `next`, which begins no earlier, continues this span.
    fn is_continued_by(&self, next: &Self) -> bool {
        let kind = |span: &Self| (span.layer, span.opaque, span.changes_peel);
        kind(self) == kind(next) && next.start <= self.end
    }
}

/// The spans of some rows at every level of blocks: row by row, within a row block by block ([`Bins::blocks`]), and within a block by
/// layer and column.
#[derive(Debug, Clone)]
struct StripSpans {
    /// For each row and block, where its spans begin in `spans`; after the last one, where they end.
    starts: Vec<u32>,
    spans: Vec<Span>,
    /// For each layer, whether a span of it is translucent.
    translucent: Vec<bool>,
}

impl StripSpans {
    /// No rows yet of `rows` of `layers` layers.
    fn new((layers, rows): (usize, usize), bins: &Bins) -> Self {
        let mut starts = Vec::with_capacity(rows * bins.blocks().len() + 1);
        starts.push(0);
        Self { starts, spans: Vec::new(), translucent: vec![false; layers] }
    }

    /// Appends a row with the spans `found`, each with its bin, in the order of layers and columns.
    fn push_row(&mut self, found: &[(u16, Span)], bins: &Bins, scratch: &mut Scratch) {
        let row = self.starts.len() - 1;
        self.push_bins(found, bins.count(), &mut scratch.next);
        let unions = &mut scratch.unions;
        for level in 1..LEVELS {
            let below = bins.blocks_of_level(level - 1);
            let bin = |number: usize| number << level;
            unions.clear();
            for number in 0..bins.blocks_of_level(level).len() {
                if bins.highest_level(bin(number)) >= level {
                    let first = row + below.start + 2 * number;
                    let second = if 2 * number + 1 < below.len() { self.spans_at(first + 1) } else { &[] };
                    push_union(self.spans_at(first), second, unions);
                }
                self.starts.push((self.spans.len() + unions.len()) as u32);
            }
            self.spans.extend_from_slice(unions);
        }
    }

    /// Appends the lowest level of a row: a stable counting sort.
    fn push_bins(&mut self, found: &[(u16, Span)], bins: usize, next: &mut Vec<u32>) {
        let (row, first) = (self.starts.len() - 1, self.spans.len());
        self.starts.resize(row + bins + 1, 0);
        let starts = &mut self.starts[row..];
        for (bin, _) in found {
            starts[usize::from(*bin) + 1] += 1;
        }
        for bin in 0..bins {
            starts[bin + 1] += starts[bin];
        }
        next.clear();
        next.extend(starts.iter().map(|start| start - first as u32));
        let none = Span { start: 0, end: 0, layer: 0, opaque: false, changes_peel: false };
        self.spans.resize(first + found.len(), none);
        let spans = &mut self.spans[first..];
        for (bin, span) in found {
            let index = &mut next[usize::from(*bin)];
            spans[*index as usize] = *span;
            *index += 1;
        }
    }

    /// The spans of the block whose start is `starts[index]`.
    #[inline(always)]
    fn spans_at(&self, index: usize) -> &[Span] {
        &self.spans[self.starts[index] as usize..self.starts[index + 1] as usize]
    }
}

/// Memory for [`StripSpans::push_row`].
#[derive(Debug, Default)]
struct Scratch {
    /// For each bin, where its next span goes.
    next: Vec<u32>,
    /// The spans of a level.
    unions: Vec<Span>,
}

/// Appends the union of the spans of two blocks to `unions`.
fn push_union(mut first: &[Span], mut second: &[Span], unions: &mut Vec<Span>) {
    let block = unions.len();
    while let ([one, other_ones @ ..], [two, other_twos @ ..]) = (first, second) {
        let next = if order(one) <= order(two) {
            first = other_ones;
            one
        } else {
            second = other_twos;
            two
        };
        push_or_continue(next, block, unions);
    }
    let mut rest = first.iter().chain(second);
    // Once a span of the rest continues none, those after it continue none either: they are in one block of the level below.
    while let Some(next) = rest.next() {
        if !push_or_continue(next, block, unions) {
            unions.extend(rest);
            return;
        }
    }
}

/// Appends `next` to the spans from index `block` on, or lengthens the last of them by it, and returns whether it does.
#[inline(always)]
fn push_or_continue(next: &Span, block: usize, spans: &mut Vec<Span>) -> bool {
    match spans[block..].last_mut() {
        Some(last) if last.is_continued_by(next) => {
            last.end = last.end.max(next.end);
            true
        }
        _ => {
            spans.push(*next);
            false
        }
    }
}

/// The order of spans within a block.
#[inline(always)]
fn order(span: &Span) -> u64 {
    u64::from(span.layer) << 32 | u64::from(span.start)
}

/// The spans of all rows, and the rows in which each bin occurs.
#[derive(Debug, Clone)]
pub(super) struct Spans {
    /// From the top, [`STRIP`] rows each.
    strips: Vec<StripSpans>,
    /// Number of rows.
    height: usize,
    /// Number of bins, and of blocks of all levels.
    bins: usize,
    blocks: usize,
    /// `last_row[y · bins + b]`: one more than the last row, up to row `y`, in which bin `b` has spans; 0 for none.
    last_row: Vec<u32>,
}

impl Spans {
    /// Number of rows.
    pub(super) fn height(&self) -> usize {
        self.height
    }

    /// The spans of block `block` in row `row`; the first blocks are the bins.
    #[inline(always)]
    pub(super) fn of_block(&self, row: usize, block: usize) -> &[Span] {
        self.strips[row / STRIP].spans_at(row % STRIP * self.blocks + block)
    }

    /// Whether layer `layer` has a translucent fragment.
    pub(super) fn has_translucent(&self, layer: usize) -> bool {
        self.strips.iter().any(|strip| strip.translucent[layer])
    }

    /// Whether bin `bin` has a span in any of `rows`; rows past the border count as the border row.
    pub(super) fn occurs(&self, bin: usize, rows: RangeInclusive<i32>) -> bool {
        let last = self.height as i32 - 1;
        let [first, last] = [*rows.start(), *rows.end()].map(|y| y.clamp(0, last) as usize);
        self.last_row[last * self.bins + bin] as usize > first
    }

    /// See [`Spans::last_row`].
    fn find_last_rows(&mut self) {
        let mut last = vec![0; self.bins];
        self.last_row.reserve(self.height * self.bins);
        for row in 0..self.height {
            let starts = &self.strips[row / STRIP].starts[row % STRIP * self.blocks..];
            for (last, ends) in last.iter_mut().zip(starts.windows(2)) {
                *last = if ends[1] > ends[0] { row as u32 + 1 } else { *last };
            }
            self.last_row.extend_from_slice(&last);
        }
    }
}

/// Finds the spans of the fragments of `layers` that are `shown`, which extend by `extent`.
pub(super) fn find(layers: &[Layer], bins: &Bins, extent: Extent, shown: &Shown) -> Spans {
    let height = layers.first().map_or(0, Layer::height);
    let of_strip = |rows: Range<usize>| {
        let keys = Keys::new(layers, bins, (extent, shown), rows.clone());
        let mut strip = StripSpans::new((layers.len(), rows.len()), bins);
        let (mut row, mut found, mut scratch) = (Vec::new(), Vec::new(), Scratch::default());
        for y in rows {
            found.clear();
            for layer in 0..layers.len() {
                let first = found.len();
                for columns in shown.columns(layer, y) {
                    keys.fill((layer, y), columns.clone(), &mut row);
                    scan(&row, (columns.start, layer as u16), &mut found);
                }
                strip.translucent[layer] |= found[first..].iter().any(|(_, span): &(u16, Span)| !span.opaque);
            }
            strip.push_row(&found, bins, &mut scratch);
        }
        strip
    };
    let strips = parallel::map(height.div_ceil(STRIP), &|strip| {
        of_strip(strip * STRIP..((strip + 1) * STRIP).min(height))
    });
    let (bins, blocks) = (bins.count(), bins.blocks().len());
    let mut spans = Spans { strips, height, bins, blocks, last_row: Vec::new() };
    spans.find_last_rows();
    spans
}

/// Appends the spans of the keys of a row from column `first` on to `found`, each with its bin.
fn scan(keys: &[Key], (first, layer): (usize, u16), found: &mut Vec<(u16, Span)>) {
    let mut open = OpenSpans { first: 0, starts: [0; MAX_BINS_OF_FRAGMENT], count: 0, flags: OPAQUE };
    let mut last = NO_KEY;
    for (x, &key) in keys.iter().enumerate() {
        if key != last {
            open.change(key, (first + x) as u32, layer, found);
            last = key;
        }
    }
    open.change(NO_KEY, (first + keys.len()) as u32, layer, found);
}

/// The spans that are open at a column: those of the fragment's bin and of the bins it joins.
struct OpenSpans {
    /// The open bins are `first .. first + count`.
    first: u16,
    /// For each open bin, the first column of its span.
    starts: [u32; MAX_BINS_OF_FRAGMENT],
    count: u16,
    /// [`OPAQUE`] and [`CHANGES_PEEL`] of the open spans' fragments.
    flags: Key,
}

impl OpenSpans {
    /// Closes the spans that `key` does not continue and opens those that it begins at column `x`.
    fn change(&mut self, key: Key, x: u32, layer: u16, found: &mut Vec<(u16, Span)>) {
        let flags = key & (OPAQUE | CHANGES_PEEL);
        let (first, count) = if key == NO_KEY {
            (0, 0)
        } else {
            ((key >> BIN_SHIFT) as u16, 1 + (key >> EXTRA_SHIFT & EXTRA_MASK) as u16)
        };
        let continues = |bin: u16| flags == self.flags && bin >= first && bin < first + count;
        for k in 0..self.count {
            let bin = self.first + k;
            if !continues(bin) {
                found.push((bin, self.span(k, x, layer)));
            }
        }
        let (from, to) = (first.max(self.first), (first + count).min(self.first + self.count));
        if flags == self.flags && from < to {
            let [kept, first_kept] = [self.first, first].map(|first| (from - first) as usize);
            let last_kept = first_kept + (to - from) as usize;
            self.starts.copy_within(kept..kept + (to - from) as usize, first_kept);
            self.starts[..first_kept].fill(x);
            self.starts[last_kept..count as usize].fill(x);
        } else {
            self.starts[..count as usize].fill(x);
        }
        (self.first, self.count, self.flags) = (first, count, flags);
    }

    /// The span of open bin `k`, which ends at column `end`.
    fn span(&self, k: u16, end: u32, layer: u16) -> Span {
        Span {
            start: self.starts[k as usize],
            end,
            layer,
            opaque: self.flags & OPAQUE != 0,
            changes_peel: self.flags & CHANGES_PEEL != 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;
    use crate::scene::surface;

    fn find(layers: &[Layer], bins: &Bins) -> Spans {
        super::find(layers, bins, Extent::HalfWay, &Shown::all(layers))
    }

    fn layer(alpha: &[f32], coc: &[f32]) -> Layer {
        let plane = |values: &[f32]| Plane::from_fn(values.len(), 1, |x, _| values[x]);
        Layer { color: std::array::from_fn(|_| plane(alpha)), alpha: plane(alpha), coc_px: plane(coc) }
    }

    fn span(start: u32, end: u32, opaque: bool) -> Span {
        Span { start, end, layer: 0, opaque, changes_peel: false }
    }

    #[test]
    fn fragments_of_one_bin_are_one_run() {
        let bins = Bins::new([3.0, 3.0], 0.5);
        let spans = find(&[layer(&[1.0; 4], &[3.0; 4])], &bins);
        assert_eq!(spans.of_block(0, bins.index(3.0) as usize), [span(0, 4, true)], "the whole row");
    }

    #[test]
    fn neighbours_of_one_surface_share_a_bin() {
        // A slope of up to 1.8 px a sample, and relief.
        for coc in [vec![0.0, 0.1, 0.3, 0.4], vec![-3.0, -1.2, 0.6, 2.4, 4.2], vec![0.0, 0.9, -0.8, 0.2]] {
            let layer = layer(&vec![1.0; coc.len()], &coc);
            let bins = Bins::new([-3.0, 4.2], 0.5);
            let spans = find(&[layer], &bins);
            for x in 0..coc.len() as u32 - 1 {
                let holds = |bin: &usize| {
                    let spans = spans.of_block(0, *bin);
                    spans.iter().any(|span| span.start <= x && span.end >= x + 2)
                };
                assert!((0..bins.count()).any(|bin| holds(&bin)), "{coc:?}: columns {x} and {}", x + 1);
            }
        }
    }

    #[test]
    fn four_samples_of_one_surface_in_a_square_share_a_bin() {
        let bins = Bins::new([-4.0, 4.0], 0.5);
        let steps = [-0.45_f32, -0.21, 0.0, 0.04, 0.3, 0.49];
        for i in 0..6 * 6 * 6 {
            let [right, below, across] = [i % 6, i / 6 % 6, i / 36].map(|i| steps[i]);
            for start in [-3.0, -0.1, 0.4] {
                let coc = [start, start + right, start + below, start + right.min(below) + across];
                let sides = [(0, 1), (0, 2), (1, 3), (2, 3)];
                if !sides.iter().all(|&(one, other)| surface::joins(coc[one], coc[other])) {
                    continue;
                }
                let plane = |values: [f32; 4]| Plane::from_values(2, 2, &values);
                let layer = Layer {
                    color: [(); 3].map(|()| plane([1.0; 4])),
                    alpha: plane([1.0; 4]),
                    coc_px: plane(coc),
                };
                let spans = find(&[layer], &bins);
                let holds = |bin: usize| (0..2).all(|y| spans.of_block(y, bin) == [span(0, 2, true)]);
                assert!((0..bins.count()).any(holds), "{coc:?}");
            }
        }
    }

    #[test]
    fn no_occluder_is_in_a_nearer_bin_than_its_own() {
        let bins = Bins::new([0.0, 3.0], 0.5);
        let coc = [0.0, 1.0, 2.0, 3.0];
        for alpha in [1.0, 0.5] {
            let layers = [layer(&[alpha; 4], &coc)];
            let spans = super::find(&layers, &bins, Extent::Occluder, &Shown::all(&layers));
            for (x, coc) in coc.into_iter().enumerate() {
                let own = usize::from(bins.index(coc));
                let holds = |bin: usize| {
                    spans.of_block(0, bin).iter().any(|span| (span.start..span.end).contains(&(x as u32)))
                };
                assert!(holds(own) && !(0..own).any(holds), "column {x} of alpha {alpha}");
                assert_eq!((own + 1..bins.count()).any(holds), x < 3, "column {x} of alpha {alpha}");
            }
        }
    }

    #[test]
    fn fragments_across_an_edge_in_depth_do_not_join() {
        let bins = Bins::new([0.0, 5.0], 0.5);
        let spans = find(&[layer(&[1.0; 4], &[0.0, 0.0, 5.0, 5.0])], &bins);
        assert_eq!(spans.of_block(0, 0), [span(0, 2, true)], "in front");
        assert_eq!(spans.of_block(0, bins.count() - 1), [span(2, 4, true)], "behind");
        let all: usize = (0..bins.count()).map(|bin| spans.of_block(0, bin).len()).sum();
        assert_eq!(all, 2, "nothing between");
    }

    #[test]
    fn a_surface_that_goes_on_in_another_peel_joins_it_there() {
        let front = layer(&[0.5, 0.5, 1.0, 1.0], &[1.0, 1.2, -8.0, -8.0]);
        let back = layer(&[0.0, 0.0, 0.5, 0.5], &[0.0, 0.0, 1.4, 1.6]);
        let bins = Bins::new([-8.0, 1.6], 0.5);
        let spans = find(&[front, back], &bins);
        let changing: Vec<(u32, u32, u16)> = (0..bins.count())
            .flat_map(|bin| spans.of_block(0, bin).to_vec())
            .filter(|span| span.changes_peel)
            .map(|span| (span.start, span.end, span.layer))
            .collect();
        assert!(changing.contains(&(1, 2, 0)) && changing.contains(&(2, 3, 1)), "{changing:?}");
        assert!(changing.iter().all(|&(start, end, _)| end == start + 1), "only at the change: {changing:?}");
    }

    #[test]
    fn a_blocks_spans_cover_what_its_bins_cover() {
        let bins = Bins::new([-4.0, 4.0], 0.5);
        let coc: Vec<f32> = (0..40).map(|x| ((x * 37) % 23) as f32 * 0.3 - 3.5).collect();
        let alpha: Vec<f32> = (0..40).map(|x| [1.0, 1.0, 0.4, 0.0][(x / 3) % 4]).collect();
        let spans = find(&[layer(&alpha, &coc), layer(&[1.0; 40], &[2.0; 40])], &bins);
        let columns = |spans: &[Span]| {
            let mut columns: Vec<(u16, u32)> =
                spans.iter().flat_map(|span| (span.start..span.end).map(|x| (span.layer, x))).collect();
            columns.sort_unstable();
            columns.dedup();
            columns
        };
        for level in 0..LEVELS {
            for (number, block) in bins.blocks_of_level(level).enumerate() {
                if bins.highest_level(number << level) < level {
                    assert!(spans.of_block(0, block).is_empty(), "level {level}, block {number} is too wide");
                    continue;
                }
                let [first, last] = bins.blocks()[block].bins.map(usize::from);
                let of_bins: Vec<Span> =
                    (first..=last).flat_map(|bin| spans.of_block(0, bin).to_vec()).collect();
                assert_eq!(
                    columns(spans.of_block(0, block)),
                    columns(&of_bins),
                    "level {level}, block {number}"
                );
                let in_order =
                    spans.of_block(0, block).windows(2).all(|pair| order(&pair[0]) < order(&pair[1]));
                assert!(in_order, "level {level}, block {number}");
            }
        }
    }

    #[test]
    fn empty_samples_end_runs() {
        let bins = Bins::new([3.0, 3.0], 0.5);
        let spans = find(&[layer(&[1.0, 0.0, 1.0], &[3.0; 3])], &bins);
        let found = spans.of_block(0, bins.index(3.0) as usize);
        assert_eq!(found, [span(0, 1, true), span(2, 3, true)], "two spans");
    }

    #[test]
    fn keys_do_not_depend_on_the_columns_that_are_computed_together() {
        // Surfaces that end, go on in the other peel, and are missing for more columns than a block has.
        let (width, height) = (300, 5);
        let noise = |x: usize, y: usize, seed: usize| ((x * 31 + y * 17 + seed * 7) % 13) as f32;
        let layer = |seed: usize| {
            let is_there =
                |x: usize, y: usize| !(90..240).contains(&(x + 40 * seed)) && noise(x, y, seed) > 1.0;
            let plane = |value: &dyn Fn(usize, usize) -> f32| Plane::from_fn(width, height, value);
            let alpha = plane(&|x, y| if is_there(x, y) { [1.0, 0.5][x / 9 % 2] } else { 0.0 });
            let coc_px = plane(&|x, y| (x / 20 % 3) as f32 + 0.1 * noise(x / 2, y, 0));
            Layer { color: [(); 3].map(|()| alpha.clone()), alpha, coc_px }
        };
        let (layers, bins) = ([layer(0), layer(1)], Bins::new([-1.0, 5.0], 0.5));
        let shown = Shown::all(&layers);
        let keys = Keys::new(&layers, &bins, (Extent::HalfWay, &shown), 0..height);
        let (mut whole, mut part, mut changing) = (Vec::new(), Vec::new(), 0);
        for (layer, y) in (0..2).flat_map(|layer| (0..height).map(move |y| (layer, y))) {
            keys.fill((layer, y), 0..width, &mut whole);
            for (x, &key) in whole.iter().enumerate() {
                keys.fill((layer, y), x..x + 1, &mut part);
                assert_eq!(part, [key], "layer {layer}, row {y}, column {x}");
                changing += usize::from(key != NO_KEY && key & CHANGES_PEEL != 0);
            }
        }
        assert!(changing > 20, "{changing} surfaces go on in the other peel");
    }
}
