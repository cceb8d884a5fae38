//! Rendering of a scene: layers are prepared once for each number of views, then single pixels or the picture are painted.

use super::bins::{Bins, plateau_px};
use super::canvas::{Barrel, BinsInReach, Canvas, Shear};
use super::highlights::{self, Highlight};
use super::keys::Extent;
use super::lanes::LANES;
use super::mirrors::Mirrors;
use super::picture::{self, NearFilter};
use super::prefilter;
use super::prepare::{self, Painted};
use super::reach::Reach;
use super::resolve::Resolve;
use super::row_sums::{RowSums, blended};
use super::row_views::{Painting, RowViews};
use super::saved::SavedColors;
use super::shown::Shown;
use super::spans::{self, Spans};
use super::sums::FOCUSED;
use crate::image::{Image, Plane, neighbours};
use crate::lens::Field;
use crate::methods::contract::{PixelFilter, Plan, Progress, Sampler};
use crate::parallel;
use crate::scene::{Antialiasing, Background, EffectKind, Layer, Scene};
use pulp::Arch;
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

/// What a picture is made of beside its layers.
#[derive(Debug, Clone)]
pub(super) struct Frame<'p> {
    pub(super) plan: &'p Plan,
    /// Width and height of the picture.
    pub(super) size: (usize, usize),
    /// The picture's place in the lens's field.
    pub(super) field: Field,
    /// The background, if the plan simulates it and any pixel shows it.
    pub(super) background: Option<Arc<Background>>,
    /// Where colours are averages over the pixel.
    pub(super) antialiasing: Antialiasing,
    /// The filter that ends the picture.
    pub(super) resolve: Option<Resolve>,
}

impl<'p> Frame<'p> {
    /// The frame of the picture of `scene` by `plan`.
    pub(super) fn new(scene: &Scene, plan: &'p Plan) -> Self {
        Self {
            plan,
            size: scene.picture_size(),
            field: scene.field,
            background: plan.background(scene),
            antialiasing: scene.antialiasing.clone(),
            resolve: Resolve::new(plan, scene),
        }
    }
}

/// The layers and highlights of a scene, with the intermediate results for the last requested number of views.
#[derive(Debug)]
pub(super) struct ShearSampler<'p> {
    frame: Frame<'p>,
    /// The highlights removed from the layers, which are drawn as discs.
    highlights: Vec<Highlight>,
    /// The reflections removed from the layers.
    mirrors: Option<Mirrors>,
    layers: PaintLayers,
}

/// The layers to paint, at picture resolution.
#[derive(Debug)]
enum PaintLayers {
    Unprepared(Vec<Layer>),
    /// With their original colours, from which they are prepared for another number of views.
    Prepared(Box<Prepared>, SavedColors),
}

/// Everything that painting `views` views reads.
#[derive(Debug)]
struct Prepared {
    views: usize,
    bins: Bins,
    spans: Spans,
    row_views: RowViews,
    /// The layers, prefiltered.
    layers: Vec<Layer>,
    /// The reflections removed from them, smoothed.
    mirrors: Option<Mirrors>,
    /// What [`Prepared::paint`] has painted, if single pixels were asked for that need their surroundings.
    whole: Option<(Image, Plane)>,
}

impl Prepared {
    /// Prepares `layers` for `views` views.
    fn new(source: (Vec<Layer>, &Option<Mirrors>), frame: &Frame<'_>, views: usize) -> Self {
        let bins = bins(frame.plan, views);
        let shown = Shown::new(&source.0, &bins);
        let spans = spans::find(&source.0, &bins, Extent::HalfWay, &shown);
        Self::with_spans(source, (bins, spans), frame, views)
    }

    /// Prepares the layers for another number of views, from their original colours `saved`.
    fn for_views(
        self,
        (saved, mirrors): (&SavedColors, &Option<Mirrors>),
        frame: &Frame<'_>,
        views: usize,
    ) -> Self {
        if self.views == views {
            return self;
        }
        let Self { views: before, mut layers, bins, spans, .. } = self;
        saved.restore(&mut layers);
        if plateau_px(before) == plateau_px(views) {
            Self::with_spans((layers, mirrors), (bins, spans), frame, views)
        } else {
            Self::new((layers, mirrors), frame, views)
        }
    }

    fn with_spans(
        (mut layers, mirrors): (Vec<Layer>, &Option<Mirrors>),
        (bins, spans): (Bins, Spans),
        frame: &Frame<'_>,
        views: usize,
    ) -> Self {
        let plan = frame.plan;
        let mut mirrors = mirrors.clone();
        if plan.does(EffectKind::Prefilter) {
            let strength = plan.strength(EffectKind::Prefilter).unwrap_or(0.0);
            prefilter::smooth(&mut layers, views, strength);
            mirrors = mirrors.map(|mirrors| mirrors.smoothed(views, strength));
        }
        let row_views = RowViews::new(plan, &frame.antialiasing, &bins, views);
        Self { views, bins, spans, row_views, layers, mirrors, whole: None }
    }

