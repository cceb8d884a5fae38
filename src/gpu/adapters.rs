//! The graphics adapters of this machine, as wgpu finds them, and which of them counts as a GPU.

use serde::Serialize;
use std::fmt;

/// What an adapter is made of, in the order in which one is taken rather than another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum AdapterKind {
    /// A card with memory of its own.
    Discrete,
    /// A part of the processor, with which it shares its memory.
    Integrated,
    /// A card that is shared with other machines.
    Virtual,
    /// Not known.
    Other,
    /// A program on the processor.
    Software,
}

impl AdapterKind {
    /// The name of listings.
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

/// An adapter, and what a frame may take of it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct Adapter {
    /// The name it gives itself.
    pub name: String,
    /// What it is made of.
    pub kind: AdapterKind,
    /// The interface that it is reached by: Vulkan, Metal or DX12.
    pub interface: String,
    /// Driver and its version.
    pub driver: String,
    /// The largest part of a buffer that a shader can see at once, in bytes: larger frames go in bands.
    pub max_binding_bytes: u64,
    /// The largest buffer in bytes.
    pub max_buffer_bytes: u64,
    /// Threads of a workgroup.
    pub max_workgroup_threads: u32,
    /// Whether it can time what it does.
    pub has_timestamps: bool,
}

impl fmt::Display for Adapter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}, {})", self.name, self.kind.name(), self.interface)
    }
}

/// Every adapter of this machine.
#[cfg(feature = "gpu")]
pub(super) fn find() -> Vec<Adapter> {
    enumerate().iter().map(Adapter::of).collect()
}

/// None: this program was built without them.
#[cfg(not(feature = "gpu"))]
pub(super) fn find() -> Vec<Adapter> {
    Vec::new()
}

/// Every adapter as wgpu has it.
#[cfg(feature = "gpu")]
pub(super) fn enumerate() -> Vec<wgpu::Adapter> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()))
}

#[cfg(feature = "gpu")]
impl Adapter {
    pub(super) fn of(adapter: &wgpu::Adapter) -> Self {
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
