//! Kernels, and passes that run them.

use super::clock::GpuUsage;
use super::context::{Gpu, lock};
use super::handles::{Kernel, Resource, Stamps};
use super::shader::Shader;
use crate::error::Error;

/// Passes to submit, executed in order.
pub(crate) struct Work<'g> {
    gpu: &'g Gpu,
    passes: Vec<Pass>,
}

struct Pass {
    kernel: Kernel,
    bindings: wgpu::BindGroup,
    groups: [u32; 3],
}

impl std::fmt::Debug for Work<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.passes.iter().map(|pass| pass.kernel.name)).finish()
    }
}

impl Gpu {
    /// The kernel of entry point `name` of `shader`, compiled on first use.
    ///
    /// # Errors
    /// If the driver rejects it.
    pub(crate) fn kernel(&self, shader: &'static Shader, name: &'static str) -> Result<Kernel, Error> {
        self.kernel_with(shader, name, &[])
    }

    /// The same with values for the shader's `override` constants.
    ///
    /// # Errors
    /// As [`Self::kernel`].
    pub(crate) fn kernel_with(
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
            let module =
                lock(&self.modules).entry(shader.name).or_insert_with(|| self.module(shader)).clone();
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

    fn module(&self, shader: &Shader) -> wgpu::ShaderModule {
        self.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(shader.name),
            source: wgpu::ShaderSource::Wgsl(shader.source().into()),
        })
    }

    /// Submits the passes that `add_passes` adds, in order.
    ///
    /// # Errors
    /// If a pass is invalid, or the device fails.
    pub(crate) fn submit(
        &self,
        add_passes: impl FnOnce(&mut Work<'_>) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let mut work = Work { gpu: self, passes: Vec::new() };
        add_passes(&mut work)?;
        let names: Vec<_> = work.passes.iter().map(|pass| pass.kernel.name).collect();
        let stamps = self.stamps(names)?;
        self.guarded("the passes", || {
            let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let set = stamps.as_ref().map(|(set, _)| set);
            work.passes.iter().enumerate().for_each(|(i, pass)| pass.encode(&mut encoder, set, i));
            if let Some((set, Stamps { ticks, names })) = &stamps {
                encoder.resolve_query_set(set, 0..2 * names.len() as u32, &ticks.raw, 0);
            }
            self.queue.submit([encoder.finish()]);
        })?;
        lock(&self.usage).submitted(work.passes.len());
        lock(&self.pending).extend(stamps.map(|(_, stamps)| stamps));
        Ok(())
    }

    /// Usage of the GPU so far.
    ///
    /// # Errors
    /// When the device fails.
    pub fn usage(&self) -> Result<GpuUsage, Error> {
        let nanoseconds_per_tick = f64::from(self.queue.get_timestamp_period());
        for Stamps { names, ticks } in std::mem::take(&mut *lock(&self.pending)) {
            let ticks: Vec<u64> = self.fetch(&ticks)?;
            let mut usage = lock(&self.usage);
            for (name, ticks) in names.into_iter().zip(ticks.chunks_exact(2)) {
                usage.passed(name, ticks[1].saturating_sub(ticks[0]) as f64 * nanoseconds_per_tick * 1e-9);
            }
        }
        Ok(lock(&self.usage).clone())
    }

    /// Query set and buffer for the timestamps of the passes `names`; `None` if the adapter does not support timestamps.
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

impl Pass {
    /// Encodes the pass with number `i`; its timestamps are written to `set`.
    fn encode(&self, encoder: &mut wgpu::CommandEncoder, set: Option<&wgpu::QuerySet>, i: usize) {
        let Self { kernel, bindings, groups: [x, y, z] } = self;
        let timestamp_writes = set.map(|query_set| wgpu::ComputePassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(2 * i as u32),
            end_of_pass_write_index: Some(2 * i as u32 + 1),
        });
        let label = Some(kernel.name);
        let mut encoded =
            encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label, timestamp_writes });
        encoded.set_pipeline(&kernel.pipeline);
        encoded.set_bind_group(0, bindings, &[]);
        encoded.dispatch_workgroups(*x, *y, *z);
    }
}

impl Work<'_> {
    /// Adds a pass of `groups` workgroups of `kernel`. `bindings` have to be exactly those that the entry point uses, each with
    /// its number.
    ///
    /// # Errors
    /// If the bindings are not the kernel's.
    pub(crate) fn pass<'a, R: Into<Resource<'a>> + Copy>(
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
        self.passes.push(Pass { kernel: kernel.clone(), bindings, groups });
        Ok(())
    }
}

/// Maximum number of loop iterations of a thread in one pass, all loops together. Mesa's software driver ends loops after 65 535
/// iterations without an error.
pub(crate) const MAX_ROUNDS: usize = 60_000;

/// Workgroups of `side` × `side` threads that cover `width` × `height` values.
pub(crate) fn tiles(width: usize, height: usize, side: usize) -> [u32; 3] {
    [width.div_ceil(side) as u32, height.div_ceil(side) as u32, 1]
}
