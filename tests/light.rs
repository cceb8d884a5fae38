//! Light without alpha: it adds, is hidden by what is before it, and hides nothing.

#![expect(clippy::unwrap_used, reason = "a test stops at the first failure")]

use thinlens::gpu::DeviceChoice;
use thinlens::image::{Image, Plane};
use thinlens::methods::{Law, METHODS, Method};
use thinlens::render::{Job, render_stack};
use thinlens::settings::{Effort, Focus, Values};
use thinlens::stack::{Frame, Peel, ReadOptions, Stack};

const WIDTH: usize = 120;
const HEIGHT: usize = 80;

/// Background depth, as Blender writes it.
const NONE: f32 = 1e10;

/// A peel of `sample(x, y)` = grey, alpha and depth.
fn peel(sample: impl Fn(usize, usize) -> (f32, f32, f32)) -> Peel {
    let grey = Plane::from_fn(WIDTH, HEIGHT, |x, y| sample(x, y).0);
    Peel {
        color: [grey.clone(), grey.clone(), grey],
        alpha: Plane::from_fn(WIDTH, HEIGHT, |x, y| sample(x, y).1),
        depth: Plane::from_fn(WIDTH, HEIGHT, |x, y| sample(x, y).2),
    }
}

/// A soft glow around the middle of the picture, without an end that is brighter than 0.
fn glow(x: usize, y: usize) -> f32 {
    let [dx, dy] = [x as f32 - 60.0, y as f32 - 40.0];
    let light = 0.8 * (-(dx * dx + dy * dy) / 40.0).exp();
    if light > 1e-3 { light } else { 0.0 }
}

/// The picture of `peels` by `method`: a CoC radius of 10.1 px at infinity, focused on depth 3.
fn picture(peels: Vec<Peel>, method: &dyn Method, f_number: f32) -> Image {
    let stack = Stack::from_peels(peels, Frame::from_size(WIDTH, HEIGHT), &ReadOptions::default()).unwrap();
    let values = Values {
        method: Some(method.info().name.to_owned()),
        effort: method.samples_lens().then_some(Effort::Views(64)),
        focal_length_mm: Some(135.0),
        f_number: Some(f_number),
        sensor_width_mm: Some(36.0),
        focus: Some(Focus::Distance(3.0)),
        ..Values::default()
    };
    let job = Job { device: DeviceChoice::Cpu, ..Job::default() }.with_values(values);
    render_stack(stack, &job, &|_| {}).unwrap().image
}

fn shear() -> &'static dyn Method {
    METHODS.into_iter().find(|method| method.info().name == "shear").unwrap()
}

fn sum(plane: &Plane) -> f64 {
    plane.values().iter().map(|&value| f64::from(value)).sum()
}

#[test]
fn without_a_lens_light_is_the_input_bit_for_bit() {
    type Sample = fn(usize, usize) -> (f32, f32, f32);
    let one_pixel: Sample = |x, y| if (x, y) == (17, 5) { (3.25, 0.0, NONE) } else { (0.0, 0.0, NONE) };
    let at_the_edge: Sample = |x, _| if x == 0 { (0.1, 0.0, 2.0) } else { (0.7, 1.0, 5.0) };
    let everywhere: Sample = |x, y| (0.01 * (x + y) as f32 - 0.2, 0.0, 4.0);
    let translucent: Sample = |x, y| if x < 60 { (glow(x, y), 0.0, NONE) } else { (0.25, 0.5, 3.0) };
    for (case, input) in [one_pixel, at_the_edge, everywhere, translucent].into_iter().enumerate() {
        let found = picture(vec![peel(input)], shear(), f32::INFINITY);
        let expected = Image::from_fn(WIDTH, HEIGHT, |x, y| {
            let (grey, alpha, _) = input(x, y);
            [grey, grey, grey, alpha]
        });
        assert_eq!(found, expected, "input {case}");
    }
}

