//! Written files are read back with the readers of the EXR and PNG libraries, not with those of thinlens.

#![expect(clippy::unwrap_used, reason = "a test stops at the first failure")]

use exr::image::{AnyChannel, FlatSamples};
use exr::meta::attribute::{AttributeValue, Text};
use exr::prelude::{ReadChannels as _, ReadLayers as _, read};
use half::f16;
use std::path::{Path, PathBuf};
use tempfile::TempDir;
use thinlens::image::Image;
use thinlens::output::exr::{Codec, ExrOptions};
use thinlens::output::{exr as exr_output, png, report};
use thinlens::stack::{Carried, CarriedChannel, Frame, Precision, Window};
use thinlens::usage;

type Picture = exr::image::Image<exr::image::Layer<exr::image::AnyChannels<FlatSamples>>>;

const LOSSLESS: [Codec; 5] = [Codec::None, Codec::Rle, Codec::Zips, Codec::Zip, Codec::Piz];

/// Odd in both directions, more than one block of 32 lines, the data window partly outside the display window.
const FRAME: Frame = Frame {
    data: Window { x: -7, y: -3, width: 53, height: 41 },
    display: Window { x: 0, y: 0, width: 40, height: 45 },
    pixel_aspect: 1.5,
};

fn gradient() -> Image {
    Image::from_fn(FRAME.data.width, FRAME.data.height, |x, y| {
        let (x, y) = (x as f32, y as f32);
        [x * 0.013 + y, (x * 3.7).sin(), -y / 3.0, (x + y) / 100.0]
    })
}

fn carried_channel(name: &str, samples: FlatSamples) -> CarriedChannel {
    CarriedChannel { name: name.to_owned(), samples, quantize_linearly: true }
}

/// One channel of each type; the ids use all bits, the floats cannot be represented as halves.
fn carried() -> Carried {
    let count = FRAME.data.width * FRAME.data.height;
    let ids = (0..count as u32).map(|i| i.wrapping_mul(2_654_435_761)).collect();
    Carried {
        channels: vec![
            carried_channel("objectId", FlatSamples::U32(ids)),
            carried_channel("Depth.Z", FlatSamples::F32((0..count).map(|i| 1.0 + i as f32 * 1e-5).collect())),
            carried_channel(
                "AO.Y",
                FlatSamples::F16((0..count).map(|i| f16::from_f32(i as f32 / 100.0)).collect()),
            ),
        ],
        attributes: Vec::new(),
    }
}

fn write(folder: &TempDir, image: &Image, carried: &Carried, precision: Precision, codec: Codec) -> PathBuf {
    let path = folder.path().join("picture.exr");
    let findings =
        exr_output::write(&path, image, &FRAME, carried, &ExrOptions { precision, codec }).unwrap();
    assert_eq!(findings, []);
    path
}

fn read_back(path: &Path) -> Picture {
    read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .pedantic()
        .from_file(path)
        .unwrap()
}

fn channel<'a>(picture: &'a Picture, name: &str) -> &'a AnyChannel<FlatSamples> {
    picture.layer_data.channel_data.list.iter().find(|channel| channel.name.eq(name)).unwrap()
}

fn values(picture: &Picture, name: &str) -> Vec<f32> {
    channel(picture, name).sample_data.values_as_f32().collect()
}

#[test]
fn floats_and_carried_channels_read_back_bit_for_bit_through_every_lossless_codec() {
    let (folder, image, carried) = (TempDir::new().unwrap(), gradient(), carried());
    for codec in LOSSLESS {
        let picture = read_back(&write(&folder, &image, &carried, Precision::Float, codec));
        for (name, plane) in ["R", "G", "B", "A"].iter().zip(&image.planes) {
            assert_eq!(values(&picture, name), plane.values(), "{codec} {name}");
        }
        for expected in &carried.channels {
            assert_eq!(channel(&picture, &expected.name).sample_data, expected.samples, "{codec}");
            assert!(channel(&picture, &expected.name).quantize_linearly);
        }
    }
}

