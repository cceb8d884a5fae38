//! Graphics cards: device choice, and adapters at work. Knows no method by name.
//!
//! [`choose`] says where a plan is carried out. A [`Gpu`] is an adapter that was opened: it takes buffers and kernels, and every
//! failure is one error. What a frame needs beyond an adapter's limits goes in [`bands()`]. Structures that shaders share with
//! the program are [`Mirrored`].

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

/// What the user asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DeviceChoice {
    /// A graphics card where there is one that gives the same picture, the processor elsewhere.
    #[default]
    Auto,
    /// The processor.
    Cpu,
    /// A graphics adapter, be it a program on the processor.
    Gpu,
}

/// Kind of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum DeviceKind {
    /// The processor.
    Cpu,
    /// A graphics adapter.
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
#[non_exhaustive]
pub struct Device {
    /// Its kind.
    pub kind: DeviceKind,
    /// The name it gives itself.
    pub name: String,
    /// Why it was chosen.
    pub reason: String,
}

impl Device {
    /// The processor, for this reason.
    pub fn cpu(reason: impl Into<String>) -> Self {
        Self { kind: DeviceKind::Cpu, name: machine::cpu_name(), reason: reason.into() }
    }

    fn gpu(adapter: &Adapter, reason: impl Into<String>) -> Self {
        Self { kind: DeviceKind::Gpu, name: adapter.to_string(), reason: reason.into() }
    }
}

/// Opens an adapter: [`Gpu::open`], or that with something done around it while drivers are loaded.
pub(crate) type Open<'a> = &'a dyn Fn(bool) -> Result<Option<Gpu>, Error>;

/// The adapter that `choice` insists on, opened; `None` where it insists on none.
///
/// # Errors
/// [`crate::error::ErrorKind::Device`] where there is none, or it cannot be opened.
pub(crate) fn demanded(choice: DeviceChoice, open: Open<'_>) -> Result<Option<Gpu>, Error> {
    if choice != DeviceChoice::Gpu {
        return Ok(None);
    }
    let help = "use `device = auto`, which runs on the CPU here; `thinlens devices` lists what there is";
    let none = || Error::device("there is no graphics adapter").with("looked for", LOOKED_FOR).help(help);
    open(true)?.ok_or_else(none).map(Some)
}

/// Where to carry out a plan that `cpu_only_reason`, if any, keeps from a GPU, and the GPU if it is one; `demanded` is what [`demanded()`]
/// found.
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
        DeviceChoice::Cpu => return (Device::cpu("asked for"), None),
        DeviceChoice::Gpu => (demanded, "asked for"),
        DeviceChoice::Auto => match open(false) {
            Ok(opened) => (opened, "a graphics card"),
            // Nobody asked for it.
            Err(error) => return (Device::cpu(error.on_one_line()), None),
        },
    };
    let device = match &opened {
        Some(gpu) => Device::gpu(gpu.adapter(), reason),
        None => Device::cpu("there is no graphics card"),
    };
    (device, opened)
}

/// What can compute on this machine.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[non_exhaustive]
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
    let best = adapters.iter().min_by_key(|adapter| adapter.kind);
    let (auto, auto_reason) = match best {
        Some(card) if card.kind != AdapterKind::Software => {
            (DeviceKind::Gpu, format!("{card}; methods without a GPU twin run on the CPU"))
        }
        Some(software) => (DeviceKind::Cpu, format!("{software} is a program on the same processor")),
        None => (DeviceKind::Cpu, "there is no graphics card".to_owned()),
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

/// Whether this program can use a GPU at all.
pub(crate) const IS_SUPPORTED: bool = cfg!(feature = "gpu");

/// How adapters are looked for.
#[cfg(feature = "gpu")]
pub(crate) const LOOKED_FOR: &str = "looked for by Vulkan, Metal and DX12 drivers";
#[cfg(not(feature = "gpu"))]
pub(crate) const LOOKED_FOR: &str = "this program was built without GPU support";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_processor_is_taken_where_it_is_asked_for_or_nothing_else_will_do() {
        let (device, gpu) = choose(DeviceChoice::Cpu, None, None, &Gpu::open);
        assert!(device.kind == DeviceKind::Cpu && gpu.is_none() && !device.name.is_empty());
        for choice in [DeviceChoice::Auto, DeviceChoice::Gpu] {
            let (device, gpu) = choose(choice, None, Some("it has none".to_owned()), &Gpu::open);
            assert!(device.kind == DeviceKind::Cpu && gpu.is_none(), "{choice:?}");
            assert_eq!(device.reason, "it has none");
        }
    }

    #[test]
    fn a_survey_says_what_auto_is_and_why() {
        let survey = survey();
        assert!(!survey.processor.is_empty() && survey.threads > 0 && !survey.auto_reason.is_empty());
        let has_card = survey.adapters.iter().any(|adapter| adapter.kind != AdapterKind::Software);
        assert_eq!(survey.auto == DeviceKind::Gpu, has_card, "{}", survey.auto_reason);
        assert!(
            survey.adapters.iter().all(|adapter| !adapter.name.is_empty() && adapter.max_buffer_bytes > 0)
        );
    }
}
