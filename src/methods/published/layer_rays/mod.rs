//! `layer-rays`: lens rays intersected with depth layers by false position, and widened to cones.
//!
//! Lee, Eisemann & Seidel 2009, "Depth-of-Field Rendering with Multiview Synthesis". CoC depth is cut into layers of
//! equal CoC growth (eq. 4). At every sample a layer keeps the nearest fragment of its interval. A lens ray visits
//! the layers front to back. In each one it is intersected with the layer's height field ([`layers`]) and takes the
//! first hit. Layers without a fragment within reach are skipped ([`cull`]). The colour of a hit is that of a cone
//! around the ray ([`cones`]). Lens samples differ from pixel to pixel ([`samples`]).
//!
//! Where the paper gives no rule, or needs data that a stack lacks:
//! * *Layers from peels.* A layer is not stored: it is the first fragment of its interval in a sample's sorted list.
//!   The picture is the same, and memory is that of the stack, whatever the number of layers.
//! * *Empty samples* count as the far bound until the search has found the surface, and as the near bound after that.
//! * *Colours* are those of the sample that is hit, as a fragment covers the square of its sample. Only cones
//!   interpolate.
//! * *Translucent fragments* let the ray continue behind them, in the same layer too. A fragment that was hit is not
//!   hit again in the overlap of two layers. After a cone the ray continues in the next layer.
//! * *Ray origins.* The paper's rays pass through pixel centres. Here the plan spreads them over the pixel, which
//!   anti-aliases at no cost and is what the reference does.
//! * *Rays that leave the frame* are discarded, as in section 4.3. Past the frame the border's samples are repeated;
//!   a ray that hits one of them is discarded whole. A ray passes where the border has no fragment in its way. If all
//!   rays of a pixel are discarded, its central ray is used. At borders this removes the outward part of the lens.
//!   With `discard` off, hits on repeated samples count, as in the reference.
//! * *λ* is given for 32 samples only, see [`cones::sample_distance`].
//!
//! * *Reflections* that a stack describes are moved by the lens, as the reference does it ([`crate::scene::Reflections`]).
//! * *View-dependent shading* (section 5) is that of [`gloss`], where the user gives an environment: in difference form, and with microfacets
//!   unless Phong's lobe is asked for.
//!
//! Cost: pixels × rays × (layers within reach, and 3 to 6 look-ups in each layer that is not empty around the ray).
//! Memory: the stack; at most 64 N-buffers of at most 65536 blocks; mipmaps of the fragments that cones reach,
//! usually a third of their size. Limits: only surfaces in the peels are known. Within a layer a ray may hit a
//! surface that it should pass (silhouettes gain or lose up to half of δ), and may step over things thinner than its
//! path through the layer.
//! GPU backend: `shaders/methods/layer_rays.wgsl`.

mod cones;
mod cost;
mod cull;
mod gloss;
#[cfg(feature = "gpu")]
mod gpu;
mod layers;
mod parameters;
mod samples;

use crate::error::Error;
use crate::image::Image;
use crate::methods::contract::{LensSampling, LostRays, Method, MethodInfo, Plan, Progress, Role, Sampler};
use crate::methods::cost::Cost;
use crate::methods::laws::{Deviation, Law};
use crate::methods::shared::{Fragments, LensRay, RayJitter, RaySampler, RaySum, ReflectedLight, Tracer};
use crate::scene::{Background, EffectKind, OPAQUE_ALPHA, Scene, Workload};
use crate::settings::ParameterTable;
use cones::Cones;
use cull::Cull;
use glam::Vec2;
use gloss::Glossy;
use layers::{Hit, Ray, Segment, Spacing};
use parameters::LayerRaysParameters;
use samples::LensSamples;
use std::sync::Arc;

/// The method.
#[derive(Debug)]
pub(in crate::methods) struct LayerRays;

/// Reasons of several deviations.
const OVERLAP: &str =
    "neighbouring depth layers overlap, so that a ray may hit a surface in both, or pass between two samples";
const SPACING: &str =
    "depth layers are as thick as the picture's CoC range says, and a surface is hit where its layer is";
const ONE_HIT: &str = "a cone hits one surface in each depth layer; peels that are closer share a layer";

