//! Lens rays against the stack, one by one: the obviously right answer that everything else is measured by.
//!
//! Haeberli & Akeley 1990, "The Accumulation Buffer", and Cook, Porter & Carpenter 1984, "Distributed Ray Tracing", with
//! the stack for a scene. A fragment is the square of its sample times an interval of CoC depth: its own `c`, and half the
//! way to each of its four neighbours in the peel that lies within half a pixel, so that surfaces have no cracks. A ray
//! `(p + j + c·u, c)` walks the samples it passes over, `c` rising, and meets the fragments of each whose intervals overlap
//! the ray's stay there, nearest first; what a fragment lets through goes on.
//!
//! Past the frame's border the last sample goes on for ever. A ray that leaves without a hit says nothing where the
//! stack's background is closed, and is transparent where it is open.
//!
//! Cost: pixels × rays × samples passed × layers; no shortcut is taken that could change the answer: only where a tile of samples has
//! nothing at all at a ray's CoC depth does the ray pass it as a whole. Memory: none but the picture. Limits: knows only what the peels know.
//! GPU twin: `shaders/methods/accumulate.wgsl`.

mod cost;
#[cfg(feature = "gpu")]
mod gpu;
mod parameters;
mod tiles;
mod volume;

pub(crate) use volume::Volume;

use crate::error::Error;
use crate::image::Image;
use crate::lens::Rays;
#[cfg(feature = "gpu")]
use crate::methods::contract::GpuBackend;
use crate::methods::contract::Plan;
use crate::methods::contract::{LensSampling, Method, MethodInfo, Progress, Role, Sampler};
use crate::methods::cost::Cost;
use crate::methods::shared::{RaySampler, Tracer};
use crate::scene::{EffectKind, Layer, Scene, Workload};
use crate::settings::ParameterTable;
use parameters::AccumulateParameters;

/// The reference.
#[derive(Debug)]
pub(in crate::methods) struct Accumulate;

impl Method for Accumulate {
    fn info(&self) -> MethodInfo {
        MethodInfo {
            name: "accumulate",
            source: "Haeberli & Akeley 1990; Cook, Porter & Carpenter 1984",
            role: Role::Reference,
            summary: "lens rays against the stack, one by one, no shortcut",
            effects: &[
                EffectKind::BladeCurvature,
                EffectKind::Squeeze,
                EffectKind::ApertureImage,
                EffectKind::CatsEye,
                EffectKind::SphericalAberration,
                EffectKind::AxialColor,
            ],
            lens_samples: Some("rays"),
            steps: &["16", "64", "256"],
            deviations: &[],
        }
    }

    fn parameters(&self) -> ParameterTable {
        ParameterTable::of::<AccumulateParameters>()
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
        Some(self)
    }
}

impl LensSampling for Accumulate {
    fn begin<'p>(&self, scene: Scene, plan: &'p Plan) -> Box<dyn Sampler + 'p> {
        Box::new(RaySampler::<Accumulation>::new(scene, plan))
    }
}

/// The rays of every pixel, and what they are followed through.
#[derive(Debug)]
struct Accumulation {
    volume: Volume<Layer>,
    rays: Rays,
}

impl Tracer for Accumulation {
    type Scratch = ();

    fn new(scene: Scene, plan: &Plan, rays: usize) -> Self {
        Self { volume: Volume::owning(scene, plan), rays: plan.optics.rays(rays) }
    }

    fn pixel(&self, x: usize, y: usize, (): &mut ()) -> [f32; 4] {
        self.volume.pixel(x, y, &self.rays)
    }
}