    fn canvas<'a>(&'a self, frame: &'a Frame<'_>) -> Canvas<'a> {
        let Self { layers, spans, bins, .. } = self;
        let mirrors = self.mirrors.as_ref();
        let (optics, lost_rays) = (&frame.plan.optics, frame.plan.lost_rays);
        let (softness, field) = (barrel_softness(self.views), frame.field);
        let barrel = (optics.cats_eye > 0.0).then_some(Barrel { optics, field, softness });
        let (aberration_px, background) = (optics.longest_shift_px(), frame.background.as_deref());
        Canvas { layers, spans, bins, mirrors, barrel, aberration_px, background, lost_rays }
    }

    /// Paints all views, in the memory of `spare` planes as far as there are any. Returns the picture with smooth near light and, for each
    /// pixel, the share of rays that hit something in focus.
    fn paint(&self, frame: &Frame<'_>, spare: Vec<Plane>, progress: &Progress<'_>) -> (Image, Plane) {
        let (canvas, arch) = (self.canvas(frame), Arch::new());
        let near = NearFilter::new(frame.plan, &self.bins, self.views);
        let new_row = || RowSums::new(frame.size.0, near.is_some());
        let planes = picture::planes(frame.size, spare);
        picture::painted(planes, near.as_ref(), progress, &new_row, &|sums, y, planes| {
            let in_reach = canvas.bins_in_reach(y);
            for painting in self.row_views.of_row(y) {
                sums.paint_only(|x| painting.is_visible(x));
                let Painting { sets, weights, .. } = painting;
                for (shears, channels) in sets {
                    sums.clear();
                    add_row(sums, &canvas, (y, &in_reach), shears, arch);
                    sums.write((channels, weights), canvas.lost_rays, planes, arch);
                }
            }
        })
    }

    /// The values of `pixels`, `y · width + x` each, of [`Prepared::paint`].
    ///
    /// Smooth near light needs a pixel's surroundings, and those of a few hundred pixels are much of the picture: there all of it is painted,
    /// and kept.
    fn values_of(&mut self, frame: &Frame<'_>, pixels: impl Iterator<Item = usize>) -> Values {
        if NearFilter::new(frame.plan, &self.bins, self.views).is_none() {
            let reach = Reach::from_spans(&self.spans, &self.bins, frame.size);
            return self.paint_pixels(&self.canvas(frame), (&reach, frame.size.0), pixels);
        }
        let (image, focused_share) = match self.whole.take() {
            Some(whole) => whole,
            None => self.paint(frame, Vec::new(), &|_| {}),
        };
        let value = |pixel: usize| {
            let [r, g, b, a] = image.planes.each_ref().map(|plane| plane.values()[pixel]);
            (pixel, [r, g, b, a, focused_share.values()[pixel]])
        };
        let values = pixels.map(value).collect();
        self.whole = Some((image, focused_share));
        values
    }

    /// Paints all views of `pixels` only, `y · width + x` each. The values are those of [`Prepared::paint`] before near light is smoothed.
    fn paint_pixels(
        &self,
        canvas: &Canvas<'_>,
        (reach, width): (&Reach, usize),
        pixels: impl Iterator<Item = usize>,
    ) -> Values {
        let arch = Arch::new();
        let mut rows: BTreeMap<usize, BTreeSet<usize>> = BTreeMap::new();
        for pixel in pixels {
            rows.entry(pixel / width).or_default().insert(pixel % width);
        }
        let rows: Vec<(usize, Vec<usize>)> =
            rows.into_iter().map(|(y, columns)| (y, columns.into_iter().collect())).collect();
        let painted_row = |row: usize| {
            let (y, columns) = &rows[row];
            let mut sums = RowSums::only(width, columns);
            let in_reach = reach.bins(canvas, *y, columns);
            let mut painted = vec![[0.0; 5]; columns.len()];
            for Painting { sets, weights, .. } in self.row_views.of_row(*y) {
                for (shears, channels) in sets {
                    sums.clear();
                    sums.add(canvas, (*y, &in_reach), shears, arch);
                    for (&x, values) in columns.iter().zip(&mut painted) {
                        let weight = weights.map_or(1.0, |weights| weights[x]);
                        let found = sums.means(x / LANES, canvas.lost_rays);
                        picture::written(channels, false).for_each(|(k, mean)| {
                            values[k] = blended(values[k], found[mean].0[x % LANES], weight);
                        });
                    }
                }
            }
            columns.iter().map(|x| y * width + x).zip(painted).collect()
        };
        parallel::flat_map(rows.len(), &painted_row).into_iter().collect()
    }

    /// Takes the planes that only discs and reflections need, and painting does not: CoC radii, and alpha where all that there is is opaque.
    fn take_unpainted(&mut self) -> Vec<Plane> {
        let Self { layers, spans, .. } = self;
        let unpainted = layers.iter_mut().enumerate().flat_map(|(number, Layer { alpha, coc_px, .. })| {
            let alpha = (!spans.has_translucent(number)).then_some(alpha);
            std::iter::once(coc_px).chain(alpha)
        });
        unpainted.map(std::mem::take).collect()
    }

    /// Adds the discs of `highlights` to `image`.
    fn draw_discs(&self, image: &mut Image, highlights: &[Highlight], frame: &Frame<'_>) {
        highlights::draw(image, highlights, (frame.plan, frame.field), (&self.layers, &self.bins));
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
    // A mirror shows each view something else, also where it stays in its place.
    if canvas.mirrors.is_none() && shears.iter().all(|shear| shear.is_identity(in_reach)) {
        sums.add(&Canvas { barrel: None, ..*canvas }, (y, in_reach), &shears[..1], arch);
    } else {
        sums.add(canvas, (y, in_reach), shears, arch);
    }
}

