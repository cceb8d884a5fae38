//! Colours of a farther surface without what a nearer one mixed into them at its edge.
//!
//! In one picture with depth, colours are averages over the pixel and depth is one sample, so that a pixel at an edge may have the depth
//! of the wall and a colour that is partly that of what stands before it. A surface that is continued behind the edge must not take that
//! colour. Such a pixel gets the mean of the same surface's pixels near it that touch nothing nearer. Where the surface is blurred, the pixel
//! itself gets it too: it would spread the nearer surface's colour as a halo, and its own edge is not seen.
//!
//! On a textured surface the difference may be texture, so that a pixel is replaced only as far as its colour is beyond the surface's own
//! variation.
//!
//! How far a pixel is mixed grows with the difference in CoC radius to the nearest of its eight neighbours, and with how far colours are
//! averages ([`Antialiasing`]), both continuously. Cost: the edges only.

use super::layer::Layer;
use super::surface::CELL_PX;
use crate::stack::{Antialiasing, LIGHT_ALPHA};
use rayon::prelude::*;

/// Differences in CoC radius to a nearer neighbour, in picture pixels: none of the colour is mixed up to the first, all from the second.
const MIXED_PX: [f32; 2] = [0.5, 1.5];

/// A difference from a surface's mean is explained by this multiple of its variance: that of two standard deviations.
const EXPLAINED: f32 = 4.0;

/// Share of a difference that the surface's variance may explain: from here on the pixel keeps its colour.
const MAX_EXPLAINED: f32 = 0.1;

/// Half the side of the square in which pixels of the same surface are looked for, in pixels.
const AROUND: isize = 4;

/// CoC radii of the surface, in picture pixels, from which on its own edge pixels are replaced: none up to the first, all from the second.
const BLURRED_PX: [f32; 2] = [1.0, 3.0];

/// Replaces the colours `unmixed` from `layer` ([`unmixed_colors`]) in it where it is blurred.
pub(super) fn replace_blurred(layer: &mut Layer, unmixed: &[[f32; 3]]) {
    let [none, all] = BLURRED_PX;
    let Layer { color, alpha, coc_px } = layer;
    for (k, plane) in color.iter_mut().enumerate() {
        let fragments = alpha.values().par_iter().zip(coc_px.values()).zip(unmixed);
        plane.values_mut().par_iter_mut().zip(fragments).for_each(|(value, ((alpha, coc), unmixed))| {
            let share = ((coc.abs() - none) / (all - none)).clamp(0.0, 1.0);
            // Light without alpha has no colour of its own to divide by it.
            if *alpha > LIGHT_ALPHA {
                *value += share * (alpha * unmixed[k] - *value);
            }
        });
    }
}

/// Unpremultiplied colours of `layer`, row by row, without what nearer surfaces mixed into them.
pub(super) fn unmixed_colors(layer: &Layer, antialiasing: &Antialiasing) -> Vec<[f32; 3]> {
    let (width, height) = (layer.width(), layer.height());
    if antialiasing.everywhere() == Some(0.0) {
        return layer.unpremultiplied();
    }
    let mixed: Vec<f32> = (0..width * height)
        .into_par_iter()
        .map(|i| antialiasing.at(i % width, i / width) * mixed_share(layer, i % width, i / width))
        .collect();
    (0..width * height)
        .into_par_iter()
        .map(|i| {
            let own = layer.unpremultiplied_at(i % width, i / width);
            if mixed[i] > 0.0 { cleaned(layer, &mixed, i, own) } else { own }
        })
        .collect()
}

/// The fragments of `layer` up to `reach` columns and rows away from `x, y`: their places.
fn around(layer: &Layer, x: usize, y: usize, reach: isize) -> impl Iterator<Item = (usize, usize)> {
    let place = move |dx: isize, dy: isize| {
        let place = x.checked_add_signed(dx).zip(y.checked_add_signed(dy));
        place.filter(|&(x, y)| x < layer.width() && y < layer.height() && layer.alpha.get(x, y) > LIGHT_ALPHA)
    };
    (-reach..=reach).flat_map(move |dy| (-reach..=reach).filter_map(move |dx| place(dx, dy)))
}

/// How much of the colour at `x, y` may be that of a nearer surface beside it, 0 … 1.
fn mixed_share(layer: &Layer, x: usize, y: usize) -> f32 {
    if layer.alpha.get(x, y) <= LIGHT_ALPHA {
        return 0.0;
    }
    let coc = layer.coc_px.get(x, y);
    let nearest = around(layer, x, y, 1).fold(coc, |nearest, (x, y)| nearest.min(layer.coc_px.get(x, y)));
    let [none, all] = MIXED_PX;
    ((coc - nearest - none) / (all - none)).clamp(0.0, 1.0)
}

