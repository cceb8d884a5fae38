//! PROBES: the sampling error of any picture, from the stack's own truth at a few hundred pixels.
//!
//! The truth at a pixel is what [`crate::methods::Volume`] says of it with very many rays. Squared differences to it at a few
//! hundred pixels, drawn so that busy places are looked at more often and counted accordingly less, estimate the mean squared
//! error of the whole picture, and with it its PSNR.
//!
//! *Once.* Where to look and what the truth is are decided by the stack alone: one set of [`Probes`] serves any number of
//! pictures of a scene, by any method.
//!
//! *Without bias.* Truth from finitely many rays is itself off, which would add to every difference. So the rays come in two
//! halves `A`, `B`, independent of each other and of any method's samples, and the squared error of value `x` is estimated as
//! `(x − A)(x − B)`, whose mean is `(x − truth)²`.
//!
//! *Where.* Errors of sampling live where a pixel's rays see different things. Some thousands of pixels, spread over the picture, get
//! [`SPREAD_RAYS`] rays each; those in focus and the others are each sorted by how much these rays differ and cut into strata of
//! equal total spread, from each of which equally many are drawn: near to Neyman's allocation, where errors grow with the
//! spread. (Sharing out half of the probes by the errors that the first half found makes the interval a fifth narrower, and wrong
//! one time in ten: rare large errors that the first half missed are then never looked for.)
//!
//! *How sure.* The 95 % interval is Student's, with Satterthwaite's degrees of freedom, on the logarithm of the error, which is
//! lopsided. Errors are heavy-tailed: a stratum that looks even has as likely as not hidden its rare large ones, so none counts as
//! more certain than all are on the mean. (Without that, intervals held the truth 90 times of 100 on renders of real scenes.)
//!
//! What lies beyond the frame ([`crate::scene::Scene::padded`]) is there for the rays, and is not looked at itself; a picture is judged before it
//! is cut to the frame.
//!
//! Cost: the rays. Memory: next to none.

mod peels;

#[cfg(feature = "cli")]
pub(crate) use peels::PEELS_ENOUGH_DB;
pub use peels::{PeelsSeen, peels_seen};

use crate::error::Error;
use crate::image::Image;
use crate::lens::Rays;
use crate::methods::Plan;
use crate::methods::Volume;
use crate::metrics::displayed;
use crate::scene::{EffectKind, Layer, Scene};
use fastrand::Rng;
use glam::Vec2;
use rayon::prelude::*;
use std::borrow::Cow;
use std::f32::consts::TAU;
use std::fmt;

/// Seed of every report: the same scene is looked at in the same places.
pub const SEED: u64 = 1;

/// Strata that the pixels are cut into.
const STRATA: usize = 10;

/// CoC radius below which a pixel counts as in focus here.
const IN_FOCUS_PX: f32 = 1.0;

/// Pixels among which each probe is chosen: enough that what share of the picture each stratum is, is as good as known.
const CANDIDATES: usize = 8;

/// Rays that tell how much the rays of a pixel differ.
const SPREAD_RAYS: usize = 8;

/// This share of the mean spread is added to every pixel's: errors follow the spread only roughly, and places that seem even must not be
/// left out.
const FLOOR: f32 = 1.0;

/// Fewest probes: two a stratum, below which there is no variance.
pub const MIN_PROBES: usize = 2 * STRATA;

/// Rays of each half of a truth that is to serve any picture, however good.
pub const MANY_RAYS: usize = 1024;

/// What the probes say of a picture.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct ErrorEstimate {
    /// PSNR in dB of sRGB values clipped to 0 … 1 against the stack's truth; `None` if the error is below what can be seen.
    pub psnr_db: Option<f64>,
    /// 95 % interval of [`ErrorEstimate::psnr_db`]; its upper end is `None` where the error may be nothing at all.
    pub interval_db: (f64, Option<f64>),
    /// Pixels looked at.
    pub pixels: usize,
    /// Rays traced for each.
    pub rays_per_pixel: usize,
}

impl ErrorEstimate {
    /// For tables: `44.1 dB (43.2 … 45.0)`.
    pub fn in_short(&self) -> String {
        let (found, interval) = self.in_words();
        format!("{} ({interval})", found.unwrap_or_else(|| "none seen".to_owned()))
    }

