//! What the header of an output says of how it was made, and the digest of a job.

#![expect(clippy::unwrap_used, reason = "a test stops at the first failure")]

#[expect(dead_code, reason = "other tests use the rest")]
mod fixtures;

use exr::image::FlatSamples;
use exr::math::Vec2;
use exr::meta::attribute::{AttributeValue, Text};
use fixtures::{Part, exr_bytes, source};
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};
use tempfile::TempDir;
use thinlens::finding::Finding;
use thinlens::gpu::DeviceChoice;
use thinlens::output::exr::{self as exr_output, Codec, ExrOptions};
use thinlens::output::{Encoding, digest_of, png as png_output};
use thinlens::render::{self, Job, Rendered};
use thinlens::settings::{Focus, LensSettings, Preset, Switches, Value, Values};
use thinlens::stack::{self, Carry, Precision, ReadOptions, Source};

/// Width and height of the pictures.
const SIZE: (usize, usize) = (24, 16);

/// A picture with depth: a wall of stripes that slopes from 2 to 10 depth units.
fn sloped() -> Part {
    let count = SIZE.0 * SIZE.1;
    let column = |i: usize| (i % SIZE.0) as f32;
    let stripes = (0..count).map(|i| if (i % SIZE.0 / 2).is_multiple_of(2) { 0.1 } else { 0.9 }).collect();
    let depth = (0..count).map(|i| 2.0 + 8.0 * column(i) / (SIZE.0 - 1) as f32).collect();
    Part::flat(SIZE, "R=0.5 G=0.25 B=0.75 A=1 Z=1")
        .with("R", FlatSamples::F32(stripes))
        .with("Z", FlatSamples::F32(depth))
}

fn number(value: f32) -> AttributeValue {
    AttributeValue::F32(value)
}

fn text(value: &str) -> AttributeValue {
    AttributeValue::Text(Text::from(value))
}

fn preset(content: &str) -> Preset {
    Preset::parse(content, "p.toml").unwrap_or_else(|error| panic!("{error}\n{content}"))
}

/// A job on the CPU that copies every channel, so that the output can be read as a stack again.
fn job(source: Source, content: &str) -> Job {
    Job {
        device: DeviceChoice::Cpu,
        read_options: ReadOptions { carry: Carry::All, ..ReadOptions::default() },
        ..Job::new([source]).with_preset("p.toml", preset(content))
    }
}

fn rendered(job: &Job) -> Rendered {
    render::render(job, &|_| ()).unwrap_or_else(|error| panic!("{error}"))
}

/// The picture in the file `name` of `folder`.
fn written(rendered: &Rendered, folder: &TempDir, name: &str) -> PathBuf {
    let path = folder.path().join(name);
    let options = ExrOptions { precision: Precision::Float, codec: Codec::Zip };
    exr_output::write(&path, &rendered.image, &rendered.frame, &rendered.stack.carried, &options).unwrap();
    path
}

/// The camera that is read from the output of `rendered`.
fn camera(rendered: &Rendered) -> Values {
    let folder = TempDir::new().unwrap();
    let path = written(rendered, &folder, "out.exr");
    stack::read(&[Source::file(path)], &ReadOptions::default()).unwrap().camera
}

/// The attribute of the output called `name`.
fn attribute(rendered: &Rendered, name: &str) -> Option<AttributeValue> {
    let found: Vec<_> =
        rendered.stack.carried.attributes.iter().filter(|(other, _)| other.eq(name)).collect();
    assert!(found.len() <= 1, "{name} is there {} times", found.len());
    found.first().map(|(_, value)| value.clone())
}

/// The values of `lens`, focused at `distance`.
fn used(lens: &LensSettings, distance: f32) -> Values {
    Values { focus: Some(Focus::Distance(distance)), ..lens.values() }
}

fn about<'a>(findings: &'a [Finding], about: &str) -> Vec<&'a str> {
    findings.iter().filter(|finding| finding.about == about).map(|finding| finding.text.as_str()).collect()
}

/// A preset that sets every lens attribute to something else than the default and than the header.
const LENS: &str = "
    [lens]\nfocal_length_mm = 85\nf_number = 2\nfocus_distance = 5\nsensor_width_mm = 24\nvignetting = 0.5
    sensor_distance = 'thin_lens'
    [aperture]\nblades = 6\nrotation_deg = 20\nblade_curvature = 0.5\nsqueeze = 1.5\ncats_eye = 0.25
    [aberrations]\nspherical_um = 10\naxial_color_um = [5, -5]\nlateral_color_um = [3, -2]
    [depth]\nmetres_per_unit = 0.5\nnear_clip = 0.1
    [method]\nviews = 16";

