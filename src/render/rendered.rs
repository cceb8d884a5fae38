//! A rendered job and its report.

use crate::gpu::{Device, GpuUsage};
use crate::image::{Image, Plane};
use crate::lens::ThinLens;
use crate::methods::Plan;
use crate::output::report::{LensReport, PlanReport, Report, StackReport};
use crate::output::{self, Made};
use crate::probes::ErrorEstimate;
use crate::sample_budget::Outcome;
use crate::settings::Settings;
use crate::stack::{Frame, Stack};
use crate::usage::{self, StageClock};

/// A rendered job.
#[derive(Debug)]
#[non_exhaustive]
pub struct Rendered {
    /// The picture, with the size of the frame's data window.
    pub image: Image,
    /// Data and display window in picture pixels.
    pub frame: Frame,
    /// The stack as read, without its peels.
    pub stack: Stack,
    /// Summary of the stack.
    pub summary: StackReport,
    /// Every value with its origin.
    pub settings: Settings,
    /// The lens in picture pixels.
    pub lens: ThinLens,
    /// What was simulated, with reasons.
    pub plan: Plan,
    /// Device that carried out the plan.
    pub device: Device,
    /// Timings of the GPU, if one was used.
    pub gpu_usage: Option<GpuUsage>,
    /// How the number of lens samples was found, if it was not given.
    pub outcome: Option<Outcome>,
    /// The sampling error, if it was requested.
    pub probe: Option<ErrorEstimate>,
    /// The confidence mask, if it was requested: the share of each pixel's light that comes from surfaces of the stack.
    pub confidence: Option<Plane>,
    /// How the picture was made; the attributes of [`Stack::carried`] say the same.
    pub made: Made,
    /// Time by stage; the caller adds writing.
    pub clock: StageClock,
}

impl Rendered {
    /// Adds the digest of the job and of the encoding ([`super::digest()`]) to what the headers of outputs say.
    pub fn set_digest(&mut self, digest: String) {
        self.made.digest = Some(digest);
        // The camera was corrected before: there is nothing new to report.
        self.made.apply(&mut self.stack.carried.attributes);
    }

    /// The sampling error, where it was measured: on request, or to find the number of lens samples.
    pub fn sampling_error(&self) -> Option<ErrorEstimate> {
        self.probe.or_else(|| self.outcome.as_ref()?.estimate())
    }

    /// The report of the run so far, with the names of its `input` files and its `output` file.
    pub fn report(&self, input: Vec<String>, output: String) -> Report {
        Report {
            version: env!("CARGO_PKG_VERSION"),
            input,
            output,
            method: self.plan.method.name(),
            device: output::report::Device {
                kind: self.device.kind.name(),
                name: self.device.name.clone(),
                reason: self.device.reason.clone(),
                gpu: self.gpu_usage.as_ref().and_then(|usage| serde_json::to_value(usage).ok()),
            },
            lens: LensReport::new(&self.settings, &self.lens),
            picture: self.settings.picture.clone(),
            stack: self.summary.clone(),
            plan: PlanReport::from(&self.plan),
            views: self.plan.views,
            dial: self.outcome.as_ref().and_then(|outcome| serde_json::to_value(outcome).ok()),
            seconds: self.clock.seconds(),
            cpu_seconds: self.clock.cpu_seconds().total,
            cpu_seconds_by_stage: self.clock.cpu_seconds(),
            threads: rayon::current_num_threads(),
            peak_memory_bytes: usage::peak_memory_bytes(),
            confidence: None,
            probe: self.sampling_error().and_then(|estimate| serde_json::to_value(estimate).ok()),
            findings: self.stack.findings.clone(),
            warnings: Report::warnings(&self.stack.findings),
        }
    }
}
