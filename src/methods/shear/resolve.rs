//! Anti-aliasing of point-sampled fragments in focus, where no blur softens the edges.
//!
//! A five-tap cross filter, weighted by the share of the pixel's rays that hit something in focus, and by how far the colours around the
//! pixel are point samples ([`Antialiasing`]). It fades as the lens closes, because a pinhole picture is the input bit for bit.

use crate::image::{Image, Plane};
use crate::methods::contract::{PixelFilter, Plan};
use crate::parallel;
use crate::scene::{Antialiasing, EffectKind, Scene};
use pulp::{Arch, NullaryFnOnce};

/// How far a fragment of the CoC radius `coc_px`, in picture pixels, counts as in focus: from 1 up to half a pixel down to 0 from one and
/// a half on.
pub(super) fn focus(coc_px: f32) -> f32 {
    const FROM_PX: f32 = 0.5;
    const TO_PX: f32 = 1.5;
    1.0 - smooth_step((coc_px.abs() - FROM_PX) / (TO_PX - FROM_PX))
}

/// A smooth step from 0 at 0 to 1 at 1.
pub(super) fn smooth_step(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Opening of the lens from which on the filter has its full weight, see [`crate::lens::ThinLens::opening_px`], in picture pixels.
const FULL_OPENING_PX: f32 = 1.5;

/// Rows that one task filters.
const BAND: usize = 32;

/// The filter of one picture.
#[derive(Debug, Clone)]
pub(super) struct Resolve {
    /// Weight of each of the four neighbours where all rays hit something in focus and colours are point samples.
    weight: f32,
    antialiasing: Antialiasing,
    /// Width of the picture.
    width: usize,
}

impl Resolve {
    /// The filter that ends the picture of `scene` by `plan`; `None` where the plan has none.
    pub(super) fn new(plan: &Plan, scene: &Scene) -> Option<Self> {
        let weight = plan.strength(EffectKind::Resolve)? * smooth_step(scene.opening_px / FULL_OPENING_PX);
        let (antialiasing, width) = (scene.antialiasing.clone(), scene.picture_size().0);
        (weight > 0.0).then_some(Self { weight, antialiasing, width })
    }

    /// Weight of each of the four neighbours of pixel `x, y`, of whose rays the share `share` hits something in focus.
    pub(super) fn weight(&self, (x, y): (usize, usize), share: f32) -> f32 {
        self.weight * share * (1.0 - self.antialiasing.at(x, y))
    }

    /// Filters `image`, whose pixels have the shares `focused_share` of rays that hit something in focus.
    pub(super) fn soften(&self, image: &mut Image, focused_share: Plane) {
        let width = image.width();
        if width == 0 {
            return;
        }
        let mut weights = focused_share;
        parallel::for_each_row(weights.values_mut(), width, &|y, row| {
            row.iter_mut().enumerate().for_each(|(x, share)| *share = self.weight((x, y), *share));
        });
        for plane in &mut image.planes {
            soften_plane(plane, &weights);
        }
    }
}

/// Filters `plane` by these weights of each of the four neighbours. Memory: two rows of each band, and two a thread.
fn soften_plane(plane: &mut Plane, weights: &Plane) {
    let (width, height, arch) = (plane.width(), plane.height(), Arch::new());
    let row_before = |y: usize| plane.row(y.min(height - 1)).to_vec();
    // The rows above and below each band, before they are filtered.
    let around: Vec<[Vec<f32>; 2]> = (0..height)
        .step_by(BAND)
        .map(|first| [row_before(first.saturating_sub(1)), row_before(first + BAND)])
        .collect();
    let scratch = || [(); 2].map(|()| vec![0.0; width]);
    let bands = plane.values_mut().chunks_mut(BAND * width);
    parallel::for_each_with(bands, &scratch, &|[above, here], band, mut rest| {
        let [first_above, last_below] = &around[band];
        above.copy_from_slice(first_above);
        let mut y = band * BAND;
        while !rest.is_empty() {
            let (row, below) = rest.split_at_mut(width);
            here.copy_from_slice(row);
            let below_here = below.get(..width).unwrap_or(last_below);
            arch.dispatch(SoftenRow { row, here, beside: [above, below_here], weights: weights.row(y) });
            std::mem::swap(above, here);
            (rest, y) = (below, y + 1);
        }
    });
}

/// Filters `row`, which was `here` between the rows `beside`, by these weights of each of the four neighbours.
struct SoftenRow<'a> {
    row: &'a mut [f32],
    here: &'a [f32],
    /// Those above and below.
    beside: [&'a [f32]; 2],
    weights: &'a [f32],
}

impl NullaryFnOnce for SoftenRow<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { row, here, beside: [above, below], weights } = self;
        let last = row.len() - 1;
        // Selected, not multiplied: what has no weight may be infinite.
        let value = |own, around, weight| if weight > 0.0 { softened(own, around, weight) } else { own };
        for x in [0, last] {
            let around = [here[x.saturating_sub(1)], here[(x + 1).min(last)], above[x], below[x]];
            row[x] = value(here[x], around, weights[x]);
        }
        let inner = 1..last.max(1);
        let (own, weights) = (&here[inner.clone()], &weights[inner.clone()]);
        let (left, right) = (&here[..own.len()], &here[here.len().min(2)..][..own.len()]);
        let (above, below) = (&above[inner.clone()], &below[inner.clone()]);
        for (x, out) in row[inner].iter_mut().enumerate() {
            *out = value(own[x], [left[x], right[x], above[x], below[x]], weights[x]);
        }
    }
}

