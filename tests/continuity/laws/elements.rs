//! An element without a background keeps its alpha, and one colour stays that colour.

use super::engine::{Engine, Setup};
use super::rays::{mean_of_samples, rays};
use super::scenes::{averaged, differences, inner, layer, noise, translucent};
use super::{Figure, Measured, Promise, figure};
use thinlens::image::Image;
use thinlens::methods::Law;
use thinlens::scene::{EffectKind, Scene};
use thinlens::stack::StackKind;

pub(crate) const LONE_ELEMENT: Measured =
    Measured { law: Law::Element, bound: 2e-3, promised_by: Promise::All, figures: lone_elements };

pub(crate) const SOFT_DISC: Measured =
    Measured { law: Law::SoftDisc, bound: 5e-3, promised_by: Promise::LensSampling, figures: soft_discs };

pub(crate) const ONE_COLOR: Measured =
    Measured { law: Law::ConstantColor, bound: 1e-5, promised_by: Promise::All, figures: one_color };

const COLOR: [f32; 3] = [0.8, 0.5, 0.2];

/// One layer of alpha 0.3 everywhere; nothing behind it.
fn lone_elements(engine: &Engine) -> Vec<Figure> {
    const SIZE: usize = 40;
    const ALPHA: f32 = 0.3;
    let fills: &[bool] = if engine.has(EffectKind::Fill) { &[false, true] } else { &[false] };
    // Only rays tell the many CoC radii of a slope apart.
    let slopes_px: &[f32] = if engine.method.lens_sampling().is_some() { &[0.0, 0.1] } else { &[0.0] };
    let cases = [-8.0, 0.0, 5.0].into_iter().flat_map(|coc_px| {
        let of_slope = move |&slope_px: &f32| [6.0, 40.0].map(|infinity_px| (coc_px, slope_px, infinity_px));
        slopes_px.iter().flat_map(of_slope)
    });
    let measured =
        engine.some_of(cases.collect(), 2).into_iter().flat_map(|(coc_px, slope_px, infinity_px)| {
            fills.iter().map(move |&fill| {
                let element = layer(SIZE, SIZE, |_, y| {
                    (translucent(COLOR, ALPHA), coc_px + slope_px * (y as f32 - 20.0))
                });
                let scene = Scene::new(vec![element], StackKind::Coverage, 1, infinity_px);
                let image = engine.blur(scene, Setup { views: 64, passes: &[(EffectKind::Fill, fill)] });
                let expected = Image::from_fn(SIZE, SIZE, |_, _| translucent(COLOR, ALPHA));
                let off = differences(&image, &expected).map(|(_, off)| off).fold(0.0, f64::max);
                let filled = if fill { ", filled" } else { "" };
                figure(
                    format!("c = {coc_px} px, {slope_px} px a row, {infinity_px} px at infinity{filled}"),
                    off,
                )
            })
        });
    measured.collect()
}

/// A disc of alpha 0.5 that fades over four pixels, alone: its blurred alpha is the mean over the lens.
fn soft_discs(engine: &Engine) -> Vec<Figure> {
    const SIZE: usize = 40;
    let alpha = |x: usize, y: usize| {
        let distance = (x as f32 - 19.5).hypot(y as f32 - 19.5);
        0.5 * ((14.0 - distance) / 4.0).clamp(0.0, 1.0)
    };
    let rays = rays(20_000);
    [-2.9, 2.9]
        .map(|coc_px: f32| {
            let disc = layer(SIZE, SIZE, |x, y| (translucent(COLOR, alpha(x, y)), coc_px));
            // Point samples, so that a ray starts anywhere in its pixel, as the oracle's do.
            let scene = Scene::new(vec![disc], StackKind::PointSampled, 1, 12.0);
            let passes = [(EffectKind::Resolve, false), (EffectKind::Prefilter, false)];
            let image = engine.blur(scene, Setup { views: 1024, passes: &passes });
            let off = |&(x, y): &(usize, usize)| {
                let expected = mean_of_samples(&rays, (x, y), f64::from(coc_px), (SIZE, SIZE), |x, y| {
                    f64::from(alpha(x, y))
                });
                (f64::from(image.planes[3].get(x, y)) - expected).abs()
            };
            // Every third pixel of a quarter: the disc is symmetric, the lens samples are not quite.
            let quarter: Vec<_> =
                inner(SIZE, SIZE, 1).into_iter().filter(|&(x, y)| x % 3 == 0 && y <= 20).collect();
            figure(format!("c = {coc_px} px"), quarter.iter().map(off).fold(0.0, f64::max))
        })
        .to_vec()
}

/// Layers of one colour with random alphas and holes, on surfaces of their own. No alpha is so near 1 that it counts as opaque.
fn one_color(engine: &Engine) -> Vec<Figure> {
    const SIZE: usize = 32;
    type Alpha = fn(usize, usize, usize) -> f32;
    let patterns: [(&str, Alpha); 4] = [
        ("random alphas", |x, y, peel| 0.99 * noise(x, y, peel)),
        ("random holes", |x, y, peel| f32::from(noise(x, y, peel) > 0.3)),
        ("random alphas and holes", |x, y, peel| (2.0 * noise(x / 2, y / 3, peel) - 0.6).clamp(0.0, 0.99)),
        ("a hole in one corner", |x, y, _| f32::from(x + y > 0)),
    ];
    let cases = patterns.into_iter().flat_map(|pattern| [1, 3].map(|peels| (pattern, peels))).collect();
    let measured = engine.some_of(cases, 3).into_iter().map(|((name, alpha), peels)| {
        let peel = |at: usize| {
            let coc_px = move |x: usize, y: usize| [-7.0, 0.2 * x as f32 - 3.0, 0.1 * y as f32 + 4.0][at];
            layer(SIZE, SIZE, move |x, y| (translucent(COLOR, alpha(x, y, at)), coc_px(x, y)))
        };
        let image = engine.blur(averaged((0..peels).map(peel).collect()), Setup::views(48));
        let off = |(x, y): (usize, usize)| {
            let [red, green, blue, alpha] = image.pixel(x, y);
            let channels = [red, green, blue].into_iter().zip(COLOR);
            channels.map(|(value, color)| f64::from(value - color * alpha).abs()).fold(0.0, f64::max)
        };
        let worst = inner(SIZE, SIZE, 0).into_iter().map(off).fold(0.0, f64::max);
        figure(format!("{name}, peels: {peels}"), worst)
    });
    measured.collect()
}
