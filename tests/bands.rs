//! A frame that is rendered in bands of rows is the frame that is rendered as a whole.
//!
//! The memory that a job may use is set to what some of the rows of a sample take, so that bands are needed. The lens is stopped down: the
//! samples are small, and a band has at least as many rows as lie around it.

#![expect(clippy::unwrap_used, reason = "a test stops at the first failure")]

use ::exr::image::{
    AnyChannel, AnyChannels, Blocks, Encoding, FlatSamples, Image as ExrImage, Layer as ExrLayer,
};
use ::exr::math::Vec2;
use ::exr::meta::attribute::{Compression, LineOrder};
use ::exr::meta::header::LayerAttributes;
use ::exr::prelude::{SmallVec, WritableImage as _};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use thinlens::image::Image;
use thinlens::metrics;
use thinlens::output::exr::{self, Codec, ExrOptions};
use thinlens::render::{self, Job};
use thinlens::settings::{Border, Effort, Preset, Values};
use thinlens::stack::{
    self, Carried, CarriedChannel, Frame, Precision, ReadOptions, Source, Window, read_picture,
};

/// The job of rendering sample `name` with `method`, with the aperture of its preset closed to `f_number`.
fn job(name: &str, method: &str, f_number: f32) -> Job {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples").join(name);
    let preset =
        Preset::parse(&fs::read_to_string(folder.join("preset.toml")).unwrap(), "preset.toml").unwrap();
    let values = Values {
        method: Some(method.to_owned()),
        effort: Some(Effort::Views(32)),
        f_number: Some(f_number),
        ..Values::default()
    };
    Job::new([Source::file(folder.join("stack.exr"))]).with_preset("preset.toml", preset).with_values(values)
}

/// `job`, allowed the memory that `rows` rows take.
fn allowed(job: &Job, rows: usize) -> Job {
    let footprint = stack::footprint(&job.sources, &ReadOptions::default()).unwrap();
    Job { memory: Some(footprint.render_bytes(rows)), ..job.clone() }
}

/// Rows of the data window of the stack of `job`.
fn job_rows(job: &Job) -> usize {
    stack::footprint(&job.sources, &ReadOptions::default()).unwrap().height
}

/// Renders `job` as a whole and in bands into `folder`; returns whether the files are the same, and the PSNR between their pictures in dB.
fn compared(folder: &Path, job: &Job) -> (bool, f64) {
    let [whole, banded] = ["whole.exr", "banded.exr"].map(|name| folder.join(name));
    let rendered = render::render(job, &|_| {}).unwrap();
    let options = ExrOptions::new(rendered.stack.precision);
    exr::write(&whole, &rendered.image, &rendered.frame, &rendered.stack.carried, &options).unwrap();
    let bands = render::in_bands(&allowed(job, job_rows(job) - 1), Codec::default()).unwrap().unwrap();
    let found = &bands.stack().findings;
    assert!(
        found.iter().any(|finding| finding.about == "memory" && finding.text.contains("rendered in")),
        "{found:?}"
    );
    assert_eq!(
        bands.plan().effects.iter().map(|e| e.on).collect::<Vec<_>>(),
        rendered.plan.effects.iter().map(|e| e.on).collect::<Vec<_>>()
    );
    bands.write(&banded, &options, None, &|_| {}).unwrap();
    let [a, b] = [&whole, &banded].map(|path| read_picture(path).unwrap());
    let same = fs::read(&whole).unwrap() == fs::read(&banded).unwrap();
    (same, metrics::score(&a, &b, 0).unwrap().psnr_db)
}

#[test]
fn shear_makes_the_same_file_in_bands() {
    let folder = tempfile::tempdir().unwrap();
    for (name, f_number) in [("fence", 16.0), ("table", 11.0)] {
        let (same, psnr_db) = compared(folder.path(), &job(name, "shear", f_number));
        assert!(same, "{name}: {psnr_db} dB");
    }
}

/// A ray's place is a number of rows from the top of what is read, so that it is rounded otherwise in a band: a few rays end in the pixel
/// beside.
#[test]
fn accumulate_makes_the_same_picture_in_bands_but_for_rounding() {
    let folder = tempfile::tempdir().unwrap();
    let (same, psnr_db) = compared(folder.path(), &job("fence", "accumulate", 16.0));
    assert!(same || psnr_db >= 80.0, "{psnr_db} dB");
}

