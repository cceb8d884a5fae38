//! Reading: naming schemes, depth conventions, and invalid files.

#[path = "reading/blocks.rs"]
mod blocks;
#[path = "reading/completeness.rs"]
mod completeness;
#[path = "reading/deep.rs"]
mod deep;
#[path = "fixtures/deep.rs"]
mod deep_fixtures;
#[path = "reading/limits.rs"]
mod limits;
mod fixtures;
#[path = "reading/windows.rs"]
mod windows;
#[path = "reading/values.rs"]
mod values;
#[path = "reading/names.rs"]
mod names;
#[path = "reading/reflections.rs"]
mod reflections;

use exr::image::FlatSamples;
use exr::meta::attribute::{AttributeValue, Compression, Text, TimeCode};
use fixtures::{Part, exr_bytes, exr_bytes_displayed, failure, failure_with, source, stack_of};
use half::f16;
use std::path::Path;
use thinlens::error::ErrorKind;
use thinlens::image::{Image, Plane};
use thinlens::render::{Job, prepare_stack, render_stack};
use thinlens::settings::{DepthConvention, Effort, Focus, Values};
use thinlens::stack::{
    Antialiasing, Carry, ColorRange, Frame, Peel, Precision, ReadOptions, Source, Stack, StackKind, Window,
    read, read_picture,
};

/// `[r, g, b, a, depth]` of every peel at the top left pixel.
fn first_pixels(stack: &Stack) -> Vec<[f32; 5]> {
    let peels = stack.peels.iter();
    peels
        .map(|peel| {
            let [r, g, b] = peel.color.each_ref().map(|plane| plane.get(0, 0));
            [r, g, b, peel.alpha.get(0, 0), peel.depth.get(0, 0)]
        })
        .collect()
}

fn carried_names(stack: &Stack) -> Vec<&str> {
    stack.carried.channels.iter().map(|channel| channel.name.as_str()).collect()
}

fn warnings(stack: &Stack) -> Vec<&str> {
    stack.findings.iter().filter(|finding| finding.warning).map(|finding| finding.text.as_str()).collect()
}

// The naming table: one test per row.

#[test]
fn blender_view_layers_are_peels_ordered_by_number() {
    let peel = |n: usize, z: usize| {
        format!(
            "Peel{n}.Combined.R=0.{n}1 Peel{n}.Combined.G=0 Peel{n}.Combined.B=0 Peel{n}.Combined.A=1 Peel{n}.Depth.Z={z}"
        )
    };
    let stack = stack_of(vec![Part::flat((2, 2), &format!("{} {}", peel(10, 9), peel(2, 4)))]);
    assert_eq!(first_pixels(&stack), [[0.21, 0.0, 0.0, 1.0, 4.0], [0.101, 0.0, 0.0, 1.0, 9.0]]);
    assert!(stack.carried.channels.is_empty());
    assert!(warnings(&stack).is_empty());
}

#[test]
fn the_compositors_result_is_not_a_peel() {
    let channels = "Composite.Combined.R=9 Composite.Combined.G=9 Composite.Combined.B=9 Composite.Combined.A=1 \
                    ViewLayer.Combined.R=1 ViewLayer.Combined.G=1 ViewLayer.Combined.B=1 ViewLayer.Combined.A=1 \
                    ViewLayer.Depth.Z=3";
    let stack = stack_of(vec![Part::flat((1, 1), channels)]);
    assert_eq!(first_pixels(&stack), [[1.0, 1.0, 1.0, 1.0, 3.0]]);
    assert_eq!(stack.carried.channels.len(), 4);
}

#[test]
fn numbered_view_layers_follow_the_one_without_a_number() {
    let layer = |name: &str, z: usize| {
        format!(
            "{name}.Combined.R=1 {name}.Combined.G=1 {name}.Combined.B=1 {name}.Combined.A=1 {name}.Depth.Z={z}"
        )
    };
    let names = [layer("ViewLayer_002", 3), layer("ViewLayer", 1), layer("ViewLayer_001", 2)];
    let stack = stack_of(vec![Part::flat((1, 1), &names.join(" "))]);
    assert_eq!(first_pixels(&stack).map_depth(), [1.0, 2.0, 3.0]);
}

#[test]
fn depth_v_and_depth_z_read_the_same() {
    for ending in ["Depth.Z", "Depth.V"] {
        let channels = format!(
            "ViewLayer.Combined.R=0.5 ViewLayer.Combined.G=0.25 ViewLayer.Combined.B=0.125 ViewLayer.Combined.A=1 \
             ViewLayer.{ending}=7"
        );
        let stack = stack_of(vec![Part::flat((2, 2), &channels)]);
        assert_eq!(first_pixels(&stack), [[0.5, 0.25, 0.125, 1.0, 7.0]], "{ending}");
        assert_eq!(stack.kind, Some(StackKind::BeautyDepth));
    }
}

#[test]
fn mitsuba_peels_are_read_with_all_their_depth_names() {
    for ending in ["depth", "depth.T", "Z", "T"] {
        let peel = |n: usize, z: usize| {
            format!("peel{n}.R=1 peel{n}.G=1 peel{n}.B=1 peel{n}.A=1 peel{n}.{ending}={z}")
        };
        let stack = stack_of(vec![Part::flat((1, 1), &format!("{} {}", peel(0, 2), peel(1, 5)))]);
        assert_eq!(first_pixels(&stack).map_depth(), [2.0, 5.0], "{ending}");
    }
}

