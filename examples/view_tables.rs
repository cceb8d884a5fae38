//! Computes `view_tables.bin` and `row_tables.bin` of `src/lens`: joint lens and pixel sample tables by sliced optimal transport.
//!
//! `cargo run --release --example view_tables -- src/lens` (ten minutes).
//!
//! A table of `n` points `(u, j)` is moved iteratively so that, along random directions and for every CoC radius `c` of
//! a list, the sorted projections of `j + c·u` match the quantiles of the true distribution (uniform disc, uniform pixel).
//! The points are then ordered by kernel herding, so that every prefix of a table is evenly spread.
//!
//! For the rows of a picture that take turns there are further sets, with the lens points of the table and other pixel points. The same
//! projections move these until each set by itself, its prefixes, and all sets together are evenly spread. In tables and sets of that
//! size, pixel points end in the middles of as many equal parts along each axis: the smallest blur moves as few views as it should.

use glam::Vec2;
use std::f32::consts::PI;
use std::path::PathBuf;

/// CoC radii at which `j + c·u` is made even; the last one is the lens alone.
const RADII: [f32; 10] = [0.0, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, f32::INFINITY];
const STEPS: usize = 3000;

/// Sizes of the tables: powers of two, and halfway between them.
const SIZES: [usize; 15] = [8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024];

const SLICES: usize = 12;

type Point = (Vec2, Vec2);

/// Number of sets of views that rows take turns with; the first is the table.
const ROW_SETS: usize = 8;

/// The smallest table with further sets.
const SMALLEST_IN_TURNS: usize = 32;

/// Directions of the projections for the further sets.
const DIRECTIONS: usize = 128;

/// Weights of a set by itself, of one of its prefixes, and of all sets together.
const ALONE: f32 = 0.75;
const PREFIX: f32 = 0.15;
const TOGETHER: f32 = 0.1;

/// Which errors of a wide blur the pixel points take up, with the lens points at rest: 0 for all, as in the least mean squared error, and 1
/// for the pixel's part of them, as where both points move. Between them, no CoC radius is evenly spread at the cost of others.
const REST: f32 = 0.2;

fn main() -> std::io::Result<()> {
    let folder = PathBuf::from(std::env::args().nth(1).expect("the folder to write to as first argument"));
    let lines = lines();
    let (mut tables, mut further) = (Vec::new(), Vec::new());
    let mut smaller = 0;
    for n in SIZES {
        let table = ordered(&optimised(n));
        let (lens, mut jitters): (Vec<Vec2>, Vec<Vec2>) = table.iter().copied().unzip();
        if n >= SMALLEST_IN_TURNS {
            let sets = further_jitters(&table, smaller, &lines).into_iter().map(in_equal_parts);
            further.extend(sets.collect::<Vec<_>>().concat());
            jitters = in_equal_parts(jitters);
        }
        tables.extend(lens.into_iter().zip(jitters).flat_map(|(lens, jitter)| [lens, jitter]));
        smaller = n;
    }
    std::fs::write(folder.join("view_tables.bin"), bytes(&tables))?;
    std::fs::write(folder.join("row_tables.bin"), bytes(&further))
}

