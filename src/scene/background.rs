//! The background of a picture: what lens rays meet behind all layers.
//!
//! A pixel through which nothing is seen but the background, at least in part, shows that nothing lies behind its fragments. A pixel that
//! is hidden shows nothing of the kind: what lies behind its last fragment is unknown. So the background is a surface of its own at
//! infinity, with a share in each pixel: 1 where at least [`CLEAR_FROM`] of the light passes all fragments, 0 where none does, and
//! proportional to it between the two. A ray of transmittance `l` that has passed all fragments ends in the background with
//! `min(l, share)`; the rest of it is lost, which means that the stack has nothing there.
//!
//! Where a ray ends in a hidden pixel, it has passed beside what hides it. If the pixel on that side is clear, the background
//! continues behind the fragment: a lone object is as transparent at its blurred edges as its coverage says. Most of the light has to pass
//! that pixel ([`BESIDE_FROM`]): the fractions of rims rarely add up to 1, and what they leave of a closed scene is no background.
//!
//! Both pixels lie within the largest CoC radius of the ray's own pixel, and shares are continuous in alpha: no sample changes the
//! background elsewhere.

use super::layer::{Layer, OPAQUE_ALPHA};
use crate::image::Plane;
use crate::parallel;
use glam::IVec2;

/// Transmittance of all fragments of a pixel from which on rays that end there meet nothing but the background.
///
/// With a transmittance of 1 here, rays that pass beside translucent fragments and end behind them would be lost in part, which makes
/// their blurred edges too opaque: by 0.08 for a disc of alpha 0.5, against 0.01 with a tenth.
const CLEAR_FROM: f32 = 0.1;

/// Transmittance of the pixel beside a fragment up to which it says nothing of what is behind the fragment; from there on it says so in
/// proportion, wholly where it is clear.
const BESIDE_FROM: f32 = 0.5;

/// The background of a scene in which it is visible somewhere.
#[derive(Debug, Clone, PartialEq)]
pub struct Background {
    /// Share of the background in each pixel of the picture, 0 … 1.
    share: Plane,
    /// Share of the background behind a fragment that a ray passes beside in each pixel, 0 … 1.
    beside: Plane,
    /// Signed CoC radius of the last fragment of each pixel, the farthest of its samples, in picture pixels.
    last_coc_px: Plane,
    /// CoC radius at infinity in picture pixels.
    coc_infinity_px: f32,
}

impl Background {
    /// The background behind `layers`, which have `supersample` samples per picture pixel along each axis; `None` where no pixel shows
    /// it.
    pub(super) fn behind(layers: &[Layer], supersample: usize, coc_infinity_px: f32) -> Option<Self> {
        let first = layers.first()?;
        if layers.iter().any(is_opaque) {
            return None;
        }
        let (width, height) = (first.width() / supersample, first.height() / supersample);
        let [mut share, mut beside, mut last_coc_px] = [(); 3].map(|()| Plane::zeros(width, height));
        let planes = [&mut share, &mut beside, &mut last_coc_px].map(Plane::values_mut);
        parallel::for_each_row_of(planes, width, &|y, [share, beside, last_coc_px]| {
            for (x, ((share, beside), last)) in share.iter_mut().zip(beside).zip(last_coc_px).enumerate() {
                let samples = (0..supersample * supersample).map(|i| {
                    through(layers, x * supersample + i % supersample, y * supersample + i / supersample)
                });
                let (sum, farthest) = samples
                    .fold((0.0, f32::NEG_INFINITY), |(sum, farthest), (t, coc)| (sum + t, coc.max(farthest)));
                let transmittance = sum / (supersample * supersample) as f32;
                *share = (transmittance / CLEAR_FROM).min(1.0);
                *beside = ((transmittance - BESIDE_FROM) / (1.0 - BESIDE_FROM)).max(0.0);
                *last = if farthest.is_finite() { farthest } else { coc_infinity_px };
            }
        });
        let visible = share.values().iter().any(|&share| share > 0.0);
        visible.then_some(Self { share, beside, last_coc_px, coc_infinity_px })
    }

    /// Share of the background in each pixel of the picture, 0 … 1.
    pub fn share(&self) -> &Plane {
        &self.share
    }

    /// Share of the background behind a fragment that a ray passes beside in each pixel, 0 … 1.
    pub fn beside(&self) -> &Plane {
        &self.beside
    }

    /// Signed CoC radius of the last fragment of each pixel in picture pixels.
    pub fn last_coc_px(&self) -> &Plane {
        &self.last_coc_px
    }

    /// Signed CoC radius at infinity in picture pixels.
    pub fn coc_infinity_px(&self) -> f32 {
        self.coc_infinity_px
    }

    /// Number of pixels that show the background, at least in part.
    pub(super) fn pixels(&self) -> usize {
        self.share.values().iter().filter(|&&share| share > 0.0).count()
    }

    /// Share of the background where a ray ends that is at pixel `at(c)` at the CoC radius `c`; past the border, the border's pixel.
    #[inline]
    pub fn met_by(&self, at: impl Fn(f32) -> IVec2) -> f32 {
        let last = IVec2::new(self.share.width() as i32, self.share.height() as i32) - 1;
        let clamped = |pixel: IVec2| {
            let pixel = pixel.clamp(IVec2::ZERO, last);
            (pixel.x as usize, pixel.y as usize)
        };
        let (x, y) = clamped(at(self.coc_infinity_px));
        let share = self.share.get(x, y);
        if share >= 1.0 {
            return share;
        }
        let (x, y) = clamped(at(self.last_coc_px.get(x, y)));
        share.max(self.beside.get(x, y))
    }
}

