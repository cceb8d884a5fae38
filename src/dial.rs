//! DIAL: the number of lens samples that reaches a goal, found by looking at a few pixels first.
//!
//! A picture at twice the samples costs twice the time, so none is painted to be thrown away. The truth is found at a few hundred
//! pixels ([`Probes`]), the method is asked for these pixels alone ([`Sampler::pixels`]) with rising or falling numbers of samples,
//! and when the number is known the picture is painted once. What the probes said of that number is then true of the picture.
//!
//! The numbers are powers of two, for which the tables of lens samples are made. Where more samples stop helping (a method that
//! makes the picture in another way than ray by ray has an error that no number of samples takes away) the search ends and
//! says so.

use crate::error::Error;
use crate::image::Image;
use crate::methods::{self, Progress, Sampler};
use crate::probes::{self, Probes, SEED, Verdict};
use crate::scene::{Goal, Plan, Scene};
use serde::Serialize;
use std::collections::BTreeMap;

/// Pixels at which numbers of samples are tried.
const PROBES: usize = 200;

/// Fewest lens samples that are tried: the smallest table's.
const FEWEST_VIEWS: usize = 8;

/// A target is met if it is missed by no more than this: about half the standard error of the estimate.
const TOLERANCE_DB: f64 = 0.25;

/// What doubling the number of lens samples gains where nothing better is known.
const DB_PER_DOUBLING: f64 = 2.5;

/// Squared error falls with this power of the number of lens samples at least, where nothing but the samples is at fault.
const LEAST_POWER: f64 = 0.6;

/// With this power it falls for rays that are evenly spread.
const POWER_OF_RAYS: f64 = 1.2;

/// What a search found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Outcome {
    /// What was to be reached.
    pub goal: Goal,
    /// Whether it was.
    pub met: bool,
    /// Lens samples a pixel of the picture.
    pub views: usize,
    /// Every number of lens samples that was looked at, in order.
    pub tried: Vec<Trial>,
    /// What is to be said, in words.
    pub statement: String,
}

impl Outcome {
    /// What the probes said of the number of lens samples that was chosen.
    pub fn verdict(&self) -> Option<Verdict> {
        self.tried.iter().find(|trial| trial.views == self.views).map(|trial| trial.verdict)
    }
}

/// One number of lens samples that was looked at.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Trial {
    /// Lens samples a pixel.
    pub views: usize,
    /// What the probes said.
    #[serde(flatten)]
    pub verdict: Verdict,
}

impl Trial {
    /// PSNR in dB; of an error too small to be seen, the least that it is.
    fn psnr_db(&self) -> f64 {
        self.verdict.psnr_db.unwrap_or(self.verdict.interval_db.0)
    }
}

/// The picture of `scene` as `plan` has it, with the fewest lens samples that reach `psnr_db`, or with the most that help.
///
/// # Errors
/// A method that cannot be asked for single pixels.
pub fn reach(
    scene: Scene,
    plan: &Plan,
    (psnr_db, most_views): (f64, usize),
    progress: &Progress<'_>,
) -> Result<(Image, Outcome), Error> {
    let (mut sampler, probes) = begin(scene, plan)?;
    let pixels = probes.pixels();
    let mut tried = Vec::new();
    let found = search(psnr_db, plan.lens_samples(), most_views, |views| {
        let trial = Trial { views, verdict: probes.judge(&sampler.pixels(views, &pixels)) };
        tried.push(trial);
        trial.psnr_db()
    });
    let image = sampler.picture(found.views, progress);
    let statement = statement(plan.method, psnr_db, &found, &tried, &probes);
    let goal = Goal::TargetDb { psnr_db, most_views };
    Ok((image, Outcome { goal, met: found.end == End::Met, views: found.views, tried, statement }))
}

