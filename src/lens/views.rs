//! Lens samples: pairs of a point on the aperture and a point within the pixel, evenly spread in both jointly.
//!
//! The tables hold, for 8, 12, 16, 24 … 1024 views, point sets `(u, j)` optimised so that `j + c·u` is evenly spread along every
//! direction for every CoC radius `c` from 0 (the pixel alone) to ∞ (the lens alone): sliced optimal transport after
//! Paulin et al. 2020, "Sliced Optimal Transport Sampling". `examples/view_tables.rs` computes them. The order of each table makes its
//! prefixes evenly spread as well.

use super::Aperture;
use glam::Vec2;

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

/// Step of a sequence that is evenly spread over the pixel.
const KRONECKER: Vec2 = Vec2::new(0.754_877_7, 0.569_840_3);

/// Bytes of a point.
const POINT: usize = 4 * size_of::<f32>();

/// `count` views of `aperture`, evenly spread.
///
/// A count that is not the size of a table takes a prefix of the next larger table. Past the largest table, that one is repeated with
/// rotated lens points and shifted pixel points.
pub fn views(count: usize, aperture: Aperture) -> Vec<View> {
    let index = SIZES.iter().position(|&size| size >= count).unwrap_or(SIZES.len() - 1);
    let (before, size) = (SIZES[..index].iter().sum::<usize>(), SIZES[index]);
    let table = &TABLES[before * POINT..][..size * POINT];
    (0..count)
        .map(|i| {
            let view = point(table, i % size);
            let turned = turn(view, i / size);
            View { lens: aperture.warp_disc(turned.lens), ..turned }
        })
        .collect()
}

/// Point `i` of a table.
fn point(table: &[u8], i: usize) -> View {
    let value = |k: usize| {
        let start = i * POINT + k * size_of::<f32>();
        table[start..start + 4].try_into().map_or(0.0, f32::from_le_bytes)
    };
    View { lens: Vec2::new(value(0), value(1)), jitter: Vec2::new(value(2), value(3)), shift: Vec2::ZERO }
}

/// The `round`-th variant of a view: the lens point rotated by golden angles, the pixel point shifted by a Kronecker sequence.
fn turn(view: View, round: usize) -> View {
    if round == 0 {
        return view;
    }
    let golden_angle = std::f32::consts::PI * (3.0 - 5f32.sqrt());
    moved(view, golden_angle * round as f32, KRONECKER * round as f32)
}

/// `view` with its lens point rotated by `angle`, and its pixel point moved by `shift` with wrap-around.
fn moved(view: View, angle: f32, shift: Vec2) -> View {
    if (angle, shift) == (0.0, Vec2::ZERO) {
        return view;
    }
    let jitter = (view.jitter + 0.5 + shift).fract_gl() - 0.5;
    View { lens: Vec2::from_angle(angle).rotate(view.lens), jitter, ..view }
}

/// Numbers of views for which the rows of a picture take turns with several sets of views: fewer would lose their even spread, and more
/// have steps too small to be seen.
const IN_TURNS: std::ops::RangeInclusive<usize> = 32..=1024;

/// Number of sets of views with which the rows of a picture take turns, for `count` views.
///
/// As the CoC radius changes, each view moves a whole picture by a pixel at a time. In turns a step moves a quarter of the rows.
pub(super) fn row_sets(count: usize) -> usize {
    if IN_TURNS.contains(&count) { 4 } else { 1 }
}

impl View {
    /// The view in set `set` of [`row_sets`]: its pixel point is shifted by a Kronecker sequence, its lens point is the same.
    #[must_use]
    pub(super) fn in_row_set(self, set: usize) -> Self {
        moved(self, 0.0, KRONECKER * set as f32)
    }
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
