//! The number of a stack's layers that contribute to a picture, and whether further layers would contribute.
//!
//! The truth at some pixels is computed with all layers and with only the first 1, 2, … of them, by the same rays, so that the
//! difference is due to the missing layers alone. As in [`super`], the rays are split into two halves and the squared error is the
//! product of both differences, which has no bias. The disocclusion fill is left out, because it would replace the missing surfaces that
//! are measured here.
//!
//! A ray that hits nothing after it has passed behind a fragment of the last layer may have missed a fragment of a further
//! layer. Where a sample has fewer fragments than the stack has layers, there is no further surface, and such rays are not lost.
//!
//! Cost: the rays, once for each number of layers. Memory: negligible. Limits: errors that occur in few places are partly missed.

use super::truth::PixelTracer;
use super::{Basis, ProbeSites, SEED, StratumErrors, mean_error};
use crate::lens::Rays;
use crate::methods::Plan;
use crate::parallel;
use crate::scene::{EffectKind, Scene};
use fastrand::Rng;

/// PSNR in dB from which fewer layers suffice: a third of the squared error of final quality, 45 dB.
pub(crate) const PEELS_ENOUGH_DB: f64 = 50.0;

/// Share of lost rays from which on further layers would contribute. The first two peels of a synthetic table scene lose 0.1 % and give a
/// picture within 57 dB of that of all four, those of a fence lose 2.4 % and are within 36 dB: by proportion, 50 dB correspond to 0.5 %
/// and to 0.1 %. The limit lies between the two.
pub(super) const LOST_RAYS_SHARE: f64 = 2e-3;

/// Number of probed pixels. The contribution of deep peels is rare: where the whole pictures of two peels and of four differ by 57.0 dB,
/// on a synthetic table scene, 400 pixels estimate 61.9 dB and 1600 pixels 60.3 dB.
const PIXELS: usize = 1600;

/// Rays of each half.
const RAYS: usize = 64;

/// The contribution of a stack's layers to the picture.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct PeelsSeen {
    /// Number of layers of the stack.
    pub layers: usize,
    /// The smallest number of layers whose picture is within [`PEELS_ENOUGH_DB`] of that of all.
    pub needed: usize,
    /// PSNR in dB of the picture of the first 1, 2, … layers against that of all; `None` where no difference is measurable.
    pub psnr_db: Vec<Option<f64>>,
    /// Share of the rays that hit nothing behind the last layer, where a further layer may have a surface.
    pub lost_rays: f64,
    /// Number of probed pixels.
    pub pixels: usize,
    /// Rays for each pixel and each number of layers.
    pub rays_per_pixel: usize,
}

impl PeelsSeen {
    /// Whether further layers would contribute to the picture.
    pub fn needs_more_layers(&self) -> bool {
        self.lost_rays >= LOST_RAYS_SHARE
    }
}

/// The contribution of the layers of `scene` to the picture of `plan`; `None` for a single layer, and where nothing is blurred.
pub fn peels_seen(scene: &Scene, plan: &Plan) -> Option<PeelsSeen> {
    let layers = scene.layers.len();
    if layers < 2 || !plan.does(EffectKind::Blur) {
        return None;
    }
    let basis = Basis::of_stack(scene, plan);
    let (tracer, ProbeSites { strata, .. }) = (basis.tracer(), ProbeSites::new(&basis, PIXELS, SEED));
    let fewer: Vec<PixelTracer<'_>> = (1..layers).map(|count| basis.tracer_of_first_layers(count)).collect();
    let strata: Vec<(f64, Vec<PixelStats>)> = strata
        .into_iter()
        .map(|(size, sites)| {
            let stats = |site: usize| pixel_stats(&tracer, &fewer, sites[site].pixel, sites[site].random);
            (size, parallel::map(sites.len(), &stats))
        })
        .collect();
    let mean = |value: &dyn Fn(&PixelStats) -> f64| {
        let in_stratum = |(size, pixels): &(f64, Vec<PixelStats>)| StratumErrors {
            size: *size,
            errors: pixels.iter().map(value).collect(),
        };
        mean_error(&strata.iter().map(in_stratum).collect::<Vec<_>>())
    };
    let errors = (0..layers - 1).map(|k| mean(&|pixel| pixel.errors[k]));
    let psnr_db: Vec<Option<f64>> =
        errors.map(|error| (error > 0.0).then(|| -10.0 * error.log10())).collect();
    let enough = |db: &Option<f64>| db.is_none_or(|db| db >= PEELS_ENOUGH_DB);
    Some(PeelsSeen {
        layers,
        needed: psnr_db.iter().position(enough).map_or(layers, |k| k + 1),
        psnr_db,
        lost_rays: mean(&|pixel| pixel.lost_rays),
        pixels: strata.iter().map(|(_, pixels)| pixels.len()).sum(),
        rays_per_pixel: 2 * RAYS,
    })
}

/// Results for one pixel.
#[derive(Debug)]
struct PixelStats {
    /// Estimates of the squared error of the first 1, 2, … layers.
    errors: Vec<f64>,
    /// Share of the rays that are lost behind the last layer.
    lost_rays: f64,
}

