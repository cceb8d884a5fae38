//! The values that an output chunk reads of a source row, and how they are added to sums.

use super::lanes::{Chunk, LANES, Mask, lanes};
use super::spans::Span;
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
    pub(super) layer: u16,
    /// An index of [`super::bins::Bins::blocks`].
    pub(super) block: u16,
    /// Whether every column has the same value.
    repeats: bool,
    opaque: bool,
}

/// The alpha of opaque fragments.
static ONES: Chunk = Chunk([1.0; LANES]);

impl Source {
    /// The part of `span`, whose row begins at `start` ([`Plane::padded`]), that lies in `column`.
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
        let planes = [red, green, blue, &layer.alpha];
        if self.repeats {
            for (repeated, plane) in repeated.iter_mut().zip(planes) {
                repeated.0 = [plane.padded(self.at as usize)[0]; LANES];
            }
            return [
                &repeated[0].0,
                &repeated[1].0,
                &repeated[2].0,
                if self.opaque { &ONES.0 } else { &repeated[3].0 },
            ];
        }
        let at = (self.at + (chunk * LANES) as i64) as usize;
        let alpha = if self.opaque { &ONES.0 } else { layer.alpha.padded(at) };
        [red.padded(at), green.padded(at), blue.padded(at), alpha]
    }

    /// Alpha for output chunk `chunk`.
    #[inline(always)]
    pub(super) fn alpha(&self, layer: &Layer, chunk: usize) -> Chunk {
        let plane: &Plane = &layer.alpha;
        let mut alpha = ONES;
        if !self.opaque {
            if self.repeats {
                alpha.0 = [plane.padded(self.at as usize)[0]; LANES];
            } else {
                alpha.0.copy_from_slice(plane.padded((self.at + (chunk * LANES) as i64) as usize));
            }
        }
        alpha
    }
}

/// What values count for that rays meet.
#[derive(Clone, Copy)]
pub(super) struct Weights<'a> {
    /// Transmittance of the rays.
    pub(super) passing: &'a Chunk,
    /// The lanes of the rays.
    pub(super) lanes: Mask,
    /// Share of the values.
    pub(super) share: f32,
}

/// Adds `values` to `sums`, by their `weights`.
#[inline(always)]
pub(super) fn add_weighted<S: Simd, const N: usize>(
    simd: S,
    sums: &mut [Chunk; N],
    values: [&[f32]; N],
    weights: Weights<'_>,
) {
    let (zero, share) = (simd.splat_f32s(0.0), simd.splat_f32s(weights.share));
    let passing = S::as_simd_f32s(&weights.passing.0).0;
    for (sum, values) in sums.iter_mut().zip(values) {
        let values = S::as_simd_f32s(values).0;
        for (i, (sum, (&passing, &value))) in
            S::as_mut_simd_f32s(&mut sum.0).0.iter_mut().zip(passing.iter().zip(values)).enumerate()
        {
            let value = simd.mul_f32s(simd.mul_f32s(passing, value), share);
            // Selected, not multiplied: a lane outside the span may hold any value, NaN included.
            *sum = simd.add_f32s(*sum, simd.select_f32s(lanes(simd, weights.lanes, i), value, zero));
        }
    }
}
