//! Values that cannot be what they are given as: depth, peels, alpha.

use crate::fixtures::{Part, exr_bytes, failure, source, stack_of};
use crate::warnings;
use exr::image::FlatSamples;
use exr::meta::attribute::{AttributeValue, Text};
use thinlens::error::ErrorKind;
use thinlens::render::{Job, prepare_stack};
use thinlens::settings::{AlphaMode, DepthConvention, Effort, Focus, Values};
use thinlens::stack::{ReadOptions, Source, Stack, StackKind, read};

const SIZE: (usize, usize) = (24, 16);

/// One value a pixel.
fn samples(value: impl Fn(usize, usize) -> f32) -> FlatSamples {
    FlatSamples::F32((0..SIZE.0 * SIZE.1).map(|i| value(i % SIZE.0, i / SIZE.0)).collect())
}

/// An opaque grey picture with this depth in channel `channel`.
fn picture(channel: &str, depth: impl Fn(usize, usize) -> f32) -> Part {
    Part::flat(SIZE, "R=0.5 G=0.5 B=0.5 A=1").with(channel, samples(depth))
}

/// A block at `near` before a wall at `far`, `shift` columns to the right.
fn block(near: f32, far: f32, shift: usize) -> impl Fn(usize, usize) -> f32 {
    move |x, y| if (6 + shift..12 + shift).contains(&x) && (4..10).contains(&y) { near } else { far }
}

fn read_with(part: Part, options: &ReadOptions) -> Stack {
    read(&[source(exr_bytes(vec![part]))], options).unwrap_or_else(|error| panic!("{error}"))
}

fn is_said(stack: &Stack, text: &str) -> bool {
    stack.findings.iter().any(|finding| finding.text.contains(text))
}

#[test]
fn depth_of_nothing_but_zero_or_minus_one_is_refused() {
    for (value, named) in
        [(0.0, "is 0 everywhere"), (-1.0, "is -1 everywhere"), (f32::NAN, "is NaN everywhere")]
    {
        let error = failure(exr_bytes(vec![picture("Z", |_, _| value)]));
        assert_eq!(error.kind(), ErrorKind::Input);
        assert!(
            error.to_string().contains(named) && error.to_string().contains("`depth_channel`"),
            "{error}"
        );
    }
}

#[test]
fn one_distance_beside_any_background_is_read_as_before() {
    for background in [0.0, -1.0, 1e10, f32::INFINITY, f32::NAN, f32::NEG_INFINITY] {
        let depth = |x: usize, y: usize| if y < 8 { background } else { 3.0 + x as f32 };
        let options = ReadOptions { kind: Some(StackKind::PointSampled), ..ReadOptions::default() };
        let stack = read_with(picture("Z", depth), &options);
        let read: Vec<u32> = stack.peels[0].depth.values().iter().map(|depth| depth.to_bits()).collect();
        let FlatSamples::F32(written) = samples(depth) else { unreachable!() };
        assert_eq!(read, written.iter().map(|depth| depth.to_bits()).collect::<Vec<_>>(), "{background}");
        assert!(warnings(&stack).is_empty(), "{background}: {:?}", warnings(&stack));
    }
}

#[test]
fn sky_alone_is_read_with_a_warning_and_mitsubas_zero_is_sky() {
    let sky = stack_of(vec![picture("Z", |_, _| 1e10)]);
    assert!(warnings(&sky).iter().any(|text| text.contains("nothing but background")));
    let mitsuba = AttributeValue::Text(Text::from("Mitsuba version 3.9.1"));
    let sky = stack_of(vec![picture("depth.T", |_, _| 0.0).attribute("generatedBy", mitsuba)]);
    assert!(warnings(&sky).iter().any(|text| text.contains("nothing but background")));
}

#[test]
fn distances_along_minus_z_are_those_without_the_sign() {
    let forwards = stack_of(vec![picture("Z", block(3.0, 12.0, 0))]);
    let backwards = stack_of(vec![picture("Z", block(-3.0, -12.0, 0))]);
    assert_eq!(forwards.peels, backwards.peels);
    assert!(is_said(&backwards, "all distances are negative, from -12 to -3"));
}

