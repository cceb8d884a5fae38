//! TRUTH: what very many lens rays through the stack see at a pixel, and what of a picture it is compared with.
//!
//! Only what a method samples is measured: lights that it draws exactly are neither sampled nor traced, because few rays hit a light and
//! their noise would be taken for an error of the method. A filter that ends the method's picture ends the truth as well: the truth is
//! traced at the pixel and at its four neighbours, with the share of its own rays that hit something in focus. Each half of the rays is
//! filtered by itself, so that the halves stay independent.

use crate::image::{Image, neighbours};
use crate::lens::Rays;
use crate::methods::{PixelFilter, Plan, Volume};
use crate::metrics::displayed;
use crate::scene::{EffectKind, Layer, Scene};
use fastrand::Rng;
use glam::Vec2;
use std::borrow::Cow;
use std::f32::consts::TAU;
use std::sync::Arc;

/// What the sampling error of pictures of one scene is measured against.
#[derive(Debug)]
pub struct Basis<'a> {
    /// The scene that rays are traced through.
    pub(super) scene: Cow<'a, Scene>,
    /// The lens that rays are traced with.
    plan: &'a Plan,
    /// The filter that ends the pictures.
    filter: Option<Arc<dyn PixelFilter>>,
}

impl<'a> Basis<'a> {
    /// Of the pictures of `scene` by `plan`: with the plan's disocclusion fill, because an estimated surface is not a sampling error.
    pub fn new(scene: &'a Scene, plan: &'a Plan) -> Self {
        Self::for_picture(scene, plan, plan).filled()
    }

    /// Of the pictures of `scene` by `painting`, which may be of another method than `tracing`, whose lens the rays have. Without
    /// disocclusion fill, so that all methods are measured by what the stack holds.
    pub fn for_picture(scene: &'a Scene, tracing: &'a Plan, painting: &Plan) -> Self {
        let Some(sampling) = painting.method.lens_sampling() else { return Self::of_stack(scene, tracing) };
        let filter = sampling.filter(scene, painting).map(Arc::from);
        Self { scene: sampling.sampled(scene, painting), plan: tracing, filter }
    }

    /// The same with the disocclusion fill, if the lens's plan has it on.
    #[must_use]
    pub fn filled(self) -> Self {
        if !self.plan.does(EffectKind::Fill) {
            return self;
        }
        Self { scene: Cow::Owned(self.scene.into_owned().filled()), ..self }
    }

    /// What lens rays of `plan` see in `scene`, with all its lights and without a filter.
    pub(super) fn of_stack(scene: &'a Scene, plan: &'a Plan) -> Self {
        Self { scene: Cow::Borrowed(scene), plan, filter: None }
    }

    /// The tracer of single pixels.
    pub(super) fn tracer(&self) -> PixelTracer<'_> {
        self.tracer_of_first_layers(self.scene.layers.len())
    }

    /// The tracer of single pixels of a scene that has the first `count` layers only.
    pub(super) fn tracer_of_first_layers(&self, count: usize) -> PixelTracer<'_> {
        let (scene, plan) = (&*self.scene, self.plan);
        let volume = Volume::from_first_layers(count, scene, plan);
        PixelTracer { scene, volume, plan, filter: self.filter.clone() }
    }
}

/// The lights that `plan` adds exactly to its picture of `scene`; `None` where it samples all light.
pub(super) fn exact_lights(scene: &Scene, plan: &Plan) -> Option<Image> {
    plan.method.lens_sampling()?.exact_lights(scene, plan)
}

/// The display values of a colour.
pub(super) fn to_display([r, g, b, _]: [f32; 4]) -> [f32; 3] {
    [r, g, b].map(displayed)
}

/// A neighbour has this share of the rays of its pixel: a filter gives it a small weight, and its noise counts less.
const NEIGHBOUR_SHARE: usize = 4;