    fn in_words(&self) -> (Option<String>, String) {
        let (least, most) = self.interval_db;
        let most = most.map_or("any".to_owned(), |db| format!("{db:.1}"));
        (self.psnr_db.map(|db| format!("{db:.1} dB")), format!("{least:.1} … {most}"))
    }
}

impl fmt::Display for ErrorEstimate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (found, interval) = self.in_words();
        let found = found.unwrap_or_else(|| "an error not to be told from nothing".to_owned());
        write!(f, "{found} (with 95 % certainty {interval})")
    }
}

/// Where to look at the pictures of a scene.
#[derive(Debug)]
pub struct Places<'a> {
    look: Look<'a>,
    /// Of each stratum, how many pixels it has and those that are looked at.
    strata: Vec<(f64, Vec<usize>)>,
    spread: f64,
    rng: Rng,
}

impl<'a> Places<'a> {
    /// About `count` pixels of `scene` as `plan` has it. The same `seed` chooses the same pixels.
    pub fn new(scene: &'a Scene, plan: &'a Plan, count: usize, seed: u64) -> Self {
        let mut rng = Rng::with_seed(seed);
        let count = count.max(MIN_PROBES);
        let look = Look { scene, volume: Volume::new(scene, plan), plan };
        let candidates = look.candidates(count * CANDIDATES, &mut rng);
        let sum: f64 = candidates.iter().map(|candidate| f64::from(candidate.spread)).sum();
        let spread = sum / (3 * candidates.len().max(1)) as f64;
        let mut strata = strata(candidates, scene);
        let each = count.div_ceil(strata.len().max(1));
        for (_, pixels) in &mut strata {
            rng.shuffle(pixels);
            pixels.truncate(each);
        }
        Self { look, strata, spread, rng }
    }

    /// How much single rays of a pixel differ: the variance of what they show, the mean over the picture and its channels. It is
    /// the squared error of a picture of one ray a pixel.
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

/// Pixels of one kind, some of them looked at.
#[derive(Debug, Clone, PartialEq, Default)]
struct Stratum {
    /// How many there are: as the candidates tell.
    size: f64,
    /// Those that are looked at: `y · width + x`.
    pixels: Vec<usize>,
    /// The truth at each of these: of two halves of rays, display-encoded.
    truths: Vec<[[f32; 3]; 2]>,
}

impl Probes {
    /// Looks at the pixels `places`, with two times `rays_per_half` rays each.
    pub fn new(places: Places<'_>, rays_per_half: usize) -> Self {
        let Places { look, strata, mut rng, .. } = places;
        let stratum = |(size, pixels): (f64, Vec<usize>)| {
            let seeds: Vec<(usize, u64)> = pixels.iter().map(|&pixel| (pixel, rng.u64(..))).collect();
            let truth = |(pixel, seed)| look.truth(pixel, rays_per_half, seed);
            Stratum { size, truths: seeds.into_par_iter().map(truth).collect(), pixels }
        };
        Self { strata: strata.into_iter().map(stratum).collect(), rays_per_half }
    }

    /// The pixels that are looked at, `y · width + x` each.
    pub fn pixels(&self) -> Vec<usize> {
        self.strata.iter().flat_map(|stratum| stratum.pixels.iter().copied()).collect()
    }

    /// What is to be said of a picture whose [`Probes::pixels`] have these `values`: scene-linear red, green, blue, alpha.
    pub fn estimate(&self, values: &[[f32; 4]]) -> ErrorEstimate {
        let mut rest = values;
        let errors = self.strata.iter().map(|stratum| {
            let (own, others) = rest.split_at(stratum.pixels.len());
            rest = others;
            StratumErrors { size: stratum.size, errors: stratum.errors(own) }
        });
        let (psnr_db, interval_db) = interval(&errors.collect::<Vec<_>>());
        ErrorEstimate { psnr_db, interval_db, pixels: values.len(), rays_per_pixel: 2 * self.rays_per_half }
    }

    /// What is to be said of the picture that `plan` would make of `scene`, without making it; `None` where its method cannot be asked
    /// for single pixels.
    ///
    /// # Errors
    /// An unknown method.
    pub fn foresee(&self, scene: &Scene, plan: &Plan) -> Result<Option<ErrorEstimate>, Error> {
        let Some(sampling) = plan.method.lens_sampling() else {
            return Ok(None);
        };
        let values = sampling.begin(scene.clone(), plan).pixels(plan.lens_samples(), &self.pixels());
        Ok(Some(self.estimate(&values)))
    }

