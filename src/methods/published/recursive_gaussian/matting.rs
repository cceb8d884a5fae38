//! Matting: the fragments of all peels, shared out among the depth layers.
//!
//! In the first peel a fragment shows in the layer that it lies in, fades out towards the next nearer layer (`ω`, eq. 4) and
//! reaches into the next farther one (`ω` and `ω̇`, eq. 3), where it is hidden behind itself until blur makes its own
//! layer's border thin. In all other peels it does not reach nearer (`ω̇`), lest it cover what hides it.
//!
//! The paper knows opaque fragments only. Here what is seen of a fragment through those before it goes by `ω`, what is not
//! by `ω̇`. A translucent fragment does not reach into the farther layer, where it would show twice, and the layer it
//! lies in takes what the nearer one leaves: `a (1 − s) / (1 − a s)` behind `a s`, `a` in all.

use super::layers::{Layers, depth};
use crate::image::Plane;
use crate::methods::shared::{CoveragePlanes, Peel};
use crate::scene::OPAQUE_ALPHA;
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

/// A peel by depth.
#[derive(Debug)]
pub(super) struct DepthPeel {
    pub covered: CoveragePlanes,
    /// As of [`depth`]; finite.
    pub depth: Plane,
    /// Least and greatest depth in each row; none in a row without fragments.
    pub spans: Vec<[f32; 2]>,
}

impl DepthPeel {
    /// `peel` with its CoC radii turned into depths, in place.
    pub(super) fn new(peel: Peel, coc_infinity_px: f32) -> Self {
        let Peel { covered, coc_px: mut depths } = peel;
        let width = depths.width().max(1);
        let rows = depths.values_mut().par_chunks_mut(width).zip(covered.coverage.values().par_chunks(width));
        let spans = rows.map(|(depths, coverage)| {
            let mut span = [f32::INFINITY, f32::NEG_INFINITY];
            for (value, &coverage) in depths.iter_mut().zip(coverage) {
                *value = depth(*value, coc_infinity_px);
                if coverage > 0.0 {
                    span = [span[0].min(*value), span[1].max(*value)];
                }
            }
            span
        });
        let spans = spans.collect();
        Self { covered, depth: depths, spans }
    }
}

/// A rise from 0 to 1, linear in depth.
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

    /// A step that everything (`f32::NEG_INFINITY`) or nothing (`f32::INFINITY`) is past.
    fn step(at: f32) -> Self {
        Self { from: at, to: at, slope: 0.0 }
    }

    /// The ramp at `depth`; a ramp of no width is a step.
    #[inline(always)]
    fn at(&self, depth: f32) -> f32 {
        let between = ((depth - self.from) * self.slope).min(1.0);
        let risen = if depth >= self.to { 1.0 } else { between };
        if depth < self.from { 0.0 } else { risen }
    }
}

/// The matting functions of one layer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Matte {
    /// `z_{k−2} … z_{k−1}`, where fragments of the nearer layer reach into this one.
    pub rise: Ramp,
    /// `z_{k−1} … z_k`, where this layer's own fragments fade out of the nearer one.
    pub own: Ramp,
    /// `z_k … z_{k+1}`, where fragments of the farther layer fade out of this one.
    pub fall: Ramp,
}

impl Matte {
    /// The matte of `layer`. Nothing limits the outermost layers on the outside (`z_{−1} = −∞`, `z_{K−1} = ∞`); the ramps of all
    /// others have the ends that eq. 9 gives. (The paper sets `z_0 = −∞` too, which would leave the nearest layer empty.)
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

    /// What this layer gets of a fragment of opacity `alpha` at `depth`, of which the share `seen` is seen in the pinhole
    /// picture: `ω` where all is seen, `ω̇` where nothing is.
    #[inline(always)]
    fn share(&self, depth: f32, alpha: f32, seen: f32) -> f32 {
        let nearer = seen * (1.0 - self.own.at(depth));
        let own = if depth > self.rise.to { (1.0 - nearer) / (1.0 - alpha * nearer) } else { 0.0 };
        let not_past = if alpha >= OPAQUE_ALPHA { self.rise.at(depth) } else { own };
        let past = seen * (1.0 - self.fall.at(depth));
        let share = if depth <= self.fall.from { not_past } else { past };
        if alpha > 0.0 { share } else { 0.0 }
    }

