//! A frame that costs what a rendered one does: 1080p, four peels of one sample a pixel, half colour and float depth, ZIP.
//!
//! A floor leads from near to a far wall. Before it stand and hang three thousand balls and slats through focus, many small and few
//! large. Where few of them overlap the deeper peels are empty. Colour has the noise of a path tracer, so that it does not compress
//! to nothing.

use exr::image::{AnyChannel, AnyChannels, Blocks, Encoding, FlatImage, FlatSamples, Image, Layer};
use exr::meta::attribute::IntegerBounds;
use exr::meta::header::{ImageAttributes, LayerAttributes};
use exr::prelude::{Compression, LineOrder, SmallVec, Vec2};
use fastrand::Rng;
use half::f16;

/// The lens that the frame is made for.
pub(crate) const PRESET: &str = "[lens]
focal_length_mm = 60
f_number = 1
focus_distance = 4.5
sensor_width_mm = 36
sensor_distance = \"focal_length\"

[depth]
convention = \"planar\"
";

const WIDTH: usize = 1920;
const HEIGHT: usize = 1080;
const PEELS: usize = 4;

/// Balls and slats.
const SURFACES: usize = 3000;

/// Focal length in pixels: 60 mm on a sensor 36 mm wide.
const FOCAL_PX: f32 = 3200.0;

/// Row of the horizon, and the camera's height above the floor and the wall's distance, in metres.
const HORIZON: f32 = 270.0;
const CAMERA_HEIGHT: f32 = 0.6;
const WALL: f32 = 15.0;

/// Planar distances of the nearest and farthest ball, in metres.
const NEAREST: f32 = 1.7;
const FARTHEST: f32 = 13.0;

/// Radii of the smallest and the largest ball, in metres. The number of balls falls with the square of their radius.
const SMALLEST: f32 = 0.001;
const LARGEST: f32 = 0.24;

/// What is written as depth where a peel has no fragment.
const NO_DEPTH: f32 = 1e10;

/// Largest difference of a sample's colour from the surface's own, as a share of it.
const NOISE: f32 = 0.015;

/// What a pixel's ray hits: planar distance in metres, how bright the surface is there, and its colour.
#[derive(Clone, Copy)]
struct Fragment {
    depth: f32,
    light: f32,
    albedo: [f32; 3],
}

const NOTHING: Fragment = Fragment { depth: NO_DEPTH, light: 0.0, albedo: [0.0; 3] };

/// The frame, the same on every machine.
pub(crate) fn frame() -> FlatImage {
    let mut rng = Rng::with_seed(1);
    let mut pixels: Vec<[Fragment; PEELS]> =
        (0..WIDTH * HEIGHT).map(|i| [background(i % WIDTH, i / WIDTH), NOTHING, NOTHING, NOTHING]).collect();
    for _ in 0..SURFACES {
        draw(&mut pixels, &mut rng);
    }
    let mut channels: SmallVec<[AnyChannel<FlatSamples>; 4]> = SmallVec::new();
    for peel in 0..PEELS {
        let mut color: [Vec<f16>; 3] = Default::default();
        for fragment in pixels.iter().map(|pixel| pixel[peel]) {
            for (plane, albedo) in color.iter_mut().zip(fragment.albedo) {
                let noise = 1.0 + NOISE * (rng.f32() + rng.f32() - 1.0);
                plane.push(f16::from_f32(albedo * fragment.light * noise));
            }
        }
        let of_all = |figure: fn(&Fragment) -> f32| pixels.iter().map(move |pixel| figure(&pixel[peel]));
        let covered = of_all(|fragment| f32::from(u8::from(fragment.depth < NO_DEPTH)));
        let alpha = FlatSamples::F16(covered.map(f16::from_f32).collect());
        let depth = FlatSamples::F32(of_all(|fragment| fragment.depth).collect());
        let named = |name: &str, samples| AnyChannel::new(format!("Peel{peel}.{name}").as_str(), samples);
        channels.extend(
            ["R", "G", "B"]
                .iter()
                .zip(color)
                .map(|(letter, plane)| named(&format!("Combined.{letter}"), FlatSamples::F16(plane))),
        );
        channels.extend([named("Combined.A", alpha), named("Depth.Z", depth)]);
    }
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let layer =
        Layer::new((WIDTH, HEIGHT), LayerAttributes::default(), encoding, AnyChannels::sort(channels));
    let display = IntegerBounds::new((0, 0), Vec2(WIDTH, HEIGHT));
    Image::from_layers(ImageAttributes::new(display), SmallVec::from_vec(vec![layer]))
}

