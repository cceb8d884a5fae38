//! Painting: for every output row and every view, the spans of the stack, sheared, front to back.
//!
//! ```text
//!   view (u, j), bin of radius c:   source row   y + ⌊c·u_y + j_y + ½⌋
//!                                   shift        ⌊c·u_x + j_x + ½⌋
//!   span [start, end) lands on      [start − shift, end − shift)
//! ```
//!
//! One bit per pixel marks an occluded ray; only unoccluded rays accumulate light. There is no z-buffer, no sort and no image
//! per view. The cost is about one masked load and add for each visible pixel and view, and consecutive pixels read consecutive
//! memory. Bins that a view moves alike are painted in blocks.
//!
//! Translucent spans keep, beside the bit, the transmittance of the ray. A ray may hit several fragments of a surface, and counts the surface
//! once ([`super::translucent_hits`]).
//!
//! The inner loops are compiled for several instruction sets, one of which is selected when the program runs. Additions,
//! multiplications and selections have one order and are never fused, so every instruction set gives the same bits.

use super::bins::Block;
use super::canvas::{Barrel, BinsInReach, Canvas, Shear, Step};
use super::lanes::{Chunk, LANES, Mask, has, lanes};
use super::mirrors::Noted;
use super::picture;
use super::spans::Span;
use super::sums::{Means, Sums};
use super::translucent_hits::{Hit, TranslucentHits};
use crate::image::{MARGIN, Plane};
use crate::methods::contract::LostRays;
use crate::scene::{Background, Layer};
use glam::{IVec2, Vec2};
use pulp::{Arch, NullaryFnOnce, Simd, WithSimd};
use std::ops::Range;

/// A ray of less transmittance goes no further.
pub(super) const MIN_TRANSMITTANCE: f32 = 0.002;

/// Partial sums are flushed after this number of views, so that the f32 rounding error does not grow with the view count.
const VIEWS_PER_BATCH: usize = 256;

/// Sums over views for one output row, and the rays of the current view. Views may be added in several calls: the bits are those
/// of one call.
///
/// Each quantity has its own vector with one chunk or mask for each 16 pixels, so that what every span touches stays close
/// together.
#[derive(Debug)]
pub(super) struct RowSums {
    width: usize,
    views: usize,
    /// Lanes that are not painted: past the end of the row, or excluded by [`RowSums::only`].
    skipped: Vec<Mask>,
    /// The smallest range that holds all painted columns.
    columns: Range<i32>,
    /// For each column of all chunks, the number of views that the barrel hides, with fractions where a view fades in.
    hidden: Vec<f32>,
    /// Sums of the current batch.
    sums: Sums,
    /// Sums of all batches before it.
    flushed: Sums,
    /// Rays that are occluded.
    occluded: Vec<Mask>,
    /// Rays of transmittance below 1, which `transmittance` has.
    attenuated: Vec<Mask>,
    /// Undefined for rays that are not attenuated.
    transmittance: Vec<Chunk>,
    hits: TranslucentHits,
    /// Rays of the current view that mirrors stop.
    noted: Vec<Noted>,
}

impl RowSums {
    /// A row of `width` pixels with no views; `near` says whether near surfaces are kept apart.
    pub(super) fn new(width: usize, near: bool) -> Self {
        let chunks = width.div_ceil(LANES);
        let mut skipped = vec![0; chunks];
        let overhang = width % LANES;
        if overhang > 0
            && let Some(last) = skipped.last_mut()
        {
            *last = Mask::MAX << overhang;
        }
        Self {
            width,
            views: 0,
            skipped,
            columns: 0..width as i32,
            hidden: vec![0.0; chunks * LANES],
            sums: Sums::blank(chunks, near),
            flushed: Sums::blank(chunks, near),
            occluded: vec![0; chunks],
            attenuated: vec![0; chunks],
            transmittance: vec![Chunk::default(); chunks],
            hits: TranslucentHits::default(),
            noted: Vec::new(),
        }
    }

    /// A row of `width` pixels with no views, of which only `columns`, in ascending order, are painted.
    pub(super) fn only(width: usize, columns: &[usize]) -> Self {
        let mut row = Self::new(width, false);
        row.skipped.fill(Mask::MAX);
        columns.iter().for_each(|&x| row.skipped[x / LANES] &= !(1 << (x % LANES)));
        row.columns = match columns {
            [first, .., last] => *first as i32..*last as i32 + 1,
            [one] => *one as i32..*one as i32 + 1,
            [] => 0..0,
        };
        row
    }

