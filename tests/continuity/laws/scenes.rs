//! Parts of which the scenes of the laws are made.

use thinlens::image::{Image, Plane};
use thinlens::scene::{Layer, Scene};
use thinlens::stack::StackKind;

/// Red, green, blue, premultiplied, and alpha.
pub(super) type Pixel = [f32; 4];

/// A fragment: its pixel and its signed CoC radius in picture pixels.
pub(super) type Fragment = (Pixel, f32);

/// No fragment.
pub(super) const EMPTY: Fragment = ([0.0; 4], 0.0);

/// CoC radius of a white wall far behind, and of infinity, in picture pixels.
const WALL_PX: f32 = 60.0;
pub(super) const INFINITY_PX: f32 = 80.0;

pub(super) fn grey(value: f32) -> Pixel {
    [value, value, value, 1.0]
}

/// Black of the opacity `alpha`.
pub(super) fn veil(alpha: f32) -> Pixel {
    [0.0, 0.0, 0.0, alpha]
}

/// `color`, not premultiplied, with `alpha`.
pub(super) fn translucent([red, green, blue]: [f32; 3], alpha: f32) -> Pixel {
    [red * alpha, green * alpha, blue * alpha, alpha]
}

/// A layer of `width × height` fragments.
pub(super) fn layer(width: usize, height: usize, fragment: impl Fn(usize, usize) -> Fragment) -> Layer {
    Layer {
        color: std::array::from_fn(|k| Plane::from_fn(width, height, |x, y| fragment(x, y).0[k])),
        alpha: Plane::from_fn(width, height, |x, y| fragment(x, y).0[3]),
        coc_px: Plane::from_fn(width, height, |x, y| fragment(x, y).1),
    }
}

/// A white wall far behind everything.
pub(super) fn wall(width: usize, height: usize) -> Layer {
    layer(width, height, |_, _| (grey(1.0), WALL_PX))
}

/// A fragment of that wall.
pub(super) fn of_wall() -> Fragment {
    (grey(1.0), WALL_PX)
}

/// Point-sampled layers, nearest first.
pub(super) fn point_sampled(layers: Vec<Layer>) -> Scene {
    Scene::new(layers, StackKind::PointSampled, 1, INFINITY_PX)
}

/// Layers whose colours are averages over their pixels, nearest first.
pub(super) fn averaged(layers: Vec<Layer>) -> Scene {
    Scene::new(layers, StackKind::Coverage, 1, INFINITY_PX)
}

/// A pseudo-random number from 0 to 1 that depends only on the arguments.
pub(super) fn noise(x: usize, y: usize, seed: usize) -> f32 {
    let mut bits = (x as u32).wrapping_mul(0x9e37_79b9)
        ^ (y as u32).wrapping_mul(0x85eb_ca6b)
        ^ (seed as u32).wrapping_mul(0xc2b2_ae35);
    for shift in [16, 13, 16] {
        bits = (bits ^ (bits >> shift)).wrapping_mul(0x7feb_352d);
    }
    (bits >> 8) as f32 / (1 << 24) as f32
}

/// The pixels at least `margin` away from every side.
pub(super) fn inner(width: usize, height: usize, margin: usize) -> Vec<(usize, usize)> {
    (margin..height - margin).flat_map(|y| (margin..width - margin).map(move |x| (x, y))).collect()
}

/// Mean of channel `k` over `pixels`.
pub(super) fn mean(image: &Image, k: usize, pixels: &[(usize, usize)]) -> f64 {
    let sum: f64 = pixels.iter().map(|&(x, y)| f64::from(image.planes[k].get(x, y))).sum();
    sum / pixels.len() as f64
}

/// Largest difference between two pictures.
pub(super) fn difference(a: &Image, b: &Image) -> f64 {
    differences(a, b).map(|(_, difference)| difference).fold(0.0, f64::max)
}

/// For every pixel its column and row, and the largest difference of its channels.
pub(super) fn differences<'a>(a: &'a Image, b: &'a Image) -> impl Iterator<Item = ([usize; 2], f64)> + 'a {
    (0..a.height()).flat_map(move |y| {
        (0..a.width()).map(move |x| {
            let channels = a.pixel(x, y).into_iter().zip(b.pixel(x, y));
            let difference = |(a, b): (f32, f32)| f64::from(a - b).abs();
            ([x, y], channels.map(difference).map(or_infinite).fold(0.0, f64::max))
        })
    })
}

/// A difference that is no number counts as infinite.
fn or_infinite(difference: f64) -> f64 {
    if difference.is_nan() { f64::INFINITY } else { difference }
}

/// Root mean square of the difference of the colours.
pub(super) fn rms(a: &Image, b: &Image) -> f64 {
    let colors = |image: &Image| {
        image.planes[..3].iter().flat_map(|plane| plane.values().to_vec()).collect::<Vec<f32>>()
    };
    let (a, b) = (colors(a), colors(b));
    let sum: f64 = a.iter().zip(&b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    (sum / a.len() as f64).sqrt()
}
