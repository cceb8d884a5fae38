//! PROBES: the sampling error of a picture, from the stack's own truth at a few hundred of its pixels.
//!
//! The truth at a pixel is what [`crate::methods::Volume`] says of it with very many rays. Squared differences to it at a few
//! hundred pixels, drawn so that busy places are looked at more often and counted accordingly less, estimate the mean squared
//! error of the whole picture, and with it its PSNR.
//!
//! *Without bias.* Truth from finitely many rays is itself off, which would add to every difference. So the rays come in two
//! halves `A`, `B`, independent of each other and of any method's samples, and the squared error of value `x` is estimated as
//! `(x − A)(x − B)`, whose mean is `(x − truth)²`.
//!
//! *Where.* Errors of sampling live where pictures are busy, and differ in focus and out of it. The pixels in focus and the
//! others are each sorted by local contrast and cut into strata of equal total contrast, from each of which equally many are
//! drawn: near to Neyman's allocation, where errors grow with contrast. (Sharing out half of the probes by the errors
//! that the first half found makes the interval a fifth narrower, and wrong one time in ten: rare large errors that the first
//! half missed are then never looked for.)
//!
//! *How sure.* The 95 % interval is Student's, with Satterthwaite's degrees of freedom, on the logarithm of the error, which is
//! lopsided. Cost: the rays. Memory: three planes and the reach of each fragment.

use crate::image::{Image, Plane};
use crate::lens::{View, moved_views};
use crate::methods::Volume;
use crate::metrics::{Rgb, display};
use crate::scene::{Plan, Scene};
use fastrand::Rng;
use glam::Vec2;
use rayon::prelude::*;
use std::f32::consts::TAU;

/// Seed of every report: the same picture is looked at in the same places.
pub const SEED: u64 = 1;

/// Strata that the pixels are cut into.
const STRATA: usize = 10;

/// CoC radius below which a pixel counts as in focus here.
const IN_FOCUS_PX: f32 = 1.0;

/// Share of the mean contrast that every pixel has at least, so that no place is left out.
const FLOOR: f32 = 0.5;

/// Fewest probes: two a stratum, below which there is no variance.
pub const FEWEST_PROBES: usize = 2 * STRATA;

/// What the probes say of a picture.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Verdict {
    /// PSNR in dB of sRGB values clipped to 0 … 1 against the stack's truth; `None` if the error is below what can be seen.
    pub psnr_db: Option<f64>,
    /// 95 % interval of [`Verdict::psnr_db`]; its upper end is `None` where the error may be nothing at all.
    pub interval_db: (f64, Option<f64>),
    /// Pixels looked at.
    pub pixels: usize,
    /// Rays traced for each.
    pub rays_per_pixel: usize,
}

/// Looks at about `probes` pixels of `image`, the picture of `scene` as `plan` has it. The same `seed` looks at the same pixels.
pub fn verify(image: &Image, scene: &Scene, plan: &Plan, probes: usize, seed: u64) -> Verdict {
    let shown = display(&[0, 1, 2].map(|k| image.planes[k].clone()));
    let volume = Volume::new(scene, plan);
    let look = Look { volume: &volume, shown: &shown, plan };
    let mut rng = Rng::with_seed(seed);
    let mut strata = strata(&contrast(&shown), scene);
    strata.iter_mut().for_each(|stratum| rng.shuffle(&mut stratum.pixels));
    let probes = probes.max(FEWEST_PROBES);
    let each = probes.div_ceil(strata.len().max(1));
    for stratum in &mut strata {
        look.at(stratum, each, &mut rng);
    }
    let (psnr_db, interval_db) = interval(&strata);
    Verdict {
        psnr_db,
        interval_db,
        pixels: strata.iter().map(|stratum| stratum.errors.len()).sum(),
        rays_per_pixel: 2 * look.half(&mut rng).len(),
    }
}

/// What it takes to look at a pixel.
struct Look<'a> {
    volume: &'a Volume<'a>,
    shown: &'a Rgb,
    plan: &'a Plan,
}

