//! Painting: for every output row and every view, the runs of the stack, sheared, front to back.
//!
//! ```text
//!   view (u, j), bin of radius c:   source row   y + ⌊c·u_y + j_y + ½⌋
//!                                   shift        ⌊c·u_x + j_x + ½⌋
//!   a run [start, end) lands on     [start − shift, end − shift)
//! ```
//!
//! A bit a pixel says whether the view's ray has been stopped; only rays still on their way take light. There is no z-buffer,
//! no sort and no image of a view: about one masked load and add for each visible pixel and view, consecutive pixels from
//! consecutive memory. Translucent runs keep, beside the bit, how much of the ray is left.
//!
//! The inner loops are compiled for several instruction sets and chosen at run time. They add, multiply and select in
//! one order and never fuse, so every path gives the same bits.

use super::canvas::{Barrel, Canvas, Shear, Shift};
use super::runs::Run;
use crate::image::MARGIN;
use glam::Vec2;
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;

/// Lanes of a word: pixels that are handled at once.
const LANES: usize = MARGIN;

/// A bit for each lane of a word.
type Mask = u16;

/// A ray with less than this left has been stopped.
pub(super) const STOPPED_BELOW: f32 = 0.002;

/// A pixel of whose rays less than this hit anything is empty.
pub(super) const MIN_HIT: f32 = 1e-3;

/// 16 neighbouring pixels of one channel.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(64))]
struct Word([f32; LANES]);

/// Views after which the sums are put aside: a float that has grown large takes what is added to it by halves and quarters,
/// so thousands of views are summed in goes.
const VIEWS_IN_A_GO: usize = 256;

/// Sums over views, a word for each 16 pixels.
#[derive(Debug, Clone)]
struct Sums {
    color: Vec<[Word; 3]>,
    /// Share of rays that met something in focus.
    focused: Vec<Word>,
    /// Share of rays that met nothing.
    missed: Vec<Word>,
}

impl Sums {
    fn blank(words: usize) -> Self {
        let blank = vec![Word::default(); words];
        Self { color: vec![[Word::default(); 3]; words], focused: blank.clone(), missed: blank }
    }

    fn clear(&mut self) {
        self.color.fill([Word::default(); 3]);
        self.focused.fill(Word::default());
        self.missed.fill(Word::default());
    }

    fn words(&self) -> impl Iterator<Item = &Word> {
        self.color.as_flattened().iter().chain(&self.focused).chain(&self.missed)
    }

    fn words_mut(&mut self) -> impl Iterator<Item = &mut Word> {
        self.color.as_flattened_mut().iter_mut().chain(&mut self.focused).chain(&mut self.missed)
    }
}

/// Sums over views for one output row, and the rays of the view at hand. Views may be painted in several calls: the sums go
/// on where they were, bit for bit.
///
/// One vector a quantity, a word or a mask for each 16 pixels: what every run touches stays close together.
#[derive(Debug)]
pub(super) struct RowSums {
    width: usize,
    views: usize,
    /// Lanes that are not asked for: past the end of the row, or left out by [`RowSums::only`].
    unwanted: Vec<Mask>,
    /// From the first column that is asked for to past the last.
    wanted: Range<i32>,
    /// Views that the barrel hides from each column.
    hidden: Vec<f32>,
    /// Of the go at hand.
    sums: Sums,
    /// Of all goes before it.
    settled: Sums,
    /// Rays that have been stopped.
    stopped: Vec<Mask>,
    /// Rays that have lost some light: their share left is in `left`.
    dimmed: Vec<Mask>,
    left: Vec<Word>,
}

impl RowSums {
    /// A blank row of `width` pixels.
    pub(super) fn new(width: usize) -> Self {
        let words = width.div_ceil(LANES);
        let mut unwanted = vec![0; words];
        let overhang = width % LANES;
        if overhang > 0
            && let Some(last) = unwanted.last_mut()
        {
            *last = Mask::MAX << overhang;
        }
        Self {
            width,
            views: 0,
            unwanted,
            wanted: 0..width as i32,
            hidden: vec![0.0; width],
            sums: Sums::blank(words),
            settled: Sums::blank(words),
            stopped: vec![0; words],
            dimmed: vec![0; words],
            left: vec![Word::default(); words],
        }
    }

