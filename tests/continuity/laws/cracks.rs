//! Opaque surfaces let no light pass: steep ones, and rough ones nearly none.

use super::engine::{Engine, Setup};
use super::scenes::{INFINITY_PX, grey, inner, layer, mean, noise, point_sampled, wall};
use super::{Figure, Measured, Promise, figure};
use std::f32::consts::FRAC_1_SQRT_2;
use thinlens::methods::Law;
use thinlens::scene::EffectKind;

const SIZE: usize = 64;

pub(crate) const STEEP_RAMP: Measured =
    Measured { law: Law::SteepRamp, bound: 1e-3, promised_by: Promise::LensSampling, figures: ramps };

pub(crate) const RELIEF: Measured =
    Measured { law: Law::Relief, bound: 1e-2, promised_by: Promise::LensSampling, figures: reliefs };

/// Mean of a white wall's light that passes an opaque black surface with the CoC radius `coc_px`.
fn leak(engine: &Engine, margin: usize, coc_px: impl Fn(usize, usize) -> f32) -> f64 {
    debug_assert!((0..SIZE).all(|i| coc_px(i, i).abs() < INFINITY_PX));
    let surface = layer(SIZE, SIZE, |x, y| (grey(0.0), coc_px(x, y)));
    let scene = point_sampled(vec![surface, wall(SIZE, SIZE)]);
    let image = engine.blur(scene, Setup { views: 128, passes: &[(EffectKind::Resolve, false)] });
    mean(&image, 0, &inner(SIZE, SIZE, margin))
}

/// Planes whose CoC radius changes by up to a pixel from pixel to pixel. Rays of the inner pixels stay within the frame, past which
/// a plane goes on level.
fn ramps(engine: &Engine) -> Vec<Figure> {
    let directions = [
        ("row", [0.0, 1.0]),
        ("column", [1.0, 0.0]),
        ("diagonal", [FRAC_1_SQRT_2; 2]),
        ("other diagonal", [FRAC_1_SQRT_2, -FRAC_1_SQRT_2]),
    ];
    let slopes_px = [1.0, 0.75, 0.5, 0.25];
    let cases = directions.into_iter().flat_map(|direction| slopes_px.map(|slope_px| (direction, slope_px)));
    let cases = cases.flat_map(|case| [-8.0, 0.0].map(|centre_px| (case, centre_px))).collect();
    let measured = engine.some_of(cases, 5).into_iter().map(|(((direction, along), slope_px), centre_px)| {
        let offset = |at: usize| at as f32 - 0.5 * SIZE as f32;
        let coc_px = |x, y| centre_px + slope_px * (along[0] * offset(x) + along[1] * offset(y));
        figure(format!("{slope_px} px a {direction} from {centre_px}"), leak(engine, 24, coc_px))
    });
    measured.collect()
}

/// Surfaces on which every sample has a CoC radius of its own, up to a pixel from the mean.
fn reliefs(engine: &Engine) -> Vec<Figure> {
    let cases = [-8.0f32, -2.0]
        .into_iter()
        .flat_map(|centre_px| [1.0, 0.5, 0.3].map(|height_px| (centre_px, height_px)))
        .collect();
    let measured = engine.some_of(cases, 3).into_iter().map(|(centre_px, height_px)| {
        let coc_px = |x, y| centre_px + height_px * (2.0 * noise(x, y, 5) - 1.0);
        figure(format!("± {height_px} px around {centre_px}"), leak(engine, 12, coc_px))
    });
    measured.collect()
}