#[test]
fn the_lens_read_from_an_output_is_the_lens_that_was_used() {
    let input = sloped()
        .attribute("thinlens.f_number", number(8.0))
        .attribute("thinlens.blades", AttributeValue::I32(9))
        .attribute("thinlens.focus_distance", number(3.0));
    for content in [LENS, "", "[lens]\nf_number = inf", "[lens]\nfocus_distance = inf"] {
        let rendered = rendered(&job(source(exr_bytes(vec![input_copy(&input)])), content));
        let expected = used(&rendered.settings.lens, rendered.lens.focus_distance);
        let read = camera(&rendered);
        assert_eq!(read.attributes(), expected.attributes(), "{content}");
    }
}

fn input_copy(part: &Part) -> Part {
    Part {
        name: part.name,
        size: part.size,
        position: part.position,
        channels: part.channels.clone(),
        attributes: part.attributes.clone(),
        compression: part.compression,
        tile: part.tile,
    }
}

#[test]
fn standard_attributes_that_a_preset_overrules_are_corrected() {
    let input = sloped()
        .attribute("aperture", number(8.0))
        .attribute("tStop", number(8.5))
        .attribute("nominalFocalLength", number(35.0))
        .attribute("effectiveFocalLength", number(36.0))
        .attribute("sensorOverallDimensions", AttributeValue::FloatVec2(Vec2(36.0, 18.0)))
        .attribute("sensorPhotositePitch", number(4.0))
        .attribute("focus", number(3.0));
    let rendered = rendered(&job(source(exr_bytes(vec![input])), LENS));
    assert_eq!(attribute(&rendered, "aperture"), Some(number(2.0)));
    assert_eq!(attribute(&rendered, "nominalFocalLength"), Some(number(85.0)));
    assert_eq!(attribute(&rendered, "effectiveFocalLength"), Some(number(85.0)));
    let size = AttributeValue::FloatVec2(Vec2(24.0, 12.0));
    assert_eq!(attribute(&rendered, "sensorOverallDimensions"), Some(size), "with its proportions");
    assert_eq!(attribute(&rendered, "focus"), Some(number(2.5)), "5 units of half a metre");
    assert_eq!(attribute(&rendered, "tStop"), None, "the transmission is not known");
    assert_eq!(attribute(&rendered, "sensorPhotositePitch"), None);
    let notes = about(&rendered.stack.findings, "header");
    assert!(notes.len() == 1 && notes[0].contains("tStop") && notes[0].contains("aperture"), "{notes:?}");
}

#[test]
fn attributes_of_renderers_that_contradict_the_lens_are_left_out() {
    // As V-Ray and Blender write them; the last ones describe the geometry of the picture.
    let input = sloped()
        .attribute("cameraAperture", number(36.0))
        .attribute("cameraTargetDistance", number(3.0))
        .attribute("vrayInfo/camera/focal_length", number(35.0))
        .attribute("Lens", text("35.00 mm"))
        .attribute("cameraFNumber", text("f/8"))
        .attribute("cameraFov", number(0.9))
        .attribute("Camera", text("Camera.001"));
    let rendered = rendered(&job(source(exr_bytes(vec![input])), LENS));
    for gone in
        ["cameraAperture", "cameraTargetDistance", "vrayInfo/camera/focal_length", "Lens", "cameraFNumber"]
    {
        assert_eq!(attribute(&rendered, gone), None, "{gone}");
    }
    assert_eq!(attribute(&rendered, "cameraFov"), Some(number(0.9)));
    assert_eq!(attribute(&rendered, "Camera"), Some(text("Camera.001")));
}

#[test]
fn a_header_that_says_what_was_used_stays_as_it_is() {
    let attributes = [
        ("aperture", number(4.0)),
        ("tStop", number(4.5)),
        ("nominalFocalLength", number(35.0)),
        ("sensorOverallDimensions", AttributeValue::FloatVec2(Vec2(36.0, 24.0))),
        ("sensorPhotositePitch", number(4.0)),
        ("focus", number(3.0)),
        ("Lens", text("35.00 mm")),
        ("cameraAperture", number(36.0)),
        ("cameraTargetDistance", number(3.0)),
        ("fStop", text("f/4.0")),
    ];
    let input = attributes.iter().cloned().fold(sloped(), |part, (name, value)| part.attribute(name, value));
    let rendered = rendered(&job(source(exr_bytes(vec![input])), ""));
    for (name, value) in attributes {
        assert_eq!(attribute(&rendered, name), Some(value), "{name}");
    }
    assert_eq!(about(&rendered.stack.findings, "header"), Vec::<&str>::new());
}

