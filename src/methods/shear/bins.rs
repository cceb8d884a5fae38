//! Bins of CoC radius: the slices in which the scene is sheared.
//!
//! All fragments of a bin move alike, by its centre's CoC radius, so a bin's width is an error in the radius. Bins are
//! [`FOCUS_WIDTH_PX`] wide up to [`FOCUS_PX`], where the picture follows the radius closest, then widen by [`GROWTH`] of what the radius
//! exceeds that by up to a plateau, and beyond `plateau / SHARE` are a [`SHARE`] of the radius wide. They are anchored at `c = 0`, so that
//! they do not move when the CoC range changes from frame to frame.

use crate::scene::surface::SAME_HIT_PX;

/// Width of the bins near focus, in picture pixels.
const FOCUS_WIDTH_PX: f32 = 1.0 / 16.0;

/// CoC radius up to which bins have that width, in picture pixels.
const FOCUS_PX: f32 = 3.0;

/// Growth of a bin's width with its radius beyond that.
const GROWTH: f32 = 1.0 / 8.0;

/// Width of the plateau, in picture pixels, for few and for many views. Narrower bins are visible only at low noise.
const PLATEAU_PX: [f32; 2] = [0.5, 0.25];

/// The smallest number of views with the narrower plateau.
const MANY_VIEWS: usize = 128;

/// Width of wide bins as a share of their radius.
const SHARE: f32 = 1.0 / 32.0;

/// Width of the plateau for `views` views, in picture pixels.
pub(super) fn plateau_px(views: usize) -> f32 {
    PLATEAU_PX[usize::from(views >= MANY_VIEWS)]
}

/// The bin index of a sample without a fragment.
pub(super) const EMPTY: u16 = u16::MAX;

/// Largest number of bins a range may have: a bin's index has twelve bits where rays remember it.
pub(super) const MAX_BINS: usize = 1 << 12;

/// The scale of bins with a plateau: a strictly rising function of the CoC radius, on which bin `b` covers `b − ½ … b + ½`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Scale {
    plateau_px: f32,
    /// Radius and position at the end of the narrow bins, at the start of the plateau and at its end.
    ends: [[f32; 2]; 3],
}

impl Scale {
    fn new(plateau_px: f32) -> Self {
        let narrow = [FOCUS_PX, FOCUS_PX / FOCUS_WIDTH_PX];
        let plateau = [
            FOCUS_PX + (plateau_px - FOCUS_WIDTH_PX) / GROWTH,
            narrow[1] + (plateau_px / FOCUS_WIDTH_PX).ln() / GROWTH,
        ];
        let wide_px = (plateau_px / SHARE).max(plateau[0]);
        let wide = [wide_px, plateau[1] + (wide_px - plateau[0]) / plateau_px];
        Self { plateau_px, ends: [narrow, plateau, wide] }
    }

    /// The position of CoC radius `c`.
    fn position(&self, c: f32) -> f32 {
        let [narrow, plateau, wide] = self.ends;
        let size = c.abs();
        let position = if size <= narrow[0] {
            size / FOCUS_WIDTH_PX
        } else if size <= plateau[0] {
            narrow[1] + (1.0 + (size - narrow[0]) * GROWTH / FOCUS_WIDTH_PX).ln() / GROWTH
        } else if size <= wide[0] {
            plateau[1] + (size - plateau[0]) / self.plateau_px
        } else {
            wide[1] + (size / wide[0]).ln() / SHARE
        };
        position.copysign(c)
    }

    /// The CoC radius at `position`: the inverse of [`Scale::position`].
    fn radius(&self, position: f32) -> f32 {
        let [narrow, plateau, wide] = self.ends;
        let steps = position.abs();
        let size = if steps <= narrow[1] {
            steps * FOCUS_WIDTH_PX
        } else if steps <= plateau[1] {
            narrow[0] + FOCUS_WIDTH_PX * (((steps - narrow[1]) * GROWTH).exp() - 1.0) / GROWTH
        } else if steps <= wide[1] {
            plateau[0] + (steps - plateau[1]) * self.plateau_px
        } else {
            wide[0] * ((steps - wide[1]) * SHARE).exp()
        };
        size.copysign(position)
    }
}

/// Cells per pixel up to [`FINE_PX`] and beyond it. A cell is at most half as wide as the narrowest bin there, so that it holds at most one
/// bin's end and one comparison finds a bin.
const CELLS_PER_PX: [f32; 2] = [32.0, 8.0];

/// CoC radius up to which cells are fine, in picture pixels.
const FINE_PX: f32 = 4.0;

/// The position of CoC radius `c` on a scale of cells.
fn cell_position(c: f32) -> f32 {
    let size = c.abs();
    (size.min(FINE_PX) * CELLS_PER_PX[0] + (size - FINE_PX).max(0.0) * CELLS_PER_PX[1]).copysign(c)
}

/// The bins of a range of CoC radii, numbered from the nearest.
#[derive(Debug, Clone)]
pub(super) struct Bins {
    /// CoC radius at the centre of each bin.
    centers_px: Vec<f32>,
    /// CoC radius where each bin ends; infinite for the last one.
    ends_px: Vec<f32>,
    /// For each bin the nearest bin that may hold an earlier hit of the same translucent surface: see [`SAME_HIT_PX`].
    same_hit_from: Vec<u16>,
    /// For each cell of [`cell_position`] from the range's start on, the bin in which the cell begins.
    first_in_cell: Vec<u16>,
    /// Position of the range's start.
    start: f32,
}

