//! Sum over the lens rays of one pixel.

use crate::methods::contract::LostRays;

/// At most this fraction of a pixel's rays is rounding.
pub(in crate::methods) const MIN_HIT: f64 = 1e-9;

/// Sum over the rays of one pixel, in double precision: in single precision the error would grow over thousands of samples.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::methods) struct RaySum {
    pub(in crate::methods) color: [f64; 3],
    /// Rays that end in the background, weighted by transmittance.
    pub(in crate::methods) transparent: f64,
    /// Rays that end where the stack has neither a surface nor the background, weighted by transmittance.
    pub(in crate::methods) lost: f64,
    /// Rays left out of the mean, because they leave the frame.
    pub(in crate::methods) discarded: f64,
    /// Whether colours were shaded anew: a difference of models may leave less than nothing.
    pub(in crate::methods) shaded: bool,
}

impl RaySum {
    /// Adds premultiplied `color`, attenuated by `transmittance`.
    pub(in crate::methods) fn add(&mut self, color: [f32; 3], transmittance: f32) {
        self.color.iter_mut().zip(color).for_each(|(sum, value)| *sum += f64::from(value * transmittance));
    }

    /// Ends a ray with the transmittance `left` where the background's share is `share`: see [`crate::scene::Background`].
    pub(in crate::methods) fn end(&mut self, left: f32, share: f32) {
        let transparent = left.min(share);
        self.transparent += f64::from(transparent);
        self.lost += f64::from(left - transparent);
    }

    /// Mean over `rays` rays, of which lost ones count as `lost_rays` says.
    pub(in crate::methods) fn mean(&self, rays: usize, lost_rays: LostRays) -> [f32; 4] {
        let rays = rays as f64 - self.discarded;
        let known = rays - self.lost;
        let hit = known - self.transparent;
        let (weight, covered) = match lost_rays {
            LostRays::LeftOut => (known, hit),
            LostRays::Black => (rays, rays - self.transparent),
        };
        if weight <= MIN_HIT * rays {
            return [0.0; 4];
        }
        // Rays that hit nothing but light without alpha have a colour.
        let least = if self.shaded { 0.0 } else { f32::NEG_INFINITY };
        let [r, g, b] = self.color.map(|sum| ((sum / weight) as f32).max(least));
        [r, g, b, if covered > MIN_HIT * rays { (covered / weight) as f32 } else { 0.0 }]
    }
}
