//! Stacks that renderers write by mistake, or rarely: each gives a picture without surprises, and a word where something is left out.

use crate::fixtures::{Part, exr_bytes, exr_bytes_displayed};
use crate::tracer::{
    Camera, Look, METHODS, NOTHING, Shape, World, difference, is_within, waves, without_shading,
};
use exr::image::FlatSamples;
use fastrand::Rng;
use glam::DVec3;
use std::path::Path;
use thinlens::image::{Image, Plane};
use thinlens::render::{Job, render_stack};
use thinlens::scene::EffectKind;
use thinlens::settings::{Border, Values};
use thinlens::stack::{Peel, ReadOptions, Shading, Source, Stack, StackKind};

fn sky(along: DVec3) -> [f64; 3] {
    waves(along, 0.7)
}

fn camera() -> Camera {
    Camera::new(32, 24)
}

/// A mirror that faces the camera and shows what lies 1.5 before it.
fn flat() -> Stack {
    let mirror = Shape::plane(DVec3::new(0.0, 0.0, -2.0), DVec3::Z);
    let mut stack = World { things: vec![(mirror, Look::Mirror)], environment: sky }.stack(&camera(), 1);
    shading(&mut stack).reflected_distance.values_mut().fill(1.5);
    stack
}

fn shading(stack: &mut Stack) -> &mut Shading {
    stack.shading[0].as_mut().unwrap()
}

/// Lets the mirror reflect only where `keeps` says so.
fn only(mut stack: Stack, keeps: impl Fn(usize, usize) -> bool) -> Stack {
    for plane in &mut shading(&mut stack).light {
        *plane =
            Plane::from_fn(
                plane.width(),
                plane.height(),
                |x, y| if keeps(x, y) { plane.get(x, y) } else { 0.0 },
            );
    }
    stack
}

fn with_normals(mut stack: Stack, normal: impl Fn(usize, usize) -> [f32; 3]) -> Stack {
    let [width, height] = [stack.width(), stack.height()];
    shading(&mut stack).normal = [0, 1, 2].map(|k| Plane::from_fn(width, height, |x, y| normal(x, y)[k]));
    stack
}

fn with_distance(mut stack: Stack, distance: f32) -> Stack {
    shading(&mut stack).reflected_distance.values_mut().fill(distance);
    stack
}

fn with_light(mut stack: Stack, light: impl Fn(usize, usize) -> f32) -> Stack {
    for plane in &mut shading(&mut stack).light {
        *plane = Plane::from_fn(plane.width(), plane.height(), &light);
    }
    stack
}

/// Alpha of [`translucent`].
const ALPHA: f32 = 0.3;

/// [`flat`], of which everything shines through.
fn translucent() -> Stack {
    let mut stack = flat();
    let [peel] = &mut stack.peels[..] else { unreachable!("it is one peel") };
    let light = &mut stack.shading[0].as_mut().unwrap().light;
    let planes = peel.color.iter_mut().chain([&mut peel.alpha]).chain(light);
    planes.for_each(|plane| plane.values_mut().iter_mut().for_each(|value| *value *= ALPHA));
    stack
}

/// A stack, what is said of it, and the range of its picture.
struct Case {
    name: &'static str,
    stack: Stack,
    said: Option<&'static str>,
    range: [f32; 2],
}

fn case(name: &'static str, stack: Stack, said: impl Into<Option<&'static str>>) -> Case {
    // The waves are between 0.15 and 0.85; smoothing over gaps between lens samples does not widen that.
    Case { name, stack, said: said.into(), range: [0.14, 1.001] }
}

/// Renders each case by each method and with two lenses.
fn check(cases: Vec<Case>) {
    for Case { name, stack, said, range } in cases {
        for method in METHODS {
            for f_number in [0.25, f32::INFINITY] {
                let camera = Camera { f_number, ..camera() };
                let rendered = camera.render(stack.clone(), method, 64);
                assert!(is_within(&rendered.image, range), "{name}, {method}, f/{f_number}");
                if f_number.is_infinite() {
                    let plain = camera.render(without_shading(&stack), method, 64).image;
                    assert_eq!(rendered.image, plain, "{name}, {method}: a pinhole");
                    continue;
                }
                let texts: Vec<&str> = rendered
                    .stack
                    .findings
                    .iter()
                    .filter(|finding| finding.about == "reflections")
                    .map(|finding| finding.text.as_str())
                    .collect();
                match said {
                    Some(words) => {
                        assert!(texts.iter().any(|text| text.contains(words)), "{name}, {method}: {texts:?}");
                    }
                    None => assert!(texts.is_empty(), "{name}, {method}: {texts:?}"),
                }
            }
        }
    }
}

