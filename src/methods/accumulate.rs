//! Lens rays against the stack, one by one: the obviously right answer that everything else is measured by.
//!
//! Haeberli & Akeley 1990, "The Accumulation Buffer", and Cook, Porter & Carpenter 1984, "Distributed Ray Tracing", with
//! the stack for a scene. A fragment is the square of its sample times an interval of CoC depth: its own `c`, and half the
//! way to each of its four neighbours in the peel that lies within [`JOIN_PX`], so that surfaces have no cracks. A ray
//! `(p + j + c·u, c)` walks the samples it passes over, `c` rising, and meets the fragments of each whose intervals overlap
//! the ray's stay there, nearest first; what a fragment lets through goes on.
//!
//! Past the frame's border the last sample goes on for ever. A ray that leaves without a hit says nothing where the
//! stack's background is closed, and is transparent where it is open.
//!
//! Cost: pixels × rays × samples passed × layers; no shortcut is taken that could change the answer. Memory: none but the
//! picture. Limits: knows only what the peels know.

use super::shared::{RaySampler, Tracer};
use super::{LensSampling, Method, MethodInfo, Progress, RaySum, Sampler};
use crate::error::Error;
use crate::image::Image;
use crate::lens::{View, views};
use crate::scene::{EffectKind, Layer, OPAQUE_ALPHA, Plan, Scene};
use crate::settings::MethodParameters;
use glam::Vec2;
use rayon::prelude::*;
use std::borrow::Borrow;

/// Neighbours in a peel belong to one surface when their CoC radii differ by less than this, in picture pixels.
const JOIN_PX: f32 = 0.5;

/// The reference.
#[derive(Debug)]
pub(super) struct Accumulate;

impl Method for Accumulate {
    fn info(&self) -> MethodInfo {
        MethodInfo {
            name: "accumulate",
            source: "Haeberli & Akeley 1990; Cook, Porter & Carpenter 1984",
            role: "reference",
            summary: "lens rays against the stack, one by one, no shortcut",
            effects: &[],
            steps: &["16", "64", "256"],
            deviations: &[],
        }
    }

    fn lens_samples(&self, parameters: &MethodParameters) -> Option<usize> {
        Some(parameters.accumulate.rays)
    }

    fn lens_sampling(&self) -> Option<&dyn LensSampling> {
        Some(self)
    }

    fn blur(&self, scene: Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        Ok(self.begin(scene, plan).picture(plan.lens_samples(), progress))
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
    samples: Vec<View>,
}

impl Tracer for Accumulation {
    type Scratch = ();

    fn new(scene: Scene, plan: &Plan, rays: usize) -> Self {
        Self { volume: Volume::owning(scene, plan), samples: views(rays, plan.aperture) }
    }

