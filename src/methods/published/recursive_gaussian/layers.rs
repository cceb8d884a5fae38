//! The depth layers: blur and depth boundaries of each.
//!
//! Layers are numbered from the layer in focus, negative in front of it: the paper's `k − k_f`.

use super::parameters::RecursiveGaussianParameters;

/// Maximum number of layers. The outermost ones take everything beyond.
pub(super) const MAX_LAYERS: usize = 512;

/// The layers of one scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Layers {
    /// Number of layers in front of the one in focus.
    pub front: i32,
    /// Number of layers behind the one in focus.
    pub back: i32,
    coc_per_sigma: f32,
    anchor: f32,
    coc_infinity_px: f32,
}

/// Standard deviation in pixels of the cascade's blur at a layer: `σ̂_k = |k − k_f|` (eq. 14).
pub(super) fn cascade_sigma_px(layer: i32) -> f32 {
    layer.unsigned_abs() as f32
}

/// Standard deviation in pixels of a layer's total blur: `σ_k² = n(n+1)(2n+1)/6`, `n = |k − k_f|`.
///
/// This is eq. 15 in closed form. Its recursion has to run away from focus: `σ_k² = σ̂_k² + σ²` of the next layer
/// towards focus.
pub(super) fn sigma_px(layer: i32) -> f32 {
    let n = f64::from(layer.unsigned_abs());
    (n * (n + 1.0) * (2.0 * n + 1.0) / 6.0).sqrt() as f32
}

impl Layers {
    /// The layers for CoC radii of `coc_range_px` and a lens whose CoC radius at infinity is `coc_infinity_px`.
    ///
    /// "auto" makes as many as are needed to place the range between the outermost boundaries (section 3.2.3). A
    /// fixed number is added layer by layer to the side whose uncovered range is larger. Behind focus layers end
    /// where no depth has their CoC (eq. 8).
    pub(super) fn new(
        coc_range_px: [f32; 2],
        coc_infinity_px: f32,
        parameters: &RecursiveGaussianParameters,
    ) -> Self {
        let &RecursiveGaussianParameters { coc_per_sigma, anchor, .. } = parameters;
        let mut layers = Self { front: 0, back: 0, coc_per_sigma, anchor, coc_infinity_px };
        while layers.count() < parameters.layers.unwrap_or(MAX_LAYERS) {
            let front = layers.boundary_px(-layers.front) - coc_range_px[0];
            let end = layers.boundary_px(layers.back);
            let back = if end < coc_infinity_px { coc_range_px[1] - end } else { f32::NEG_INFINITY };
            if parameters.layers.is_none() && front.max(back) <= 0.0 {
                break;
            }
            *(if front >= back { &mut layers.front } else { &mut layers.back }) += 1;
        }
        layers
    }

    /// The paper's `K`.
    pub(super) fn count(&self) -> usize {
        (self.front + 1 + self.back) as usize
    }

    /// Signed CoC radius in pixels of `layer`: half the diameter `d_k` that its blur represents (eq. 10).
    fn radius_px(&self, layer: i32) -> f32 {
        0.5 * self.coc_per_sigma * sigma_px(layer) * layer.signum() as f32
    }

    /// Signed CoC radius in pixels of the boundary `z_k` between `layer` and the next farther one: midway between
    /// theirs (eq. 9) unless `anchor` differs.
    fn boundary_px(&self, layer: i32) -> f32 {
        let (nearer, farther) = (self.radius_px(layer), self.radius_px(layer + 1));
        (1.0 - self.anchor) * nearer + self.anchor * farther
    }

    /// Depth of the boundary `z_k` between `layer` and the next farther one.
    pub(super) fn boundary(&self, layer: i32) -> f32 {
        depth(self.boundary_px(layer), self.coc_infinity_px)
    }
}

