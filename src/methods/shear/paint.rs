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

use super::bins::Bins;
use super::runs::{Run, Runs};
use super::surfaces::{LANES, PaddedPlane, Surface};
use crate::lens::View;
use pulp::Arch;
use std::ops::Range;

/// A bit for each lane of a word.
type Mask = u16;

/// A ray with less than this left has been stopped.
const STOPPED_BELOW: f32 = 0.002;

/// A pixel of whose rays less than this hit anything is empty.
const LEAST_HIT: f32 = 1e-3;

/// A fragment with a smaller CoC radius counts as in focus, in picture pixels.
const FOCUSED_BELOW_PX: f32 = 1.01;

/// What the painter reads.
#[derive(Debug)]
pub(super) struct Canvas<'a> {
    /// The surfaces, nearest first.
    pub(super) surfaces: &'a [Surface<'a>],
    /// Their coverage in padded rows; empty when every fragment is opaque.
    pub(super) alpha: &'a [PaddedPlane],
    /// Their runs.
    pub(super) runs: &'a Runs,
    /// The bins of the runs.
    pub(super) bins: &'a Bins,
}

/// Sums over views for 16 neighbouring pixels.
#[derive(Debug, Clone, Copy)]
struct Word {
    color: [[f32; LANES]; 3],
    /// Share of rays that met something in focus.
    focused: [f32; LANES],
    /// Share of rays that met nothing.
    missed: [f32; LANES],
}

const BLANK: Word = Word { color: [[0.0; LANES]; 3], focused: [0.0; LANES], missed: [0.0; LANES] };

/// State of the rays of one view for 16 neighbouring pixels.
#[derive(Debug, Clone, Copy, Default)]
struct Rays {
    /// Rays that have been stopped.
    stopped: Mask,
    /// Rays that have lost some light: their share left is in `left`.
    dimmed: Mask,
    left: [f32; LANES],
}

/// Sums over views for one output row. Views may be painted in several goes: the sums go on where they were.
#[derive(Debug)]
pub(super) struct RowSums {
    width: usize,
    words: Vec<Word>,
    rays: Vec<Rays>,
    views: usize,
}

impl RowSums {
    /// A blank row of `width` pixels.
    pub(super) fn new(width: usize) -> Self {
        let words = width.div_ceil(LANES);
        Self { width, words: vec![BLANK; words], rays: vec![Rays::default(); words], views: 0 }
    }

    /// Adds `views` of output row `y`.
    pub(super) fn add(&mut self, canvas: &Canvas<'_>, y: usize, views: &[View], arch: Arch) {
        arch.dispatch(
            #[inline(always)]
            || {
                for view in views {
                    self.start_view();
                    self.paint_view(canvas, y, view);
                    self.count_missed();
                }
            },
        );
        self.views += views.len();
    }

    /// The mean of pixel `x` over all views so far: rays that met nothing are transparent where the background is open,
    /// and left out of the mean where it is closed.
    pub(super) fn pixel(&self, x: usize, open_background: bool) -> [f32; 4] {
        let (word, lane) = (&self.words[x / LANES], x % LANES);
        let views = self.views as f32;
        let hit = views - word.missed[lane];
        if hit <= LEAST_HIT {
            return [0.0; 4];
        }
        let weight = if open_background { views } else { hit };
        let [r, g, b] = word.color.map(|channel| channel[lane] / weight);
        [r, g, b, hit / weight]
    }

    /// Share of pixel `x`'s rays that met something in focus.
    pub(super) fn focused_share(&self, x: usize) -> f32 {
        self.words[x / LANES].focused[x % LANES] / self.views as f32
    }

    /// Lets all rays of the row go.
    #[inline(always)]
    fn start_view(&mut self) {
        for rays in &mut self.rays {
            rays.stopped = 0;
            rays.dimmed = 0;
        }
        let overhang = self.width % LANES;
        if overhang > 0 && let Some(last) = self.rays.last_mut() {
            last.stopped = Mask::MAX << overhang;
        }
    }

    #[inline(always)]
    fn paint_view(&mut self, canvas: &Canvas<'_>, y: usize, view: &View) {
        let mut words_left = self.rays.len();
        let last_row = canvas.runs.rows.len() as i32 - 1;
        for (bin, &coc) in canvas.bins.centers_px().iter().enumerate() {
            let row = y as i32 + (coc * view.lens.y + view.jitter.y + 0.5).floor() as i32;
            let row = row.clamp(0, last_row) as usize;
            let (first, last) = canvas.runs.rows_of_bin[bin];
            if row < first || row > last {
                continue;
            }
            let shift = (coc * view.lens.x + view.jitter.x + 0.5).floor() as i32;
            let focused = coc.abs() < FOCUSED_BELOW_PX;
            for run in canvas.runs.rows[row].of_bin(bin) {
                self.paint_run(canvas, run, row, shift, focused, &mut words_left);
            }
            if words_left == 0 {
                return;
            }
        }
    }

