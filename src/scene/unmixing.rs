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
use crate::image::Plane;
use crate::parallel;
use crate::stack::{Antialiasing, LIGHT_ALPHA};

/// Differences in CoC radius to a nearer neighbour, in picture pixels: none of the colour is mixed up to the first, all from the second.
const MIXED_PX: [f32; 2] = [0.5, 1.5];

/// A difference from a surface's mean is explained by this multiple of its variance: that of two standard deviations.
const EXPLAINED: f32 = 4.0;

/// Share of a difference that the surface's variance may explain: from here on the pixel keeps its colour.
const MAX_EXPLAINED: f32 = 0.1;

/// Half the side of the square in which pixels of the same surface are looked for, in pixels.
const AROUND: usize = 4;

/// CoC radii of the surface, in picture pixels, from which on its own edge pixels are replaced: none up to the first, all from the second.
const BLURRED_PX: [f32; 2] = [1.0, 3.0];

/// The colours of edge pixels without what nearer surfaces mixed into them.
#[derive(Debug)]
pub(super) struct Unmixed {
    /// How much of each colour may be that of a nearer surface beside it, 0 … 1; 1 where there is no fragment.
    mixed: Plane,
    /// Unpremultiplied colours, row by row: those of fragments that are mixed. The others are not written, which costs no memory.
    colors: Vec<[f32; 3]>,
}

impl Unmixed {
    /// Those of `layer`; `None` where its colours are point samples, which mix nothing.
    pub(super) fn new(layer: &Layer, antialiasing: &Antialiasing) -> Option<Self> {
        if antialiasing.everywhere() == Some(0.0) {
            return None;
        }
        let mixed = mixed_shares(layer, antialiasing);
        let width = layer.width();
        let mut colors = vec![[0.0; 3]; width * layer.height()];
        parallel::for_each_row(&mut colors, width, &|y, row| {
            for (x, (color, &share)) in row.iter_mut().zip(mixed.row(y)).enumerate() {
                if share > 0.0 && layer.alpha.get(x, y) > LIGHT_ALPHA {
                    *color = cleaned(layer, &mixed, (x, y));
                }
            }
        });
        Some(Self { mixed, colors })
    }

    /// The unpremultiplied colour of the fragment at `x, y`, if it is mixed.
    pub(super) fn get(&self, x: usize, y: usize) -> Option<[f32; 3]> {
        (self.mixed.get(x, y) > 0.0).then(|| self.colors[y * self.mixed.width() + x])
    }
}

/// Replaces colours of `layer` by the `unmixed` ones where it is blurred.
pub(super) fn replace_blurred(layer: &mut Layer, unmixed: Option<&Unmixed>) {
    let width = layer.width().max(1);
    let Layer { color: [red, green, blue], alpha, coc_px } = layer;
    parallel::for_each_row_of([red, green, blue].map(Plane::values_mut), width, &|y, [red, green, blue]| {
        for (x, (&alpha, &coc_px)) in alpha.row(y).iter().zip(coc_px.row(y)).enumerate() {
            let cleaned = unmixed.and_then(|unmixed| unmixed.get(x, y));
            // Light without alpha has no colour of its own to divide by it, and dividing by 1 changes nothing.
            if alpha <= LIGHT_ALPHA || (alpha == 1.0 && cleaned.is_none()) {
                continue;
            }
            let share = blurred_share(coc_px);
            for (k, value) in [&mut red[x], &mut green[x], &mut blue[x]].into_iter().enumerate() {
                let unmixed = cleaned.map_or(*value / alpha, |color| color[k]);
                *value += share * (alpha * unmixed - *value);
            }
        }
    });
}

/// How far a fragment of this CoC radius takes its unmixed colour, 0 … 1.
fn blurred_share(coc_px: f32) -> f32 {
    let [none, all] = BLURRED_PX;
    ((coc_px.abs() - none) / (all - none)).clamp(0.0, 1.0)
}

/// How much of each colour of `layer` may be that of a nearer surface beside it, 0 … 1; 1 where there is no fragment.
fn mixed_shares(layer: &Layer, antialiasing: &Antialiasing) -> Plane {
    let (width, height) = (layer.width(), layer.height());
    let mut mixed = Plane::zeros(width, height);
    let rows = mixed.values_mut().chunks_mut(width.max(1));
    // The smallest CoC radius of three rows by column, with a column beyond either border.
    let nearest = || vec![f32::INFINITY; width + 2];
    parallel::for_each_with(rows, &nearest, &|nearest, y, row| {
        nearest.fill(f32::INFINITY);
        for y in y.saturating_sub(1)..(y + 2).min(height) {
            let fragments = layer.coc_px.row(y).iter().zip(layer.alpha.row(y));
            for (nearest, (&coc, &alpha)) in nearest[1..].iter_mut().zip(fragments) {
                *nearest = nearest.min(if alpha > LIGHT_ALPHA { coc } else { f32::INFINITY });
            }
        }
        let fragments = layer.coc_px.row(y).iter().zip(layer.alpha.row(y));
        for (x, (mixed, (&coc, &alpha))) in row.iter_mut().zip(fragments).enumerate() {
            let nearest = nearest[x].min(nearest[x + 1]).min(nearest[x + 2]);
            let [none, all] = MIXED_PX;
            let share = ((coc - nearest - none) / (all - none)).clamp(0.0, 1.0);
            *mixed = if alpha > LIGHT_ALPHA { antialiasing.at(x, y) * share } else { 1.0 };
        }
    });
    mixed
}

