//! When two samples are of one surface: every limit by which the program joins neighbours or tells them apart.
//!
//! Depth is known at samples only, so that a surface is a guess: samples beside one another whose CoC radii are close. How close
//! depends on what for, so each question has its own limit here, and shaders get the same constants. Differences are of signed CoC
//! radii in picture pixels: a difference of `d` px moves one sample against the other by at most `d` px for any lens ray.

/// Neighbouring samples of one surface differ by less than this in CoC radius, in picture pixels.
///
/// Wider would thicken edges. `shear` decides by it which bins a fragment joins, `accumulate` how far a fragment reaches towards its
/// neighbours, `peel-rays` along which samples a ray may go on, and the focus map where a line may be drawn.
pub(crate) const JOIN_PX: f32 = 0.5;

/// Whether neighbouring samples of these CoC radii, in picture pixels, are of one surface.
#[inline(always)]
pub(crate) fn joins(coc_px: f32, other_coc_px: f32) -> bool {
    (other_coc_px - coc_px).abs() < JOIN_PX
}

/// From pixel to pixel of one surface a step larger than [`JOIN_PX`] changes by at most this share of itself.
///
/// On a plane in space CoC is affine over the picture, because `1/z` is: its steps are equal, however large.
const STEP_CHANGE_SHARE: f32 = 0.25;

/// Whether the two pixels in the middle of four in a row, of these CoC radii in picture pixels, are of one surface: the step between
/// them is small, or like the step before or after it. NaN stands for no pixel. The focus map asks, which sees one radius a pixel.
pub(crate) fn continues([before, from, to, after]: [f32; 4]) -> bool {
    let step = to - from;
    let like = |other: f32| (other - step).abs() <= STEP_CHANGE_SHARE * step.abs();
    step.abs() <= JOIN_PX || like(from - before) || like(after - to)
}

/// Neighbours whose colours may be averaged differ by less than this in CoC radius, in picture pixels.
///
/// `shear`'s prefilter averages, and the stats of a peel say how often it cannot.
pub(crate) const AVERAGE_PX: f32 = 0.6;

/// Whether the colours of neighbours of these CoC radii, in picture pixels, may be averaged.
#[inline(always)]
pub(crate) fn may_average(coc_px: f32, other_coc_px: f32) -> bool {
    (coc_px - other_coc_px).abs() < AVERAGE_PX
}

/// Samples of one pixel that differ by less than this in CoC radius, in picture pixels, merge …
const MERGE_PX: f32 = 0.5;

/// … or by less than this share of it, whichever is more.
const MERGE_SHARE: f32 = 0.02;

/// The difference to the next sample of a pixel from which a sample of this CoC radius is of another surface, in picture pixels.
/// Merging the samples of a supersampled stack asks.
pub(crate) fn merge_gap_px(coc_px: f32) -> f32 {
    MERGE_PX.max(MERGE_SHARE * coc_px.abs())
}

/// Neighbours that differ by this in CoC radius, in picture pixels, are wholly different surfaces …
const DISTINCT_PX: f32 = 0.5;

/// … or by this share of it, whichever is more.
const DISTINCT_SHARE: f32 = 1.0 / 32.0;

/// How different the surfaces of neighbours of these CoC radii are, from 0 to 1. Predicting costs asks: work begins anew where a
/// surface does.
#[inline(always)]
pub(crate) fn difference(coc_px: f32, next_coc_px: f32) -> f32 {
    let distinct_px = (coc_px.abs() * DISTINCT_SHARE).max(DISTINCT_PX);
    ((next_coc_px - coc_px).abs() / distinct_px).min(1.0)
}

/// What lies within this of the farthest CoC radius of a cell, in picture pixels, is of its farthest surface. The guess of what lies
/// behind a stack asks, of cells of many pixels: their samples lie farther from one another than neighbours.
pub(crate) const CELL_PX: f32 = 1.0;

/// What lies within this share of a surface's CoC radius is of its level in `b-buffer`, which keeps no depth within a level: it cannot
/// be told apart.
pub(crate) const LEVEL_SHARE: f32 = 0.5;

/// The difference from which a fragment is not of the surface of CoC radius `surface_px` in `b-buffer`, whose parameter
/// `same_surface_px` is the least; in picture pixels.
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
        assert!(!joins(f32::NAN, 1.0) && !may_average(1.0, f32::NAN), "nothing joins nothing");
    }

    #[test]
    fn a_surface_continues_over_a_small_step_and_over_one_of_a_slope() {
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