#[test]
fn a_single_picture_is_read_with_all_depth_names() {
    for depth in ["depth.T", "Depth.Z", "depth.Y", "depth", "Depth", "Z", "DEPTH.Z", "z"] {
        let stack = stack_of(vec![Part::flat((1, 1), &format!("R=0.5 G=0 B=0 A=0.75 {depth}=3"))]);
        assert_eq!(first_pixels(&stack), [[0.5, 0.0, 0.0, 0.75, 3.0]], "{depth}");
    }
}

#[test]
fn parts_are_peels_ordered_by_name() {
    let part = |z: usize| Part::flat((1, 1), &format!("R=1 G=1 B=1 A=1 Z={z}"));
    let stack = stack_of(vec![part(8).named("peel1"), part(3).named("peel0")]);
    assert_eq!(first_pixels(&stack).map_depth(), [3.0, 8.0]);
}

#[test]
fn parts_per_pass_are_one_picture_with_the_only_depth() {
    let stack = stack_of(vec![
        Part::flat((1, 1), "R=1 G=0 B=0 A=1").named("rgba"),
        Part::flat((1, 1), "Z=6").named("depth"),
    ]);
    assert_eq!(first_pixels(&stack), [[1.0, 0.0, 0.0, 1.0, 6.0]]);
}

#[test]
fn groups_of_any_name_with_depth_are_peels_with_a_warning() {
    let stack = stack_of(vec![Part::flat(
        (1, 1),
        "back.R=1 back.G=1 back.B=1 back.Z=9 afront.R=2 afront.G=2 afront.B=2 afront.Z=1",
    )]);
    assert_eq!(first_pixels(&stack).map_depth(), [1.0, 9.0]);
    assert!(warnings(&stack)[0].contains("by name only"));
}

#[test]
fn luminance_is_grey_and_colour_without_alpha_is_opaque() {
    let stack = stack_of(vec![Part::flat((1, 1), "Y=0.5 Z=2")]);
    assert_eq!(first_pixels(&stack), [[0.5, 0.5, 0.5, 1.0, 2.0]]);
}

#[test]
fn channels_that_are_not_the_picture_are_carried() {
    let channels = "R=1 G=1 B=1 A=1 depth.T=2 img.R=1 img.G=1 img.B=1 P.X=1 P.Y=1 P.Z=1 Noisy~Image.R=1 Noisy~Image.G=1 \
                    Noisy~Image.B=1 CryptoObject00.r=1 CryptoObject00.g=1 CryptoObject00.b=1 CryptoObject00.a=1 id=7";
    let part = Part::flat((1, 1), channels).with("id", FlatSamples::U32(vec![4_000_000_007]));
    let stack = stack_of(vec![part]);
    assert_eq!(first_pixels(&stack), [[1.0, 1.0, 1.0, 1.0, 2.0]]);
    assert_eq!(stack.carried.channels.len(), 14);
    let id = stack.carried.channels.iter().find(|channel| channel.name == "id").expect("id is carried");
    assert_eq!(id.samples, FlatSamples::U32(vec![4_000_000_007]));
}

// Names by option, and errors with the channels found.

#[test]
fn colour_and_depth_can_be_named_by_option() {
    let bytes = exr_bytes(vec![Part::flat(
        (1, 1),
        "one.R=1 one.G=1 one.B=1 two.R=2 two.G=2 two.B=2 far.away=5 near.by=4",
    )]);
    let error = failure(bytes.clone());
    assert!(error.to_string().contains("`color_channel`"), "{error}");
    let options = ReadOptions {
        color_channel: Some("two".to_owned()),
        depth_channel: Some("near.by".to_owned()),
        ..ReadOptions::default()
    };
    let stack = read(&[source(bytes.clone())], &options).expect("both are named");
    assert_eq!(first_pixels(&stack), [[2.0, 2.0, 2.0, 1.0, 4.0]]);
    let error = failure_with(bytes, &ReadOptions { color_channel: Some("three".to_owned()), ..options });
    assert!(error.to_string().starts_with("there is no colour group called three\n"), "{error}");
}

#[test]
fn a_peel_without_depth_is_an_error_with_its_channels() {
    let peel = |n: usize| format!("Peel{n}.Combined.R=1 Peel{n}.Combined.G=1 Peel{n}.Combined.B=1");
    let error =
        failure(exr_bytes(vec![Part::flat((1, 1), &format!("{} {} Peel0.Depth.Z=1", peel(0), peel(1)))]));
    assert_eq!(
        error.to_string(),
        "peel 1 has no depth channel\n  found: Peel1.Combined.B Peel1.Combined.G Peel1.Combined.R\n  \
         looked for: Depth.Z, Depth.V, depth.T, depth, Z\n  in: fixture.exr\n  \
         help: enable the Z pass, name it with `depth_channel`, or give it as `depth_file`"
    );
}

#[test]
fn a_file_without_colour_is_an_error_with_its_channels() {
    let error = failure(exr_bytes(vec![Part::flat((1, 1), "Z=1 N.X=0 N.Y=0 N.Z=1")]));
    assert_eq!(error.kind(), ErrorKind::Input);
    assert!(error.to_string().contains("found: N.X N.Y N.Z Z"), "{error}");
    assert!(error.to_string().contains("`color_channel`"), "{error}");
}

