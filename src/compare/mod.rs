//! COMPARE: time and error of several methods on one stack.
//!
//! Two errors, never mixed: the *sampling error* is measured against many lens rays through the stack ([`crate::probes`]) and
//! always known; the *model error* is measured against a reference render with the lens on, if there is one.
//!
//! [`Comparison::run`] measures one candidate; [`Results`] holds all measurements, and each output format has a file of its
//! own. The pictures stay in a [`Gallery`] until [`folder::write`] has analyzed them.

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
use crate::probes::{ErrorEstimate, ProbeSet};
use crate::render::Prepared;
use crate::stack::{FramedImage, Window};
use crate::usage::Stopwatch;
use serde::{Deserialize, Serialize};

/// A whole comparison: the content of `results.json`. Scripts of users read it: keys are added, never changed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Results {
    /// Version of this tool.
    pub version: &'static str,
    /// The command line, quoted for a shell.
    pub command: String,
    /// The files read.
    pub input: Vec<String>,
    /// The file of the reference render, if there is one.
    pub reference: Option<String>,
    /// The part of the picture that is compared, in pixels of its data window.
    pub compared: Window,
    /// The stack.
    pub stack: StackReport,
    /// The lens, each value with its origin.
    pub lens: LensReport,
    /// Texts of the findings that are warnings.
    pub warnings: Vec<String>,
    /// The machine of the measurement.
    pub machine: Machine,
    /// Number of runs of each candidate.
    pub repeats: usize,
    /// Number of pixels at which the sampling error is measured.
    pub probes: usize,
    /// Cost of reading and planning, shared by all entries.
    pub prepared: Cost,
    /// The measurements of each candidate.
    pub entries: Vec<Entry>,
    /// What error maps and crops are measured against; `null` if no pictures were written.
    #[serde(rename = "yardstick")]
    pub baseline: Option<Baseline>,
    /// The crops in which the pictures differ most, the largest difference first; empty if no pictures were written.
    pub crops: Vec<Crop>,
}

/// Processor time and wall time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// Processor seconds of all threads.
    pub cpu_seconds: f64,
    /// Wall seconds.
    pub seconds: f64,
}

/// The measurements of one candidate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// The candidate in the syntax of the command line.
    pub name: String,
    /// Name of the method.
    pub method: String,
    /// Lens samples per pixel; `null` for a method that does not sample the lens.
    pub views: Option<usize>,
    /// Processor seconds of the blur: the median of the runs.
    pub cpu_seconds: f64,
    /// Wall seconds of the blur: the median of the runs.
    pub seconds: f64,
    /// The cost of every run of the blur, in order.
    pub runs: Vec<Cost>,
    /// Cost of reading, planning and blur.
    pub whole: Cost,
    /// The predicted cost of the blur, if a calibration was given.
    pub predicted: Option<Prediction>,
    /// The sampling error.
    pub sampling: ErrorEstimate,
    /// The model error, if there is a reference.
    pub model: Option<Score>,
    /// Whether the entry is on the Pareto front: no other entry is both faster and more accurate.
    pub on_front: bool,
    /// The command line that renders this picture.
    pub command: String,
    /// File name of the picture in the same folder.
    pub picture: Option<String>,
    /// File name of the error map, FLIP against the baseline, in the same folder; `null` for the baseline itself.
    pub map: Option<String>,
}

/// What error maps and crops are measured against.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "kind", content = "name")]
pub enum Baseline {
    /// The reference render.
    Reference,
    /// The entry of this name, which has the smallest sampling error.
    Entry(String),
}

/// A square in which the pictures differ.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Crop {
    /// First column of the square in the part that is compared.
    pub x: usize,
    /// First row.
    pub y: usize,
    /// Width and height in pixels.
    pub side_px: usize,
    /// PSNR of the pinhole picture against the baseline within the square, in dB.
    pub pinhole_psnr_db: Option<f64>,
    /// PSNR in dB of each entry's picture, in their order; `null` where it equals the baseline's, value for value.
    pub psnr_db: Vec<Option<f64>>,
}

impl Entry {
    /// PSNR in dB that determines the Pareto front: of the model error if there is a reference, else of the sampling error.
    pub fn psnr_db(&self) -> f64 {
        self.model.map_or(self.sampling.psnr_db.unwrap_or(f64::INFINITY), |score| score.psnr_db)
    }
}

