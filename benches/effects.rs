//! Cost of each effect: CPU seconds of the blur with and without it.
//!
//! `cargo bench --bench effects` uses a synthetic 1080p stack of four peels with a thousand lights, or the file of the
//! environment variable `THINLENS_STACK` with the lens of `THINLENS_PRESET`. 64 views; medians of several runs, alternating in
//! one process.

#![expect(clippy::print_stdout, reason = "the figures are the result")]

mod scene;

use scene::{bench_scene, median};
use std::sync::Arc;
use thinlens::finish::finish;
use thinlens::methods;
use thinlens::methods::Plan;
use thinlens::scene::{EffectKind, Scene};
use thinlens::settings::{Effort, Mask, Settings};
use thinlens::usage::Stopwatch;

const RUNS: usize = 7;

/// Number of lights added to the synthetic scene.
const LIGHTS: usize = 1000;

fn main() {
    let (mut scene, mut settings, read_seconds) = bench_scene();
    if read_seconds.is_none() {
        add_lights(&mut scene);
    }
    settings.effort.value = Some(Effort::Views(64));
    println!("{} × {} pixels, {} layers", scene.width(), scene.height(), scene.layers.len());
    println!("effect                    without     with   (CPU s)");
    for (kind, with) in lenses(&settings) {
        let plan = methods::Registry::default().plan(&scene.analyze(), &with).expect("the lens is one");
        let [without, with] = [plan.clone().forced(kind, false), plan.forced(kind, true)];
        let [without, with] = compared(&scene, [&without, &with]);
        println!(
            "{:24}   {without:6.3}   {with:6.3}   {:+.0} %",
            kind.name(),
            100.0 * (with / without - 1.0)
        );
    }
}

/// `settings` with each effect strong enough to be visible.
fn lenses(settings: &Settings) -> Vec<(EffectKind, Settings)> {
    let with = |change: &dyn Fn(&mut Settings)| {
        let mut settings = settings.clone();
        change(&mut settings);
        settings
    };
    vec![
        (EffectKind::Highlights, with(&|_| {})),
        (EffectKind::Fill, with(&|_| {})),
        (EffectKind::Prefilter, with(&|_| {})),
        (EffectKind::Resolve, with(&|_| {})),
        (
            EffectKind::BladeCurvature,
            with(&|s| (s.lens.blades.value, s.lens.blade_curvature.value) = (7, 0.5)),
        ),
        (EffectKind::Squeeze, with(&|s| s.lens.squeeze.value = 2.0)),
        (EffectKind::ApertureImage, with(&|s| s.mask = Some(Arc::new(ring())))),
        (EffectKind::CatsEye, with(&|s| s.lens.cats_eye.value = 0.8)),
        (EffectKind::SphericalAberration, with(&|s| s.lens.spherical_um.value = -300.0)),
        (EffectKind::AxialColor, with(&|s| s.lens.axial_color_um.value = [100.0, 100.0])),
        (EffectKind::LateralColor, with(&|s| s.lens.lateral_color_um.value = [40.0, -40.0])),
        (EffectKind::Vignetting, with(&|s| s.lens.vignetting.value = 1.0)),
    ]
}

/// The aperture of a mirror lens.
fn ring() -> Mask {
    let side = 256;
    let light = |i: usize| {
        let (x, y) = ((i % side) as f32 - 127.5, (i / side) as f32 - 127.5);
        f32::from(u8::from((50.0..128.0).contains(&x.hypot(y))))
    };
    Mask { name: "ring".to_owned(), width: side, height: side, values: (0..side * side).map(light).collect() }
}

/// Median CPU seconds of rendering `scene` by each of `plans`.
fn compared(scene: &Scene, plans: [&Plan; 2]) -> [f64; 2] {
    let mut seconds = [(); 2].map(|()| Vec::with_capacity(RUNS));
    for _ in 0..RUNS {
        for (plan, seconds) in plans.into_iter().zip(&mut seconds) {
            let (scene, field) = (scene.clone(), scene.field);
            let watch = Stopwatch::start();
            let image = methods::render(scene, plan, &|_| {}).expect("the CPU does not fail");
            finish(image, plan, field);
            seconds.push(watch.cpu_seconds());
        }
    }
    seconds.map(median)
}

/// Makes scattered fragments as bright as lights.
fn add_lights(scene: &mut Scene) {
    let layer = &mut scene.layers[0];
    let (width, count) = (layer.width(), layer.width() * layer.height());
    for i in 0..LIGHTS {
        let index = (i * 7_919 * 263) % count;
        layer.color.iter_mut().for_each(|plane| plane.set(index % width, index / width, 300.0));
    }
}