/// The plan's method at work on `scene`, and the truth at some of its pixels.
fn begin(scene: Scene, plan: &Plan) -> Result<(Box<dyn Sampler + '_>, Probes), Error> {
    let method = methods::by_name(plan.method)?;
    let Some(sampling) = method.lens_sampling() else {
        return Err(Error::settings(format!("{} cannot be asked for single pixels", plan.method))
            .help("ask for a number of lens samples with --views"));
    };
    // Twice the samples that are likely to do: their own noise then adds little to what is measured.
    let rays_per_half = (2 * plan.lens_samples()).clamp(64, probes::MANY_RAYS);
    let probes = Probes::new(&scene, plan, PROBES, rays_per_half, SEED);
    Ok((sampling.begin(scene, plan), probes))
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

/// Looks for the smallest power of two, up to `most`, whose PSNR, as `measure` has it, reaches `target_db`; begins at `first`.
fn search(target_db: f64, first: usize, most: usize, mut measure: impl FnMut(usize) -> f64) -> Found {
    let mut known = BTreeMap::new();
    let mut views = first.clamp(FEWEST_VIEWS.min(most), most);
    loop {
        known.insert(views, measure(views));
        match next(&known, target_db, most) {
            Step::Try(next) => views = next,
            Step::End(found) => return found,
        }
    }
}

/// What to do after the numbers of lens samples that are `known`, each with its PSNR.
enum Step {
    Try(usize),
    End(Found),
}

fn next(known: &BTreeMap<usize, f64>, target_db: f64, most: usize) -> Step {
    let enough = known.iter().find(|(_, db)| **db >= target_db - TOLERANCE_DB);
    let short = known.iter().rfind(|(_, db)| **db < target_db - TOLERANCE_DB);
    match (short, enough) {
        (Some((&views, &db)), None) => more(known, (views, db), target_db, most),
        (None, Some((&views, &db))) => fewer((views, db), target_db),
        // What reaches the target with fewer than something that misses it does so by chance.
        (Some((&less, &less_db)), Some((&views, &db))) => between((less, less_db), (views, db), target_db),
        (None, None) => Step::End(Found { views: most, end: End::Most }),
    }
}

/// Nothing known reaches the target, `views` with `db` come nearest to it.
fn more(known: &BTreeMap<usize, f64>, (views, db): (usize, f64), target_db: f64, most: usize) -> Step {
    let end = if views >= most { Some(End::Most) } else { floor_db(known, target_db).map(End::Floor) };
    if let Some(end) = end {
        return Step::End(Found { views: fewest_as_good(known), end });
    }
    let doublings = ((target_db - db) / DB_PER_DOUBLING).ceil().clamp(1.0, 3.0) as u32;
    Step::Try((views << doublings).min(most))
}

/// Everything known reaches the target; `views`, the fewest, have `db`.
fn fewer((views, db): (usize, f64), target_db: f64) -> Step {
    // Halving may cost little: as little as this where the picture is smooth.
    const LEAST_DB_PER_DOUBLING: f64 = 1.5;
    let halvings = ((db - target_db) / LEAST_DB_PER_DOUBLING).floor().clamp(0.0, 2.0) as u32;
    let tried = (views >> halvings).max(FEWEST_VIEWS);
    if tried < views { Step::Try(tried) } else { Step::End(Found { views, end: End::Met }) }
}

/// `less` views miss the target, `views` reach it.
fn between((less, less_db): (usize, f64), (views, db): (usize, f64), target_db: f64) -> Step {
    let doublings = (views as f64 / less as f64).log2();
    let needed = ((target_db - less_db) / (db - less_db).max(1e-3) * doublings).ceil().max(1.0);
    if needed >= doublings {
        return Step::End(Found { views, end: End::Met });
    }
    Step::Try(less << needed as u32)
}

/// The PSNR in dB that more and more lens samples approach, if it misses the target.
fn floor_db(known: &BTreeMap<usize, f64>, target_db: f64) -> Option<f64> {
    // Only numbers far enough apart tell a floor from chance.
    const APART: usize = 4;
    let (&most, &most_db) = known.last_key_value()?;
    let (&fewer, &fewer_db) = known.iter().rfind(|(views, _)| **views * APART <= most)?;
    let error = |db: f64| 10f64.powf(-0.1 * db);
    let falls_to = (most as f64 / fewer as f64).powf(-LEAST_POWER);
    let floor = (error(most_db) - error(fewer_db) * falls_to) / (1.0 - falls_to);
    (floor >= error(target_db)).then(|| -10.0 * floor.log10())
}

/// The fewest of the `known` lens samples that are hardly worse than the best.
fn fewest_as_good(known: &BTreeMap<usize, f64>) -> usize {
    const HARDLY_DB: f64 = 0.5;
    let best = known.values().fold(f64::NEG_INFINITY, |best, db| best.max(*db));
    known.iter().find(|(_, db)| **db >= best - HARDLY_DB).map_or(FEWEST_VIEWS, |(views, _)| *views)
}

/// What there is to say of a search for `target_db`.
fn statement(method: &str, target_db: f64, found: &Found, tried: &[Trial], probes: &Probes) -> String {
    let views = found.views;
    let reached = tried.iter().find(|trial| trial.views == views);
    let reached = reached.map_or_else(String::new, |trial| trial.verdict.to_string());
    match found.end {
        End::Met => format!("{views} views reach {reached}; asked for were {target_db} dB"),
        End::Most => {
            format!("the most views that this is worth, {views}, reach {reached}, not {target_db} dB")
        }
        End::Floor(floor_db) => {
            let rays = probes.rays_for(target_db, POWER_OF_RAYS);
            format!(
                "{method} cannot reach {target_db} dB on this stack: {views} views reach {reached}, and no number of them more \
                 than about {floor_db:.0} dB; accumulate can, with about {rays} rays (--method accumulate)"
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
        let db = |views: usize| -10.0 * (floor + noise * (views as f64).powf(-power)).log10();
        let found = search(target_db, 64, most, |views| {
            tried.push(views);
            db(views)
        });
        (found, tried)
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
                    assert!(db(found.views) >= target_db - TOLERANCE_DB, "too few: {case}");
                    let half_would_do = db(found.views / 2) >= target_db && found.views > FEWEST_VIEWS;
                    assert!(!half_would_do || db(found.views) < target_db + 3.0, "too many: {case}");
                    assert!(tried.len() <= 8, "{case}");
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
    fn a_search_stops_at_the_most_samples_it_may_take() {
        let (found, tried) = searched(60.0, [0.0, 1e-2, 1.0], 100);
        assert_eq!((found.end, found.views), (End::Most, 100), "after {tried:?}");
        let (found, _) = searched(60.0, [0.0, 1e-2, 1.0], 2);
        assert_eq!((found.end, found.views), (End::Most, 2), "even below the smallest table");
    }

    #[test]
    fn more_samples_that_make_it_no_better_are_not_spent() {
        let (found, tried) = searched(60.0, [1e-4, 1e-9, 1.0], 1 << 16);
        assert_eq!(found.views, 64, "{found:?} after {tried:?}");
    }
}