    fn pixel(&self, x: usize, y: usize, (): &mut ()) -> [f32; 4] {
        self.volume.pixel(x, y, &self.samples)
    }
}

/// The stack as a set of boxes in `(x, y, c)`.
#[derive(Debug)]
pub struct Volume<L> {
    layers: Vec<L>,
    /// Whether every sample has its fragments nearest first: past one behind a ray's stay there is then none before it.
    nearest_first: bool,
    size: [i32; 2],
    supersample: f32,
    coc_range_px: [f32; 2],
    jitter: f32,
    open_background: bool,
}

/// From where to where the fragment `x, y` of `layer` reaches in CoC depth: less than half of [`JOIN_PX`] either way.
fn extent(layer: &Layer, x: usize, y: usize) -> [f32; 2] {
    let coc = layer.coc_px.get(x, y);
    let mut reach = [coc; 2];
    if layer.alpha.get(x, y) < OPAQUE_ALPHA {
        // Translucent fragments stay thin: reaching into one another they would count twice.
        return reach;
    }
    let neighbours = [
        (x > 0).then(|| (x - 1, y)),
        (x + 1 < layer.width()).then(|| (x + 1, y)),
        (y > 0).then(|| (x, y - 1)),
        (y + 1 < layer.height()).then(|| (x, y + 1)),
    ];
    for (nx, ny) in neighbours.into_iter().flatten() {
        let other = layer.coc_px.get(nx, ny);
        if layer.alpha.get(nx, ny) > 0.0 && (other - coc).abs() < JOIN_PX {
            let middle = 0.5 * (coc + other);
            reach = [reach[0].min(middle), reach[1].max(middle)];
        }
    }
    reach
}

/// Where a fragment is, seen from a ray's stay in its sample.
enum Meeting {
    Before,
    Met,
    Behind,
}

/// Where the fragment `x, y` of `layer` is, seen from the CoC depths `stay`.
fn meeting(layer: &Layer, x: usize, y: usize, stay: [f32; 2]) -> Meeting {
    let coc = layer.coc_px.get(x, y);
    if coc > stay[1] + JOIN_PX {
        return Meeting::Behind;
    }
    if coc < stay[0] - JOIN_PX {
        return Meeting::Before;
    }
    let within = coc >= stay[0] && coc <= stay[1];
    let met = within || {
        let [near, far] = extent(layer, x, y);
        near <= stay[1] && far >= stay[0]
    };
    // Beside the stay, but not in it: another layer may still be.
    if met { Meeting::Met } else { Meeting::Before }
}

/// Whether all layers have their fragments at every sample in the order of their CoC radii.
fn nearest_first<L: Borrow<Layer> + Sync>(layers: &[L]) -> bool {
    let Some(first) = layers.first() else { return true };
    (0..first.borrow().height()).into_par_iter().all(|y| {
        let mut nearest = vec![f32::NEG_INFINITY; first.borrow().width()];
        layers.iter().all(|layer| {
            let (alpha, coc) = (layer.borrow().alpha.row(y), layer.borrow().coc_px.row(y));
            nearest.iter_mut().zip(alpha.iter().zip(coc)).fold(true, |ordered, (nearest, (&alpha, &coc))| {
                let (before, present) = (*nearest, alpha > 0.0);
                *nearest = if present { coc } else { before };
                ordered & (*nearest >= before)
            })
        })
    })
}

impl<'a> Volume<&'a Layer> {
    /// The boxes of `scene`.
    pub fn new(scene: &'a Scene, plan: &Plan) -> Self {
        Self::of(scene.layers.iter().collect(), scene.supersample, plan)
    }
}

impl Volume<Layer> {
    /// The boxes of `scene`, which it keeps.
    fn owning(scene: Scene, plan: &Plan) -> Self {
        Self::of(scene.layers, scene.supersample, plan)
    }
}

impl<L: Borrow<Layer> + Sync> Volume<L> {
    fn of(layers: Vec<L>, supersample: usize, plan: &Plan) -> Self {
        let first = layers.first().map(Borrow::borrow);
        Self {
            size: first.map_or([0; 2], |layer| [layer.width() as i32, layer.height() as i32]),
            nearest_first: nearest_first(&layers),
            layers,
            supersample: supersample as f32,
            coc_range_px: plan.coc_range_px,
            jitter: if supersample > 1 { 1.0 } else { plan.jitter },
            open_background: plan.does(EffectKind::OpenBackground),
        }
    }

    /// The mean over the rays `samples` of picture pixel `x, y`.
    pub fn pixel(&self, x: usize, y: usize, samples: &[View]) -> [f32; 4] {
        let centre = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
        let mut sum = RaySum::default();
        for view in samples {
            self.follow(centre + self.jitter * view.jitter, view.lens, &mut sum);
        }
        sum.mean(samples.len(), self.open_background)
    }

    /// Follows the ray of sensor point `point` and lens point `lens` through the stack and adds what it meets.
    fn follow(&self, point: Vec2, lens: Vec2, sum: &mut RaySum) {
        let (start, step) = (point * self.supersample, lens * self.supersample);
        let [nearest, farthest] = self.coc_range_px;
        let mut enter = nearest;
        let mut cell = (start + enter * step).floor().as_ivec2();
        let mut transmitted = 1.0;
        loop {
            // The ray leaves the sample through the side it heads for, at the CoC depth where it reaches it.
            let leave_x = leave(start.x, step.x, cell.x);
            let leave_y = leave(start.y, step.y, cell.y);
            let exit = leave_x.min(leave_y);
            transmitted = self.meet(cell.x, cell.y, [enter, exit.min(farthest)], transmitted, sum);
            if transmitted <= 0.0 || exit >= farthest {
                break;
            }
            if leave_x <= leave_y {
                cell.x += if step.x > 0.0 { 1 } else { -1 };
            } else {
                cell.y += if step.y > 0.0 { 1 } else { -1 };
            }
            enter = exit;
        }
        sum.missed += f64::from(transmitted);
    }

