//! The values that an output chunk reads of a source row, and how they are added to sums.

use super::lanes::{Chunk, LANES, Mask, lanes};
use crate::image::{MARGIN, Plane};
use pulp::Simd;

/// The source column of an output column.
#[derive(Clone, Copy)]
pub(super) enum SourceColumn {
    /// The output column plus the shift.
    Shifted(i32),
    /// The same column for all.
    Border(usize),
}
/// Adds the share `share` of `colors` to `sums` in the lanes in `free`.
#[inline(always)]
pub(super) fn add_colors<S: Simd>(
    simd: S,
    sums: &mut [Chunk; 3],
    colors: &[Values<'_>; 3],
    (free, share): (Mask, f32),
) {
    let zero = simd.splat_f32s(0.0);
    for (sum, values) in sums.iter_mut().zip(colors) {
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
pub(super) struct Weights<'a> {
    /// Transmittance of the rays.
    pub(super) passing: &'a Chunk,
    /// The lanes of the rays.
    pub(super) free: Mask,
    /// Share of the values.
    pub(super) share: f32,
}

/// Adds `values` to `sums`, by their `weights`.
#[inline(always)]
pub(super) fn add_weighted<S: Simd, const N: usize>(
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
pub(super) fn add_constant<S: Simd>(simd: S, sum: &mut Chunk, free: Mask, value: f32) {
    let (value, zero) = (simd.splat_f32s(value), simd.splat_f32s(0.0));
    for (i, sum) in S::as_mut_simd_f32s(&mut sum.0).0.iter_mut().enumerate() {
        *sum = simd.add_f32s(*sum, simd.select_f32s(lanes(simd, free, i), value, zero));
    }
}

/// The values of a plane that an output chunk reads.
#[derive(Clone, Copy)]
pub(super) enum Values<'a> {
    /// One for each lane; lanes outside the span may have any value.
    Lanes(&'a [f32]),
    /// The same for all.
    Same(f32),
}

impl<'a> Values<'a> {
    /// Those of row `row` of `plane` for output chunk `chunk`.
    #[inline(always)]
    pub(super) fn of(plane: &'a Plane, row: usize, column: SourceColumn, chunk: usize) -> Self {
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
    pub(super) fn vector<S: Simd>(&self, simd: S, i: usize) -> S::f32s {
        match self {
            Self::Lanes(values) => S::as_simd_f32s(&values[i * S::F32_LANES..][..S::F32_LANES]).0[0],
            Self::Same(value) => simd.splat_f32s(*value),
        }
    }
}