    /// A blank row of `width` pixels, of which only `columns`, in rising order, will be asked for.
    pub(super) fn only(width: usize, columns: &[usize]) -> Self {
        let mut row = Self::new(width);
        row.unwanted.fill(Mask::MAX);
        columns.iter().for_each(|&x| row.unwanted[x / LANES] &= !(1 << (x % LANES)));
        row.wanted = match columns {
            [first, .., last] => *first as i32..*last as i32 + 1,
            [one] => *one as i32..*one as i32 + 1,
            [] => 0..0,
        };
        row
    }

    /// Makes the row blank again.
    pub(super) fn clear(&mut self) {
        self.views = 0;
        self.hidden.fill(0.0);
        self.sums.clear();
        self.settled.clear();
    }

    /// How many views column `x` has seen so far.
    fn views_at(&self, x: usize) -> f32 {
        self.views as f32 - self.hidden[x]
    }

    /// Adds the views `shears` of output row `y`, to which they bring `bins` at most, with the instructions of `arch`.
    pub(super) fn add(
        &mut self,
        canvas: &Canvas<'_>,
        (y, bins): (usize, &[u16]),
        shears: &[Shear],
        arch: Arch,
    ) {
        let mut rest = shears;
        while !rest.is_empty() {
            let room = VIEWS_IN_A_GO - self.views % VIEWS_IN_A_GO;
            let (go, others) = rest.split_at(room.min(rest.len()));
            arch.dispatch(AddViews { row: self, canvas, y, bins, shears: go });
            self.views += go.len();
            rest = others;
            if self.views.is_multiple_of(VIEWS_IN_A_GO) {
                self.settle();
            }
        }
    }

    /// Puts the sums of a go aside.
    fn settle(&mut self) {
        for (settled, sum) in self.settled.words_mut().zip(self.sums.words()) {
            settled.0.iter_mut().zip(sum.0).for_each(|(settled, sum)| *settled += sum);
        }
        self.sums.clear();
    }

    /// The mean of pixel `x` over all views so far: rays that met nothing are transparent where the background is open,
    /// and left out of the mean where it is closed.
    pub(super) fn pixel(&self, x: usize, transparent_background: bool) -> [f32; 4] {
        let (word, lane) = (x / LANES, x % LANES);
        let views = self.views_at(x);
        let hit = views - (self.settled.missed[word].0[lane] + self.sums.missed[word].0[lane]);
        if hit <= MIN_HIT {
            return [0.0; 4];
        }
        let weight = if transparent_background { views } else { hit };
        let color = |k: usize| self.settled.color[word][k].0[lane] + self.sums.color[word][k].0[lane];
        [color(0) / weight, color(1) / weight, color(2) / weight, hit / weight]
    }

    /// Share of pixel `x`'s rays that met something in focus.
    pub(super) fn focused_share(&self, x: usize) -> f32 {
        let (word, lane) = (x / LANES, x % LANES);
        let focused = self.settled.focused[word].0[lane] + self.sums.focused[word].0[lane];
        focused / self.views_at(x).max(MIN_HIT)
    }

    /// Lets all rays of the row go, and says how many words have any.
    fn start_view(&mut self) -> usize {
        self.stopped.copy_from_slice(&self.unwanted);
        self.dimmed.fill(0);
        self.words_on_their_way()
    }

    /// Lets the rays of the view through `lens` go, as far as they pass `barrel`, and says how many words of row `y` have any.
    fn start_view_past(&mut self, barrel: &Barrel<'_>, lens: Vec2, y: usize) -> usize {
        let inside = |x: i32| x.clamp(0, self.width as i32) as usize;
        let [[first, end], [first_whole, end_whole]] = barrel
            .columns(lens, y)
            .map(|columns| [columns.start, columns.end.max(columns.start)].map(inside));
        self.hidden[..first].iter_mut().for_each(|hidden| *hidden += 1.0);
        self.hidden[end..].iter_mut().for_each(|hidden| *hidden += 1.0);
        for (word, (stopped, unwanted)) in self.stopped.iter_mut().zip(&self.unwanted).enumerate() {
            let lanes_before = |x: usize| (1u32 << x.saturating_sub(word * LANES).min(LANES)) - 1;
            *stopped = unwanted | (lanes_before(first) | !lanes_before(end)) as Mask;
        }
        self.dimmed.fill(0);
        let [first_whole, end_whole] =
            if first_whole < end_whole { [first_whole, end_whole] } else { [end; 2] };
        for x in (first..first_whole).chain(end_whole..end) {
            let passing = barrel.passing(lens, x, y);
            self.hidden[x] += 1.0 - passing;
            self.dimmed[x / LANES] |= 1 << (x % LANES);
            self.left[x / LANES].0[x % LANES] = passing;
        }
        self.words_on_their_way()
    }