#[test]
fn normals_of_every_kind_give_a_picture_and_a_word_where_they_are_none() {
    let no_normal = "have no normal that faces the camera";
    let mut rng = Rng::with_seed(5);
    let bumps: Vec<[f32; 3]> =
        (0..32 * 24).map(|_| [0.4 * rng.f32() - 0.2, 0.4 * rng.f32() - 0.2, 1.0]).collect();
    let unit = |[x, y, z]: [f32; 3]| [x, y, z].map(|value| value / (x * x + y * y + z * z).sqrt());
    check(vec![
        case("zero", with_normals(flat(), |_, _| [0.0; 3]), no_normal),
        case(
            "zero in a row",
            with_normals(flat(), |_, y| [0.0, 0.0, f32::from(u8::from(y != 7))]),
            no_normal,
        ),
        case("NaN", with_normals(flat(), |_, _| [f32::NAN; 3]), no_normal),
        case(
            "NaN in places",
            with_normals(
                flat(),
                |x, y| if (x + y) % 5 == 0 { [0.0, f32::NAN, 1.0] } else { [0.0, 0.0, 1.0] },
            ),
            no_normal,
        ),
        case("infinite", with_normals(flat(), |_, _| [0.0, 0.0, f32::INFINITY]), no_normal),
        case("huge", with_normals(flat(), |_, _| [0.0, 0.0, 1e30]), no_normal),
        case("from 0 to 1", with_normals(flat(), |_, _| [0.5, 0.5, 1.0]), None),
        case("bumpy", with_normals(flat(), |x, y| unit(bumps[32 * y + x])), "movement was limited"),
        case("of the world", with_normals(flat(), |_, _| [0.0, 0.0, -1.0]), "face away from the camera"),
    ]);
}

#[test]
fn normals_of_the_world_leave_the_picture_as_it_is_without_them() {
    let stack = with_normals(flat(), |_, _| [0.0, 0.0, -1.0]);
    for method in METHODS {
        let camera = camera();
        let plain = camera.render(without_shading(&stack), method, 64).image;
        assert_eq!(camera.render(stack.clone(), method, 64).image, plain, "{method}");
    }
}

#[test]
fn distances_of_every_kind_give_a_picture_and_a_word_where_they_are_none() {
    let none = "from a distance of 0 or less, or none";
    check(vec![
        case("0", with_distance(flat(), 0.0), none),
        case("-0", with_distance(flat(), -0.0), none),
        case("negative", with_distance(flat(), -3.0), none),
        case("NaN", with_distance(flat(), f32::NAN), none),
        case("minus infinity", with_distance(flat(), f32::NEG_INFINITY), none),
        case("infinite", with_distance(flat(), f32::INFINITY), None),
        case("of no hit", with_distance(flat(), NOTHING as f32), None),
        case("the largest half float", with_distance(flat(), 65504.0), None),
        case("the largest float", with_distance(flat(), f32::MAX), None),
        case("tiny", with_distance(flat(), 1e-6), None),
        case("the smallest float", with_distance(flat(), f32::from_bits(1)), none),
        case(
            "one of each",
            {
                let mut stack = flat();
                let all = [0.0, -1.0, f32::NAN, f32::INFINITY, 65504.0, 1e10, 1e-30, 0.5, 2.0];
                let plane = &mut shading(&mut stack).reflected_distance;
                *plane = Plane::from_fn(plane.width(), plane.height(), |x, y| all[(3 * x + y) % all.len()]);
                stack
            },
            none,
        ),
    ]);
}

#[test]
fn small_and_lonely_mirrors_give_a_picture() {
    check(vec![
        case("of one pixel", only(flat(), |x, y| (x, y) == (13, 9)), None),
        case("in a corner", only(flat(), |x, y| (x, y) == (0, 0)), None),
        case("in the last corner", only(flat(), |x, y| (x, y) == (31, 23)), None),
        case("a row", only(flat(), |_, y| y == 23), None),
        case("a column", only(flat(), |x, _| x == 31), None),
        case("a chessboard", only(flat(), |x, y| (x + y) % 2 == 0), None),
        case("none", only(flat(), |_, _| false), None),
    ]);
    let small = Camera::new(1, 1);
    let world =
        World { things: vec![(Shape::plane(DVec3::NEG_Z, DVec3::Z), Look::Mirror)], environment: sky };
    let stack = world.stack(&small, 1);
    for method in METHODS {
        let image = small.render(stack.clone(), method, 64).image;
        let own = stack.peels[0].color[0].get(0, 0);
        assert!((image.pixel(0, 0)[0] - own).abs() < 1e-5, "{method}: there is nothing else to see");
    }
}

