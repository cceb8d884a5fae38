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
//! memory. Bins that a view moves alike are painted in blocks. What is opaque is only noted while the spans are looked through, and added when
//! all of them are ([`super::opaque_hits`]).
//!
//! Translucent spans keep, beside the bit, the transmittance of the ray. A ray may hit several fragments of a surface, and counts the surface
//! once ([`super::translucent_hits`]).
//!
//! The inner loops are compiled for several instruction sets, one of which is selected when the program runs. Additions,
//! multiplications and selections have one order and are never fused, so every instruction set gives the same bits.

use super::bins::Block;
use super::canvas::{BinsInReach, Canvas, Shear, Step};
use super::lanes::{Chunk, LANES, Mask, chunks_of, has, lanes, lanes_of};
use super::mirrors::Noted;
use super::row_sums::RowSums;
use super::spans::Span;
use super::translucent_hits::Hit;
use super::values::{Source, SourceColumn, Weights, add_weighted};
use crate::image::Plane;
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;

/// A ray of less transmittance goes no further.
pub(super) const MIN_TRANSMITTANCE: f32 = 0.002;

/// Partial sums are flushed after this number of views, so that the f32 rounding error does not grow with the view count.
const VIEWS_PER_BATCH: usize = 256;

impl RowSums {
    /// Adds the views `shears` of output row `y` with the instructions of `arch`; every bin that they can move there is `in_reach`.
    pub(super) fn add(
        &mut self,
        canvas: &Canvas<'_>,
        (y, in_reach): (usize, &BinsInReach),
        shears: &[Shear],
        arch: Arch,
    ) {
        self.hits.prepare(canvas.layers.len(), self.transmittance.len());
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
            let rays = match self.canvas.barrel {
                None => self.row.start_view(),
                Some(barrel) => self.row.start_view_through(&barrel, shear.view.lens, self.y),
            };
            self.row.hits.start_view();
            let mut painter = Painter { simd, rays, row: self.row, repeated: [Chunk::default(); 4] };
            painter.paint_view(self.canvas, self.y, shear, self.in_reach);
            if painter.rays > 0 {
                self.row.end_rays(self.canvas.background, shear, self.y);
            }
            self.row.opaque_hits.add_to(simd, &mut self.row.sums, self.canvas);
            self.row.add_reflections(self.canvas, (self.y, shear));
        }
    }
}

/// Paints one view of one row.
struct Painter<'a, S> {
    simd: S,
    row: &'a mut RowSums,
    /// Number of unoccluded rays.
    rays: usize,
    /// Memory for [`Source::values`].
    repeated: [Chunk; 4],
}

/// A span, and how a view moves it.
#[derive(Clone, Copy)]
struct PlacedSpan<'a> {
    /// Its row.
    row: usize,
    /// Where the row begins ([`Plane::row_start`]).
    start: i64,
    span: &'a Span,
    step: &'a Step,
    block: &'a Block,
}