// Pixels.

#[test]
fn every_codec_and_tiling_gives_the_same_pixels() {
    let size = (37, 70);
    let ramp: Vec<f32> = (0..size.0 * size.1).map(|i| (i % 251) as f32 * 0.25).collect();
    let halves: Vec<f16> = ramp.iter().map(|&value| f16::from_f32(value)).collect();
    let part = |compression, tile| {
        Part { compression, tile, ..Part::flat(size, "R=1 G=2 B=3 A=1 Z=4") }
            .with("G", FlatSamples::F16(halves.clone()))
            .with("Z", FlatSamples::F32(ramp.clone()))
    };
    for compression in
        [Compression::Uncompressed, Compression::RLE, Compression::ZIP1, Compression::ZIP16, Compression::PIZ]
    {
        for tile in [None, Some((16, 8)), Some((64, 128))] {
            let stack = stack_of(vec![part(compression, tile)]);
            assert_eq!(stack.peels[0].color[1].values(), ramp, "{compression:?} {tile:?}");
            assert_eq!(stack.peels[0].depth.values(), ramp, "{compression:?} {tile:?}");
            assert_eq!(stack.peels[0].color[2].values(), vec![3.0; ramp.len()], "{compression:?} {tile:?}");
        }
    }
}

#[test]
fn the_number_of_threads_does_not_change_a_bit() {
    let values = (0..40 * 300).map(|i| (i as f32).sin()).collect();
    let bytes = exr_bytes(vec![Part::flat((40, 300), "R=1 G=1 B=1 Z=1").with("R", FlatSamples::F32(values))]);
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| read(&[source(bytes.clone())], &ReadOptions::default())).expect("it is read").peels
    };
    assert_eq!(on(1), on(3));
}

#[test]
fn half_and_float_colour_are_distinguished() {
    let half = |value: f32| FlatSamples::F16(vec![f16::from_f32(value)]);
    let float = Part::flat((1, 1), "R=1 G=1 B=1 Z=1");
    assert_eq!(stack_of(vec![Part::flat((1, 1), "R=1 G=1 B=1 Z=1")]).precision, Precision::Float);
    let halves = float.with("R", half(1.0)).with("G", half(1.0)).with("B", half(1.0));
    let stack = stack_of(vec![halves]);
    assert_eq!((stack.precision, stack.color_range), (Precision::Half, ColorRange::Unbounded));
}

#[test]
fn a_nan_pixel_does_not_make_the_frame_fail() {
    let part = Part::flat((3, 1), "R=1 G=0 B=0 A=1 Z=2")
        .with("R", FlatSamples::F32(vec![f32::NAN, f32::INFINITY, -0.5]))
        .with("A", FlatSamples::F32(vec![f32::NAN, 7.0, 0.5]));
    let stack = stack_of(vec![part]);
    assert_eq!(stack.peels[0].color[0].values(), [0.0, 65504.0, -0.5]);
    assert_eq!(stack.peels[0].alpha.values(), [0.0, 1.0, 0.5]);
    let text = warnings(&stack)[0];
    assert!(text.contains("1 colour values were NaN") && text.contains("2 alpha values"), "{text}");
}

#[test]
fn depth_that_is_nan_everywhere_is_an_error() {
    let error = failure(exr_bytes(vec![Part::flat((2, 1), "R=1 G=1 B=1 Z=nan")]));
    assert_eq!(error.kind(), ErrorKind::Input);
    let some = Part::flat((2, 1), "R=1 G=1 B=1 Z=1").with("Z", FlatSamples::F32(vec![f32::NAN, 1.0]));
    assert_eq!(stack_of(vec![some]).peels.len(), 1);
}

// Windows.

#[test]
fn overscan_keeps_both_windows() {
    let bytes = exr_bytes_displayed(vec![Part::flat((6, 5), "R=1 G=1 B=1 Z=1").at(-1, -2)], (4, 3));
    let stack = read(&[source(bytes)], &ReadOptions::default()).expect("it is read");
    assert_eq!(stack.frame.data, Window { x: -1, y: -2, width: 6, height: 5 });
    assert_eq!(stack.frame.display, Window { x: 0, y: 0, width: 4, height: 3 });
}