#[test]
fn blocks_of_noise_do_not_become_smaller_and_read_back_bit_for_bit() {
    let folder = TempDir::new().unwrap();
    let (width, height) = (FRAME.data.width, FRAME.data.height);
    let mut random = fastrand::Rng::with_seed(2);
    let mut noise = || (0..width * height).map(|_| random.u32(..)).collect::<Vec<u32>>();
    let planes = [noise(), noise(), noise(), noise()];
    let image = Image::from_fn(width, height, |x, y| {
        planes.each_ref().map(|bits| f32::from_bits(bits[y * width + x]))
    });
    let ids = FlatSamples::U32(noise());
    let carried = Carried { channels: vec![carried_channel("id", ids.clone())], attributes: Vec::new() };
    for codec in [Codec::Zips, Codec::Zip] {
        let path = write(&folder, &image, &carried, Precision::Float, codec);
        assert!(std::fs::metadata(&path).unwrap().len() > (20 * width * height) as u64, "{codec}");
        let picture = read_back(&path);
        for (name, expected) in ["R", "G", "B", "A"].iter().zip(&planes) {
            let bits: Vec<u32> = values(&picture, name).iter().map(|value| value.to_bits()).collect();
            assert_eq!(bits, *expected, "{codec} {name}");
        }
        assert_eq!(channel(&picture, "id").sample_data, ids, "{codec}");
    }
}

#[test]
fn halves_are_rounded_to_nearest_by_every_codec_that_is_lossless_for_halves() {
    let (folder, image) = (TempDir::new().unwrap(), gradient());
    for codec in LOSSLESS.into_iter().chain([Codec::Pxr24]) {
        let picture = read_back(&write(&folder, &image, &Carried::default(), Precision::Half, codec));
        for (name, plane) in ["R", "G", "B", "A"].iter().zip(&image.planes) {
            let expected: Vec<f16> = plane.values().iter().map(|&value| f16::from_f32(value)).collect();
            assert_eq!(channel(&picture, name).sample_data, FlatSamples::F16(expected), "{codec} {name}");
        }
    }
}

#[test]
fn lossy_codecs_stay_close_and_keep_ids_exact() {
    let (folder, carried) = (TempDir::new().unwrap(), carried());
    let image = Image::from_fn(FRAME.data.width, FRAME.data.height, |x, y| {
        [0.2 + x as f32 / 100.0, 0.5, 0.2 + y as f32 / 80.0, 1.0]
    });
    for codec in Codec::ALL {
        let picture = read_back(&write(&folder, &image, &carried, Precision::Half, codec));
        for (name, plane) in ["R", "G", "B", "A"].iter().zip(&image.planes) {
            for (read, written) in values(&picture, name).iter().zip(plane.values()) {
                assert!((read - written).abs() < 0.03, "{codec} {name}: {read} for {written}");
            }
        }
        assert_eq!(channel(&picture, "objectId").sample_data, carried.channels[0].samples, "{codec}");
    }
}

#[test]
fn windows_and_pixel_aspect_are_those_of_the_frame() {
    let folder = TempDir::new().unwrap();
    let picture = read_back(&write(&folder, &gradient(), &Carried::default(), Precision::Half, Codec::Zip));
    let display = picture.attributes.display_window;
    assert_eq!((display.position.x(), display.position.y()), (0, 0));
    assert_eq!((display.size.width(), display.size.height()), (40, 45));
    let position = picture.layer_data.attributes.layer_position;
    assert_eq!((position.x(), position.y()), (-7, -3));
    assert_eq!((picture.layer_data.size.width(), picture.layer_data.size.height()), (53, 41));
    assert_eq!(picture.attributes.pixel_aspect, 1.5);
}

#[test]
fn channels_are_sorted_by_name() {
    let folder = TempDir::new().unwrap();
    let picture = read_back(&write(&folder, &gradient(), &carried(), Precision::Half, Codec::Zip));
    let names: Vec<String> =
        picture.layer_data.channel_data.list.iter().map(|channel| channel.name.to_string()).collect();
    assert_eq!(names, ["A", "AO.Y", "B", "Depth.Z", "G", "R", "objectId"]);
}

