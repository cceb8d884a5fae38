//! Names of channels: which is depth, by program, and which is not.

use crate::fixtures::{Part, exr_bytes, failure, failure_with, source, stack_of};
use exr::image::FlatSamples;
use exr::meta::attribute::{AttributeValue, Text};
use thinlens::settings::{DepthConvention, Focus};
use thinlens::stack::{ReadOptions, Stack, read};

fn depths(stack: &Stack) -> Vec<f32> {
    stack.peels.iter().map(|peel| peel.depth.get(0, 0)).collect()
}

fn said(stack: &Stack, about: &str, words: &str) -> bool {
    stack.findings.iter().any(|finding| finding.about == about && finding.text.contains(words))
}

fn text(value: &str) -> AttributeValue {
    AttributeValue::Text(Text::from(value))
}

/// A pixel of the colour (1, 0.5, 0.25) in the group `group`.
fn color(group: &str) -> String {
    format!("{group}R=1 {group}G=0.5 {group}B=0.25")
}

#[test]
fn depth_is_found_by_the_names_of_every_program_and_named() {
    for (program, picture, depth, name) in [
        ("Blender's file output", color("Image.").as_str(), "Depth.V=7", "Depth.V"),
        ("Blender's item", color("Image.").as_str(), "Z.V=7", "Z.V"),
        ("Nuke", &color(""), "depth.Z=7", "depth.Z"),
        ("RenderMan", "Ci.r=1 Ci.g=0.5 Ci.b=0.25 a=1", "z=7", "z"),
        ("Houdini", &color(""), "Pz=7", "Pz"),
        ("Houdini's planes", &color("C."), "Pz.z=7", "Pz.z"),
        ("Karma", &color(""), "depth=7", "depth"),
        ("V-Ray", &color(""), "VRayZDepth.R=7 VRayZDepth.G=7 VRayZDepth.B=7 VRayZDepth.A=1", "VRayZDepth.R"),
        ("V-Ray, one channel", &color(""), "VRayZDepth=7", "VRayZDepth"),
        ("ZDepth", &color("rgba."), "ZDepth.Z=7", "ZDepth.Z"),
        (
            "Corona",
            &color(""),
            "CESSENTIAL_ZDepth.R=7 CESSENTIAL_ZDepth.G=7 CESSENTIAL_ZDepth.B=7",
            "CESSENTIAL_ZDepth.R",
        ),
        ("Depth.depth", &color(""), "Depth.depth=7", "Depth.depth"),
        ("Redshift", &color(""), "Depth.Z=7", "Depth.Z"),
        (
            "Unreal",
            &color("FinalImage."),
            "FinalImageWorldDepth.R=7 FinalImageWorldDepth.G=7 FinalImageWorldDepth.B=7",
            "FinalImageWorldDepth.R",
        ),
        ("pbrt", &color(""), "Px=1 Py=2 Pz=7 dzdx=0 dzdy=0", "Pz"),
        ("Arnold", &color(""), "Z=7 volume_Z=3 st.S=0 st.T=1", "Z"),
    ] {
        let stack = stack_of(vec![Part::flat((2, 1), &format!("{picture} {depth}"))]);
        assert_eq!(depths(&stack), [7.0], "{program}");
        assert_eq!(stack.peels[0].color[1].get(0, 0), 0.5, "{program}");
        assert!(said(&stack, "depth", name), "{program}: {:?}", stack.findings);
    }
}

#[test]
fn the_alpha_of_ci_is_that_of_the_root() {
    let stack = stack_of(vec![Part::flat((1, 1), "Ci.r=0.5 Ci.g=0.5 Ci.b=0.5 a=0.75 z=4")]);
    assert_eq!(stack.peels[0].alpha.get(0, 0), 0.75);
}

