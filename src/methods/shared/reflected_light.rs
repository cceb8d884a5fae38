//! What a lens ray sees in a surface that reflects: [`crate::scene::Reflections`] as rays meet it.
//!
//! * *Curved surfaces.* The ray that meets the surface at `q` sees what the pinhole sees at `q + M u`, with the matrix of the place that is
//!   looked at: [`STEPS`] steps of `δ ← M(q + δ) u`, on the same surface; past its edge, at the last place on it.
//! * *Flat mirrors.* The ray goes on behind the mirror, through the fragments that it shows there: the first one that it meets, each
//!   extended half-way to its neighbours. Where it meets none, past the mirror's edge or behind what the mirror does not show, it sees the
//!   last one that it passed of the farthest surface.
//!
//! GPU version: `shaders/shared/reflected_light.wgsl`.

use super::lens_ray::LensRay;
use crate::image::Plane;
use crate::methods::contract::Plan;
use crate::scene::surface::JOIN_PX;
use crate::scene::{EffectKind, Layer, ReflectingLayer, Reflections, Scene};
use glam::{IVec2, Vec2};
use rayon::prelude::*;
use std::sync::Arc;

/// Steps towards the place that is seen in a curved surface.
pub(in crate::methods) const STEPS: usize = 4;

/// What the surfaces of a scene reflect, for rays: all that is known of a sample lies together.
#[derive(Debug, Clone)]
pub(in crate::methods) struct ReflectedLight {
    layers: Vec<Option<Arc<Vec<Reflecting>>>>,
    /// For each surface the largest CoC radius of what it shows as a flat mirror, in picture pixels.
    farthest_px: Arc<Vec<f32>>,
    /// Columns and rows of samples.
    size: [usize; 2],
    supersample: f32,
}

/// A sample of a layer that reflects; see [`ReflectingLayer`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Reflecting {
    pub(super) light: [f32; 3],
    pub(super) coc_px: f32,
    pub(super) movement: [f32; 4],
    pub(super) mirrored_px: [f32; 2],
    pub(super) flat: f32,
    pub(super) curved: f32,
    pub(super) surface: u32,
}

/// A fragment that reflects, where a ray meets it.
#[derive(Debug, Clone, Copy)]
pub(in crate::methods) struct Met {
    /// Its layer.
    pub layer: usize,
    /// Column and row of its sample.
    pub at: (usize, usize),
}

/// What changes for a ray in the light that a fragment reflects, not multiplied by alpha.
#[derive(Debug, Clone, Copy)]
pub(in crate::methods) struct MovedLight {
    /// The light that is part of the fragment's colour and moves.
    pub own: [f32; 3],
    /// What the ray sees in its place.
    pub seen: [f32; 3],
    /// Share of the reflected light that moves, 0 … 1.
    pub share: f32,
}

impl Reflecting {
    fn of(layer: &ReflectingLayer, index: usize) -> Self {
        let value = |plane: &Plane| plane.values()[index];
        Self {
            light: layer.light.each_ref().map(value),
            coc_px: value(&layer.coc_px),
            movement: layer.movement.each_ref().map(value),
            mirrored_px: layer.mirrored_px.each_ref().map(value),
            flat: value(&layer.flat),
            curved: value(&layer.curved),
            surface: layer.surface[index],
        }
    }

    /// Share of the light that moves.
    fn share(&self) -> f32 {
        self.flat + self.curved
    }

    /// By how much the place moves, in picture pixels, at which the sample is seen reflected from the lens point `lens`.
    fn moved_by(&self, lens: Vec2) -> Vec2 {
        let [xx, xy, yx, yy] = self.movement;
        Vec2::new(xx * lens.x + xy * lens.y, yx * lens.x + yy * lens.y)
    }

    /// Radius of the blur of what is seen reflected, in picture pixels: it lands where `c u + M u` moves it; the root of the mean of the squares
    /// of that along two axes.
    fn blur_px(&self) -> f32 {
        let [xx, xy, yx, yy] = self.movement;
        let coc_px = self.coc_px;
        (0.5 * ((coc_px + xx).powi(2) + xy * xy + yx * yx + (coc_px + yy).powi(2))).sqrt()
    }
}