/// Compares `pixel` with all layers to the same rays' results with `fewer` layers.
fn pixel_stats(all: &PixelTracer<'_>, fewer: &[PixelTracer<'_>], pixel: usize, seed: u64) -> PixelStats {
    let mut rng = Rng::with_seed(seed);
    let halves = [(); 2].map(|()| all.rays(RAYS, &mut rng));
    let truth = halves.each_ref().map(|rays| all.color(pixel, rays));
    let error = |few: &PixelTracer<'_>| {
        let found = halves.each_ref().map(|rays| few.color(pixel, rays));
        let difference = |half: usize, channel: usize| f64::from(found[half][channel] - truth[half][channel]);
        (0..3).map(|channel| difference(0, channel) * difference(1, channel)).sum::<f64>() / 3.0
    };
    let width = all.scene.picture_size().0;
    let lost = |rays: &Rays| all.volume.lost_rays(pixel % width, pixel / width, rays.green());
    PixelStats {
        errors: fewer.iter().map(error).collect(),
        lost_rays: halves.iter().map(lost).sum::<f64>() / 2.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;
    use crate::methods;
    use crate::metrics::displayed;
    use crate::scene::Layer;
    use crate::settings::{ParameterValues, Settings};
    use crate::stack::StackKind;

    const WIDTH: usize = 96;
    const HEIGHT: usize = 64;

    /// Brightness and CoC radius of a layer in column `x`; `None` where it is empty.
    type Column = fn(usize) -> Option<(f32, f32)>;

    fn peels_seen(layers: &[Column]) -> Option<PeelsSeen> {
        let layer = |column: &Column| {
            let plane = |value: fn((f32, f32)) -> f32| {
                Plane::from_fn(WIDTH, HEIGHT, |x, _| column(x).map_or(0.0, value))
            };
            Layer {
                color: std::array::from_fn(|_| plane(|(brightness, _)| brightness)),
                alpha: plane(|_| 1.0),
                coc_px: plane(|(_, coc)| coc),
            }
        };
        let scene = Scene::new(layers.iter().map(layer).collect(), StackKind::PointSampled, 1, 20.0);
        let settings = Settings::resolve(&[], ParameterValues::default());
        let plan = methods::Registry::default().plan(&scene.analyze(), &settings).unwrap();
        super::peels_seen(&scene, &plan)
    }

    /// A near, blurred surface on the left half, over a bright wall in focus.
    const NEAR_HALF: Column = |x| Some(if x < 48 { (0.2, -8.0) } else { (0.8, 0.0) });

    /// The wall behind the near surface.
    const WALL_BEHIND: Column = |x| (x < 48).then_some((0.5, 0.0));

    /// A surface behind the wall, which no ray reaches.
    const BEHIND_THE_WALL: Column = |_| Some((0.9, 4.0));

    #[test]
    fn a_layer_that_no_ray_reaches_is_not_needed() {
        let seen = peels_seen(&[NEAR_HALF, WALL_BEHIND, BEHIND_THE_WALL]).unwrap();
        assert_eq!((seen.layers, seen.needed), (3, 2), "{seen:?}");
        assert_eq!(seen.psnr_db[1], None, "the first two layers give the whole picture");
        let flat = peels_seen(&[|_| Some((0.5, 3.0)), BEHIND_THE_WALL]).unwrap();
        assert_eq!((flat.needed, flat.lost_rays), (1, 0.0), "behind a surface without an edge");
    }

    #[test]
    fn a_layer_behind_a_blurred_near_edge_is_needed() {
        let seen = peels_seen(&[NEAR_HALF, WALL_BEHIND]).unwrap();
        assert_eq!(seen.needed, 2, "{seen:?}");
        assert!(!seen.needs_more_layers(), "{seen:?}");
        // In 8 columns at the edge, the share of the disc beyond it shows the wall, 0.5; without the wall only the other rays, 0.2, count.
        let beyond = |d: f32| (d.acos() - d * (1.0 - d * d).sqrt()) / std::f32::consts::PI;
        let error = |i: u8| displayed(0.2 + 0.3 * beyond((f32::from(i) + 0.5) / 8.0)) - displayed(0.2);
        let mean = (0..8).map(|i| error(i).powi(2)).sum::<f32>() / WIDTH as f32;
        let expected = -10.0 * f64::from(mean).log10();
        assert!((seen.psnr_db[0].unwrap() - expected).abs() < 1.0, "expected {expected:.1} dB, {seen:?}");
    }

    #[test]
    fn rays_that_pass_the_last_layer_and_hit_nothing_are_lost() {
        // A third surface is missing behind two near ones: in 8 of 96 columns at most half of the rays pass both.
        let second: Column = |x| (x < 48).then_some((0.4, -6.0));
        let seen = peels_seen(&[NEAR_HALF, second]).unwrap();
        assert!(seen.needs_more_layers() && seen.lost_rays < 0.5 * 8.0 / 96.0, "{seen:?}");
    }

    #[test]
    fn rays_into_a_transparent_background_are_not_lost() {
        // They pass a near object, behind which the stack has fewer fragments than layers: there is no further surface.
        let first: Column = |x| match x {
            ..48 => Some((0.2, -8.0)),
            80.. => Some((0.5, 0.0)),
            _ => None,
        };
        let seen = peels_seen(&[first, |x| (x >= 80).then_some((0.5, 4.0))]).unwrap();
        assert_eq!(seen.lost_rays, 0.0, "{seen:?}");
    }

    #[test]
    fn a_single_layer_or_a_picture_without_blur_is_not_measured() {
        assert_eq!(peels_seen(&[NEAR_HALF]), None);
        assert_eq!(peels_seen(&[|_| Some((0.5, 0.1)), BEHIND_THE_WALL]).map(|seen| seen.needed), Some(1));
        assert_eq!(peels_seen(&[|_| Some((0.5, 0.001)), |_| Some((0.5, 0.002))]), None);
    }
}
