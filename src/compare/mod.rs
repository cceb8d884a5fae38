//! COMPARE: methods on one stack against each other: what each costs, and how far it is from the truth.
//!
//! Two errors, never mixed: the *sampling error*, against what the stack itself says ([`crate::probes`]), which is always
//! known, and the *model error*, against a true render, where there is one.

mod contender;

pub use contender::Contender;

use crate::error::Error;
use crate::image::Image;
use crate::methods;
use crate::metrics::{Pair, Score};
use crate::output::usage::Stopwatch;
use crate::probes::{self, Verdict};
use crate::render::Prepared;

/// What became of one contender.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Entry {
    /// The contender as the command line writes it.
    pub name: String,
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
        let plan = methods::plan(facts, &contender.settings(settings)?)?;
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
            name: contender.to_string(),
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
            name: "shear".to_owned(),
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
