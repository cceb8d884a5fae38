//! PROBES: estimates of a picture's sampling error, from the stack's own truth at a few hundred pixels.
//!
//! The truth at a pixel ([`truth`]) is the colour of [`crate::methods::Volume`] for a very large number of rays. The mean squared error
//! of the whole picture, and its PSNR, are estimated from squared differences to the truth at a few hundred pixels. Pixels with a high
//! variance are probed more often and have a lower weight.
//!
//! *Reuse.* The probed pixels and their truth depend on the [`Basis`] alone: one set of [`Probes`] serves any number of pictures that are
//! measured against it. [`ProbeSet`] has a set for each basis that occurs among several methods.
//!
//! *No bias.* Truth from finitely many rays has an error of its own, which would add to every difference. So the rays are split into two
//! halves `A`, `B`, independent of each other and of any method's samples, and the squared error of value `x` is estimated as
//! `(x − A)(x − B)`, whose mean is `(x − truth)²`.
//!
//! *Stratification.* Sampling errors occur where the rays of a pixel differ. Some thousands of pixels, spread over the picture, get
//! [`SPREAD_RAYS`] rays each. Pixels in focus and the others are each sorted by the variance of these rays and cut into strata of
//! equal total variance, and equally many probes are drawn from each: close to Neyman's allocation, where errors grow with the
//! variance. (Allocating half of the probes by the errors of the first half makes the interval a fifth narrower, and wrong
//! one time in ten, because rare large errors that the first half missed are then never found.)
//!
//! *Confidence interval.* The 95 % interval is Student's, with Satterthwaite's degrees of freedom, on the logarithm of the error, because
//! the error's distribution is skewed. Errors are heavy-tailed: a stratum with even samples may well have missed its rare large errors, so
//! no stratum counts as more certain than all are on average. (Without that, intervals contained the truth 90 times of 100 on renders of
//! real scenes.)
//!
//! The padding of the frame ([`crate::scene::Scene::padded`]) is visible to the rays but is not probed; a picture is estimated before it
//! is cropped to the frame.
//!
//! Cost: the rays. Memory: negligible.

mod peels;
mod truth;

#[cfg(feature = "cli")]
pub(crate) use peels::PEELS_ENOUGH_DB;
pub use peels::{PeelsSeen, peels_seen};
pub use truth::Basis;

use crate::image::Image;
use crate::methods::Plan;
use crate::parallel;
use crate::scene::{EffectKind, Scene};
use fastrand::Rng;
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};
use truth::{PixelTracer, Truth};

/// Seed of every report, so that the same pixels of a scene are probed each time.
pub const SEED: u64 = 1;

/// Number of strata.
const STRATA: usize = 10;

/// CoC radius below which a pixel counts as in focus here, in picture pixels.
const IN_FOCUS_PX: f32 = 1.0;

/// Candidate pixels per probe: enough for the size of each stratum to be practically exact.
const CANDIDATES: usize = 8;

/// Rays per candidate, from which the variance of its rays is estimated.
const SPREAD_RAYS: usize = 8;

/// Share of the mean variance that is added to that of every candidate: errors follow the variance only roughly, and pixels whose few rays
/// agree must not be left out.
const SPREAD_FLOOR: f32 = 1.0;

/// Smallest number of probes: two per stratum, since a variance needs two.
pub const MIN_PROBES: usize = 2 * STRATA;

/// Rays of each half of a truth that is accurate enough for any picture.
pub const MANY_RAYS: usize = 1024;

/// The sampling error of a picture, as estimated from probes.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct ErrorEstimate {
    /// PSNR in dB of sRGB values clipped to 0 … 1 against the stack's truth; `None` if no error is measurable.
    pub psnr_db: Option<f64>,
    /// 95 % interval of [`ErrorEstimate::psnr_db`]; its upper end is `None` where the error may be 0.
    pub interval_db: (f64, Option<f64>),
    /// Number of probed pixels.
    pub pixels: usize,
    /// Rays traced for each pixel.
    pub rays_per_pixel: usize,
}

