//! An adapter at work: buffers, kernels, and every failure as one [`Error`].
//!
//! wgpu reports a failure in a scope, by a callback or by a panic, at once or later; here each ends as the `Err` of the call
//! that meets it. After one, the caller does what it wanted on the processor: nothing made on a GPU is kept for later.

use super::adapters::{self, Adapter, AdapterKind};
use super::clock::GpuUsage;
use super::quiet::quietly;
use super::shader::{Mirrored, Shader};
use crate::error::Error;
use bytemuck::{Pod, cast_slice};
use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// What a frame may take of an adapter, on top of its own limits: bands of this size lose nothing, and leave room for others.
const MOST_WORKING_BYTES: u64 = 2 << 30;

/// An adapter, opened.
pub struct Gpu {
    adapter: Adapter,
    device: wgpu::Device,
    queue: wgpu::Queue,
    most_binding_bytes: u64,
    kernels: Mutex<HashMap<(&'static str, &'static str), Kernel>>,
    /// What failed first of what no scope was there to catch.
    fault: Arc<Mutex<Option<String>>>,
    usage: Mutex<GpuUsage>,
    pending: Mutex<Vec<Stamps>>,
}

/// Memory of a GPU.
#[derive(Debug)]
pub struct Buffer {
    raw: wgpu::Buffer,
}

impl Buffer {
    /// Its size.
    pub fn bytes(&self) -> u64 {
        self.raw.size()
    }
}

/// An entry point of a shader, ready to run.
#[derive(Debug, Clone)]
pub struct Kernel {
    name: &'static str,
    pipeline: wgpu::ComputePipeline,
}

/// Times of passes that are still to be read.
struct Stamps {
    names: Vec<&'static str>,
    ticks: Buffer,
}

/// Locked; what a thread that panicked had half done is whole here: every change is one step.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl std::fmt::Debug for Gpu {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Gpu").field("adapter", &self.adapter).finish_non_exhaustive()
    }
}

impl Gpu {
    /// Opens the fastest adapter that there is; one that is a program on the processor only if `software` ones will do, and
    /// `None` where there is none.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Device`] for one that cannot be opened.
    pub fn open(software: bool) -> Result<Option<Self>, Error> {
        let found = adapters::enumerate().into_iter().map(|raw| (Adapter::of(&raw), raw));
        let fit = found.filter(|(adapter, _)| software || adapter.kind != AdapterKind::Software);
        let Some((adapter, raw)) = fit.min_by_key(|(adapter, _)| adapter.kind) else { return Ok(None) };
        Self::of(adapter, &raw).map(Some)
    }

