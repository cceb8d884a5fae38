//! Finding lights: bright points, which a few views would show as dots, become [`Highlight`]s.
//!
//! The excess of a bright fragment over its surroundings ([`Spark`]) is removed from its surface. Fragments that touch and belong to one
//! surface are one light: a disc of their area at the centroid of their energy. A light that covers several pixels in part is then as large
//! as it is, and not as large as its pixels. Where a light is no such disc, because it is hardly blurred, large or long, its fragments are
//! lights of their own, each as wide as its sample. Both are weights: a light changes continuously from one to the other.
//!
//! Cost: one comparison a fragment, and about a hundred reads for each bright one.

use super::highlights::{Emitter, Highlight, Part};
use super::sparks::{Spark, sparks};
use crate::methods::contract::Plan;
use crate::scene::surface::merge_gap_px;
use crate::scene::{EffectKind, Layer, Scene, share_of_disc};
use glam::{Mat2, Vec2};
use std::collections::{BTreeMap, HashMap};
use std::f32::consts::PI;

/// CoC radius of a light, in picture pixels: up to the first its fragments are not joined, from the second on they are. Where a light is
/// sharp, its own pixels show its shape.
const JOINED_FROM_PX: [f32; 2] = [1.5, 2.0];

/// Area of a light in picture pixels up to which its fragments are joined, and from which on they are not.
const JOINED_AREA_PX: [f32; 2] = [25.0, 30.0];

/// Difference of the variances of a light along its longer and its shorter axis, relative to the variance of a disc of its area: up to the
/// first its fragments are joined, from the second on they are not. It is 2 for two discs that touch.
const JOINED_LENGTH: [f32; 2] = [1.1, 1.7];

/// Sum of the two variances of a light relative to that of a disc of its area, alike. It is 5/4 for four discs that touch.
const JOINED_SPREAD: [f32; 2] = [1.15, 1.4];

/// Variance along one axis that sampling a disc in squares adds to it, in sample widths.
const SQUARE_VARIANCE: f32 = 1.0 / 12.0;

/// Variance along one axis that a renderer's pixel filter adds at most, in sample widths.
const FILTER_VARIANCE: f32 = 0.2;

/// Energy of a fragment relative to the brightest of its light: up to the first its depth may be that of the surface behind, from the
/// second on it is the light's.
const OWN_DEPTH_FROM: [f32; 2] = [0.5, 0.75];

/// Removes the excess of fragments brighter than the plan's threshold from the layers of `scene`.
pub(super) fn extract(scene: &mut Scene, plan: &Plan) -> Vec<Highlight> {
    let threshold = plan.strength(EffectKind::Highlights).unwrap_or(f32::INFINITY);
    extract_brighter(scene, threshold, plan.averages_px)
}

/// Removes the excess of fragments brighter than `threshold`; an average over the pixel is drawn `averages_px` wide.
fn extract_brighter(scene: &mut Scene, threshold: f32, averages_px: f32) -> Vec<Highlight> {
    let sparks = sparks(scene, threshold);
    let mut highlights = Vec::new();
    for light in joined(&sparks) {
        let members: Vec<&Spark> = light.iter().map(|&index| &sparks[index]).collect();
        let light = Light::new(&members);
        let joined = light.share_joined(scene.supersample);
        for spark in &members {
            // What is not joined is drawn as far as a disc can carry it.
            let alone = (1.0 - joined) * share_of_disc(spark.coc_px);
            subtract(&mut scene.layers, spark, joined + alone);
            highlights.extend(squares(spark, alone, (averages_px, scene.supersample)));
        }
        highlights.extend((joined > 0.0).then(|| light.disc(&members, joined, scene.supersample)));
    }
    highlights
}

/// Subtracts `share` of the light of `spark` from its fragment.
fn subtract(layers: &mut [Layer], spark: &Spark, share: f32) {
    let [layer, x, y] = spark.place;
    for (plane, excess) in layers[layer].color.iter_mut().zip(spark.excess) {
        plane.set(x, y, plane.get(x, y) - share * spark.share * excess);
    }
}

