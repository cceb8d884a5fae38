//! SAMPLE BUDGET: the number of lens samples that reaches a target.
//!
//! *A time* is met by prediction: [`crate::cost`] gives the number of samples that fit. *A sampling error* is reached by a number that is
//! found before the picture is rendered, in two steps.
//!
//! *Expected.* The variance of single rays ([`ProbeSites::spread`]) at some thousand pixels costs little, and the error of a picture
//! follows from it to within some decibels. Where [`BASE_VIEWS`] or fewer are enough by more than that, where the target allows no more, and
//! where the picture of a named quality is small, nothing is measured: it would cost more than the lens samples that it could save.
//!
//! *Measured.* Otherwise the truth is computed at a few hundred pixels ([`Probes`]), the method renders only these pixels
//! ([`Sampler::pixels`]) with [`BASE_VIEWS`], then with twice as many until the target is reached or the largest number is, and the picture
//! is rendered once with the number that was found. Its error estimate is that of the probes at this number.
//!
//! A higher target never gives fewer samples: what is expected and measured of a number of samples does not depend on the target, each
//! search goes through powers of two upwards, and ends at the first that is enough. Powers of two, pixels that stay the same, and more of
//! them the larger the picture is, also keep the number from changing between the frames of a shot. Near a threshold it can still change:
//! the outcome names the number, so that a sequence can keep it.
//!
//! A method that does not render ray by ray has an error that does not fall with the number of samples. Where more samples stop helping
//! and the target sets no smaller limit, the search ends with the last number that was measured.

use crate::cost::{self, Calibration};
use crate::error::Error;
use crate::finding::Finding;
use crate::image::Image;
use crate::methods::{self, Plan, Progress, Sampler, Target};
use crate::probes::{Basis, ErrorEstimate, MANY_RAYS, ProbeSites, Probes, SEED};
use crate::scene::{EffectKind, Scene, SceneStats};
use crate::usage::Stopwatch;
use serde::Serialize;

/// Smallest and largest number of pixels at which numbers of samples are measured.
const PROBES: [usize; 2] = [200, 1600];

/// Pixels of the picture for each of these: the share of the measurement in the time of a blur stays the same.
const PIXELS_PER_PROBE: usize = 4000;

/// Pixels of a picture from which a measurement costs less than the lens samples that it saves on average: it takes about 0.05 s of
/// processor time where 64 further lens samples take 0.3 µs a pixel.
const MEASURED_FROM_PIXELS: usize = 600_000;

/// Rays of each half of a truth that up to [`MANY_VIEWS`] are measured against: twice as many in all as the smallest number that is measured,
/// so that the noise of the truth adds little to the measured error.
const FEW_RAYS: usize = 128;

/// The largest number of lens samples that is measured against [`FEW_RAYS`]; more against [`MANY_RAYS`].
const MANY_VIEWS: usize = 256;

/// Number of lens samples up to which a number is never measured: preparing a scene for it costs about as much as rendering so few.
const BASE_VIEWS: usize = 64;

/// Smallest number of lens samples that is expected to be enough without a measurement.
const FEWEST_VIEWS: usize = 16;

/// Share of the largest number for a target that is the smallest one, within [`FEWEST_VIEWS`] and [`BASE_VIEWS`]: a final picture has no
/// fewer than the base, and a preview no more than a final picture.
const FEWEST_SHARE: usize = 4;

/// Margin in dB by which the expected error is nearly never off: what is expected to reach the target by more is not measured.
const SURE_DB: f64 = 6.0;

/// Margin in dB by which it is seldom off: what is expected to reach the target by more is taken where nothing is measured.
const LIKELY_DB: f64 = 3.0;

/// Margin above the target that a number of samples has to reach at the probes. Their estimates are off by about 0.8 dB, and
/// selection favours numbers whose estimate is too high.
const MARGIN_DB: f64 = 0.5;

/// Smallest power of the number of lens samples with which the squared error falls, if samples are the only cause of error.
const MIN_POWER: f64 = 0.6;

/// Gain of four times the lens samples below which more samples do not help: at the power above it would be 3.6 dB.
const MIN_DB_PER_FOURFOLD: f64 = 2.0;

/// Power of the number of rays with which the squared error falls for evenly spread rays.
const POWER_OF_RAYS: f64 = 1.2;

