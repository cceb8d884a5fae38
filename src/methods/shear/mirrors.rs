//! Surfaces whose reflection the lens moves ([`crate::scene::Reflections`]): the light that moves is taken out of the layers, and each ray
//! that hits such a surface sees it where [`ReflectedLight`] says.
//!
//! A span paints what does not move, and notes the rays that it stops (the stencil). After a view's last span, each of these looks up what
//! it sees: one look-up a noted pixel and view. The reflection is smoothed over the gaps between lens samples by its own blur, not by the
//! surface's: a mirror in focus does not blur, and what it shows does.
//!
//! Cost: a look-up for each noted pixel and view, of a few samples on a curved surface and of those up to the mirrored fragment in a flat
//! mirror. Memory: 52 bytes a sample of each layer that reflects, twice while they are smoothed.

use super::prefilter;
use crate::image::Plane;
use crate::methods::contract::Plan;
use crate::methods::shared::{LensRay, Met, ReflectedLight};
use crate::scene::{EffectKind, Layer, ReflectingLayer, Reflections, Scene};
use crate::stack::StackKind;
use glam::Vec2;
use std::sync::Arc;

/// Difference in CoC radius, in picture pixels, up to which a sample's fragment is that of its pixel.
pub(super) const SAME_PX: f32 = 0.5;

/// The surfaces of the painted layers whose reflection moves.
#[derive(Debug, Clone)]
pub(super) struct Mirrors {
    reflected: ReflectedLight,
    /// For each painted layer, how much of each pixel's ray sees light that moves: coverage times share; `None` where there is none.
    weights: Vec<Option<Plane>>,
    supersample: usize,
}

/// A ray that a surface stops whose reflection moves.
#[derive(Debug, Clone, Copy)]
pub(super) struct Noted {
    /// Column of the picture.
    pub(super) x: u32,
    /// The painted layer, and column and row of its fragment.
    pub(super) layer: u16,
    pub(super) column: u32,
    pub(super) row: u32,
    /// What the ray has left there, times what it sees of light that moves.
    pub(super) weight: f32,
    /// How far the fragment counts as in focus.
    pub(super) focus: f32,
}

/// Adds `share` of the light that moves to the colours of `layers`.
fn add_moving(layers: &mut [Layer], reflections: &Reflections, share: f32) {
    for (layer, reflecting) in layers.iter_mut().zip(&reflections.layers) {
        let Some(reflecting) = reflecting else { continue };
        for (color, light) in layer.color.iter_mut().zip(&reflecting.light) {
            for y in 0..layer.alpha.height() {
                let moving = light.row(y).iter().zip(layer.alpha.row(y));
                let shares = reflecting.flat.row(y).iter().zip(reflecting.curved.row(y));
                for ((color, (light, alpha)), (flat, curved)) in
                    color.row_mut(y).iter_mut().zip(moving).zip(shares)
                {
                    // Where nothing moves, the colour keeps its bits.
                    let moves = flat + curved;
                    if moves > 0.0 {
                        *color += share * moves * alpha * light;
                    }
                }
            }
        }
    }
}

/// `of` applied to `scene` without the light that moves, which is in the scene again after it.
pub(super) fn without_moving<T>(scene: &mut Scene, plan: &Plan, of: impl FnOnce(&mut Scene) -> T) -> T {
    let Some(reflections) = moving(scene, plan) else { return of(scene) };
    add_moving(&mut scene.layers, &reflections, -1.0);
    let found = of(scene);
    add_moving(&mut scene.layers, &reflections, 1.0);
    found
}

/// What the surfaces of `scene` reflect, if the plan moves it.
fn moving(scene: &Scene, plan: &Plan) -> Option<Arc<Reflections>> {
    scene.reflections.clone().filter(|_| plan.does(EffectKind::Reflections))
}

/// What of a scene moves, at the resolution of the painted layers.
#[derive(Debug)]
pub(super) struct Moving {
    reflected: ReflectedLight,
    supersample: usize,
    /// Layers whose colour is light that moves, multiplied by coverage.
    light: Vec<Layer>,
    /// Layers whose red is the share of light that moves, times coverage.
    share: Vec<Layer>,
}

