//! Padding of a scene with what lies beyond its frame.
//!
//! Every method repeats the last sample at the border without end. For any other border each layer is padded by as much as the blur can
//! reach, the larger picture is blurred, and the result is cropped to the frame ([`crate::image::Image::trimmed`]). Methods do not
//! depend on the border.
//!
//! Cost: none for [`Border::Clamp`]; otherwise the scene is copied once, and the blur has more pixels. Limits: the padding on each side is
//! at most as wide and as high as the frame (or [`MIN_LIMIT_PX`]), which makes up to nine times the pixels; past that, its last sample is
//! repeated. Rows are added in multiples of [`ROW_SETS`], so that every row of the frame keeps its set of views.

use super::{Background, Layer, Scene};
use crate::image::Plane;
use crate::lens::ROW_SETS;
use crate::parallel;
use crate::settings::Border;
use glam::Vec2;
use std::sync::Arc;

/// Smallest limit of the padding, in picture pixels: it holds for frames that are smaller than this.
const MIN_LIMIT_PX: usize = 256;

/// How far beyond the largest CoC radius methods read, in picture pixels: for interpolation and for rounding to bins.
const READ_MARGIN_PX: f32 = 2.0;

impl Scene {
    /// How far beyond the frame a fragment can lie and still contribute to it, in picture pixels, for a lens that displaces light by up to
    /// `displacement_px` beyond its CoC.
    pub fn reach_px(&self, displacement_px: f32) -> usize {
        let max_coc_of_layer = |layer: &Layer| {
            let of_row = |y: usize| max_coc_of_row(layer.alpha.row(y), layer.coc_px.row(y));
            parallel::map(layer.height(), &of_row).into_iter().fold(0.0, f32::max)
        };
        let max_px = self.layers.iter().map(max_coc_of_layer).fold(0.0, f32::max) + displacement_px;
        if max_px > 0.0 { (max_px + READ_MARGIN_PX).ceil() as usize } else { 0 }
    }

    /// The scene padded as `border` says, by `reach_px` on each side or as much as the limit for the frame allows:
    /// [`Scene::outside_px`] has the width of the padding.
    #[must_use]
    pub fn padded(self, border: Border, reach_px: usize) -> Self {
        let (width, height) = self.picture_size();
        let padded = match border {
            _ if reach_px == 0 || width * height == 0 => return self,
            Border::Clamp => return self,
            Border::Mirror => mirror_padded,
            Border::Transparent => zero_padded,
        };
        let [columns, rows] = [width, height].map(|side| reach_px.min(side.max(MIN_LIMIT_PX)));
        let outside_px = [columns, rows.next_multiple_of(ROW_SETS)];
        let outside = outside_px.map(|pixels| pixels * self.supersample);
        // One plane at a time, so that only one of them is held twice.
        let pad = |plane: Plane| padded(&plane, outside);
        // Beyond the frame, what surfaces reflect does not move.
        let pad_with_nothing = |plane: &Plane| zero_padded(plane, outside);
        let layer = |layer: Layer| Layer {
            color: layer.color.map(pad),
            alpha: pad(layer.alpha),
            coc_px: pad(layer.coc_px),
        };
        let layers: Vec<Layer> = self.layers.into_iter().map(layer).collect();
        let background = Background::behind(&layers, self.supersample, self.coc_infinity_px).map(Arc::new);
        let antialiasing = self.antialiasing.changed(|plane| mirror_padded(plane, outside_px));
        let mut field = self.field;
        field.axis_px += Vec2::from(outside_px.map(|pixels| pixels as f32));
        let reflections = self.reflections.map(|found| Arc::new(found.padded(pad_with_nothing)));
        let environment = self.environment.map(|shading| Arc::new(shading.padded(outside)));
        Self { layers, antialiasing, field, outside_px, background, reflections, environment, ..self }
    }
}

/// The largest absolute CoC radius of the fragments.
fn max_coc_of_row(alpha: &[f32], coc_px: &[f32]) -> f32 {
    let sizes = alpha.iter().zip(coc_px).map(|(&alpha, coc)| if alpha > 0.0 { coc.abs() } else { 0.0 });
    sizes.fold(0.0, |largest, size| if size > largest { size } else { largest })
}

/// `plane` padded with zeros.
fn zero_padded(plane: &Plane, outside: [usize; 2]) -> Plane {
    padded_plane(plane, outside, |y| y.checked_sub(outside[1]).filter(|&y| y < plane.height()), |_, _| 0.0)
}

/// `plane` padded with its reflections.
fn mirror_padded(plane: &Plane, outside: [usize; 2]) -> Plane {
    let source_row = |y: usize| Some(reflected(y, outside[1], plane.height()));
    padded_plane(plane, outside, source_row, |samples, x| samples[reflected(x, outside[0], samples.len())])
}

