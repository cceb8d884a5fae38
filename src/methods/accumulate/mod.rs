//! The reference method: traces every lens ray through the stack without approximation. Other methods are measured against it.
//!
//! Haeberli & Akeley 1990, "The Accumulation Buffer", and Cook, Porter & Carpenter 1984, "Distributed Ray Tracing", applied to
//! the stack. A fragment is a box: the square of its sample times an interval of CoC depth. The interval is its own `c`, extended
//! half-way to each of the four neighbours of the same surface ([`crate::scene::surface`]), so that surfaces have no
//! cracks. A ray `(p + j + c·u, c)` traverses the samples below it in order of rising `c`. In each sample it hits the fragments
//! whose intervals overlap the ray's interval there, nearest first; each attenuates the ray by its alpha, and a translucent surface
//! does so once, however many of its fragments the ray passes ([`surfaces`]).
//!
//! Past the frame's border the border samples are repeated. A ray that has passed all fragments is transparent by the background's
//! share of the pixel where it ends ([`crate::scene::Background`]); the rest of it is left out of the mean.
//!
//! Cost: pixels × rays × samples passed × layers. No shortcut changes the result: a ray skips a tile of samples only if the tile
//! has no fragment at the ray's CoC depths. Memory: the picture only. Limits: sees only what the peels contain.
//! GPU backend: `shaders/methods/accumulate.wgsl`.

mod cost;
#[cfg(feature = "gpu")]
mod gpu;
mod parameters;
mod surfaces;
mod tiles;
mod volume;

pub(crate) use volume::Volume;

use crate::error::Error;
use crate::image::Image;
use crate::lens::Rays;
#[cfg(feature = "gpu")]
use crate::methods::contract::GpuBackend;
use crate::methods::contract::{LensSampling, Method, MethodInfo, Plan, Progress, Role, Sampler};
use crate::methods::cost::Cost;
use crate::methods::shared::{RaySampler, Tracer};
use crate::scene::{EffectKind, Layer, Scene, Workload};
use crate::settings::ParameterTable;
use parameters::AccumulateParameters;

/// The reference method.
#[derive(Debug)]
pub(in crate::methods) struct Accumulate;

impl Method for Accumulate {
    fn info(&self) -> MethodInfo {
        MethodInfo {
            name: "accumulate",
            source: "Haeberli & Akeley 1990; Cook, Porter & Carpenter 1984",
            role: Role::Reference,
            summary: "every lens ray traced through the stack, without approximation",
            effects: &[
                EffectKind::Reflections,
                EffectKind::Environment,
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

    /// A pixel is the mean of what its rays hit.
    fn rows_around(&self, _plan: &Plan, reach_px: usize) -> Option<usize> {
        Some(reach_px)
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

/// The boxes of the stack, and the rays of every pixel.
#[derive(Debug)]
struct Accumulation {
    volume: Volume<Layer>,
    /// The rays of rows in turns.
    rays: Vec<Rays>,
}

impl Tracer for Accumulation {
    type Scratch = ();

    fn new(scene: Scene, plan: &Plan, rays: usize) -> Self {
        Self { volume: Volume::owning(scene, plan), rays: plan.optics.rays_in_turns(rays) }
    }

    fn pixel(&self, x: usize, y: usize, (): &mut ()) -> [f32; 4] {
        self.volume.pixel(x, y, &self.rays[y % self.rays.len()])
    }
}
