//! Memory of a GPU: what goes up and what comes down.

use super::context::{Gpu, lock};
use super::shader::Mirrored;
use crate::error::Error;
use bytemuck::{Pod, cast_slice, cast_slice_mut};
use rayon::prelude::*;
use std::time::Instant;

/// Bytes of rows that are made before they are handed over: what stays in a processor's cache.
const BYTES_AT_ONCE: usize = 4 << 20;

/// Memory of a GPU.
#[derive(Debug)]
pub struct Buffer {
    pub(super) raw: wgpu::Buffer,
}

impl Buffer {
    /// Its size.
    pub fn bytes(&self) -> u64 {
        self.raw.size()
    }
}

/// Layers of texels on a GPU, which kernels fetch faster than values of a [`Buffer`].
#[derive(Debug)]
pub struct Texture {
    pub(super) raw: wgpu::Texture,
    view: wgpu::TextureView,
}

/// What a texel is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Texels {
    /// `rgba32float`.
    FourFloats,
    /// `rg32uint`.
    TwoWords,
}

/// What a kernel is given.
#[derive(Debug, Clone, Copy)]
pub enum Resource<'a> {
    /// For `var<storage>` and `var<uniform>`.
    Buffer(&'a Buffer),
    /// For `texture_2d_array` and `texture_storage_2d_array`.
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

impl Gpu {
    /// A buffer of `values`.
    ///
    /// # Errors
    /// When it does not fit, or the device fails.
    pub fn upload<T: Pod>(&self, label: &str, values: &[T]) -> Result<Buffer, Error> {
        self.upload_all(label, &[values])
    }

    /// A buffer of all `parts`, one after the other.
    ///
    /// # Errors
    /// As [`Self::upload`].
    pub fn upload_all<T: Pod>(&self, label: &str, parts: &[&[T]]) -> Result<Buffer, Error> {
        let bytes: usize = parts.iter().map(|part| size_of_val(*part)).sum();
        let buffer = self.buffer(label, bytes as u64, wgpu::BufferUsages::STORAGE)?;
        self.write(label, &buffer, 0, parts)?;
        Ok(buffer)
    }

    /// A buffer of `rows` rows of `width` values, each written by `row`: several at once, so that it may gather what lies far
    /// apart.
    ///
    /// # Errors
    /// As [`Self::upload`].
    pub fn upload_rows<T: Pod + Send>(
        &self,
        label: &str,
        (width, rows): (usize, usize),
        row: impl Fn(usize, &mut [T]) + Sync,
    ) -> Result<Buffer, Error> {
        let row_bytes = width * size_of::<T>();
        let buffer = self.buffer(label, (rows * row_bytes) as u64, wgpu::BufferUsages::STORAGE)?;
        let at_once = (BYTES_AT_ONCE / row_bytes.max(1)).clamp(1, rows.max(1));
        let mut values = vec![T::zeroed(); at_once * width];
        for start in (0..rows).step_by(at_once) {
            let values = &mut values[..at_once.min(rows - start) * width];
            values.par_chunks_mut(width.max(1)).enumerate().for_each(|(i, values)| row(start + i, values));
            self.write(label, &buffer, start * row_bytes, &[values])?;
        }
        Ok(buffer)
    }

    /// A buffer of the members of `values`, for a shader's `var<uniform>`.
    ///
    /// # Errors
    /// As [`Self::upload`].
    pub fn uniform(&self, values: &impl Mirrored) -> Result<Buffer, Error> {
        self.uniform_of(&values.words())
    }

    /// A buffer of `values`, for a `var<uniform>` that is an array.
    ///
    /// # Errors
    /// As [`Self::upload`].
    pub fn uniform_of<T: Pod>(&self, values: &[T]) -> Result<Buffer, Error> {
        const LABEL: &str = "parameters";
        let buffer = self.buffer(LABEL, size_of_val(values) as u64, wgpu::BufferUsages::UNIFORM)?;
        self.write(LABEL, &buffer, 0, &[values])?;
        Ok(buffer)
    }

    /// A buffer of `count` values, all 0.
    ///
    /// # Errors
    /// As [`Self::upload`].
    pub fn zeros<T: Pod>(&self, label: &str, count: usize) -> Result<Buffer, Error> {
        self.buffer(label, (count * size_of::<T>()) as u64, wgpu::BufferUsages::STORAGE)
    }

    pub(super) fn buffer(&self, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> Result<Buffer, Error> {
        let most = self.most_binding_bytes();
        if bytes > most {
            return Err(too_large(label, format!("{bytes} bytes"), format!("{most} bytes at most")));
        }
        // A buffer of nothing cannot be bound.
        let size = bytes.next_multiple_of(4).max(4);
        let usage = usage | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        let descriptor =
            wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false };
        self.guarded(label, || Buffer { raw: self.device.create_buffer(&descriptor) })
    }

    /// `layers` layers of `width` × `height` texels, all 0.
    ///
    /// # Errors
    /// As [`Self::upload`].
    pub fn texture(
        &self,
        label: &str,
        texels: Texels,
        (width, height): (usize, usize),
        layers: usize,
    ) -> Result<Texture, Error> {
        let limits = self.device.limits();
        let most = [limits.max_texture_dimension_2d, limits.max_texture_array_layers];
        if width.max(height) > most[0] as usize || layers > most[1] as usize {
            let found = format!("{layers} layers of {width} × {height} texels");
            return Err(too_large(label, found, format!("{} of {} either way at most", most[1], most[0])));
        }
        let [width, height, layers] = [width, height, layers].map(|side| side.max(1) as u32);
        let descriptor = wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: layers },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: match texels {
                Texels::FourFloats => wgpu::TextureFormat::Rgba32Float,
                Texels::TwoWords => wgpu::TextureFormat::Rg32Uint,
            },
            usage: wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::STORAGE_BINDING
                | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        };
        let of_layers = wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..wgpu::TextureViewDescriptor::default()
        };
        self.guarded(label, || {
            let raw = self.device.create_texture(&descriptor);
            let view = raw.create_view(&of_layers);
            Texture { raw, view }
        })
    }

    /// Writes `parts` into `buffer`, one after the other, from byte `start` on.
    fn write<T: Pod>(&self, label: &str, buffer: &Buffer, start: usize, parts: &[&[T]]) -> Result<(), Error> {
        let watch = Instant::now();
        let end = self.guarded(label, || {
            parts.iter().fold(start, |offset, part| {
                let bytes: &[u8] = cast_slice(part);
                self.queue.write_buffer(&buffer.raw, offset as u64, bytes);
                offset + bytes.len()
            })
        })?;
        lock(&self.usage).uploaded(end - start, watch.elapsed());
        Ok(())
    }

    /// What `buffer` holds after everything that was asked for.
    ///
    /// # Errors
    /// When the device fails.
    pub fn read<T: Pod>(&self, buffer: &Buffer) -> Result<Vec<T>, Error> {
        self.finish()?;
        let watch = Instant::now();
        let values: Vec<T> = self.fetch(buffer)?;
        lock(&self.usage).read_back(size_of_val(&values[..]), watch.elapsed());
        Ok(values)
    }

    /// Copies `buffer` into `parts`, one after the other, after everything that was asked for.
    ///
    /// # Errors
    /// When the device fails.
    pub fn read_into(&self, buffer: &Buffer, parts: &mut [&mut [f32]]) -> Result<(), Error> {
        self.finish()?;
        let watch = Instant::now();
        let bytes = self.mapped(buffer, |bytes| {
            let mut rest = bytes;
            for part in parts {
                let target: &mut [u8] = cast_slice_mut(part);
                let (source, others) = rest.split_at(target.len());
                target.copy_from_slice(source);
                rest = others;
            }
            bytes.len() - rest.len()
        })?;
        lock(&self.usage).read_back(bytes, watch.elapsed());
        Ok(())
    }

    pub(super) fn fetch<T: Pod>(&self, buffer: &Buffer) -> Result<Vec<T>, Error> {
        self.mapped(buffer, bytemuck::pod_collect_to_vec)
    }

    /// Calls `look` with the bytes of `buffer`.
    fn mapped<T>(&self, buffer: &Buffer, look: impl FnOnce(&[u8]) -> T) -> Result<T, Error> {
        const LABEL: &str = "readback";
        let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ;
        let size = buffer.raw.size();
        let descriptor =
            wgpu::BufferDescriptor { label: Some(LABEL), size, usage, mapped_at_creation: false };
        let copy = self.guarded(LABEL, || {
            let copy = self.device.create_buffer(&descriptor);
            let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            encoder.copy_buffer_to_buffer(&buffer.raw, 0, &copy, 0, size);
            self.queue.submit([encoder.finish()]);
            copy.map_async(wgpu::MapMode::Read, .., |_| ());
            copy
        })?;
        self.finish()?;
        let view = copy.get_mapped_range(..).map_err(|error| self.failure(LABEL, &error.to_string()))?;
        Ok(look(&view))
    }
}

fn too_large(what: &str, found: String, wanted: String) -> Error {
    Error::device(format!("{what} are too large for the GPU"))
        .with("found", found)
        .with("wanted", wanted)
        .help("use --device cpu")
}
