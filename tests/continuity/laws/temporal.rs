//! Changes from frame to frame against the true ones, of a scene whose lens rays are traced here.

use super::engine::{Engine, Setup};
use super::rays::{Ray, rays};
use super::scenes::{EMPTY, Fragment, layer};
use super::sweeps::{Lens, Steps};
use rayon::prelude::*;
use thinlens::image::Image;
use thinlens::scene::Scene;
use thinlens::stack::StackKind;

const FRAMES: usize = 48;
const WIDTH: usize = 64;
const HEIGHT: usize = 40;

/// Row from which on the floor is seen.
const HORIZON: f32 = 12.0;

/// Inverse distances of the bars and of the wall, and how much the floor's grows from row to row.
const BARS: f32 = 2.0;
const WALL: f32 = 0.3;
const FLOOR_SLOPE: f32 = 0.05;

/// A moving picture.
#[derive(Debug)]
pub(crate) struct Sequence {
    pub(crate) name: &'static str,
    truth: Vec<Image>,
    frame: fn(f32) -> (Lens, f32),
}

/// How the changes of a sequence by one engine compare with the true ones.
#[derive(Debug)]
pub(crate) struct Changes {
    /// Root mean square of the error of a change, over that of the true changes.
    pub(crate) error: f64,
    /// Largest change over the mean.
    pub(crate) largest_over_mean: f64,
    /// Frames that do not change.
    pub(crate) frozen: usize,
}

/// A focus pull, an f-number sweep and a pan of an eighth of a pixel a frame.
pub(crate) fn sequences() -> Vec<Sequence> {
    let pull: fn(f32) -> (Lens, f32) =
        |share| (Lens { infinity_px: 5.0 * (0.4 + 1.4 * share), scale_px: 5.0 }, 0.0);
    let f_number: fn(f32) -> (Lens, f32) = |share| {
        let scale_px = 0.3 * 20f32.powf(share);
        (Lens { infinity_px: scale_px, scale_px }, 0.0)
    };
    let pan: fn(f32) -> (Lens, f32) =
        |share| (Lens { infinity_px: 4.0, scale_px: 4.0 }, share * (FRAMES - 1) as f32 / 8.0);
    let rays = rays(1024);
    [("focus pull", pull), ("f-number sweep", f_number), ("pan", pan)]
        .map(|(name, frame)| Sequence {
            name,
            truth: shares().map(|share| traced(&rays, frame(share))).collect(),
            frame,
        })
        .into()
}

fn shares() -> impl Iterator<Item = f32> {
    (0..FRAMES).map(|i| i as f32 / (FRAMES - 1) as f32)
}

impl Sequence {
    /// The true changes, compared with themselves: how even they are.
    pub(crate) fn true_changes(&self) -> Changes {
        self.compared(&self.truth)
    }

    /// The changes that `engine` makes of it with `views` lens samples a pixel.
    pub(crate) fn changes(&self, engine: &Engine, views: usize) -> Changes {
        let frame = |share| engine.blur(sampled((self.frame)(share)), Setup::views(views));
        self.compared(&shares().map(frame).collect::<Vec<_>>())
    }

    fn compared(&self, frames: &[Image]) -> Changes {
        let changes = |frames: &[Image]| -> Vec<f32> {
            let of_plane = |k: usize, pair: &[Image]| {
                let values = pair[1].planes[k].values().iter().zip(pair[0].planes[k].values());
                values.map(|(after, before)| after - before).collect::<Vec<f32>>()
            };
            frames.windows(2).flat_map(|pair| (0..3).flat_map(move |k| of_plane(k, pair))).collect()
        };
        let (found, expected) = (changes(frames), changes(&self.truth));
        let sum =
            |values: &mut dyn Iterator<Item = f32>| values.map(|value| f64::from(value).powi(2)).sum::<f64>();
        let off = sum(&mut found.iter().zip(&expected).map(|(found, expected)| found - expected));
        let steps = Steps::between(frames);
        Changes {
            error: (off / sum(&mut expected.iter().copied())).sqrt(),
            largest_over_mean: steps.largest_over_mean,
            frozen: steps.frozen,
        }
    }
}

