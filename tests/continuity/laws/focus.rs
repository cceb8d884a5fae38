//! As the lens closes the picture becomes the input, without a jump.

use super::engine::{Engine, Setup};
use super::scenes::{difference, layer, noise};
use super::{Figure, Measured, Promise, figure};
use thinlens::image::Image;
use thinlens::methods::Law;
use thinlens::scene::{EffectKind, Scene};
use thinlens::stack::StackKind;

pub(crate) const NEAR_FOCUS: Measured = Measured {
    law: Law::NearFocus,
    // At 0.02 px the closed form is 2 · 4 / (3π) · 0.02 of the contrast, 0.0085.
    bound: 0.01,
    promised_by: Promise::LensSampling,
    figures: differences_from_input,
};

pub(crate) const STEP_NEAR_FOCUS: Measured =
    Measured { law: Law::StepNearFocus, bound: 0.03, promised_by: Promise::LensSampling, figures: steps };

const WIDTH: usize = 32;
const HEIGHT: usize = 20;

/// Difference of the CoC radii of two steps, in pixels.
const STEP_PX: f32 = 0.01;

/// Noise of contrast one half.
fn color(x: usize, y: usize) -> [f32; 4] {
    [0.25 + 0.5 * noise(x, y, 1), 0.25 + 0.5 * noise(x, y, 2), 0.25 + 0.5 * noise(x, y, 3), 1.0]
}

/// The program's own decisions, and blur where the plan leaves it out as too little to see.
const SETTINGS: [(&str, &[(EffectKind, bool)]); 2] =
    [("", &[]), (", blur forced", &[(EffectKind::Blur, true)])];

/// Point samples in front of and behind focus, through a lens whose largest CoC radius is `coc_px`.
fn blurred(engine: &Engine, coc_px: f32, setup: Setup<'_>) -> Image {
    blurred_planes(engine, [-coc_px, 0.7 * coc_px], setup)
}

/// Point samples of a plane behind focus, through a lens whose largest CoC radius is `coc_px`: without a silhouette, at which two surfaces
/// join below a step of half a pixel.
fn blurred_plane(engine: &Engine, coc_px: f32, setup: Setup<'_>) -> Image {
    blurred_planes(engine, [coc_px; 2], setup)
}

/// Point samples of two planes side by side, with these CoC radii.
fn blurred_planes(engine: &Engine, [left_px, right_px]: [f32; 2], setup: Setup<'_>) -> Image {
    let plane = layer(WIDTH, HEIGHT, |x, y| (color(x, y), if x < WIDTH / 2 { left_px } else { right_px }));
    let scene = Scene::new(vec![plane], StackKind::PointSampled, 1, left_px.abs());
    engine.blur(scene, setup)
}

fn differences_from_input(engine: &Engine) -> Vec<Figure> {
    let input = Image::from_fn(WIDTH, HEIGHT, color);
    let of = |(name, passes): (&str, &[(EffectKind, bool)])| {
        [0.0, 1e-6, 0.001, 0.005, 0.01, 0.02].map(|coc_px| {
            figure(
                format!("c = {coc_px} px{name}"),
                difference(&blurred(engine, coc_px, Setup { views: 1024, passes }), &input),
            )
        })
    };
    SETTINGS.into_iter().flat_map(of).collect()
}

/// Largest changes from one CoC radius to the next. On a GPU the first of them.
fn steps(engine: &Engine) -> Vec<Figure> {
    let last = if engine.is_gpu() { 6 } else { 60 };
    let of = |(name, passes): (&str, &[(EffectKind, bool)])| {
        let pictures: Vec<Image> = (0..=last)
            .map(|i| blurred_plane(engine, STEP_PX * i as f32, Setup { views: 256, passes }))
            .collect();
        let step = |(i, pair): (usize, &[Image])| {
            let coc_px = STEP_PX * (i + 1) as f32;
            figure(format!("c = {coc_px:.2} px{name}"), difference(&pair[0], &pair[1]))
        };
        pictures.windows(2).enumerate().map(step).collect::<Vec<_>>()
    };
    SETTINGS.into_iter().flat_map(of).collect()
}
