//! SAMPLE BUDGET: the number of lens samples that reaches a target.
//!
//! *A time* is met by prediction: [`crate::cost`] says how many samples fit. *A sampling error* is found by looking at a few pixels
//! first, as follows.
//!
//! A picture at twice the samples costs twice the time, so none is painted to be thrown away. The truth is found at a few hundred
//! pixels ([`Probes`]), the method is asked for these pixels alone ([`Sampler::pixels`]) with rising or falling numbers of samples,
//! and when the number is known the picture is painted once. What the probes said of that number is then true of the picture.
//!
//! The numbers are those that there are tables of lens samples for: powers of two, and halfway between them. The first one is
//! guessed from how much single rays differ ([`Places::spread`]). Where more samples stop helping (a method that makes the
//! picture in another way than ray by ray has an error that no number of samples takes away) the search ends and says so.

use crate::cost::{self, Calibration};
use crate::error::Error;
use crate::finding::Finding;
use crate::image::Image;
use crate::methods::{self, Progress, Sampler};
use crate::methods::{Plan, Target};
use crate::probes::{self, ErrorEstimate, MANY_RAYS, Places, Probes, SEED};
use crate::scene::{Scene, SceneStats};
use crate::usage::Stopwatch;
use serde::Serialize;
use std::collections::BTreeMap;

/// Pixels at which numbers of samples are tried.
const PROBES: usize = 200;

/// Rays of each half of a truth at least.
const MIN_RAYS: usize = 32;

/// How much more than the target a number of samples has to reach at the probes: what they say is off by about 0.8 dB, and
/// the number that looks best is more often too good than not.
const MARGIN_DB: f64 = 0.5;

/// What one step up, to √2 times the lens samples, gains where nothing better is known.
const DB_PER_STEP: f64 = 1.25;

/// Steps that there must be to spare for fewer samples to be tried: a trial that then misses the target was for nothing, and one
/// costs as much as a step.
const STEPS_WORTH_A_TRIAL: u32 = 2;

/// Where this many steps at most lie between too few samples and enough, trying another number costs as much as it may save.
const NEAR_STEPS: u32 = 3;

/// Squared error falls with this power of the number of lens samples at least, where nothing but the samples is at fault.
const MIN_POWER: f64 = 0.6;

/// Where doubling the number of lens samples gains less than this, more of them will not help.
const MIN_DB_PER_DOUBLING: f64 = 0.3;

/// With this power it falls for rays that are evenly spread.
const POWER_OF_RAYS: f64 = 1.2;

/// Predictions are off by a seventh as often as not: this much of a time budget is planned for.
const SHARE_OF_BUDGET: f64 = 0.85;

/// What a search found.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Outcome {
    /// What was to be reached.
    #[serde(rename = "goal")]
    pub target: Target,
    /// Whether it was.
    pub met: bool,
    /// Lens samples a pixel of the picture.
    pub views: usize,
    /// Every number of lens samples that was looked at, in order; none for a time.
    pub tried: Vec<Trial>,
    /// What is to be said, in words.
    pub statement: String,
}

impl Outcome {
    /// What there is to say, a warning if the goal was not reached.
    pub fn finding(&self) -> Finding {
        let say = if self.met { Finding::note } else { Finding::warning };
        say("views", self.statement.clone())
    }

    /// What the probes said of the number of lens samples that was chosen.
    pub fn estimate(&self) -> Option<ErrorEstimate> {
        self.tried.iter().find(|trial| trial.views == self.views).map(|trial| trial.estimate)
    }
}

/// One number of lens samples that was looked at.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Trial {
    /// Lens samples a pixel.
    pub views: usize,
    /// What the probes said.
    #[serde(flatten)]
    pub estimate: ErrorEstimate,
}

impl Trial {
    /// PSNR in dB; of an error too small to be seen, the least that it is.
    fn psnr_db(&self) -> f64 {
        self.estimate.psnr_db.unwrap_or(self.estimate.interval_db.0)
    }
}

