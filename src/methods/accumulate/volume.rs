//! The stack as a set of boxes in `(x, y, c)`, and ray traversal through them.

use super::surfaces::{Hit, TranslucentHits, extent, is_translucent};
use super::tiles::{Passage, REACH_PX, TILE, Tiles};
use crate::lens::{Field, Optics, Rays, View};
use crate::methods::contract::{LostRays, Plan};
use crate::methods::shared::{LensRay, Met, RayJitter, RaySum, ReflectedLight};
use crate::scene::environment::{EnvironmentShading, Sight};
use crate::scene::{Background, Layer, Scene};
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
    /// Extent of rays in each pixel.
    pub(super) jitter: RayJitter,
    pub(super) background: Option<Arc<Background>>,
    pub(super) lost_rays: LostRays,
    pub(super) optics: Optics,
    pub(super) field: Field,
    /// What the surfaces reflect, if it moves.
    pub(super) reflected: Option<ReflectedLight>,
    /// The environment that they reflect, if it is shaded for each ray.
    pub(super) environment: Option<Arc<EnvironmentShading>>,
}

/// The index of the alpha channel.
const ALPHA: usize = 3;

/// The centre of picture pixel `x, y`.
fn centre(x: usize, y: usize) -> Vec2 {
    Vec2::new(x as f32 + 0.5, y as f32 + 0.5)
}

/// What the hits of rays are added to.
trait Hits {
    /// Adds the fragment that a ray of `transmittance` hits.
    fn hit(&mut self, fragment: &Fragment, transmittance: f32);
}

/// A fragment as a ray sees it.
struct Fragment {
    color: [f32; 3],
    alpha: f32,
    coc_px: f32,
    /// Share of what it reflects that moves with the lens.
    moved: f32,
    /// Whether its colour is shaded for the ray.
    shaded: bool,
}

impl Hits for RaySum {
    fn hit(&mut self, fragment: &Fragment, transmittance: f32) {
        self.add(fragment.color, transmittance);
        self.shaded |= fragment.shaded;
    }
}

/// The colours that rays hit, and how far these are in focus.
struct FocusedHits<'a> {
    colors: RaySum,
    /// Sum over the rays of how far what they hit is in focus.
    focused: f64,
    /// How far a fragment of a CoC radius in picture pixels counts as in focus.
    focus: &'a dyn Fn(f32) -> f32,
}

impl Hits for FocusedHits<'_> {
    fn hit(&mut self, fragment: &Fragment, transmittance: f32) {
        self.colors.hit(fragment, transmittance);
        let covered = transmittance * fragment.alpha * (1.0 - fragment.moved);
        self.focused += f64::from(covered * (self.focus)(fragment.coc_px));
    }
}

/// Position of a fragment relative to a ray's interval of CoC depth in its sample.
enum DepthOrder {
    InFront,
    /// With the part of the interval in which they overlap.
    Overlapping([f32; 2]),
    Behind,
}

/// Position of the fragment at `x, y` of layer `number` relative to `coc_interval`.
fn depth_order<L: Borrow<Layer>>(
    layers: &[L],
    number: usize,
    (x, y): (usize, usize),
    coc_interval: [f32; 2],
) -> DepthOrder {
    let layer = layers[number].borrow();
    let coc = layer.coc_px.get(x, y);
    if coc > coc_interval[1] + REACH_PX {
        return DepthOrder::Behind;
    }
    if coc < coc_interval[0] - REACH_PX {
        return DepthOrder::InFront;
    }
    let within = coc >= coc_interval[0] && coc <= coc_interval[1];
    if within && !is_translucent(layer.alpha.get(x, y)) {
        return DepthOrder::Overlapping(coc_interval);
    }
    let [near, far] = extent(layers, number, (x, y));
    let overlap = [near.max(coc_interval[0]), far.min(coc_interval[1])];
    // Close to the interval without overlapping it: the fragments of further layers may overlap, so never `Behind`.
    if overlap[0] <= overlap[1] { DepthOrder::Overlapping(overlap) } else { DepthOrder::InFront }
}

impl<'a> Volume<&'a Layer> {
    /// The boxes of `scene`.
    #[cfg(feature = "gpu")]
    pub(super) fn new(scene: &'a Scene, plan: &Plan) -> Self {
        Self::from_first_layers(scene.layers.len(), scene, plan)
    }

    /// The boxes of the first `count` layers of `scene`.
    pub(crate) fn from_first_layers(count: usize, scene: &'a Scene, plan: &Plan) -> Self {
        Self::from_layers(scene.layers.iter().take(count).collect(), scene, plan)
    }
}

impl Volume<Layer> {
    /// The boxes of `scene`, owning its layers.
    pub(super) fn owning(mut scene: Scene, plan: &Plan) -> Self {
        let layers = std::mem::take(&mut scene.layers);
        Self::from_layers(layers, &scene, plan)
    }
}

