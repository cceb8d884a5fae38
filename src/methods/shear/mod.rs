//! `shear`: the default method. The stack in slices of equal CoC radius, sheared for each lens sample.
//!
//! In `(x, y, c)` space a lens ray is straight, so all fragments of one CoC radius, seen from lens point `u`, are their own
//! image shifted by `−c·u`. The picture is the mean over `N` views `(u, j)`, lens point and place in the pixel, of the first
//! fragment each ray meets. That is what casting `N` rays a pixel gives, visibility correlated over the lens included, at
//! the price of about one masked add for each visible pixel and view. It converges to [`super::accumulate`].
//!
//! Passes, each a function of its own:
//!
//! | pass | module | does |
//! | --- | --- | --- |
//! | highlights | [`highlights`] | takes bright points out, to be drawn as exact discs |
//! | merge | [`Scene::merged`] | samples of a supersampled stack → coverage peels |
//! | fill | [`fill`] | a guessed surface where the stack has none |
//! | bins, runs | [`bins`], [`runs`] | stretches of fragments that move together |
//! | prefilter | [`prefilter`] | closes the gaps between lens samples |
//! | paint | [`mod@paint`] | the views |
//! | draw | [`highlights`] | the discs |
//! | resolve | [`resolve`] | anti-aliasing in focus |
//!
//! Cost: rows × views × (bins + pixels). Memory: the scene, in which it works, the runs, and the picture. Limits: knows only what the
//! peels know; content past the frame is its border repeated.

mod bins;
mod fill;
mod highlights;
mod paint;
mod prefilter;
mod resolve;
mod runs;

use super::{Deviation, Law, Method, MethodInfo, Progress, planes_from_rows};
use crate::error::Error;
use crate::image::{Image, Plane};
use crate::lens::{View, views};
use crate::scene::{EffectKind, Layer, Plan, Scene};
use crate::settings::MethodParameters;
use bins::Bins;
use highlights::{Bokeh, Highlight, Occluders};
use paint::{Canvas, RowSums};
use pulp::Arch;

/// Width of the bins near focus, in picture pixels, for few views and for many: narrower shows only when noise is low.
const BIN_WIDTH_PX: [f32; 2] = [0.5, 0.25];

/// From this number of views on, bins are narrow.
const MANY_VIEWS: usize = 128;

/// Ours.
#[derive(Debug)]
pub(super) struct Shear;

impl Method for Shear {
    fn info(&self) -> MethodInfo {
        MethodInfo {
            name: "shear",
            source: "this project",
            role: "default",
            summary: "slices of equal blur, sheared for each lens sample and painted front to back",
            effects: &[
                EffectKind::Merge,
                EffectKind::Highlights,
                EffectKind::Fill,
                EffectKind::Prefilter,
                EffectKind::Resolve,
            ],
            steps: &["16", "64", "256"],
            deviations: &[Deviation {
                law: Law::NoCracksAcrossCorners,
                within: [0.0, 0.02],
                reason: "from bin to bin a view may move across the corner of a sample, where a ray passes its sides",
            }],
        }
    }

    fn lens_samples(&self, parameters: &MethodParameters) -> Option<usize> {
        Some(parameters.shear.views)
    }

    fn blur(&self, scene: Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let views = plan.lens_samples();
        let size = scene.picture_size();
        let (mut layers, highlights) = load(scene, plan);
        let bins = Bins::new(plan.coc_range_px, BIN_WIDTH_PX[usize::from(views >= MANY_VIEWS)]);
        let runs = runs::find(&layers, &bins);
        if plan.does(EffectKind::Prefilter) {
            prefilter::smooth(&mut layers, views, plan.parameters.shear.prefilter);
        }
        let canvas = Canvas { layers: &layers, runs: &runs, bins: &bins };
        let (mut image, focused_share) = paint(&canvas, size, plan, progress);
        let occluders = Occluders { width: image.width(), runs: &runs, bins: &bins, layers: &layers };
        let bokeh = Bokeh::new(plan.aperture, plan.fragment_px);
        highlights::draw(&mut image, &highlights, &bokeh, &occluders);
        if plan.does(EffectKind::Resolve) {
            resolve::soften(&mut image, &focused_share, plan.parameters.shear.resolve);
        }
        Ok(image)
    }
}

/// The layers to paint, at picture resolution, and the highlights taken out of them.
fn load(mut scene: Scene, plan: &Plan) -> (Vec<Layer>, Vec<Highlight>) {
    let highlights = if plan.does(EffectKind::Highlights) {
        highlights::extract(&mut scene.layers, plan, scene.supersample)
    } else {
        Vec::new()
    };
    let mut layers = scene.merged().layers;
    if plan.does(EffectKind::Fill) {
        layers.extend(fill::guess(&layers));
    }
    (layers, highlights)
}

/// Paints all views of `plan`: the picture, and for each pixel the share of rays that met something in focus.
fn paint(canvas: &Canvas<'_>, size: (usize, usize), plan: &Plan, progress: &Progress<'_>) -> (Image, Plane) {
    let shears: Vec<_> = views(plan.lens_samples(), plan.aperture)
        .into_iter()
        .map(|view| paint::Shear::new(&View { jitter: view.jitter * plan.jitter, ..view }, canvas.bins))
        .collect();
    let open = plan.does(EffectKind::OpenBackground);
    let arch = Arch::new();
    let new_row = || RowSums::new(size.0);
    let [red, green, blue, alpha, focused_share] =
        planes_from_rows(size, progress, new_row, |sums, y, planes: &mut [_; 5]| {
            sums.clear();
            sums.add(canvas, y, &shears, arch);
            for x in 0..size.0 {
                let [r, g, b, a] = sums.pixel(x, open);
                for (plane, value) in planes.iter_mut().zip([r, g, b, a, sums.focused_share(x)]) {
                    plane[x] = value;
                }
            }
        });
    (Image { planes: [red, green, blue, alpha] }, focused_share)
}