/// Channels that are copied, overscan, a border that lets rays end in the background, and aberrations that move light.
#[test]
fn carried_channels_overscan_and_what_lies_beyond_the_frame_are_the_same_in_bands() {
    let folder = tempfile::tempdir().unwrap();
    let shelf = job("shelf", "shear", 22.0);
    for border in [Border::Clamp, Border::Mirror, Border::Transparent] {
        let flags =
            Values { border: Some(border), lateral_color_um: Some([20.0, -20.0]), ..shelf.flags.clone() };
        let job = Job { flags: Values { vignetting: Some(1.0), ..flags }, ..shelf.clone() };
        let (same, psnr_db) = compared(folder.path(), &job);
        assert!(same || psnr_db >= 80.0, "{border:?}: {psnr_db} dB");
    }
}

#[test]
fn a_frame_that_fits_is_rendered_as_a_whole() {
    let job = job("fence", "shear", 1.4);
    assert!(render::fits_into_memory(&allowed(&job, 180)).unwrap());
    assert!(render::in_bands(&allowed(&job, 180), Codec::default()).unwrap().is_none());
    assert!(!render::fits_into_memory(&allowed(&job, 179)).unwrap());
}

#[test]
fn a_limit_that_an_error_names_is_enough() {
    let job = job("fence", "shear", 16.0);
    let error = render::in_bands(&allowed(&job, 130), Codec::default()).unwrap_err();
    assert_eq!(error.kind(), thinlens::error::ErrorKind::Limits);
    let text = error.to_string();
    let (_, size) = text.split_once("needed: ").unwrap();
    let (size, _) = size.split_once(" for bands").unwrap();
    let enough = Job { memory: Some(thinlens::memory::parse_bytes(size).unwrap()), ..job };
    assert!(render::in_bands(&enough, Codec::default()).unwrap().is_some(), "{text}");
}

#[test]
fn what_needs_the_whole_frame_is_refused_with_the_memory_that_it_takes() {
    let fence = job("fence", "shear", 16.0);
    let verified = Job { verify: Some(400), ..fence.clone() };
    let masked = Job { confidence: true, ..fence };
    for (job, expected) in [
        (verified, "the sampling error is not measured"),
        (masked, "there is no confidence mask"),
        (job("fence", "recursive-gaussian", 16.0), "recursive-gaussian needs the whole frame"),
    ] {
        let job = Job { flags: Values { effort: None, ..job.flags.clone() }, ..job };
        let error = render::in_bands(&allowed(&job, 155), Codec::default()).unwrap_err();
        assert_eq!(error.kind(), thinlens::error::ErrorKind::Limits);
        let text = error.to_string();
        assert!(text.contains(expected) && text.contains("for the whole frame"), "{text}");
    }
}

#[test]
fn the_estimate_bounds_the_memory_of_a_render() {
    let folder = tempfile::tempdir().unwrap();
    for (name, method) in [("terrace", "shear"), ("fence", "accumulate"), ("shelf", "shear")] {
        let samples = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples").join(name);
        let [stack, preset] =
            ["stack.exr", "preset.toml"].map(|file| samples.join(file).display().to_string());
        let arguments =
            ["render", &stack, "-o", "out.exr", "--preset", &preset, "--method", method, "--views", "16"];
        let arguments = [&arguments[..], &["--device", "cpu", "--report", "report.json"]].concat();
        let mut program = Command::new(env!("CARGO_BIN_EXE_thinlens"));
        let output = program.current_dir(folder.path()).args(arguments).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let report: serde_json::Value =
            serde_json::from_slice(&fs::read(folder.path().join("report.json")).unwrap()).unwrap();
        let Some(peak) = report["peak_memory_bytes"].as_u64() else { return };
        let footprint = stack::footprint(&[Source::file(&stack)], &ReadOptions::default()).unwrap();
        let bound = footprint.render_bytes(footprint.height);
        assert!(footprint.decoded_bytes() < peak && peak <= bound, "{name}: {peak} of {bound} bytes");
    }
}

#[test]
fn outputs_that_need_the_whole_picture_and_sizes_that_are_none_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let stack = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/fence/stack.exr").display().to_string();
    for (arguments, expected) in [
        (["-o", "out.png", "--memory", "1MiB"], "a PNG is written from the whole picture"),
        (["-o", "-", "--memory", "1MiB"], "standard output gets the whole picture at once"),
        (["-o", "out.exr", "--memory", "1MiB"], "allow at least that much with --memory"),
        (["-o", "out.exr", "--memory", "much"], "4GiB, 1.5GiB, 800MB"),
    ] {
        let mut program = Command::new(env!("CARGO_BIN_EXE_thinlens"));
        let output =
            program.current_dir(folder.path()).args(["render", &stack]).args(arguments).output().unwrap();
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && text.contains(expected), "{arguments:?}: {text}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is left behind");
}