/// `plane` with `columns` on either side and `rows` above and below. Row `y` of the result has in its middle the samples of row
/// `source_row(y)` of `plane`, and `padding(samples, x)` in every other column `x`; it is zero where there is no source row.
fn padded_plane(
    plane: &Plane,
    [columns, rows]: [usize; 2],
    source_row: impl Fn(usize) -> Option<usize> + Sync + Send,
    padding: impl Fn(&[f32], usize) -> f32 + Sync + Send,
) -> Plane {
    let (width, larger_width) = (plane.width(), plane.width() + 2 * columns);
    let mut larger = Plane::zeros(larger_width, plane.height() + 2 * rows);
    parallel::for_each_row(larger.values_mut(), larger_width, &|y, to| {
        let Some(from) = source_row(y).map(|y| plane.row(y)) else { return };
        to[columns..][..width].copy_from_slice(from);
        for x in (0..columns).chain(columns + width..larger_width) {
            to[x] = padding(from, x);
        }
    });
    larger
}

/// Index of the sample, of `length` samples that begin at `outside`, that is shown at `at`: reflected at both ends, repeatedly.
fn reflected(at: usize, outside: usize, length: usize) -> usize {
    let period = 2 * length;
    // Adding whole periods keeps the difference from being negative.
    let place = (at + outside.div_ceil(period) * period - outside) % period;
    if place < length { place } else { period - 1 - place }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stack::{Antialiasing, StackKind};

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
    fn reflections_repeat_the_border_sample_and_reverse_at_both_ends() {
        let found: Vec<usize> = (0..13).map(|at| reflected(at, 5, 3)).collect();
        assert_eq!(found, [1, 2, 2, 1, 0, 0, 1, 2, 2, 1, 0, 0, 1], "the second 0 is the first sample");
    }

    #[test]
    fn a_mirrored_scene_is_surrounded_by_its_reflections() {
        let scene = scene(-0.5, 1);
        assert_eq!(scene.reach_px(0.0), 3, "half a pixel and a margin of two, in whole pixels");
        let padded = scene.clone().padded(Border::Mirror, 8);
        assert_eq!((padded.picture_size(), padded.frame_size()), ((20, 18), (4, 2)));
        let red = &padded.layers[0].color[0];
        let [there, back] = [[1.0, 2.0, 3.0, 4.0], [4.0, 3.0, 2.0, 1.0]];
        assert_eq!(red.row(8), [there, back, there, back, there].concat());
        let column: Vec<f32> = (8..18).map(|y| red.get(8, y)).collect();
        assert_eq!(column, [1.0, 11.0, 11.0, 1.0, 1.0, 11.0, 11.0, 1.0, 1.0, 11.0]);
        assert_eq!(red.clone().trimmed(padded.outside_px), scene.layers[0].color[0], "unchanged within");
    }

    #[test]
    fn a_transparent_border_adds_no_fragments() {
        let padded = scene(-0.5, 1).padded(Border::Transparent, 8);
        let alpha = &padded.layers[0].alpha;
        assert_eq!(alpha.values().iter().sum::<f32>(), 8.0, "no more fragments than before");
        assert_eq!(alpha.clone().trimmed([8, 8]), Plane::filled(4, 2, 1.0));
    }

    #[test]
    fn what_colours_are_goes_on_beyond_the_frame() {
        let share = Plane::from_fn(4, 2, |x, _| if x < 2 { 0.0 } else { 1.0 });
        let scene = Scene { antialiasing: Antialiasing::by_pixel(share), ..scene(3.0, 1) };
        for border in [Border::Mirror, Border::Transparent] {
            let padded = scene.clone().padded(border, 4);
            assert_eq!(
                padded.antialiasing.plane().map(|plane| (plane.width(), plane.height())),
                Some((12, 18))
            );
            let row: Vec<f32> = (0..12).map(|x| padded.antialiasing.at(x, 9)).collect();
            assert_eq!(row, [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0], "{border:?}");
        }
    }

    #[test]
    fn rows_are_added_in_multiples_of_the_sets_that_rows_take_turns_with() {
        assert_eq!(scene(3.0, 1).padded(Border::Mirror, 5).outside_px, [5, 8]);
    }

    #[test]
    fn a_clamped_border_adds_no_padding() {
        let scene = scene(40.0, 1);
        assert_eq!(scene.clone().padded(Border::Clamp, 42), scene);
        let focused = self::scene(0.0, 1);
        assert_eq!(scene.reach_px(4.0), 46, "with what aberrations add");
        assert_eq!(focused.reach_px(0.0), 0, "no border needs padding where nothing is blurred");
    }

    #[test]
    fn padding_keeps_the_samples_of_a_pixel_together_and_the_axis_in_place() {
        let scene = scene(3.0, 2);
        let padded = scene.clone().padded(Border::Mirror, 8);
        assert_eq!((padded.width(), padded.height()), (36, 34));
        assert_eq!((padded.picture_size(), padded.frame_size()), ((18, 17), (2, 1)));
        assert_eq!(padded.field.axis_px, scene.field.axis_px + 8.0);
        assert_eq!(padded.field.half_diagonal_px, scene.field.half_diagonal_px);
    }

    #[test]
    fn padding_is_no_wider_than_the_frame_unless_the_frame_is_small() {
        let plane = || Plane::filled(300, 2, 1.0);
        let layer = Layer { color: [plane(), plane(), plane()], alpha: plane(), coc_px: plane() };
        let scene = Scene::new(vec![layer], StackKind::PointSampled, 1, 10.0);
        assert_eq!(scene.padded(Border::Transparent, 5000).outside_px, [300, 256]);
    }
}
