//! An environment blurred as rough surfaces reflect it.
//!
//! Karis 2013, "Real Shading in Unreal Engine 4": for each of a few degrees of roughness the map is averaged over the lobe that a surface reflects which is
//! seen along its normal. Each texel sums [`SAMPLES`] directions of that lobe, spread by one fixed set of points, and looks each of them up in the map
//! reduced to the size of what the direction stands for (Křivánek & Colbert 2008, "Real-time Shading with Filtered Importance Sampling").
//!
//! Phong's lobe has the exponent `2 / α² − 2`, the one that is as wide as the microfacets' (Walter et al. 2007).
//!
//! Cost: independent of the map's size, apart from reducing it once. A blurred map has as many texels as its lobe needs, [`MAX_WIDTH`] across at
//! most, and is made only for roughness that occurs. Limits: the lobe is round, and that of a surface seen from the side is not.

use super::map::{RadianceMap, direction};
use super::points::hammersley;
use crate::settings::Lobe;
use glam::Vec3;
use std::f32::consts::{PI, TAU};

/// Steps of roughness from 0 to 1.
const STEPS: usize = 16;

/// Directions summed for a texel.
const SAMPLES: u32 = 64;

/// Widest blurred map, in texels.
const MAX_WIDTH: usize = 1024;

/// Texels of a blurred map in a circle, over α: four in the width of the lobe.
const TEXELS: f32 = 8.0;

/// A map, and its blurs by roughness.
#[derive(Debug, Clone, PartialEq)]
pub struct Prefiltered {
    /// The map as it is: of a mirror.
    sharp: RadianceMap,
    /// That of roughness `(k + 1) / STEPS`, where it is needed.
    blurred: Vec<Option<RadianceMap>>,
}

/// A direction of a lobe about +z.
struct LobeSample {
    direction: Vec3,
    weight: f32,
    /// Solid angle that it stands for.
    solid_angle: f32,
}

impl Prefiltered {
    /// `map` with its blurs by `lobe` for roughness that `is_needed` between two values.
    pub fn new(map: RadianceMap, lobe: Lobe, is_needed: impl Fn([f32; 2]) -> bool) -> Self {
        let roughness = |step: usize| step as f32 / STEPS as f32;
        let needed = |step: usize| is_needed([roughness(step - 1), roughness(step.min(STEPS - 1) + 1)]);
        let steps: Vec<usize> = (1..=STEPS).filter(|&step| needed(step)).collect();
        let mut blurred = vec![None; STEPS];
        if !steps.is_empty() {
            let sizes = sizes(&map);
            for step in steps {
                blurred[step - 1] = Some(blur(&map, &sizes, lobe, roughness(step)));
            }
        }
        Self { sharp: map, blurred }
    }

    /// Mean radiance over the lobe of `roughness` about `direction`.
    pub fn radiance(&self, direction: Vec3, roughness: f32) -> [f32; 3] {
        let step = roughness.clamp(0.0, 1.0) * STEPS as f32;
        if step <= 0.0 {
            return self.sharp.radiance(direction);
        }
        let rougher = (step.ceil() as usize).clamp(1, STEPS);
        let share = step - (rougher - 1) as f32;
        // A blur that is not there was not needed: the nearest that is.
        let value = |step: usize| {
            let map = self.blurred[..step].iter().rev().find_map(Option::as_ref);
            map.unwrap_or(&self.sharp).radiance(direction)
        };
        let (fine, coarse) = (value(rougher - 1), value(rougher));
        std::array::from_fn(|k| fine[k] + share * (coarse[k] - fine[k]))
    }
}

/// `map` and its halves, down to one of few texels.
fn sizes(map: &RadianceMap) -> Vec<RadianceMap> {
    let mut sizes: Vec<RadianceMap> = Vec::new();
    loop {
        let last = sizes.last().unwrap_or(map);
        if last.width().min(last.height()) < 4 {
            return sizes;
        }
        sizes.push(last.reduced(last.width() / 2, last.height() / 2));
    }
}

/// `map`, of which `halves` are the smaller sizes, averaged over the lobe of `roughness`.
fn blur(map: &RadianceMap, halves: &[RadianceMap], lobe: Lobe, roughness: f32) -> RadianceMap {
    let alpha = roughness * roughness;
    let width = ((TEXELS / alpha) as usize).next_power_of_two().clamp(16, MAX_WIDTH.min(map.width().max(16)));
    let texel_angle = 2.0 * PI * PI / (map.width() * map.height()) as f32;
    let samples: Vec<(Vec3, f32, f32)> = (0..SAMPLES)
        .filter_map(|i| lobe_sample(lobe, alpha, hammersley(i, SAMPLES)))
        .map(|sample| {
            let level = 0.5 * (sample.solid_angle / texel_angle).max(1.0).log2();
            (sample.direction, sample.weight, level)
        })
        .collect();
    let whole: f32 = samples.iter().map(|(_, weight, _)| weight).sum();
    let look_up = |direction: Vec3, level: f32| {
        let size = |number: usize| match number {
            0 => map,
            _ => &halves[(number - 1).min(halves.len().saturating_sub(1))],
        };
        if halves.is_empty() || level <= 0.0 {
            return map.radiance(direction);
        }
        let (finer, share) = (level as usize, level.fract());
        let (fine, coarse) = (size(finer).radiance(direction), size(finer + 1).radiance(direction));
        std::array::from_fn(|k| fine[k] + share * (coarse[k] - fine[k]))
    };
    RadianceMap::from_fn(width, width / 2, |x, y| {
        let axis = direction([x, y], [width, width / 2]);
        let (right, up) = axis.any_orthonormal_pair();
        let mut sum = [0.0; 3];
        for &(direction, weight, level) in &samples {
            let towards = direction.x * right + direction.y * up + direction.z * axis;
            let light: [f32; 3] = look_up(towards, level);
            sum.iter_mut().zip(light).for_each(|(sum, light)| *sum += weight * light);
        }
        sum.map(|sum| sum / whole)
    })
}

