//! Computes planes row by row, in parallel.

use crate::image::Plane;
use crate::methods::contract::Progress;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Computes `N` planes of one size row by row, rows in parallel, with progress. `row(scratch, y, planes)` writes row `y` of each
/// plane; `scratch` makes the scratch memory of a thread.
pub(in crate::methods) fn planes_from_rows<const N: usize, T>(
    (width, height): (usize, usize),
    progress: &Progress<'_>,
    scratch: impl Fn() -> T + Sync + Send,
    row: impl Fn(&mut T, usize, &mut [&mut [f32]; N]) + Sync + Send,
) -> [Plane; N] {
    let mut planes: [Plane; N] = std::array::from_fn(|_| Plane::zeros(width, height));
    let mut rests = planes.each_mut().map(Plane::values_mut);
    let rows: Vec<[&mut [f32]; N]> = (0..height)
        .map(|_| {
            rests.each_mut().map(|rest| {
                let (first, others) = std::mem::take(rest).split_at_mut(width);
                *rest = others;
                first
            })
        })
        .collect();
    let done = AtomicUsize::new(0);
    rows.into_par_iter().enumerate().for_each_init(scratch, |scratch, (y, mut planes)| {
        row(scratch, y, &mut planes);
        progress((done.fetch_add(1, Ordering::Relaxed) + 1) as f32 / height as f32);
    });
    planes
}
