//! When two samples belong to one surface: all limits by which the program joins or separates neighbours.
//!
//! Depth is known only at samples, so a surface is an assumption: neighbouring samples whose CoC radii are close. How close depends on
//! the use, so each use has its own limit here, and shaders get the same constants. Differences are of signed CoC radii in picture
//! pixels: for a difference of `d` px, any lens ray shifts the two samples against each other by at most `d` px.

/// Difference in CoC radius, in picture pixels, below which neighbouring samples always belong to one surface.
///
/// Where more is known of a surface than the two samples, [`join_limit_px`] may be larger. This is the limit from peel to peel.
pub(crate) const JOIN_PX: f32 = 0.5;

/// Difference in CoC radius, in picture pixels, from which on neighbouring samples never belong to one surface.
pub(crate) const MAX_JOIN_PX: f32 = 2.0;

/// [`join_limit_px`] as a multiple of the sum of the differences on both sides.
pub(crate) const ROUGHNESS: f32 = 2.0;

/// The difference in CoC radius below which two neighbouring samples of a peel belong to one surface, in picture pixels. `before` is the
/// difference between the first of them and the sample before it, `after` that between the second and the sample after it, in the same
/// direction; 0 where there is none.
///
/// A surface goes on as far as its roughness does. On a slope all three differences are equal, on grass or gravel they are all large; at
/// a silhouette between two smooth surfaces the outer two are small, so that the two stay separate and no edge thickens.
#[inline(always)]
pub(crate) fn join_limit_px(before: f32, after: f32) -> f32 {
    (ROUGHNESS * (before + after)).clamp(JOIN_PX, MAX_JOIN_PX)
}

/// Whether neighbouring samples of these CoC radii, in picture pixels, belong to one surface.
#[inline(always)]
pub(crate) fn joins(coc_px: f32, other_coc_px: f32) -> bool {
    (other_coc_px - coc_px).abs() < JOIN_PX
}

/// Largest relative change, from one pixel to the next of one surface, of a step in CoC radius larger than [`JOIN_PX`].
///
/// On a plane in space the CoC radius is affine over the picture, because `1/z` is. Its steps are equal, whatever their size.
const STEP_CHANGE_SHARE: f32 = 0.25;

/// Whether the two middle samples of four in a row of a peel, of these CoC radii in picture pixels, belong to one surface. NaN stands for
/// no sample.
#[inline(always)]
pub(crate) fn goes_on([before, from, to, after]: [f32; 4]) -> bool {
    // The maximum of NaN and 0 is 0.
    let [back, ahead] = [(from - before).abs().max(0.0), (after - to).abs().max(0.0)];
    (to - from).abs() < join_limit_px(back, ahead)
}

/// [`goes_on`], also where the step between the two is similar to the step before or after it, however large. Used by the focus map,
/// which has one radius per pixel and draws a line where a surface passes focus between two of them.
pub(crate) fn continues(row: [f32; 4]) -> bool {
    let [before, from, to, after] = row;
    let step = to - from;
    let is_similar = |other: f32| (other - step).abs() <= STEP_CHANGE_SHARE * step.abs();
    goes_on(row) || is_similar(from - before) || is_similar(after - to)
}

/// Difference in CoC depth, in picture pixels, within which a ray that hits a translucent surface again is still in the same surface: the
/// surface is not composited a second time.
pub(crate) const SAME_HIT_PX: f32 = 1.0;

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

/// Fragments some pixels apart within this difference in CoC radius, in picture pixels, may belong to one surface. Used by the
/// disocclusion fill. Wider than [`JOIN_PX`], because they lie farther apart than neighbours.
pub(crate) const CELL_PX: f32 = 1.0;

/// That difference as a share of the CoC radius, or of how far the surface lies behind another, where that is more than [`CELL_PX`].
pub(crate) const CELL_SHARE: f32 = 0.1;

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
    fn a_surface_goes_on_where_its_roughness_does() {
        assert!(goes_on([0.0, 1.0, 2.0, 3.0]), "a slope of a pixel a sample");
        assert!(goes_on([f32::NAN, 1.0, 2.0, 3.0]), "at its end as well");
        assert!(goes_on([0.0, 1.0, -0.9, 0.3]), "relief");
        assert!(!goes_on([1.0, 1.1, 2.0, 2.1]), "a silhouette between smooth surfaces");
        assert!(!goes_on([-3.0, 0.0, 2.0, 5.0]), "never by two pixels");
        assert!(!goes_on([1.0, f32::NAN, 2.0, 2.0]), "nor over no sample");
    }

    #[test]
    fn a_surface_continues_over_small_steps_and_along_slopes() {
        assert!(continues([f32::NAN, 1.0, 1.4, f32::NAN]), "a small step needs no neighbours");
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
