//! Matting: distribution of the fragments of all peels over the depth layers.
//!
//! A fragment of the first peel shows in the layer that it lies in, fades out towards the next nearer layer (`ω`, eq.
//! 4) and extends into the next farther one (`ω` and `ω̇`, eq. 3), where it is hidden behind itself until blur lowers
//! the coverage at its own layer's border. Fragments of all other peels do not extend nearer (`ω̇`), so that they
//! cannot cover the fragments that hide them.
//!
//! The paper covers opaque fragments only. Here the visible share of a fragment, seen through the fragments before
//! it, uses `ω`, and the hidden share `ω̇`. A translucent fragment does not extend into the farther layer, where it
//! would show twice, and the layer it lies in takes the part that the nearer one leaves: `a (1 − s) / (1 − a s)`
//! behind `a s`, `a` in total.

use super::layers::{Layers, depth};
use crate::image::Plane;
use crate::methods::shared::{CoveragePlanes, Peel};
use crate::parallel;
use crate::scene::OPAQUE_ALPHA;
use pulp::{Arch, NullaryFnOnce};
use std::sync::atomic::{AtomicBool, Ordering};

/// A peel with depths in place of CoC radii.
#[derive(Debug)]
pub(super) struct DepthPeel {
    pub planes: CoveragePlanes,
    /// Depth of each fragment as from [`depth`]; finite.
    pub depth: Plane,
    /// Minimum and maximum depth in each row; empty (∞, −∞) in a row without fragments.
    pub row_ranges: Vec<[f32; 2]>,
}

impl DepthPeel {
    /// Converts the CoC radii of `peel` to depths, in place.
    pub(super) fn new(peel: Peel, coc_infinity_px: f32) -> Self {
        let Peel { covered: planes, coc_px: mut depths } = peel;
        let width = depths.width().max(1);
        let row_ranges = parallel::map_each(depths.values_mut().chunks_mut(width), &|y, depths| {
            let mut range = [f32::INFINITY, f32::NEG_INFINITY];
            for (value, &coverage) in depths.iter_mut().zip(planes.coverage.row(y)) {
                *value = depth(*value, coc_infinity_px);
                if coverage > 0.0 {
                    range = [range[0].min(*value), range[1].max(*value)];
                }
            }
            range
        });
        Self { planes, depth: depths, row_ranges }
    }
}

/// A ramp from 0 to 1, linear in depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ramp {
    pub from: f32,
    pub to: f32,
    pub slope: f32,
}

impl Ramp {
    fn new(from: f32, to: f32) -> Self {
        Self { from, to, slope: 1.0 / (to - from) }
    }

    /// A step at −∞, which every depth is past, or at ∞, which no depth is past.
    fn step(at: f32) -> Self {
        Self { from: at, to: at, slope: 0.0 }
    }

    /// Value of the ramp at `depth`; a ramp of zero width is a step.
    #[inline(always)]
    fn at(&self, depth: f32) -> f32 {
        let between = ((depth - self.from) * self.slope).min(1.0);
        let value = if depth >= self.to { 1.0 } else { between };
        if depth < self.from { 0.0 } else { value }
    }
}

/// The matting functions of one layer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Matte {
    /// `z_{k−2} … z_{k−1}`, where fragments of the nearer layer extend into this one.
    pub rise: Ramp,
    /// `z_{k−1} … z_k`, where this layer's own fragments fade out of the nearer one.
    pub own: Ramp,
    /// `z_k … z_{k+1}`, where fragments of the farther layer fade out of this one.
    pub fall: Ramp,
}

impl Matte {
    /// The matte of `layer`. The outermost layers have no outer limit (`z_{−1} = −∞`, `z_{K−1} = ∞`); all other ramps
    /// have the ends of eq. 9. (The paper sets `z_0 = −∞` too, which would leave the nearest layer empty.)
    pub(super) fn new(layers: &Layers, layer: i32) -> Self {
        let ramp = |k: i32| Ramp::new(layers.boundary(k), layers.boundary(k + 1));
        let outside = Ramp::step(f32::NEG_INFINITY);
        let nearest = layer == -layers.front;
        Self {
            rise: if nearest { outside } else { ramp(layer - 2) },
            own: if nearest { outside } else { ramp(layer - 1) },
            fall: if layer == layers.back { Ramp::step(f32::INFINITY) } else { ramp(layer) },
        }
    }

