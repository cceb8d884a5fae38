//! `peel-rays`: every lens ray is marched through the peels' height fields, without layers between.
//!
//! Lee, Eisemann & Seidel 2010, "Real-Time Lens Blur Effects and Focus Control", as Schedl & Wimmer 2012 describe it
//! (section 4): a linear search along the ray, then a binary search where the ray has passed a surface. Both are
//! limited to the CoC range that an N-buffer gives for that ray alone.
//!
//! Where the description gives no rule, or needs data that a stack lacks:
//! * *Back faces.* The paper needs closed objects with back faces, so that a ray behind a front face is inside. Peels
//!   may be open surfaces, and a ray that passes behind an edge is not inside anything. So the binary search follows
//!   the surface that was passed, from sample to sample while they lie within [`surface::JOIN_PX`] of one another. A
//!   hit counts only if the ray intersects that surface before the surface ends; otherwise the march continues to
//!   farther fragments.
//! * *Nearest first.* Within a step all fragments at both ends are tested, nearest first.
//! * *Steps.* At most two for each sample that the ray passes: more would find the same samples again.
//! * *Border.* Past the frame's border the last sample is repeated, as in [`crate::methods::accumulate`].
//! * *Lens samples.* Spread evenly over the aperture, not Gaussian: the blur is to be that of the lens.
//!
//! Cost: pixels × rays × steps × layers. Memory: the scene. Limits: only surfaces in the peels are known; with few
//! steps thin objects are stepped over.
//! GPU backend: `shaders/methods/peel_rays.wgsl`.

mod cost;
#[cfg(feature = "gpu")]
mod gpu;
mod parameters;

use crate::error::Error;
use crate::image::Image;
use crate::lens::{View, views};
use crate::methods::contract::{LensSampling, LostRays, Method, MethodInfo, Plan, Progress, Role, Sampler};
use crate::methods::cost::Cost;
use crate::methods::laws::{Deviation, Law};
use crate::methods::shared::{Blocks, Fragments, NBuffer, RayJitter, RaySampler, RaySum, Tracer};
use crate::scene::{Background, EffectKind, OPAQUE_ALPHA, Scene, Workload, surface};
use crate::settings::ParameterTable;
use glam::Vec2;
use parameters::PeelRaysParameters;
use std::sync::Arc;

/// Linear steps per sample that a ray passes; more steps find the same samples again.
const STEPS_PER_SAMPLE: f32 = 2.0;

/// The method.
#[derive(Debug)]
pub(in crate::methods) struct PeelRays;

impl Method for PeelRays {
    fn info(&self) -> MethodInfo {
        MethodInfo {
            name: "peel-rays",
            source: "Lee, Eisemann & Seidel 2010, as Schedl & Wimmer 2012 describe it",
            role: Role::Baseline,
            summary: "lens rays marched through the peels' height fields",
            effects: &[EffectKind::BladeCurvature, EffectKind::Squeeze],
            lens_samples: Some("rays"),
            steps: &["16", "64", "256"],
            deviations: &[
                Deviation {
                    law: Law::NoCracksAcrossCorners,
                    within: [-0.001, 0.02],
                    reason: "the linear search may step across the corner of a sample, whose neighbours are no longer one surface",
                },
                Deviation { law: Law::TiltedPane, within: [0.0, 0.1], reason: THIN },
                Deviation { law: Law::SheetOfTwoPeels, within: [0.0, 0.02], reason: THIN },
                Deviation { law: Law::Element, within: [0.0, 0.04], reason: THIN },
                Deviation { law: Law::LocalChange, within: [0.0, 0.04], reason: STEPS },
                Deviation { law: Law::SteepRamp, within: [0.0, 0.2], reason: THIN },
                Deviation { law: Law::Relief, within: [0.0, 0.2], reason: THIN },
                Deviation { law: Law::EvenSweep, within: [1.0, 2.4], reason: ONE_SET },
                Deviation { law: Law::ManyPeels, within: [0.0, 0.3], reason: STEPS },
            ],
        }
    }

    fn parameters(&self) -> ParameterTable {
        ParameterTable::of::<PeelRaysParameters>()
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

impl LensSampling for PeelRays {
    fn begin<'p>(&self, scene: Scene, plan: &'p Plan) -> Box<dyn Sampler + 'p> {
        Box::new(RaySampler::<Marcher>::new(scene, plan))
    }
}

/// Reasons of several deviations.
const THIN: &str =
    "the height field of a peel is thin: a ray may pass between two of its samples, or hit both";
const STEPS: &str = "the ray takes a fixed number of steps through the CoC range, so that surfaces closer than a step are missed";
const ONE_SET: &str = "all pixels have the same lens samples, so that each moves the whole picture at once";