impl Look<'_> {
    /// Looks at the first `count` pixels of `stratum`, as far as it has them.
    fn at(&self, stratum: &mut Stratum, count: usize, rng: &mut Rng) {
        let seeds: Vec<(usize, u64)> =
            stratum.pixels.iter().take(count).map(|&pixel| (pixel, rng.u64(..))).collect();
        stratum.errors = seeds.into_par_iter().map(|(pixel, seed)| self.squared_error(pixel, seed)).collect();
    }

    /// An unbiased estimate of the squared error of pixel `pixel`, mean of its three channels.
    fn squared_error(&self, pixel: usize, seed: u64) -> f64 {
        let mut rng = Rng::with_seed(seed);
        let width = self.shown[0].width();
        let (x, y) = (pixel % width, pixel / width);
        let halves: [Rgb; 2] = std::array::from_fn(|_| {
            let [r, g, b, _] = self.volume.pixel(x, y, &self.half(&mut rng));
            display(&[r, g, b].map(|value| Plane::filled(1, 1, value)))
        });
        let channel = |k: usize| {
            let value = self.shown[k].get(x, y);
            let [a, b] = halves.each_ref().map(|half| f64::from(value - half[k].get(0, 0)));
            a * b
        };
        (channel(0) + channel(1) + channel(2)) / 3.0
    }

    /// Half the rays of a pixel, unlike any others.
    fn half(&self, rng: &mut Rng) -> Vec<View> {
        moved_views(self.plan.aperture, rng.f32() * TAU, Vec2::new(rng.f32(), rng.f32()))
    }
}

/// Squared local contrast of each pixel: of the largest difference to one of its neighbours, in any channel.
fn contrast(shown: &Rgb) -> Plane {
    let (width, height) = (shown[0].width(), shown[0].height());
    let mut contrast = Plane::zeros(width, height);
    contrast.values_mut().par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        for (x, value) in row.iter_mut().enumerate() {
            let columns = x.saturating_sub(1)..(x + 2).min(width);
            for plane in shown {
                let own = plane.get(x, y);
                for ny in rows.clone() {
                    let neighbours = &plane.row(ny)[columns.clone()];
                    *value = neighbours.iter().fold(*value, |most, other| most.max((other - own).powi(2)));
                }
            }
        }
    });
    contrast
}

/// Pixels of one kind.
#[derive(Debug, Clone, PartialEq, Default)]
struct Stratum {
    /// Those that it has, in the order in which they are looked at.
    pixels: Vec<usize>,
    /// Estimates of the squared error of the first of them.
    errors: Vec<f64>,
}

/// The pixels of a picture of `scene` with this `contrast` in strata, in focus and out of it, of falling contrast and about
/// equal total contrast.
fn strata(contrast: &Plane, scene: &Scene) -> Vec<Stratum> {
    let values = contrast.values();
    let (focused, blurred) = (0..values.len()).partition(|&pixel| in_focus(scene, pixel));
    [focused, blurred].into_iter().flat_map(|pixels| of_equal_contrast(pixels, values)).collect()
}

/// Whether the camera sees something in focus at a pixel.
fn in_focus(scene: &Scene, pixel: usize) -> bool {
    let (width, s) = (scene.picture_size().0, scene.supersample);
    let (x, y) = (pixel % width * s, pixel / width * s);
    let seen = scene.layers.iter().find(|layer| layer.alpha.get(x, y) > 0.0);
    seen.is_some_and(|layer| layer.coc_px.get(x, y).abs() < IN_FOCUS_PX)
}

/// `pixels` in half of [`STRATA`] strata of falling contrast `values` and about equal total contrast.
fn of_equal_contrast(mut pixels: Vec<usize>, values: &[f32]) -> Vec<Stratum> {
    const COUNT: usize = STRATA / 2;
    let total: f64 = pixels.iter().map(|&pixel| f64::from(values[pixel])).sum();
    let floor = (f64::from(FLOOR) * total / pixels.len().max(1) as f64).max(f64::MIN_POSITIVE);
    // Equal contrasts keep their order, so that the strata do not depend on the number of threads.
    pixels.par_sort_by(|&a, &b| values[b].total_cmp(&values[a]));
    let whole = total + floor * pixels.len() as f64;
    let mut strata = vec![Stratum::default(); COUNT];
    let mut sum = 0.0;
    for pixel in pixels {
        let stratum = (sum / whole * COUNT as f64) as usize;
        strata[stratum.min(COUNT - 1)].pixels.push(pixel);
        sum += f64::from(values[pixel]) + floor;
    }
    strata.retain(|stratum| !stratum.pixels.is_empty());
    strata
}

impl Stratum {
    fn mean(&self) -> f64 {
        self.errors.iter().sum::<f64>() / self.errors.len() as f64
    }

    /// Variance of [`Stratum::mean`], which is 0 once every pixel was looked at.
    fn variance(&self) -> f64 {
        let (count, mean) = (self.errors.len() as f64, self.mean());
        let squares: f64 = self.errors.iter().map(|error| (error - mean).powi(2)).sum();
        squares / (count - 1.0).max(1.0) / count * (1.0 - count / self.pixels.len() as f64)
    }
}