#[test]
fn a_depth_convention_that_a_preset_overrules_is_corrected() {
    let input = || source(exr_bytes(vec![sloped().attribute("thinlens.depth_convention", text("planar"))]));
    let convention = |content| attribute(&rendered(&job(input(), content)), "thinlens.depth_convention");
    assert_eq!(convention("[depth]\nconvention = 'ray'"), Some(text("ray")));
    assert_eq!(convention(""), Some(text("planar")));
}

#[test]
fn a_pinhole_is_in_the_header_too_and_no_f_number_contradicts_it() {
    let input = sloped().attribute("aperture", number(8.0));
    let rendered = rendered(&job(source(exr_bytes(vec![input])), "[lens]\nf_number = inf"));
    assert_eq!(attribute(&rendered, "thinlens.f_number"), Some(number(f32::INFINITY)));
    assert_eq!(attribute(&rendered, "aperture"), None);
    let Some(AttributeValue::Text(effects)) = attribute(&rendered, "thinlens.effects") else { panic!() };
    assert!(!effects.to_string().split(", ").any(|effect| effect == "blur"), "{effects}");
}

#[test]
fn what_an_output_says_of_itself_is_not_what_its_input_said() {
    let folder = TempDir::new().unwrap();
    let mut first = rendered(&job(source(exr_bytes(vec![sloped()])), LENS));
    first.set_digest("1234".to_owned());
    let path = written(&first, &folder, "first.exr");
    let second = rendered(&job(Source::file(path), "[lens]\nf_number = inf"));
    assert_eq!(attribute(&second, "thinlens.digest"), None);
    assert_eq!(attribute(&second, "thinlens.source"), Some(text("first.exr")));
    assert_eq!(attribute(&first, "thinlens.source"), Some(text("fixture.exr")));
    assert_eq!(attribute(&second, "thinlens.f_number"), Some(number(f32::INFINITY)));
    assert_eq!(attribute(&second, "thinlens.blades"), Some(AttributeValue::I32(6)), "read from the first");
}

#[test]
fn the_settings_in_a_header_are_a_preset_that_makes_the_same_picture() {
    let header = || {
        sloped()
            .attribute("thinlens.f_number", number(1.4))
            .attribute("thinlens.focal_length_mm", number(70.0))
    };
    let input = || source(exr_bytes(vec![header()]));
    let without = Switches { force: vec!["highlights".to_owned()], without: vec!["cats-eye".to_owned()] };
    let jobs = [
        job(input(), ""),
        job(input(), LENS),
        job(input(), "[lens]\nf_number = 2.8\nfocus_point = [20, 5]\n[picture]\nborder = 'mirror'"),
        job(
            input(),
            "[method]\nquality = 'draft'\n[method.shear]\nprefilter = 1\n[depth]\nconvention = 'ray'",
        ),
        Job { switches: without, parameters: vec!["prefilter=0".to_owned()], ..job(input(), LENS) },
        job(input(), "[method]\nname = 'opaque-blur'"),
        job(
            input(),
            "[[lens.f_number_keys]]\nframe = 1\nvalue = 1.0\n[[lens.f_number_keys]]\nframe = 4\nvalue = 8",
        ),
    ];
    let pinhole = rendered(&job(input(), "[lens]\nf_number = inf")).image;
    for made in jobs {
        let made = Job { frame: Some(2), ..made };
        let first = rendered(&made);
        assert!(first.image != pinhole, "it shows");
        let Some(AttributeValue::Text(settings)) = attribute(&first, "thinlens.settings") else { panic!() };
        let second = rendered(&job(input(), &settings.to_string()));
        assert!(second.image == first.image, "{settings}");
        assert_eq!(attribute(&second, "thinlens.settings"), Some(AttributeValue::Text(settings)));
    }
}

