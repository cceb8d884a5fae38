//! Environments: what surfaces reflect of them is shaded anew for each point of the lens.

#![expect(clippy::unwrap_used, reason = "a test stops at the first failure")]

#[expect(dead_code, reason = "other tests use the rest")]
mod fixtures;

use exr::image::FlatSamples;
use exr::meta::attribute::AttributeValue;
use fixtures::{Part, exr_bytes};
use std::f32::consts::PI;
use std::path::{Path, PathBuf};
use thinlens::error::Error;
use thinlens::gpu::DeviceChoice;
use thinlens::image::Image;
use thinlens::render::{Job, render};
use thinlens::settings::{Effort, EnvironmentAxes, Focus, Values};
use thinlens::stack::Source;

const WIDTH: usize = 96;
const HEIGHT: usize = 8;

/// Radius of the lens over the distance in focus, times the focal length in pixels: 9 mm, 0.1 m, 48 px.
const COC_INFINITY_PX: f32 = 0.009 / 0.1 * 48.0;

/// A camera that looks along the world's −z, with y up.
const AHEAD: [f32; 16] = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.];

/// The same with the world's z up: it looks along +y.
const AHEAD_OF_BLENDER: [f32; 16] = [1., 0., 0., 0., 0., 0., -1., 0., 0., 1., 0., 0., 0., 0., 0., 1.];

/// A mirror that faces the camera at `depth`, and reflects what lies to the right of the axis as white, the rest as black.
fn mirror(depth: f32, distance: f32) -> Part {
    let step = || {
        FlatSamples::F32((0..WIDTH * HEIGHT).map(|i| if i % WIDTH < WIDTH / 2 { 0.0 } else { 1.0 }).collect())
    };
    let size = (WIDTH, HEIGHT);
    let same = "Peel0.Combined.A=1 Peel0.Diffuse.R=0 Peel0.Diffuse.G=0 Peel0.Diffuse.B=0 Peel0.Normal.X=0 Peel0.Normal.Y=0 Peel0.Normal.Z=1 \
        Peel0.Specular.R=1 Peel0.Specular.G=1 Peel0.Specular.B=1 Peel0.Roughness.V=0";
    let same = format!("{same} Peel0.Depth.Z={depth} Peel0.ReflectedDistance.V={distance}");
    let part = Part::flat(size, &same);
    ["R", "G", "B"].iter().fold(part, |part, channel| part.with(&format!("Peel0.Combined.{channel}"), step()))
}

fn seen_from(part: Part, camera: [f32; 16]) -> Source {
    Source::memory(
        "mirror.exr",
        exr_bytes(vec![part.attribute("worldToCamera", AttributeValue::Matrix4x4(camera))]),
    )
}

/// An environment that is white in columns where `is_white` of their share of the width, in a folder of its own.
fn environment(folder: &Path, is_white: impl Fn(f32) -> bool) -> PathBuf {
    let (width, height) = (2048, 16);
    let values = |_| {
        FlatSamples::F32(
            (0..width * height)
                .map(|i| f32::from(u8::from(is_white((i % width) as f32 / width as f32))))
                .collect(),
        )
    };
    let part = ["R", "G", "B"]
        .iter()
        .fold(Part::flat((width, height), "R=0 G=0 B=0"), |part, name| part.with(name, values(name)));
    let path = folder.join("environment.exr");
    std::fs::write(&path, exr_bytes(vec![part])).unwrap();
    path
}

fn values(environment: Option<PathBuf>, method: &str) -> Values {
    Values {
        method: Some(method.to_owned()),
        effort: Some(Effort::Views(256)),
        focal_length_mm: Some(18.0),
        f_number: Some(1.0),
        sensor_width_mm: Some(36.0),
        focus: Some(Focus::Distance(0.1)),
        environment,
        ..Values::default()
    }
}

fn picture(source: Source, values: Values) -> Result<Image, Error> {
    let job = Job { device: DeviceChoice::Cpu, ..Job::new([source]).with_values(values) };
    Ok(render(&job, &|_| {})?.image)
}

/// Share of the unit disc to the right of −`t`.
fn share_to_the_right(t: f32) -> f32 {
    let t = t.clamp(-1.0, 1.0);
    0.5 + (t * (1.0 - t * t).sqrt() + t.asin()) / PI
}

/// Asserts that each pixel of the middle row shows the share of the lens that sees white, to the right of the axis.
fn assert_blurred_as_at_infinity(picture: &Image, what: &str) {
    for x in 30..WIDTH - 30 {
        let from_axis = x as f32 + 0.5 - WIDTH as f32 / 2.0;
        let t = from_axis / COC_INFINITY_PX;
        let expected = share_to_the_right(t);
        let found = picture.pixel(x, HEIGHT / 2)[0];
        // A pixel is as wide as 0.23 of the lens, over which the share is nearly linear; 256 rays leave a hundredth.
        assert!((found - expected).abs() < 0.03, "{what}, column {x}: {found}, expected {expected}");
    }
}

