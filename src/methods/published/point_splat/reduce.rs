//! Fewer points where the difference is not visible (section 5): four pixels as one point, a quarter of the
//! resolution.
//!
//! Pixels keep their own points in and near focus, near partial occlusion, and where the four are not one surface.
//! Around partial occlusion both kinds of points overlap, as in the paper, but at half the weight of either.

use super::hidden::{Edge, Fragment};
use super::layers::Light;
use super::splat::{Grid, Point};
use super::sprites::{Centre, Sprite};
use crate::image::Plane;
use crate::parallel;
use std::f32::consts::PI;

/// Minimum CoC radius of reduced points: a diameter of 4 pixels (section 5).
const MIN_COC_PX: f32 = 2.0;

/// Excess of light over the block's mean, spread over a sprite, at which a shift of half a pixel is visible: a 64th of white.
const VISIBLE_EXCESS: f32 = 1.0 / 64.0;

/// Share of each 2 × 2 block of pixels that is splatted as one point.
#[derive(Debug)]
pub(super) struct ReducedShares {
    rows: Vec<Vec<f32>>,
}

impl ReducedShares {
    /// No reduced points.
    pub(super) fn none() -> Self {
        Self { rows: Vec::new() }
    }

    /// Share of pixel `x, y` that is splatted with its block.
    pub(super) fn at(&self, x: usize, y: usize) -> f32 {
        self.rows.get(y / 2).and_then(|row| row.get(x / 2)).copied().unwrap_or(0.0)
    }
}

/// Reduced points of a picture of `visible(x, y)` fragments, and each block's share in them.
///
/// `visible_px` and `edges` are the picture's CoC radii and edge classes. Four pixels are one surface if all are in
/// the same layer by eq. 6 with `delta`.
pub(super) fn reduce_points<const N: usize>(
    visible: impl Fn(usize, usize) -> Option<Fragment<N>> + Sync,
    (visible_px, edges): (&Plane, &[Edge]),
    delta: f32,
) -> (ReducedShares, Grid<N>) {
    let (width, height) = (visible_px.width() / 2, visible_px.height() / 2);
    let row = |y: usize| {
        let (mut shares, mut points) = (vec![0.0; width], Vec::new());
        for (x, share) in shares.iter_mut().enumerate() {
            let pixels = block_pixels(x, y);
            let block_share = surface_share(pixels.map(|(x, y)| visible_px.get(x, y)), delta)
                * overlap(pixels.map(|(x, y)| edges[y * visible_px.width() + x]));
            if block_share == 0.0 {
                continue;
            }
            let fragments = pixels.map(|(x, y)| visible(x, y));
            let Some(light) = mean(fragments).filter(|mean| !has_outlier(mean, &fragments)) else { continue };
            *share = block_share;
            // The point has the energy of four pixels.
            let scale = 4.0 * block_share;
            points.push(Point {
                column: 2 * x as i32,
                sprite: Sprite::from_coc_px(light.coc_px),
                light: Light {
                    content: light.content.map(|value| scale * value),
                    alpha: scale * light.alpha,
                    ..light
                },
            });
        }
        (shares, points)
    };
    let (shares, rows) = parallel::map(height, &row).into_iter().unzip();
    (ReducedShares { rows: shares }, Grid { centre: Centre::Corner, rows })
}

/// 1 if four pixels of these CoC radii are blurred and one surface, otherwise 0.
fn surface_share(coc_px: [f32; 4], delta: f32) -> f32 {
    let (min, max) =
        coc_px.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(min, max), &c| (min.min(c), max.max(c)));
    let radius = if min < 0.0 { -max } else { min };
    if radius >= MIN_COC_PX && max - min <= delta * radius { 1.0 } else { 0.0 }
}

/// Share of a reduced point near partial occlusion: the rest stays with the pixels' own points.
fn overlap(edges: [Edge; 4]) -> f32 {
    if edges.contains(&Edge::Near) {
        0.0
    } else if edges.contains(&Edge::Overlap) {
        0.5
    } else {
        1.0
    }
}