/// What rays are marched through.
#[derive(Debug)]
struct Marcher {
    samples: Vec<View>,
    fragments: Fragments,
    range: CocRange,
    supersample: f32,
    /// Extent of the ray origins in each pixel.
    jitter: RayJitter,
    linear_steps: usize,
    binary_steps: usize,
    background: Option<Arc<Background>>,
    lost_rays: LostRays,
}

/// CoC ranges of the fragments in parts of the picture.
#[derive(Debug)]
struct CocRange {
    blocks: Blocks,
    nearest: NBuffer,
    /// Negated, so that an N-buffer of minima serves for it too.
    farthest: NBuffer,
    full_px: [f32; 2],
}

impl CocRange {
    fn new(fragments: &Fragments, full_px: [f32; 2], supersample: f32) -> Self {
        let blocks = Blocks::of(fragments);
        let max_window = 2.0 * supersample * (full_px[0].abs().max(full_px[1].abs()) + 0.5);
        let last = |sample: usize| fragments.coc_px(sample).iter().rfind(|coc| coc.is_finite()).copied();
        Self {
            blocks,
            nearest: blocks.least(fragments, max_window, |sample| {
                fragments.coc_px(sample).first().copied().unwrap_or(f32::INFINITY)
            }),
            farthest: blocks
                .least(fragments, max_window, |sample| last(sample).map_or(f32::INFINITY, |far| -far)),
            full_px,
        }
    }

    /// CoC range of the fragments between two sample positions; starts at infinity if there are none.
    fn between_px(&self, a: Vec2, b: Vec2) -> [f32; 2] {
        let window = self.blocks.window(a.min(b), a.max(b));
        [self.nearest.least(&window), -self.farthest.least(&window)]
    }

    /// CoC range of the fragments that rays through the pixel with centre `centre` (in samples) can hit.
    fn bundle_px(&self, centre: Vec2, supersample: f32) -> [f32; 2] {
        let mut range = self.full_px;
        // The fragments within reach of the full range give a smaller reach, and that a smaller range.
        for _ in 0..2 {
            let reach = Vec2::splat((range[0].abs().max(range[1].abs()) + 0.5) * supersample);
            range = self.between_px(centre - reach, centre + reach);
            if range[0] == f32::INFINITY {
                break;
            }
        }
        range
    }
}

/// A lens ray: at CoC radius `c` it passes sample position `start + c·step`.
#[derive(Debug, Clone, Copy)]
struct Ray {
    start: Vec2,
    step: Vec2,
}

impl Ray {
    #[inline(always)]
    fn at(&self, c: f32) -> Vec2 {
        self.start + c * self.step
    }
}

/// A segment of a ray: CoC radii and samples at its ends. Fragments up to CoC radius `passed_coc_px` were hit before.
#[derive(Debug, Clone, Copy)]
struct Segment {
    from: f32,
    to: f32,
    samples: [usize; 2],
    passed_coc_px: f32,
}

/// A fragment that a ray hits.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Hit {
    sample: usize,
    fragment: usize,
    coc_px: f32,
}

impl Tracer for Marcher {
    type Scratch = ();

    fn new(scene: Scene, plan: &Plan, rays: usize) -> Self {
        let parameters = plan.parameters.get::<PeelRaysParameters>();
        let supersample = scene.supersample as f32;
        let (background, jitter) = (plan.background(&scene), RayJitter::new(&scene, plan));
        let fragments = Fragments::new(scene);
        Self {
            samples: views(rays, plan.optics.aperture),
            range: CocRange::new(&fragments, plan.coc_range_px, supersample),
            fragments,
            supersample,
            jitter,
            linear_steps: parameters.linear_steps,
            binary_steps: parameters.binary_steps,
            background,
            lost_rays: plan.lost_rays,
        }
    }

    fn pixel(&self, x: usize, y: usize, (): &mut ()) -> [f32; 4] {
        let centre = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) * self.supersample;
        let range = self.range.bundle_px(centre, self.supersample);
        let extent = self.jitter.at(x, y) * self.supersample;
        let mut sum = RaySum::default();
        for view in &self.samples {
            let start = centre + extent * view.jitter;
            self.march(Ray { start, step: self.supersample * view.lens }, range, &mut sum);
        }
        sum.mean(self.samples.len(), self.lost_rays)
    }
}

