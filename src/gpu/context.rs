//! An opened adapter, with every failure as one [`Error`].
//!
//! wgpu reports failures by error scopes, callbacks or panics, immediately or later. Here each of them becomes the `Err` of the
//! call that detects it. After a failure the caller renders on the CPU; no result of the GPU is reused.

use super::adapters::{self, Adapter, AdapterKind};
use super::clock::GpuUsage;
use super::handles::{Kernel, Stamps};
use crate::error::Error;
use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Maximum bytes of a band, beside the adapter's own limits: larger bands are not faster, and smaller ones leave memory for other
/// programs.
const MAX_WORKING_BYTES: u64 = 2 << 30;

/// An opened adapter.
pub struct Gpu {
    adapter: Adapter,
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    max_binding_bytes: u64,
    pub(super) modules: Mutex<HashMap<&'static str, wgpu::ShaderModule>>,
    pub(super) kernels: Mutex<HashMap<String, Kernel>>,
    /// The first failure outside of an error scope.
    fault: Arc<Mutex<Option<String>>>,
    pub(super) usage: Mutex<GpuUsage>,
    pub(super) pending: Mutex<Vec<Stamps>>,
}

/// Locks `mutex`, poisoned or not: every change under these locks is a single operation, so a panic leaves no partial state.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl std::fmt::Debug for Gpu {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Gpu").field("adapter", &self.adapter).finish_non_exhaustive()
    }
}

impl Gpu {
    /// Opens the adapter of the preferred [`AdapterKind`]; software drivers only if `software` is set. `None` if there is no
    /// adapter.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Device`] if the adapter cannot be opened.
    pub fn open(software: bool) -> Result<Option<Self>, Error> {
        let found = adapters::enumerate().into_iter().map(|raw| (Adapter::from_wgpu(&raw), raw));
        let usable = found.filter(|(adapter, _)| software || adapter.kind != AdapterKind::Software);
        let Some((adapter, raw)) = usable.min_by_key(|(adapter, _)| adapter.kind) else { return Ok(None) };
        Self::from_adapter(adapter, &raw).map(Some)
    }

