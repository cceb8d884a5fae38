//! The aperture against that of Cycles: two small lights, one before focus and one behind, through its own lens.
//!
//! `tests/cycles/render.py` made the pictures. A name such as `blades3_rotation20` says what Cycles was told; thinlens is told the
//! same numbers, Cycles' `aperture_ratio` as the squeeze.

#![expect(clippy::unwrap_used, reason = "a fixture that cannot be read has failed")]

use std::path::{Path, PathBuf};
use thinlens::image::Image;
use thinlens::lens::Aperture;
use thinlens::render::{Job, render};
use thinlens::settings::{Effort, Focus, Switches, Values};
use thinlens::stack::{Source, read_picture};

const WIDTH: usize = 128;
const HEIGHT: usize = 64;
/// Radius of either light's blur without blades or squeeze: ½ · 100 mm / 0.75 · 100 mm / 1 m · 128 px / 36 mm · (1 − 1 / 2).
const COC_RADIUS_PX: f64 = 11.852;

#[derive(Debug, Clone, Copy, PartialEq)]
struct Shape {
    blades: u32,
    rotation_deg: f32,
    squeeze: f32,
}

/// The files and what Cycles was told.
const CASES: [(&str, Shape); 6] = [
    ("blades3", Shape { blades: 3, rotation_deg: 0.0, squeeze: 1.0 }),
    ("blades3_rotation20", Shape { blades: 3, rotation_deg: 20.0, squeeze: 1.0 }),
    ("blades5_rotation20", Shape { blades: 5, rotation_deg: 20.0, squeeze: 1.0 }),
    ("blades6_rotation20", Shape { blades: 6, rotation_deg: 20.0, squeeze: 1.0 }),
    ("ratio2", Shape { blades: 0, rotation_deg: 0.0, squeeze: 2.0 }),
    ("blades3_rotation20_ratio2", Shape { blades: 3, rotation_deg: 20.0, squeeze: 2.0 }),
];

#[derive(Debug, Clone, Copy)]
enum Side {
    BeforeFocus,
    BehindFocus,
}

const SIDES: [Side; 2] = [Side::BeforeFocus, Side::BehindFocus];

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cycles").join(format!("{name}.exr"))
}

fn cycles(name: &str) -> Image {
    read_picture(&fixture(name)).unwrap()
}

/// The stack through Cycles' camera with `shape` for its aperture. The method `dots` is `shear` without exact discs.
fn thinlens(shape: Shape, method: &str) -> Image {
    let without = if method == "dots" { vec!["highlights".to_owned()] } else { Vec::new() };
    let job = Job {
        sources: vec![Source::File(fixture("stack"))],
        flags: Values {
            focal_length_mm: Some(100.0),
            f_number: Some(0.75),
            focus: Some(Focus::Distance(1.0)),
            blades: Some(shape.blades),
            rotation_deg: Some(shape.rotation_deg),
            squeeze: Some(shape.squeeze),
            method: Some(method.replace("dots", "shear")),
            effort: Some(Effort::Views(512)),
            ..Values::default()
        },
        switches: Switches { without, ..Switches::default() },
        ..Job::default()
    };
    render(&job, &|_| {}).unwrap().image
}

/// The green of one light's half of the picture: the light before focus is on the left.
fn half(image: &Image, side: Side) -> Vec<f64> {
    let left = match side {
        Side::BeforeFocus => 0,
        Side::BehindFocus => WIDTH / 2,
    };
    let green = |i: usize| f64::from(image.pixel(left + i % (WIDTH / 2), i / (WIDTH / 2))[1]);
    (0..WIDTH / 2 * HEIGHT).map(green).collect()
}

/// Pearson's correlation.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let (mean_a, mean_b) = (mean(a), mean(b));
    let covariance = |x: &[f64], mean_x: f64, y: &[f64], mean_y: f64| -> f64 {
        x.iter().zip(y).map(|(x, y)| (x - mean_x) * (y - mean_y)).sum()
    };
    covariance(a, mean_a, b, mean_b)
        / (covariance(a, mean_a, a, mean_a) * covariance(b, mean_b, b, mean_b)).sqrt()
}

