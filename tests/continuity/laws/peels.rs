//! Any number of peels, in any order.

use super::engine::{Engine, Setup};
use super::program::{peels, render};
use super::scenes::{EMPTY, averaged, difference, grey, layer, point_sampled, veil};
use super::{Figure, Measured, Promise, figure};
use thinlens::image::Image;
use thinlens::methods::Law;
use thinlens::scene::{Layer, Scene};

pub(crate) const MANY_PEELS: Measured =
    Measured { law: Law::ManyPeels, bound: 2e-4, promised_by: Promise::All, figures: many_peels };

pub(crate) const PEEL_ORDER: Measured =
    Measured { law: Law::PeelOrder, bound: 1e-6, promised_by: Promise::All, figures: orders };

/// Frames whose every pixel has the same value, held by one of 300 peels or attenuated by all of them.
fn many_peels(engine: &Engine) -> Vec<Figure> {
    const PEELS: usize = 300;
    const SIZE: (usize, usize) = (9, 7);
    let coc_px = |peel: usize| 0.04 * peel as f32 - 6.0;
    let of = |peel: &dyn Fn(usize) -> Layer| (0..PEELS).map(peel).collect::<Vec<_>>();
    let full = |peel: usize, pixel: [f32; 4]| layer(SIZE.0, SIZE.1, |_, _| (pixel, coc_px(peel)));
    let none = layer(SIZE.0, SIZE.1, |_, _| EMPTY);
    let last = PEELS - 1;
    let empty = of(&|peel| if peel == last { full(peel, grey(0.7)) } else { none.clone() });
    let clear = of(&|peel| if peel == last { full(peel, grey(0.7)) } else { full(peel, veil(0.001)) });
    let hidden = of(&|peel| match peel {
        256 => full(peel, grey(0.7)),
        299 => full(peel, grey(0.1)),
        _ => none.clone(),
    });
    let holder = |x: usize, y: usize| (31 * x + 17 * y) % PEELS;
    let scattered = of(&|peel| {
        layer(SIZE.0, SIZE.1, |x, y| if holder(x, y) == peel { (grey(0.7), -4.0) } else { EMPTY })
    });
    let attenuated = 0.7 * 0.999f32.powi(last as i32);
    let cases: [(&str, Scene, f32); 4] = [
        ("299 empty peels before the last", point_sampled(empty), 0.7),
        ("299 clear peels before the last", averaged(clear), attenuated),
        ("the 257th hides the 300th", point_sampled(hidden), 0.7),
        ("one surface scattered over 300 peels", point_sampled(scattered), 0.7),
    ];
    let measured = cases.into_iter().map(|(case, scene, value)| {
        let expected = Image::from_fn(SIZE.0, SIZE.1, |_, _| [value, value, value, 1.0]);
        figure(case, difference(&engine.blur(scene, Setup::views(16)), &expected))
    });
    measured.collect()
}

/// A stack against the same peels in another order.
fn orders(engine: &Engine) -> Vec<Figure> {
    let ordered = render(engine, peels());
    let turned = |count: usize| {
        let mut peels = peels();
        peels.rotate_left(count);
        peels
    };
    let reversed = peels().into_iter().rev().collect();
    [("farthest first", reversed), ("nearest last", turned(1)), ("second nearest last", turned(2))]
        .map(|(case, peels)| figure(case, difference(&render(engine, peels), &ordered)))
        .to_vec()
}