#[test]
fn a_value_beyond_half_is_clamped_to_the_largest_half() {
    let folder = TempDir::new().unwrap();
    let values_in = [1e6, -1e6, f32::INFINITY, 65_504.0];
    let image = Image::from_fn(FRAME.data.width, FRAME.data.height, |_, _| values_in);
    let picture = read_back(&write(&folder, &image, &Carried::default(), Precision::Half, Codec::Zip));
    let first = ["R", "G", "B", "A"].map(|name| values(&picture, name)[0]);
    assert_eq!(first, [65_504.0, -65_504.0, 65_504.0, 65_504.0]);
}

#[test]
fn attributes_known_and_unknown_are_copied_except_those_of_the_storage() {
    let folder = TempDir::new().unwrap();
    let text = |value: &str| AttributeValue::Text(Text::from(value));
    let custom = AttributeValue::Custom { kind: Text::from("myType"), bytes: [1_u8, 2, 3].as_slice().into() };
    let long = "an attribute whose name is longer than thirty-one bytes";
    let attributes = [
        ("owner", text("somebody")),
        ("BlenderMultiChannel", text("Blender V2.55.1 and newer")),
        ("screenWindowWidth", AttributeValue::F32(2.0)),
        ("mine", custom.clone()),
        (long, AttributeValue::I32(7)),
        ("compression", AttributeValue::Compression(exr::compression::Compression::PIZ)),
        ("name", text("ViewLayer")),
        ("tiles", text("nonsense")),
    ];
    let attributes = attributes.map(|(name, value)| (Text::from(name), value)).to_vec();
    let carried = Carried { attributes, ..Carried::default() };
    let picture = read_back(&write(&folder, &gradient(), &carried, Precision::Half, Codec::Zip));
    let read = &picture.layer_data.attributes;
    assert_eq!(read.owner, Some(Text::from("somebody")));
    assert_eq!(read.screen_window_width, 2.0);
    assert_eq!(read.layer_name, None);
    let other = |name: &str| read.other.get(&Text::from(name)).cloned();
    assert_eq!(other("BlenderMultiChannel"), Some(text("Blender V2.55.1 and newer")));
    assert_eq!(other("mine"), Some(custom));
    assert_eq!(other(long), Some(AttributeValue::I32(7)));
    assert_eq!(other("thinlens.version"), Some(text(env!("CARGO_PKG_VERSION"))));
    assert_eq!(other("tiles"), None);
    assert_eq!(picture.layer_data.encoding.compression, exr::compression::Compression::ZIP16);
}

#[test]
fn equal_pictures_give_equal_files_with_any_number_of_threads() {
    let folder = TempDir::new().unwrap();
    let attributes =
        (0..20).map(|i| (Text::from(format!("attribute {i}").as_str()), AttributeValue::I32(i))).collect();
    let carried = Carried { attributes, ..carried() };
    let bytes = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let path = pool.install(|| write(&folder, &gradient(), &carried, Precision::Half, Codec::Zips));
        std::fs::read(path).unwrap()
    };
    assert_eq!(bytes(1), bytes(3));
}

#[test]
fn channels_that_cannot_be_carried_are_reported() {
    let folder = TempDir::new().unwrap();
    let count = FRAME.data.width * FRAME.data.height;
    let mut carried = carried();
    carried.channels.extend([
        carried_channel("R", FlatSamples::F32(vec![9.0; count])),
        carried_channel("objectId", FlatSamples::F32(vec![9.0; count])),
        carried_channel("small", FlatSamples::F32(vec![9.0; 3])),
    ]);
    let path = folder.path().join("a.exr");
    let options = ExrOptions { precision: Precision::Float, codec: Codec::Zip };
    let findings = exr_output::write(&path, &gradient(), &FRAME, &carried, &options).unwrap();
    let texts: Vec<&str> = findings.iter().map(|finding| finding.text.as_str()).collect();
    assert_eq!(
        texts,
        [
            "channel \"R\" of the input is left out: the picture has a channel of this name",
            "channel \"objectId\" of the input is left out: another channel has the same name",
            "channel \"small\" of the input is left out: it has 3 samples, the picture 53×41",
        ]
    );
    assert!(findings.iter().all(|finding| finding.warning));
    let picture = read_back(&path);
    assert_eq!(values(&picture, "R"), gradient().planes[0].values());
    assert_eq!(channel(&picture, "objectId").sample_data, carried.channels[0].samples);
}

