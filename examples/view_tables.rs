//! Computes `src/lens/view_tables.bin`: joint lens and pixel sample tables by sliced optimal transport.
//!
//! `cargo run --release --example view_tables -- src/lens/view_tables.bin` (a few minutes).
//!
//! A table of `n` points `(u, j)` is moved iteratively so that, along random directions and for every CoC radius `c` of
//! a list, the sorted projections of `j + c·u` match the quantiles of the true distribution (uniform disc, uniform pixel).
//! The points are then ordered by kernel herding, so that every prefix of a table is evenly spread.

use glam::Vec2;
use std::f32::consts::PI;

/// CoC radii at which `j + c·u` is made even; the last one is the lens alone.
const RADII: [f32; 10] = [0.0, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, f32::INFINITY];
const STEPS: usize = 3000;

/// Sizes of the tables: powers of two, and halfway between them.
const SIZES: [usize; 15] = [8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024];

const SLICES: usize = 12;

type Point = (Vec2, Vec2);

fn main() -> std::io::Result<()> {
    let path = std::env::args().nth(1).expect("the file to write as first argument");
    let mut bytes = Vec::new();
    for n in SIZES {
        for (lens, jitter) in ordered(&optimised(n)) {
            bytes.extend([lens.x, lens.y, jitter.x, jitter.y].iter().flat_map(|v| v.to_le_bytes()));
        }
    }
    std::fs::write(path, bytes)
}

/// Point `i` of the R4 sequence (Roberts 2018), mapped to disc × pixel.
fn sequence(i: usize) -> Point {
    let root = 1.167_303_978_261_418_7_f64; // positive root of x⁵ = x + 1
    let r: [f32; 4] = std::array::from_fn(|k| ((i as f64 + 0.5) * root.powi(-(k as i32) - 1)).fract() as f32);
    let (radius, angle) = (r[0].sqrt(), 2.0 * PI * r[1]);
    (radius * Vec2::from_angle(angle), Vec2::new(r[2], r[3]) - 0.5)
}

/// Weights of lens and pixel in the projection for CoC radius `c`.
fn weights(c: f32) -> (f32, f32) {
    if c.is_finite() { (c, 1.0) } else { (1.0, 0.0) }
}

fn optimised(n: usize) -> Vec<Point> {
    let oversampling = (1 << 15) / n;
    let truth: Vec<Point> = (0..n * oversampling).map(sequence).collect();
    let mut points: Vec<Point> = (0..n).map(sequence).collect();
    let mut order: Vec<usize> = (0..n).collect();
    for step in 0..STEPS {
        let mut moves = vec![(Vec2::ZERO, Vec2::ZERO); n];
        for slice in 0..SLICES {
            let turn = step as f32 * 0.618_034 + slice as f32 * 0.754_8;
            let direction = Vec2::from_angle(PI * turn.fract());
            let (lens, pixel) = weights(RADII[(step * SLICES + slice) % RADII.len()]);
            let project = |p: &Point| direction.dot(lens * p.0 + pixel * p.1);
            let mut quantiles: Vec<f32> = truth.iter().map(project).collect();
            quantiles.sort_by(f32::total_cmp);
            order.sort_by(|&a, &b| project(&points[a]).total_cmp(&project(&points[b])));
            let norm = lens * lens + pixel * pixel;
            for (rank, &i) in order.iter().enumerate() {
                let error = quantiles[rank * oversampling + oversampling / 2] - project(&points[i]);
                moves[i].0 += direction * (error * lens / norm);
                moves[i].1 += direction * (error * pixel / norm);
            }
        }
        let stride = (1.0 - 0.9 * step as f32 / STEPS as f32) / SLICES as f32;
        for (point, shift) in points.iter_mut().zip(&moves) {
            point.0 += stride * shift.0;
            point.1 = (point.1 + stride * shift.1).clamp(Vec2::splat(-0.4999), Vec2::splat(0.4999));
        }
    }
    centred(points)
}

/// Moves the means to zero, so that blur does not shift points, and keeps the points within the lens.
fn centred(mut points: Vec<Point>) -> Vec<Point> {
    for _ in 0..20 {
        let mean = points.iter().fold((Vec2::ZERO, Vec2::ZERO), |m, p| (m.0 + p.0, m.1 + p.1));
        let scale = 1.0 / points.len() as f32;
        for point in &mut points {
            point.0 = (point.0 - mean.0 * scale).clamp_length_max(1.0);
            point.1 = (point.1 - mean.1 * scale).clamp(Vec2::splat(-0.5), Vec2::splat(0.5));
        }
    }
    points
}

/// Kernel herding with the energy distance: each next point is the one that the chosen set lacks most.
fn ordered(points: &[Point]) -> Vec<Point> {
    let n = points.len();
    let kernel = |a: &Point, b: &Point| {
        RADII.iter().fold(0.0, |sum, &c| {
            let (lens, pixel) = weights(c);
            sum - (lens * (a.0 - b.0) + pixel * (a.1 - b.1)).length() / (lens + pixel)
        })
    };
    let mean: Vec<f32> =
        points.iter().map(|a| points.iter().map(|b| kernel(a, b)).sum::<f32>() / n as f32).collect();
    let mut chosen_sum = vec![0.0f32; n];
    let mut remaining: Vec<usize> = (0..n).collect();
    let mut result = Vec::with_capacity(n);
    while !remaining.is_empty() {
        let lack = |i: usize| mean[i] * (result.len() + 1) as f32 - chosen_sum[i];
        let by_lack = |a: &usize, b: &usize| lack(remaining[*a]).total_cmp(&lack(remaining[*b]));
        let best = (0..remaining.len()).max_by(by_lack).unwrap_or(0);
        let chosen = remaining.swap_remove(best);
        for &i in &remaining {
            chosen_sum[i] += kernel(&points[i], &points[chosen]);
        }
        result.push(points[chosen]);
    }
    result
}
