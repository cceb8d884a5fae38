//! A lens that changes evenly changes the picture evenly.

use super::engine::{Engine, Setup};
use super::scenes::{EMPTY, Fragment, Pixel, layer, noise, rms};
use super::{Figure, Measured, Promise, figure};
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};
use thinlens::image::Image;
use thinlens::methods::Law;
use thinlens::scene::Scene;
use thinlens::stack::StackKind;

/// Frames of a sweep.
const FRAMES: usize = 45;

const WIDTH: usize = 48;
const HEIGHT: usize = 32;

pub(crate) const EVEN_SWEEP: Measured =
    Measured { law: Law::EvenSweep, bound: 2.0, promised_by: Promise::LensSampling, figures: even };

pub(crate) const FROZEN_FRAMES: Measured =
    Measured { law: Law::FrozenFrames, bound: 2.0, promised_by: Promise::LensSampling, figures: frozen };

/// Changes from each frame of a sweep to the next.
#[derive(Debug, Clone, Copy)]
pub(super) struct Steps {
    /// The largest over the mean.
    pub(super) largest_over_mean: f64,
    /// How many are below a hundredth of the mean.
    pub(super) frozen: usize,
}

impl Steps {
    /// The steps between `frames`; a sweep of which no frame differs is frozen, and as uneven as can be.
    pub(super) fn between(frames: &[Image]) -> Self {
        let steps: Vec<f64> = frames.windows(2).map(|pair| rms(&pair[0], &pair[1])).collect();
        let mean = steps.iter().sum::<f64>() / steps.len() as f64;
        let largest = steps.iter().copied().fold(0.0, f64::max);
        let frozen = steps.iter().filter(|&&step| step <= 0.01 * mean).count();
        let largest_over_mean = if mean > 0.0 { largest / mean } else { f64::INFINITY };
        Self { largest_over_mean, frozen }
    }
}

fn even(engine: &Engine) -> Vec<Figure> {
    measured(engine).into_iter().map(|(case, steps)| figure(case, steps.largest_over_mean)).collect()
}

fn frozen(engine: &Engine) -> Vec<Figure> {
    measured(engine).into_iter().map(|(case, steps)| figure(case, steps.frozen as f64)).collect()
}

/// The steps of every sweep: measured once for an engine, since two laws ask.
fn measured(engine: &Engine) -> Vec<(String, Steps)> {
    static MEASURED: Mutex<BTreeMap<String, Vec<(String, Steps)>>> = Mutex::new(BTreeMap::new());
    let mut measured = MEASURED.lock().unwrap_or_else(PoisonError::into_inner);
    measured.entry(engine.to_string()).or_insert_with(|| measure(engine)).clone()
}

/// The sweeps are those in which exact pictures change evenly. In even steps of the CoC radius the largest step of the sines is 1.37 times
/// the mean, by the closed form; in even ratios, in which that of noise is 1.4 times and that of the scene 1.7 times the mean with 4096 rays
/// a pixel, it would be 1.81 times.
fn measure(engine: &Engine) -> Vec<(String, Steps)> {
    type Case = (&'static str, fn(f32) -> Lens, fn(Lens) -> Scene);
    let sweeps: [Case; 5] = [
        ("opening of sines, even steps", even_steps, sines),
        ("opening of noise, even ratios", even_ratios, white_noise),
        ("opening of a scene with depth, even ratios", even_ratios, world),
        ("focus of sines", focus, sines),
        ("focus of a scene with depth", focus, world),
    ];
    let cases = sweeps.into_iter().flat_map(|sweep| [64, 96].map(|views| (sweep, views))).collect();
    let steps = engine.some_of(cases, 4).into_iter().map(|((name, lens, scene), views)| {
        let share = |i: usize| i as f32 / (FRAMES - 1) as f32;
        let frames: Vec<Image> =
            (0..FRAMES).map(|i| engine.blur(scene(lens(share(i))), Setup::views(views))).collect();
        (format!("{name}, {views} views"), Steps::between(&frames))
    });
    steps.collect()
}

/// A lens: the CoC radius at infinity, and how much smaller that of a fragment at the inverse distance 1 is, in picture pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lens {
    pub(super) infinity_px: f32,
    pub(super) scale_px: f32,
}

impl Lens {
    /// Focused at the inverse distance `inverse`, with `scale_px` as the CoC radius at infinity when that is 1.
    pub(super) fn focused(scale_px: f32, inverse: f32) -> Self {
        Self { infinity_px: scale_px * inverse, scale_px }
    }

    /// CoC radius at `inverse` of the distance, in units of the scene.
    pub(super) fn coc_px(self, inverse: f32) -> f32 {
        self.infinity_px - self.scale_px * inverse
    }
}

/// Focused at 1, opened from 0.3 to 3 px in even steps.
fn even_steps(share: f32) -> Lens {
    Lens::focused(0.3 + 2.7 * share, 1.0)
}

/// The same in even ratios.
fn even_ratios(share: f32) -> Lens {
    Lens::focused(0.3 * 10f32.powf(share), 1.0)
}

/// Focused from the inverse distance 0.1 to 1.6.
fn focus(share: f32) -> Lens {
    Lens::focused(3.0, 0.1 + 1.5 * share)
}

/// A plane at infinity with the colours `color`.
fn plane(lens: Lens, color: impl Fn(usize, usize) -> Pixel) -> Scene {
    let coc_px = lens.coc_px(0.0);
    let plane = layer(WIDTH, HEIGHT, |x, y| (color(x, y), coc_px));
    Scene::new(vec![plane], StackKind::PointSampled, 1, lens.infinity_px)
}

fn sines(lens: Lens) -> Scene {
    let wave = |at: usize, period: f32| (std::f32::consts::TAU * at as f32 / period).sin();
    plane(lens, |x, y| {
        let light = 0.5 + 0.25 * wave(x, 5.3) + 0.2 * wave(y, 7.1);
        [light, 0.8 * light, 0.5 + 0.4 * wave(x + y, 4.7), 1.0]
    })
}

fn white_noise(lens: Lens) -> Scene {
    plane(lens, |x, y| [noise(x, y, 1), noise(x, y, 2), noise(x, y, 3), 1.0])
}

/// Near bars, a slanted floor, a wall, and four lights.
fn world(lens: Lens) -> Scene {
    const LIGHTS: [(usize, usize); 4] = [(6, 5), (20, 4), (33, 24), (44, 9)];
    let fragments = |x: usize, y: usize| -> [Fragment; 3] {
        let light = if LIGHTS.contains(&(x, y)) { 8.0 } else { 1.0 };
        let texture = |seed: usize| -> Pixel {
            let fine = 0.2 + 0.6 * noise(x / 2, y / 3, seed);
            [light * fine, light * noise(x / 3, y / 4, seed + 1), 0.5 * light * fine, 1.0]
        };
        let floor = (texture(2), lens.coc_px(0.4 + 1.2 * y as f32 / HEIGHT as f32));
        let wall = (texture(3), lens.coc_px(0.1));
        if (x * 7 / WIDTH) % 3 == 1 {
            [(texture(1), lens.coc_px(2.0)), floor, wall]
        } else {
            [floor, wall, EMPTY]
        }
    };
    let peel = |at: usize| layer(WIDTH, HEIGHT, |x, y| fragments(x, y)[at]);
    Scene::new((0..3).map(peel).collect(), StackKind::PointSampled, 1, lens.infinity_px)
}
