//! A frame that is rendered in bands of rows is the frame that is rendered as a whole.
//!
//! The memory that a job may use is set to what some of the rows of a sample take, so that bands are needed. The lens is stopped down: the
//! samples are small, and a band has at least as many rows as lie around it.

#![expect(clippy::unwrap_used, reason = "a test stops at the first failure")]

mod program;

use std::fs;
use std::path::Path;
use thinlens::metrics;
use thinlens::output::exr::{self, Codec, ExrOptions};
use thinlens::render::{self, Job};
use thinlens::settings::{Border, Effort, Preset, Values};
use thinlens::stack::{self, ReadOptions, Source, read_picture};

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
    for (name, f_number) in [("fence", 5.6), ("table", 4.0)] {
        let (same, psnr_db) = compared(folder.path(), &job(name, "shear", f_number));
        assert!(same, "{name}: {psnr_db} dB");
    }
}

/// A ray's place is a number of rows from the top of what is read, so that it is rounded otherwise in a band: a few rays end in the pixel
/// beside.
#[test]
fn accumulate_makes_the_same_picture_in_bands_but_for_rounding() {
    let folder = tempfile::tempdir().unwrap();
    let (same, psnr_db) = compared(folder.path(), &job("fence", "accumulate", 5.6));
    assert!(same || psnr_db >= 80.0, "{psnr_db} dB");
}

/// Channels that are copied, overscan, a border that lets rays end in the background, and aberrations that move light.
#[test]
fn carried_channels_overscan_and_what_lies_beyond_the_frame_are_the_same_in_bands() {
    let folder = tempfile::tempdir().unwrap();
    let shelf = job("shelf", "shear", 11.0);
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
    let job = job("fence", "shear", 5.6);
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
    let fence = job("fence", "shear", 5.6);
    let verified = Job { verify: Some(400), ..fence.clone() };
    let masked = Job { confidence: true, ..fence };
    for (job, expected) in [
        (verified, "the sampling error is not measured"),
        (masked, "there is no confidence mask"),
        (job("fence", "recursive-gaussian", 5.6), "recursive-gaussian needs the whole frame"),
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
        let run =
            ["render", &stack, "-o", "out.exr", "--preset", &preset, "--method", method, "--views", "16"];
        let run = [&run[..], &["--device", "cpu", "--report", "report.json"]].concat();
        let output = program::run(folder.path(), &run);
        assert!(output.status.success(), "{}", program::stderr(&output));
        let report: serde_json::Value =
            serde_json::from_slice(&fs::read(folder.path().join("report.json")).unwrap()).unwrap();
        let Some(peak) = report["peak_memory_bytes"].as_u64() else { return };
        let footprint = stack::footprint(&[Source::file(&stack)], &ReadOptions::default()).unwrap();
        let bound = footprint.render_bytes(footprint.height);
        assert!(footprint.decoded_bytes() < peak && peak <= bound, "{name}: {peak} of {bound} bytes");
    }
}
