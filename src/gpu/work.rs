//! Work for a GPU: kernels, and passes that run them.

use super::context::{Gpu, lock};
use super::memory::{Buffer, Resource, Texture};
use super::shader::Shader;
use crate::error::Error;

/// An entry point of a shader, ready to run.
#[derive(Debug, Clone)]
pub struct Kernel {
    name: &'static str,
    pipeline: wgpu::ComputePipeline,
}

/// Times of passes that are still to be read.
pub(super) struct Stamps {
    pub(super) names: Vec<&'static str>,
    pub(super) ticks: Buffer,
}

/// Passes that are to be carried out one after the other, and copies between them.
pub struct Work<'g> {
    gpu: &'g Gpu,
    steps: Vec<Step>,
}

enum Step {
    Pass(Pass),
    Copy(Copy),
}

struct Pass {
    kernel: Kernel,
    bindings: wgpu::BindGroup,
    groups: [u32; 3],
}

/// The texels of a texture's layer, from a buffer of as many rows one after the other.
struct Copy {
    from: wgpu::Buffer,
    to: wgpu::Texture,
    layer: u32,
    row_bytes: u32,
}

impl Step {
    fn kernel_name(&self) -> Option<&'static str> {
        match self {
            Self::Pass(pass) => Some(pass.kernel.name),
            Self::Copy(_) => None,
        }
    }
}

impl std::fmt::Debug for Work<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.steps.iter().filter_map(Step::kernel_name)).finish()
    }
}

impl Gpu {
    /// The entry point `name` of `shader`, made when it is first asked for.
    ///
    /// # Errors
    /// When the driver does not take it.
    pub fn kernel(&self, shader: &'static Shader, name: &'static str) -> Result<Kernel, Error> {
        self.kernel_with(shader, name, &[])
    }

    /// The same with `constants` in place of the shader's `override`s.
    ///
    /// # Errors
    /// As [`Self::kernel`].
    pub fn kernel_with(
        &self,
        shader: &'static Shader,
        name: &'static str,
        constants: &[(&str, f64)],
    ) -> Result<Kernel, Error> {
        let key = format!("{} {name} {constants:?}", shader.name);
        let known = lock(&self.kernels).get(&key).cloned();
        if let Some(kernel) = known {
            return Ok(kernel);
        }
        let kernel = self.guarded(name, || {
            let module = self.device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(shader.name),
                source: wgpu::ShaderSource::Wgsl(shader.source().into()),
            });
            let compilation_options =
                wgpu::PipelineCompilationOptions { constants, zero_initialize_workgroup_memory: false };
            let pipeline = self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(name),
                layout: None,
                module: &module,
                entry_point: Some(name),
                compilation_options,
                cache: None,
            });
            Kernel { name, pipeline }
        })?;
        lock(&self.kernels).insert(key, kernel.clone());
        Ok(kernel)
    }

    /// Has the passes that `ask` asks for carried out, in order.
    ///
    /// # Errors
    /// When one cannot be, or the device fails.
    pub fn submit(&self, ask: impl FnOnce(&mut Work<'_>) -> Result<(), Error>) -> Result<(), Error> {
        let mut work = Work { gpu: self, steps: Vec::new() };
        ask(&mut work)?;
        let names: Vec<_> = work.steps.iter().filter_map(Step::kernel_name).collect();
        let passes = names.len();
        let stamps = self.stamps(names)?;
        self.guarded("the passes", || {
            let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let set = stamps.as_ref().map(|(set, _)| set);
            work.steps.iter().fold(0, |pass, step| step.encode(&mut encoder, set, pass));
            if let Some((set, Stamps { ticks, names })) = &stamps {
                encoder.resolve_query_set(set, 0..2 * names.len() as u32, &ticks.raw, 0);
            }
            self.queue.submit([encoder.finish()]);
        })?;
        lock(&self.usage).asked_for(passes);
        lock(&self.pending).extend(stamps.map(|(_, stamps)| stamps));
        Ok(())
    }

    /// Where the times of the passes `names` are written, if the adapter has a clock.
    fn stamps(&self, names: Vec<&'static str>) -> Result<Option<(wgpu::QuerySet, Stamps)>, Error> {
        const LABEL: &str = "times";
        if !self.device.features().contains(wgpu::Features::TIMESTAMP_QUERY) || names.is_empty() {
            return Ok(None);
        }
        let count = 2 * names.len() as u32;
        let bytes = u64::from(count) * size_of::<u64>() as u64;
        let ticks = self.buffer(LABEL, bytes, wgpu::BufferUsages::QUERY_RESOLVE)?;
        let descriptor =
            wgpu::QuerySetDescriptor { label: Some(LABEL), ty: wgpu::QueryType::Timestamp, count };
        let set = self.guarded(LABEL, || self.device.create_query_set(&descriptor))?;
        Ok(Some((set, Stamps { names, ticks })))
    }
}

