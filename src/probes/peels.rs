//! How many of a stack's layers a lens can see, and whether it would see more than there are.
//!
//! The truth at some pixels is asked for with all layers and with the first 1, 2, … alone, by the same rays, so that only
//! what the missing layers hide or show differs. As in [`super`], the rays come in two halves and the squared error is the
//! product of both differences, which has no bias. Guessed surfaces take no part: what a stack with fewer layers would have to guess
//! is what is asked for.
//!
//! A ray that finds nothing and has passed behind something of the last layer on its way may have missed what a further layer would
//! hold. Where a sample has fewer fragments than the stack has layers, nothing more is behind them: such rays found all there was.
//!
//! Cost: the rays, once for each number of layers. Memory: next to none. Limits: of errors in few places only some are seen.

use super::{Look, Places, SEED, StratumErrors, mean_error};
use crate::lens::Rays;
use crate::methods::Plan;
use crate::methods::Volume;
use crate::scene::{EffectKind, Scene};
use fastrand::Rng;
use rayon::prelude::*;

/// PSNR in dB from which a picture of fewer layers will do: a third of the squared error that is left at final quality, 45 dB.
pub(crate) const PEELS_ENOUGH_DB: f64 = 50.0;

/// From this share of lost rays on, more layers would be seen. The first two peels of a made table scene lose 0.1 % and make a picture
/// within 57 dB of that of all four, those of a fence lose 2.4 % and are within 36 dB: in proportion, 50 dB are left at 0.5 %
/// and at 0.1 %. This is between the two.
pub(super) const LOST_RAYS_SHARE: f64 = 2e-3;

/// Pixels looked at. What deep peels add is rare: where the whole pictures of two peels and of four differ by 57.0 dB, on a made table
/// scene, 400 pixels say 61.9 and these 60.3.
const PIXELS: usize = 1600;

/// Rays of each half.
const RAYS: usize = 64;

/// What a lens sees of a stack's layers.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct PeelsSeen {
    /// Layers of the stack.
    pub layers: usize,
    /// The least number of layers whose picture is within [`PEELS_ENOUGH_DB`] of that of all.
    pub needed: usize,
    /// PSNR in dB of the picture of the first 1, 2, … layers against that of all; `None` where no difference is seen.
    pub psnr_db: Vec<Option<f64>>,
    /// Share of the rays that find nothing behind the last layer, where a further one may have something.
    pub lost_rays: f64,
    /// Pixels looked at.
    pub pixels: usize,
    /// Rays for each of them and each number of layers.
    pub rays_per_pixel: usize,
}

impl PeelsSeen {
    /// Whether more layers than there are would be seen.
    pub fn wants_more(&self) -> bool {
        self.lost_rays >= LOST_RAYS_SHARE
    }
}

/// What the lens of `plan` sees of the layers of `scene`; `None` for a single layer, and where nothing is blurred.
pub fn peels_seen(scene: &Scene, plan: &Plan) -> Option<PeelsSeen> {
    let layers = scene.layers.len();
    if layers < 2 || !plan.does(EffectKind::Blur) {
        return None;
    }
    let Places { look, strata, mut rng, .. } = Places::new(scene, plan, PIXELS, SEED);
    let fewer: Vec<Look<'_>> = (1..layers)
        .map(|count| Look { scene, plan, volume: Volume::from_first_layers(count, scene, plan) })
        .collect();
    let strata: Vec<(f64, Vec<Seen>)> = strata
        .into_iter()
        .map(|(size, pixels)| {
            let seeds: Vec<(usize, u64)> = pixels.into_iter().map(|pixel| (pixel, rng.u64(..))).collect();
            (size, seeds.into_par_iter().map(|(pixel, seed)| seen(&look, &fewer, pixel, seed)).collect())
        })
        .collect();
    let mean = |value: &dyn Fn(&Seen) -> f64| {
        let of_stratum = |(size, seen): &(f64, Vec<Seen>)| StratumErrors {
            size: *size,
            errors: seen.iter().map(value).collect(),
        };
        mean_error(&strata.iter().map(of_stratum).collect::<Vec<_>>())
    };
    let errors = (0..layers - 1).map(|k| mean(&|seen| seen.errors[k]));
    let psnr_db: Vec<Option<f64>> =
        errors.map(|error| (error > 0.0).then(|| -10.0 * error.log10())).collect();
    let enough = |db: &Option<f64>| db.is_none_or(|db| db >= PEELS_ENOUGH_DB);
    Some(PeelsSeen {
        layers,
        needed: psnr_db.iter().position(enough).map_or(layers, |k| k + 1),
        psnr_db,
        lost_rays: mean(&|seen| seen.lost_rays),
        pixels: strata.iter().map(|(_, seen)| seen.len()).sum(),
        rays_per_pixel: 2 * RAYS,
    })
}

