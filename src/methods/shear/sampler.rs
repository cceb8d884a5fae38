//! At work on a scene: what each number of views needs, once, then pixels or the picture.

use super::bins::{Bins, bin_width_px};
use super::bokeh::Bokeh;
use super::canvas::{Barrel, Canvas, Shear};
use super::highlights::{self, Highlight, Occluders};
use super::paint::RowSums;
use super::prefilter;
use super::reach::Reach;
use super::resolve;
use super::runs::{self, Runs};
use super::saved::SavedColors;
use crate::image::{Image, Plane};
use crate::lens::{Field, View};
use crate::methods::contract::Plan;
use crate::methods::contract::{Progress, Sampler};
use crate::methods::shared::planes_from_rows;
use crate::scene::{EffectKind, Layer};
use pulp::Arch;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::f32::consts::PI;

/// Views fade in at the barrel over this share of the gap between them.
const RIM_SOFTNESS: f32 = 0.5;

/// The bins in which `views` views are painted.
pub(super) fn bins(plan: &Plan, views: usize) -> Bins {
    Bins::new(plan.coc_range_px, bin_width_px(views))
}

/// Over how many aperture radii each of `views` views fades in at the barrel.
pub(super) fn barrel_softness(views: usize) -> f32 {
    RIM_SOFTNESS * (PI / views as f32).sqrt()
}

/// The views of a set of colours, and the channels that they make: see [`crate::lens::Rays`].
pub(super) type ShearSet = (Vec<Shear>, &'static [usize]);

/// How far each of `count` views of each set of colours moves `bins`.
pub(super) fn shears(plan: &Plan, bins: &Bins, count: usize) -> Vec<ShearSet> {
    let shear = |view: &View| Shear::new(&View { jitter: view.jitter * plan.jitter, ..*view }, bins);
    let rays = plan.optics.rays(count);
    rays.sets().map(|(views, channels)| (views.iter().map(shear).collect(), channels)).collect()
}

/// What the stack has to paint, and what was made of it for the last number of views that was asked for.
#[derive(Debug)]
pub(super) struct ShearSampler<'p> {
    plan: &'p Plan,
    /// Width and height of the picture.
    size: (usize, usize),
    /// Where in the lens's field it lies.
    field: Field,
    /// What was taken out of the layers, to be drawn as discs.
    highlights: Vec<Highlight>,
    work: Work,
}

/// The layers to paint, at picture resolution.
#[derive(Debug)]
enum Work {
    Loaded(Vec<Layer>),
    /// With what they were before, so that they can be made ready for another number of views.
    Ready(Ready, SavedColors),
}

/// Everything that painting a number of views reads.
#[derive(Debug)]
struct Ready {
    views: usize,
    bins: Bins,
    runs: Runs,
    /// The views of each set of colours.
    shears: Vec<ShearSet>,
    /// The layers, prefiltered.
    layers: Vec<Layer>,
}

impl Ready {
    /// Gets `layers` ready for `views` views.
    fn new(layers: Vec<Layer>, plan: &Plan, views: usize) -> Self {
        let bins = bins(plan, views);
        let runs = runs::find(&layers, &bins);
        Self::with_runs(layers, (bins, runs), plan, views)
    }

    /// Ready for `views` views what was ready for some number of them, before which its colours were those `saved`.
    fn again(self, saved: &SavedColors, plan: &Plan, views: usize) -> Self {
        if self.views == views {
            return self;
        }
        let Self { views: before, mut layers, bins, runs, .. } = self;
        saved.restore(&mut layers);
        if bin_width_px(before) == bin_width_px(views) {
            Self::with_runs(layers, (bins, runs), plan, views)
        } else {
            Self::new(layers, plan, views)
        }
    }

    fn with_runs(mut layers: Vec<Layer>, (bins, runs): (Bins, Runs), plan: &Plan, count: usize) -> Self {
        if plan.does(EffectKind::Prefilter) {
            prefilter::smooth(&mut layers, count, plan.strength(EffectKind::Prefilter).unwrap_or(0.0));
        }
        let shears = shears(plan, &bins, count);
        Self { views: count, bins, runs, shears, layers }
    }

