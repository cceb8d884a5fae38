//! The shipped scenes against their true thin-lens references: the floor no change may fall through.

#![expect(clippy::unwrap_used, reason = "a sample that cannot be read has failed")]

use std::path::{Path, PathBuf};
use thinlens::gpu::DeviceChoice;
use thinlens::methods::{self, METHODS};
use thinlens::metrics::score;
use thinlens::render::{Job, NamedPreset, prepare, render, render_stack};
use thinlens::scene::EffectKind;
use thinlens::settings::{Effort, Preset, Values};
use thinlens::stack::{FramedImage, ReadOptions, Source, Stack, read, read_framed_picture, read_picture};

fn folder(scene: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("samples").join(scene)
}

fn job(scene: &str, input: &str, method: &str, views: usize) -> Job {
    let preset = std::fs::read_to_string(folder(scene).join("preset.toml")).unwrap();
    Job {
        sources: vec![Source::File(folder(scene).join(input))],
        preset: Some(NamedPreset { name: scene.to_owned(), preset: Preset::parse(&preset, scene).unwrap() }),
        flags: Values {
            method: Some(method.to_owned()),
            effort: Some(Effort::Views(views)),
            ..Values::default()
        },
        ..Job::default()
    }
}

/// Against the true lens, with the default method; and the share of the picture whose colours are averages over the pixel.
fn psnr_db(scene: &str, input: &str, views: usize) -> (f64, f64) {
    let rendered = render(&job(scene, input, "shear", views), &|_| {}).unwrap();
    let reference = read_framed_picture(&folder(scene).join("reference.exr")).unwrap();
    let [part, of_reference] = rendered.frame.shared_with(&reference.frame).unwrap();
    let image = FramedImage { image: rendered.image, frame: rendered.frame }.part(part);
    let db = score(&image, &reference.part(of_reference), 0).unwrap().psnr_db;
    (db, rendered.stack.antialiasing.mean())
}

#[test]
fn the_default_method_is_as_near_the_true_lens_as_it_was() {
    for (scene, input, averages, floor_db) in [
        ("terrace", "stack.exr", 0.98..=1.0, 34.7),
        ("terrace", "pinhole.exr", 1.0..=1.0, 27.9),
        ("fence", "stack.exr", 0.0..=0.0, 32.5),
        ("fence", "pinhole.exr", 1.0..=1.0, 28.5),
        ("table", "stack.exr", 0.0..=0.0, 36.6),
        ("table", "pinhole.exr", 1.0..=1.0, 38.6),
        ("stall", "stack.exr", 1.0..=1.0, 34.2),
        ("shelf", "stack.exr", 1.0..=1.0, 41.6),
    ] {
        let (db, found) = psnr_db(scene, input, 64);
        assert!(db > floor_db, "{scene}/{input}: {db:.2} dB, was over {floor_db}");
        assert!(averages.contains(&found), "{scene}/{input}: {found}");
    }
}

#[test]
fn peels_tell_what_a_picture_with_depth_cannot() {
    for (scene, gain_db) in [("fence", 4.0), ("terrace", 6.3)] {
        let (peels, _) = psnr_db(scene, "stack.exr", 64);
        let (picture, _) = psnr_db(scene, "pinhole.exr", 64);
        assert!(peels > picture + gain_db, "{scene}: peels {peels:.2} dB, one picture {picture:.2} dB");
    }
}

#[test]
fn the_default_method_answers_the_reference_methods_question() {
    for scene in ["fence", "table"] {
        let picture = |method: &str| {
            let prepared = prepare(&job(scene, "stack.exr", method, 256)).unwrap();
            let plan = prepared.plan.forced(EffectKind::Prefilter, false).forced(EffectKind::Resolve, false);
            methods::render(prepared.scene, &plan, &|_| {}).unwrap()
        };
        let db = score(&picture("shear"), &picture("accumulate"), 0).unwrap().psnr_db;
        assert!(db > 45.0, "{scene}: {db:.2} dB apart");
    }
}

#[test]
fn the_default_method_is_nearer_the_true_lens_than_any_paper_s() {
    for scene in ["fence", "table", "terrace"] {
        let (default, _) = psnr_db(scene, "stack.exr", 64);
        let reference = read_picture(&folder(scene).join("reference.exr")).unwrap();
        for info in
            METHODS.iter().map(|method| method.info()).filter(|info| info.role == methods::Role::Paper)
        {
            let mut job = job(scene, "stack.exr", info.name, 64);
            job.flags.effort = None;
            let image = render(&job, &|_| {}).unwrap().image;
            let db = score(&image, &reference, 0).unwrap().psnr_db;
            assert!(default > db, "{scene}: default {default:.2} dB, {} {db:.2} dB", info.name);
        }
    }
}

#[test]
fn methods_that_read_the_peels_see_through_the_fence_and_those_that_read_one_picture_do_not() {
    let reference = read_picture(&folder("fence").join("reference.exr")).unwrap();
    for (method, sees_through) in [
        ("recursive-gaussian", true),
        ("b-buffer", true),
        ("point-splat", true),
        ("layer-rays", true),
        ("opaque-blur", false),
        ("pyramid-disocclusion", false),
        ("gather", false),
        ("scatter", false),
    ] {
        let mut job = job("fence", "stack.exr", method, 64);
        job.flags.effort = None;
        let db = score(&render(&job, &|_| {}).unwrap().image, &reference, 0).unwrap().psnr_db;
        let expected = if sees_through { 28.0..40.0 } else { 20.0..26.0 };
        assert!(expected.contains(&db), "{method}: {db:.2} dB, not within {expected:?}");
    }
}

#[test]
fn an_infinite_f_number_gives_the_stack_as_the_camera_saw_it_with_every_method() {
    for method in METHODS {
        let mut job = job("fence", "stack.exr", method.info().name, 64);
        job.flags.f_number = Some(f32::INFINITY);
        if !method.samples_lens() {
            job.flags.effort = None;
        }
        let prepared = prepare(&job).unwrap();
        let seen = prepared.scene.pinhole();
        assert_eq!(prepared.blur(&|_| {}).unwrap().image, seen, "{}", method.info().name);
    }
}

#[test]
fn planes_in_memory_are_rendered_as_their_file_is() {
    let job = Job { device: DeviceChoice::Cpu, ..job("fence", "stack.exr", "shear", 4) };
    let Stack { peels, frame, convention, camera, .. } = read(&job.sources, &job.read_options).unwrap();
    let options = ReadOptions { convention: Some(convention), ..ReadOptions::default() };
    let mut planes = Stack::from_peels(peels, frame, &options).unwrap();
    planes.camera = camera;
    let in_memory = render_stack(planes, &job, &|_| {}).unwrap();
    assert_eq!(in_memory.image, render(&job, &|_| {}).unwrap().image);
    assert_eq!(in_memory.frame, frame);
}