    fn words_on_their_way(&self) -> usize {
        self.stopped.iter().filter(|stopped| **stopped != Mask::MAX).count()
    }

    /// Counts the rays that nothing stopped.
    fn count_missed(&mut self) {
        for (word, &stopped) in self.stopped.iter().enumerate().filter(|(_, stopped)| **stopped != Mask::MAX)
        {
            for lane in (0..LANES).filter(|&lane| !has(stopped, lane)) {
                self.sums.missed[word].0[lane] +=
                    if has(self.dimmed[word], lane) { self.left[word].0[lane] } else { 1.0 };
            }
        }
    }
}

/// Whether `mask` has bit `lane`.
#[inline(always)]
fn has(mask: Mask, lane: usize) -> bool {
    mask >> lane & 1 == 1
}

/// [`RowSums::add`], to be compiled for each instruction set.
struct AddViews<'a> {
    row: &'a mut RowSums,
    canvas: &'a Canvas<'a>,
    y: usize,
    bins: &'a [u16],
    shears: &'a [Shear],
}

impl WithSimd for AddViews<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for shear in self.shears {
            let words_left = match self.canvas.barrel {
                None => self.row.start_view(),
                Some(barrel) => self.row.start_view_past(&barrel, shear.lens, self.y),
            };
            let mut brush = Brush { simd, words_left, row: self.row };
            brush.paint_view(self.canvas, self.y, &shear.shifts, self.bins);
            self.row.count_missed();
        }
    }
}

/// Paints one view of one row.
struct Brush<'a, S> {
    simd: S,
    row: &'a mut RowSums,
    /// Words with rays still on their way.
    words_left: usize,
}

/// One row of a surface, as a span reads it.
#[derive(Clone, Copy)]
struct SourceRow<'a> {
    /// Red, green, blue, with margins.
    color: [&'a [f32]; 3],
    /// `None` for opaque fragments.
    alpha: Option<&'a [f32]>,
    column: Column,
    focused: bool,
}

/// Where a span's columns come from.
#[derive(Clone, Copy)]
enum Column {
    /// Output column plus the shift.
    Shifted(i32),
    /// One column for all.
    Border(usize),
}