    fn canvas<'a>(&'a self, plan: &'a Plan, field: Field) -> Canvas<'a> {
        let Self { layers, runs, bins, .. } = self;
        let optics = &plan.optics;
        let softness = barrel_softness(self.views);
        let barrel = (optics.cats_eye > 0.0).then_some(Barrel { optics, field, softness });
        Canvas { layers, runs, bins, barrel, astray_px: optics.longest_shift_px() }
    }

    /// Paints all views: the picture, and for each pixel the share of rays that met something in focus.
    fn paint(
        &self,
        canvas: &Canvas<'_>,
        size: (usize, usize),
        open: bool,
        progress: &Progress<'_>,
    ) -> (Image, Plane) {
        let arch = Arch::new();
        let new_row = || RowSums::new(size.0);
        let [red, green, blue, alpha, focused_share] =
            planes_from_rows(size, progress, new_row, |sums, y, planes: &mut [_; 5]| {
                let bins = canvas.bins_in_reach(y);
                for (shears, channels) in &self.shears {
                    sums.clear();
                    add_row(sums, canvas, (y, &bins), shears, arch);
                    write_row(sums, channels, open, planes);
                }
            });
        (Image { planes: [red, green, blue, alpha] }, focused_share)
    }

    /// Paints all views of `pixels` alone, `y · width + x` each: what [`Ready::paint`] has there.
    fn paint_pixels(
        &self,
        canvas: &Canvas<'_>,
        (reach, width): (&Reach, usize),
        open: bool,
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
                let bins = reach.bins(canvas, y, &columns);
                let mut painted = vec![([0.0; 4], 0.0); columns.len()];
                for (shears, channels) in &self.shears {
                    sums.clear();
                    sums.add(canvas, (y, &bins), shears, arch);
                    for (&x, (color, focused_share)) in columns.iter().zip(&mut painted) {
                        let pixel = sums.pixel(x, open);
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
    fn draw(&self, image: &mut Image, highlights: &[Highlight], plan: &Plan, field: Field) {
        let Self { bins, runs, layers, .. } = self;
        let occluders = Occluders { width: image.width(), runs, bins, layers };
        highlights::draw(image, highlights, &Bokeh::new(&plan.optics, field, plan.fragment_px), &occluders);
    }
}

/// The channel of alpha.
const ALPHA: usize = 3;

/// Writes `channels` of a row to its planes; with alpha goes the share of rays that met something in focus.
fn write_row(sums: &RowSums, channels: &[usize], open: bool, planes: &mut [&mut [f32]; 5]) {
    let [red, green, blue, alpha, focused_share] = planes.each_mut().map(|plane| plane.iter_mut());
    let [has_red, has_green, has_blue] = [0, 1, 2].map(|channel| channels.contains(&channel));
    let pixels = red.zip(green).zip(blue).zip(alpha).zip(focused_share).enumerate();
    for (x, ((((red, green), blue), alpha), focused_share)) in pixels {
        let [r, g, b, a] = sums.pixel(x, open);
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

/// Adds the views `shears` to a row. What no view moves, every view sees alike: one says it all.
fn add_row(
    sums: &mut RowSums,
    canvas: &Canvas<'_>,
    (y, bins): (usize, &[u16]),
    shears: &[Shear],
    arch: Arch,
) {
    if shears.iter().all(|shear| shear.keeps_still(bins)) {
        sums.add(&Canvas { barrel: None, ..*canvas }, (y, bins), &shears[..1], arch);
    } else {
        sums.add(canvas, (y, bins), shears, arch);
    }
}

/// Pixels with their colours and the share of their rays that met something in focus.
type Painted = HashMap<usize, ([f32; 4], f32)>;

impl Sampler for ShearSampler<'_> {
    fn pixels(&mut self, views: usize, pixels: &[usize]) -> Vec<[f32; 4]> {
        let (ready, saved) = match std::mem::replace(&mut self.work, Work::Loaded(Vec::new())) {
            Work::Loaded(layers) => {
                let saved = SavedColors::of(&layers);
                (Ready::new(layers, self.plan, views), saved)
            }
            Work::Ready(ready, saved) => (ready.again(&saved, self.plan, views), saved),
        };
        let (width, height) = self.size;
        let open = self.plan.does(EffectKind::TransparentBackground);
        let weight = self.plan.strength(EffectKind::Resolve).unwrap_or(0.0);
        let reach = Reach::of(&ready.runs, &ready.bins, self.size);
        let canvas = ready.canvas(self.plan, self.field);
        let own = ready.paint_pixels(&canvas, (&reach, width), open, pixels.iter().copied());
        let softens = |pixel: usize| self.plan.does(EffectKind::Resolve) && own[&pixel].1 > 0.0;
        let softened = pixels.iter().copied().filter(|&pixel| softens(pixel));
        let beside = ready.paint_pixels(
            &canvas,
            (&reach, width),
            open,
            softened.flat_map(|pixel| neighbours(pixel, width, height)),
        );
        let discs = self.discs(&ready);
        let lit = |painted: &Painted, pixel: usize| {
            let ([r, g, b, a], _) = painted[&pixel];
            let light = |k: usize| discs.as_ref().map_or(0.0, |discs| discs.planes[k].values()[pixel]);
            [r + light(0), g + light(1), b + light(2), a]
        };
        let value = |&pixel: &usize| {
            let value = lit(&own, pixel);
            if !softens(pixel) {
                return value;
            }
            let (beside, share) =
                (neighbours(pixel, width, height).map(|pixel| lit(&beside, pixel)), own[&pixel].1);
            std::array::from_fn(|k| resolve::softened(value[k], beside.map(|near| near[k]), weight * share))
        };
        let values = pixels.iter().map(value).collect();
        self.work = Work::Ready(ready, saved);
        values
    }

    fn picture(self: Box<Self>, views: usize, progress: &Progress<'_>) -> Image {
        let Self { plan, size, field, highlights, work } = *self;
        let ready = match work {
            Work::Loaded(layers) => Ready::new(layers, plan, views),
            Work::Ready(ready, saved) => ready.again(&saved, plan, views),
        };
        let open = plan.does(EffectKind::TransparentBackground);
        let (mut image, focused_share) = ready.paint(&ready.canvas(plan, field), size, open, progress);
        ready.draw(&mut image, &highlights, plan, field);
        if plan.does(EffectKind::Resolve) {
            resolve::soften(&mut image, &focused_share, plan.strength(EffectKind::Resolve).unwrap_or(0.0));
        }
        image
    }
}

impl<'p> ShearSampler<'p> {
    /// At work on `layers`, which `highlights` were taken out of.
    pub(super) fn new(
        plan: &'p Plan,
        (size, field): ((usize, usize), Field),
        (layers, highlights): (Vec<Layer>, Vec<Highlight>),
    ) -> Self {
        Self { plan, size, field, highlights, work: Work::Loaded(layers) }
    }

    /// The discs of the highlights over nothing, if there are any.
    fn discs(&self, ready: &Ready) -> Option<Image> {
        if self.highlights.is_empty() {
            return None;
        }
        let mut discs = Image::from_fn(self.size.0, self.size.1, |_, _| [0.0; 4]);
        ready.draw(&mut discs, &self.highlights, self.plan, self.field);
        Some(discs)
    }
}

/// The pixels left, right, above and below, the border's its own neighbours.
fn neighbours(pixel: usize, width: usize, height: usize) -> [usize; 4] {
    let (x, y) = (pixel % width, pixel / width);
    let at = |x: usize, y: usize| y * width + x;
    [
        at(x.saturating_sub(1), y),
        at((x + 1).min(width - 1), y),
        at(x, y.saturating_sub(1)),
        at(x, (y + 1).min(height - 1)),
    ]
}
