//! The report of a run, as JSON: what was read, understood, decided and spent. Other people's scripts read it, so keys are
//! only ever added.

use super::atomic;
use crate::error::Error;
use crate::finding::Finding;
use crate::image::Plane;
use crate::lens::ThinLens;
use crate::methods::Plan;
use crate::scene::Effect;
use crate::settings::{DepthConvention, LensSettings, PictureSettings, Settings};
use crate::stack::{Precision, Stack, StackKind};
use crate::usage::Seconds;
use serde::Serialize;
use std::path::Path;

/// One run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Version of this tool.
    pub version: &'static str,
    /// The files read.
    pub input: Vec<String>,
    /// The file written.
    pub output: String,
    /// Name of the method.
    pub method: &'static str,
    /// What the blur ran on.
    pub device: Device,
    /// The lens, each value with its origin.
    pub lens: LensReport,
    /// The picture beside its lens, each value with its origin.
    pub picture: PictureSettings,
    /// What was read.
    pub stack: StackReport,
    /// What was decided.
    pub plan: PlanReport,
    /// Lens samples a pixel; `null` for a method that does not sample the lens.
    pub views: Option<usize>,
    /// How the number of lens samples was found, where it was not given.
    pub dial: Option<serde_json::Value>,
    /// Wall time by stage.
    pub seconds: Seconds,
    /// Processor time in all.
    pub cpu_seconds: f64,
    /// Processor time by stage.
    pub cpu_seconds_by_stage: Seconds,
    /// Threads of the pool.
    pub threads: usize,
    /// The most memory held, where the system says.
    pub peak_memory_bytes: Option<u64>,
    /// The measured sampling error, where one was asked for.
    pub probe: Option<serde_json::Value>,
    /// How much of the picture the stack knows, where that was asked for.
    pub confidence: Option<Confidence>,
    /// Every conclusion drawn from the input.
    pub findings: Vec<Finding>,
    /// Texts of the findings that the user should look at.
    pub warnings: Vec<String>,
}

/// How much of the picture's light comes from what the stack knows.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Confidence {
    /// The mask that was written.
    pub file: String,
    /// Its mean over all pixels, 0 … 1.
    pub mean: f64,
}

impl Confidence {
    /// Of the mask `known`, written to `path`.
    pub fn new(path: &Path, known: &Plane) -> Self {
        let sum: f64 = known.values().iter().map(|&value| f64::from(value)).sum();
        Self { file: path.display().to_string(), mean: sum / known.values().len().max(1) as f64 }
    }
}

/// What the blur ran on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Device {
    /// `cpu` or `gpu`.
    pub kind: &'static str,
    /// The device's own name.
    pub name: String,
    /// Why it was chosen.
    pub reason: String,
    /// What a GPU spent its time on; absent where none was at work.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gpu: Option<serde_json::Value>,
}

/// The lens as it was set, and what follows.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LensReport {
    /// Every value with its origin; an infinite f-number is `null`.
    #[serde(flatten)]
    pub settings: LensSettings,
    /// The planar distance that came out as in focus, in depth units.
    pub focus_distance: f32,
    /// CoC radius at infinity in pixels.
    pub c_inf: f32,
}

/// What was decided.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlanReport {
    /// Why this method.
    pub method_reason: String,
    /// Every effect, on or off, with its reason.
    pub effects: Vec<Effect>,
    /// The method's own parameters.
    pub parameters: serde_json::Value,
}

/// What was read.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct StackReport {
    /// Width of the data window in samples.
    pub width: usize,
    /// Height of the data window in samples.
    pub height: usize,
    /// Number of peels.
    pub peels: usize,
    /// What the fragments stand for.
    pub kind: StackKind,
    /// Samples a picture pixel along each axis.
    pub supersample: usize,
    /// How depth is written.
    pub convention: DepthConvention,
    /// Numeric type of the colour channels.
    pub precision: Precision,
}

impl LensReport {
    /// The lens of `settings`, resolved to `lens`.
    pub fn new(settings: &Settings, lens: &ThinLens) -> Self {
        Self {
            settings: settings.lens.clone(),
            focus_distance: lens.focus_distance,
            c_inf: lens.coc_infinity_px,
        }
    }
}

impl From<&Plan> for PlanReport {
    fn from(plan: &Plan) -> Self {
        Self {
            method_reason: plan.method_reason.clone(),
            effects: plan.effects.clone(),
            parameters: plan.parameters.table(),
        }
    }
}

impl From<&Stack> for StackReport {
    fn from(stack: &Stack) -> Self {
        Self {
            width: stack.width(),
            height: stack.height(),
            peels: stack.peels.len(),
            kind: stack.kind,
            supersample: stack.supersample,
            convention: stack.convention,
            precision: stack.precision,
        }
    }
}

impl Report {
    /// The texts of `findings` that the user should look at.
    pub fn warnings(findings: &[Finding]) -> Vec<String> {
        findings.iter().filter(|finding| finding.warning).map(|finding| finding.text.clone()).collect()
    }
}

/// Writes `value` as indented JSON to the file `path` (`-`: standard output). Numbers that JSON lacks become `null`.
///
/// # Errors
/// As [`atomic::write()`].
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<(), Error> {
    let mut text = serde_json::to_string_pretty(value).map_err(|error| {
        Error::output("the report cannot be written as JSON").in_file(path).caused_by(error)
    })?;
    text.push('\n');
    atomic::write_text(path, &text)
}