impl Step {
    /// Encodes the step, before which there were `pass` passes, and returns how many there are then; their times go into `set`.
    fn encode(&self, encoder: &mut wgpu::CommandEncoder, set: Option<&wgpu::QuerySet>, pass: u32) -> u32 {
        match self {
            Self::Copy(copy) => {
                copy.encode(encoder);
                pass
            }
            Self::Pass(Pass { kernel, bindings, groups: [x, y, z] }) => {
                let timestamp_writes = set.map(|query_set| wgpu::ComputePassTimestampWrites {
                    query_set,
                    beginning_of_pass_write_index: Some(2 * pass),
                    end_of_pass_write_index: Some(2 * pass + 1),
                });
                let label = Some(kernel.name);
                let mut encoded =
                    encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label, timestamp_writes });
                encoded.set_pipeline(&kernel.pipeline);
                encoded.set_bind_group(0, bindings, &[]);
                encoded.dispatch_workgroups(*x, *y, *z);
                pass + 1
            }
        }
    }
}

impl Copy {
    fn encode(&self, encoder: &mut wgpu::CommandEncoder) {
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(self.row_bytes),
            rows_per_image: None,
        };
        let from = wgpu::TexelCopyBufferInfo { buffer: &self.from, layout };
        let origin = wgpu::Origin3d { x: 0, y: 0, z: self.layer };
        let to = wgpu::TexelCopyTextureInfo { origin, ..self.to.as_image_copy() };
        let size = wgpu::Extent3d { depth_or_array_layers: 1, ..self.to.size() };
        encoder.copy_buffer_to_texture(from, to, size);
    }
}

impl Work<'_> {
    /// Asks for `groups` workgroups of `kernel`, with `bindings` by their number: those that the entry point uses, no others.
    ///
    /// # Errors
    /// When the bindings are not the kernel's.
    pub fn pass<'a, R: Into<Resource<'a>> + std::marker::Copy>(
        &mut self,
        kernel: &Kernel,
        bindings: &[(u32, R)],
        groups: [u32; 3],
    ) -> Result<(), Error> {
        let gpu = self.gpu;
        let bindings = gpu.guarded(kernel.name, || {
            let entry = |&(binding, resource): &(u32, R)| wgpu::BindGroupEntry {
                binding,
                resource: resource.into().raw(),
            };
            let entries: Vec<_> = bindings.iter().map(entry).collect();
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(kernel.name),
                layout: &kernel.pipeline.get_bind_group_layout(0),
                entries: &entries,
            })
        })?;
        self.steps.push(Step::Pass(Pass { kernel: kernel.clone(), bindings, groups }));
        Ok(())
    }

    /// Asks for a copy of `from`, rows of texels of `row_bytes` each, a multiple of [`ROW_ALIGNMENT`], to layer `layer` of `to`.
    pub fn copy(&mut self, from: &Buffer, to: &Texture, layer: usize, row_bytes: usize) {
        let (from, to) = (from.raw.clone(), to.raw.clone());
        let copy = Copy { from, to, layer: layer as u32, row_bytes: row_bytes as u32 };
        self.steps.push(Step::Copy(copy));
    }
}

/// Rounds of all loops of a thread together in one pass. Mesa's software driver ends them without a word after 65 535.
pub const MOST_ROUNDS: usize = 60_000;

/// Rows of a buffer that is copied to a texture are a multiple of so many bytes.
pub const ROW_ALIGNMENT: usize = wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize;

/// Workgroups of `side` × `side` threads that cover `width` × `height` values.
pub fn tiles(width: usize, height: usize, side: usize) -> [u32; 3] {
    [width.div_ceil(side) as u32, height.div_ceil(side) as u32, 1]
}