impl Method for LayerRays {
    fn info(&self) -> MethodInfo {
        MethodInfo {
            name: "layer-rays",
            source: "Lee, Eisemann & Seidel 2009",
            role: Role::Paper,
            summary: "lens rays against depth layers, by false position, thickened to cones",
            effects: &[EffectKind::Reflections, EffectKind::Environment, EffectKind::BladeCurvature],
            lens_samples: Some("rays"),
            steps: &["8", "32", "128"],
            deviations: &[
                Deviation {
                    law: Law::Energy,
                    within: [0.97, 1.005],
                    reason: "lens samples differ from pixel to pixel, so the shares of a point's light do not add up exactly",
                },
                Deviation {
                    law: Law::Place,
                    within: [0.0, 0.1],
                    reason: "lens samples differ from pixel to pixel, so the shares of a point's light do not add up exactly",
                },
                Deviation {
                    law: Law::NoCracksAcrossCorners,
                    within: [-0.001, 0.01],
                    reason: "false position may step over the sample that holds the surface; the layer's overlap is too thin",
                },
                Deviation {
                    law: Law::Convergence,
                    within: [39.5, 42.5],
                    reason: "rays that hit something outside the frame are discarded; the reference repeats the border",
                },
                Deviation { law: Law::TiltedPane, within: [0.0, 0.04], reason: OVERLAP },
                Deviation { law: Law::SheetOfTwoPeels, within: [0.0, 0.01], reason: OVERLAP },
                Deviation { law: Law::Element, within: [0.0, 0.03], reason: OVERLAP },
                Deviation { law: Law::LocalChange, within: [0.0, 0.2], reason: SPACING },
                Deviation { law: Law::SteepRamp, within: [0.0, 0.01], reason: OVERLAP },
                Deviation { law: Law::EvenSweep, within: [1.0, 2.4], reason: SPACING },
                Deviation { law: Law::ManyPeels, within: [0.0, 0.6], reason: ONE_HIT },
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
    fn gpu(&self) -> Option<&dyn crate::methods::contract::GpuBackend> {
        Some(self)
    }
}

impl LensSampling for LayerRays {
    fn begin<'p>(&self, scene: Scene, plan: &'p Plan) -> Box<dyn Sampler + 'p> {
        Box::new(RaySampler::<LayerTracer>::new(scene, plan))
    }
}

/// What rays are traced against.
#[derive(Debug)]
struct LayerTracer {
    samples: LensSamples,
    fragments: Fragments,
    spacing: Spacing,
    cull: Cull,
    cones: Option<Cones<4>>,
    /// What surfaces reflect of an environment, if that is shaded for each ray.
    gloss: Option<Glossy>,
    /// What surfaces reflect, if the lens moves it.
    reflected: Option<ReflectedLight>,
    supersample: f32,
    /// Extent of the ray origins in each pixel.
    jitter: RayJitter,
    iterations: usize,
    /// Whether rays that leave the frame are discarded.
    discard: bool,
    background: Option<Arc<Background>>,
    lost_rays: LostRays,
}

impl Tracer for LayerTracer {
    /// The layers that the rays of a pixel can hit.
    type Scratch = Vec<usize>;

    fn new(scene: Scene, plan: &Plan, rays: usize) -> Self {
        let parameters = plan.parameters.get::<LayerRaysParameters>();
        let supersample = scene.supersample as f32;
        let (background, jitter) = (plan.background(&scene), RayJitter::new(&scene, plan));
        let environment = plan.environment(&scene);
        let reflected = ReflectedLight::of(&scene, plan);
        let fragments = Fragments::new(scene);
        let spacing = Spacing::new(plan.coc_range_px, parameters.delta_px, parameters.overlap);
        let distance = cones::sample_distance(rays, plan.optics.aperture.area());
        Self {
            samples: LensSamples::new(rays, plan.optics.aperture, parameters.jitter),
            cull: Cull::new(&fragments, spacing, supersample),
            cones: parameters.cones.then(|| Cones::of_colors(&fragments, spacing, distance * supersample)),
            gloss: environment.map(|environment| {
                let per_coc_px = parameters.cones.then_some(distance * supersample);
                Glossy::new(environment, &fragments, spacing, per_coc_px)
            }),
            reflected,
            fragments,
            spacing,
            supersample,
            jitter,
            iterations: parameters.iterations,
            discard: parameters.discard,
            background,
            lost_rays: plan.lost_rays,
        }
    }