    fn from_adapter(adapter: Adapter, raw: &wgpu::Adapter) -> Result<Self, Error> {
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("thinlens"),
            required_features: raw.features() & wgpu::Features::TIMESTAMP_QUERY,
            required_limits: raw.limits(),
            ..wgpu::DeviceDescriptor::default()
        };
        let opened = pollster::block_on(raw.request_device(&descriptor));
        let (device, queue) = opened.map_err(|error| {
            Error::device("the GPU cannot be opened")
                .with("found", adapter.to_string())
                .help("use `device = cpu`")
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
        let max_binding_bytes =
            device.limits().max_storage_buffer_binding_size.min(device.limits().max_buffer_size);
        Ok(Self {
            adapter,
            device,
            queue,
            max_binding_bytes: max_binding_bytes.min(MAX_WORKING_BYTES),
            modules: Mutex::default(),
            kernels: Mutex::default(),
            fault,
            usage: Mutex::default(),
            pending: Mutex::default(),
        })
    }

    /// The same with buffers of at most `bytes`, as on an adapter with less memory: frames are rendered in smaller bands.
    #[must_use]
    #[doc(hidden)]
    pub fn limited_to(self, bytes: u64) -> Self {
        Self { max_binding_bytes: self.max_binding_bytes.min(bytes), ..self }
    }

    /// The adapter.
    pub fn adapter(&self) -> &Adapter {
        &self.adapter
    }

    /// Maximum size of a buffer in bytes: larger frames are rendered in [`super::bands()`].
    pub(crate) fn max_binding_bytes(&self) -> u64 {
        self.max_binding_bytes
    }

    /// Maximum width and height of a texture.
    #[doc(hidden)]
    pub fn max_texels(&self) -> usize {
        self.device.limits().max_texture_dimension_2d as usize
    }

    /// Maximum bytes of all buffers of a band together.
    pub(crate) fn max_working_bytes(&self) -> u64 {
        MAX_WORKING_BYTES
    }

    /// Destroys the device: all further work on it fails.
    pub fn lose(&self) {
        self.device.destroy();
        lock(&self.fault).get_or_insert_with(|| "the device was destroyed".to_owned());
    }

    /// Waits until all submitted work is done.
    ///
    /// # Errors
    /// When the device fails.
    pub(crate) fn finish(&self) -> Result<(), Error> {
        let watch = Instant::now();
        // wgpu panics if the device is lost during the wait.
        let waited = catch_unwind(AssertUnwindSafe(|| self.device.poll(wgpu::PollType::wait_indefinitely())));
        lock(&self.usage).waited(watch.elapsed());
        match waited {
            Ok(Ok(_)) => self.check("waiting"),
            Ok(Err(error)) => Err(self.failure("waiting", &error.to_string())),
            Err(_) => Err(self.failure("waiting", "the device was lost")),
        }
    }

    /// Runs `act` in error scopes; its result, or the first failure.
    pub(super) fn guarded<T>(&self, what: &str, act: impl FnOnce() -> T) -> Result<T, Error> {
        self.check(what)?;
        let scopes =
            [wgpu::ErrorFilter::OutOfMemory, wgpu::ErrorFilter::Internal, wgpu::ErrorFilter::Validation]
                .map(|filter| self.device.push_error_scope(filter));
        let result = catch_unwind(AssertUnwindSafe(act));
        // Scopes have to be popped in reverse order.
        let errors = scopes.into_iter().rev().map(|scope| pollster::block_on(scope.pop()));
        let errors: Vec<wgpu::Error> = errors.flatten().collect();
        match (errors.first(), result) {
            (Some(error), _) => Err(self.failure(what, &error.to_string())),
            (None, Ok(result)) => self.check(what).map(|()| result),
            (None, Err(_)) => {
                const PANICKED: &str = "the graphics library panicked";
                lock(&self.fault).get_or_insert_with(|| PANICKED.to_owned());
                Err(self.failure(what, PANICKED))
            }
        }
    }

    /// An error if the device has failed outside of an error scope.
    fn check(&self, what: &str) -> Result<(), Error> {
        match &*lock(&self.fault) {
            Some(fault) => Err(self.failure(what, fault)),
            None => Ok(()),
        }
    }

    pub(super) fn failure(&self, what: &str, text: &str) -> Error {
        let line = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect::<Vec<_>>().join(" ");
        Error::device("the GPU failed")
            .with("in", what)
            .with("found", line)
            .with("device", self.adapter.to_string())
            .help("use `device = cpu`")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::{Constant, Layout, Mirrored, ScalarKind, Shader};

    super::super::shader::mirrored! {
        /// Parameters of the test kernel.
        struct Scaling {
            /// Number of values.
            count: u32,
            /// Factor of each value.
            factor: f32,
        }
    }

    static SHADER: Shader = Shader {
        name: "scale",
        constants: &[("BASE", Constant::Float(0.25))],
        parts: &["struct Scaling { count: u32, factor: f32 }
            @group(0) @binding(0) var<uniform> scaling: Scaling;
            @group(0) @binding(1) var<storage, read_write> values: array<f32>;
            @compute @workgroup_size(64)
            fn scale(@builtin(global_invocation_id) at: vec3u) {
                if at.x < scaling.count { values[at.x] = BASE + values[at.x] * scaling.factor; }
            }"],
        structs: &[Scaling::LAYOUT],
    };

    /// An adapter of any kind, if there is one.
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
    fn uploaded_data_is_read_back_as_the_kernel_made_it_and_is_counted() {
        let Some(gpu) = gpu() else { return };
        let expected: Vec<f32> = (0..1000).map(|i| 0.25 + 2.5 * i as f32).collect();
        assert_eq!(scaled(&gpu, 1000, 2.5).unwrap(), expected);
        let usage = gpu.usage().unwrap();
        assert_eq!((usage.upload_bytes, usage.readback_bytes, usage.passes), (4000 + 8, 4000, 1));
    }

    #[test]
    fn a_buffer_larger_than_the_limit_is_refused_with_the_limit() {
        let Some(gpu) = gpu().map(|gpu| gpu.limited_to(4096)) else { return };
        let error = gpu.zeros::<f32>("colours", 1025).unwrap_err().to_string();
        assert!(error.contains("colours are too large") && error.contains("4096 bytes at most"), "{error}");
    }

    #[test]
    fn bindings_that_are_not_the_kernels_are_an_error_and_the_device_still_works() {
        let Some(gpu) = gpu() else { return };
        let kernel = gpu.kernel(&SHADER, "scale").unwrap();
        let values = gpu.zeros::<f32>("values", 64).unwrap();
        let error =
            gpu.submit(|work| work.pass(&kernel, &[(1, &values)], [1, 1, 1])).unwrap_err().to_string();
        assert!(error.contains("the GPU failed\n  in: scale"), "{error}");
        assert_eq!(scaled(&gpu, 2, 3.0).unwrap(), [0.25, 3.25]);
    }

    #[test]
    fn a_device_that_is_lost_is_an_error() {
        let Some(gpu) = gpu() else { return };
        let values = gpu.zeros::<f32>("values", 64).unwrap();
        gpu.lose();
        let error = gpu.read::<f32>(&values).unwrap_err().to_string();
        assert!(error.contains("the GPU failed") && error.contains("`device = cpu`"), "{error}");
        assert!(scaled(&gpu, 2, 3.0).is_err(), "it stays lost");
    }

    #[test]
    fn members_keep_their_names_their_order_and_their_bits() {
        const MEMBERS: [(&str, ScalarKind); 2] = [("count", ScalarKind::Uint), ("factor", ScalarKind::Float)];
        assert_eq!(Scaling::LAYOUT, Layout { name: "Scaling", members: &MEMBERS });
        assert_eq!(Scaling { count: 3, factor: 1.0 }.words(), [3, 0x3f80_0000]);
    }
}