#[test]
fn a_mirror_shows_the_environment_in_focus_at_infinity_wherever_it_stands() {
    let folder = tempfile::tempdir().unwrap();
    // Behind the camera, where the mirror points, +x is left of the centre.
    let right_half = environment(folder.path(), |share| share < 0.5);
    for method in ["accumulate", "layer-rays"] {
        // In focus; at twice the distance, with half of the CoC radius of infinity; and in front.
        for depth in [0.1, 0.2, 0.08] {
            let source = seen_from(mirror(depth, 1e10), AHEAD);
            let seen = picture(source, values(Some(right_half.clone()), method)).unwrap();
            assert_blurred_as_at_infinity(&seen, &format!("{method}, depth {depth}"));
        }
    }
}

#[test]
fn the_axes_and_the_rotation_of_the_environment_are_those_of_the_settings() {
    let folder = tempfile::tempdir().unwrap();
    // In Blender's world the mirror points to −y, the map's u = ¾; +x lies on the side of its centre.
    let right_half = environment(folder.path(), |share| (0.25..0.75).contains(&share));
    let blender = || Values {
        environment_axes: Some(EnvironmentAxes::Blender),
        ..values(Some(right_half.clone()), "accumulate")
    };
    let source = || seen_from(mirror(0.1, 1e10), AHEAD_OF_BLENDER);
    assert_blurred_as_at_infinity(&picture(source(), blender()).unwrap(), "Blender's axes");
    // Turned by half a circle, the environment is black where the stack shows white: the two add up to more than white, or to less than
    // nothing, which is cut off.
    let turned = Values { environment_rotation_deg: Some(180.0), ..blender() };
    let seen = picture(source(), turned).unwrap();
    let share = share_to_the_right(0.5 / COC_INFINITY_PX);
    for (x, expected) in [(WIDTH / 2 - 1, 0.0), (WIDTH / 2, 1.0 + (1.0 - share))] {
        let found = seen.pixel(x, HEIGHT / 2)[0];
        assert!((found - expected).abs() < 0.03, "column {x}: {found}, expected {expected}");
    }
}

#[test]
fn an_even_environment_and_a_reflected_surface_change_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let [even, stripes] = [environment(folder.path(), |_| true), {
        let other = folder.path().join("other");
        std::fs::create_dir(&other).unwrap();
        environment(&other, |share| ((share * 100.0) as usize).is_multiple_of(2))
    }];
    for method in ["accumulate", "layer-rays"] {
        for (distance, file) in [(1e10, &even), (3.0, &stripes)] {
            let without = Values { switches: None, ..values(None, method) };
            let picture = |values: Values| {
                let switches = thinlens::settings::Switches {
                    without: vec!["reflections".to_owned()],
                    ..Default::default()
                };
                picture(
                    seen_from(mirror(0.12, distance), AHEAD),
                    Values { switches: Some(switches), ..values },
                )
                .unwrap()
            };
            let (plain, shaded) = (picture(without), picture(values(Some(file.clone()), method)));
            for (plain, shaded) in plain.planes[0].values().iter().zip(shaded.planes[0].values()) {
                assert!((plain - shaded).abs() < 1e-5, "{method}, {distance}: {plain}, {shaded}");
            }
        }
    }
}

#[test]
fn a_stack_that_lacks_what_the_environment_needs_is_refused_with_what_is_wanted() {
    let folder = tempfile::tempdir().unwrap();
    let sky = environment(folder.path(), |_| true);
    let refused =
        |source: Source| picture(source, values(Some(sky.clone()), "accumulate")).unwrap_err().to_string();
    let without_camera = refused(Source::memory("mirror.exr", exr_bytes(vec![mirror(0.1, 1e10)])));
    assert!(without_camera.contains("worldToCamera"), "{without_camera}");
    let mut bare = mirror(0.1, 1e10);
    bare.channels.retain(|(name, _)| !name.contains("Specular"));
    let without_reflectance = refused(seen_from(bare, AHEAD));
    assert!(without_reflectance.contains("Peel0.Specular"), "{without_reflectance}");
    let cube = exr::meta::attribute::EnvironmentMap::Cube;
    let part = Part::flat((8, 48), "R=0 G=0 B=0").attribute("envmap", AttributeValue::EnvironmentMap(cube));
    let path = folder.path().join("cube.exr");
    std::fs::write(&path, exr_bytes(vec![part])).unwrap();
    let source = seen_from(mirror(0.1, 1e10), AHEAD);
    let cube = picture(source, values(Some(path), "accumulate")).unwrap_err().to_string();
    assert!(cube.contains("six faces of a cube") && cube.contains("`environment`"), "{cube}");
}