    /// Paints one run: its columns, and past the picture's border the border column for ever.
    #[inline(always)]
    fn paint_run(
        &mut self,
        canvas: &Canvas<'_>,
        run: &Run,
        row: usize,
        shift: i32,
        focused: bool,
        words_left: &mut usize,
    ) {
        let (start, end) = (run.start as i32 - shift, run.end as i32 - shift);
        let width = self.width as i32;
        let surface = &canvas.surfaces[run.layer as usize];
        let color = surface.color.each_ref().map(|plane| plane.padded_row(row));
        let alpha = (!run.opaque).then(|| canvas.alpha[run.layer as usize].padded_row(row));
        let source = |column| SourceRow { color, alpha, column, focused };
        self.paint_span(start.max(0)..end.min(width), &source(Column::Shifted(shift)), words_left);
        if run.start == 0 {
            self.paint_span(0..start.min(width), &source(Column::Border(0)), words_left);
        }
        if run.end as i32 == width {
            self.paint_span(end.max(0)..width, &source(Column::Border(self.width - 1)), words_left);
        }
    }

    /// Paints the pixels `span` of the row from `source`.
    #[inline(always)]
    fn paint_span(&mut self, span: Range<i32>, source: &SourceRow<'_>, words_left: &mut usize) {
        if span.is_empty() {
            return;
        }
        let span = span.start as usize..span.end as usize;
        let (first, last) = (span.start / LANES, (span.end - 1) / LANES);
        for index in first..=last {
            let mut wanted = Mask::MAX;
            if index == first {
                wanted &= Mask::MAX << (span.start % LANES);
            }
            if index == last {
                wanted &= Mask::MAX >> (LANES - 1 - (span.end - 1) % LANES);
            }
            let rays = &mut self.rays[index];
            let free = wanted & !rays.stopped;
            if free == 0 {
                continue;
            }
            let word = &mut self.words[index];
            if source.alpha.is_none() && free & rays.dimmed == 0 {
                take(word, source, index, free);
                rays.stopped |= wanted;
            } else {
                take_share(word, rays, source, index, free);
            }
            *words_left -= usize::from(rays.stopped == Mask::MAX);
        }
    }

    /// Counts the rays that nothing stopped.
    #[inline(always)]
    fn count_missed(&mut self) {
        for (word, rays) in self.words.iter_mut().zip(&self.rays) {
            if rays.stopped != Mask::MAX {
                for lane in 0..LANES {
                    let left = if rays.dimmed >> lane & 1 == 1 { rays.left[lane] } else { 1.0 };
                    word.missed[lane] += if rays.stopped >> lane & 1 == 1 { 0.0 } else { left };
                }
            }
        }
    }
}

/// Where a span's columns come from.
#[derive(Clone, Copy)]
enum Column {
    /// Output column plus the shift.
    Shifted(i32),
    /// One column for all.
    Border(usize),
}

/// One row of a surface, as a span reads it.
struct SourceRow<'a> {
    color: [&'a [f32]; 3],
    /// `None` for opaque fragments.
    alpha: Option<&'a [f32]>,
    column: Column,
    focused: bool,
}

impl SourceRow<'_> {
    /// The values for the lanes of output word `index`; lanes outside the span may be anything.
    #[inline(always)]
    fn lanes(&self, channel: &[f32], index: usize) -> [f32; LANES] {
        match self.column {
            Column::Shifted(shift) => {
                // A span lies within the picture on both sides, so the word reaches at most one word past its ends.
                let start = ((index * LANES + LANES) as i32 + shift) as usize;
                let mut lanes = [0.0; LANES];
                lanes.copy_from_slice(&channel[start..start + LANES]);
                lanes
            }
            Column::Border(column) => [channel[LANES + column]; LANES],
        }
    }
}

/// Opaque fragments, full rays: adds the source to the lanes in `free`.
#[inline(always)]
fn take(word: &mut Word, source: &SourceRow<'_>, index: usize, free: Mask) {
    for (sum, channel) in word.color.iter_mut().zip(source.color) {
        let lanes = source.lanes(channel, index);
        if free == Mask::MAX {
            for lane in 0..LANES {
                sum[lane] += lanes[lane];
            }
        } else {
            for lane in 0..LANES {
                sum[lane] += if free >> lane & 1 == 1 { lanes[lane] } else { 0.0 };
            }
        }
    }
    if source.focused {
        for lane in 0..LANES {
            word.focused[lane] += if free >> lane & 1 == 1 { 1.0 } else { 0.0 };
        }
    }
}

/// Translucent fragments or dimmed rays: adds the source times what is left of each ray, and dims the rays.
#[inline(always)]
fn take_share(word: &mut Word, rays: &mut Rays, source: &SourceRow<'_>, index: usize, free: Mask) {
    let mut left = [0.0; LANES];
    for lane in 0..LANES {
        let share = if rays.dimmed >> lane & 1 == 1 { rays.left[lane] } else { 1.0 };
        left[lane] = if free >> lane & 1 == 1 { share } else { 0.0 };
    }
    for (sum, channel) in word.color.iter_mut().zip(source.color) {
        let lanes = source.lanes(channel, index);
        for lane in 0..LANES {
            // Selected, not multiplied by 0: a lane outside the span may hold anything.
            sum[lane] += if free >> lane & 1 == 1 { left[lane] * lanes[lane] } else { 0.0 };
        }
    }
    let alpha = source.alpha.map_or([1.0; LANES], |channel| source.lanes(channel, index));
    let mut stopped = rays.stopped;
    for lane in 0..LANES {
        if free >> lane & 1 == 1 {
            word.focused[lane] += if source.focused { left[lane] * alpha[lane] } else { 0.0 };
            rays.left[lane] = left[lane] * (1.0 - alpha[lane]);
            stopped |= Mask::from(rays.left[lane] < STOPPED_BELOW) << lane;
        }
    }
    rays.dimmed |= free;
    rays.stopped = stopped;
}
