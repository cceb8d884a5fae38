//! GPUs: choice of the device, buffers, kernels and passes. Independent of the methods.
//!
//! [`choose`] selects the device that executes a plan. A [`Gpu`] is an opened adapter: it provides buffers and kernels, and
//! reports every failure as one error type. Frames larger than an adapter's limits are rendered in [`bands()`]. Structures that
//! shaders share with the program are [`Mirrored`].

mod adapters;
mod clock;

#[cfg(feature = "gpu")]
mod bands;
#[cfg(feature = "gpu")]
mod context;
#[cfg(feature = "gpu")]
mod handles;
#[cfg(feature = "gpu")]
mod memory;
#[cfg(feature = "gpu")]
mod shader;
#[cfg(feature = "gpu")]
mod work;

#[cfg(not(feature = "gpu"))]
mod absent;

#[cfg(not(feature = "gpu"))]
pub use absent::Gpu;
pub use adapters::{Adapter, AdapterKind};
#[cfg(feature = "gpu")]
pub(crate) use bands::{Band, bands};
pub use clock::GpuUsage;
#[cfg(feature = "gpu")]
pub use context::Gpu;
#[cfg(feature = "gpu")]
pub(crate) use handles::{Buffer, Kernel, Resource, Texels, Texture};
#[cfg(feature = "gpu")]
pub(crate) use shader::mirrored;
#[cfg(feature = "gpu")]
pub(crate) use shader::{Constant, Mirrored, Scalar};
#[cfg(feature = "gpu")]
#[doc(hidden)]
pub use shader::{Layout, ScalarKind, Shader};
#[cfg(feature = "gpu")]
pub(crate) use work::{MAX_ROUNDS, Work, tiles};

use crate::error::Error;
use crate::machine;
use serde::Serialize;

/// The device that the user requests.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DeviceChoice {
    /// A graphics card if there is one and the method runs on it, otherwise the CPU.
    #[default]
    Auto,
    /// The CPU.
    Cpu,
    /// A graphics adapter, including software drivers.
    Gpu,
}

/// Kind of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum DeviceKind {
    /// The CPU.
    Cpu,
    /// A graphics adapter.
    Gpu,
}

impl DeviceKind {
    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Gpu => "gpu",
        }
    }
}

/// The chosen device.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct Device {
    /// Kind of the device.
    pub kind: DeviceKind,
    /// Name of the CPU or adapter.
    pub name: String,
    /// Reason for the choice.
    pub reason: String,
}

impl Device {
    /// The CPU, chosen for this reason.
    pub fn cpu(reason: impl Into<String>) -> Self {
        Self { kind: DeviceKind::Cpu, name: machine::cpu_name(), reason: reason.into() }
    }

    fn gpu(adapter: &Adapter, reason: impl Into<String>) -> Self {
        Self { kind: DeviceKind::Gpu, name: adapter.to_string(), reason: reason.into() }
    }
}

/// Opens an adapter: [`Gpu::open`], or a wrapper of it (for example one that redirects stderr while drivers are loaded).
pub(crate) type Open<'a> = &'a dyn Fn(bool) -> Result<Option<Gpu>, Error>;

/// Whether `choice` may come to a GPU on this machine.
pub fn may_be_chosen(choice: DeviceChoice) -> bool {
    match choice {
        DeviceChoice::Cpu => false,
        DeviceChoice::Gpu => true,
        DeviceChoice::Auto => cfg!(feature = "gpu") && adapters::may_have_card(),
    }
}

/// Opens the adapter that `choice` requires; `None` where it requires none.
///
/// # Errors
/// [`crate::error::ErrorKind::Device`] if there is no adapter, or it cannot be opened.
pub(crate) fn demanded(choice: DeviceChoice, open: Open<'_>) -> Result<Option<Gpu>, Error> {
    if choice != DeviceChoice::Gpu {
        return Ok(None);
    }
    let help = "use `device = auto`, which runs on the CPU here; `thinlens devices` lists the devices";
    let none = || Error::device("there is no graphics adapter").with("looked for", LOOKED_FOR).help(help);
    open(true)?.ok_or_else(none).map(Some)
}

