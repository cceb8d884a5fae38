//! An extended box along lines of planes, pass by pass, and its running sums: whole numbers of steps.

use super::super::gaussian::{ExtendedBox, PASSES};
use crate::gpu::mirrored;
use std::ops::Range;

mirrored! {
    /// An extended box along lines.
    pub(super) struct Lines {
        /// How many lines there are side by side.
        count: i32,
        /// Samples of each.
        length: i32,
        /// Where they are read, as a [`Way`].
        from_first: i32,
        from_plane: i32,
        from_line: i32,
        from_sample: i32,
        /// Where they are written.
        to_first: i32,
        to_plane: i32,
        to_line: i32,
        to_sample: i32,
        /// Samples that a thread makes.
        chunk: i32,
        radius: i32,
        edge: f32,
        scale: f32,
        /// Steps in a value of one, and the step; both powers of two.
        steps: f32,
        step: f32,
        /// Fine steps in a step, and the fine step.
        fine_steps: f32,
        fine_step: f32,
    }
}

/// Where planes lie in a buffer.
#[derive(Debug, Clone, Copy)]
struct Way {
    /// The first sample of the first line.
    first: usize,
    /// From one plane, one line and one sample to the next.
    plane: usize,
    line: usize,
    sample: usize,
}

impl Lines {
    /// `count` lines of `length` samples of at most `brightest`, and the ways from and to where they go.
    fn new(
        filter: &ExtendedBox,
        (count, length): (usize, usize),
        [from, to]: [Way; 2],
        brightest: f32,
    ) -> Self {
        let &ExtendedBox { radius, edge, scale } = filter;
        // A sum of all samples of a box must fit into a whole number of 31 bits; single precision has 24.
        let sum_bits = (2 * radius + 2).next_power_of_two().trailing_zeros() as i32;
        let bits = (30 - sum_bits).clamp(1, 22);
        let [steps, fine_steps] =
            [bits - brightest.log2().ceil() as i32, bits].map(|bits| f32::from(bits as i16).exp2());
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
            // Where a thread begins it adds up a whole box: few begin.
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

/// The passes that blur `rows` of planes of `width` × `source_rows` samples of at most `brightest`, rows first; every other one ends
/// where the first begins.
pub(super) fn blur_passes(
    filter: &ExtendedBox,
    (width, source_rows): (usize, usize),
    rows: &Range<usize>,
    brightest: f32,
) -> [Lines; 2 * PASSES] {
    let height = rows.len();
    let plane = width * source_rows;
    let there = |[line, sample]: [usize; 2]| Way { first: width * rows.start, plane, line, sample };
    let between = |[line, sample]: [usize; 2]| Way { first: 0, plane: width * height, line, sample };
    // Rows lie as columns in between: a pass reads or writes across them only at either end.
    let (row, column, upright) = ([width, 1], [1, height], [1, width]);
    let across = |ways| Lines::new(filter, (height, width), ways, brightest);
    let down = |ways| Lines::new(filter, (width, height), ways, brightest);
    let [out, back] = [[there(upright), between(upright)], [between(upright), there(upright)]].map(down);
    [
        across([there(row), between(column)]),
        across([between(column), there(column)]),
        across([there(column), between(column)]),
        across([between(column), there(row)]),
        out,
        back,
        out,
        back,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_whole_steps_fit_and_are_finer_than_single_precision() {
        for sigma in [1.0, 9.0, 100.0, 4000.0] {
            for brightest in [1.0f32, 65_504.0, 3e30] {
                let way = Way { first: 0, plane: 63, line: 9, sample: 1 };
                let lines = Lines::new(&ExtendedBox::from_sigma(sigma), (7, 9), [way; 2], brightest);
                let box_length = f64::from(2 * lines.radius + 2);
                assert!(f64::from(brightest) * f64::from(lines.steps) * box_length <= 2f64.powi(31) - 1.0);
                assert!(f64::from(lines.fine_steps) * box_length <= 2f64.powi(31) - 1.0, "σ = {sigma}");
                assert!(lines.fine_step <= brightest * 2f32.powi(-33), "σ = {sigma}: {}", lines.fine_step);
            }
        }
    }
}