impl ErrorEstimate {
    /// The estimate for tables: `44.1 dB (43.2 … 45.0)`.
    pub fn summary(&self) -> String {
        let (psnr, interval) = self.psnr_and_interval();
        format!("{} ({interval})", psnr.unwrap_or_else(|| "no error".to_owned()))
    }

    fn psnr_and_interval(&self) -> (Option<String>, String) {
        let (min, max) = self.interval_db;
        let max = max.map_or("any".to_owned(), |db| format!("{db:.1}"));
        (self.psnr_db.map(|db| format!("{db:.1} dB")), format!("{min:.1} … {max}"))
    }
}

impl fmt::Display for ErrorEstimate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (psnr, interval) = self.psnr_and_interval();
        let psnr = psnr.unwrap_or_else(|| "no measurable error".to_owned());
        write!(f, "{psnr} (95 % interval {interval})")
    }
}

/// The pixels of a scene's pictures that are probed, before their truth is known.
///
/// Each pixel has a random number of its own, by which it is chosen and which its rays begin with: where most of a scene stays as it was, so
/// do the probes and their noise.
#[derive(Debug)]
pub struct ProbeSites {
    /// For each stratum, its size in pixels and the pixels that are probed.
    strata: Vec<(f64, Vec<Site>)>,
    spread: f64,
}

/// A pixel, `y · width + x`, and its random number.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Site {
    pixel: usize,
    random: u64,
}

impl ProbeSites {
    /// About `count` pixels of the pictures that are measured against `basis`. The same `seed` chooses the same pixels.
    pub fn new(basis: &Basis<'_>, count: usize, seed: u64) -> Self {
        let count = count.max(MIN_PROBES);
        let candidates = candidates(&basis.tracer(), count * CANDIDATES, &mut Rng::with_seed(seed));
        let sum: f64 = candidates.iter().map(|candidate| f64::from(candidate.spread)).sum();
        let spread = sum / (3 * candidates.len().max(1)) as f64;
        let mut strata = strata(candidates, &basis.scene);
        let each = count.div_ceil(strata.len().max(1));
        for (_, sites) in &mut strata {
            sites.sort_by_key(|site| site.random);
            sites.truncate(each);
        }
        Self { strata, spread }
    }

    /// Variance of the colours of single rays of a pixel, the mean over the picture and its channels. It is
    /// the mean squared error of a picture with one ray per pixel.
    pub fn spread(&self) -> f64 {
        self.spread
    }
}

/// Pixels of a scene's picture with the stack's truth at each.
#[derive(Debug, Clone)]
pub struct Probes {
    strata: Vec<Stratum>,
    rays_per_half: usize,
}

/// A stratum of pixels, some of which are probed.
#[derive(Debug, Clone)]
struct Stratum {
    /// Number of its pixels, as estimated from the candidates.
    size: f64,
    /// The truth at each of the probed pixels.
    truths: Vec<Truth>,
}

impl Probes {
    /// Computes the truth of `basis` at `sites`, with two times `rays_per_half` rays each.
    pub fn new(basis: &Basis<'_>, sites: &ProbeSites, rays_per_half: usize) -> Self {
        let tracer = basis.tracer();
        // Other rays than those by which the pixel was chosen.
        let truth = |site: &Site| tracer.truth(site.pixel, rays_per_half, !site.random);
        let stratum = |(size, sites): &(f64, Vec<Site>)| Stratum {
            size: *size,
            truths: parallel::map(sites.len(), &|site| truth(&sites[site])),
        };
        Self { strata: sites.strata.iter().map(stratum).collect(), rays_per_half }
    }

    /// The probed pixels, `y · width + x` each.
    pub fn pixels(&self) -> Vec<usize> {
        self.strata.iter().flat_map(|stratum| stratum.truths.iter().map(Truth::pixel)).collect()
    }

    /// The error estimate for a picture whose [`Probes::pixels`] have these `values`: scene-linear red, green, blue, alpha, without the
    /// lights that the method draws exactly ([`crate::methods::LensSampling::sampled`]).
    pub fn estimate(&self, values: &[[f32; 4]]) -> ErrorEstimate {
        self.estimate_lit(values, None)
    }

