//! Changes from frame to frame against the true ones, of a scene whose lens rays are traced here.

use super::engine::{Engine, Setup};
use super::rays::{Ray, rays};
use super::scenes::{EMPTY, Fragment, layer, mean};
use super::sweeps::{Lens, Steps};
use rayon::prelude::*;
use thinlens::image::Image;
use thinlens::scene::Scene;
use thinlens::stack::StackKind;

const FRAMES: usize = 48;
const WIDTH: usize = 64;
const HEIGHT: usize = 40;

/// Height from which on the floor is seen, in rows.
const HORIZON: f32 = 11.5;

/// Inverse distances of the bars and of the wall, and how much the floor's grows from row to row.
const BARS: f32 = 2.0;
const WALL: f32 = 0.3;
const FLOOR_SLOPE: f32 = 0.05;

/// Side of a block, in pixels: the eye sees a change of a block before that of a pixel.
const BLOCK: usize = 4;

/// A lens, and how far the scene has moved to the left, in pixels.
type Moment = (Lens, f32);

/// A moving picture.
#[derive(Debug)]
pub(crate) struct Sequence {
    pub(crate) name: &'static str,
    moment: fn(f32) -> Moment,
    kind: StackKind,
    truth: Vec<Image>,
}

/// How the changes from frame to frame by one engine compare with the true ones.
#[derive(Debug)]
pub(crate) struct Changes {
    /// Root mean square of the error of a pixel's change, over that of the true changes.
    pub(crate) error: f64,
    /// The same for the means over blocks of 4 × 4 pixels.
    pub(crate) error_of_blocks: f64,
    /// Largest change over the mean.
    pub(crate) largest_over_mean: f64,
    /// Frames that do not change.
    pub(crate) frozen: usize,
}

/// A focus pull and an f-number sweep of point samples, and a pan of an eighth of a pixel a frame, of which point samples would jump
/// from pixel to pixel, so of averages; their truth is traced with `count_of_rays` rays a pixel.
pub(crate) fn sequences(count_of_rays: usize) -> Vec<Sequence> {
    type Moments = fn(f32) -> Moment;
    let moments: [(&str, Moments, StackKind); 3] = [
        ("focus pull", focus_pull, StackKind::PointSampled),
        ("f-number sweep", f_number_sweep, StackKind::PointSampled),
        ("pan", pan, StackKind::Coverage),
    ];
    let rays = rays(count_of_rays);
    let truth = |moment: Moments| shares().map(|share| traced(&rays, moment(share))).collect();
    moments.map(|(name, moment, kind)| Sequence { name, moment, kind, truth: truth(moment) }).into()
}

/// From the inverse distance 0.4 to 1.8.
fn focus_pull(share: f32) -> Moment {
    (Lens::focused(5.0, 0.4 + 1.4 * share), 0.0)
}

/// From 0.3 to 6 px in even ratios.
fn f_number_sweep(share: f32) -> Moment {
    (Lens::focused(0.3 * 20f32.powf(share), 1.0), 0.0)
}

fn pan(share: f32) -> Moment {
    (Lens::focused(4.0, 1.0), share * (FRAMES - 1) as f32 / 8.0)
}

fn shares() -> impl Iterator<Item = f32> {
    (0..FRAMES).map(|i| i as f32 / (FRAMES - 1) as f32)
}

impl Sequence {
    /// The changes that `engine` makes of it with `views` lens samples a pixel.
    pub(crate) fn changes(&self, engine: &Engine, views: usize) -> Changes {
        let frame = |share| engine.blur(sampled((self.moment)(share), self.kind), Setup::views(views));
        self.compared(&shares().map(frame).collect::<Vec<_>>())
    }

    /// The true changes, compared with themselves: how even they are.
    pub(crate) fn true_changes(&self) -> Changes {
        self.compared(&self.truth)
    }

