//! When two samples belong to one surface: all limits by which the program joins or separates neighbours.
//!
//! Depth is known only at samples, so a surface is an assumption: neighbouring samples whose CoC radii are close. How close depends on
//! the use, so each use has its own limit here, and shaders get the same constants. Differences are of signed CoC radii in picture
//! pixels: for a difference of `d` px, any lens ray shifts the two samples against each other by at most `d` px.

/// Upper limit of the difference in CoC radius between neighbouring samples of one surface, in picture pixels.
///
/// A larger limit would thicken edges. It decides in `shear` which bins a fragment joins, in `accumulate` how far a fragment extends
/// towards its neighbours, in `peel-rays` along which samples a ray continues, and in the focus map where a line may be drawn.
pub(crate) const JOIN_PX: f32 = 0.5;

/// Whether neighbouring samples of these CoC radii, in picture pixels, belong to one surface.
#[inline(always)]
pub(crate) fn joins(coc_px: f32, other_coc_px: f32) -> bool {
    (other_coc_px - coc_px).abs() < JOIN_PX
}

/// Largest relative change, from one pixel to the next of one surface, of a step in CoC radius larger than [`JOIN_PX`].
///
/// On a plane in space the CoC radius is affine over the picture, because `1/z` is. Its steps are equal, whatever their size.
const STEP_CHANGE_SHARE: f32 = 0.25;

/// Whether the two middle pixels of four in a row, of these CoC radii in picture pixels, belong to one surface: the step between
/// them is small, or similar to the step before or after it. NaN stands for no pixel. Used by the focus map, which has one radius per
/// pixel.
pub(crate) fn continues([before, from, to, after]: [f32; 4]) -> bool {
    let step = to - from;
    let is_similar = |other: f32| (other - step).abs() <= STEP_CHANGE_SHARE * step.abs();
    step.abs() <= JOIN_PX || is_similar(from - before) || is_similar(after - to)
}

/// Upper limit of the difference in CoC radius between neighbours whose colours may be averaged, in picture pixels.
///
/// Used by `shear`'s prefilter. The statistics of a peel count the pairs that exceed it.
pub(crate) const AVERAGE_PX: f32 = 0.6;

/// Whether the colours of neighbours of these CoC radii, in picture pixels, may be averaged.
#[inline(always)]
pub(crate) fn may_average(coc_px: f32, other_coc_px: f32) -> bool {
    (coc_px - other_coc_px).abs() < AVERAGE_PX
}

/// Smallest value of [`merge_gap_px`], in picture pixels.
const MERGE_PX: f32 = 0.5;

/// [`merge_gap_px`] as a share of the CoC radius, where that is more than [`MERGE_PX`].
const MERGE_SHARE: f32 = 0.02;

/// The difference in CoC radius from which the next sample of a pixel belongs to another surface than a sample of this CoC radius, in
/// picture pixels. Used to merge the samples of a supersampled stack.
pub(crate) fn merge_gap_px(coc_px: f32) -> f32 {
    MERGE_PX.max(MERGE_SHARE * coc_px.abs())
}

/// Smallest difference in CoC radius between neighbours on wholly different surfaces, in picture pixels.
const DISTINCT_PX: f32 = 0.5;

/// That difference as a share of the CoC radius, where that is more than [`DISTINCT_PX`].
const DISTINCT_SHARE: f32 = 1.0 / 32.0;

/// How different the surfaces of neighbours of these CoC radii are, from 0 to 1. Used to predict costs, which rise with the number of
/// surfaces along a row.
#[inline(always)]
pub(crate) fn difference(coc_px: f32, next_coc_px: f32) -> f32 {
    let distinct_px = (coc_px.abs() * DISTINCT_SHARE).max(DISTINCT_PX);
    ((next_coc_px - coc_px).abs() / distinct_px).min(1.0)
}

/// Samples of a cell of many pixels within this distance of its farthest CoC radius, in picture pixels, belong to its farthest surface.
/// Used by the disocclusion fill. Wider than [`JOIN_PX`], because samples of a cell lie farther apart than neighbours.
pub(crate) const CELL_PX: f32 = 1.0;

/// Fragments within this share of a surface's CoC radius belong to its level in `b-buffer`, which keeps no depth within a level and
/// cannot separate them.
pub(crate) const LEVEL_SHARE: f32 = 0.5;

/// The difference in CoC radius from which a fragment does not belong to the surface of CoC radius `surface_px` in `b-buffer`, in picture
/// pixels. The parameter `same_surface_px` is its lower bound.
pub(crate) fn level_gap_px(surface_px: f32, same_surface_px: f32) -> f32 {
    same_surface_px.max(LEVEL_SHARE * surface_px.abs())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_join_below_the_limit_and_not_at_it() {
        assert!(joins(3.0, 3.49) && joins(3.49, 3.0) && !joins(3.0, 3.5) && !joins(-3.5, -3.0));
        assert!(may_average(0.0, 0.59) && !may_average(0.0, AVERAGE_PX));
        assert!(!joins(f32::NAN, 1.0) && !may_average(1.0, f32::NAN), "NaN joins no sample");
    }

    #[test]
    fn a_surface_continues_over_small_steps_and_along_slopes() {
        assert!(continues([f32::NAN, 1.0, 1.5, f32::NAN]), "a small step needs no neighbours");
        assert!(continues([1.0, 3.0, 5.0, f32::NAN]) && continues([f32::NAN, 3.0, 5.0, 7.4]), "a slope");
        assert!(!continues([3.0, 3.0, 5.0, 5.0]) && !continues([1.0, 1.0, f32::NAN, f32::NAN]), "an edge");
    }

    #[test]
    fn limits_grow_with_the_blur_from_half_a_pixel_on() {
        assert_eq!([0.0, 25.0, -50.0].map(merge_gap_px), [0.5, 0.5, 1.0]);
        assert_eq!(
            [difference(16.0, 16.25), difference(-32.0, -31.5), difference(1.0, 9.0)],
            [0.5, 0.5, 1.0]
        );
        assert_eq!([level_gap_px(0.0, 0.75), level_gap_px(-4.0, 0.75)], [0.75, 2.0]);
        assert_eq!(level_gap_px(f32::NEG_INFINITY, 0.5), f32::INFINITY, "no surface yet");
    }
}