impl<S: Simd> Brush<'_, S> {
    #[inline(always)]
    fn paint_view(&mut self, canvas: &Canvas<'_>, y: usize, shear: &[Shift], bins: &[u16]) {
        let last_row = canvas.runs.rows.len() as i32 - 1;
        for &bin in bins {
            let shift = shear[bin as usize];
            let row = (y as i32 + shift.rows).clamp(0, last_row) as usize;
            for run in canvas.runs.rows[row].of_bin(bin as usize) {
                self.paint_run(canvas, run, row, shift);
            }
            if self.words_left == 0 {
                return;
            }
        }
    }

    /// Paints one run: its columns, and past the picture's border the border column for ever.
    #[inline(always)]
    fn paint_run(&mut self, canvas: &Canvas<'_>, run: &Run, row: usize, shift: Shift) {
        let (start, end) = (run.start as i32 - shift.columns, run.end as i32 - shift.columns);
        let width = self.row.width as i32;
        let layer = &canvas.layers[run.layer as usize];
        let [red, green, blue] = &layer.color;
        let source = |column| SourceRow {
            color: [red.row_with_margins(row), green.row_with_margins(row), blue.row_with_margins(row)],
            alpha: (!run.opaque).then(|| layer.alpha.row_with_margins(row)),
            column,
            focused: shift.focused,
        };
        let Range { start: first, end: past } = self.row.wanted;
        self.paint_span(start.max(first)..end.min(past), source(Column::Shifted(shift.columns)));
        if run.start == 0 && start > first {
            self.paint_span(first..start.min(past), source(Column::Border(0)));
        }
        if run.end as i32 == width && end < past {
            self.paint_span(end.max(first)..past, source(Column::Border(width as usize - 1)));
        }
    }

    /// Paints the pixels `span` of the row from `source`.
    #[inline(always)]
    fn paint_span(&mut self, span: Range<i32>, source: SourceRow<'_>) {
        if span.is_empty() {
            return;
        }
        let span = span.start as usize..span.end as usize;
        let (first, last) = (span.start / LANES, (span.end - 1) / LANES);
        for word in first..=last {
            let mut wanted = Mask::MAX;
            if word == first {
                wanted &= Mask::MAX << (span.start % LANES);
            }
            if word == last {
                wanted &= Mask::MAX >> (LANES - 1 - (span.end - 1) % LANES);
            }
            let free = wanted & !self.row.stopped[word];
            if free == 0 {
                continue;
            }
            if source.alpha.is_none() && free & self.row.dimmed[word] == 0 {
                self.take(word, &source, free);
            } else {
                self.take_share(word, &source, free);
            }
            self.words_left -= usize::from(self.row.stopped[word] == Mask::MAX);
        }
    }

    /// Opaque fragments, full rays: adds the source to the lanes in `free` and stops them.
    #[inline(always)]
    fn take(&mut self, word: usize, source: &SourceRow<'_>, free: Mask) {
        let (simd, zero) = (self.simd, self.simd.splat_f32s(0.0));
        for (k, sum) in self.row.sums.color[word].iter_mut().enumerate() {
            for (i, sum) in S::as_mut_simd_f32s(&mut sum.0).0.iter_mut().enumerate() {
                let value = source.vector(simd, source.color[k], word, i);
                // Selected, not multiplied: a lane outside the span may hold anything.
                let value = if free == Mask::MAX {
                    value
                } else {
                    simd.select_f32s(lanes(simd, free, i), value, zero)
                };
                *sum = simd.add_f32s(*sum, value);
            }
        }
        if source.focused {
            let one = simd.splat_f32s(1.0);
            for (i, sum) in S::as_mut_simd_f32s(&mut self.row.sums.focused[word].0).0.iter_mut().enumerate() {
                *sum = simd.add_f32s(*sum, simd.select_f32s(lanes(simd, free, i), one, zero));
            }
        }
        self.row.stopped[word] |= free;
    }

    /// Translucent fragments or dimmed rays: adds the source times what is left of each ray, and dims the rays.
    #[inline(always)]
    fn take_share(&mut self, word: usize, source: &SourceRow<'_>, free: Mask) {
        let simd = self.simd;
        let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
        let dimmed = self.row.dimmed[word];
        let left = &mut self.row.left[word].0;
        for (i, left) in S::as_mut_simd_f32s(left).0.iter_mut().enumerate() {
            let wanted = lanes(simd, free, i);
            let before = simd.select_f32s(lanes(simd, dimmed, i), *left, one);
            for (k, sum) in self.row.sums.color[word].iter_mut().enumerate() {
                let value = source.vector(simd, source.color[k], word, i);
                let value = simd.select_f32s(wanted, simd.mul_f32s(before, value), zero);
                let sum = &mut S::as_mut_simd_f32s(&mut sum.0).0[i];
                *sum = simd.add_f32s(*sum, value);
            }
            let alpha = source.alpha.map_or(one, |row| source.vector(simd, row, word, i));
            if source.focused {
                let sum = &mut S::as_mut_simd_f32s(&mut self.row.sums.focused[word].0).0[i];
                *sum = simd.add_f32s(*sum, simd.select_f32s(wanted, simd.mul_f32s(before, alpha), zero));
            }
            let after = simd.mul_f32s(before, simd.sub_f32s(one, alpha));
            *left = simd.select_f32s(wanted, after, before);
        }
        self.row.dimmed[word] |= free;
        let spent = left
            .iter()
            .enumerate()
            .fold(0, |mask, (lane, &left)| mask | Mask::from(left < STOPPED_BELOW) << lane);
        self.row.stopped[word] |= spent & free;
    }
}

impl SourceRow<'_> {
    /// Vector `i` of the source of output word `word` in `row`; lanes outside the span may be anything.
    #[inline(always)]
    fn vector<S: Simd>(&self, simd: S, row: &[f32], word: usize, i: usize) -> S::f32s {
        match self.column {
            Column::Shifted(shift) => {
                // A span lies within the picture on both sides, so a word reaches less than the margin past its ends.
                let start = (word * LANES + i * S::F32_LANES + MARGIN) as i32 + shift;
                let values = &row[start as usize..][..S::F32_LANES];
                S::as_simd_f32s(values).0[0]
            }
            Column::Border(column) => simd.splat_f32s(row[MARGIN + column]),
        }
    }
}

