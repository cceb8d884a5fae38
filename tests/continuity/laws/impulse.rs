//! A point of light loses its peak as its disc grows, from the first hundredth of a pixel on.

use super::engine::{Engine, Setup};
use super::scenes::{grey, layer};
use super::{Figure, Measured, Promise, figure};
use thinlens::methods::Law;
use thinlens::scene::{EffectKind, Scene};
use thinlens::stack::StackKind;

pub(crate) const PEAK: Measured =
    Measured { law: Law::Peak, bound: 0.05, promised_by: Promise::LensSampling, figures: peaks };

/// A white pixel in each of four rows, so far from one another that no disc reaches another's pixel.
const LIGHTS: [(usize, usize); 4] = [(4, 4), (12, 5), (20, 6), (28, 7)];
const WIDTH: usize = 33;
const HEIGHT: usize = 12;

fn peaks(engine: &Engine) -> Vec<Figure> {
    let tenths = engine.some_of((0..=30).collect(), 6);
    let measured = tenths.into_iter().map(|tenths| {
        let coc_px = 0.1 * tenths as f32;
        let light = |x, y| if LIGHTS.contains(&(x, y)) { grey(0.8) } else { grey(0.0) };
        let plane = layer(WIDTH, HEIGHT, |x, y| (light(x, y), coc_px));
        let scene = Scene::new(vec![plane], StackKind::PointSampled, 1, 4.0);
        let passes = [(EffectKind::Resolve, false), (EffectKind::Prefilter, false)];
        let image = engine.blur(scene, Setup { views: 4096, passes: &passes });
        let peak = LIGHTS.map(|(x, y)| f64::from(image.planes[0].get(x, y)) / 0.8).iter().sum::<f64>() / 4.0;
        figure(format!("c = {coc_px:.1} px"), (peak / expected(f64::from(coc_px)) - 1.0).abs())
    });
    measured.collect()
}

/// Share of a pixel's rays that meet the pixel's own sample: a ray that starts evenly within the pixel and is moved by `c·u` stays in
/// it with probability `(1 − |c·u_x|)⁺ (1 − |c·u_y|)⁺`; the mean of that over the lens, a unit disc.
fn expected(coc_px: f64) -> f64 {
    /// Cells of the mean along a radius of the disc.
    const STEPS: usize = 800;
    let at = |i: usize| (i as f64 + 0.5) / STEPS as f64;
    let cells = (0..STEPS).flat_map(|i| (0..STEPS).map(move |k| (at(i), at(k))));
    let stays = |offset: f64| (1.0 - coc_px * offset).max(0.0);
    let in_disc = cells.filter(|(x, y)| x * x + y * y <= 1.0);
    let (sum, count) =
        in_disc.fold((0.0, 0usize), |(sum, count), (x, y)| (sum + stays(x) * stays(y), count + 1));
    sum / count as f64
}