#[test]
fn a_picture_of_another_size_than_its_frame_is_refused_and_leaves_no_file() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("a.exr");
    let options = ExrOptions { precision: Precision::Half, codec: Codec::Zip };
    let write = |image: &Image, frame: &Frame| {
        exr_output::write(&path, image, frame, &Carried::default(), &options).unwrap_err().to_string()
    };
    let text = write(&Image::transparent(5, 5), &FRAME);
    assert!(text.contains("5×5") && text.contains("53×41") && text.contains("a.exr"), "{text}");
    let aspect = write(&gradient(), &Frame { pixel_aspect: 0.0, ..FRAME });
    assert!(aspect.contains("pixel aspect") && !path.exists(), "{aspect}");
}

#[test]
fn an_opaque_picture_becomes_an_rgb_png_and_exposure_is_in_stops() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("a.png");
    // Linear 0.25 and 0.5 are sRGB 137 and 188 (IEC 61966-2-1: 0.5371, 0.7354).
    let image = Image::from_fn(3, 2, |_, _| [0.25, f32::NAN, 7.0, 1.0]);
    png::write(&path, &image, 0.0).unwrap();
    assert_eq!(image::open(&path).unwrap().into_rgb8().get_pixel(2, 1).0, [137, 0, 255]);
    assert_eq!(image::open(&path).unwrap().color(), image::ColorType::Rgb8);
    png::write(&path, &image, 1.0).unwrap();
    assert_eq!(image::open(&path).unwrap().into_rgb8().get_pixel(0, 0).0, [188, 0, 255]);
}

#[test]
fn a_transparent_picture_becomes_a_png_with_straight_alpha() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("a.png");
    let image = Image::from_fn(2, 1, |x, _| if x == 0 { [0.25, 0.125, 0.0, 0.5] } else { [0.0; 4] });
    png::write(&path, &image, 0.0).unwrap();
    let read = image::open(&path).unwrap();
    assert_eq!(read.color(), image::ColorType::Rgba8);
    // 0.25 / 0.5 = 0.5 → 188, 0.125 / 0.5 = 0.25 → 137.
    assert_eq!(read.to_rgba8().get_pixel(0, 0).0, [188, 137, 0, 128]);
    assert_eq!(read.to_rgba8().get_pixel(1, 0).0, [0, 0, 0, 0]);
}

#[test]
fn pictures_side_by_side_keep_their_size_and_order() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("a.png");
    let white = Image::from_fn(3, 2, |_, _| [1.0; 4]);
    let red = Image::from_fn(4, 5, |_, _| [1.0, 0.0, 0.0, 0.5]);
    png::write_side_by_side(&path, &[&white, &red], 0.0).unwrap();
    let read = image::open(&path).unwrap().into_rgb8();
    assert_eq!(read.dimensions(), (3 + 8 + 4, 5));
    assert_eq!((read.get_pixel(0, 0).0, read.get_pixel(14, 4).0), ([255; 3], [255, 0, 0]));
    assert_eq!(read.get_pixel(3, 0).0, read.get_pixel(0, 2).0);
    assert!(png::write_side_by_side(&path, &[], 0.0).is_err());
}

#[test]
fn json_is_written_with_a_newline_at_its_end() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("a.json");
    let mut seconds = usage::Seconds::default();
    seconds.read = 0.5;
    report::write_json(&path, &seconds).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.ends_with("}\n"));
    let value: serde_json::Value = serde_json::from_str(&text).unwrap();
    let expected = serde_json::json!({
        "read": 0.5, "plan": 0.0, "blur": 0.0, "verify": 0.0, "confidence": 0.0, "write": 0.0,
        "total": 0.0
    });
    assert_eq!(value, expected);
}