#[test]
fn a_png_has_version_source_settings_and_digest_as_texts() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("out.png");
    let input = Source::memory("b\u{e9}aut\u{e9}.exr", exr_bytes(vec![sloped()]));
    let mut rendered = rendered(&job(input, LENS));
    rendered.set_digest("00ff".to_owned());
    png_output::write_made(&path, &rendered.image, 0.0, &rendered.made).unwrap();
    let reader = png::Decoder::new(std::io::BufReader::new(File::open(&path).unwrap())).read_info().unwrap();
    let ascii = &reader.info().uncompressed_latin1_text;
    let found = |name: &str| ascii.iter().find(|chunk| chunk.keyword == name).map(|chunk| chunk.text.clone());
    assert_eq!(found("thinlens.version").as_deref(), Some(env!("CARGO_PKG_VERSION")));
    assert_eq!(found("thinlens.digest").as_deref(), Some("00ff"));
    let settings = preset(&found("thinlens.settings").unwrap()).values;
    assert_eq!((settings.f_number, settings.blades), (Some(2.0), Some(6)));
    let source = reader.info().utf8_text.iter().find(|chunk| chunk.keyword == "thinlens.source").unwrap();
    assert_eq!(source.get_text().unwrap(), "b\u{e9}aut\u{e9}.exr");
    let (with, without) = (fs::read(&path).unwrap(), folder.path().join("plain.png"));
    png_output::write(&without, &rendered.image, 0.0).unwrap();
    assert!(with.len() > fs::read(&without).unwrap().len());
    let [with, without] = [&path, &without].map(|path| stack::read_picture(path).unwrap());
    assert!(with == without, "the texts change no pixel");
}

#[test]
fn the_digest_of_an_output_is_the_one_that_it_was_given() {
    let folder = TempDir::new().unwrap();
    let mut rendered = rendered(&job(source(exr_bytes(vec![sloped()])), "[method]\nviews = 4"));
    let png = folder.path().join("out.png");
    let plain = folder.path().join("plain.png");
    png_output::write(&plain, &rendered.image, 0.0).unwrap();
    let without = written(&rendered, &folder, "without.exr");
    rendered.set_digest("first".to_owned());
    rendered.set_digest("c0ffee".to_owned());
    let exr = written(&rendered, &folder, "out.exr");
    png_output::write_made(&png, &rendered.image, 0.0, &rendered.made).unwrap();
    for complete in [&exr, &png] {
        assert_eq!(digest_of(complete).as_deref(), Some("c0ffee"), "{}", complete.display());
        let bytes = fs::read(complete).unwrap();
        for length in [bytes.len() - 1, bytes.len() / 2, 20, 0] {
            let cut = folder.path().join("cut");
            fs::write(&cut, &bytes[..length]).unwrap();
            assert_eq!(digest_of(&cut), None, "{} after {length} bytes", complete.display());
        }
    }
    for none in [&without, &plain, &folder.path().join("missing.exr"), &folder.path().to_owned()] {
        assert_eq!(digest_of(none), None, "{}", none.display());
    }
}

/// A file with `bytes`, modified `seconds` after 1970.
fn file(path: &Path, bytes: &[u8], seconds: u64) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, bytes).unwrap();
    let file = File::options().write(true).open(path).unwrap();
    file.set_modified(SystemTime::UNIX_EPOCH + Duration::from_secs(seconds)).unwrap();
}

fn digest(job: &Job) -> String {
    render::digest(job, &Encoding::default()).unwrap()
}

