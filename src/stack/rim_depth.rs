//! The depth of fragments of fractional alpha that have background depth: sky, or the rim of a surface.
//!
//! A renderer that filters colour and alpha does not filter depth: at a surface's rim, where the pixel's centre misses it, there is
//! colour without depth. Sky that shares a pixel with a surface looks the same. Each fragment is decided by what is beside it: it is
//! sky where the sky goes on, in its peel or a nearer one, where it is one of a wide area far from surfaces, or where it is exactly what the
//! fragments before it leave of the pixel; else it has the depth
//! of the nearest surface of its peel, or, where there is none, of the fragment before it in its pixel.
//!
//! Cost: one read of alpha and depth, and some sixty samples for each such fragment.

use super::Peel;
use super::depth::foreground;
use super::silhouettes::{ALPHA_ROUNDING, RIM_SAMPLES};
use crate::finding::Finding;
use crate::parallel;
use crate::settings::DepthConvention;
use pulp::Arch;
use std::ops::Range;

/// Sets the depth of fragments of fractional alpha and background depth that belong to a surface, and says so.
///
/// Not for peels that are known to be coverage: a fragment of theirs has background depth only if all its samples are background.
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
        let depths = surface_depths(&peels[..=i], &depthless, &foreground, &mut sky);
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
        "{completed} fragments of fractional alpha without depth have that of a surface beside or before them{advice}; \
         {kept} beside sky, or without a surface near, stay background"
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
    let arch = Arch::new();
    let row = |y: usize| peel.alpha.row(y).iter().zip(peel.depth.row(y));
    // Most rows have none: one loop without branches says so.
    let any = |y: usize| row(y).fold(false, |any, (alpha, depth)| any | is_depthless(*alpha, *depth));
    let of_row = |y: usize| {
        if !arch.dispatch(|| any(y)) {
            return Vec::new();
        }
        let found = row(y).enumerate().filter(|(_, (alpha, depth))| is_depthless(**alpha, **depth));
        found.map(|(x, _)| (x, y)).collect()
    };
    parallel::flat_map(peel.alpha.height(), &of_row)
}

/// Adds the opaque fragments of background depth to `sky`, which has one entry for each sample.
fn mark_opaque_sky(peel: &Peel, foreground: &Range<f32>, sky: &mut [bool]) {
    let samples = peel.alpha.values().iter().zip(peel.depth.values());
    for (sky, (&alpha, depth)) in sky.iter_mut().zip(samples) {
        *sky |= (alpha >= 1.0 - ALPHA_ROUNDING) & !foreground.contains(depth);
    }
}