/// Chooses the device for a plan; returns the opened adapter too if that is the device. `cpu_only_reason` is the reason why the
/// plan cannot run on a GPU, if there is one; `demanded` is the result of [`demanded()`].
pub(crate) fn choose(
    choice: DeviceChoice,
    demanded: Option<Gpu>,
    cpu_only_reason: Option<String>,
    open: Open<'_>,
) -> (Device, Option<Gpu>) {
    if let Some(cpu_only_reason) = cpu_only_reason {
        return (Device::cpu(cpu_only_reason), None);
    }
    let (opened, reason) = match choice {
        DeviceChoice::Cpu => return (Device::cpu("requested"), None),
        DeviceChoice::Gpu => (demanded, "requested"),
        DeviceChoice::Auto if !adapters::may_have_card() => return (Device::cpu(NO_CARD), None),
        DeviceChoice::Auto => match open(false) {
            Ok(opened) => (opened, "a graphics card"),
            // Not an error: the user did not request a GPU.
            Err(error) => return (Device::cpu(error.on_one_line()), None),
        },
    };
    let device = match &opened {
        Some(gpu) => Device::gpu(gpu.adapter(), reason),
        None => Device::cpu(NO_CARD),
    };
    (device, opened)
}

/// The devices of this machine.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct Survey {
    /// Name of the CPU.
    pub processor: String,
    /// Number of threads of the current pool.
    pub threads: usize,
    /// Graphics adapters, including software drivers.
    pub adapters: Vec<Adapter>,
    /// How adapters were searched for.
    pub looked_for: &'static str,
    /// Device that [`DeviceChoice::Auto`] selects here.
    pub auto: DeviceKind,
    /// Reason for it.
    pub auto_reason: String,
}

/// Lists the devices of this machine.
pub fn survey() -> Survey {
    let adapters = adapters::find();
    let seen =
        adapters.iter().filter(|adapter| adapter.kind == AdapterKind::Software || adapters::may_have_card());
    let best = seen.min_by_key(|adapter| adapter.kind);
    let (auto, auto_reason) = match best {
        Some(adapter) if adapter.kind != AdapterKind::Software => {
            (DeviceKind::Gpu, format!("{adapter}; methods without a GPU backend run on the CPU"))
        }
        Some(software) => (DeviceKind::Cpu, format!("{software} is a software driver on the same CPU")),
        None => (DeviceKind::Cpu, NO_CARD.to_owned()),
    };
    Survey {
        processor: machine::cpu_name(),
        threads: rayon::current_num_threads(),
        adapters,
        looked_for: LOOKED_FOR,
        auto,
        auto_reason,
    }
}

/// Why the CPU is chosen where there is no card.
const NO_CARD: &str = if IS_SUPPORTED { "there is no graphics card" } else { LOOKED_FOR };

/// Whether this build can use a GPU at all.
pub(crate) const IS_SUPPORTED: bool = cfg!(feature = "gpu");

/// How adapters are searched for.
#[cfg(feature = "gpu")]
pub(crate) const LOOKED_FOR: &str = "searched through Vulkan, Metal and DX12 drivers";
#[cfg(not(feature = "gpu"))]
pub(crate) const LOOKED_FOR: &str = "this program was built without GPU support";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cpu_is_chosen_if_requested_or_if_the_plan_is_cpu_only() {
        let (device, gpu) = choose(DeviceChoice::Cpu, None, None, &Gpu::open);
        assert!(device.kind == DeviceKind::Cpu && gpu.is_none() && !device.name.is_empty());
        for choice in [DeviceChoice::Auto, DeviceChoice::Gpu] {
            let (device, gpu) = choose(choice, None, Some("it has none".to_owned()), &Gpu::open);
            assert!(device.kind == DeviceKind::Cpu && gpu.is_none(), "{choice:?}");
            assert_eq!(device.reason, "it has none");
        }
    }

    #[test]
    fn a_survey_has_the_device_of_auto_with_a_reason() {
        let survey = survey();
        assert!(!survey.processor.is_empty() && survey.threads > 0 && !survey.auto_reason.is_empty());
        let has_card = survey.adapters.iter().any(|adapter| adapter.kind != AdapterKind::Software);
        assert_eq!(survey.auto == DeviceKind::Gpu, has_card, "{}", survey.auto_reason);
        assert!(
            survey.adapters.iter().all(|adapter| !adapter.name.is_empty() && adapter.max_buffer_bytes > 0)
        );
    }
}