#[test]
fn a_digest_changes_with_everything_that_determines_the_picture() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name);
    for name in ["a.0001.exr", "b.0001.exr", "depth.exr", "beauty.exr", "iris.png"] {
        file(&path(name), b"content", 1000);
    }
    let base =
        || job(Source::file(path("a.0001.exr")), "[lens]\nf_number = 2\n[method.shear]\nprefilter = 1");
    let flags = |flags| base().with_values(flags);
    let read = |read_options| Job { read_options, ..base() };
    let keys = "[[lens.focal_length_keys]]\nframe = 1\nvalue = 24";
    let mut digests = vec![
        digest(&base()),
        digest(&job(Source::file(path("b.0001.exr")), "[lens]\nf_number = 2\n[method.shear]\nprefilter = 1")),
        digest(&job(Source::file(path("a.0001.exr")), "[lens]\nf_number = 4\n[method.shear]\nprefilter = 1")),
        digest(&job(Source::file(path("a.0001.exr")), "[lens]\nf_number = 2\n[method.shear]\nprefilter = 0")),
        digest(&job(Source::file(path("a.0001.exr")), keys)),
        digest(&Job { frame: Some(2), ..job(Source::file(path("a.0001.exr")), keys) }),
        digest(&flags(Values { blades: Some(5), ..Values::default() })),
        digest(&flags(Values { method: Some("shear".to_owned()), ..Values::default() })),
        digest(&flags(Values { aperture_image: Some(path("iris.png")), ..Values::default() })),
        digest(&flags(Values { beauty: Some(path("beauty.exr")), ..Values::default() })),
        digest(&read(ReadOptions::default())),
        digest(&read(ReadOptions { depth_file: Some(path("depth.exr")), ..ReadOptions::default() })),
        digest(&read(ReadOptions { color_channel: Some("X".to_owned()), ..ReadOptions::default() })),
        digest(&read(ReadOptions { depth_channel: Some("X".to_owned()), ..ReadOptions::default() })),
        digest(&Job { device: DeviceChoice::Auto, ..base() }),
        digest(&Job { parameters: vec!["prefilter=0".to_owned()], ..base() }),
        digest(&Job {
            switches: Switches { force: vec!["fill".to_owned()], ..Switches::default() },
            ..base()
        }),
        digest(&Job {
            switches: Switches { without: vec!["fill".to_owned()], ..Switches::default() },
            ..base()
        }),
        render::digest(&base(), &Encoding { codec: Codec::Piz, ..Encoding::default() }).unwrap(),
        render::digest(&base(), &Encoding { precision: Some(Precision::Half), ..Encoding::default() })
            .unwrap(),
        render::digest(&base(), &Encoding { exposure_stops: 1.0, ..Encoding::default() }).unwrap(),
    ];
    file(&path("a.0001.exr"), b"content", 1001);
    digests.push(digest(&base()));
    file(&path("a.0001.exr"), b"contents", 1000);
    digests.push(digest(&base()));
    file(&path("a.0001.exr"), b"content", 1000);
    assert_eq!(digest(&base()), digests[0], "the same again");
    file(&path("iris.png"), b"content", 1001);
    digests.push(digest(&flags(Values { aperture_image: Some(path("iris.png")), ..Values::default() })));
    for (i, one) in digests.iter().enumerate() {
        assert!(one.len() == 32 && one.chars().all(|c| c.is_ascii_hexdigit()), "{one}");
        assert_eq!(digests.iter().position(|other| other == one), Some(i), "{i}");
    }
}

#[test]
fn a_digest_does_not_change_with_what_leaves_the_picture_as_it_is() {
    let folder = TempDir::new().unwrap();
    let at = |mount: &str, name: &str| folder.path().join(mount).join(name);
    for mount in ["here", "there"] {
        file(&at(mount, "a.0001.exr"), b"content", 1000);
        file(&at(mount, "iris.png"), b"content", 1000);
    }
    let base = |mount: &str| {
        let values = Values { aperture_image: Some(at(mount, "iris.png")), ..Values::default() };
        Job::new([Source::file(at(mount, "a.0001.exr"))]).with_values(values)
    };
    let expected = digest(&base("here"));
    assert_eq!(digest(&base("there")), expected, "where a folder is mounted");
    assert_eq!(digest(&Job { frame: Some(7), ..base("here") }), expected, "a frame number without keys");
    assert_eq!(digest(&Job { verify: Some(400), confidence: true, ..base("here") }), expected);
    let limited = ReadOptions { max_bytes: Some(1 << 30), ..ReadOptions::default() };
    assert_eq!(digest(&Job { read_options: limited, ..base("here") }), expected);
    let named = |name: &str| base("here").with_preset(name, preset("[lens]\nf_number = 2"));
    assert_eq!(digest(&named("a.toml")), digest(&named("b.toml")), "the name of a preset");
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    assert_eq!(pool(1).install(|| digest(&base("here"))), pool(3).install(|| digest(&base("here"))));
}

#[test]
fn a_digest_needs_its_files_but_reads_none() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("no-picture.exr");
    let job = Job::new([Source::file(&path)]);
    let message = render::digest(&job, &Encoding::default()).unwrap_err().to_string();
    assert!(message.contains("no such file") && message.contains("no-picture.exr"), "{message}");
    file(&path, b"", 0);
    digest(&job);
}

