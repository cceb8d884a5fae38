//! The input of painting, and how far each view moves it.

use super::bins::Bins;
use super::resolve;
use super::spans::Spans;
use crate::lens::{Field, Optics, View};
use crate::scene::Layer;
use glam::Vec2;
use std::ops::Range;

/// What the painter reads.
#[derive(Debug, Clone, Copy)]
pub(super) struct Canvas<'a> {
    /// The layers, nearest first.
    pub(super) layers: &'a [Layer],
    /// The spans of the layers.
    pub(super) spans: &'a Spans,
    /// The bins of the spans.
    pub(super) bins: &'a Bins,
    /// The barrel, if it hides views.
    pub(super) barrel: Option<Barrel<'a>>,
    /// The largest distance by which aberrations move a view, in picture pixels.
    pub(super) aberration_px: f32,
}

/// The barrel of a lens, which hides some lens points from some pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Barrel<'a> {
    pub(super) optics: &'a Optics,
    pub(super) field: Field,
    /// Width over which a view fades in at the barrel, in aperture radii. With few views a hard edge would show as steps.
    pub(super) softness: f32,
}

impl Barrel<'_> {
    /// The columns of row `y` from which the view through `lens` passes at least in part, and those from which it passes in full.
    pub(super) fn columns(&self, lens: Vec2, y: usize) -> [Range<i32>; 2] {
        [-0.5, 0.5].map(|within| self.optics.columns(lens, y, &self.field, within * self.softness))
    }

    /// Share of the view through `lens` that the barrel lets pass to pixel `x, y`.
    pub(super) fn passing(&self, lens: Vec2, x: usize, y: usize) -> f32 {
        let height = self.field.height(Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
        (self.optics.within_barrel(lens, height) / self.softness + 0.5).clamp(0.0, 1.0)
    }
}

impl Canvas<'_> {
    /// The bins that some view can move to output row `y`, nearest first.
    pub(super) fn bins_in_reach(&self, y: usize) -> Vec<u16> {
        let in_reach = |(bin, coc): (usize, &f32)| {
            let reach = (coc.abs() + self.aberration_px).ceil() as i32 + 1;
            self.spans.occurs(bin, y as i32 - reach..=y as i32 + reach).then_some(bin as u16)
        };
        self.bins.centers_px().iter().enumerate().filter_map(in_reach).collect()
    }
}

/// How far a view moves a bin.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shift {
    /// Source row minus output row.
    pub(super) rows: i32,
    /// Source column minus output column.
    pub(super) columns: i32,
    /// Whether the bin counts as in focus.
    pub(super) focused: bool,
}

/// One view: how far it moves each bin, the same for every row.
#[derive(Debug)]
pub(super) struct Shear {
    /// The lens point.
    pub(super) lens: Vec2,
    /// The shift of each bin.
    pub(super) shifts: Vec<Shift>,
}

impl Shear {
    /// The shifts of `view` for `bins`.
    pub(super) fn new(view: &View, bins: &Bins) -> Self {
        // Ties round up, so that half a pixel gives the same shift on every machine.
        let rounded = |value: f32| (value + 0.5).floor() as i32;
        let offset = view.jitter + view.shift;
        let shift = |&coc: &f32| Shift {
            rows: rounded(coc * view.lens.y + offset.y),
            columns: rounded(coc * view.lens.x + offset.x),
            focused: resolve::focus(coc) > 0.0,
        };
        Self { lens: view.lens, shifts: bins.centers_px().iter().map(shift).collect() }
    }

    /// Whether the view moves none of `bins`.
    pub(super) fn is_identity(&self, bins: &[u16]) -> bool {
        let moves = |shift: &Shift| shift.rows != 0 || shift.columns != 0;
        !bins.iter().any(|&bin| moves(&self.shifts[bin as usize]))
    }
}