#[test]
fn light_alone_keeps_its_energy_and_gets_no_alpha_by_every_method() {
    let lone = || peel(|x, y| (glow(x, y), 0.0, NONE));
    let before: f64 = sum(&lone().color[0]);
    for method in METHODS {
        let info = method.info();
        let deviation = info.deviations.iter().find(|deviation| deviation.law == Law::Energy);
        let [least, most] = deviation.map_or([0.95, 1.05], |deviation| deviation.within);
        let image = picture(vec![lone()], method, 1.0);
        let kept = sum(&image.planes[0]) / before;
        assert!(
            (f64::from(least).min(0.95)..=f64::from(most).max(1.05)).contains(&kept),
            "{}: {kept}",
            info.name
        );
        let alpha = image.planes[3].values().iter().copied().fold(0.0, f32::max);
        assert!(alpha < 1e-4, "{}: alpha {alpha}", info.name);
        let peak = image.planes[0].values().iter().copied().fold(0.0, f32::max);
        assert!(peak < 0.6, "{}: {peak} is not blurred", info.name);
    }
}

/// A disc in focus before a wall, and a peel of light between or before them, `strength` times as bright.
fn lit(strength: f32, depth: f32) -> Vec<Peel> {
    let is_disc = |x: usize, y: usize| (x as f32 - 85.0).hypot(y as f32 - 40.0) < 14.0;
    let light = peel(|x, y| (strength * glow(x, y), 0.0, depth));
    let disc = peel(|x, y| if is_disc(x, y) { (0.3, 1.0, 3.0) } else { (0.0, 0.0, NONE) });
    let wall = peel(|x, y| (0.2 + 0.6 * ((x / 8 + y / 8) % 2) as f32, 1.0, 12.0));
    vec![light, disc, wall]
}

#[test]
fn light_adds_as_much_as_there_is_and_changes_nothing_beyond_its_blur() {
    for method in METHODS.into_iter().filter(|method| method.lens_sampling().is_some()) {
        let name = method.info().name;
        for (depth, reach) in [(NONE, 12), (2.0, 9)] {
            let [dark, bright] = [0.0, 1.0].map(|strength| picture(lit(strength, depth), method, 1.0));
            assert_eq!(dark.planes[3], bright.planes[3], "{name}, depth {depth}: alpha");
            let added = sum(&bright.planes[0]) - sum(&dark.planes[0]);
            // Of light on the wall, the disc hides a little.
            let expected = sum(&peel(|x, y| (glow(x, y), 0.0, NONE)).color[0]);
            assert!(
                (0.9..1.05).contains(&(added / expected)),
                "{name}, depth {depth}: {added} of {expected}"
            );
            if !["shear", "accumulate"].contains(&name) {
                // Where the others look for hits follows the range of CoC radii, which the light widens.
                continue;
            }
            for y in 0..HEIGHT {
                for x in 0..WIDTH {
                    let [before, after] = [&dark, &bright].map(|image| image.planes[0].get(x, y));
                    assert!(
                        after >= before - 1e-4,
                        "{name}, depth {depth}: {after} after {before} at {x}, {y}"
                    );
                    let away = x.abs_diff(60).max(y.abs_diff(40));
                    // The light ends 17 px from its middle.
                    assert!(
                        away <= 17 + 2 * reach || before == after,
                        "{name}, depth {depth}: changed at {x}, {y}"
                    );
                }
            }
        }
    }
}

#[test]
fn what_is_before_light_hides_it_and_what_is_behind_shows_through_it() {
    // A sharp, opaque wall over the right half, before and behind light that covers all.
    let half = || peel(|x, _| if x >= 60 { (0.5, 1.0, 3.0) } else { (0.0, 0.0, NONE) });
    let light = |depth| peel(move |_, _| (1.0, 0.0, depth));
    let at = |peels: Vec<Peel>| picture(peels, shear(), 1.0).pixel(90, 40);
    assert_eq!(at(vec![half(), light(12.0)])[0], 0.5, "behind the wall");
    let before = at(vec![light(2.0), half()]);
    assert!((before[0] - 1.5).abs() < 1e-3 && before[3] == 1.0, "before it: {before:?}");
}