#[test]
fn elements_are_corrected_before_they_are_merged() {
    let near = |x: usize, y: usize| if x < 8 { 3.0 + y as f32 } else { 1e10 };
    let far = |x: usize, y: usize| 12.0 + (x + y) as f32;
    let merged = |part: Part, convention: Option<DepthConvention>| {
        let options = ReadOptions { merge: true, convention, ..ReadOptions::default() };
        let behind = exr_bytes(vec![picture("Z", far)]);
        read(&[source(exr_bytes(vec![part])), source(behind)], &options).unwrap()
    };
    let expected = merged(picture("Z", near), None);
    let backwards = merged(picture("Z", |x, y| if x < 8 { -near(x, y) } else { f32::NEG_INFINITY }), None);
    assert_eq!(backwards.peels, expected.peels, "along −z");
    assert!(is_said(&backwards, "without their sign"));
    let even = |x: usize, _: usize| if x < 8 { 3.0 } else { 1e10 };
    let broken = merged(picture("Z", move |x, y| if (x, y) == (4, 5) { f32::NAN } else { even(x, y) }), None);
    assert_eq!(broken.peels, merged(picture("Z", even), None).peels, "a speck of NaN");
    let options = ReadOptions { merge: true, ..ReadOptions::default() };
    let nothing = exr_bytes(vec![picture("Z", |_, _| 0.0)]);
    let error = read(&[source(nothing), source(exr_bytes(vec![picture("Z", far)]))], &options).unwrap_err();
    assert!(error.to_string().contains("is 0 everywhere"), "{error}");
}

#[test]
fn the_program_of_a_depth_file_says_how_depth_is_written() {
    let distance = |x: usize, y: usize| 2.0 + (x + y) as f32;
    let nuke = AttributeValue::Text(Text::from("15.0v4"));
    let mut depth = picture("depth.Z", |x, y| 1.0 / distance(x, y)).attribute("nuke/version", nuke);
    depth.channels.retain(|(name, _)| name == "depth.Z");
    let mut beauty = picture("Z", distance);
    beauty.channels.retain(|(name, _)| name != "Z");
    let files = [beauty, depth].map(|part| source(exr_bytes(vec![part])));
    let stack = read(&files, &ReadOptions::default()).unwrap();
    assert_eq!(stack.convention, DepthConvention::Inverse);
}

#[test]
fn specks_of_nan_on_a_surface_have_its_depth_and_are_counted() {
    let at = [(3, 2), (9, 7), (20, 12), (21, 12)];
    let depth = |x: usize, y: usize| if at.contains(&(x, y)) { f32::NAN } else { 4.0 + 0.1 * y as f32 };
    let stack = stack_of(vec![picture("Z", depth)]);
    for (x, y) in at {
        let (found, surface) = (stack.peels[0].depth.get(x, y), 4.0 + 0.1 * y as f32);
        assert!((found - surface).abs() <= 0.11, "{found} at {x}, {y}");
    }
    assert!(warnings(&stack).contains(&"4 specks of NaN have the depth of what is beside them"));
}

#[test]
fn files_saved_by_nuke_hold_reciprocals_where_their_values_say_so() {
    let nuke = |part: Part| part.attribute("nuke/version", AttributeValue::Text(Text::from("15.0v4")));
    let distance = |x: usize, y: usize| if x < 2 { 0.8 } else { block(3.0, 12.0, 0)(x, y) };
    let inverse = stack_of(vec![nuke(picture("depth.Z", |x, y| 1.0 / distance(x, y)))]);
    assert_eq!(inverse.convention, DepthConvention::Inverse);
    assert!(is_said(&inverse, "`convention = planar`"));
    let planar = stack_of(vec![nuke(picture("depth.Z", distance))]);
    assert_eq!(planar.convention, DepthConvention::Planar);
    let options = ReadOptions { convention: Some(DepthConvention::Planar), ..ReadOptions::default() };
    let chosen = read_with(nuke(picture("depth.Z", |x, y| 1.0 / distance(x, y))), &options);
    assert_eq!(chosen.convention, DepthConvention::Planar);
    assert_eq!(stack_of(vec![picture("depth.Z", distance)]).convention, DepthConvention::Planar);
}

#[test]
fn normalised_depth_with_one_near_is_that_with_zero_near_turned_around() {
    let ramp = |x: usize, _: usize| x as f32 / 32.0;
    let options = |near, far| ReadOptions {
        convention: Some(DepthConvention::Normalised),
        near: Some(near),
        far: Some(far),
        ..ReadOptions::default()
    };
    let forwards = read_with(picture("Z", ramp), &options(2.0, 12.0));
    let backwards = read_with(picture("Z", |x, y| 1.0 - ramp(x, y)), &options(12.0, 2.0));
    assert_eq!(forwards.peels, backwards.peels);
    assert!(backwards.near_is_one && !forwards.near_is_one);
}

/// A view layer with this depth.
fn layer(name: &str, depth: impl Fn(usize, usize) -> f32) -> Vec<(String, FlatSamples)> {
    let color =
        ["R", "G", "B", "A"].map(|channel| (format!("{name}.Combined.{channel}"), samples(|_, _| 1.0)));
    color.into_iter().chain([(format!("{name}.Depth.Z"), samples(depth))]).collect()
}