    /// About how many rays a pixel bring the truth itself to `target_db`, if its squared error falls with the power `power` of their
    /// number.
    pub fn rays_for(&self, target_db: f64, power: f64) -> usize {
        let errors = self.strata.iter().map(|stratum| {
            let differences = stratum.truths.iter().map(|[a, b]| {
                let squares = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2));
                // The difference has the errors of both halves.
                squares.sum::<f64>() / 6.0
            });
            StratumErrors { size: stratum.size, errors: differences.collect() }
        });
        let error = mean_error(&errors.collect::<Vec<_>>()).max(f64::MIN_POSITIVE);
        let wanted = 10f64.powf(-0.1 * target_db);
        let rays = self.rays_per_half as f64 * (error / wanted).powf(1.0 / power);
        (rays.ceil() as usize).next_power_of_two()
    }

    /// What is to be said of `image`.
    pub(crate) fn estimate_image(&self, image: &Image) -> ErrorEstimate {
        let width = image.width();
        let value =
            |pixel: usize| image.planes.each_ref().map(|plane| plane.get(pixel % width, pixel / width));
        self.estimate(&self.pixels().into_iter().map(value).collect::<Vec<_>>())
    }
}

/// `scene` with the surfaces that `plan` guesses, if it does: a guess is no error of a picture's samples.
pub fn with_guesses<'a>(scene: &'a Scene, plan: &Plan) -> Cow<'a, Scene> {
    if plan.does(EffectKind::Fill) { Cow::Owned(scene.clone().filled()) } else { Cow::Borrowed(scene) }
}

/// Looks at about `probes` pixels of `image`, the picture of `scene` as `plan` has it, guesses included. The same `seed` looks
/// at the same pixels.
pub fn verify(image: &Image, scene: &Scene, plan: &Plan, probes: usize, seed: u64) -> ErrorEstimate {
    let scene = &*with_guesses(scene, plan);
    Probes::new(Places::new(scene, plan, probes, seed), MANY_RAYS).estimate_image(image)
}

/// `color` as a display shows it.
fn shown([r, g, b, _]: [f32; 4]) -> [f32; 3] {
    [r, g, b].map(displayed)
}

/// What it takes to look at a pixel.
#[derive(Debug)]
struct Look<'a> {
    scene: &'a Scene,
    volume: Volume<&'a Layer>,
    plan: &'a Plan,
}

impl Look<'_> {
    /// `count` pixels of the frame, spread over all of it; all of them, if it has no more.
    fn candidates(&self, count: usize, rng: &mut Rng) -> Vec<Candidate> {
        let (width, height) = self.scene.frame_size();
        let (stride, [columns, rows]) = (self.scene.picture_size().0, self.scene.outside_px);
        let in_picture = |pixel: usize| (pixel / width + rows) * stride + pixel % width + columns;
        let all = width * height;
        let count = count.min(all);
        // One from each of `count` equal stretches of pixels.
        let places = (0..count).map(|i| {
            let (from, to) = (i * all / count, (i + 1) * all / count);
            (in_picture(rng.usize(from..to)), rng.u64(..))
        });
        let places: Vec<(usize, u64)> = places.collect();
        let candidate = |(pixel, seed): (usize, u64)| Candidate {
            pixel,
            spread: self.spread(pixel, &mut Rng::with_seed(seed)),
            in_focus: in_focus(self.scene, pixel % stride, pixel / stride),
        };
        places.into_par_iter().map(candidate).collect()
    }

    /// How much single rays of a pixel differ: the variance of what they show, summed over the channels.
    fn spread(&self, pixel: usize, rng: &mut Rng) -> f32 {
        let rays = self.rays(SPREAD_RAYS, rng);
        let width = self.scene.picture_size().0;
        let passes = |i: &usize| self.volume.passes_barrel(pixel % width, pixel / width, &rays.green()[*i]);
        let passing = (0..SPREAD_RAYS).filter(passes);
        let colors: Vec<[f32; 3]> = passing.map(|i| self.shown(pixel, &rays.single(i))).collect();
        let mean = |value: &dyn Fn(&[f32; 3]) -> f32| {
            colors.iter().map(value).sum::<f32>() / colors.len().max(1) as f32
        };
        let variance = |k: usize| {
            let centre = mean(&|color| color[k]);
            mean(&|color| (color[k] - centre).powi(2))
        };
        variance(0) + variance(1) + variance(2)
    }

    /// What `rays` show at a pixel.
    fn shown(&self, pixel: usize, rays: &Rays) -> [f32; 3] {
        let width = self.scene.picture_size().0;
        shown(self.volume.pixel(pixel % width, pixel / width, rays))
    }

    /// What two halves of the rays say of pixel `pixel`.
    fn truth(&self, pixel: usize, rays_per_half: usize, seed: u64) -> [[f32; 3]; 2] {
        let mut rng = Rng::with_seed(seed);
        std::array::from_fn(|_| self.shown(pixel, &self.rays(rays_per_half, &mut rng)))
    }

    /// Rays of a pixel, unlike any others.
    fn rays(&self, count: usize, rng: &mut Rng) -> Rays {
        let (angle, shift) = (rng.f32() * TAU, Vec2::new(rng.f32(), rng.f32()));
        self.plan.optics.moved_rays(count, angle, shift)
    }
}

