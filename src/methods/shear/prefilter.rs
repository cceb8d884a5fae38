//! Smoothing within a surface by the gap between lens samples, so that few views show no separate copies.
//!
//! `N` lens samples on a disc of radius `|c|` pixels lie `|c|·√(π/N)` apart. Finer detail of a blurred surface would show as
//! `N` separate copies. The filter is a box whose radius is half that gap times a strength: with enough views the blur removes
//! the same detail. It is applied as an edge-aware recursive filter of the same variance, along rows, then along columns, once
//! in each direction: `y_i = x_i + a (y_{i−1} − x_i)`, with `a = 0` where the surface ends. The result is always a convex
//! combination of the surface's own colours.

use crate::image::Plane;
use crate::parallel;
use crate::scene::{Layer, surface};
use pulp::{Arch, NullaryFnOnce};
use std::f32::consts::PI;

/// A filter of at most this variance, in squared pixels, is not applied.
pub(super) const MIN_VARIANCE: f32 = 0.03;

/// Columns that one task filters.
const STRIP: usize = 128;

/// Rows that are filtered together: a step waits for the one before it, and meanwhile the other row's is computed.
const TOGETHER: usize = 2;

/// Beyond this number of box radii the filter's response is below a millionth: `e^(−√6 · 6)`.
#[cfg(feature = "gpu")]
pub(super) const REACH_RADII: f32 = 6.0;

/// Radius of the box per pixel of CoC radius: half the gap between `views` lens samples, times `strength`.
pub(super) fn radius_per_coc(views: usize, strength: f32) -> f32 {
    0.5 * strength * (PI / views as f32).sqrt()
}

/// Smooths `layers` for `views` lens samples; `strength` scales the box's radius.
pub(super) fn smooth(layers: &mut [Layer], views: usize, strength: f32) {
    let radius_per_coc = radius_per_coc(views, strength);
    for Layer { color, alpha, coc_px } in layers {
        let surface = Surface { width: alpha.width(), alpha: alpha.values(), coc_px: coc_px.values() };
        smooth_surface(color.each_mut().map(Plane::values_mut), &surface, radius_per_coc);
    }
}

/// Coverage and CoC radius of consecutive rows of a layer.
#[derive(Debug)]
pub(super) struct Surface<'a> {
    /// Number of columns.
    pub(super) width: usize,
    /// Coverage, row by row.
    pub(super) alpha: &'a [f32],
    /// Signed CoC radius in picture pixels, row by row.
    pub(super) coc_px: &'a [f32],
}

impl Surface<'_> {
    /// Alpha and CoC radius of row `y`.
    #[inline(always)]
    fn row(&self, y: usize) -> (&[f32], &[f32]) {
        let values = y * self.width..(y + 1) * self.width;
        (&self.alpha[values.clone()], &self.coc_px[values])
    }
}

/// Red, green and blue of a surface, row by row.
type Channels<'a> = [&'a mut [f32]; 3];

/// Smooths `color`, the colours of `surface`.
pub(super) fn smooth_surface(mut color: Channels<'_>, surface: &Surface<'_>, radius_per_coc: f32) {
    along_rows(color.each_mut().map(|channel| &mut **channel), surface, radius_per_coc);
    along_columns(color, surface, radius_per_coc);
}

/// The weight `a` between two neighbours of CoC radii `coc` and `other_coc`; `coc` sets the radius of the box.
///
/// A box of radius `r` has variance `v = r²/3`; the two-way recursion with weight `a` has `2a/(1 − a)²`.
#[inline(always)]
fn weight(coc: f32, other_coc: f32, same_surface: bool, radius_per_coc: f32) -> f32 {
    let radius = coc.abs() * radius_per_coc;
    let variance = radius * radius * (1.0 / 3.0);
    // Fades in from 0 at the smallest variance.
    let v = (variance - MIN_VARIANCE * MIN_VARIANCE / variance.max(MIN_VARIANCE)).max(1e-4);
    let a = (v + 1.0 - (1.0 + 2.0 * v).sqrt()) / v;
    let smooth = same_surface & surface::may_average(coc, other_coc) & (variance > MIN_VARIANCE);
    if smooth { a } else { 0.0 }
}

/// Fills `weights` with the weights between `here` and `neighbours` (alpha and CoC radius each), unless all are 0. Returns whether any is
/// not.
struct FillWeights<'a> {
    weights: &'a mut [f32],
    neighbours: (&'a [f32], &'a [f32]),
    here: (&'a [f32], &'a [f32]),
    radius_per_coc: f32,
}

