//! The three layers of a pixel: the layer of a point (eq. 6), sums of points, and blending (eq. 7).
//!
//! Pixels are stored in blocks of [`LANES`]; all sums of a block are adjacent.

use crate::image::Plane;

/// Pixels in a block.
pub(super) const LANES: usize = 16;

/// One value per pixel of a block.
pub(super) type Lanes = [f32; LANES];

/// The bounds of the same-depth layer in a block of pixels.
#[derive(Debug, Clone)]
pub(super) struct Limits {
    /// `c_v − δ|c_v|`: a nearer point is in front.
    front: Lanes,
    /// `c_v + δ|c_v|`: a farther point is behind.
    behind: Lanes,
    /// Minimum and maximum of each.
    front_range: [f32; 2],
    behind_range: [f32; 2],
}

/// The bounds of the same-depth layer of a pixel whose visible CoC radius is `visible_px`: `c_v − δ|c_v|`, `c_v + δ|c_v|`.
pub(super) fn bounds(visible_px: f32, delta: f32) -> [f32; 2] {
    let width = delta * visible_px.abs();
    [visible_px - width, visible_px + width]
}

impl Limits {
    /// The bounds for visible CoC radii `visible_px`, a block or the remainder of a row, and δ `delta`.
    pub(super) fn new(visible_px: &[f32], delta: f32) -> Self {
        let last = visible_px.last().copied().unwrap_or(0.0);
        let at = |lane: usize| visible_px.get(lane).copied().unwrap_or(last);
        let front: Lanes = std::array::from_fn(|lane| bounds(at(lane), delta)[0]);
        let behind: Lanes = std::array::from_fn(|lane| bounds(at(lane), delta)[1]);
        let range = |values: &Lanes| {
            let widen = |[min, max]: [f32; 2], &value: &f32| [min.min(value), max.max(value)];
            values.iter().fold([f32::INFINITY, f32::NEG_INFINITY], widen)
        };
        Self { front_range: range(&front), behind_range: range(&behind), front, behind }
    }

    /// The bounds of all blocks of a picture, row by row.
    pub(super) fn from_picture(visible_px: &Plane, delta: f32) -> Vec<Self> {
        let row = |y| visible_px.row(y).chunks(LANES).map(|block| Self::new(block, delta));
        (0..visible_px.height()).flat_map(row).collect()
    }

    /// The layer of a point of CoC radius `coc_px` if it is the same in all pixels of the block.
    #[inline(always)]
    fn layer(&self, coc_px: f32) -> Option<usize> {
        if coc_px < self.front_range[0] {
            Some(0)
        } else if coc_px > self.behind_range[1] {
            Some(2)
        } else if coc_px >= self.front_range[1] && coc_px <= self.behind_range[0] {
            Some(1)
        } else {
            None
        }
    }
}

/// Sum of the points in one layer of a block of pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sum<const N: usize> {
    /// Content, premultiplied by alpha.
    pub content: [Lanes; N],
    /// Alpha.
    pub alpha: Lanes,
}

impl<const N: usize> Sum<N> {
    /// An empty sum.
    pub(super) const NONE: Self = Self { content: [[0.0; LANES]; N], alpha: [0.0; LANES] };

    /// Adds `content` and `alpha`, weighted by `weights`.
    #[inline(always)]
    pub(super) fn add(&mut self, weights: &Lanes, content: &[f32; N], alpha: f32) {
        for (sums, value) in self.content.iter_mut().zip(content) {
            for (sum, weight) in sums.iter_mut().zip(weights) {
                *sum += weight * value;
            }
        }
        for (sum, weight) in self.alpha.iter_mut().zip(weights) {
            *sum += weight * alpha;
        }
    }

    /// Adds another sum.
    #[inline(always)]
    pub(super) fn add_sum(&mut self, other: &Self) {
        for (sums, others) in self.content.iter_mut().zip(&other.content) {
            sums.iter_mut().zip(others).for_each(|(sum, other)| *sum += other);
        }
        self.alpha.iter_mut().zip(&other.alpha).for_each(|(sum, other)| *sum += other);
    }
}

/// The layers in front of the visible surface, at its depth, and behind it.
pub(super) type Layers<const N: usize> = [Sum<N>; 3];

/// A point to be splatted: content, alpha, CoC radius, and whether it is of the hidden image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Light<const N: usize> {
    /// Content, premultiplied by alpha.
    pub content: [f32; N],
    /// Alpha.
    pub alpha: f32,
    /// Signed CoC radius.
    pub coc_px: f32,
    /// Hidden points occlude nothing: they have no front layer.
    pub hidden: bool,
}

/// Adds a point, weighted by `weights`, to its layer in each pixel of a block (eq. 6).
#[inline(always)]
pub(super) fn add<const N: usize>(
    layers: &mut Layers<N>,
    weights: &Lanes,
    light: &Light<N>,
    limits: &Limits,
) {
    let Light { content, alpha, coc_px, hidden } = light;
    match limits.layer(*coc_px) {
        Some(0) if *hidden => {}
        Some(layer) => layers[layer].add(weights, content, *alpha),
        None => {
            let mut parts = [[0.0; LANES]; 3];
            for lane in 0..LANES {
                let weight = weights[lane];
                let front = if *coc_px < limits.front[lane] { weight } else { 0.0 };
                let behind = if *coc_px > limits.behind[lane] { weight } else { 0.0 };
                parts[0][lane] = front;
                parts[1][lane] = weight - front - behind;
                parts[2][lane] = behind;
            }
            for (layer, part) in layers.iter_mut().zip(&parts).skip(usize::from(*hidden)) {
                layer.add(part, content, *alpha);
            }
        }
    }
}