#[test]
fn a_channel_that_is_alone_is_not_depth_for_that_and_is_listed_with_its_meaning() {
    for (name, meaning) in [
        ("ViewLayer.Mist.Z", "a mist pass"),
        ("ViewLayer.Denoising~Depth.Z", "denoiser"),
        ("st.T", "texture coordinates"),
        ("volume.Z", "volumes"),
        ("volume_depth.Z", "volumes"),
        ("data.Z", "data.Z"),
        ("T", "T"),
        ("thing.V", "thing.V"),
        ("my_dist.X1", "my_dist.X1"),
    ] {
        let layer =
            "ViewLayer.Combined.R=1 ViewLayer.Combined.G=1 ViewLayer.Combined.B=1 ViewLayer.Combined.A=1";
        let bytes = exr_bytes(vec![Part::flat((2, 2), &format!("{layer} {name}=0.5"))]);
        let error = failure(bytes.clone()).to_string();
        let name = name.replace('~', " ");
        assert!(error.starts_with("peel 0 has no depth channel"), "{name}: {error}");
        assert!(
            error.contains(&name) && error.contains(meaning) && error.contains("`depth_channel`"),
            "{name}: {error}"
        );
        let options = ReadOptions { depth_channel: Some(name.clone()), ..ReadOptions::default() };
        let stack = read(&[source(bytes)], &options).expect("it is named by the user");
        assert_eq!(depths(&stack), [0.5], "{name}");
    }
}

#[test]
fn parts_called_after_what_they_hold_are_found() {
    let rgba = || Part::flat((2, 1), &color("")).named("rgba_main");
    let stack = stack_of(vec![rgba(), Part::flat((2, 1), "Z=5").named("depth")]);
    assert_eq!(depths(&stack), [5.0]);
    let main = |part: Part| part.attribute("view", text("main"));
    let stack = stack_of(vec![main(rgba()), main(Part::flat((2, 1), "Z=5").named("depth_main"))]);
    assert_eq!(depths(&stack), [5.0], "the view's name is no part of the depth's");
    let error = failure(exr_bytes(vec![rgba(), Part::flat((2, 1), "Z=5").named("mist")]));
    assert!(error.to_string().contains("mist.Z (a mist pass"), "{error}");
}

#[test]
fn a_depth_file_of_three_equal_channels_is_depth_and_one_in_colours_is_not() {
    let picture = source(exr_bytes(vec![Part::flat((8, 1), &color(""))]));
    let folder = tempfile::tempdir().expect("a folder");
    let ramp =
        |factor: f32| FlatSamples::F32((0..8).map(|x| (x as f32 - 3.6).abs() * factor + 1.0).collect());
    let read_with = |factor: f32, depth_channel: Option<&str>| {
        let path = folder.path().join("depth.exr");
        let part =
            Part::flat((8, 1), "R=0").with("R", ramp(1.0)).with("G", ramp(factor)).with("B", ramp(1.0));
        std::fs::write(&path, exr_bytes(vec![part])).expect("written");
        let depth_channel = depth_channel.map(str::to_owned);
        read(
            std::slice::from_ref(&picture),
            &ReadOptions { depth_file: Some(path), depth_channel, ..ReadOptions::default() },
        )
    };
    assert_eq!(depths(&read_with(1.0, None).expect("grey")), [4.6]);
    let error = read_with(-0.1, None).expect_err("colours").to_string();
    assert!(error.starts_with("the depth is a picture in colours"), "{error}");
    assert_eq!(depths(&read_with(-0.1, Some("R")).expect("named")), [4.6]);
}

#[test]
fn a_depth_picture_in_colours_is_refused_unless_its_channel_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("depth.png");
    let picture = source(exr_bytes(vec![Part::flat((8, 1), &color(""))]));
    let read_with = |shade: fn(u8) -> [u8; 3], depth_channel: Option<&str>| {
        image::RgbImage::from_fn(8, 1, |x, _| image::Rgb(shade(x as u8 * 30))).save(&path).expect("written");
        let depth_channel = depth_channel.map(str::to_owned);
        let options = ReadOptions { depth_file: Some(path.clone()), depth_channel, ..ReadOptions::default() };
        read(std::slice::from_ref(&picture), &options).map(|stack| stack.peels[0].depth.get(7, 0))
    };
    assert_eq!(read_with(|x| [x, x, x], None).expect("grey"), 210.0 / 255.0);
    let error = read_with(|x| [x, 255 - x, 40], None).expect_err("a heat map").to_string();
    assert!(error.starts_with("the depth is a picture in colours"), "{error}");
    assert_eq!(read_with(|x| [x, 255 - x, 40], Some("G")).expect("named"), 45.0 / 255.0);
}

#[test]
fn a_second_file_of_three_equal_channels_is_the_depth_of_the_first() {
    let picture = source(exr_bytes(vec![Part::flat((2, 1), &color(""))]));
    for channels in
        ["R=6 G=6 B=6", "depth.R=6 depth.G=6 depth.B=6", "VRayZDepth.R=6 VRayZDepth.G=6 VRayZDepth.B=6"]
    {
        let depth = source(exr_bytes(vec![Part::flat((2, 1), channels)]));
        let stack = read(&[picture.clone(), depth], &ReadOptions::default()).expect("colour and depth");
        assert_eq!(depths(&stack), [6.0], "{channels}");
    }
}

