//! Which fragments of a scene show an environment, and by how much another point of the lens sees them change.
//!
//! A ray of picture point `p` through lens point `u` passes CoC depth `c` at `p + c·u` and infinity at `p + c_inf·u`: it runs along the direction that the lens's
//! centre sees there. The fragment at `p`, CoC radius `c`, is seen from `u` along the direction of `p + (c_inf − c)·u`. (The same as `X − V` with
//! the fragment at `X = (z / f) (x, −y, −f)` and the lens point at `V = R (−u_x, u_y, 0)`, because `c_inf − c = R f / z`: a test compares the two.)
//! So neither depth nor the size of the lens is needed.

use super::{Environment, Gloss, RadianceMap};
use crate::image::Plane;
use crate::lens::Field;
use crate::parallel;
use crate::scene::Scene;
use crate::scene::surface::JOIN_PX;
use crate::settings::Lobe;
use glam::{Mat3, Vec2, Vec3};

/// Distance along the mirror direction from which on it meets nothing: stacks have 10¹⁰ there.
const NOTHING_MET: f32 = 1e9;

/// Cosine between the normals of neighbours from which on they are of one smooth surface.
const SMOOTH_COSINE: f32 = 0.5;

/// What a stack has of how the surfaces of one peel reflect.
#[derive(Debug, Clone, Copy)]
pub struct SurfacePlanes<'a> {
    /// Normals in camera space: x right, y up, z to the viewer.
    pub normal: &'a [Plane; 3],
    /// Share of the light reflected along the normal: F0, by channel.
    pub specular: &'a [Plane; 3],
    /// Roughness; mirrors without it.
    pub roughness: Option<&'a Plane>,
    /// Distance along the mirror direction to what is met there.
    pub reflected_distance: &'a Plane,
}

/// A fragment that reflects the environment.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Shaded {
    gloss: Gloss,
    /// Share of its reflection that the environment is; 0 for a fragment that does not reflect it.
    share: f32,
    coc_px: f32,
    /// What it reflects towards the centre of the lens.
    at_centre: [f32; 3],
}

/// The fragments of a scene that reflect an environment.
#[derive(Debug, Clone, PartialEq)]
pub struct EnvironmentShading {
    environment: Environment,
    /// By layer, row by row; `None` for a layer without any.
    layers: Vec<Option<Vec<Shaded>>>,
    /// Columns and rows.
    size: [usize; 2],
    /// Columns and rows of samples before the first in the layers of the scene: its padding.
    origin: [usize; 2],
    supersample: f32,
    coc_infinity_px: f32,
    field: Field,
    stats: EnvironmentStats,
}

/// What reflects an environment.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct EnvironmentStats {
    /// Fragments that reflect it.
    pub fragments: usize,
    /// How far the view of them moves at most, in picture pixels per aperture radius.
    pub largest_movement_px: f32,
}

impl EnvironmentStats {
    /// Those of both parts of a picture.
    pub(in crate::scene) fn joined(self, other: Self) -> Self {
        Self {
            fragments: self.fragments + other.fragments,
            largest_movement_px: self.largest_movement_px.max(other.largest_movement_px),
        }
    }
}

/// Where a ray meets a fragment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    /// Where the ray is at the fragment, in samples.
    pub place: Vec2,
    /// Where the ray passes infinity, in samples.
    pub vanishing: Vec2,
}