/// Width and height of the pictures that are read in rows: no multiple of a block.
const SIZE: (usize, usize) = (61, 299);

/// A picture with a smooth depth, as an EXR with scan lines compressed by `codec`, whose data window begins at −7, −3.
fn write_scan_lines(path: &Path, codec: Codec) {
    let (width, height) = SIZE;
    let data = Window { x: -7, y: -3, width, height };
    let frame = Frame { data, display: data, pixel_aspect: 1.0 };
    let image = Image::from_fn(width, height, |x, y| [x as f32 / 61.0, y as f32 / 299.0, 0.25, 1.0]);
    let depth = (0..width * height).map(|i| 2.0 + 0.001 * (i / width) as f32).collect();
    let depth =
        CarriedChannel { name: "Z".to_owned(), samples: FlatSamples::F32(depth), quantize_linearly: false };
    let carried = Carried { channels: vec![depth], attributes: Vec::new() };
    exr::write(path, &image, &frame, &carried, &ExrOptions { precision: Precision::Float, codec }).unwrap();
}

/// The same in tiles.
fn write_tiles(path: &Path) {
    let channel = |name: &str, value: fn(usize, usize) -> f32| {
        let values = (0..SIZE.0 * SIZE.1).map(|i| value(i % SIZE.0, i / SIZE.0)).collect();
        AnyChannel::new(name, FlatSamples::F32(values))
    };
    let channels = AnyChannels::sort(SmallVec::from_vec(vec![
        channel("R", |x, _| x as f32 / 61.0),
        channel("G", |_, y| y as f32 / 299.0),
        channel("B", |_, _| 0.25),
        channel("Z", |_, y| 2.0 + 0.001 * y as f32),
    ]));
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::Tiles(Vec2(24, 20)),
        line_order: LineOrder::Increasing,
    };
    let attributes = LayerAttributes { layer_position: Vec2(-7, -3), ..LayerAttributes::default() };
    let layer = ExrLayer::new(Vec2(SIZE.0, SIZE.1), attributes, encoding, channels);
    ExrImage::from_layer(layer).write().to_file(path).unwrap();
}

#[test]
fn rows_of_a_file_are_those_of_the_whole_file_with_every_codec_and_in_tiles() {
    let folder = tempfile::tempdir().unwrap();
    let mut files: Vec<PathBuf> = Codec::ALL.map(|codec| folder.path().join(format!("{codec}.exr"))).into();
    files.iter().zip(Codec::ALL).for_each(|(path, codec)| write_scan_lines(path, codec));
    files.push(folder.path().join("tiles.exr"));
    write_tiles(&files[Codec::ALL.len()]);
    for path in &files {
        let read = |rows| {
            let options = ReadOptions { rows, ..ReadOptions::default() };
            stack::read(&[Source::file(path)], &options).unwrap()
        };
        let whole = read(None);
        for rows in [-3..-2, -3..20, 17..18, 30..100, 250..296, 295..296] {
            let part = read(Some(rows.clone()));
            assert_eq!((part.frame.data.y, part.height()), (rows.start, rows.len()), "{}", path.display());
            assert_eq!(part.frame.display, whole.frame.display);
            let top = (rows.start + 3) as usize;
            for y in 0..rows.len() {
                let [of_part, of_whole] = [(&part, y), (&whole, top + y)].map(|(stack, y)| {
                    let peel = &stack.peels[0];
                    [&peel.color[0], &peel.color[1], &peel.depth].map(|plane| plane.row(y).to_vec())
                });
                assert!(of_part == of_whole, "row {} of {}", rows.start + y as i32, path.display());
            }
        }
    }
}

#[test]
fn a_picture_that_is_no_open_exr_is_refused_in_bands() {
    let error = stack::read(
        &[Source::memory("a.png", include_bytes!("../docs/methods.png").as_slice())],
        &ReadOptions { rows: Some(0..8), ..ReadOptions::default() },
    );
    assert!(error.unwrap_err().to_string().contains("only OpenEXR can be read a few rows at a time"));
}