#[test]
fn a_position_and_the_camera_of_the_header_are_depth() {
    let position = "P.X=1 P.Y=2 P.Z=-2";
    let bytes = |camera: bool| {
        let part = Part::flat((2, 1), &format!("{} {position}", color("")));
        let moved = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., -5., 1.];
        exr_bytes(vec![if camera {
            part.attribute("worldToCamera", AttributeValue::Matrix4x4(moved))
        } else {
            part
        }])
    };
    // The camera at z = 5 looks along −z: a point at z = −2 is 7 in front of it.
    let stack = read(&[source(bytes(true))], &ReadOptions::default()).expect("a position with a camera");
    assert_eq!(depths(&stack), [7.0]);
    assert!(said(&stack, "depth", "P.Z"), "{:?}", stack.findings);
    assert!(failure(bytes(false)).to_string().starts_with("peel 0 has no depth channel"));
}

#[test]
fn inverse_depth_is_told_by_the_writer() {
    let part = |header: (&'static str, &str), values: Vec<f32>| {
        Part::flat((4, 1), &format!("{} depth.Z=0", color("")))
            .with("depth.Z", FlatSamples::F32(values))
            .attribute(header.0, text(header.1))
    };
    let convention = |header, values| stack_of(vec![part(header, values)]).convention;
    let reciprocals = || vec![0.083, 0.333, 0.2, 0.0];
    assert_eq!(convention(("nuke/version", "15.0v4"), reciprocals()), DepthConvention::Inverse);
    assert_eq!(convention(("software", "Nuke 13.2v5"), reciprocals()), DepthConvention::Inverse);
    assert_eq!(convention(("nuke/version", "15.0v4"), vec![12.0, 3.0, 5.0, 1e10]), DepthConvention::Planar);
    assert_eq!(convention(("comments", "none"), reciprocals()), DepthConvention::Planar);
}

// Camera data.

