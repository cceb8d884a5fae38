//! COMPARE: methods on one stack against each other: what each costs, and how far it is from the truth.
//!
//! Two errors, never mixed: the *sampling error*, against what the stack itself says ([`crate::probes`]), which is always
//! known, and the *model error*, against a true render, where there is one.
//!
//! [`Comparison::run`] measures one candidate; [`Results`] is all that was found, with a file for each format that it is
//! written in. The pictures stay in a [`Gallery`] until [`folder::write`] has looked at them.

mod candidate;
mod crops;
mod csv;
pub mod folder;
mod gallery;
mod html;
mod picture;
pub mod shell;
mod table;

pub use candidate::Candidate;
pub use csv::csv;
pub use gallery::Gallery;
pub use picture::Picture;
pub use table::table;

use crate::cost::{self, Calibration, Prediction};
use crate::error::Error;
use crate::finish::finish;
use crate::image::Image;
use crate::machine::Machine;
use crate::methods;
use crate::methods::Plan;
use crate::metrics::{Pair, Score};
use crate::output::report::{LensReport, Report, StackReport};
use crate::probes::{ErrorEstimate, Probes};
use crate::render::Prepared;
use crate::usage::Stopwatch;
use serde::{Deserialize, Serialize};

/// A whole comparison: what `results.json` holds. Other people's scripts read it, so keys are only ever added.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Results {
    /// Version of this tool.
    pub version: &'static str,
    /// The command line, as a shell reads it.
    pub command: String,
    /// The files read.
    pub input: Vec<String>,
    /// The file of the true render, if there is one.
    pub reference: Option<String>,
    /// What was read.
    pub stack: StackReport,
    /// The lens, each value with its origin.
    pub lens: LensReport,
    /// Texts of the findings that the user should look at.
    pub warnings: Vec<String>,
    /// What it ran on.
    pub machine: Machine,
    /// How often each candidate ran.
    pub repeats: usize,
    /// Pixels at which the sampling error was to be measured.
    pub probes: usize,
    /// Reading and planning, which all entries share.
    pub prepared: Cost,
    /// What became of each candidate.
    pub entries: Vec<Entry>,
    /// What error maps and crops were measured against; `null` where no pictures were kept.
    #[serde(rename = "yardstick")]
    pub baseline: Option<Baseline>,
    /// The places where the pictures differ most, from the greatest difference down; none where no pictures were kept.
    pub crops: Vec<Crop>,
}

/// What something cost.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// Processor seconds, all threads together.
    pub cpu_seconds: f64,
    /// Seconds on the wall.
    pub seconds: f64,
}

/// What became of one candidate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// The candidate as the command line writes it.
    pub name: String,
    /// Name of the method.
    pub method: String,
    /// Lens samples a pixel; `null` for a method that does not sample the lens.
    pub views: Option<usize>,
    /// Processor seconds of the blur: the median of the runs.
    pub cpu_seconds: f64,
    /// Wall seconds of the blur: the median of the runs.
    pub seconds: f64,
    /// Every run of the blur, in order.
    pub runs: Vec<Cost>,
    /// Reading, planning and the blur.
    pub whole: Cost,
    /// What the blur was expected to cost, if that was asked for.
    pub predicted: Option<Prediction>,
    /// The sampling error.
    pub sampling: ErrorEstimate,
    /// The model error, where there is a reference.
    pub model: Option<Score>,
    /// Whether no other entry is both quicker and nearer to the truth.
    pub on_front: bool,
    /// The command line that renders this picture.
    pub command: String,
    /// The picture, a file of the same folder.
    pub picture: Option<String>,
    /// FLIP at each pixel against the baseline, a file of the same folder; `null` for the baseline itself.
    pub map: Option<String>,
}

/// What error maps and crops are measured against.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "kind", content = "name")]
pub enum Baseline {
    /// The true render.
    Reference,
    /// The entry of this name, the nearest to the stack's truth.
    Entry(String),
}

/// A place where the pictures differ.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Crop {
    /// First column of the square in the data window.
    pub x: usize,
    /// First row.
    pub y: usize,
    /// Width and height.
    pub side_px: usize,
    /// PSNR of the pinhole picture against the baseline within the square, in dB.
    pub pinhole_psnr_db: Option<f64>,
    /// PSNR of each entry's picture, in their order; `null` where it is the baseline's, value for value.
    pub psnr_db: Vec<Option<f64>>,
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
    /// How often each candidate runs, at least once.
    pub repeats: usize,
    /// The stack's truth at some pixels.
    pub probes: &'a Probes,
    /// How fast this machine is, if costs are to be predicted too.
    pub calibration: Option<&'a Calibration>,
    /// The words of a command line that give the inputs and the lens.
    pub words: &'a [String],
}

