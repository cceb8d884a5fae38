//! The values that an output chunk reads of a source row, and how they are added to sums.

use super::bins::Block;
use super::canvas::Canvas;
use super::lanes::{Chunk, LANES, Mask, lanes};
use super::spans::Span;
use super::sums::Sums;
use crate::image::Plane;
use crate::scene::Layer;
use pulp::Simd;

/// The source column of an output column.
#[derive(Debug, Clone, Copy)]
pub(super) enum SourceColumn {
    /// The output column plus the shift.
    Shifted(i32),
    /// The same column for all.
    Border(usize),
}

/// A part of a span, as it lies under output columns.
#[derive(Debug, Clone, Copy)]
pub(super) struct Source {
    /// Where planes have its value for output column 0, or for every one: see [`Plane::padded`].
    at: i64,
    layer: u16,
    /// An index of [`super::bins::Bins::blocks`].
    pub(super) block: u16,
    /// Whether every column has the same value.
    repeats: bool,
    opaque: bool,
}

/// Rays of a chunk that hit something.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Hit {
    pub(super) chunk: u32,
    /// The lanes of the rays.
    pub(super) lanes: Mask,
}

/// The alpha of opaque fragments, and the transmittance of rays that passed nothing.
pub(super) static ONES: Chunk = Chunk([1.0; LANES]);

impl Source {
    /// The part of `span` of `block`, whose row begins at `start` ([`row_start`](crate::image::Plane::row_start)), that lies in `column`.
    #[inline(always)]
    pub(super) fn new(span: &Span, block: u16, start: i64, column: SourceColumn) -> Self {
        let (at, repeats) = match column {
            // The painted columns and their sources lie within the picture, so a chunk extends past its ends by less than the margin.
            SourceColumn::Shifted(shift) => (start + i64::from(shift), false),
            SourceColumn::Border(column) => (start + column as i64, true),
        };
        Self { at, layer: span.layer, block, repeats, opaque: span.opaque }
    }

    /// Red, green, blue and alpha for output chunk `chunk`; lanes outside the span may have any value. `repeated` is memory.
    #[inline(always)]
    pub(super) fn values<'a>(
        &self,
        layers: &'a [Layer],
        chunk: usize,
        repeated: &'a mut [Chunk; 4],
    ) -> [&'a [f32]; 4] {
        let layer = &layers[usize::from(self.layer)];
        let [red, green, blue] = &layer.color;
        if self.repeats {
            // Where all is opaque there is no alpha to read.
            let alpha = if self.opaque { red } else { &layer.alpha };
            for (repeated, plane) in repeated.iter_mut().zip([red, green, blue, alpha]) {
                repeated.0 = [plane.padded()[self.at as usize]; LANES];
            }
            let [red, green, blue, alpha] = &*repeated;
            return [&red.0, &green.0, &blue.0, if self.opaque { &ONES.0 } else { &alpha.0 }];
        }
        let at = (self.at + (chunk * LANES) as i64) as usize;
        let alpha = if self.opaque { &ONES.0 } else { &layer.alpha.padded()[at..][..LANES] };
        [&red.padded()[at..][..LANES], &green.padded()[at..][..LANES], &blue.padded()[at..][..LANES], alpha]
    }

    /// Where `planes` have its values. `repeated` is memory.
    #[inline(always)]
    fn places<'a>(&self, planes: [&'a Plane; 3], repeated: &'a mut [Chunk; 3]) -> Places<'a> {
        if self.repeats {
            for (repeated, plane) in repeated.iter_mut().zip(planes) {
                repeated.0 = [plane.padded()[self.at as usize]; LANES];
            }
            let [red, green, blue] = &*repeated;
            Places { planes: [&red.0, &green.0, &blue.0], first: 0, step: 0 }
        } else {
            Places { planes: planes.map(Plane::padded), first: self.at, step: LANES as i64 }
        }
    }
}

/// Where the colours of chunks are.
#[derive(Clone, Copy)]
struct Places<'a> {
    planes: [&'a [f32]; 3],
    /// The place of those of chunk 0, and the way from one chunk's to the next's.
    first: i64,
    step: i64,
}

impl<'a> Places<'a> {
    /// Those of chunk `chunk` in plane `k`.
    #[inline(always)]
    fn of(&self, k: usize, chunk: usize) -> &'a [f32] {
        &self.planes[k][(self.first + chunk as i64 * self.step) as usize..][..LANES]
    }
}