fn camera_of(attributes: &[(&'static str, AttributeValue)]) -> thinlens::settings::Values {
    let mut part = Part::flat((1, 1), "R=1 G=1 B=1 Z=1");
    for (name, value) in attributes {
        part = part.attribute(name, value.clone());
    }
    stack_of(vec![part]).camera
}

#[test]
fn the_pinholes_focal_length_comes_before_the_effective_and_the_nominal() {
    let number = AttributeValue::F32;
    let (pinhole, effective, nominal) = (
        ("pinholeFocalLength", number(41.0)),
        ("effectiveFocalLength", number(42.0)),
        ("nominalFocalLength", number(43.0)),
    );
    assert_eq!(camera_of(&[nominal.clone(), effective.clone(), pinhole]).focal_length_mm, Some(41.0));
    assert_eq!(camera_of(&[nominal.clone(), effective]).focal_length_mm, Some(42.0));
    assert_eq!(camera_of(&[nominal]).focal_length_mm, Some(43.0));
}

#[test]
fn the_part_of_the_sensor_that_was_used_comes_before_the_whole() {
    let size = |width, height| AttributeValue::FloatVec2(exr::math::Vec2(width, height));
    let whole = ("sensorOverallDimensions", size(36.0, 24.0));
    assert_eq!(
        camera_of(&[whole.clone(), ("sensorAcquisitionDimensions", size(24.0, 13.5))]).sensor_width_mm,
        Some(24.0)
    );
    assert_eq!(camera_of(&[whole]).sensor_width_mm, Some(36.0));
}

#[test]
fn cameras_of_renderers_are_read() {
    let number = AttributeValue::F32;
    let vray = camera_of(&[
        ("vrayInfo/camera", text("cam")),
        ("cameraAperture", number(24.0)),
        ("cameraFNumber", number(4.0)),
        ("cameraFocalLength", number(35.0)),
        ("cameraTargetDistance", number(6.5)),
    ]);
    assert_eq!(
        (vray.sensor_width_mm, vray.f_number, vray.focal_length_mm),
        (Some(24.0), Some(4.0), Some(35.0))
    );
    assert_eq!(vray.focus, Some(Focus::Distance(6.5)));
    let unreal = camera_of(&[
        ("unreal/camera/FinalImage/fstop", text("2.8")),
        ("unreal/camera/FinalImage/sensorWidth", text("24")),
        ("unreal/camera/FinalImage/fov", text("90")),
        ("unreal/camera/FinalImage/focalDistance", text("450")),
    ]);
    assert_eq!((unreal.f_number, unreal.metres_per_unit), (Some(2.8), Some(0.01)));
    assert!((unreal.focal_length_mm.expect("of the field of view") - 12.0).abs() < 1e-3);
    assert_eq!(unreal.focus, Some(Focus::Distance(450.0)));
    let blender = camera_of(&[("BlenderMultiChannel", text("Blender V2.55.1")), ("Lens", text("85.00 mm"))]);
    assert_eq!(blender.focal_length_mm, Some(85.0));
}

#[test]
fn focus_at_infinity_and_a_pinhole_of_usd_are_read() {
    let infinity = camera_of(&[("focus", AttributeValue::F32(f32::INFINITY))]);
    assert_eq!(infinity.focus, Some(Focus::Distance(f32::INFINITY)));
    let closed = ("aperture", AttributeValue::F32(0.0));
    assert_eq!(camera_of(&[closed.clone(), ("software", text("usdrecord"))]).f_number, Some(f32::INFINITY));
    assert_eq!(camera_of(&[closed]).f_number, None);
}

#[test]
fn camera_data_may_be_in_any_part() {
    let stack = stack_of(vec![
        Part::flat((1, 1), "R=1 G=1 B=1").named("rgba"),
        Part::flat((1, 1), "Z=6").named("depth").attribute("aperture", AttributeValue::F32(2.0)),
    ]);
    assert_eq!(stack.camera.f_number, Some(2.0));
}

// Views.

fn two_eyes() -> String {
    format!("{} left.A=1 left.Z=2 right.R=3 right.G=3 right.B=3 right.A=1 right.Z=5", color("left."))
}

fn of_view(bytes: Vec<u8>, view: &str) -> Stack {
    let options = ReadOptions { view: Some(view.to_owned()), ..ReadOptions::default() };
    read(&[source(bytes)], &options).unwrap_or_else(|error| panic!("{view}: {error}"))
}

fn eyes(names: &[&str]) -> AttributeValue {
    AttributeValue::TextVector(names.iter().map(|name| Text::from(*name)).collect())
}

#[test]
fn two_eyes_are_never_peels_and_one_is_chosen_by_its_name() {
    let stated = Part::flat((2, 1), &two_eyes()).attribute("multiView", eyes(&["left", "right"]));
    let hero =
        Part::flat((2, 1), &two_eyes().replace("left.", "")).attribute("multiView", eyes(&["left", "right"]));
    let last = |name: &str| format!("{} {name}.left.A=1 {name}.left.Z=2", color(&format!("{name}.left.")));
    let behind =
        format!("{} {}", last("beauty"), last("beauty").replace("left", "right").replace("Z=2", "Z=5"));
    let behind = Part::flat((2, 1), &behind).attribute("multiView", eyes(&["left", "right"]));
    let unstated = Part::flat((2, 1), &two_eyes());
    let unstated_hero = Part::flat((2, 1), &two_eyes().replace("left.", ""));
    for (case, part) in [stated, hero, behind, unstated, unstated_hero].into_iter().enumerate() {
        let bytes = exr_bytes(vec![part]);
        let error = failure(bytes.clone()).to_string();
        assert!(error.contains("left and right") && error.contains("`view = left`"), "{case}: {error}");
        for (view, depth) in [("left", 2.0), ("right", 5.0), ("RIGHT", 5.0)] {
            let stack = of_view(bytes.clone(), view);
            assert_eq!(depths(&stack), [depth], "{case}: {view}");
            assert!(stack.carried.channels.is_empty(), "{case}: nothing of the other eye travels on");
            assert!(said(&stack, "view", &view.to_lowercase()), "{case}: {:?}", stack.findings);
        }
        let options = ReadOptions { view: Some("middle".to_owned()), ..ReadOptions::default() };
        let error = failure_with(bytes, &options).to_string();
        assert!(error.contains("no view called middle") && error.contains("left, right"), "{case}: {error}");
    }
}

#[test]
fn channels_are_named_as_they_are_stored_or_without_their_view() {
    let channels = format!("{} right.far=8", two_eyes());
    let part = Part::flat((2, 1), &channels).attribute("multiView", eyes(&["left", "right"]));
    let bytes = exr_bytes(vec![part]);
    for name in ["right.far", "far"] {
        let options = ReadOptions {
            view: Some("right".to_owned()),
            color_channel: Some("right".to_owned()),
            depth_channel: Some(name.to_owned()),
            ..ReadOptions::default()
        };
        assert_eq!(
            depths(&read(&[source(bytes.clone())], &options).expect("both are named")),
            [8.0],
            "{name}"
        );
    }
}

#[test]
fn grey_eyes_are_views() {
    let part =
        Part::flat((2, 1), "Y=1 Z=2 right.Y=1 right.Z=5").attribute("multiView", eyes(&["left", "right"]));
    let bytes = exr_bytes(vec![part]);
    assert!(failure(bytes.clone()).to_string().contains("left and right"));
    assert_eq!(depths(&of_view(bytes, "right")), [5.0]);
}

#[test]
fn parts_of_views_are_views() {
    let part = |view: &'static str, name: &'static str, channels: &str| {
        Part::flat((2, 1), channels).named(name).attribute("view", text(view))
    };
    let bytes = exr_bytes(vec![
        part("left", "rgba.left", &color("")),
        part("left", "depth.left", "Z=2"),
        part("right", "rgba.right", &color("")),
        part("right", "depth.right", "Z=5"),
    ]);
    assert!(failure(bytes.clone()).to_string().contains("left and right"));
    assert_eq!(depths(&of_view(bytes.clone(), "left")), [2.0]);
    assert_eq!(depths(&of_view(bytes, "right")), [5.0]);
}

#[test]
fn lights_called_left_and_right_are_no_views() {
    let channels = format!("{} A=1 Z=4 {} {}", color(""), color("left."), color("right."));
    let stack = stack_of(vec![Part::flat((2, 1), &channels)]);
    assert_eq!((depths(&stack), stack.carried.channels.len()), (vec![4.0], 6));
}

#[test]
fn two_files_of_two_eyes_are_no_peels() {
    let bytes = |z: usize| exr_bytes(vec![Part::flat((1, 1), &format!("R=1 G=1 B=1 A=1 Z={z}"))]);
    for pair in [["shot_L.0001.exr", "shot_R.0001.exr"], ["a.left.exr", "a.right.exr"]] {
        let sources = [0, 1].map(|i| thinlens::stack::Source::memory(pair[i], bytes(2 + i)));
        let error = read(&sources, &ReadOptions::default()).expect_err("two eyes").to_string();
        assert!(error.contains(pair[0]) && error.contains(pair[1]), "{error}");
    }
    let peels = ["peel0.exr", "peel1.exr"];
    let sources = [0, 1].map(|i| thinlens::stack::Source::memory(peels[i], bytes(2 + i)));
    assert_eq!(read(&sources, &ReadOptions::default()).expect("peels").peels.len(), 2);
}

#[test]
fn files_without_views_refuse_one_that_is_requested() {
    let options = ReadOptions { view: Some("left".to_owned()), ..ReadOptions::default() };
    let error = failure_with(exr_bytes(vec![Part::flat((1, 1), "R=1 G=1 B=1 Z=1")]), &options).to_string();
    assert!(error.contains("no view called left") && error.contains("no views"), "{error}");
}

// Colour as luminance and chroma.

#[test]
fn luminance_and_chroma_with_a_sample_a_pixel_are_the_colours_they_were_made_of() {
    // Rec. 709, as a header without chromaticities means; Y is the luminance of (0.9, 0.5, 0.25).
    let luminance = 0.212_639 * 0.9 + 0.715_169 * 0.5 + 0.072_192 * 0.25;
    let (of_red, of_blue) = ((0.9 - luminance) / luminance, (0.25 - luminance) / luminance);
    let stack =
        stack_of(vec![Part::flat((2, 1), &format!("Y={luminance} RY={of_red} BY={of_blue} A=1 Z=3"))]);
    let found = stack.peels[0].color.each_ref().map(|plane| plane.get(1, 0));
    assert!(found.iter().zip([0.9, 0.5, 0.25]).all(|(a, b)| (a - b).abs() < 1e-5), "{found:?}");
    assert_eq!((stack.peels[0].alpha.get(1, 0), stack.carried.channels.len()), (1.0, 0));
}

// Headers that contradict themselves.

/// `bytes` with another value of the attribute `type`, of the same length: shorter texts end in zeros.
fn with_type(mut bytes: Vec<u8>, kind: &str) -> Vec<u8> {
    let at = bytes.windows(12).position(|window| window == b"type\0string\0").expect("a type") + 12;
    let size = u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]) as usize;
    bytes[at + 4..at + 4 + size].fill(0);
    bytes[at + 4..at + 4 + kind.len()].copy_from_slice(kind.as_bytes());
    bytes
}

