//! View-dependent shading (section 5): what a ray sees reflected of an environment, from the properties of the surfaces in its cone.
//!
//! The paper extracts normals and shininess beside colours, mipmaps them for its cones, and computes a reflection where a ray hits. The
//! mipmaps here hold normal, reflectance, roughness and share of the fragments that reflect, each weighted by share and coverage. The reflection itself
//! is in difference form ([`crate::scene::environment`]): the colour of the cone, changed by what the ray's view and the centre's differ in.

use super::cones::Cones;
use super::layers::{Hit, Ray, Spacing};
use crate::methods::shared::Fragments;
use crate::scene::environment::{EnvironmentShading, Gloss, Sight};
use glam::Vec3;
use std::sync::Arc;

/// Normal, reflectance and roughness, times the last value: share of the reflection that the environment is, times coverage.
type Mixed = [f32; 8];

/// What surfaces reflect of an environment.
#[derive(Debug)]
pub(super) struct Glossy {
    environment: Arc<EnvironmentShading>,
    /// `None` without cones.
    cones: Option<Cones<8>>,
}

impl Glossy {
    /// What `fragments` reflect of `environment`, with mipmaps for cones of `per_coc_px` samples of diameter per pixel of CoC radius.
    pub(super) fn new(
        environment: Arc<EnvironmentShading>,
        fragments: &Fragments,
        spacing: Spacing,
        per_coc_px: Option<f32>,
    ) -> Self {
        let value = |sample, k| mixed(&environment, fragments, sample, k);
        let cones = per_coc_px.map(|per_coc_px| Cones::new(fragments, spacing, per_coc_px, value));
        Self { environment, cones }
    }

    /// By how much `ray`, which has `hit` a fragment of `layer`, sees more or less light reflected than the centre of the lens; `None` where nothing
    /// reflects the environment. Multiplied by coverage.
    pub(super) fn change(
        &self,
        fragments: &Fragments,
        hit: &Hit,
        ray: &Ray,
        layer: usize,
    ) -> Option<[f32; 3]> {
        let sight = Sight { place: ray.at(hit.at), vanishing: ray.at(self.environment.coc_infinity_px()) };
        let value = |sample, k| mixed(&self.environment, fragments, sample, k);
        let mean = self.cones.as_ref().and_then(|cones| cones.mean(hit, sight.place, layer, value));
        if let Some([x, y, z, red, green, blue, roughness, share]) = mean {
            if share <= 0.0 {
                return None;
            }
            let normal = Vec3::new(x, y, z).try_normalize()?;
            let gloss = Gloss {
                normal,
                specular: [red, green, blue].map(|f0| f0 / share),
                roughness: roughness / share,
            };
            return Some(self.environment.change_of(&gloss, &sight).map(|change| share * change));
        }
        let sample = column_and_row(fragments, hit.sample);
        let own = self.environment.layer_at(sample, hit.coc_px)?;
        let alpha = fragments.color(hit.sample, hit.fragment)[3];
        Some(self.environment.change(own, sample, &sight)?.map(|change| alpha * change))
    }
}

/// Column and row of a sample.
fn column_and_row(fragments: &Fragments, sample: usize) -> (usize, usize) {
    let width = fragments.size().0;
    (sample % width, sample / width)
}

/// What fragment `k` of `sample` adds to a mean.
fn mixed(environment: &EnvironmentShading, fragments: &Fragments, sample: usize, k: usize) -> Mixed {
    let at = column_and_row(fragments, sample);
    let layer = environment.layer_at(at, fragments.coc_px(sample)[k]);
    let Some((gloss, share)) = layer.and_then(|layer| environment.gloss(layer, at)) else { return [0.0; 8] };
    let share = share * fragments.color(sample, k)[3];
    let ([x, y, z], [red, green, blue]) = (gloss.normal.to_array(), gloss.specular);
    [x, y, z, red, green, blue, gloss.roughness, 1.0].map(|value| share * value)
}
