//! Rendering of a scene: layers are prepared once for each number of views, then single pixels or the picture are painted.

use super::bins::{Bins, plateau_px};
use super::bokeh::Bokeh;
use super::canvas::{Barrel, BinsInReach, Canvas, Shear};
use super::highlights::{self, Highlight, Occluders};
use super::paint::RowSums;
use super::reach::Reach;
use super::resolve::Resolve;
use super::saved::SavedColors;
use super::spans::{self, Spans};
use super::{prefilter, prepare};
use crate::image::{Image, Plane, neighbours};
use crate::lens::{Field, Rays, View};
use crate::methods::contract::{LostRays, PixelFilter, Plan, Progress, Sampler};
use crate::methods::shared::planes_from_rows;
use crate::scene::{Background, EffectKind, Layer, Scene};
use pulp::Arch;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::f32::consts::PI;
use std::sync::Arc;

/// Width over which a view fades in at the barrel, as a share of the gap between views.
const BARREL_SOFTNESS: f32 = 0.5;

/// The bins in which `views` views are painted.
pub(super) fn bins(plan: &Plan, views: usize) -> Bins {
    Bins::new(plan.coc_range_px, plateau_px(views))
}

/// Width over which each of `views` views fades in at the barrel, in aperture radii.
pub(super) fn barrel_softness(views: usize) -> f32 {
    BARREL_SOFTNESS * (PI / views as f32).sqrt()
}

/// The views of a set of colours, and the channels that they render: see [`crate::lens::Rays`].
pub(super) type ShearSet = (Vec<Shear>, &'static [usize]);

/// How far each of `count` views of each set of colours moves `bins`, for rows in turns: row `y` has entry `y mod n` of the `n` entries.
pub(super) fn shears(plan: &Plan, bins: &Bins, count: usize) -> Vec<Vec<ShearSet>> {
    let shear = |view: &View| Shear::new(&View { jitter: view.jitter * plan.jitter, ..*view }, bins);
    let shears = |rays: &Rays| {
        rays.sets().map(|(views, channels)| (views.iter().map(shear).collect(), channels)).collect()
    };
    plan.optics.rays_in_turns(count).iter().map(shears).collect()
}

/// The layers and highlights of a scene, with the intermediate results for the last requested number of views.
#[derive(Debug)]
pub(super) struct ShearSampler<'p> {
    plan: &'p Plan,
    /// Width and height of the picture.
    size: (usize, usize),
    /// The picture's place in the lens's field.
    field: Field,
    /// The highlights removed from the layers, which are drawn as discs.
    highlights: Vec<Highlight>,
    /// The background, if the plan simulates it and any pixel shows it.
    background: Option<Arc<Background>>,
    /// The filter that ends the picture.
    resolve: Option<Resolve>,
    layers: PaintLayers,
}

/// The layers to paint, at picture resolution.
#[derive(Debug)]
enum PaintLayers {
    Unprepared(Vec<Layer>),
    /// With their original colours, from which they are prepared for another number of views.
    Prepared(Prepared, SavedColors),
}

/// Everything that painting `views` views reads.
#[derive(Debug)]
struct Prepared {
    views: usize,
    bins: Bins,
    spans: Spans,
    /// The views of each set of colours, for rows in turns.
    shears: Vec<Vec<ShearSet>>,
    /// The layers, prefiltered.
    layers: Vec<Layer>,
}

impl Prepared {
    /// Prepares `layers` for `views` views.
    fn new(layers: Vec<Layer>, plan: &Plan, views: usize) -> Self {
        let bins = bins(plan, views);
        let spans = spans::find(&layers, &bins);
        Self::with_spans(layers, (bins, spans), plan, views)
    }

    /// Prepares the layers for another number of views, from their original colours `saved`.
    fn for_views(self, saved: &SavedColors, plan: &Plan, views: usize) -> Self {
        if self.views == views {
            return self;
        }
        let Self { views: before, mut layers, bins, spans, .. } = self;
        saved.restore(&mut layers);
        if plateau_px(before) == plateau_px(views) {
            Self::with_spans(layers, (bins, spans), plan, views)
        } else {
            Self::new(layers, plan, views)
        }
    }

    fn with_spans(mut layers: Vec<Layer>, (bins, spans): (Bins, Spans), plan: &Plan, count: usize) -> Self {
        if plan.does(EffectKind::Prefilter) {
            prefilter::smooth(&mut layers, count, plan.strength(EffectKind::Prefilter).unwrap_or(0.0));
        }
        let shears = shears(plan, &bins, count);
        Self { views: count, bins, spans, shears, layers }
    }