#[test]
fn a_cropped_deeper_peel_is_placed_in_the_first_ones_window() {
    let front = exr_bytes(vec![Part::flat((3, 2), "R=1 G=1 B=1 A=1 Z=1")]);
    let back = |x| exr_bytes_displayed(vec![Part::flat((1, 1), "R=5 G=5 B=5 A=1 Z=9").at(x, 1)], (3, 2));
    let stack = read(&[source(front.clone()), source(back(2))], &ReadOptions::default()).expect("it fits");
    assert_eq!(stack.peels[1].color[0].values(), [0.0, 0.0, 0.0, 0.0, 0.0, 5.0]);
    assert_eq!(stack.peels[1].alpha.values(), [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
    assert_eq!(stack.peels[1].depth.get(2, 1), 9.0);
    assert_eq!(stack.peels[1].depth.get(0, 0), f32::INFINITY);
    let outside =
        read(&[source(front), source(back(3))], &ReadOptions::default()).expect("it lies beside it");
    assert_eq!(outside.frame.data, Window { x: 0, y: 0, width: 4, height: 2 });
    assert_eq!(outside.peels[1].color[0].values(), [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0]);
}

// Several files.

#[test]
fn files_ordered_far_to_near_are_sorted_with_a_warning() {
    let peel = |z: usize| source(exr_bytes(vec![Part::flat((2, 2), &format!("R=1 G=1 B=1 A=1 Z={z}"))]));
    let stack = read(&[peel(9), peel(2)], &ReadOptions::default()).expect("it is read");
    assert_eq!(first_pixels(&stack).map_depth(), [2.0, 9.0]);
    assert!(warnings(&stack)[0].contains("nearest first"));
    assert!(warnings(&read(&[peel(2), peel(9)], &ReadOptions::default()).expect("it is read")).is_empty());
}

#[test]
fn a_second_file_without_colour_is_depth() {
    let color = source(exr_bytes(vec![Part::flat((2, 2), "R=1 G=1 B=1 A=1")]));
    let depth = source(exr_bytes(vec![Part::flat((2, 2), "Z=4")]));
    let stack = read(&[color.clone(), depth], &ReadOptions::default()).expect("colour and depth");
    assert_eq!(first_pixels(&stack), [[1.0, 1.0, 1.0, 1.0, 4.0]]);
    let small = source(exr_bytes(vec![Part::flat((1, 2), "Z=4")]));
    let error = read(&[color, small], &ReadOptions::default()).expect_err("sizes differ").to_string();
    assert!(error.contains("colour: 2×2 pixels") && error.contains("depth: 1×2 pixels"), "{error}");
}

#[test]
fn an_srgb_png_with_a_16_bit_depth_png_becomes_linear_and_premultiplied() {
    let folder = tempfile::tempdir().expect("a folder");
    let (color, depth) = (folder.path().join("color.png"), folder.path().join("depth.png"));
    image::RgbaImage::from_pixel(2, 1, image::Rgba([255, 188, 0, 128])).save(&color).expect("written");
    let grey: image::ImageBuffer<image::Luma<u16>, Vec<u16>> =
        image::ImageBuffer::from_pixel(2, 1, image::Luma([13107]));
    grey.save(&depth).expect("written");
    let options = ReadOptions { depth_file: Some(depth), ..ReadOptions::default() };
    let stack = read(&[Source::File(color)], &options).expect("colour and depth");
    let alpha = 128.0 / 255.0;
    let [[r, g, b, a, z]] = first_pixels(&stack)[..] else { panic!("one peel") };
    assert_eq!([r, b, a], [alpha, 0.0, alpha]);
    // Code 188 is 0.7373 in sRGB: ((0.7373 + 0.055) / 1.055)^2.4 = 0.5029 linear.
    assert!((g / alpha - 0.5029).abs() < 1e-3, "{g}");
    // 13107 / 65535 = 0.2: values are not converted, with a warning about their range.
    assert!((z - 0.2).abs() < 1e-6);
    assert!(warnings(&stack)[0].contains("`convention`"));
    assert!(stack.findings.iter().any(|finding| finding.text.contains("sRGB")));
    assert_eq!(stack.color_range, ColorRange::UpToWhite, "integers are clipped at white");
}

// Conclusions.

#[test]
fn the_header_sets_the_convention_and_the_option_overrides_it() {
    let part = || {
        let inverse = AttributeValue::Text(Text::from("inverse"));
        Part::flat((1, 1), "R=1 G=1 B=1 depth.T=1").attribute("thinlens.depth_convention", inverse)
    };
    assert_eq!(stack_of(vec![part()]).convention, DepthConvention::Inverse);
    let options = ReadOptions { convention: Some(DepthConvention::Planar), ..ReadOptions::default() };
    let stack = read(&[source(exr_bytes(vec![part()]))], &options).expect("it is read");
    assert_eq!(stack.convention, DepthConvention::Planar);
}

#[test]
fn camera_data_in_the_header_becomes_settings() {
    let part = Part::flat((1, 1), "R=1 G=1 B=1 Z=1")
        .attribute("thinlens.focal_length_mm", AttributeValue::F32(85.0))
        .attribute("thinlens.focus_distance", AttributeValue::F64(6.0))
        .attribute("thinlens.blades", AttributeValue::I32(7));
    let camera = stack_of(vec![part]).camera;
    assert_eq!((camera.focal_length_mm, camera.blades), (Some(85.0), Some(7)));
    assert_eq!(camera.focus, Some(Focus::Distance(6.0)));
    assert_eq!(camera.f_number, None);
}

#[test]
fn a_supersampled_stack_is_detected_from_its_header_and_carries_no_channels() {
    let part = |s| {
        Part::flat((4, 2), "R=1 G=1 B=1 A=1 Z=2 id=3")
            .attribute("thinlens.supersample", AttributeValue::I32(s))
    };
    let stack = stack_of(vec![part(2)]);
    assert_eq!((stack.kind, stack.supersample), (Some(StackKind::Supersampled), 2));
    assert!(stack.carried.channels.is_empty());
    assert!(stack.carried.attributes.is_empty(), "the output is not supersampled");
    assert_eq!(warnings(&stack).len(), 1);
    let error = failure(exr_bytes(vec![part(3)]));
    assert_eq!(error.kind(), ErrorKind::Settings);
    assert!(error.to_string().starts_with("3 samples per pixel do not divide a size of 4"), "{error}");
}

#[test]
fn a_kind_in_the_header_holds_everywhere_unless_the_user_sets_another() {
    let peels =
        "peel0.R=1 peel0.G=1 peel0.B=1 peel0.A=1 peel0.Z=2 peel1.R=1 peel1.G=1 peel1.B=1 peel1.A=1 peel1.Z=5";
    let part =
        |kind: &str| Part::flat((4, 2), peels).attribute("thinlens.kind", AttributeValue::Text(kind.into()));
    let stack = stack_of(vec![part("coverage")]);
    assert_eq!((stack.kind, stack.antialiasing), (Some(StackKind::Coverage), Antialiasing::AVERAGES));
    assert!(stack.carried.attributes.is_empty(), "the output is no stack");
    let options = ReadOptions { kind: Some(StackKind::PointSampled), ..ReadOptions::default() };
    let stack = read(&[source(exr_bytes(vec![part("coverage")]))], &options).expect("it is read");
    assert_eq!(stack.antialiasing, Antialiasing::POINT_SAMPLES);
    assert_eq!(stack_of(vec![part("auto")]).kind, None);
    let error = failure(exr_bytes(vec![part("beauty")]));
    assert_eq!(error.kind(), ErrorKind::Settings);
    assert!(error.to_string().contains("2 peels"), "{error}");
}

/// A stack of one row per peel of `(colour, alpha, depth)`, repeated over `HEIGHT` rows.
fn rows_of(peels: &[Vec<(f32, f32, f32)>], kind: Option<StackKind>) -> Stack {
    const HEIGHT: usize = 24;
    let peel = |row: &Vec<(f32, f32, f32)>| {
        let plane =
            |value: fn((f32, f32, f32)) -> f32| Plane::from_fn(row.len(), HEIGHT, |x, _| value(row[x]));
        Peel {
            color: std::array::from_fn(|_| plane(|fragment| fragment.0)),
            alpha: plane(|fragment| fragment.1),
            depth: plane(|fragment| fragment.2),
        }
    };
    let options = ReadOptions { kind, ..ReadOptions::default() };
    Stack::from_peels(peels.iter().map(peel).collect(), Frame::from_size(peels[0].len(), HEIGHT), &options)
        .expect("it is a stack")
}

/// The picture of `stack` by `method`, in focus at `focus`.
fn picture(stack: &Stack, method: &str, focus: f32) -> Image {
    let values = Values {
        method: Some(method.to_owned()),
        f_number: Some(1.0),
        focal_length_mm: Some(200.0),
        focus: Some(Focus::Distance(focus)),
        effort: Some(Effort::Views(64)),
        ..Values::default()
    };
    render_stack(stack.clone(), &Job::default().with_values(values), &|_| {}).expect("it is rendered").image
}

#[test]
fn the_sky_continues_behind_the_edge_of_an_object_whatever_share_of_the_pixel_it_is_given() {
    const WIDTH: usize = 48;
    const EDGE: usize = 24;
    const SKY: f32 = 0.75;
    let empty = (0.0, 0.0, 1e10);
    for share in [0.25, 0.5, 0.75] {
        let object = |x| if x < EDGE { (0.25, 1.0, 4.0) } else { (0.25 * share, share, 4.0) };
        let front = (0..WIDTH).map(|x| if x <= EDGE { object(x) } else { (SKY, 1.0, 1e10) });
        let front: Vec<_> = front.collect();
        let with_sky = |alpha: f32| {
            let row = (0..WIDTH).map(|x| match x {
                ..EDGE => (SKY, 1.0, 1e10),
                EDGE => (SKY * alpha, alpha, 1e10),
                _ => empty,
            });
            vec![front.clone(), row.collect()]
        };
        for kind in [Some(StackKind::Coverage), None] {
            let [whole, part] = [1.0, 1.0 - share].map(|alpha| rows_of(&with_sky(alpha), kind));
            for method in ["shear", "accumulate", "layer-rays"] {
                for focus in [4.0, 1000.0] {
                    let [whole, part] = [&whole, &part].map(|stack| picture(stack, method, focus));
                    assert_eq!(part, whole, "{method}, focus at {focus}, share {share}, {kind:?}");
                }
            }
            // With the object in focus, the pixel is the object by its share and the sky by the rest.
            for method in ["shear", "accumulate"] {
                let pixel = picture(&part, method, 4.0).pixel(EDGE, 12);
                let expected = share * 0.25 + (1.0 - share) * SKY;
                let near = (pixel[0] - expected).abs() < 1e-3 && pixel[3] > 0.999;
                assert!(near, "{method}: {pixel:?}, expected {expected}");
            }
        }
    }
}

/// Channels of two point-sampled peels of 4 × 2 pixels, and a beauty in the group `beauty`, if it has a name.
fn with_beauty(beauty: &str) -> String {
    let peels = "Peel0.Combined.R=0.5 Peel0.Combined.G=0.5 Peel0.Combined.B=0.5 Peel0.Combined.A=1 Peel0.Depth.Z=2 \
                 Peel1.Combined.R=0.2 Peel1.Combined.G=0.2 Peel1.Combined.B=0.2 Peel1.Combined.A=1 Peel1.Depth.Z=5";
    if beauty.is_empty() {
        peels.to_owned()
    } else {
        format!("{peels} {beauty}.R=0.25 {beauty}.G=0.25 {beauty}.B=0.25 {beauty}.A=1")
    }
}

#[test]
fn the_beauty_of_peel_0_is_taken_from_its_group_and_no_other() {
    let stack = stack_of(vec![Part::flat((4, 2), &with_beauty("Peel0.Beauty"))]);
    assert_eq!((stack.peels.len(), stack.peels[0].color[0].get(3, 1)), (2, 0.25));
    assert_eq!(stack.antialiasing, Antialiasing::AVERAGES, "the colours of peel 0 are averages");
    assert!(stack.findings.iter().any(|finding| finding.about == "beauty"), "{:?}", stack.findings);
    assert!(stack.carried.channels.is_empty(), "it is part of the stack");
    for same in ["peel0.beauty", "Peel0.Beauty.Combined"] {
        let stack = stack_of(vec![Part::flat((4, 2), &with_beauty(same))]);
        assert_eq!((stack.peels.len(), stack.peels[0].color[0].get(3, 1)), (2, 0.25), "{same}");
    }
    for other in ["Beauty", "Peel1.Beauty", "ViewLayer.Beauty"] {
        let stack = stack_of(vec![Part::flat((4, 2), &with_beauty(other))]);
        assert_eq!(stack.peels[0].color[0].get(3, 1), 0.5, "{other} is carried");
        assert_eq!(stack.carried.channels.len(), 4, "{other} is carried");
    }
}

#[test]
fn a_beauty_in_the_stack_that_cannot_be_used_is_said_and_the_stack_is_read() {
    let text_of = |part: Part, options: &ReadOptions| {
        let stack = read(&[source(exr_bytes(vec![part]))], options).expect("it is read");
        assert_eq!(stack.peels[0].color[0].get(1, 1), 0.5, "peel 0 keeps its colour");
        stack.findings.into_iter().find(|finding| finding.about == "beauty").expect("it is said").text
    };
    let incomplete = format!("{} Peel0.Beauty.R=1 Peel0.Beauty.G=1", with_beauty(""));
    let text = text_of(Part::flat((4, 2), &incomplete), &ReadOptions::default());
    assert!(text.contains("Peel0.Beauty") && text.contains("R, G, B"), "{text}");
    let options = ReadOptions { supersample: Some(2), ..ReadOptions::default() };
    let text = text_of(Part::flat((4, 2), &with_beauty("Peel0.Beauty")), &options);
    assert!(text.contains("one sample a pixel"), "{text}");
}

#[test]
fn a_beauty_file_replaces_the_colour_of_peel_0_and_mistakes_say_what_to_do() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = |name: &str, size, channels: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, exr_bytes(vec![Part::flat(size, channels)])).expect("it is written");
        path
    };
    let read_with = |path: std::path::PathBuf, supersample| {
        let options = ReadOptions { beauty: Some(path), supersample, ..ReadOptions::default() };
        read(&[source(exr_bytes(vec![Part::flat((4, 2), &with_beauty(""))]))], &options)
    };
    let beauty = file("beauty.exr", (4, 2), "R=0.75 G=0.75 B=0.75 Z=2");
    let stack = read_with(beauty.clone(), None).expect("it is read");
    assert_eq!((stack.peels[0].color[2].get(0, 0), stack.peels[1].color[2].get(0, 0)), (0.75, 0.2));
    let refused = |path, supersample| read_with(path, supersample).expect_err("it is refused").to_string();
    assert!(refused(file("small.exr", (2, 1), "R=1 G=1 B=1"), None).contains("not of the frame"));
    let text = refused(file("depth.exr", (4, 2), "Z=1"), None);
    assert!(text.contains("no colour channels") && !text.contains("color_channel"), "{text}");
    let text = refused(folder.path().join("none.exr"), None);
    assert!(text.contains("none.exr") && text.contains("used as: `beauty`"), "{text}");
    let broken = read_with(file("broken.exr", (4, 2), "R=NaN G=0.4 B=inf"), None).expect("it is read");
    let is_said = |finding: &thinlens::finding::Finding| {
        finding.about == "beauty" && finding.text.contains("8 colour values were NaN")
    };
    assert!(broken.findings.iter().any(is_said), "{:?}", broken.findings);
    assert!(refused(beauty, Some(2)).contains("leave out `beauty`"));
}