    /// Adds the fragments of one sample that overlap `stay`, nearest first, and returns what passes them.
    fn meet(&self, x: i32, y: i32, stay: [f32; 2], mut transmitted: f32, sum: &mut RaySum) -> f32 {
        let x = x.clamp(0, self.size[0] - 1) as usize;
        let y = y.clamp(0, self.size[1] - 1) as usize;
        for layer in &self.layers {
            let layer = layer.borrow();
            let alpha = layer.alpha.get(x, y);
            if alpha <= 0.0 {
                continue;
            }
            match meeting(layer, x, y, stay) {
                Meeting::Behind if self.nearest_first => break,
                Meeting::Before | Meeting::Behind => continue,
                Meeting::Met => (),
            }
            sum.add(layer.color_at(x, y), transmitted);
            transmitted *= if alpha >= OPAQUE_ALPHA { 0.0 } else { 1.0 - alpha };
            if transmitted <= 0.0 {
                break;
            }
        }
        transmitted
    }
}

/// CoC depth at which the coordinate `start + c·step` leaves cell `cell`.
fn leave(start: f32, step: f32, cell: i32) -> f32 {
    // A ray this steep crosses no sample within any CoC that occurs.
    const STEEP: f32 = 1e-7;
    if step > STEEP {
        ((cell + 1) as f32 - start) / step
    } else if step < -STEEP {
        (cell as f32 - start) / step
    } else {
        f32::INFINITY
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;

    #[test]
    fn a_ray_leaves_a_cell_where_its_line_meets_the_side_it_heads_for() {
        assert_eq!(leave(0.25, 0.5, 0), 1.5, "three quarters of a cell at half a cell per unit of c");
        assert_eq!(leave(0.25, -0.5, 0), 0.5, "a quarter of a cell the other way");
        assert_eq!(leave(0.25, 0.0, 0), f32::INFINITY, "never");
    }

    #[test]
    fn neighbours_within_half_a_pixel_of_coc_meet_halfway() {
        let coc = [0.0, 0.4, 2.0];
        let layer = Layer {
            color: std::array::from_fn(|_| Plane::zeros(3, 1)),
            alpha: Plane::filled(3, 1, 1.0),
            coc_px: Plane::from_fn(3, 1, |x, _| coc[x]),
        };
        let extents = [0, 1, 2].map(|x| extent(&layer, x, 0));
        assert_eq!(
            extents,
            [[0.0, 0.2], [0.2, 0.4], [2.0, 2.0]],
            "only the second forward, only the first back"
        );
        for stay in [[-0.1, 0.1], [0.15, 0.25], [0.19, 0.3], [0.21, 0.3], [0.45, 0.6], [1.0, 1.4], [1.9, 2.1]]
        {
            let found = [0, 1, 2].map(|x| matches!(meeting(&layer, x, 0, stay), Meeting::Met));
            let wanted = extents.map(|[near, far]| near <= stay[1] && far >= stay[0]);
            assert_eq!(found, wanted, "{stay:?}");
        }
    }

    #[test]
    fn layers_in_any_order_show_the_nearest() {
        let layer = |value: f32, coc: f32| Layer {
            color: std::array::from_fn(|_| Plane::filled(3, 3, value)),
            alpha: Plane::filled(3, 3, 1.0),
            coc_px: Plane::filled(3, 3, coc),
        };
        for (order, layers) in [
            ("nearest first", vec![layer(0.2, -1.0), layer(0.7, 2.0)]),
            ("farthest first", vec![layer(0.7, 2.0), layer(0.2, -1.0)]),
        ] {
            assert_eq!(nearest_first(&layers), order == "nearest first");
            let volume = Volume {
                nearest_first: nearest_first(&layers),
                layers,
                size: [3, 3],
                supersample: 1.0,
                coc_range_px: [-1.0, 2.0],
                jitter: 0.0,
                open_background: false,
            };
            let seen = volume.pixel(1, 1, &[View { lens: Vec2::new(0.9, 0.1), jitter: Vec2::ZERO }]);
            assert_eq!(seen, [0.2, 0.2, 0.2, 1.0], "{order}");
        }
    }
}
