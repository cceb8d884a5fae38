//! Holdouts: they hide what is behind them along every lens ray, and are not seen.

#![expect(clippy::unwrap_used, reason = "a test stops at the first failure")]

#[expect(dead_code, reason = "other tests use the rest")]
mod fixtures;

use exr::image::FlatSamples;
use fixtures::{Part, exr_bytes};
use std::path::{Path, PathBuf};
use thinlens::gpu::DeviceChoice;
use thinlens::image::Image;
use thinlens::render::{Job, render};
use thinlens::settings::{Effort, Focus, Values};
use thinlens::stack::Source;

const WIDTH: usize = 96;
const HEIGHT: usize = 64;

/// A file of one element: `sample(x, y)` = grey, alpha and depth.
fn write(folder: &Path, name: &str, sample: impl Fn(usize, usize) -> (f32, f32, f32)) -> PathBuf {
    let values = |of: fn((f32, f32, f32)) -> f32| {
        FlatSamples::F32((0..WIDTH * HEIGHT).map(|i| of(sample(i % WIDTH, i / WIDTH))).collect())
    };
    let part = Part::flat((WIDTH, HEIGHT), "R=0 G=0 B=0 A=0 Z=0")
        .with("R", values(|of| of.0))
        .with("G", values(|of| 0.5 * of.0))
        .with("B", values(|of| of.0 * of.0))
        .with("A", values(|of| of.1))
        .with("Z", values(|of| of.2));
    let path = folder.join(name);
    std::fs::write(&path, exr_bytes(vec![part])).unwrap();
    path
}

/// A picture of `inputs`, merged by depth, with the holdout in `holdout`; a CoC radius of about 8 px at infinity, focused on depth 3.
fn picture(inputs: &[&Path], holdout: Option<&Path>, method: &str, f_number: f32) -> Image {
    let values = Values {
        method: Some(method.to_owned()),
        effort: Some(Effort::Views(64)),
        focal_length_mm: Some(135.0),
        f_number: Some(f_number),
        sensor_width_mm: Some(36.0),
        focus: Some(Focus::Distance(3.0)),
        holdout: holdout.map(Path::to_owned),
        ..Values::default()
    };
    let job = Job::new(inputs.iter().map(|path| Source::file(*path))).with_values(values);
    let mut job = Job { device: DeviceChoice::Cpu, ..job };
    job.read_options.merge = inputs.len() > 1;
    render(&job, &|_| {}).unwrap().image
}

/// A disc in focus, with a pattern, and a bar that crosses it: near at its left end and far at its right.
fn elements(folder: &Path) -> [PathBuf; 2] {
    let pattern = |x: usize, y: usize| 0.2 + 0.1 * ((x / 3 + 2 * (y / 4)) % 7) as f32;
    let disc = move |x: usize, y: usize| {
        let inside = (x as f32 - 48.0).hypot(y as f32 - 32.0) < 20.0;
        if inside { (pattern(x, y), 1.0, 3.0) } else { (0.0, 0.0, 1e10) }
    };
    let bar = move |x: usize, y: usize| {
        if (24..40).contains(&y) {
            (0.5 * pattern(y, x), 1.0, 1.8 + 0.03 * x as f32)
        } else {
            (0.0, 0.0, 1e10)
        }
    };
    [write(folder, "disc.exr", disc), write(folder, "bar.exr", bar)]
}

#[test]
fn two_elements_held_out_of_one_another_add_up_to_the_picture_of_both() {
    let folder = tempfile::tempdir().unwrap();
    let [disc, bar] = elements(folder.path());
    for method in ["shear", "accumulate", "peel-rays", "layer-rays"] {
        let both = picture(&[&disc, &bar], None, method, 1.0);
        let parts =
            [(&disc, &bar), (&bar, &disc)].map(|(shown, held)| picture(&[shown], Some(held), method, 1.0));
        for (channel, plane) in both.planes.iter().enumerate() {
            for (i, &expected) in plane.values().iter().enumerate() {
                let sum: f32 = parts.iter().map(|part| part.planes[channel].values()[i]).sum();
                let (x, y) = (i % WIDTH, i / WIDTH);
                assert!(
                    (sum - expected).abs() < 1e-4,
                    "{method}, channel {channel} at {x}, {y}: {sum}, not {expected}"
                );
            }
        }
    }
}

