//! Focus on points, on objects by cryptomatte, and focus keys of a sequence.

#![expect(clippy::unwrap_used, reason = "a test stops at the first failure")]

#[expect(dead_code, reason = "other tests use the rest")]
mod fixtures;
#[cfg(feature = "cli")]
#[expect(dead_code, reason = "other tests use the rest")]
mod program;

use exr::image::FlatSamples;
use exr::meta::attribute::{AttributeValue, Text};
use fixtures::{Part, exr_bytes, source};
use half::f16;
use thinlens::error::Error;
use thinlens::render::{Job, NamedPreset, prepare};
use thinlens::scene::{Focused, focus_distance};
use thinlens::settings::{Focus, Preset};
use thinlens::stack::depth::DepthScale;
use thinlens::stack::{Carry, Objects, ReadOptions, Stack, read};

/// Ids of names, as Cryptomatte's own tests have them.
const CUBE: u32 = 0xd968_2f08;
const SPHERE: u32 = 0x591e_9a8d;

/// Names and ids as a manifest.
const MANIFEST: &str = r#"{"cube":"d9682f08","sphere":"591e9a8d","plane":"2e2136b8"}"#;

fn floats(values: &[f32]) -> FlatSamples {
    FlatSamples::F32(values.to_vec())
}

fn ids(ids: &[u32]) -> FlatSamples {
    FlatSamples::F32(ids.iter().copied().map(f32::from_bits).collect())
}

fn text(text: &str) -> AttributeValue {
    AttributeValue::Text(Text::from_slice_unchecked(text.as_bytes()))
}

/// A picture of one row, its pixels at `depths`.
fn picture(depths: &[f32]) -> Part {
    Part::flat((depths.len(), 1), "R=1 G=1 B=1 A=1").with("Z", floats(depths))
}

trait Crypto {
    /// Adds the channels `NAME00.R` and `.G`: ids of largest coverage, and that coverage.
    fn matte(self, name: &str, objects: &[u32], coverage: &[f32]) -> Self;
    /// Adds the channels `NAME00.B` and `.A`: the ids of second largest coverage.
    fn second(self, name: &str, objects: &[u32], coverage: &[f32]) -> Self;
    /// Adds header attributes with `NAME` and its manifest.
    fn manifest(self, name: &str, manifest: &str) -> Self;
}

impl Crypto for Part {
    fn matte(self, name: &str, objects: &[u32], coverage: &[f32]) -> Self {
        self.with(&format!("{name}00.R"), ids(objects)).with(&format!("{name}00.G"), floats(coverage))
    }

    fn second(self, name: &str, objects: &[u32], coverage: &[f32]) -> Self {
        self.with(&format!("{name}00.B"), ids(objects)).with(&format!("{name}00.A"), floats(coverage))
    }

    fn manifest(self, name: &str, manifest: &str) -> Self {
        self.attribute("cryptomatte/1234567/name", text(name))
            .attribute("cryptomatte/1234567/hash", text("MurmurHash3_32"))
            .attribute("cryptomatte/1234567/conversion", text("uint32_to_float32"))
            .attribute("cryptomatte/1234567/manifest", text(manifest))
    }
}

/// Cube, cube, sphere, sphere at 1, 2, 3 and 4, with a manifest.
fn four() -> Part {
    picture(&[1.0, 2.0, 3.0, 4.0])
        .matte("CryptoObject", &[CUBE, CUBE, SPHERE, SPHERE], &[1.0; 4])
        .manifest("CryptoObject", MANIFEST)
}

fn options() -> ReadOptions {
    ReadOptions { objects: true, ..ReadOptions::default() }
}

fn stack_with(parts: Vec<Part>, options: &ReadOptions) -> Stack {
    read(&[source(exr_bytes(parts))], options).unwrap_or_else(|error| panic!("{error}"))
}

fn focused(stack: &Stack, name: &str) -> Result<Focused, Error> {
    let scale =
        DepthScale { convention: stack.convention, near_clip: 0.0, near_far: [0.0, 1.0], focal_px: 100.0 };
    focus_distance(stack, &scale, &Focus::Object(name.to_owned()), None)
}