impl NullaryFnOnce for FillWeights<'_> {
    type Output = bool;

    #[inline(always)]
    fn call(self) -> bool {
        let Self { weights, neighbours, here, radius_per_coc } = self;
        // Most rows of deeper peels are empty or in focus, and finding that out costs less than their weights.
        let least_coc_px = 0.999 * (3.0 * MIN_VARIANCE).sqrt() / radius_per_coc;
        if !here.1.iter().fold(false, |any, coc_px| any | (coc_px.abs() > least_coc_px)) {
            return false;
        }
        let mut blurred = false;
        let pairs = neighbours.0.iter().zip(neighbours.1).zip(here.0.iter().zip(here.1));
        for (out, ((&other_alpha, &other_coc), (&alpha, &coc))) in weights.iter_mut().zip(pairs) {
            let same = (alpha > 0.0) & (alpha == other_alpha);
            *out = weight(coc, other_coc, same, radius_per_coc);
            blurred |= *out > 0.0;
        }
        blurred
    }
}

fn along_rows([red, green, blue]: Channels<'_>, surface: &Surface<'_>, radius_per_coc: f32) {
    let (width, arch) = (surface.width, Arch::new());
    let pair = TOGETHER * width;
    let pairs = red.chunks_mut(pair).zip(green.chunks_mut(pair)).zip(blue.chunks_mut(pair));
    parallel::for_each_with(
        pairs,
        &|| [(); TOGETHER].map(|()| vec![0.0; width]),
        &|weights, pair, ((red, green), blue)| {
            let rows = red.chunks_mut(width).zip(green.chunks_mut(width)).zip(blue.chunks_mut(width));
            let mut blurred = Vec::with_capacity(TOGETHER);
            for (i, (((red, green), blue), weights)) in rows.zip(weights).enumerate() {
                let ((alpha, coc), last) = (surface.row(pair * TOGETHER + i), width - 1);
                let (neighbours, here) = ((&alpha[..last], &coc[..last]), (&alpha[1..], &coc[1..]));
                let fill = FillWeights { weights: &mut weights[1..], neighbours, here, radius_per_coc };
                if arch.dispatch(fill) {
                    blurred.push(Row { color: [red, green, blue], weights });
                }
            }
            match <[Row<'_>; TOGETHER]>::try_from(blurred) {
                Ok(rows) => arch.dispatch(SmoothRows { rows }),
                Err(rows) => rows.into_iter().for_each(|row| arch.dispatch(SmoothRows { rows: [row] })),
            }
        },
    );
}

/// A row; `weights[x]` is the weight between `x − 1` and `x`.
struct Row<'a> {
    color: [&'a mut [f32]; 3],
    weights: &'a [f32],
}

impl Row<'_> {
    /// The first `width` values of each, as slices whose length the compiler knows to be the same.
    #[inline(always)]
    fn of_width(self, width: usize) -> Self {
        Self { color: self.color.map(|channel| &mut channel[..width]), weights: &self.weights[..width] }
    }

    /// Moves the colour of column `x` towards `last` by the weight of column `weighted`, and `last` to it.
    #[inline(always)]
    fn step(&mut self, x: usize, last: &mut [f32; 3], weighted: usize) {
        let [red, green, blue] = &mut self.color;
        *last = mixed([red[x], green[x], blue[x]], *last, self.weights[weighted]);
        [red[x], green[x], blue[x]] = *last;
    }
}

/// Both directions over rows of one width.
struct SmoothRows<'a, const N: usize> {
    rows: [Row<'a>; N],
}

impl<const N: usize> NullaryFnOnce for SmoothRows<'_, N> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let width = self.rows[0].weights.len();
        let mut rows = self.rows.map(|row| row.of_width(width));
        let mut last = rows.each_ref().map(|row| row.color.each_ref().map(|channel| channel[0]));
        for x in 1..width {
            for (row, last) in rows.iter_mut().zip(&mut last) {
                row.step(x, last, x);
            }
        }
        for x in (0..width - 1).rev() {
            for (row, last) in rows.iter_mut().zip(&mut last) {
                row.step(x, last, x + 1);
            }
        }
    }
}

/// `color` moved towards `other` by weight `a`; for weight 0 the bits of `color`.
#[inline(always)]
fn mixed(color: [f32; 3], other: [f32; 3], a: f32) -> [f32; 3] {
    let keep = 1.0 - a;
    [keep * color[0] + a * other[0], keep * color[1] + a * other[1], keep * color[2] + a * other[2]]
}

fn along_columns(color: Channels<'_>, surface: &Surface<'_>, radius_per_coc: f32) {
    let (width, height) = (surface.width, color[0].len() / surface.width);
    let arch = Arch::new();
    parallel::for_each_with(
        strips(color, width).into_iter(),
        &|| vec![0.0; STRIP * height],
        &|weights, i, mut channels| {
            let columns = i * STRIP..(i * STRIP + STRIP).min(width);
            let row = |y: usize| {
                let (alpha, coc) = surface.row(y);
                (&alpha[columns.clone()], &coc[columns.clone()])
            };
            let mut blurred = vec![false; height];
            for y in 1..height {
                let weights = &mut weights[y * STRIP..y * STRIP + columns.len()];
                blurred[y] = arch.dispatch(FillWeights {
                    weights,
                    neighbours: row(y - 1),
                    here: row(y),
                    radius_per_coc,
                });
            }
            for rows in &mut channels {
                arch.dispatch(SmoothColumns { rows, weights, blurred: &blurred });
            }
        },
    );
}

