//! What lies beyond the frame, put around a scene.
//!
//! Every method takes the last sample at the border to go on for ever. Where something else is asked for, each layer is made larger by as
//! much as the blur can reach, the larger picture is blurred, and it is cut back to the frame ([`crate::image::Image::trimmed`]). A method
//! knows nothing of it.
//!
//! Cost: nothing for [`Border::Clamp`]; else the scene is copied once, and the blur has more pixels. Limits: what is put around is at
//! most as wide and as high as the frame on each side (or [`ALWAYS_PX`]), which makes nine times the pixels; past that, its last sample
//! goes on.

use super::{Layer, Scene};
use crate::image::Plane;
use crate::settings::Border;
use glam::Vec2;
use rayon::prelude::*;

/// As much may always be put around a frame, in picture pixels, however small the frame is.
const ALWAYS_PX: usize = 256;

/// Methods look so much farther than the largest CoC radius, in picture pixels: for interpolation and for rounding to bins.
const SPARE_PX: f32 = 2.0;

impl Scene {
    /// How far beyond the frame something may lie and yet be seen in it, in picture pixels, by a lens that moves things `astray_px` beyond
    /// their CoC.
    pub fn reach_px(&self, astray_px: f32) -> usize {
        let of_layer = |layer: &Layer| {
            let width = layer.width().max(1);
            let rows = layer.alpha.values().par_chunks(width).zip(layer.coc_px.values().par_chunks(width));
            rows.map(|(alpha, coc_px)| largest_of_row(alpha, coc_px)).reduce(|| 0.0, f32::max)
        };
        let largest_px = self.layers.iter().map(of_layer).fold(0.0, f32::max) + astray_px;
        if largest_px > 0.0 { (largest_px + SPARE_PX).ceil() as usize } else { 0 }
    }

    /// The scene with what `border` says around it, `reach_px` wide on each side, or as wide as the frame allows:
    /// [`Scene::outside_px`] says how much it was.
    #[must_use]
    pub fn padded(self, border: Border, reach_px: usize) -> Self {
        let (width, height) = self.picture_size();
        let around = match border {
            _ if reach_px == 0 || width * height == 0 => return self,
            Border::Clamp => return self,
            Border::Mirror => mirrored,
            Border::Transparent => isolated,
        };
        let outside_px = [width, height].map(|side| reach_px.min(side.max(ALWAYS_PX)));
        let outside = outside_px.map(|pixels| pixels * self.supersample);
        // One plane after the other, so that only one of them is there twice.
        let larger = |plane: Plane| around(&plane, outside);
        let layer = |layer: Layer| Layer {
            color: layer.color.map(larger),
            alpha: larger(layer.alpha),
            coc_px: larger(layer.coc_px),
        };
        let layers = self.layers.into_iter().map(layer).collect();
        let mut field = self.field;
        field.axis_px += Vec2::from(outside_px.map(|pixels| pixels as f32));
        Self { layers, field, outside_px, ..self }
    }
}

/// The largest size of CoC radii where there are fragments.
fn largest_of_row(alpha: &[f32], coc_px: &[f32]) -> f32 {
    let sizes = alpha.iter().zip(coc_px).map(|(&alpha, coc)| if alpha > 0.0 { coc.abs() } else { 0.0 });
    sizes.fold(0.0, |largest, size| if size > largest { size } else { largest })
}

/// `plane` amid zeros.
fn isolated(plane: &Plane, outside: [usize; 2]) -> Plane {
    framed(plane, outside, |y| y.checked_sub(outside[1]).filter(|&y| y < plane.height()), |_, _| 0.0)
}

/// `plane` amid its reflections.
fn mirrored(plane: &Plane, outside: [usize; 2]) -> Plane {
    let row = |y: usize| Some(reflected(y, outside[1], plane.height()));
    framed(plane, outside, row, |samples, x| samples[reflected(x, outside[0], samples.len())])
}

/// A plane as large as `plane` with the columns and rows `outside` around it: each of its rows has in its middle the samples of
/// `row(y)`, if any, and `beside(samples, x)` in every other column `x`.
fn framed(
    plane: &Plane,
    [columns, rows]: [usize; 2],
    row: impl Fn(usize) -> Option<usize> + Sync + Send,
    beside: impl Fn(&[f32], usize) -> f32 + Sync + Send,
) -> Plane {
    let (width, larger_width) = (plane.width(), plane.width() + 2 * columns);
    let mut larger = Plane::zeros(larger_width, plane.height() + 2 * rows);
    larger.values_mut().par_chunks_mut(larger_width).enumerate().for_each(|(y, to)| {
        let Some(from) = row(y).map(|y| plane.row(y)) else { return };
        to[columns..][..width].copy_from_slice(from);
        for x in (0..columns).chain(columns + width..larger_width) {
            to[x] = beside(from, x);
        }
    });
    larger
}