/// For each pixel its values, in the order of [`super::sums::Means`].
type Values = HashMap<usize, [f32; 5]>;

impl Sampler for ShearSampler<'_> {
    fn pixels(&mut self, views: usize, pixels: &[usize]) -> Vec<[f32; 4]> {
        let (frame, mirrors) = (&self.frame, &self.mirrors);
        let (mut prepared, saved) =
            match std::mem::replace(&mut self.layers, PaintLayers::Unprepared(Vec::new())) {
                PaintLayers::Unprepared(layers) => {
                    let saved = SavedColors::from_layers(&layers);
                    (Box::new(Prepared::new((layers, mirrors), frame, views)), saved)
                }
                PaintLayers::Prepared(prepared, saved) => {
                    (Box::new(prepared.for_views((&saved, mirrors), frame, views)), saved)
                }
            };
        let own = prepared.values_of(frame, pixels.iter().copied());
        let filter = |pixel: usize| frame.resolve.as_ref().filter(|_| own[&pixel][FOCUSED] > 0.0);
        let resolved = pixels.iter().copied().filter(|&pixel| filter(pixel).is_some());
        let around = prepared.values_of(frame, resolved.flat_map(|pixel| neighbours(pixel, frame.size)));
        let color = |[r, g, b, a, _]: [f32; 5]| [r, g, b, a];
        let value = |&pixel: &usize| {
            let values = own[&pixel];
            filter(pixel).map_or(color(values), |resolve| {
                let around = neighbours(pixel, frame.size).map(|near| color(around[&near]));
                resolve.filtered(pixel, values[FOCUSED], color(values), around)
            })
        };
        let values = pixels.iter().map(value).collect();
        self.layers = PaintLayers::Prepared(prepared, saved);
        values
    }

    fn picture(self: Box<Self>, views: usize, progress: &Progress<'_>) -> Image {
        let Self { frame, highlights, mirrors, layers } = *self;
        let mut prepared = match layers {
            PaintLayers::Unprepared(layers) => Prepared::new((layers, &mirrors), &frame, views),
            PaintLayers::Prepared(prepared, saved) => prepared.for_views((&saved, &mirrors), &frame, views),
        };
        let whole = prepared.whole.take();
        let (mut image, focused_share) = whole.unwrap_or_else(|| {
            let needed = !highlights.is_empty() || mirrors.is_some();
            let spare = if needed { Vec::new() } else { prepared.take_unpainted() };
            prepared.paint(&frame, spare, progress)
        });
        prepared.draw_discs(&mut image, &highlights, &frame);
        let soften = || {
            if let Some(resolve) = &frame.resolve {
                resolve.soften(&mut image, focused_share);
            }
        };
        // Giving much memory back takes a while.
        rayon::join(|| drop(prepared), soften);
        image
    }
}

impl<'p> ShearSampler<'p> {
    /// A sampler of `scene` by `plan`.
    pub(super) fn new(scene: Scene, plan: &'p Plan) -> Self {
        let frame = Frame::new(&scene, plan);
        let Painted { layers, highlights, mirrors } = prepare::painted(scene, plan);
        Self { frame, highlights, mirrors, layers: PaintLayers::Unprepared(layers) }
    }
}

/// The discs of the highlights of `scene` by `plan` on a transparent picture; `None` without highlights.
pub(super) fn discs(scene: Scene, plan: &Plan) -> Option<Image> {
    let frame = Frame::new(&scene, plan);
    let Painted { layers, highlights, .. } = prepare::painted(scene, plan);
    if highlights.is_empty() {
        return None;
    }
    let mut discs = Image::transparent(frame.size.0, frame.size.1);
    Prepared::new((layers, &None), &frame, plan.lens_samples()).draw_discs(&mut discs, &highlights, &frame);
    Some(discs)
}