/// Squared error that one view makes at a barely blurred light, in display values times pixels: the light is in one pixel or another. The
/// middle of 1 to 10 on the scenes of `examples/default_quality` with lights.
const LIGHT_ERROR: f64 = 4.0;

/// Share of a time budget that is planned for: half of all predictions are off by more than a seventh.
const SHARE_OF_BUDGET: f64 = 0.85;

/// The result of a search.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Outcome {
    /// The target.
    #[serde(rename = "goal")]
    pub target: Target,
    /// Whether the target was reached: as far as is known, expected where nothing was measured.
    pub met: bool,
    /// Lens samples per pixel of the picture.
    pub views: usize,
    /// PSNR in dB that was expected of this number before any measurement; `None` for a time.
    pub expected_db: Option<f64>,
    /// Every number of lens samples that was measured, in order; empty for a time, and where nothing had to be measured.
    pub tried: Vec<Trial>,
    /// The result in words.
    pub statement: String,
}

impl Outcome {
    /// The statement as a finding: a warning if the target was not reached.
    pub fn finding(&self) -> Finding {
        let say = if self.met { Finding::note } else { Finding::warning };
        say("views", self.statement.clone())
    }

    /// The error estimate for the chosen number of lens samples.
    pub fn estimate(&self) -> Option<ErrorEstimate> {
        self.tried.iter().find(|trial| trial.views == self.views).map(|trial| trial.estimate)
    }
}

/// One number of lens samples that was tried.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Trial {
    /// Lens samples per pixel.
    pub views: usize,
    /// The error estimate of the probes.
    #[serde(flatten)]
    pub estimate: ErrorEstimate,
}

impl Trial {
    /// PSNR in dB; if the error is not measurable, the lower end of the interval.
    fn psnr_db(&self) -> f64 {
        self.estimate.psnr_db.unwrap_or(self.estimate.interval_db.0)
    }
}

/// The picture of `scene` by `plan`, with a number of lens samples that reaches `psnr_db`, or the largest that helps.
///
/// # Errors
/// A method that cannot render single pixels.
#[doc(hidden)]
pub fn render_to_target(
    scene: Scene,
    plan: &Plan,
    (psnr_db, max_views): (f64, usize),
    progress: &Progress<'_>,
) -> Result<(Image, Outcome), Error> {
    let (sampler, outcome) = seek(scene, plan, (psnr_db, max_views))?;
    Ok((sampler.picture(outcome.views, progress), outcome))
}

/// The outcome of [`render_to_target`], without the picture.
///
/// # Errors
/// Those of [`render_to_target`].
#[doc(hidden)]
pub fn find_views(scene: Scene, plan: &Plan, target: (f64, usize)) -> Result<Outcome, Error> {
    seek(scene, plan, target).map(|(_, outcome)| outcome)
}

fn seek<'p>(
    scene: Scene,
    plan: &'p Plan,
    (psnr_db, max_views): (f64, usize),
) -> Result<(Box<dyn Sampler + 'p>, Outcome), Error> {
    let sampling = plan.method.lens_sampling().ok_or_else(|| {
        Error::settings(format!("{} cannot render single pixels, which a target in dB needs", plan.method))
            .help("request a number of lens samples with `views`")
    })?;
    let basis = Basis::for_picture(&scene, plan, plan);
    let (width, height) = scene.picture_size();
    let pixels = width * height;
    let sites = ProbeSites::new(&basis, (pixels / PIXELS_PER_PROBE).clamp(PROBES[0], PROBES[1]), SEED);
    let lights = plan.barely_blurred_lights / pixels.max(1) as f64;
    let expected = Expected { spread: sites.spread(), gain_db: sampling.gain_db(), lights, pixels };
    let target = Target::Error { psnr_db, max_views };
    let outcome = |views, met, tried, statement| {
        let statement = format!("{statement}; for a sequence, keep it with `views = {views}`");
        Outcome { target, met, views, expected_db: Some(expected.db(views)), tried, statement }
    };
    if let Some(views) = expected.enough(psnr_db, max_views) {
        let expected_db = expected.db(views);
        let mut statement = expected_statement(views, (psnr_db, max_views), expected_db);
        if expected.is_of_lights(views) {
            statement.push_str("; most of the error is that of lights with too little blur for exact discs");
        }
        drop(basis);
        return Ok((
            sampling.begin(scene, plan),
            outcome(views, expected_db >= psnr_db, Vec::new(), statement),
        ));
    }
    let basis = basis.filled();
    let mut truth = Truths { few: Probes::new(&basis, &sites, FEW_RAYS), many: None };
    if max_views > MANY_VIEWS {
        truth.many = Some(Probes::new(&basis, &sites, MANY_RAYS));
    }
    drop(basis);
    let mut sampler = sampling.begin(scene, plan);
    let pixels = truth.few.pixels();
    let mut tried = Vec::new();
    let found = search(psnr_db + MARGIN_DB, max_views, |views| {
        let trial = Trial { views, estimate: truth.of(views).estimate(&sampler.pixels(views, &pixels)) };
        tried.push(trial);
        trial.psnr_db()
    });
    // The search may end with a number that reaches the target but not the margin.
    let reached = tried.iter().any(|trial| trial.views == found.views && trial.psnr_db() >= psnr_db);
    let found = if reached { Found { end: End::Met, ..found } } else { found };
    let statement = statement(plan, psnr_db, &found, &tried, &truth.few);
    Ok((sampler, outcome(found.views, found.end == End::Met, tried, statement)))
}