/// Colour of surface `seed` at a place in its own picture, which moves with it.
fn texture(x: f32, y: f32, seed: f32) -> [f32; 4] {
    let wave = |at: f32, period: f32| (std::f32::consts::TAU * at / period + seed).sin();
    let light = 0.5 + 0.25 * wave(x, 5.3) + 0.2 * wave(x + y, 7.7);
    [light, 0.5 + 0.4 * wave(y - 0.3 * x, 6.1), 0.3 * seed * light, 1.0]
}

fn is_bar(x: f32) -> bool {
    x.rem_euclid(21.0) < 5.4
}

fn floor_inverse(y: f32) -> f32 {
    WALL + FLOOR_SLOPE * (y - HORIZON)
}

/// The scene as a stack of point samples, moved left by `moved_px`.
fn sampled((lens, moved_px): (Lens, f32)) -> Scene {
    let fragments = |x: usize, y: usize| -> [Fragment; 3] {
        let (x, y) = (x as f32 + moved_px, y as f32);
        let bar = is_bar(x).then(|| (texture(x, y, 1.0), lens.coc_px(BARS)));
        let floor = (y >= HORIZON).then(|| (texture(x, y, 2.0), lens.coc_px(floor_inverse(y))));
        let wall = Some((texture(x, y, 3.0), lens.coc_px(WALL)));
        let mut found = [bar, floor, wall].into_iter().flatten();
        std::array::from_fn(|_| found.next().unwrap_or(EMPTY))
    };
    let peel = |at: usize| layer(WIDTH, HEIGHT, |x, y| fragments(x, y)[at]);
    Scene::new((0..3).map(peel).collect(), StackKind::PointSampled, 1, lens.infinity_px)
}

/// The picture of the scene itself: the mean of `rays` from all over each pixel and the lens.
fn traced(rays: &[Ray], (lens, moved_px): (Lens, f32)) -> Image {
    let pixel = |i: usize| {
        let (x, y) = ((i % WIDTH) as f32 + moved_px, (i / WIDTH) as f32);
        let mut sum = [0.0f64; 4];
        for ray in rays {
            let hit = hit(lens, [x, y], ray);
            sum.iter_mut().zip(hit).for_each(|(sum, value)| *sum += f64::from(value));
        }
        sum.map(|sum| (sum / rays.len() as f64) as f32)
    };
    let pixels: Vec<[f32; 4]> = (0..WIDTH * HEIGHT).into_par_iter().map(pixel).collect();
    Image::from_fn(WIDTH, HEIGHT, |x, y| pixels[y * WIDTH + x])
}

/// What `ray` of the pixel at `x, y` meets: a point of CoC radius c is seen at `place + c · lens`.
fn hit(lens: Lens, [x, y]: [f32; 2], ray: &Ray) -> [f32; 4] {
    let [ux, uy] = ray.lens.map(|at| at as f32);
    let [px, py] = [x + ray.place[0] as f32, y + ray.place[1] as f32];
    let at = |coc_px: f32| [px + coc_px * ux, py + coc_px * uy];
    let [bar_x, bar_y] = at(lens.coc_px(BARS));
    if is_bar(bar_x) {
        return texture(bar_x, bar_y, 1.0);
    }
    // On the floor c = c₀ − b (y − horizon), so y = py + c·uy is linear in y.
    let (c0, b) = (lens.coc_px(WALL), lens.scale_px * FLOOR_SLOPE);
    let row = (py + (c0 + b * HORIZON) * uy) / (1.0 + b * uy);
    if row >= HORIZON {
        let [floor_x, _] = at(lens.coc_px(floor_inverse(row)));
        return texture(floor_x, row, 2.0);
    }
    let [wall_x, wall_y] = at(lens.coc_px(WALL));
    texture(wall_x, wall_y, 3.0)
}
