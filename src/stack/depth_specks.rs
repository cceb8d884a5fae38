//! Specks of NaN in depth: single samples that a renderer failed at, in the middle of a surface.
//!
//! NaN is also how some programs write background. It is not where a file has another value for background, ten times as often, or hardly any
//! NaN at all. Then a place decides: a NaN is a speck where few are around it and no larger area of NaN is near. A speck takes the depth of that neighbour whose colour is most like its own, from its rim inwards, so that it is sharp where its
//! surroundings are.
//!
//! Cost: one read of depth; a few hundred samples for each NaN, where there are no more than specks and borders.

use super::Peel;
use super::depth::foreground;
use crate::finding::Finding;
use crate::parallel;
use crate::settings::DepthConvention;
use std::ops::Range;

/// Half the side of the square in which NaN is counted, in pixels.
const AROUND: usize = 4;
/// Most NaN in that square where there are specks alone.
const MOST: usize = 10;
/// Most NaN of the samples in a square that the picture's border cuts: one of so many.
const MOST_OF: usize = 4;
/// Distance, along rows and columns, at which a larger area of NaN says that NaN is background, in pixels.
const AREA_REACH: usize = 8;

/// One sample of so many at most is NaN where NaN is not background.
const RARE: u64 = 50;
/// The same of the samples that have another background value.
const RARE_AMONG_BACKGROUND: u64 = 10;

/// Gives the specks of NaN in `peels` the depth beside them, and says how many.
pub(super) fn repair(peels: &mut [Peel], convention: DepthConvention) -> Option<Finding> {
    let foreground = foreground(convention);
    if !is_a_fault(peels, &foreground) {
        return None;
    }
    let repaired: usize = peels.iter_mut().map(|peel| repair_peel(peel, &foreground)).sum();
    let text = format!("{repaired} specks of NaN have the depth of what is beside them");
    (repaired > 0).then(|| Finding::warning("depth", text))
}

/// Whether `peels` have NaN, and not for background. Samples count whether they are empty or not: programs write one value for both.
fn is_a_fault(peels: &[Peel], foreground: &Range<f32>) -> bool {
    let of_row = |row: &[f32]| -> [u64; 2] {
        let [mut nan, mut surfaces] = [0_u32; 2];
        for depth in row {
            nan += u32::from(depth.is_nan());
            surfaces += u32::from((*depth >= foreground.start) & (*depth < foreground.end));
        }
        [nan, surfaces].map(u64::from)
    };
    let rows =
        peels.iter().flat_map(|peel| parallel::map(peel.depth.height(), &|y| of_row(peel.depth.row(y))));
    let [nan, surfaces] = rows.fold([0; 2], |[a, b], [c, d]| [a + c, b + d]);
    let samples = peels.iter().map(|peel| peel.depth.values().len() as u64).sum::<u64>();
    let background = samples - surfaces - nan;
    nan > 0 && (nan * RARE <= samples || nan * RARE_AMONG_BACKGROUND <= background)
}

/// Repairs one peel; the number of repaired samples.
fn repair_peel(peel: &mut Peel, foreground: &Range<f32>) -> usize {
    let nan = peel.depth.values().iter().any(|depth| depth.is_nan());
    if !nan {
        return 0;
    }
    let mut specks = specks(peel);
    let mut repaired = 0;
    while !specks.is_empty() {
        // A round takes the depths that were there before it, so that the order of samples is no matter.
        let found: Vec<_> = specks.iter().map(|&place| (place, beside(peel, place, foreground))).collect();
        specks.clear();
        let before = repaired;
        for (place, depth) in found {
            match depth {
                Some(depth) => {
                    peel.depth.set(place.0, place.1, depth);
                    repaired += 1;
                }
                None => specks.push(place),
            }
        }
        if repaired == before {
            break;
        }
    }
    repaired
}

/// The fragments of NaN that are specks.
fn specks(peel: &Peel) -> Vec<(usize, usize)> {
    let (width, height) = (peel.depth.width(), peel.depth.height());
    let is_fragment = |x: usize, y: usize| peel.alpha.get(x, y) > 0.0;
    let fragments = |y: usize| {
        let row = peel.depth.row(y).iter().enumerate();
        row.filter(move |&(x, depth)| depth.is_nan() && is_fragment(x, y)).map(move |(x, _)| (x, y))
    };
    let places: Vec<(usize, usize)> = (0..height).flat_map(fragments).collect();
    // Sums of the NaN left of and above each sample: a square is counted in four reads.
    let sums = sums_of_nan(peel);
    let count = |columns: Range<usize>, rows: Range<usize>| {
        let at = |x: usize, y: usize| sums[y * (width + 1) + x];
        at(columns.end, rows.end) + at(columns.start, rows.start)
            - at(columns.start, rows.end)
            - at(columns.end, rows.start)
    };
    let around = |(x, y): (usize, usize), reach: usize| {
        let of = |at: usize, size: usize| at.saturating_sub(reach)..(at + reach + 1).min(size);
        (of(x, width), of(y, height))
    };
    let few = |place: (usize, usize)| {
        let (columns, rows) = around(place, AROUND);
        let samples = columns.len() * rows.len();
        count(columns, rows) as usize <= MOST.min(samples / MOST_OF)
    };
    let is_alone = |&place: &(usize, usize)| {
        let (columns, rows) = around(place, AREA_REACH);
        // No more than a few in all that is near need no second look.
        few(place)
            && (count(columns.clone(), rows.clone()) as usize <= MOST
                || rows
                    .into_iter()
                    .all(|y| columns.clone().all(|x| !peel.depth.get(x, y).is_nan() || few((x, y)))))
    };
    places.into_iter().filter(is_alone).collect()
}

