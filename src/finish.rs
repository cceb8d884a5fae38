//! FINISH: the effects of a lens on the picture as a whole, for every method: lateral colour and vignetting.
//!
//! Both depend only on the position in the picture, so they are applied after any method, and cost nothing where they are off. The
//! sampling error is measured before them.
//!
//! *Lateral colour.* Red shows at `p` what green shows at `axis + (p − axis) / (1 + m)`, interpolated bilinearly: for surfaces in focus
//! that is exact, because a fragment is the square of its sample. Border pixels are repeated. Alpha is sampled like green.
//!
//! *Light without alpha.* Its fragments have [`LIGHT_ALPHA`] while they are blurred; a picture of light alone has alpha 0.
//!
//! Cost: a read and a write of the picture. Memory: one channel.

use crate::image::{Image, Plane};
use crate::lens::{Falloff, Field, Optics};
use crate::methods::Plan;
use crate::parallel;
use crate::scene::EffectKind;
use crate::stack::LIGHT_ALPHA;
use glam::Vec2;

/// Alpha up to this is that of light which hides nothing, as many as 32 one behind another.
const NO_ALPHA: f32 = 32.0 * LIGHT_ALPHA;

/// `image` with the lateral colour and vignetting of `plan`; `field` is its position in the lens's field.
pub fn finish(mut image: Image, plan: &Plan, field: Field) -> Image {
    let optics = &plan.optics;
    if plan.does(EffectKind::LateralColor) {
        for (plane, lateral_px) in image.planes.iter_mut().zip(optics.lateral_px) {
            if lateral_px != 0.0 {
                *plane = magnified(plane, 1.0 + lateral_px / field.half_diagonal_px, field.axis_px);
            }
        }
    }
    if plan.does(EffectKind::Vignetting) {
        // The requested optics: the barrel darkens the corners even where the cat's eye is off because nothing is blurred.
        let barrel = Optics { vignetting: optics.vignetting, ..plan.optics_requested.clone() };
        darken(&mut image, &Falloff::new(&barrel, field));
    }
    let [.., alpha] = &mut image.planes;
    alpha.values_mut().iter_mut().for_each(|alpha| *alpha = if *alpha > NO_ALPHA { *alpha } else { 0.0 });
    image
}

/// `plane` magnified by `factor` about `axis`.
fn magnified(plane: &Plane, factor: f32, axis: Vec2) -> Plane {
    let (width, height) = (plane.width(), plane.height());
    let mut result = Plane::zeros(width, height);
    parallel::for_each_row(result.values_mut(), width, &|y, row| {
        let (above, below, down) = between(axis.y + (y as f32 + 0.5 - axis.y) / factor, height);
        let (above, below) = (plane.row(above), plane.row(below));
        for (x, value) in row.iter_mut().enumerate() {
            let (left, right, across) = between(axis.x + (x as f32 + 0.5 - axis.x) / factor, width);
            let interpolated = |row: &[f32]| row[left] + across * (row[right] - row[left]);
            *value = interpolated(above) + down * (interpolated(below) - interpolated(above));
        }
    });
    result
}

/// The two pixels, of `count`, between whose centres `place` lies, and the weight of the second.
fn between(place: f32, count: usize) -> (usize, usize, f32) {
    let place = (place - 0.5).clamp(0.0, count as f32 - 1.0);
    let first = place as usize;
    (first, (first + 1).min(count - 1), place - first as f32)
}

/// Multiplies the colours of `image` by `falloff`.
fn darken(image: &mut Image, falloff: &Falloff) {
    let width = image.width().max(1);
    let [red, green, blue, _] = image.planes.each_mut().map(Plane::values_mut);
    parallel::for_each_row_of([red, green, blue], width, &|y, [red, green, blue]| {
        for (x, ((red, green), blue)) in red.iter_mut().zip(green).zip(blue).enumerate() {
            let brightness = falloff.at(Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
            [red, green, blue].into_iter().for_each(|value| *value *= brightness);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods;
    use crate::scene::{Layer, Scene};
    use crate::settings::{Origin, ParameterValues, Settings, Values};
    use crate::stack::StackKind;

    #[test]
    fn magnification_divides_distances_from_the_axis() {
        // A ramp of 1 per pixel from the axis: 5 % larger, it is 1 / 1.05 per pixel.
        let ramp = Plane::from_fn(41, 21, |x, y| (x as f32 - 20.0) + 100.0 * (y as f32 - 10.0));
        let larger = magnified(&ramp, 1.05, Vec2::new(20.5, 10.5));
        for (x, y) in [(20, 10), (0, 0), (40, 20), (31, 3)] {
            let expected = ramp.get(x, y) / 1.05;
            assert!((larger.get(x, y) - expected).abs() < 1e-3, "{x}, {y}: {}", larger.get(x, y));
        }
    }

    #[test]
    fn a_barrel_darkens_the_corners_of_a_picture_in_focus_too() {
        let plane = || Plane::filled(60, 40, 1.0);
        let layer =
            Layer { color: [plane(), plane(), plane()], alpha: plane(), coc_px: Plane::zeros(60, 40) };
        let scene = Scene::new(vec![layer], StackKind::Coverage, 1, 10.0);
        for method in ["shear", "scatter"] {
            let (cats_eye, vignetting) = (Some(1.0), Some(1.0));
            let values =
                Values { method: Some(method.to_owned()), cats_eye, vignetting, ..Values::default() };
            let settings = Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default());
            let plan = methods::Registry::default().plan(&scene.analyze(), &settings).unwrap();
            assert!(!plan.does(EffectKind::CatsEye), "{method}: nothing is blurred");
            let image = finish(scene.pinhole(), &plan, scene.field);
            // Near the corner, where 39 % of the light passes the barrel, and the cosine of 31° to the fourth power is 54 %.
            let corner = image.pixel(0, 0)[1];
            let expected = plan.optics_requested.brightness(&scene.field, Vec2::splat(0.5));
            assert!((corner - expected).abs() < 1e-5 && (0.2..0.23).contains(&corner), "{method}: {corner}");
            assert_eq!(image.pixel(0, 0)[3], 1.0, "{method}: alpha is unchanged");
        }
    }

    #[test]
    fn lateral_colour_shifts_red_and_blue_against_green_in_proportion_to_the_distance_from_the_axis() {
        let plane = || Plane::from_fn(64, 36, |x, _| x as f32);
        let layer =
            Layer { color: [plane(), plane(), plane()], alpha: plane(), coc_px: Plane::zeros(64, 36) };
        let scene = Scene::new(vec![layer], StackKind::Coverage, 1, 10.0);
        // 64 px at 50 mm: 2 mm are 2.56 px in the corners.
        let values = Values { lateral_color_um: Some([2000.0, -2000.0]), ..Values::default() };
        let settings = Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default());
        let plan = methods::Registry::default().plan(&scene.analyze(), &settings).unwrap();
        let image = finish(scene.pinhole(), &plan, scene.field);
        // 24 of the 36.7 px to the corner: 1.67 px.
        let [red, green, blue, _] = image.pixel(55, 18);
        assert_eq!(green, 55.0);
        assert!((green - red - 1.6).abs() < 0.1, "{red}: 1.67 px, divided by the magnification");
        assert!((blue - green - 1.75).abs() < 0.1, "{blue}");
    }

    #[test]
    fn a_smaller_picture_repeats_its_border() {
        let plane = Plane::from_fn(8, 1, |x, _| x as f32);
        let smaller = magnified(&plane, 0.5, Vec2::new(4.0, 0.5));
        assert_eq!([smaller.get(0, 0), smaller.get(7, 0)], [0.0, 7.0]);
    }
}