    /// Paints only the columns for which `is_visible` holds from now on; for others, pixels have no meaning.
    pub(super) fn paint_only(&mut self, is_visible: impl Fn(usize) -> bool) {
        for (chunk, skipped) in self.skipped.iter_mut().enumerate() {
            let is_skipped = |lane: usize| {
                let x = chunk * LANES + lane;
                x >= self.width || !is_visible(x)
            };
            *skipped = (0..LANES).fold(0, |mask, lane| mask | Mask::from(is_skipped(lane)) << lane);
        }
    }

    /// Removes all views from the row.
    pub(super) fn clear(&mut self) {
        self.views = 0;
        self.hidden.fill(0.0);
        self.sums.clear();
        self.flushed.clear();
    }

    /// Adds the views `shears` of output row `y` with the instructions of `arch`; every bin that they can move there is `in_reach`.
    pub(super) fn add(
        &mut self,
        canvas: &Canvas<'_>,
        (y, in_reach): (usize, &BinsInReach),
        shears: &[Shear],
        arch: Arch,
    ) {
        self.hits.prepare(canvas.layers.len(), self.occluded.len());
        let mut rest = shears;
        while !rest.is_empty() {
            let room = VIEWS_PER_BATCH - self.views % VIEWS_PER_BATCH;
            let (batch, others) = rest.split_at(room.min(rest.len()));
            arch.dispatch(AddViews { row: self, canvas, y, in_reach, shears: batch });
            self.views += batch.len();
            rest = others;
            if self.views.is_multiple_of(VIEWS_PER_BATCH) {
                self.flush();
            }
        }
    }

    /// Adds the sums of the current batch to those of the batches before it, and clears them.
    fn flush(&mut self) {
        self.flushed.add(&self.sums);
        self.sums.clear();
    }

    /// The means of chunk `chunk` over all views so far, of which lost rays count as `lost_rays` says.
    #[inline(always)]
    pub(super) fn means(&self, chunk: usize, lost_rays: LostRays) -> Means {
        let hidden = &self.hidden[chunk * LANES..][..LANES];
        let views = std::array::from_fn(|lane| self.views as f32 - hidden[lane]);
        self.flushed.means(&self.sums, chunk, &views, lost_rays)
    }

    /// Writes what views of these `channels` painted to `planes` of the row ([`picture::written`]), blended by `weights` with what is there.
    pub(super) fn write(
        &self,
        (channels, weights): (&[usize], Option<&[f32]>),
        lost_rays: LostRays,
        planes: &mut [&mut [f32]],
        arch: Arch,
    ) {
        arch.dispatch(WriteRow { row: self, channels, weights, lost_rays, planes });
    }

    /// Starts a view with every ray unoccluded. Returns the number of chunks that have such rays.
    fn start_view(&mut self) -> usize {
        self.occluded.copy_from_slice(&self.skipped);
        self.attenuated.fill(0);
        self.active_chunks()
    }

    /// Starts the view through `lens` for row `y` with those rays unoccluded that pass `barrel`. Returns the number of chunks
    /// that have such rays.
    fn start_view_through(&mut self, barrel: &Barrel<'_>, lens: Vec2, y: usize) -> usize {
        let inside = |x: i32| x.clamp(0, self.width as i32) as usize;
        let [[first, end], [first_whole, end_whole]] = barrel
            .columns(lens, y)
            .map(|columns| [columns.start, columns.end.max(columns.start)].map(inside));
        self.hidden[..first].iter_mut().for_each(|hidden| *hidden += 1.0);
        self.hidden[end..].iter_mut().for_each(|hidden| *hidden += 1.0);
        for (chunk, (occluded, skipped)) in self.occluded.iter_mut().zip(&self.skipped).enumerate() {
            let lanes_before = |x: usize| (1u32 << x.saturating_sub(chunk * LANES).min(LANES)) - 1;
            *occluded = skipped | (lanes_before(first) | !lanes_before(end)) as Mask;
        }
        self.attenuated.fill(0);
        let [first_whole, end_whole] =
            if first_whole < end_whole { [first_whole, end_whole] } else { [end; 2] };
        for x in (first..first_whole).chain(end_whole..end) {
            let passing = barrel.passing(lens, x, y);
            self.hidden[x] += 1.0 - passing;
            self.attenuated[x / LANES] |= 1 << (x % LANES);
            self.transmittance[x / LANES].0[x % LANES] = passing;
        }
        self.active_chunks()
    }