/// The picture of `scene` as `plan` has it, with the fewest lens samples that reach `psnr_db`, or with the most that help.
///
/// # Errors
/// A method that cannot be asked for single pixels.
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

/// What [`render_to_target`] would find, without the picture.
///
/// # Errors
/// As [`render_to_target`].
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
        Error::settings(format!("{} cannot be asked for single pixels", plan.method))
            .help("ask for a number of lens samples with --views")
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
    // What a search ends with may miss the margin alone.
    let reached = tried.iter().any(|trial| trial.views == found.views && trial.psnr_db() >= psnr_db);
    let found = if reached { Found { end: End::Met, ..found } } else { found };
    let statement = statement(plan, psnr_db, &found, &tried, &probes);
    let target = Target::Error { psnr_db, max_views };
    Ok((sampler, Outcome { target, met: found.end == End::Met, views: found.views, tried, statement }))
}

/// The truth at some pixels of `scene`, and the step at which the search for `psnr_db` begins.
fn probes(scene: &Scene, plan: &Plan, psnr_db: f64, gain_db: [f64; 2]) -> (Probes, u32) {
    let scene = &*probes::with_guesses(scene, plan);
    let places = Places::new(scene, plan, PROBES, SEED);
    let first = first_step(psnr_db, places.spread(), gain_db);
    // Two halves of twice as many rays as samples: their own noise then adds little to what is measured.
    let rays_per_half = (2 * views_at(first)).clamp(MIN_RAYS, MANY_RAYS);
    (Probes::new(places, rays_per_half), first)
}

/// Lens samples of step `step` of the grid: 8, 12, 16, 24 …
fn views_at(step: u32) -> usize {
    let octave = step / 2;
    if step.is_multiple_of(2) { 8 << octave } else { 12 << octave }
}

/// The last step of the grid with at most `views` lens samples; the first of all, if none has so few.
fn step_within(views: usize) -> u32 {
    let mut step = 0;
    while views_at(step + 1) <= views {
        step += 1;
    }
    step
}

/// The step that is likely to reach `psnr_db` where the squared error of one ray is `spread`, see
/// [`methods::LensSampling::gain_db`].
fn first_step(psnr_db: f64, spread: f64, [gain_of_16, gain_of_step]: [f64; 2]) -> u32 {
    const STEP_OF_16: f64 = 2.0;
    const LAST: f64 = 16.0;
    let wanted = psnr_db + 10.0 * spread.max(1e-12).log10();
    ((wanted - gain_of_16) / gain_of_step + STEP_OF_16).ceil().clamp(0.0, LAST) as u32
}

/// The picture of `scene`, which shows `stats`, as `plan` has it, with as many lens samples as `calibration` predicts the blur to
/// have time for: `seconds` on the wall.
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
    let few = if predicted > seconds { "; fewer are not worth a picture" } else { "" };
    let statement =
        format!("{views} views took {taken:.2} s of {seconds} s, predicted were {predicted:.2} s{few}");
    let target = Target::Time { seconds };
    Ok((image, Outcome { target, met: taken <= seconds, views, tried: Vec::new(), statement }))
}

/// The lens samples that are expected to fit into `seconds`, with some room; the fewest of all where none do.
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
            Error::settings(format!("how long {} takes cannot be predicted", plan.method)).help(
                "ask for a number of lens samples with --views, or for a sampling error with --target-db",
            )
        })?;
    Ok(views_at(step_within(affordable)))
}

/// How a search ended.
#[derive(Debug, Clone, Copy, PartialEq)]
enum End {
    /// With the fewest lens samples that reach the target.
    Met,
    /// At the most lens samples that it may take.
    Most,
    /// Where more would not help: they approach this PSNR in dB.
    Floor(f64),
}

/// The lens samples to paint with, and how they were found.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Found {
    views: usize,
    end: End,
}

/// PSNRs in dB by step of the grid.
type Known = BTreeMap<u32, f64>;