/// The vectors one after the other, little-endian.
fn bytes(vectors: &[Vec2]) -> Vec<u8> {
    vectors.iter().flat_map(|v| [v.x, v.y]).flat_map(f32::to_le_bytes).collect()
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
            point.1 = within_pixel(point.1 + stride * shift.1);
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

/// A projection of `j + c·u`, and how the true distribution is spread along it.
struct Line {
    direction: Vec2,
    coc: f32,
    /// Evenly many values, sorted.
    sorted: Vec<f32>,
}

impl Line {
    fn project(&self, point: &Point) -> f32 {
        self.direction.dot(self.coc * point.0 + point.1)
    }

    /// The place of rank `rank` of `count` evenly spread points.
    fn quantile(&self, rank: usize, count: usize) -> f32 {
        let place = (rank as f32 + 0.5) / count as f32 * self.sorted.len() as f32 - 0.5;
        let (before, share) = (place.floor() as usize, place.fract());
        let after = (before + 1).min(self.sorted.len() - 1);
        self.sorted[before] * (1.0 - share) + self.sorted[after] * share
    }
}

/// The lines for the further sets, in the order in which they are used: all finite radii for each direction.
fn lines() -> Vec<Line> {
    let truth: Vec<Point> = (0..12 * 1024).map(sequence).collect();
    let directions = (0..DIRECTIONS).map(|k| {
        let spread = k * 79 % DIRECTIONS; // each direction far from the last ones
        Vec2::from_angle(PI * (spread as f32 + 0.5) / DIRECTIONS as f32)
    });
    let radii = RADII.into_iter().filter(|c| c.is_finite());
    let pairs = directions.flat_map(|direction| radii.clone().map(move |coc| (direction, coc)));
    pairs
        .map(|(direction, coc)| {
            let mut line = Line { direction, coc, sorted: Vec::new() };
            line.sorted = truth.iter().map(|point| line.project(point)).collect();
            line.sorted.sort_by(f32::total_cmp);
            line
        })
        .collect()
}

/// The pixel points of sets 1, 2, … for the lens points of `table`, whose next smaller table has `smaller` points.
fn further_jitters(table: &[Point], smaller: usize, lines: &[Line]) -> Vec<Vec<Vec2>> {
    let n = table.len();
    let mut sets: Vec<Vec<Point>> = (0..ROW_SETS).map(|set| shifted(table, set)).collect();
    for step in 0..STEPS {
        let mut moves = vec![vec![Vec2::ZERO; n]; ROW_SETS];
        for slice in 0..SLICES {
            let line = &lines[(step * SLICES + slice) % lines.len()];
            let prefix = smaller + 1 + (step * 7 + slice * 13) % (n - smaller);
            for set in 1..ROW_SETS {
                fit(line, &sets, set..set + 1, n, ALONE, &mut moves);
                fit(line, &sets, set..set + 1, prefix, PREFIX, &mut moves);
            }
            fit(line, &sets, 0..ROW_SETS, n, TOGETHER, &mut moves);
        }
        let stride = (1.0 - 0.9 * step as f32 / STEPS as f32) / SLICES as f32;
        for (set, moves) in sets.iter_mut().zip(&moves).skip(1) {
            for (point, shift) in set.iter_mut().zip(moves) {
                point.1 = within_pixel(point.1 + stride * *shift);
            }
        }
    }
    let jitters = |set: Vec<Point>| centred_in_pixel(set.into_iter().map(|point| point.1).collect());
    sets.into_iter().skip(1).map(jitters).collect()
}

/// `table` with its pixel points shifted by a Kronecker sequence with wrap-around: where the optimisation of set `set` starts.
fn shifted(table: &[Point], set: usize) -> Vec<Point> {
    let shift = Vec2::new(0.754_877_7, 0.569_840_3) * set as f32;
    let wrapped = |jitter: Vec2| if set == 0 { jitter } else { (jitter + 0.5 + shift).fract_gl() - 0.5 };
    table.iter().map(|&(lens, jitter)| (lens, wrapped(jitter))).collect()
}

/// Adds to `moves` what takes the first `count` points of each of the sets `chosen`, ranked together, to their quantiles on `line`.
fn fit(
    line: &Line,
    sets: &[Vec<Point>],
    chosen: std::ops::Range<usize>,
    count: usize,
    weight: f32,
    moves: &mut [Vec<Vec2>],
) {
    let points = chosen.flat_map(|set| (0..count).map(move |i| (set, i)));
    let mut ranked: Vec<(f32, usize, usize)> =
        points.map(|(set, i)| (line.project(&sets[set][i]), set, i)).collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    let scale = weight / (line.coc * line.coc + 1.0).powf(REST);
    for (rank, &(place, set, i)) in ranked.iter().enumerate() {
        moves[set][i] += line.direction * (scale * (line.quantile(rank, ranked.len()) - place));
    }
}

/// Moves `jitters` along each axis, in order, to the middles of as many equal parts of the pixel.
fn in_equal_parts(mut jitters: Vec<Vec2>) -> Vec<Vec2> {
    let count = jitters.len();
    let mut order: Vec<usize> = (0..count).collect();
    for axis in [Vec2::X, Vec2::Y] {
        order.sort_by(|&a, &b| jitters[a].dot(axis).total_cmp(&jitters[b].dot(axis)));
        for (rank, &i) in order.iter().enumerate() {
            let middle = (rank as f32 + 0.5) / count as f32 - 0.5;
            jitters[i] = jitters[i] * (Vec2::ONE - axis) + middle * axis;
        }
    }
    jitters
}

/// Moves the mean to zero, within the pixel.
fn centred_in_pixel(mut jitters: Vec<Vec2>) -> Vec<Vec2> {
    for _ in 0..20 {
        let mean = jitters.iter().sum::<Vec2>() / jitters.len() as f32;
        for jitter in &mut jitters {
            *jitter = within_pixel(*jitter - mean);
        }
    }
    jitters
}

/// The nearest point within the pixel, short of its edges.
fn within_pixel(jitter: Vec2) -> Vec2 {
    jitter.clamp(Vec2::splat(-0.4999), Vec2::splat(0.4999))
}
