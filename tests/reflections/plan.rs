//! Whether reflections are moved, why, and by whose choice.

use crate::tracer::{Camera, Look, METHODS, Shape, World, difference, waves, without_shading};
use glam::DVec3;
use thinlens::methods::METHODS as EVERY_METHOD;
use thinlens::render::{Rendered, prepare_stack};
use thinlens::scene::{Effect, EffectKind};
use thinlens::stack::Stack;

fn sky(along: DVec3) -> [f64; 3] {
    waves(along, 0.2)
}

fn grey(_: DVec3) -> [f64; 3] {
    [0.4; 3]
}

/// A mirror in focus that fills the frame.
fn mirror(environment: fn(DVec3) -> [f64; 3]) -> Stack {
    let plane = Shape::plane(DVec3::new(0.0, 0.0, -2.0), DVec3::new(0.2, 0.0, 1.0));
    World { things: vec![(plane, Look::Mirror)], environment }.stack(&Camera::new(40, 30), 1)
}

fn effect(rendered: &Rendered) -> &Effect {
    rendered.plan.effect(EffectKind::Reflections)
}

#[test]
fn reflections_are_moved_where_that_shows_with_shares_and_otherwise_not_with_the_reason() {
    for method in METHODS {
        let camera = Camera::new(40, 30);
        let on = camera.render(mirror(sky), method, 64);
        let found = effect(&on);
        assert!(found.on && !found.forced, "{method}: {}", found.reason);
        assert!(found.reason.contains("100.0 % of the fragments reflect"), "{method}: {}", found.reason);
        assert!(found.change.contains('%'), "{method}: {}", found.change);

        let plain = camera.render(without_shading(&mirror(sky)), method, 64);
        assert!(!effect(&plain).on);
        assert!(effect(&plain).reason.contains("no channel says"), "{}", effect(&plain).reason);

        let even = camera.render(mirror(grey), method, 64);
        assert!(!effect(&even).on, "it shows nothing else: {}", effect(&even).reason);

        let closed = Camera { f_number: 8.0, ..camera }.render(mirror(sky), method, 64);
        assert!(
            !effect(&closed).on && effect(&closed).reason.contains("px at most"),
            "{}",
            effect(&closed).reason
        );
    }
}

#[test]
fn methods_that_cannot_move_reflections_leave_them_out() {
    for method in EVERY_METHOD.into_iter().filter(|method| !METHODS.contains(&method.info().name)) {
        let name = method.info().name;
        let mut job = Camera::new(40, 30).job(name, 64);
        if !method.samples_lens() {
            job.flags.effort = None;
        }
        let prepared = prepare_stack(mirror(sky), &job).unwrap();
        let found = prepared.plan.effect(EffectKind::Reflections);
        assert_eq!(
            found.on,
            method.info().effects.contains(&EffectKind::Reflections),
            "{name}: {}",
            found.reason
        );
    }
}

#[test]
fn what_is_left_out_is_the_picture_without_channels_and_what_is_forced_is_done() {
    for method in METHODS {
        let camera = Camera::new(40, 30);
        let left_out = camera.render_with(mirror(sky), method, (&[], &["reflections"]));
        let plain = camera.render_with(without_shading(&mirror(sky)), method, (&[], &["reflections"]));
        assert!(!effect(&left_out).on && effect(&left_out).forced);
        assert_eq!(left_out.image, plain.image, "{method}");

        let own = camera.render_with(mirror(sky), method, (&[], &[]));
        let forced = camera.render_with(mirror(sky), method, (&["reflections"], &[]));
        assert_eq!(own.image, forced.image, "{method}: it was on");
        assert!(difference(&own.image, &plain.image) > 0.05, "{method}: and shows");

        let nothing_to_move =
            camera.render_with(without_shading(&mirror(sky)), method, (&["reflections"], &[]));
        let plain = camera.render_with(without_shading(&mirror(sky)), method, (&[], &[]));
        assert_eq!(nothing_to_move.image, plain.image, "{method}: forced without channels");
    }
}

#[test]
fn channels_that_move_nothing_leave_every_bit_of_the_picture() {
    // The lens moves what the mirror shows by less than half a pixel.
    let camera = Camera { f_number: 6.0, focus: 1.0, ..Camera::new(40, 30) };
    for method in METHODS {
        for force in [&[][..], &["reflections"]] {
            let [with, without] = [mirror(sky), without_shading(&mirror(sky))]
                .map(|stack| camera.render_with(stack, method, (force, &[])).image);
            assert_eq!(with, without, "{method}, forced {force:?}");
        }
    }
}