#[test]
fn light_of_every_kind_gives_a_bounded_picture() {
    let bounded = |name, stack, range| Case { range, ..case(name, stack, None) };
    let lamp = |stack: Stack| {
        let mut stack = stack;
        let light = stack.shading[0].as_mut().unwrap().light.iter_mut();
        stack.peels[0].color.iter_mut().chain(light).for_each(|plane| plane.set(12, 9, 5000.0));
        stack
    };
    check(vec![
        bounded("translucent", translucent(), [0.04, 0.31]),
        bounded(
            "more than the colour",
            with_light(flat(), |x, y| 0.9 + 0.3 * ((x + y) % 2) as f32),
            [-0.3, 1.2],
        ),
        bounded("negative", with_light(flat(), |x, _| -0.05 - 0.01 * x as f32), [-0.4, 1.6]),
        bounded("a lamp", lamp(flat()), [0.0, 5001.0]),
        bounded("a lamp at an infinite distance", lamp(with_distance(flat(), f32::INFINITY)), [0.0, 5001.0]),
        bounded("NaN", with_light(flat(), |x, y| if (x + y) % 3 == 0 { f32::NAN } else { 0.2 }), [-0.3, 1.2]),
        bounded(
            "NaN in one colour",
            {
                let mut stack = flat();
                shading(&mut stack).light[1].values_mut().fill(f32::NAN);
                stack
            },
            [0.0, 1.2],
        ),
        bounded(
            "infinite",
            with_light(flat(), |x, y| if (x + y) % 3 == 0 { f32::INFINITY } else { 0.2 }),
            [-0.3, 1.2],
        ),
    ]);
}

#[test]
fn a_translucent_mirror_shows_its_share_of_what_an_opaque_one_shows() {
    for method in METHODS {
        let [opaque, seen] = [flat(), translucent()].map(|stack| {
            let switches = (&["reflections"][..], &["prefilter", "resolve", "highlights"][..]);
            camera().render_with(stack, method, switches).image
        });
        let shares = seen.planes[0].values().iter().zip(opaque.planes[0].values());
        let off = shares.map(|(seen, opaque)| (seen - ALPHA * opaque).abs()).fold(0.0, f32::max);
        assert!(off < 1e-4, "{method}: {off}");
    }
}

#[test]
fn a_concave_mirror_near_its_focus_is_limited_and_says_so() {
    // Reflected rays are parallel where the mirror is half its radius away.
    for radius in [3.9, 4.0, 4.1] {
        let sphere = Shape::Sphere { centre: DVec3::new(0.0, 0.0, radius - 2.0), radius: -radius };
        let stack = World { things: vec![(sphere, Look::Mirror)], environment: sky }.stack(&camera(), 1);
        for method in METHODS {
            let rendered = camera().render(stack.clone(), method, 64);
            assert!(is_within(&rendered.image, [0.14, 1.001]), "radius {radius}, {method}");
            let texts: Vec<_> = rendered.stack.findings.iter().map(|finding| finding.text.clone()).collect();
            assert!(
                texts.iter().any(|text| text.contains("concave mirror does near its focus")),
                "{texts:?}"
            );
        }
    }
}

/// A pole before a mirror: beside it the mirror is in the first peel, behind it in the second.
fn pole(has_mirror_behind: bool) -> Stack {
    let mirror = flat();
    let is_pole = |x: usize| (14..18).contains(&x);
    let front = Peel {
        color: [0, 1, 2].map(|k| {
            Plane::from_fn(32, 24, |x, y| if is_pole(x) { 0.5 } else { mirror.peels[0].color[k].get(x, y) })
        }),
        alpha: Plane::filled(32, 24, 1.0),
        depth: Plane::from_fn(32, 24, |x, _| if is_pole(x) { 1.3 } else { 2.0 }),
    };
    let cut = |plane: &Plane, keeps: &dyn Fn(usize) -> bool| {
        Plane::from_fn(32, 24, |x, y| if keeps(x) { plane.get(x, y) } else { 0.0 })
    };
    let behind = Peel {
        color: mirror.peels[0].color.each_ref().map(|plane| cut(plane, &is_pole)),
        alpha: Plane::from_fn(32, 24, |x, _| f32::from(u8::from(is_pole(x)))),
        depth: Plane::from_fn(32, 24, |x, _| if is_pole(x) { 2.0 } else { 1e10 }),
    };
    let shading = mirror.shading[0].as_ref().unwrap();
    let part = |keeps: &dyn Fn(usize) -> bool| {
        let light = shading.light.each_ref().map(|plane| cut(plane, keeps));
        Shading::new(
            light,
            shading.normal.each_ref().map(|plane| cut(plane, keeps)),
            cut(&shading.reflected_distance, keeps),
        )
    };
    let mut stack = Stack::from_peels(vec![front, behind], camera().frame, &ReadOptions::default()).unwrap();
    stack.shading = vec![Some(part(&|x| !is_pole(x))), has_mirror_behind.then(|| part(&is_pole))];
    stack
}

