//! The scene of benchmarks: synthetic, or from a file.

#![allow(dead_code, reason = "each benchmark uses a part of this module")]

use std::path::PathBuf;
use thinlens::image::Plane;
use thinlens::render::{Job, NamedPreset, prepare};
use thinlens::scene::{Layer, Scene};
use thinlens::settings::{ParameterValues, Preset, Settings};
use thinlens::stack::{Source, StackKind};

/// The scene to measure with, its settings, and the wall seconds of reading it if it is from a file.
pub(crate) fn bench_scene() -> (Scene, Settings, Option<f64>) {
    let Ok(stack) = std::env::var("THINLENS_STACK") else {
        return (synthetic(1920, 1080), Settings::resolve(&[], ParameterValues::default()), None);
    };
    let preset = std::env::var("THINLENS_PRESET").ok().map(|path| NamedPreset {
        preset: Preset::parse(&std::fs::read_to_string(&path).expect("the preset's file"), &path)
            .unwrap_or_else(|error| panic!("{error}")),
        name: path,
    });
    let job = Job { sources: vec![Source::File(PathBuf::from(stack))], preset, ..Job::default() };
    let prepared = prepare(&job).unwrap_or_else(|error| panic!("{error}"));
    let read_seconds = prepared.clock.seconds().read;
    (prepared.scene, prepared.settings, Some(read_seconds))
}

/// Median of `values`.
pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Four layers: rows of vertical bars in front of and behind focus over a slanted floor and a far wall.
pub(crate) fn synthetic(width: usize, height: usize) -> Scene {
    let hash = |x: usize, y: usize, seed: usize| {
        let bits = (x * 73_856_093) ^ (y * 19_349_663) ^ (seed * 83_492_791);
        ((bits ^ (bits >> 13)).wrapping_mul(0x5bd1_e995) % 1024) as f32 / 1024.0
    };
    let floor = |y: usize| 14.0 - 50.0 * y as f32 / height as f32;
    // Surfaces from near to far, each present where its pattern is; a pixel's layers are the first four.
    let surface = |x: usize, y: usize, k: usize| match k {
        0..=5 => {
            let bar = (x + 97 * k) % (160 + 30 * k) < 40 + 8 * k && y > height / 5;
            bar.then_some(-37.0 + 8.5 * k as f32)
        }
        6 => (y > height / 2).then(|| floor(y)),
        _ => Some(15.0),
    };
    let fragment = |x: usize, y: usize, layer: usize| {
        (0..8).filter_map(|k| surface(x, y, k).map(|coc| (coc, k))).nth(layer)
    };
    let layers = (0..4)
        .map(|layer| Layer {
            color: std::array::from_fn(|channel| {
                Plane::from_fn(width, height, |x, y| {
                    fragment(x, y, layer).map_or(0.0, |(_, k)| 0.9 * hash(x / 4, y / 4, 3 * k + channel))
                })
            }),
            alpha: Plane::from_fn(width, height, |x, y| f32::from(u8::from(fragment(x, y, layer).is_some()))),
            coc_px: Plane::from_fn(width, height, |x, y| fragment(x, y, layer).map_or(0.0, |(coc, _)| coc)),
        })
        .collect();
    Scene::new(layers, StackKind::PointSampled, 1, 64.0)
}

/// `scene` with its CoC radii scaled so that the largest is `coc` pixels.
pub(crate) fn scaled(scene: &Scene, coc: f32) -> Scene {
    let [near, far] = scene.analyze().coc_range_px;
    let factor = coc / near.abs().max(far.abs());
    let mut scene = scene.clone();
    for layer in &mut scene.layers {
        layer.coc_px.values_mut().iter_mut().for_each(|value| *value *= factor);
    }
    scene
}