    fn of(adapter: Adapter, raw: &wgpu::Adapter) -> Result<Self, Error> {
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("thinlens"),
            required_features: raw.features() & wgpu::Features::TIMESTAMP_QUERY,
            required_limits: raw.limits(),
            ..wgpu::DeviceDescriptor::default()
        };
        let opened = quietly(|| pollster::block_on(raw.request_device(&descriptor)));
        let (device, queue) = opened.map_err(|error| {
            Error::device("the GPU cannot be opened")
                .with("found", adapter.to_string())
                .help("use --device cpu")
                .caused_by(error)
        })?;
        let fault = Arc::new(Mutex::new(None));
        let note = |fault: &Arc<Mutex<Option<String>>>, text: String| {
            lock(fault).get_or_insert(text);
        };
        let uncaught = Arc::clone(&fault);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| note(&uncaught, error.to_string())));
        let lost = Arc::clone(&fault);
        device.set_device_lost_callback(move |reason, text| {
            note(&lost, format!("the device was lost ({reason:?}): {text}"));
        });
        let most_binding_bytes =
            device.limits().max_storage_buffer_binding_size.min(device.limits().max_buffer_size);
        Ok(Self {
            adapter,
            device,
            queue,
            most_binding_bytes: most_binding_bytes.min(MOST_WORKING_BYTES),
            kernels: Mutex::default(),
            fault,
            usage: Mutex::default(),
            pending: Mutex::default(),
        })
    }

    /// The same with buffers of `bytes` at most, as if the adapter had no more: frames go in smaller bands.
    #[must_use]
    pub fn limited_to(self, bytes: u64) -> Self {
        Self { most_binding_bytes: self.most_binding_bytes.min(bytes), ..self }
    }

    /// The adapter.
    pub fn adapter(&self) -> &Adapter {
        &self.adapter
    }

    /// The largest buffer in bytes: larger frames go in [`super::bands`].
    pub fn most_binding_bytes(&self) -> u64 {
        self.most_binding_bytes
    }

    /// Bytes that all buffers of a band may take together.
    pub fn most_working_bytes(&self) -> u64 {
        MOST_WORKING_BYTES
    }

    /// Gives the device back: whatever is asked of it from now on fails.
    pub fn lose(&self) {
        self.device.destroy();
        lock(&self.fault).get_or_insert_with(|| "the device was given back".to_owned());
    }

    /// What it has spent its time on so far.
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
        self.fill(label, &buffer, parts)?;
        Ok(buffer)
    }

    /// A buffer of the members of `values`, for a shader's `var<uniform>`.
    ///
    /// # Errors
    /// As [`Self::upload`].
    pub fn uniform(&self, values: &impl Mirrored) -> Result<Buffer, Error> {
        let words = values.words();
        let buffer =
            self.buffer("parameters", size_of_val(&words[..]) as u64, wgpu::BufferUsages::UNIFORM)?;
        self.fill("parameters", &buffer, &[&words])?;
        Ok(buffer)
    }

    /// A buffer of `count` values, all 0.
    ///
    /// # Errors
    /// As [`Self::upload`].
    pub fn zeros<T: Pod>(&self, label: &str, count: usize) -> Result<Buffer, Error> {
        self.buffer(label, (count * size_of::<T>()) as u64, wgpu::BufferUsages::STORAGE)
    }

    fn buffer(&self, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> Result<Buffer, Error> {
        if bytes > self.most_binding_bytes {
            return Err(Error::device(format!("{label} are too large for the GPU"))
                .with("found", format!("{bytes} bytes"))
                .with("wanted", format!("{} bytes at most", self.most_binding_bytes))
                .help("use --device cpu"));
        }
        // A buffer of nothing cannot be bound.
        let size = bytes.next_multiple_of(4).max(4);
        let usage = usage | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        let descriptor =
            wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false };
        self.guarded(label, || Buffer { raw: self.device.create_buffer(&descriptor) })
    }

    fn fill<T: Pod>(&self, label: &str, buffer: &Buffer, parts: &[&[T]]) -> Result<(), Error> {
        let watch = Instant::now();
        let bytes = self.guarded(label, || {
            parts.iter().fold(0, |offset, part| {
                let bytes: &[u8] = cast_slice(part);
                self.queue.write_buffer(&buffer.raw, offset as u64, bytes);
                offset + bytes.len()
            })
        })?;
        lock(&self.usage).uploaded(bytes, watch.elapsed());
        Ok(())
    }

    /// The entry point `name` of `shader`, made when it is first asked for.
    ///
    /// # Errors
    /// When the driver does not take it.
    pub fn kernel(&self, shader: &'static Shader, name: &'static str) -> Result<Kernel, Error> {
        let known = lock(&self.kernels).get(&(shader.name, name)).cloned();
        if let Some(kernel) = known {
            return Ok(kernel);
        }
        let kernel = self.guarded(name, || {
            let module = self.device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(shader.name),
                source: wgpu::ShaderSource::Wgsl(shader.source().into()),
            });
            let compilation_options = wgpu::PipelineCompilationOptions {
                zero_initialize_workgroup_memory: false,
                ..wgpu::PipelineCompilationOptions::default()
            };
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
        lock(&self.kernels).insert((shader.name, name), kernel.clone());
        Ok(kernel)
    }

    /// Has the passes that `ask` asks for carried out, in order.
    ///
    /// # Errors
    /// When one cannot be, or the device fails.
    pub fn submit(&self, ask: impl FnOnce(&mut Work<'_>) -> Result<(), Error>) -> Result<(), Error> {
        let mut work = Work { gpu: self, passes: Vec::new() };
        ask(&mut work)?;
        let passes = work.passes;
        let stamps = self.stamps(&passes)?;
        let commands = self.guarded("the passes", || {
            let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            for (i, pass) in passes.iter().enumerate() {
                let timestamp_writes = stamps.as_ref().map(|(set, _)| wgpu::ComputePassTimestampWrites {
                    query_set: set,
                    beginning_of_pass_write_index: Some(2 * i as u32),
                    end_of_pass_write_index: Some(2 * i as u32 + 1),
                });
                let label = Some(pass.kernel.name);
                let descriptor = wgpu::ComputePassDescriptor { label, timestamp_writes };
                let mut encoded = encoder.begin_compute_pass(&descriptor);
                encoded.set_pipeline(&pass.kernel.pipeline);
                encoded.set_bind_group(0, &pass.bindings, &[]);
                let [x, y, z] = pass.groups;
                encoded.dispatch_workgroups(x, y, z);
            }
            if let Some((set, Stamps { ticks, names })) = &stamps {
                encoder.resolve_query_set(set, 0..2 * names.len() as u32, &ticks.raw, 0);
            }
            encoder.finish()
        })?;
        self.guarded("the passes", || self.queue.submit([commands]))?;
        lock(&self.usage).asked_for(passes.len());
        lock(&self.pending).extend(stamps.map(|(_, stamps)| stamps));
        Ok(())
    }

    fn stamps(&self, passes: &[Pass]) -> Result<Option<(wgpu::QuerySet, Stamps)>, Error> {
        if !self.device.features().contains(wgpu::Features::TIMESTAMP_QUERY) || passes.is_empty() {
            return Ok(None);
        }
        let count = 2 * passes.len() as u32;
        let ticks = self.buffer(
            "times",
            u64::from(count) * size_of::<u64>() as u64,
            wgpu::BufferUsages::QUERY_RESOLVE,
        )?;
        let descriptor =
            wgpu::QuerySetDescriptor { label: Some("times"), ty: wgpu::QueryType::Timestamp, count };
        let set = self.guarded("times", || self.device.create_query_set(&descriptor))?;
        let names = passes.iter().map(|pass| pass.kernel.name).collect();
        Ok(Some((set, Stamps { names, ticks })))
    }

    /// Waits until everything that was asked for is done.
    ///
    /// # Errors
    /// When the device fails.
    pub fn finish(&self) -> Result<(), Error> {
        self.wait()
    }

    /// What `buffer` holds after everything that was asked for.
    ///
    /// # Errors
    /// When the device fails.
    pub fn read<T: Pod>(&self, buffer: &Buffer) -> Result<Vec<T>, Error> {
        self.wait()?;
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
        self.wait()?;
        let watch = Instant::now();
        let bytes = self.mapped(buffer, |bytes| {
            let mut rest = bytes;
            for part in parts {
                let target: &mut [u8] = bytemuck::cast_slice_mut(part);
                let (source, others) = rest.split_at(target.len());
                target.copy_from_slice(source);
                rest = others;
            }
            bytes.len() - rest.len()
        })?;
        lock(&self.usage).read_back(bytes, watch.elapsed());
        Ok(())
    }

    fn fetch<T: Pod>(&self, buffer: &Buffer) -> Result<Vec<T>, Error> {
        self.mapped(buffer, bytemuck::pod_collect_to_vec)
    }

    /// Calls `look` with the bytes of `buffer`.
    fn mapped<T>(&self, buffer: &Buffer, look: impl FnOnce(&[u8]) -> T) -> Result<T, Error> {
        let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ;
        let size = buffer.raw.size();
        let descriptor =
            wgpu::BufferDescriptor { label: Some("readback"), size, usage, mapped_at_creation: false };
        let copy = self.guarded("readback", || {
            let copy = self.device.create_buffer(&descriptor);
            let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            encoder.copy_buffer_to_buffer(&buffer.raw, 0, &copy, 0, size);
            self.queue.submit([encoder.finish()]);
            copy.map_async(wgpu::MapMode::Read, .., |_| ());
            copy
        })?;
        self.wait()?;
        let view = copy.get_mapped_range(..).map_err(|error| self.failure("readback", &error.to_string()))?;
        Ok(look(&view))
    }

    /// Waits until everything that was asked for is done.
    fn wait(&self) -> Result<(), Error> {
        let watch = Instant::now();
        // A device that is lost while it is waited for makes wgpu panic.
        let waited = catch_unwind(AssertUnwindSafe(|| self.device.poll(wgpu::PollType::wait_indefinitely())));
        lock(&self.usage).waited(watch.elapsed());
        match waited {
            Ok(Ok(_)) => self.check("waiting"),
            Ok(Err(error)) => Err(self.failure("waiting", &error.to_string())),
            Err(_) => Err(self.failure("waiting", "the device was lost")),
        }
    }

    /// What `act` returns, if nothing that it did failed.
    fn guarded<T>(&self, what: &str, act: impl FnOnce() -> T) -> Result<T, Error> {
        self.check(what)?;
        let scopes =
            [wgpu::ErrorFilter::OutOfMemory, wgpu::ErrorFilter::Internal, wgpu::ErrorFilter::Validation]
                .map(|filter| self.device.push_error_scope(filter));
        let result = act();
        // Scopes end in the reverse of the order in which they began.
        let errors = scopes.into_iter().rev().map(|scope| pollster::block_on(scope.pop()));
        let errors: Vec<wgpu::Error> = errors.flatten().collect();
        match errors.first() {
            Some(error) => Err(self.failure(what, &error.to_string())),
            None => self.check(what).map(|()| result),
        }
    }

    /// Whether the device has failed behind everybody's back.
    fn check(&self, what: &str) -> Result<(), Error> {
        match &*lock(&self.fault) {
            Some(fault) => Err(self.failure(what, fault)),
            None => Ok(()),
        }
    }

    fn failure(&self, what: &str, text: &str) -> Error {
        let line = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect::<Vec<_>>().join(" ");
        Error::device("the GPU failed")
            .with("in", what)
            .with("found", line)
            .with("device", self.adapter.to_string())
            .help("use --device cpu")
    }
}

