//! `layer-rays`: lens rays against depth layers, by false position, thickened to cones.
//!
//! Lee, Eisemann & Seidel 2009, "Depth-of-Field Rendering with Multiview Synthesis". CoC depth is cut into layers of equal growth of
//! CoC (eq. 4), each of which keeps the nearest fragment of its interval at every sample. A lens ray walks the layers front
//! to back; within one it is intersected with the layer's height field ([`layers`]), and stops at the first hit. Layers that
//! hold nothing within reach are skipped ([`cull`]). What a hit brings home is what a cone around the ray sees there
//! ([`cones`]), and lens samples differ from pixel to pixel ([`samples`]).
//!
//! Where the paper is silent, or has something a stack has not:
//! * *Layers from peels.* A layer is not stored: it is the first fragment of its interval in a sample's sorted list, the same
//!   picture at the cost of the stack alone, however many layers there are.
//! * *Empty samples* count as the far bound until the search has found the surface, as the near bound after it.
//! * *Colours* are those of the sample that is hit, as a fragment is the square of its sample; only cones interpolate.
//! * *Translucent fragments* let the ray go on behind them, in the same layer too. What has been met is not met again in the
//!   overlap. After a cone the ray goes on in the next layer.
//! * *Where rays start.* The paper's go through pixel centres; these are spread over the pixel as the plan asks, which
//!   anti-aliases at no cost and is what the reference does.
//! * *Rays that leave the frame* are discarded, as in section 4.3: whole rays, and those that would be stopped outside the frame if its
//!   border's samples went on for ever; one that is outside where the border has nothing for it is taken to pass. Where all
//!   are discarded, the central one is left. Borders lose the outward part of the lens that way; with `discard` off the
//!   border's samples do go on for ever instead, as in the reference.
//! * *λ* is given for 32 samples only, see [`cones::sample_distance`].
//!
//! Left out: shading that depends on the view (section 5), which needs normals and materials, where the stack has colour only.
//!
//! Cost: pixels × rays × (layers within reach, and 3 to 6 look-ups in each that is not empty around the ray). Memory: the
//! stack; at most 64 N-buffers of at most 65536 blocks; mipmaps as large as the fragments that cones reach, a third of them as
//! a rule. Limits: knows only what the peels know; within a layer a ray may hit what it would have passed by (silhouettes gain
//! or lose up to half of δ), and step over things thinner than its way through the layer.
//! GPU twin: `shaders/methods/layer_rays.wgsl`.

mod cost;
mod parameters;
mod cones;
mod cull;
#[cfg(feature = "gpu")]
mod gpu;
mod layers;
mod samples;

use crate::error::Error;
use crate::image::Image;
#[cfg(feature = "gpu")]
use crate::methods::contract::GpuBackend;
use crate::methods::contract::Plan;
use crate::methods::contract::{LensSampling, Method, MethodInfo, Progress, Role, Sampler};
use crate::methods::cost::Cost;
use crate::methods::laws::{Deviation, Law};
use crate::methods::shared::RaySum;
use crate::methods::shared::{Fragments, RaySampler, Tracer};
use crate::scene::{EffectKind, OPAQUE_ALPHA, Scene, Workload};
use crate::settings::ParameterTable;
use cones::Cones;
use cull::Cull;
use glam::Vec2;
use layers::{Ray, Segment, Spacing};
use parameters::LayerRaysParameters;
use samples::Samples;

/// The method.
#[derive(Debug)]
pub(in crate::methods) struct LayerRays;

impl Method for LayerRays {
    fn info(&self) -> MethodInfo {
        MethodInfo {
            name: "layer-rays",
            source: "Lee, Eisemann & Seidel 2009",
            role: Role::Paper,
            summary: "lens rays against depth layers, by false position, thickened to cones",
            effects: &[EffectKind::BladeCurvature],
            lens_samples: Some("rays"),
            steps: &["8", "32", "128"],
            deviations: &[
                Deviation {
                    law: Law::Energy,
                    within: [0.97, 1.005],
                    reason: "with samples that differ from pixel to pixel, no two pixels share out a point's light exactly",
                },
                Deviation {
                    law: Law::Place,
                    within: [0.0, 0.1],
                    reason: "with samples that differ from pixel to pixel, no two pixels share out a point's light exactly",
                },
                Deviation {
                    law: Law::NoCracksAcrossCorners,
                    within: [-0.001, 0.01],
                    reason: "false position may step over the sample that holds the surface; the layer's overlap is too thin",
                },
                Deviation {
                    law: Law::Convergence,
                    within: [39.5, 42.5],
                    reason: "rays that are stopped outside the frame are discarded, where the reference repeats the border",
                },
            ],
        }
    }