/// `share` of the light of `spark` as that of a fragment: a point sample as wide as a pixel, an average `averages_px` wide.
fn squares(
    spark: &Spark,
    share: f32,
    (averages_px, supersample): (f32, usize),
) -> impl Iterator<Item = Highlight> {
    /// Width of the square that a point sample represents, in picture pixels.
    const POINT_SAMPLE_PX: f32 = 1.0;
    let spark = *spark;
    let widths = [(POINT_SAMPLE_PX, 1.0 - spark.antialiased), (averages_px, spark.antialiased)];
    widths
        .into_iter()
        .map(move |(width_px, part)| (width_px, share * part))
        .filter(|(_, part)| *part > 0.0)
        .map(move |(width_px, part)| {
            let position = in_picture(spark.position(), supersample);
            Highlight {
                position,
                coc_px: spark.coc_px,
                energy: spark.excess.map(|excess| part * spark.share * excess / samples(supersample)),
                emitter: Emitter::Square { width_px },
                parts: vec![Part { position, share: 1.0, hidden: spark.hidden }],
            }
        })
}

/// Samples of a pixel.
fn samples(supersample: usize) -> f32 {
    (supersample * supersample) as f32
}

/// The position of the samples' position `at` in picture pixels, whose centres are at whole numbers.
fn in_picture(at: Vec2, supersample: usize) -> Vec2 {
    (at + 0.5) / supersample as f32 - 0.5
}

/// 1 up to `from`, 0 from `to` on.
fn up_to([from, to]: [f32; 2], value: f32) -> f32 {
    ((to - value) / (to - from)).clamp(0.0, 1.0)
}

/// The `sparks` of each light, by their indices: those that touch, of one surface.
fn joined(sparks: &[Spark]) -> Vec<Vec<usize>> {
    let layers = sparks.iter().map(|spark| spark.place[0] + 1).max().unwrap_or(0);
    let indices: HashMap<[usize; 3], usize> =
        sparks.iter().enumerate().map(|(index, spark)| (spark.place, index)).collect();
    let mut is_taken = vec![false; sparks.len()];
    let mut lights = Vec::new();
    for first in 0..sparks.len() {
        if std::mem::replace(&mut is_taken[first], true) {
            continue;
        }
        let mut light = vec![first];
        let mut next = 0;
        while let Some(&index) = light.get(next) {
            let [_, x, y] = sparks[index].place;
            let around = (x.saturating_sub(1)..=x + 1)
                .flat_map(|nx| (y.saturating_sub(1)..=y + 1).map(move |ny| [nx, ny]))
                .filter(|&near| near != [x, y]);
            for [nx, ny] in around {
                for other in (0..layers).filter_map(|layer| indices.get(&[layer, nx, ny]).copied()) {
                    if !is_taken[other] && are_joined(&sparks[index], &sparks[other]) {
                        is_taken[other] = true;
                        light.push(other);
                    }
                }
            }
            next += 1;
        }
        // By place, so that sums do not depend on the order in which the fragments were reached.
        light.sort_unstable();
        lights.push(light);
    }
    lights
}

/// Whether two bright fragments that touch are of one surface.
fn are_joined(a: &Spark, b: &Spark) -> bool {
    (a.mixes && b.mixes) || (a.coc_px - b.coc_px).abs() < merge_gap_px(a.coc_px)
}

/// Fragments that are one light.
#[derive(Debug)]
struct Light {
    /// Sum of their excess, in samples.
    energy: [f32; 3],
    /// Mean position by energy, in samples.
    centroid: Vec2,
    /// Variances of the position by energy along the longer and the shorter axis, in samples.
    variances: [f32; 2],
    /// Area in samples.
    area: f32,
    coc_px: f32,
}

