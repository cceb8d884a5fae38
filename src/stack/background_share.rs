//! Background that shares a pixel with surfaces, in coverage peels.
//!
//! A coverage peel's alpha is the share of the pixel that its fragment has. At the edge of an object before the sky, the sky's alpha is the
//! share that the object leaves. But the sky does not end at the edge: it continues behind the object, and a lens ray that passes the
//! object meets it in full. So such a fragment gets the opacity of the background: its share over what the surfaces before it leave of the
//! pixel, at most 1. Where the background alone is seen nearby, it is no more opaque than there.
//!
//! Where colours are point samples, alpha is opacity already, and nothing changes; between the two, in proportion.
//!
//! Cost: one read of alpha and depth, and some fifty samples for each such fragment.

use super::antialiasing::Antialiasing;
use super::depth::foreground;
use super::silhouettes::{ALPHA_ROUNDING, RIM_SAMPLES};
use super::{Peel, rim_depth};
use crate::finding::Finding;
use crate::parallel;
use crate::settings::DepthConvention;
use std::ops::Range;

/// Smallest share of a pixel that a background seen through it is taken to have: that of a sample of 8 × 8.
const MIN_SHARE: f32 = 1.0 / 64.0;

/// How much it counts that background is opaque, against one pixel nearby that shows it alone.
const OPAQUE_WEIGHT: f32 = 0.05;

/// The background in one pixel.
#[derive(Debug, Clone, Copy, Default)]
struct Seen {
    /// Index of its peel.
    peel: usize,
    /// Its alpha; 0 where there is none.
    alpha: f32,
    /// Sum of the alphas before it, at most 1.
    before: f32,
}

impl Seen {
    /// Its opacity, if alpha is a share of the pixel.
    fn opacity(self) -> f32 {
        (self.alpha / (1.0 - self.before).max(MIN_SHARE)).min(1.0)
    }
}

/// Gives the background its opacity where it shares a pixel with surfaces, and says so.
pub(super) fn complete(
    peels: &mut [Peel],
    convention: DepthConvention,
    antialiasing: &Antialiasing,
) -> Option<Finding> {
    let foreground = foreground(convention);
    let height = peels.first().map_or(0, |peel| peel.alpha.height());
    let of_row = |y: usize| completed_row(peels, &foreground, antialiasing, y);
    let completed: Vec<(usize, usize, Seen, f32)> = parallel::flat_map(height, &of_row);
    for &(x, y, Seen { peel, alpha, .. }, whole) in &completed {
        let peel = &mut peels[peel];
        peel.alpha.set(x, y, whole);
        peel.color.iter_mut().for_each(|plane| plane.set(x, y, plane.get(x, y) * (whole / alpha)));
    }
    let text = format!(
        "{} fragments of background share their pixel with surfaces: the background continues behind these",
        completed.len()
    );
    (!completed.is_empty()).then(|| Finding::note("background", text))
}

/// The pixels of row `y` whose background changes: column, background, and its alpha from now on.
fn completed_row(
    peels: &[Peel],
    foreground: &Range<f32>,
    antialiasing: &Antialiasing,
    y: usize,
) -> Vec<(usize, usize, Seen, f32)> {
    let width = peels.first().map_or(0, |peel| peel.alpha.width());
    let mut completed = Vec::new();
    for x in 0..width {
        let averaged = antialiasing.at(x, y);
        let seen = if averaged > 0.0 { background(peels, foreground, x, y) } else { Seen::default() };
        if seen.alpha <= 0.0 || seen.before <= 0.0 || seen.opacity() <= seen.alpha {
            continue;
        }
        let opacity = seen.opacity().min(opacity_beside(peels, foreground, x, y));
        let whole = seen.alpha + averaged * (opacity - seen.alpha).max(0.0);
        if whole > seen.alpha {
            completed.push((x, y, seen, whole));
        }
    }
    completed
}

/// The first fragment of background depth of a pixel.
fn background(peels: &[Peel], foreground: &Range<f32>, x: usize, y: usize) -> Seen {
    let mut before = 0.0;
    for (peel, planes) in peels.iter().enumerate() {
        let alpha = planes.alpha.get(x, y);
        if alpha > 0.0 && !foreground.contains(&planes.depth.get(x, y)) {
            return Seen { peel, alpha, before: f32::min(before, 1.0) };
        }
        before += alpha;
    }
    Seen::default()
}