    /// Share in this layer of a fragment of opacity `alpha` at `depth`. `visibility` is its share seen in the pinhole
    /// picture: `ω` for 1, `ω̇` for 0.
    #[inline(always)]
    fn share(&self, depth: f32, alpha: f32, visibility: f32) -> f32 {
        let nearer = visibility * (1.0 - self.own.at(depth));
        let own = if depth > self.rise.to { (1.0 - nearer) / (1.0 - alpha * nearer) } else { 0.0 };
        let not_past = if alpha >= OPAQUE_ALPHA { self.rise.at(depth) } else { own };
        let past = visibility * (1.0 - self.fall.at(depth));
        let share = if depth <= self.fall.from { not_past } else { past };
        if alpha > 0.0 { share } else { 0.0 }
    }

    /// Whether fragments in the depth range can have a share in the layer.
    pub(super) fn overlaps(&self, range: [f32; 2]) -> bool {
        range[0] <= self.fall.to && range[1] >= self.rise.from
    }
}

/// Position of a layer relative to the layers composited before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CompositeOrder {
    /// In front of them: layers behind focus, composited towards the viewer.
    Over,
    /// Behind them: layers in front of focus, composited away from the viewer.
    Under,
}

/// Mattes the layer of `matte` (eq. 2) and composites it with `planes`; returns whether the layer has any content.
pub(super) fn composite_layer(
    planes: &mut CoveragePlanes,
    peels: &[DepthPeel],
    matte: &Matte,
    order: CompositeOrder,
) -> bool {
    let channels = planes.content.len();
    let arch = Arch::new();
    let has_content = AtomicBool::new(false);
    let row = |scratch: &mut LayerRow, y: usize, mut target: TargetRow<'_>| {
        if !peels.iter().any(|peel| matte.overlaps(peel.row_ranges[y])) {
            return;
        }
        if arch.dispatch(MatteRow { peels, y, matte, scratch: &mut *scratch }) {
            arch.dispatch(ComposeRow { target: &mut target, layer: scratch, order });
            has_content.store(true, Ordering::Relaxed);
        }
    };
    parallel::for_each_with(target_rows(planes).into_iter(), &|| LayerRow::new(channels), &row);
    has_content.into_inner()
}

/// A row of coverage planes, to be written.
struct TargetRow<'a> {
    content: Vec<&'a mut [f32]>,
    coverage: &'a mut [f32],
}

/// The rows of `planes`.
fn target_rows(planes: &mut CoveragePlanes) -> Vec<TargetRow<'_>> {
    let width = planes.coverage.width().max(1);
    let rows = planes.coverage.values_mut().chunks_mut(width);
    let channels = planes.content.len();
    let mut target_rows: Vec<TargetRow<'_>> =
        rows.map(|coverage| TargetRow { content: Vec::with_capacity(channels), coverage }).collect();
    for plane in &mut planes.content {
        let rows = plane.values_mut().chunks_mut(width);
        target_rows.iter_mut().zip(rows).for_each(|(target, row)| target.content.push(row));
    }
    target_rows
}

/// A row of a layer, and of temporary values.
struct LayerRow {
    content: Vec<Vec<f32>>,
    coverage: Vec<f32>,
    /// Visible share of the current peel in the pinhole picture, per pixel.
    visibility: Vec<f32>,
    /// Share of the current peel in the layer, behind the content matted before.
    share: Vec<f32>,
}

impl LayerRow {
    fn new(channels: usize) -> Self {
        Self {
            content: vec![Vec::new(); channels],
            coverage: Vec::new(),
            visibility: Vec::new(),
            share: Vec::new(),
        }
    }