impl Light {
    fn new(sparks: &[&Spark]) -> Self {
        let energies = sparks.iter().map(|spark| spark.energy());
        let (sum, most) =
            energies.clone().fold((0.0, 0.0), |(sum, most): (f32, f32), e| (sum + e, most.max(e)));
        let mean = |value: &dyn Fn(&Spark) -> f32| {
            sparks.iter().map(|spark| spark.energy() * value(spark)).sum::<f32>() / sum
        };
        let centroid = Vec2::new(mean(&|spark| spark.position().x), mean(&|spark| spark.position().y));
        let covariance = |a: usize, b: usize| {
            mean(&|spark| (spark.position() - centroid)[a] * (spark.position() - centroid)[b])
        };
        let covariances =
            Mat2::from_cols_array(&[covariance(0, 0), covariance(0, 1), covariance(0, 1), covariance(1, 1)]);
        let level = if sparks.iter().any(|spark| spark.mixes) { most } else { level(sparks, most) };
        Self {
            energy: std::array::from_fn(|k| sparks.iter().map(|spark| spark.share * spark.excess[k]).sum()),
            centroid,
            variances: eigenvalues(covariances),
            // A fragment is a light in part where the light covers it in part, or where other parts of its surface do.
            area: sparks.iter().map(|spark| (spark.energy() / level).min(spark.share * spark.alpha)).sum(),
            coc_px: own_coc_px(sparks, most),
        }
    }

    /// How far the fragments are drawn as one disc.
    fn share_joined(&self, supersample: usize) -> f32 {
        let blurred = 1.0 - up_to(JOINED_FROM_PX, self.coc_px.abs());
        let disc = self.area / (4.0 * PI) + SQUARE_VARIANCE;
        let [long, short] = self.variances;
        let compact = up_to(JOINED_LENGTH, (long - short) / disc)
            * up_to(JOINED_SPREAD, (long + short) / (2.0 * (disc + FILTER_VARIANCE - SQUARE_VARIANCE)));
        blurred * compact * up_to(JOINED_AREA_PX, self.area / samples(supersample))
    }

    /// `share` of it as a disc; `sparks` are its fragments.
    fn disc(&self, sparks: &[&Spark], share: f32, supersample: usize) -> Highlight {
        Highlight {
            position: in_picture(self.centroid, supersample),
            coc_px: self.coc_px,
            energy: self.energy.map(|energy| share * energy / samples(supersample)),
            emitter: Emitter::Disc { radius_px: (self.area / (PI * samples(supersample))).sqrt() },
            parts: parts(sparks, supersample),
        }
    }
}

/// The parts of a light of `sparks`, half a pixel wide: its fragments there, and the quarters of a fragment that is a pixel wide.
fn parts(sparks: &[&Spark], supersample: usize) -> Vec<Part> {
    const QUARTERS: [Vec2; 4] =
        [Vec2::new(-0.25, -0.25), Vec2::new(0.25, -0.25), Vec2::new(-0.25, 0.25), Vec2::new(0.25, 0.25)];
    let mut by_place: BTreeMap<[usize; 2], Vec<&Spark>> = BTreeMap::new();
    for spark in sparks {
        let [_, x, y] = spark.place;
        by_place.entry([y, x].map(|sample| 2 * sample / supersample)).or_default().push(spark);
    }
    let sum = |sparks: &[&Spark], value: &dyn Fn(&Spark) -> f32| {
        sparks.iter().map(|spark| spark.energy() * value(spark)).sum::<f32>()
    };
    let whole = sum(sparks, &|_| 1.0);
    let part = |sparks: &Vec<&Spark>| {
        let energy = sum(sparks, &|_| 1.0);
        let mean = |value: &dyn Fn(&Spark) -> f32| sum(sparks, value) / energy;
        let position = Vec2::new(mean(&|spark| spark.position().x), mean(&|spark| spark.position().y));
        Part {
            position: in_picture(position, supersample),
            share: energy / whole,
            hidden: mean(&|spark| spark.hidden),
        }
    };
    let parts = by_place.values().filter(|sparks| sum(sparks, &|_| 1.0) > 0.0).map(part);
    if supersample > 1 {
        return parts.collect();
    }
    let quarters = |part: Part| {
        QUARTERS.map(|shift| Part { position: part.position + shift, share: 0.25 * part.share, ..part })
    };
    parts.flat_map(quarters).collect()
}