/// PSNR and its 95 % interval from what was found.
fn interval(strata: &[Stratum]) -> (Option<f64>, (f64, Option<f64>)) {
    let pixels: usize = strata.iter().map(|stratum| stratum.pixels.len()).sum();
    let share = |stratum: &Stratum| stratum.pixels.len() as f64 / pixels as f64;
    let error: f64 = strata.iter().map(|s| share(s) * s.mean()).sum();
    let parts: Vec<(f64, f64)> =
        strata.iter().map(|s| (share(s).powi(2) * s.variance(), s.errors.len() as f64 - 1.0)).collect();
    let variance: f64 = parts.iter().map(|part| part.0).sum();
    // Satterthwaite: the degrees of freedom of a weighted sum of variances.
    let freedom = variance.powi(2) / parts.iter().map(|(v, n)| v * v / n.max(1.0)).sum::<f64>();
    let quantile = if freedom.is_finite() { student_975(freedom.max(1.0)) } else { 0.0 };
    let db = |error: f64| -10.0 * error.max(1e-20).log10();
    let spread = variance.sqrt();
    if error <= 0.0 || spread >= error {
        // The error may be nothing: only how large it could be is known.
        return ((error > 0.0).then(|| db(error)), (db(error.max(0.0) + quantile * spread), None));
    }
    let step = quantile * (1.0 + (spread / error).powi(2)).ln().sqrt();
    (Some(db(error)), (db(error * step.exp()), Some(db(error * (-step).exp()))))
}

/// The 97.5 % quantile of Student's distribution: Cornish and Fisher's expansion about the normal one, within 1 % from three
/// degrees of freedom on.
fn student_975(freedom: f64) -> f64 {
    let z: f64 = 1.959_963_985;
    let term = |power: i32| z.powi(power);
    let first = (term(3) + z) / 4.0;
    let second = (5.0 * term(5) + 16.0 * term(3) + 3.0 * z) / 96.0;
    let third = (3.0 * term(7) + 19.0 * term(5) + 17.0 * term(3) - 15.0 * z) / 384.0;
    z + first / freedom + second / freedom.powi(2) + third / freedom.powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn students_quantile_is_that_of_the_tables() {
        for (freedom, expected) in [(3.0, 3.182), (5.0, 2.571), (10.0, 2.228), (30.0, 2.042), (1e9, 1.960)] {
            let found = student_975(freedom);
            assert!(
                (found / expected - 1.0).abs() < 0.015,
                "{freedom} degrees: {found}, expected {expected}"
            );
        }
    }

    fn stratum(pixels: usize, errors: Vec<f64>) -> Stratum {
        Stratum { pixels: (0..pixels).collect(), errors }
    }

    #[test]
    fn strata_hold_every_pixel_once_and_share_the_contrast() {
        let contrast = Plane::from_fn(50, 20, |x, y| if y == 3 { 1.0 } else { x as f32 * 1e-3 });
        let strata = of_equal_contrast((0..1000).collect(), contrast.values());
        let mut all: Vec<usize> = strata.iter().flat_map(|stratum| stratum.pixels.clone()).collect();
        all.sort_unstable();
        assert_eq!(all, (0..1000).collect::<Vec<_>>(), "every pixel once");
        assert!(strata[0].pixels.len() < strata[strata.len() - 1].pixels.len() / 4, "busy strata are small");
        assert!(strata[0].pixels.iter().all(|pixel| pixel / 50 == 3), "the bright row comes first");
    }

    #[test]
    fn a_stratum_counts_for_its_pixels_and_not_for_its_probes() {
        // 100 pixels of error 0.01 and 900 of none: MSE 1e-3, 30 dB.
        let (db, (low, high)) = interval(&[stratum(100, vec![0.01; 50]), stratum(900, vec![0.0; 50])]);
        assert!((db.unwrap() - 30.0).abs() < 1e-9);
        assert!((low - 30.0).abs() < 1e-9 && (high.unwrap() - 30.0).abs() < 1e-9, "no variance, no interval");
    }

    #[test]
    fn an_error_that_may_be_nothing_has_no_upper_end() {
        let (db, (low, high)) = interval(&[stratum(1000, vec![1e-6, -1e-6, 1e-6, -1.1e-6])]);
        assert_eq!((db, high), (None, None));
        assert!(low > 50.0, "but it is not large: {low}");
    }

    #[test]
    fn a_stratum_looked_at_whole_is_known() {
        let whole = stratum(3, vec![1.0, 2.0, 3.0]);
        assert_eq!((whole.mean(), whole.variance()), (2.0, 0.0));
    }
}