#[test]
fn in_focus_the_picture_of_point_samples_with_their_beauty_is_the_beauty() {
    const WIDTH: usize = 48;
    /// Place of the edge in pixels: it covers 0.3 of pixel 20.
    const EDGE: f32 = 20.3;
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("beauty.exr");
    // An edge between two surfaces in focus, far from a surface that is not; a light in the first surface.
    let point = |x: usize| match x {
        5 => 40.0,
        _ if (x as f32 + 0.5) < EDGE => 0.8,
        _ => 0.2,
    };
    let covered = |x: usize| (EDGE - x as f32).clamp(0.0, 1.0);
    let box_filtered: Vec<f32> =
        (0..WIDTH).map(|x| if x == 5 { 20.0 } else { 0.2 + 0.6 * covered(x) }).collect();
    let rows = || FlatSamples::F32(box_filtered.repeat(24));
    let part = Part::flat((WIDTH, 24), "R=0").with("R", rows()).with("G", rows()).with("B", rows());
    std::fs::write(&path, exr_bytes(vec![part])).expect("it is written");
    let near = |x: usize| if x == 46 { 3.99 } else { 4.0 };
    let channel =
        |value: &dyn Fn(usize) -> f32| FlatSamples::F32((0..WIDTH).map(value).collect::<Vec<_>>().repeat(24));
    let mut peels = Part::flat((WIDTH, 24), "peel0.A=1 peel1.R=0 peel1.G=0 peel1.B=0 peel1.A=0 peel1.Z=9");
    for name in ["peel0.R", "peel0.G", "peel0.B"] {
        peels = peels.with(name, channel(&point));
    }
    let bytes = exr_bytes(vec![peels.with("peel0.Z", channel(&near))]);
    let options = ReadOptions { beauty: Some(path), ..ReadOptions::default() };
    let stack = read(&[source(bytes)], &options).expect("it is read");
    assert_eq!(stack.peels[0].color[0].get(5, 0), 40.0, "the light is that of the peel, bit for bit");
    for method in ["shear", "accumulate", "gather", "layer-rays"] {
        let image = picture(&stack, method, 4.0);
        for x in (8..44).step_by(3).chain(19..22) {
            let found = image.pixel(x, 12)[0];
            assert!(
                (found - box_filtered[x]).abs() < 1e-4,
                "{method}, column {x}: {found}, {}",
                box_filtered[x]
            );
        }
    }
}