/// The focus distance of an object in a file of `parts`.
fn distance(parts: Vec<Part>, name: &str) -> f32 {
    focused(&stack_with(parts, &options()), name).unwrap_or_else(|error| panic!("{error}")).distance
}

fn failure(parts: Vec<Part>, name: &str) -> String {
    focused(&stack_with(parts, &options()), name).unwrap_err().to_string()
}

// The distance of an object.

#[test]
fn the_distance_of_an_object_is_the_median_of_its_pixels() {
    let part = picture(&[5.0, 2.0, 9.0, 2.5, 1000.0, 7.0])
        .matte("CryptoObject", &[CUBE, CUBE, CUBE, CUBE, CUBE, SPHERE], &[1.0; 6])
        .manifest("CryptoObject", MANIFEST);
    let focused = focused(&stack_with(vec![part], &options()), "cube").unwrap();
    assert_eq!(focused.distance, 5.0, "of 2, 2.5, 5, 9 and 1000");
    assert_eq!(focused.reason.unwrap(), "object 'cube' of CryptoObject: 5, the median of 5 pixels");
}

#[test]
fn pixels_that_an_object_covers_by_less_than_half_are_ignored() {
    let part = |coverage: &[f32]| {
        picture(&[1.0, 2.0, 8.0])
            .matte("CryptoObject", &[CUBE; 3], coverage)
            .manifest("CryptoObject", MANIFEST)
    };
    assert_eq!(distance(vec![part(&[0.49, 0.49, 0.5])], "cube"), 8.0);
    assert_eq!(distance(vec![part(&[0.5, 0.5, 0.5])], "cube"), 2.0);
    // Hair covers no pixel by half: the pixels of its largest coverage count.
    assert_eq!(distance(vec![part(&[0.1, 0.1, 0.3])], "cube"), 8.0);
}

#[test]
fn pixels_are_weighted_by_coverage() {
    let part = picture(&[1.0, 2.0, 8.0])
        .matte("CryptoObject", &[CUBE; 3], &[0.5, 0.5, 1.0])
        .manifest("CryptoObject", MANIFEST);
    // Half of the weight, 1 of 2, is reached at the second.
    assert_eq!(distance(vec![part], "cube"), 2.0);
}

#[test]
fn coverage_of_all_ranks_adds_up() {
    let part = picture(&[1.0, 2.0])
        .matte("CryptoObject", &[SPHERE, CUBE], &[0.6, 0.3])
        .second("CryptoObject", &[CUBE, CUBE], &[0.4, 0.3])
        .manifest("CryptoObject", MANIFEST);
    assert_eq!(distance(vec![part], "cube"), 2.0, "0.6 of the second pixel, 0.4 of the first");
}

#[test]
fn the_depth_is_that_of_the_visible_peel() {
    let part = Part::flat((2, 1), "peel0.R=1 peel0.G=1 peel0.B=1 peel1.R=1 peel1.G=1 peel1.B=1 peel1.A=1")
        .with("peel0.A", floats(&[0.0, 1.0]))
        .with("peel0.depth", floats(&[1.0, 2.0]))
        .with("peel1.depth", floats(&[6.0, 7.0]))
        .matte("CryptoObject", &[CUBE, SPHERE], &[1.0, 1.0])
        .manifest("CryptoObject", MANIFEST);
    assert_eq!(distance(vec![part], "cube"), 6.0, "the first peel has nothing there");
}

#[test]
fn depth_along_the_ray_becomes_planar() {
    let part = Part::flat((200, 1), "R=1 G=1 B=1 A=1 depth.T=10");
    let place = |i| if i == 150 { CUBE } else { 0 };
    let part = part.matte("CryptoObject", &(0..200).map(place).collect::<Vec<_>>(), &[1.0; 200]);
    // 50.5 px from the axis before a lens 100 px long: 10 · 100 / √(100² + 50.5²).
    let expected = 10.0 * 100.0 / (100.0f32 * 100.0 + 50.5 * 50.5).sqrt();
    assert!((distance(vec![part], "cube") - expected).abs() < 1e-4);
}