impl Comparison<'_> {
    /// What `candidate` is to do.
    ///
    /// # Errors
    /// Those of its settings and of the plan, such as an effect asked for that it has no step for.
    pub fn plan(&self, candidate: &Candidate) -> Result<Plan, Error> {
        let Prepared { stats, settings, methods, .. } = self.prepared;
        methods.plan(stats, &candidate.settings(settings)?)
    }

    /// Runs `candidate` and measures it; gives its picture too.
    ///
    /// # Errors
    /// Those of the plan and of the method, and a reference of another size.
    pub fn run(&self, candidate: &Candidate) -> Result<(Entry, Image), Error> {
        let Prepared { scene, stats, .. } = self.prepared;
        let plan = self.plan(candidate)?;
        let mut runs = Vec::with_capacity(self.repeats);
        let mut picture = None;
        for _ in 0..self.repeats.max(1) {
            let scene = scene.clone();
            let watch = Stopwatch::start();
            picture = Some(methods::render(scene, &plan, &|_| {})?);
            runs.push(Cost { cpu_seconds: watch.cpu_seconds(), seconds: watch.seconds() });
        }
        let painted = picture.unwrap_or_default();
        let sampling = self.probes.estimate_image(&painted);
        let image = finish(painted, &plan, scene.field).trimmed(scene.outside_px);
        let model = self.reference.map(|reference| Pair::new(&image, reference, 0)).transpose()?;
        let blur = Cost {
            cpu_seconds: median(runs.iter().map(|run| run.cpu_seconds)),
            seconds: median(runs.iter().map(|run| run.seconds)),
        };
        let entry = Entry {
            name: candidate.to_string(),
            method: plan.method.name().to_owned(),
            views: plan.views,
            cpu_seconds: blur.cpu_seconds,
            seconds: blur.seconds,
            runs,
            whole: blur.and(self.prepared_cost()),
            predicted: self.calibration.and_then(|calibration| cost::predict(stats, &plan, calibration)),
            sampling,
            model: model.map(|pair| pair.score()),
            on_front: false,
            command: self.command(candidate),
            picture: None,
            map: None,
        };
        Ok((entry, image))
    }

    /// Results without any entry: what is known before the first candidate runs. `command` is the command line of the
    /// comparison, `input` and `reference` the files read.
    pub fn results(&self, command: String, input: Vec<String>, reference: Option<String>) -> Results {
        let Prepared { summary, settings, lens, stack, .. } = self.prepared;
        Results {
            version: env!("CARGO_PKG_VERSION"),
            command,
            input,
            reference,
            stack: summary.clone(),
            lens: LensReport::new(settings, lens),
            warnings: Report::warnings(&stack.findings),
            machine: Machine::this(),
            repeats: self.repeats,
            probes: self.probes.pixels().len(),
            prepared: self.prepared_cost(),
            entries: Vec::new(),
            baseline: None,
            crops: Vec::new(),
        }
    }

    /// Reading and planning.
    fn prepared_cost(&self) -> Cost {
        let (cpu, wall) = (self.prepared.clock.cpu_seconds(), self.prepared.clock.seconds());
        Cost { cpu_seconds: cpu.read + cpu.plan, seconds: wall.read + wall.plan }
    }

    /// The command line that renders the picture of `candidate`.
    fn command(&self, candidate: &Candidate) -> String {
        let output = format!("{}.exr", candidate.file_stem());
        let words = ["thinlens", "render"].map(str::to_owned).into_iter().chain(self.words.iter().cloned());
        shell::line(words.chain(candidate.flags()).chain(["-o".to_owned(), output]))
    }
}

impl Cost {
    /// This and `other` together.
    fn and(self, other: Self) -> Self {
        Self { cpu_seconds: self.cpu_seconds + other.cpu_seconds, seconds: self.seconds + other.seconds }
    }
}