impl Moving {
    /// That of `scene`, if the plan moves reflections.
    pub(super) fn of(scene: &Scene, plan: &Plan) -> Option<Self> {
        let (reflections, reflected) = (moving(scene, plan)?, ReflectedLight::of(scene, plan)?);
        let zeros = || Plane::zeros(scene.width(), scene.height());
        let dark = |layer: &Layer| Layer { color: [zeros(), zeros(), zeros()], ..layer.clone() };
        let mut light: Vec<Layer> = scene.layers.iter().map(dark).collect();
        add_moving(&mut light, &reflections, 1.0);
        let share = |(layer, reflecting): (&Layer, &Option<ReflectingLayer>)| {
            let red = reflecting.as_ref().map_or_else(zeros, |reflecting| {
                Plane::from_fn(scene.width(), scene.height(), |x, y| {
                    reflecting.share(x, y) * layer.alpha.get(x, y)
                })
            });
            Layer { color: [red, zeros(), zeros()], ..layer.clone() }
        };
        let share = scene.layers.iter().zip(&reflections.layers).map(share).collect();
        let (samples, infinity_px) = (scene.supersample, scene.coc_infinity_px);
        let merged = |layers: Vec<Layer>| match samples {
            1 => layers,
            _ => Scene::new(layers, StackKind::Supersampled, samples, infinity_px).merged().layers,
        };
        Some(Self { reflected, supersample: scene.supersample, light: merged(light), share: merged(share) })
    }

    /// Takes the light that moves out of the painted `layers`; `None` if there is none.
    pub(super) fn taken_from(self, layers: &mut [Layer]) -> Option<Mirrors> {
        for (layer, light) in layers.iter_mut().zip(&self.light) {
            for (color, light) in layer.color.iter_mut().zip(&light.color) {
                let values = color.values_mut().iter_mut().zip(light.values());
                values.filter(|(_, light)| **light != 0.0).for_each(|(color, light)| *color -= light);
            }
        }
        let red = |Layer { color: [red, _, _], .. }: Layer| red;
        let weights = self.share.into_iter().map(red);
        let weights: Vec<Option<Plane>> = weights
            .map(|plane| Some(plane).filter(|plane| plane.values().iter().any(|&share| share > 0.0)))
            .collect();
        let moves = weights.iter().any(Option::is_some);
        moves.then_some(Mirrors { reflected: self.reflected, weights, supersample: self.supersample })
    }
}

impl Mirrors {
    /// What the surfaces reflect.
    #[cfg(feature = "gpu")]
    pub(super) fn reflected(&self) -> &ReflectedLight {
        &self.reflected
    }

    /// How much of the rays to each pixel of layer `layer` sees light that moves.
    #[inline(always)]
    pub(super) fn weights(&self, layer: usize) -> Option<&Plane> {
        self.weights.get(layer)?.as_ref()
    }

    /// The same, with reflections smoothed for `views` lens samples by `strength` times the gap between them.
    #[must_use]
    pub(super) fn smoothed(&self, views: usize, strength: f32) -> Self {
        let smooth = |layer: &mut Layer| prefilter::smooth(std::slice::from_mut(layer), views, strength);
        Self { reflected: self.reflected.smoothed(smooth), ..self.clone() }
    }

    /// The light that the ray `noted` sees in its surface, not multiplied by its weight: the ray of a view through `lens` that starts `off`
    /// the centre of row `y` of the picture, in pixels. `coc_px` is the fragment's CoC radius.
    pub(super) fn seen(&self, noted: &Noted, (y, off, lens): (usize, Vec2, Vec2), coc_px: f32) -> [f32; 3] {
        let samples = self.supersample as f32;
        let start = (Vec2::new(noted.x as f32 + 0.5, y as f32 + 0.5) + off) * samples;
        let ray = LensRay::new(start, lens * samples);
        let Some(met) = self.met(noted, &ray, coc_px) else { return [0.0; 3] };
        self.reflected.seen(met, &ray)
    }

    /// The sample of the fragment that the ray `noted` has met: of those of its pixel, the nearest one to the ray at the fragment's depth.
    fn met(&self, noted: &Noted, ray: &LensRay, coc_px: f32) -> Option<Met> {
        let (column, row, layer) = (noted.column as usize, noted.row as usize, usize::from(noted.layer));
        if self.supersample == 1 {
            return Some(Met { layer, at: (column, row) });
        }
        let side = self.supersample;
        let place = ray.start + coc_px * ray.step;
        let mut best: Option<(f32, Met)> = None;
        for index in 0..side * side {
            let at = (column * side + index % side, row * side + index / side);
            let centre = Vec2::new(at.0 as f32 + 0.5, at.1 as f32 + 0.5);
            for (number, own_px) in self.reflected.fragments_at(at) {
                let off = ((own_px - coc_px).abs() - SAME_PX).max(0.0);
                let cost = 1e4 * off + centre.distance_squared(place).min(1e4);
                if best.is_none_or(|(least, _)| cost < least) {
                    best = Some((cost, Met { layer: number, at }));
                }
            }
        }
        best.map(|(_, met)| met)
    }
}
