//! The stack as a set of boxes in `(x, y, c)`, and ray traversal through them.

use super::tiles::{Passage, TILE, Tiles};
use crate::lens::{Field, Optics, Rays, View};
use crate::methods::contract::{LostRays, Plan};
use crate::methods::shared::RaySum;
use crate::scene::surface::{self, JOIN_PX};
use crate::scene::{Background, Layer, OPAQUE_ALPHA, Scene};
use glam::{IVec2, Vec2};
use std::borrow::Borrow;
use std::sync::Arc;

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
    pub(super) background: Option<Arc<Background>>,
    pub(super) lost_rays: LostRays,
    pub(super) optics: Optics,
    pub(super) field: Field,
}

/// The centre of picture pixel `x, y`.
fn centre(x: usize, y: usize) -> Vec2 {
    Vec2::new(x as f32 + 0.5, y as f32 + 0.5)
}

/// Interval of CoC depth of the fragment `x, y` of `layer`; it extends less than half of [`JOIN_PX`] to either side of its own
/// depth.
fn extent(layer: &Layer, x: usize, y: usize) -> [f32; 2] {
    let coc = layer.coc_px.get(x, y);
    let mut interval = [coc; 2];
    if layer.alpha.get(x, y) < OPAQUE_ALPHA {
        // Translucent fragments have no thickness: overlapping ones would attenuate a ray twice.
        return interval;
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
            interval = [interval[0].min(middle), interval[1].max(middle)];
        }
    }
    interval
}

/// Position of a fragment relative to a ray's interval of CoC depth in its sample.
enum DepthOrder {
    InFront,
    Overlapping,
    Behind,
}

/// Position of the fragment `x, y` of `layer` relative to `coc_interval`.
fn depth_order(layer: &Layer, x: usize, y: usize, coc_interval: [f32; 2]) -> DepthOrder {
    let coc = layer.coc_px.get(x, y);
    if coc > coc_interval[1] + JOIN_PX {
        return DepthOrder::Behind;
    }
    if coc < coc_interval[0] - JOIN_PX {
        return DepthOrder::InFront;
    }
    let within = coc >= coc_interval[0] && coc <= coc_interval[1];
    let overlaps = within || {
        let [near, far] = extent(layer, x, y);
        near <= coc_interval[1] && far >= coc_interval[0]
    };
    // Close to the interval without overlapping it: the fragments of further layers may overlap, so never `Behind`.
    if overlaps { DepthOrder::Overlapping } else { DepthOrder::InFront }
}

impl<'a> Volume<&'a Layer> {
    /// The boxes of `scene`.
    pub(crate) fn new(scene: &'a Scene, plan: &Plan) -> Self {
        Self::from_first_layers(scene.layers.len(), scene, plan)
    }

    /// The boxes of the first `count` layers of `scene`.
    pub(crate) fn from_first_layers(count: usize, scene: &'a Scene, plan: &Plan) -> Self {
        let background = plan.background(scene);
        Self::from_layers(
            scene.layers.iter().take(count).collect(),
            (scene.supersample, scene.field),
            background,
            plan,
        )
    }
}

impl Volume<Layer> {
    /// The boxes of `scene`, owning its layers.
    pub(super) fn owning(scene: Scene, plan: &Plan) -> Self {
        let background = plan.background(&scene);
        Self::from_layers(scene.layers, (scene.supersample, scene.field), background, plan)
    }
}

impl<L: Borrow<Layer>> Volume<L> {
    fn from_layers(
        layers: Vec<L>,
        (supersample, field): (usize, Field),
        background: Option<Arc<Background>>,
        plan: &Plan,
    ) -> Self {
        let first = layers.first().map(Borrow::borrow);
        let size = first.map_or([0; 2], |layer| [layer.width() as i32, layer.height() as i32]);
        Self {
            layers,
            tiles: Tiles::new(size, plan.coc_range_px),
            size,
            supersample: supersample as f32,
            coc_range_px: plan.coc_range_px,
            jitter: if supersample > 1 { 1.0 } else { plan.jitter },
            background,
            lost_rays: plan.lost_rays,
            optics: plan.optics.clone(),
            field,
        }
    }

    /// Mean colour over `rays` of picture pixel `x, y`, with the rays of each channel's set.
    pub(crate) fn pixel(&self, x: usize, y: usize, rays: &Rays) -> [f32; 4] {
        let mut pixel = [0.0; 4];
        for (views, channels) in rays.sets() {
            let mean = self.mean_color(x, y, views);
            channels.iter().for_each(|&channel| pixel[channel] = mean[channel]);
        }
        pixel
    }