/// The unpremultiplied colour at `x, y`, of which the share that is `mixed` is replaced by the mean of its surface nearby, as far as that
/// can be trusted.
fn cleaned(layer: &Layer, mixed: &Plane, (x, y): (usize, usize)) -> [f32; 3] {
    let own = layer.unpremultiplied_at(x, y);
    let coc = layer.coc_px.get(x, y);
    let columns = x.saturating_sub(AROUND)..(x + AROUND + 1).min(layer.width());
    let (mut sum, mut squares, mut total) = ([0.0; 3], 0.0, 0.0);
    for row in y.saturating_sub(AROUND)..(y + AROUND + 1).min(layer.height()) {
        let others = layer.coc_px.row(row)[columns.clone()].iter().zip(&mixed.row(row)[columns.clone()]);
        for (column, (other, mixed)) in columns.clone().zip(others) {
            let apart = (other - coc).abs() / CELL_PX;
            let weight = (1.0 - mixed) * (1.0 - apart).max(0.0);
            if weight > 0.0 {
                let color = layer.unpremultiplied_at(column, row);
                sum.iter_mut().zip(color).for_each(|(sum, value)| *sum += weight * value);
                squares += weight * squared(color);
                total += weight;
            }
        }
    }
    if total <= 0.0 {
        return own;
    }
    let mean = sum.map(|sum| sum / total);
    let variance = (squares / total - squared(mean)).max(0.0);
    // Less than one clean pixel in sight replaces less.
    let replaced = mixed.get(x, y) * total.min(1.0) * trust(own, mean, variance);
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

    /// The unpremultiplied colour that column `x` of the third row has without what is mixed into it.
    fn unmixed_color(layer: &Layer, antialiasing: &Antialiasing, x: usize) -> [f32; 3] {
        let unmixed = Unmixed::new(layer, antialiasing);
        unmixed.and_then(|unmixed| unmixed.get(x, 2)).unwrap_or_else(|| layer.unpremultiplied_at(x, 2))
    }

    #[test]
    fn a_share_is_by_the_nearest_of_the_pixel_and_the_eight_around_it() {
        let coc = |x: usize, y: usize| ((x * 7 + y * 11 + x * y) % 13) as f32 / 8.0;
        let alpha = |x: usize, y: usize| if (x + 3 * y).is_multiple_of(5) { LIGHT_ALPHA } else { 1.0 };
        let layer = Layer {
            color: std::array::from_fn(|_| Plane::zeros(24, 5)),
            alpha: Plane::from_fn(24, 5, alpha),
            coc_px: Plane::from_fn(24, 5, coc),
        };
        let shares = mixed_shares(&layer, &Antialiasing::AVERAGES);
        for (x, y) in (0..5).flat_map(|y: usize| (0..24).map(move |x: usize| (x, y))) {
            let around = (y.saturating_sub(1)..=y + 1)
                .flat_map(|y| (x.saturating_sub(1)..=x + 1).map(move |x| (x, y)));
            let fragments = around.filter(|&(x, y)| x < 24 && y < 5 && alpha(x, y) > LIGHT_ALPHA);
            let nearest = fragments.map(|(x, y)| coc(x, y)).fold(f32::INFINITY, f32::min);
            let [none, all] = MIXED_PX;
            let share = ((coc(x, y) - nearest - none) / (all - none)).clamp(0.0, 1.0);
            let expected = if alpha(x, y) > LIGHT_ALPHA { share } else { 1.0 };
            assert_eq!(shares.get(x, y), expected, "{x}, {y}");
        }
    }

    #[test]
    fn an_edge_pixel_of_the_wall_takes_the_walls_colour() {
        let color = |x: usize| unmixed_color(&stripe(), &Antialiasing::AVERAGES, x);
        assert_eq!(color(12), [0.0, 1.0, 0.0], "without the stripe's red");
        assert_eq!(color(11), [1.0, 0.0, 0.0], "the stripe keeps its own");
        assert_eq!(color(20), [0.0, 1.0, 0.0], "as does the wall elsewhere");
    }

    #[test]
    fn a_blurred_surface_loses_what_is_mixed_into_it_and_a_sharp_one_keeps_it() {
        for (coc_px, expected) in [(9.0, 0.0), (2.0, 0.25), (0.9, 0.5)] {
            let mut layer = stripe();
            let is_stripe = |x: usize| (8..12).contains(&x);
            layer.coc_px = Plane::from_fn(24, 5, |x, _| if is_stripe(x) { coc_px - 9.0 } else { coc_px });
            let unmixed = Unmixed::new(&layer, &Antialiasing::AVERAGES);
            replace_blurred(&mut layer, unmixed.as_ref());
            assert_eq!(layer.color_at(12, 2)[0], expected, "c = {coc_px}");
            assert_eq!(layer.color_at(20, 2), [0.0, 1.0, 0.0], "the wall elsewhere");
        }
    }

    #[test]
    fn point_samples_are_not_mixed() {
        let color = unmixed_color(&stripe(), &Antialiasing::POINT_SAMPLES, 12);
        assert_eq!(color, [0.5, 0.5, 0.0], "its own colour");
    }

    #[test]
    fn what_may_be_the_surfaces_texture_is_kept() {
        let mut layer = stripe();
        let texture = |x: usize| if x.is_multiple_of(2) { 0.6 } else { 0.0 };
        layer.color[0] = Plane::from_fn(24, 5, |x, _| if (8..12).contains(&x) { 1.0 } else { texture(x) });
        assert_eq!(unmixed_color(&layer, &Antialiasing::AVERAGES, 12)[0], 0.6);
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
        let color = |x: usize| unmixed_color(&layer, &Antialiasing::AVERAGES, x);
        assert!((0..24).all(|x| color(x) == [shade(x); 3]), "every column");
    }
}