    /// The error estimate for `values` that have `lights`, which are taken as exact.
    fn estimate_lit(&self, values: &[[f32; 4]], lights: Option<&Image>) -> ErrorEstimate {
        let mut rest = values;
        let errors = self.strata.iter().map(|stratum| {
            let (own, others) = rest.split_at(stratum.truths.len());
            rest = others;
            StratumErrors { size: stratum.size, errors: stratum.errors(own, lights) }
        });
        let (psnr_db, interval_db) = interval(&errors.collect::<Vec<_>>());
        ErrorEstimate { psnr_db, interval_db, pixels: values.len(), rays_per_pixel: 2 * self.rays_per_half }
    }

    /// Approximate number of rays per pixel with which the truth itself reaches `target_db`, if its squared error falls with the power
    /// `power` of that number.
    pub fn rays_for(&self, target_db: f64, power: f64) -> usize {
        let errors = self.strata.iter().map(|stratum| {
            let differences = stratum.truths.iter().map(|truth| {
                let [a, b] = truth.shown(None);
                let squares = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2));
                // Divided by two, as the difference has the errors of both halves, and by three channels.
                squares.sum::<f64>() / 6.0
            });
            StratumErrors { size: stratum.size, errors: differences.collect() }
        });
        let error = mean_error(&errors.collect::<Vec<_>>()).max(f64::MIN_POSITIVE);
        let target = 10f64.powf(-0.1 * target_db);
        let rays = self.rays_per_half as f64 * (error / target).powf(1.0 / power);
        (rays.ceil() as usize).next_power_of_two()
    }

    /// The error estimate for `image`, which has `lights` that are taken as exact.
    fn estimate_image(&self, image: &Image, lights: Option<&Image>) -> ErrorEstimate {
        let width = image.width();
        let value =
            |pixel: usize| image.planes.each_ref().map(|plane| plane.get(pixel % width, pixel / width));
        self.estimate_lit(&self.pixels().into_iter().map(value).collect::<Vec<_>>(), lights)
    }
}

/// The probes of one scene for plans of several methods. Plans that are measured against the same truth share theirs.
#[derive(Debug)]
pub struct ProbeSet<'a> {
    scene: &'a Scene,
    tracing: &'a Plan,
    /// Whether the truth has the disocclusion fill of `tracing`.
    fills: bool,
    count: usize,
    known: Mutex<Vec<(BasisKey, Arc<Probes>)>>,
}

/// What two plans have in common that are measured against the same truth: the strengths of the passes that the truth follows.
type BasisKey = [Option<f32>; 2];

impl<'a> ProbeSet<'a> {
    /// About `count` probes for each truth of `scene`, traced through the lens of `tracing`.
    pub fn new(scene: &'a Scene, tracing: &'a Plan, count: usize) -> Self {
        Self { scene, tracing, fills: false, count, known: Mutex::new(Vec::new()) }
    }

    /// The same with the disocclusion fill of the lens's plan, if that has it on.
    #[must_use]
    pub fn filled(self) -> Self {
        Self { fills: true, ..self }
    }

    /// The probes for pictures by `plan`, whose truth is computed the first time.
    pub fn of(&self, plan: &Plan) -> Arc<Probes> {
        let key = [EffectKind::Highlights, EffectKind::Resolve].map(|kind| plan.strength(kind));
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, probes)) = known.iter().find(|(other, _)| *other == key) {
            return probes.clone();
        }
        let basis = Basis::for_picture(self.scene, self.tracing, plan);
        let basis = if self.fills { basis.filled() } else { basis };
        let sites = ProbeSites::new(&basis, self.count, SEED);
        let probes = Arc::new(Probes::new(&basis, &sites, MANY_RAYS));
        known.push((key, probes.clone()));
        probes
    }

    /// The error estimate for the picture that `plan` would render, from the probed pixels alone; `None` for a method that cannot
    /// render single pixels.
    pub fn predict(&self, plan: &Plan) -> Option<ErrorEstimate> {
        let sampling = plan.method.lens_sampling()?;
        let probes = self.of(plan);
        let mut sampler = sampling.begin(self.scene.clone(), plan);
        Some(probes.estimate(&sampler.pixels(plan.lens_samples(), &probes.pixels())))
    }

    /// The error estimate for `image`, rendered by `plan`.
    #[cfg(feature = "cli")]
    pub(crate) fn estimate_image(&self, image: &Image, plan: &Plan) -> ErrorEstimate {
        self.of(plan).estimate_image(image, truth::exact_lights(self.scene, plan).as_ref())
    }
}