    /// Mean colour over the rays of picture pixel `x, y` for those of `views` that the lens barrel does not occlude.
    fn mean_color(&self, x: usize, y: usize, views: &[View]) -> [f32; 4] {
        let centre = centre(x, y);
        let height = self.field.height(centre);
        let (mut sum, mut rays) = (RaySum::default(), 0);
        for view in views.iter().filter(|view| self.optics.within_barrel(view.lens, height) >= 0.0) {
            let ray = self.ray(centre, view);
            let left = self.follow(&ray, &mut sum);
            sum.end(left, self.share_of_background(&ray, left));
            rays += 1;
        }
        sum.mean(rays, self.lost_rays)
    }

    /// Whether the ray of `view` from picture pixel `x, y` passes the lens barrel.
    pub(crate) fn passes_barrel(&self, x: usize, y: usize, view: &View) -> bool {
        self.optics.within_barrel(view.lens, self.field.height(centre(x, y))) >= 0.0
    }

    /// Fraction of the rays `samples` of picture pixel `x, y` that hit nothing although they pass behind a fragment of the last
    /// layer: a further layer might have content there.
    pub(crate) fn lost_rays(&self, x: usize, y: usize, samples: &[View]) -> f64 {
        let centre = centre(x, y);
        let lost = |view: &View| {
            let ray = self.ray(centre, view);
            let left = self.follow(&ray, &mut RaySum::default());
            let lost = left - left.min(self.share_of_background(&ray, left));
            if lost > 0.0 && self.passes_last_layer(&ray) { f64::from(lost) } else { 0.0 }
        };
        let passing = samples.iter().filter(|view| self.passes_barrel(x, y, view));
        passing.map(lost).sum::<f64>() / samples.len() as f64
    }

    /// The ray of `view` through the pixel with its centre at `centre`, in picture pixels.
    fn ray(&self, centre: Vec2, view: &View) -> Ray {
        let point = centre + self.jitter * view.jitter + view.shift;
        Ray::new(point * self.supersample, view.lens * self.supersample)
    }

    /// Share of the background where `ray` ends with the transmittance `left`; 0 for a ray that is occluded.
    fn share_of_background(&self, ray: &Ray, left: f32) -> f32 {
        let Some(background) = self.background.as_deref().filter(|_| left > 0.0) else { return 0.0 };
        let supersample = self.supersample as i32;
        background.met_by(|coc_px| ray.cell(coc_px).div_euclid(IVec2::splat(supersample)))
    }

    /// Whether `ray` passes behind any fragment of the last layer.
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

    /// The sample at `cell`; past the border, the nearest border sample.
    fn clamped(&self, cell: IVec2) -> (usize, usize) {
        let [width, height] = self.size;
        (cell.x.clamp(0, width - 1) as usize, cell.y.clamp(0, height - 1) as usize)
    }

    /// Traces `ray` through the stack, adds the fragments that it hits to `sum`, and returns the transmittance that is left.
    fn follow(&self, ray: &Ray, sum: &mut RaySum) -> f32 {
        let [nearest, farthest] = self.coc_range_px;
        let mut enter = nearest;
        let mut tile = ray.cell(enter).div_euclid(IVec2::splat(TILE));
        let mut transmittance = 1.0;
        loop {
            let (exit, side) = ray.leaves(tile * TILE, TILE);
            if let Some(passage) = self.tiles.passage(&self.layers, tile, [enter, exit.min(farthest)]) {
                transmittance = self.cross_tile(ray, tile, passage, transmittance, sum);
            }
            if transmittance <= 0.0 || exit >= farthest {
                return transmittance;
            }
            tile += side;
            enter = exit;
        }
    }

    /// Traces `ray` over the samples of `tile` and returns its transmittance after them.
    fn cross_tile(
        &self,
        ray: &Ray,
        tile: IVec2,
        Passage { coc_interval: [mut enter, end], nearest_first }: Passage,
        mut transmittance: f32,
        sum: &mut RaySum,
    ) -> f32 {
        let first = tile * TILE;
        let mut cell = ray.cell(enter).clamp(first, first + (TILE - 1));
        loop {
            let (exit, side) = ray.leaves(cell, 1);
            let passage = Passage { coc_interval: [enter, exit.min(end)], nearest_first };
            transmittance = self.hit_sample(cell, passage, transmittance, sum);
            if transmittance <= 0.0 || exit >= end {
                return transmittance;
            }
            cell += side;
            enter = exit;
        }
    }

