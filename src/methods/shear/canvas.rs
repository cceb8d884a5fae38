//! The input of painting, and how far each view moves it.

use super::bins::Bins;
use super::mirrors::Mirrors;
use super::spans::Spans;
use crate::lens::{Field, Optics, View};
use crate::methods::contract::LostRays;
use crate::scene::{Background, Layer};
use glam::{IVec2, Vec2};
use std::ops::{Range, RangeInclusive};

/// What the painter reads.
#[derive(Debug, Clone, Copy)]
pub(super) struct Canvas<'a> {
    /// The layers, nearest first.
    pub(super) layers: &'a [Layer],
    /// The spans of the layers.
    pub(super) spans: &'a Spans,
    /// The bins of the spans.
    pub(super) bins: &'a Bins,
    /// The surfaces whose reflection moves, if any.
    pub(super) mirrors: Option<&'a Mirrors>,
    /// The barrel, if it hides views.
    pub(super) barrel: Option<Barrel<'a>>,
    /// The largest distance by which aberrations move a view, in picture pixels.
    pub(super) aberration_px: f32,
    /// The background, if any pixel shows it.
    pub(super) background: Option<&'a Background>,
    /// What rays count as that end where the stack has nothing.
    pub(super) lost_rays: LostRays,
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
    #[inline(always)]
    pub(super) fn passing(&self, lens: Vec2, x: usize, y: usize) -> f32 {
        let height = self.field.height(Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
        (self.optics.within_barrel(lens, height) / self.softness + 0.5).clamp(0.0, 1.0)
    }
}

/// The bins that views can move to a row, or to some of its pixels.
#[derive(Debug, Clone)]
pub(super) struct BinsInReach {
    /// In order.
    bins: Vec<u16>,
    /// Ranges that hold all of them and few others, more than [`LEAST_GAP`] apart.
    ranges: Vec<RangeInclusive<u16>>,
}

/// Distance of two bins in reach up to which those between are not passed over: a range more costs as much as some bins without spans.
const LEAST_GAP: u16 = 4;

impl BinsInReach {
    /// Those of `bins` for which `in_reach(bin, coc_px)` holds.
    pub(super) fn new(bins: &Bins, in_reach: impl Fn(usize, f32) -> bool) -> Self {
        let found = bins.centers_px().iter().enumerate().filter(|(bin, coc_px)| in_reach(*bin, **coc_px));
        let bins: Vec<u16> = found.map(|(bin, _)| bin as u16).collect();
        let alike = bins.chunk_by(|before, bin| bin - before <= LEAST_GAP);
        let ranges = alike.filter_map(|bins| Some(*bins.first()?..=*bins.last()?)).collect();
        Self { bins, ranges }
    }

    /// Whether `bin` is one of them.
    #[cfg(test)]
    pub(super) fn has(&self, bin: usize) -> bool {
        self.bins.contains(&(bin as u16))
    }
}

impl Canvas<'_> {
    /// The bins that some view can move to output row `y`.
    pub(super) fn bins_in_reach(&self, y: usize) -> BinsInReach {
        BinsInReach::new(self.bins, |bin, coc_px| {
            // The next larger whole number, and a row for the place in the pixel. `ceil` would be a call of a library.
            let reach_px = coc_px.abs() + self.aberration_px;
            let whole = reach_px as i32;
            let reach = whole + i32::from(reach_px > whole as f32) + 1;
            self.spans.occurs(bin, y as i32 - reach..=y as i32 + reach)
        })
    }
}

/// How far a view moves a bin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Shift {
    /// Source row minus output row.
    pub(super) rows: i32,
    /// Source column minus output column.
    pub(super) columns: i32,
}

/// A block of bins that a view moves alike. Kept small: a row reads those of all its views.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    pub(super) shift: Shift,
    /// The block, an index of [`Bins::blocks`].
    pub(super) block: u16,
    /// First bin from which on the view moves all bins up to this block alike.
    pub(super) moved_alike_from: u16,
}

/// One view: how far it moves each bin, the same for every row.
#[derive(Debug)]
pub(super) struct Shear {
    /// The lens point and the place in the pixel.
    pub(super) view: View,
    /// The bins in the largest blocks that the view moves alike, nearest first.
    pub(super) steps: Box<[Step]>,
    /// For each bin the index of its step.
    step_of_bin: Box<[u16]>,
}

impl Shear {
    /// The shifts of `view` for `bins`.
    pub(super) fn new(view: &View, bins: &Bins) -> Self {
        let shifts: Vec<Shift> = bins.centers_px().iter().map(|&coc_px| shift(view, coc_px)).collect();
        let steps = steps(&shifts, bins);
        let bins_of = |(index, step): (usize, &Step)| {
            let [first, last] = bins.blocks()[usize::from(step.block)].bins;
            (first..=last).map(move |_| index as u16)
        };
        let step_of_bin = steps.iter().enumerate().flat_map(bins_of).collect();
        Self { view: *view, steps, step_of_bin }
    }

