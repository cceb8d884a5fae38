//! What the lens rays of one pixel add up to.

/// A pixel of whose rays no more than this share hit anything shows nothing.
pub(in crate::methods) const MIN_HIT: f64 = 1e-9;

/// What the rays of one pixel bring home, summed in double precision: thousands of samples would drift in single.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::methods) struct RaySum {
    pub(in crate::methods) color: [f64; 3],
    pub(in crate::methods) missed: f64,
    /// Rays that count for nothing, as nobody knows what they would have found.
    pub(in crate::methods) discarded: f64,
}

impl RaySum {
    /// Adds premultiplied `color` seen through `transmitted`.
    pub(in crate::methods) fn add(&mut self, color: [f32; 3], transmitted: f32) {
        self.color.iter_mut().zip(color).for_each(|(sum, value)| *sum += f64::from(value * transmitted));
    }

    /// The pixel after `rays` rays: light that found nothing is transparent where the background is open, and left out of
    /// the mean where it is closed.
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
