//! Passes of an extended box along lines of planes, with running sums in whole steps.

use super::super::gaussian::{ExtendedBox, PASSES};
use crate::gpu::mirrored;
use std::ops::Range;

mirrored! {
    /// Parameters of one pass of an extended box along lines.
    pub(super) struct Lines {
        /// Number of lines.
        count: i32,
        /// Samples per line.
        length: i32,
        /// Position of the input, as [`Strides`].
        from_first: i32,
        from_plane: i32,
        from_line: i32,
        from_sample: i32,
        /// Position of the output.
        to_first: i32,
        to_plane: i32,
        to_line: i32,
        to_sample: i32,
        /// Samples that a thread computes.
        chunk: i32,
        radius: i32,
        edge: f32,
        scale: f32,
        /// Steps per unit, and size of a step; both powers of two.
        steps: f32,
        step: f32,
        /// Fine steps per step, and size of a fine step.
        fine_steps: f32,
        fine_step: f32,
    }
}

/// Layout of planes in a buffer.
#[derive(Debug, Clone, Copy)]
struct Strides {
    /// Index of the first sample of the first line.
    first: usize,
    /// Distance of neighbouring planes, lines and samples.
    plane: usize,
    line: usize,
    sample: usize,
}

impl Lines {
    /// A pass along `count` lines of `length` samples with magnitudes up to `max_value`, between two layouts.
    fn new(
        filter: &ExtendedBox,
        (count, length): (usize, usize),
        [from, to]: [Strides; 2],
        max_value: f32,
    ) -> Self {
        let &ExtendedBox { radius, edge, scale } = filter;
        // The sum of all samples of a box must fit into 31 bits; f32 has 24.
        let sum_bits = (2 * radius + 2).next_power_of_two().trailing_zeros() as i32;
        let bits = (30 - sum_bits).clamp(1, 22);
        let [steps, fine_steps] =
            [bits - max_value.log2().ceil() as i32, bits].map(|bits| f32::from(bits as i16).exp2());
        Self {
            count: count as i32,
            length: length as i32,
            from_first: from.first as i32,
            from_plane: from.plane as i32,
            from_line: from.line as i32,
            from_sample: from.sample as i32,
            to_first: to.first as i32,
            to_plane: to.plane as i32,
            to_line: to.line as i32,
            to_sample: to.sample as i32,
            // Each thread first sums a whole box, so there are few threads per line.
            chunk: 8 * (radius as i32 + 1),
            radius: radius as i32,
            edge: edge as f32,
            scale: scale as f32,
            steps,
            step: steps.recip(),
            fine_steps,
            fine_step: (steps * fine_steps).recip(),
        }
    }
}

/// The passes that blur `rows` of planes of `width` × `source_rows` samples with magnitudes up to `max_value`, rows
/// first. Every other pass writes to where the first one reads.
pub(super) fn blur_passes(
    filter: &ExtendedBox,
    (width, source_rows): (usize, usize),
    rows: &Range<usize>,
    max_value: f32,
) -> [Lines; 2 * PASSES] {
    let height = rows.len();
    let plane = width * source_rows;
    let source = |[line, sample]: [usize; 2]| Strides { first: width * rows.start, plane, line, sample };
    let scratch = |[line, sample]: [usize; 2]| Strides { first: 0, plane: width * height, line, sample };
    // The buffer between holds rows as columns, so only the first and the last pass access samples across lines.
    let (row, column, upright) = ([width, 1], [1, height], [1, width]);
    let across = |strides| Lines::new(filter, (height, width), strides, max_value);
    let down = |strides| Lines::new(filter, (width, height), strides, max_value);
    let [forward, back] =
        [[source(upright), scratch(upright)], [scratch(upright), source(upright)]].map(down);
    [
        across([source(row), scratch(column)]),
        across([scratch(column), source(column)]),
        across([source(column), scratch(column)]),
        across([scratch(column), source(row)]),
        forward,
        back,
        forward,
        back,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_whole_steps_fit_into_31_bits_and_are_finer_than_f32() {
        for sigma in [1.0, 9.0, 100.0, 4000.0] {
            for max_value in [1.0f32, 65_504.0, 3e30] {
                let strides = Strides { first: 0, plane: 63, line: 9, sample: 1 };
                let lines = Lines::new(&ExtendedBox::from_sigma(sigma), (7, 9), [strides; 2], max_value);
                let box_length = f64::from(2 * lines.radius + 2);
                assert!(f64::from(max_value) * f64::from(lines.steps) * box_length <= 2f64.powi(31) - 1.0);
                assert!(f64::from(lines.fine_steps) * box_length <= 2f64.powi(31) - 1.0, "σ = {sigma}");
                assert!(lines.fine_step <= max_value * 2f32.powi(-33), "σ = {sigma}: {}", lines.fine_step);
            }
        }
    }
}
