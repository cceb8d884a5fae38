//! A sample matters only to the pixels that its blur, before or after it changed, can reach.

use super::engine::{Engine, Setup};
use super::scenes::{EMPTY, Fragment, Pixel, differences, inner, layer, noise};
use super::{Figure, Measured, Promise, figure, program};
use thinlens::image::Image;
use thinlens::methods::Law;
use thinlens::scene::{EffectKind, Layer, Scene};
use thinlens::stack::StackKind;

pub(crate) const LOCALITY: Measured =
    Measured { law: Law::LocalChange, bound: 1e-6, promised_by: Promise::LensSampling, figures: changes };

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

/// The samples that change: a square.
#[derive(Clone, Copy)]
struct Square {
    place: &'static str,
    /// Column and row of its first sample.
    corner: [usize; 2],
    /// Samples on a side.
    side: usize,
}

impl Square {
    const fn new(place: &'static str, corner: [usize; 2], side: usize) -> Self {
        Self { place, corner, side }
    }

    fn contains(self, x: usize, y: usize) -> bool {
        self.pixels_away(x, y) == 0.0
    }

    fn pixels_away(self, x: usize, y: usize) -> f32 {
        let axis = |at: usize, from: usize| at.abs_diff(at.clamp(from, from + self.side - 1)) as f32;
        axis(x, self.corner[0]).hypot(axis(y, self.corner[1]))
    }

    /// Largest change of a pixel more than `reach_px` and one pixel away from the square.
    fn change_beyond(self, reach_px: f32, before: &Image, after: &Image) -> f64 {
        let beyond =
            differences(before, after).filter(|&([x, y], _)| self.pixels_away(x, y) > reach_px + 1.0);
        beyond.map(|(_, difference)| difference).fold(0.0, f64::max)
    }
}

const SQUARES: [Square; 4] = [
    Square::new("in the corner", [0, 0], 1),
    Square::new("in the middle", [31, 21], 1),
    Square::new("at the border", [62, 20], 2),
    Square::new("in a corner", [0, 41], 3),
];

fn changes(engine: &Engine) -> Vec<Figure> {
    [changes_of_scenes(engine), changes_of_stacks(engine)].concat()
}

/// Changes of scenes that are of one kind.
fn changes_of_scenes(engine: &Engine) -> Vec<Figure> {
    let scenes = [
        ("points", points as fn() -> Vec<Layer>, StackKind::PointSampled),
        ("coverage", coverage, StackKind::Coverage),
        ("beauty + Z", beauty, StackKind::BeautyDepth),
    ];
    scenes.into_iter().flat_map(|(name, layers, kind)| changes_of(engine, name, &layers(), kind)).collect()
}

fn changes_of(engine: &Engine, name: &str, layers: &[Layer], kind: StackKind) -> Vec<Figure> {
    let filled = [(EffectKind::Resolve, true), (EffectKind::Fill, true)];
    let settings =
        [("", &[][..]), (", filled", &filled[..]), (", not filled", &[(EffectKind::Fill, false)][..])];
    let cases = SQUARES.into_iter().flat_map(|square| CHANGES.map(|change| (square, change))).collect();
    let cases = engine.some_of(cases, 6);
    let with = |(forced, passes)| {
        let setup = Setup { views: 32, passes };
        let scene = |layers| Scene::new(layers, kind, 1, INFINITY_PX);
        let before = engine.blur(scene(layers.to_vec()), setup);
        let figure_of = |&(square, (how, change)): &(Square, (&str, Change))| {
            let after = engine.blur(scene(changed(layers, square, change)), setup);
            // No CoC radius of the scenes is larger than that at infinity.
            let beyond = square.change_beyond(INFINITY_PX, &before, &after);
            figure(format!("{name}{forced}: {how} {}", square.place), beyond)
        };
        cases.iter().map(figure_of).collect::<Vec<_>>()
    };
    settings.into_iter().flat_map(with).collect()
}

/// `layers` with the nearest fragment of each pixel in `square` changed; one that becomes empty takes all behind it along.
fn changed(layers: &[Layer], square: Square, change: Change) -> Vec<Layer> {
    let change_layer = |(i, old): (usize, &Layer)| {
        layer(WIDTH, HEIGHT, |x, y| {
            let [red, green, blue] = old.color_at(x, y);
            let fragment = ([red, green, blue, old.alpha.get(x, y)], old.coc_px.get(x, y));
            let changed = change(fragment);
            if square.contains(x, y) && (i == 0 || changed == EMPTY) { changed } else { fragment }
        })
    };
    layers.iter().enumerate().map(change_layer).collect()
}

/// Changes of a stack, of which the program concludes what its samples stand for.
fn changes_of_stacks(engine: &Engine) -> Vec<Figure> {
    let before = program::render(engine, program::peels());
    let figure_of = |square: Square| {
        let mut peels = program::peels();
        for (x, y) in
            inner(program::SIZE[0], program::SIZE[1], 0).into_iter().filter(|&(x, y)| square.contains(x, y))
        {
            let nearest = &mut peels[0];
            let planes = nearest.color.iter_mut().chain([&mut nearest.alpha]);
            planes.for_each(|plane| plane.set(x, y, 0.5 * plane.get(x, y)));
        }
        let after = program::render(engine, peels);
        let beyond = square.change_beyond(program::INFINITY_PX, &before, &after);
        figure(format!("a stack: half covered {}", square.place), beyond)
    };
    let squares = [
        Square::new("in the middle", [24, 22], 1),
        Square::new("in the middle, two by two", [24, 22], 2),
        Square::new("at the border", [24, 41], 3),
    ];
    engine.some_of(squares.to_vec(), 2).into_iter().map(figure_of).collect()
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

fn points() -> Vec<Layer> {
    (0..3).map(|peel| layer(WIDTH, HEIGHT, |x, y| fragments(x, y)[peel])).collect()
}

fn beauty() -> Vec<Layer> {
    points().drain(..1).collect()
}

/// The same as points with a translucent rim around each bar.
fn coverage() -> Vec<Layer> {
    let mut layers = points();
    let is_bar = |x: usize| (x * 7 / WIDTH) % 3 == 1;
    layers[0] = layer(WIDTH, HEIGHT, |x, y| {
        let (color, coc_px) = fragments(x, y)[0];
        let is_rim = is_bar(x) && !(is_bar(x - 1) && is_bar(x + 1));
        (if is_rim { color.map(|value| 0.5 * value) } else { color }, coc_px)
    });
    layers
}