/// Bit `i` in lane `i`.
static LANE_BITS: [u32; LANES] =
    [1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768];

/// The lanes of vector `i` of a word that `mask` has.
#[inline(always)]
fn lanes<S: Simd>(simd: S, mask: Mask, i: usize) -> S::m32s {
    let bits = S::as_simd_u32s(&LANE_BITS).0[i];
    simd.equal_u32s(simd.and_u32s(simd.splat_u32s(u32::from(mask)), bits), bits)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;
    use crate::lens::{Aperture, views};
    use crate::methods::shear::bins::Bins;
    use crate::methods::shear::runs;
    use crate::scene::Layer;

    const WIDTH: usize = 53;
    const HEIGHT: usize = 7;

    /// Two layers with runs of all kinds: short and long, opaque and translucent, near and far.
    fn layers() -> Vec<Layer> {
        let plane = |f: fn(usize, usize) -> f32| Plane::from_fn(WIDTH, HEIGHT, f);
        let color = |f| std::array::from_fn(|_| plane(f));
        let front_alpha = plane(|x, y| [1.0, 1.0, 0.4, 0.0, 1.0][(x / 3 + y) % 5]);
        let front = Layer {
            color: color(|x, y| (x * 3 + y) as f32 * 0.1),
            alpha: front_alpha,
            coc_px: plane(|x, _| -6.0 - (x / 9) as f32),
        };
        let back = Layer {
            color: color(|x, y| (x + y * y) as f32 * 0.3),
            alpha: plane(|_, _| 1.0),
            coc_px: plane(|_, y| 0.2 * y as f32),
        };
        vec![front, back]
    }

    /// Calls `paint` with a canvas of [`layers`] and its views.
    fn with_canvas<T>(paint: impl Fn(&Canvas<'_>, &[Shear]) -> T) -> T {
        let layers = layers();
        let bins = Bins::new([-12.0, 2.0], 0.5);
        let runs = runs::find(&layers, &bins);
        let shears: Vec<Shear> =
            views(64, Aperture::DISC).iter().map(|view| Shear::new(view, &bins)).collect();
        paint(&Canvas { layers: &layers, runs: &runs, bins: &bins, barrel: None, astray_px: 0.0 }, &shears)
    }

    fn rows(canvas: &Canvas<'_>, goes: &[&[Shear]], arch: Arch) -> Vec<[f32; 5]> {
        let row = |y| {
            let mut sums = RowSums::new(WIDTH);
            let bins = canvas.bins_in_reach(y);
            goes.iter().for_each(|shears| sums.add(canvas, (y, &bins), shears, arch));
            (0..WIDTH)
                .map(|x| {
                    let [r, g, b, a] = sums.pixel(x, false);
                    [r, g, b, a, sums.focused_share(x)]
                })
                .collect::<Vec<_>>()
        };
        (0..HEIGHT).flat_map(row).collect()
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        with_canvas(|canvas, shears| {
            let scalar = rows(canvas, &[shears], Arch::Scalar);
            assert!(scalar.iter().any(|pixel| pixel[0] > 1.0), "there is a picture to compare");
            #[cfg(target_arch = "x86_64")]
            {
                if let Some(v3) = pulp::x86::V3::try_new() {
                    assert_eq!(rows(canvas, &[shears], Arch::V3(v3)), scalar, "AVX2 and scalar");
                }
                if let Some(v4) = pulp::x86::V4::try_new() {
                    assert_eq!(rows(canvas, &[shears], Arch::V4(v4)), scalar, "AVX-512 and scalar");
                }
            }
            assert_eq!(rows(canvas, &[shears], Arch::new()), scalar, "this machine's choice and scalar");
        });
    }

    #[test]
    fn views_painted_in_two_calls_are_the_views_painted_in_one() {
        with_canvas(|canvas, shears| {
            let (first, second) = shears.split_at(24);
            assert_eq!(
                rows(canvas, &[first, second], Arch::new()),
                rows(canvas, &[shears], Arch::new()),
                "24 + 40 = 64"
            );
        });
    }

    #[test]
    fn every_ray_meets_the_layer_behind_at_the_latest() {
        with_canvas(|canvas, shears| {
            for pixel in rows(canvas, &[shears], Arch::new()) {
                assert!((pixel[3] - 1.0).abs() < 1e-6, "alpha {}", pixel[3]);
            }
        });
    }
}
