//! Sub-images: the picture divided by depth into parts of uniform blur.
//!
//! Kraus & Strengert 2007, "Depth-of-Field Rendering by Pyramidal Image Processing", as Kraus 2011, "Using Opaque Image Blur for
//! Real-Time Depth-of-Field Rendering", section 3, describes them. Sub-image `i` has blur radius `r_0 = 0`, `r_i = r_1·2^(|i|−1)`
//! (eq. 1) and is at the depth where the lens has that CoC radius (eqs. 2–4): `z_i = z_f / (1 ± r_i / r_∞)`, so its signed CoC
//! radius is `±r_i`; behind focus only `r_i < r_∞` exist. Its matting weight rises from `z_(i−2)` to `z_(i−1)`, is 1 up to `z_i`
//! and falls to 0 at `z_(i+1)`, linear in depth (Figure 2); the weights of the outermost stay 1 outward.
//!
//! The weights of neighbours overlap: the farther of two has weight 1 where the nearer one fades, so that compositing them blends
//! by the nearer one's weight.
//!
//! GPU version: `shaders/shared/sub_images.wgsl`.

use super::pyramid::max_levels;
#[cfg(feature = "gpu")]
use crate::gpu::mirrored;
use pulp::{Arch, NullaryFnOnce};

/// Text of `shaders/shared/sub_images.wgsl`.
#[cfg(feature = "gpu")]
pub(in crate::methods) const SUB_IMAGES_WGSL: &str = include_str!("../../../shaders/shared/sub_images.wgsl");

#[cfg(feature = "gpu")]
mirrored! {
    /// The matting weight of a sub-image: two [`Ramp`]s, each of which may be missing.
    pub(in crate::methods) struct Matting {
        rises: u32,
        rise_start: f32,
        rise_scale: f32,
        falls: u32,
        fall_start: f32,
        fall_scale: f32,
        inverse: f32,
    }
}

/// The sub-images that a picture needs.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::methods) struct SubImages {
    /// Signed CoC radius of each, nearest first, preceded by that of the next nearer number, which does not exist.
    anchors_px: Vec<f32>,
    /// Number `i` of the nearest sub-image, 0 or less.
    first: i32,
    /// `r_∞`: CoC radius at infinity.
    coc_infinity_px: f32,
}

/// Signed CoC radius of sub-image `i` (eq. 1).
fn radius_px(i: i32, first_radius_px: f32) -> f32 {
    let radius = if i == 0 { 0.0 } else { first_radius_px * ((i.abs() - 1) as f32).exp2() };
    if i < 0 { -radius } else { radius }
}

impl SubImages {
    /// The sub-images that the CoC range of a frame of this size requires, on either side of focus.
    pub(in crate::methods) fn new(
        first_radius_px: f32,
        coc_range_px: [f32; 2],
        coc_infinity_px: f32,
        frame: (usize, usize),
    ) -> Self {
        let max_number = max_levels(frame) as i32;
        let needed = |limit_px: f32| {
            (0..max_number).find(|&i| radius_px(i, first_radius_px) >= limit_px).unwrap_or(max_number)
        };
        let first = -needed(-coc_range_px[0]);
        let possible =
            (0..max_number).take_while(|&i| radius_px(i + 1, first_radius_px) < coc_infinity_px).count();
        let last = needed(coc_range_px[1]).min(possible as i32);
        let anchors_px = (first - 1..=last).map(|i| radius_px(i, first_radius_px)).collect();
        Self { anchors_px, first, coc_infinity_px }
    }

    /// The sub-images by number, farthest first.
    pub(in crate::methods) fn far_to_near(&self) -> impl Iterator<Item = i32> + use<> {
        let first = self.first;
        (first..first + self.anchors_px.len() as i32 - 1).rev()
    }

    /// Number of levels of the largest pyramid among them.
    pub(in crate::methods) fn max_levels(&self) -> usize {
        self.far_to_near().map(|i| i.unsigned_abs() as usize).max().unwrap_or(0)
    }

    /// Whether sub-image `i` is the nearest.
    pub(in crate::methods) fn is_nearest(&self, i: i32) -> bool {
        i == self.first
    }

    /// Matting weight `ω_i` of fragments of CoC radius `coc_px` (Figure 2).
    pub(in crate::methods) fn weigh(&self, i: i32, coc_px: &[f32], weights: &mut [f32]) {
        Arch::new().dispatch(Weigh { rise: self.rise(i), fall: self.fall(i), coc_px, weights });
    }

    /// The weight function of [`Self::weigh`], for a shader.
    #[cfg(feature = "gpu")]
    pub(in crate::methods) fn matting(&self, i: i32) -> Matting {
        let inverse = 1.0 / self.coc_infinity_px;
        let none = Ramp { start: 0.0, scale: 0.0, inverse };
        let (rise, fall) = (self.rise(i), self.fall(i));
        let [rises, falls] = [rise, fall].map(|ramp| u32::from(ramp.is_some()));
        let [rise, fall] = [rise, fall].map(|ramp| ramp.unwrap_or(none));
        Matting {
            rises,
            rise_start: rise.start,
            rise_scale: rise.scale,
            falls,
            fall_start: fall.start,
            fall_scale: fall.scale,
            inverse,
        }
    }

    /// Fraction of fragments of CoC radius `coc_px` that is not nearer than the range of sub-image `i`: the weight without its
    /// fall.
    pub(in crate::methods) fn weigh_not_nearer(&self, i: i32, coc_px: &[f32], weights: &mut [f32]) {
        Arch::new().dispatch(Weigh { rise: self.rise(i), fall: None, coc_px, weights });
    }

    fn index(&self, i: i32) -> usize {
        (i - self.first + 1) as usize
    }

