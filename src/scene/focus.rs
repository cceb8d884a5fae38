//! ANALYZE: which parts of the camera's picture are in focus.
//!
//! Cost: one read of each pixel's fragments. Memory: one plane.

use super::{OPAQUE_ALPHA, Scene};
use crate::image::Plane;
use crate::lens::SHARP_COC_PX;

/// Shares of a picture's pixels by the position of their visible surface; they sum to 1, or to 0 for a picture without pixels.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
#[non_exhaustive]
pub struct FocusShares {
    /// In front of focus: CoC radius of [`SHARP_COC_PX`] or more.
    pub in_front: f64,
    /// In focus.
    pub in_focus: f64,
    /// Behind focus.
    pub behind: f64,
    /// Without a fragment.
    pub empty: f64,
}

impl FocusShares {
    /// The shares of the picture whose [`Scene::seen_coc_px`] is `coc_px`.
    pub fn from_coc(coc_px: &Plane) -> Self {
        let share = |is_counted: fn(f32) -> bool| {
            let count = coc_px.values().iter().filter(|&&coc| is_counted(coc)).count();
            count as f64 / coc_px.values().len().max(1) as f64
        };
        Self {
            in_front: share(|coc| coc <= -SHARP_COC_PX),
            in_focus: share(|coc| coc.abs() < SHARP_COC_PX),
            behind: share(|coc| coc >= SHARP_COC_PX),
            empty: share(f32::is_nan),
        }
    }
}

impl Scene {
    /// Signed CoC radius in picture pixels of the most visible fragment of each pixel of the frame, at its middle sample; NaN for an empty
    /// pixel.
    pub fn seen_coc_px(&self) -> Plane {
        let ((width, height), [columns, rows]) = (self.frame_size(), self.outside_px);
        let s = self.supersample;
        let sample = |pixel: usize| pixel * s + s / 2;
        Plane::from_fn(width, height, |x, y| self.seen_at(sample(x + columns), sample(y + rows)))
    }

    fn seen_at(&self, x: usize, y: usize) -> f32 {
        let (mut transmittance, mut max_visibility, mut seen) = (1.0, 0.0, f32::NAN);
        for layer in &self.layers {
            let alpha = layer.alpha.get(x, y);
            if transmittance * alpha > max_visibility {
                (max_visibility, seen) = (transmittance * alpha, layer.coc_px.get(x, y));
            }
            transmittance *= 1.0 - alpha;
            if alpha >= OPAQUE_ALPHA {
                break;
            }
        }
        seen
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Layer;
    use crate::stack::StackKind;

    /// A scene one sample high: for each layer alpha and CoC radius of its samples.
    fn scene<const W: usize>(layers: &[[(f32, f32); W]], supersample: usize) -> Scene {
        let layers = layers.iter().map(|layer| Layer {
            color: std::array::from_fn(|_| Plane::zeros(W, supersample)),
            alpha: Plane::from_fn(W, supersample, |x, _| layer[x].0),
            coc_px: Plane::from_fn(W, supersample, |x, _| layer[x].1),
        });
        Scene::new(layers.collect(), StackKind::Coverage, supersample, 10.0)
    }

    #[test]
    fn a_pixel_has_the_radius_of_its_most_visible_fragment() {
        let front = [(1.0, -3.0), (0.25, -3.0), (0.75, -3.0), (0.0, 0.0)];
        let seen = scene(&[front, [(1.0, 2.0), (1.0, 2.0), (1.0, 2.0), (0.0, 0.0)]], 1).seen_coc_px();
        assert_eq!(seen.values()[..3], [-3.0, 2.0, -3.0]);
        assert!(seen.get(3, 0).is_nan(), "an empty pixel");
    }

    #[test]
    fn a_supersampled_pixel_has_the_radius_of_its_middle_sample() {
        let seen = scene(&[[(1.0, -3.0), (1.0, 5.0), (1.0, -4.0), (1.0, 6.0)]], 2).seen_coc_px();
        assert_eq!(seen.values(), [5.0, 6.0]);
    }

    #[test]
    fn every_pixel_is_counted_once() {
        let row = [-7.0, -1.0, -0.9, 0.0, 0.9, 1.0, 3.0, 9.0, f32::NAN, 2.0];
        let shares = FocusShares::from_coc(&Plane::from_fn(10, 1, |x, _| row[x]));
        assert_eq!(shares, FocusShares { in_front: 0.2, in_focus: 0.3, behind: 0.4, empty: 0.1 });
        assert_eq!(FocusShares::from_coc(&Plane::zeros(0, 0)), FocusShares::default());
    }
}
