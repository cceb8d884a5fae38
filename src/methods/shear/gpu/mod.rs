//! `shear` on a GPU: `shaders/methods/shear.wgsl`.
//!
//! What is done once a fragment, whatever the number of views, the CPU does as for itself, with its rows in hand on their way up: bins,
//! keys, the prefilter. So it does the shifts of views, and it draws the few discs of highlights while the GPU paints. Bands ([`band`])
//! read as far as views and the prefilter reach.
//!
//! Memory: 18 bytes a fragment, 100 a pixel.

mod band;

use super::bins::Bins;
use super::bokeh::Bokeh;
use super::highlights::{self, Highlight, Occluders};
use super::keys::{BIN_SHIFT, EXTRA, EXTRA_SHIFT, Key, Keys, NO_KEY, OPAQUE};
use super::paint::{MIN_HIT, STOPPED_BELOW};
use super::prefilter;
use super::resolve;
use super::runs;
use super::sampler::{ShearSet, barrel_softness, bins, shears};
use crate::error::Error;
use crate::gpu::{Constant, Gpu, Mirrored, Shader, bands, mirrored};
use crate::image::{Image, Plane};
use crate::methods::contract::Plan;
use crate::methods::contract::{GpuBackend, Progress};
use crate::scene::{EffectKind, Layer, OPAQUE_ALPHA, Scene};
use band::BandWork;
use std::borrow::Cow;
use std::ops::Range;

static SHADER: Shader = Shader {
    name: "shear",
    constants: &[
        ("OPAQUE_ALPHA", Constant::Float(OPAQUE_ALPHA)),
        ("STOPPED_BELOW", Constant::Float(STOPPED_BELOW)),
        ("MIN_HIT", Constant::Float(MIN_HIT)),
        ("BIN_SHIFT", Constant::Uint(BIN_SHIFT)),
        ("EXTRA_SHIFT", Constant::Uint(EXTRA_SHIFT)),
        ("EXTRA", Constant::Uint(EXTRA as u32)),
        ("OPAQUE", Constant::Uint(OPAQUE as u32)),
        ("NO_KEY", Constant::Uint(NO_KEY as u32)),
        ("TILE", Constant::Uint(TILE as u32)),
        ("BLOCK", Constant::Uint(BLOCK as u32)),
        ("SQUARE", Constant::Uint(SQUARE as u32)),
    ],
    parts: &[
        include_str!("../../../../shaders/methods/shear.wgsl"),
        include_str!("../../../../shaders/methods/shear_lists.wgsl"),
    ],
    structs: &[Params::LAYOUT],
};

/// Sides of the shader's tiles and blocks.
const TILE: usize = 16;
const BLOCK: usize = 4;

/// Entries that lists of groups have room for at first: most often one or two are needed, but they are made again where one list is longer.
const ENTRIES: usize = 16;

/// Tiles along one of the shader's squares.
const SQUARE: usize = 4;

/// Bytes of a colour.
const TEXEL: usize = size_of::<[f32; 4]>();

/// Layers whose keys share a texel.
const LAYERS_PER_TEXEL: usize = 4;

/// Planes of a picture in the making: red, green, blue, alpha, and the share of rays that met something in focus.
const PLANES: usize = 5;

/// Planes of sums: colour, what of it was in focus, what was missed, what was hidden.
const SUMS: usize = 6;

/// Bytes of a fragment in colours and keys; of a pixel in sums, the picture and its readback, the lists of its tile, and two layers that
/// are on their way.
const FRAGMENT_BYTES: usize = TEXEL + size_of::<Key>();
const PIXEL_BYTES: usize = size_of::<f32>() * (2 * PLANES + SUMS) + 16 + 40;

mirrored! {
    /// What all kernels read: see the shader.
    struct Params {
        width: u32,
        height: u32,
        source_start: u32,
        source_rows: u32,
        band_start: u32,
        band_rows: u32,
        layers: u32,
        bins: u32,
        words: u32,
        entries: u32,
        focused_start: u32,
        focused_end: u32,
        views: u32,
        views_in_go: u32,
        transparent_background: u32,
        channels: u32,
        cats_eye: f32,
        axis_x_px: f32,
        axis_y_px: f32,
        half_diagonal_px: f32,
        softness: f32,
    }
}

/// `shear` on a GPU.
#[derive(Debug)]
pub(super) struct ShearGpu;

impl GpuBackend for ShearGpu {
    fn blur(&self, gpu: &Gpu, scene: &Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let (layers, highlights) = load(scene, plan);
        let work = Work::new(gpu, scene, &layers, plan);
        let (painted, discs) = rayon::join(|| work.paint(progress), || work.discs(scene, &highlights));
        let (mut image, focused_share) = painted?;
        if let Some(discs) = discs {
            add_light(&mut image, &discs);
        }
        if plan.does(EffectKind::Resolve) {
            resolve::soften(&mut image, &focused_share, plan.strength(EffectKind::Resolve).unwrap_or(0.0));
        }
        Ok(image)
    }

    fn shader(&self) -> &'static Shader {
        &SHADER
    }
}

/// [`super::load`], of a scene that stays as it is.
fn load<'a>(scene: &'a Scene, plan: &Plan) -> (Cow<'a, [Layer]>, Vec<Highlight>) {
    let changes = plan.does(EffectKind::Highlights) || plan.does(EffectKind::Fill) || scene.supersample > 1;
    if !changes {
        return (Cow::Borrowed(&scene.layers), Vec::new());
    }
    let (layers, highlights) = super::load(scene.clone(), plan);
    (Cow::Owned(layers), highlights)
}

