//! Bright fragments: what each has beyond its surroundings, and how far its depth is that of the light.

use super::occluders::share_that_covers;
use crate::parallel;
use crate::scene::surface::merge_gap_px;
use crate::scene::{Antialiasing, Layer, Scene, brightness, isolation};
use glam::Vec2;

/// How much brighter than the threshold a fragment is whose whole excess is a light: a quarter of a stop.
const WHOLE_LIGHT_FROM: f32 = 1.19;

/// Half the side of the square around a fragment whose fragments below the threshold are its surroundings, in samples.
const SURROUNDINGS: usize = 4;

/// A bright fragment.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spark {
    /// Layer, column and row.
    pub(super) place: [usize; 3],
    pub(super) coc_px: f32,
    pub(super) alpha: f32,
    /// Colour beyond that of its surroundings.
    pub(super) excess: [f32; 3],
    /// Share of the excess that is light.
    pub(super) share: f32,
    /// Share that the peels before it hide from all of the lens: see [`share_that_covers`].
    pub(super) hidden: f32,
    /// How far its colour is an average over the pixel: see [`Antialiasing`].
    pub(super) antialiased: f32,
    /// Whether its colour may be of another surface than its depth: see [`mixes`].
    pub(super) mixes: bool,
    /// How far its depth is its light's own: see [`own_depth`].
    pub(super) own_depth: f32,
}

impl Spark {
    /// Its position in samples.
    pub(super) fn position(&self) -> Vec2 {
        Vec2::new(self.place[1] as f32, self.place[2] as f32)
    }

    /// Its light: the largest of its channels.
    pub(super) fn energy(&self) -> f32 {
        self.share * brightness(self.excess)
    }
}

/// The fragments of `scene` brighter than `threshold`, by layer and row.
pub(super) fn sparks(scene: &Scene, threshold: f32) -> Vec<Spark> {
    let rows = scene.layers.len() * scene.height();
    let in_row = |row: usize| {
        let (index, y) = (row / scene.height(), row % scene.height());
        let columns = flagged(&scene.layers[index], y, threshold);
        columns.into_iter().filter_map(|x| spark(scene, [index, x, y], threshold)).collect()
    };
    parallel::flat_map(rows, &in_row)
}

/// Columns of row `y` with fragments brighter than `threshold`.
fn flagged(layer: &Layer, y: usize, threshold: f32) -> Vec<usize> {
    let [red, green, blue] = layer.color.each_ref().map(|plane| plane.row(y));
    // Most rows hold none, which one comparison a value tells.
    let any = |row: &[f32]| row.iter().fold(false, |any, &value| any | (value > threshold));
    if ![red, green, blue].into_iter().any(any) {
        return Vec::new();
    }
    let alpha = layer.alpha.row(y);
    let is_bright = |x: &usize| brightness([red[*x], green[*x], blue[*x]]) > threshold && alpha[*x] > 0.0;
    (0..red.len()).filter(is_bright).collect()
}

/// The bright fragment at `place`; `None` inside of a bright area.
fn spark(scene: &Scene, place: [usize; 3], threshold: f32) -> Option<Spark> {
    let [index, x, y] = place;
    let (layer, supersample) = (&scene.layers[index], scene.supersample);
    let (color, coc_px) = (layer.color_at(x, y), layer.coc_px.get(x, y));
    let share = isolation(layer, [x, y], supersample) * share_of_light(brightness(color) / threshold);
    let base = (share > 0.0).then(|| surroundings(layer, x, y, threshold))?;
    let mixes = mixes(&scene.layers, &scene.antialiasing, [x / supersample, y / supersample]);
    Some(Spark {
        place,
        coc_px,
        alpha: layer.alpha.get(x, y),
        excess: std::array::from_fn(|k| color[k] - base[k]),
        share,
        hidden: hidden_at(&scene.layers[..index], [x, y], coc_px),
        antialiased: scene.antialiasing.at(x / supersample, y / supersample),
        mixes,
        own_depth: if mixes { own_depth(layer, x, y, threshold) } else { 1.0 },
    })
}

/// Share of the excess of a fragment `times` as bright as the threshold that is light.
fn share_of_light(times: f32) -> f32 {
    ((times - 1.0) / (WHOLE_LIGHT_FROM - 1.0)).clamp(0.0, 1.0)
}

/// Whether colours at picture pixel `x, y` may be of another surface than their depth: one picture with depth has averages over the pixel
/// and a depth at its centre, whereas each peel holds its own surface's colours.
fn mixes(layers: &[Layer], antialiasing: &Antialiasing, [x, y]: [usize; 2]) -> bool {
    layers.len() == 1 && antialiasing.at(x, y) >= 0.5
}

/// Mean colour of the surfaces around `x, y` that are no brighter than `threshold`, as the colour of a fragment of the same coverage, at
/// most the fragment's own. Without such surfaces, its own colour scaled to the threshold.
fn surroundings(layer: &Layer, x: usize, y: usize, threshold: f32) -> [f32; 3] {
    let (own, own_alpha) = (layer.color_at(x, y), layer.alpha.get(x, y));
    let (mut sum, mut alpha_sum) = ([0.0; 3], 0.0);
    for [nx, ny] in dim_around(layer, [x, y], threshold) {
        sum.iter_mut().zip(layer.color_at(nx, ny)).for_each(|(sum, value)| *sum += value);
        alpha_sum += layer.alpha.get(nx, ny);
    }
    std::array::from_fn(|k| {
        let around = if alpha_sum > 0.0 { sum[k] / alpha_sum } else { own[k] * threshold / brightness(own) };
        (own_alpha * around).min(own[k])
    })
}

/// The fragments around `place` whose surfaces are no brighter than `threshold`. The rim of a light covers little of its pixels: it is dim,
/// and none of them.
fn dim_around(layer: &Layer, [x, y]: [usize; 2], threshold: f32) -> impl Iterator<Item = [usize; 2]> {
    let rows = y.saturating_sub(SURROUNDINGS)..=(y + SURROUNDINGS).min(layer.height() - 1);
    let columns = x.saturating_sub(SURROUNDINGS)..=(x + SURROUNDINGS).min(layer.width() - 1);
    let places = rows.flat_map(move |ny| columns.clone().map(move |nx| [nx, ny]));
    places.filter(move |&[nx, ny]| {
        let alpha = layer.alpha.get(nx, ny);
        alpha > 0.0 && brightness(layer.color_at(nx, ny)) <= threshold * alpha
    })
}

/// How far the depth of a bright fragment at `x, y` is its light's own, 0 … 1: not that of a surface beside the light, which the
/// fragment shows in part.
fn own_depth(layer: &Layer, x: usize, y: usize, threshold: f32) -> f32 {
    let coc_px = layer.coc_px.get(x, y);
    let difference = |[nx, ny]: [usize; 2]| (layer.coc_px.get(nx, ny) - coc_px).abs();
    let least = dim_around(layer, [x, y], threshold).map(difference).fold(f32::INFINITY, f32::min);
    (least / merge_gap_px(coc_px) - 1.0).clamp(0.0, 1.0)
}

/// Share of a fragment at `x, y` that the fragments of `in_front` at the same place hide from all of the lens.
fn hidden_at(in_front: &[Layer], [x, y]: [usize; 2], coc_px: f32) -> f32 {
    let passing = in_front.iter().fold(1.0, |passing: f32, layer| {
        let covers = share_that_covers(coc_px, layer.coc_px.get(x, y));
        passing * (1.0 - covers * layer.alpha.get(x, y).clamp(0.0, 1.0))
    });
    1.0 - passing
}
