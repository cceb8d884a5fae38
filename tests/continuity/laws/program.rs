//! Peels with depth, rendered by the whole program.

use super::engine::Engine;
use super::scenes::noise;
use thinlens::image::{Image, Plane};
use thinlens::render::{Job, render_stack};
use thinlens::settings::{Effort, Focus, Values};
use thinlens::stack::{Frame, Peel, ReadOptions, Stack};

/// Width and height of the pictures.
pub(super) const SIZE: [usize; 2] = [64, 44];

/// CoC radius at infinity of the lens, in pixels; no CoC radius is larger: 135² mm² ÷ (2 · 0.45 · 3000 mm) ÷ 36 mm · 64 px.
pub(super) const INFINITY_PX: f32 = 12.0;

/// The picture of `peels`, point samples as far as they are opaque, by the method and device of `engine`.
pub(super) fn render(engine: &Engine, peels: Vec<Peel>) -> Image {
    let stack =
        Stack::from_peels(peels, Frame::from_size(SIZE[0], SIZE[1]), &ReadOptions::default()).unwrap();
    let values = Values {
        focal_length_mm: Some(135.0),
        f_number: Some(0.45),
        focus: Some(Focus::Distance(3.0)),
        method: Some(engine.method.name().to_owned()),
        effort: engine.method.samples_lens().then_some(Effort::Views(32)),
        ..Values::default()
    };
    let job = Job { device: engine.device(), ..Job::default().with_values(values) };
    render_stack(stack, &job, &|_| {}).unwrap().image
}

/// What a ray through each pixel meets at its first, second and third hit: bars, a floor that comes nearer downwards, a wall.
pub(super) fn peels() -> Vec<Peel> {
    let hits = |x: usize, y: usize| {
        let bar = (x % 16 < 3).then_some((1, 2.0));
        let floor = (y > 12).then_some((2, 5.0 - 0.08 * (y as f32 - 12.0)));
        [bar, floor, Some((3, 8.0))].into_iter().flatten()
    };
    (0..3).map(|at| peel(|x, y| hits(x, y).nth(at))).collect()
}

/// An opaque peel; `hit` is the surface and its depth, `None` where there is no fragment.
fn peel(hit: impl Fn(usize, usize) -> Option<(usize, f32)>) -> Peel {
    let plane = |value: &dyn Fn(usize, usize, usize) -> f32| {
        Plane::from_fn(SIZE[0], SIZE[1], |x, y| hit(x, y).map_or(0.0, |(surface, _)| value(x, y, surface)))
    };
    Peel {
        color: std::array::from_fn(|k| plane(&|x, y, surface| noise(x / 2, y / 2, 3 * surface + k))),
        alpha: plane(&|_, _, _| 1.0),
        depth: Plane::from_fn(SIZE[0], SIZE[1], |x, y| hit(x, y).map_or(f32::INFINITY, |(_, depth)| depth)),
    }
}