/// The depth of the surface that each of the `depthless` fragments of the last of `peels` belongs to; `None` for sky, which is added
/// to `sky`, and for fragments without a surface beside them or before them.
fn surface_depths(
    peels: &[Peel],
    depthless: &[(usize, usize)],
    foreground: &Range<f32>,
    sky: &mut [bool],
) -> Vec<Option<f32>> {
    let Some((peel, before)) = peels.split_last() else { return Vec::new() };
    let width = peel.alpha.width();
    for &(x, y) in depthless {
        sky[y * width + x] |= is_the_rest(peel, before, x, y);
    }
    let mut depths = parallel::map_in_blocks(depthless.len(), |i| {
        let (x, y) = depthless[i];
        nearest_depth(peel, foreground, x, y)
    });
    for (&(x, y), depth) in depthless.iter().zip(&mut depths) {
        if depth.is_none() && is_wide(peel, foreground, x, y) {
            sky[y * width + x] = true;
        } else if depth.is_none() {
            *depth = last_depth(before, foreground, x, y);
        }
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

/// The places within `reach` of one, in the picture.
pub(super) fn around(
    peel: &Peel,
    x: usize,
    y: usize,
    reach: usize,
) -> impl Iterator<Item = (usize, usize)> + use<> {
    let within = |at: usize, size: usize| at.saturating_sub(reach)..(at + reach + 1).min(size);
    let (columns, rows) = (within(x, peel.alpha.width()), within(y, peel.alpha.height()));
    rows.flat_map(move |row| columns.clone().map(move |column| (column, row)))
}

/// Whether the alpha of a fragment is what those `before` it leave of the pixel, as it is in coverage peels.
fn is_the_rest(peel: &Peel, before: &[Peel], x: usize, y: usize) -> bool {
    let sum: f32 = before.iter().map(|peel| peel.alpha.get(x, y)).sum();
    sum > ALPHA_ROUNDING && (sum + peel.alpha.get(x, y) - 1.0).abs() <= ALPHA_ROUNDING
}

/// Whether all eight samples around a place have a fragment of background depth.
fn is_wide(peel: &Peel, foreground: &Range<f32>, x: usize, y: usize) -> bool {
    around(peel, x, y, 1)
        .all(|(x, y)| peel.alpha.get(x, y) > 0.0 && !foreground.contains(&peel.depth.get(x, y)))
}

/// Depth of the last fragment with depth that a pixel has in `peels`.
fn last_depth(peels: &[Peel], foreground: &Range<f32>, x: usize, y: usize) -> Option<f32> {
    let fragments = peels.iter().rev().filter(|peel| peel.alpha.get(x, y) > 0.0);
    fragments.map(|peel| peel.depth.get(x, y)).find(|depth| foreground.contains(depth))
}

/// Whether one of the eight samples around a place is `sky`.
fn touches(sky: &[bool], peel: &Peel, (x, y): (usize, usize)) -> bool {
    around(peel, x, y, 1).any(|(x, y)| sky[y * peel.alpha.width() + x])
}

/// Depth of the fragment with depth that is nearest to a place in the picture, within the width of a rim.
fn nearest_depth(peel: &Peel, foreground: &Range<f32>, x: usize, y: usize) -> Option<f32> {
    let distance = |(column, row): (usize, usize)| column.abs_diff(x).pow(2) + row.abs_diff(y).pow(2);
    let with_depth = around(peel, x, y, RIM_SAMPLES).filter(|&(column, row)| {
        peel.alpha.get(column, row) > 0.0 && foreground.contains(&peel.depth.get(column, row))
    });
    with_depth.min_by_key(|&place| distance(place)).map(|(column, row)| peel.depth.get(column, row))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;

    /// A row of fragments, `(alpha, depth)` each.
    fn peel(fragments: &[(f32, f32)]) -> Peel {
        let plane = |value: &dyn Fn((f32, f32)) -> f32| {
            Plane::from_fn(fragments.len(), 1, |x, _| value(fragments[x]))
        };
        let alpha = plane(&|(alpha, _)| alpha);
        Peel { color: std::array::from_fn(|_| alpha.clone()), depth: plane(&|(_, depth)| depth), alpha }
    }

    const SKY: f32 = 1e10;
    const EMPTY: (f32, f32) = (0.0, SKY);

    /// The depths of the last of `peels`, completed.
    fn completed(mut peels: Vec<Peel>) -> Vec<f32> {
        complete(&mut peels, DepthConvention::Planar);
        peels.last().unwrap().depth.row(0).to_vec()
    }

    #[test]
    fn the_rim_of_a_surface_has_its_depth() {
        let rim = peel(&[(0.5, SKY), (1.0, 4.0), (0.7, SKY), (0.2, SKY), EMPTY, EMPTY]);
        assert_eq!(completed(vec![rim]), [4.0, 4.0, 4.0, 4.0, SKY, SKY]);
    }

    #[test]
    fn sky_beside_a_surface_stays_sky() {
        let own = peel(&[(1.0, 4.0), (0.5, SKY), (1.0, SKY), (1.0, SKY)]);
        assert_eq!(completed(vec![own]), [4.0, SKY, SKY, SKY], "it goes on in its own peel");
        let front = peel(&[(1.0, 2.0), (0.5, 2.0), (1.0, SKY)]);
        let behind = peel(&[(1.0, 4.0), (0.5, SKY), EMPTY]);
        assert_eq!(completed(vec![front, behind]), [4.0, SKY, SKY], "it goes on in the nearer peel");
    }

    #[test]
    fn what_the_fragments_before_it_leave_of_a_pixel_is_sky() {
        let front = peel(&[(1.0, 2.0), (0.25, 2.0), (1.0, 2.0)]);
        let behind = |alpha| peel(&[(1.0, 4.0), (alpha, SKY), (1.0, 4.0)]);
        assert_eq!(completed(vec![front.clone(), behind(0.75)])[1], SKY, "no sky beside it");
        assert_eq!(
            completed(vec![front, behind(0.5)])[1],
            4.0,
            "half of a pixel of which three quarters are left"
        );
    }

    #[test]
    fn a_wide_area_without_depth_stays_background_up_to_the_surface_beside_it() {
        let smoke = peel(&[&[(1.0, 4.0)][..], &[(0.3, SKY); 9]].concat());
        assert_eq!(completed(vec![smoke])[1..], [SKY; 9]);
    }

    #[test]
    fn a_speck_without_a_surface_beside_it_has_the_depth_of_what_is_before_it() {
        let front = peel(&[(1.0, 2.0), (1.0, 2.5), (1.0, 3.0)]);
        let speck = peel(&[EMPTY, (0.3, SKY), EMPTY]);
        assert_eq!(completed(vec![front, speck.clone()]), [SKY, 2.5, SKY]);
        assert_eq!(completed(vec![speck]), [SKY; 3], "nothing is before it: it is kept, as background");
    }

    #[test]
    fn colour_and_alpha_are_not_touched_and_the_change_is_said() {
        let mut peels = [peel(&[(1.0, 4.0), (0.5, SKY), EMPTY])];
        let before = peels.clone();
        let finding = complete(&mut peels, DepthConvention::Planar).unwrap();
        assert!(finding.text.starts_with("1 fragments of fractional alpha"), "{}", finding.text);
        assert_eq!((&peels[0].alpha, &peels[0].color), (&before[0].alpha, &before[0].color));
        assert_eq!(complete(&mut peels, DepthConvention::Planar), None, "nothing is left to complete");
    }
}
