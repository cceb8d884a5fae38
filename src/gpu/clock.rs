//! What a GPU spent its time on.

use serde::Serialize;
use std::collections::BTreeMap;
#[cfg(feature = "gpu")]
use std::time::Duration;

/// What was done on a GPU, in seconds and bytes.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct GpuUsage {
    /// Handing data to it.
    pub upload_seconds: f64,
    /// How much.
    pub upload_bytes: u64,
    /// Fetching data from it, without waiting for what makes them.
    pub readback_seconds: f64,
    /// How much.
    pub readback_bytes: u64,
    /// Waiting for what was asked of it.
    pub wait_seconds: f64,
    /// Steps that were carried out.
    pub passes: u64,
    /// What each step took by the adapter's own clock; empty where it has none.
    pub pass_seconds: BTreeMap<&'static str, f64>,
}

impl GpuUsage {
    /// By the adapter's own clock, all steps together; `None` where it has no clock.
    pub fn pass_seconds_total(&self) -> Option<f64> {
        (!self.pass_seconds.is_empty()).then(|| self.pass_seconds.values().sum())
    }
}

#[cfg(feature = "gpu")]
impl GpuUsage {
    pub(super) fn uploaded(&mut self, bytes: usize, taken: Duration) {
        self.upload_bytes += bytes as u64;
        self.upload_seconds += taken.as_secs_f64();
    }

    pub(super) fn read_back(&mut self, bytes: usize, taken: Duration) {
        self.readback_bytes += bytes as u64;
        self.readback_seconds += taken.as_secs_f64();
    }

    pub(super) fn waited(&mut self, taken: Duration) {
        self.wait_seconds += taken.as_secs_f64();
    }

    pub(super) fn asked_for(&mut self, passes: usize) {
        self.passes += passes as u64;
    }

    pub(super) fn passed(&mut self, pass: &'static str, seconds: f64) {
        *self.pass_seconds.entry(pass).or_default() += seconds;
    }
}