/// Whether a pixel differs so much from the mean that its own blur is visible, like a highlight's.
fn has_outlier<const N: usize>(mean: &Light<N>, fragments: &[Option<Fragment<N>>; 4]) -> bool {
    let threshold = VISIBLE_EXCESS * PI * mean.coc_px * mean.coc_px;
    fragments
        .iter()
        .flatten()
        .any(|fragment| fragment.content.iter().zip(&mean.content).any(|(a, b)| (a - b).abs() > threshold))
}

/// The pixels of block `x, y`.
fn block_pixels(x: usize, y: usize) -> [(usize, usize); 4] {
    [(2 * x, 2 * y), (2 * x + 1, 2 * y), (2 * x, 2 * y + 1), (2 * x + 1, 2 * y + 1)]
}

/// The mean of four fragments, over the known ones.
fn mean<const N: usize>(fragments: [Option<Fragment<N>>; 4]) -> Option<Light<N>> {
    let mut mean = Light { content: [0.0; N], alpha: 0.0, coc_px: 0.0, hidden: false };
    let known = fragments.iter().flatten();
    for Fragment { content, weight, coc_px } in known.clone() {
        mean.content.iter_mut().zip(content).for_each(|(sum, value)| *sum += 0.25 * value);
        mean.alpha += 0.25 * weight;
        mean.coc_px += coc_px;
    }
    let count = known.count();
    mean.coc_px /= count as f32;
    (count > 0).then_some(mean)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The reduced points of a picture of constant CoC radius −6, and their shares.
    fn reduced_picture(value: fn(usize, usize) -> f32) -> (ReducedShares, Grid<1>) {
        let visible =
            |x: usize, y: usize| Some(Fragment { content: [value(x, y)], weight: 1.0, coc_px: -6.0 });
        let surface = (&Plane::filled(5, 5, -6.0), &[Edge::None; 25][..]);
        reduce_points(visible, surface, 0.4)
    }

    #[test]
    fn a_reduced_point_has_the_energy_and_the_centre_of_its_four_pixels() {
        let (shares, grid) = reduced_picture(|x, y| (x + 10 * y) as f32 / 100.0);
        assert_eq!(grid.rows.len(), 2, "the fifth row has no partner");
        let point = grid.rows[1][1];
        // The sum of pixels 22, 23, 32 and 33.
        assert!((point.light.content[0] - 1.1).abs() < 1e-6, "the sum of all four: {point:?}");
        assert_eq!(point.light.alpha, 4.0, "four pixels");
        assert_eq!((point.column, grid.centre), (2, Centre::Corner), "their common corner");
        assert_eq!([shares.at(3, 3), shares.at(4, 4)], [1.0, 0.0], "the fifth column keeps its own points");
    }

    #[test]
    fn a_highlight_is_not_reduced() {
        // Its excess over the mean of four is 3/4 · 4 = 3. Over its disc of 113 pixels that is 0.0265, more than 1/64 of white.
        let (shares, grid) = reduced_picture(|x, y| if (x, y) == (1, 1) { 4.0 } else { 0.0 });
        assert_eq!([shares.at(0, 0), shares.at(2, 0)], [0.0, 1.0], "its block keeps its own points");
        assert_eq!(grid.rows[0].len(), 1, "others are reduced");
    }

    #[test]
    fn focus_edges_and_depth_steps_are_not_reduced() {
        assert_eq!(surface_share([2.0; 4], 0.4), 1.0, "a diameter of 4 px");
        assert_eq!(surface_share([-1.9; 4], 0.4), 0.0, "less");
        assert_eq!(surface_share([10.0, 10.0, 10.0, 14.0], 0.4), 1.0, "within δ of one another");
        assert_eq!(surface_share([10.0, 10.0, 10.0, 14.1], 0.4), 0.0, "two surfaces");
        assert_eq!(surface_share([-10.0, -10.0, 10.0, 10.0], 0.4), 0.0, "on either side of focus");
        assert_eq!(overlap([Edge::None, Edge::None, Edge::Overlap, Edge::Near]), 0.0, "partial occlusion");
        assert_eq!(
            overlap([Edge::None, Edge::None, Edge::None, Edge::Overlap]),
            0.5,
            "near it, half and half"
        );
    }
}