    /// Adds the fragments of one sample that overlap the ray's interval there, nearest first, and returns the transmittance after
    /// them.
    fn hit_sample(&self, cell: IVec2, passage: Passage, mut transmittance: f32, sum: &mut RaySum) -> f32 {
        let Passage { coc_interval, nearest_first } = passage;
        let (x, y) = self.clamped(cell);
        for layer in &self.layers {
            let layer = layer.borrow();
            let alpha = layer.alpha.get(x, y);
            if alpha <= 0.0 {
                continue;
            }
            match depth_order(layer, x, y, coc_interval) {
                DepthOrder::Behind if nearest_first => break,
                DepthOrder::InFront | DepthOrder::Behind => continue,
                DepthOrder::Overlapping => (),
            }
            sum.add(layer.color_at(x, y), transmittance);
            transmittance *= if alpha >= OPAQUE_ALPHA { 0.0 } else { 1.0 - alpha };
            if transmittance <= 0.0 {
                break;
            }
        }
        transmittance
    }
}

/// A ray: at CoC depth `c` it is at sample position `start + c·step`.
pub(super) struct Ray {
    start: Vec2,
    step: Vec2,
    /// `1 / step`; 0 along an axis that the ray is perpendicular to.
    pub(super) inverse: Vec2,
    /// CoC depth at which the ray leaves a sample along an axis that it is perpendicular to: infinity; 0 on other axes.
    perpendicular_exit: Vec2,
    /// Direction on each axis: −1 or 1.
    heading: IVec2,
}

impl Ray {
    pub(super) fn new(start: Vec2, step: Vec2) -> Self {
        // Below this step a ray crosses no sample boundary within any CoC that occurs.
        const STEEP: f32 = 1e-7;
        let moves = step.abs().cmpgt(Vec2::splat(STEEP));
        Self {
            start,
            step,
            inverse: Vec2::select(moves, step.recip(), Vec2::ZERO),
            perpendicular_exit: Vec2::select(moves, Vec2::ZERO, Vec2::INFINITY),
            heading: IVec2::select(step.cmpgt(Vec2::ZERO), IVec2::ONE, IVec2::NEG_ONE),
        }
    }

    /// The sample at CoC depth `coc`.
    fn cell(&self, coc: f32) -> IVec2 {
        let position = self.start + coc * self.step;
        // `floor` is a call into the C library on processors before SSE 4.1, which took a tenth of the time.
        let towards_zero = position.as_ivec2();
        towards_zero - IVec2::select(towards_zero.as_vec2().cmpgt(position), IVec2::ONE, IVec2::ZERO)
    }

    /// CoC depth at which the ray leaves the square of `side` samples that begins at `first`, and the direction in which it
    /// leaves.
    #[inline]
    fn leaves(&self, first: IVec2, side: i32) -> (f32, IVec2) {
        let edge = first + side * self.heading.max(IVec2::ZERO);
        let leave = (edge.as_vec2() - self.start) * self.inverse + self.perpendicular_exit;
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
    fn a_ray_leaves_a_square_on_the_side_of_its_direction() {
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
    fn extents_of_neighbours_within_half_a_pixel_of_coc_meet_halfway() {
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
            "the first extends to the second, the second to the first, the third to none"
        );
        for coc_interval in
            [[-0.1, 0.1], [0.15, 0.25], [0.19, 0.3], [0.21, 0.3], [0.45, 0.6], [1.0, 1.4], [1.9, 2.1]]
        {
            let found =
                [0, 1, 2].map(|x| matches!(depth_order(&layer, x, 0, coc_interval), DepthOrder::Overlapping));
            let expected = extents.map(|[near, far]| near <= coc_interval[1] && far >= coc_interval[0]);
            assert_eq!(found, expected, "{coc_interval:?}");
        }
    }

    #[test]
    fn the_nearest_layer_is_visible_whatever_the_order_of_layers() {
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
                background: None,
                lost_rays: LostRays::LeftOut,
                optics: Optics::from_aperture(Aperture::DISC),
                field: Field::from_picture_size(3, 3),
            };
            let view = View { lens: Vec2::new(0.9, 0.1), jitter: Vec2::ZERO, shift: Vec2::ZERO };
            let pixel = volume.pixel(1, 1, &Rays::alike(vec![view]));
            assert_eq!(pixel, [0.2, 0.2, 0.2, 1.0], "{order}");
        }
    }
}
