//! Fewer points where that does not show (section 5): four pixels as one, a quarter of the resolution.
//!
//! Pixels keep their own points in and near focus, where partial occlusion occurs, and where the four are not one surface.
//! Around partial occlusion both kinds overlap, as in the paper, but at half the weight of either.

use super::hidden::{Edge, Fragment};
use super::layers::Light;
use super::splat::{Grid, Point};
use super::sprites::{Centre, Sprite, Sprites};
use crate::image::Plane;
use rayon::prelude::*;

/// CoC radius from which points are reduced: a diameter of 4 pixels (section 5).
const LEAST_COC_PX: f32 = 2.0;

/// What a reduced point's four pixels add to the second moment of its blur: each lies half a pixel off the centre, in x and in y.
const AVERAGED_MOMENT: f32 = 0.25;

/// How much of each 2 × 2 block of pixels is splatted as one point.
#[derive(Debug)]
pub(super) struct Shares {
    width: usize,
    height: usize,
    shares: Vec<f32>,
}

impl Shares {
    /// The shares for what is visible and for its `edges`; four pixels are one surface while each is in the same layer as the
    /// others by eq. 6 with `delta`.
    pub(super) fn new(visible_px: &Plane, edges: &[Edge], delta: f32) -> Self {
        let (width, height) = (visible_px.width() / 2, visible_px.height() / 2);
        let share = |block: usize| {
            let places = four(block % width, block / width);
            let coc_px = places.map(|(x, y)| visible_px.get(x, y));
            let edges = places.map(|(x, y)| edges[y * visible_px.width() + x]);
            let [least, most] = coc_px.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |range, &coc_px| {
                [range[0].min(coc_px), range[1].max(coc_px)]
            });
            let radius = if least < 0.0 { -most } else { least };
            if radius < LEAST_COC_PX || most - least > delta * radius || edges.contains(&Edge::Near) {
                0.0
            } else if edges.contains(&Edge::Overlap) {
                0.5
            } else {
                1.0
            }
        };
        Self { width, height, shares: (0..width * height).into_par_iter().map(share).collect() }
    }

    /// No reduced points.
    pub(super) fn none() -> Self {
        Self { width: 0, height: 0, shares: Vec::new() }
    }

    /// Share of pixel `x, y` that is splatted with its neighbours.
    pub(super) fn at(&self, x: usize, y: usize) -> f32 {
        let (x, y) = (x / 2, y / 2);
        if x < self.width && y < self.height { self.shares[y * self.width + x] } else { 0.0 }
    }

    /// The reduced points of a picture of `visible(x, y)` fragments, blurred by `sprites`.
    pub(super) fn grid<const N: usize>(
        &self,
        visible: impl Fn(usize, usize) -> Option<Fragment<N>> + Sync,
        sprites: &Sprites,
    ) -> Grid<N> {
        let row = |y: usize| {
            let point = |x: usize| {
                let share = self.shares[y * self.width + x];
                let fragments = four(x, y).map(|(x, y)| if share > 0.0 { visible(x, y) } else { None });
                let light = mean(fragments)?;
                let sprite = sprite(light.coc_px, sprites.second_moment);
                // The mean stands for four pixels.
                let light = Light {
                    content: light.content.map(|value| 4.0 * share * value),
                    alpha: 4.0 * share * light.alpha,
                    ..light
                };
                Some(Point { column: 2 * x as i32, sprite, light })
            };
            (0..self.width).filter_map(point).collect()
        };
        let rows = (0..self.height).into_par_iter().map(row).collect();
        Grid { centre: Centre::Corner, rows }
    }
}

/// The pixels of block `x, y`.
fn four(x: usize, y: usize) -> [(usize, usize); 4] {
    [(2 * x, 2 * y), (2 * x + 1, 2 * y), (2 * x, 2 * y + 1), (2 * x + 1, 2 * y + 1)]
}

/// The mean of four fragments, over what of them is known.
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

/// The sprite of a reduced point, smaller by the second moment that averaging has added already.
fn sprite(coc_px: f32, second_moment: f32) -> Sprite {
    let square = (coc_px * coc_px - AVERAGED_MOMENT / second_moment).max(0.25 * coc_px * coc_px);
    Sprite::of(square.sqrt().copysign(coc_px))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::Aperture;

    #[test]
    fn a_reduced_point_has_the_energy_and_the_place_of_its_four_pixels() {
        let visible_px = Plane::filled(5, 5, -6.0);
        let shares = Shares::new(&visible_px, &[Edge::None; 25], 0.4);
        let visible =
            |x: usize, y: usize| Some(Fragment { content: [(x + 10 * y) as f32], weight: 1.0, coc_px: -6.0 });
        let grid = shares.grid(visible, &Sprites::new(Aperture::Disc, &[1.0]));
        assert_eq!(grid.rows.len(), 2, "the fifth row has no partner");
        let point = grid.rows[1][1];
        // Pixels 22, 23, 32 and 33.
        assert_eq!((point.light.content, point.light.alpha), ([110.0], 4.0), "the sum of all four");
        assert_eq!((point.column, grid.centre), (2, Centre::Corner), "where they meet");
        assert_eq!([shares.at(3, 3), shares.at(4, 4)], [1.0, 0.0], "the fifth column keeps its own points");
    }

    #[test]
    fn focus_edges_and_steps_keep_their_resolution() {
        let share = |coc_px: [f32; 4], edge| {
            let visible_px = Plane::from_fn(2, 2, |x, y| coc_px[x + 2 * y]);
            Shares::new(&visible_px, &[Edge::None, Edge::None, Edge::None, edge], 0.4).at(0, 0)
        };
        assert_eq!(share([2.0; 4], Edge::None), 1.0, "a diameter of 4 px");
        assert_eq!(share([-1.9; 4], Edge::None), 0.0, "less");
        assert_eq!(share([-8.0; 4], Edge::Near), 0.0, "partial occlusion");
        assert_eq!(share([-8.0; 4], Edge::Overlap), 0.5, "near it, half and half");
        assert_eq!(share([10.0, 10.0, 10.0, 14.0], Edge::None), 1.0, "within δ of one another");
        assert_eq!(share([10.0, 10.0, 10.0, 14.1], Edge::None), 0.0, "two surfaces");
        assert_eq!(share([-10.0, -10.0, 10.0, 10.0], Edge::None), 0.0, "on either side of focus");
    }

    #[test]
    fn the_smaller_sprite_and_the_four_pixels_spread_as_the_full_one() {
        // Moments add: ¼ of the squared radius of the disc, and ¼ for the pixels.
        for coc_px in [-2.5f32, 5.0, 20.0] {
            let reduced = sprite(coc_px, 0.25).coc_px();
            let spread = 0.25 * reduced * reduced + 0.25;
            // The radius is rounded to a 128th, its square to a 64th.
            assert!((spread / (0.25 * coc_px * coc_px) - 1.0).abs() < 1.0 / 60.0, "{coc_px}: {spread}");
            assert_eq!(reduced < 0.0, coc_px < 0.0, "on the same side of focus");
        }
    }
}