    /// The views of each set of colours for row `y`.
    fn shears_of_row(&self, y: usize) -> &[ShearSet] {
        &self.shears[y % self.shears.len()]
    }

    fn canvas<'a>(&'a self, plan: &'a Plan, field: Field, background: Option<&'a Background>) -> Canvas<'a> {
        let Self { layers, spans, bins, .. } = self;
        let optics = &plan.optics;
        let softness = barrel_softness(self.views);
        let barrel = (optics.cats_eye > 0.0).then_some(Barrel { optics, field, softness });
        let aberration_px = optics.longest_shift_px();
        Canvas { layers, spans, bins, barrel, aberration_px, background, lost_rays: plan.lost_rays }
    }

    /// Paints all views. Returns the picture and, for each pixel, the share of rays that hit something in focus.
    fn paint(&self, canvas: &Canvas<'_>, size: (usize, usize), progress: &Progress<'_>) -> (Image, Plane) {
        let arch = Arch::new();
        let new_row = || RowSums::new(size.0);
        let [red, green, blue, alpha, focused_share] =
            planes_from_rows(size, progress, new_row, |sums, y, planes: &mut [_; 5]| {
                let in_reach = canvas.bins_in_reach(y);
                for (shears, channels) in self.shears_of_row(y) {
                    sums.clear();
                    add_row(sums, canvas, (y, &in_reach), shears, arch);
                    write_row(sums, channels, canvas.lost_rays, planes);
                }
            });
        (Image { planes: [red, green, blue, alpha] }, focused_share)
    }

    /// Paints all views of `pixels` only, `y · width + x` each. The values are those of [`Prepared::paint`].
    fn paint_pixels(
        &self,
        canvas: &Canvas<'_>,
        (reach, width): (&Reach, usize),
        pixels: impl Iterator<Item = usize>,
    ) -> Painted {
        let arch = Arch::new();
        let mut rows: BTreeMap<usize, BTreeSet<usize>> = BTreeMap::new();
        for pixel in pixels {
            rows.entry(pixel / width).or_default().insert(pixel % width);
        }
        let rows: Vec<(usize, Vec<usize>)> =
            rows.into_iter().map(|(y, columns)| (y, columns.into_iter().collect())).collect();
        rows.into_par_iter()
            .flat_map_iter(|(y, columns)| {
                let mut sums = RowSums::only(width, &columns);
                let in_reach = reach.bins(canvas, y, &columns);
                let mut painted = vec![([0.0; 4], 0.0); columns.len()];
                for (shears, channels) in self.shears_of_row(y) {
                    sums.clear();
                    sums.add(canvas, (y, &in_reach), shears, arch);
                    for (&x, (color, focused_share)) in columns.iter().zip(&mut painted) {
                        let pixel = sums.pixel(x, canvas.lost_rays);
                        channels.iter().for_each(|&channel| color[channel] = pixel[channel]);
                        if channels.contains(&ALPHA) {
                            *focused_share = sums.focused_share(x);
                        }
                    }
                }
                columns.into_iter().map(move |x| y * width + x).zip(painted)
            })
            .collect()
    }

    /// Adds the discs of `highlights` to `image`.
    fn draw_discs(&self, image: &mut Image, highlights: &[Highlight], plan: &Plan, field: Field) {
        let Self { bins, spans, layers, .. } = self;
        let occluders = Occluders { width: image.width(), spans, bins, layers };
        highlights::draw(image, highlights, &Bokeh::new(&plan.optics, field, plan.fragment_px), &occluders);
    }
}

/// The index of the alpha channel.
const ALPHA: usize = 3;

/// Writes `channels` of a row to its planes. Alpha and the share of rays that hit something in focus are those of green's views.
fn write_row(sums: &RowSums, channels: &[usize], lost_rays: LostRays, planes: &mut [&mut [f32]; 5]) {
    let [red, green, blue, alpha, focused_share] = planes.each_mut().map(|plane| plane.iter_mut());
    let [has_red, has_green, has_blue] = [0, 1, 2].map(|channel| channels.contains(&channel));
    let pixels = red.zip(green).zip(blue).zip(alpha).zip(focused_share).enumerate();
    for (x, ((((red, green), blue), alpha), focused_share)) in pixels {
        let [r, g, b, a] = sums.pixel(x, lost_rays);
        if has_red {
            *red = r;
        }
        if has_green {
            (*green, *alpha, *focused_share) = (g, a, sums.focused_share(x));
        }
        if has_blue {
            *blue = b;
        }
    }
}