#[test]
fn three_hundred_peels_are_read_in_order() {
    let channels = (0..300).map(|n| {
        format!("peel{n}.R={0} peel{n}.G={0} peel{n}.B={0} peel{n}.A={0} peel{n}.Z={1}", n % 2, n + 1)
    });
    let stack = stack_of(vec![Part::flat((2, 1), &channels.collect::<Vec<_>>().join(" "))]);
    assert_eq!(stack.peels.len(), 300);
    assert!((0..300).all(|n| stack.peels[n].depth.get(1, 0) == (n + 1) as f32));
    let prepared = prepare_stack(stack, &Job::default()).expect("it can be planned");
    assert_eq!((prepared.stats.layers, prepared.summary.peels), (300, 300));
    assert_eq!(prepared.stats.fragments, 300, "two samples in every second peel");
}

// Channels and attributes copied to the output.

#[test]
fn carry_selects_the_copied_channels() {
    let bytes = exr_bytes(vec![Part::flat((1, 1), "R=1 G=1 B=1 A=1 Z=1 normal.X=0 normal.Y=0 normal.Z=1")]);
    let carried = |carry| {
        let stack = read(&[source(bytes.clone())], &ReadOptions { carry, ..ReadOptions::default() });
        carried_names(&stack.expect("it is read")).join(" ")
    };
    assert_eq!(carried(Carry::Unused), "normal.X normal.Y normal.Z");
    assert_eq!(carried(Carry::All), "A B G R Z normal.X normal.Y normal.Z");
    assert_eq!(carried(Carry::None), "");
}

