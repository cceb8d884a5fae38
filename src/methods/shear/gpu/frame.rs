//! A scene to be rendered on a GPU: the tables that the CPU computes once, and the limits that follow from the GPU's memory.

use super::kernels::{LIST_ENTRIES, NEAR_SUMS, Params, SUMS, TEXEL_BYTES};
use crate::error::Error;
use crate::gpu::{Buffer, Gpu};
use crate::methods::contract::{LostRays, Plan};
use crate::methods::shared::{ReflectingBuffers, has_translucent};
use crate::methods::shear::bins::{Bins, LEVELS, MAX_BINS};
use crate::methods::shear::keys::{Extent, Key, Keys};
use crate::methods::shear::mirrors::Mirrors;
use crate::methods::shear::picture::{NearFilter, PLANES};
use crate::methods::shear::row_views::RowViews;
use crate::methods::shear::sampler::{self, barrel_softness, bins};
use crate::methods::shear::shown::Shown;
use crate::methods::shear::{near, prefilter, resolve};
use crate::scene::{Background, EffectKind, Layer, Scene};
use std::ops::Range;

/// Bytes of a fragment: its colour and its key.
const FRAGMENT_BYTES: usize = TEXEL_BYTES + size_of::<Key>();

/// Bytes of a pixel beside its sums, the picture and its readback: what the pixel shows beside its fragments, the lists of its tile, and two
/// layers in upload.
const PIXEL_BYTES: usize = TEXEL_BYTES + 64 + 40;

/// A scene to be rendered on a GPU.
pub(super) struct Frame<'a> {
    pub(super) gpu: &'a Gpu,
    /// What the picture is made of beside its layers.
    pub(super) picture: sampler::Frame<'a>,
    /// The layers to paint, at picture resolution.
    pub(super) layers: &'a [Layer],
    /// Whether some fragment is translucent.
    pub(super) translucent: bool,
    /// Number of views of each set of colours.
    pub(super) views: usize,
    pub(super) bins: Bins,
    pub(super) keys: Keys<'a>,
    pub(super) row_views: RowViews,
    /// Radius of the prefilter's box per pixel of CoC radius, if the plan has a prefilter.
    pub(super) radius_per_coc: Option<f32>,
    /// The filter of near light, if there is any.
    pub(super) near: Option<NearFilter>,
    /// The shader's parameters for one band that is the whole picture.
    pub(super) params: Params,
    /// What its mirrors show.
    pub(super) reflecting: ReflectingBuffers,
    /// For each fragment how much of a ray sees light that moves, and its CoC radius; one entry without mirrors.
    pub(super) mirror_weights: Buffer,
}