/// The truth at the probes that numbers of lens samples are measured against.
struct Truths {
    few: Probes,
    /// For more than [`MANY_VIEWS`].
    many: Option<Probes>,
}

impl Truths {
    fn of(&self, views: usize) -> &Probes {
        self.many.as_ref().filter(|_| views > MANY_VIEWS).unwrap_or(&self.few)
    }
}

/// What is expected of a number of lens samples before any is measured.
#[derive(Debug, Clone, Copy)]
struct Expected {
    /// See [`ProbeSites::spread`].
    spread: f64,
    /// See [`methods::LensSampling::gain_db`].
    gain_db: [f64; 2],
    /// Lights per pixel that are blurred too little for exact discs: see [`Plan::barely_blurred_lights`]. Too few rays hit them for a spread
    /// to show them.
    lights: f64,
    /// Pixels of the picture.
    pixels: usize,
}

impl Expected {
    /// PSNR in dB of a picture with `views` lens samples per pixel.
    fn db(&self, views: usize) -> f64 {
        let [of_16, of_step] = self.gain_db;
        let without_lights =
            of_16 + 2.0 * of_step * (views as f64 / 16.0).log2() - 10.0 * self.spread.max(1e-12).log10();
        -10.0 * (10f64.powf(-0.1 * without_lights) + self.light_error(views)).log10()
    }

    /// The part of the squared error with `views` lens samples that lights make.
    fn light_error(&self, views: usize) -> f64 {
        LIGHT_ERROR * self.lights / views as f64
    }

    /// Whether lights make most of the error of `views` lens samples.
    fn is_of_lights(&self, views: usize) -> bool {
        self.light_error(views) > 0.5 * 10f64.powf(-0.1 * self.db(views))
    }

    /// The number of lens samples for `target_db`, at most `max_views`, where none has to be measured.
    fn enough(&self, target_db: f64, max_views: usize) -> Option<usize> {
        let is_small = self.pixels < MEASURED_FROM_PIXELS && max_views <= MANY_VIEWS;
        let measures = max_views > BASE_VIEWS && !is_small;
        let (margin_db, last) = if measures { (SURE_DB, BASE_VIEWS) } else { (LIKELY_DB, max_views) };
        let fewest = (max_views / FEWEST_SHARE).clamp(FEWEST_VIEWS, BASE_VIEWS);
        let mut unmeasured = powers_of_two(fewest).take_while(|views| *views <= last);
        let enough = unmeasured.find(|views| self.db(*views) >= target_db + margin_db);
        enough.or_else(|| (!measures).then_some(max_views))
    }
}

/// `first` and its doubles.
fn powers_of_two(first: usize) -> impl Iterator<Item = usize> {
    std::iter::successors(Some(first), |views| views.checked_mul(2))
}

