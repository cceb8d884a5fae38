//! The graphics adapters of this machine that wgpu finds, by kind.

use serde::Serialize;
use std::fmt;
use std::io::ErrorKind;
use std::path::Path;

/// Kind of an adapter, in order of preference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum AdapterKind {
    /// A graphics card with its own memory.
    Discrete,
    /// A GPU in the processor that shares its memory.
    Integrated,
    /// A virtual GPU.
    Virtual,
    /// Unknown.
    Other,
    /// A software driver on the CPU.
    Software,
}

impl AdapterKind {
    /// Name in listings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Discrete => "discrete",
            Self::Integrated => "integrated",
            Self::Virtual => "virtual",
            Self::Software => "software",
            Self::Other => "unknown",
        }
    }
}

/// An adapter and its limits.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct Adapter {
    /// Name reported by the driver.
    pub name: String,
    /// Kind of the adapter.
    pub kind: AdapterKind,
    /// Graphics API: Vulkan, Metal or DX12.
    pub interface: String,
    /// Name and version of the driver.
    pub driver: String,
    /// Maximum size of a buffer binding in bytes: larger frames are rendered in bands.
    pub max_binding_bytes: u64,
    /// Maximum size of a buffer in bytes.
    pub max_buffer_bytes: u64,
    /// Maximum number of threads per workgroup.
    pub max_workgroup_threads: u32,
    /// Whether the adapter supports timestamps.
    pub has_timestamps: bool,
}

impl fmt::Display for Adapter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}, {})", self.name, self.kind.name(), self.interface)
    }
}

/// Files of `/dev` by which programs reach a graphics card, or the beginnings of their names: of the kernel's drivers, NVIDIA's, AMD's for
/// computing, Windows's for its Linux, and those of phones and boards.
const CARD_FILES: [&str; 10] =
    ["dri/renderD", "dri/card", "nvidia", "nvhost-", "nvgpu", "kfd", "dxg", "mali", "kgsl-3d", "pvr"];

/// Whether this machine may have a graphics card: whether it is worth loading drivers, which costs many milliseconds. On Linux a card has
/// a file in `/dev`; elsewhere, and where the user names drivers, there may always be one.
pub(super) fn may_have_card() -> bool {
    let names_drivers = |variable: &&str| std::env::var_os(variable).is_some();
    let named = ["VK_DRIVER_FILES", "VK_ADD_DRIVER_FILES", "VK_ICD_FILENAMES"].iter().any(names_drivers);
    !cfg!(target_os = "linux") || named || has_card_file(Path::new("/dev"))
}

/// Whether one of [`CARD_FILES`] is below `devices`, or may be: a folder that cannot be read may have one.
fn has_card_file(devices: &Path) -> bool {
    ["", "dri/"].iter().any(|folder| match std::fs::read_dir(devices.join(folder)) {
        Ok(entries) => entries.flatten().any(|entry| {
            let file = format!("{folder}{}", entry.file_name().to_string_lossy());
            CARD_FILES.iter().any(|start| file.starts_with(start))
        }),
        Err(error) => error.kind() != ErrorKind::NotFound,
    })
}

/// All adapters of this machine.
#[cfg(feature = "gpu")]
pub(super) fn find() -> Vec<Adapter> {
    enumerate().iter().map(Adapter::from_wgpu).collect()
}

/// Always empty: built without GPU support.
#[cfg(not(feature = "gpu"))]
pub(super) fn find() -> Vec<Adapter> {
    Vec::new()
}

/// All adapters as wgpu reports them.
#[cfg(feature = "gpu")]
pub(super) fn enumerate() -> Vec<wgpu::Adapter> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()))
}

#[cfg(feature = "gpu")]
impl Adapter {
    pub(super) fn from_wgpu(adapter: &wgpu::Adapter) -> Self {
        let (info, limits) = (adapter.get_info(), adapter.limits());
        Self {
            name: info.name,
            kind: match info.device_type {
                wgpu::DeviceType::DiscreteGpu => AdapterKind::Discrete,
                wgpu::DeviceType::IntegratedGpu => AdapterKind::Integrated,
                wgpu::DeviceType::VirtualGpu => AdapterKind::Virtual,
                wgpu::DeviceType::Cpu => AdapterKind::Software,
                wgpu::DeviceType::Other => AdapterKind::Other,
            },
            interface: info.backend.to_string(),
            driver: [info.driver, info.driver_info].join(" ").trim().to_owned(),
            max_binding_bytes: limits.max_storage_buffer_binding_size,
            max_buffer_bytes: limits.max_buffer_size,
            max_workgroup_threads: limits.max_compute_invocations_per_workgroup,
            has_timestamps: adapter.features().contains(wgpu::Features::TIMESTAMP_QUERY),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_card_is_looked_for_by_its_file_whatever_its_number() {
        for file in [
            "dri/renderD128",
            "dri/renderD131",
            "nvidia0",
            "nvidiactl",
            "nvhost-ctrl-gpu",
            "nvgpu",
            "kfd",
            "dxg",
            "mali0",
        ] {
            let devices = tempfile::tempdir().unwrap();
            fs::create_dir(devices.path().join("dri")).unwrap();
            fs::write(devices.path().join("null"), "").unwrap();
            assert!(!has_card_file(devices.path()), "an empty folder of cards is none");
            fs::write(devices.path().join(file), "").unwrap();
            assert!(has_card_file(devices.path()), "{file}");
        }
    }

    #[test]
    fn what_cannot_be_listed_may_hold_a_card_and_what_is_not_there_holds_none() {
        let devices = tempfile::tempdir().unwrap();
        assert!(!has_card_file(&devices.path().join("none")), "no folder of devices");
        assert!(!has_card_file(devices.path()), "no folder of cards");
        fs::write(devices.path().join("dri"), "").unwrap();
        assert!(has_card_file(devices.path()), "one that cannot be listed");
    }
}
