//! What is painted, and how far each view moves it.

use super::bins::Bins;
use super::runs::Runs;
use crate::lens::{Field, Optics, View};
use crate::scene::Layer;
use glam::Vec2;
use std::ops::Range;

/// A fragment with a smaller CoC radius counts as in focus, in picture pixels.
const FOCUSED_BELOW_PX: f32 = 1.01;

/// What the painter reads.
#[derive(Debug, Clone, Copy)]
pub(super) struct Canvas<'a> {
    /// The layers, nearest first.
    pub(super) layers: &'a [Layer],
    /// Their runs.
    pub(super) runs: &'a Runs,
    /// The bins of the runs.
    pub(super) bins: &'a Bins,
    /// What cuts views off.
    pub(super) barrel: Option<Barrel<'a>>,
    /// How far aberrations move a view, at most.
    pub(super) astray_px: f32,
}

/// The barrel of a lens, which hides some lens points from some places of the picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Barrel<'a> {
    pub(super) optics: &'a Optics,
    pub(super) field: Field,
    /// Over how many aperture radii a view fades in at the barrel: where few views come and go, steps would show.
    pub(super) softness: f32,
}

impl Barrel<'_> {
    /// The columns of row `y` from which any of the view through `lens` passes, and those from which all of it does.
    pub(super) fn columns(&self, lens: Vec2, y: usize) -> [Range<i32>; 2] {
        [-0.5, 0.5].map(|within| self.optics.columns(lens, y, &self.field, within * self.softness))
    }

    /// How much of the view through `lens` passes, seen from pixel `x, y`.
    pub(super) fn passing(&self, lens: Vec2, x: usize, y: usize) -> f32 {
        let height = self.field.height(Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
        (self.optics.within_barrel(lens, height) / self.softness + 0.5).clamp(0.0, 1.0)
    }
}

impl Canvas<'_> {
    /// The bins that any view can bring to output row `y`, nearest first.
    pub(super) fn bins_in_reach(&self, y: usize) -> Vec<u16> {
        let in_reach = |(bin, coc): (usize, &f32)| {
            let reach = (coc.abs() + self.astray_px).ceil() as i32 + 1;
            self.runs.occurs(bin, y as i32 - reach..=y as i32 + reach).then_some(bin as u16)
        };
        self.bins.centers_px().iter().enumerate().filter_map(in_reach).collect()
    }
}

/// How far a view moves a bin.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shift {
    /// Source row less output row.
    pub(super) rows: i32,
    /// Source column less output column.
    pub(super) columns: i32,
    /// Whether the bin counts as in focus.
    pub(super) focused: bool,
}

/// One view: how far it moves each bin, the same for every row.
#[derive(Debug)]
pub(super) struct Shear {
    /// Point on the lens.
    pub(super) lens: Vec2,
    /// For each bin.
    pub(super) shifts: Vec<Shift>,
}

impl Shear {
    /// The shifts of `view` for `bins`.
    pub(super) fn new(view: &View, bins: &Bins) -> Self {
        // Ties round up: half a pixel is the same way on every machine.
        let rounded = |value: f32| (value + 0.5).floor() as i32;
        let place = view.jitter + view.shift;
        let shift = |&coc: &f32| Shift {
            rows: rounded(coc * view.lens.y + place.y),
            columns: rounded(coc * view.lens.x + place.x),
            focused: coc.abs() < FOCUSED_BELOW_PX,
        };
        Self { lens: view.lens, shifts: bins.centers_px().iter().map(shift).collect() }
    }

    /// Whether it moves none of `bins`.
    pub(super) fn keeps_still(&self, bins: &[u16]) -> bool {
        let moves = |shift: &Shift| shift.rows != 0 || shift.columns != 0;
        !bins.iter().any(|&bin| moves(&self.shifts[bin as usize]))
    }
}
