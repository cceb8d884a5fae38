//! Budget of a render: CPU seconds of the scene's analysis and of the blur, their growth with the blur's size, the cost of the
//! search for the number of views that reaches a target, and memory.
//!
//! `cargo bench --bench budget` uses a synthetic 1080p stack of four peels, or the file of the environment variable
//! `THINLENS_STACK` with the lens of `THINLENS_PRESET`. Each figure is the median of several runs in one process, except memory,
//! which is measured in a separate process.

#![expect(clippy::print_stdout, reason = "the figures are the result")]

mod scene;

use scene::{bench_scene, median, scaled};
use std::hint::black_box;
use std::process::Command;
use thinlens::methods::{Plan, Target};
use thinlens::scene::Scene;
use thinlens::settings::{Effort, Origin, ParameterValues, Settings, Values};
use thinlens::usage::{Stopwatch, peak_memory_bytes};
use thinlens::{methods, sample_budget};

const RUNS: usize = 5;
const MEMORY_FLAG: &str = "--measure-memory";
const TARGET_FLAG: &str = "--for-a-target";

fn main() {
    if std::env::args().any(|argument| argument == MEMORY_FLAG) {
        return measure_memory();
    }
    let (scene, _, read_seconds) = bench_scene();
    println!("{} × {} pixels, {} layers", scene.width(), scene.height(), scene.layers.len());
    println!("analyze  {:6.4} CPU s", analyze(&scene));
    println!("views    CPU s   wall s");
    for views in [16, 64, 256] {
        let (cpu, wall) = blur(&scene, views);
        println!("{views:5}   {cpu:6.3}   {wall:6.3}");
        if let (64, Some(read)) = (views, read_seconds) {
            println!("         blur / read: {:.2} (wall)", wall / read);
        }
    }
    println!("CoC px   CPU s at 64 views");
    let smallest = blur(&scaled(&scene, 16.0), 64).0;
    println!("   16   {smallest:6.3}");
    for coc in [32.0, 64.0, 128.0] {
        let cpu = blur(&scaled(&scene, coc), 64).0;
        println!("{coc:5}   {cpu:6.3}   {:.2} times that of 16 px", cpu / smallest);
    }
    println!("target   CPU s   found in");
    for target_db in [35.0, 40.0, 45.0] {
        print_search(&scene, target_db);
    }
    drop(scene);
    memory();
}

/// Prints the cost of the search for the views that reach `target_db` and of the blur with them.
fn print_search(scene: &Scene, target_db: f64) {
    let plan = plan(scene, Effort::TargetDb(target_db));
    let Some(Target::Error { psnr_db, max_views }) = plan.target else { return println!("nothing to blur") };
    let outcome = sample_budget::find_views(scene.clone(), &plan, (psnr_db, max_views))
        .expect("shear samples the lens");
    let search = timed(scene, |scene| {
        sample_budget::render_to_target(scene, &plan, (psnr_db, max_views), &|_| {})
            .expect("the CPU does not fail");
    });
    let blur_alone = blur(scene, outcome.views).0;
    let tried: Vec<String> = outcome.tried.iter().map(|trial| trial.views.to_string()).collect();
    println!(
        "{target_db:3} dB   {:6.3}   {} views: {:.2} times the blur with {}",
        search.0,
        tried.join(", "),
        search.0 / blur_alone,
        outcome.views
    );
}

/// Median CPU and wall seconds of blurring `scene`.
fn blur(scene: &Scene, views: usize) -> (f64, f64) {
    let plan = plan(scene, Effort::Views(views));
    timed(scene, |scene| {
        methods::render(scene, &plan, &|_| {}).expect("the CPU does not fail");
    })
}

/// Median CPU and wall seconds of `work` on a copy of `scene`.
fn timed(scene: &Scene, work: impl Fn(Scene)) -> (f64, f64) {
    let runs: Vec<(f64, f64)> = (0..RUNS)
        .map(|_| {
            let scene = scene.clone();
            let watch = Stopwatch::start();
            work(scene);
            (watch.cpu_seconds(), watch.seconds())
        })
        .collect();
    (median(runs.iter().map(|run| run.0).collect()), median(runs.iter().map(|run| run.1).collect()))
}

/// Median CPU seconds of analyzing `scene`.
fn analyze(scene: &Scene) -> f64 {
    let run = |_| {
        let watch = Stopwatch::start();
        black_box(scene.analyze());
        watch.cpu_seconds()
    };
    median((0..RUNS).map(run).collect())
}

fn plan(scene: &Scene, effort: Effort) -> Plan {
    let values = Values { effort: Some(effort), ..Values::default() };
    let settings = Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default());
    methods::Registry::default().plan(&scene.analyze(), &settings).expect("defaults make a plan")
}

/// Measures memory in new processes of this program, so that earlier measurements do not count.
fn memory() {
    let program = std::env::current_exe().expect("this program's path");
    for (what, flags) in [("64 views", &[MEMORY_FLAG] as &[&str]), ("45 dB", &[MEMORY_FLAG, TARGET_FLAG])] {
        println!("for {what}:");
        let status = Command::new(&program).args(flags).status().expect("this program runs");
        assert!(status.success(), "the memory run failed: {status}");
    }
}

/// Blurs once, with a fixed number of views or for a target, and compares the process's peak memory with the decoded stack.
fn measure_memory() {
    let (scene, ..) = bench_scene();
    let stack_bytes = scene.layers.len() * 5 * size_of::<f32>() * scene.width() * scene.height();
    if std::env::args().any(|argument| argument == TARGET_FLAG) {
        let plan = plan(&scene, Effort::TargetDb(45.0));
        sample_budget::render_to_target(scene, &plan, (45.0, 256), &|_| {}).expect("the CPU does not fail");
    } else {
        let plan = plan(&scene, Effort::Views(64));
        methods::render(scene, &plan, &|_| {}).expect("the CPU does not fail");
    }
    let Some(peak) = peak_memory_bytes() else { return println!("peak memory: not known on this system") };
    let ratio = peak as f64 / stack_bytes as f64;
    println!(
        "peak memory {} MiB, {ratio:.2} times the decoded stack of {} MiB",
        peak >> 20,
        stack_bytes >> 20
    );
}
