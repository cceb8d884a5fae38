//! Lens samples: pairs of a point on the aperture and a point within the pixel, evenly spread in both jointly.
//!
//! The tables hold, for 8, 12, 16, 24 … 1024 views, point sets `(u, j)` optimised so that `j + c·u` is evenly spread along every
//! direction for every CoC radius `c` from 0 (the pixel alone) to ∞ (the lens alone): sliced optimal transport after
//! Paulin et al. 2020, "Sliced Optimal Transport Sampling". The order of each table makes its prefixes evenly spread as well. For the rows
//! of a picture that take turns there are further pixel points for the same lens points, optimised in the same way.
//! `examples/view_tables.rs` computes all of them.

use super::Aperture;
use glam::Vec2;
use std::ops::RangeInclusive;

/// One lens sample: a point on the aperture and a point within the pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Point on the aperture, in units of its radius.
    pub lens: Vec2,
    /// Offset from the pixel centre, −½ … ½.
    pub jitter: Vec2,
    /// Shift of the ray in the picture by aberrations, in pixels.
    pub shift: Vec2,
}

/// Sizes of the tables: powers of two, and halfway between them.
const SIZES: [usize; 15] = [8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024];

/// The tables, one after the other; a point is `u_x, u_y, j_x, j_y`, little-endian.
static TABLES: &[u8] = include_bytes!("view_tables.bin");

/// Bytes of a point.
const POINT: usize = 4 * size_of::<f32>();

/// Number of sets of views that the rows of a picture take turns with.
pub(crate) const ROW_SETS: usize = 8;

/// Numbers of views for which rows take turns: with fewer, rows would differ visibly from one another, and more have steps too small to be
/// seen.
const IN_TURNS: RangeInclusive<usize> = 32..=1024;

/// The pixel points of sets 1, 2, … for the lens points of each table whose size is [`IN_TURNS`], one table after the other; a point is
/// `j_x, j_y`, little-endian.
static ROW_TABLES: &[u8] = include_bytes!("row_tables.bin");

/// Bytes of a pixel point.
const PIXEL_POINT: usize = 2 * size_of::<f32>();

/// `count` views of `aperture`, evenly spread.
///
/// A count that is not the size of a table takes a prefix of the next larger table. Past the largest table, that one is repeated with
/// rotated lens points and shifted pixel points.
pub fn views(count: usize, aperture: Aperture) -> Vec<View> {
    let (smaller, size) = table_for(count);
    let table = &TABLES[smaller.iter().sum::<usize>() * POINT..][..size * POINT];
    (0..count)
        .map(|i| {
            let view = point(table, i % size);
            let turned = turn(view, i / size);
            View { lens: aperture.warp_disc(turned.lens), ..turned }
        })
        .collect()
}

/// The sizes of the tables before the one that has `count` views, and its size.
fn table_for(count: usize) -> (&'static [usize], usize) {
    let index = SIZES.iter().position(|&size| size >= count).unwrap_or(SIZES.len() - 1);
    (&SIZES[..index], SIZES[index])
}

/// Point `i` of a table.
fn point(table: &[u8], i: usize) -> View {
    let pair = |k: usize| vector(table, 2 * i + k);
    View { lens: pair(0), jitter: pair(1), shift: Vec2::ZERO }
}

/// Vector `i` of a list of vectors.
fn vector(list: &[u8], i: usize) -> Vec2 {
    let value = |k: usize| {
        let start = (2 * i + k) * size_of::<f32>();
        list[start..start + 4].try_into().map_or(0.0, f32::from_le_bytes)
    };
    Vec2::new(value(0), value(1))
}

/// The `round`-th variant of a view: the lens point rotated by golden angles, the pixel point shifted by a Kronecker sequence.
fn turn(view: View, round: usize) -> View {
    if round == 0 {
        return view;
    }
    let golden_angle = std::f32::consts::PI * (3.0 - 5f32.sqrt());
    let shift = Vec2::new(0.754_877_7, 0.569_840_3) * round as f32;
    moved(view, golden_angle * round as f32, shift)
}