/// For each sample and one past the ends, the number of NaN left of it and above it.
fn sums_of_nan(peel: &Peel) -> Vec<u32> {
    let (width, height) = (peel.depth.width(), peel.depth.height());
    let mut sums = vec![0; (width + 1) * (height + 1)];
    for y in 0..height {
        let mut row = 0;
        for (x, depth) in peel.depth.row(y).iter().enumerate() {
            row += u32::from(depth.is_nan());
            sums[(y + 1) * (width + 1) + x + 1] = sums[y * (width + 1) + x + 1] + row;
        }
    }
    sums
}

/// The depth of that neighbour of a sample whose colour is most like the sample's; of several the first in the order of rows.
fn beside(peel: &Peel, (x, y): (usize, usize), foreground: &Range<f32>) -> Option<f32> {
    let color = |x: usize, y: usize| peel.color.each_ref().map(|plane| plane.get(x, y));
    let own = color(x, y);
    let difference =
        |x: usize, y: usize| own.into_iter().zip(color(x, y)).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    let rows = y.saturating_sub(1)..(y + 2).min(peel.depth.height());
    let columns = x.saturating_sub(1)..(x + 2).min(peel.depth.width());
    let places = rows.flat_map(|y| columns.clone().map(move |x| (x, y)));
    let known =
        places.filter(|&(x, y)| peel.alpha.get(x, y) > 0.0 && foreground.contains(&peel.depth.get(x, y)));
    let nearest = known.min_by(|a, b| difference(a.0, a.1).total_cmp(&difference(b.0, b.1)));
    nearest.map(|(x, y)| peel.depth.get(x, y))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;

    /// A wall at 4 left of column 20 and one at 9 right of it, in two colours; NaN where `is_nan` says so.
    fn walls(is_nan: impl Fn(usize, usize) -> bool) -> Peel {
        let plane = |value: &dyn Fn(usize, usize) -> f32| Plane::from_fn(40, 30, value);
        Peel {
            color: std::array::from_fn(|_| plane(&|x, _| if x < 20 { 0.8 } else { 0.1 })),
            alpha: plane(&|_, _| 1.0),
            depth: plane(&|x, y| match is_nan(x, y) {
                true => f32::NAN,
                false if x < 20 => 4.0,
                false => 9.0,
            }),
        }
    }

    #[test]
    fn specks_have_the_depth_of_their_surface_wherever_they_are() {
        let at =
            [(5, 5), (0, 0), (39, 29), (19, 12), (20, 12), (10, 20), (11, 20), (10, 21), (11, 21), (12, 22)];
        let mut peels = [walls(|x, y| at.contains(&(x, y)))];
        let finding = repair(&mut peels, DepthConvention::Planar).unwrap();
        assert!(finding.warning && finding.text.starts_with("10 specks"), "{}", finding.text);
        assert_eq!(peels[0], walls(|_, _| false));
    }

    #[test]
    fn nan_is_background_where_it_is_the_only_background() {
        let is_sky = |x: usize, y: usize| y < 5 || [(12, 20), (30, 25)].contains(&(x, y));
        let mut peels = [walls(is_sky)];
        assert_eq!(repair(&mut peels, DepthConvention::Planar), None);
        peels[0].depth.values_mut()[..5 * 40].fill(1e10);
        let finding = repair(&mut peels, DepthConvention::Planar).unwrap();
        assert!(finding.text.starts_with("2 specks"), "{}", finding.text);
    }

    #[test]
    fn an_area_of_nan_is_background_with_its_tips() {
        // A triangle of NaN, one pixel wide at its tip.
        let is_nan = |x: usize, y: usize| (8..14).contains(&y) && x.abs_diff(10) <= (y - 8) / 2;
        let mut peels = [walls(is_nan)];
        assert_eq!(repair(&mut peels, DepthConvention::Planar), None);
        assert!(peels[0].depth.get(10, 8).is_nan());
    }

    #[test]
    fn a_seam_of_nan_between_surfaces_is_closed() {
        let mut peels = [walls(|x, y| x == 19 && (3..23).contains(&y))];
        assert!(repair(&mut peels, DepthConvention::Planar).is_some());
        assert_eq!(peels[0], walls(|_, _| false));
    }
}
