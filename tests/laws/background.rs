//! Laws of the background: it is a surface with a share in each pixel, and no pixel decides for others.

use super::{Trial, blur, grey, layer, noise, scene};
use std::f32::consts::PI;
use thinlens::image::Image;
use thinlens::methods::{Law, METHODS};
use thinlens::scene::{EffectKind, Scene};
use thinlens::stack::StackKind;

/// `scene` with another CoC radius at infinity.
fn focused(scene: Scene, coc_infinity_px: f32) -> Scene {
    let antialiasing = scene.antialiasing;
    let kind = StackKind::PointSampled;
    Scene { antialiasing, ..Scene::new(scene.layers, kind, scene.supersample, coc_infinity_px) }
}

/// A wall with a near bar before it, `clear` where `is_clear(x, y)`; in one layer or, if `whole`, with the wall behind the bar as well.
fn closed(whole: bool, is_clear: impl Fn(usize, usize) -> bool) -> Scene {
    let texture = |x: usize, y: usize| [0.2 + 0.6 * noise(x / 3, y / 3, 1), 0.5, 0.3 * noise(x, y, 2), 1.0];
    let bar = |x: usize| (52..60).contains(&x);
    let clear = ([0.0; 4], 0.0);
    let wall = |x: usize, y: usize| (texture(x, y), 3.0);
    let front = layer(96, 48, |x, y| match (is_clear(x, y), bar(x)) {
        (true, _) => clear,
        (false, true) => (grey(0.9), -6.0),
        (false, false) => wall(x, y),
    });
    let back = layer(96, 48, |x, y| if whole && bar(x) && !is_clear(x, y) { wall(x, y) } else { clear });
    focused(scene(vec![front, back]), 5.0)
}

/// Largest difference between two pictures in the pixels where `counts(x, y)`.
fn difference(a: &Image, b: &Image, counts: impl Fn(usize, usize) -> bool) -> f32 {
    let pixels = (0..a.height()).flat_map(|y| (0..a.width()).map(move |x| (x, y)));
    let counted = pixels.filter(|&(x, y)| counts(x, y));
    counted.fold(0.0, |max, (x, y)| {
        let pairs = a.pixel(x, y).into_iter().zip(b.pixel(x, y));
        pairs.fold(max, |max: f32, (a, b)| max.max((a - b).abs()))
    })
}

#[test]
fn clear_pixels_change_nothing_beyond_the_largest_blur_of_them() {
    const LARGEST_COC_PX: f32 = 6.0;
    const ESTIMATE_PX: f32 = 9.0;
    for method in METHODS {
        let mut trial = Trial::new(method, Law::Locality);
        for whole in [false, true] {
            // What is estimated behind the bar depends on its surroundings, as far as rays reach from the bar's depth to the wall's.
            let estimates = !whole && method.info().effects.contains(&EffectKind::Fill);
            let reach_px = LARGEST_COC_PX + if estimates { ESTIMATE_PX } else { 0.0 };
            let expected = blur(method, &closed(whole, |_, _| false), 64);
            // A sample in the wall, one beside the bar, one in the bar, and nine in a corner.
            for (left, top, side) in [(20, 24, 1), (51, 24, 1), (55, 24, 1), (0, 0, 3)] {
                let is_clear = |x, y| (left..left + side).contains(&x) && (top..top + side).contains(&y);
                let image = blur(method, &closed(whole, is_clear), 64);
                // A disc ends half a pixel past its radius, and a pixel is half a pixel wide.
                let is_far = |x: usize, y: usize| {
                    let away = |at: usize, from: usize| {
                        (from as f32 - at as f32).max(at as f32 - (from + side - 1) as f32).max(0.0)
                    };
                    away(x, left).hypot(away(y, top)) > reach_px + 1.0
                };
                let off = difference(&image, &expected, is_far);
                trial.add(
                    off,
                    [0.0, 1e-5],
                    format!("{side} × {side} at {left}, {top}, wall behind: {whole}"),
                );
            }
        }
        trial.check();
    }
}

/// Share of a disc of radius 1 on the left of a straight line `at` from its centre.
fn share_of_disc(at: f32) -> f32 {
    let at = at.clamp(-1.0, 1.0);
    0.5 + (at * (1.0 - at * at).sqrt() + at.asin()) / PI
}

#[test]
fn the_edge_of_a_lone_object_has_the_coverage_of_its_blur() {
    for method in METHODS {
        let mut trial = Trial::new(method, Law::Edge);
        for (coc, coc_infinity_px) in [(-10.0, 5.0), (-3.0, 12.0), (6.0, 9.0)] {
            let bar = 30..54;
            let color = |x: usize| if bar.contains(&x) { (grey(0.5), coc) } else { ([0.0; 4], 0.0) };
            let object = focused(scene(vec![layer(84, 40, |x, _| color(x))]), coc_infinity_px);
            let image = blur(method, &object, 1024);
            // The mean over the width of a pixel.
            let covered = |x: usize| {
                let parts = (0..16).map(|i| x as f32 + (i as f32 + 0.5) / 16.0);
                let share =
                    |x: f32| share_of_disc((54.0 - x) / coc.abs()) - share_of_disc((30.0 - x) / coc.abs());
                parts.map(share).sum::<f32>() / 16.0
            };
            let expected = Image::from_fn(84, 40, |x, _| grey(0.5).map(|value| value * covered(x)));
            let off = difference(&image, &expected, |_, y| (14..26).contains(&y));
            trial.add(off, [0.0, 0.015], format!("c = {coc}, {coc_infinity_px} at infinity"));
        }
        trial.check();
    }
}