/// `view` with its lens point rotated by `angle`, and its pixel point moved by `shift` with wrap-around.
fn moved(view: View, angle: f32, shift: Vec2) -> View {
    let jitter = (view.jitter + 0.5 + shift).fract_gl() - 0.5;
    View { lens: Vec2::from_angle(angle).rotate(view.lens), jitter, ..view }
}

/// `count` views of a disc for each of the sets that the rows of a picture take turns with: one set for a number of views that does not
/// take turns. The first is that of [`views`], and the lens points of all sets are the same.
///
/// As the CoC radius changes, each view moves a whole picture by a pixel at a time. In turns a step moves one row of eight.
pub(super) fn views_in_turns(count: usize) -> Vec<Vec<View>> {
    let first = views(count, Aperture::DISC);
    let at = |jitters: &'static [u8]| {
        let view = |(i, view): (usize, &View)| View { jitter: vector(jitters, i), ..*view };
        first.iter().enumerate().map(view).collect()
    };
    let further: Vec<Vec<View>> = further_jitters(count).map(at).collect();
    std::iter::once(first).chain(further).collect()
}

/// The pixel points of sets 1, 2, … for the table that has `count` views; none where rows do not take turns.
fn further_jitters(count: usize) -> impl Iterator<Item = &'static [u8]> {
    let sets = if IN_TURNS.contains(&count) { ROW_SETS } else { 1 };
    let (smaller, size) = table_for(count);
    let before: usize = smaller.iter().filter(|&size| IN_TURNS.contains(size)).sum();
    let start = before * (ROW_SETS - 1);
    (1..sets).map(move |set| &ROW_TABLES[(start + (set - 1) * size) * PIXEL_POINT..][..size * PIXEL_POINT])
}