fn add_light(image: &mut Image, light: &Image) {
    for (plane, light) in image.planes.iter_mut().zip(&light.planes).take(3) {
        plane.values_mut().iter_mut().zip(light.values()).for_each(|(value, light)| *value += light);
    }
}

/// A scene on its way through a GPU.
struct Work<'a> {
    gpu: &'a Gpu,
    plan: &'a Plan,
    layers: &'a [Layer],
    size: (usize, usize),
    views: usize,
    bins: Bins,
    keys: Keys<'a>,
    sets: Vec<ShearSet>,
    /// Radius of the prefilter's box, for each pixel of CoC radius, if there is one.
    radius_per_coc: Option<f32>,
    /// Of the whole picture.
    params: Params,
}

impl<'a> Work<'a> {
    fn new(gpu: &'a Gpu, scene: &Scene, layers: &'a [Layer], plan: &'a Plan) -> Self {
        let (size, views) = (scene.picture_size(), plan.lens_samples());
        let bins = bins(plan, views);
        let sets = shears(plan, &bins, views);
        let params = params(scene, layers.len(), plan, (&bins, &sets));
        let strength = plan.strength(EffectKind::Prefilter).unwrap_or(0.0);
        let radius_per_coc =
            plan.does(EffectKind::Prefilter).then(|| prefilter::radius_per_coc(views, strength));
        let keys = Keys::new(layers, &bins);
        Self { gpu, plan, layers, size, views, bins, keys, sets, radius_per_coc, params }
    }

    /// How many rows away what a pixel shows may lie.
    fn reach(&self) -> usize {
        let coc = self.bins.centers_px().iter().fold(0.0, |most: f32, coc| most.max(coc.abs()));
        let smoothed = prefilter::REACH_RADII * self.radius_per_coc.unwrap_or(0.0) * coc;
        // Half a pixel of jitter.
        (coc + self.plan.optics.longest_shift_px() + smoothed + 0.5).ceil() as usize + 1
    }

    /// Rows that can be read at once.
    fn max_rows(&self) -> usize {
        let (width, layers) = (self.size.0, self.layers.len());
        let largest = width * TEXEL.max(SUMS * size_of::<f32>());
        let together = width * (FRAGMENT_BYTES * layers + PIXEL_BYTES);
        let rows = |bytes: u64, of_a_row: usize| bytes as usize / of_a_row;
        rows(self.gpu.max_binding_bytes(), largest)
            .min(rows(self.gpu.max_working_bytes(), together))
            .min(self.gpu.max_texels())
    }

    fn paint(&self, progress: &Progress<'_>) -> Result<(Image, Plane), Error> {
        let (width, height) = self.size;
        let mut planes: [Plane; PLANES] = std::array::from_fn(|_| Plane::zeros(width, height));
        let bands = bands(height, self.reach(), self.max_rows())?;
        for (i, band) in bands.iter().enumerate() {
            let share = |done: f32| progress((i as f32 + done) / bands.len() as f32);
            let picture = BandWork::new(self, band)?.picture(&share)?;
            let values = band.rows.start * width..band.rows.end * width;
            let mut parts = planes.each_mut().map(|plane| &mut plane.values_mut()[values.clone()]);
            self.gpu.read_into(&picture, &mut parts)?;
        }
        let [red, green, blue, alpha, focused_share] = planes;
        Ok((Image { planes: [red, green, blue, alpha] }, focused_share))
    }

    /// The discs of `highlights` over nothing, if there are any.
    fn discs(&self, scene: &Scene, highlights: &[Highlight]) -> Option<Image> {
        if highlights.is_empty() {
            return None;
        }
        let (bins, layers, (width, height)) = (&self.bins, self.layers, self.size);
        let runs = runs::find(layers, bins);
        let mut discs = Image::from_fn(width, height, |_, _| [0.0; 4]);
        let bokeh = Bokeh::new(&self.plan.optics, scene.field, self.plan.fragment_px);
        highlights::draw(&mut discs, highlights, &bokeh, &Occluders { width, runs: &runs, bins, layers });
        Some(discs)
    }
}

/// What is the same for all bands.
fn params(scene: &Scene, layers: usize, plan: &Plan, (bins, sets): (&Bins, &[ShearSet])) -> Params {
    let (width, height) = scene.picture_size();
    let views = plan.lens_samples();
    let focused = focused_bins(sets);
    let (field, optics) = (&scene.field, &plan.optics);
    Params {
        width: width as u32,
        height: height as u32,
        source_start: 0,
        source_rows: height as u32,
        band_start: 0,
        band_rows: height as u32,
        layers: layers as u32,
        bins: bins.count() as u32,
        words: bins.count().div_ceil(32) as u32,
        entries: ENTRIES as u32,
        focused_start: focused.start as u32,
        focused_end: focused.end as u32,
        views: views as u32,
        views_in_go: 0,
        transparent_background: u32::from(plan.does(EffectKind::TransparentBackground)),
        channels: 0,
        cats_eye: optics.cats_eye,
        axis_x_px: field.axis_px.x,
        axis_y_px: field.axis_px.y,
        half_diagonal_px: field.half_diagonal_px,
        softness: barrel_softness(views),
    }
}

/// The bins that count as in focus: neighbours, since bins rise.
fn focused_bins(sets: &[ShearSet]) -> Range<usize> {
    let shifts = sets.first().and_then(|(shears, _)| shears.first()).map_or(&[][..], |shear| &shear.shifts);
    let first = shifts.iter().position(|shift| shift.focused).unwrap_or(0);
    first..shifts.iter().rposition(|shift| shift.focused).map_or(first, |last| last + 1)
}