/// What one half of the rays sees at a pixel, scene-linear.
#[derive(Debug, Clone, PartialEq)]
struct Seen {
    own: [f32; 4],
    /// Mean over the rays of how far what they hit is in focus.
    focused_share: f32,
    /// The pixels around it; `None` where the filter does not read them.
    around: Option<[[f32; 4]; 4]>,
}

/// The truth at one pixel, from two independent halves of rays.
#[derive(Debug, Clone)]
pub(super) struct Truth {
    pixel: usize,
    /// Width and height of the picture.
    size: (usize, usize),
    filter: Option<Arc<dyn PixelFilter>>,
    halves: [Seen; 2],
}

impl Truth {
    /// The pixel, `y · width + x`.
    pub(super) fn pixel(&self) -> usize {
        self.pixel
    }

    /// The display colours by each half of the rays, of a picture to which `lights` were added.
    pub(super) fn shown(&self, lights: Option<&Image>) -> [[f32; 3]; 2] {
        let lit = |color: [f32; 4], pixel: usize| match lights {
            None => color,
            Some(lights) => std::array::from_fn(|k| color[k] + lights.planes[k].values()[pixel]),
        };
        self.halves.each_ref().map(|Seen { own, focused_share, around }| {
            let own = lit(*own, self.pixel);
            let (Some(filter), Some(around)) = (&self.filter, around) else { return to_display(own) };
            let near = neighbours(self.pixel, self.size);
            let around = std::array::from_fn(|i| lit(around[i], near[i]));
            to_display(filter.filtered(self.pixel, *focused_share, own, around))
        })
    }
}

/// Traces rays of single pixels.
#[derive(Debug)]
pub(super) struct PixelTracer<'a> {
    pub(super) scene: &'a Scene,
    pub(super) volume: Volume<&'a Layer>,
    plan: &'a Plan,
    filter: Option<Arc<dyn PixelFilter>>,
}

impl PixelTracer<'_> {
    /// The display colour of a pixel by `rays`, without the filter.
    pub(super) fn color(&self, pixel: usize, rays: &Rays) -> [f32; 3] {
        to_display(self.linear(pixel, rays))
    }

    fn linear(&self, pixel: usize, rays: &Rays) -> [f32; 4] {
        let width = self.scene.picture_size().0;
        self.volume.pixel(pixel % width, pixel / width, rays)
    }

    /// The truth at `pixel` by two independent sets of `rays_per_half` rays.
    pub(super) fn truth(&self, pixel: usize, rays_per_half: usize, seed: u64) -> Truth {
        let mut rng = Rng::with_seed(seed);
        let halves = std::array::from_fn(|_| {
            let rays = [rays_per_half, rays_per_half.div_ceil(NEIGHBOUR_SHARE)]
                .map(|count| self.rays(count, &mut rng));
            self.seen(pixel, &rays)
        });
        Truth { pixel, size: self.scene.picture_size(), filter: self.filter.clone(), halves }
    }

    /// What `rays` of `pixel` see, and the other set those of its neighbours.
    fn seen(&self, pixel: usize, [rays, rays_around]: &[Rays; 2]) -> Seen {
        let Some(filter) = &self.filter else {
            return Seen { own: self.linear(pixel, rays), focused_share: 0.0, around: None };
        };
        let size = self.scene.picture_size();
        let focus = |coc_px: f32| filter.focus(coc_px);
        let (own, focused_share) = self.volume.pixel_and_focus(pixel % size.0, pixel / size.0, rays, &focus);
        let around = || neighbours(pixel, size).map(|near| self.linear(near, rays_around));
        Seen { own, focused_share, around: (focused_share > 0.0).then(around) }
    }

    /// Rays with a random rotation and shift, independent of all others.
    pub(super) fn rays(&self, count: usize, rng: &mut Rng) -> Rays {
        let (angle, shift) = (rng.f32() * TAU, Vec2::new(rng.f32(), rng.f32()));
        self.plan.optics.moved_rays(count, angle, shift)
    }
}
