//! GPU memory: allocation, upload and readback.

use super::context::{Gpu, lock};
use super::handles::{Buffer, Texels, Texture};
use super::shader::Mirrored;
use crate::error::Error;
use crate::parallel;
use bytemuck::{Pod, cast_slice, cast_slice_mut};
use std::time::Instant;

impl Gpu {
    /// Uploads `values` to a new buffer.
    ///
    /// # Errors
    /// If the buffer is too large, or the device fails.
    pub(crate) fn upload<T: Pod>(&self, label: &str, values: &[T]) -> Result<Buffer, Error> {
        self.upload_all(label, &[values])
    }

    /// Uploads all `parts`, concatenated, to a new buffer.
    ///
    /// # Errors
    /// As [`Self::upload`].
    pub(crate) fn upload_all<T: Pod>(&self, label: &str, parts: &[&[T]]) -> Result<Buffer, Error> {
        let bytes: usize = parts.iter().map(|part| size_of_val(*part)).sum();
        let buffer = self.buffer(label, bytes as u64, wgpu::BufferUsages::STORAGE)?;
        self.write(label, &buffer, 0, parts)?;
        Ok(buffer)
    }

    /// Uploads the members of `values` to a new buffer for `var<uniform>`.
    ///
    /// # Errors
    /// As [`Self::upload`].
    pub(crate) fn uniform(&self, values: &impl Mirrored) -> Result<Buffer, Error> {
        self.uniform_of(&values.words())
    }

    /// Uploads `values` to a new buffer for a `var<uniform>` that is an array.
    ///
    /// # Errors
    /// As [`Self::upload`].
    pub(crate) fn uniform_of<T: Pod>(&self, values: &[T]) -> Result<Buffer, Error> {
        const LABEL: &str = "parameters";
        let buffer = self.buffer(LABEL, size_of_val(values) as u64, wgpu::BufferUsages::UNIFORM)?;
        self.write(LABEL, &buffer, 0, &[values])?;
        Ok(buffer)
    }

    /// Allocates a buffer of `count` values, all 0.
    ///
    /// # Errors
    /// As [`Self::upload`].
    pub(crate) fn zeros<T: Pod>(&self, label: &str, count: usize) -> Result<Buffer, Error> {
        self.buffer(label, (count * size_of::<T>()) as u64, wgpu::BufferUsages::STORAGE)
    }

    pub(super) fn buffer(&self, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> Result<Buffer, Error> {
        let max_bytes = self.max_binding_bytes();
        if bytes > max_bytes {
            return Err(too_large(label, format!("{bytes} bytes"), format!("{max_bytes} bytes at most")));
        }
        // An empty buffer cannot be bound.
        let size = bytes.next_multiple_of(4).max(4);
        let usage = usage | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        let descriptor =
            wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false };
        self.guarded(label, || Buffer { raw: self.device.create_buffer(&descriptor) })
    }