    fn active_chunks(&self) -> usize {
        self.occluded.iter().filter(|occluded| **occluded != Mask::MAX).count()
    }

    /// Ends the attenuated rays of the lanes in `spent`: what they have left is lost.
    #[inline(always)]
    fn occlude(&mut self, chunk: usize, spent: Mask) {
        self.occluded[chunk] |= spent;
        for lane in (0..LANES).filter(|&lane| has(spent, lane)) {
            self.sums.lost[chunk].0[lane] += self.transmittance[chunk].0[lane];
        }
    }

    /// Adds what the rays of `shear` that mirrors stopped see there.
    fn add_reflections(&mut self, canvas: &Canvas<'_>, (y, shear): (usize, &Shear)) {
        let Some(mirrors) = canvas.mirrors else { return };
        let (off, lens) = (shear.view.jitter + shear.view.shift, shear.view.lens);
        for noted in self.noted.drain(..) {
            let layer = &canvas.layers[usize::from(noted.layer)];
            let coc_px = layer.coc_px.get(noted.column as usize, noted.row as usize);
            let seen = mirrors.seen(&noted, (y, off, lens), coc_px);
            let (chunk, lane) = (noted.x as usize / LANES, noted.x as usize % LANES);
            for (sum, value) in self.sums.color[chunk].iter_mut().zip(seen) {
                sum.0[lane] += noted.weight * value;
            }
            // What a mirror shows is not in focus where its surface is.
            self.sums.focused[chunk].0[lane] -= noted.weight * noted.focus;
        }
    }

    /// Ends the rays of `shear` that are left: in the `background`, or where the stack has nothing.
    fn end_rays(&mut self, background: Option<&Background>, shear: &Shear, y: usize) {
        for (chunk, &occluded) in
            self.occluded.iter().enumerate().filter(|(_, occluded)| **occluded != Mask::MAX)
        {
            for lane in (0..LANES).filter(|&lane| !has(occluded, lane)) {
                let left =
                    if has(self.attenuated[chunk], lane) { self.transmittance[chunk].0[lane] } else { 1.0 };
                let transparent = background.map_or(0.0, |background| {
                    let pixel = IVec2::new((chunk * LANES + lane) as i32, y as i32);
                    left.min(background.met_by(|coc_px| shear.pixel_at(pixel, coc_px)))
                });
                self.sums.transparent[chunk].0[lane] += transparent;
                self.sums.lost[chunk].0[lane] += left - transparent;
            }
        }
    }
}

/// [`RowSums::add`], to be compiled for each instruction set.
struct AddViews<'a> {
    row: &'a mut RowSums,
    canvas: &'a Canvas<'a>,
    y: usize,
    in_reach: &'a BinsInReach,
    shears: &'a [Shear],
}

impl WithSimd for AddViews<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for shear in self.shears {
            let active_chunks = match self.canvas.barrel {
                None => self.row.start_view(),
                Some(barrel) => self.row.start_view_through(&barrel, shear.view.lens, self.y),
            };
            self.row.hits.start_view();
            let mut painter = Painter { simd, active_chunks, row: self.row };
            painter.paint_view(self.canvas, self.y, shear, self.in_reach);
            if painter.active_chunks > 0 {
                self.row.end_rays(self.canvas.background, shear, self.y);
            }
            self.row.add_reflections(self.canvas, (self.y, shear));
        }
    }
}

/// [`RowSums::write`], to be compiled for each instruction set.
struct WriteRow<'a, 'b> {
    row: &'a RowSums,
    channels: &'a [usize],
    weights: Option<&'a [f32]>,
    lost_rays: LostRays,
    planes: &'a mut [&'b mut [f32]],
}

