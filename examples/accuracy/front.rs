//! The nearest surface of a scene, and its edges.

use thinlens::metrics::displayed;
use thinlens::scene::Scene;

/// CoC radius in picture pixels below which a fragment is in focus.
pub(crate) const FOCUSED_PX: f32 = 1.0;

/// Smallest difference in CoC radius between neighbouring pixels that is an edge, in picture pixels.
const EDGE_PX: f32 = 0.5;

/// A difference is an edge if it exceeds the smaller of those before and after it by this factor: on a slope all are equal.
const EDGE_CHANGE: f32 = 2.0;

/// Red, green and blue as shown on a display.
pub(crate) type Shown = [f32; 3];

/// Difference of two colours: the root of the mean squared difference of their display values.
pub(crate) fn contrast(color: Shown, other: Shown) -> f32 {
    let squares = color.into_iter().zip(other).map(|(a, b)| (a - b) * (a - b));
    (squares.sum::<f32>() / 3.0).sqrt()
}

/// What a frame shows without a lens, by picture pixel and without padding.
#[derive(Debug)]
pub(crate) struct Front {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Signed CoC radius of the nearest surface in picture pixels; that of infinity where there is none.
    pub(crate) coc_px: Vec<f32>,
    /// The pinhole picture.
    pub(crate) color: Vec<Shown>,
    /// The nearest surface in focus, hidden or not.
    pub(crate) focused: Vec<Option<Shown>>,
}

/// An edge between two surfaces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Edge {
    /// Signed CoC radius of its nearer side, in picture pixels.
    pub(crate) near_px: f32,
    /// [`contrast`] of both sides.
    pub(crate) contrast: f32,
}

/// The fragments of pixel `x, y` of the frame: layer, column and row of each sample that shows a surface; nearest layers first.
pub(crate) fn fragments(
    scene: &Scene,
    x: usize,
    y: usize,
) -> impl Iterator<Item = (usize, usize, usize)> + '_ {
    let s = scene.supersample;
    let [column, row] = [x + scene.outside_px[0], y + scene.outside_px[1]].map(|at| at * s);
    let samples = (0..s * s).map(move |i| (column + i % s, row + i / s));
    let of_layer = move |layer: usize| samples.clone().map(move |(x, y)| (layer, x, y));
    let is_surface = |&(layer, x, y): &(usize, usize, usize)| scene.layers[layer].alpha.get(x, y) > 0.0;
    (0..scene.layers.len()).flat_map(of_layer).filter(is_surface)
}

impl Front {
    /// What `scene` shows without a lens.
    pub(crate) fn new(scene: &Scene) -> Self {
        let (width, height) = scene.frame_size();
        let places = (0..width * height).map(|pixel| (pixel % width, pixel / width));
        let coc_px = |(layer, x, y): (usize, usize, usize)| scene.layers[layer].coc_px.get(x, y);
        let nearest = |(x, y)| fragments(scene, x, y).map(coc_px).fold(scene.coc_infinity_px, f32::min);
        let color = |(x, y)| {
            let [red, green, blue, _] = scene.pinhole_pixel(x + scene.outside_px[0], y + scene.outside_px[1]);
            [red, green, blue].map(displayed)
        };
        Self {
            width,
            height,
            coc_px: places.clone().map(nearest).collect(),
            color: places.clone().map(color).collect(),
            focused: places.map(|(x, y)| focused(scene, x, y)).collect(),
        }
    }

    /// The edge beside each pixel, that of the nearest surface if there are several.
    pub(crate) fn edges(&self) -> Vec<Option<Edge>> {
        let mut edges: Vec<Option<Edge>> = vec![None; self.coc_px.len()];
        let rows = (0..self.height).map(|y| (y * self.width, 1, self.width));
        for (first, step, length) in rows.chain((0..self.width).map(|x| (x, self.width, self.height))) {
            let at = |i: usize| first + i * step;
            let difference = |i: usize| (self.coc_px[at(i + 1)] - self.coc_px[at(i)]).abs();
            for i in 0..length.saturating_sub(1) {
                let before = if i > 0 { difference(i - 1) } else { 0.0 };
                let after = if i + 2 < length { difference(i + 1) } else { 0.0 };
                if difference(i) < EDGE_PX.max(EDGE_CHANGE * before.min(after)) {
                    continue;
                }
                let sides = [at(i), at(i + 1)];
                let edge = Edge {
                    near_px: self.coc_px[sides[0]].min(self.coc_px[sides[1]]),
                    contrast: contrast(self.color[sides[0]], self.color[sides[1]]),
                };
                for side in sides {
                    let other = edges[side].filter(|other| other.near_px < edge.near_px);
                    edges[side] = other.or(Some(edge));
                }
            }
        }
        edges
    }
}

/// The mean of the samples of the nearest layer of pixel `x, y` that are in focus.
fn focused(scene: &Scene, x: usize, y: usize) -> Option<Shown> {
    let is_focused =
        |&(layer, x, y): &(usize, usize, usize)| scene.layers[layer].coc_px.get(x, y).abs() < FOCUSED_PX;
    let (first, _, _) = fragments(scene, x, y).find(is_focused)?;
    let samples = fragments(scene, x, y).filter(is_focused).filter(|&(layer, _, _)| layer == first);
    let (mut sum, mut alpha) = ([0.0; 3], 0.0);
    for (layer, x, y) in samples {
        let layer = &scene.layers[layer];
        sum.iter_mut().zip(layer.color_at(x, y)).for_each(|(sum, value)| *sum += value);
        alpha += layer.alpha.get(x, y);
    }
    Some(sum.map(|sum| displayed(sum / alpha)))
}