/// The error estimate for `image`, rendered from `scene` by `plan`, from about `probes` pixels. The truth includes the plan's disocclusion
/// fill. The same `seed` probes the same pixels.
pub fn verify(image: &Image, scene: &Scene, plan: &Plan, probes: usize, seed: u64) -> ErrorEstimate {
    let basis = Basis::new(scene, plan);
    let probes = Probes::new(&basis, &ProbeSites::new(&basis, probes, seed), MANY_RAYS);
    probes.estimate_image(image, truth::exact_lights(scene, plan).as_ref())
}

/// `count` pixels of the frame, spread over all of it; all pixels if the frame has no more.
fn candidates(tracer: &PixelTracer<'_>, count: usize, rng: &mut Rng) -> Vec<Candidate> {
    let scene = tracer.scene;
    let (width, height) = scene.frame_size();
    let (stride, [columns, rows]) = (scene.picture_size().0, scene.outside_px);
    let in_picture = |pixel: usize| (pixel / width + rows) * stride + pixel % width + columns;
    let all = width * height;
    let count = count.min(all);
    // One from each of `count` ranges of pixels of equal length.
    let seeds = (0..count).map(|i| {
        let (from, to) = (i * all / count, (i + 1) * all / count);
        (in_picture(rng.usize(from..to)), rng.u64(..))
    });
    let seeds: Vec<(usize, u64)> = seeds.collect();
    let candidate = |(pixel, random): (usize, u64)| Candidate {
        site: Site { pixel, random },
        spread: spread(tracer, pixel, &mut Rng::with_seed(random)),
        in_focus: in_focus(scene, pixel % stride, pixel / stride),
    };
    parallel::map(seeds.len(), &|seed| candidate(seeds[seed]))
}

/// Variance of the colours of single rays of a pixel, summed over the channels.
fn spread(tracer: &PixelTracer<'_>, pixel: usize, rng: &mut Rng) -> f32 {
    let rays = tracer.rays(SPREAD_RAYS, rng);
    let width = tracer.scene.picture_size().0;
    let passes = |i: &usize| tracer.volume.passes_barrel(pixel % width, pixel / width, &rays.green()[*i]);
    let passing = (0..SPREAD_RAYS).filter(passes);
    let colors: Vec<[f32; 3]> = passing.map(|i| tracer.color(pixel, &rays.single(i))).collect();
    let mean =
        |value: &dyn Fn(&[f32; 3]) -> f32| colors.iter().map(value).sum::<f32>() / colors.len().max(1) as f32;
    let variance = |k: usize| {
        let centre = mean(&|color| color[k]);
        mean(&|color| (color[k] - centre).powi(2))
    };
    variance(0) + variance(1) + variance(2)
}

impl Stratum {
    /// Unbiased estimates of the squared error of `values`, which have `lights`, one for each probed pixel: means over the three channels.
    fn errors(&self, values: &[[f32; 4]], lights: Option<&Image>) -> Vec<f64> {
        let squared_error = |(&value, truth): (&[f32; 4], &Truth)| {
            let (shown, [a, b]) = (truth::to_display(value), truth.shown(lights));
            let channel = |k: usize| f64::from(shown[k] - a[k]) * f64::from(shown[k] - b[k]);
            (channel(0) + channel(1) + channel(2)) / 3.0
        };
        values.iter().zip(&self.truths).map(squared_error).collect()
    }
}

/// A pixel that may be probed.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Candidate {
    site: Site,
    /// Variance of its rays.
    spread: f32,
    in_focus: bool,
}