/// Looks for the fewest lens samples, up to `most`, whose PSNR, as `measure` has it, reaches `target_db`; begins at step `first`.
fn search(target_db: f64, first: u32, most: usize, mut measure: impl FnMut(usize) -> f64) -> Found {
    let last = step_within(most);
    let views = |step: u32| views_at(step).min(most);
    let mut known = Known::new();
    let mut step = first.min(last);
    loop {
        known.insert(step, measure(views(step)));
        match next(&known, target_db, last) {
            Step::Try(next) => step = next,
            Step::End(step, end) => return Found { views: views(step), end },
        }
    }
}

/// What to do after some steps of the grid are known.
enum Step {
    Try(u32),
    End(u32, End),
}

fn next(known: &Known, target_db: f64, last: u32) -> Step {
    let reaches = |(_, db): &(&u32, &f64)| **db >= target_db;
    let enough = known.iter().find(reaches);
    // Of the steps below it: one above that misses the target does so by chance.
    let mut below = known.iter().filter(|(step, _)| enough.is_none_or(|(enough, _)| *step < enough));
    match (below.next_back(), enough) {
        (_, None) => more(known, target_db, last),
        (None, Some((&step, &db))) => fewer(step, db - target_db),
        (Some((&short, &short_db)), Some((&step, &db))) => {
            between((short, short_db - target_db), (step, db - target_db))
        }
    }
}

/// Nothing known reaches the target.
fn more(known: &Known, target_db: f64, last: u32) -> Step {
    let Some((&step, &db)) = known.last_key_value() else { return Step::Try(0) };
    let end = if step >= last { Some(End::Most) } else { floor_db(known, target_db).map(End::Floor) };
    match end {
        Some(end) => Step::End(fewest_as_good(known), end),
        None => {
            let steps = ((target_db - db) / DB_PER_STEP).ceil().clamp(1.0, 6.0) as u32;
            Step::Try((step + steps).min(last))
        }
    }
}

/// Everything known reaches the target, step `step`, the lowest, by `surplus_db`.
fn fewer(step: u32, surplus_db: f64) -> Step {
    let steps = (surplus_db / DB_PER_STEP).floor().clamp(0.0, 6.0) as u32;
    if step == 0 || steps < STEPS_WORTH_A_TRIAL {
        Step::End(step, End::Met)
    } else {
        Step::Try(step - steps.min(step))
    }
}

/// Step `short` misses the target, by `short_db` below nothing, step `enough` reaches it, by `surplus_db`.
fn between((short, short_db): (u32, f64), (enough, surplus_db): (u32, f64)) -> Step {
    let steps = enough - short;
    let share = -short_db / (surplus_db - short_db).max(1e-3);
    let needed = (share * f64::from(steps)).ceil().max(1.0) as u32;
    if steps <= NEAR_STEPS || needed >= steps {
        Step::End(enough, End::Met)
    } else {
        Step::Try(short + needed)
    }
}

/// The PSNR in dB that more and more lens samples approach, if it misses the target.
fn floor_db(known: &Known, target_db: f64) -> Option<f64> {
    let (&last, &last_db) = known.last_key_value()?;
    let before = |steps: u32| known.iter().rfind(|(step, _)| **step + steps <= last);
    if let Some((step, db)) = before(2)
        && 2.0 * (last_db - db) / f64::from(last - step) < MIN_DB_PER_DOUBLING
    {
        return Some(last_db);
    }
    // Only numbers far enough apart tell a floor ahead from chance: four times as many.
    let (&step, &db) = before(4)?;
    let error = |db: f64| 10f64.powf(-0.1 * db);
    let falls_to = (views_at(last) as f64 / views_at(step) as f64).powf(-MIN_POWER);
    let floor = (error(last_db) - error(db) * falls_to) / (1.0 - falls_to);
    (floor >= error(target_db)).then(|| -10.0 * floor.log10())
}