/// `count` views of a disc, all rotated by `angle` and moved by `shift` within the pixel. Random `angle` and `shift` give independent
/// sample sets that are as evenly spread as the table.
pub(super) fn moved_views(count: usize, angle: f32, shift: Vec2) -> Vec<View> {
    views(count, Aperture::DISC).into_iter().map(|view| moved(view, angle, shift)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_count_gives_that_many_views_within_lens_and_pixel() {
        for count in [1, 2, 7, 8, 9, 64, 96, 100, 768, 1024, 1500, 4096] {
            let samples = views(count, Aperture::DISC);
            assert_eq!(samples.len(), count, "requested: {count}");
            for view in samples {
                assert!(view.lens.length() <= 1.0 + 1e-5, "{view:?} leaves the lens");
                assert!(view.jitter.abs().max_element() <= 0.5, "{view:?} leaves the pixel");
            }
        }
    }

    #[test]
    fn the_length_of_the_tables_is_that_of_their_sizes() {
        assert_eq!(TABLES.len(), SIZES.iter().sum::<usize>() * POINT);
        let in_turns: usize = SIZES.iter().filter(|size| IN_TURNS.contains(size)).sum();
        assert_eq!(ROW_TABLES.len(), (ROW_SETS - 1) * in_turns * PIXEL_POINT);
    }

    /// CoC radii from a sharp picture to a wide blur, between and beyond those that the tables are optimised for.
    const RADII_PX: [f32; 6] = [0.0, 0.3, 0.65, 1.2, 2.5, 5.0];

    /// Root of the mean squared distance between the sorted projections of `j + c·u` along several directions and those of many random
    /// points of lens and pixel: 0 for a perfectly even spread.
    fn unevenness(views: &[View], coc: f32) -> f32 {
        let mut random = fastrand::Rng::with_seed(7);
        let truth: Vec<View> = (0..views.len() * 64)
            .map(|_| View {
                lens: Vec2::from_angle(random.f32() * std::f32::consts::TAU) * random.f32().sqrt(),
                jitter: Vec2::new(random.f32(), random.f32()) - 0.5,
                shift: Vec2::ZERO,
            })
            .collect();
        let squares: Vec<f32> = (0..6)
            .flat_map(|k| {
                let direction = Vec2::from_angle(std::f32::consts::PI * (k as f32 + 0.3) / 6.0);
                let sorted = |views: &[View]| {
                    let mut along: Vec<f32> =
                        views.iter().map(|view| direction.dot(view.jitter + coc * view.lens)).collect();
                    along.sort_by(f32::total_cmp);
                    along
                };
                let (found, expected) = (sorted(views), sorted(&truth));
                found.into_iter().zip(expected.into_iter().skip(32).step_by(64)).map(|(a, b)| (a - b).powi(2))
            })
            .collect();
        (squares.iter().sum::<f32>() / squares.len() as f32).sqrt()
    }

    /// The mean of [`unevenness`] over all radii, each in proportion to the blur.
    fn mean_unevenness(views: &[View]) -> f32 {
        RADII_PX.iter().map(|&coc| unevenness(views, coc) / (1.0 + coc)).sum::<f32>() / RADII_PX.len() as f32
    }

    #[test]
    fn sets_of_rows_begin_with_the_table_and_share_its_lens_points_in_order() {
        for count in [32, 40, 64, 100, 1024] {
            let sets = views_in_turns(count);
            assert_eq!(sets.len(), ROW_SETS, "{count} views");
            assert_eq!(sets[0], views(count, Aperture::DISC), "{count} views");
            for set in &sets {
                let lens = |views: &[View]| views.iter().map(|view| view.lens).collect::<Vec<_>>();
                assert_eq!(lens(set), lens(&sets[0]), "{count} views");
                assert!(set.iter().all(|view| view.jitter.abs().max_element() <= 0.5), "{count} views");
            }
        }
    }

    #[test]
    fn rows_have_one_set_of_few_views_and_of_more_than_the_largest_table() {
        for count in [1, 24, 31, 1025, 4096] {
            assert_eq!(views_in_turns(count), [views(count, Aperture::DISC)], "{count} views");
        }
    }

    #[test]
    fn each_set_of_rows_is_as_evenly_spread_as_the_table() {
        for count in [32, 48, 56, 64, 128, 256] {
            let sets = views_in_turns(count);
            let table = mean_unevenness(&sets[0]);
            for (set, views) in sets.iter().enumerate() {
                let found = mean_unevenness(views);
                assert!(found < 1.25 * table, "set {set} of {count} views: {found}, table {table}");
            }
        }
    }

    #[test]
    fn the_sets_of_rows_together_are_more_evenly_spread_than_any_of_them() {
        // Sets that agreed would together be as uneven as each. Wide blurs gain less, because the lens points are the same.
        for count in [32, 64, 256] {
            let sets = views_in_turns(count);
            for coc in [0.0, 0.5, 1.0, 1.5] {
                let together = unevenness(&sets.concat(), coc);
                for (set, views) in sets.iter().enumerate() {
                    let alone = unevenness(views, coc);
                    assert!(
                        together < 0.8 * alone,
                        "{count} views, c = {coc}: {together}, set {set} {alone}"
                    );
                }
            }
        }
    }

    #[test]
    fn views_past_the_largest_table_begin_with_that_table() {
        let (once, twice) = (views(1024, Aperture::DISC), views(2048, Aperture::DISC));
        assert_eq!(once, twice[..1024], "the first half is the table itself");
    }

    #[test]
    fn views_are_evenly_spread_in_pixel_and_lens_jointly() {
        // For several CoC radii, the share of points in a half plane through the centre is one half.
        for count in [48, 64, 96, 192, 256, 768, 1024] {
            for coc in [0.0f32, 1.0, 4.0] {
                let positive = views(count, Aperture::DISC)
                    .iter()
                    .filter(|v| (v.jitter + coc * v.lens).dot(Vec2::new(0.8, 0.6)) > 0.0)
                    .count();
                let share = positive as f32 / count as f32;
                assert!((share - 0.5).abs() < 2.0 / count as f32 + 0.01, "{count} views, c = {coc}: {share}");
            }
        }
    }
}