impl NullaryFnOnce for WriteRow<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { row, channels, weights, lost_rays, planes } = self;
        for (chunk, first) in (0..row.width).step_by(LANES).enumerate() {
            let columns = first..(first + LANES).min(row.width);
            let means = row.means(chunk, lost_rays);
            for (plane, mean) in picture::written(channels, planes.len() > picture::PLANES) {
                let (values, found) = (&mut planes[plane][columns.clone()], &means[mean].0[..columns.len()]);
                match weights {
                    None => values.copy_from_slice(found),
                    Some(weights) => {
                        let found = found.iter().zip(&weights[columns.clone()]);
                        for (value, (&found, &weight)) in values.iter_mut().zip(found) {
                            *value = blended(*value, found, weight);
                        }
                    }
                }
            }
        }
    }
}

/// `before`, with `value` in its place by `weight`.
#[inline(always)]
pub(super) fn blended(before: f32, value: f32, weight: f32) -> f32 {
    match weight {
        1.0.. => value,
        ..=0.0 => before,
        _ => before + weight * (value - before),
    }
}

/// Paints one view of one row.
struct Painter<'a, S> {
    simd: S,
    row: &'a mut RowSums,
    /// Number of chunks with unoccluded rays.
    active_chunks: usize,
}

/// What a span reads: a row of a layer.
#[derive(Clone, Copy)]
struct Source<'a> {
    layer: &'a Layer,
    row: usize,
    span: &'a Span,
    step: &'a Step,
    block: &'a Block,
}

/// The source column of an output column.
#[derive(Clone, Copy)]
enum SourceColumn {
    /// The output column plus the shift.
    Shifted(i32),
    /// The same column for all.
    Border(usize),
}