/// Which of `length` samples place `at` shows, where the first of them is at `outside`: reflected past either end, and there again.
fn reflected(at: usize, outside: usize, length: usize) -> usize {
    let turns = 2 * length;
    // Both are whole numbers of samples from the first; a whole number of turns keeps the difference from being negative.
    let place = (at + outside.div_ceil(turns) * turns - outside) % turns;
    if place < length { place } else { turns - 1 - place }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stack::StackKind;

    /// A scene four samples wide and two high, all at CoC radius `coc_px`.
    fn scene(coc_px: f32, supersample: usize) -> Scene {
        let plane = |value: f32| Plane::from_fn(4, 2, |x, y| value + (x + 10 * y) as f32);
        let layer = Layer {
            color: [plane(1.0), plane(2.0), plane(3.0)],
            alpha: Plane::filled(4, 2, 1.0),
            coc_px: Plane::filled(4, 2, coc_px),
        };
        Scene::new(vec![layer], StackKind::PointSampled, supersample, 10.0)
    }

    #[test]
    fn reflections_repeat_the_border_and_turn_at_either_end() {
        let found: Vec<usize> = (0..13).map(|at| reflected(at, 5, 3)).collect();
        assert_eq!(found, [1, 2, 2, 1, 0, 0, 1, 2, 2, 1, 0, 0, 1], "the second 0 is the first sample");
    }

    #[test]
    fn a_mirrored_scene_is_itself_amid_its_reflections() {
        let scene = scene(-0.5, 1);
        assert_eq!(scene.reach_px(0.0), 3, "half a pixel and two to spare, in whole pixels");
        let padded = scene.clone().padded(Border::Mirror, 3);
        assert_eq!((padded.picture_size(), padded.frame_size()), ((10, 8), (4, 2)));
        let red = &padded.layers[0].color[0];
        assert_eq!(red.row(3), [3.0, 2.0, 1.0, 1.0, 2.0, 3.0, 4.0, 4.0, 3.0, 2.0]);
        let column: Vec<f32> = (0..8).map(|y| red.get(3, y)).collect();
        assert_eq!(column, [11.0, 11.0, 1.0, 1.0, 11.0, 11.0, 1.0, 1.0]);
        assert_eq!(red.clone().trimmed(padded.outside_px), scene.layers[0].color[0], "and itself within");
    }

    #[test]
    fn nothing_is_beyond_a_transparent_border() {
        let padded = scene(-0.5, 1).padded(Border::Transparent, 3);
        let alpha = &padded.layers[0].alpha;
        assert_eq!(alpha.values().iter().sum::<f32>(), 8.0, "no more fragments than before");
        assert_eq!(alpha.clone().trimmed([3, 3]), Plane::filled(4, 2, 1.0));
    }

    #[test]
    fn a_border_that_goes_on_costs_nothing() {
        let scene = scene(40.0, 1);
        assert_eq!(scene.clone().padded(Border::Clamp, 42), scene);
        let focused = self::scene(0.0, 1);
        assert_eq!(scene.reach_px(4.0), 46, "and what aberrations add");
        assert_eq!(focused.reach_px(0.0), 0, "and neither does any where nothing spreads");
    }

    #[test]
    fn samples_of_a_pixel_stay_together_and_the_axis_where_it_was() {
        let scene = scene(3.0, 2);
        let padded = scene.clone().padded(Border::Mirror, 5);
        assert_eq!((padded.width(), padded.height()), (24, 22));
        assert_eq!((padded.picture_size(), padded.frame_size()), ((12, 11), (2, 1)));
        assert_eq!(padded.field.axis_px, scene.field.axis_px + 5.0);
        assert_eq!(padded.field.half_diagonal_px, scene.field.half_diagonal_px);
    }

    #[test]
    fn what_is_put_around_is_no_wider_than_the_frame_unless_that_is_small() {
        let plane = || Plane::filled(300, 2, 1.0);
        let layer = Layer { color: [plane(), plane(), plane()], alpha: plane(), coc_px: plane() };
        let scene = Scene::new(vec![layer], StackKind::PointSampled, 1, 10.0);
        assert_eq!(scene.padded(Border::Transparent, 5000).outside_px, [300, 256]);
    }
}