/// Adds what whole rays hit of `source`, which is opaque, to their `sums`. The bits are those of [`add_weighted`].
#[inline(always)]
pub(super) fn add_opaque<S: Simd>(
    simd: S,
    sums: &mut Sums,
    canvas: &Canvas<'_>,
    source: &Source,
    hits: &[Hit],
) {
    let block = &canvas.bins.blocks()[usize::from(source.block)];
    let mut repeated = [Chunk::default(); 3];
    let places = source.places(canvas.layers[usize::from(source.layer)].color.each_ref(), &mut repeated);
    let near = if sums.near.is_empty() { 0.0 } else { block.near };
    if near < 1.0 {
        let share = simd.splat_f32s(1.0 - near);
        for hit in hits {
            add_where(simd, &mut sums.color[hit.chunk as usize], (&places, hit), share);
        }
    }
    if near > 0.0 {
        let (share, radius_px) = (simd.splat_f32s(near), near * block.radius_px);
        for hit in hits {
            let sums = &mut sums.near[hit.chunk as usize];
            add_where(simd, &mut sums.color, (&places, hit), share);
            add_constant(simd, &mut sums.share, near, hit.lanes);
            add_constant(simd, &mut sums.radius_px, radius_px, hit.lanes);
        }
    }
    if block.focus > 0.0 {
        for hit in hits {
            add_constant(simd, &mut sums.focused[hit.chunk as usize], block.focus, hit.lanes);
        }
    }
}

/// Adds the share `share` of the values that rays `hit` to their `sums`.
#[inline(always)]
fn add_where<S: Simd>(simd: S, sums: &mut [Chunk; 3], (places, hit): (&Places<'_>, &Hit), share: S::f32s) {
    let zero = simd.splat_f32s(0.0);
    for (k, sum) in sums.iter_mut().enumerate() {
        let values = S::as_simd_f32s(places.of(k, hit.chunk as usize)).0;
        for (i, (sum, &value)) in S::as_mut_simd_f32s(&mut sum.0).0.iter_mut().zip(values).enumerate() {
            // Selected, not multiplied: a lane outside the span may hold any value, NaN included.
            let value = simd.select_f32s(lanes(simd, hit.lanes, i), simd.mul_f32s(value, share), zero);
            *sum = simd.add_f32s(*sum, value);
        }
    }
}

/// Adds `value` to `sum` in `lanes`.
#[inline(always)]
fn add_constant<S: Simd>(simd: S, sum: &mut Chunk, value: f32, mask: Mask) {
    let (value, zero) = (simd.splat_f32s(value), simd.splat_f32s(0.0));
    for (i, sum) in S::as_mut_simd_f32s(&mut sum.0).0.iter_mut().enumerate() {
        *sum = simd.add_f32s(*sum, simd.select_f32s(lanes(simd, mask, i), value, zero));
    }
}

/// What values count for that rays meet.
#[derive(Clone, Copy)]
pub(super) struct Weights<'a> {
    /// Transmittance of the rays.
    pub(super) passing: &'a Chunk,
    /// The lanes of the rays.
    pub(super) lanes: Mask,
}

/// Adds the red, green, blue and alpha `values` of a fragment of `block` to the sums of chunk `chunk`, by their `weights`.
#[inline(always)]
pub(super) fn add_weighted<S: Simd>(
    simd: S,
    (sums, chunk): (&mut Sums, usize),
    block: &Block,
    values: &[&[f32]; 4],
    weights: Weights<'_>,
) {
    let [red, green, blue, alpha] = *values;
    let near = if sums.near.is_empty() { 0.0 } else { block.near };
    if near < 1.0 {
        add_share(simd, &mut sums.color[chunk], [red, green, blue], (weights, 1.0 - near));
    }
    if near > 0.0 {
        let sums = &mut sums.near[chunk];
        add_share(simd, &mut sums.color, [red, green, blue], (weights, near));
        add_share(simd, std::array::from_mut(&mut sums.share), [alpha], (weights, near));
        let radius_px = std::array::from_mut(&mut sums.radius_px);
        add_share(simd, radius_px, [alpha], (weights, near * block.radius_px));
    }
    if block.focus > 0.0 {
        let focused = std::array::from_mut(&mut sums.focused[chunk]);
        add_share(simd, focused, [alpha], (weights, block.focus));
    }
}

/// Adds the share `share` of `values` to `sums`, by their `weights`.
#[inline(always)]
fn add_share<S: Simd, const N: usize>(
    simd: S,
    sums: &mut [Chunk; N],
    values: [&[f32]; N],
    (weights, share): (Weights<'_>, f32),
) {
    let (zero, share) = (simd.splat_f32s(0.0), simd.splat_f32s(share));
    let passing = S::as_simd_f32s(&weights.passing.0).0;
    for (sum, values) in sums.iter_mut().zip(values) {
        let values = passing.iter().zip(S::as_simd_f32s(values).0);
        for (i, (sum, (&passing, &value))) in
            S::as_mut_simd_f32s(&mut sum.0).0.iter_mut().zip(values).enumerate()
        {
            let value = simd.mul_f32s(simd.mul_f32s(passing, value), share);
            // Selected, not multiplied: a lane outside the span may hold any value, NaN included.
            *sum = simd.add_f32s(*sum, simd.select_f32s(lanes(simd, weights.lanes, i), value, zero));
        }
    }
}