impl<S: Simd> Painter<'_, S> {
    #[inline(always)]
    fn paint_view<'s>(&mut self, canvas: &Canvas<'_>, y: usize, shear: &'s Shear, in_reach: &BinsInReach) {
        let last_row = canvas.spans.height() as i32 - 1;
        let place = |step: &'s Step| {
            let row = (y as i32 + step.shift.rows).clamp(0, last_row) as usize;
            (step, row, canvas.spans.of_block(row, step.block.into()))
        };
        // The spans of the next step are looked up before this one is painted, so that the processor does not wait for them.
        let mut places = shear.steps_in_reach(in_reach).flatten().map(place);
        let mut next = places.next();
        while let Some((step, row, spans)) = next {
            next = places.next();
            let block = &canvas.bins.blocks()[usize::from(step.block)];
            for span in spans {
                self.paint_span(canvas, span, row, (step, block));
            }
            if self.active_chunks == 0 {
                return;
            }
        }
    }

    /// Paints one span: its columns and, where it touches the picture's border, the border column for every column past it.
    #[inline(always)]
    fn paint_span(&mut self, canvas: &Canvas<'_>, span: &Span, row: usize, (step, block): (&Step, &Block)) {
        let columns = step.shift.columns;
        let (start, end) = (span.start as i32 - columns, span.end as i32 - columns);
        let width = self.row.width as i32;
        let source = Source { layer: &canvas.layers[span.layer as usize], row, span, step, block };
        let Range { start: first, end: past } = self.row.columns;
        self.paint_columns(canvas, start.max(first)..end.min(past), &source, SourceColumn::Shifted(columns));
        if span.start == 0 && start > first {
            self.paint_columns(canvas, first..start.min(past), &source, SourceColumn::Border(0));
        }
        if span.end as i32 == width && end < past {
            let last = SourceColumn::Border(width as usize - 1);
            self.paint_columns(canvas, end.max(first)..past, &source, last);
        }
    }

    /// Paints `columns` of the row from `source`.
    #[inline(always)]
    fn paint_columns(
        &mut self,
        canvas: &Canvas<'_>,
        columns: Range<i32>,
        source: &Source<'_>,
        column: SourceColumn,
    ) {
        if columns.is_empty() {
            return;
        }
        let columns = columns.start as usize..columns.end as usize;
        let (first, last) = (columns.start / LANES, (columns.end - 1) / LANES);
        for chunk in first..=last {
            let mut inside = Mask::MAX;
            if chunk == first {
                inside &= Mask::MAX << (columns.start % LANES);
            }
            if chunk == last {
                inside &= Mask::MAX >> (LANES - 1 - (columns.end - 1) % LANES);
            }
            let free = inside & !self.row.occluded[chunk];
            if free == 0 {
                continue;
            }
            if source.span.opaque && free & self.row.attenuated[chunk] == 0 {
                self.note_mirrors(canvas, chunk, (source, column), (free, None));
                self.add_opaque(chunk, (source, column), free);
            } else {
                self.composite(canvas, chunk, (source, column), free);
            }
            self.active_chunks -= usize::from(self.row.occluded[chunk] == Mask::MAX);
        }
    }

    /// Adds the opaque `source` to the rays of the lanes in `free`, which are not attenuated, and occludes them.
    #[inline(always)]
    fn add_opaque(&mut self, chunk: usize, (source, column): (&Source<'_>, SourceColumn), free: Mask) {
        let near = self.nearness(source.block);
        if near < 1.0 {
            let sums = &mut self.row.sums.color[chunk];
            add_colors(self.simd, sums, (source, column, chunk), (free, 1.0 - near));
        }
        if near > 0.0 {
            let sums = &mut self.row.sums.near[chunk];
            add_colors(self.simd, &mut sums.color, (source, column, chunk), (free, near));
            add_constant(self.simd, &mut sums.share, free, near);
            add_constant(self.simd, &mut sums.radius_px, free, near * source.block.radius_px);
        }
        if source.block.focus > 0.0 {
            add_constant(self.simd, &mut self.row.sums.focused[chunk], free, source.block.focus);
        }
        self.row.occluded[chunk] |= free;
    }

    /// Notes the rays of the lanes in `free` that `source` stops with a mirror; they have `passing` left, or all.
    #[inline(always)]
    fn note_mirrors(
        &mut self,
        canvas: &Canvas<'_>,
        chunk: usize,
        (source, column): (&Source<'_>, SourceColumn),
        (free, passing): (Mask, Option<&Chunk>),
    ) {
        let layer = source.span.layer;
        let Some(weights) = canvas.mirrors.and_then(|mirrors| mirrors.weights(usize::from(layer))) else {
            return;
        };
        for lane in (0..LANES).filter(|&lane| has(free, lane)) {
            let x = chunk * LANES + lane;
            let column = match column {
                SourceColumn::Shifted(shift) => (x as i32 + shift) as usize,
                SourceColumn::Border(column) => column,
            };
            let weight = weights.get(column, source.row) * passing.map_or(1.0, |passing| passing.0[lane]);
            if weight > 0.0 {
                self.row.noted.push(Noted {
                    x: x as u32,
                    layer,
                    column: column as u32,
                    row: source.row as u32,
                    weight,
                    focus: source.block.focus,
                });
            }
        }
    }

    /// How far the fragments of `block` are kept apart as near.
    #[inline(always)]
    fn nearness(&self, block: &Block) -> f32 {
        if self.row.sums.near.is_empty() { 0.0 } else { block.near }
    }

    /// Composites `source` behind what the rays of the lanes in `free` have passed, except for those that hit its surface before: adds it
    /// times their transmittance, and attenuates them by its coverage.
    #[inline(always)]
    fn composite(
        &mut self,
        canvas: &Canvas<'_>,
        chunk: usize,
        (source, column): (&Source<'_>, SourceColumn),
        mut free: Mask,
    ) {
        let Source { layer, row, span, step, block } = *source;
        if !span.opaque {
            let same_from = canvas.bins.same_hit_from(block.bins[0].into());
            free &= !self.row.hits.hit_before(chunk, free, &Hit::new(same_from, (step, block), span));
            if free == 0 {
                return;
            }
        }
        let (simd, near) = (self.simd, self.nearness(block));
        let one = simd.splat_f32s(1.0);
        let attenuated = self.row.attenuated[chunk];
        let transmittance = &mut self.row.transmittance[chunk].0;
        let mut passing = Chunk::default();
        let vectors = S::as_mut_simd_f32s(&mut passing.0).0.iter_mut();
        for (i, (passing, before)) in vectors.zip(S::as_simd_f32s(&*transmittance).0).enumerate() {
            *passing = simd.select_f32s(lanes(simd, attenuated, i), *before, one);
        }
        self.note_mirrors(canvas, chunk, (source, column), (free, Some(&passing)));
        let transmittance = &mut self.row.transmittance[chunk].0;
        let sums = &mut self.row.sums;
        let weights = |share| Weights { passing: &passing, free, share };
        let colors = layer.color.each_ref().map(|plane| Values::of(plane, row, column, chunk));
        let alpha =
            if span.opaque { Values::Same(1.0) } else { Values::of(&layer.alpha, row, column, chunk) };
        if near < 1.0 {
            add_weighted(simd, &mut sums.color[chunk], colors, weights(1.0 - near));
        }
        if near > 0.0 {
            let sums = &mut sums.near[chunk];
            add_weighted(simd, &mut sums.color, colors, weights(near));
            add_weighted(simd, std::array::from_mut(&mut sums.share), [alpha], weights(near));
            let radius = weights(near * block.radius_px);
            add_weighted(simd, std::array::from_mut(&mut sums.radius_px), [alpha], radius);
        }
        if block.focus > 0.0 {
            let focused = std::array::from_mut(&mut sums.focused[chunk]);
            add_weighted(simd, focused, [alpha], weights(block.focus));
        }
        let vectors = S::as_mut_simd_f32s(transmittance).0.iter_mut();
        for (i, (transmittance, &before)) in vectors.zip(S::as_simd_f32s(&passing.0).0).enumerate() {
            let after = simd.mul_f32s(before, simd.sub_f32s(one, alpha.vector(simd, i)));
            *transmittance = simd.select_f32s(lanes(simd, free, i), after, before);
        }
        self.row.attenuated[chunk] |= free;
        let spent = transmittance
            .iter()
            .enumerate()
            .fold(0, |mask, (lane, &left)| mask | Mask::from(left < MIN_TRANSMITTANCE) << lane);
        self.row.occlude(chunk, spent & free);
    }
}

/// Adds the share `share` of the colours of `source` to `sums` in the lanes in `free`.
#[inline(always)]
fn add_colors<S: Simd>(
    simd: S,
    sums: &mut [Chunk; 3],
    (source, column, chunk): (&Source<'_>, SourceColumn, usize),
    (free, share): (Mask, f32),
) {
    let zero = simd.splat_f32s(0.0);
    for (k, sum) in sums.iter_mut().enumerate() {
        let values = Values::of(&source.layer.color[k], source.row, column, chunk);
        for (i, sum) in S::as_mut_simd_f32s(&mut sum.0).0.iter_mut().enumerate() {
            let value = values.vector(simd, i);
            let value = if share < 1.0 { simd.mul_f32s(value, simd.splat_f32s(share)) } else { value };
            // Selected, not multiplied: a lane outside the span may hold any value, NaN included.
            let value =
                if free == Mask::MAX { value } else { simd.select_f32s(lanes(simd, free, i), value, zero) };
            *sum = simd.add_f32s(*sum, value);
        }
    }
}

/// What values count for that rays meet.
#[derive(Clone, Copy)]
struct Weights<'a> {
    /// Transmittance of the rays.
    passing: &'a Chunk,
    /// The lanes of the rays.
    free: Mask,
    /// Share of the values.
    share: f32,
}

/// Adds `values` to `sums`, by their `weights`.
#[inline(always)]
fn add_weighted<S: Simd, const N: usize>(
    simd: S,
    sums: &mut [Chunk; N],
    values: [Values<'_>; N],
    weights: Weights<'_>,
) {
    let (zero, share) = (simd.splat_f32s(0.0), simd.splat_f32s(weights.share));
    for (sum, values) in sums.iter_mut().zip(values) {
        let passing = S::as_simd_f32s(&weights.passing.0).0;
        for (i, (sum, &passing)) in S::as_mut_simd_f32s(&mut sum.0).0.iter_mut().zip(passing).enumerate() {
            let value = simd.mul_f32s(passing, values.vector(simd, i));
            let value = if weights.share == 1.0 { value } else { simd.mul_f32s(value, share) };
            // Selected, not multiplied: a lane outside the span may hold any value, NaN included.
            *sum = simd.add_f32s(*sum, simd.select_f32s(lanes(simd, weights.free, i), value, zero));
        }
    }
}

/// Adds `value` to `sum` in the lanes in `free`.
#[inline(always)]
fn add_constant<S: Simd>(simd: S, sum: &mut Chunk, free: Mask, value: f32) {
    let (value, zero) = (simd.splat_f32s(value), simd.splat_f32s(0.0));
    for (i, sum) in S::as_mut_simd_f32s(&mut sum.0).0.iter_mut().enumerate() {
        *sum = simd.add_f32s(*sum, simd.select_f32s(lanes(simd, free, i), value, zero));
    }
}

/// The values of a plane that an output chunk reads.
#[derive(Clone, Copy)]
enum Values<'a> {
    /// One for each lane; lanes outside the span may have any value.
    Lanes(&'a [f32]),
    /// The same for all.
    Same(f32),
}

impl<'a> Values<'a> {
    /// Those of row `row` of `plane` for output chunk `chunk`.
    #[inline(always)]
    fn of(plane: &'a Plane, row: usize, column: SourceColumn, chunk: usize) -> Self {
        let values = plane.row_with_margins(row);
        match column {
            SourceColumn::Shifted(shift) => {
                // The painted columns and their sources lie within the picture, so a chunk extends past its ends by less than
                // the margin.
                let start = (chunk * LANES + MARGIN) as i32 + shift;
                Self::Lanes(&values[start as usize..][..LANES])
            }
            SourceColumn::Border(column) => Self::Same(values[MARGIN + column]),
        }
    }

    /// Vector `i` of the chunk.
    #[inline(always)]
    fn vector<S: Simd>(&self, simd: S, i: usize) -> S::f32s {
        match self {
            Self::Lanes(values) => S::as_simd_f32s(&values[i * S::F32_LANES..][..S::F32_LANES]).0[0],
            Self::Same(value) => simd.splat_f32s(*value),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::{Aperture, views};
    use crate::methods::shear::bins::Bins;
    use crate::methods::shear::keys::Extent;
    use crate::methods::shear::spans;

    const WIDTH: usize = 53;
    const HEIGHT: usize = 7;

    /// Two layers whose spans are short and long, opaque and translucent, near and far.
    fn layers() -> Vec<Layer> {
        let plane = |f: fn(usize, usize) -> f32| Plane::from_fn(WIDTH, HEIGHT, f);
        let color = |f| std::array::from_fn(|_| plane(f));
        let front_alpha = plane(|x, y| [1.0, 1.0, 0.4, 0.0, 1.0][(x / 3 + y) % 5]);
        let front = Layer {
            color: color(|x, y| (x * 3 + y) as f32 * 0.1),
            alpha: front_alpha,
            coc_px: plane(|x, _| -11.0 - (x / 9) as f32),
        };
        let back = Layer {
            color: color(|x, y| (x + y * y) as f32 * 0.3),
            alpha: plane(|_, _| 1.0),
            coc_px: plane(|_, y| 0.2 * y as f32),
        };
        vec![front, back]
    }

    /// Calls `paint` with a canvas of [`layers`] and 64 views of it.
    fn with_canvas<T>(paint: impl Fn(&Canvas<'_>, &[Shear]) -> T) -> T {
        let layers = layers();
        let bins = Bins::new([-16.0, 2.0], 0.5);
        let spans = spans::find(&layers, &bins, Extent::HalfWay);
        let shears: Vec<Shear> =
            views(64, Aperture::DISC).iter().map(|view| Shear::new(view, &bins)).collect();
        paint(
            &Canvas {
                layers: &layers,
                spans: &spans,
                bins: &bins,
                mirrors: None,
                barrel: None,
                aberration_px: 0.0,
                background: None,
                lost_rays: LostRays::LeftOut,
            },
            &shears,
        )
    }

    fn rows(canvas: &Canvas<'_>, batches: &[&[Shear]], arch: Arch) -> Vec<[f32; 10]> {
        let row = |y| {
            let mut sums = RowSums::new(WIDTH, true);
            let bins = canvas.bins_in_reach(y);
            batches.iter().for_each(|shears| sums.add(canvas, (y, &bins), shears, arch));
            let value = |x: usize| sums.means(x / LANES, canvas.lost_rays).map(|mean| mean.0[x % LANES]);
            (0..WIDTH).map(value).collect::<Vec<_>>()
        };
        (0..HEIGHT).flat_map(row).collect()
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        with_canvas(|canvas, shears| {
            let scalar = rows(canvas, &[shears], Arch::Scalar);
            assert!(scalar.iter().any(|pixel| pixel[0] > 1.0), "the picture is not black");
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
    fn views_added_in_two_calls_give_the_bits_of_one_call() {
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
    fn every_ray_hits_the_opaque_layer_behind_at_the_latest() {
        with_canvas(|canvas, shears| {
            for pixel in rows(canvas, &[shears], Arch::new()) {
                assert!((pixel[3] - 1.0).abs() < 1e-6, "alpha {}", pixel[3]);
            }
        });
    }
}