/// The f-number and focal length of frame `frame` with the preset `content`, and the findings about them.
fn keyed(frame: i64, content: &str) -> ([f32; 2], Vec<Finding>) {
    let input = sloped()
        .attribute("thinlens.f_number", number(11.0))
        .attribute("thinlens.focal_length_mm", number(100.0));
    let job = Job { frame: Some(frame), ..job(source(exr_bytes(vec![input])), content) };
    let prepared = render::prepare(&job).unwrap_or_else(|error| panic!("{error}"));
    let lens = &prepared.settings.lens;
    ([lens.f_number.value, lens.focal_length_mm.value], prepared.stack.findings)
}

const KEYS: &str = "
    [[lens.f_number_keys]]\nframe = 1\nvalue = 2\neasing = 'linear'
    [[lens.f_number_keys]]\nframe = 5\nvalue = 6
    [[lens.f_number_keys]]\nframe = 9\nvalue = inf
    [[lens.focal_length_keys]]\nframe = 1\nvalue = 24\neasing = 'linear'
    [[lens.focal_length_keys]]\nframe = 5\nvalue = 85\neasing = 'hold'
    [[lens.focal_length_keys]]\nframe = 9\nvalue = 50";

#[test]
fn keys_of_f_number_and_focal_length_outrank_the_header_at_every_frame() {
    // Halfway the diameter is the mean of 1/2 and 1/6, which is 1/3; halfway to a pinhole the f-number is doubled.
    for (frame, expected) in [
        (-5, [2.0, 24.0]),
        (1, [2.0, 24.0]),
        (3, [3.0, 54.5]),
        (5, [6.0, 85.0]),
        (7, [12.0, 85.0]),
        (9, [f32::INFINITY, 50.0]),
        (99, [f32::INFINITY, 50.0]),
    ] {
        assert_eq!(keyed(frame, KEYS).0, expected, "{frame}");
    }
    let (_, findings) = keyed(3, KEYS);
    let expected = "frame 3, from `frame`; between keys 1 and 5, eased 0.50 of the way from 2 to 6: 3";
    assert_eq!(about(&findings, "f-number"), [expected]);
    let expected = "frame 3, from `frame`; between keys 1 and 5, eased 0.50 of the way from 24 to 85: 54.5";
    assert_eq!(about(&findings, "focal length"), [expected]);
}

#[test]
fn a_keyed_lens_makes_the_picture_of_the_lens_at_that_frame() {
    // Ray depth becomes planar depth by the focal length, so a key of it counts there too.
    // Units of 5 cm: the wall is so near that it is blurred.
    let depth = "[depth]\nconvention = 'ray'\nmetres_per_unit = 0.05\n[method]\nviews = 8";
    let input = || source(exr_bytes(vec![sloped()]));
    let at_frame = Job { frame: Some(3), ..job(input(), &format!("{KEYS}\n{depth}")) };
    let fixed = job(input(), &format!("[lens]\nf_number = 3\nfocal_length_mm = 54.5\n{depth}"));
    let other = job(input(), &format!("[lens]\nf_number = 3\nfocal_length_mm = 24\n{depth}"));
    let [at_frame, fixed, other] = [at_frame, fixed, other].map(|job| rendered(&job));
    assert!(at_frame.image == fixed.image, "the picture of the fixed lens");
    assert!(at_frame.image != other.image, "another focal length shows");
    assert_eq!(attribute(&at_frame, "thinlens.f_number"), Some(number(3.0)));
    assert_eq!(attribute(&at_frame, "thinlens.focal_length_mm"), Some(number(54.5)));
    assert_eq!(at_frame.settings.lens.f_number.origin.to_string(), "preset p.toml");
}

#[test]
fn a_flag_outranks_keys_and_then_no_frame_number_is_needed() {
    let values = Values { f_number: Some(4.0), focal_length_mm: Some(35.0), ..Values::default() };
    let job = job(source(exr_bytes(vec![sloped()])), KEYS).with_values(values);
    let lens = render::prepare(&job).unwrap().settings.lens;
    assert_eq!((lens.f_number.value, lens.focal_length_mm.value), (4.0, 35.0));
}

#[test]
fn keys_without_a_frame_number_are_refused() {
    for (list, name) in [("f_number_keys", "f-number"), ("focal_length_keys", "focal length")] {
        let content = format!("[[lens.{list}]]\nframe = 1\nvalue = 2");
        let message =
            render::prepare(&job(source(exr_bytes(vec![sloped()])), &content)).unwrap_err().to_string();
        assert!(message.contains(&format!("{name} keys need the number of the frame")), "{message}");
    }
}

