//! What a GPU spent its time on.

use serde::Serialize;
use std::collections::BTreeMap;
#[cfg(feature = "gpu")]
use std::time::Duration;

/// What was done on a GPU, in seconds and bytes.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[non_exhaustive]
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

    /// What was added to it since it was `before`.
    #[must_use]
    pub fn since(&self, before: &Self) -> Self {
        let pass = |(name, seconds): (&&'static str, &f64)| {
            (*name, seconds - before.pass_seconds.get(name).copied().unwrap_or(0.0))
        };
        Self {
            upload_seconds: self.upload_seconds - before.upload_seconds,
            upload_bytes: self.upload_bytes - before.upload_bytes,
            readback_seconds: self.readback_seconds - before.readback_seconds,
            readback_bytes: self.readback_bytes - before.readback_bytes,
            wait_seconds: self.wait_seconds - before.wait_seconds,
            passes: self.passes - before.passes,
            pass_seconds: self.pass_seconds.iter().map(pass).collect(),
        }
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