/// The inputs of a comparison.
#[derive(Debug, Clone, Copy)]
pub struct Comparison<'a> {
    /// The stack, the lens and the settings; the method of the settings is not used.
    pub prepared: &'a Prepared,
    /// The part of the picture that is compared, in pixels of its data window.
    pub part: Window,
    /// The reference render's pixels of that part, if there is one.
    pub reference: Option<&'a Image>,
    /// Number of runs of each candidate; at least one run is made.
    pub repeats: usize,
    /// The expected colours at some pixels, from many lens rays through the stack.
    pub probes: &'a ProbeSet<'a>,
    /// The calibration of this machine, to predict costs; `None` for no predictions.
    pub calibration: Option<&'a Calibration>,
    /// The command-line words for inputs, lens and effects.
    pub words: &'a [String],
}

impl Comparison<'_> {
    /// The plan of `candidate`.
    ///
    /// # Errors
    /// Those of its settings and of the plan, such as a forced effect whose pass the method does not have.
    pub fn plan(&self, candidate: &Candidate) -> Result<Plan, Error> {
        let Prepared { stats, settings, methods, .. } = self.prepared;
        methods.plan(stats, &candidate.settings(settings)?)
    }

    /// Runs `candidate` and measures it; returns its picture too, as far as it is compared.
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
        let blurred = picture.unwrap_or_default();
        let sampling = self.probes.estimate_image(&blurred, &plan);
        let image = self.compared(finish(blurred, &plan, scene.field).trimmed(scene.outside_px));
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

    /// The part of `picture` that is compared.
    pub fn compared(&self, picture: Image) -> Image {
        FramedImage { image: picture, frame: self.prepared.stack.picture_frame() }.part(self.part)
    }

    /// Results without entries: everything that is known before the first candidate runs. `command` is the command line of the
    /// comparison, `input` and `reference` are the files read.
    pub fn results(&self, command: String, input: Vec<String>, reference: Option<String>) -> Results {
        let Prepared { summary, settings, lens, stack, .. } = self.prepared;
        Results {
            version: env!("CARGO_PKG_VERSION"),
            command,
            input,
            reference,
            compared: self.part,
            stack: summary.clone(),
            lens: LensReport::new(settings, lens),
            warnings: Report::warnings(&stack.findings),
            machine: Machine::this(),
            repeats: self.repeats,
            probes: self.probes.of(&self.prepared.plan).pixels().len(),
            prepared: self.prepared_cost(),
            entries: Vec::new(),
            baseline: None,
            crops: Vec::new(),
        }
    }

    /// Cost of reading and planning.
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
    /// The sum of this and `other`.
    fn and(self, other: Self) -> Self {
        Self { cpu_seconds: self.cpu_seconds + other.cpu_seconds, seconds: self.seconds + other.seconds }
    }
}

impl Results {
    /// Marks the entries on the Pareto front of processor time and accuracy.
    pub fn mark_front(&mut self) {
        let points: Vec<(f64, f64)> =
            self.entries.iter().map(|entry| (entry.cpu_seconds, entry.psnr_db())).collect();
        for (entry, &(seconds, db)) in self.entries.iter_mut().zip(&points) {
            let dominated = points.iter().any(|&(s, d)| s <= seconds && d >= db && (s < seconds || d > db));
            entry.on_front = !dominated;
        }
    }
}

/// The median of `values`; of an even number, the lower of the two middle ones.
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
    use crate::stack::Precision;

    /// An entry of `shear` that took `cpu_seconds`, with this sampling error.
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
            compared: Window { x: 0, y: 0, width: 100, height: 80 },
            stack: StackReport {
                width: 100,
                height: 80,
                peels: 2,
                kind: "point".to_owned(),
                antialiased: 0.0,
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
    fn entries_on_the_front_are_those_that_no_other_beats_in_both_time_and_accuracy() {
        let mut results =
            results(vec![entry(1.0, 30.0), entry(2.0, 40.0), entry(3.0, 35.0), entry(0.5, 20.0)]);
        results.mark_front();
        let on_front: Vec<bool> = results.entries.iter().map(|entry| entry.on_front).collect();
        assert_eq!(on_front, [true, true, false, true]);
    }

    #[test]
    fn the_median_of_an_even_number_of_runs_is_one_of_them() {
        assert_eq!(median([3.0, 1.0, 2.0].into_iter()), 2.0);
        assert_eq!(median([4.0, 1.0].into_iter()), 1.0);
    }

    #[test]
    fn measurements_are_read_back_from_json() {
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
        assert_eq!((kind, stop.map(|stop| stop as f32)), (&"point".into(), Some(2.8)));
    }
}
