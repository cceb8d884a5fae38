//! `shear`: the default method. The stack in slices of equal CoC radius, sheared for each lens sample.
//!
//! In `(x, y, c)` space a lens ray is straight, so all fragments of one CoC radius, seen from lens point `u`, are their own
//! image shifted by `−c·u`. The picture is the mean over `N` views `(u, j)`, lens point and place in the pixel, of the first
//! fragment each ray meets. That is what casting `N` rays a pixel gives, visibility correlated over the lens included, at
//! the price of about one masked add for each visible pixel and view. It converges to [`super::accumulate`].
//!
//! Passes, each a function of its own:
//!
//! | pass | module | does |
//! | --- | --- | --- |
//! | highlights | [`highlights`] | takes bright points out, to be drawn as exact discs |
//! | merge | [`Scene::merged`] | samples of a supersampled stack → coverage peels |
//! | fill | [`Scene::filled`] | a guessed surface where the stack has none |
//! | bins, keys, runs | [`bins`], [`keys`], [`runs`] | stretches of fragments that move together |
//! | prefilter | [`prefilter`] | closes the gaps between lens samples |
//! | paint | [`canvas`], [`mod@paint`] | the views |
//! | draw | [`highlights`], [`bokeh`] | the discs |
//! | resolve | [`resolve`] | anti-aliasing in focus |
//!
//! On a GPU ([`gpu`], `shaders/methods/shear.wgsl`) it is the pixels that look for fragments, and no runs are made.
//!
//! Cost: rows × views × (bins + pixels). Memory: the scene, in which it works, the runs, and the picture. Limits: knows only what the
//! peels know; content past the frame is its border repeated.

mod cost;
mod parameters;
mod passes;
mod bins;
mod bokeh;
mod canvas;
#[cfg(feature = "gpu")]
mod gpu;
mod highlights;
mod keys;
mod paint;
mod prefilter;
mod reach;
mod resolve;
mod runs;
mod sampler;
mod saved;

use crate::error::Error;
use crate::image::Image;
#[cfg(feature = "gpu")]
use crate::methods::contract::GpuBackend;
use crate::methods::contract::Plan;
use crate::methods::contract::{LensSampling, Method, MethodInfo, Progress, Role, Sampler};
use crate::methods::cost::Cost;
use crate::methods::laws::{Deviation, Law};
use crate::scene::{Effect, EffectKind, Inputs, Layer, Scene, Workload};
use crate::settings::{ParameterTable, Parameters};
use highlights::Highlight;
use parameters::ShearParameters;
use sampler::ShearSampler;

/// Ours.
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
                law: Law::NoCracksAcrossCorners,
                within: [0.0, 0.02],
                reason: "from bin to bin a view may move across the corner of a sample, where a ray passes its sides",
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
        let frame = (scene.picture_size(), scene.field);
        Box::new(ShearSampler::new(plan, frame, load(scene, plan)))
    }

    /// More than rays gain: the prefilter.
    fn gain_db(&self) -> [f64; 2] {
        [21.5, 1.25]
    }
}

/// The layers to paint, at picture resolution, and the highlights taken out of them.
fn load(mut scene: Scene, plan: &Plan) -> (Vec<Layer>, Vec<Highlight>) {
    let highlights = if plan.does(EffectKind::Highlights) {
        highlights::extract(&mut scene.layers, plan, scene.supersample)
    } else {
        Vec::new()
    };
    let scene = if plan.does(EffectKind::Fill) { scene.filled() } else { scene.merged() };
    (scene.layers, highlights)
}
