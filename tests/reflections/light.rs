//! How much light is seen in mirrors, and how it changes with the lens and with the light.

use crate::tracer::{Camera, Look, METHODS, NOTHING, Shape, World, difference, waves, without_shading};
use fastrand::Rng;
use glam::DVec3;
use thinlens::image::Plane;
use thinlens::scene::EffectKind;
use thinlens::stack::Stack;

fn grey(_: DVec3) -> [f64; 3] {
    [0.37; 3]
}

fn textured(at: DVec3) -> [f64; 3] {
    waves(at, 3.0)
}

/// A mirror that fills the frame: flat and turned, or curved.
fn mirrors() -> [(&'static str, Shape); 3] {
    [
        ("flat", Shape::plane(DVec3::new(0.0, 0.0, -2.2), DVec3::new(0.1, 0.05, 1.0))),
        ("convex", Shape::Sphere { centre: DVec3::new(0.0, 0.0, -4.5), radius: 2.5 }),
        ("concave", Shape::Sphere { centre: DVec3::new(0.0, 0.0, 5.0), radius: -7.0 }),
    ]
}

/// A mirror before a `wall` behind the camera.
fn world(mirror: Shape, wall: fn(DVec3) -> [f64; 3]) -> World {
    let behind = Shape::plane(DVec3::new(0.0, 0.0, 2.0), DVec3::new(0.1, 0.3, -1.0));
    World { things: vec![(mirror, Look::Mirror), (behind, Look::Painted(wall))], environment: wall }
}

/// Adds `light(x, y)` to the colour of the first peel.
fn add(stack: &mut Stack, light: impl Fn(usize, usize) -> f32) {
    for plane in &mut stack.peels[0].color {
        *plane = Plane::from_fn(plane.width(), plane.height(), |x, y| plane.get(x, y) + light(x, y));
    }
}

#[test]
fn what_is_as_bright_everywhere_is_so_in_every_mirror() {
    for (name, mirror) in mirrors() {
        for camera in [Camera::new(64, 48), Camera::new(64, 48).supersampled()] {
            let mut stack = world(mirror, grey).stack(&camera, 1);
            let side = camera.supersample;
            // The mirror has a colour of its own, which does not move.
            let dust = |x: usize, y: usize| 0.2 + 0.1 * ((x / side / 7 + y / side / 5) % 3) as f32;
            add(&mut stack, dust);
            for method in METHODS {
                let case = format!("{name}, {side} × {side}, {method}");
                let moved = camera.render(stack.clone(), method, 64);
                let fixed = camera.render(without_shading(&stack), method, 64);
                assert!(moved.plan.does(EffectKind::Blur), "{case}");
                let mean = |plane: &Plane| {
                    let sum: f64 = plane.values().iter().map(|&value| f64::from(value)).sum();
                    sum / plane.values().len() as f64
                };
                let forced = camera.render_with(stack.clone(), method, (&["reflections"], &[]));
                let plain = camera.render_with(stack.clone(), method, (&[], &["reflections"]));
                let off = difference(&forced.image, &plain.image);
                assert!(off < 1e-5, "{case}: forced, {off}");
                let [moved, fixed] = [moved, fixed].map(|rendered| mean(&rendered.image.planes[1]));
                assert!((moved - fixed).abs() < 1e-5, "{case}: {moved} for {fixed}");
            }
        }
    }
}

/// The largest difference between neighbours in what the first peel reflects.
fn steepest(stack: &Stack) -> f32 {
    let planes = &stack.shading[0].as_ref().unwrap().light;
    let neighbours = planes.iter().flat_map(|plane| {
        let across = (0..plane.height()).flat_map(move |y| (1..plane.width()).map(move |x| (x - 1, y, x, y)));
        let down = (1..plane.height()).flat_map(move |y| (0..plane.width()).map(move |x| (x, y - 1, x, y)));
        across.chain(down).map(move |(x, y, to_x, to_y)| (plane.get(x, y) - plane.get(to_x, to_y)).abs())
    });
    neighbours.fold(0.0, f32::max)
}

#[test]
fn a_movement_begins_gradually_as_the_lens_opens() {
    for (name, mirror) in mirrors() {
        let camera = Camera { focus: 2.1, ..Camera::new(48, 36) };
        let stack = world(mirror, textured).stack(&camera, 1);
        let slope = steepest(&stack);
        for method in METHODS {
            let pictures: Vec<_> = (0..=60)
                .map(|step| Camera { f_number: 0.25 / (0.05 + 0.012 * step as f32), ..camera })
                .map(|camera| camera.render(stack.clone(), method, 128))
                .collect();
            let is_on = |at: usize| pictures[at].plan.does(EffectKind::Reflections);
            assert!(
                !is_on(0) && is_on(60),
                "{name}, {method}: {}",
                pictures[60].plan.effect(EffectKind::Reflections).reason
            );
            let steps: Vec<f32> =
                pictures.windows(2).map(|pair| difference(&pair[0].image, &pair[1].image)).collect();
            // A step opens the lens by up to 0.05 px at the far end of what is seen. From half a pixel to one the share that moves grows
            // by three a pixel, times what a blur of up to a pixel changes, less than half of the steepest slope.
            let allowed = slope * (0.05 + 3.0 * 0.05 * 0.5);
            let (at, most) = steps.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
            assert!(most < allowed, "{name}, {method}: {most} at step {at}, allowed {allowed}: {steps:?}");
        }
    }
}

/// `stack` with `change` added to the light of the fragment at `x, y`.
fn edited(stack: &Stack, (x, y): (usize, usize), change: f32) -> Stack {
    let mut stack = stack.clone();
    let light = &mut stack.shading[0].as_mut().unwrap().light;
    for plane in stack.peels[0].color.iter_mut().chain(light) {
        plane.set(x, y, plane.get(x, y) + change);
    }
    stack
}

#[test]
fn a_small_change_of_a_fragments_light_changes_the_picture_as_little() {
    const EDIT: f32 = 1e-4;
    let mut rng = Rng::with_seed(3);
    for (name, mirror) in mirrors() {
        let camera = Camera::new(48, 36);
        let stack = world(mirror, textured).stack(&camera, 1);
        for method in METHODS {
            let before = camera.render(stack.clone(), method, 64).image;
            for _ in 0..4 {
                let at = (rng.usize(8..40), rng.usize(8..28));
                let after = camera.render(edited(&stack, at, EDIT), method, 64).image;
                let most = difference(&before, &after);
                let total: f32 = (after.planes[1].values().iter().zip(before.planes[1].values()))
                    .map(|(after, before)| (after - before).abs())
                    .sum();
                assert!(most < 1.5 * EDIT, "{name}, {method}, {at:?}: {most}");
                // Movement magnifies: one place of a mirror can be seen at several.
                assert!(total < 8.0 * EDIT, "{name}, {method}, {at:?}: {total} in all");
            }
        }
    }
}

/// A mirror of `level` everywhere, but for a lamp in the middle that is infinitely far away.
fn lamp_in(level: f32, specular: Option<f32>) -> Stack {
    let mirror = Shape::plane(DVec3::new(0.0, 0.0, -2.0), DVec3::Z);
    let mut stack = world(mirror, grey).stack(&Camera::new(48, 36), 1);
    let lamp = |x: usize, y: usize| if x.abs_diff(24) + y.abs_diff(18) < 3 { 20.0 } else { 0.0 };
    let light = Plane::from_fn(48, 36, |x, y| level + lamp(x, y));
    let light = [light.clone(), light.clone(), light];
    stack.peels[0].color = light.clone();
    let shading = stack.shading[0].as_mut().unwrap();
    shading.light = light;
    shading.reflected_distance = Plane::filled(48, 36, NOTHING as f32);
    shading.specular = specular.map(|value| [0; 3].map(|_| Plane::filled(48, 36, value)));
    stack
}

#[test]
fn a_lamp_in_a_dark_mirror_is_the_disc_that_it_is_in_a_grey_one() {
    let camera = Camera::new(48, 36);
    for method in METHODS {
        let picture = |level| camera.render(lamp_in(level, Some(1.0)), method, 64).image;
        let grey = picture(0.25);
        for level in [0.0, 1e-6, 1.0 / 2048.0, 1.0 / 1024.0, 1.0 / 900.0] {
            let dark = picture(level);
            let off = (dark.planes[0].values().iter().zip(grey.planes[0].values()))
                .map(|(dark, grey)| (grey - dark - (0.25 - level)).abs())
                .fold(0.0, f32::max);
            // The lamp is 20: rounding of its light.
            assert!(off < 2e-4, "{method}, {level}: {off}");
        }
        let own = camera.render(without_shading(&lamp_in(0.0, None)), method, 64).image;
        assert!(difference(&grey, &own) > 1.0, "{method}: the lamp is blurred");
        // Of a surface that reflects nothing, nothing moves.
        let matt = camera.render(lamp_in(0.0, Some(0.0)), method, 64).image;
        assert_eq!(matt.pixel(30, 18)[0], 0.0, "{method}");
    }
}