#[test]
fn without_a_lens_a_holdout_cuts_out_what_is_behind_it_and_leaves_what_is_before_it() {
    let folder = tempfile::tempdir().unwrap();
    let wall = write(folder.path(), "wall.exr", |x, y| (0.1 + 0.01 * (x + y) as f32, 1.0, 5.0));
    let held = write(folder.path(), "held.exr", |x, _| match x {
        0..30 => (9.0, 1.0, 2.0),
        30..60 => (9.0, 1.0, 8.0),
        60..70 => (9.0, 0.25, 2.0),
        _ => (0.0, 0.0, 1e10),
    });
    let image = picture(&[&wall], Some(&held), "shear", f32::INFINITY);
    let red = |x: usize| 0.1 + 0.01 * (x + 10) as f32;
    assert_eq!(image.pixel(10, 10), [0.0; 4], "behind it");
    for x in [45, 90] {
        let [r, _, _, alpha] = image.pixel(x, 10);
        assert_eq!((r, alpha), (red(x), 1.0), "before it, and beside it");
    }
    let [r, _, _, alpha] = image.pixel(65, 10);
    assert!(
        (r - 0.75 * red(65)).abs() < 1e-6 && (alpha - 0.75).abs() < 1e-6,
        "through a quarter: {r}, {alpha}"
    );
}

#[test]
fn a_holdout_in_focus_is_sharp_and_one_out_of_focus_is_soft() {
    let folder = tempfile::tempdir().unwrap();
    let wall = write(folder.path(), "wall.exr", |_, _| (0.8, 1.0, 12.0));
    let rows = |depth: f32| {
        let held =
            write(
                folder.path(),
                "held.exr",
                move |x, _| {
                    if x >= 48 { (1.0, 1.0, depth) } else { (0.0, 0.0, 1e10) }
                },
            );
        let image = picture(&[&wall], Some(&held), "accumulate", 1.0);
        (0..WIDTH).map(|x| image.pixel(x, 32)[3]).collect::<Vec<f32>>()
    };
    let sharp = rows(3.0);
    assert_eq!((sharp[46], sharp[49]), (1.0, 0.0), "one pixel from its edge");
    // At depth 2 the CoC radius is half of that at infinity: the edge is half way at its place.
    let soft = rows(2.0);
    assert!((0.3..0.7).contains(&soft[47]) && soft[44] < 1.0 && soft[51] > 0.0, "{:?}", &soft[40..56]);
}

#[test]
fn a_holdout_of_another_frame_or_convention_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let wall = write(folder.path(), "wall.exr", |_, _| (0.8, 1.0, 12.0));
    let path = folder.path().join("other.exr");
    let failure = |part: Part| {
        std::fs::write(&path, exr_bytes(vec![part])).unwrap();
        let values = Values { holdout: Some(path.clone()), ..Values::default() };
        let job = Job::new([Source::file(wall.as_path())]).with_values(values);
        render(&job, &|_| {}).unwrap_err().to_string()
    };
    let smaller = failure(Part::flat((WIDTH - 1, HEIGHT), "R=0 G=0 B=0 A=1 Z=3"));
    assert!(smaller.contains("another frame") && smaller.contains("95×64"), "{smaller}");
    let missing = failure(Part::flat((WIDTH, HEIGHT), "R=0 G=0 B=0 A=1"));
    assert!(missing.contains("holdout") && missing.contains("depth"), "{missing}");
}