#[test]
fn of_a_file_of_one_part_the_flags_count_and_not_a_type_that_contradicts_them() {
    let scan_lines = exr_bytes(vec![Part::flat((9, 20), "R=1 G=1 B=1 A=1 Z=4")]);
    for kind in ["tiledimage", "scanline", "picture"] {
        let stack = read(&[source(with_type(scan_lines.clone(), kind))], &ReadOptions::default());
        let stack = stack.unwrap_or_else(|error| panic!("{kind}: {error}"));
        assert_eq!(stack.peels[0].depth.get(8, 19), 4.0, "{kind}");
        assert!(stack.carried.attributes.is_empty(), "{kind}: {:?}", stack.carried.attributes);
    }
    let tiled = Part { tile: Some((8, 8)), ..Part::flat((9, 20), "R=1 G=1 B=1 A=1 Z=4") };
    let stack = read(&[source(with_type(exr_bytes(vec![tiled]), "scanline"))], &ReadOptions::default());
    assert_eq!(stack.expect("tiles by the flags").peels[0].depth.get(8, 19), 4.0);
}

#[test]
fn a_damaged_header_names_what_is_damaged() {
    let mut bytes = exr_bytes(vec![Part::flat((2, 2), "R=1 G=1 B=1 Z=1")]);
    let key = b"pixelAspectRatio\0float\0";
    let at = bytes.windows(key.len()).position(|window| window == key).expect("it is there") + key.len();
    let with_size = |bytes: &mut Vec<u8>, size: i32| bytes[at..at + 4].copy_from_slice(&size.to_le_bytes());
    with_size(&mut bytes, -4);
    let error = failure(bytes.clone()).to_string();
    assert!(error.starts_with("the header is damaged") && error.contains("pixelAspectRatio"), "{error}");
    with_size(&mut bytes, 1 << 20);
    let error = failure(bytes).to_string();
    assert!(error.contains("pixelAspectRatio"), "{error}");
}