/// The brightness of a light of `sparks` where it covers a fragment in full: a mean that the brightest of them dominate, so that neither one
/// spot nor the dim rim of a light decides. `most` is the energy of the brightest.
fn level(sparks: &[&Spark], most: f32) -> f32 {
    /// Least coverage that a fragment's colour is divided by.
    const LEAST_ALPHA: f32 = 0.05;
    let sum = |power: i32| {
        let term = |spark: &&Spark| {
            let relative = spark.energy() / (most * spark.alpha.max(LEAST_ALPHA));
            spark.energy() * relative.powi(power)
        };
        sparks.iter().map(term).sum::<f32>()
    };
    most * sum(2) / sum(1)
}

/// The CoC radius of a light of `sparks`, of which the brightest has the energy `most`: the nearest of those whose depth is the light's own, or
/// else that of the brightest.
fn own_coc_px(sparks: &[&Spark], most: f32) -> f32 {
    let mut by_depth = sparks.to_vec();
    by_depth.sort_by(|a, b| a.coc_px.total_cmp(&b.coc_px));
    let (mut coc_px, mut left) = (0.0, 1.0);
    for spark in by_depth {
        let is_light = 1.0 - up_to(OWN_DEPTH_FROM, spark.energy() / most);
        let share = left * is_light * spark.own_depth;
        coc_px += share * spark.coc_px;
        left -= share;
    }
    // Where a fragment is of another surface in part, it is dimmer.
    let weight = |spark: &Spark| (spark.energy() / most).powi(8);
    let (sum, weights) = sparks.iter().fold((0.0, 0.0), |(sum, weights), spark| {
        (sum + weight(spark) * spark.coc_px, weights + weight(spark))
    });
    coc_px + left * sum / weights
}