impl Marcher {
    /// Marches `ray` through the fragments in the CoC radii of `range`, and adds those that it hits.
    fn march(&self, ray: Ray, range: [f32; 2], sum: &mut RaySum) {
        let mut transmittance = 1.0;
        let [near, far] = match range {
            [f32::INFINITY, _] => range,
            [near, far] => self.range.between_px(ray.at(near), ray.at(far)),
        };
        // The ray may pass over fragments outside of the bundle's range, which it cannot hit.
        let (near, far) = (near.max(range[0]), far.min(range[1]));
        if near <= far {
            let passed = ray.step.abs().max_element() * (far - near) * STEPS_PER_SAMPLE;
            let steps = (passed.ceil() as usize).clamp(1, self.linear_steps);
            let mut segment = Segment {
                from: near,
                to: near,
                samples: [self.fragments.sample_at(ray.at(near)); 2],
                passed_coc_px: f32::NEG_INFINITY,
            };
            for step in 1..=steps {
                segment.from = segment.to;
                segment.to =
                    if step < steps { near + (far - near) * (step as f32 / steps as f32) } else { far };
                segment.samples = [segment.samples[1], self.fragments.sample_at(ray.at(segment.to))];
                while let Some(hit) = self.intersect(ray, &segment) {
                    let [r, g, b, alpha] = self.fragments.color(hit.sample, hit.fragment);
                    sum.add([r, g, b], transmittance);
                    transmittance *= if alpha >= OPAQUE_ALPHA { 0.0 } else { 1.0 - alpha };
                    if transmittance <= 0.0 {
                        return;
                    }
                    segment.passed_coc_px = hit.coc_px;
                }
            }
        }
        let pixel = |coc_px: f32| (ray.at(coc_px) / self.supersample).floor().as_ivec2();
        let share = self.background.as_deref().map_or(0.0, |background| background.met_by(pixel));
        sum.end(transmittance, share);
    }

    /// The first fragment that the ray hits in a segment.
    #[inline]
    fn intersect(&self, ray: Ray, segment: &Segment) -> Option<Hit> {
        let [first, last] = segment.samples;
        let within = |&(_, coc): &(usize, f32)| {
            coc >= segment.from && coc <= segment.to && coc > segment.passed_coc_px
        };
        let candidate_at_first = self.fragments_of(first).find(within);
        if first == last {
            return candidate_at_first.map(|(fragment, coc_px)| Hit { sample: first, fragment, coc_px });
        }
        let hit_at_first = candidate_at_first.and_then(|(fragment, coc_px)| {
            self.search(ray, segment, Hit { sample: first, fragment, coc_px }, true)
        });
        hit_at_first.or_else(|| {
            let mut candidates_at_last = self.fragments_of(last).filter(within);
            candidates_at_last.find_map(|(fragment, coc_px)| {
                self.search(ray, segment, Hit { sample: last, fragment, coc_px }, false)
            })
        })
    }

    /// The fragments of a sample and their CoC radii, nearest first.
    #[inline(always)]
    fn fragments_of(&self, sample: usize) -> impl Iterator<Item = (usize, f32)> {
        self.fragments.coc_px(sample).iter().copied().enumerate().take_while(|(_, coc)| *coc < f32::INFINITY)
    }

    /// Binary search for the intersection of the ray with the surface of `found`, which lies at the first or at the
    /// last end of the segment; `None` if the surface ends before it.
    ///
    /// One end of the search stays over the surface. The other end is past the surface's edge, or over the surface
    /// but on its other side.
    fn search(&self, ray: Ray, segment: &Segment, mut found: Hit, over_first: bool) -> Option<Hit> {
        let (mut on, mut off) =
            if over_first { (segment.from, segment.to) } else { (segment.to, segment.from) };
        let on_this_side = |coc: f32, c: f32| if over_first { coc >= c } else { coc <= c };
        let mut beyond = self
            .joined_fragment(segment.samples[usize::from(over_first)], &found)
            .filter(|other| !on_this_side(other.coc_px, off) || other.coc_px == off);
        for _ in 0..self.binary_steps {
            let middle = 0.5 * (on + off);
            match self.joined_fragment(self.fragments.sample_at(ray.at(middle)), &found) {
                Some(next) if on_this_side(next.coc_px, middle) => (on, found) = (middle, next),
                next => (off, beyond) = (middle, next),
            }
        }
        if let Some(beyond) = beyond {
            // The surface continues past the ray: take the sample where a straight line between the two sides crosses
            // it.
            let (ahead, past) = ((found.coc_px - on).abs(), (beyond.coc_px - off).abs());
            let crossing = on + (off - on) * if ahead > 0.0 { ahead / (ahead + past) } else { 0.0 };
            return self.joined_fragment(self.fragments.sample_at(ray.at(crossing)), &found).or(Some(found));
        }
        (!on_this_side(found.coc_px, off) || found.coc_px == off).then_some(found)
    }