fn is_opaque(layer: &Layer) -> bool {
    parallel::all(layer.height(), &|y| layer.alpha.row(y).iter().all(|&alpha| alpha >= OPAQUE_ALPHA))
}

/// Transmittance of all fragments of a sample, and the CoC radius of the last one; `−∞` without fragments.
fn through(layers: &[Layer], x: usize, y: usize) -> (f32, f32) {
    layers.iter().fold((1.0, f32::NEG_INFINITY), |(transmittance, last), layer| match layer.alpha.get(x, y) {
        alpha if alpha <= 0.0 => (transmittance, last),
        alpha if alpha >= OPAQUE_ALPHA => (0.0, layer.coc_px.get(x, y)),
        alpha => (transmittance * (1.0 - alpha), layer.coc_px.get(x, y)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A layer of one row, `(alpha, CoC radius)` each.
    fn layer(fragments: &[(f32, f32)]) -> Layer {
        let plane = |value: &dyn Fn((f32, f32)) -> f32| {
            Plane::from_fn(fragments.len(), 1, |x, _| value(fragments[x]))
        };
        let alpha = plane(&|(alpha, _)| alpha);
        Layer { color: std::array::from_fn(|_| alpha.clone()), alpha, coc_px: plane(&|(_, coc)| coc) }
    }

    fn shares(layers: &[Layer], supersample: usize) -> Option<Vec<f32>> {
        Background::behind(layers, supersample, 5.0).map(|background| background.share.row(0).to_vec())
    }

    #[test]
    fn the_share_is_that_of_the_light_that_passes_all_fragments_and_saturates_at_a_tenth() {
        let front = layer(&[(1.0, -2.0), (0.0, 0.0), (0.9, -2.0), (0.98, -2.0), (0.5, 1.0)]);
        let back = layer(&[(0.0, 0.0), (0.0, 0.0), (0.5, 3.0), (0.0, 0.0), (0.9995, 3.0)]);
        let found = shares(&[front, back], 1).unwrap();
        for (found, expected) in found.into_iter().zip([0.0, 1.0, 0.5, 0.2, 0.0]) {
            assert!((found - expected).abs() < 1e-5, "{found}, expected {expected}");
        }
    }

    #[test]
    fn a_scene_that_hides_its_background_everywhere_has_none() {
        assert_eq!(shares(&[layer(&[(0.5, 1.0), (0.0, 0.0)]), layer(&[(1.0, 3.0), (1.0, 3.0)])], 1), None);
        assert_eq!(shares(&[layer(&[(1.0, 1.0), (0.0, 0.0)]), layer(&[(0.0, 3.0), (1.0, 3.0)])], 1), None);
    }

    #[test]
    fn the_share_of_a_pixel_is_from_the_mean_of_its_samples() {
        let plane = |f: &dyn Fn(usize, usize) -> f32| Plane::from_fn(4, 2, f);
        let alpha = plane(&|x, y| f32::from(u8::from(x < 2 || (x, y) != (3, 1))));
        let layer =
            Layer { color: std::array::from_fn(|_| alpha.clone()), coc_px: plane(&|x, _| x as f32), alpha };
        let background = Background::behind(&[layer], 2, 5.0).unwrap();
        assert_eq!(background.share.row(0), [0.0, 1.0], "a quarter of the second pixel is empty");
        assert_eq!(background.last_coc_px.row(0), [1.0, 3.0], "the farthest sample of each");
    }

    #[test]
    fn a_ray_that_ends_behind_an_object_meets_the_background_that_it_passed_beside_it() {
        // An object of CoC radius −4 in columns 4 … 7; at infinity the radius is 5.
        let row: Vec<(f32, f32)> =
            (0..12).map(|x| if (4..8).contains(&x) { (1.0, -4.0) } else { (0.0, 0.0) }).collect();
        let background = Background::behind(&[layer(&row)], 1, 5.0).unwrap();
        let met = |x: f32, u: f32| background.met_by(|c| IVec2::new((x + c * u + 0.5).floor() as i32, 0));
        assert_eq!(met(1.0, 0.2), 1.0, "it ends beside the object");
        assert_eq!(met(4.0, 0.5), 1.0, "it ends behind it and has passed it on its left");
        assert_eq!(met(5.0, 0.1), 0.0, "through the object, which a ray does not pass");
    }

    #[test]
    fn a_rim_that_is_little_transparent_says_nothing_of_what_is_behind_an_object_beside_it() {
        // The object's rim lets 0.3 of the light pass, in column 3.
        let row: Vec<(f32, f32)> = (0..12).map(|x| if x == 3 { (0.7, -4.0) } else { (1.0, -4.0) }).collect();
        let background = Background::behind(&[layer(&row)], 1, 5.0).unwrap();
        let met = |x: f32, u: f32| background.met_by(|c| IVec2::new((x + c * u + 0.5).floor() as i32, 0));
        assert_eq!(met(0.5, 0.5), 1.0, "it ends in the rim itself");
        assert_eq!(met(5.0, 0.5), 0.0, "it ends behind the object and has passed the rim");
    }
}