/// A file of two view layers.
fn layers(front: Vec<(String, FlatSamples)>, back: Vec<(String, FlatSamples)>) -> Vec<u8> {
    let channels = front.into_iter().chain(back).collect();
    exr_bytes(vec![Part { channels, ..Part::flat(SIZE, "R=0") }])
}

#[test]
fn a_copy_of_a_view_layer_is_no_peel() {
    let error =
        failure(layers(layer("ViewLayer", block(3.0, 12.0, 0)), layer("ViewLayer.001", block(3.0, 12.0, 0))));
    assert!(error.to_string().starts_with("ViewLayer.001 is no peel"), "{error}");
    assert!(error.to_string().contains("`color_channel`"), "{error}");
    let moved = failure(layers(layer("a", block(3.0, 12.0, 0)), layer("b", block(3.0, 12.0, 2))));
    assert!(moved.to_string().starts_with("b is no peel"), "{moved}");
}

#[test]
fn files_whose_names_differ_in_a_frame_number_are_refused_and_peels_are_read() {
    let file =
        |name: &str, depth: f32| Source::memory(name, exr_bytes(vec![picture("Z", block(depth, 12.0, 0))]));
    let behind = |name: &str| Source::memory(name, exr_bytes(vec![picture("Z", block(13.0, 14.0, 0))]));
    let read = |sources: &[Source]| read(sources, &ReadOptions::default());
    let error = read(&[file("shot.0001.exr", 3.0), behind("shot.0002.exr")]).unwrap_err();
    assert!(error.to_string().contains("'shot.####.exr'"), "{error}");
    for names in [["peel0.exr", "peel1.exr"], ["front.0007.exr", "back.0007.exr"], ["a1.exr", "a2.exr"]] {
        let stack = read(&[file(names[0], 3.0), behind(names[1])]).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(stack.peels.len(), 2, "{names:?}");
    }
    assert!(read(&[file("a1.exr", 3.0), file("a2.exr", 4.0)]).is_err(), "the wall is in both");
}

#[test]
fn straight_alpha_is_doubted_where_it_shows_and_premultiplied_on_request() {
    let alpha = |x: usize, _: usize| ((x as f32 - 4.0) / 8.0).clamp(0.0, 1.0);
    let part = |color: &dyn Fn(usize, usize) -> f32| {
        let part = picture("Z", |_, _| 3.0).with("A", samples(alpha));
        ["R", "G", "B"].into_iter().fold(part, |part, channel| part.with(channel, samples(color)))
    };
    let straight = || part(&|x, y| if alpha(x, y) > 0.0 { 0.8 } else { 0.0 });
    let doubted = |stack: &Stack| warnings(stack).iter().any(|text| text.contains("`alpha = straight`"));
    let premultiplied = stack_of(vec![part(&|x, y| 0.8 * alpha(x, y))]);
    assert!(!doubted(&premultiplied));
    assert!(doubted(&stack_of(vec![straight()])));
    let options = ReadOptions { alpha: Some(AlphaMode::Straight), ..ReadOptions::default() };
    let read = read_with(straight(), &options);
    assert!(!doubted(&read));
    assert_eq!(read.peels, premultiplied.peels);
}

#[test]
fn a_scene_in_centimetres_read_as_metres_is_named_and_one_in_metres_is_not() {
    let doubts = |scale: f32, focus: f32, metres_per_unit: f32| -> Vec<String> {
        let depth = block(3.0 * scale, 12.0 * scale, 0);
        let flags = Values {
            focus: Some(Focus::Distance(focus)),
            focal_length_mm: Some(135.0),
            f_number: Some(1.0),
            metres_per_unit: Some(metres_per_unit),
            effort: Some(Effort::Views(4)),
            ..Values::default()
        };
        let stack = stack_of(vec![picture("Z", depth)]);
        let prepared =
            prepare_stack(stack, &Job { flags, ..Job::default() }).unwrap_or_else(|error| panic!("{error}"));
        let findings = prepared.stack.findings.into_iter().filter(|finding| finding.about == "units");
        findings.map(|finding| finding.text).collect()
    };
    assert!(doubts(1.0, 3.0, 1.0).is_empty() && doubts(100.0, 300.0, 0.01).is_empty());
    for focus in [3.0, 300.0] {
        let said = doubts(100.0, focus, 1.0);
        assert!(said[0].contains("300 to 1200") && said[0].contains("`metres_per_unit = 0.01`"), "{said:?}");
    }
}