/// The picture of `scene`, whose statistics are `stats`, by `plan`, with as many lens samples as the blur is predicted to have time for:
/// `seconds` of wall time on the machine of `calibration`.
///
/// # Errors
/// Those of the method.
pub(crate) fn render_within(
    scene: Scene,
    (stats, plan): (&SceneStats, &Plan),
    seconds: f64,
    calibration: &Calibration,
    progress: &Progress<'_>,
) -> Result<(Image, Outcome), Error> {
    let views = views_within(stats, plan, seconds, calibration)?;
    let plan = Plan { views: Some(views), ..plan.clone() };
    let predicted = cost::predict(stats, &plan, calibration).map_or(0.0, |cost| cost.seconds);
    let watch = Stopwatch::start();
    let image = methods::render(scene, &plan, progress)?;
    let taken = watch.seconds();
    let few = if predicted > seconds { "; this is the smallest number of views" } else { "" };
    let statement =
        format!("{views} views took {taken:.2} s of {seconds} s; predicted: {predicted:.2} s{few}");
    let target = Target::Time { seconds };
    let met = taken <= seconds;
    Ok((image, Outcome { target, met, views, expected_db: None, tried: Vec::new(), statement }))
}

/// The number of lens samples that is predicted to fit into `seconds`, with a margin; the smallest number where none fits.
///
/// # Errors
/// [`crate::error::ErrorKind::Settings`] for a method that does not say its cost, or does not sample the lens.
pub fn views_within(
    stats: &SceneStats,
    plan: &Plan,
    seconds: f64,
    calibration: &Calibration,
) -> Result<usize, Error> {
    let affordable =
        cost::views_within(stats, plan, calibration, SHARE_OF_BUDGET * seconds).ok_or_else(|| {
            Error::settings(format!("the time of {} cannot be predicted", plan.method))
                .help("request a number of lens samples with `views`, or a sampling error with `target_db`")
        })?;
    Ok(halfway_within(affordable))
}

/// The largest power of two, or number halfway between two, that is at most `views`; 8 if all are more.
fn halfway_within(views: usize) -> usize {
    let power = 1 << views.max(8).ilog2();
    if power + power / 2 <= views { power + power / 2 } else { power }
}

/// How a search ended.
#[derive(Debug, Clone, Copy, PartialEq)]
enum End {
    /// With the first number of lens samples that reaches the target.
    Met,
    /// At the largest number of lens samples allowed.
    Max,
    /// Where more do not help: they approach this PSNR in dB.
    Floor(f64),
}

/// The number of lens samples to render with, and how the search ended.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Found {
    views: usize,
    end: End,
}

/// Searches the first of [`BASE_VIEWS`] and its doubles, up to `max_views`, whose PSNR in dB by `measure` reaches `target_db`.
///
/// Only where it ends depends on the target, so that a higher target or a larger maximum never gives fewer.
fn search(target_db: f64, max_views: usize, mut measure: impl FnMut(usize) -> f64) -> Found {
    let (mut known, mut views) = (Vec::new(), BASE_VIEWS.min(max_views));
    loop {
        let db = measure(views);
        known.push((views, db));
        if db >= target_db {
            return Found { views, end: End::Met };
        }
        if views == max_views {
            return Found { views, end: End::Max };
        }
        if let Some(floor_db) = floor_db(&known) {
            return Found { views, end: End::Floor(floor_db) };
        }
        views = (2 * views).min(max_views);
    }
}

/// The PSNR in dB that rising numbers of lens samples approach, if the last fourfold did not help.
fn floor_db(known: &[(usize, f64)]) -> Option<f64> {
    let [.., (before, before_db), _, (last, last_db)] = known else { return None };
    if last_db - before_db >= MIN_DB_PER_FOURFOLD {
        return None;
    }
    let error = |db: f64| 10f64.powf(-0.1 * db);
    let falls_to = (*last as f64 / *before as f64).powf(-MIN_POWER);
    let floor = (error(*last_db) - error(*before_db) * falls_to) / (1.0 - falls_to);
    Some(-10.0 * floor.max(f64::MIN_POSITIVE).log10())
}

/// The number `views` in words, which is not measured, for a target of `psnr_db` with at most `max_views`.
fn expected_statement(views: usize, (psnr_db, max_views): (f64, usize), expected_db: f64) -> String {
    let most = if views == max_views { ", the largest number of views for this target," } else { " views" };
    format!(
        "{views}{most} are expected to reach about {expected_db:.0} dB; requested: {psnr_db} dB; not measured, because that \
         would cost more than it could save"
    )
}

