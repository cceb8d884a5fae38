//! Bins of CoC radius: the slices in which the scene is sheared.
//!
//! Bin widths grow with the radius, `max(w0, |c|·ρ)`, and are anchored at `c = 0`, so that bins do not move when the CoC range
//! changes from frame to frame.

/// Growth of a bin's width with its radius, `ρ`.
const GROWTH: f32 = 1.0 / 32.0;

/// Width of the bins near focus, in picture pixels, for few and for many views. Narrower bins are visible only at low noise.
const BIN_WIDTH_PX: [f32; 2] = [0.5, 0.25];

/// The smallest number of views with narrow bins.
const MANY_VIEWS: usize = 128;

/// Width of the bins near focus for `views` views, in picture pixels.
pub(super) fn bin_width_px(views: usize) -> f32 {
    BIN_WIDTH_PX[usize::from(views >= MANY_VIEWS)]
}

/// The bin index of a sample without a fragment.
pub(super) const EMPTY: u16 = u16::MAX;

/// The bins of a range of CoC radii, numbered from the nearest.
#[derive(Debug, Clone)]
pub(super) struct Bins {
    /// CoC radius at the centre of each bin.
    centers_px: Vec<f32>,
    /// CoC radius where each bin ends; infinite for the last one.
    ends_px: Vec<f32>,
    /// For each cell of a uniform grid over the range, the bin in which the cell begins.
    first_in_cell: Vec<u16>,
    start_px: f32,
    cells_per_px: f32,
}

/// The position of CoC radius `c` on the scale of bins, on which bin `b` covers `b − ½ … b + ½`.
fn position(c: f32, width_px: f32) -> f32 {
    let linear_to = width_px / GROWTH;
    let size = c.abs();
    let steps = if size <= linear_to { size / width_px } else { (1.0 + (size / linear_to).ln()) / GROWTH };
    steps.copysign(c)
}

/// The CoC radius at position `b`: the inverse of [`position`].
fn radius(b: f32, width_px: f32) -> f32 {
    let linear_to = 1.0 / GROWTH;
    let steps = b.abs();
    let size =
        if steps <= linear_to { steps * width_px } else { width_px / GROWTH * (steps * GROWTH - 1.0).exp() };
    size.copysign(b)
}

impl Bins {
    /// The bins that cover `range_px`, `width_px` wide near focus.
    pub(super) fn new(range_px: [f32; 2], width_px: f32) -> Self {
        let [first, last] = range_px.map(|c| (position(c, width_px) + 0.5).floor() as i32);
        let centers_px: Vec<f32> = (first..=last).map(|b| radius(b as f32, width_px)).collect();
        let ends_px: Vec<f32> = (first..=last)
            .map(|b| if b == last { f32::INFINITY } else { radius(b as f32 + 0.5, width_px) })
            .collect();
        // A cell half as wide as the narrowest bin holds at most one bin end, so one comparison finds the index.
        let cells_per_px = 2.0 / width_px;
        let start_px = range_px[0];
        let cells = ((range_px[1] - start_px) * cells_per_px) as usize + 1;
        let first_in_cell = (0..cells)
            .map(|cell| {
                let c = start_px + cell as f32 / cells_per_px;
                ends_px.partition_point(|&end| end <= c) as u16
            })
            .collect();
        Self { centers_px, ends_px, first_in_cell, start_px, cells_per_px }
    }

    /// Number of bins.
    pub(super) fn count(&self) -> usize {
        self.centers_px.len()
    }

    /// CoC radius at the centre of each bin, nearest first.
    pub(super) fn centers_px(&self) -> &[f32] {
        &self.centers_px
    }

    /// The bin of CoC radius `c`, which lies in the range.
    pub(super) fn index(&self, c: f32) -> u16 {
        let cell = ((c - self.start_px) * self.cells_per_px) as usize;
        let bin = self.first_in_cell[cell.min(self.first_in_cell.len() - 1)];
        bin + u16::from(c >= self.ends_px[bin as usize])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_radius_lies_in_the_bin_whose_centre_is_nearest_on_the_scale() {
        let bins = Bins::new([-151.3, 48.2], 0.5);
        let first = (position(-151.3, 0.5) + 0.5).floor();
        for i in 0..20_000 {
            let c = -151.3 + 199.5 * i as f32 / 20_000.0;
            let expected = position(c, 0.5) - first;
            let off = (f32::from(bins.index(c)) - expected).abs();
            assert!(off <= 0.501, "c = {c}: bin {}, position {expected}", bins.index(c));
        }
    }

    #[test]
    fn focus_is_the_centre_of_a_bin_and_bins_do_not_move_with_the_range() {
        let (narrow, wide) = (Bins::new([-1.0, 1.0], 0.5), Bins::new([-100.0, 30.0], 0.5));
        assert_eq!(narrow.centers_px()[narrow.index(0.1) as usize], 0.0, "bin of focus");
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
        for b in [-200.0, -33.0, -1.5, 0.0, 0.5, 31.9, 32.1, 180.0] {
            assert!((position(radius(b, 0.25), 0.25) - b).abs() < 1e-3, "position {b}");
        }
    }
}
