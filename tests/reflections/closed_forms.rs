//! What a lens sees in mirrors, as geometry has it.

use crate::tracer::{
    Camera, Look, METHODS, NOTHING, Shape, World, displayed_psnr_db, waves, without_shading,
};
use glam::{DMat2, DVec2, DVec3};
use thinlens::image::Image;
use thinlens::scene::{ReflectingLayer, Scene};
use thinlens::settings::DepthConvention;
use thinlens::stack::{Frame, Stack, Window};

/// The mirror that fills the frame, `depth` before the camera and turned by `degrees` about the picture's rows and columns.
fn tilted_mirror(depth: f64, [across, down]: [f64; 2]) -> Shape {
    let normal = DVec3::new(across.to_radians().tan(), down.to_radians().tan(), 1.0);
    Shape::plane(DVec3::new(0.0, 0.0, -depth), normal)
}

/// What the first layer of `stack` reflects.
fn reflecting(stack: &Stack, camera: &Camera) -> ReflectingLayer {
    let scene = Scene::from_stack(&mut stack.clone(), &camera.lens(), &camera.depth_scale());
    scene.reflections.unwrap().layers[0].clone().unwrap()
}

fn movement(layer: &ReflectingLayer, x: usize, y: usize) -> DMat2 {
    let [xx, xy, yx, yy] = layer.movement.each_ref().map(|plane| f64::from(plane.get(x, y)));
    DMat2::from_cols(DVec2::new(xx, yx), DVec2::new(xy, yy))
}

/// The largest element of a matrix.
fn largest(matrix: DMat2) -> f64 {
    matrix.to_cols_array().into_iter().map(f64::abs).fold(0.0, f64::max)
}

// Small lights in flat mirrors.

const LAMP: f64 = 50.0;
const GREY: f64 = 0.2;

fn lamp(_: DVec3) -> [f64; 3] {
    [LAMP, GREY, GREY]
}

fn grey(_: DVec3) -> [f64; 3] {
    [GREY; 3]
}

/// Sum, centre and mean square of the distance from it along each axis, of what is redder than grey.
fn moments(image: &Image) -> (f64, DVec2, DVec2) {
    let mut sums = (0.0, DVec2::ZERO, DVec2::ZERO);
    for y in 0..image.height() {
        for x in 0..image.width() {
            let [red, green, ..] = image.pixel(x, y).map(f64::from);
            let place = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            let weight = red - green;
            sums = (sums.0 + weight, sums.1 + weight * place, sums.2 + weight * place * place);
        }
    }
    let centre = sums.1 / sums.0;
    (sums.0, centre, sums.2 / sums.0 - centre * centre)
}

#[test]
fn a_lamp_in_a_tilted_mirror_is_a_disc_of_the_size_and_in_the_place_of_the_mirrored_point() {
    // Focus, depth of the mirror, distance of the lamp from it, and tilts in degrees. The lamp is nearer than what is behind it by more than
    // the 2 px up to which lone samples are joined with what surrounds them.
    for (focus, depth, distance, tilt) in [
        (2.0, 2.0, 4.0, [-20.0, 0.0]),
        (2.0, 3.0, 4.0, [15.0, 20.0]),
        (1.2, 2.0, 2.0, [0.0, -25.0]),
        (6.0, 2.0, 1.0, [22.0, 5.0]),
    ] {
        let camera = Camera { focus, ..Camera::new(128, 96) };
        let mirror = tilted_mirror(depth, tilt);
        let Shape::Disc { at, normal, .. } = mirror else { unreachable!("it is a plane") };
        // The lamp lies where the ray through a place beside the middle is reflected to.
        let ray = camera.pinhole_ray(70.3, 44.6);
        let met = ray.along * (at.dot(normal) / ray.along.dot(normal));
        let along = ray.along - 2.0 * ray.along.dot(normal) * normal;
        let place = met + distance * along;
        let mirrored = place - 2.0 * (place - at).dot(normal) * normal;
        let radius = 2.2 * -mirrored.z / camera.focal_px();
        let disc = Shape::Disc { at: place, normal: along, radius };
        let things = vec![(mirror, Look::Mirror), (disc, Look::Painted(lamp))];
        let stack = World { things, environment: grey }.stack(&camera, 1);
        let pinhole = Image::from_fn(128, 96, |x, y| {
            let [red, green, blue] = stack.peels[0].color.each_ref().map(|plane| plane.get(x, y));
            [red, green, blue, 1.0]
        });
        let (light, centre, own) = moments(&pinhole);
        let seen_at = camera.seen_at(mirrored);
        assert!(centre.distance(seen_at) < 0.2, "a lamp of few samples: {centre} for {seen_at}");
        let expected = camera.coc_px(-mirrored.z).abs();
        for method in METHODS {
            let case = format!("{method}, focus {focus}, mirror at {depth}, lamp {distance} from it");
            let image = camera.render(stack.clone(), method, 256).image;
            let (seen, seen_centre, spread) = moments(&image);
            assert!((seen / light - 1.0).abs() < 0.01, "{case}: light {}", seen / light);
            let off = seen_centre.distance(centre);
            assert!(off < 0.05, "{case}: {off} px from its place");
            // The mean square along an axis is a quarter of the radius's. Samples are squares, and so are pixels: 1/12 each.
            let squares = spread - own - 1.0 / 6.0;
            let found = (2.0 * (squares.x + squares.y).max(0.0)).sqrt();
            assert!((found - expected).abs() < 0.01 * expected, "{case}: radius {found} for {expected}");
        }
    }
}

