//! The shipped scenes against their true thin-lens references: the floor no change may fall through.

#![expect(clippy::unwrap_used, reason = "a sample that cannot be read has failed")]

use std::path::{Path, PathBuf};
use thinlens::methods;
use thinlens::metrics::score;
use thinlens::render::{Job, NamedPreset, prepare, render};
use thinlens::scene::EffectKind;
use thinlens::settings::{Preset, Values};
use thinlens::stack::{Source, StackKind, read_picture};

fn folder(scene: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("samples").join(scene)
}

fn job(scene: &str, input: &str, method: &str, views: usize) -> Job {
    let preset = std::fs::read_to_string(folder(scene).join("preset.toml")).unwrap();
    Job {
        sources: vec![Source::File(folder(scene).join(input))],
        preset: Some(NamedPreset { name: scene.to_owned(), preset: Preset::parse(&preset, scene).unwrap() }),
        flags: Values { method: Some(method.to_owned()), views: Some(views), ..Values::default() },
        ..Job::default()
    }
}

/// Against the true lens, with the default method.
fn psnr_db(scene: &str, input: &str, views: usize) -> (f64, StackKind) {
    let rendered = render(&job(scene, input, "shear", views), &|_| {}).unwrap();
    let reference = read_picture(&folder(scene).join("reference.exr")).unwrap();
    (score(&rendered.image, &reference, 0).unwrap().psnr_db, rendered.stack.kind)
}

#[test]
fn the_default_method_is_as_near_the_true_lens_as_it_was() {
    for (scene, input, kind, floor_db) in [
        ("fence", "stack.exr", StackKind::PointSampled, 32.5),
        ("fence", "pinhole.exr", StackKind::BeautyDepth, 28.0),
        ("table", "stack.exr", StackKind::PointSampled, 36.6),
        ("table", "pinhole.exr", StackKind::BeautyDepth, 38.1),
    ] {
        let (db, found) = psnr_db(scene, input, 64);
        assert!(db > floor_db, "{scene}/{input}: {db:.2} dB, was over {floor_db}");
        assert_eq!(found, kind, "{scene}/{input}");
    }
}

#[test]
fn peels_tell_what_a_picture_with_depth_cannot() {
    let (peels, _) = psnr_db("fence", "stack.exr", 64);
    let (picture, _) = psnr_db("fence", "pinhole.exr", 64);
    assert!(peels > picture + 4.0, "peels {peels:.2} dB, one picture {picture:.2} dB");
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