    fn clear(&mut self, width: usize) {
        let empty = self.content.iter_mut().chain([&mut self.coverage]);
        for (values, value) in empty.map(|values| (values, 0.0)).chain([(&mut self.visibility, 1.0)]) {
            values.clear();
            values.resize(width, value);
        }
        self.share.resize(width, 0.0);
    }
}

/// Mattes row `y` of a layer: `L_k = I_0 ω_k(Z_0) ⊕ I_1 ω̇_k(Z_1) ⊕ …`; compiled for each instruction set.
struct MatteRow<'a> {
    peels: &'a [DepthPeel],
    y: usize,
    matte: &'a Matte,
    scratch: &'a mut LayerRow,
}

impl NullaryFnOnce for MatteRow<'_> {
    type Output = bool;

    #[inline(always)]
    fn call(self) -> bool {
        let Self { peels, y, matte, scratch } = self;
        let width = peels.first().map_or(0, |peel| peel.depth.width());
        scratch.clear(width);
        let mut has_content = false;
        for peel in peels {
            let overlaps = share_row(matte, peel, y, scratch);
            has_content |= overlaps;
            if !overlaps {
                continue;
            }
            for (row, plane) in scratch.content.iter_mut().zip(&peel.planes.content) {
                for ((sum, &value), &share) in row.iter_mut().zip(plane.row(y)).zip(&scratch.share) {
                    *sum += share * value;
                }
            }
            let alphas = peel.planes.coverage.row(y).iter();
            for ((sum, &alpha), &share) in scratch.coverage.iter_mut().zip(alphas).zip(&scratch.share) {
                *sum += share * alpha;
            }
        }
        has_content
    }
}

/// Fills `scratch.share` for row `y` of `peel`, updates the visibility for the peels behind, and returns whether any
/// share is not 0.
#[inline(always)]
fn share_row(matte: &Matte, peel: &DepthPeel, y: usize, scratch: &mut LayerRow) -> bool {
    let LayerRow { coverage, visibility, share, .. } = scratch;
    let mut max_share = 0.0f32;
    let fragments = peel.depth.row(y).iter().zip(peel.planes.coverage.row(y));
    for (((&depth, &alpha), (share, &layer_coverage)), visibility) in
        fragments.zip(share.iter_mut().zip(coverage.iter())).zip(visibility)
    {
        *share = (1.0 - layer_coverage) * matte.share(depth, alpha, *visibility);
        max_share = if *share > max_share { *share } else { max_share };
        *visibility *= if alpha >= OPAQUE_ALPHA { 0.0 } else { 1.0 - alpha };
    }
    max_share > 0.0
}

/// Composites a row of a layer with a row of coverage planes; compiled for each instruction set.
struct ComposeRow<'a, 'b> {
    target: &'a mut TargetRow<'b>,
    layer: &'a LayerRow,
    order: CompositeOrder,
}