#[test]
fn a_mistake_in_keys_is_shown_with_its_location() {
    let message = |text: &str| Preset::parse(text, "my.toml").unwrap_err().to_string();
    for (text, expected) in [
        ("[lens]\nf_number = 2\n[[lens.f_number_keys]]\nframe = 1\nvalue = 2", "exclude one another"),
        ("[lens]\nfocal_length_keys = [{frame = 1, value = 2}]\nfocal_length_mm = 2", "exclude one another"),
        ("[[lens.f_number_keys]]\nframe = 1\nvalue = 0", "'value' must be a positive number, or inf"),
        ("[[lens.focal_length_keys]]\nframe = 1\nvalue = inf", "'value' must be a positive number"),
        ("[[lens.f_number_keys]]\nframe = 1\nvalue = 1\nspeed = 2", "are frame, value, easing"),
        ("[[lens.f_number_keys]]\nframe = 1\nvalve = 1", "did you mean 'value'?"),
        ("[[lens.f_number_keys]]\nvalue = 1", "has no frame"),
        ("[[lens.f_number_keys]]\nframe = 1", "has no value"),
        (
            "[[lens.f_number_keys]]\nframe = 2\nvalue = 1\n[[lens.f_number_keys]]\nframe = 2\nvalue = 1",
            "rising",
        ),
        ("[lens]\nf_number_keys = []", "must be at least one table, [[lens.f_number_keys]]"),
        ("[lens]\nf_number_key = 3", "did you mean 'f_number_keys'?"),
        ("[effects]\nforce = 'fill'", "'force' must be a list of texts in quotes"),
    ] {
        let message = message(text);
        assert!(message.contains(expected) && message.contains("my.toml:"), "{text}: {message}");
    }
}

#[test]
fn keys_of_the_library_are_checked_like_those_of_presets() {
    use thinlens::settings::{Easing, NumberKey};
    let key = |frame, value| NumberKey { frame, value, easing: Easing::Linear };
    let check = |keys| Values { f_number_keys: Some(keys), ..Values::default() }.check();
    assert!(check(vec![key(1, 2.0), key(2, f32::INFINITY)]).is_ok());
    for wrong in [vec![], vec![key(1, -2.0)], vec![key(2, 2.0), key(2, 3.0)], vec![key(1, f32::NAN)]] {
        assert!(check(wrong.clone()).is_err(), "{wrong:?}");
    }
    let both = Values { f_number: Some(2.0), f_number_keys: Some(vec![key(1, 2.0)]), ..Values::default() };
    assert!(both.check().is_err());
}

#[test]
fn effects_of_a_preset_are_switched_unless_the_job_says_otherwise() {
    let content = "[effects]\nforce = ['transparent-background']\nwithout = ['fill', 'highlights']";
    let switched = |force: &[&str], without: &[&str]| {
        let names = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
        let switches = Switches { force: names(force), without: names(without) };
        let job = Job { switches, ..job(source(exr_bytes(vec![sloped()])), content) };
        render::prepare(&job).unwrap().settings.switches
    };
    let own = switched(&[], &[]);
    assert_eq!((own.force, own.without.len()), (vec!["transparent-background".to_owned()], 2));
    let other = switched(&["highlights"], &["open-background"]);
    assert_eq!(other.force, ["highlights"]);
    assert_eq!(other.without, ["fill", "open-background"], "one effect by two names");
    let unknown = job(source(exr_bytes(vec![sloped()])), "[effects]\nforce = ['fil']");
    assert!(render::prepare(&unknown).unwrap_err().to_string().contains("'fil'"));
}

#[test]
fn every_lens_attribute_is_known_to_this_test() {
    // The preset of these tests sets every setting of the lens that has a header attribute, apart from normalised depth.
    let set = preset(LENS).values.attributes();
    let all: Vec<_> = thinlens::settings::SETTINGS
        .iter()
        .filter(|setting| setting.default_value().is_some() || setting.key == "focus_distance")
        .filter_map(|setting| setting.attribute)
        .filter(|name| !["thinlens.near", "thinlens.far"].contains(name))
        .collect();
    let mut set: Vec<_> = set.into_iter().map(|(name, _): (_, Value)| name).collect();
    set.sort_unstable();
    let mut all = all;
    all.sort_unstable();
    assert_eq!(set, all);
}
