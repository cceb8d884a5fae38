//! How far the rays of a pixel are spread over it.

use crate::methods::contract::Plan;
use crate::scene::{Antialiasing, Scene};

/// Extent of the origins of rays in each pixel of a picture: see [`Plan::jitter`].
#[derive(Debug, Clone)]
pub(in crate::methods) struct RayJitter {
    antialiasing: Antialiasing,
    /// Extent in a pixel whose colours are averages over it.
    of_averages: f32,
}

impl RayJitter {
    /// That of the picture of `scene` by `plan`.
    pub(in crate::methods) fn new(scene: &Scene, plan: &Plan) -> Self {
        // The samples of a supersampled stack are point samples of its own, finer grid.
        let of_averages = if scene.supersample > 1 { 1.0 } else { plan.averages_jitter };
        Self { antialiasing: scene.antialiasing.clone(), of_averages }
    }

    /// Extent over the whole pixel everywhere.
    #[cfg(test)]
    pub(in crate::methods) fn whole_pixels() -> Self {
        Self { antialiasing: Antialiasing::POINT_SAMPLES, of_averages: 1.0 }
    }

    /// Extent in picture pixel `x, y`, as a fraction of its width.
    #[inline]
    pub(in crate::methods) fn at(&self, x: usize, y: usize) -> f32 {
        self.of(self.antialiasing.at(x, y))
    }

    /// The extent in all pixels, if they have the same.
    #[cfg(feature = "gpu")]
    pub(in crate::methods) fn everywhere(&self) -> Option<f32> {
        self.antialiasing.everywhere().map(|antialiased| self.of(antialiased))
    }

    fn of(&self, antialiased: f32) -> f32 {
        1.0 - antialiased * (1.0 - self.of_averages)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;

    #[test]
    fn rays_start_from_less_of_a_pixel_the_more_its_colours_are_averages() {
        let shares = Plane::from_fn(3, 1, |x, _| 0.5 * x as f32);
        let jitter = RayJitter { antialiasing: Antialiasing::by_pixel(shares), of_averages: 0.5 };
        assert_eq!([0, 1, 2].map(|x| jitter.at(x, 0)), [1.0, 0.75, 0.5]);
    }
}