impl Results {
    /// Marks the entries that no other beats in both time and accuracy.
    pub fn mark_front(&mut self) {
        let places: Vec<(f64, f64)> =
            self.entries.iter().map(|entry| (entry.cpu_seconds, entry.psnr_db())).collect();
        for (entry, &(seconds, db)) in self.entries.iter_mut().zip(&places) {
            let beaten = places.iter().any(|&(s, d)| s <= seconds && d >= db && (s < seconds || d > db));
            entry.on_front = !beaten;
        }
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
    use crate::lens::{LensSpec, ThinLens};
    use crate::settings::{DepthConvention, ParameterValues, SensorDistance, Settings};
    use crate::stack::{Precision, StackKind};

    /// An entry of `shear` that took `cpu_seconds` and came this near to the truth.
    pub(super) fn entry(cpu_seconds: f64, psnr_db: f64) -> Entry {
        let cost = Cost { cpu_seconds, seconds: cpu_seconds };
        Entry {
            name: "shear".to_owned(),
            method: "shear".to_owned(),
            views: None,
            cpu_seconds,
            seconds: cpu_seconds,
            runs: vec![cost],
            whole: cost,
            predicted: None,
            sampling: ErrorEstimate {
                psnr_db: Some(psnr_db),
                interval_db: (psnr_db, None),
                pixels: 1,
                rays_per_pixel: 1,
            },
            model: None,
            on_front: false,
            command: "thinlens render a.exr".to_owned(),
            picture: None,
            map: None,
        }
    }

    /// A comparison of `entries`.
    pub(super) fn results(entries: Vec<Entry>) -> Results {
        let lens = LensSpec {
            focal_length_mm: 50.0,
            f_number: 2.0,
            focus_distance: 4.0,
            sensor_width_mm: 36.0,
            sensor_distance: SensorDistance::FocalLength,
            metres_per_unit: 1.0,
        };
        let lens = ThinLens::new(&lens, 100.0).unwrap();
        Results {
            version: "0",
            command: "thinlens compare a.exr".to_owned(),
            input: vec!["a.exr".to_owned()],
            reference: None,
            stack: StackReport {
                width: 100,
                height: 80,
                peels: 2,
                kind: StackKind::PointSampled,
                supersample: 1,
                convention: DepthConvention::Planar,
                precision: Precision::Half,
            },
            lens: LensReport::new(&Settings::resolve(&[], ParameterValues::default()), &lens),
            warnings: Vec::new(),
            machine: Machine::this(),
            repeats: 1,
            probes: 60,
            prepared: Cost { cpu_seconds: 0.1, seconds: 0.1 },
            entries,
            baseline: Some(Baseline::Entry("shear".to_owned())),
            crops: vec![Crop {
                x: 1,
                y: 2,
                side_px: 20,
                pinhole_psnr_db: Some(20.0),
                psnr_db: vec![None, Some(30.5)],
            }],
        }
    }

    #[test]
    fn the_front_is_what_nothing_else_beats_in_both() {
        let mut results =
            results(vec![entry(1.0, 30.0), entry(2.0, 40.0), entry(3.0, 35.0), entry(0.5, 20.0)]);
        results.mark_front();
        let on_front: Vec<bool> = results.entries.iter().map(|entry| entry.on_front).collect();
        assert_eq!(on_front, [true, true, false, true]);
    }

    #[test]
    fn the_median_of_an_even_number_is_a_run_that_was_there() {
        assert_eq!(median([3.0, 1.0, 2.0].into_iter()), 2.0);
        assert_eq!(median([4.0, 1.0].into_iter()), 1.0);
    }

    #[test]
    fn what_was_measured_is_read_back_from_json() {
        let model =
            Score { psnr_db: 31.5, ssim: Some(0.75), flip: 0.125, relative_mse: 0.5, log_psnr_db: 30.25 };
        let predicted = Some(Prediction { cpu_seconds: 0.5, seconds: 0.25 });
        let full = Entry { model: Some(model), predicted, views: Some(16), ..entry(1.5, 30.5) };
        let results = results(vec![entry(0.1, 20.1), full]);
        let json: serde_json::Value =
            serde_json::from_str(&serde_json::to_string(&results).unwrap()).unwrap();
        let read: Vec<Entry> = serde_json::from_value(json["entries"].clone()).unwrap();
        assert_eq!(read, results.entries);
        let read: Vec<Crop> = serde_json::from_value(json["crops"].clone()).unwrap();
        assert_eq!(read, results.crops);
        let read: Option<Baseline> = serde_json::from_value(json["yardstick"].clone()).unwrap();
        assert_eq!(read, results.baseline);
        let read: Machine = serde_json::from_value(json["machine"].clone()).unwrap();
        assert_eq!(read, results.machine);
        let (kind, stop) = (&json["stack"]["kind"], json["lens"]["f_number"]["value"].as_f64());
        assert_eq!((kind, stop.map(|stop| stop as f32)), (&"point-sampled".into(), Some(2.8)));
    }
}
