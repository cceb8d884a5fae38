//! SAMPLE BUDGET: the number of lens samples that reaches a target.
//!
//! *A time* is met by prediction: [`crate::cost`] gives the number of samples that fit. *A sampling error* is reached by a search at a few
//! pixels, before the picture is rendered.
//!
//! Twice the samples cost twice the time, so no picture is rendered and discarded. The truth is computed at a few hundred
//! pixels ([`Probes`]), the method renders only these pixels ([`Sampler::pixels`]) with different numbers of samples,
//! and the picture is rendered once with the number that was found. Its error estimate is that of the probes at this number.
//!
//! The numbers are the sizes of the tables of lens samples: powers of two, and halfway between them. The first one is
//! predicted from the variance of single rays ([`ProbeSites::spread`]). A method that does not render ray by ray has an error that does not
//! fall with the number of samples; where more samples stop helping, the search ends and reports it.

use crate::cost::{self, Calibration};
use crate::error::Error;
use crate::finding::Finding;
use crate::image::Image;
use crate::methods::{self, Plan, Progress, Sampler, Target};
use crate::probes::{Basis, ErrorEstimate, MANY_RAYS, ProbeSites, Probes, SEED};
use crate::scene::{Scene, SceneStats};
use crate::usage::Stopwatch;
use serde::Serialize;
use std::collections::BTreeMap;

/// Number of pixels at which numbers of samples are tried.
const PROBES: usize = 200;

/// Smallest number of rays of each half of a truth.
const MIN_RAYS: usize = 32;

/// Margin above the target that a number of samples has to reach at the probes. Their estimates are off by about 0.8 dB, and
/// selection favours numbers whose estimate is too high.
const MARGIN_DB: f64 = 0.5;

/// Assumed gain of one step up, to √2 times the lens samples, before it is measured.
const DB_PER_STEP: f64 = 1.25;

/// Surplus in steps from which on fewer samples are tried: a trial costs as much as a step, and is wasted if it misses the
/// target.
const STEPS_WORTH_A_TRIAL: u32 = 2;

/// Number of steps between too few samples and enough up to which another trial costs as much as it may save.
const NEAR_STEPS: u32 = 3;

/// Smallest power of the number of lens samples with which the squared error falls, if samples are the only cause of error.
const MIN_POWER: f64 = 0.6;

/// Gain of doubling the number of lens samples below which more samples do not help.
const MIN_DB_PER_DOUBLING: f64 = 0.3;

/// Power of the number of rays with which the squared error falls for evenly spread rays.
const POWER_OF_RAYS: f64 = 1.2;

/// Share of a time budget that is planned for: half of all predictions are off by more than a seventh.
const SHARE_OF_BUDGET: f64 = 0.85;

/// The result of a search.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Outcome {
    /// The target.
    #[serde(rename = "goal")]
    pub target: Target,
    /// Whether the target was reached.
    pub met: bool,
    /// Lens samples per pixel of the picture.
    pub views: usize,
    /// Every number of lens samples that was tried, in order; empty for a time.
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

/// The picture of `scene` by `plan`, with the smallest number of lens samples that reaches `psnr_db`, or the largest that helps.
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
    let (probes, first) = probes(&scene, plan, psnr_db + MARGIN_DB, sampling.gain_db());
    let mut sampler = sampling.begin(scene, plan);
    let pixels = probes.pixels();
    let mut tried = Vec::new();
    let found = search(psnr_db + MARGIN_DB, first, max_views, |views| {
        let trial = Trial { views, estimate: probes.estimate(&sampler.pixels(views, &pixels)) };
        tried.push(trial);
        trial.psnr_db()
    });
    // The search may end with a number that reaches the target but not the margin.
    let reached = tried.iter().any(|trial| trial.views == found.views && trial.psnr_db() >= psnr_db);
    let found = if reached { Found { end: End::Met, ..found } } else { found };
    let statement = statement(plan, psnr_db, &found, &tried, &probes);
    let target = Target::Error { psnr_db, max_views };
    Ok((sampler, Outcome { target, met: found.end == End::Met, views: found.views, tried, statement }))
}

/// The truth at some pixels of `scene`, and the step at which the search for `psnr_db` begins.
fn probes(scene: &Scene, plan: &Plan, psnr_db: f64, gain_db: [f64; 2]) -> (Probes, u32) {
    let basis = Basis::new(scene, plan);
    let sites = ProbeSites::new(&basis, PROBES, SEED);
    let first = first_step(psnr_db, sites.spread(), gain_db);
    // Two halves of twice as many rays as samples, so that the noise of the truth adds little to the measured error.
    let rays_per_half = (2 * views_at(first)).clamp(MIN_RAYS, MANY_RAYS);
    (Probes::new(sites, rays_per_half), first)
}

/// Number of lens samples of step `step` of the grid: 8, 12, 16, 24 …
fn views_at(step: u32) -> usize {
    let octave = step / 2;
    if step.is_multiple_of(2) { 8 << octave } else { 12 << octave }
}

/// The last step of the grid with at most `views` lens samples; the first step if all have more.
fn step_within(views: usize) -> u32 {
    let mut step = 0;
    while views_at(step + 1) <= views {
        step += 1;
    }
    step
}