impl<'a> Frame<'a> {
    /// The frame of `layers`, which are those of `scene` after the passes before painting.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Device`] if there are translucent fragments in more layers than a ray can remember.
    pub(super) fn new(
        gpu: &'a Gpu,
        scene: &Scene,
        (layers, mirrors): (&'a [Layer], Option<Mirrors>),
        plan: &'a Plan,
    ) -> Result<Self, Error> {
        let views = plan.lens_samples();
        let translucent = has_translucent(layers)?;
        let picture = sampler::Frame::new(scene, plan);
        let bins = bins(plan, views);
        let strength = plan.strength(EffectKind::Prefilter).unwrap_or(0.0);
        let radius_per_coc =
            plan.does(EffectKind::Prefilter).then(|| prefilter::radius_per_coc(views, strength));
        let mirrors = mirrors.map(|mirrors| match radius_per_coc {
            Some(_) => mirrors.smoothed(views, strength),
            None => mirrors,
        });
        let reflecting = ReflectingBuffers::new(gpu, mirrors.as_ref().map(Mirrors::reflected))?;
        let mirror_weights = gpu.upload("weights of mirrors", &mirror_weights(layers, mirrors.as_ref()))?;
        let row_views = RowViews::new(plan, &picture.antialiasing, &bins, views);
        let keys = Keys::new(layers, &bins, (Extent::HalfWay, &Shown::all(layers)), 0..picture.size.1);
        let params = params(&picture, layers.len(), &bins, views);
        let near = NearFilter::new(plan, &bins, views);
        Ok(Self {
            gpu,
            picture,
            layers,
            translucent,
            views,
            bins,
            keys,
            row_views,
            radius_per_coc,
            near,
            params,
            reflecting,
            mirror_weights,
        })
    }

    /// Largest distance in rows between a pixel and what it depends on.
    pub(super) fn reach(&self) -> usize {
        let fragments_px = self.bins.centers_px().iter().fold(0.0, |max: f32, coc| max.max(coc.abs()));
        let filtered_px =
            fragments_px + prefilter::REACH_RADII * self.radius_per_coc.unwrap_or(0.0) * fragments_px;
        let infinity_px = self.picture.background.as_deref().map_or(0.0, Background::coc_infinity_px).abs();
        // 0.5: half a pixel of jitter.
        let reach_px = filtered_px.max(infinity_px) + self.picture.plan.optics.longest_shift_px() + 0.5;
        reach_px.ceil() as usize + 1
    }

    /// Number of planes of the unfinished picture: those of [`crate::methods::shear::picture::smoothed`].
    pub(super) fn planes(&self) -> usize {
        PLANES + self.near.map_or(0, |near| near.planes())
    }

    /// Number of planes of sums.
    pub(super) fn sums(&self) -> usize {
        if self.near.is_some() { SUMS + NEAR_SUMS } else { SUMS }
    }

    /// The largest number of rows that fits into the GPU's memory and limits.
    pub(super) fn max_rows(&self) -> usize {
        let (width, layers) = (self.picture.size.0, self.layers.len());
        let largest = width * TEXEL_BYTES.max(self.planes().max(self.sums()) * size_of::<f32>());
        let planes = size_of::<f32>() * (2 * self.planes() + self.sums());
        let all = width * (FRAGMENT_BYTES * layers + PIXEL_BYTES + planes);
        let rows = |bytes: u64, row_bytes: usize| bytes as usize / row_bytes;
        rows(self.gpu.max_binding_bytes(), largest)
            .min(rows(self.gpu.max_working_bytes(), all))
            .min(self.gpu.max_texels())
    }

    /// For each bin how far it counts as in focus, or its negative CoC radius where it counts as near, as bits, and the nearest bin that may
    /// hold an earlier hit of the same translucent surface.
    pub(super) fn bin_table(&self) -> Vec<[u32; 2]> {
        let centers_px = self.bins.centers_px().iter().enumerate();
        let bins = centers_px.map(|(bin, &coc_px)| {
            let value = if near::share(coc_px) > 0.0 { coc_px } else { resolve::focus(coc_px) };
            [value.to_bits(), u32::from(self.bins.same_hit_from(bin))]
        });
        let mut table: Vec<[u32; 2]> = bins.collect();
        table.resize(MAX_BINS, [0; 2]);
        table
    }

    /// Fills `texels` with what the pixels of row `y` show beside their fragments, in the layout of the shader's `pixels`.
    pub(super) fn pixel_row(&self, y: usize, texels: &mut [[f32; 4]]) {
        let (background, antialiasing) = (self.picture.background.as_deref(), &self.picture.antialiasing);
        for (x, texel) in texels.iter_mut().enumerate() {
            let [share, beside, last_coc_px] = background.map_or([0.0; 3], |background| {
                [background.share(), background.beside(), background.last_coc_px()]
                    .map(|plane| plane.get(x, y))
            });
            *texel = [share, last_coc_px, antialiasing.at(x, y), beside];
        }
    }

    /// Whether pixels differ in what they show beside their fragments.
    pub(super) fn has_pixels(&self) -> bool {
        self.picture.background.is_some() || self.picture.antialiasing.plane().is_some()
    }
}

/// For each fragment of `layers` how much of a ray sees light that moves, and its CoC radius.
fn mirror_weights(layers: &[Layer], mirrors: Option<&Mirrors>) -> Vec<[f32; 2]> {
    let Some(mirrors) = mirrors else { return vec![[0.0; 2]] };
    let of_layer = |(number, layer): (usize, &Layer)| -> Vec<[f32; 2]> {
        let coc_px = layer.coc_px.values().iter();
        match mirrors.weights(number) {
            Some(weights) => {
                weights.values().iter().copied().zip(coc_px.copied()).map(<[f32; 2]>::from).collect()
            }
            None => vec![[0.0; 2]; coc_px.len()],
        }
    };
    layers.iter().enumerate().flat_map(of_layer).collect()
}

/// The shader's parameters for one band that is the whole picture.
fn params(picture: &sampler::Frame<'_>, layers: usize, bins: &Bins, views: usize) -> Params {
    let (width, height) = picture.size;
    let focused = focused_bins(bins);
    let (field, optics) = (&picture.field, &picture.plan.optics);
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
        near_end: bins.centers_px().partition_point(|&coc_px| near::share(coc_px) > 0.0) as u32,
        near_pairs_from: near_level_from(bins, 1) as u32,
        near_fours_from: near_level_from(bins, 2) as u32,
        near_eights_from: near_level_from(bins, 3) as u32,
        near_sixteens_from: near_level_from(bins, 4) as u32,
        views: views as u32,
        batch_views: 0,
        turns: 0,
        lost_are_black: u32::from(picture.plan.lost_rays == LostRays::Black),
        channels: 0,
        blends: 0,
        near_share_plane: 0,
        cats_eye: optics.cats_eye,
        axis_x_px: field.axis_px.x,
        axis_y_px: field.axis_px.y,
        half_diagonal_px: field.half_diagonal_px,
        softness: barrel_softness(views),
    }
}

/// The bins that count as in focus, at least in part. They are consecutive, because bins are sorted by CoC radius.
fn focused_bins(bins: &Bins) -> Range<usize> {
    let is_focused = |&coc_px: &f32| resolve::focus(coc_px) > 0.0;
    let first = bins.centers_px().iter().position(is_focused).unwrap_or(0);
    first..bins.centers_px().iter().rposition(is_focused).map_or(first, |last| last + 1)
}

/// The first bin from which on, up to focus, there are blocks of level `level`: bins become narrower towards focus.
fn near_level_from(bins: &Bins, level: usize) -> usize {
    let mut largest_blocks = (0..bins.count()).step_by(1 << (LEVELS - 1));
    largest_blocks.find(|&first| bins.highest_level(first) >= level).unwrap_or(bins.count())
}