impl ReflectedLight {
    /// What the surfaces of `scene` reflect, if the plan moves it.
    pub(in crate::methods) fn of(scene: &Scene, plan: &Plan) -> Option<Self> {
        let reflections = scene.reflections.as_deref().filter(|_| plan.does(EffectKind::Reflections))?;
        let Reflections { layers, farthest_px, .. } = reflections;
        let plane = layers.iter().flatten().map(|layer| &layer.coc_px).next()?;
        let samples = |layer: &ReflectingLayer| -> Vec<Reflecting> {
            (0..layer.surface.len()).into_par_iter().map(|index| Reflecting::of(layer, index)).collect()
        };
        let layers = layers.iter().map(|layer| layer.as_ref().map(|layer| Arc::new(samples(layer))));
        Some(Self {
            layers: layers.collect(),
            farthest_px: Arc::new(farthest_px.clone()),
            size: [plane.width(), plane.height()],
            supersample: scene.supersample as f32,
        })
    }

    /// For each layer of the scene its samples, row by row; `None` where its surfaces reflect nothing.
    #[cfg(feature = "gpu")]
    pub(super) fn layers(&self) -> impl ExactSizeIterator<Item = Option<&[Reflecting]>> {
        self.layers.iter().map(|layer| layer.as_ref().map(|samples| samples.as_slice()))
    }

    /// Columns and rows of samples.
    #[cfg(feature = "gpu")]
    pub(super) fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Samples per pixel along each axis.
    #[cfg(feature = "gpu")]
    pub(super) fn supersample(&self) -> f32 {
        self.supersample
    }

    /// The largest CoC radius of what `surface` shows as a flat mirror.
    pub(super) fn farthest_px(&self, surface: u32) -> f32 {
        self.farthest_px[surface as usize]
    }

    /// The same with light that `smooth` smooths: as colours of a layer whose CoC radii are those of the reflections, in samples.
    #[must_use]
    pub(in crate::methods) fn smoothed(&self, smooth: impl Fn(&mut Layer)) -> Self {
        let [width, height] = self.size;
        let of_layer = |samples: &Arc<Vec<Reflecting>>| {
            let plane = |value: &dyn Fn(&Reflecting) -> f32| {
                let mut plane = Plane::zeros(width, height);
                plane.values_mut().iter_mut().zip(&**samples).for_each(|(to, sample)| *to = value(sample));
                plane
            };
            let mut layer = Layer {
                color: [0, 1, 2].map(|k| plane(&|sample| sample.light[k])),
                alpha: plane(&|sample| if sample.surface > 0 { 1.0 } else { 0.0 }),
                coc_px: plane(&|sample| self.supersample * sample.blur_px()),
            };
            smooth(&mut layer);
            let [red, green, blue] = layer.color.each_ref().map(Plane::values);
            let light = red.iter().zip(green).zip(blue).map(|((r, g), b)| [*r, *g, *b]);
            let samples = samples.iter().zip(light).map(|(sample, light)| Reflecting { light, ..*sample });
            Arc::new(samples.collect())
        };
        let layers = self.layers.iter().map(|layer| layer.as_ref().map(of_layer)).collect();
        Self { layers, ..self.clone() }
    }

    /// The sample of layer `number` at `x, y`, if the layer reflects.
    #[inline]
    fn sample(&self, number: usize, (x, y): (usize, usize)) -> Option<&Reflecting> {
        let samples = self.layers.get(number)?.as_ref()?;
        samples.get(y * self.size[0] + x)
    }

    /// The fragment of `surface` at a sample: that of layer `own` before others, with its layer.
    #[inline]
    fn fragment(&self, at: (usize, usize), surface: u32, own: usize) -> Option<(usize, &Reflecting)> {
        let of_layer = |layer: usize| {
            let sample = self.sample(layer, at).filter(|sample| sample.surface == surface)?;
            Some((layer, sample))
        };
        of_layer(own).or_else(|| (0..self.layers.len()).filter(|&layer| layer != own).find_map(of_layer))
    }

    /// The fragments at a sample whose reflection moves: their layers and CoC radii.
    pub(in crate::methods) fn fragments_at(&self, at: (usize, usize)) -> impl Iterator<Item = (usize, f32)> {
        (0..self.layers.len()).filter_map(move |number| {
            let sample = self.sample(number, at).filter(|sample| sample.share() > 0.0)?;
            Some((number, sample.coc_px))
        })
    }