/// Radii across and down of the ellipse with the second moments of a light's half of the picture, less those of the light and the pixel.
fn radii(light: &[f64]) -> [f64; 2] {
    let total: f64 = light.iter().sum();
    let place = |i: usize| [i % (WIDTH / 2), i / (WIDTH / 2)].map(|place| place as f64 + 0.5);
    [0, 1].map(|axis| {
        let moment = |about: f64, power: i32| -> f64 {
            let terms =
                light.iter().enumerate().map(|(i, light)| light * (place(i)[axis] - about).powi(power));
            terms.sum::<f64>() / total
        };
        // The light is 3 px wide, the pixel 1; an ellipse's variance is a quarter of its squared radius.
        let variance = moment(moment(0.0, 1), 2) - (3.0 * 3.0 + 1.0) / 12.0;
        2.0 * variance.sqrt()
    })
}

/// How well what `shape` looks like by `method` correlates with Cycles' picture, before and behind focus.
fn likeness(shape: Shape, method: &str, cycles: &Image) -> [f64; 2] {
    let ours = thinlens(shape, method);
    SIDES.map(|side| correlation(&half(&ours, side), &half(cycles, side)))
}

/// `shape` upside down, mirrored, turned by 180° and by −20°, where that is not nearly the same shape again, as it always is for a disc.
fn wrongly_turned(shape: Shape) -> Vec<Shape> {
    let period = 360.0 / shape.blades as f32;
    let rotation = shape.rotation_deg;
    let differs = |turned: &f32| {
        let turn = (turned - rotation).rem_euclid(period);
        shape.blades > 0 && turn.min(period - turn) > 10.0
    };
    let turned = [-rotation, 180.0 - rotation, rotation + 180.0, rotation - 20.0];
    turned.into_iter().filter(differs).map(|rotation_deg| Shape { rotation_deg, ..shape }).collect()
}

/// Holds `method` to a correlation of `least` with Cycles, and to less by a hundredth where the aperture is turned wrongly.
fn assert_turned_as_in_cycles(method: &str, least: f64) {
    for (name, shape) in CASES {
        let cycles = cycles(name);
        let right = likeness(shape, method, &cycles);
        assert!(right.iter().all(|&found| found > least), "{name}: {right:.4?}");
        let wrong = wrongly_turned(shape);
        assert_eq!(wrong.is_empty(), shape.blades == 0, "{name} can be turned wrongly");
        for wrong in wrong {
            let found = likeness(wrong, method, &cycles);
            let told_apart = (0..2).all(|side| found[side] < right[side] - 0.01);
            assert!(told_apart, "{name}: {found:.4?} for {wrong:?}, {right:.4?} for what is right");
        }
    }
}

#[test]
fn an_aperture_is_turned_as_in_cycles_before_and_behind_focus() {
    // What is missing to 1 is the noise of Cycles' samples.
    assert_turned_as_in_cycles("shear", 0.9995);
}

#[test]
fn an_aperture_is_turned_as_in_cycles_where_no_disc_is_exact() {
    // And that of 512 lens samples, each a dot of 9 pixels.
    assert_turned_as_in_cycles("dots", 0.985);
    assert_turned_as_in_cycles("accumulate", 0.985);
}

#[test]
fn cycles_aperture_ratio_is_the_squeeze_and_its_f_stop_the_f_number() {
    // About 147 000 of Cycles' samples hit a light: the standard deviation of a radius is at most 0.13 %, that of the light 0.26 %.
    for (name, shape) in CASES {
        let aperture =
            Aperture::new(shape.blades, shape.rotation_deg).unwrap().squeezed(shape.squeeze).unwrap();
        let expected =
            aperture.second_moments().to_array().map(|moment| 2.0 * COC_RADIUS_PX * f64::from(moment).sqrt());
        for side in SIDES {
            let light = half(&cycles(name), side);
            for (found, expected) in radii(&light).into_iter().zip(expected) {
                assert!(
                    (found / expected - 1.0).abs() < 0.004,
                    "{name}, {side:?}: {found:.3} px, not {expected:.3}"
                );
            }
            let radiance: f64 = light.iter().sum::<f64>() / 9.0;
            assert!((radiance / 64.0 - 1.0).abs() < 0.008, "{name}, {side:?}: radiance {radiance:.2}");
        }
    }
}