#[test]
fn a_mirror_beside_and_behind_a_pole_is_one_mirror() {
    let camera = camera();
    let scene = thinlens::scene::Scene::from_stack(&mut pole(true), &camera.lens(), &camera.depth_scale());
    let reflections = scene.reflections.unwrap();
    let surface =
        |layer: usize, x: usize, y: usize| reflections.layers[layer].as_ref().unwrap().surface[32 * y + x];
    assert!(surface(0, 2, 12) > 0);
    for y in [0, 12, 23] {
        assert_eq!([surface(0, 2, 12), surface(0, 30, y), surface(1, 15, y)], [surface(0, 2, 12); 3]);
    }
    assert_eq!(surface(0, 15, 12), 0, "the pole");
    check(vec![case("behind and beside", pole(true), None), case("only beside", pole(false), None)]);
    // Away from the pole by what it blurs, the picture is that of the mirror alone.
    for method in METHODS {
        let [with, alone] = [pole(true), flat()].map(|stack| camera.render(stack, method, 64).image);
        let margin = [0usize, 24].map(|x| {
            let part = |image: &Image| image.clone().part([x, 0], (8, 24));
            difference(&part(&with), &part(&alone))
        });
        assert!(margin.into_iter().all(|off| off < 0.02), "{method}: {margin:?}");
    }
}

#[test]
fn two_flat_mirrors_at_an_angle_show_only_their_own_light() {
    // The left mirror shows red alone, the right one green alone.
    let color = |left: bool| if left { [0.8f32, 0.0, 0.0] } else { [0.0, 0.8, 0.0] };
    let tilt = 20f32.to_radians();
    let mut stack = with_normals(with_distance(flat(), f32::INFINITY), |x, _| {
        if x < 16 { [tilt.sin(), 0.0, tilt.cos()] } else { [-tilt.sin(), 0.0, tilt.cos()] }
    });
    let planes = [0, 1, 2].map(|k| Plane::from_fn(32, 24, |x, _| color(x < 16)[k]));
    // Both planes meet in the middle, at the depth in focus.
    stack.peels[0].depth = Plane::from_fn(32, 24, |x, _| {
        let across = (x as f32 + 0.5 - 16.0) / camera().focal_px() as f32;
        2.0 / (1.0 + across.abs() * tilt.tan())
    });
    stack.peels[0].color = planes.clone();
    shading(&mut stack).light = planes;
    for method in METHODS {
        let image = camera().render(stack.clone(), method, 64).image;
        assert!(is_within(&image, [-1e-5, 1.0001]), "{method}");
        // Where they meet they are in focus, and what they show is blurred by 2 px.
        for x in [4, 10, 14, 15, 16, 17, 21, 27] {
            let [red, green, ..] = image.pixel(x, 12);
            let (own, other) = if x < 16 { (red, green) } else { (green, red) };
            assert!(own > 0.79 && other < 0.01, "{method} at {x}: {red}, {green}");
        }
    }
}

/// `stack` as a file, which has its reflections only with `channels`.
fn file(stack: &Stack, channels: bool) -> Vec<u8> {
    let [peel] = &stack.peels[..] else { unreachable!("it is one peel") };
    let samples = |plane: &Plane| FlatSamples::F32(plane.values().to_vec());
    let mut part = Part::flat((32, 24), "Peel0.Combined.R=0");
    let mut add = |name: &str, plane: &Plane| {
        let part = &mut part.channels;
        part.retain(|(other, _)| other != name);
        part.push((name.to_owned(), samples(plane)));
    };
    for (name, plane) in ["R", "G", "B"].into_iter().zip(&peel.color) {
        add(&format!("Peel0.Combined.{name}"), plane);
    }
    add("Peel0.Combined.A", &peel.alpha);
    add("Peel0.Depth.Z", &peel.depth);
    if channels {
        let shading = stack.shading[0].as_ref().unwrap();
        for (k, name) in ["R", "G", "B"].into_iter().enumerate() {
            let diffuse = Plane::from_fn(32, 24, |x, y| peel.color[k].get(x, y) - shading.light[k].get(x, y));
            add(&format!("Peel0.Diffuse.{name}"), &diffuse);
        }
        for (name, plane) in ["X", "Y", "Z"].into_iter().zip(&shading.normal) {
            add(&format!("Peel0.Normal.{name}"), plane);
        }
        add("Peel0.ReflectedDistance.V", &shading.reflected_distance);
    }
    exr_bytes(vec![part])
}