#[test]
fn channels_of_parts_have_the_parts_name_as_a_prefix() {
    let parts = vec![
        Part::flat((1, 1), "R=1 G=1 B=1 Z=1").named("peel0"),
        Part::flat((1, 1), "X=1 Y=1").named("motion"),
    ];
    assert_eq!(carried_names(&stack_of(parts)), ["motion.X", "motion.Y"]);
}

#[test]
fn attributes_are_copied_except_those_of_the_storage() {
    let part = Part::flat((1, 1), "R=1 G=1 B=1 Z=1")
        .attribute("shot", AttributeValue::Text(Text::from("room.0042")))
        .attribute("owner", AttributeValue::Text(Text::from("us")))
        .attribute("isoSpeed", AttributeValue::F32(400.0))
        .attribute("framesPerSecond", AttributeValue::Rational((24, 1)))
        .attribute("timeCode", AttributeValue::TimeCode(TimeCode { hours: 1, ..TimeCode::default() }));
    let attributes = stack_of(vec![part]).carried.attributes;
    let mut names: Vec<String> = attributes.iter().map(|(name, _)| name.to_string()).collect();
    names.sort();
    assert_eq!(names, ["framesPerSecond", "isoSpeed", "owner", "shot", "timeCode"]);
}

// The main picture.

#[test]
fn the_main_picture_is_the_root_even_if_there_are_peels() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("out.exr");
    let both =
        "R=0.5 G=0.5 B=0.5 A=1 Peel0.Combined.R=9 Peel0.Combined.G=9 Peel0.Combined.B=9 Peel0.Depth.Z=1";
    std::fs::write(&path, exr_bytes(vec![Part::flat((1, 1), both)])).expect("written");
    assert_eq!(read_picture(&path).expect("it is read").pixel(0, 0), [0.5, 0.5, 0.5, 1.0]);
    std::fs::write(&path, exr_bytes(vec![Part::flat((1, 1), "img.R=2 img.G=1 img.B=0")])).expect("written");
    assert_eq!(read_picture(&path).expect("it is read").pixel(0, 0), [2.0, 1.0, 0.0, 1.0]);
}

// Invalid and malicious input.

/// Overwrites the value of the first attribute called `name` of type `kind`.
fn patched(mut bytes: Vec<u8>, name: &str, kind: &str, value: &[u8]) -> Vec<u8> {
    let key = format!("{name}\0{kind}\0");
    let at =
        bytes.windows(key.len()).position(|window| window == key.as_bytes()).expect("the attribute is there");
    let start = at + key.len() + 4;
    bytes[start..start + value.len()].copy_from_slice(value);
    bytes
}

