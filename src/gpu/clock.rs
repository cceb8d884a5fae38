//! Time and amount of GPU work.

use serde::Serialize;
use std::collections::BTreeMap;
#[cfg(feature = "gpu")]
use std::time::Duration;

/// GPU work, in seconds and bytes.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[non_exhaustive]
pub struct GpuUsage {
    /// Time of uploads.
    pub upload_seconds: f64,
    /// Amount of uploads.
    pub upload_bytes: u64,
    /// Time of readbacks, without the wait for the passes that compute the data.
    pub readback_seconds: f64,
    /// Amount of readbacks.
    pub readback_bytes: u64,
    /// Time of waiting for submitted work.
    pub wait_seconds: f64,
    /// Number of submitted passes.
    pub passes: u64,
    /// Time of passes by name, from the adapter's timestamps; empty where it has none.
    pub pass_seconds: BTreeMap<&'static str, f64>,
}

impl GpuUsage {
    /// Time of all passes together, from the adapter's timestamps; `None` where it has none.
    pub fn pass_seconds_total(&self) -> Option<f64> {
        (!self.pass_seconds.is_empty()).then(|| self.pass_seconds.values().sum())
    }

    /// The difference from an earlier value, `before`.
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

    pub(super) fn submitted(&mut self, passes: usize) {
        self.passes += passes as u64;
    }

    pub(super) fn passed(&mut self, pass: &'static str, seconds: f64) {
        *self.pass_seconds.entry(pass).or_default() += seconds;
    }
}
