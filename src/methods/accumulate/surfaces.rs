//! The surfaces that fragments belong to: how far a fragment extends towards its neighbours, and which hits of a ray are of one surface.

use crate::scene::surface::{self, JOIN_PX, SAME_HIT_PX};
use crate::scene::{Layer, OPAQUE_ALPHA};
use std::borrow::Borrow;

/// The four neighbours of a fragment: columns and rows away.
const SIDES: [[isize; 2]; 4] = [[-1, 0], [1, 0], [0, -1], [0, 1]];

/// CoC radius of the fragment of `layer` that lies `columns` and `rows` away from `x, y`, in picture pixels; NaN where there is none.
fn coc_px_at(layer: &Layer, (x, y): (usize, usize), [columns, rows]: [isize; 2]) -> f32 {
    let place = x.checked_add_signed(columns).zip(y.checked_add_signed(rows));
    let inside = place.filter(|&(x, y)| x < layer.width() && y < layer.height());
    let present = inside.filter(|&(x, y)| layer.alpha.get(x, y) > 0.0);
    present.map_or(f32::NAN, |(x, y)| layer.coc_px.get(x, y))
}

/// Whether the surface of the fragment at `x, y` of `layer` goes on in the same peel on one side.
fn goes_on(layer: &Layer, at: (usize, usize), [dx, dy]: [isize; 2]) -> bool {
    let coc_px = |steps: isize| coc_px_at(layer, at, [steps * dx, steps * dy]);
    surface::goes_on([coc_px(-1), coc_px(0), coc_px(1), coc_px(2)])
}

/// CoC radius of the neighbour on one side that continues the surface of the fragment at `x, y` of layer `number`: in its own peel, or
/// where the surface does not go on there, in any other within [`JOIN_PX`].
fn continuation_px<L: Borrow<Layer>>(
    layers: &[L],
    number: usize,
    at: (usize, usize),
    side: [isize; 2],
) -> Option<f32> {
    let own = layers[number].borrow();
    if goes_on(own, at, side) {
        return Some(coc_px_at(own, at, side));
    }
    let coc = own.coc_px.get(at.0, at.1);
    let others = layers.iter().enumerate().filter(|(other, _)| *other != number);
    let mut neighbours = others.map(|(_, layer)| coc_px_at(layer.borrow(), at, side));
    neighbours.find(|other| (other - coc).abs() < JOIN_PX)
}

/// Interval of CoC depth of the fragment at `x, y` of layer `number`: from its own depth half-way to each neighbour that continues its
/// surface, at most half of [`surface::MAX_JOIN_PX`].
pub(super) fn extent<L: Borrow<Layer>>(layers: &[L], number: usize, at: (usize, usize)) -> [f32; 2] {
    let coc = layers[number].borrow().coc_px.get(at.0, at.1);
    let mut interval = [coc; 2];
    for other in SIDES.into_iter().filter_map(|side| continuation_px(layers, number, at, side)) {
        let middle = 0.5 * (coc + other);
        interval = [interval[0].min(middle), interval[1].max(middle)];
    }
    interval
}

/// The hit of a translucent fragment.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hit {
    pub(super) layer: usize,
    pub(super) at: (usize, usize),
    /// The part of the ray's path in the fragment's extent, in CoC depth.
    pub(super) coc_interval: [f32; 2],
}

/// The last translucent hit of a ray in each layer.
#[derive(Debug, Default)]
pub(super) struct TranslucentHits(Vec<Hit>);

impl TranslucentHits {
    /// Whether `hit` is in a surface that the ray has hit before; remembers it.
    ///
    /// The fragments of one surface overlap, and the ray may pass several of them. Those of one layer within [`SAME_HIT_PX`] are one
    /// surface. Those of different layers are if they are neighbours and the surface does not go on in either of the layers, which is
    /// where something nearer begins or ends.
    pub(super) fn is_repeated<L: Borrow<Layer>>(&mut self, layers: &[L], hit: Hit) -> bool {
        let near = |last: &&Hit| hit.coc_interval[0] <= last.coc_interval[1] + SAME_HIT_PX;
        let same = |last: &Hit| last.layer == hit.layer || changes_layer(layers, last, &hit);
        let repeated = self.0.iter().filter(near).any(same);
        match self.0.iter_mut().find(|last| last.layer == hit.layer) {
            Some(last) => *last = hit,
            None => self.0.push(hit),
        }
        repeated
    }
}