impl Bins {
    /// The bins that cover `range_px`, with this plateau.
    ///
    /// # Panics
    /// If there are more than [`MAX_BINS`], which the limit of CoC radii excludes ([`crate::scene::coc_limit_px`]).
    pub(super) fn new(range_px: [f32; 2], plateau_px: f32) -> Self {
        let scale = Scale::new(plateau_px);
        let [first, last] = range_px.map(|c| (scale.position(c) + 0.5).floor() as i32);
        let centers_px: Vec<f32> = (first..=last).map(|b| scale.radius(b as f32)).collect();
        assert!(centers_px.len() <= MAX_BINS, "CoC radii {range_px:?} make {} bins", centers_px.len());
        let ends_px: Vec<f32> = (first..=last)
            .map(|b| if b == last { f32::INFINITY } else { scale.radius(b as f32 + 0.5) })
            .collect();
        let same_hit_from = (0..centers_px.len())
            .map(|bin| {
                // By a bin's width more, so that wide bins always include the one before.
                let before = bin.saturating_sub(1);
                let nearest_px = centers_px[bin] - SAME_HIT_PX - (centers_px[bin] - centers_px[before]);
                centers_px.partition_point(|&center| center < nearest_px).min(before) as u16
            })
            .collect();
        let start = cell_position(range_px[0]);
        let cells = (cell_position(range_px[1]) - start) as usize + 1;
        let ends: Vec<f32> = ends_px.iter().map(|&end| cell_position(end)).collect();
        let first_in_cell =
            (0..cells).map(|cell| ends.partition_point(|&end| end <= start + cell as f32) as u16).collect();
        Self { centers_px, ends_px, same_hit_from, first_in_cell, start }
    }

    /// Number of bins.
    pub(super) fn count(&self) -> usize {
        self.centers_px.len()
    }

    /// CoC radius at the centre of each bin, nearest first.
    pub(super) fn centers_px(&self) -> &[f32] {
        &self.centers_px
    }

    /// The nearest bin that may hold an earlier hit of the translucent surface that a ray hits in `bin`.
    pub(super) fn same_hit_from(&self, bin: usize) -> u16 {
        self.same_hit_from[bin]
    }

    /// The bin of CoC radius `c`, which lies in the range.
    pub(super) fn index(&self, c: f32) -> u16 {
        let cell = (cell_position(c) - self.start) as usize;
        let bin = self.first_in_cell[cell.min(self.first_in_cell.len() - 1)];
        bin + u16::from(c >= self.ends_px[bin as usize])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_radius_lies_in_the_bin_whose_centre_is_nearest_on_the_scale() {
        for plateau_px in [0.5, 0.25] {
            let (bins, scale) = (Bins::new([-151.3, 48.2], plateau_px), Scale::new(plateau_px));
            let first = (scale.position(-151.3) + 0.5).floor();
            for i in 0..20_000 {
                let c = -151.3 + 199.5 * i as f32 / 20_000.0;
                let expected = scale.position(c) - first;
                let off = (f32::from(bins.index(c)) - expected).abs();
                assert!(off <= 0.501, "c = {c}: bin {}, position {expected}", bins.index(c));
            }
        }
    }

    #[test]
    fn a_bin_is_as_wide_as_the_law_of_widths_says() {
        let bins = Bins::new([-40.0, 100.0], 0.5);
        let width_px = |c: f32| {
            let bin = bins.index(c) as usize;
            bins.ends_px[bin] - bins.ends_px[bin - 1]
        };
        for (c, expected) in
            [(0.0, 0.0625), (-2.9, 0.0625), (4.0, 0.1875), (10.0, 0.5), (-12.0, 0.5), (64.0, 2.0)]
        {
            assert!(
                (width_px(c) / expected - 1.0).abs() < 0.1,
                "at {c}: {}, expected {expected}",
                width_px(c)
            );
        }
    }

    #[test]
    fn focus_is_the_centre_of_a_bin_and_bins_do_not_move_with_the_range() {
        let (narrow, wide) = (Bins::new([-1.0, 1.0], 0.5), Bins::new([-100.0, 30.0], 0.5));
        assert_eq!(narrow.centers_px()[narrow.index(0.01) as usize], 0.0, "bin of focus");
        let center_px = |bins: &Bins, c| bins.centers_px()[bins.index(c) as usize];
        for c in [-0.9, -0.3, 0.2, 0.8] {
            assert_eq!(center_px(&narrow, c), center_px(&wide, c), "c = {c}");
        }
    }

    #[test]
    fn a_range_of_one_radius_is_one_bin() {
        let bins = Bins::new([3.0, 3.0], 0.5);
        assert_eq!((bins.count(), bins.index(3.0)), (1, 0), "one bin");
    }

    #[test]
    fn radius_inverts_position() {
        let scale = Scale::new(0.25);
        for b in [-200.0, -33.0, -1.5, 0.0, 0.5, 31.9, 48.1, 70.0, 180.0] {
            assert!((scale.position(scale.radius(b)) - b).abs() < 1e-2, "position {b}");
        }
    }

    #[test]
    fn the_same_surface_is_looked_for_a_pixel_and_a_bin_before() {
        let bins = Bins::new([-60.0, 60.0], 0.5);
        for (c, reach_px) in [(0.0, 1.0625), (2.0, 1.0625), (12.0, 1.5), (50.0, 2.6)] {
            let bin = bins.index(c) as usize;
            let from = bins.same_hit_from(bin) as usize;
            let reach = bins.centers_px()[bin] - bins.centers_px()[from];
            assert!(from < bin && reach <= reach_px + 0.05, "at {c}: {reach} px");
            let next = bins.centers_px()[bin] - bins.centers_px()[from - 1];
            assert!(next > reach_px - 0.05, "at {c}: {next} px are too far");
        }
    }
}
