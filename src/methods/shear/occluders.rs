//! What lies in front of a light, row by row of its disc.
//!
//! The ray from picture point `p` to `q` on the light passes CoC radius `c_k` at `s = p (1 − f) + q f`, `f = c_k / c_q`. This is affine in
//! `p`, so that a span of fragments is projected to a span of the disc's row. A row looks once for the spans that reach it, seen from the
//! rectangle that holds all of the light, and each part of the light then chooses among these alone.

use super::bins::Bins;
use super::hidden::{Affine, Hidden};
use super::keys::Extent;
use super::shown::Shown;
use super::spans::{self, Span, Spans};
use crate::scene::Layer;
use glam::Vec2;
use std::ops::Range;

/// Fragments nearer than a light by less than the first belong to its own surface, and those nearer by more than the second to others, in
/// picture pixels and as a share of the light's CoC radius: whichever is more.
const OWN_SURFACE: [(f32, f32); 2] = [(0.25, 0.03), (0.75, 0.06)];

/// Share of a fragment with the CoC radius `occluder_px` that hides a light with `coc_px`: what is not of its own surface.
pub(super) fn share_that_hides(coc_px: f32, occluder_px: f32) -> f32 {
    let [own_px, other_px] = OWN_SURFACE.map(|(least_px, share)| f32::max(least_px, share * coc_px.abs()));
    ((coc_px - occluder_px - own_px) / (other_px - own_px)).clamp(0.0, 1.0)
}

/// Share of a fragment with the CoC radius `occluder_px` that hides all of the light behind it at the same place with `coc_px`: a ray passes it
/// at nearly the place of the light, if it is little nearer.
pub(super) fn share_that_covers(coc_px: f32, occluder_px: f32) -> f32 {
    /// Difference in CoC radius from which on it covers nothing, relative to the one from which on [`share_that_hides`] is all.
    const NONE_FROM: f32 = 1.25;
    let other_px = f32::max(OWN_SURFACE[1].0, OWN_SURFACE[1].1 * coc_px.abs());
    ((NONE_FROM * other_px - (coc_px - occluder_px)) / ((NONE_FROM - 1.0) * other_px)).clamp(0.0, 1.0)
}

/// The scene in front of lights.
#[derive(Debug)]
pub(super) struct Occluders<'a> {
    /// Width of the picture.
    width: usize,
    /// The spans of all layers, by [`Extent::Occluder`].
    spans: Spans,
    /// The bins of the spans.
    bins: &'a Bins,
    /// The layers.
    layers: &'a [Layer],
}

/// Some columns of a row of a light's disc, and the light: in picture pixels.
#[derive(Debug, Clone)]
pub(super) struct DiscRow {
    /// The row.
    pub(super) y: usize,
    /// The columns; not empty.
    pub(super) columns: Range<usize>,
    /// CoC radius of the light without axial colour.
    pub(super) coc_px: f32,
    /// CoC radius of the disc.
    pub(super) disc_px: f32,
    /// What axial colour adds to every CoC radius.
    pub(super) axial_px: f32,
}

/// A span that may hide a part of a light from a row of its disc.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate<'a> {
    span: &'a Span,
    /// Row of the span.
    row: usize,
    /// Share of the way from the picture to the light at which a ray passes it.
    f: f32,
    /// How far it hides: [`share_that_hides`].
    share: f32,
}

impl<'a> Occluders<'a> {
    /// The occluders in `layers`, whose CoC radii `bins` cover.
    pub(super) fn new(layers: &'a [Layer], bins: &'a Bins) -> Self {
        let width = layers.first().map_or(0, Layer::width);
        Self { width, spans: spans::find(layers, bins, Extent::Occluder, &Shown::all(layers)), bins, layers }
    }

    /// Replaces `found` by the spans that may hide from `disc_row` what lies between the corners `light` of a rectangle, in picture pixels.
    pub(super) fn search<'s>(&'s self, disc_row: &DiscRow, light: [Vec2; 2], found: &mut Vec<Candidate<'s>>) {
        found.clear();
        for (bin, &bin_px) in self.bins.centers_px().iter().enumerate() {
            let share = share_that_hides(disc_row.coc_px, bin_px);
            if share <= 0.0 {
                break;
            }
            let f = (bin_px + disc_row.axial_px) / disc_row.disc_px;
            let [one, other] = light.map(|corner| self.row_passed(disc_row.y, corner.y, f));
            let maps = light.map(|corner| map(corner.x, f));
            for row in one.min(other)..=one.max(other) {
                let spans = self.spans.of_block(row, bin).iter();
                let reaches = |span: &&Span| disc_row.is_reached(self.columns_of(span), maps);
                found.extend(spans.filter(reaches).map(|span| Candidate { span, row, f, share }));
            }
        }
    }

    /// Adds to `hidden` what `candidates` hide of a part of a light at `position` from row `y` of its disc.
    pub(super) fn hide(
        &self,
        candidates: &[Candidate<'_>],
        (position, y): (Vec2, usize),
        hidden: &mut Hidden,
    ) {
        for &Candidate { span, row, f, share } in candidates {
            if self.row_passed(y, position.y, f) == row {
                let alpha = (!span.opaque).then(|| self.layers[span.layer as usize].alpha.row(row));
                hidden.add(span, (self.columns_of(span), map(position.x, f)), (share, alpha));
            }
        }
    }

    /// The row that a ray from row `y` of the picture to a light in row `light_y` passes at the share `f` of its way.
    fn row_passed(&self, y: usize, light_y: f32, f: f32) -> usize {
        let row = ((y as f32) * (1.0 - f) + light_y * f + 0.5).floor();
        row.clamp(0.0, self.spans.height() as f32 - 1.0) as usize
    }

    /// The columns that `span` covers; a span that ends at the picture's border is unbounded there.
    fn columns_of(&self, span: &Span) -> [f32; 2] {
        let start = if span.start == 0 { f32::NEG_INFINITY } else { span.start as f32 - 0.5 };
        let end = if span.end as usize == self.width { f32::INFINITY } else { span.end as f32 - 0.5 };
        [start, end]
    }
}

/// The projection of columns passed at the share `f` of the way, seen from a light in column `light_x`.
fn map(light_x: f32, f: f32) -> Affine {
    Affine { offset: -light_x * f / (1.0 - f), scale: 1.0 / (1.0 - f) }
}

impl DiscRow {
    /// Whether the occluder's columns `ends`, projected by any map between `maps`, reach these columns.
    fn is_reached(&self, ends: [f32; 2], maps: [Affine; 2]) -> bool {
        let [a, b] = maps.map(|map| ends.map(|s| map.offset + map.scale * s));
        let (from, to) = [a, b]
            .as_flattened()
            .iter()
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(from, to), &end| (from.min(end), to.max(end)));
        to >= self.columns.start as f32 - 0.5 && from <= self.columns.end as f32 - 0.5
    }
}