impl<S: Simd> Painter<'_, S> {
    #[inline(always)]
    fn paint_view(&mut self, canvas: &Canvas<'_>, y: usize, shear: &Shear, in_reach: &BinsInReach) {
        let last_row = canvas.spans.height() as i32 - 1;
        // The spans of the next step are looked up before this one is painted, so that the processor does not wait for them.
        let mut steps = shear.steps_in_reach(in_reach).flatten();
        let mut placed = None;
        loop {
            let next = steps.next().map(|step| {
                let row = (y as i32 + step.shift.rows).clamp(0, last_row) as usize;
                (step, row, canvas.spans.of_block(row, step.block.into()))
            });
            let is_last = next.is_none();
            if let Some((step, row, spans)) = std::mem::replace(&mut placed, next) {
                let block = &canvas.bins.blocks()[usize::from(step.block)];
                let start = Plane::row_start(self.row.width, row) as i64;
                for span in spans {
                    self.paint_span(canvas, &PlacedSpan { row, start, span, step, block });
                }
            }
            if is_last || self.rays == 0 {
                return;
            }
        }
    }

    /// Paints one span: its columns and, where it touches the picture's border, the border column for every column past it.
    #[inline(always)]
    fn paint_span(&mut self, canvas: &Canvas<'_>, source: &PlacedSpan<'_>) {
        let (span, columns) = (source.span, source.step.shift.columns);
        let (start, end) = (span.start as i32 - columns, span.end as i32 - columns);
        let width = self.row.width as i32;
        let Range { start: first, end: past } = self.row.columns;
        self.paint_columns(canvas, start.max(first)..end.min(past), source, SourceColumn::Shifted(columns));
        if span.start == 0 && start > first {
            self.paint_columns(canvas, first..start.min(past), source, SourceColumn::Border(0));
        }
        if span.end as i32 == width && end < past {
            let last = SourceColumn::Border(width as usize - 1);
            self.paint_columns(canvas, end.max(first)..past, source, last);
        }
    }

    /// Paints `columns` of the row from `source`.
    #[inline(always)]
    fn paint_columns(
        &mut self,
        canvas: &Canvas<'_>,
        columns: Range<i32>,
        source: &PlacedSpan<'_>,
        column: SourceColumn,
    ) {
        if columns.is_empty() {
            return;
        }
        let columns = columns.start as usize..columns.end as usize;
        let part = Source::new(source.span, source.step.block, source.start, column);
        if source.span.opaque && canvas.mirrors.is_none() && !self.note_opaque(&columns, part) {
            return;
        }
        for chunk in chunks_of(&columns) {
            let free = !self.row.occluded.chunk(chunk) & lanes_of(&columns, chunk);
            if free == 0 {
                continue;
            }
            if source.span.opaque && free & self.row.attenuated.chunk(chunk) == 0 {
                self.note_mirrors(canvas, chunk, (source, column), (free, None));
                let inside = columns.start.max(chunk * LANES)..columns.end.min((chunk + 1) * LANES);
                self.note_opaque(&inside, part);
            } else {
                self.composite(canvas, chunk, (source, column, part), free);
            }
        }
    }

    /// Notes what rays hit of `part`, which is opaque, at `columns`, and occludes them, unless they are attenuated. Returns whether such
    /// rays are left.
    #[inline(always)]
    fn note_opaque(&mut self, columns: &Range<usize>, part: Source) -> bool {
        let RowSums { opaque_hits, occluded, attenuated, .. } = &mut *self.row;
        let left = opaque_hits.note(occluded, attenuated, columns, part);
        self.rays -= left.ended;
        left.attenuated
    }

    /// Notes the rays of the lanes in `free` that `source` stops with a mirror; they have `passing` left, or all.
    #[inline(always)]
    fn note_mirrors(
        &mut self,
        canvas: &Canvas<'_>,
        chunk: usize,
        (source, column): (&PlacedSpan<'_>, SourceColumn),
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

    /// Composites `source` behind what the rays of the lanes in `free` have passed, except for those that hit its surface before: adds it
    /// times their transmittance, and attenuates them by its coverage.
    #[inline(always)]
    fn composite(
        &mut self,
        canvas: &Canvas<'_>,
        chunk: usize,
        (source, column, part): (&PlacedSpan<'_>, SourceColumn, Source),
        mut free: Mask,
    ) {
        let PlacedSpan { span, step, block, .. } = *source;
        if !span.opaque {
            let same_from = canvas.bins.same_hit_from(block.bins[0].into());
            free &= !self.row.hits.hit_before(chunk, free, &Hit::new(same_from, (step, block), span));
            if free == 0 {
                return;
            }
        }
        let simd = self.simd;
        let one = simd.splat_f32s(1.0);
        let attenuated = self.row.attenuated.chunk(chunk);
        let transmittance = &mut self.row.transmittance[chunk].0;
        let mut passing = Chunk::default();
        let vectors = S::as_mut_simd_f32s(&mut passing.0).0.iter_mut();
        for (i, (passing, before)) in vectors.zip(S::as_simd_f32s(&*transmittance).0).enumerate() {
            *passing = simd.select_f32s(lanes(simd, attenuated, i), *before, one);
        }
        self.note_mirrors(canvas, chunk, (source, column), (free, Some(&passing)));
        let values = part.values(canvas.layers, chunk, &mut self.repeated);
        let weights = Weights { passing: &passing, lanes: free };
        add_weighted(simd, (&mut self.row.sums, chunk), block, &values, weights);
        let alpha = S::as_simd_f32s(values[3]).0;
        let transmittance = &mut self.row.transmittance[chunk].0;
        let vectors = S::as_mut_simd_f32s(transmittance).0.iter_mut();
        for (i, (transmittance, &before)) in vectors.zip(S::as_simd_f32s(&passing.0).0).enumerate() {
            let after = simd.mul_f32s(before, simd.sub_f32s(one, alpha[i]));
            *transmittance = simd.select_f32s(lanes(simd, free, i), after, before);
        }
        self.row.attenuated.add(chunk, free);
        let spent = transmittance
            .iter()
            .enumerate()
            .fold(0, |mask, (lane, &left)| mask | Mask::from(left < MIN_TRANSMITTANCE) << lane);
        self.row.occlude(chunk, spent & free);
        self.rays -= (spent & free).count_ones() as usize;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::{Aperture, views};
    use crate::methods::contract::LostRays;
    use crate::methods::shear::bins::Bins;
    use crate::methods::shear::keys::Extent;
    use crate::methods::shear::shown::Shown;
    use crate::methods::shear::spans;
    use crate::scene::Layer;

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
        let spans = spans::find(&layers, &bins, Extent::HalfWay, &Shown::all(&layers));
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