    /// [`ReflectedLight::moved`] in the fragment of CoC radius `coc_px` at the sample `at`, whatever its layer.
    pub(in crate::methods) fn moved_at(
        &self,
        (at, coc_px): ((usize, usize), f32),
        ray: &LensRay,
    ) -> Option<MovedLight> {
        let (layer, _) = self.fragments_at(at).find(|(_, own_px)| *own_px == coc_px)?;
        self.moved(Met { layer, at }, ray)
    }

    /// The light that `ray` sees in the fragment that it has `met`, of all that moves.
    pub(in crate::methods) fn seen(&self, met: Met, ray: &LensRay) -> [f32; 3] {
        let moved = self.moved(met, ray);
        moved.map_or([0.0; 3], |moved| moved.seen.map(|value| value / moved.share))
    }

    /// What changes for `ray` in the light of the fragment that it has `met`; `None` if none of it moves.
    #[inline]
    pub(in crate::methods) fn moved(&self, met: Met, ray: &LensRay) -> Option<MovedLight> {
        let own = self.sample(met.layer, met.at).filter(|sample| sample.share() > 0.0)?;
        let mut seen = [0.0; 3];
        let mut add = |share: f32, place: &Reflecting| {
            seen.iter_mut().zip(place.light).for_each(|(sum, value)| *sum += share * value);
        };
        if own.flat > 0.0 {
            add(own.flat, self.behind_mirror((own, met.layer), ray));
        }
        if own.curved > 0.0 {
            add(own.curved, self.on_curve((own, met.layer), ray));
        }
        let share = own.share();
        Some(MovedLight { own: own.light.map(|value| share * value), seen, share })
    }

    /// The sample at `cell`; past the border, the nearest border sample.
    #[inline]
    fn clamped(&self, cell: IVec2) -> (usize, usize) {
        let last = |samples: usize| samples as i32 - 1;
        let [width, height] = self.size;
        (cell.x.clamp(0, last(width)) as usize, cell.y.clamp(0, last(height)) as usize)
    }

    /// The fragment whose reflection `ray` sees in the curved surface of `met`, which lies in layer `own`.
    fn on_curve<'a>(&'a self, (met, own): (&'a Reflecting, usize), ray: &LensRay) -> &'a Reflecting {
        let lens = ray.step / self.supersample;
        let from = ray.start + met.coc_px * ray.step;
        let mut place = met;
        for _ in 0..STEPS {
            let at = self.clamped(floor(from + place.moved_by(lens) * self.supersample));
            match self.fragment(at, met.surface, own) {
                // From here on every step ends at the same place.
                Some((_, found)) if std::ptr::eq(found, place) => break,
                Some((_, found)) => place = found,
                None => break,
            }
        }
        place
    }

    /// The fragment that `ray` meets behind the flat mirror of `met`, which lies in layer `own`.
    fn behind_mirror<'a>(&'a self, (met, own): (&'a Reflecting, usize), ray: &LensRay) -> &'a Reflecting {
        let farthest_px = self.farthest_px(met.surface);
        let mut enter = met.coc_px;
        let mut cell = ray.cell(enter);
        let (mut passed, mut passed_px) = (met, met.mirrored_px[1]);
        loop {
            let (exit, side) = ray.leaves(cell, 1);
            if let Some((_, shown)) = self.fragment(self.clamped(cell), met.surface, own) {
                let [near, far] = shown.mirrored_px;
                if near <= exit && far >= enter {
                    return shown;
                }
                if far > passed_px - JOIN_PX {
                    (passed, passed_px) = (shown, far);
                }
            }
            if exit >= farthest_px {
                return passed;
            }
            (cell, enter) = (cell + side, exit);
        }
    }
}

/// The sample at `position`.
#[inline]
fn floor(position: Vec2) -> IVec2 {
    // `floor` is a call into the C library on processors before SSE 4.1.
    let towards_zero = position.as_ivec2();
    towards_zero - IVec2::select(towards_zero.as_vec2().cmpgt(position), IVec2::ONE, IVec2::ZERO)
}
