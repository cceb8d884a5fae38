//! Device choice: which device carries out a plan.
//!
//! Limits: every method runs on the CPU so far. Asking for a GPU by name is therefore an error that says what was found,
//! never a silent fall back.

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
    let found = find_adapter().unwrap_or_else(|| "no graphics card".to_owned());
    Error::unsupported("no method runs on the GPU so far")
        .with("found", found)
        .help("use --device auto, which runs on the CPU")
}

/// Name and driver interface of the first adapter that is not a software driver.
#[cfg(feature = "gpu")]
fn find_adapter() -> Option<String> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    let info = adapters
        .iter()
        .map(wgpu::Adapter::get_info)
        .find(|info| info.device_type != wgpu::DeviceType::Cpu)?;
    Some(format!("{} ({})", info.name, info.backend))
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
    fn the_processor_is_named_by_its_first_model_line() {
        let text = "processor\t: 0\nmodel name\t: Example 9000 @ 3 GHz\nmodel name\t: other\n";
        assert_eq!(model_name(text), Some("Example 9000 @ 3 GHz"));
        assert_eq!(model_name("processor: 0\n"), None);
    }
}
