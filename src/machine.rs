//! Which machine this is: what timings, and a calibration, hold for.

use serde::{Deserialize, Serialize};

/// A machine, as far as it decides how long a blur takes, and the program that was measured on it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Machine {
    /// The processor's name; its architecture where the system does not say.
    pub cpu: String,
    /// Logical cores that the process may use.
    pub cores: usize,
    /// Threads of the pool.
    pub threads: usize,
    /// The instruction set that vector code is run in.
    pub vectors: String,
    /// The operating system.
    pub os: String,
    /// Version of thinlens.
    pub version: String,
}

impl Machine {
    /// This one, with the threads of the pool that this is called from.
    pub(crate) fn this() -> Self {
        // "V4(…)", "Neon(…)", "Scalar".
        let vectors = format!("{:?}", pulp::Arch::new());
        Self {
            cpu: model().unwrap_or_else(|| std::env::consts::ARCH.to_owned()),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            threads: rayon::current_num_threads(),
            vectors: vectors.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default().to_owned(),
            os: std::env::consts::OS.to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
        }
    }

    /// Name of the file that its calibration is kept in: a folder may be shared by many machines.
    pub(crate) fn file_name(&self) -> String {
        let Self { cpu, cores, threads, vectors, os, .. } = self;
        let name = format!("calibration {os} {cpu} {vectors} {threads} of {cores}").to_lowercase();
        let words = name.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
        words.collect::<Vec<_>>().join("-") + ".json"
    }
}

/// The processor's name; `CPU` where the system does not say.
pub(crate) fn cpu_name() -> String {
    model().unwrap_or_else(|| "CPU".to_owned())
}

/// The processor's name as the system has it.
#[cfg(target_os = "linux")]
fn model() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    model_name(&text).map(str::to_owned)
}

/// The first model name in the text of `/proc/cpuinfo`.
#[cfg(target_os = "linux")]
fn model_name(cpuinfo: &str) -> Option<&str> {
    let (_, name) = cpuinfo.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'))?;
    Some(name.trim()).filter(|name| !name.is_empty())
}

/// The processor's name as the system has it: a variable of every process on Windows, not asked for elsewhere.
#[cfg(not(target_os = "linux"))]
fn model() -> Option<String> {
    std::env::var("PROCESSOR_IDENTIFIER").ok().filter(|name| !name.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_machine_counts_the_threads_of_the_pool_that_it_is_asked_in() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        assert_eq!(pool.install(Machine::this).threads, 3);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn the_processor_is_named_by_its_first_model_line() {
        let text = "processor\t: 0\nmodel name\t: Example 9000 @ 3 GHz\nmodel name\t: other\n";
        assert_eq!(model_name(text), Some("Example 9000 @ 3 GHz"));
        assert_eq!(model_name("processor: 0\n"), None);
    }

    #[test]
    fn machines_that_differ_keep_their_calibration_in_different_files() {
        let this = Machine { cpu: "AMD EPYC 9B14 (Zen 4)".to_owned(), ..Machine::this() };
        let name = this.file_name();
        assert!(name.contains("-amd-epyc-9b14-zen-4-") && name.ends_with(".json"), "{name}");
        let other = Machine { threads: this.threads + 1, ..this };
        assert_ne!(other.file_name(), name);
    }
}