/// Adds the views `shears` to a row. Where no view moves any of the bins `in_reach`, all views are equal, and only one is painted.
fn add_row(
    sums: &mut RowSums,
    canvas: &Canvas<'_>,
    (y, in_reach): (usize, &BinsInReach),
    shears: &[Shear],
    arch: Arch,
) {
    if shears.iter().all(|shear| shear.is_identity(in_reach)) {
        sums.add(&Canvas { barrel: None, ..*canvas }, (y, in_reach), &shears[..1], arch);
    } else {
        sums.add(canvas, (y, in_reach), shears, arch);
    }
}

/// For each pixel its colour and the share of its rays that hit something in focus.
type Painted = HashMap<usize, ([f32; 4], f32)>;

impl Sampler for ShearSampler<'_> {
    fn pixels(&mut self, views: usize, pixels: &[usize]) -> Vec<[f32; 4]> {
        let (prepared, saved) = match std::mem::replace(&mut self.layers, PaintLayers::Unprepared(Vec::new()))
        {
            PaintLayers::Unprepared(layers) => {
                let saved = SavedColors::from_layers(&layers);
                (Prepared::new(layers, self.plan, views), saved)
            }
            PaintLayers::Prepared(prepared, saved) => (prepared.for_views(&saved, self.plan, views), saved),
        };
        let width = self.size.0;
        let reach = Reach::from_spans(&prepared.spans, &prepared.bins, self.size);
        let canvas = prepared.canvas(self.plan, self.field, self.background.as_deref());
        let own = prepared.paint_pixels(&canvas, (&reach, width), pixels.iter().copied());
        let filter = |pixel: usize| self.resolve.as_ref().filter(|_| own[&pixel].1 > 0.0);
        let resolved = pixels.iter().copied().filter(|&pixel| filter(pixel).is_some());
        let around = prepared.paint_pixels(
            &canvas,
            (&reach, width),
            resolved.flat_map(|pixel| neighbours(pixel, self.size)),
        );
        let value = |&pixel: &usize| {
            let (value, share) = own[&pixel];
            filter(pixel).map_or(value, |resolve| {
                let around = neighbours(pixel, self.size).map(|near| around[&near].0);
                resolve.filtered(pixel, share, value, around)
            })
        };
        let values = pixels.iter().map(value).collect();
        self.layers = PaintLayers::Prepared(prepared, saved);
        values
    }

    fn picture(self: Box<Self>, views: usize, progress: &Progress<'_>) -> Image {
        let Self { plan, size, field, highlights, background, resolve, layers } = *self;
        let prepared = match layers {
            PaintLayers::Unprepared(layers) => Prepared::new(layers, plan, views),
            PaintLayers::Prepared(prepared, saved) => prepared.for_views(&saved, plan, views),
        };
        let canvas = prepared.canvas(plan, field, background.as_deref());
        let (mut image, focused_share) = prepared.paint(&canvas, size, progress);
        prepared.draw_discs(&mut image, &highlights, plan, field);
        if let Some(resolve) = resolve {
            resolve.soften(&mut image, &focused_share);
        }
        image
    }
}

impl<'p> ShearSampler<'p> {
    /// A sampler of `scene` by `plan`.
    pub(super) fn new(scene: Scene, plan: &'p Plan) -> Self {
        let (size, field, background) = (scene.picture_size(), scene.field, plan.background(&scene));
        let resolve = Resolve::new(plan, &scene);
        let (layers, highlights) = prepare::layers(scene, plan);
        Self { plan, size, field, highlights, background, resolve, layers: PaintLayers::Unprepared(layers) }
    }
}

/// The discs of the highlights of `scene` by `plan` on a transparent picture; `None` without highlights.
pub(super) fn discs(scene: Scene, plan: &Plan) -> Option<Image> {
    let ((width, height), field) = (scene.picture_size(), scene.field);
    let (layers, highlights) = prepare::layers(scene, plan);
    if highlights.is_empty() {
        return None;
    }
    let mut discs = Image::transparent(width, height);
    Prepared::new(layers, plan, plan.lens_samples()).draw_discs(&mut discs, &highlights, plan, field);
    Some(discs)
}
