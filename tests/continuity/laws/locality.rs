//! A sample matters only to the pixels that its blur, before or after it changed, can reach.

use super::engine::{Engine, Setup};
use super::scenes::{EMPTY, Fragment, Pixel, differences, layer, noise};
use super::{Figure, Measured, Promise, figure};
use thinlens::methods::Law;
use thinlens::scene::{EffectKind, Layer, Scene};
use thinlens::stack::StackKind;

pub(crate) const LOCALITY: Measured =
    Measured { law: Law::Locality, bound: 2e-6, promised_by: Promise::LensSampling, figures: changes };

const WIDTH: usize = 64;
const HEIGHT: usize = 44;
const INFINITY_PX: f32 = 12.0;

/// How a sample changes.
type Change = fn(Fragment) -> Fragment;

const CHANGES: [(&str, Change); 5] = [
    ("empty", |_| EMPTY),
    ("half covered", |(color, coc_px)| (color.map(|value| 0.5 * value), coc_px)),
    ("brighter", |([red, green, blue, alpha], coc_px)| {
        ([40.0 * red, 40.0 * green, 40.0 * blue, alpha], coc_px)
    }),
    ("nearer", |(color, _)| (color, -11.5)),
    ("farther", |(color, _)| (color, 11.5)),
];

/// Columns and rows of the samples that change: a square of one, two or three on a side.
const PLACES: [(&str, [usize; 2], usize); 4] = [
    ("in the corner", [0, 0], 1),
    ("in the middle", [31, 21], 1),
    ("at the border", [63, 20], 2),
    ("in a corner", [0, 41], 3),
];

fn changes(engine: &Engine) -> Vec<Figure> {
    let scenes = [("points", points as fn() -> Scene), ("coverage", coverage), ("beauty + Z", beauty)];
    scenes.into_iter().flat_map(|(name, scene)| changes_of(engine, name, &scene())).collect()
}

fn changes_of(engine: &Engine, name: &str, scene: &Scene) -> Vec<Figure> {
    let passes = [(EffectKind::Resolve, true), (EffectKind::Fill, true)];
    let settings = [("", &[][..]), (", resolved and filled", &passes[..])];
    let cases = PLACES.into_iter().flat_map(|place| CHANGES.map(|change| (place, change))).collect();
    let cases = engine.some_of(cases, 6);
    let all = settings.into_iter().flat_map(|(forced, passes)| {
        let setup = Setup { views: 32, passes };
        let before = engine.blur(scene.clone(), setup);
        cases
            .iter()
            .map(move |&((place, [x0, y0], side), (how, change))| {
                let square =
                    move |x: usize, y: usize| (x0..x0 + side).contains(&x) && (y0..y0 + side).contains(&y);
                let after = engine.blur(changed(scene, square, change), setup);
                let away = |[x, y]: [usize; 2]| {
                    let axis = |at: usize, from: usize| at.abs_diff(at.clamp(from, from + side - 1)) as f32;
                    axis(x, x0).hypot(axis(y, y0))
                };
                // No CoC radius of the scenes is larger than that at infinity.
                let beyond = differences(&before, &after).filter(|&(at, _)| away(at) > INFINITY_PX + 1.0);
                let worst = beyond.map(|(_, difference)| difference).fold(0.0, f64::max);
                figure(format!("{name}{forced}: {how} {place}"), worst)
            })
            .collect::<Vec<_>>()
    });
    all.collect()
}

/// `scene` with the nearest fragment of each pixel in `square` changed; a fragment that becomes empty takes all behind it along.
fn changed(scene: &Scene, square: impl Fn(usize, usize) -> bool + Copy, change: Change) -> Scene {
    let fragment = |layer: &Layer, x, y| {
        let [red, green, blue] = layer.color_at(x, y);
        ([red, green, blue, layer.alpha.get(x, y)], layer.coc_px.get(x, y))
    };
    let change_layer = |(i, old): (usize, &Layer)| {
        layer(WIDTH, HEIGHT, |x, y| {
            let old = fragment(old, x, y);
            let empties = change(old) == EMPTY;
            if square(x, y) && (i == 0 || empties) { change(old) } else { old }
        })
    };
    let layers = scene.layers.iter().enumerate().map(change_layer).collect();
    Scene::new(layers, scene.kind, 1, INFINITY_PX)
}

fn texture(x: usize, y: usize, seed: usize) -> Pixel {
    [0.2 + 0.6 * noise(x / 2, y / 3, seed), noise(x / 5, y / 4, seed + 1), 0.5 * noise(x, y, seed + 2), 1.0]
}

/// Near bars, a slanted floor through focus, and a far wall: the fragments of pixel `x, y`, nearest first.
fn fragments(x: usize, y: usize) -> [Fragment; 3] {
    let is_bar = (x * 7 / WIDTH) % 3 == 1;
    let floor = (texture(x, y, 2), 6.0 - 12.0 * y as f32 / HEIGHT as f32);
    let wall = (texture(x, y, 3), 9.0);
    if is_bar { [(texture(x, y, 1), -9.0), floor, wall] } else { [floor, wall, EMPTY] }
}

fn layers() -> Vec<Layer> {
    (0..3).map(|peel| layer(WIDTH, HEIGHT, |x, y| fragments(x, y)[peel])).collect()
}

fn points() -> Scene {
    Scene::new(layers(), StackKind::PointSampled, 1, INFINITY_PX)
}

fn beauty() -> Scene {
    Scene::new(layers().drain(..1).collect(), StackKind::BeautyDepth, 1, INFINITY_PX)
}

/// The same with a translucent rim around each bar.
fn coverage() -> Scene {
    let mut layers = layers();
    let is_bar = |x: usize| (x * 7 / WIDTH) % 3 == 1;
    layers[0] = layer(WIDTH, HEIGHT, |x, y| {
        let (color, coc_px) = fragments(x, y)[0];
        let is_rim = is_bar(x) && !(is_bar(x - 1) && is_bar(x + 1));
        (if is_rim { color.map(|value| 0.5 * value) } else { color }, coc_px)
    });
    Scene::new(layers, StackKind::Coverage, 1, INFINITY_PX)
}
