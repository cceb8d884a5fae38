//! Anti-aliasing of point-sampled fragments in focus, where no blur softens the edges.
//!
//! A five-tap cross filter, weighted by the share of the pixel's rays that hit something in focus.

use crate::image::{Image, Plane};
use rayon::prelude::*;

/// How much of what a ray hits at CoC radius `coc_px` counts as in focus: from 1 up to half a pixel down to 0 at one and a half.
pub(super) fn focus(coc_px: f32) -> f32 {
    const FROM_PX: f32 = 0.5;
    const TO_PX: f32 = 1.5;
    let t = ((coc_px.abs() - FROM_PX) / (TO_PX - FROM_PX)).clamp(0.0, 1.0);
    1.0 - t * t * (3.0 - 2.0 * t)
}

/// Softens `image` where `focused_share` is not 0; `weight` is the weight of each of the four neighbours for a share of 1.
pub(super) fn soften(image: &mut Image, focused_share: &Plane, weight: f32) {
    let (width, height) = (image.width(), image.height());
    if width == 0 {
        return;
    }
    for plane in &mut image.planes {
        let before = plane.clone();
        plane.values_mut().par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            let (above, below) = (before.row(y.saturating_sub(1)), before.row((y + 1).min(height - 1)));
            let here = before.row(y);
            for (x, (value, &share)) in row.iter_mut().zip(focused_share.row(y)).enumerate() {
                if share > 0.0 {
                    let [left, right] = [here[x.saturating_sub(1)], here[(x + 1).min(width - 1)]];
                    *value = softened(here[x], [left, right, above[x], below[x]], weight * share);
                }
            }
        });
    }
}

/// `value` filtered with its four neighbours, each of weight `weight`.
pub(super) fn softened(value: f32, [left, right, above, below]: [f32; 4], weight: f32) -> f32 {
    value * (1.0 - 4.0 * weight) + weight * (left + right + above + below)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_keeps_its_sum() {
        let point = |x, y| if (x, y) == (4, 4) { [1.0, 0.5, 0.25, 1.0] } else { [0.0; 4] };
        let mut image = Image::from_fn(9, 9, point);
        soften(&mut image, &Plane::filled(9, 9, 1.0), 0.08);
        let sum: f32 = image.planes[0].values().iter().sum();
        assert!((sum - 1.0).abs() < 1e-6, "sum {sum}");
        assert!((image.planes[0].get(4, 4) - 0.68).abs() < 1e-6, "1 − 4 · 0.08 of the point");
    }

    #[test]
    fn pixels_out_of_focus_do_not_change() {
        let mut image = Image::from_fn(5, 5, |x, y| [(x * y) as f32; 4]);
        let before = image.clone();
        soften(&mut image, &Plane::zeros(5, 5), 0.08);
        assert_eq!(image, before, "untouched");
    }
}
