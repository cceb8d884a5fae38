//! The graphics adapters of this machine that wgpu finds, by kind.

use serde::Serialize;
use std::fmt;

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
