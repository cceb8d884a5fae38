//! Time of each method on one scene, with default parameters.
//!
//! `cargo bench --bench methods` uses a synthetic 960 × 540 stack of four peels with CoC radii up to 16 pixels. Wall seconds of
//! the blur only, on all cores: a comparison of methods on this machine, within the noise of three samples.

mod scene;

use divan::Bencher;
use thinlens::methods::{self, METHODS};
use thinlens::scene::Scene;
use thinlens::settings::{Effort, Origin, ParameterValues, Settings, Values};

/// Lens samples of the reference: its default of 1024 would take longer than all other methods together.
const REFERENCE_VIEWS: usize = 32;

fn main() {
    divan::main();
}

/// The scene of every benchmark.
fn scene() -> Scene {
    scene::scaled(&scene::synthetic(960, 540), 16.0)
}

#[divan::bench(args = METHODS.map(|method| method.info().name), sample_count = 3, sample_size = 1)]
fn blur(bencher: Bencher<'_, '_>, method: &str) {
    let scene = scene();
    let is_reference = methods::Registry::default()
        .by_name(method)
        .is_ok_and(|method| method.info().role == methods::Role::Reference);
    let values = Values {
        method: Some(method.to_owned()),
        effort: is_reference.then_some(Effort::Views(REFERENCE_VIEWS)),
        ..Values::default()
    };
    let settings = Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default());
    let plan = methods::Registry::default().plan(&scene.analyze(), &settings).expect("defaults make a plan");
    bencher
        .with_inputs(|| scene.clone())
        .bench_values(|scene| methods::render(scene, &plan, &|_| {}).expect("the CPU does not fail"));
}
