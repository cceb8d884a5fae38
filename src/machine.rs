//! The machine that timings and a calibration are valid for.

use serde::{Deserialize, Serialize};

/// The properties of a machine that determine how long a blur takes, and the version of the program.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Machine {
    /// Name of the processor; its architecture if the system does not provide it.
    pub cpu: String,
    /// Logical cores that the process may use.
    pub cores: usize,
    /// Threads of the pool.
    pub threads: usize,
    /// The instruction set of vector code.
    pub vectors: String,
    /// The operating system.
    pub os: String,
    /// Version of thinlens.
    pub version: String,
}

impl Machine {
    /// This machine, with the number of threads of the current pool.
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

    /// Name of the calibration file of this machine: several machines may share a folder.
    pub(crate) fn file_name(&self) -> String {
        let Self { cpu, cores, threads, vectors, os, .. } = self;
        let name = format!("calibration {os} {cpu} {vectors} {threads} of {cores}").to_lowercase();
        let words = name.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
        words.collect::<Vec<_>>().join("-") + ".json"
    }
}

/// Name of the processor; `CPU` if the system does not provide it.
pub(crate) fn cpu_name() -> String {
    model().unwrap_or_else(|| "CPU".to_owned())
}

/// Name of the processor as reported by the system.
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

/// Name of the processor from an environment variable of Windows; not available on other systems.
#[cfg(not(target_os = "linux"))]
fn model() -> Option<String> {
    std::env::var("PROCESSOR_IDENTIFIER").ok().filter(|name| !name.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_machine_has_the_number_of_threads_of_the_current_pool() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        assert_eq!(pool.install(Machine::this).threads, 3);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn the_name_of_the_processor_is_its_first_model_name() {
        let text = "processor\t: 0\nmodel name\t: Example 9000 @ 3 GHz\nmodel name\t: other\n";
        assert_eq!(model_name(text), Some("Example 9000 @ 3 GHz"));
        assert_eq!(model_name("processor: 0\n"), None);
    }

    #[test]
    fn different_machines_have_different_calibration_files() {
        let this = Machine { cpu: "AMD EPYC 9B14 (Zen 4)".to_owned(), ..Machine::this() };
        let name = this.file_name();
        assert!(name.contains("-amd-epyc-9b14-zen-4-") && name.ends_with(".json"), "{name}");
        let other = Machine { threads: this.threads + 1, ..this };
        assert_ne!(other.file_name(), name);
    }
}