    /// The steps that move a bin `in_reach`, nearest first, in slices.
    #[inline(always)]
    pub(super) fn steps_in_reach(&self, in_reach: &BinsInReach) -> impl Iterator<Item = &[Step]> {
        let mut next = 0;
        in_reach.ranges.iter().map(move |range| {
            let [first, last] = [range.start(), range.end()].map(|&bin| self.step_of_bin[usize::from(bin)]);
            let steps = usize::from(first).max(next)..usize::from(last) + 1;
            next = steps.end;
            &self.steps[steps]
        })
    }

    /// Where the ray of the view from `pixel` is at the CoC radius `coc_px`.
    #[inline(always)]
    pub(super) fn pixel_at(&self, pixel: IVec2, coc_px: f32) -> IVec2 {
        let Shift { rows, columns } = shift(&self.view, coc_px);
        pixel + IVec2::new(columns, rows)
    }

    /// Whether the view moves none of the bins `in_reach`.
    pub(super) fn is_identity(&self, in_reach: &BinsInReach) -> bool {
        let stays = Shift { rows: 0, columns: 0 };
        let step_of = |&bin: &u16| &self.steps[usize::from(self.step_of_bin[usize::from(bin)])];
        in_reach.bins.iter().map(step_of).all(|step| step.shift == stays)
    }
}

/// How far `view` moves a fragment of CoC radius `coc_px`.
#[inline(always)]
fn shift(view: &View, coc_px: f32) -> Shift {
    // Ties round up, so that half a pixel gives the same shift on every machine. `floor` would be a call of a library.
    let rounded = |value: f32| {
        let whole = (value + 0.5) as i32;
        whole - i32::from(whole as f32 > value + 0.5)
    };
    let moved = coc_px * view.lens + view.jitter + view.shift;
    Shift { rows: rounded(moved.y), columns: rounded(moved.x) }
}

/// The largest blocks of bins with one shift each.
fn steps(shifts: &[Shift], bins: &Bins) -> Box<[Step]> {
    let mut steps = Vec::with_capacity(shifts.len());
    let mut bin = 0;
    for alike in shifts.chunk_by(|a, b| a == b) {
        let (first, end) = (bin, bin + alike.len());
        while bin < end {
            let level = bins.highest_level(bin).min((end - bin).ilog2() as usize);
            let block = bins.blocks_of_level(level).start + (bin >> level);
            steps.push(Step { shift: alike[0], block: block as u16, moved_alike_from: first as u16 });
            bin += 1 << level;
        }
    }
    steps.into_boxed_slice()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_steps_in_reach_hold_every_bin_in_reach_and_none_twice() {
        let bins = Bins::new([-20.0, 8.0], 0.5);
        let view = View { lens: Vec2::new(0.3, -0.8), jitter: Vec2::ZERO, shift: Vec2::ZERO };
        let shear = Shear::new(&view, &bins);
        let wanted = |bin: usize| bin % 37 < 2 || (60..90).contains(&bin) || bin + 1 == bins.count();
        let in_reach = BinsInReach::new(&bins, |bin, _| wanted(bin));
        let mut held = vec![0; bins.count()];
        for step in shear.steps_in_reach(&in_reach).flatten() {
            let [first, last] = bins.blocks()[usize::from(step.block)].bins;
            (first..=last).for_each(|bin| held[usize::from(bin)] += 1);
        }
        assert!((0..bins.count()).all(|bin| held[bin] == 1 || !wanted(bin)), "{held:?}");
        assert!(held.iter().all(|&times| times <= 1), "{held:?}");
        let passed_over = |bin: usize| held[bin] == 0;
        assert!(
            (0..bins.count()).filter(|&bin| passed_over(bin)).count() > 100,
            "most are passed over: {held:?}"
        );
    }

    #[test]
    fn the_steps_of_a_view_are_its_bins_in_order_each_once_in_blocks_that_it_moves_alike() {
        let bins = Bins::new([-20.0, 8.0], 0.5);
        for lens in [Vec2::new(0.3, -0.8), Vec2::new(0.01, 0.02), Vec2::ZERO] {
            let view = View { lens, jitter: Vec2::new(0.2, -0.4), shift: Vec2::ZERO };
            let shear = Shear::new(&view, &bins);
            let mut next = 0;
            for step in &shear.steps {
                let [first, last] = bins.blocks()[usize::from(step.block)].bins;
                assert_eq!(first, next, "in order");
                for bin in step.moved_alike_from..=last {
                    let coc_px = bins.centers_px()[usize::from(bin)];
                    assert_eq!(shift(&view, coc_px), step.shift, "moved alike");
                }
                next = last + 1;
            }
            assert_eq!(usize::from(next), bins.count(), "all of them");
        }
    }
}