/// Depth at which the signed CoC radius is `coc_px`, measured from the focal plane, in units in which it equals
/// `coc_px` near the plane: `c_inf (z − z_f) / z_f = c / (1 − c / c_inf)`, the inverse of the CoC law (eqs. 6 and 7).
///
/// The matting is linear in depth, so any linear scale of depth is valid; this one is exact near focus. Infinity, and
/// values rounded beyond it, map to the largest finite depth.
#[inline(always)]
pub(super) fn depth(coc_px: f32, coc_infinity_px: f32) -> f32 {
    let depth = coc_px / (1.0 - coc_px / coc_infinity_px);
    if coc_px >= coc_infinity_px { f32::MAX } else { depth.min(f32::MAX) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layers(range: [f32; 2], infinity: f32, count: Option<usize>) -> Layers {
        let parameters = RecursiveGaussianParameters::default();
        Layers::new(range, infinity, &RecursiveGaussianParameters { layers: count, ..parameters })
    }

    #[test]
    fn the_closed_form_of_sigma_is_the_sum_of_the_cascade() {
        let mut sum = 0.0;
        for layer in 1..60 {
            sum += cascade_sigma_px(layer).powi(2);
            assert!((sigma_px(layer).powi(2) / sum - 1.0).abs() < 1e-6, "layer {layer}");
            assert_eq!(sigma_px(layer), sigma_px(-layer), "as much in front as behind");
        }
        assert_eq!([0, 1].map(sigma_px), [0.0, 1.0]);
        assert_eq!([2, 3].map(sigma_px), [5f32.sqrt(), 14f32.sqrt()], "1 + 4, and 9 more");
    }

    #[test]
    fn a_layers_gaussian_has_the_variance_of_its_disc() {
        let layers = layers([-30.0, 30.0], 1000.0, None);
        for layer in -5..=5 {
            let disc = layers.radius_px(layer).powi(2) / 4.0;
            assert!((disc - sigma_px(layer).powi(2)).abs() < 1e-4, "layer {layer}: r² / 4 = {disc}");
        }
    }

    #[test]
    fn boundaries_rise_and_lie_midway_between_the_layers_radii() {
        let layers = layers([-30.0, 30.0], 100.0, None);
        assert_eq!([-1, 0].map(|k| layers.boundary_px(k)), [-1.0, 1.0], "radii 0 and 2");
        for k in -20..20 {
            assert!(layers.boundary(k) <= layers.boundary(k + 1), "boundary {k}");
            assert_eq!(layers.boundary_px(k), -layers.boundary_px(-k - 1), "boundary {k} mirrored");
        }
    }

    #[test]
    fn depth_inverts_the_coc_law() {
        let infinity = 40.0;
        for coc in [-2000.0f32, -3.0, -1e-6, 0.0, 1e-6, 5.0, 39.0] {
            // c = c_inf (1 − z_f / z) with z / z_f = 1 + depth / c_inf.
            let ratio = 1.0 + f64::from(depth(coc, infinity)) / f64::from(infinity);
            let back = f64::from(infinity) * (1.0 - 1.0 / ratio);
            assert!((back - f64::from(coc)).abs() < 1e-4 * f64::from(coc.abs()).max(1e-3), "{coc}: {back}");
        }
        assert_eq!([40.0, 41.0].map(|coc| depth(coc, infinity)), [f32::MAX; 2], "infinity and beyond");
    }

    #[test]
    fn auto_makes_as_many_layers_as_the_range_needs() {
        // Radii 0, 2, 4.47, 7.48: boundaries 1, 3.24, 5.98, their mirror images in front.
        let sides = |range| {
            let layers = layers(range, 1000.0, None);
            (layers.front, layers.back)
        };
        assert_eq!(sides([-0.5, 0.5]), (1, 0), "the focal plane lies before the first boundary behind it");
        assert_eq!(sides([-3.0, 5.0]), (2, 2));
        assert_eq!(sides([-3.3, 1.0]), (3, 0));
        assert_eq!(sides([1.5, 2.0]), (0, 1), "no fragment at focus or in front of it");
    }

    #[test]
    fn behind_focus_layers_end_where_no_depth_has_their_coc() {
        let layers = layers([0.0, 500.0], 6.0, None);
        assert_eq!(layers.back, 3, "the boundary at 5.98 is the last below 6");
        assert_eq!(layers.boundary(3), f32::MAX);
    }

    #[test]
    fn a_fixed_number_of_layers_extends_the_less_covered_side() {
        let fixed = layers([-4.0, 30.0], 1000.0, Some(4));
        assert_eq!((fixed.front, fixed.back), (0, 3));
        let fixed = layers([-30.0, 4.0], 1000.0, Some(1));
        assert_eq!((fixed.front, fixed.back), (0, 0), "the layer in focus alone");
    }

    #[test]
    fn the_number_of_layers_is_bounded_for_any_range() {
        assert_eq!(layers([-1e9, 5.0], 10.0, None).count(), MAX_LAYERS);
    }
}