    fn anchor(&self, i: i32) -> Option<f32> {
        self.anchors_px.get(self.index(i)).copied()
    }

    fn rise(&self, i: i32) -> Option<Ramp> {
        (!self.is_nearest(i))
            .then(|| self.ramp(self.anchors_px[self.index(i) - 2], self.anchors_px[self.index(i) - 1]))
    }

    fn fall(&self, i: i32) -> Option<Ramp> {
        self.anchor(i + 1).map(|end| self.ramp(self.anchors_px[self.index(i)], end))
    }

    /// From 0 at CoC radius `start` to 1 at `end`, linear in depth.
    fn ramp(&self, start: f32, end: f32) -> Ramp {
        let inverse = 1.0 / self.coc_infinity_px;
        Ramp { start, scale: (1.0 - end * inverse) / (end - start), inverse }
    }
}

/// `(z − z_start) / (z_end − z_start)` with `z = z_f / (1 − c / c_inf)`, in CoC radii and so without cancellation:
/// `(c − start) / (end − start) · (1 − end / c_inf) / (1 − c / c_inf)`.
#[derive(Debug, Clone, Copy)]
struct Ramp {
    start: f32,
    scale: f32,
    inverse: f32,
}

impl Ramp {
    #[inline(always)]
    fn at(self, coc_px: f32) -> f32 {
        // Rounding may give a CoC radius beyond that at infinity, for which depth would be negative.
        let nearness = (1.0 - coc_px * self.inverse).max(1e-6);
        ((coc_px - self.start) * self.scale / nearness).clamp(0.0, 1.0)
    }
}

/// Weights of one row; compiled for each instruction set.
struct Weigh<'a> {
    rise: Option<Ramp>,
    fall: Option<Ramp>,
    coc_px: &'a [f32],
    weights: &'a mut [f32],
}

impl NullaryFnOnce for Weigh<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { rise, fall, coc_px, weights } = self;
        weights.fill(1.0);
        if let Some(ramp) = rise {
            weights.iter_mut().zip(coc_px).for_each(|(weight, &coc)| *weight = ramp.at(coc));
        }
        if let Some(ramp) = fall {
            weights.iter_mut().zip(coc_px).for_each(|(weight, &coc)| *weight *= 1.0 - ramp.at(coc));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weight(images: &SubImages, i: i32, coc_px: f32) -> f32 {
        let mut weights = [0.0];
        images.weigh(i, &[coc_px], &mut weights);
        weights[0]
    }

    /// Sub-images −3 … 3 with radii 2, 4, 8 and `r_∞ = 40`.
    fn images() -> SubImages {
        SubImages::new(2.0, [-7.0, 7.0], 40.0, (640, 480))
    }

    #[test]
    fn blur_radii_double_from_sub_image_to_sub_image() {
        // Eq. 1: r_1 = 1.7, r_3 = 1.7 · 2².
        assert_eq!([-3, -1, 0, 1, 3].map(|i| radius_px(i, 1.7)), [-6.8, -1.7, 0.0, 1.7, 6.8]);
    }

    #[test]
    fn there_are_as_many_sub_images_as_the_blur_needs_and_none_past_infinity() {
        let numbers = |range, infinity| {
            SubImages::new(2.0, range, infinity, (640, 480)).far_to_near().collect::<Vec<_>>()
        };
        assert_eq!(numbers([-3.0, 2.0], 40.0), [1, 0, -1, -2], "radii 4, 2, 0 and 2");
        assert_eq!(numbers([0.0, 9.0], 9.0), [3, 2, 1, 0], "a fourth, of radius 16, would lie past infinity");
        assert_eq!(numbers([-1.0, 0.9], 1.0), [0, -1], "nothing behind focus blurs as much as the first");
        assert_eq!(numbers([-1e9, 0.0], 1.0).len(), 12, "640 pixels have 11 levels");
    }

    #[test]
    fn weights_are_trapezoids_in_depth() {
        let images = images();
        // z / z_f = 1 / (1 − c / 40): c = 2, 4 are at 20/19 and 10/9. Half way in depth is 1.08187, so c = 40 (1 − 1/1.08187).
        let half_way = 40.0 * (1.0 - 1.0 / (0.5 * (20.0 / 19.0 + 10.0 / 9.0)));
        let cases = [(0.0, 1.0, 0.0), (2.0, 1.0, 1.0), (half_way, 0.5, 1.0), (4.0, 0.0, 1.0)];
        for (coc, first, second) in cases {
            assert!((weight(&images, 1, coc) - first).abs() < 1e-5, "sub-image 1 at c = {coc}");
            assert!((weight(&images, 2, coc) - second).abs() < 1e-5, "sub-image 2 at c = {coc}");
        }
    }

    #[test]
    fn every_fragment_has_weight_1_in_some_sub_image() {
        for coc in [-900.0, -8.0, -3.1, -2.0, -0.1, 0.0, 1e-20, 1.9, 4.0, 7.9, 39.999, 40.0, 41.0, 900.0] {
            let images = images();
            let farthest = images.far_to_near().map(|i| weight(&images, i, coc)).find(|&weight| weight > 0.0);
            let whole = images.far_to_near().any(|i| weight(&images, i, coc) > 0.999);
            assert!(farthest.is_some() && whole, "c = {coc}");
        }
    }

    #[test]
    fn ramps_narrower_than_the_precision_of_depth_are_exact() {
        // Depths that are equal in single precision.
        let images = SubImages::new(0.5, [-3.0, 3.0], 1e9, (64, 64));
        assert!((weight(&images, 1, 0.75) - 0.5).abs() < 1e-6, "half way from 0.5 to 1");
    }
}