/// The colour `own` of pixel `i`, of which the share `mixed[i]` is replaced by the mean of its surface nearby, as far as that can be trusted.
fn cleaned(layer: &Layer, mixed: &[f32], i: usize, own: [f32; 3]) -> [f32; 3] {
    let (width, coc) = (layer.width(), layer.coc_px.values()[i]);
    let (mut sum, mut squares, mut total) = ([0.0; 3], 0.0, 0.0);
    for (x, y) in around(layer, i % width, i / width, AROUND) {
        let apart = (layer.coc_px.get(x, y) - coc).abs() / CELL_PX;
        let weight = (1.0 - mixed[y * width + x]) * (1.0 - apart).max(0.0);
        let color = layer.unpremultiplied_at(x, y);
        sum.iter_mut().zip(color).for_each(|(sum, value)| *sum += weight * value);
        squares += weight * squared(color);
        total += weight;
    }
    if total <= 0.0 {
        return own;
    }
    let mean = sum.map(|sum| sum / total);
    let variance = (squares / total - squared(mean)).max(0.0);
    // Less than one clean pixel in sight replaces less.
    let replaced = mixed[i] * total.min(1.0) * trust(own, mean, variance);
    std::array::from_fn(|k| own[k] + replaced * (mean[k] - own[k]))
}

/// How far the difference of `own` from the `mean` of a surface can only be a mixture: not where the surface's own `variance` explains it.
fn trust(own: [f32; 3], mean: [f32; 3], variance: f32) -> f32 {
    let difference = squared(std::array::from_fn(|k| own[k] - mean[k]));
    let explained = EXPLAINED * variance / (difference + EXPLAINED * variance).max(f32::MIN_POSITIVE);
    (1.0 - explained / MAX_EXPLAINED).max(0.0)
}

/// The squared length of a colour.
fn squared(color: [f32; 3]) -> f32 {
    color.iter().map(|value| value * value).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;

    /// A near red stripe in columns 8 … 11 before a far green wall; the wall's column 12 is half red.
    fn stripe() -> Layer {
        let red = |x: usize| match x {
            8..12 => 1.0,
            12 => 0.5,
            _ => 0.0,
        };
        let plane = |value: &dyn Fn(usize) -> f32| Plane::from_fn(24, 5, |x, _| value(x));
        Layer {
            color: [plane(&red), plane(&|x| 1.0 - red(x)), plane(&|_| 0.0)],
            alpha: plane(&|_| 1.0),
            coc_px: plane(&|x| if (8..12).contains(&x) { 0.0 } else { 9.0 }),
        }
    }

    #[test]
    fn an_edge_pixel_of_the_wall_takes_the_walls_colour() {
        let colors = unmixed_colors(&stripe(), &Antialiasing::AVERAGES);
        assert_eq!(colors[2 * 24 + 12], [0.0, 1.0, 0.0], "without the stripe's red");
        assert_eq!(colors[2 * 24 + 11], [1.0, 0.0, 0.0], "the stripe keeps its own");
        assert_eq!(colors[2 * 24 + 20], [0.0, 1.0, 0.0], "as does the wall elsewhere");
    }

    #[test]
    fn a_blurred_surface_loses_what_is_mixed_into_it_and_a_sharp_one_keeps_it() {
        for (coc_px, expected) in [(9.0, 0.0), (2.0, 0.25), (0.9, 0.5)] {
            let mut layer = stripe();
            let is_stripe = |x: usize| (8..12).contains(&x);
            layer.coc_px = Plane::from_fn(24, 5, |x, _| if is_stripe(x) { coc_px - 9.0 } else { coc_px });
            let unmixed = unmixed_colors(&layer, &Antialiasing::AVERAGES);
            replace_blurred(&mut layer, &unmixed);
            assert_eq!(layer.color_at(12, 2)[0], expected, "c = {coc_px}");
            assert_eq!(layer.color_at(20, 2), [0.0, 1.0, 0.0], "the wall elsewhere");
        }
    }

    #[test]
    fn point_samples_are_not_mixed() {
        let colors = unmixed_colors(&stripe(), &Antialiasing::POINT_SAMPLES);
        assert_eq!(colors[2 * 24 + 12], [0.5, 0.5, 0.0], "its own colour");
    }

    #[test]
    fn what_may_be_the_surfaces_texture_is_kept() {
        let mut layer = stripe();
        let texture = |x: usize| if x.is_multiple_of(2) { 0.6 } else { 0.0 };
        layer.color[0] = Plane::from_fn(24, 5, |x, _| if (8..12).contains(&x) { 1.0 } else { texture(x) });
        let colors = unmixed_colors(&layer, &Antialiasing::AVERAGES);
        assert_eq!(colors[2 * 24 + 12][0], 0.6);
    }

    #[test]
    fn a_slope_keeps_its_colours() {
        let plane = |value: &dyn Fn(usize) -> f32| Plane::from_fn(24, 5, |x, _| value(x));
        let shade = |x: usize| (x % 3) as f32;
        let layer = Layer {
            color: std::array::from_fn(|_| plane(&shade)),
            alpha: plane(&|_| 1.0),
            coc_px: plane(&|x| 0.4 * x as f32),
        };
        let colors = unmixed_colors(&layer, &Antialiasing::AVERAGES);
        assert!((0..24).all(|x| colors[24 + x] == [shade(x); 3]), "every column");
    }
}
