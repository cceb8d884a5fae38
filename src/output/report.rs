//! The JSON report of a render: input, settings, decisions and costs. Scripts of users read it: keys are added, never changed.

use super::atomic;
use crate::error::Error;
use crate::finding::Finding;
use crate::image::Plane;
use crate::lens::ThinLens;
use crate::methods::Plan;
use crate::scene::Effect;
use crate::settings::{DepthConvention, LensSettings, PictureSettings, Settings};
use crate::stack::{Precision, Stack};
use crate::usage::Seconds;
use serde::Serialize;
use std::path::Path;

/// The report of one render.
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
    /// The device of the blur.
    pub device: Device,
    /// The lens, each value with its origin.
    pub lens: LensReport,
    /// The settings of the picture, each value with its origin.
    pub picture: PictureSettings,
    /// The stack.
    pub stack: StackReport,
    /// The plan.
    pub plan: PlanReport,
    /// Lens samples per pixel; `null` for a method that does not sample the lens.
    pub views: Option<usize>,
    /// How the number of lens samples was found, if it was not given.
    pub dial: Option<serde_json::Value>,
    /// Wall time by stage.
    pub seconds: Seconds,
    /// Total processor time.
    pub cpu_seconds: f64,
    /// Processor time by stage.
    pub cpu_seconds_by_stage: Seconds,
    /// Threads of the pool.
    pub threads: usize,
    /// Peak memory, if the system provides it.
    pub peak_memory_bytes: Option<u64>,
    /// The measured sampling error, if requested.
    pub probe: Option<serde_json::Value>,
    /// The confidence mask, if requested.
    pub confidence: Option<Confidence>,
    /// Every finding about the input.
    pub findings: Vec<Finding>,
    /// Texts of the findings that are warnings.
    pub warnings: Vec<String>,
}

/// The share of the picture's light that comes from surfaces in the stack.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Confidence {
    /// File of the mask.
    pub file: String,
    /// Its mean over all pixels, 0 … 1.
    pub mean: f64,
}

impl Confidence {
    /// The summary of the mask `known`, written to `path`.
    pub fn new(path: &Path, known: &Plane) -> Self {
        let sum: f64 = known.values().iter().map(|&value| f64::from(value)).sum();
        Self { file: path.display().to_string(), mean: sum / known.values().len().max(1) as f64 }
    }
}

/// The device of the blur.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Device {
    /// `cpu` or `gpu`.
    pub kind: &'static str,
    /// The device's own name.
    pub name: String,
    /// Why it was chosen.
    pub reason: String,
    /// GPU times by pass; absent without a GPU.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gpu: Option<serde_json::Value>,
}

/// The settings of the lens, and values derived from them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LensReport {
    /// Every value with its origin; an infinite f-number is `null`.
    #[serde(flatten)]
    pub settings: LensSettings,
    /// The planar focus distance in depth units.
    pub focus_distance: f32,
    /// CoC radius at infinity in pixels.
    pub c_inf: f32,
}

/// The decisions of the plan.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlanReport {
    /// Why this method.
    pub method_reason: String,
    /// Every effect, on or off, with its reason.
    pub effects: Vec<Effect>,
    /// The method's own parameters.
    pub parameters: serde_json::Value,
}

/// The properties of the stack.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StackReport {
    /// Width of the data window in samples.
    pub width: usize,
    /// Height of the data window in samples.
    pub height: usize,
    /// Number of peels.
    pub peels: usize,
    /// What the fragments represent, in words: the kind that applies everywhere, or the shares of the picture.
    pub kind: String,
    /// Share of the picture whose colours are averages over the pixel; the rest are point samples.
    pub antialiased: f64,
    /// Samples per picture pixel along each axis.
    pub supersample: usize,
    /// The depth convention.
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
            kind: stack.kind_in_words(),
            antialiased: stack.antialiasing.mean(),
            supersample: stack.supersample,
            convention: stack.convention,
            precision: stack.precision,
        }
    }
}

impl Report {
    /// The texts of the warnings in `findings`.
    pub fn warnings(findings: &[Finding]) -> Vec<String> {
        findings.iter().filter(|finding| finding.warning).map(|finding| finding.text.clone()).collect()
    }
}

/// Writes `value` as indented JSON to the file `path` (`-`: standard output). Infinite and NaN values become `null`.
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