/// The lowest of the `known` steps that is hardly worse than the best.
fn fewest_as_good(known: &Known) -> u32 {
    const HARDLY_DB: f64 = 0.5;
    let best = known.values().fold(f64::NEG_INFINITY, |best, db| best.max(*db));
    known.iter().find(|(_, db)| **db >= best - HARDLY_DB).map_or(0, |(step, _)| *step)
}

/// What there is to say of a search for `target_db`.
fn statement(plan: &Plan, target_db: f64, found: &Found, tried: &[Trial], probes: &Probes) -> String {
    let (method, views) = (plan.method, found.views);
    let reached = tried.iter().find(|trial| trial.views == views);
    let reached = reached.map_or_else(String::new, |trial| trial.estimate.to_string());
    match found.end {
        End::Met => format!("{views} views reach {reached}; asked for were {target_db} dB"),
        End::Most => {
            format!("the most views that this is worth, {views}, reach {reached}, not {target_db} dB")
        }
        End::Floor(floor_db) => {
            // Few rays meet a light: how many it takes does not show at a few hundred pixels.
            let rays = if plan.does(crate::scene::EffectKind::Highlights) {
                "very many rays: the stack has lights, and few rays meet one".to_owned()
            } else {
                format!("about {} rays", probes.rays_for(target_db, POWER_OF_RAYS))
            };
            format!(
                "{method} cannot reach {target_db} dB on this stack: {views} views reach {reached}, and no number of them more \
                 than about {floor_db:.0} dB; accumulate can (--method accumulate), with {rays}"
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A search for `target_db` from 64 on, and the numbers it tried, where the error is `floor + noise / views ^ power`.
    fn searched(target_db: f64, [floor, noise, power]: [f64; 3], most: usize) -> (Found, Vec<usize>) {
        let mut tried = Vec::new();
        let found = search(target_db, step_within(64), most, |views| {
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
    fn the_fewest_samples_that_reach_the_target_are_found_in_a_few_looks() {
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
    fn an_error_that_samples_do_not_take_away_ends_the_search() {
        let (found, tried) = searched(50.0, [2e-5, 2e-3, 1.2], 1 << 16);
        let End::Floor(floor_db) = found.end else { panic!("{found:?} after {tried:?}") };
        assert!((47.0..48.5).contains(&floor_db), "47 dB, and seen from above: {floor_db}");
        assert!(*tried.last().unwrap() <= 1024, "{tried:?}");
    }

    #[test]
    fn a_search_does_not_climb_for_nothing() {
        // 48 dB are asked for and all but reached: 47.96 is the floor.
        let (found, tried) = searched(48.0, [1.6e-5, 3e-4, 1.1], 1 << 16);
        assert!(matches!(found.end, End::Floor(_)) && tried.len() <= 6, "{found:?} after {tried:?}");
    }

    #[test]
    fn a_search_stops_at_the_most_samples_it_may_take() {
        let (found, tried) = searched(60.0, [0.0, 1e-2, 1.0], 100);
        assert_eq!((found.end, found.views), (End::Most, 96), "after {tried:?}");
        let (found, _) = searched(60.0, [0.0, 1e-2, 1.0], 2);
        assert_eq!((found.end, found.views), (End::Most, 2), "even below the smallest table");
    }

    #[test]
    fn more_samples_that_make_it_no_better_are_not_spent() {
        let (found, tried) = searched(60.0, [1e-4, 1e-9, 1.0], 1 << 16);
        assert_eq!(found.views, 64, "{found:?} after {tried:?}");
    }

    #[test]
    fn the_first_guess_follows_the_target_and_the_spread() {
        let first = |db, spread| views_at(first_step(db, spread, [21.5, 1.25]));
        assert!(first(45.0, 1e-2) > first(40.0, 1e-2), "a higher target");
        assert!(first(45.0, 1e-2) > first(45.0, 1e-3), "a busier scene");
        assert_eq!(first(45.0, 0.0), 8, "nothing differs");
        assert!(
            views_at(first_step(45.0, 1e-2, [15.0, 1.25])) > first(45.0, 1e-2),
            "single rays are noisier"
        );
    }
}