    fn parameters(&self) -> ParameterTable {
        ParameterTable::of::<LayerRaysParameters>()
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

impl LensSampling for LayerRays {
    fn begin<'p>(&self, scene: Scene, plan: &'p Plan) -> Box<dyn Sampler + 'p> {
        Box::new(RaySampler::<LayerTracer>::new(scene, plan))
    }
}

/// Everything that rays are traced against.
#[derive(Debug)]
struct LayerTracer {
    samples: Samples,
    fragments: Fragments,
    spacing: Spacing,
    cull: Cull,
    cones: Option<Cones>,
    supersample: f32,
    /// Where in the pixel the rays lie, as a share of its width.
    jitter: f32,
    iterations: usize,
    /// Whether rays that leave the frame are left out.
    discard: bool,
    transparent_background: bool,
}

impl Tracer for LayerTracer {
    /// The layers that a pixel's rays can meet.
    type Scratch = Vec<usize>;

    fn new(scene: Scene, plan: &Plan, rays: usize) -> Self {
        let parameters = plan.parameters.get::<LayerRaysParameters>();
        let supersample = scene.supersample as f32;
        let fragments = Fragments::new(scene);
        let spacing = Spacing::new(plan.coc_range_px, parameters.delta_px, parameters.overlap);
        let distance = cones::sample_distance(rays, plan.optics.aperture.area());
        Self {
            samples: Samples::new(rays, plan.optics.aperture, parameters.jitter),
            cull: Cull::new(&fragments, spacing, supersample),
            cones: parameters.cones.then(|| Cones::new(&fragments, spacing, distance * supersample)),
            fragments,
            spacing,
            supersample,
            jitter: if supersample > 1.0 { 1.0 } else { plan.jitter },
            iterations: parameters.iterations,
            discard: parameters.discard,
            transparent_background: plan.does(EffectKind::TransparentBackground),
        }
    }

    fn pixel(&self, x: usize, y: usize, layers: &mut Vec<usize>) -> [f32; 4] {
        let samples = self.samples.of(x, y);
        let centre = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) * self.supersample;
        self.cull.bundle(centre, layers);
        let mut sum = RaySum::default();
        for view in samples {
            let start = centre + self.jitter * self.supersample * view.jitter;
            self.follow(Ray { start, step: self.supersample * view.lens }, layers, &mut sum);
        }
        let mean = sum.mean(samples.len(), self.transparent_background);
        if mean[3] > 0.0 || (self.transparent_background && sum.discarded < samples.len() as f64) {
            return mean;
        }
        // Nothing is known of any ray but the central one, which never leaves.
        let mut central = RaySum::default();
        self.follow(Ray { start: centre, step: Vec2::ZERO }, layers, &mut central);
        central.mean(1, self.transparent_background)
    }
}

impl LayerTracer {
    /// Follows `ray` through `layers`, front to back, and adds what it meets.
    fn follow(&self, ray: Ray, layers: &[usize], sum: &mut RaySum) {
        let (width, height) = self.fragments.size();
        let [enters, leaves] = match self.discard {
            true => ray.stay(Vec2::new(width as f32, height as f32)),
            false => [f32::NEG_INFINITY, f32::INFINITY],
        };
        let without = *sum;
        let mut transmitted = 1.0;
        let mut behind = f32::NEG_INFINITY;
        for &layer in layers {
            let interval = self.spacing.interval(layer);
            if !self.cull.can_meet(&ray, layer, interval) {
                continue;
            }
            loop {
                let interval = [interval[0].max(behind), interval[1]];
                let segment = Segment { fragments: &self.fragments, ray, interval, behind };
                let Some(hit) = segment.meet(self.iterations) else { break };
                if !(enters..=leaves).contains(&hit.at) {
                    // With what it has met, or pixels at the border would show more of what is near.
                    *sum = RaySum { discarded: without.discarded + 1.0, ..without };
                    return;
                }
                let cone = self.cones.as_ref();
                let cone = cone.and_then(|cones| cones.read(&self.fragments, &hit, ray.at(hit.at), layer));
                let [r, g, b, alpha] = cone.unwrap_or_else(|| self.fragments.color(hit.sample, hit.fragment));
                sum.add([r, g, b], transmitted);
                transmitted *= if alpha >= OPAQUE_ALPHA { 0.0 } else { 1.0 - alpha };
                if transmitted <= 0.0 {
                    return;
                }
                behind = hit.coc_px;
                if cone.is_some() {
                    break;
                }
            }
        }
        sum.missed += f64::from(transmitted);
    }
}