/// The step that probably reaches `psnr_db` where the squared error of one ray is `spread`, see
/// [`methods::LensSampling::gain_db`].
fn first_step(psnr_db: f64, spread: f64, [gain_of_16, gain_of_step]: [f64; 2]) -> u32 {
    const STEP_OF_16: f64 = 2.0;
    const LAST: f64 = 16.0;
    let required_gain = psnr_db + 10.0 * spread.max(1e-12).log10();
    ((required_gain - gain_of_16) / gain_of_step + STEP_OF_16).ceil().clamp(0.0, LAST) as u32
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
    Ok((image, Outcome { target, met: taken <= seconds, views, tried: Vec::new(), statement }))
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
    Ok(views_at(step_within(affordable)))
}

/// How a search ended.
#[derive(Debug, Clone, Copy, PartialEq)]
enum End {
    /// With the smallest number of lens samples that reaches the target.
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

/// PSNRs in dB by step of the grid.
type Known = BTreeMap<u32, f64>;

/// Searches the smallest number of lens samples, up to `max_views`, whose PSNR by `measure` reaches `target_db`; begins at step `first`.
fn search(target_db: f64, first: u32, max_views: usize, mut measure: impl FnMut(usize) -> f64) -> Found {
    let last = step_within(max_views);
    let views = |step: u32| views_at(step).min(max_views);
    let mut known = Known::new();
    let mut step = first.min(last);
    loop {
        known.insert(step, measure(views(step)));
        match next(&known, target_db, last) {
            Action::Try(next) => step = next,
            Action::End(step, end) => return Found { views: views(step), end },
        }
    }
}

/// The next action of the search.
enum Action {
    /// Measure this step.
    Try(u32),
    /// End with this step.
    End(u32, End),
}

fn next(known: &Known, target_db: f64, last: u32) -> Action {
    let reaches = |(_, db): &(&u32, &f64)| **db >= target_db;
    let enough = known.iter().find(reaches);
    // Only steps below it: a step above that misses the target does so by chance.
    let mut below = known.iter().filter(|(step, _)| enough.is_none_or(|(enough, _)| *step < enough));
    match (below.next_back(), enough) {
        (_, None) => more(known, target_db, last),
        (None, Some((&step, &db))) => fewer(step, db - target_db),
        (Some((&short, &short_db)), Some((&step, &db))) => {
            between((short, short_db - target_db), (step, db - target_db))
        }
    }
}

/// The action if no known step reaches the target.
fn more(known: &Known, target_db: f64, last: u32) -> Action {
    let Some((&step, &db)) = known.last_key_value() else { return Action::Try(0) };
    let end = if step >= last { Some(End::Max) } else { floor_db(known, target_db).map(End::Floor) };
    match end {
        Some(end) => Action::End(first_near_best(known), end),
        None => {
            let steps = ((target_db - db) / DB_PER_STEP).ceil().clamp(1.0, 6.0) as u32;
            Action::Try((step + steps).min(last))
        }
    }
}

/// The action if every known step reaches the target; the lowest, `step`, exceeds it by `surplus_db`.
fn fewer(step: u32, surplus_db: f64) -> Action {
    let steps = (surplus_db / DB_PER_STEP).floor().clamp(0.0, 6.0) as u32;
    if step == 0 || steps < STEPS_WORTH_A_TRIAL {
        Action::End(step, End::Met)
    } else {
        Action::Try(step - steps.min(step))
    }
}

/// The action between step `short`, which misses the target (`short_db` is negative), and step `enough`, which exceeds it by `surplus_db`.
fn between((short, short_db): (u32, f64), (enough, surplus_db): (u32, f64)) -> Action {
    let steps = enough - short;
    let share = -short_db / (surplus_db - short_db).max(1e-3);
    let needed = (share * f64::from(steps)).ceil().max(1.0) as u32;
    if steps <= NEAR_STEPS || needed >= steps {
        Action::End(enough, End::Met)
    } else {
        Action::Try(short + needed)
    }
}

/// The PSNR in dB that rising numbers of lens samples approach, if it misses the target.
fn floor_db(known: &Known, target_db: f64) -> Option<f64> {
    let (&last, &last_db) = known.last_key_value()?;
    let before = |steps: u32| known.iter().rfind(|(step, _)| **step + steps <= last);
    if let Some((step, db)) = before(2)
        && 2.0 * (last_db - db) / f64::from(last - step) < MIN_DB_PER_DOUBLING
    {
        return Some(last_db);
    }
    // Only numbers of samples that differ by a factor of four separate a floor from noise.
    let (&step, &db) = before(4)?;
    let error = |db: f64| 10f64.powf(-0.1 * db);
    let falls_to = (views_at(last) as f64 / views_at(step) as f64).powf(-MIN_POWER);
    let floor = (error(last_db) - error(db) * falls_to) / (1.0 - falls_to);
    (floor >= error(target_db)).then(|| -10.0 * floor.log10())
}

/// The lowest of the `known` steps whose PSNR is within half a decibel of the best.
fn first_near_best(known: &Known) -> u32 {
    const TOLERANCE_DB: f64 = 0.5;
    let best = known.values().fold(f64::NEG_INFINITY, |best, db| best.max(*db));
    known.iter().find(|(_, db)| **db >= best - TOLERANCE_DB).map_or(0, |(step, _)| *step)
}

/// The result of a search for `target_db` in words.
fn statement(plan: &Plan, target_db: f64, found: &Found, tried: &[Trial], probes: &Probes) -> String {
    let (method, views) = (plan.method, found.views);
    let reached = tried.iter().find(|trial| trial.views == views);
    let reached = reached.map_or_else(String::new, |trial| trial.estimate.to_string());
    match found.end {
        End::Met => format!("{views} views reach {reached}; requested: {target_db} dB"),
        End::Max => {
            format!(
                "the largest number of views for this target, {views}, reaches {reached}, not {target_db} dB"
            )
        }
        End::Floor(floor_db) => {
            // Few rays hit a light, so a few hundred pixels do not show how many rays it takes.
            let rays = if plan.does(crate::scene::EffectKind::Highlights) {
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

    /// A search for `target_db` that begins at 64, and the numbers it tried, where the error is `floor + noise / views ^ power`.
    fn searched(target_db: f64, [floor, noise, power]: [f64; 3], max_views: usize) -> (Found, Vec<usize>) {
        let mut tried = Vec::new();
        let found = search(target_db, step_within(64), max_views, |views| {
            tried.push(views);
            -10.0 * (floor + noise * (views as f64).powf(-power)).log10()
        });
        (found, tried)
    }

    #[test]
    fn the_grid_has_powers_of_two_and_halfway_between_them() {
        assert_eq!([0, 1, 2, 3, 4].map(views_at), [8, 12, 16, 24, 32]);
        assert_eq!([1, 8, 11, 12, 64, 95, 96].map(step_within), [0, 0, 0, 1, 6, 6, 7]);
    }

    #[test]
    fn the_smallest_number_of_samples_that_reaches_the_target_is_found_in_a_few_trials() {
        for power in [0.7, 1.0, 1.3, 1.6] {
            for noise in [1e-4, 1e-3, 1e-2, 0.1] {
                for target_db in [30.0, 35.0, 40.0, 45.0, 50.0] {
                    let (found, tried) = searched(target_db, [0.0, noise, power], 1 << 20);
                    let db = |views: usize| -10.0 * (noise * (views as f64).powf(-power)).log10();
                    let case =
                        format!("{target_db} dB, power {power}, noise {noise}: {found:?} after {tried:?}");
                    assert_eq!(found.end, End::Met, "{case}");
                    assert!(db(found.views) >= target_db, "too few: {case}");
                    let surplus_db = db(found.views) - target_db;
                    assert!(found.views == 8 || surplus_db < 5.0, "{surplus_db} dB too many: {case}");
                    assert!(tried.len() <= 9, "{case}");
                }
            }
        }
    }

    #[test]
    fn an_error_that_does_not_fall_with_samples_ends_the_search() {
        let (found, tried) = searched(50.0, [2e-5, 2e-3, 1.2], 1 << 16);
        let End::Floor(floor_db) = found.end else { panic!("{found:?} after {tried:?}") };
        assert!((47.0..48.5).contains(&floor_db), "47 dB, estimated slightly too high: {floor_db}");
        assert!(*tried.last().unwrap() <= 1024, "{tried:?}");
    }

    #[test]
    fn a_search_ends_soon_at_a_floor_just_below_the_target() {
        // The target is 48 dB, the floor 47.96.
        let (found, tried) = searched(48.0, [1.6e-5, 3e-4, 1.1], 1 << 16);
        assert!(matches!(found.end, End::Floor(_)) && tried.len() <= 6, "{found:?} after {tried:?}");
    }

    #[test]
    fn a_search_ends_at_the_largest_number_allowed() {
        let (found, tried) = searched(60.0, [0.0, 1e-2, 1.0], 100);
        assert_eq!((found.end, found.views), (End::Max, 96), "after {tried:?}");
        let (found, _) = searched(60.0, [0.0, 1e-2, 1.0], 2);
        assert_eq!((found.end, found.views), (End::Max, 2), "even below the smallest table");
    }

    #[test]
    fn samples_that_do_not_lower_the_error_are_not_spent() {
        let (found, tried) = searched(60.0, [1e-4, 1e-9, 1.0], 1 << 16);
        assert_eq!(found.views, 64, "{found:?} after {tried:?}");
    }

    #[test]
    fn the_first_step_follows_the_target_and_the_spread() {
        let first = |db, spread| views_at(first_step(db, spread, [21.5, 1.25]));
        assert!(first(45.0, 1e-2) > first(40.0, 1e-2), "a higher target");
        assert!(first(45.0, 1e-2) > first(45.0, 1e-3), "a scene of higher variance");
        assert_eq!(first(45.0, 0.0), 8, "no variance");
        assert!(
            views_at(first_step(45.0, 1e-2, [15.0, 1.25])) > first(45.0, 1e-2),
            "single rays are noisier"
        );
    }
}
