//! Handles that a [`super::Gpu`] returns: memory and kernels.

/// A buffer in GPU memory.
#[derive(Debug)]
pub(crate) struct Buffer {
    pub(super) raw: wgpu::Buffer,
}

impl Buffer {
    /// Size in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.raw.size()
    }
}

/// A texture array in GPU memory; kernels fetch its texels faster than values of a [`Buffer`].
#[derive(Debug)]
pub(crate) struct Texture {
    pub(super) raw: wgpu::Texture,
    pub(super) view: wgpu::TextureView,
}

/// Format of texels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Texels {
    /// `rgba32float`.
    FourFloats,
    /// `rgba32uint`.
    FourWords,
}

/// A resource that is bound to a kernel.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Resource<'a> {
    /// For `var<storage>` and `var<uniform>`.
    Buffer(&'a Buffer),
    /// For `texture_2d_array`.
    Texture(&'a Texture),
}

impl<'a> From<&'a Buffer> for Resource<'a> {
    fn from(buffer: &'a Buffer) -> Self {
        Self::Buffer(buffer)
    }
}

impl<'a> From<&'a Texture> for Resource<'a> {
    fn from(texture: &'a Texture) -> Self {
        Self::Texture(texture)
    }
}

impl<'a> Resource<'a> {
    pub(super) fn raw(self) -> wgpu::BindingResource<'a> {
        match self {
            Self::Buffer(buffer) => buffer.raw.as_entire_binding(),
            Self::Texture(texture) => wgpu::BindingResource::TextureView(&texture.view),
        }
    }
}

/// An entry point of a shader, ready to run.
#[derive(Debug, Clone)]
pub(crate) struct Kernel {
    pub(super) name: &'static str,
    pub(super) pipeline: wgpu::ComputePipeline,
}

/// Timestamps of passes, not read yet.
pub(super) struct Stamps {
    pub(super) names: Vec<&'static str>,
    pub(super) ticks: Buffer,
}
