//! From the channels of a stack to what moves: surfaces, matrices, and the CoC radii of what flat mirrors show.

use super::layer::{MOVES_FROM_PX, ReflectingLayer, ReflectionStats, Reflections};
use super::surfaces::{self, NONE, Surfaces};
use super::view::{Point, Slope, View, largest_stretch};
use crate::finding::Finding;
use crate::image::Plane;
use crate::lens::ThinLens;
use crate::parallel;
use crate::scene::surface;
use crate::stack::depth::DepthScale;
use crate::stack::{Peel, Shading, Stack};
use glam::{Mat2, Vec2, Vec3};
use rayon::prelude::*;
use std::sync::Arc;

/// A fragment that does not differ by more than this from what it would show moves to no effect.
const LEAST_CHANGE: f32 = 1.0 / 255.0;

/// Lens points at which that is asked, about as far out as the lens's mean point.
const ASKED: [Vec2; 4] =
    [Vec2::new(0.6, 0.0), Vec2::new(-0.6, 0.0), Vec2::new(0.0, 0.6), Vec2::new(0.0, -0.6)];

/// Difference in picture pixels from the movement of a flat mirror, up to which a surface counts as flat; as much more and it does not.
const FLAT_PX: f32 = 0.25;

/// Least alpha of a fragment that reflects: its light is divided by it.
const LEAST_ALPHA: f32 = 1e-3;

/// Share of the normals that face away, from which they are not those of the camera's axes.
const FACING_AWAY: f64 = 0.2;

/// What the surfaces of `stack` reflect to `lens`, of which CoC radii up to `limit_px` are kept, with what is to be said of it; depth is `scale`d. Takes the stack's shading. `None` where
/// nothing says what surfaces reflect, or they do not, or the lens is a point.
pub(in crate::scene) fn reflections(
    stack: &mut Stack,
    (lens, limit_px): (&ThinLens, f32),
    scale: &DepthScale,
) -> (Option<Arc<Reflections>>, Vec<Finding>) {
    let shading = std::mem::take(&mut stack.shading);
    if shading.iter().all(Option::is_none) || lens.coc_infinity_px <= 0.0 {
        return (None, Vec::new());
    }
    if let Some(refused) = unfit(stack, &shading) {
        return (None, vec![refused]);
    }
    let grid = Grid::of(stack, (lens, limit_px), scale);
    let layers = stack.peels.iter().zip(&shading);
    let fragments: Vec<Option<Fragments>> =
        layers.map(|(peel, shading)| Some(grid.fragments(peel, shading.as_ref()?, scale))).collect();
    if let Some(refused) = facing_away(&fragments) {
        return (None, vec![refused]);
    }
    let reflections = grid.reflections(fragments);
    let findings = reflections.stats.findings();
    (Some(Arc::new(reflections)).filter(|found| found.stats.reflecting_fragments > 0), findings)
}

/// The samples of a stack, and what sees them.
struct Grid {
    width: usize,
    height: usize,
    view: View,
    lens: ThinLens,
    /// Largest CoC radius that is kept, in picture pixels.
    limit_px: f32,
}

/// The fragments of one layer that reflect.
struct Fragments {
    /// Their points; `None` where nothing reflects, or where the normal is none.
    points: Vec<Option<Point>>,
    /// Reciprocal of the distance of what they reflect; NaN where there is none.
    inverse_distance: Vec<f32>,
    /// Light that they reflect, not multiplied by alpha.
    light: [Plane; 3],
    /// Number of those that reflect, of those without a usable normal, and of those whose normal faces away.
    reflecting: usize,
    without_normal: usize,
    facing_away: usize,
}

/// The refusal of shading that is not that of the stack's peels, if it is not.
fn unfit(stack: &Stack, shading: &[Option<Shading>]) -> Option<Finding> {
    let size = (stack.width(), stack.height());
    let fits = |shading: &Shading| shading.planes().all(|plane| (plane.width(), plane.height()) == size);
    let is_fit = shading.len() == stack.peels.len() && shading.iter().flatten().all(fits);
    let text = "what surfaces reflect is not of the size and number of the peels: reflections do not move with the lens";
    (!is_fit).then(|| Finding::warning("reflections", text))
}

