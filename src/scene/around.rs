//! The fragments around pixels that their ways have come to, how much each counts, and the surface in the middle of them.

use super::surface::{CELL_PX, CELL_SHARE};
use super::surroundings::FADE_PX;
use super::vector::Vector;
use super::ways::{WAYS, Ways};
use pulp::Simd;

/// Shares of what is around a pixel, of surfaces not behind a plate: transparent up to the first, opaque from the second on.
const CLEAR: [f32; 2] = [0.5, 0.9];

/// A fragment does not count from this multiple of the distance of the nearest on.
pub(super) const COUNTS_TO: f32 = 3.0;

/// The fragments that the ways from pixels have come to, by direction.
pub(super) struct Around<S: Simd> {
    simd: S,
    /// `−∞` without a fragment.
    pub(super) coc_px: [Vector<S>; WAYS],
    /// `∞` without a fragment.
    pub(super) distance_px: [Vector<S>; WAYS],
    /// How much each counts: 0 for a fragment that does not, or none.
    pub(super) weights: [Vector<S>; WAYS],
}

impl<S: Simd> Around<S> {
    /// Fragments count less the farther away they are, and nothing from [`COUNTS_TO`] times `nearest_px` on: what an edge hides depends
    /// on what is near it.
    #[inline(always)]
    pub(super) fn new(simd: S, ways: &Ways<S>, nearest_px: Vector<S>) -> Self {
        let [zero, one, counts_to] = [0.0, 1.0, COUNTS_TO].map(|value| Vector::all(simd, value));
        let distance_px = ways.distances_px();
        let end_px = counts_to * nearest_px;
        let none = one / (end_px * end_px);
        let mut weights = distance_px;
        for weight in &mut weights {
            *weight = (one / (*weight * *weight) - none).larger(zero);
        }
        Self { simd, coc_px: ways.coc_px(), distance_px, weights }
    }

    /// The CoC radius up to which half of what is seen lies, by weight; `∞` where nothing is seen.
    #[inline(always)]
    pub(super) fn middle_px(&self) -> Vector<S> {
        let [zero, half, infinity] = [0.0, 0.5, f32::INFINITY].map(|value| Vector::all(self.simd, value));
        let mut seen = [self.coc_px, self.weights];
        for (coc_px, weight) in seen[0].iter_mut().zip(self.weights) {
            *coc_px = weight.is_above(zero).select(*coc_px, infinity);
        }
        sort(&mut seen);
        let [coc_px, weights] = seen;
        let half = half * weights.into_iter().fold(zero, |sum, weight| sum + weight);
        let (mut sum, mut middle_px) = (zero, infinity);
        for (coc_px, weight) in coc_px.into_iter().zip(weights) {
            sum = sum + weight;
            // In order: the first that is not too small.
            middle_px = half.is_at_most(sum).select(coc_px.smaller(middle_px), middle_px);
        }
        middle_px
    }

    /// How far rays that pass fragments of the CoC radii `last_px` reach what is seen, 0 … 1: at a depth they are as far away as CoC radii
    /// differ.
    #[inline(always)]
    pub(super) fn within_reach(&self, last_px: Vector<S>) -> Vector<S> {
        let [zero, infinity] = [0.0, f32::INFINITY].map(|value| Vector::all(self.simd, value));
        let mut missing_px = infinity;
        for ((coc_px, distance_px), weight) in self.coc_px.into_iter().zip(self.distance_px).zip(self.weights)
        {
            let of_way = distance_px - (coc_px - last_px);
            missing_px = weight.is_above(zero).select(of_way, infinity).smaller(missing_px);
        }
        let [none, fade_px] = [FADE_PX[1], FADE_PX[1] - FADE_PX[0]].map(|px| Vector::all(self.simd, px));
        ((none - missing_px) / fade_px).clamped()
    }
}

/// For each pixel a surface among those around it.
pub(super) struct Surface<S: Simd> {
    simd: S,
    pub(super) coc_px: Vector<S>,
    /// Difference in CoC radius from which a fragment is of another surface.
    pub(super) cell_px: Vector<S>,
}

impl<S: Simd> Surface<S> {
    /// The surfaces of the CoC radii `coc_px` behind fragments of the CoC radii `last_px`.
    #[inline(always)]
    pub(super) fn new(simd: S, coc_px: Vector<S>, last_px: Vector<S>) -> Self {
        let [least_px, share] = [CELL_PX, CELL_SHARE].map(|value| Vector::all(simd, value));
        Self { simd, coc_px, cell_px: (share * (coc_px - last_px)).larger(least_px) }
    }