impl Stratum {
    /// Unbiased estimates of the squared error of `values`, one for each pixel looked at: means over the three channels.
    fn errors(&self, values: &[[f32; 4]]) -> Vec<f64> {
        let squared_error = |(&value, [a, b]): (&[f32; 4], &[[f32; 3]; 2])| {
            let shown = shown(value);
            let channel = |k: usize| f64::from(shown[k] - a[k]) * f64::from(shown[k] - b[k]);
            (channel(0) + channel(1) + channel(2)) / 3.0
        };
        values.iter().zip(&self.truths).map(squared_error).collect()
    }
}

/// A pixel that may be looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Candidate {
    pixel: usize,
    /// How much its rays differ.
    spread: f32,
    in_focus: bool,
}

/// Whether the camera sees something in focus at a pixel.
fn in_focus(scene: &Scene, x: usize, y: usize) -> bool {
    let (x, y) = (x * scene.supersample, y * scene.supersample);
    let seen = scene.layers.iter().find(|layer| layer.alpha.get(x, y) > 0.0);
    seen.is_some_and(|layer| layer.coc_px.get(x, y).abs() < IN_FOCUS_PX)
}

/// `candidates` in strata, in focus and out of it, of falling spread and about equal total spread: for each its share of the
/// candidates, in pixels of the frame, and its candidates.
fn strata(candidates: Vec<Candidate>, scene: &Scene) -> Vec<(f64, Vec<usize>)> {
    let (width, height) = scene.frame_size();
    let pixels_each = (width * height) as f64 / candidates.len().max(1) as f64;
    let (focused, blurred): (Vec<_>, Vec<_>) =
        candidates.into_iter().partition(|candidate| candidate.in_focus);
    let cut = [focused, blurred].into_iter().flat_map(of_equal_spread);
    cut.map(|pixels| (pixels.len() as f64 * pixels_each, pixels)).collect()
}

/// `candidates` in half of [`STRATA`] strata of falling spread and about equal total spread.
fn of_equal_spread(mut candidates: Vec<Candidate>) -> Vec<Vec<usize>> {
    const COUNT: usize = STRATA / 2;
    let total: f64 = candidates.iter().map(|candidate| f64::from(candidate.spread)).sum();
    let floor = (f64::from(FLOOR) * total / candidates.len().max(1) as f64).max(f64::MIN_POSITIVE);
    // Equal spreads keep their order, so that the strata do not depend on the number of threads.
    candidates.sort_by(|a, b| b.spread.total_cmp(&a.spread));
    let whole = total + floor * candidates.len() as f64;
    let mut strata = vec![Vec::new(); COUNT];
    let mut sum = 0.0;
    for Candidate { pixel, spread, .. } in candidates {
        let stratum = (sum / whole * COUNT as f64) as usize;
        strata[stratum.min(COUNT - 1)].push(pixel);
        sum += f64::from(spread) + floor;
    }
    strata.retain(|pixels| !pixels.is_empty());
    strata
}

/// Squared errors of some of the pixels of one kind.
#[derive(Debug, Clone, PartialEq)]
struct StratumErrors {
    /// How many pixels there are.
    size: f64,
    errors: Vec<f64>,
}