impl NullaryFnOnce for ComposeRow<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { target: TargetRow { content, coverage }, layer, order } = self;
        for (values, own) in content.iter_mut().zip(&layer.content) {
            let covers = coverage.iter().zip(&layer.coverage);
            for ((value, &own), (&target_coverage, &layer_coverage)) in values.iter_mut().zip(own).zip(covers)
            {
                *value = match order {
                    CompositeOrder::Over => own + (1.0 - layer_coverage) * *value,
                    CompositeOrder::Under => *value + (1.0 - target_coverage) * own,
                };
            }
        }
        for (target_coverage, &layer_coverage) in coverage.iter_mut().zip(&layer.coverage) {
            *target_coverage += (1.0 - *target_coverage) * layer_coverage;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::parameters::RecursiveGaussianParameters;
    use super::*;

    fn layers(infinity: f32) -> Layers {
        Layers::new([-9.0, 9.0], infinity, &RecursiveGaussianParameters::default())
    }

    /// Share of a fragment in each layer, nearest layer first.
    fn shares(layers: &Layers, depth: f32, alpha: f32, visibility: f32) -> Vec<f32> {
        let of = |layer| Matte::new(layers, layer).share(depth, alpha, visibility);
        (-layers.front..=layers.back).map(of).collect()
    }

    /// Depths between two boundaries, without the ends.
    fn between(from: f32, to: f32) -> impl Iterator<Item = (f32, f32)> {
        (1..20).map(move |i| {
            let share = i as f32 / 20.0;
            (from + share * (to - from), share)
        })
    }

    #[test]
    fn the_first_peels_matte_is_a_trapezoid() {
        let layers = layers(50.0);
        for layer in -2..=2 {
            let matte = Matte::new(&layers, layer);
            let anchor = |offset: i32| layers.boundary(layer + offset);
            for (depth, share) in between(anchor(-2), anchor(-1)) {
                assert!((matte.share(depth, 1.0, 1.0) - share).abs() < 1e-5, "layer {layer} rises");
            }
            for (depth, _) in between(anchor(-1), anchor(0)) {
                assert_eq!(matte.share(depth, 1.0, 1.0), 1.0, "layer {layer} is whole");
            }
            for (depth, share) in between(anchor(0), anchor(1)) {
                assert!((matte.share(depth, 1.0, 1.0) - (1.0 - share)).abs() < 1e-5, "layer {layer} falls");
                assert_eq!(matte.share(depth, 1.0, 0.0), 0.0, "layer {layer} ends for what is hidden");
            }
            assert_eq!(matte.share(anchor(-2) - 0.1, 1.0, 1.0), 0.0, "nothing before");
            assert_eq!(matte.share(anchor(1) + 0.1, 1.0, 1.0), 0.0, "nothing after");
        }
    }

    #[test]
    fn a_fragment_fades_out_of_one_layer_as_it_fades_into_the_next_but_one() {
        let layers = layers(50.0);
        for k in -2..=1 {
            for (depth, _) in between(layers.boundary(k), layers.boundary(k + 1)) {
                let of = |layer: i32| Matte::new(&layers, layer).share(depth, 1.0, 1.0);
                assert!((of(k) + of(k + 2) - 1.0).abs() < 1e-5, "boundaries {k} and {}", k + 1);
                assert_eq!(of(k + 1), 1.0, "whole in its own layer");
            }
        }
    }

    #[test]
    fn all_layers_composited_contain_a_fragment_once() {
        let layers = layers(50.0);
        for alpha in [1.0, 0.9, 0.5, 1e-3] {
            for depth in [-45.0, -9.0, -3.3, -0.2, 0.0, 1.0, 2.7, 8.0, 1e9, f32::MAX] {
                for visibility in [1.0, 0.4, 0.0] {
                    let through: f32 = shares(&layers, depth, alpha, visibility)
                        .iter()
                        .map(|share| 1.0 - share * alpha)
                        .product();
                    assert!(
                        (1.0 - through - alpha).abs() < 1e-6,
                        "alpha {alpha} at depth {depth}: {}",
                        1.0 - through
                    );
                }
            }
        }
    }

    #[test]
    fn the_outermost_layers_have_no_outer_limit() {
        let layers = layers(50.0);
        let far = shares(&layers, f32::MAX, 1.0, 1.0);
        assert_eq!(far.last(), Some(&1.0), "infinity is in the farthest");
        let near = shares(&layers, -49.999, 1.0, 1.0);
        assert_eq!(near.first(), Some(&1.0), "the lens itself is in the nearest");
    }

    #[test]
    fn layers_beyond_infinity_and_ramps_of_zero_width_are_steps() {
        let layers = Layers::new([-9.0, 9.0], 3.0, &RecursiveGaussianParameters::default());
        for depth in [-2.9, 0.0, 5.0, 1e30, f32::MAX] {
            let shares = shares(&layers, depth, 1.0, 1.0);
            assert!(shares.iter().all(|share| (0.0..=1.0).contains(share)), "{shares:?} at {depth}");
        }
        let step = Ramp::new(2.0, 2.0);
        assert_eq!([1.9, 2.0, 2.1].map(|depth| step.at(depth)), [0.0, 1.0, 1.0]);
    }
}