    /// Whether anything of the depths in `span` is in the layer.
    pub(super) fn meets(&self, span: [f32; 2]) -> bool {
        span[0] <= self.fall.to && span[1] >= self.rise.from
    }
}

/// On which side of what was composed before a layer lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    /// Before it: layers behind focus, composed towards the viewer.
    Before,
    /// Behind it: layers in front of focus, composed away from the viewer.
    Behind,
}

/// Composes the layer of `matte` (eq. 2) with `covered`, and says whether there is anything in the layer.
pub(super) fn compose(covered: &mut CoveragePlanes, peels: &[DepthPeel], matte: &Matte, side: Side) -> bool {
    let channels = covered.content.len();
    let arch = Arch::new();
    let row = |scratch: &mut Row, (y, target): (usize, &mut Target<'_>)| {
        if !peels.iter().any(|peel| matte.meets(peel.spans[y])) {
            return false;
        }
        let found = arch.dispatch(MatteRow { peels, y, matte, scratch: &mut *scratch });
        if found {
            arch.dispatch(ComposeRow { target, layer: scratch, side });
        }
        found
    };
    let mut targets = targets(covered);
    let rows = targets.par_iter_mut().enumerate();
    let found = rows.map_init(|| Row::new(channels), row);
    found.reduce(|| false, |one, other| one | other)
}

/// A row of a covered, to write.
struct Target<'a> {
    content: Vec<&'a mut [f32]>,
    coverage: &'a mut [f32],
}

/// The rows of `covered`.
fn targets(covered: &mut CoveragePlanes) -> Vec<Target<'_>> {
    let width = covered.coverage.width().max(1);
    let rows = covered.coverage.values_mut().chunks_mut(width);
    let channels = covered.content.len();
    let mut targets: Vec<Target<'_>> =
        rows.map(|coverage| Target { content: Vec::with_capacity(channels), coverage }).collect();
    for plane in &mut covered.content {
        let rows = plane.values_mut().chunks_mut(width);
        targets.iter_mut().zip(rows).for_each(|(target, row)| target.content.push(row));
    }
    targets
}

/// A row of a layer in the making.
struct Row {
    content: Vec<Vec<f32>>,
    coverage: Vec<f32>,
    /// Share of each pixel in which the peel at hand is seen in the pinhole picture.
    seen: Vec<f32>,
    /// What the layer gets of the peel at hand, behind what it has already.
    share: Vec<f32>,
}

impl Row {
    fn new(channels: usize) -> Self {
        Self {
            content: vec![Vec::new(); channels],
            coverage: Vec::new(),
            seen: Vec::new(),
            share: Vec::new(),
        }
    }

    fn clear(&mut self, width: usize) {
        let empty = self.content.iter_mut().chain([&mut self.coverage]);
        for (values, value) in empty.map(|values| (values, 0.0)).chain([(&mut self.seen, 1.0)]) {
            values.clear();
            values.resize(width, value);
        }
        self.share.resize(width, 0.0);
    }
}

/// Makes row `y` of a layer: `L_k = I_0 ω_k(Z_0) ⊕ I_1 ω̇_k(Z_1) ⊕ …`; to be compiled for each instruction set.
struct MatteRow<'a> {
    peels: &'a [DepthPeel],
    y: usize,
    matte: &'a Matte,
    scratch: &'a mut Row,
}

impl NullaryFnOnce for MatteRow<'_> {
    type Output = bool;

    #[inline(always)]
    fn call(self) -> bool {
        let Self { peels, y, matte, scratch } = self;
        let width = peels.first().map_or(0, |peel| peel.depth.width());
        scratch.clear(width);
        let mut found = false;
        for peel in peels {
            let meets = share_row(matte, peel, y, scratch);
            found |= meets;
            if !meets {
                continue;
            }
            for (row, plane) in scratch.content.iter_mut().zip(&peel.covered.content) {
                for ((sum, &value), &share) in row.iter_mut().zip(plane.row(y)).zip(&scratch.share) {
                    *sum += share * value;
                }
            }
            let alphas = peel.covered.coverage.row(y).iter();
            for ((sum, &alpha), &share) in scratch.coverage.iter_mut().zip(alphas).zip(&scratch.share) {
                *sum += share * alpha;
            }
        }
        found
    }
}