fn small() -> Vec<u8> {
    exr_bytes(vec![Part::flat((4, 4), "R=1 G=1 B=1 A=1 Z=1")])
}

#[test]
fn a_small_file_with_a_huge_data_window_is_refused() {
    let corner = |x: i32, y: i32| [0i32, 0, x, y].map(i32::to_le_bytes).concat();
    for (x, y) in [(99_999, 99_999), (i32::MAX, i32::MAX), (-5, 3), (1_000_000_000, 0)] {
        let error = failure(patched(small(), "dataWindow", "box2i", &corner(x, y)));
        assert_eq!(error.kind(), ErrorKind::Input, "{x} {y}: {error}");
    }
}

#[test]
fn an_invalid_display_window_is_refused() {
    for x in [1 << 28, -1] {
        let display = [0i32, 0, x, x].map(i32::to_le_bytes).concat();
        assert_eq!(failure(patched(small(), "displayWindow", "box2i", &display)).kind(), ErrorKind::Input);
    }
}

#[test]
fn a_picture_above_the_memory_limit_is_refused_with_both_sizes() {
    let bytes = exr_bytes(vec![Part::flat((1024, 512), "R=1 G=1 B=1 A=1 Z=1")]);
    let options = ReadOptions { max_bytes: Some(8 << 20), ..ReadOptions::default() };
    let error = failure_with(bytes, &options);
    assert_eq!(error.kind(), ErrorKind::Limits);
    // 1024 · 512 pixels · 5 channels · 4 bytes = 10 MiB.
    assert!(error.to_string().contains("10 MiB") && error.to_string().contains("8 MiB"), "{error}");
}

#[test]
fn deep_data_and_unsupported_codecs_are_errors_with_a_help() {
    let mut deep = small();
    deep[5] |= 8;
    assert_eq!(failure(deep.clone()).kind(), ErrorKind::Unsupported);
    assert!(failure(deep).to_string().contains("deep"));
    let error = failure(patched(small(), "compression", "compression", &[10]));
    assert_eq!(error.kind(), ErrorKind::Unsupported);
    assert!(error.to_string().contains("HTJ2K") && error.to_string().contains("ZIP (scanline)"), "{error}");
}

#[test]
fn subsampled_channels_are_an_error_with_the_channel() {
    // In the channel list: name, type, linear flag and padding, then the two sampling rates.
    let mut bytes = small();
    let at = bytes.windows(2).position(|window| window == b"B\0").expect("a channel called B") + 2 + 4 + 4;
    bytes[at..at + 8].copy_from_slice(&[2, 0, 0, 0, 2, 0, 0, 0]);
    let error = failure(bytes);
    assert_eq!(error.kind(), ErrorKind::Unsupported);
    assert!(error.to_string().contains("channel B with one sample per 2×2 pixels"), "{error}");
}

#[test]
fn paths_that_are_not_pictures_are_errors() {
    let folder = tempfile::tempdir().expect("a folder");
    let fails = |path: &Path| {
        read(&[Source::File(path.to_owned())], &ReadOptions::default()).expect_err("no picture").to_string()
    };
    assert!(fails(folder.path()).starts_with("this is a folder"));
    assert!(fails(&folder.path().join("absent.exr")).starts_with("no such file"));
    let path = folder.path().join("notes.exr");
    std::fs::write(&path, "").expect("written");
    assert!(fails(&path).starts_with("the file is empty"));
    std::fs::write(&path, "just words").expect("written");
    assert!(fails(&path).starts_with("this is not an OpenEXR file"));
    assert!(read(&[], &ReadOptions::default()).is_err());
}

#[test]
fn a_file_truncated_anywhere_is_an_error() {
    let bytes = small();
    for len in 1..bytes.len() {
        failure(bytes[..len].to_vec());
    }
}

#[test]
fn mutated_files_are_read_or_refused_without_a_panic() {
    let peels =
        "Peel0.Combined.R=1 Peel0.Combined.G=1 Peel0.Combined.B=1 Peel0.Combined.A=1 Peel0.Depth.Z=1 id=3";
    let codecs =
        [Compression::ZIP16, Compression::PIZ, Compression::RLE, Compression::DWAA(None), Compression::PXR24];
    let files = codecs.map(|compression| {
        let tile = (compression == Compression::RLE).then_some((4, 4));
        exr_bytes(vec![Part { compression, tile, ..Part::flat((9, 40), peels) }])
    });
    let mut state = 0x2545_f491_4f6c_dd1d_u64;
    let mut random = |below: usize| {
        // xorshift64: a fixed seed makes a failure repeatable.
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as usize % below
    };
    for round in 0..300 {
        let mut bytes = files[round % files.len()].clone();
        for _ in 0..=random(4) {
            let at = random(bytes.len());
            bytes[at] = random(256) as u8;
        }
        if random(8) == 0 {
            bytes.truncate(1 + random(bytes.len()));
        }
        let _ = read(&[source(bytes)], &ReadOptions::default());
    }
}

/// Picks the depth of [`first_pixels`].
trait MapDepth {
    fn map_depth(&self) -> Vec<f32>;
}

impl MapDepth for Vec<[f32; 5]> {
    fn map_depth(&self) -> Vec<f32> {
        self.iter().map(|pixel| pixel[4]).collect()
    }
}