/// The direction of the lobe at `point` of the unit square; `None` for one below the surface.
fn lobe_sample(lobe: Lobe, alpha: f32, point: [f32; 2]) -> Option<LobeSample> {
    let [across, around] = point;
    let (sin_around, cos_around) = (TAU * around).sin_cos();
    let (cosine, weight, density) = match lobe {
        Lobe::Ggx => {
            // A half vector of the distribution of normals D, seen along the normal: l = 2 (n·h) h − n, with density D / 4 and weight n·l.
            let squared = (1.0 - across) / (1.0 + (alpha * alpha - 1.0) * across);
            let cosine = 2.0 * squared - 1.0;
            let root = squared * (alpha * alpha - 1.0) + 1.0;
            (cosine, cosine, alpha * alpha / (PI * root * root) / 4.0)
        }
        Lobe::Phong => {
            let exponent = (2.0 / (alpha * alpha) - 2.0).max(0.0);
            let cosine = (1.0 - across).powf(1.0 / (exponent + 1.0));
            (cosine, 1.0, (exponent + 1.0) / TAU * cosine.powf(exponent))
        }
    };
    if cosine <= 0.0 {
        return None;
    }
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    Some(LobeSample {
        direction: Vec3::new(sine * cos_around, sine * sin_around, cosine),
        weight,
        solid_angle: 1.0 / (SAMPLES as f32 * density),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOBES: [Lobe; 2] = [Lobe::Ggx, Lobe::Phong];

    /// A dark map of 128 × 64 with one bright texel towards +z.
    fn one_light() -> RadianceMap {
        RadianceMap::from_fn(128, 64, |x, y| if (x, y) == (64, 32) { [100.0, 50.0, 0.0] } else { [0.0; 3] })
    }

    #[test]
    fn an_even_environment_is_the_same_at_any_roughness() {
        for lobe in LOBES {
            let even = Prefiltered::new(RadianceMap::from_fn(40, 20, |_, _| [3.0, 1.0, 0.0]), lobe, |_| true);
            for i in 0..100 {
                let direction = direction([i, i * 7 % 50], [100, 50]);
                let [red, green, blue] = even.radiance(direction, i as f32 / 99.0);
                assert!(
                    (red - 3.0).abs() < 1e-5 && (green - 1.0).abs() < 1e-5 && blue == 0.0,
                    "{lobe:?}: {red}, {green}"
                );
            }
        }
    }

    #[test]
    fn the_blur_of_a_light_widens_with_roughness_and_is_weaker() {
        for lobe in LOBES {
            let light = Prefiltered::new(one_light(), lobe, |_| true);
            let along = |degrees: f32| Vec3::new(degrees.to_radians().sin(), 0.0, degrees.to_radians().cos());
            let steps: Vec<f32> = (4..=16).map(|step| step as f32 / 16.0).collect();
            let centre: Vec<f32> = steps.iter().map(|&r| light.radiance(along(0.0), r)[0]).collect();
            assert!(centre.windows(2).all(|pair| pair[1] < pair[0]), "{lobe:?}, at the centre: {centre:?}");
            let width = |roughness: f32| {
                let peak = light.radiance(along(0.0), roughness)[0];
                (0..180).find(|&degrees| light.radiance(along(degrees as f32), roughness)[0] < 0.5 * peak)
            };
            let widths: Vec<usize> = steps.iter().filter_map(|&roughness| width(roughness)).collect();
            assert!(widths.windows(2).all(|pair| pair[1] >= pair[0]), "{lobe:?}, half-widths: {widths:?}");
            assert!(widths.len() > 8 && widths.last() > widths.first(), "{lobe:?}: {widths:?}");
        }
    }

    #[test]
    fn the_light_of_all_directions_is_kept() {
        // The lobe about each direction sums to 1, and is as wide about all: no light is lost on the sphere.
        for lobe in LOBES {
            let light = Prefiltered::new(one_light(), lobe, |[from, to]| {
                [0.5, 1.0].iter().any(|r| (from..=to).contains(r))
            });
            let total = |roughness: f32| {
                let rows = (0..64).map(|y| {
                    let row = (0..128).map(|x| light.radiance(direction([x, y], [128, 64]), roughness)[0]);
                    row.sum::<f32>() * ((y as f32 + 0.5) / 64.0 * PI).sin()
                });
                rows.sum::<f32>()
            };
            let sharp = total(0.0);
            // 64 directions of a lobe leave a few hundredths.
            for roughness in [0.5, 1.0] {
                let share = total(roughness) / sharp;
                assert!((share - 1.0).abs() < 0.05, "{lobe:?}, roughness {roughness}: {share}");
            }
        }
    }

    #[test]
    fn a_mirror_sees_the_map_itself_and_roughness_that_does_not_occur_costs_nothing() {
        let light = Prefiltered::new(one_light(), Lobe::Ggx, |[from, to]| from < 0.5 && to > 0.4);
        assert_eq!(
            light.radiance(direction([64, 32], [128, 64]), 0.0),
            one_light().radiance(direction([64, 32], [128, 64]))
        );
        let made: Vec<usize> = (0..STEPS).filter(|&k| light.blurred[k].is_some()).map(|k| k + 1).collect();
        assert_eq!(made, [6, 7, 8], "those around 0.4 to 0.5");
    }

    #[test]
    fn the_blur_is_the_same_for_any_number_of_threads() {
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| Prefiltered::new(one_light(), Lobe::Ggx, |_| true))
        };
        assert_eq!(on(1), on(3));
    }
}