impl PixelFilter for Resolve {
    fn focus(&self, coc_px: f32) -> f32 {
        focus(coc_px)
    }

    fn filtered(&self, pixel: usize, share: f32, own: [f32; 4], around: [[f32; 4]; 4]) -> [f32; 4] {
        let weight = self.weight((pixel % self.width, pixel / self.width), share);
        std::array::from_fn(|k| softened(own[k], around.map(|near| near[k]), weight))
    }
}

/// `value` filtered with its four neighbours, each of weight `weight`.
#[inline(always)]
fn softened(value: f32, [left, right, above, below]: [f32; 4], weight: f32) -> f32 {
    value * (1.0 - 4.0 * weight) + weight * (left + right + above + below)
}

#[cfg(test)]
mod tests {
    use super::*;

    const RESOLVE: Resolve = Resolve { weight: 0.08, antialiasing: Antialiasing::POINT_SAMPLES, width: 6 };

    #[test]
    fn a_point_keeps_its_sum() {
        let point = |x, y| if (x, y) == (3, 4) { [1.0, 0.5, 0.25, 1.0] } else { [0.0; 4] };
        let mut image = Image::from_fn(6, 9, point);
        RESOLVE.soften(&mut image, Plane::filled(6, 9, 1.0));
        let sum: f32 = image.planes[0].values().iter().sum();
        assert!((sum - 1.0).abs() < 1e-6, "sum {sum}");
        assert!((image.planes[0].get(3, 4) - 0.68).abs() < 1e-6, "1 − 4 · 0.08 of the point");
    }

    #[test]
    fn pixels_out_of_focus_do_not_change() {
        let mut image = Image::from_fn(6, 5, |x, y| [(x * y) as f32; 4]);
        let before = image.clone();
        RESOLVE.soften(&mut image, Plane::zeros(6, 5));
        assert_eq!(image, before, "untouched");
    }

    #[test]
    fn averages_are_not_filtered_again() {
        let share = Plane::from_fn(6, 4, |x, _| if x < 3 { 1.0 } else { 0.0 });
        let by_place = Resolve { antialiasing: Antialiasing::by_pixel(share), ..RESOLVE };
        assert_eq!([by_place.weight((2, 1), 1.0), by_place.weight((3, 1), 1.0)], [0.0, 0.08]);
    }

    #[test]
    fn focus_fades_over_a_pixel_of_coc() {
        assert_eq!([0.0, -0.5, 1.0, -1.5, 9.0].map(focus), [1.0, 1.0, 0.5, 0.0, 0.0]);
    }

    #[test]
    fn a_pixel_by_itself_is_filtered_as_in_the_picture() {
        // One band, whole ones, and a part of one.
        for height in [1, BAND, 2 * BAND + 7] {
            let size = (6, height);
            let before =
                Image::from_fn(6, height, |x, y| [(x * y) as f32, x as f32, (7 * x + y) as f32, 1.0]);
            let share = Plane::from_fn(6, height, |x, y| (x + y % 3) as f32 / 8.0);
            let mut image = before.clone();
            RESOLVE.soften(&mut image, share.clone());
            let value = |pixel: usize| before.pixel(pixel % 6, pixel / 6);
            for pixel in 0..6 * height {
                let (x, y) = (pixel % 6, pixel / 6);
                let around = crate::image::neighbours(pixel, size).map(value);
                let found = RESOLVE.filtered(pixel, share.get(x, y), value(pixel), around);
                assert_eq!(found, image.pixel(x, y), "pixel {x}, {y} of {height} rows");
            }
        }
    }
}