    /// Allocates a texture of `layers` layers of `width` × `height` texels, all 0.
    ///
    /// # Errors
    /// As [`Self::upload`].
    pub(crate) fn texture(
        &self,
        label: &str,
        texels: Texels,
        (width, height): (usize, usize),
        layers: usize,
    ) -> Result<Texture, Error> {
        let [max_side, max_layers] =
            [self.max_texels(), self.device.limits().max_texture_array_layers as usize];
        if width.max(height) > max_side || layers > max_layers {
            let found = format!("{layers} layers of {width} × {height} texels");
            return Err(too_large(
                label,
                found,
                format!("{max_layers} layers of {max_side} × {max_side} texels at most"),
            ));
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
                Texels::FourWords => wgpu::TextureFormat::Rgba32Uint,
            },
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        };
        let array_view = wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..wgpu::TextureViewDescriptor::default()
        };
        self.guarded(label, || {
            let raw = self.device.create_texture(&descriptor);
            let view = raw.create_view(&array_view);
            Texture { raw, view }
        })
    }

    /// Fills layer `layer` of `texture`: `row` writes a row of texels. Rows are written in parallel, which hides the latency
    /// where `row` gathers from scattered memory.
    ///
    /// # Errors
    /// As [`Self::upload`].
    pub(crate) fn fill<T: Pod + Send>(
        &self,
        texture: &Texture,
        layer: usize,
        row: &(dyn Fn(usize, &mut [T]) + Sync),
    ) -> Result<(), Error> {
        const LABEL: &str = "texels";
        let watch = Instant::now();
        let size = wgpu::Extent3d { depth_or_array_layers: 1, ..texture.raw.size() };
        let row_bytes = size.width as usize * size_of::<T>();
        let stride = row_bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize);
        let descriptor = wgpu::BufferDescriptor {
            label: Some(LABEL),
            size: (stride * size.height as usize) as u64,
            usage: wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::MAP_WRITE,
            mapped_at_creation: true,
        };
        let staged = self.guarded(LABEL, || self.device.create_buffer(&descriptor))?;
        let texels = || vec![T::zeroed(); size.width as usize];
        let written = parallel::map_with(size.height as usize, &texels, &|texels, y| {
            row(y, texels);
            let start = (y * stride) as u64;
            let target = staged.get_mapped_range_mut(start..start + stride as u64);
            let mut target = target.map_err(|error| self.failure(LABEL, &error.to_string()))?;
            target.slice(..row_bytes).copy_from_slice(cast_slice(texels));
            Ok(())
        });
        written.into_iter().collect::<Result<(), Error>>()?;
        self.guarded(LABEL, || {
            staged.unmap();
            let layout = wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(stride as u32),
                rows_per_image: None,
            };
            let origin = wgpu::Origin3d { z: layer as u32, ..wgpu::Origin3d::ZERO };
            let target = wgpu::TexelCopyTextureInfo { origin, ..texture.raw.as_image_copy() };
            let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            encoder.copy_buffer_to_texture(
                wgpu::TexelCopyBufferInfo { buffer: &staged, layout },
                target,
                size,
            );
            self.queue.submit([encoder.finish()]);
        })?;
        lock(&self.usage).uploaded(row_bytes * size.height as usize, watch.elapsed());
        Ok(())
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

    /// Reads `buffer` back after all submitted work.
    ///
    /// # Errors
    /// When the device fails.
    pub(crate) fn read<T: Pod>(&self, buffer: &Buffer) -> Result<Vec<T>, Error> {
        self.finish()?;
        let watch = Instant::now();
        let values: Vec<T> = self.fetch(buffer)?;
        lock(&self.usage).read_back(size_of_val(&values[..]), watch.elapsed());
        Ok(values)
    }

    /// Copies `buffer` to `parts`, in order, after all submitted work.
    ///
    /// # Errors
    /// When the device fails.
    pub(crate) fn read_into(&self, buffer: &Buffer, parts: &mut [&mut [f32]]) -> Result<(), Error> {
        self.finish()?;
        let watch = Instant::now();
        let bytes = self.mapped(buffer, |bytes| {
            let mut rest = bytes;
            for part in parts {
                let target: &mut [u8] = cast_slice_mut(part);
                let (source, remaining) = rest.split_at(target.len());
                target.copy_from_slice(source);
                rest = remaining;
            }
            bytes.len() - rest.len()
        })?;
        lock(&self.usage).read_back(bytes, watch.elapsed());
        Ok(())
    }

    pub(super) fn fetch<T: Pod>(&self, buffer: &Buffer) -> Result<Vec<T>, Error> {
        self.mapped(buffer, bytemuck::pod_collect_to_vec)
    }

    /// Calls `inspect` with the bytes of `buffer`.
    fn mapped<T>(&self, buffer: &Buffer, inspect: impl FnOnce(&[u8]) -> T) -> Result<T, Error> {
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
        Ok(inspect(&view))
    }
}

fn too_large(what: &str, found: String, limit: String) -> Error {
    Error::device(format!("{what} are too large for the GPU"))
        .with("found", found)
        .with("expected", limit)
        .help("use `device = cpu`")
}