    /// The fragment of `sample` that continues the surface of `found`: `found` itself, or a joined fragment if both
    /// are opaque. Translucent ones would count twice.
    fn joined_fragment(&self, sample: usize, found: &Hit) -> Option<Hit> {
        if sample == found.sample {
            return Some(*found);
        }
        let opaque = |sample, fragment| self.fragments.color(sample, fragment)[3] >= OPAQUE_ALPHA;
        let near = |&(_, coc): &(usize, f32)| surface::joins(found.coc_px, coc);
        let (fragment, coc_px) = self.fragments_of(sample).find(near)?;
        (opaque(sample, fragment) && opaque(found.sample, found.fragment)).then_some(Hit {
            sample,
            fragment,
            coc_px,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods::shared::noise;

    fn marcher(fragments: Fragments, coc_range_px: [f32; 2]) -> Marcher {
        Marcher {
            samples: Vec::new(),
            range: CocRange::new(&fragments, coc_range_px, 1.0),
            fragments,
            supersample: 1.0,
            jitter: RayJitter::whole_pixels(),
            linear_steps: 100,
            binary_steps: 5,
            background: None,
            lost_rays: LostRays::LeftOut,
        }
    }

    /// CoC radius of the fragment that `ray` hits; 0 if none.
    fn hit_coc_px(marcher: &Marcher, ray: Ray) -> f64 {
        let mut sum = RaySum::default();
        marcher.march(ray, marcher.range.full_px, &mut sum);
        sum.color[0]
    }

    fn ray(x: f32, step: f32) -> Ray {
        Ray { start: Vec2::new(x, 0.5), step: Vec2::new(step, 0.0) }
    }

    #[test]
    fn a_ray_that_passes_behind_an_edge_hits_the_surface_behind_it() {
        // A bar at −4 over the right half, in front of a wall at 6.
        let list = |x, _| if x >= 8 { vec![-4.0, 6.0] } else { vec![6.0] };
        let marcher = marcher(Fragments::from_lists((24, 1), list), [-4.0, 6.0]);
        assert_eq!(hit_coc_px(&marcher, ray(11.0, 0.5)), -4.0, "over 9 at −4: hits the bar");
        assert_eq!(hit_coc_px(&marcher, ray(9.0, 0.5)), 6.0, "over 7 at −4, over 9 at 0: behind the bar");
        assert_eq!(hit_coc_px(&marcher, ray(7.0, -0.6)), -4.0, "over 9.4 at −4, leaving: hits the bar");
    }

    #[test]
    fn a_slanted_surface_is_hit_where_the_ray_crosses_it_in_any_peel() {
        // A floor that rises by 0.4 per sample, in front of a wall at 30. Over some samples a bar moves it back by
        // one peel.
        let floor = |x: usize| 0.4 * (x as f32 - 20.0);
        let list =
            |x, _| if (18..24).contains(&x) { vec![-9.0, floor(x), 30.0] } else { vec![floor(x), 30.0] };
        let marcher = marcher(Fragments::from_lists((48, 1), list), [-9.0, 30.0]);
        for i in 0..200 {
            // x = p + 0.9 c intersects c = 0.4 (x − 20) at c = 0.4 (p − 20) / (1 − 0.36); the bar, at −9, is 8
            // samples away.
            let start = 20.0 + 0.03 * i as f32;
            let crossing = 0.4 * (start - 20.5) / 0.64;
            let found = hit_coc_px(&marcher, ray(start, 0.9)) as f32;
            assert!((found - crossing).abs() < 0.45, "from {start}: {found}, expected {crossing}");
        }
    }

    #[test]
    fn the_range_of_a_bundle_holds_all_fragments_that_its_rays_can_hit() {
        let list = |x, y| {
            if noise(x / 4, y / 4, 3) < 0.8 { vec![] } else { vec![24.0 * noise(x / 4, y / 4, 4) - 12.0] }
        };
        let fragments = Fragments::from_lists((60, 60), list);
        let range = CocRange::new(&fragments, [-12.0, 12.0], 1.0);
        for (px, py) in (0..60).step_by(7).flat_map(|x| (0..60).step_by(5).map(move |y| (x, y))) {
            let centre = Vec2::new(px as f32 + 0.5, py as f32 + 0.5);
            let [near, far] = range.bundle_px(centre, 1.0);
            for (x, y) in (0..60 * 60).map(|i| (i % 60, i / 60)) {
                let away = (Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - centre).abs().max_element();
                for &coc in fragments.coc_px(y * 60 + x).iter().filter(|coc| coc.abs() > away) {
                    assert!(
                        coc == f32::INFINITY || (near..=far).contains(&coc),
                        "{coc} at {x}, {y} from {px}, {py}"
                    );
                }
            }
        }
    }
}