// The matrix of the movement.

/// The movement of what `shape` shows at the sample position `x, y` from `distance`, from rays: a step of the lens point and steps of the
/// place that let the same point be seen.
fn traced_movement(camera: &Camera, shape: Shape, distance: f64, (x, y): (f64, f64)) -> Option<DMat2> {
    const STEP: f64 = 1e-4;
    let mirror = World { things: vec![(shape, Look::Mirror)], environment: grey };
    let meets = |x: f64, y: f64| {
        let ray = camera.pinhole_ray(x, y);
        let hit = *mirror.hits(&ray).first()?;
        Some((hit.at, hit.mirror?.0, ray.along))
    };
    let mirrored = |along: DVec3, normal: DVec3| along - 2.0 * along.dot(normal) * normal;
    let (at, normal, _) = meets(x, y)?;
    // Where a ray ends: on a sphere around the fragment, or its direction.
    let ends = |from: DVec3, along: DVec3| {
        if distance >= NOTHING {
            return along;
        }
        let off = from - at;
        let half = off.dot(along);
        from + along * (-half + (half * half - off.length_squared() + distance * distance).sqrt())
    };
    let by_place = |x: f64, y: f64| {
        let (at, normal, along) = meets(x, y)?;
        Some(ends(at, mirrored(along, normal)))
    };
    let by_lens = |u: DVec2| ends(at, mirrored((at - camera.on_lens(u)).normalize(), normal));
    let slope = |after: DVec3, before: DVec3| (after - before) / (2.0 * STEP);
    let a = [
        slope(by_place(x + STEP, y)?, by_place(x - STEP, y)?),
        slope(by_place(x, y + STEP)?, by_place(x, y - STEP)?),
    ];
    let b = [DVec2::X, DVec2::Y].map(|axis| slope(by_lens(STEP * axis), by_lens(-STEP * axis)));
    let products = |one: [DVec3; 2], other: [DVec3; 2]| {
        DMat2::from_cols(
            DVec2::new(one[0].dot(other[0]), one[1].dot(other[0])),
            DVec2::new(one[0].dot(other[1]), one[1].dot(other[1])),
        )
    };
    Some(products(a, a).inverse() * products(a, b) * (1.0 / camera.supersample as f64))
}