/// The refusal of normals that are not in the camera's axes, if they are not.
fn facing_away(fragments: &[Option<Fragments>]) -> Option<Finding> {
    let sum = |of: fn(&Fragments) -> usize| fragments.iter().flatten().map(of).sum::<usize>();
    let (away, all) = (sum(|layer| layer.facing_away), sum(|layer| layer.reflecting));
    let share = away as f64 / all.max(1) as f64;
    let text = format!(
        "{:.0} % of the normals of what reflects face away from the camera: Normal has to be in the camera's axes (right, up, \
         towards the viewer), not the world's; reflections do not move with the lens",
        100.0 * share
    );
    (share > FACING_AWAY).then(|| Finding::warning("reflections", text))
}

impl Grid {
    fn of(stack: &Stack, (lens, limit_px): (&ThinLens, f32), scale: &DepthScale) -> Self {
        let (width, height) = (stack.width(), stack.height());
        let view = View::new(stack.frame, stack.supersample, *lens, scale);
        Self { width, height, view, lens: *lens, limit_px }
    }

    /// Column and row of sample `index`.
    fn at(&self, index: usize) -> (usize, usize) {
        (index % self.width, index / self.width)
    }

    /// The fragments of `peel` that reflect.
    fn fragments(&self, peel: &Peel, shading: &Shading, scale: &DepthScale) -> Fragments {
        let mut depth = peel.depth.clone();
        parallel::for_each_row(depth.values_mut(), self.width, &|y, row| self.view.planar_row(row, y, scale));
        let found = |index: usize| {
            let (x, y) = self.at(index);
            let (alpha, z) = (peel.alpha.get(x, y), depth.get(x, y));
            let reflects = alpha > LEAST_ALPHA && z.is_finite() && shading.reflects(x, y);
            if !reflects {
                return Found::Nothing;
            }
            let normal = Vec3::from(shading.normal.each_ref().map(|plane| plane.get(x, y)));
            let length = normal.length();
            let at = self.view.point(x, y, z);
            match () {
                () if !(0.5..=1.5).contains(&length) => Found::NoNormal,
                () if normal.dot(at) >= 0.0 => Found::FacingAway,
                () => Found::Point(Point { at, normal: normal / length }),
            }
        };
        let found: Vec<Found> = (0..self.width * self.height).into_par_iter().map(found).collect();
        let count = |of: fn(&Found) -> bool| found.iter().filter(|found| of(found)).count();
        let (without_normal, facing_away) = (
            count(|found| matches!(found, Found::NoNormal)),
            count(|found| matches!(found, Found::FacingAway)),
        );
        let reflecting = count(|found| !matches!(found, Found::Nothing));
        let points: Vec<Option<Point>> = found.into_iter().map(Found::point).collect();
        let mut light = shading.light.clone();
        for plane in &mut light {
            parallel::for_each_block(plane.values_mut(), &|block, values| {
                for (light, &alpha) in values.iter_mut().zip(&peel.alpha.values()[block]) {
                    // Without a finite light there is nothing to move.
                    let is_light = alpha > LEAST_ALPHA && light.is_finite();
                    *light = if is_light { *light / alpha } else { 0.0 };
                }
            });
        }
        let distances = shading.reflected_distance.values().iter();
        // The reciprocal of the smallest numbers is infinite.
        let is_distance = |distance: f32| distance > 0.0 && distance.recip().is_finite();
        let inverse_distance =
            distances.map(|&distance| if is_distance(distance) { distance.recip() } else { f32::NAN });
        Fragments {
            points,
            inverse_distance: inverse_distance.collect(),
            light,
            reflecting,
            without_normal,
            facing_away,
        }
    }

