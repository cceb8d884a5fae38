//! Sum over the lens rays of one pixel.

/// A pixel is empty if at most this fraction of its rays hit anything.
pub(in crate::methods) const MIN_HIT: f64 = 1e-9;

/// Sum over the rays of one pixel, in double precision: in single precision the error would grow over thousands of samples.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::methods) struct RaySum {
    pub(in crate::methods) color: [f64; 3],
    pub(in crate::methods) missed: f64,
    /// Rays left out of the mean, because the stack has no data for what they would hit.
    pub(in crate::methods) discarded: f64,
}

impl RaySum {
    /// Adds premultiplied `color`, attenuated by `transmittance`.
    pub(in crate::methods) fn add(&mut self, color: [f32; 3], transmittance: f32) {
        self.color.iter_mut().zip(color).for_each(|(sum, value)| *sum += f64::from(value * transmittance));
    }

    /// Mean over `rays` rays: rays that hit nothing are transparent where the background is transparent, and left out of the mean
    /// where it is closed.
    pub(in crate::methods) fn mean(&self, rays: usize, transparent_background: bool) -> [f32; 4] {
        let known = rays as f64 - self.discarded;
        let hit = known - self.missed;
        let weight = if transparent_background { known } else { hit };
        if hit <= MIN_HIT * rays as f64 {
            return [0.0; 4];
        }
        let [r, g, b] = self.color.map(|sum| (sum / weight) as f32);
        [r, g, b, (hit / weight) as f32]
    }
}