// Cryptomattes.

#[test]
fn a_manifest_beside_the_picture_names_its_objects_and_half_ids_are_said() {
    let folder = tempfile::tempdir().expect("a folder");
    let id = 0x3f80_0001_u32;
    let matte = |samples: FlatSamples| {
        Part::flat((2, 1), "R=1 G=1 B=1 A=1 Z=4 CryptoObject00.R=0 CryptoObject00.G=1")
            .with("CryptoObject00.R", samples)
            .attribute("cryptomatte/1234567/name", text("CryptoObject"))
            .attribute("cryptomatte/1234567/manif_file", text("names.json"))
    };
    let path = folder.path().join("picture.exr");
    std::fs::write(&path, exr_bytes(vec![matte(FlatSamples::F32(vec![f32::from_bits(id); 2]))]))
        .expect("written");
    std::fs::write(folder.path().join("names.json"), format!("{{\"the cow\":\"{id:08x}\"}}"))
        .expect("written");
    let options = ReadOptions { objects: true, ..ReadOptions::default() };
    let stack = read(&[thinlens::stack::Source::file(&path)], &options).expect("it is read");
    assert_eq!(stack.object("the cow").expect("it is named in the file").coverage, [1.0, 1.0]);
    std::fs::remove_file(folder.path().join("names.json")).expect("it was there");
    let stack = read(&[thinlens::stack::Source::file(&path)], &options).expect("it is read");
    let doubt = stack.objects()[0].doubt.clone().expect("the file is gone");
    assert!(doubt.contains("names.json"), "{doubt}");

    let half = matte(FlatSamples::F16(vec![half::f16::ONE; 2]));
    let stack = read(&[source(exr_bytes(vec![half]))], &options).expect("it is read");
    assert!(said(&stack, "cryptomatte", "CryptoObject00.R are 16-bit"), "{:?}", stack.findings);
    let error = stack.object("the cow").expect_err("no ids").to_string();
    assert!(error.contains("16-bit"), "{error}");
}