/// Whether the visible surface of a pixel is in focus.
fn in_focus(scene: &Scene, x: usize, y: usize) -> bool {
    let (x, y) = (x * scene.supersample, y * scene.supersample);
    let visible = scene.layers.iter().find(|layer| layer.alpha.get(x, y) > 0.0);
    visible.is_some_and(|layer| layer.coc_px.get(x, y).abs() < IN_FOCUS_PX)
}

/// `candidates` in strata, in focus and out of focus, of falling variance and about equal total variance: for each its size in pixels of
/// the frame, in proportion to its number of candidates, and its candidates.
fn strata(candidates: Vec<Candidate>, scene: &Scene) -> Vec<(f64, Vec<Site>)> {
    let (width, height) = scene.frame_size();
    let pixels_each = (width * height) as f64 / candidates.len().max(1) as f64;
    let (focused, blurred): (Vec<_>, Vec<_>) =
        candidates.into_iter().partition(|candidate| candidate.in_focus);
    let strata = [focused, blurred].into_iter().flat_map(strata_of_equal_spread);
    strata.map(|sites| (sites.len() as f64 * pixels_each, sites)).collect()
}

/// `candidates` in half of [`STRATA`] strata of falling variance and about equal total variance.
fn strata_of_equal_spread(mut candidates: Vec<Candidate>) -> Vec<Vec<Site>> {
    const COUNT: usize = STRATA / 2;
    let total: f64 = candidates.iter().map(|candidate| f64::from(candidate.spread)).sum();
    let floor = (f64::from(SPREAD_FLOOR) * total / candidates.len().max(1) as f64).max(f64::MIN_POSITIVE);
    // A stable sort, so that the strata do not depend on the number of threads.
    candidates.sort_by(|a, b| b.spread.total_cmp(&a.spread));
    let whole = total + floor * candidates.len() as f64;
    let mut strata = vec![Vec::new(); COUNT];
    let mut sum = 0.0;
    for Candidate { site, spread, .. } in candidates {
        let stratum = (sum / whole * COUNT as f64) as usize;
        strata[stratum.min(COUNT - 1)].push(site);
        sum += f64::from(spread) + floor;
    }
    strata.retain(|sites| !sites.is_empty());
    strata
}

/// Squared errors of the probed pixels of a stratum.
#[derive(Debug, Clone, PartialEq)]
struct StratumErrors {
    /// Number of pixels of the stratum.
    size: f64,
    errors: Vec<f64>,
}

impl StratumErrors {
    fn mean(&self) -> f64 {
        self.errors.iter().sum::<f64>() / self.errors.len() as f64
    }

    /// Share of the pixels that were not probed.
    fn unprobed(&self) -> f64 {
        (1.0 - self.errors.len() as f64 / self.size).max(0.0)
    }

    /// Variance of [`StratumErrors::mean`]; 0 if every pixel was probed.
    fn variance(&self) -> f64 {
        let (count, mean) = (self.errors.len() as f64, self.mean());
        let squares: f64 = self.errors.iter().map(|error| (error - mean).powi(2)).sum();
        squares / (count - 1.0).max(1.0) / count * self.unprobed()
    }
}

/// The mean squared error of the whole picture.
fn mean_error(strata: &[StratumErrors]) -> f64 {
    let pixels: f64 = strata.iter().map(|stratum| stratum.size).sum();
    strata.iter().map(|stratum| stratum.size / pixels * stratum.mean()).sum()
}

/// The relative variance of a stratum's mean error, variance over squared mean and at most 1, averaged over the strata.
fn mean_relative_variance(strata: &[StratumErrors]) -> f64 {
    let with_error = strata.iter().filter(|stratum| stratum.mean() > 0.0);
    let relative: Vec<f64> = with_error.map(|s| (s.variance() / s.mean().powi(2)).min(1.0)).collect();
    relative.iter().sum::<f64>() / relative.len().max(1) as f64
}