    /// What moves of `fragments`.
    fn reflections(&self, fragments: Vec<Option<Fragments>>) -> Reflections {
        let (mut surface, count) = self.surfaces(&fragments);
        let mut moved: Vec<Option<Moved>> = fragments
            .iter()
            .enumerate()
            .map(|(number, layer)| layer.as_ref().map(|_| self.moved(number, &fragments, &surface)))
            .collect();
        self.join_mirrors(&mut surface, count, (&fragments, &moved));
        let count = surface.iter().flatten().copied().max().unwrap_or(NONE) as usize;
        let mut farthest_px = vec![f32::NEG_INFINITY; count + 1];
        for (moved, surface) in moved.iter().zip(&surface) {
            for (moved, &surface) in moved.iter().flat_map(|moved| &moved.samples).zip(surface) {
                if moved.flat > 0.0 {
                    let farthest = &mut farthest_px[surface as usize];
                    *farthest = farthest.max(moved.mirrored_px);
                }
            }
        }
        let mirrored: Vec<Option<[Plane; 2]>> = (0..moved.len())
            .map(|number| moved[number].as_ref().map(|_| self.extents(number, &moved, &surface)))
            .collect();
        let mut stats = ReflectionStats::default();
        let mut layers = Vec::new();
        for (((layer, moved), mirrored_px), surface) in
            fragments.into_iter().zip(&mut moved).zip(mirrored).zip(surface)
        {
            let (Some(layer), Some(moved), Some(mirrored_px)) = (layer, moved.take(), mirrored_px) else {
                layers.push(None);
                continue;
            };
            stats.reflecting_fragments += layer.reflecting;
            stats.without_normal += layer.without_normal + layer.facing_away;
            stats.without_distance += moved.samples.iter().filter(|sample| sample.has_no_distance).count();
            stats.limited_fragments += moved.samples.iter().filter(|sample| sample.is_limited).count();
            let of_row = |y: usize| {
                let row = &moved.samples[y * self.width..][..self.width];
                row.iter().map(|sample| largest_stretch(sample.movement)).fold(0.0, f32::max)
            };
            let stretches = parallel::map(self.height, &of_row);
            stats.largest_movement_px = stretches.into_iter().fold(stats.largest_movement_px, f32::max);
            layers.push(Some(self.layer(layer.light, &moved, mirrored_px, surface)));
        }
        let mut reflections = Reflections { layers, farthest_px, stats };
        reflections.stats.moving_fragments = self.moving(&reflections);
        reflections
    }

    /// The surface of each fragment, and the number of surfaces.
    fn surfaces(&self, fragments: &[Option<Fragments>]) -> (Vec<Vec<u32>>, usize) {
        let samples = self.width * self.height;
        let mut joined = Surfaces::apart(samples * fragments.len());
        let reflecting: Vec<(usize, &Fragments)> = fragments
            .iter()
            .enumerate()
            .filter_map(|(number, layer)| Some((number, layer.as_ref()?)))
            .collect();
        for &(number, layer) in &reflecting {
            for index in 0..samples {
                let Some(point) = &layer.points[index] else { continue };
                let (x, y) = self.at(index);
                let beside = [(x + 1 < self.width, index + 1), (y + 1 < self.height, index + self.width)];
                for other in beside.into_iter().filter_map(|(inside, other)| inside.then_some(other)) {
                    for &(its_number, its_layer) in &reflecting {
                        if let Some(its_point) = &its_layer.points[other]
                            && surfaces::joins(point, its_point)
                        {
                            joined.join(number * samples + index, its_number * samples + other);
                        }
                    }
                }
            }
        }
        let is_present = |fragment: usize| {
            let layer = fragments[fragment / samples.max(1)].as_ref();
            layer.is_some_and(|layer| layer.points[fragment % samples].is_some())
        };
        let (numbers, count) = joined.numbered(is_present);
        (numbers.chunks(samples.max(1)).map(<[u32]>::to_vec).collect(), count)
    }

