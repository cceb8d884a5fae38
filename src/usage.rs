//! Resources of a run: wall time and processor time by stage, and memory.

use std::time::Instant;

/// A stage of the pipeline.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Stage {
    /// Files to stack.
    Read,
    /// Stack to scene and plan.
    Plan,
    /// Plan to picture.
    Blur,
    /// Measurement of the sampling error.
    Verify,
    /// The confidence mask.
    Confidence,
    /// Picture to files.
    Write,
}

/// Seconds by stage.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
#[non_exhaustive]
pub struct Seconds {
    /// [`Stage::Read`].
    pub read: f64,
    /// [`Stage::Plan`].
    pub plan: f64,
    /// [`Stage::Blur`].
    pub blur: f64,
    /// [`Stage::Verify`].
    pub verify: f64,
    /// [`Stage::Confidence`].
    pub confidence: f64,
    /// [`Stage::Write`].
    pub write: f64,
    /// Since the start of the clock, including time between the stages.
    pub total: f64,
}

impl Seconds {
    fn add(&mut self, stage: Stage, seconds: f64) {
        match stage {
            Stage::Read => self.read += seconds,
            Stage::Plan => self.plan += seconds,
            Stage::Blur => self.blur += seconds,
            Stage::Verify => self.verify += seconds,
            Stage::Confidence => self.confidence += seconds,
            Stage::Write => self.write += seconds,
        }
    }
}

/// Wall time and processor time since its start.
#[derive(Debug, Clone, Copy)]
pub struct Stopwatch {
    started: Instant,
    cpu_at_start: f64,
}

impl Stopwatch {
    /// Starts now.
    pub fn start() -> Self {
        Self { started: Instant::now(), cpu_at_start: cpu_seconds() }
    }

    /// Wall seconds.
    pub fn seconds(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    /// Processor seconds of all threads of the process.
    pub fn cpu_seconds(&self) -> f64 {
        cpu_seconds() - self.cpu_at_start
    }
}

/// Sums up the time of each stage. Processor time is that of the whole process: it includes stages that run at the same time.
#[derive(Debug, Clone)]
pub struct StageClock {
    whole: Stopwatch,
    since_lap: Stopwatch,
    seconds: Seconds,
    cpu_seconds: Seconds,
}

impl StageClock {
    /// Starts now.
    pub fn start() -> Self {
        let now = Stopwatch::start();
        Self { whole: now, since_lap: now, seconds: Seconds::default(), cpu_seconds: Seconds::default() }
    }

    /// Adds the time since the last lap to `stage`.
    pub fn lap(&mut self, stage: Stage) {
        self.seconds.add(stage, self.since_lap.seconds());
        self.cpu_seconds.add(stage, self.since_lap.cpu_seconds());
        self.skip();
    }

    /// Starts a new lap; the time since the last one is added to no stage.
    pub fn skip(&mut self) {
        self.since_lap = Stopwatch::start();
    }

    /// Wall time by stage, and in total until now.
    pub fn seconds(&self) -> Seconds {
        Seconds { total: self.whole.seconds(), ..self.seconds }
    }

    /// Processor time by stage, and in total until now.
    pub fn cpu_seconds(&self) -> Seconds {
        Seconds { total: self.whole.cpu_seconds(), ..self.cpu_seconds }
    }
}

/// Processor seconds of this process so far, user and system, all threads; 0 if the system does not provide it.
#[cfg(unix)]
pub fn cpu_seconds() -> f64 {
    use nix::sys::resource::{UsageWho, getrusage};
    use nix::sys::time::TimeVal;
    let seconds = |time: TimeVal| time.tv_sec() as f64 + time.tv_usec() as f64 * 1e-6;
    getrusage(UsageWho::RUSAGE_SELF)
        .map_or(0.0, |usage| seconds(usage.user_time()) + seconds(usage.system_time()))
}

/// Processor seconds of this process so far: not available on this system, 0.
#[cfg(not(unix))]
pub fn cpu_seconds() -> f64 {
    0.0
}

/// Peak memory of this process in bytes.
#[cfg(target_os = "linux")]
pub fn peak_memory_bytes() -> Option<u64> {
    // `getrusage` includes the memory of the parent at the start of this process: a large parent script would be counted.
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let kibibytes = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    kibibytes.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|value| value * 1024)
}

/// Peak memory of this process in bytes.
#[cfg(all(unix, not(target_os = "linux")))]
pub fn peak_memory_bytes() -> Option<u64> {
    use nix::sys::resource::{UsageWho, getrusage};
    // Bytes on macOS, kibibytes on the other systems.
    let unit = if cfg!(target_vendor = "apple") { 1 } else { 1024 };
    getrusage(UsageWho::RUSAGE_SELF).ok().map(|usage| usage.max_rss() as u64 * unit)
}

/// Peak memory of this process: not available on this system.
#[cfg(not(unix))]
pub fn peak_memory_bytes() -> Option<u64> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_counts_its_own_time_and_the_total_includes_everything() {
        let work = || std::thread::sleep(std::time::Duration::from_millis(20));
        let mut clock = StageClock::start();
        work();
        clock.lap(Stage::Read);
        work();
        clock.skip();
        clock.lap(Stage::Plan);
        work();
        clock.lap(Stage::Read);
        let seconds = clock.seconds();
        assert!(seconds.read >= 0.04, "{seconds:?}");
        assert!(seconds.plan < 0.02, "skipped time is added to no stage: {seconds:?}");
        assert_eq!((seconds.blur, seconds.write), (0.0, 0.0));
        assert!(seconds.total >= seconds.read + 0.02, "{seconds:?}");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn peak_memory_includes_allocated_memory() {
        let held = vec![1_u8; 32 << 20];
        assert!(peak_memory_bytes().unwrap() >= std::hint::black_box(&held).len() as u64);
    }

    #[cfg(unix)]
    #[test]
    fn work_takes_processor_time() {
        let watch = Stopwatch::start();
        let mut sum = 0.0_f64;
        while watch.cpu_seconds() < 0.01 {
            sum += std::hint::black_box(1.0_f64).sqrt();
        }
        assert!(sum > 0.0 && watch.seconds() > 0.0);
    }
}