/// PSNR and its 95 % interval.
fn interval(strata: &[StratumErrors]) -> (Option<f64>, (f64, Option<f64>)) {
    let pixels: f64 = strata.iter().map(|stratum| stratum.size).sum();
    let share = |stratum: &StratumErrors| stratum.size / pixels;
    let error = mean_error(strata);
    let relative = mean_relative_variance(strata);
    let part = |s: &StratumErrors| {
        let variance = s.variance().max(relative * s.unprobed() * s.mean().powi(2));
        (share(s).powi(2) * variance, s.errors.len() as f64 - 1.0)
    };
    let parts: Vec<(f64, f64)> = strata.iter().map(part).collect();
    let variance: f64 = parts.iter().map(|part| part.0).sum();
    // Degrees of freedom of a weighted sum of variances, after Satterthwaite.
    let freedom = variance.powi(2) / parts.iter().map(|(v, n)| v * v / n.max(1.0)).sum::<f64>();
    let quantile = if freedom.is_finite() { student_975(freedom.max(1.0)) } else { 0.0 };
    let db = |error: f64| -10.0 * error.max(1e-20).log10();
    let spread = variance.sqrt();
    if error <= 0.0 || spread >= error {
        // The error may be 0: only its upper bound is known.
        return ((error > 0.0).then(|| db(error)), (db(error.max(0.0) + quantile * spread), None));
    }
    let step = quantile * (1.0 + (spread / error).powi(2)).ln().sqrt();
    (Some(db(error)), (db(error * step.exp()), Some(db(error * (-step).exp()))))
}

/// The 97.5 % quantile of Student's distribution: Cornish and Fisher's expansion about the normal distribution, accurate to 1 % from
/// three degrees of freedom on.
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
    fn students_quantile_matches_the_tables() {
        for (freedom, expected) in [(3.0, 3.182), (5.0, 2.571), (10.0, 2.228), (30.0, 2.042), (1e9, 1.960)] {
            let found = student_975(freedom);
            assert!(
                (found / expected - 1.0).abs() < 0.015,
                "{freedom} degrees: {found}, expected {expected}"
            );
        }
    }

    fn stratum(size: f64, errors: Vec<f64>) -> StratumErrors {
        StratumErrors { size, errors }
    }

    #[test]
    fn strata_have_every_pixel_once_and_about_equal_spread() {
        let spread = |pixel: usize| if pixel / 50 == 3 { 1.0 } else { (pixel % 50) as f32 * 1e-3 };
        let site = |pixel| Site { pixel, random: 0 };
        let candidate = |pixel| Candidate { site: site(pixel), spread: spread(pixel), in_focus: false };
        let strata: Vec<Vec<usize>> = strata_of_equal_spread((0..1000).map(candidate).collect())
            .into_iter()
            .map(|sites| sites.into_iter().map(|site| site.pixel).collect())
            .collect();
        let mut all: Vec<usize> = strata.iter().flatten().copied().collect();
        all.sort_unstable();
        assert_eq!(all, (0..1000).collect::<Vec<_>>(), "every pixel once");
        assert!(strata[0].len() < strata[strata.len() - 1].len() / 4, "strata of high variance are small");
        assert!(strata[0].iter().all(|pixel| pixel / 50 == 3), "the bright row comes first");
    }

    #[test]
    fn a_stratum_is_weighted_by_its_pixels_and_not_by_its_probes() {
        // 100 pixels of error 0.01 and 900 of none: MSE 1e-3, 30 dB.
        let (db, (low, high)) = interval(&[stratum(100.0, vec![0.01; 50]), stratum(900.0, vec![0.0; 50])]);
        assert!((db.unwrap() - 30.0).abs() < 1e-9);
        assert!((low - 30.0).abs() < 1e-9 && (high.unwrap() - 30.0).abs() < 1e-9, "no variance, no interval");
    }

    #[test]
    fn the_interval_of_an_error_that_may_be_zero_has_no_upper_end() {
        let (db, (low, high)) = interval(&[stratum(1000.0, vec![1e-6, -1e-6, 1e-6, -1.1e-6])]);
        assert_eq!((db, high), (None, None));
        assert!(low > 50.0, "the error is small: {low}");
    }

    #[test]
    fn a_fully_probed_stratum_has_no_variance() {
        let whole = stratum(3.0, vec![1.0, 2.0, 3.0]);
        assert_eq!((whole.mean(), whole.variance()), (2.0, 0.0));
    }
}
