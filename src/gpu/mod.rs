//! Device choice: which device carries out a plan.
//!
//! Limits: every method runs on the CPU so far. Asking for a GPU by name is therefore an error that says what was found,
//! never a silent fall back.

mod adapters;

pub use adapters::{Adapter, AdapterKind};

use crate::error::Error;
use serde::Serialize;

/// What the user asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DeviceChoice {
    /// The fastest device that gives the same picture.
    #[default]
    Auto,
    /// The processor.
    Cpu,
    /// A graphics card; software drivers do not count as one.
    Gpu,
}

/// Kind of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum DeviceKind {
    /// The processor.
    Cpu,
    /// A graphics card.
    Gpu,
}

impl DeviceKind {
    /// The name that reports use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Gpu => "gpu",
        }
    }
}

/// The device that was chosen.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Device {
    /// Its kind.
    pub kind: DeviceKind,
    /// The name it gives itself.
    pub name: String,
}

/// The device for `choice`.
///
/// # Errors
/// [`crate::error::ErrorKind::Unsupported`] for [`DeviceChoice::Gpu`], with the adapter that was found: no method runs on
/// it so far.
pub fn choose(choice: DeviceChoice) -> Result<Device, Error> {
    match choice {
        DeviceChoice::Auto | DeviceChoice::Cpu => Ok(Device { kind: DeviceKind::Cpu, name: cpu_name() }),
        DeviceChoice::Gpu => Err(gpu_error()),
    }
}

/// What can compute on this machine.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Survey {
    /// The processor.
    pub processor: String,
    /// Threads that work at once.
    pub threads: usize,
    /// Graphics adapters, software drivers among them.
    pub adapters: Vec<Adapter>,
    /// How adapters were looked for.
    pub looked_for: &'static str,
    /// What [`DeviceChoice::Auto`] is here.
    pub auto: DeviceKind,
    /// Why.
    pub auto_reason: String,
}

/// Looks at what can compute here.
pub fn survey() -> Survey {
    let adapters = adapters::find();
    let card = adapters.iter().find(|adapter| adapter.kind != AdapterKind::Software);
    let auto_reason = match (card, adapters.first()) {
        (Some(card), _) => format!("no method runs on {card} so far"),
        (None, Some(software)) => {
            format!("{software} is a program on the same processor, and no method runs on it so far")
        }
        (None, None) => "there is no graphics card".to_owned(),
    };
    Survey {
        processor: cpu_name(),
        threads: rayon::current_num_threads(),
        adapters,
        looked_for: LOOKED_FOR,
        auto: DeviceKind::Cpu,
        auto_reason,
    }
}

/// How adapters are looked for.
#[cfg(feature = "gpu")]
const LOOKED_FOR: &str = "looked for by Vulkan, Metal and DX12 drivers";
#[cfg(not(feature = "gpu"))]
const LOOKED_FOR: &str = "this program was built without GPU support";

/// Model of the processor, or `CPU` where the system does not tell.
fn cpu_name() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    model_name(&text).unwrap_or("CPU").to_owned()
}

/// The first model name in the text of `/proc/cpuinfo`.
fn model_name(cpuinfo: &str) -> Option<&str> {
    let line = cpuinfo.lines().find(|line| line.starts_with("model name"))?;
    let (_, name) = line.split_once(':')?;
    Some(name.trim()).filter(|name| !name.is_empty())
}

#[cfg(feature = "gpu")]
fn gpu_error() -> Error {
    let adapters = adapters::find();
    let card = adapters.iter().find(|adapter| adapter.kind != AdapterKind::Software);
    let found = card.map_or_else(|| "no graphics card".to_owned(), Adapter::to_string);
    Error::unsupported("no method runs on the GPU so far")
        .with("found", found)
        .help("use --device auto, which runs on the CPU")
}

#[cfg(not(feature = "gpu"))]
fn gpu_error() -> Error {
    Error::unsupported("this program was built without GPU support")
        .help("use --device auto, or build with the feature `gpu`")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn auto_and_cpu_are_the_processor() {
        for choice in [DeviceChoice::Auto, DeviceChoice::Cpu] {
            let device = choose(choice).unwrap();
            assert_eq!(device.kind, DeviceKind::Cpu);
            assert!(!device.name.is_empty(), "a device has a name");
        }
    }

    #[test]
    fn asking_for_a_gpu_is_refused_with_the_way_out() {
        let error = choose(DeviceChoice::Gpu).unwrap_err().to_string();
        assert!(error.contains("--device auto"), "{error}");
    }

    #[test]
    fn a_survey_has_the_processor_and_says_why_it_is_chosen() {
        let survey = survey();
        assert!(!survey.processor.is_empty() && survey.threads > 0);
        assert_eq!(survey.auto, DeviceKind::Cpu, "{}", survey.auto_reason);
        assert!(
            survey.adapters.iter().all(|adapter| !adapter.name.is_empty() && adapter.most_buffer_bytes > 0)
        );
    }

    #[test]
    fn the_processor_is_named_by_its_first_model_line() {
        let text = "processor\t: 0\nmodel name\t: Example 9000 @ 3 GHz\nmodel name\t: other\n";
        assert_eq!(model_name(text), Some("Example 9000 @ 3 GHz"));
        assert_eq!(model_name("processor: 0\n"), None);
    }
}