    fn pixel(&self, x: usize, y: usize, layers: &mut Vec<usize>) -> [f32; 4] {
        let samples = self.samples.at_pixel(x, y);
        let centre = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) * self.supersample;
        self.cull.layers_in_reach(centre, layers);
        let extent = self.jitter.at(x, y) * self.supersample;
        let mut sum = RaySum::default();
        for view in samples {
            let start = centre + extent * view.jitter;
            self.follow(Ray { start, step: self.supersample * view.lens }, layers, &mut sum);
        }
        let mean = sum.mean(samples.len(), self.lost_rays);
        if mean[3] > 0.0 || sum.transparent > 0.0 {
            return mean;
        }
        // All rays were discarded. The central ray never leaves the frame.
        let mut central = RaySum::default();
        self.follow(Ray { start: centre, step: Vec2::ZERO }, layers, &mut central);
        central.mean(1, self.lost_rays)
    }
}

impl LayerTracer {
    /// By how much what `ray` sees reflected at `hit` differs from the fragment's own colour, of this `alpha`.
    fn moved(&self, hit: &Hit, ray: &Ray, alpha: f32) -> Option<[f32; 3]> {
        let (width, _) = self.fragments.size();
        let at = (hit.sample % width, hit.sample / width);
        let moved =
            self.reflected.as_ref()?.moved_at((at, hit.coc_px), &LensRay::new(ray.start, ray.step))?;
        Some(std::array::from_fn(|k| alpha * (moved.seen[k] - moved.own[k])))
    }

    /// Follows `ray` through `layers`, front to back, and adds the fragments that it hits.
    fn follow(&self, ray: Ray, layers: &[usize], sum: &mut RaySum) {
        let (width, height) = self.fragments.size();
        let [enters_at, leaves_at] = match self.discard {
            true => ray.frame_interval(Vec2::new(width as f32, height as f32)),
            false => [f32::NEG_INFINITY, f32::INFINITY],
        };
        let before_ray = *sum;
        let mut transmittance = 1.0;
        let mut passed_coc_px = f32::NEG_INFINITY;
        for &layer in layers {
            let interval = self.spacing.interval(layer);
            if !self.cull.can_hit(&ray, layer, interval) {
                continue;
            }
            loop {
                let interval = [interval[0].max(passed_coc_px), interval[1]];
                let segment = Segment { fragments: &self.fragments, ray, interval, passed_coc_px };
                let Some(hit) = segment.intersect(self.iterations) else { break };
                if !(enters_at..=leaves_at).contains(&hit.at) {
                    // Drops the earlier hits of the ray too: otherwise pixels at the border would show more of near
                    // surfaces.
                    *sum = RaySum { discarded: before_ray.discarded + 1.0, ..before_ray };
                    return;
                }
                let cone = self.cones.as_ref();
                let cone = cone.and_then(|cones| cones.lookup(&self.fragments, &hit, ray.at(hit.at), layer));
                let [r, g, b, alpha] = cone.unwrap_or_else(|| self.fragments.color(hit.sample, hit.fragment));
                let changed =
                    self.gloss.as_ref().and_then(|gloss| gloss.change(&self.fragments, &hit, &ray, layer));
                sum.shaded |= changed.is_some();
                let [red, green, blue] =
                    changed.or_else(|| self.moved(&hit, &ray, alpha)).unwrap_or_default();
                sum.add([r + red, g + green, b + blue], transmittance);
                transmittance *= if alpha >= OPAQUE_ALPHA { 0.0 } else { 1.0 - alpha };
                if transmittance <= 0.0 {
                    return;
                }
                passed_coc_px = hit.coc_px;
                if cone.is_some() {
                    break;
                }
            }
        }
        let pixel = |coc_px: f32| (ray.at(coc_px) / self.supersample).floor().as_ivec2();
        let share = self.background.as_deref().map_or(0.0, |background| background.met_by(pixel));
        sum.end(transmittance, share);
    }
}