/// Opacity of the background around a pixel: that of the pixels that show little else, 1 without any.
fn opacity_beside(peels: &[Peel], foreground: &Range<f32>, x: usize, y: usize) -> f32 {
    let (mut sum, mut weights) = (OPAQUE_WEIGHT, OPAQUE_WEIGHT);
    for (column, row) in rim_depth::around(&peels[0], x, y, RIM_SAMPLES) {
        let seen = background(peels, foreground, column, row);
        let weight = if seen.alpha > 0.0 { (1.0 - 2.0 * seen.before).max(0.0) } else { 0.0 };
        sum += weight * seen.opacity();
        weights += weight;
    }
    let opacity = sum / weights;
    // Half floats round alpha: what is opaque to within that is opaque.
    if opacity >= 1.0 - ALPHA_ROUNDING { 1.0 } else { opacity }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;

    const SKY: f32 = 1e10;
    const EMPTY: (f32, f32) = (0.0, SKY);

    /// A row of fragments, `(alpha, depth)` each, all of the colour 0.5.
    fn peel(fragments: &[(f32, f32)]) -> Peel {
        let plane = |value: &dyn Fn((f32, f32)) -> f32| {
            Plane::from_fn(fragments.len(), 1, |x, _| value(fragments[x]))
        };
        let alpha = plane(&|(alpha, _)| alpha);
        let color = std::array::from_fn(|_| plane(&|(alpha, _)| 0.5 * alpha));
        Peel { color, depth: plane(&|(_, depth)| depth), alpha }
    }

    /// The alphas of the last of `peels`, completed.
    fn completed(mut peels: Vec<Peel>, antialiasing: &Antialiasing) -> Vec<f32> {
        complete(&mut peels, DepthConvention::Planar, antialiasing);
        let last = peels.last().unwrap();
        for (&alpha, &color) in last.alpha.row(0).iter().zip(last.color[0].row(0)) {
            assert!((color - 0.5 * alpha).abs() < 1e-6, "colour stays premultiplied: {color} of {alpha}");
        }
        last.alpha.row(0).to_vec()
    }

    #[test]
    fn the_sky_at_an_edge_is_opaque_whatever_share_of_the_pixel_it_has() {
        let front = peel(&[(1.0, 4.0), (0.75, 4.0), (0.25, 4.0), (1.0, SKY)]);
        let seen = peel(&[EMPTY, (0.25, SKY), (0.75, SKY), EMPTY]);
        assert_eq!(completed(vec![front.clone(), seen], &Antialiasing::AVERAGES), [0.0, 1.0, 1.0, 0.0]);
        let behind = peel(&[(1.0, SKY), (0.5, SKY), (1.0, SKY), EMPTY]);
        assert_eq!(completed(vec![front, behind], &Antialiasing::AVERAGES), [1.0, 1.0, 1.0, 0.0]);
    }

    #[test]
    fn a_background_that_is_not_opaque_alone_is_not_behind_an_object() {
        let haze = [(0.3, SKY); 8];
        let front = peel(&[&haze[..], &[(0.5, 4.0), (1.0, 4.0)]].concat());
        let behind = peel(&[&[EMPTY; 8][..], &[(0.3, SKY), (0.3, SKY)]].concat());
        let found = completed(vec![front, behind], &Antialiasing::AVERAGES);
        assert!(found[8..].iter().all(|&alpha| (0.3..0.32).contains(&alpha)), "{found:?}");
    }

    #[test]
    fn where_colours_are_point_samples_alpha_is_opacity_and_stays() {
        let front = peel(&[(0.5, 4.0), (0.5, 4.0), (1.0, SKY)]);
        let behind = peel(&[(0.25, SKY), (0.25, SKY), EMPTY]);
        let share = Antialiasing::by_pixel(Plane::from_fn(3, 1, |x, _| [0.0, 0.5, 1.0][x]));
        assert_eq!(completed(vec![front, behind], &share), [0.25, 0.375, 0.0], "halfway from 0.25 to 0.5");
    }

    #[test]
    fn a_pixel_that_shows_nothing_but_background_keeps_its_alpha() {
        let mut peels = [peel(&[(0.4, SKY), (1.0, SKY)]), peel(&[EMPTY, EMPTY])];
        let before = peels.clone();
        assert_eq!(complete(&mut peels, DepthConvention::Planar, &Antialiasing::AVERAGES), None);
        assert_eq!(peels, before);
    }
}