/// Passes that are to be carried out one after the other.
pub struct Work<'g> {
    gpu: &'g Gpu,
    passes: Vec<Pass>,
}

/// One of them.
struct Pass {
    kernel: Kernel,
    bindings: wgpu::BindGroup,
    groups: [u32; 3],
}

impl std::fmt::Debug for Work<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.passes.iter().map(|pass| (pass.kernel.name, pass.groups))).finish()
    }
}

impl Work<'_> {
    /// Asks for `groups` workgroups of `kernel`, with `bindings` by their number: those that the entry point uses, no others.
    ///
    /// # Errors
    /// When the bindings are not the kernel's.
    pub fn pass(
        &mut self,
        kernel: &Kernel,
        bindings: &[(u32, &Buffer)],
        groups: [u32; 3],
    ) -> Result<(), Error> {
        let gpu = self.gpu;
        let bindings = gpu.guarded(kernel.name, || {
            let entries: Vec<wgpu::BindGroupEntry<'_>> = bindings
                .iter()
                .map(|&(binding, buffer)| wgpu::BindGroupEntry {
                    binding,
                    resource: buffer.raw.as_entire_binding(),
                })
                .collect();
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

/// Workgroups of `side` × `side` threads that cover `width` × `height` values.
pub fn tiles(width: usize, height: usize, side: usize) -> [u32; 3] {
    [width.div_ceil(side) as u32, height.div_ceil(side) as u32, 1]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::{Layout, ScalarKind};

    super::super::shader::mirrored! {
        /// How to scale.
        struct Scaling {
            /// Values.
            count: u32,
            /// What each is multiplied by.
            factor: f32,
        }
    }

    static SHADER: Shader = Shader {
        name: "scale",
        parts: &["struct Scaling { count: u32, factor: f32 }
            @group(0) @binding(0) var<uniform> scaling: Scaling;
            @group(0) @binding(1) var<storage, read_write> values: array<f32>;
            @compute @workgroup_size(64)
            fn scale(@builtin(global_invocation_id) at: vec3u) {
                if at.x < scaling.count { values[at.x] *= scaling.factor; }
            }"],
        structs: &[Scaling::LAYOUT],
    };

    /// An adapter of any kind, where there is one.
    fn gpu() -> Option<Gpu> {
        Gpu::open(true).unwrap()
    }

    /// `count` values, scaled.
    fn scaled(gpu: &Gpu, count: usize, factor: f32) -> Result<Vec<f32>, Error> {
        let values: Vec<f32> = (0..count).map(|i| i as f32).collect();
        let values = gpu.upload("values", &values)?;
        let scaling = gpu.uniform(&Scaling { count: count as u32, factor })?;
        let kernel = gpu.kernel(&SHADER, "scale")?;
        gpu.submit(|work| {
            work.pass(&kernel, &[(0, &scaling), (1, &values)], [count.div_ceil(64) as u32, 1, 1])
        })?;
        gpu.read(&values)
    }

    #[test]
    fn what_goes_up_comes_down_as_the_kernel_made_it_and_is_accounted_for() {
        let Some(gpu) = gpu() else { return };
        let expected: Vec<f32> = (0..1000).map(|i| 2.5 * i as f32).collect();
        assert_eq!(scaled(&gpu, 1000, 2.5).unwrap(), expected);
        let usage = gpu.usage().unwrap();
        assert_eq!((usage.upload_bytes, usage.readback_bytes, usage.passes), (4000 + 8, 4000, 1));
    }

    #[test]
    fn what_an_adapter_cannot_hold_is_refused_with_its_limit() {
        let Some(gpu) = gpu().map(|gpu| gpu.limited_to(4096)) else { return };
        let error = gpu.zeros::<f32>("colours", 1025).unwrap_err().to_string();
        assert!(error.contains("colours are too large") && error.contains("4096 bytes at most"), "{error}");
    }

    #[test]
    fn bindings_that_are_not_the_kernels_are_an_error_and_the_device_goes_on() {
        let Some(gpu) = gpu() else { return };
        let kernel = gpu.kernel(&SHADER, "scale").unwrap();
        let values = gpu.zeros::<f32>("values", 64).unwrap();
        let error =
            gpu.submit(|work| work.pass(&kernel, &[(1, &values)], [1, 1, 1])).unwrap_err().to_string();
        assert!(error.contains("the GPU failed\n  in: scale"), "{error}");
        assert_eq!(scaled(&gpu, 2, 3.0).unwrap(), [0.0, 3.0]);
    }

    #[test]
    fn a_device_that_is_lost_is_an_error() {
        let Some(gpu) = gpu() else { return };
        let values = gpu.zeros::<f32>("values", 64).unwrap();
        gpu.lose();
        let error = gpu.read::<f32>(&values).unwrap_err().to_string();
        assert!(error.contains("the GPU failed") && error.contains("--device cpu"), "{error}");
        assert!(scaled(&gpu, 2, 3.0).is_err(), "it stays lost");
    }

    #[test]
    fn members_keep_their_names_their_order_and_their_bits() {
        const MEMBERS: [(&str, ScalarKind); 2] = [("count", ScalarKind::Uint), ("factor", ScalarKind::Float)];
        assert_eq!(Scaling::LAYOUT, Layout { name: "Scaling", members: &MEMBERS });
        assert_eq!(Scaling { count: 3, factor: 1.0 }.words(), [3, 0x3f80_0000]);
    }
}
