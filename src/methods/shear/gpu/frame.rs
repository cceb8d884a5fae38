//! A scene to be rendered on a GPU: the tables that the CPU computes once, and the limits that follow from the GPU's memory.

use super::kernels::{LIST_ENTRIES, PLANES, Params, SUMS, TEXEL_BYTES};
use crate::gpu::Gpu;
use crate::methods::contract::Plan;
use crate::methods::shear::bins::Bins;
use crate::methods::shear::keys::{Key, Keys};
use crate::methods::shear::prefilter;
use crate::methods::shear::sampler::{ShearSet, barrel_softness, bins, shears};
use crate::scene::{EffectKind, Layer, Scene};
use std::ops::Range;

/// Bytes of a fragment: its colour and its key.
const FRAGMENT_BYTES: usize = TEXEL_BYTES + size_of::<Key>();

/// Bytes of a pixel: sums, the picture and its readback, the lists of its tile, and two layers in upload.
const PIXEL_BYTES: usize = size_of::<f32>() * (2 * PLANES + SUMS) + 16 + 40;

/// A scene to be rendered on a GPU.
pub(super) struct Frame<'a> {
    pub(super) gpu: &'a Gpu,
    pub(super) plan: &'a Plan,
    /// The layers to paint, at picture resolution.
    pub(super) layers: &'a [Layer],
    /// Width and height of the picture.
    pub(super) size: (usize, usize),
    /// Number of views of each set of colours.
    pub(super) views: usize,
    pub(super) bins: Bins,
    pub(super) keys: Keys<'a>,
    /// The views of each set of colours.
    pub(super) sets: Vec<ShearSet>,
    /// Radius of the prefilter's box per pixel of CoC radius, if the plan has a prefilter.
    pub(super) radius_per_coc: Option<f32>,
    /// The shader's parameters for one band that is the whole picture.
    pub(super) params: Params,
}

impl<'a> Frame<'a> {
    /// The frame of `layers`, which are those of `scene` after the passes before painting.
    pub(super) fn new(gpu: &'a Gpu, scene: &Scene, layers: &'a [Layer], plan: &'a Plan) -> Self {
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

    /// Largest distance in rows between a pixel and the fragments that it depends on.
    pub(super) fn reach(&self) -> usize {
        let coc = self.bins.centers_px().iter().fold(0.0, |max: f32, coc| max.max(coc.abs()));
        let filtered = prefilter::REACH_RADII * self.radius_per_coc.unwrap_or(0.0) * coc;
        // 0.5: half a pixel of jitter.
        (coc + self.plan.optics.longest_shift_px() + filtered + 0.5).ceil() as usize + 1
    }

    /// The largest number of rows that fits into the GPU's memory and limits.
    pub(super) fn max_rows(&self) -> usize {
        let (width, layers) = (self.size.0, self.layers.len());
        let largest = width * TEXEL_BYTES.max(SUMS * size_of::<f32>());
        let all = width * (FRAGMENT_BYTES * layers + PIXEL_BYTES);
        let rows = |bytes: u64, row_bytes: usize| bytes as usize / row_bytes;
        rows(self.gpu.max_binding_bytes(), largest)
            .min(rows(self.gpu.max_working_bytes(), all))
            .min(self.gpu.max_texels())
    }
}

/// The shader's parameters for one band that is the whole picture.
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
        entries: LIST_ENTRIES as u32,
        focused_start: focused.start as u32,
        focused_end: focused.end as u32,
        views: views as u32,
        batch_views: 0,
        transparent_background: u32::from(plan.does(EffectKind::TransparentBackground)),
        channels: 0,
        cats_eye: optics.cats_eye,
        axis_x_px: field.axis_px.x,
        axis_y_px: field.axis_px.y,
        half_diagonal_px: field.half_diagonal_px,
        softness: barrel_softness(views),
    }
}

/// The bins that count as in focus. They are consecutive, because bins are sorted by CoC radius.
fn focused_bins(sets: &[ShearSet]) -> Range<usize> {
    let shifts = sets.first().and_then(|(shears, _)| shears.first()).map_or(&[][..], |shear| &shear.shifts);
    let first = shifts.iter().position(|shift| shift.focused).unwrap_or(0);
    first..shifts.iter().rposition(|shift| shift.focused).map_or(first, |last| last + 1)
}