#[test]
fn an_object_with_background_depth_only_has_no_distance() {
    let part = picture(&[1.0, 1e10])
        .matte("CryptoObject", &[CUBE, SPHERE], &[1.0; 2])
        .manifest("CryptoObject", MANIFEST);
    let message = failure(vec![part], "sphere");
    assert!(
        message.starts_with("the object 'sphere' has no depth") && message.contains("`focus_point"),
        "{message}"
    );
}

// How objects are found.

#[test]
fn channel_names_of_different_programs_are_read() {
    let ways = [
        ("CryptoObject", ["R", "G"], "CryptoObject"),
        ("ViewLayer.CryptoObject", ["r", "g"], "ViewLayer.CryptoObject"),
        ("View Layer.CryptoObject", ["R", "G"], "CryptoObject"),
        ("CryptoObject", ["R", "G"], "ViewLayer.CryptoObject"),
        ("crypto_object", ["red", "green"], "crypto_object"),
        ("Anything", ["R", "G"], "Anything"),
    ];
    for (channels, [id, coverage], header) in ways {
        let part = picture(&[1.0, 4.0])
            .with(&format!("{channels}00.{id}"), ids(&[0x2e21_36b8, 7]))
            .with(&format!("{channels}00.{coverage}"), floats(&[1.0, 1.0]))
            .manifest(header, r#"{"plane":"2e2136b8","odd":"00000007"}"#);
        // Its id is not the hash of its name: only the manifest has it.
        assert_eq!(distance(vec![part], "odd"), 4.0, "{channels}00.{id}, header {header}");
    }
}

#[test]
fn a_cryptomatte_may_be_in_a_separate_part() {
    let crypto = |name| {
        let part = Part::flat((2, 1), "X=0").named(name);
        part.matte("CryptoObject", &[CUBE, 7], &[1.0; 2]).manifest("CryptoObject", r#"{"odd":"00000007"}"#)
    };
    let parts = vec![picture(&[1.0, 4.0]).named("rgba"), crypto("mattes")];
    assert_eq!(distance(parts, "odd"), 4.0);
    let part = Part::flat((2, 1), "X=0").named("CryptoObject00");
    let part = part.with("R", ids(&[7, CUBE])).with("G", floats(&[1.0; 2]));
    assert_eq!(distance(vec![picture(&[1.0, 4.0]).named("rgba"), part], "cube"), 4.0, "named as the part");
}

#[test]
fn without_a_manifest_a_name_is_found_by_its_hash() {
    let bare = || picture(&[1.0, 4.0]).matte("CryptoObject", &[CUBE, SPHERE], &[1.0; 2]);
    assert_eq!(distance(vec![bare()], "sphere"), 4.0, "no header at all");
    let elsewhere = bare()
        .attribute("cryptomatte/1234567/name", text("CryptoObject"))
        .attribute("cryptomatte/1234567/manif_file", text("names.json"));
    assert_eq!(distance(vec![elsewhere], "sphere"), 4.0, "a manifest in another file");
    for broken in ["", "{\"cube\":", "[1, 2]", "\u{0}", &"[".repeat(100_000)] {
        assert_eq!(distance(vec![bare().manifest("CryptoObject", broken)], "sphere"), 4.0, "{broken:.9}");
    }
    let message = failure(vec![bare().manifest("CryptoObject", "{")], "sphre");
    assert!(message.contains("2 objects without names: its manifest cannot be read"), "{message}");
}

#[test]
fn names_may_contain_any_characters() {
    let name = "Kühe/\"weiß\" равнина";
    let manifest = r#"{"Kühe\/\"wei\u00df\" равнина":"00000007"}"#;
    let part =
        picture(&[1.0, 4.0]).matte("CryptoObject", &[CUBE, 7], &[1.0; 2]).manifest("CryptoObject", manifest);
    assert_eq!(distance(vec![part], name), 4.0);
}

#[test]
fn ids_are_compared_as_bits() {
    // NaN differs from itself as a float, and 0 equals −0.
    let nan = 0x7fc0_0001;
    let manifest = r#"{"nan":"7fc00001","other nan":"7fc00002","zero":"80000000"}"#;
    let part = picture(&[1.0, 4.0, 5.0, 6.0])
        .matte("CryptoObject", &[0x7fc0_0002, nan, 0x8000_0000, 0], &[1.0; 4])
        .manifest("CryptoObject", manifest);
    let stack = stack_with(vec![part], &options());
    let distance = |name| focused(&stack, name).unwrap().distance;
    assert_eq!(["nan", "other nan", "zero"].map(distance), [4.0, 1.0, 5.0]);
}

#[test]
fn invalid_coverage_is_ignored_or_clamped() {
    let part = picture(&[1.0, 2.0, 3.0, 4.0])
        .matte("CryptoObject", &[CUBE; 4], &[f32::NAN, -5.0, 1e30, f32::INFINITY])
        .second("CryptoObject", &[SPHERE; 4], &[0.0; 4])
        .manifest("CryptoObject", MANIFEST);
    let stack = stack_with(vec![part], &options());
    assert_eq!(focused(&stack, "cube").unwrap().distance, 3.0, "both at most 1");
    assert!(focused(&stack, "sphere").is_err(), "none at all");
}

#[test]
fn coverage_of_16_bits_is_read_and_ids_of_16_bits_are_not() {
    let part = |id: FlatSamples| {
        let coverage = FlatSamples::F16(vec![f16::ZERO, f16::ONE]);
        picture(&[1.0, 4.0]).with("CryptoObject00.R", id).with("CryptoObject00.G", coverage)
    };
    assert_eq!(distance(vec![part(ids(&[CUBE; 2]))], "cube"), 4.0);
    let lost = part(FlatSamples::F16(vec![f16::ONE; 2]));
    let message = failure(vec![lost], "cube");
    assert!(message.contains("no cryptomatte") && message.contains("32-bit"), "{message}");
}

#[test]
fn a_manifest_of_half_a_million_names_is_searched() {
    let mut manifest = String::from("{");
    for i in 0..500_000 {
        manifest.push_str(&format!("\"/world/forest/tree_{i}\":\"{:08x}\",", 1_000_000 + i));
    }
    manifest.push_str("\"cow\":\"00000007\"}");
    let part =
        picture(&[1.0, 4.0]).matte("CryptoObject", &[CUBE, 7], &[1.0; 2]).manifest("CryptoObject", &manifest);
    let stack = stack_with(vec![part], &options());
    assert_eq!(focused(&stack, "cow").unwrap().distance, 4.0);
    let message = focused(&stack, "/world/forest/tree_499999").unwrap_err().to_string();
    assert!(
        message.contains("the object '/world/forest/tree_499999' is not visible in the picture"),
        "{message}"
    );
}

#[test]
fn objects_are_preferred_to_materials_of_the_same_name() {
    let manifest = |id: &str| format!(r#"{{"clay":"{id}"}}"#);
    let material = |name: &'static str| {
        let part = four().matte("CryptoMaterial", &[7, 7, 8, 8], &[1.0; 4]);
        part.attribute("cryptomatte/7654321/name", text("CryptoMaterial"))
            .attribute("cryptomatte/7654321/manifest", text(&manifest(name)))
    };
    assert_eq!(distance(vec![material("00000008")], "clay"), 3.0, "a material where no object is called so");
    let both = material("00000008").manifest("CryptoObject", &manifest("d9682f08"));
    assert_eq!(distance(vec![both], "clay"), 1.0, "the object where both are");
}

#[test]
fn only_the_cryptomattes_of_the_first_view_layer_are_used() {
    let peel = |n: usize| {
        format!(
            "Peel{n}.Combined.R=1 Peel{n}.Combined.G=1 Peel{n}.Combined.B=1 Peel{n}.Combined.A=1 Peel{n}.Depth.Z={}",
            n + 1
        )
    };
    let part = Part::flat((1, 1), &format!("{} {}", peel(0), peel(1)))
        .matte("Peel0.CryptoObject", &[CUBE], &[1.0])
        .matte("Peel1.CryptoObject", &[SPHERE], &[1.0]);
    let stack = stack_with(vec![part], &options());
    assert_eq!(focused(&stack, "cube").unwrap().distance, 1.0);
    assert!(focused(&stack, "sphere").is_err(), "the second peel's objects are hidden");
}

#[test]
fn each_cryptomatte_has_the_manifest_of_its_own_name() {
    let odd = |id: &str| format!(r#"{{"odd":"{id}"}}"#);
    let part = picture(&[1.0, 4.0])
        .matte("CryptoObject", &[8, 7], &[1.0; 2])
        .matte("B.CryptoObject", &[8, 9], &[1.0; 2])
        .manifest("CryptoObject", &odd("00000007"))
        .attribute("cryptomatte/7654321/name", text("B.CryptoObject"))
        .attribute("cryptomatte/7654321/manifest", text(&odd("00000008")));
    let objects = stack_with(vec![part], &options()).objects();
    let unnamed: Vec<_> = objects.iter().map(|found| (found.cryptomatte.as_str(), found.unnamed)).collect();
    assert_eq!(unnamed, [("B.CryptoObject", 1), ("CryptoObject", 1)]);
    assert!(objects.iter().all(|found| found.names == ["odd"]), "{objects:?}");
}

// Channels in memory.

#[test]
fn objects_are_found_whichever_channels_are_copied_to_the_output() {
    for carry in [Carry::Unused, Carry::All, Carry::None] {
        let stack = stack_with(vec![four()], &ReadOptions { carry, ..options() });
        assert_eq!(focused(&stack, "sphere").unwrap().distance, 3.0, "{carry:?}");
        let travels = stack.carried.channels.iter().any(|channel| channel.name == "CryptoObject00.R");
        assert_eq!(travels, carry != Carry::None, "{carry:?}");
        assert_eq!(stack.mattes.is_empty(), travels, "no channel is kept twice");
    }
    let unasked = stack_with(vec![four()], &ReadOptions { carry: Carry::None, ..ReadOptions::default() });
    assert!(unasked.mattes.is_empty(), "cryptomattes are not read unless requested");
}

#[test]
fn objects_of_a_supersampled_stack_are_found_and_not_copied_to_the_output() {
    let part = Part::flat((4, 2), "R=1 G=1 B=1 A=1")
        .with("Z", floats(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]))
        .matte("CryptoObject", &[CUBE, CUBE, CUBE, SPHERE, 0, 0, 0, 0], &[1.0; 8]);
    let stack = stack_with(vec![part], &ReadOptions { supersample: Some(2), ..options() });
    let focused = focused(&stack, "cube").unwrap();
    assert_eq!((focused.distance, stack.supersample), (2.0, 2));
    assert!(focused.reason.unwrap().ends_with("the median of 3 samples"));
    assert!(stack.carried.channels.is_empty());
}

// Messages.

#[test]
fn visible_objects_are_listed_largest_first() {
    let part = picture(&[1.0, 2.0, 3.0, 4.0])
        .matte("CryptoObject", &[SPHERE, CUBE, CUBE, 7], &[1.0, 1.0, 1.0, 0.5])
        .second("CryptoObject", &[0, SPHERE, 0, 0], &[0.0, 0.5, 1.0, 0.5])
        .manifest("CryptoObject", MANIFEST);
    let objects = stack_with(vec![part], &options()).objects();
    let [Objects { cryptomatte, names, unnamed: 1, doubt: None, .. }] = objects.as_slice() else {
        panic!("{objects:?}")
    };
    assert_eq!(cryptomatte, "CryptoObject");
    assert_eq!(names, &["cube", "sphere"], "the plane is not visible");
}

#[test]
fn an_unknown_object_is_an_error_with_the_nearest_name_and_a_list() {
    let message = failure(vec![four()], "shpere");
    assert!(message.starts_with("there is no object called 'shpere' in the picture"), "{message}");
    assert!(message.contains("found: in CryptoObject: cube, sphere"), "{message}");
    assert!(message.contains("did you mean 'sphere'?"), "{message}");
    assert!(failure(vec![four()], "Cube").contains("did you mean 'cube'?"), "case is often what slips");
    assert!(failure(vec![four()], "spher").contains("did you mean 'sphere'?"));
    assert!(failure(vec![four()], "").contains("`focus_point = [X, Y]`"), "nothing is near to nothing");
}

#[test]
fn a_list_of_many_objects_is_truncated() {
    let many: Vec<u32> = (1..=40).collect();
    let names = many.iter().map(|id| format!("\"n{id}\":\"{id:08x}\"")).collect::<Vec<_>>().join(",");
    let part = picture(&[1.0; 40]).matte("CryptoObject", &many, &[1.0; 40]);
    let message = failure(vec![part.manifest("CryptoObject", &format!("{{{names}}}"))], "cow");
    assert!(message.contains(" and 24 more\n"), "{message}");
}

#[test]
fn a_file_without_cryptomatte_is_an_error_with_the_expected_channels() {
    let message = failure(vec![picture(&[1.0])], "cow");
    assert_eq!(
        message,
        "the file has no cryptomatte: the object 'cow' cannot be found\n  looked for: 32-bit channels such as CryptoObject00.R G B A, \
         with the picture's data window\n  help: render with a Cryptomatte pass, or focus on a pixel with `focus_point = [X, Y]`"
    );
}

// Along a sequence.

/// The focus distance of a job with the preset `lens`, and the text of its finding.
fn pulled(lens: &str, frame: Option<i64>) -> Result<(f32, String), Error> {
    let preset = Preset::parse(lens, "lens.toml").unwrap();
    let job = Job {
        sources: vec![source(exr_bytes(vec![four()]))],
        frame,
        read_options: ReadOptions { carry: Carry::None, ..ReadOptions::default() },
        preset: Some(NamedPreset { name: "lens.toml".to_owned(), preset }),
        ..Job::default()
    };
    let prepared = prepare(&job)?;
    assert!(prepared.stack.mattes.is_empty(), "channels that were read for focusing are dropped");
    let said = prepared.stack.findings.iter().find(|finding| finding.about == "focus");
    Ok((prepared.lens.focus_distance, said.map(|finding| finding.text.clone()).unwrap_or_default()))
}

const PULL: &str = "
    [lens]
    [[lens.focus_keys]]
    frame = 1
    distance = 2
    easing = 'linear'
    [[lens.focus_keys]]
    frame = 5
    object = 'sphere'
    [[lens.focus_keys]]
    frame = 9
    point = [0, 0]";

#[test]
fn focus_is_interpolated_between_keys() {
    let distance = |frame| pulled(PULL, Some(frame)).unwrap().0;
    assert_eq!([distance(-7), distance(1)], [2.0; 2], "before the first key, focus is there");
    assert!((distance(3) - 2.4).abs() < 1e-6, "2 · 2 · 3 / (2 + 3), halfway between the reciprocals");
    assert_eq!(distance(5), 3.0, "the sphere");
    // A quarter of the time is 5/32 of the way: 1 / (27/32 / 3 + 5/32 / 1).
    assert!((distance(6) - 1.0 / (27.0 / 96.0 + 5.0 / 32.0)).abs() < 1e-6);
    assert_eq!([distance(9), distance(1000)], [1.0; 2], "after the last, focus stays there");
}

#[test]
fn the_focus_of_a_frame_is_reported_with_its_keys() {
    let (_, said) = pulled(PULL, Some(3)).unwrap();
    assert_eq!(
        said,
        "frame 3, from `frame`; between keys 1 and 5, eased 0.50 of the way from 2 to 3: 2.4; frame 5 has object 'sphere' of \
         CryptoObject: 3, the median of 2 pixels"
    );
    assert_eq!(pulled(PULL, Some(0)).unwrap().1, "frame 0, from `frame`; at the key of frame 1: 2");
}

#[test]
fn the_object_of_a_key_that_is_not_used_is_not_searched_for() {
    let lens = PULL.replace("sphere", "cow");
    assert_eq!(pulled(&lens, Some(1)).unwrap().0, 2.0);
    let message = pulled(&lens, Some(4)).unwrap_err().to_string();
    assert!(message.contains("'cow'") && message.contains("focus key: of frame 5"), "{message}");
}

#[test]
fn focus_keys_without_a_frame_number_are_an_error() {
    let message = pulled(PULL, None).unwrap_err().to_string();
    assert!(message.contains("need the number of the frame") && message.contains("`frame = N`"), "{message}");
}

/// The program.
#[cfg(feature = "cli")]
mod commands {
    use super::program::{run, stderr};
    use super::{PULL, exr_bytes, four};
    use std::fs;
    use std::path::Path;

    /// A folder with `shot.0003.exr` and `lens.toml`, a pull.
    fn sequence() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("shot.0003.exr"), exr_bytes(vec![four()])).unwrap();
        fs::write(folder.path().join("lens.toml"), PULL).unwrap();
        folder
    }

    fn stdout(folder: &Path, arguments: &[&str]) -> String {
        let output = run(folder, arguments);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        String::from_utf8(output.stdout).unwrap()
    }

    #[test]
    fn every_subcommand_takes_the_frame_number_from_the_file_name() {
        let folder = sequence();
        let rendered = run(
            folder.path(),
            &["render", "shot.0003.exr", "--preset", "lens.toml", "-o", "out.exr", "--report", "r.json"],
        );
        assert_eq!(rendered.status.code(), Some(0), "{}", stderr(&rendered));
        assert!(stderr(&rendered).contains("frame 3, from the file's name"), "{}", stderr(&rendered));
        let report: serde_json::Value =
            serde_json::from_slice(&fs::read(folder.path().join("r.json")).unwrap()).unwrap();
        assert!((report["lens"]["focus_distance"].as_f64().unwrap() - 2.4).abs() < 1e-6);
        assert_eq!(report["lens"]["focus"]["value"]["keys"][1]["focus"]["object"], "sphere");
        let findings = report["findings"].as_array().unwrap();
        assert!(findings.iter().any(|finding| finding["about"] == "focus"), "{findings:?}");
        for command in [&["plan", "--uncalibrated"][..], &["inspect"], &["compare", "--methods", "shear:4"]] {
            let files = ["shot.0003.exr", "--preset", "lens.toml", "--frame", "5"];
            let output = run(folder.path(), &[command, &files].concat());
            assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
            let said = format!("{}{}", stderr(&output), String::from_utf8_lossy(&output.stdout));
            assert!(said.contains("frame 5, from --frame; at the key of frame 5: 3"), "{command:?}: {said}");
        }
    }

    #[test]
    fn a_flag_overrides_focus_keys() {
        let folder = sequence();
        for (flag, value, distance) in
            [("--focus", "7", 7.0), ("--focus-at", "1,0", 2.0), ("--focus-on", "cube", 1.0)]
        {
            let text = stdout(
                folder.path(),
                &["inspect", "shot.0003.exr", "--preset", "lens.toml", flag, value, "--json"],
            );
            let json: serde_json::Value = serde_json::from_str(&text).unwrap();
            assert_eq!(json["lens"]["focus_distance"], distance, "{flag}");
        }
    }

    #[test]
    fn inspect_lists_the_objects_and_prints_which_is_in_focus() {
        let folder = sequence();
        let text = stdout(folder.path(), &["inspect", "shot.0003.exr", "--focus-on", "sphere"]);
        assert!(text.contains("objects                 CryptoObject, 2: cube, sphere"), "{text}");
        assert!(
            text.contains(
                "focus                   object 'sphere' of CryptoObject: 3, the median of 2 pixels"
            ),
            "{text}"
        );
        assert!(text.contains("focus                   3 depth units, 'sphere'"), "{text}");
        let text = stdout(folder.path(), &["inspect", "shot.0003.exr", "--json"]);
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(json["objects"][0]["names"], serde_json::json!(["cube", "sphere"]));
    }

    #[test]
    fn a_misspelt_object_fails_with_its_nearest_name() {
        let folder = sequence();
        let output = run(folder.path(), &["render", "shot.0003.exr", "--focus-on", "cub", "-o", "out.exr"]);
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains("did you mean 'cube'?"), "{}", stderr(&output));
        let both =
            run(folder.path(), &["inspect", "shot.0003.exr", "--focus-on", "cube", "--focus-at", "1,1"]);
        assert_eq!(both.status.code(), Some(2), "one of them alone");
    }
}
