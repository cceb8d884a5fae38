//! A method on a device: what a law is measured on.

use std::fmt;
use std::sync::OnceLock;
use thinlens::gpu::{DeviceChoice, Gpu};
use thinlens::image::Image;
use thinlens::methods::{self, METHODS, Method, Registry, Role};
use thinlens::scene::{EffectKind, Scene};
use thinlens::settings::{Effort, Origin, ParameterValues, Settings, Values};

/// A method on the CPU or on a GPU.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Engine {
    /// The method.
    pub(crate) method: &'static dyn Method,
    /// The GPU; `None` for the CPU.
    pub(crate) gpu: Option<&'static Gpu>,
}

/// How a scene is blurred: everything else is the program's default.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Setup<'a> {
    /// Lens samples a pixel, for methods that sample the lens.
    pub(crate) views: usize,
    /// Effects that are forced on or off; a pass that the method lacks stays off.
    pub(crate) passes: &'a [(EffectKind, bool)],
}

impl Setup<'_> {
    /// The program's own decisions with `views` lens samples a pixel.
    pub(crate) fn views(views: usize) -> Self {
        Self { views, passes: &[] }
    }
}

impl Engine {
    /// All methods on the CPU.
    pub(crate) fn on_cpu() -> Vec<Self> {
        METHODS.into_iter().map(|method| Self { method, gpu: None }).collect()
    }

    /// All methods that have a GPU backend, on the adapter of this machine; none where there is no adapter.
    ///
    /// # Panics
    /// If `THINLENS_REQUIRE_GPU` is set and there is no adapter.
    pub(crate) fn on_gpu() -> Vec<Self> {
        static GPU: OnceLock<Option<Gpu>> = OnceLock::new();
        let gpu = GPU.get_or_init(|| {
            let gpu = Gpu::open(true).unwrap();
            let required = std::env::var_os("THINLENS_REQUIRE_GPU").is_some();
            assert!(gpu.is_some() || !required, "THINLENS_REQUIRE_GPU is set, and there is no adapter");
            gpu
        });
        let with = |gpu| {
            METHODS
                .into_iter()
                .filter(|method| method.gpu().is_some())
                .map(move |method| Self { method, gpu: Some(gpu) })
        };
        gpu.as_ref().map(with).into_iter().flatten().collect()
    }

    /// Whether pictures are made on a GPU.
    pub(crate) fn is_gpu(&self) -> bool {
        self.gpu.is_some()
    }

    /// The device as a job chooses it.
    pub(crate) fn device(&self) -> DeviceChoice {
        if self.is_gpu() { DeviceChoice::Gpu } else { DeviceChoice::Cpu }
    }

    /// The device's kind.
    pub(crate) fn backend(&self) -> &'static str {
        if self.is_gpu() { "GPU" } else { "CPU" }
    }

    /// All of `cases` for the default and the reference on the CPU; for the others every `stride`-th, to save time.
    pub(crate) fn some_of<T>(&self, cases: Vec<T>, stride: usize) -> Vec<T> {
        let is_main = matches!(self.method.info().role, Role::Default | Role::Reference);
        cases.into_iter().step_by(if is_main && !self.is_gpu() { 1 } else { stride }).collect()
    }

    /// Whether the method has the pass `kind`.
    pub(crate) fn has(&self, kind: EffectKind) -> bool {
        self.method.info().effects.contains(&kind)
    }

    /// The picture of `scene`.
    ///
    /// # Panics
    /// If the picture was not made on the engine's device.
    pub(crate) fn blur(&self, scene: Scene, setup: Setup<'_>) -> Image {
        let values = Values {
            method: Some(self.method.name().to_owned()),
            effort: self.method.samples_lens().then_some(Effort::Views(setup.views)),
            ..Values::default()
        };
        let settings = Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default());
        let (scene, _, plan) = Registry::default().prepare(scene, &settings).unwrap();
        let force = |plan: methods::Plan, &(kind, on): &(EffectKind, bool)| {
            plan.forced(kind, on && (self.has(kind) || !kind.is_pass()))
        };
        let plan = setup.passes.iter().fold(plan, force);
        match self.gpu {
            None => methods::render(scene, &plan, &|_| {}).unwrap(),
            Some(gpu) => {
                let (image, fault) = methods::render_on(gpu, scene, &plan, &|_| {}).unwrap();
                // What the GPU refuses by a limit of its own is rendered by the CPU.
                let words = fault.map(|fault| fault.to_string());
                let refused = words.as_ref().is_none_or(|words| words.contains("`device = cpu`"));
                assert!(refused, "{self}: {words:?}");
                image
            }
        }
    }
}

impl fmt::Display for Engine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} on the {}", self.method.name(), self.backend())
    }
}
