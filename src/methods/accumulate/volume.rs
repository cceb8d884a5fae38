//! The stack as a set of boxes in `(x, y, c)`, and the way of a ray through them.

use super::tiles::{Passage, TILE, Tiles};
use crate::lens::{Field, Optics, Rays, View};
use crate::methods::contract::Plan;
use crate::methods::shared::RaySum;
use crate::scene::surface::{self, JOIN_PX};
use crate::scene::{EffectKind, Layer, OPAQUE_ALPHA, Scene};
use glam::{IVec2, Vec2};
use std::borrow::Borrow;

/// The stack as a set of boxes in `(x, y, c)`.
#[derive(Debug)]
pub(crate) struct Volume<L> {
    pub(super) layers: Vec<L>,
    pub(super) tiles: Tiles,
    /// Columns and rows of samples.
    pub(super) size: [i32; 2],
    pub(super) supersample: f32,
    pub(super) coc_range_px: [f32; 2],
    pub(super) jitter: f32,
    pub(super) transparent_background: bool,
    pub(super) optics: Optics,
    pub(super) field: Field,
}

/// The middle of picture pixel `x, y`.
fn centre(x: usize, y: usize) -> Vec2 {
    Vec2::new(x as f32 + 0.5, y as f32 + 0.5)
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
        if layer.alpha.get(nx, ny) > 0.0 && surface::joins(coc, other) {
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

impl<'a> Volume<&'a Layer> {
    /// The boxes of `scene`.
    pub(crate) fn new(scene: &'a Scene, plan: &Plan) -> Self {
        Self::from_first_layers(scene.layers.len(), scene, plan)
    }

    /// The boxes of the first `count` layers of `scene`.
    pub(crate) fn from_first_layers(count: usize, scene: &'a Scene, plan: &Plan) -> Self {
        Self::of(scene.layers.iter().take(count).collect(), (scene.supersample, scene.field), plan)
    }
}

impl Volume<Layer> {
    /// The boxes of `scene`, which it keeps.
    pub(super) fn owning(scene: Scene, plan: &Plan) -> Self {
        Self::of(scene.layers, (scene.supersample, scene.field), plan)
    }
}

impl<L: Borrow<Layer>> Volume<L> {
    fn of(layers: Vec<L>, (supersample, field): (usize, Field), plan: &Plan) -> Self {
        let first = layers.first().map(Borrow::borrow);
        let size = first.map_or([0; 2], |layer| [layer.width() as i32, layer.height() as i32]);
        Self {
            layers,
            tiles: Tiles::new(size, plan.coc_range_px),
            size,
            supersample: supersample as f32,
            coc_range_px: plan.coc_range_px,
            jitter: if supersample > 1 { 1.0 } else { plan.jitter },
            transparent_background: plan.does(EffectKind::TransparentBackground),
            optics: plan.optics.clone(),
            field,
        }
    }

    /// The mean over `rays` of picture pixel `x, y`: of those of each colour.
    pub(crate) fn pixel(&self, x: usize, y: usize, rays: &Rays) -> [f32; 4] {
        let mut pixel = [0.0; 4];
        for (views, channels) in rays.sets() {
            let seen = self.seen(x, y, views);
            channels.iter().for_each(|&channel| pixel[channel] = seen[channel]);
        }
        pixel
    }

    /// The mean over the rays of those of `views` that pass the lens's barrel from picture pixel `x, y`.
    fn seen(&self, x: usize, y: usize, views: &[View]) -> [f32; 4] {
        let centre = centre(x, y);
        let height = self.field.height(centre);
        let (mut sum, mut rays) = (RaySum::default(), 0);
        for view in views.iter().filter(|view| self.optics.within_barrel(view.lens, height) >= 0.0) {
            sum.missed += f64::from(self.follow(&self.ray(centre, view), &mut sum));
            rays += 1;
        }
        sum.mean(rays, self.transparent_background)
    }

    /// Whether the ray of `view` passes the lens's barrel from picture pixel `x, y`.
    pub(crate) fn passes_barrel(&self, x: usize, y: usize, view: &View) -> bool {
        self.optics.within_barrel(view.lens, self.field.height(centre(x, y))) >= 0.0
    }

    /// Share of the rays `samples` of picture pixel `x, y` that find nothing, after they have passed behind something of the last
    /// layer: what a further layer may hold is lost to them.
    pub(crate) fn lost_rays(&self, x: usize, y: usize, samples: &[View]) -> f64 {
        let centre = centre(x, y);
        let lost = |view: &View| {
            let ray = self.ray(centre, view);
            let missed = self.follow(&ray, &mut RaySum::default());
            if missed > 0.0 && self.passes_last_layer(&ray) { f64::from(missed) } else { 0.0 }
        };
        let passing = samples.iter().filter(|view| self.passes_barrel(x, y, view));
        passing.map(lost).sum::<f64>() / samples.len() as f64
    }

    /// The ray of `view` through the pixel whose centre is at `centre`, a place in the picture.
    fn ray(&self, centre: Vec2, view: &View) -> Ray {
        let point = centre + self.jitter * view.jitter + view.shift;
        Ray::new(point * self.supersample, view.lens * self.supersample)
    }

    /// Whether `ray` is behind something of the last layer anywhere on its way.
    fn passes_last_layer(&self, ray: &Ray) -> bool {
        let Some(last) = self.layers.last().map(Borrow::borrow) else { return false };
        let [mut enter, farthest] = self.coc_range_px;
        let mut cell = ray.cell(enter);
        while enter < farthest {
            let (exit, side) = ray.leaves(cell, 1);
            let (x, y) = self.clamped(cell);
            if last.alpha.get(x, y) > 0.0 && last.coc_px.get(x, y) < exit.min(farthest) {
                return true;
            }
            (cell, enter) = (cell + side, exit);
        }
        false
    }

    /// The sample at `cell`, of which those at the border go on for ever.
    fn clamped(&self, cell: IVec2) -> (usize, usize) {
        let [width, height] = self.size;
        (cell.x.clamp(0, width - 1) as usize, cell.y.clamp(0, height - 1) as usize)
    }

    /// Follows `ray` through the stack, adds what it meets to `sum`, and returns what finds nothing.
    fn follow(&self, ray: &Ray, sum: &mut RaySum) -> f32 {
        let [nearest, farthest] = self.coc_range_px;
        let mut enter = nearest;
        let mut tile = ray.cell(enter).div_euclid(IVec2::splat(TILE));
        let mut transmitted = 1.0;
        loop {
            let (exit, side) = ray.leaves(tile * TILE, TILE);
            if let Some(passage) = self.tiles.passage(&self.layers, tile, [enter, exit.min(farthest)]) {
                transmitted = self.cross(ray, tile, passage, transmitted, sum);
            }
            if transmitted <= 0.0 || exit >= farthest {
                return transmitted;
            }
            tile += side;
            enter = exit;
        }
    }

    /// Follows `ray` over the samples of `tile` and returns what passes them.
    fn cross(
        &self,
        ray: &Ray,
        tile: IVec2,
        Passage { stay: [mut enter, end], nearest_first }: Passage,
        mut transmitted: f32,
        sum: &mut RaySum,
    ) -> f32 {
        let first = tile * TILE;
        let mut cell = ray.cell(enter).clamp(first, first + (TILE - 1));
        loop {
            let (exit, side) = ray.leaves(cell, 1);
            let stay = Passage { stay: [enter, exit.min(end)], nearest_first };
            transmitted = self.meet(cell, stay, transmitted, sum);
            if transmitted <= 0.0 || exit >= end {
                return transmitted;
            }
            cell += side;
            enter = exit;
        }
    }

    /// Adds the fragments of one sample that overlap its stay there, nearest first, and returns what passes them.
    fn meet(&self, cell: IVec2, passage: Passage, mut transmitted: f32, sum: &mut RaySum) -> f32 {
        let Passage { stay, nearest_first } = passage;
        let (x, y) = self.clamped(cell);
        for layer in &self.layers {
            let layer = layer.borrow();
            let alpha = layer.alpha.get(x, y);
            if alpha <= 0.0 {
                continue;
            }
            match meeting(layer, x, y, stay) {
                Meeting::Behind if nearest_first => break,
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

/// The samples `start + c·step` that a ray passes, `c` its CoC depth.
pub(super) struct Ray {
    start: Vec2,
    step: Vec2,
    /// `1 / step`, 0 along an axis that it does not move on.
    pub(super) inverse: Vec2,
    /// CoC depth at which it leaves a sample along such an axis: never.
    never: Vec2,
    /// Where it heads: −1 or 1 on each axis.
    heading: IVec2,
}

impl Ray {
    pub(super) fn new(start: Vec2, step: Vec2) -> Self {
        // A ray this steep crosses no sample within any CoC that occurs.
        const STEEP: f32 = 1e-7;
        let moves = step.abs().cmpgt(Vec2::splat(STEEP));
        Self {
            start,
            step,
            inverse: Vec2::select(moves, step.recip(), Vec2::ZERO),
            never: Vec2::select(moves, Vec2::ZERO, Vec2::INFINITY),
            heading: IVec2::select(step.cmpgt(Vec2::ZERO), IVec2::ONE, IVec2::NEG_ONE),
        }
    }

    /// The sample at CoC depth `coc`.
    fn cell(&self, coc: f32) -> IVec2 {
        let place = self.start + coc * self.step;
        // Rounding down is a call into the C library on processors before SSE 4.1: a tenth of all time.
        let towards_zero = place.as_ivec2();
        towards_zero - IVec2::select(towards_zero.as_vec2().cmpgt(place), IVec2::ONE, IVec2::ZERO)
    }

    /// At which CoC depth it leaves the square of `side` samples that begins at `first`, and on which side.
    #[inline]
    fn leaves(&self, first: IVec2, side: i32) -> (f32, IVec2) {
        let edge = first + side * self.heading.max(IVec2::ZERO);
        let leave = (edge.as_vec2() - self.start) * self.inverse + self.never;
        if leave.x <= leave.y {
            (leave.x, IVec2::new(self.heading.x, 0))
        } else {
            (leave.y, IVec2::new(0, self.heading.y))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;
    use crate::lens::Aperture;

    #[test]
    fn a_ray_leaves_a_cell_where_its_line_meets_the_side_it_heads_for() {
        let leaves = |x: f32, y: f32, side: i32| {
            Ray::new(Vec2::splat(0.25), Vec2::new(x, y)).leaves(IVec2::ZERO, side)
        };
        assert_eq!(
            leaves(0.5, 0.0, 1),
            (1.5, IVec2::X),
            "three quarters of a cell at half a cell per unit of c"
        );
        assert_eq!(leaves(0.0, -0.5, 1), (0.5, IVec2::NEG_Y), "a quarter of a cell the other way");
        assert_eq!(leaves(0.5, 0.5, 8), (15.5, IVec2::X), "of eight cells");
        assert_eq!(leaves(0.0, 0.0, 1).0, f32::INFINITY, "never");
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
            let volume = Volume {
                layers,
                tiles: Tiles::new([3, 3], [-1.0, 2.0]),
                size: [3, 3],
                supersample: 1.0,
                coc_range_px: [-1.0, 2.0],
                jitter: 0.0,
                transparent_background: false,
                optics: Optics::from_aperture(Aperture::DISC),
                field: Field::from_picture_size(3, 3),
            };
            let view = View { lens: Vec2::new(0.9, 0.1), jitter: Vec2::ZERO, shift: Vec2::ZERO };
            let seen = volume.pixel(1, 1, &Rays::alike(vec![view]));
            assert_eq!(seen, [0.2, 0.2, 0.2, 1.0], "{order}");
        }
    }
}
