//! Light from an environment that surfaces reflect, shaded anew for each point of the lens.
//!
//! A stack has colours as the centre of the lens sees them. Another point of the lens sees another part of the environment in a glossy
//! surface, which Lee, Eisemann & Seidel 2009, "Depth-of-Field Rendering with Multiview Synthesis", section 5, compute anew for each ray. Here
//! that is done in difference form: what a ray meets has the colour of the stack, changed by the difference of two models, of the ray's
//! view and of the view of the lens's centre ([`EnvironmentShading`]). Whatever the model gets wrong of both cancels: Fresnel terms, the split sum, and
//! the light that the surface has from elsewhere.
//!
//! [`RadianceMap`] is the picture, [`Orientation`] how it lies in the world, [`Prefiltered`] its blur by roughness, [`SplitSum`] the share
//! of it that a surface reflects.
//!
//! Memory: the picture, and a third more for its smaller sizes while it is blurred; 48 bytes a fragment that reflects.
//! Limits: an environment knows of nothing that stands in its way, so only fragments whose mirror direction meets nothing are shaded by it.

mod map;
mod orientation;
mod points;
mod prefilter;
mod shading;
mod split_sum;

pub use map::RadianceMap;
pub use orientation::Orientation;
pub use prefilter::Prefiltered;
pub use shading::{EnvironmentShading, EnvironmentStats, Sight, SurfacePlanes};
pub use split_sum::SplitSum;

use crate::settings::Lobe;
use glam::{Mat3, Vec3};

/// An environment as surfaces reflect it.
#[derive(Debug, Clone, PartialEq)]
pub struct Environment {
    light: Prefiltered,
    shares: SplitSum,
    /// From camera space to that of the map.
    map_from_camera: Mat3,
    lobe: Lobe,
}

/// How a surface reflects.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Gloss {
    /// Its normal in camera space (x right, y up, z to the viewer), of length 1.
    pub normal: Vec3,
    /// Share of the light that it reflects along its normal: F0, by channel.
    pub specular: [f32; 3],
    /// Its roughness, 0 for a mirror; the microfacets' α is its square.
    pub roughness: f32,
}

impl Environment {
    /// The environment of `map`, which lies in camera space as `map_from_camera` says. `is_needed` says which roughness occurs between two.
    pub fn new(
        map: RadianceMap,
        map_from_camera: Mat3,
        lobe: Lobe,
        is_needed: impl Fn([f32; 2]) -> bool,
    ) -> Self {
        Self { light: Prefiltered::new(map, lobe, is_needed), shares: SplitSum::new(), map_from_camera, lobe }
    }

    /// Light that `gloss` reflects towards a viewer who looks along `view`, of length 1, in camera space.
    ///
    /// Microfacets: the split sum of Karis 2013, `L(r, α) · (F0 · A + B)`. Phong: `L(r, n) · F`, with Schlick's `F` of the view.
    pub fn reflected(&self, view: Vec3, gloss: &Gloss) -> [f32; 3] {
        let along = view.dot(gloss.normal);
        let towards = self.map_from_camera * (view - 2.0 * along * gloss.normal);
        let light = self.light.radiance(towards, gloss.roughness);
        let roughness = match self.lobe {
            Lobe::Ggx => gloss.roughness,
            Lobe::Phong => 0.0,
        };
        let [scale, bias] = self.shares.at((-along).max(0.0), roughness);
        std::array::from_fn(|k| light[k] * (gloss.specular[k] * scale + bias))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gloss(normal: Vec3, roughness: f32) -> Gloss {
        Gloss { normal: normal.normalize(), specular: [1.0, 0.5, 0.0], roughness }
    }

    #[test]
    fn a_mirror_shows_the_map_where_its_reflection_points() {
        // A texel at a quarter of the width and half of the height: +X. A mirror at 45° turns a view along −z to +x.
        let map = RadianceMap::from_fn(64, 32, |x, y| {
            if (15..=16).contains(&x) && (15..=16).contains(&y) { [4.0; 3] } else { [0.0; 3] }
        });
        let environment = Environment::new(map, Mat3::IDENTITY, Lobe::Ggx, |_| false);
        let seen = environment.reflected(Vec3::NEG_Z, &gloss(Vec3::new(1.0, 0.0, 1.0), 0.0));
        // Schlick at 45°: (1 − cos 45°)⁵ = 0.002.
        let fresnel = (1.0 - 0.5f32.sqrt()).powi(5);
        for (seen, specular) in seen.into_iter().zip([1.0, 0.5, 0.0]) {
            let expected = 4.0 * (specular * (1.0 - fresnel) + fresnel);
            assert!((seen - expected).abs() < 1e-4, "{seen}, expected {expected}");
        }
        let other = environment.reflected(Vec3::NEG_Z, &gloss(Vec3::new(-1.0, 0.0, 1.0), 0.0));
        assert_eq!(other, [0.0; 3], "the other way round it is dark");
    }

    #[test]
    fn in_an_even_environment_no_surface_changes_with_the_view_but_by_its_share() {
        for lobe in [Lobe::Ggx, Lobe::Phong] {
            let environment =
                Environment::new(RadianceMap::from_fn(16, 8, |_, _| [2.0; 3]), Mat3::IDENTITY, lobe, |_| {
                    true
                });
            for roughness in [0.0, 0.05, 0.3, 0.5, 1.0] {
                let surface = gloss(Vec3::new(0.2, -0.1, 1.0), roughness);
                let view = Vec3::new(0.1, 0.2, -1.0).normalize();
                let model = if lobe == Lobe::Ggx { roughness } else { 0.0 };
                let [scale, bias] = SplitSum::new().at(-view.dot(surface.normal), model);
                let [red, _, blue] = environment.reflected(view, &surface);
                assert!((red - 2.0 * (scale + bias)).abs() < 1e-4, "{lobe:?}, roughness {roughness}: {red}");
                assert!((blue - 2.0 * bias).abs() < 1e-4, "{lobe:?}, roughness {roughness}: {blue}");
            }
        }
    }
}