/// Cameras of every depth convention, and frames of every form.
fn cameras() -> Vec<(String, Camera)> {
    let camera = Camera::new(48, 36);
    let conventions = [
        DepthConvention::Planar,
        DepthConvention::Ray,
        DepthConvention::Inverse,
        DepthConvention::Normalised,
    ];
    let by_convention =
        conventions.map(|convention| (format!("{convention:?}"), Camera { convention, ..camera }));
    let window = |x, y, width, height| Window { x, y, width, height };
    let framed = |display: Window, data: Window, pixel_aspect: f32| Camera {
        frame: Frame { data, display, pixel_aspect },
        ..camera
    };
    let frames = [
        ("wide pixels", framed(window(0, 0, 48, 36), window(0, 0, 48, 36), 1.5)),
        ("high pixels", framed(window(0, 0, 48, 36), window(0, 0, 48, 36), 0.6)),
        ("overscan", framed(window(6, -4, 48, 36), window(0, -8, 60, 44), 1.0)),
        ("a crop", framed(window(-10, 5, 60, 50), window(-4, 20, 40, 24), 1.0)),
        ("a crop of wide pixels", framed(window(-10, 5, 60, 50), window(-4, 20, 40, 24), 1.5)),
        ("2 × 2", camera.supersampled()),
    ];
    by_convention.into_iter().chain(frames.map(|(name, camera)| (name.to_owned(), camera))).collect()
}

#[test]
fn a_flat_mirror_moves_what_it_shows_by_the_difference_of_two_circles_of_confusion() {
    for (name, camera) in cameras() {
        for tilt in [[0.0, 0.0], [25.0, 0.0], [-15.0, 40.0], [40.0, -20.0]] {
            let mirror = tilted_mirror(2.5, tilt);
            // A wall behind the camera, so that distances differ.
            let wall = Shape::plane(DVec3::new(0.0, 0.0, 3.0), DVec3::new(0.2, 0.1, -1.0));
            let things = vec![(mirror, Look::Mirror), (wall, Look::Painted(grey))];
            let stack = World { things, environment: grey }.stack(&camera, 1);
            let layer = reflecting(&stack, &camera);
            let (width, height) = (stack.width(), stack.height());
            for (x, y) in (0..width * height).map(|i| (i % width, i / width)) {
                let ray = camera.pinhole_ray(x as f64 + 0.5, y as f64 + 0.5);
                let Shape::Disc { at, normal, .. } = mirror else { unreachable!("it is a plane") };
                let met = ray.along * (at.dot(normal) / ray.along.dot(normal));
                let distance = f64::from(stack.shading[0].as_ref().unwrap().reflected_distance.get(x, y));
                let behind = -met.z * (1.0 + distance / met.length());
                let expected = camera.coc_px(behind) - camera.coc_px(-met.z);
                let off = largest(movement(&layer, x, y) - DMat2::from_diagonal(DVec2::splat(expected)));
                // What it shows reaches half-way to its neighbours.
                let [near, far] = layer.mirrored_px.each_ref().map(|plane| f64::from(plane.get(x, y)));
                let behind_px = camera.coc_px(behind);
                assert!(
                    near - 1e-3 < behind_px && behind_px < far + 1e-3 && far - near < 0.5,
                    "{name}, tilt {tilt:?} at {x}, {y}: {near} to {far} for {behind_px}"
                );
                let is_inside = x > 0 && y > 0 && x + 1 < width && y + 1 < height;
                // At the frame's edge slopes are to one side: off by the share of a pixel in the distance of the sensor.
                let allowed = if is_inside { 1e-3 } else { 0.15 };
                assert!(off < allowed, "{name}, tilt {tilt:?} at {x}, {y}: {off} off {expected}");
            }
        }
    }
}

#[test]
fn curved_mirrors_move_what_they_show_as_traced_rays_do() {
    for (name, camera) in cameras() {
        for (radius, distance) in [(0.7, NOTHING), (0.7, 0.9), (-6.0, 1.0), (-9.0, NOTHING)] {
            let depth = if radius > 0.0 { 2.6 } else { -3.0 };
            let sphere = Shape::Sphere { centre: DVec3::new(0.1, -0.07, -depth), radius };
            let mirror = World { things: vec![(sphere, Look::Mirror)], environment: grey };
            let mut stack = mirror.stack(&camera, 1);
            stack.shading[0].as_mut().unwrap().reflected_distance.values_mut().fill(distance as f32);
            let layer = reflecting(&stack, &camera);
            let mut checked = 0;
            for (x, y) in (2..stack.width() - 2).flat_map(|x| (2..stack.height() - 2).map(move |y| (x, y))) {
                // Towards its outline a sphere's directions change too fast for differences of samples.
                let around = [[-2, 0], [2, 0], [0, -2], [0, 2]];
                let steep = |[dx, dy]: [isize; 2]| {
                    let at = (x.saturating_add_signed(dx), y.saturating_add_signed(dy));
                    stack.shading[0].as_ref().unwrap().normal[2].get(at.0, at.1) < 0.7
                };
                if around.into_iter().any(steep) {
                    continue;
                }
                let place = (x as f64 + 0.5, y as f64 + 0.5);
                let expected = traced_movement(&camera, sphere, distance, place).unwrap();
                let off = largest(movement(&layer, x, y) - expected) / largest(expected);
                checked += 1;
                assert!(
                    off < 0.05,
                    "{name}, radius {radius}, distance {distance}, at {x}, {y}: {off}; {:?} for {expected:?}",
                    movement(&layer, x, y)
                );
            }
            assert!(checked > 50, "{name}, radius {radius}: {checked}");
        }
    }
}