/// Blends the layers of pixel `lane` from back to front, normalised after each step so that alpha is one (eq. 7); and
/// the share of the pixel that the layers cover. `None` if no point reached the pixel.
#[inline(always)]
pub(super) fn blend<const N: usize>(layers: &Layers<N>, lane: usize) -> Option<([f32; N], f32)> {
    let (mut blended, mut covered) = (None, 0.0);
    for layer in layers.iter().rev() {
        let alpha = layer.alpha[lane];
        if alpha <= 0.0 {
            continue;
        }
        let content = layer.content.each_ref().map(|sums| sums[lane]);
        // With alpha over one, the transmittance is zero.
        let (behind, transmittance) =
            blended.map_or(([0.0; N], 0.0), |behind| (behind, (1.0 - alpha).max(0.0)));
        blended =
            Some(std::array::from_fn(|k| (content[k] + transmittance * behind[k]) / (alpha + transmittance)));
        // Not one minus what is uncovered, which loses the smallest alpha, that of light.
        covered = alpha.min(1.0) + (1.0 - alpha).max(0.0) * covered;
    }
    blended.map(|content| (content, covered))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn light(coc_px: f32, hidden: bool) -> Light<1> {
        Light { content: [2.0], alpha: 1.0, coc_px, hidden }
    }

    /// Alpha of a point in the three layers of two pixels with the visible CoC radii `visible_px`.
    fn alphas(visible_px: [f32; 2], light: Light<1>) -> [[f32; 2]; 3] {
        let mut layers = [Sum::NONE; 3];
        add(&mut layers, &[0.5; LANES], &light, &Limits::new(&visible_px, 0.25));
        layers.map(|layer| [layer.alpha[0], layer.alpha[1]])
    }

    #[test]
    fn the_layer_changes_at_a_coc_difference_of_delta_times_the_visible_one() {
        // δ = ¼ and c_v = −8: the same layer from −10 to −6, both inclusive.
        let layer_of = |coc_px| {
            let alphas = alphas([-8.0; 2], light(coc_px, false));
            alphas.iter().position(|alpha| alpha[0] == 0.5).unwrap()
        };
        assert_eq!([-10.01, -10.0, -6.0, -5.99].map(layer_of), [0, 1, 1, 2], "front, same, same, behind");
    }

    #[test]
    fn in_focus_any_difference_changes_the_layer() {
        let alphas = |coc_px| alphas([0.0; 2], light(coc_px, false)).map(|alpha| alpha[0]);
        assert_eq!(alphas(0.0), [0.0, 0.5, 0.0], "the visible surface");
        assert_eq!(alphas(-1e-3), [0.5, 0.0, 0.0], "slightly nearer");
        assert_eq!(alphas(1e-3), [0.0, 0.0, 0.5], "slightly farther");
    }

    #[test]
    fn the_layer_of_a_point_differs_between_pixels_of_a_block() {
        assert_eq!(
            alphas([-8.0, 20.0], light(-7.0, false)),
            [[0.0, 0.5], [0.5, 0.0], [0.0, 0.0]],
            "each by its own bounds"
        );
        assert_eq!(alphas([-8.0, 20.0], light(-7.0, true)), [[0.0, 0.0], [0.5, 0.0], [0.0; 2]], "hidden");
        assert_eq!(alphas([20.0; 2], light(-7.0, true)), [[0.0; 2]; 3], "hidden points have no front layer");
    }

    fn layers(values: [(f32, f32); 3]) -> Layers<1> {
        values.map(|(content, alpha)| Sum { content: [[content; LANES]], alpha: [alpha; LANES] })
    }

    #[test]
    fn layers_are_blended_back_to_front_and_normalised_each_time() {
        // Behind: 0.2 of alpha 0.4 is 0.5 when normalised. Same: 0.6 + 0.25 · 0.5 = 0.725. Front: 0.1 + 0.5 · 0.725 =
        // 0.4625.
        let ([blended], coverage) = blend(&layers([(0.1, 0.5), (0.6, 0.75), (0.2, 0.4)]), 3).unwrap();
        assert!((blended - 0.4625).abs() < 1e-6, "{blended}");
        assert!((coverage - (1.0 - 0.5 * 0.25 * 0.6)).abs() < 1e-6, "{coverage}");
    }

    #[test]
    fn blending_normalises_alpha_below_and_above_one() {
        let only = |content, alpha| blend(&layers([(0.0, 0.0), (content, alpha), (0.0, 0.0)]), 0);
        assert_eq!(only(0.25, 0.5), Some(([0.5], 0.5)), "alpha 0.5, no layer behind");
        assert_eq!(only(1.0, 2.0), Some(([0.5], 1.0)), "alpha 2");
        assert_eq!(only(0.0, 0.0), None, "alpha 0");
        assert_eq!(
            blend(&layers([(0.0, 0.0), (1.0, 2.0), (7.0, 1.0)]), 0),
            Some(([0.5], 1.0)),
            "the layer behind is occluded"
        );
    }
}