impl StratumErrors {
    fn mean(&self) -> f64 {
        self.errors.iter().sum::<f64>() / self.errors.len() as f64
    }

    /// Share of the pixels that were not looked at.
    fn unseen(&self) -> f64 {
        (1.0 - self.errors.len() as f64 / self.size).max(0.0)
    }

    /// Variance of [`StratumErrors::mean`], which is 0 once every pixel was looked at.
    fn variance(&self) -> f64 {
        let (count, mean) = (self.errors.len() as f64, self.mean());
        let squares: f64 = self.errors.iter().map(|error| (error - mean).powi(2)).sum();
        squares / (count - 1.0).max(1.0) / count * self.unseen()
    }
}

/// The mean squared error of the whole picture.
fn mean_error(strata: &[StratumErrors]) -> f64 {
    let pixels: f64 = strata.iter().map(|stratum| stratum.size).sum();
    strata.iter().map(|stratum| stratum.size / pixels * stratum.mean()).sum()
}

/// The mean over the strata of the variance of their mean errors in units of its square, 1 at most each.
fn mean_relative_variance(strata: &[StratumErrors]) -> f64 {
    let found = strata.iter().filter(|stratum| stratum.mean() > 0.0);
    let relative: Vec<f64> = found.map(|s| (s.variance() / s.mean().powi(2)).min(1.0)).collect();
    relative.iter().sum::<f64>() / relative.len().max(1) as f64
}

/// PSNR and its 95 % interval from what was found.
fn interval(strata: &[StratumErrors]) -> (Option<f64>, (f64, Option<f64>)) {
    let pixels: f64 = strata.iter().map(|stratum| stratum.size).sum();
    let share = |stratum: &StratumErrors| stratum.size / pixels;
    let error = mean_error(strata);
    let relative = mean_relative_variance(strata);
    let part = |s: &StratumErrors| {
        let variance = s.variance().max(relative * s.unseen() * s.mean().powi(2));
        (share(s).powi(2) * variance, s.errors.len() as f64 - 1.0)
    };
    let parts: Vec<(f64, f64)> = strata.iter().map(part).collect();
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

    fn stratum(size: f64, errors: Vec<f64>) -> StratumErrors {
        StratumErrors { size, errors }
    }

    #[test]
    fn strata_hold_every_pixel_once_and_share_the_spread() {
        let spread = |pixel: usize| if pixel / 50 == 3 { 1.0 } else { (pixel % 50) as f32 * 1e-3 };
        let candidate = |pixel| Candidate { pixel, spread: spread(pixel), in_focus: false };
        let strata = of_equal_spread((0..1000).map(candidate).collect());
        let mut all: Vec<usize> = strata.iter().flatten().copied().collect();
        all.sort_unstable();
        assert_eq!(all, (0..1000).collect::<Vec<_>>(), "every pixel once");
        assert!(strata[0].len() < strata[strata.len() - 1].len() / 4, "busy strata are small");
        assert!(strata[0].iter().all(|pixel| pixel / 50 == 3), "the bright row comes first");
    }

    #[test]
    fn a_stratum_counts_for_its_pixels_and_not_for_its_probes() {
        // 100 pixels of error 0.01 and 900 of none: MSE 1e-3, 30 dB.
        let (db, (low, high)) = interval(&[stratum(100.0, vec![0.01; 50]), stratum(900.0, vec![0.0; 50])]);
        assert!((db.unwrap() - 30.0).abs() < 1e-9);
        assert!((low - 30.0).abs() < 1e-9 && (high.unwrap() - 30.0).abs() < 1e-9, "no variance, no interval");
    }

    #[test]
    fn an_error_that_may_be_nothing_has_no_upper_end() {
        let (db, (low, high)) = interval(&[stratum(1000.0, vec![1e-6, -1e-6, 1e-6, -1.1e-6])]);
        assert_eq!((db, high), (None, None));
        assert!(low > 50.0, "but it is not large: {low}");
    }

    #[test]
    fn a_stratum_looked_at_whole_is_known() {
        let whole = stratum(3.0, vec![1.0, 2.0, 3.0]);
        assert_eq!((whole.mean(), whole.variance()), (2.0, 0.0));
    }
}