/// One strip: the rows of each channel.
type Strip<'a> = [Vec<&'a mut [f32]>; 3];

/// The channels, `width` columns each, cut into vertical strips of [`STRIP`] columns.
fn strips(color: Channels<'_>, width: usize) -> Vec<Strip<'_>> {
    let empty = || std::array::from_fn(|_| Vec::with_capacity(color[0].len() / width));
    let mut strips: Vec<Strip<'_>> = (0..width.div_ceil(STRIP)).map(|_| empty()).collect();
    for (channel, plane) in color.into_iter().enumerate() {
        for row in plane.chunks_mut(width) {
            for (i, piece) in row.chunks_mut(STRIP).enumerate() {
                strips[i][channel].push(piece);
            }
        }
    }
    strips
}

/// Both directions over one channel of a strip. Row `y` of `weights` has the weights between rows `y − 1` and `y`, which are
/// all 0 where `blurred[y]` is false.
struct SmoothColumns<'a, 'b> {
    rows: &'a mut [&'b mut [f32]],
    weights: &'a [f32],
    blurred: &'a [bool],
}

impl NullaryFnOnce for SmoothColumns<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { rows, weights, blurred } = self;
        for y in (1..blurred.len()).filter(|&y| blurred[y]) {
            let (above, below) = rows.split_at_mut(y);
            mix(above[y - 1], below[0], &weights[y * STRIP..]);
        }
        for y in (1..blurred.len()).rev().filter(|&y| blurred[y]) {
            let (above, below) = rows.split_at_mut(y);
            mix(below[0], above[y - 1], &weights[y * STRIP..]);
        }
    }
}

/// Moves `target` towards `source` by `weights`.
#[inline(always)]
fn mix(source: &[f32], target: &mut [f32], weights: &[f32]) {
    for ((value, &other), &a) in target.iter_mut().zip(source).zip(weights) {
        *value += a * (other - *value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn smoothed(
        width: usize,
        height: usize,
        color: impl Fn(usize, usize) -> f32,
        coc: impl Fn(usize, usize) -> f32,
    ) -> Plane {
        let channel = Plane::from_fn(width, height, &color);
        let mut layers = [Layer {
            color: std::array::from_fn(|_| channel.clone()),
            alpha: Plane::filled(width, height, 1.0),
            coc_px: Plane::from_fn(width, height, &coc),
        }];
        smooth(&mut layers, 64, 1.4);
        layers[0].color[1].clone()
    }

    #[test]
    fn a_constant_colour_stays_constant() {
        let result = smoothed(300, 9, |_, _| 0.7, |x, _| x as f32 * 0.3);
        assert!(result.values().iter().all(|v| (v - 0.7).abs() < 1e-6), "0.7 everywhere");
    }

    #[test]
    fn a_point_keeps_its_sum_and_gets_the_variance_of_the_box() {
        let coc = 40.0;
        let result = smoothed(201, 201, |x, y| f32::from(x == 100 && y == 100), |_, _| coc);
        let moment = |power: i32| {
            result
                .values()
                .iter()
                .enumerate()
                .map(|(i, v)| f64::from(*v) * ((i % 201) as f64 - 100.0).powi(power))
                .sum::<f64>()
        };
        let radius = 0.5 * 1.4 * f64::from(coc) * (std::f64::consts::PI / 64.0).sqrt();
        let (box_variance, least) = (radius * radius / 3.0, f64::from(MIN_VARIANCE));
        let variance = box_variance - least * least / box_variance;
        assert!((moment(0) - 1.0).abs() < 1e-4, "sum {}", moment(0));
        assert!(moment(1).abs() < 1e-3, "centroid {}", moment(1));
        assert!((moment(2) / variance - 1.0).abs() < 1e-2, "variance {}", moment(2));
    }

    #[test]
    fn colours_do_not_mix_across_an_edge_in_depth() {
        let result = smoothed(40, 5, |x, _| f32::from(x >= 20), |x, _| if x < 20 { 30.0 } else { 28.0 });
        assert!(
            (0..20).all(|x| result.get(x, 2) == 0.0) && (20..40).all(|x| result.get(x, 2) == 1.0),
            "both sides untouched"
        );
    }

    #[test]
    fn fragments_in_focus_do_not_change() {
        let result = smoothed(16, 16, |x, y| ((x + y) % 2) as f32, |_, _| 0.5);
        assert_eq!(result, Plane::from_fn(16, 16, |x, y| ((x + y) % 2) as f32), "untouched");
    }
}
