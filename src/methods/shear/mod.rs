//! `shear`: the default method. The stack is cut into slices of equal CoC radius, which are sheared for each lens sample.
//!
//! In `(x, y, c)` space a lens ray is straight, so that all fragments of one CoC radius, seen from lens point `u`, are their
//! own image shifted by `−c·u`. The picture is the mean over `N` views `(u, j)`, lens point and position in the pixel, of the
//! first fragment that each ray hits. This equals casting `N` rays per pixel, including visibility correlated over the lens, at
//! the cost of about one masked add for each visible pixel and view. It converges to [`super::accumulate`].
//!
//! Passes:
//!
//! | pass | module | does |
//! | --- | --- | --- |
//! | highlights | [`sparks`], [`lights`] | removes bright points, which are drawn as exact discs |
//! | merge | [`Scene::merged`] | samples of a supersampled stack → coverage layers, as many as the pixels need |
//! | disocclusion fill | [`Scene::filled`] | an estimated surface where the stack has none |
//! | reflections | [`mirrors`] | removes what mirrors show, which each ray looks up |
//! | bins | [`bins`] | slices of CoC radius |
//! | shown | [`shown`] | finds the fragments that some view may show, and leaves out the others |
//! | keys, spans | [`keys`], [`spans`] | ranges of fragments that move together |
//! | prefilter | [`prefilter`] | closes the gaps between lens samples |
//! | paint | [`canvas`], [`mod@paint`], [`sums`] | accumulates the views |
//! | near light | [`near`] | closes these gaps at the edges of strongly blurred near surfaces |
//! | draw | [`highlights`], [`occluders`], [`bokeh`], [`softening`] | adds the discs |
//! | resolve | [`resolve`] | anti-aliasing in focus |
//!
//! On a GPU ([`gpu`], `shaders/methods/shear.wgsl`) each pixel searches for its fragments, and no spans are made.
//!
//! Cost: rows × views × (bins + pixels). Memory: the scene, which is modified in place, the spans, and the picture. Limits:
//! only surfaces in the peels are known; past the frame the border is repeated.

mod bins;
mod bokeh;
mod canvas;
mod cost;
#[cfg(feature = "gpu")]
mod gpu;
mod hidden;
mod highlights;
mod keys;
mod lanes;
mod lights;
mod mirrors;
mod near;
mod occluders;
mod opaque_hits;
mod paint;
mod parameters;
mod passes;
mod picture;
mod prefilter;
mod prepare;
mod reach;
mod resolve;
mod row_mask;
mod row_sums;
mod row_views;
mod sampler;
mod saved;
mod shown;
mod softening;
mod spans;
mod sparks;
mod sums;
mod surroundings;
mod translucent_hits;
mod values;

use crate::error::Error;
use crate::image::Image;
#[cfg(feature = "gpu")]
use crate::methods::contract::GpuBackend;
use crate::methods::contract::{
    LensSampling, Method, MethodInfo, PixelFilter, Plan, Progress, Role, Sampler,
};
use crate::methods::cost::Cost;
use crate::methods::laws::{Deviation, Law};
use crate::scene::{Effect, EffectKind, Inputs, Scene, Workload};
use crate::settings::{ParameterTable, Parameters};
use parameters::ShearParameters;
use resolve::Resolve;
use sampler::ShearSampler;
use std::borrow::Cow;

/// The default method.
#[derive(Debug)]
pub(in crate::methods) struct Shear;

impl Method for Shear {
    fn info(&self) -> MethodInfo {
        MethodInfo {
            name: "shear",
            source: "this project",
            role: Role::Default,
            summary: "slices of equal blur, sheared for each lens sample and painted front to back",
            effects: &[
                EffectKind::Merge,
                EffectKind::Highlights,
                EffectKind::Fill,
                EffectKind::Reflections,
                EffectKind::Prefilter,
                EffectKind::Resolve,
                EffectKind::BladeCurvature,
                EffectKind::Squeeze,
                EffectKind::ApertureImage,
                EffectKind::CatsEye,
                EffectKind::SphericalAberration,
                EffectKind::AxialColor,
            ],
            lens_samples: Some("views"),
            steps: &["16", "64", "256"],
            deviations: &[Deviation {
                law: Law::PeelOrder,
                within: [0.0, 0.02],
                reason: "a rough surface goes on within its peel, and to another peel by half a pixel only: which peel holds it matters",
            }],
        }
    }

    fn parameters(&self) -> ParameterTable {
        ParameterTable::of::<ShearParameters>()
    }

    fn decide(&self, inputs: &Inputs<'_>, parameters: &Parameters) -> Result<Vec<Effect>, Error> {
        passes::decide(inputs, parameters.get())
    }

    fn cost(&self, plan: &Plan, workload: &Workload<'_>) -> Option<Cost> {
        Some(cost::cost(plan, workload))
    }

    fn rows_around(&self, plan: &Plan, reach_px: usize) -> Option<usize> {
        Some(surroundings::rows(plan, reach_px))
    }

    fn lens_sampling(&self) -> Option<&dyn LensSampling> {
        Some(self)
    }

    fn blur(&self, scene: Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        Ok(self.begin(scene, plan).picture(plan.lens_samples(), progress))
    }

    #[cfg(feature = "gpu")]
    fn gpu(&self) -> Option<&dyn GpuBackend> {
        Some(&gpu::ShearGpu)
    }
}

impl LensSampling for Shear {
    fn begin<'p>(&self, scene: Scene, plan: &'p Plan) -> Box<dyn Sampler + 'p> {
        Box::new(ShearSampler::new(scene, plan))
    }

    /// Larger than the gain of rays, because of the prefilter.
    fn gain_db(&self) -> [f64; 2] {
        [21.5, 1.25]
    }

    fn sampled<'s>(&self, scene: &'s Scene, plan: &Plan) -> Cow<'s, Scene> {
        if !plan.does(EffectKind::Highlights) {
            return Cow::Borrowed(scene);
        }
        let mut scene = scene.clone();
        mirrors::without_moving(&mut scene, plan, |scene| lights::extract(scene, plan));
        Cow::Owned(scene)
    }

    fn exact_lights(&self, scene: &Scene, plan: &Plan) -> Option<Image> {
        plan.does(EffectKind::Highlights).then(|| sampler::discs(scene.clone(), plan))?
    }

    fn filter(&self, scene: &Scene, plan: &Plan) -> Option<Box<dyn PixelFilter>> {
        Some(Box::new(Resolve::new(plan, scene)?))
    }
}
