//! The squares in which pictures differ most.

use super::picture::{Picture, Square};
use crate::image::Plane;
use crate::parallel;

/// Width and height of a crop in pixels, for pictures that are not small.
const SIDE_PX: usize = 96;

/// The crops of a small picture are its shorter side divided by this.
const SMALL_PICTURE_DIVISOR: usize = 4;

/// Maximum number of crops.
const MAX_CROPS: usize = 6;

/// The squares in which `pictures`, all of one size, differ most from one another. They do not overlap, and are spread over the
/// picture as far as possible. Squares without any difference are left out.
pub(super) fn places(pictures: &[&Picture]) -> Vec<Square> {
    let Some(first) = pictures.first() else { return Vec::new() };
    let side = SIDE_PX.min(first.width().min(first.height()) / SMALL_PICTURE_DIVISOR);
    if side == 0 { Vec::new() } else { spread(&candidates(&variance(pictures), side), side, first.width()) }
}

/// Variance among `pictures` at each pixel, summed over the channels.
fn variance(pictures: &[&Picture]) -> Plane {
    let (width, height) = pictures.first().map_or((0, 0), |picture| (picture.width(), picture.height()));
    let count = pictures.len() as f32;
    let mut variance = Plane::zeros(width, height);
    parallel::for_each_row(variance.values_mut(), width, &|y, row| {
        let rows: Vec<&[u16]> = pictures.iter().map(|picture| picture.row(y)).collect();
        for (x, value) in row.iter_mut().enumerate() {
            for i in 3 * x..3 * x + 3 {
                let mean = rows.iter().map(|row| f32::from(row[i])).sum::<f32>() / count;
                *value += rows.iter().map(|row| (f32::from(row[i]) - mean).powi(2)).sum::<f32>() / count;
            }
        }
    });
    variance
}

/// Every square with a difference, on a grid of half its side, the largest difference first.
fn candidates(variance: &Plane, side: usize) -> Vec<Square> {
    let step = (side / 2).max(1);
    let starts = |length: usize| (0..(length + 1).saturating_sub(side)).step_by(step);
    let squares =
        starts(variance.height()).flat_map(|y| starts(variance.width()).map(move |x| Square { x, y, side }));
    let mut found: Vec<(f64, Square)> =
        squares.map(|square| (sum(variance, square), square)).filter(|(sum, _)| *sum > 0.0).collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.into_iter().map(|(_, square)| square).collect()
}

fn sum(plane: &Plane, square: Square) -> f64 {
    let rows = (square.y..square.y + square.side).map(|y| &plane.row(y)[square.x..square.x + square.side]);
    rows.flatten().map(|&value| f64::from(value)).sum()
}

/// The first of `candidates` that lie far apart. If these are too few, squares nearer to one another follow, never overlapping ones.
fn spread(candidates: &[Square], side: usize, width: usize) -> Vec<Square> {
    let mut chosen: Vec<Square> = Vec::new();
    for distance in [(width / 5).max(2 * side), 2 * side, side] {
        for square in candidates {
            let apart =
                |other: &Square| square.x.abs_diff(other.x).max(square.y.abs_diff(other.y)) >= distance;
            if chosen.len() < MAX_CROPS && chosen.iter().all(apart) {
                chosen.push(*square);
            }
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;

    /// A grey picture with a white square at each of `places`.
    fn with_spots(places: &[(usize, usize)]) -> Picture {
        Picture::new(&Image::from_fn(640, 400, |x, y| {
            let lit = places.iter().any(|&(px, py)| (px..px + 20).contains(&x) && (py..py + 20).contains(&y));
            [if lit { 1.0 } else { 0.2 }; 4]
        }))
    }

    #[test]
    fn only_squares_in_which_pictures_differ_are_chosen() {
        let spots = [(100, 60), (500, 60), (300, 300)];
        let places = places(&[&with_spots(&[]), &with_spots(&spots)]);
        for (x, y) in spots {
            let holds = |square: &Square| {
                (square.x..=square.x + square.side - 20).contains(&x)
                    && (square.y..=square.y + square.side - 20).contains(&y)
            };
            assert!(places.iter().any(holds), "({x}, {y}) in {places:?}");
        }
        for square in &places {
            let shows = |&(x, y): &(usize, usize)| {
                square.x < x + 20
                    && x < square.x + square.side
                    && square.y < y + 20
                    && y < square.y + square.side
            };
            assert!(spots.iter().any(shows), "{square:?} shows no difference");
        }
    }

    #[test]
    fn squares_never_overlap_and_lie_inside_the_picture() {
        let mut rng = fastrand::Rng::with_seed(1);
        for (width, height) in [(640, 360), (97, 40), (33, 200), (9, 9)] {
            let values: Vec<f32> = (0..2 * width * height).map(|_| rng.f32()).collect();
            let noise =
                |k: usize| Image::from_fn(width, height, |x, y| [values[(k * height + y) * width + x]; 4]);
            let places = places(&[&Picture::new(&noise(0)), &Picture::new(&noise(1))]);
            assert!((4..=MAX_CROPS).contains(&places.len()), "{width}×{height}: {places:?}");
            for (i, a) in places.iter().enumerate() {
                assert!(a.x + a.side <= width && a.y + a.side <= height);
                for b in &places[..i] {
                    assert!(a.x.abs_diff(b.x) >= a.side || a.y.abs_diff(b.y) >= a.side, "{a:?} {b:?}");
                }
            }
        }
    }

    #[test]
    fn equal_pictures_have_no_crops() {
        assert_eq!(places(&[&with_spots(&[(5, 5)]), &with_spots(&[(5, 5)])]), []);
        assert_eq!(places(&[]), []);
    }
}