    /// How far fragments of these CoC radii are of the surface, 0 … 1.
    #[inline(always)]
    pub(super) fn share(&self, coc_px: Vector<S>) -> Vector<S> {
        let [zero, one] = [0.0, 1.0].map(|value| Vector::all(self.simd, value));
        (one - (coc_px - self.coc_px).abs() / self.cell_px).larger(zero)
    }

    /// How far the surface is opaque, 0 … 1: by the share of what is around that does not lie behind it.
    #[inline(always)]
    pub(super) fn clear(&self, around: &Around<S>) -> Vector<S> {
        let all = |value| Vector::all(self.simd, value);
        let (mut nearer, mut total) = (all(0.0), all(0.0));
        for (coc_px, weight) in around.coc_px.into_iter().zip(around.weights) {
            let behind = ((coc_px - self.coc_px) / self.cell_px - all(1.0)).clamped();
            nearer = nearer + weight * (all(1.0) - behind);
            total = total + weight;
        }
        let t = ((nearer / total - all(CLEAR[0])) / all(CLEAR[1] - CLEAR[0])).clamped();
        t * t * (all(3.0) - all(2.0) * t)
    }
}

/// Sorts what belongs to each pixel by the first of the `quantities`; where it is equal, the order stays.
#[inline(always)]
pub(super) fn sort<S: Simd, const N: usize>(quantities: &mut [[Vector<S>; WAYS]; N]) {
    // Neighbours are exchanged, even and odd ones in turn, as often as there are values: the same steps for all pixels.
    for round in 0..WAYS {
        for one in (round % 2..WAYS - 1).step_by(2) {
            let swaps = quantities[0][one].is_above(quantities[0][one + 1]);
            for quantity in &mut *quantities {
                let (first, second) = (quantity[one], quantity[one + 1]);
                quantity[one] = swaps.select(second, first);
                quantity[one + 1] = swaps.select(first, second);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::{Arch, WithSimd};

    /// CoC radii and weights of what ways have come to, for one pixel.
    type Seen = [[f32; WAYS]; 2];

    /// The middle of what each of as many pixels as a vector has sees.
    struct Middle<'a>(&'a Seen);

    impl WithSimd for Middle<'_> {
        type Output = f32;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> f32 {
            let [coc_px, weights] = self.0.map(|values| values.map(|value| Vector::all(simd, value)));
            let around = Around { simd, coc_px, distance_px: coc_px, weights };
            around.middle_px().least()
        }
    }

    #[test]
    fn the_middle_is_where_half_of_the_weight_lies_nearer() {
        let middles: [(Seen, f32); 5] = [
            ([[5.0, 1.0, 3.0, 2.0, 4.0, 0.0, 7.0, 6.0], [1.0; WAYS]], 3.0),
            // What does not count is not in the middle, and ways that end count for nothing.
            ([[5.0, 1.0, 3.0, 2.0, 4.0, 0.0, 7.0, 6.0], [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]], 5.0),
            ([[f32::NEG_INFINITY; WAYS], [0.0; WAYS]], f32::INFINITY),
            // One outweighs all others.
            ([[-5.0, 1.0, 3.0, 2.0, 4.0, 9.0, 7.0, 6.0], [1.0, 1.0, 1.0, 1.0, 1.0, 8.0, 1.0, 1.0]], 9.0),
            ([[2.0; WAYS], [0.1; WAYS]], 2.0),
        ];
        for (seen, middle_px) in middles {
            for arch in [Arch::Scalar, Arch::new()] {
                assert_eq!(arch.dispatch(Middle(&seen)), middle_px, "{seen:?}");
            }
        }
    }

    /// The surface of CoC radius 3, of cells of 1 px: how far others are of it.
    struct Share(f32);

    impl WithSimd for Share {
        type Output = f32;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> f32 {
            let [coc_px, last_px] = [3.0, 2.0].map(|px| Vector::all(simd, px));
            Surface::new(simd, coc_px, last_px).share(Vector::all(simd, self.0)).most()
        }
    }

    #[test]
    fn fragments_are_of_a_surface_by_degrees_up_to_a_cell_from_it() {
        let shares =
            [3.0, 3.0 + 0.25 * CELL_PX, 3.0 - 0.5 * CELL_PX, 3.0 + CELL_PX, -40.0, f32::NEG_INFINITY];
        let shares = shares.map(|coc_px| Arch::new().dispatch(Share(coc_px)));
        assert_eq!(shares, [1.0, 0.75, 0.5, 0.0, 0.0, 0.0]);
    }
}