/// What is seen at a pixel.
#[derive(Debug)]
struct Seen {
    /// Estimates of the squared error of the first 1, 2, … layers.
    errors: Vec<f64>,
    /// Share of the rays that are lost behind the last layer.
    lost_rays: f64,
}

/// What is seen at `pixel` with all layers, and by the same rays with `fewer`.
fn seen(all: &Look<'_>, fewer: &[Look<'_>], pixel: usize, seed: u64) -> Seen {
    let mut rng = Rng::with_seed(seed);
    let halves = [(); 2].map(|()| all.rays(RAYS, &mut rng));
    let truth = halves.each_ref().map(|rays| all.shown(pixel, rays));
    let error = |few: &Look<'_>| {
        let found = halves.each_ref().map(|rays| few.shown(pixel, rays));
        let difference = |half: usize, channel: usize| f64::from(found[half][channel] - truth[half][channel]);
        (0..3).map(|channel| difference(0, channel) * difference(1, channel)).sum::<f64>() / 3.0
    };
    let width = all.scene.picture_size().0;
    let lost = |rays: &Rays| all.volume.lost_rays(pixel % width, pixel / width, rays.green());
    Seen { errors: fewer.iter().map(error).collect(), lost_rays: halves.iter().map(lost).sum::<f64>() / 2.0 }
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

    /// What a layer has in column `x`: brightness and CoC radius, or nothing.
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

    /// A near, blurred half over a bright wall in focus …
    const NEAR_HALF: Column = |x| Some(if x < 48 { (0.2, -8.0) } else { (0.8, 0.0) });

    /// … the wall behind it …
    const WALL_BEHIND: Column = |x| (x < 48).then_some((0.5, 0.0));

    /// … and something behind the wall, that no ray reaches.
    const BEHIND_THE_WALL: Column = |_| Some((0.9, 4.0));

    #[test]
    fn what_no_ray_reaches_is_not_needed() {
        let seen = peels_seen(&[NEAR_HALF, WALL_BEHIND, BEHIND_THE_WALL]).unwrap();
        assert_eq!((seen.layers, seen.needed), (3, 2), "{seen:?}");
        assert_eq!(seen.psnr_db[1], None, "the first two show all there is to see");
        let flat = peels_seen(&[|_| Some((0.5, 3.0)), BEHIND_THE_WALL]).unwrap();
        assert_eq!((flat.needed, flat.lost_rays), (1, 0.0), "behind a surface without an edge");
    }

    #[test]
    fn what_lies_behind_a_blurred_near_edge_is_needed() {
        let seen = peels_seen(&[NEAR_HALF, WALL_BEHIND]).unwrap();
        assert_eq!(seen.needed, 2, "{seen:?}");
        assert!(!seen.wants_more(), "and is all there is: {seen:?}");
        // Of 8 columns before the edge the share of a disc beyond it sees the wall, 0.5; without it only the others, 0.2, count.
        let beyond = |d: f32| (d.acos() - d * (1.0 - d * d).sqrt()) / std::f32::consts::PI;
        let error = |i: u8| displayed(0.2 + 0.3 * beyond((f32::from(i) + 0.5) / 8.0)) - displayed(0.2);
        let mean = (0..8).map(|i| error(i).powi(2)).sum::<f32>() / WIDTH as f32;
        let expected = -10.0 * f64::from(mean).log10();
        assert!((seen.psnr_db[0].unwrap() - expected).abs() < 1.0, "expected {expected:.1} dB, {seen:?}");
    }

    #[test]
    fn rays_that_pass_the_last_layer_and_find_nothing_ask_for_more() {
        // A third surface is missing behind two near ones: of 8 columns of 96 at most half of the rays pass both.
        let second: Column = |x| (x < 48).then_some((0.4, -6.0));
        let seen = peels_seen(&[NEAR_HALF, second]).unwrap();
        assert!(seen.wants_more() && seen.lost_rays < 0.5 * 8.0 / 96.0, "{seen:?}");
    }

    #[test]
    fn rays_into_an_open_background_are_not_lost() {
        // They pass a near object, behind which the stack has fewer fragments than layers: there was nothing more.
        let first: Column = |x| match x {
            ..48 => Some((0.2, -8.0)),
            80.. => Some((0.5, 0.0)),
            _ => None,
        };
        let seen = peels_seen(&[first, |x| (x >= 80).then_some((0.5, 4.0))]).unwrap();
        assert_eq!(seen.lost_rays, 0.0, "{seen:?}");
    }

    #[test]
    fn one_layer_or_no_blur_is_not_asked() {
        assert_eq!(peels_seen(&[NEAR_HALF]), None);
        assert_eq!(peels_seen(&[|_| Some((0.5, 0.1)), BEHIND_THE_WALL]).map(|seen| seen.needed), Some(1));
        assert_eq!(peels_seen(&[|_| Some((0.5, 0.1)), |_| Some((0.5, 0.2))]), None);
    }
}
