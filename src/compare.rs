//! COMPARE: methods on one stack against each other: what each costs, and how far it is from the truth.
//!
//! Two errors, never mixed: the *sampling error*, against what the stack itself says ([`crate::probes`]), which is always
//! known, and the *model error*, against a true render, where there is one.

use crate::error::Error;
use crate::image::Image;
use crate::methods;
use crate::metrics::{Pair, Score};
use crate::output::usage::Stopwatch;
use crate::probes::{self, Verdict};
use crate::render::Prepared;
use crate::settings::{Origin, Settings, Sourced};
use std::fmt;
use std::str::FromStr;

/// A method with a number of lens samples: `NAME`, or `NAME:VIEWS`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Contender {
    /// Name of the method.
    pub method: &'static str,
    /// Lens samples a pixel; the method's own number where none is given.
    pub views: Option<usize>,
}

impl FromStr for Contender {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let (name, views) = match text.split_once(':') {
            None => (text, None),
            Some((name, views)) => {
                let number = views.parse().map_err(|_| {
                    Error::settings("what follows a method's name and a colon is a number of views")
                        .with("found", text)
                        .help("write shear:64, or the name alone")
                })?;
                (name, Some(number))
            }
        };
        Ok(Self { method: methods::by_name(name)?.info().name, views })
    }
}

impl fmt::Display for Contender {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.views {
            Some(views) => write!(f, "{}:{views}", self.method),
            None => f.write_str(self.method),
        }
    }
}

/// Every method but the reference, which is the truth that the others are measured by.
pub fn all() -> Vec<Contender> {
    let infos = methods::METHODS.iter().map(|method| method.info());
    infos
        .filter(|info| info.role != "reference")
        .map(|info| Contender { method: info.name, views: None })
        .collect()
}

/// What became of one contender.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Entry {
    /// Name of the method.
    pub method: &'static str,
    /// Lens samples a pixel; `null` for a method that does not sample the lens.
    pub views: Option<usize>,
    /// Processor seconds of the blur: the median of the runs.
    pub cpu_seconds: f64,
    /// Wall seconds of the blur: the median of the runs.
    pub seconds: f64,
    /// How often it ran.
    pub runs: usize,
    /// The sampling error.
    pub sampling: Verdict,
    /// The model error, where there is a reference.
    pub model: Option<Score>,
    /// Whether no other entry is both quicker and nearer to the truth.
    pub on_front: bool,
}

impl Entry {
    /// PSNR that the front is drawn by: against the reference, where there is one, else against the stack's truth.
    pub fn psnr_db(&self) -> f64 {
        self.model.map_or(self.sampling.psnr_db.unwrap_or(f64::INFINITY), |score| score.psnr_db)
    }
}

/// How to compare.
#[derive(Debug, Clone, Copy)]
pub struct Comparison<'a> {
    /// The stack, its lens and its settings; their method is not used.
    pub prepared: &'a Prepared,
    /// The true render, if there is one.
    pub reference: Option<&'a Image>,
    /// How often each contender runs, at least once.
    pub repeats: usize,
    /// Pixels to compare with the stack's truth.
    pub probes: usize,
}

impl Comparison<'_> {
    /// Runs `contender` and measures it; gives its picture too.
    ///
    /// # Errors
    /// Those of the plan and of the method, and a reference of another size.
    pub fn run(&self, contender: &Contender) -> Result<(Entry, Image), Error> {
        let Prepared { scene, facts, settings, .. } = self.prepared;
        let flag = |value| Sourced { value, origin: Origin::Flag };
        let settings = Settings {
            method: Sourced { value: contender.method.to_owned(), origin: Origin::Flag },
            views: contender.views.map_or(settings.views.clone(), |views| flag(Some(views))),
            ..settings.clone()
        };
        let plan = methods::plan(facts, &settings)?;
        let mut runs = Vec::with_capacity(self.repeats);
        let mut picture = None;
        for _ in 0..self.repeats.max(1) {
            let scene = scene.clone();
            let watch = Stopwatch::start();
            picture = Some(methods::render(scene, &plan, &|_| {})?);
            runs.push([watch.cpu_seconds(), watch.seconds()]);
        }
        let image = picture.unwrap_or_default();
        let model = self.reference.map(|reference| Pair::new(&image, reference, 0)).transpose()?;
        let entry = Entry {
            method: plan.method,
            views: plan.views,
            cpu_seconds: median(runs.iter().map(|run| run[0])),
            seconds: median(runs.iter().map(|run| run[1])),
            runs: runs.len(),
            sampling: probes::verify(&image, scene, &plan, self.probes, probes::SEED),
            model: model.map(|pair| pair.score()),
            on_front: false,
        };
        Ok((entry, image))
    }
}

/// Marks the entries that no other beats in both time and accuracy.
pub fn mark_front(entries: &mut [Entry]) {
    let places: Vec<(f64, f64)> = entries.iter().map(|entry| (entry.cpu_seconds, entry.psnr_db())).collect();
    for (entry, &(seconds, db)) in entries.iter_mut().zip(&places) {
        let beaten = places.iter().any(|&(s, d)| s <= seconds && d >= db && (s < seconds || d > db));
        entry.on_front = !beaten;
    }
}

/// The middle one of `values`, of an even number the lower of the two.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len().saturating_sub(1) / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(cpu_seconds: f64, psnr_db: f64) -> Entry {
        let sampling =
            Verdict { psnr_db: Some(psnr_db), interval_db: (psnr_db, None), pixels: 1, rays_per_pixel: 1 };
        Entry {
            method: "shear",
            views: None,
            cpu_seconds,
            seconds: cpu_seconds,
            runs: 1,
            sampling,
            model: None,
            on_front: false,
        }
    }

    #[test]
    fn a_contender_is_a_method_with_or_without_views() {
        let parse = |text: &str| text.parse::<Contender>();
        assert_eq!(parse("scatter").unwrap(), Contender { method: "scatter", views: None });
        assert_eq!(parse("shear:64").unwrap().to_string(), "shear:64");
        assert!(parse("sheer").unwrap_err().to_string().contains("did you mean 'shear'?"));
        assert!(parse("shear:many").unwrap_err().to_string().contains("number of views"));
    }

    #[test]
    fn the_front_is_what_nothing_else_beats_in_both() {
        let mut entries = [entry(1.0, 30.0), entry(2.0, 40.0), entry(3.0, 35.0), entry(0.5, 20.0)];
        mark_front(&mut entries);
        assert_eq!(entries.map(|entry| entry.on_front), [true, true, false, true]);
    }

    #[test]
    fn the_median_of_an_even_number_is_a_run_that_was_there() {
        assert_eq!(median([3.0, 1.0, 2.0].into_iter()), 2.0);
        assert_eq!(median([4.0, 1.0].into_iter()), 1.0);
    }
}
