//! thinlens as a library, without a file: planes in, planes out.
//!
//! `cargo run --release --example library [-- PICTURE.png]`
//!
//! A stack of two peels is made in memory: a blue disc in front of a wall with waves of light, and the part of the wall behind the
//! disc. The lens is focused on the surface at a pixel, and the number of lens samples is the one that reaches 45 dB. Prints findings,
//! the plan and the sampling error.

#![expect(clippy::print_stdout, reason = "the figures are the result")]

use std::path::Path;
use thinlens::error::Error;
use thinlens::image::Plane;
use thinlens::output::png;
use thinlens::render::{Job, Rendered, render_stack};
use thinlens::settings::{Effort, Focus, Values};
use thinlens::stack::{Frame, Peel, ReadOptions, Stack};

/// Width and height of the picture in pixels.
const SIZE: [usize; 2] = [320, 180];

/// Radius of the disc in pixels; it is centred in the picture.
const DISC_RADIUS_PX: f32 = 50.0;

/// Distance of the disc in metres.
const DISC_M: f32 = 2.0;

/// Distance of the wall in metres.
const WALL_M: f32 = 6.0;

fn main() -> Result<(), Error> {
    let [width, height] = SIZE;
    let stack = Stack::from_peels(peels(), Frame::from_size(width, height), &ReadOptions::default())?;
    let lens = Values {
        focal_length_mm: Some(85.0),
        f_number: Some(1.4),
        // A pixel of the wall, left of the disc.
        focus: Some(Focus::Point([20.0, 90.0])),
        effort: Some(Effort::TargetDb(45.0)),
        ..Values::default()
    };
    let rendered = render_stack(stack, &Job::default().with_values(lens), &|_share| {})?;
    describe(&rendered);
    match std::env::args().nth(1) {
        Some(path) => png::write(Path::new(&path), &rendered.image, 0.0),
        None => Ok(()),
    }
}

/// The peels, nearest first: the disc and the wall around it, then the wall behind the disc.
fn peels() -> Vec<Peel> {
    let [width, height] = SIZE;
    let in_disc = |x: usize, y: usize| {
        let [x, y] = [x as f32 + 0.5 - 0.5 * width as f32, y as f32 + 0.5 - 0.5 * height as f32];
        x.hypot(y) < DISC_RADIUS_PX
    };
    let wall = |x: usize, y: usize| {
        let wave = |at: usize| 0.5 + 0.5 * (0.2 * at as f32).sin();
        let light = 0.1 + 0.7 * wave(x) * wave(y);
        [light, 0.9 * light, 0.6 * light]
    };
    let front = |x, y| if in_disc(x, y) { [0.05, 0.2, 0.7] } else { wall(x, y) };
    let front_depth = |x, y| if in_disc(x, y) { DISC_M } else { WALL_M };
    vec![
        peel(front, |_, _| 1.0, front_depth),
        // Colour is premultiplied; depth is used only where alpha is not 0.
        peel(
            |x, y| if in_disc(x, y) { wall(x, y) } else { [0.0; 3] },
            |x, y| f32::from(in_disc(x, y)),
            |x, y| if in_disc(x, y) { WALL_M } else { f32::INFINITY },
        ),
    ]
}

/// A peel from functions of column and row.
fn peel(
    color: impl Fn(usize, usize) -> [f32; 3],
    alpha: impl Fn(usize, usize) -> f32,
    depth: impl Fn(usize, usize) -> f32,
) -> Peel {
    let [width, height] = SIZE;
    Peel {
        color: std::array::from_fn(|channel| Plane::from_fn(width, height, |x, y| color(x, y)[channel])),
        alpha: Plane::from_fn(width, height, alpha),
        depth: Plane::from_fn(width, height, depth),
    }
}

/// Prints the findings about the stack, the plan, the sampling error and two pixels of the result.
fn describe(rendered: &Rendered) {
    for finding in &rendered.stack.findings {
        println!("{}: {}", finding.about, finding.text);
    }
    println!("focus distance: {} m", rendered.lens.focus_distance);
    println!("method: {}, {:?} lens samples per pixel", rendered.plan.method, rendered.plan.views);
    if let Some(psnr_db) = rendered.sampling_error().and_then(|estimate| estimate.psnr_db) {
        println!("sampling error: {psnr_db:.1} dB");
    }
    let [width, height] = SIZE;
    for (name, x) in [("in focus", 20), ("at the disc's edge", width / 2 - DISC_RADIUS_PX as usize)] {
        println!("pixel {name}: {:.3?}", rendered.image.pixel(x, height / 2));
    }
}