/// A file of a pole at `depth` in the columns 4 to 7, in a data window that begins `above` rows above the frame.
fn pole_file(depth: f32, above: usize) -> Vec<u8> {
    let inside = |x: usize| (4..8).contains(&x);
    let values = |value: f32, other: f32| {
        FlatSamples::F32((0..32 * (24 + above)).map(|i| if inside(i % 32) { value } else { other }).collect())
    };
    let part = Part::flat((32, 24 + above), "R=0 G=0 B=0")
        .with("A", values(1.0, 0.0))
        .with("Z", values(depth, 1e10))
        .at(0, -(above as i32));
    exr_bytes_displayed(vec![part], (32, 24))
}

#[test]
fn a_mirror_beside_a_holdout_moves_as_it_does_without_it() {
    let folder = tempfile::tempdir().unwrap();
    let holdout = folder.path().join("holdout.exr");
    for (depth, above, method) in [(1.5, 0), (1.5, 8), (5.0, 0)]
        .into_iter()
        .flat_map(|(depth, above)| METHODS.map(|method| (depth, above, method)))
    {
        std::fs::write(&holdout, pole_file(depth, above)).unwrap();
        let render = |channels: bool, holdout: Option<&Path>| {
            let job = camera().job(method, 64);
            let sources = vec![Source::memory("mirror.exr", file(&flat(), channels))];
            // One peel alone would be taken for an anti-aliased picture.
            let kind = Some(StackKind::PointSampled);
            let values = Values { holdout: holdout.map(Path::to_owned), kind, ..job.flags.clone() };
            thinlens::render::render(&Job { sources, flags: values, ..job }, &|_| {}).unwrap()
        };
        let (alone, with, still) = (render(true, None), render(true, Some(&holdout)), render(false, None));
        let case = format!("{method}, holdout at {depth}, {above} rows more");
        assert!(
            with.plan.does(EffectKind::Reflections),
            "{case}: {}",
            with.plan.effect(EffectKind::Reflections).reason
        );
        let part = |image: &Image| {
            let above = image.height() - 24;
            // Eight rows more, so that lens samples are the same in each row. Rows beyond the frame are known to be empty: the mirror's are not repeated there.
            image.clone().part([16, above + 8], (16, 16))
        };
        let off = difference(&part(&with.image), &part(&alone.image));
        let moved = difference(&part(&still.image), &part(&alone.image));
        assert!(off < 1e-5 && moved > 0.01, "{case}: {off}, movement {moved}");
        assert!(is_within(&with.image, [-1e-5, 1.001]), "{case}");
    }
}

#[test]
fn confidence_is_that_of_the_surfaces_whatever_they_reflect() {
    for method in METHODS {
        let masks = [flat(), without_shading(&flat())].map(|stack| {
            let job = Job { confidence: true, ..camera().job(method, 64) };
            render_stack(stack, &job, &|_| {}).unwrap().confidence.unwrap()
        });
        let off =
            masks[0].values().iter().zip(masks[1].values()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(off < 1e-5, "{method}: {off}");
    }
}

#[test]
fn borders_of_every_kind_and_lenses_focused_at_infinity_give_a_picture() {
    for method in METHODS {
        for border in [Border::Transparent, Border::Mirror] {
            let job = camera().job(method, 64);
            let values = Values { border: Some(border), ..job.flags.clone() };
            let rendered = render_stack(flat(), &Job { flags: values, ..job }, &|_| {}).unwrap();
            assert!(is_within(&rendered.image, [-1e-4, 1.001]), "{method}, {border:?}");
            assert!(rendered.plan.does(EffectKind::Reflections), "{method}, {border:?}");
        }
        let camera = Camera { focus: f32::INFINITY, f_number: 20.0, ..camera() };
        let rendered = camera.render(flat(), method, 64);
        assert!(is_within(&rendered.image, [0.14, 1.001]), "{method}, focused at infinity");
    }
}