impl EnvironmentShading {
    /// The fragments of `scene` that reflect `map`, by what `planes` has of its layers; `None` if there are none. The map lies in camera space as
    /// `map_from_camera` says.
    pub fn new(
        scene: &Scene,
        planes: &[Option<SurfacePlanes<'_>>],
        map: RadianceMap,
        map_from_camera: Mat3,
        lobe: Lobe,
    ) -> Option<Self> {
        let layers: Vec<_> = scene
            .layers
            .iter()
            .zip(planes)
            .map(|(layer, planes)| planes.and_then(|planes| shaded(&planes, &layer.alpha, &layer.coc_px)))
            .collect();
        let all = || layers.iter().flatten().flatten().filter(|shaded| shaded.share > 0.0);
        let fragments = all().count();
        if fragments == 0 {
            return None;
        }
        let movements = all().map(|shaded| scene.coc_infinity_px - shaded.coc_px);
        let stats = EnvironmentStats { fragments, largest_movement_px: movements.fold(0.0, f32::max) };
        let occurs = |[from, to]: [f32; 2]| {
            all().any(|shaded| (from..=to).contains(&shaded.gloss.roughness) && shaded.gloss.roughness > 0.0)
        };
        let mut shading = Self {
            environment: Environment::new(map, map_from_camera, lobe, occurs),
            layers,
            size: [scene.width(), scene.height()],
            origin: [0; 2],
            supersample: scene.supersample as f32,
            coc_infinity_px: scene.coc_infinity_px,
            field: scene.field,
            stats,
        };
        shading.shade_centre();
        Some(shading)
    }

    /// Computes what each fragment reflects towards the centre of the lens.
    fn shade_centre(&mut self) {
        let mut layers = std::mem::take(&mut self.layers);
        let width = self.size[0];
        for fragments in layers.iter_mut().flatten() {
            parallel::for_each_row(fragments, width, &|y, row| {
                for (x, shaded) in row.iter_mut().enumerate().filter(|(_, shaded)| shaded.share > 0.0) {
                    let view = self.view(centre([x, y]));
                    shaded.at_centre = self.environment.reflected(view, &shaded.gloss);
                }
            });
        }
        self.layers = layers;
    }

    /// What is known of all fragments that reflect the environment.
    pub fn stats(&self) -> EnvironmentStats {
        self.stats
    }

    /// The shading of the scene padded by `outside` columns and rows of samples on either side, where nothing reflects.
    #[must_use]
    pub fn padded(&self, outside: [usize; 2]) -> Self {
        Self { origin: outside, ..self.clone() }
    }

    /// By how much a ray sees the fragment in column `x` of row `y` of `layer` otherwise than the centre of the lens does, not multiplied by the
    /// fragment's alpha; `None` where that does not depend on the lens.
    pub fn change(&self, layer: usize, (x, y): (usize, usize), sight: &Sight) -> Option<[f32; 3]> {
        let fragments = self.layers.get(layer)?.as_deref()?;
        let sample = self.own(x, y)?;
        let shaded = &fragments[self.index(sample)];
        if shaded.share <= 0.0 {
            return None;
        }
        let origin = self.origin();
        let normal = self.normal_at(fragments, sample, sight.place - origin);
        let view = self.view(sight.vanishing - origin);
        let light = self.environment.reflected(view, &Gloss { normal, ..shaded.gloss });
        Some(std::array::from_fn(|k| shaded.share * (light[k] - shaded.at_centre[k])))
    }

    /// The layer whose fragment at column `x` of row `y` has this CoC radius and reflects the environment.
    pub fn layer_at(&self, (x, y): (usize, usize), coc_px: f32) -> Option<usize> {
        let index = self.index(self.own(x, y)?);
        let is_it =
            |fragments: &Vec<Shaded>| fragments[index].share > 0.0 && fragments[index].coc_px == coc_px;
        self.layers.iter().position(|layer| layer.as_ref().is_some_and(is_it))
    }

    /// How the fragment at column `x` of row `y` of `layer` reflects, and the share of its reflection that the environment is.
    pub fn gloss(&self, layer: usize, (x, y): (usize, usize)) -> Option<(Gloss, f32)> {
        let fragments = self.layers.get(layer)?.as_deref()?;
        let shaded = &fragments[self.index(self.own(x, y)?)];
        (shaded.share > 0.0).then_some((shaded.gloss, shaded.share))
    }

    /// By how much a ray sees a surface of this `gloss` otherwise than the centre of the lens does.
    pub fn change_of(&self, gloss: &Gloss, sight: &Sight) -> [f32; 3] {
        let seen_at = |place: Vec2| self.environment.reflected(self.view(place - self.origin()), gloss);
        let (seen, at_centre) = (seen_at(sight.vanishing), seen_at(sight.place));
        std::array::from_fn(|k| seen[k] - at_centre[k])
    }

    /// The CoC radius at which rays pass infinity, in picture pixels.
    pub fn coc_infinity_px(&self) -> f32 {
        self.coc_infinity_px
    }

    /// The sample of the scene without its padding.
    fn own(&self, x: usize, y: usize) -> Option<[usize; 2]> {
        let (x, y) = (x.checked_sub(self.origin[0])?, y.checked_sub(self.origin[1])?);
        (x < self.size[0] && y < self.size[1]).then_some([x, y])
    }

    fn index(&self, [x, y]: [usize; 2]) -> usize {
        y * self.size[0] + x
    }

    fn origin(&self) -> Vec2 {
        Vec2::from(self.origin.map(|samples| samples as f32))
    }

    /// Direction, of length 1, in which the centre of the lens sees `place`, in samples.
    fn view(&self, place: Vec2) -> Vec3 {
        self.field.direction(place / self.supersample)
    }

    /// The normal at `place`, between those of the samples of one smooth surface around it.
    fn normal_at(&self, fragments: &[Shaded], [x, y]: [usize; 2], place: Vec2) -> Vec3 {
        let [width, height] = self.size;
        let own = &fragments[self.index([x, y])];
        let away = (place - centre([x, y])).clamp(Vec2::splat(-0.5), Vec2::splat(0.5));
        let beside = |at: usize, away: f32, size: usize| {
            if away < 0.0 { at.checked_sub(1) } else { Some(at + 1).filter(|&at| at < size) }
        };
        let (column, row) = (beside(x, away.x, width), beside(y, away.y, height));
        let away = away.abs();
        let mut normal = (1.0 - away.x) * (1.0 - away.y) * own.gloss.normal;
        for (column, row, weight) in [
            (column, Some(y), away.x * (1.0 - away.y)),
            (Some(x), row, (1.0 - away.x) * away.y),
            (column, row, away.x * away.y),
        ] {
            let other = column.zip(row).map(|(x, y)| &fragments[y * width + x]);
            let other = other.filter(|other| continues(own, other)).unwrap_or(own);
            normal += weight * other.gloss.normal;
        }
        normal.normalize()
    }
}

/// The centre of a sample.
fn centre([x, y]: [usize; 2]) -> Vec2 {
    Vec2::new(x as f32 + 0.5, y as f32 + 0.5)
}

/// Whether two neighbours are of one smooth surface.
fn continues(own: &Shaded, other: &Shaded) -> bool {
    other.share > 0.0
        && (other.coc_px - own.coc_px).abs() < JOIN_PX
        && own.gloss.normal.dot(other.gloss.normal) > SMOOTH_COSINE
}

/// The fragments of one layer; `None` if no one reflects an environment.
fn shaded(planes: &SurfacePlanes<'_>, alpha: &Plane, coc_px: &Plane) -> Option<Vec<Shaded>> {
    let width = alpha.width().max(1);
    let fragment = |i: usize| {
        let at = |plane: &Plane| plane.values()[i];
        let normal = Vec3::from(planes.normal.each_ref().map(at)).try_normalize();
        let specular = planes.specular.each_ref().map(|plane| at(plane).clamp(0.0, 1.0));
        let reflects = specular.iter().any(|&specular| specular > 0.0);
        let is_met = at(planes.reflected_distance) < NOTHING_MET;
        let Some(normal) = normal.filter(|_| reflects && !is_met && at(alpha) > 0.0) else {
            return Shaded::default();
        };
        let roughness = planes.roughness.map_or(0.0, at).clamp(0.0, 1.0);
        let gloss = Gloss { normal, specular, roughness };
        Shaded { gloss, share: 1.0, coc_px: at(coc_px), at_centre: [0.0; 3] }
    };
    let mut fragments = vec![Shaded::default(); alpha.values().len()];
    parallel::for_each_row(&mut fragments, width, &|y, row| {
        row.iter_mut().enumerate().for_each(|(x, shaded)| *shaded = fragment(y * width + x));
    });
    fragments.iter().any(|shaded| shaded.share > 0.0).then_some(fragments)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Layer;
    use crate::stack::StackKind;

    /// One layer of 9 × 5 samples at the CoC radius `coc_px`, all with this normal, roughness and reflected distance.
    fn shading(coc_px: f32, normal: Vec3, distance: f32, map: RadianceMap) -> Option<EnvironmentShading> {
        let plane = |value: f32| Plane::filled(9, 5, value);
        let layer = Layer { color: [1.0; 3].map(plane), alpha: plane(1.0), coc_px: plane(coc_px) };
        let mut scene = Scene::new(vec![layer], StackKind::PointSampled, 1, 4.0);
        scene.field.focal_length_px = 20.0;
        let (normal, specular) = (normal.to_array().map(plane), [1.0; 3].map(plane));
        let planes = SurfacePlanes {
            normal: &normal,
            specular: &specular,
            roughness: None,
            reflected_distance: &plane(distance),
        };
        EnvironmentShading::new(&scene, &[Some(planes)], map, Mat3::IDENTITY, Lobe::Ggx)
    }

    /// A map whose red rises with the x of a direction and whose green rises with its y.
    fn ramp() -> RadianceMap {
        let direction = |x, y| super::super::map::direction([x, y], [256, 128]);
        RadianceMap::from_fn(256, 128, |x, y| [2.0 + direction(x, y).x, 2.0 + direction(x, y).y, 1.0])
    }

    /// What the middle fragment, at `coc_px`, shows otherwise through the lens point `lens`.
    fn change(shading: &EnvironmentShading, coc_px: f32, lens: Vec2) -> Option<[f32; 3]> {
        shading.change(0, (4, 2), &sight(shading, coc_px, lens))
    }

    fn sight(shading: &EnvironmentShading, coc_px: f32, lens: Vec2) -> Sight {
        let place = Vec2::new(4.5, 2.5);
        Sight { place, vanishing: place + (shading.coc_infinity_px() - coc_px) * lens }
    }

    #[test]
    fn a_fragment_is_seen_from_the_lens_point_that_its_ray_passes() {
        // The lens ray of u passes V = R (−u_x, u_y, 0). With the fragment at the depth z, R = c_inf z_f / f and c = c_inf (1 − z_f / z).
        let (focal_px, coc_infinity_px, focus) = (20.0, 4.0, 3.0);
        let field = Field { focal_length_px: focal_px, ..Field::from_picture_size(9, 5) };
        for (z, place, lens) in [
            (3.0, Vec2::new(4.5, 2.5), Vec2::new(1.0, 0.0)),
            (1.2, Vec2::new(7.5, 1.5), Vec2::new(-0.3, 0.6)),
            (40.0, Vec2::new(0.5, 4.5), Vec2::new(0.2, 0.9)),
        ] {
            let coc_px = coc_infinity_px * (1.0 - focus / z);
            let radius = coc_infinity_px * focus / focal_px;
            let fragment = z * Vec3::new((place.x - 4.5) / focal_px, -(place.y - 2.5) / focal_px, -1.0);
            let viewer = radius * Vec3::new(-lens.x, lens.y, 0.0);
            let expected = (fragment - viewer).normalize();
            let found = field.direction(place + (coc_infinity_px - coc_px) * lens);
            assert!((found - expected).length() < 1e-6, "{z}: {found}, expected {expected}");
        }
    }

    #[test]
    fn a_mirror_seen_from_the_left_shows_more_of_the_right() {
        // A mirror that faces the camera. u to the right in the picture is a lens point on the left: from there the view runs to the right, and so does
        // its reflection. u downwards is a lens point above: the view runs down.
        let shading = shading(0.0, Vec3::Z, 1e10, ramp()).unwrap();
        let [red, green, blue] = change(&shading, 0.0, Vec2::X).unwrap();
        // The view along (c_inf, 0, −f): x = 4 / √(4² + 20²).
        let expected = 4.0 / 416.0f32.sqrt();
        assert!(
            (red - expected).abs() < 1e-3 && green.abs() < 1e-3 && blue.abs() < 1e-4,
            "{red}, {green}, {blue}"
        );
        let [_, green, _] = change(&shading, 0.0, Vec2::Y).unwrap();
        assert!((green + expected).abs() < 1e-3, "{green}");
    }

    #[test]
    fn a_ray_from_the_lens_centre_changes_nothing_and_neither_does_an_even_environment() {
        let tilted = Vec3::new(0.3, 0.2, 1.0);
        let one = shading(1.5, tilted, 1e10, ramp()).unwrap();
        let same = change(&one, 1.5, Vec2::ZERO).unwrap();
        assert!(same.iter().all(|change| change.abs() < 1e-6), "but for rounding: {same:?}");
        let even = shading(1.5, tilted, 1e10, RadianceMap::from_fn(16, 8, |_, _| [3.0; 3])).unwrap();
        let even = change(&even, 1.5, Vec2::new(0.5, 0.5)).unwrap();
        assert!(even.iter().all(|change| change.abs() < 1e-2), "by Schlick's term alone: {even:?}");
    }

    #[test]
    fn what_reflects_a_surface_is_left_as_it_is() {
        assert_eq!(shading(0.0, Vec3::Z, 3.0, ramp()), None);
        assert_eq!(shading(0.0, Vec3::ZERO, 1e10, ramp()), None, "no normal");
    }

    #[test]
    fn beyond_the_frame_nothing_reflects() {
        let shading = shading(0.0, Vec3::Z, 1e10, ramp()).unwrap();
        let padded = shading.padded([3, 2]);
        let middle = sight(&shading, 0.0, Vec2::X);
        let by = Vec2::new(3.0, 2.0);
        let moved = Sight { place: middle.place + by, vanishing: middle.vanishing + by };
        assert_eq!(padded.change(0, (7, 4), &moved), shading.change(0, (4, 2), &middle), "the same fragment");
        assert_eq!(padded.change(0, (2, 4), &moved), None);
        assert_eq!(padded.change(0, (12, 4), &moved), None);
        assert_eq!([(7, 4), (2, 4)].map(|at| padded.layer_at(at, 0.0)), [Some(0), None]);
    }

    #[test]
    fn normals_are_those_between_the_samples_of_one_surface() {
        let mut shading = shading(0.0, Vec3::Z, 1e10, ramp()).unwrap();
        let fragments = shading.layers[0].as_mut().unwrap();
        fragments[2 * 9 + 5].gloss.normal = Vec3::new(0.6, 0.0, 0.8);
        fragments[2 * 9 + 3].gloss.normal = Vec3::X;
        let fragments = shading.layers[0].as_ref().unwrap();
        let at = |x: f32| shading.normal_at(fragments, [4, 2], Vec2::new(x, 2.5));
        assert_eq!(at(4.5), Vec3::Z);
        assert!((at(5.0) - Vec3::new(0.3, 0.0, 0.9).normalize()).length() < 1e-6, "half-way: {}", at(5.0));
        assert_eq!(at(4.0), Vec3::Z, "a neighbour at a right angle is across an edge");
    }
}
