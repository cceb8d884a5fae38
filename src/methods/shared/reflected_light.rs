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
use crate::scene::{EffectKind, ReflectingLayer, Reflections, Scene};
use glam::{IVec2, Vec2};
use std::sync::Arc;

/// Steps towards the place that is seen in a curved surface.
pub(in crate::methods) const STEPS: usize = 4;

/// What the surfaces of a scene reflect, for rays.
#[derive(Debug, Clone)]
pub(in crate::methods) struct ReflectedLight {
    reflections: Arc<Reflections>,
    supersample: f32,
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

impl ReflectedLight {
    /// What the surfaces of `scene` reflect, if the plan moves it.
    pub(in crate::methods) fn of(scene: &Scene, plan: &Plan) -> Option<Self> {
        let reflections = scene.reflections.clone().filter(|_| plan.does(EffectKind::Reflections))?;
        Some(Self { reflections, supersample: scene.supersample as f32 })
    }

    /// For each layer of the scene what its surfaces reflect.
    #[cfg(feature = "gpu")]
    pub(super) fn layers(&self) -> &[Option<ReflectingLayer>] {
        &self.reflections.layers
    }

    /// Columns and rows of samples.
    #[cfg(feature = "gpu")]
    pub(super) fn size(&self) -> [usize; 2] {
        let planes = self.reflections.layers.iter().flatten().map(|layer| &layer.coc_px);
        planes.map(|plane| [plane.width(), plane.height()]).next().unwrap_or([1; 2])
    }

    /// Samples per pixel along each axis.
    #[cfg(feature = "gpu")]
    pub(super) fn supersample(&self) -> f32 {
        self.supersample
    }

    /// The largest CoC radius of what `surface` shows as a flat mirror.
    #[cfg(feature = "gpu")]
    pub(super) fn farthest_px(&self, surface: u32) -> f32 {
        self.reflections.farthest_px[surface as usize]
    }

    /// The same, with other light: that of each layer as `of` makes it.
    #[must_use]
    pub(in crate::methods) fn with_light(&self, of: impl Fn(&ReflectingLayer) -> [Plane; 3]) -> Self {
        let other = |layer: &ReflectingLayer| ReflectingLayer { light: of(layer), ..layer.clone() };
        let layers = self.reflections.layers.iter().map(|layer| layer.as_ref().map(other)).collect();
        let Reflections { farthest_px, stats, .. } = &*self.reflections;
        let reflections = Reflections { layers, farthest_px: farthest_px.clone(), stats: *stats };
        Self { reflections: Arc::new(reflections), supersample: self.supersample }
    }

    /// The fragments at a sample whose reflection moves: their layers and CoC radii.
    pub(in crate::methods) fn fragments_at(
        &self,
        (x, y): (usize, usize),
    ) -> impl Iterator<Item = (usize, f32)> {
        let layers = self.reflections.layers.iter().enumerate();
        layers.filter_map(move |(number, layer)| {
            let layer = layer.as_ref().filter(|layer| layer.share(x, y) > 0.0)?;
            Some((number, layer.coc_px.get(x, y)))
        })
    }

    /// The light that `ray` sees in the fragment that it has `met`, of all that moves.
    pub(in crate::methods) fn seen(&self, met: Met, ray: &LensRay) -> [f32; 3] {
        let moved = self.moved(met, ray);
        moved.map_or([0.0; 3], |moved| moved.seen.map(|value| value / moved.share))
    }

    /// What changes for `ray` in the light of the fragment that it has `met`; `None` if none of it moves.
    #[inline]
    pub(in crate::methods) fn moved(&self, met: Met, ray: &LensRay) -> Option<MovedLight> {
        let layer = self.reflections.layer(met.layer)?;
        let (x, y) = met.at;
        let (flat, curved) = (layer.flat.get(x, y), layer.curved.get(x, y));
        let share = flat + curved;
        if share <= 0.0 {
            return None;
        }
        let mut seen = [0.0; 3];
        let mut add = |share: f32, place: Met| {
            let light = self.light(place);
            seen.iter_mut().zip(light).for_each(|(sum, value)| *sum += share * value);
        };
        if flat > 0.0 {
            add(flat, self.behind_mirror(layer, met, ray));
        }
        if curved > 0.0 {
            add(curved, self.on_curve(layer, met, ray));
        }
        Some(MovedLight { own: self.light(met).map(|value| share * value), seen, share })
    }

    /// The light that is reflected at `place`.
    fn light(&self, place: Met) -> [f32; 3] {
        let (x, y) = place.at;
        let layer = self.reflections.layer(place.layer);
        layer.map_or([0.0; 3], |layer| layer.light.each_ref().map(|plane| plane.get(x, y)))
    }

    /// The place whose reflection `ray` sees in the curved surface that it has `met`.
    fn on_curve(&self, layer: &ReflectingLayer, met: Met, ray: &LensRay) -> Met {
        let surface = layer.surface_at(met.at.0, met.at.1);
        let lens = ray.step / self.supersample;
        let from = ray.start + layer.coc_px.get(met.at.0, met.at.1) * ray.step;
        let mut place = met;
        for _ in 0..STEPS {
            let Some(layer) = self.reflections.layer(place.layer) else { break };
            let moved = from + layer.moved_by(place.at, lens) * self.supersample;
            let at = clamped(floor(moved), &layer.coc_px);
            let Some(layer) = self.reflections.fragment(at, surface, met.layer) else { break };
            place = Met { layer, at };
        }
        place
    }

    /// The place of what `ray` meets behind the flat mirror that it has `met`.
    fn behind_mirror(&self, layer: &ReflectingLayer, met: Met, ray: &LensRay) -> Met {
        let surface = layer.surface_at(met.at.0, met.at.1);
        let farthest_px = self.reflections.farthest_px[surface as usize];
        let mut enter = layer.coc_px.get(met.at.0, met.at.1);
        let mut cell = ray.cell(enter);
        let (mut passed, mut passed_px) = (met, layer.mirrored_px[1].get(met.at.0, met.at.1));
        loop {
            let (exit, side) = ray.leaves(cell, 1);
            let at = clamped(cell, &layer.coc_px);
            if let Some(number) = self.reflections.fragment(at, surface, met.layer)
                && let Some(shown) = self.reflections.layer(number)
            {
                let [near, far] = shown.mirrored_px.each_ref().map(|plane| plane.get(at.0, at.1));
                let place = Met { layer: number, at };
                if near <= exit && far >= enter {
                    return place;
                }
                if far > passed_px - JOIN_PX {
                    (passed, passed_px) = (place, far);
                }
            }
            if exit >= farthest_px {
                return passed;
            }
            (cell, enter) = (cell + side, exit);
        }
    }
}

/// The sample at `cell` of `plane`; past the border, the nearest border sample.
fn clamped(cell: IVec2, plane: &Plane) -> (usize, usize) {
    let last = |samples: usize| samples as i32 - 1;
    (cell.x.clamp(0, last(plane.width())) as usize, cell.y.clamp(0, last(plane.height())) as usize)
}

/// The sample at `position`.
fn floor(position: Vec2) -> IVec2 {
    position.floor().as_ivec2()
}
