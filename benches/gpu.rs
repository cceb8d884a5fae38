//! The default method on the GPU and on the CPU at 1080p and 4K, four peels and 64 views: times of upload, passes and readback.
//! `cargo bench --bench gpu`; `THINLENS_STACK` and `THINLENS_PRESET` name another stack and lens.
//!
//! Every ray fetches at least one colour, 16 bytes, at most at the bandwidth of the GPU's caches. The printed minimum traffic
//! shows how far the paint pass is from that limit.

#![expect(clippy::print_stdout, reason = "the figures are the result")]

mod scene;

#[cfg(not(feature = "gpu"))]
fn main() {
    println!("built without GPU support: there is nothing to measure");
}

#[cfg(feature = "gpu")]
fn main() {
    measure::run();
}

#[cfg(feature = "gpu")]
mod measure {
    use super::scene::{bench_scene, median, synthetic};
    use std::time::Instant;
    use thinlens::gpu::{Gpu, GpuUsage};
    use thinlens::methods::{Plan, Registry, render, render_on};
    use thinlens::scene::Scene;
    use thinlens::settings::{Effort, Settings};
    use thinlens::usage::Stopwatch;

    /// Views of the frames.
    const VIEWS: usize = 64;

    /// Measured runs, of which the median counts; one run before them warms caches and compiles.
    const RUNS: usize = 5;

    /// Minimum bytes that a ray fetches: one colour.
    const MIN_BYTES_PER_RAY: f64 = 16.0;

    pub(super) fn run() {
        let Some(gpu) = Gpu::open(true).unwrap_or_else(|error| panic!("{error}")) else {
            println!("there is no graphics adapter");
            return;
        };
        println!("{}, driver {}", gpu.adapter(), gpu.adapter().driver);
        let (own, settings, _) = bench_scene();
        if std::env::var_os("THINLENS_STACK").is_some() {
            compare("own stack", &gpu, own, &settings);
            return;
        }
        for (name, width, height) in [("1080p", 1920, 1080), ("4K", 3840, 2160)] {
            compare(name, &gpu, synthetic(width, height), &settings);
        }
    }

    fn compare(name: &str, gpu: &Gpu, scene: Scene, settings: &Settings) {
        let mut settings = settings.clone();
        settings.effort.value = Some(Effort::Views(VIEWS));
        let plan =
            Registry::default().plan(&scene.analyze(), &settings).unwrap_or_else(|error| panic!("{error}"));
        let runs: Vec<Run> = (0..=RUNS).map(|_| on_gpu(gpu, &scene, &plan)).skip(1).collect();
        let middle = |part: fn(&Run) -> f64| 1e3 * median(runs.iter().map(part).collect());
        let (width, height) = scene.picture_size();
        println!("{name}: {width} × {height}, {} layers, {VIEWS} views", scene.layers.len());
        println!(
            "  wall {:.1} ms: upload {:.1}, passes {:.1}, readback {:.1}",
            middle(|run| run.wall),
            middle(|run| run.usage.upload_seconds),
            middle(|run| run.usage.pass_seconds_total().unwrap_or(0.0)),
            middle(|run| run.usage.readback_seconds),
        );
        let passes = runs[0].usage.pass_seconds.keys();
        let each = passes.map(|pass| {
            let seconds = runs.iter().map(|run| run.usage.pass_seconds[pass]).collect();
            format!("{pass} {:.2}", 1e3 * median(seconds))
        });
        println!("  passes in ms: {}", each.collect::<Vec<_>>().join(", "));
        let paint = middle(|run| run.usage.pass_seconds.get("paint").copied().unwrap_or(0.0)) * 1e-3;
        let rays = (width * height) as f64 * VIEWS as f64;
        println!(
            "  paint: {:.2} billion rays a second, {:.0} GB/s at least",
            1e-9 * rays / paint,
            1e-9 * MIN_BYTES_PER_RAY * rays / paint
        );
        println!("  CPU seconds of this process: {:.2}", 1e-3 * middle(|run| run.cpu));
        let (wall, cpu) = on_cpu(scene, &plan);
        println!("  on the CPU: wall {:.1} ms, {cpu:.2} CPU seconds", 1e3 * wall);
    }

    /// One frame on the GPU.
    struct Run {
        wall: f64,
        cpu: f64,
        usage: GpuUsage,
    }

    fn on_gpu(gpu: &Gpu, scene: &Scene, plan: &Plan) -> Run {
        let (scene, before) = (scene.clone(), gpu.usage().unwrap_or_default());
        let (clock, watch) = (Instant::now(), Stopwatch::start());
        let (_, fault) = render_on(gpu, scene, plan, &|_| {}).unwrap_or_else(|error| panic!("{error}"));
        if let Some(fault) = fault {
            panic!("{fault}");
        }
        let (wall, cpu) = (clock.elapsed().as_secs_f64(), watch.cpu_seconds());
        let usage = gpu.usage().unwrap_or_default().since(&before);
        Run { wall, cpu, usage }
    }

    fn on_cpu(scene: Scene, plan: &Plan) -> (f64, f64) {
        let (clock, watch) = (Instant::now(), Stopwatch::start());
        render(scene, plan, &|_| {}).unwrap_or_else(|error| panic!("{error}"));
        (clock.elapsed().as_secs_f64(), watch.cpu_seconds())
    }
}
