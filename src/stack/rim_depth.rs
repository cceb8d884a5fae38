//! The depth of fragments of fractional alpha that have background depth: sky, or the rim of a surface.
//!
//! A renderer that filters colour and alpha does not filter depth: at a surface's rim, where the pixel's centre misses it, there is
//! colour without depth. Sky that shares a pixel with a surface looks the same. Each fragment is decided by what is beside it: it is
//! sky where the sky goes on, in its peel or a nearer one, or where it is one of a wide area; else it has the depth of the nearest
//! surface of its peel.
//!
//! Cost: one read of alpha and depth, and some forty samples for each such fragment.

use super::Peel;
use super::depth::foreground;
use super::silhouettes::{ALPHA_ROUNDING, RIM_SAMPLES};
use crate::finding::Finding;
use crate::settings::DepthConvention;
use rayon::prelude::*;
use std::ops::Range;

/// Sets the depth of fragments of fractional alpha and background depth that belong to a surface, and says so.
pub(super) fn complete(peels: &mut [Peel], convention: DepthConvention) -> Option<Finding> {
    let foreground = foreground(convention);
    let (mut completed, mut kept) = (0, 0);
    let mut sky = Vec::new();
    let several = peels.len() > 1;
    for i in 0..peels.len() {
        let depthless = depthless(&peels[i], &foreground);
        if depthless.is_empty() {
            continue;
        }
        if sky.is_empty() {
            sky = vec![false; peels[i].alpha.values().len()];
        }
        peels[..=i].iter().for_each(|peel| mark_opaque_sky(peel, &foreground, &mut sky));
        let depths = surface_depths(&peels[i], &depthless, &foreground, &mut sky);
        for (&(x, y), depth) in depthless.iter().zip(depths) {
            match depth {
                Some(depth) => {
                    peels[i].depth.set(x, y, depth);
                    completed += 1;
                }
                None => kept += 1,
            }
        }
    }
    let advice = if several {
        "; colour was filtered and depth was not: for cleaner edges export point-sampled peels at 2× or more, or coverage peels"
    } else {
        ""
    };
    let text = format!(
        "{completed} fragments of fractional alpha without depth have that of the surface beside them{advice}; {kept} \
         beside sky, or without a surface near, stay background"
    );
    (completed > 0).then(
        || {
            if several { Finding::warning("depth", text) } else { Finding::note("depth", text) }
        },
    )
}

/// The fragments of fractional alpha and background depth, row by row.
fn depthless(peel: &Peel, foreground: &Range<f32>) -> Vec<(usize, usize)> {
    let is_depthless = |alpha: f32, depth: f32| {
        (alpha > 0.0) & (alpha < 1.0 - ALPHA_ROUNDING) & !foreground.contains(&depth)
    };
    let of_row = |y: usize| {
        let row = peel.alpha.row(y).iter().zip(peel.depth.row(y)).enumerate();
        row.filter(|(_, (alpha, depth))| is_depthless(**alpha, **depth)).map(move |(x, _)| (x, y))
    };
    (0..peel.alpha.height()).into_par_iter().flat_map_iter(of_row).collect()
}

/// Adds the opaque fragments of background depth to `sky`, which has one entry for each sample.
fn mark_opaque_sky(peel: &Peel, foreground: &Range<f32>, sky: &mut [bool]) {
    let samples = peel.alpha.values().iter().zip(peel.depth.values());
    for (sky, (&alpha, depth)) in sky.iter_mut().zip(samples) {
        *sky |= (alpha >= 1.0 - ALPHA_ROUNDING) & !foreground.contains(depth);
    }
}

/// The depth of the surface that each of the `depthless` fragments belongs to; `None` for sky, which is added to `sky`.
fn surface_depths(
    peel: &Peel,
    depthless: &[(usize, usize)],
    foreground: &Range<f32>,
    sky: &mut [bool],
) -> Vec<Option<f32>> {
    let width = peel.alpha.width();
    let mut depths: Vec<Option<f32>> =
        depthless.par_iter().map(|&(x, y)| nearest_depth(peel, foreground, x, y)).collect();
    for (&(x, y), depth) in depthless.iter().zip(&depths) {
        sky[y * width + x] |= depth.is_none();
    }
    for _ in 0..RIM_SAMPLES {
        let joins: Vec<usize> = (0..depthless.len())
            .filter(|&i| depths[i].is_some() && touches(sky, peel, depthless[i]))
            .collect();
        for i in joins {
            let (x, y) = depthless[i];
            depths[i] = None;
            sky[y * width + x] = true;
        }
    }
    depths
}

/// Whether one of the eight samples around a place is `sky`.
fn touches(sky: &[bool], peel: &Peel, (x, y): (usize, usize)) -> bool {
    let (width, height) = (peel.alpha.width(), peel.alpha.height());
    let columns = x.saturating_sub(1)..(x + 2).min(width);
    (y.saturating_sub(1)..(y + 2).min(height)).any(|y| sky[y * width..][columns.clone()].contains(&true))
}

/// Depth of the fragment with depth that is nearest to a place in the picture, within the width of a rim.
fn nearest_depth(peel: &Peel, foreground: &Range<f32>, x: usize, y: usize) -> Option<f32> {
    let (width, height) = (peel.alpha.width(), peel.alpha.height());
    let columns = x.saturating_sub(RIM_SAMPLES)..(x + RIM_SAMPLES + 1).min(width);
    let rows = y.saturating_sub(RIM_SAMPLES)..(y + RIM_SAMPLES + 1).min(height);
    let places = rows.flat_map(|row| columns.clone().map(move |column| (column, row)));
    let distance = |(column, row): (usize, usize)| column.abs_diff(x).pow(2) + row.abs_diff(y).pow(2);
    let with_depth = places.filter(|&(column, row)| {
        peel.alpha.get(column, row) > 0.0 && foreground.contains(&peel.depth.get(column, row))
    });
    with_depth.min_by_key(|&place| distance(place)).map(|(column, row)| peel.depth.get(column, row))
}
