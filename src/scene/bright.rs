//! Bright fragments: which are lights, points that a few lens samples would render as dots, and how many discs they are.

use super::Layer;

/// Number of half-stop steps of brightness that [`super::SceneStats`] counts, from 1 up.
pub(crate) const BRIGHT_STEPS: usize = 32;

/// Bright, blurred fragments of one half stop of brightness.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub(crate) struct BrightStep {
    /// Number of fragments.
    pub fragments: usize,
    /// Estimated number of discs: one for each light ([`share_of_its_light`]), by the share of its excess that discs carry ([`isolation`],
    /// [`share_of_disc`]).
    pub discs: f64,
    /// Sum of the areas of these discs, `π c²` each, in picture pixels.
    pub disc_area_px: f64,
}

/// Lower end of step `step` of [`super::SceneStats::bright`], in scene-linear units.
pub(crate) fn bright_step_floor(step: usize) -> f32 {
    (0.5 * step as f32).exp2()
}

/// The step that `brightness` falls into.
pub(super) fn bright_step(brightness: f32) -> Option<usize> {
    let step = (brightness.log2() * 2.0).floor();
    (step >= 0.0).then_some((step as usize).min(BRIGHT_STEPS - 1))
}

/// Largest of red, green and blue.
#[inline(always)]
pub(crate) fn brightness([red, green, blue]: [f32; 3]) -> f32 {
    red.max(green).max(blue)
}

/// Share of the light of a bright fragment of the CoC radius `coc_px` that may be drawn as a disc: none up to a pixel, all from one and a
/// half on.
pub(crate) fn share_of_disc(coc_px: f32) -> f32 {
    ((coc_px.abs() - 1.0) / 0.5).clamp(0.0, 1.0)
}

/// Distance in picture pixels at which the surroundings of a bright fragment say whether it lies in an area.
const RING_PX: usize = 12;

/// Mean brightness around a fragment relative to its own: up to the first it is a light, from the second on it is part of an area, which
/// lens samples render without dots. At a straight edge it is five eighths.
const AREA_FROM: [f32; 2] = [0.25, 0.5];

/// Share of the excess of the fragment at `x, y` that discs may carry: all where the picture around it is dark, none inside of a bright area.
pub(crate) fn isolation(layer: &Layer, [x, y]: [usize; 2], supersample: usize) -> f32 {
    let (radius, diagonal) = (RING_PX * supersample, RING_PX * supersample * 17 / 24);
    let own = brightness(layer.color_at(x, y));
    let at = |distance: [usize; 2], [left, up]: [bool; 2]| {
        let moved = |from: usize, by: usize, back: bool| {
            if back { from.checked_sub(by) } else { Some(from + by) }
        };
        let column = moved(x, distance[0], left).filter(|&column| column < layer.width());
        let row = moved(y, distance[1], up).filter(|&row| row < layer.height());
        let near = column.zip(row).map_or(0.0, |(column, row)| brightness(layer.color_at(column, row)));
        (near / own).clamp(0.0, 1.0)
    };
    let signs = [[false, false], [false, true], [true, false], [true, true]];
    let diagonals = signs.map(|signs| at([diagonal; 2], signs));
    let straight = [
        at([radius, 0], signs[0]),
        at([radius, 0], signs[2]),
        at([0, radius], signs[0]),
        at([0, radius], signs[1]),
    ];
    let mean = diagonals.iter().chain(&straight).sum::<f32>() / 8.0;
    let [from, to] = AREA_FROM;
    ((to - mean) / (to - from)).clamp(0.0, 1.0)
}

/// The part of its light that the bright fragment at `x, y` is, by brightness: the parts of a light of at most 3 × 3 pixels add up to
/// about 1, those of a larger one to more.
pub(super) fn share_of_its_light(layer: &Layer, [x, y]: [usize; 2], supersample: usize) -> f32 {
    let rows = y.saturating_sub(supersample)..=(y + supersample).min(layer.height() - 1);
    let columns = x.saturating_sub(supersample)..=(x + supersample).min(layer.width() - 1);
    let sum: f32 = rows
        .flat_map(|row| columns.clone().map(move |column| brightness(layer.color_at(column, row)).max(0.0)))
        .sum();
    brightness(layer.color_at(x, y)) / sum
}

/// CoC radius in picture pixels from which on a light counts in full in [`super::SceneStats::barely_blurred_lights`].
pub(super) const BARELY_BLURRED_PX: f32 = 0.1;

/// How far a fragment is a light that lens samples render with noise: from none at 8 times white, or where both neighbours are as bright, to
/// all at 32 times white beside a neighbour of a quarter of the brightness.
pub(super) fn share_of_light(brightness: f32, around: [f32; 2]) -> f32 {
    let contrast = brightness / around[0].min(around[1]).max(1.0);
    let by = |ratio: f32| (0.5 * ratio.log2()).clamp(0.0, 1.0);
    by(brightness / 8.0) * by(contrast)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;

    /// A layer of 64 × 64 samples that are 10 times white where `is_bright(x, y)`, and black elsewhere.
    fn layer(is_bright: impl Fn(usize, usize) -> bool) -> Layer {
        let color = Plane::from_fn(64, 64, |x, y| if is_bright(x, y) { 10.0 } else { 0.0 });
        Layer {
            color: [(); 3].map(|()| color.clone()),
            alpha: Plane::filled(64, 64, 1.0),
            coc_px: Plane::zeros(64, 64),
        }
    }

    #[test]
    fn points_and_lines_are_lights_and_the_inside_and_the_edge_of_an_area_are_not() {
        let isolation = |layer: &Layer, place| isolation(layer, place, 1);
        let point = layer(|x, y| (x, y) == (32, 32) || (x, y) == (0, 63));
        assert_eq!([[32, 32], [0, 63]].map(|place| isolation(&point, place)), [1.0; 2], "also in a corner");
        assert_eq!(isolation(&layer(|x, _| x == 32), [32, 32]), 1.0, "a line");
        let area = layer(|x, _| x < 32);
        assert_eq!([10, 31].map(|x| isolation(&area, [x, 32])), [0.0; 2], "inside and at the edge");
    }

    #[test]
    fn the_parts_of_a_light_make_one_disc_whatever_the_samples_of_a_pixel() {
        for (supersample, side) in [(1, 1), (1, 2), (2, 2), (2, 3), (4, 4)] {
            let light = |x: usize, y: usize| (30..30 + side).contains(&x) && (30..30 + side).contains(&y);
            let layer = layer(light);
            let places = (30..30 + side).flat_map(|y| (30..30 + side).map(move |x| [x, y]));
            let sum: f32 = places.map(|place| share_of_its_light(&layer, place, supersample)).sum();
            assert!((sum - 1.0).abs() < 0.1, "{side} samples wide, {supersample} a pixel: {sum} discs");
        }
    }
}