/// The larger and the smaller eigenvalue of a symmetric matrix.
fn eigenvalues(matrix: Mat2) -> [f32; 2] {
    let (mean, half) = (0.5 * (matrix.x_axis.x + matrix.y_axis.y), 0.5 * (matrix.x_axis.x - matrix.y_axis.y));
    let root = half.hypot(matrix.x_axis.y);
    [mean + root, mean - root]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;
    use crate::stack::StackKind;

    const SIZE: usize = 32;

    /// Radiance of a light.
    const LIGHT: f32 = 100.0;

    /// How a stack has seen a light.
    #[derive(Debug, Clone, Copy, PartialEq)]
    enum Seen {
        /// Coverage, with the light's CoC radius.
        Coverage,
        /// One picture with depth: the rim of the light has the wall's CoC radius.
        Picture,
        /// A point sample at each pixel's centre.
        Samples,
    }

    /// The scene of lights of CoC radius `coc_px`, `(centre, radius)` each in pixels, before a wall of CoC radius 12.
    fn scene(lights: &[(Vec2, f32)], coc_px: f32, seen: Seen) -> Scene {
        const GRID: usize = 16;
        let inside = |at: Vec2| lights.iter().any(|&(center, radius)| at.distance(center) < radius);
        let covered = |x: usize, y: usize| {
            let at = |i: usize| (Vec2::new((i % GRID) as f32, (i / GRID) as f32) + 0.5) / GRID as f32 - 0.5;
            let count = (0..GRID * GRID).filter(|&i| inside(Vec2::new(x as f32, y as f32) + at(i))).count();
            count as f32 / (GRID * GRID) as f32
        };
        let hit = |x: usize, y: usize| f32::from(u8::from(inside(Vec2::new(x as f32, y as f32))));
        let share =
            Plane::from_fn(SIZE, SIZE, |x, y| if seen == Seen::Samples { hit(x, y) } else { covered(x, y) });
        let plane = |value: &dyn Fn(usize, usize) -> f32| Plane::from_fn(SIZE, SIZE, value);
        let color = || [(); 3].map(|()| plane(&|x, y| LIGHT * share.get(x, y)));
        let wall = Layer {
            color: [(); 3].map(|()| Plane::zeros(SIZE, SIZE)),
            alpha: Plane::filled(SIZE, SIZE, 1.0),
            coc_px: Plane::filled(SIZE, SIZE, 12.0),
        };
        let layers = match seen {
            Seen::Picture => {
                let depth = plane(&|x, y| if hit(x, y) > 0.0 { coc_px } else { 12.0 });
                vec![Layer { color: color(), coc_px: depth, ..wall }]
            }
            _ => vec![
                Layer { color: color(), alpha: share.clone(), coc_px: Plane::filled(SIZE, SIZE, coc_px) },
                wall,
            ],
        };
        let kind = if seen == Seen::Samples { StackKind::PointSampled } else { StackKind::Coverage };
        Scene::new(layers, kind, 1, 20.0)
    }

    fn found(lights: &[(Vec2, f32)], coc_px: f32, seen: Seen) -> Vec<Highlight> {
        extract_brighter(&mut scene(lights, coc_px, seen), 1.0, 0.0)
    }

    #[test]
    fn a_light_is_one_disc_of_its_area_place_depth_and_energy_wherever_in_a_pixel_it_lies() {
        for seen in [Seen::Coverage, Seen::Picture] {
            for radius in [0.9, 1.5, 2.2] {
                for step in 0..8 {
                    let center = Vec2::new(15.0 + 0.125 * step as f32, 16.3);
                    let lights = found(&[(center, radius)], 6.0, seen);
                    let name = format!("{seen:?}, radius {radius}, centre {center}");
                    let [Highlight { position, coc_px, energy, emitter: Emitter::Disc { radius_px }, .. }] =
                        &lights[..]
                    else {
                        panic!("{name}: {lights:?}");
                    };
                    let expected = LIGHT * PI * radius * radius;
                    assert!(
                        position.distance(center) < 0.06 && (coc_px - 6.0).abs() < 1e-4,
                        "{name}: {position}, {coc_px}"
                    );
                    assert!(
                        (energy[0] / expected - 1.0).abs() < 0.03,
                        "{name}: {energy:?}, expected {expected}"
                    );
                    // The picture of a small light does not say how much of a pixel it covers.
                    let within = if seen == Seen::Picture && radius < 1.2 { 0.35 } else { 0.06 };
                    assert!((radius_px - radius).abs() < within, "{name}: {radius_px}");
                }
            }
        }
    }

    #[test]
    fn a_light_half_behind_a_nearer_surface_keeps_its_own_depth() {
        for edge in 0..8 {
            let right_of = 15.6 + 0.125 * edge as f32;
            let mut scene = scene(&[(Vec2::splat(16.0), 2.2)], 6.0, Seen::Picture);
            let [layer] = &mut scene.layers[..] else { panic!("one picture") };
            for (x, y) in (0..SIZE).flat_map(|y| (0..SIZE).map(move |x| (x, y))) {
                // The surface hides what is left of its edge, and its depth is that of each pixel of which it hides any.
                let visible = (x as f32 + 0.5 - right_of).clamp(0.0, 1.0);
                layer.color.iter_mut().for_each(|plane| plane.set(x, y, visible * plane.get(x, y)));
                if visible < 1.0 {
                    layer.coc_px.set(x, y, -10.0);
                }
            }
            let lights = extract_brighter(&mut scene, 1.0, 0.0);
            let brightest = lights.iter().max_by(|a, b| a.energy[0].total_cmp(&b.energy[0])).unwrap();
            assert!((brightest.coc_px - 6.0).abs() < 1e-3, "edge at {right_of}: {lights:?}");
        }
    }

    #[test]
    fn point_samples_of_a_light_are_a_disc_of_as_many_pixels() {
        // No fragment of the light's peel lies around it: what is not brighter than the threshold stays.
        let lights = found(&[(Vec2::splat(16.0), 1.6)], 6.0, Seen::Samples);
        let [Highlight { emitter: Emitter::Disc { radius_px }, energy, .. }] = &lights[..] else {
            panic!("{lights:?}");
        };
        assert!(
            (PI * radius_px * radius_px - 9.0).abs() < 1e-3 && energy[0] == 9.0 * (LIGHT - 1.0),
            "{lights:?}"
        );
    }

    /// Share of the energy of `lights` that is drawn as discs of joined fragments.
    fn joined_share(lights: &[Highlight]) -> f32 {
        let sum = |joined: bool| {
            let is_joined = |light: &&Highlight| matches!(light.emitter, Emitter::Disc { .. }) == joined;
            lights.iter().filter(is_joined).map(|light| light.energy[0]).sum::<f32>()
        };
        sum(true) / (sum(true) + sum(false))
    }

    #[test]
    fn lights_that_touch_are_not_drawn_as_one_disc() {
        let pair =
            |gap: f32| [Vec2::new(12.0, 16.0), Vec2::new(16.0 + gap, 16.0)].map(|center| (center, 2.0));
        assert!(joined_share(&found(&pair(0.0), 6.0, Seen::Coverage)) < 0.05, "they touch");
        let apart = found(&pair(3.0), 6.0, Seen::Coverage);
        assert_eq!((apart.len(), joined_share(&apart)), (2, 1.0), "apart they are two");
    }

    #[test]
    fn a_light_leaves_its_disc_gradually_as_it_comes_into_focus_and_as_it_grows() {
        let by_blur: Vec<f32> = (0..=40)
            .map(|i| joined_share(&found(&[(Vec2::splat(16.0), 1.5)], 1.3 + 0.02 * i as f32, Seen::Coverage)))
            .collect();
        let by_area: Vec<f32> = (0..=40)
            .map(|i| joined_share(&found(&[(Vec2::splat(16.0), 2.6 + 0.02 * i as f32)], 6.0, Seen::Coverage)))
            .collect();
        assert_eq!([by_blur[0], by_blur[40], by_area[0], by_area[40]], [0.0, 1.0, 1.0, 0.0]);
        for shares in [by_blur, by_area] {
            assert!(shares.windows(2).all(|pair| (pair[0] - pair[1]).abs() < 0.15), "{shares:?}");
        }
    }

    #[test]
    fn all_the_energy_that_leaves_the_layers_is_in_the_discs() {
        let lights = [(Vec2::new(9.3, 9.0), 1.4), (Vec2::new(20.0, 20.4), 4.0), (Vec2::new(25.0, 8.0), 0.5)];
        for seen in [Seen::Coverage, Seen::Picture, Seen::Samples] {
            for coc_px in [0.5, 1.2, 1.8, 7.0] {
                let mut scene = scene(&lights, coc_px, seen);
                let light = |scene: &Scene| {
                    scene.layers.iter().flat_map(|layer| layer.color[1].values()).sum::<f32>()
                };
                let before = light(&scene);
                let discs: f32 =
                    extract_brighter(&mut scene, 1.0, 0.0).iter().map(|disc| disc.energy[1]).sum();
                let after = light(&scene);
                assert!(
                    (before - after - discs).abs() < 1e-3 * before,
                    "{seen:?}, {coc_px}: {before} {after} {discs}"
                );
            }
        }
    }

    #[test]
    fn a_shade_hides_a_light_close_behind_it_from_all_of_the_lens() {
        for gap in [0.0, 0.2, 0.4, 0.7] {
            let mut scene = scene(&[(Vec2::splat(16.0), 1.5)], 6.0, Seen::Samples);
            let shade = Layer { coc_px: Plane::filled(SIZE, SIZE, 6.0 - gap), ..scene.layers[1].clone() };
            scene.layers.insert(0, shade);
            let lights = extract_brighter(&mut scene, 1.0, 0.0);
            let hidden: Vec<f32> =
                lights.iter().flat_map(|light| &light.parts).map(|part| part.hidden).collect();
            assert!(
                !hidden.is_empty() && hidden.iter().all(|&hidden| hidden > 0.999),
                "{gap} px: {hidden:?}"
            );
        }
    }
}