/// Fills `scratch.share` for row `y` of `peel`, goes on to what is seen behind it, and says whether any share is not 0.
#[inline(always)]
fn share_row(matte: &Matte, peel: &DepthPeel, y: usize, scratch: &mut Row) -> bool {
    let Row { coverage, seen, share, .. } = scratch;
    let mut most = 0.0f32;
    let fragments = peel.depth.row(y).iter().zip(peel.covered.coverage.row(y));
    for (((&depth, &alpha), (share, &covered)), seen) in
        fragments.zip(share.iter_mut().zip(coverage.iter())).zip(seen)
    {
        *share = (1.0 - covered) * matte.share(depth, alpha, *seen);
        most = if *share > most { *share } else { most };
        *seen *= if alpha >= OPAQUE_ALPHA { 0.0 } else { 1.0 - alpha };
    }
    most > 0.0
}

/// Composes a row of a layer with a row of a covered; to be compiled for each instruction set.
struct ComposeRow<'a, 'b> {
    target: &'a mut Target<'b>,
    layer: &'a Row,
    side: Side,
}

impl NullaryFnOnce for ComposeRow<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { target: Target { content, coverage }, layer, side } = self;
        for (values, own) in content.iter_mut().zip(&layer.content) {
            let covers = coverage.iter().zip(&layer.coverage);
            for ((value, &own), (&known, &covered)) in values.iter_mut().zip(own).zip(covers) {
                *value = match side {
                    Side::Before => own + (1.0 - covered) * *value,
                    Side::Behind => *value + (1.0 - known) * own,
                };
            }
        }
        for (known, &covered) in coverage.iter_mut().zip(&layer.coverage) {
            *known += (1.0 - *known) * covered;
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

    /// What each layer gets of a fragment, nearest layer first.
    fn shares(layers: &Layers, depth: f32, alpha: f32, seen: f32) -> Vec<f32> {
        let of = |layer| Matte::new(layers, layer).share(depth, alpha, seen);
        (-layers.front..=layers.back).map(of).collect()
    }

    /// Depths between two boundaries, ends left out.
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
    fn a_fragment_fades_out_of_one_layer_as_it_rises_in_the_next_but_one() {
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
    fn all_layers_over_one_another_hold_a_fragment_once() {
        let layers = layers(50.0);
        for alpha in [1.0, 0.9, 0.5, 1e-3] {
            for depth in [-45.0, -9.0, -3.3, -0.2, 0.0, 1.0, 2.7, 8.0, 1e9, f32::MAX] {
                for seen in [1.0, 0.4, 0.0] {
                    let through: f32 =
                        shares(&layers, depth, alpha, seen).iter().map(|share| 1.0 - share * alpha).product();
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
    fn nothing_limits_the_outermost_layers() {
        let layers = layers(50.0);
        let far = shares(&layers, f32::MAX, 1.0, 1.0);
        assert_eq!(far.last(), Some(&1.0), "infinity is in the farthest");
        let near = shares(&layers, -49.999, 1.0, 1.0);
        assert_eq!(near.first(), Some(&1.0), "the lens itself is in the nearest");
    }

    #[test]
    fn layers_beyond_infinity_and_ramps_without_width_are_steps() {
        let layers = Layers::new([-9.0, 9.0], 3.0, &RecursiveGaussianParameters::default());
        for depth in [-2.9, 0.0, 5.0, 1e30, f32::MAX] {
            let shares = shares(&layers, depth, 1.0, 1.0);
            assert!(shares.iter().all(|share| (0.0..=1.0).contains(share)), "{shares:?} at {depth}");
        }
        let step = Ramp::new(2.0, 2.0);
        assert_eq!([1.9, 2.0, 2.1].map(|depth| step.at(depth)), [0.0, 1.0, 1.0]);
    }
}