    /// The point of `surface` at sample `index`, moved by `step` columns and rows: that of layer `own` before others.
    fn point_beside<'f>(
        &self,
        (fragments, surface): (&'f [Option<Fragments>], &[Vec<u32>]),
        (own, index): (usize, usize),
        (step, number): ([isize; 2], u32),
    ) -> Option<&'f Point> {
        let other = self.beside(index, step)?;
        let of_layer = |layer: usize| {
            let is_it = surface[layer][other] == number;
            fragments[layer].as_ref().filter(|_| is_it)?.points[other].as_ref()
        };
        of_layer(own).or_else(|| (0..fragments.len()).filter(|&layer| layer != own).find_map(of_layer))
    }

    /// The index of the sample `step` columns and rows from sample `index`.
    fn beside(&self, index: usize, [columns, rows]: [isize; 2]) -> Option<usize> {
        let (x, y) = self.at(index);
        let (x, y) = (x.checked_add_signed(columns)?, y.checked_add_signed(rows)?);
        (x < self.width && y < self.height).then_some(y * self.width + x)
    }

    /// How the reflections of layer `number` move.
    fn moved(&self, number: usize, fragments: &[Option<Fragments>], surface: &[Vec<u32>]) -> Moved {
        let Some(layer) = &fragments[number] else { return Moved { samples: Vec::new() } };
        let of = |index: usize| {
            let Some(point) = &layer.points[index] else { return MovedSample::default() };
            let inverse_distance = layer.inverse_distance[index];
            let coc_px = self.lens.coc_radius_px(-point.at.z).clamp(-self.limit_px, self.limit_px);
            if inverse_distance.is_nan() {
                return MovedSample { coc_px, has_no_distance: true, ..MovedSample::default() };
            }
            let mirrored_px = self.view.mirrored_coc_px(point, inverse_distance.recip());
            let mirrored_px = mirrored_px.clamp(-self.limit_px, self.limit_px);
            let as_mirror = mirrored_px - coc_px;
            let beside = |step: [isize; 2]| {
                self.point_beside((fragments, surface), (number, index), (step, surface[number][index]))
            };
            let slope = |[columns, rows]: [isize; 2]| {
                let (before, after) = (beside([-columns, -rows]), beside([columns, rows]));
                let span = usize::from(before.is_some()) + usize::from(after.is_some());
                let (from, to) = (before.unwrap_or(point), after.unwrap_or(point));
                let change = |of: fn(&Point) -> Vec3| (of(to) - of(from)) / span as f32;
                (span > 0)
                    .then(|| Slope { at: change(|point| point.at), along: change(Point::reflects_along) })
            };
            let slopes = slope([1, 0]).zip(slope([0, 1]));
            // A surface of one sample in a row or a column is taken as flat.
            let movement = match slopes {
                Some((across, down)) => self.view.movement(point, inverse_distance, [across, down]),
                None => Some(Mat2::from_diagonal(Vec2::splat(as_mirror))),
            };
            let largest_px = self.largest_px([coc_px, mirrored_px]);
            let (movement, is_limited) = limited(movement, largest_px);
            let off_px = largest_stretch(movement - Mat2::from_diagonal(Vec2::splat(as_mirror)));
            let moves = smooth(largest_stretch(movement) / MOVES_FROM_PX - 1.0);
            let flat = moves * (1.0 - smooth(off_px / FLAT_PX - 1.0));
            MovedSample {
                movement,
                coc_px,
                mirrored_px,
                flat,
                curved: moves - flat,
                is_limited,
                has_no_distance: false,
            }
        };
        Moved { samples: (0..self.width * self.height).into_par_iter().map(of).collect() }
    }

    /// The largest movement that is kept, in picture pixels: twice the largest blur, of a surface of this CoC radius that shows as a flat
    /// mirror what has the other one. It moves that by the difference of the two.
    fn largest_px(&self, [coc_px, mirrored_px]: [f32; 2]) -> f32 {
        let largest_px = self.lens.coc_infinity_px.max(coc_px.abs()).max(mirrored_px.abs());
        (2.0 * largest_px).min(2.0 * self.limit_px)
    }

    /// Makes one mirror of the parts of a plane: changes the numbers of surfaces, of which there are `count`.
    fn join_mirrors(
        &self,
        surface: &mut [Vec<u32>],
        count: usize,
        (fragments, moved): (&[Option<Fragments>], &[Option<Moved>]),
    ) {
        let mut planes = vec![surfaces::Plane::default(); count + 1];
        for ((layer, moved), surface) in fragments.iter().zip(moved).zip(&*surface) {
            let (Some(layer), Some(moved)) = (layer, moved) else { continue };
            for ((point, moved), &surface) in layer.points.iter().zip(&moved.samples).zip(surface) {
                if let Some(point) = point {
                    let share = moved.flat / (moved.flat + moved.curved).max(f32::MIN_POSITIVE);
                    planes[surface as usize].add(point, share);
                }
            }
        }
        let joined = surfaces::same_planes(&planes);
        surface.iter_mut().flatten().for_each(|number| *number = joined[*number as usize]);
    }

    /// Nearest and farthest CoC radius of what layer `number` shows as a flat mirror at each sample.
    fn extents(&self, number: usize, moved: &[Option<Moved>], surface: &[Vec<u32>]) -> [Plane; 2] {
        let mirrored_at = |index: Option<usize>, own: u32| {
            let of_layer = |layer: &usize| {
                let sample = &moved[*layer].as_ref()?.samples[index?];
                (surface[*layer][index?] == own && sample.flat > 0.0).then_some(sample.mirrored_px)
            };
            let others = (0..moved.len()).filter(|&layer| layer != number);
            std::iter::once(number).chain(others).find_map(|layer| of_layer(&layer)).unwrap_or(f32::NAN)
        };
        let of = |index: usize| {
            let own = surface[number][index];
            let center = mirrored_at(Some(index), own);
            if own == NONE || center.is_nan() {
                return [f32::INFINITY, f32::NEG_INFINITY];
            }
            let mut interval = [center; 2];
            for [columns, rows] in [[-1, 0], [1, 0], [0, -1], [0, 1]] {
                let at = |steps: isize| mirrored_at(self.beside(index, [steps * columns, steps * rows]), own);
                let row = [at(-1), center, at(1), at(2)];
                if surface::goes_on(row) {
                    let middle = 0.5 * (center + row[2]);
                    interval = [interval[0].min(middle), interval[1].max(middle)];
                }
            }
            interval
        };
        let mut intervals = vec![[0.0; 2]; self.width * self.height];
        parallel::for_each_row(&mut intervals, self.width, &|y, row| {
            row.iter_mut().enumerate().for_each(|(x, interval)| *interval = of(y * self.width + x));
        });
        [0, 1].map(|end| self.plane(&intervals, |interval| interval[end]))
    }

    fn plane<T>(&self, samples: &[T], value: impl Fn(&T) -> f32) -> Plane {
        let mut plane = Plane::zeros(self.width, self.height);
        plane.values_mut().iter_mut().zip(samples).for_each(|(to, sample)| *to = value(sample));
        plane
    }

    fn layer(
        &self,
        light: [Plane; 3],
        Moved { samples }: &Moved,
        mirrored_px: [Plane; 2],
        surface: Vec<u32>,
    ) -> ReflectingLayer {
        let element = |k: usize| self.plane(samples, |sample| sample.movement.to_cols_array()[k]);
        ReflectingLayer {
            light,
            movement: [element(0), element(2), element(1), element(3)],
            coc_px: self.plane(samples, |sample| sample.coc_px),
            mirrored_px,
            flat: self.plane(samples, |sample| sample.flat),
            curved: self.plane(samples, |sample| sample.curved),
            surface,
        }
    }

    /// Number of fragments whose reflection moves and shows something else there.
    fn moving(&self, reflections: &Reflections) -> usize {
        let supersample = self.view.supersample();
        let of_layer = |(number, layer): (usize, &Option<ReflectingLayer>)| {
            let Some(layer) = layer else { return 0 };
            let changes = |index: &usize| {
                let (x, y) = self.at(*index);
                let light =
                    |layer: &ReflectingLayer, x, y| layer.light.each_ref().map(|plane| plane.get(x, y));
                let own = light(layer, x, y);
                let differs = |lens: &Vec2| {
                    let by = layer.moved_by((x, y), *lens) * supersample;
                    let step = [by.x, by.y].map(samples_away);
                    let Some((x, y)) = self.beside(*index, step).map(|index| self.at(index)) else {
                        return false;
                    };
                    let other = reflections.fragment((x, y), layer.surface[*index], number);
                    let other =
                        other.and_then(|other| reflections.layer(other)).map(|other| light(other, x, y));
                    other
                        .is_some_and(|other| own.iter().zip(other).any(|(a, b)| (a - b).abs() > LEAST_CHANGE))
                };
                layer.share(x, y) > 0.0 && ASKED.iter().any(differs)
            };
            let of_row = |y: usize| (y * self.width..(y + 1) * self.width).filter(changes).count();
            parallel::map(self.height, &of_row).into_iter().sum()
        };
        reflections.layers.iter().enumerate().map(of_layer).sum()
    }
}