#[test]
fn a_far_scene_in_a_convex_mirror_is_focused_half_a_radius_behind_its_surface() {
    for (radius, focus) in [(0.5, 2.0), (0.5, 2.25), (1.2, 1.0), (0.3, 9.0)] {
        let camera = Camera { focus, ..Camera::new(97, 73) };
        let sphere = Shape::Sphere { centre: DVec3::new(0.0, 0.0, -2.0 - radius), radius };
        let mirror = World { things: vec![(sphere, Look::Mirror)], environment: grey };
        let layer = reflecting(&mirror.stack(&camera, 1), &camera);
        let found = movement(&layer, 48, 36);
        let trace = 0.5 * (found.x_axis.x + found.y_axis.y);
        let expected = camera.coc_px(2.0 + 0.5 * radius) - camera.coc_px(2.0);
        // Central differences over a pixel of a sphere some tens of pixels wide.
        assert!(
            (trace / expected - 1.0).abs() < 0.01,
            "radius {radius}, focus {focus}: {trace} for {expected}"
        );
    }
}

// Pictures.

/// Colours of a far scene by direction.
fn sky(along: DVec3) -> [f64; 3] {
    waves(along, 0.7)
}

#[test]
fn a_convex_mirror_is_seen_as_rays_through_the_lens_see_it() {
    let sphere = Shape::Sphere { centre: DVec3::new(0.1, -0.05, -2.6), radius: 0.6 };
    let world = World { things: vec![(sphere, Look::Mirror)], environment: sky };
    for (blades, focus) in [(0, 2.3), (3, 2.3), (3, 1.9)] {
        // Focused on what the mirror shows, and on the mirror, before a far scene that is much blurred.
        let camera = Camera { blades, focus, f_number: 0.15, ..Camera::new(96, 72) };
        let truth = world.truth(&camera, 256);
        let stack = world.stack(&camera, 2);
        for method in METHODS {
            let moved = camera.render(stack.clone(), method, 256).image;
            let fixed = camera.render(without_shading(&stack), method, 256).image;
            let inside = |image: &Image| image.clone().part([28, 20], (46, 38));
            let [moved, fixed] =
                [moved, fixed].map(|image| displayed_psnr_db(&inside(&image), &inside(&truth), 0));
            assert!(
                moved > 48.0 && moved > fixed + 8.0,
                "{method}, {blades} blades: {moved} dB, not moved {fixed}"
            );
        }
    }
}

#[test]
fn a_convex_mirror_shows_lamps_near_it_before_a_far_scene_as_rays_see_them() {
    let lamp = |at: DVec3, radius: f64| {
        (Shape::Disc { at, normal: DVec3::Z, radius }, Look::Painted(|_| [0.9, 0.9, 0.2]))
    };
    let things = vec![
        (Shape::Sphere { centre: DVec3::new(0.0, 0.0, -2.8), radius: 0.8 }, Look::Mirror),
        lamp(DVec3::new(0.9, 0.2, -1.4), 0.12),
        lamp(DVec3::new(-0.8, 0.5, -1.2), 0.2),
        lamp(DVec3::new(0.1, -0.9, -1.0), 0.15),
    ];
    let world = World { things, environment: |along| waves(along, 2.5).map(|value| 0.3 * value) };
    // With one step towards what is seen instead of four, the first is 39.7 dB.
    for (focus, least) in [(2.0, 42.0), (2.3, 33.0)] {
        let camera = Camera { focus, f_number: 0.12, ..Camera::new(96, 72) };
        let truth = world.truth(&camera, 256);
        let stack = world.stack(&camera, 2);
        for method in METHODS {
            let image = camera.render(stack.clone(), method, 256).image;
            let inside = |image: &Image| image.clone().part([28, 18], (40, 36));
            let found = displayed_psnr_db(&inside(&image), &inside(&truth), 0);
            assert!(found > least, "{method}, focus {focus}: {found} dB");
        }
    }
}