mod the_report {
    use super::{Path, report, usage};
    use thinlens::finding::Finding;
    use thinlens::lens::ThinLens;
    use thinlens::methods::Registry;
    use thinlens::scene::{Effect, EffectKind, Scene};
    use thinlens::settings::{DepthConvention, Origin, ParameterValues, Settings, Values};
    use thinlens::stack::{Precision, StackKind};

    fn example() -> report::Report {
        let flags = Values { f_number: Some(1.5), ..Values::default() };
        let settings = Settings::resolve(&[(Origin::Flag, &flags)], ParameterValues::default());
        let nothing = Scene::new(Vec::new(), StackKind::PointSampled, 1, 12.5);
        let mut plan = Registry::default().plan(&nothing.analyze(), &settings).unwrap();
        plan.effects = vec![Effect::new(EffectKind::Fill, false, "nothing is missing", "with it, no effect")];
        let findings =
            vec![Finding::note("depth", "planar"), Finding::warning("peels", "the last peel is empty")];
        report::Report {
            version: "1.2.3",
            dial: None,
            input: vec!["a.exr".to_owned()],
            output: "b.exr".to_owned(),
            method: plan.method.name(),
            device: report::Device {
                kind: "cpu",
                name: "a processor".to_owned(),
                reason: "requested".to_owned(),
                gpu: None,
            },
            lens: report::LensReport::new(
                &settings,
                &ThinLens { coc_infinity_px: 12.5, focus_distance: 6.0, opening_px: 12.5 },
            ),
            picture: settings.picture.clone(),
            stack: report::StackReport {
                width: 40,
                height: 30,
                peels: 4,
                kind: "point".to_owned(),
                antialiased: 0.0,
                supersample: 1,
                convention: DepthConvention::Planar,
                precision: Precision::Half,
            },
            plan: report::PlanReport::from(&plan),
            views: plan.views,
            seconds: usage::Seconds::default(),
            cpu_seconds: 0.25,
            cpu_seconds_by_stage: usage::Seconds::default(),
            threads: 2,
            peak_memory_bytes: None,
            probe: None,
            confidence: None,
            warnings: report::Report::warnings(&findings),
            findings,
        }
    }

    #[test]
    fn has_the_keys_that_scripts_rely_on() {
        let json = serde_json::to_value(example()).unwrap();
        let keys: Vec<&String> = json.as_object().unwrap().keys().collect();
        for key in [
            "version",
            "input",
            "output",
            "method",
            "device",
            "lens",
            "picture",
            "plan",
            "seconds",
            "cpu_seconds",
            "peak_memory_bytes",
            "views",
            "probe",
            "warnings",
            "findings",
            "stack",
            "threads",
        ] {
            assert!(keys.iter().any(|found| *found == key), "{key} in {keys:?}");
        }
        assert_eq!(
            json["device"],
            serde_json::json!({"kind": "cpu", "name": "a processor", "reason": "requested"})
        );
        assert!(json["probe"].is_null());
        assert_eq!(json["stack"]["kind"], "point");
    }

    #[test]
    fn has_each_lens_value_with_its_origin_and_derived_values() {
        let lens = &serde_json::to_value(example()).unwrap()["lens"];
        assert_eq!(lens["f_number"], serde_json::json!({"value": 1.5, "origin": {"from": "flag"}}));
        assert_eq!(lens["focal_length_mm"]["origin"]["from"], "default");
        assert_eq!((&lens["c_inf"], &lens["focus_distance"]), (&12.5.into(), &6.0.into()));
    }

    #[test]
    fn has_every_effect_with_its_reason_and_a_list_of_warnings() {
        let json = serde_json::to_value(example()).unwrap();
        let effect = serde_json::json!({
            "name": "fill", "on": false, "reason": "nothing is missing", "change": "with it, no effect", "forced": false
        });
        assert_eq!(json["plan"]["effects"], serde_json::json!([effect]));
        assert_eq!(json["warnings"], serde_json::json!(["the last peel is empty"]));
        assert_eq!(json["findings"].as_array().unwrap().len(), 2);
    }

    #[test]
    fn an_output_folder_that_is_missing_is_an_error() {
        assert!(report::write_json(Path::new("/no such folder/a.json"), &1).is_err());
    }
}