impl<L: Borrow<Layer>> Volume<L> {
    fn from_layers(layers: Vec<L>, scene: &Scene, plan: &Plan) -> Self {
        let first = layers.first().map(Borrow::borrow);
        let size = first.map_or([0; 2], |layer| [layer.width() as i32, layer.height() as i32]);
        Self {
            layers,
            tiles: Tiles::new(size, plan.coc_range_px),
            size,
            supersample: scene.supersample as f32,
            coc_range_px: plan.coc_range_px,
            jitter: RayJitter::new(scene, plan),
            background: plan.background(scene),
            lost_rays: plan.lost_rays,
            optics: plan.optics.clone(),
            field: scene.field,
            reflected: ReflectedLight::of(scene, plan),
            environment: plan.environment(scene),
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

    /// [`Volume::pixel`], and the mean over the rays of how far what they hit is in focus: by `focus` of its CoC radius in picture pixels.
    pub(crate) fn pixel_and_focus(
        &self,
        x: usize,
        y: usize,
        rays: &Rays,
        focus: &dyn Fn(f32) -> f32,
    ) -> ([f32; 4], f32) {
        let (mut pixel, mut focused_share) = ([0.0; 4], 0.0);
        for (views, channels) in rays.sets() {
            let mut hits = FocusedHits { colors: RaySum::default(), focused: 0.0, focus };
            let mut rays = 0;
            for ray in self.rays_of((x, y), views) {
                let left = self.follow(&ray, &mut hits);
                hits.colors.end(left, self.share_of_background(&ray, left));
                rays += 1;
            }
            let mean = hits.colors.mean(rays, self.lost_rays);
            channels.iter().for_each(|&channel| pixel[channel] = mean[channel]);
            if channels.contains(&ALPHA) {
                focused_share = (hits.focused / rays.max(1) as f64) as f32;
            }
        }
        (pixel, focused_share)
    }

    /// Mean colour over the rays of picture pixel `x, y` for those of `views` that the lens barrel does not occlude.
    fn mean_color(&self, x: usize, y: usize, views: &[View]) -> [f32; 4] {
        let (mut sum, mut rays) = (RaySum::default(), 0);
        for ray in self.rays_of((x, y), views) {
            let left = self.follow(&ray, &mut sum);
            sum.end(left, self.share_of_background(&ray, left));
            rays += 1;
        }
        sum.mean(rays, self.lost_rays)
    }

    /// The rays through picture pixel `x, y` of those of `views` that the lens barrel does not occlude.
    fn rays_of(&self, (x, y): (usize, usize), views: &[View]) -> impl Iterator<Item = LensRay> {
        let (centre, jitter) = (centre(x, y), self.jitter.at(x, y));
        let height = self.field.height(centre);
        let passes = move |view: &&View| self.optics.within_barrel(view.lens, height) >= 0.0;
        views.iter().filter(passes).map(move |view| self.ray(centre, jitter, view))
    }

    /// Whether the ray of `view` from picture pixel `x, y` passes the lens barrel.
    pub(crate) fn passes_barrel(&self, x: usize, y: usize, view: &View) -> bool {
        self.optics.within_barrel(view.lens, self.field.height(centre(x, y))) >= 0.0
    }

    /// Fraction of the rays `samples` of picture pixel `x, y` that hit nothing although they pass behind a fragment of the last
    /// layer: a further layer might have content there.
    pub(crate) fn lost_rays(&self, x: usize, y: usize, samples: &[View]) -> f64 {
        let lost = |ray: &LensRay| {
            let left = self.follow(ray, &mut RaySum::default());
            let lost = left - left.min(self.share_of_background(ray, left));
            if lost > 0.0 && self.passes_last_layer(ray) { f64::from(lost) } else { 0.0 }
        };
        let (mut sum, mut rays) = (0.0, 0);
        for ray in self.rays_of((x, y), samples) {
            sum += lost(&ray);
            rays += 1;
        }
        sum / f64::from(rays.max(1))
    }

    /// The ray of `view` through the pixel with its centre at `centre`, in picture pixels, in which rays extend over the part `jitter`.
    fn ray(&self, centre: Vec2, jitter: f32, view: &View) -> LensRay {
        let point = centre + jitter * view.jitter + view.shift;
        LensRay::new(point * self.supersample, view.lens * self.supersample)
    }

    /// Share of the background where `ray` ends with the transmittance `left`; 0 for a ray that is occluded.
    fn share_of_background(&self, ray: &LensRay, left: f32) -> f32 {
        let Some(background) = self.background.as_deref().filter(|_| left > 0.0) else { return 0.0 };
        let supersample = self.supersample as i32;
        background.met_by(|coc_px| ray.cell(coc_px).div_euclid(IVec2::splat(supersample)))
    }

    /// Whether `ray` passes behind any fragment of the last layer.
    fn passes_last_layer(&self, ray: &LensRay) -> bool {
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

    /// Traces `ray` through the stack, adds the fragments that it hits to `hits`, and returns the transmittance that is left.
    fn follow(&self, ray: &LensRay, hits: &mut impl Hits) -> f32 {
        let [nearest, farthest] = self.coc_range_px;
        let mut enter = nearest;
        let mut tile = ray.cell(enter).div_euclid(IVec2::splat(TILE));
        let mut path = Path { transmittance: 1.0, translucent: TranslucentHits::default() };
        loop {
            let (exit, side) = ray.leaves(tile * TILE, TILE);
            if let Some(passage) = self.tiles.passage(&self.layers, tile, [enter, exit.min(farthest)]) {
                self.cross_tile(ray, tile, passage, &mut path, hits);
            }
            if path.transmittance <= 0.0 || exit >= farthest {
                return path.transmittance;
            }
            tile += side;
            enter = exit;
        }
    }

    /// Traces `ray` over the samples of `tile`.
    fn cross_tile(
        &self,
        ray: &LensRay,
        tile: IVec2,
        Passage { coc_interval: [mut enter, end], nearest_first }: Passage,
        path: &mut Path,
        hits: &mut impl Hits,
    ) {
        let first = tile * TILE;
        let mut cell = ray.cell(enter).clamp(first, first + (TILE - 1));
        loop {
            let (exit, side) = ray.leaves(cell, 1);
            let passage = Passage { coc_interval: [enter, exit.min(end)], nearest_first };
            self.hit_sample(ray, (cell, passage), path, hits);
            if path.transmittance <= 0.0 || exit >= end {
                return;
            }
            cell += side;
            enter = exit;
        }
    }

    /// The fragment at `x, y` of layer `number` as `ray` sees it.
    fn seen_by(&self, ray: &LensRay, number: usize, (x, y): (usize, usize)) -> Fragment {
        let layer = self.layers[number].borrow();
        let (mut color, alpha) = (layer.color_at(x, y), layer.alpha.get(x, y));
        if let Some(change) = self.change_of_environment(ray, number, (x, y)) {
            color.iter_mut().zip(change).for_each(|(color, change)| *color += alpha * change);
            return Fragment { color, alpha, coc_px: layer.coc_px.get(x, y), moved: 1.0, shaded: true };
        }
        let met = Met { layer: number, at: (x, y) };
        let moved = self.reflected.as_ref().and_then(|reflected| reflected.moved(met, ray));
        if let Some(moved) = &moved {
            let change = moved.seen.iter().zip(moved.own).map(|(seen, own)| alpha * (seen - own));
            color.iter_mut().zip(change).for_each(|(color, change)| *color += change);
        }
        Fragment {
            color,
            alpha,
            coc_px: layer.coc_px.get(x, y),
            moved: moved.map_or(0.0, |moved| moved.share),
            shaded: false,
        }
    }

    /// By how much `ray` sees another part of the environment in the fragment at `at` of layer `number` than the centre of the lens.
    fn change_of_environment(&self, ray: &LensRay, number: usize, at: (usize, usize)) -> Option<[f32; 3]> {
        let environment = self.environment.as_deref()?;
        let position = |coc_px: f32| ray.start + coc_px * ray.step;
        let place = position(self.layers[number].borrow().coc_px.get(at.0, at.1));
        environment.change(number, at, &Sight { place, vanishing: position(environment.coc_infinity_px()) })
    }

    /// Adds the fragments of one sample that overlap the ray's interval there, nearest first.
    fn hit_sample(
        &self,
        ray: &LensRay,
        (cell, passage): (IVec2, Passage),
        path: &mut Path,
        hits: &mut impl Hits,
    ) {
        let Passage { coc_interval, nearest_first } = passage;
        let (x, y) = self.clamped(cell);
        for (number, layer) in self.layers.iter().enumerate() {
            let layer = layer.borrow();
            let alpha = layer.alpha.get(x, y);
            if alpha <= 0.0 {
                continue;
            }
            let overlap = match depth_order(&self.layers, number, (x, y), coc_interval) {
                DepthOrder::Behind if nearest_first => return,
                DepthOrder::InFront | DepthOrder::Behind => continue,
                DepthOrder::Overlapping(overlap) => overlap,
            };
            let hit = Hit { layer: number, at: (x, y), coc_interval: overlap };
            if is_translucent(alpha) && path.translucent.is_repeated(&self.layers, hit) {
                continue;
            }
            hits.hit(&self.seen_by(ray, number, (x, y)), path.transmittance);
            path.transmittance *= if is_translucent(alpha) { 1.0 - alpha } else { 0.0 };
            if path.transmittance <= 0.0 {
                return;
            }
        }
    }
}

/// What a ray has passed.
struct Path {
    transmittance: f32,
    translucent: TranslucentHits,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;
    use crate::lens::Aperture;

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
                jitter: RayJitter::whole_pixels(),
                background: None,
                lost_rays: LostRays::LeftOut,
                optics: Optics::from_aperture(Aperture::DISC),
                field: Field::from_picture_size(3, 3),
                reflected: None,
                environment: None,
            };
            let view = View { lens: Vec2::new(0.9, 0.1), jitter: Vec2::ZERO, shift: Vec2::ZERO };
            let pixel = volume.pixel(1, 1, &Rays::alike(vec![view]));
            assert_eq!(pixel, [0.2, 0.2, 0.2, 1.0], "{order}");
        }
    }
}