/// Whether one surface has the fragment of `last` in one layer and continues beside it with that of `hit` in another.
fn changes_layer<L: Borrow<Layer>>(layers: &[L], last: &Hit, hit: &Hit) -> bool {
    let side = [hit.at.0 as isize - last.at.0 as isize, hit.at.1 as isize - last.at.1 as isize];
    let (from, to) = (layers[last.layer].borrow(), layers[hit.layer].borrow());
    let step = to.coc_px.get(hit.at.0, hit.at.1) - from.coc_px.get(last.at.0, last.at.1);
    SIDES.contains(&side)
        && step.abs() < JOIN_PX
        && !goes_on(from, last.at, side)
        && !goes_on(to, hit.at, side.map(|steps| -steps))
}

/// Whether a fragment of this alpha lets light pass.
pub(super) fn is_translucent(alpha: f32) -> bool {
    alpha < OPAQUE_ALPHA
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;

    /// A layer of one row with these CoC radii, NaN for no fragment.
    fn layer(coc_px: &[f32]) -> Layer {
        let plane = |value: &dyn Fn(f32) -> f32| Plane::from_fn(coc_px.len(), 1, |x, _| value(coc_px[x]));
        let alpha = plane(&|coc| if coc.is_nan() { 0.0 } else { 0.5 });
        Layer {
            color: std::array::from_fn(|_| alpha.clone()),
            alpha,
            coc_px: plane(&|coc| if coc.is_nan() { 0.0 } else { coc }),
        }
    }

    fn hit(layer: usize, x: usize, coc: f32) -> Hit {
        Hit { layer, at: (x, 0), coc_interval: [coc; 2] }
    }

    #[test]
    fn extents_of_a_surface_meet_half_way_and_those_of_different_surfaces_do_not() {
        let layers = [layer(&[0.0, 0.4, 5.0, 6.0, 7.0])];
        let extents: Vec<[f32; 2]> = (0..5).map(|x| extent(&layers, 0, (x, 0))).collect();
        assert_eq!(extents, [[0.0, 0.2], [0.2, 0.4], [5.0, 5.5], [5.5, 6.5], [6.5, 7.0]]);
    }

    #[test]
    fn a_surface_extends_into_another_peel_where_its_own_ends() {
        // Something nearer begins at the third column, and the surface continues behind it.
        let layers = [layer(&[1.0, 1.2, -8.0, -8.0]), layer(&[f32::NAN, f32::NAN, 1.4, 1.6])];
        assert_eq!(extent(&layers, 0, (1, 0)), [1.1, 1.3]);
        assert_eq!(extent(&layers, 1, (2, 0)), [1.3, 1.5]);
        assert_eq!(extent(&layers, 0, (2, 0)), [-8.0, -8.0], "what is nearer keeps to itself");
    }

    #[test]
    fn a_ray_hits_a_surface_once_and_two_surfaces_twice() {
        let layers = [layer(&[1.0, 1.2, 1.4]), layer(&[1.3, 1.3, 1.3])];
        let mut hits = TranslucentHits::default();
        assert!(!hits.is_repeated(&layers, hit(0, 0, 1.0)), "the first");
        assert!(hits.is_repeated(&layers, hit(0, 1, 1.2)), "the next sample of the same surface");
        assert!(!hits.is_repeated(&layers, hit(1, 1, 1.3)), "another surface in the same sample");
        assert!(!hits.is_repeated(&layers, hit(0, 2, 4.0)), "much farther");
    }

    #[test]
    fn a_ray_hits_a_surface_once_that_changes_peel() {
        let layers = [layer(&[1.0, 1.1, -8.0]), layer(&[f32::NAN, f32::NAN, 1.2])];
        let mut hits = TranslucentHits::default();
        assert!(!hits.is_repeated(&layers, hit(0, 1, 1.1)));
        assert!(hits.is_repeated(&layers, hit(1, 2, 1.2)));
        let two = [layer(&[1.0, 1.1, 1.2]), layer(&[1.2, 1.2, 1.2])];
        let mut hits = TranslucentHits::default();
        assert!(!hits.is_repeated(&two, hit(0, 1, 1.1)));
        assert!(!hits.is_repeated(&two, hit(1, 2, 1.2)), "both surfaces go on in their peels");
    }
}