/// The result of a search for `target_db` in words.
fn statement(plan: &Plan, target_db: f64, found: &Found, tried: &[Trial], probes: &Probes) -> String {
    let (method, views) = (plan.method, found.views);
    let Some(trial) = tried.iter().find(|trial| trial.views == views) else {
        return format!("{views} views");
    };
    let reached = trial.estimate.to_string();
    match found.end {
        End::Met => format!("{views} views reach {reached}; requested: {target_db} dB"),
        End::Max => {
            format!(
                "the largest number of views for this target, {views}, reaches {reached}, not {target_db} dB"
            )
        }
        End::Floor(_) if trial.estimate.interval_db.1.is_none_or(|most_db| most_db >= target_db) => {
            format!("{views} views reach {reached}, and more hardly help; requested: {target_db} dB")
        }
        End::Floor(floor_db) => {
            // Few rays hit a light, so a few hundred pixels do not show how many rays it takes.
            let rays = if plan.does(EffectKind::Highlights) {
                "a very large number of rays: the stack has lights, and few rays hit one".to_owned()
            } else {
                format!("about {} rays", probes.rays_for(target_db, POWER_OF_RAYS))
            };
            format!(
                "{method} cannot reach {target_db} dB on this stack: {views} views reach {reached}, and more views at most \
                 about {floor_db:.0} dB; accumulate can (`method = accumulate`), with {rays}"
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Quality;

    /// A search for `target_db`, and the numbers it tried, where the error is `floor + noise / views ^ power`.
    fn searched(target_db: f64, [floor, noise, power]: [f64; 3], max_views: usize) -> (Found, Vec<usize>) {
        let mut tried = Vec::new();
        let found = search(target_db, max_views, |views| {
            tried.push(views);
            -10.0 * (floor + noise * (views as f64).powf(-power)).log10()
        });
        (found, tried)
    }

    /// The expectation for a large picture that has the PSNR `db` with 16 views.
    fn expecting(db: f64) -> Expected {
        Expected {
            spread: 10f64.powf(-0.1 * (db - 21.5)),
            gain_db: [21.5, 1.25],
            lights: 0.0,
            pixels: 2_000_000,
        }
    }

    #[test]
    fn the_first_power_of_two_that_reaches_the_target_is_found() {
        for power in [0.7, 1.0, 1.3, 1.6] {
            for noise in [1e-4, 1e-3, 1e-2, 0.1] {
                for target_db in [30.0, 35.0, 40.0, 45.0, 50.0] {
                    let (found, tried) = searched(target_db, [0.0, noise, power], 1 << 20);
                    let db = |views: usize| -10.0 * (noise * (views as f64).powf(-power)).log10();
                    let case =
                        format!("{target_db} dB, power {power}, noise {noise}: {found:?} after {tried:?}");
                    assert_eq!(found.end, End::Met, "{case}");
                    assert!(db(found.views) >= target_db, "too few: {case}");
                    assert!(found.views == 64 || db(found.views / 2) < target_db, "too many: {case}");
                    assert!(found.views.is_power_of_two(), "{case}");
                }
            }
        }
    }

    #[test]
    fn an_error_that_does_not_fall_with_samples_ends_the_search() {
        let (found, tried) = searched(50.0, [2e-5, 2e-3, 1.2], 1 << 16);
        let End::Floor(floor_db) = found.end else { panic!("{found:?} after {tried:?}") };
        assert!((46.5..49.0).contains(&floor_db), "47 dB, estimated slightly too high: {floor_db}");
        assert!(*tried.last().unwrap() <= 1024, "{tried:?}");
    }

    #[test]
    fn a_suspected_floor_ends_at_the_largest_number_of_a_quality() {
        // Errors that do not fall at all, as of probes that a few lights dominate.
        let (found, _) = searched(45.0, [1e-2, 1e-9, 1.0], 256);
        assert_eq!((found.views, found.end), (256, End::Max));
        let (found, tried) = searched(45.0, [1e-2, 1e-9, 1.0], 1 << 16);
        assert!(found.views == *tried.last().unwrap() && found.views >= 256, "{found:?} after {tried:?}");
    }

    #[test]
    fn a_search_ends_at_the_largest_number_allowed() {
        let (found, tried) = searched(60.0, [0.0, 1e-2, 1.0], 100);
        assert_eq!((found.end, found.views), (End::Max, 100), "after {tried:?}");
        let (found, _) = searched(60.0, [0.0, 1e-2, 1.0], 2);
        assert_eq!((found.end, found.views), (End::Max, 2), "even below the base");
    }

    #[test]
    fn asking_for_more_never_gives_fewer_whatever_the_probes_say() {
        // Measured errors in any order: noise, and floors that a further number leaves.
        let mut random = fastrand::Rng::with_seed(5);
        for case in 0..2000 {
            let measured: Vec<f64> = (0..17).map(|_| 30.0 + 30.0 * random.f64()).collect();
            let pixels = if case % 2 == 0 { 2_000_000 } else { 200_000 };
            let expected = Expected { pixels, ..expecting(25.0 + 40.0 * random.f64()) };
            let views = |target_db: f64, max_views: usize| {
                let measure = |views: usize| measured[views.ilog2() as usize];
                let searched = || search(target_db + MARGIN_DB, max_views, measure).views;
                expected.enough(target_db, max_views).unwrap_or_else(searched)
            };
            let qualities = Quality::ALL.map(|quality| views(quality.target_db(), quality.max_views()));
            // A reference is rendered by another method, and measured where small pictures of the others are not.
            let comparable = if pixels < MEASURED_FROM_PIXELS { &qualities[..3] } else { &qualities[..] };
            assert!(comparable.is_sorted(), "case {case}: {qualities:?}");
            let targets = [20.0, 30.0, 35.0, 40.0, 45.0, 50.0, 55.0, 60.0].map(|db| views(db, 1 << 16));
            assert!(targets.is_sorted(), "case {case}: {targets:?}");
        }
    }

    #[test]
    fn a_final_picture_never_has_fewer_views_than_the_base() {
        for db in [20.0, 35.0, 50.0, 90.0] {
            let found = expecting(db).enough(45.0, 256);
            assert!(found.is_none_or(|views| views == BASE_VIEWS), "16 views reach {db} dB: {found:?}");
        }
    }

    #[test]
    fn nothing_is_measured_where_it_cannot_save_anything() {
        // 64 views have 5 dB more than 16.
        let found = |db: f64, target_db, max_views| expecting(db).enough(target_db, max_views);
        assert_eq!(found(46.5, 45.0, 256), Some(64), "enough by more than the expectation may be off");
        assert_eq!(found(45.5, 45.0, 256), None, "perhaps short of the target");
        assert_eq!(found(20.0, 35.0, 64), Some(64), "no more than the base are allowed");
        assert_eq!(found(41.5, 35.0, 64), Some(16), "a draft of a picture with little blur");
        assert_eq!(found(90.0, 45.0, 2), Some(2), "no more than allowed");
        let in_small = |db: f64| Expected { pixels: 200_000, ..expecting(db) };
        let small = [43.5, 42.5, 40.6, 20.0].map(|db| in_small(db).enough(45.0, 256));
        assert_eq!(small, [64, 128, 128, 256].map(Some), "a small picture is not measured");
        assert_eq!(in_small(43.5).enough(45.0, 1 << 16), None, "but where it is asked for a number of dB");
    }

    #[test]
    fn lights_that_no_disc_carries_take_more_views() {
        // 500 of them in 640 × 360 pixels, in an otherwise nearly sharp picture.
        let lit = Expected { lights: 500.0 / 230_400.0, pixels: 230_400, ..expecting(80.0) };
        assert!((lit.db(64) - 38.7).abs() < 0.1, "{} dB", lit.db(64));
        assert_eq!(lit.enough(45.0, 256), Some(256), "the largest number");
        assert!(lit.is_of_lights(256) && !Expected { lights: 1e-9, ..lit }.is_of_lights(256));
        assert_eq!(Expected { lights: 0.0, ..lit }.enough(45.0, 256), Some(64), "without lights, the base");
    }

    #[test]
    fn a_time_is_met_by_powers_of_two_and_halfway_between_them() {
        assert_eq!([1, 8, 11, 12, 64, 95, 96].map(halfway_within), [8, 8, 8, 12, 64, 64, 96]);
    }
}