/// The chequered floor, and the wall where the floor is farther away.
fn background(x: usize, y: usize) -> Fragment {
    let depth = floor_depth(y as f32 + 0.5).min(WALL);
    let across = (x as f32 + 0.5 - 0.5 * WIDTH as f32) * depth / FOCAL_PX;
    let along = if depth < WALL { depth } else { (y as f32 + 0.5 - HORIZON) * depth / FOCAL_PX };
    let odd = ((across / 0.15).floor() + (along / 0.15).floor()).rem_euclid(2.0);
    Fragment { depth, light: 0.3 + 0.5 * odd, albedo: [0.8, 0.75, 0.6] }
}

/// Planar distance of the floor in row `y`, infinite above the horizon.
fn floor_depth(y: f32) -> f32 {
    if y > HORIZON { CAMERA_HEIGHT * FOCAL_PX / (y - HORIZON) } else { f32::INFINITY }
}

/// Puts a ball or a slat before the floor.
fn draw(pixels: &mut [[Fragment; PEELS]], rng: &mut Rng) {
    // As many by reciprocal distance: a picture shows more ground near than far.
    let depth = 1.0 / (1.0 / FARTHEST + rng.f32() * (1.0 / NEAREST - 1.0 / FARTHEST));
    let radius = SMALLEST / (1.0 - rng.f32() * (1.0 - SMALLEST / LARGEST));
    let radius_px = radius * FOCAL_PX / depth;
    let is_ball = rng.bool();
    let [half_width, half_height] = if is_ball { [radius_px; 2] } else { [0.4 * radius_px, 2.0 * radius_px] };
    let lowest = (HORIZON + CAMERA_HEIGHT * FOCAL_PX / depth - half_height).min(HEIGHT as f32);
    let [centre_x, centre_y] = [rng.f32() * WIDTH as f32, rng.f32() * lowest];
    let albedo = std::array::from_fn(|_| 0.1 + 0.8 * rng.f32());
    let range = |centre: f32, half: f32, end: usize| {
        (centre - half).max(0.0) as usize..((centre + half).max(0.0) as usize + 1).min(end)
    };
    for y in range(centre_y, half_height, HEIGHT) {
        for x in range(centre_x, half_width, WIDTH) {
            let u = (x as f32 + 0.5 - centre_x) / half_width;
            let v = (y as f32 + 0.5 - centre_y) / half_height;
            let toward = if is_ball { (1.0 - u * u - v * v).max(0.0).sqrt() } else { 0.5 + 0.5 * u };
            let is_inside = if is_ball { u * u + v * v < 1.0 } else { u.abs() < 1.0 && v.abs() < 1.0 };
            if is_inside {
                let fragment =
                    Fragment { depth: depth - radius * toward, light: 0.15 + 0.85 * toward, albedo };
                insert(&mut pixels[y * WIDTH + x], fragment);
            }
        }
    }
}

/// Puts `fragment` among those of a pixel, nearest first; the farthest is dropped where there are more than fit.
fn insert(pixel: &mut [Fragment; PEELS], fragment: Fragment) {
    let place = pixel.iter().position(|other| fragment.depth < other.depth);
    let Some(place) = place else { return };
    pixel[place..].rotate_right(1);
    pixel[place] = fragment;
}
