//! Computes planes row by row, in parallel.

use crate::image::Plane;
use crate::methods::contract::Progress;
use crate::parallel;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Most rows that a thread takes at a time: with more, others wait at the end for the one whose rows are dear.
const ROWS_PER_TASK: usize = 8;

/// Writes row `y` of each plane: called with scratch memory, `y` and these rows.
pub(in crate::methods) type WriteRow<'a, T> = dyn Fn(&mut T, usize, &mut [&mut [f32]]) + Sync + 'a;

/// [`WriteRow`] of `N` planes.
pub(in crate::methods) type WriteRowOf<'a, const N: usize, T> =
    dyn Fn(&mut T, usize, &mut [&mut [f32]; N]) + Sync + 'a;

/// Computes `N` planes of one size row by row, rows in parallel, with progress. `row(scratch, y, planes)` writes row `y` of each
/// plane; `scratch` makes the scratch memory of a thread.
pub(in crate::methods) fn planes_from_rows<const N: usize, T>(
    (width, height): (usize, usize),
    progress: &Progress<'_>,
    scratch: &(dyn Fn() -> T + Sync),
    row: &WriteRowOf<'_, N, T>,
) -> [Plane; N] {
    let mut planes: [Plane; N] = std::array::from_fn(|_| Plane::zeros(width, height));
    let done = AtomicUsize::new(0);
    let values = planes.iter_mut().map(Plane::values_mut).collect();
    fill_rows(values, width, scratch, &|scratch, y, planes| {
        if let Some(planes) = planes.first_chunk_mut() {
            row(scratch, y, planes);
        }
        progress((done.fetch_add(1, Ordering::Relaxed) + 1) as f32 / height as f32);
    });
    planes
}

/// Fills rows of `width` values of `planes`, rows in parallel: `row(scratch, y, planes)` writes row `y` of each. `scratch` makes the scratch
/// memory of a thread.
pub(in crate::methods) fn fill_rows<T>(
    planes: Vec<&mut [f32]>,
    width: usize,
    scratch: &(dyn Fn() -> T + Sync),
    row: &WriteRow<'_, T>,
) {
    let mut planes: Vec<_> = planes.into_iter().map(|values| values.chunks_mut(width.max(1))).collect();
    let next_row = || -> Option<Vec<&mut [f32]>> { planes.iter_mut().map(Iterator::next).collect() };
    let rows = std::iter::from_fn(next_row).take_while(|rows| !rows.is_empty());
    parallel::for_each_in_tasks(ROWS_PER_TASK, rows, scratch, &|scratch, y, mut planes| {
        row(scratch, y, &mut planes);
    });
}