/// By how many samples the place is away that is seen at the distance `by`: from a quarter of a sample on that of a neighbour is mixed in.
fn samples_away(by: f32) -> isize {
    (by.abs() + 0.75).floor().copysign(by) as isize
}

/// What a sample has.
enum Found {
    Nothing,
    NoNormal,
    FacingAway,
    Point(Point),
}

impl Found {
    fn point(self) -> Option<Point> {
        match self {
            Self::Point(point) => Some(point),
            Self::Nothing | Self::NoNormal | Self::FacingAway => None,
        }
    }
}

/// How the reflections of a layer move, by sample.
struct Moved {
    samples: Vec<MovedSample>,
}

/// How the reflection of a fragment moves.
#[derive(Debug, Clone, Copy, Default)]
struct MovedSample {
    movement: Mat2,
    coc_px: f32,
    mirrored_px: f32,
    flat: f32,
    curved: f32,
    is_limited: bool,
    has_no_distance: bool,
}

/// `movement`, no larger than `largest_px`, and whether it was; a movement that is none is the largest one.
fn limited(movement: Option<Mat2>, largest_px: f32) -> (Mat2, bool) {
    let Some(movement) = movement else { return (Mat2::from_diagonal(Vec2::splat(largest_px)), true) };
    let stretch = largest_stretch(movement);
    if stretch > largest_px { (movement * (largest_px / stretch), true) } else { (movement, false) }
}

/// 0 up to 0, 1 from 1 on, smooth between.
fn smooth(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