    fn compared(&self, frames: &[Image]) -> Changes {
        let steps = Steps::between(frames);
        Changes {
            error: error(&changes(frames, 1), &changes(&self.truth, 1)),
            error_of_blocks: error(&changes(frames, BLOCK), &changes(&self.truth, BLOCK)),
            largest_over_mean: steps.largest_over_mean,
            frozen: steps.frozen,
        }
    }
}

/// Changes from frame to frame of the mean of every colour over every block of `side × side` pixels.
fn changes(frames: &[Image], side: usize) -> Vec<f64> {
    let corners = (0..HEIGHT).step_by(side).flat_map(|y| (0..WIDTH).step_by(side).map(move |x| (x, y)));
    let blocks: Vec<_> = corners.flat_map(|corner| (0..3).map(move |k| (corner, k))).collect();
    let mean_of = |image: &Image, ((x0, y0), k): ((usize, usize), usize)| {
        let pixels: Vec<_> = (y0..y0 + side).flat_map(|y| (x0..x0 + side).map(move |x| (x, y))).collect();
        mean(image, k, &pixels)
    };
    let change = |pair: &[Image]| {
        blocks.iter().map(|&block| mean_of(&pair[1], block) - mean_of(&pair[0], block)).collect::<Vec<f64>>()
    };
    frames.windows(2).flat_map(change).collect()
}

/// Root mean square of `found` less `expected`, over that of `expected`.
fn error(found: &[f64], expected: &[f64]) -> f64 {
    let off: f64 = found.iter().zip(expected).map(|(found, expected)| (found - expected).powi(2)).sum();
    (off / expected.iter().map(|change| change.powi(2)).sum::<f64>()).sqrt()
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

/// The scene as a stack, moved left: at the centres of pixels, or averaged over them.
fn sampled((lens, moved_px): Moment, kind: StackKind) -> Scene {
    /// Columns and rows of the places over which a pixel is averaged.
    const PLACES: usize = 8;
    let places: Vec<f32> = match kind {
        StackKind::PointSampled => vec![0.0],
        _ => (0..PLACES).map(|i| (i as f32 + 0.5) / PLACES as f32 - 0.5).collect(),
    };
    // The floor begins at the upper side of a row of pixels, so that bars alone have parts of pixels.
    let fragments = |column: usize, row: usize| -> [Fragment; 3] {
        let (x, y) = (column as f32 + moved_px, row as f32);
        let mean = |seed: f32, is_inside: fn(f32) -> bool| {
            let mut sum = [0.0; 4];
            for (x, y) in places.iter().flat_map(|dx| places.iter().map(move |dy| (x + dx, y + dy))) {
                let weight = f32::from(is_inside(x)) / places.len().pow(2) as f32;
                sum.iter_mut().zip(texture(x, y, seed)).for_each(|(sum, value)| *sum += weight * value);
            }
            Some(sum).filter(|[.., alpha]| *alpha > 0.0)
        };
        let bar = mean(1.0, is_bar).map(|pixel| (pixel, lens.coc_px(BARS)));
        let floor = mean(2.0, |_| true).map(|pixel| (pixel, lens.coc_px(floor_inverse(y))));
        let wall = mean(3.0, |_| true).map(|pixel| (pixel, lens.coc_px(WALL)));
        let mut found = [bar, floor.filter(|_| y > HORIZON), wall].into_iter().flatten();
        std::array::from_fn(|_| found.next().unwrap_or(EMPTY))
    };
    let pixels: Vec<[Fragment; 3]> = (0..WIDTH * HEIGHT).map(|i| fragments(i % WIDTH, i / WIDTH)).collect();
    let peel = |at: usize| layer(WIDTH, HEIGHT, |x, y| pixels[y * WIDTH + x][at]);
    Scene::new((0..3).map(peel).collect(), kind, 1, lens.infinity_px)
}

/// The picture of the scene itself: the mean of `rays` from all over each pixel and the lens.
fn traced(rays: &[Ray], (lens, moved_px): Moment) -> Image {
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