/// Lamps and waves.
fn wall(at: DVec3) -> [f64; 3] {
    waves(at, 1.1)
}

#[test]
fn a_flat_mirror_is_seen_as_rays_through_the_lens_see_it() {
    let bright =
        |at: DVec3| (Shape::Disc { at, normal: DVec3::Z, radius: 0.05 }, Look::Painted(|_| [0.9, 0.8, 0.1]));
    let things = vec![
        (tilted_mirror(2.0, [12.0, 0.0]), Look::Mirror),
        (Shape::plane(DVec3::new(0.0, 0.0, 4.0), DVec3::new(0.1, 0.0, -1.0)), Look::Painted(wall)),
        bright(DVec3::new(1.0, 0.1, 0.2)),
        bright(DVec3::new(1.2, -0.3, 1.2)),
    ];
    let world = World { things, environment: sky };
    for blades in [0, 3] {
        for focus in [2.0, 4.0] {
            let camera = Camera { blades, focus, ..Camera::new(96, 72) };
            let truth = world.truth(&camera, 256);
            let stack = world.stack(&camera, 1);
            for method in METHODS {
                let moved = camera.render(stack.clone(), method, 256).image;
                let fixed = camera.render(without_shading(&stack), method, 256).image;
                let [moved, fixed] = [moved, fixed].map(|image| displayed_psnr_db(&image, &truth, 10));
                assert!(
                    moved > 45.0 && moved > fixed + 8.0,
                    "{method}, {blades} blades, focus {focus}: {moved} dB, not moved {fixed}"
                );
            }
        }
    }
}

/// Depth of the mirror that faces the camera.
const FACING: f64 = 2.0;

fn behind_the_camera(at: DVec3) -> [f64; 3] {
    waves(at, 0.9)
}

fn behind_the_mirror(at: DVec3) -> [f64; 3] {
    behind_the_camera(DVec3::new(at.x, at.y, -2.0 * FACING - at.z))
}

#[test]
fn a_mirror_that_faces_the_camera_equals_the_scene_unfolded() {
    let slanted = DVec3::new(0.3, -0.2, 1.0);
    let in_mirror = vec![
        (tilted_mirror(FACING, [0.0; 2]), Look::Mirror),
        (Shape::plane(DVec3::new(0.0, 0.0, 1.5), slanted), Look::Painted(behind_the_camera)),
    ];
    let mirrored = DVec3::new(slanted.x, slanted.y, -slanted.z);
    let unfolded = (
        Shape::plane(DVec3::new(0.0, 0.0, -1.5 - 2.0 * FACING), mirrored),
        Look::Painted(behind_the_mirror as fn(DVec3) -> [f64; 3]),
    );
    let [folded, unfolded] = [in_mirror, vec![unfolded]].map(|things| World { things, environment: grey });
    for supersample in [1, 2] {
        for focus in [2.0, 4.0] {
            let camera = Camera { focus, ..Camera::new(96, 72) };
            let camera = if supersample == 2 { camera.supersampled() } else { camera };
            for method in METHODS {
                let seen = camera.render(folded.stack(&camera, 1), method, 256).image;
                let direct = camera.render(unfolded.stack(&camera, 1), method, 256).image;
                let border = 2 + camera.coc_px(6.5).abs().max(camera.coc_px(FACING).abs()).ceil() as usize;
                let found = displayed_psnr_db(&seen, &direct, border);
                // Shear smooths what a mirror shows by itself, and merges samples by surface. Rays looked up without their place in
                // the pixel would reach 63.8 and 56.4 dB.
                let least = if supersample == 1 { 64.0 } else { 56.5 };
                assert!(found > least, "{method}, {supersample} × {supersample}, focus {focus}: {found} dB");
            }
        }
    }
}
