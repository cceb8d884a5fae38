//! What does not change from frame to frame.

use super::program::{STACK, run, stderr};
use super::{ended_with, lines, render, shot};
use std::fs;
use std::path::Path;
use thinlens::image::Image;
use thinlens::output::exr::{self, ExrOptions};
use thinlens::stack::{Carried, Frame, Precision, read_picture};

/// The samples of the picture at `path`, bit by bit.
fn bits(path: &Path) -> Vec<Vec<u32>> {
    let Image { planes } = read_picture(path).unwrap();
    planes.iter().map(|plane| plane.values().iter().map(|value| value.to_bits()).collect()).collect()
}

#[test]
fn a_static_shot_gives_the_same_bits_in_every_frame_and_as_a_single_render() {
    let folder = shot(&[1, 2, 3, 4, 5, 6, 7]);
    let arguments = ["render", "shot.####.exr", "-o", "out/f.####.exr", "--focus", "6", "--quality", "draft"];
    ended_with(&run(folder.path(), &arguments), 0);
    let first = bits(&folder.path().join("out/f.0001.exr"));
    for number in 2..=7 {
        assert!(bits(&folder.path().join(format!("out/f.{number:04}.exr"))) == first, "frame {number}");
    }
    ended_with(
        &run(folder.path(), &["render", STACK, "-o", "a.exr", "--focus", "6", "--quality", "draft"]),
        0,
    );
    assert!(bits(&folder.path().join("a.exr")) == first, "a single render");
}

#[test]
fn a_focus_that_nobody_chose_is_refused_and_a_focus_of_the_header_is_taken() {
    let folder = shot(&[1, 2]);
    let arguments = ["render", "shot.####.exr", "-o", "out/f.####.exr", "--views", "4"];
    let output = run(folder.path(), &arguments);
    ended_with(&output, 2);
    for flag in ["--focus", "--focus-at", "--focus-on", "focus_keys"] {
        assert!(stderr(&output).contains(flag), "{flag}: {}", stderr(&output));
    }
    assert_eq!(fs::read_dir(folder.path().join("out")).unwrap().count(), 0);
    ended_with(&run(folder.path(), &[&arguments[..], &["--focus-at", "160,90"]].concat()), 0);
}

/// A picture of 96 × 64 pixels of noise of this strength, with its depth, behind focus.
fn noisy(path: &Path, strength: f32) {
    use thinlens::image::Plane;
    let mut random = fastrand::Rng::with_seed(1);
    let grey = Plane::from_fn(96, 64, |_, _| 0.5 + strength * (random.f32() - 0.5));
    let planes = [grey.clone(), grey.clone(), grey, Plane::filled(96, 64, 1.0)];
    let frame = Frame::from_size(96, 64);
    let options = ExrOptions::new(Precision::Float);
    exr::write(path, &Image { planes }, &frame, &Carried::default(), &options).unwrap();
}

#[test]
fn all_frames_have_the_number_of_views_of_the_hardest() {
    let folder = tempfile::tempdir().unwrap();
    let depth = |path: &Path| {
        let far = thinlens::image::Plane::filled(96, 64, 8.0);
        let planes = std::array::from_fn(|_| far.clone());
        let options = ExrOptions::new(Precision::Float);
        exr::write(path, &Image { planes }, &Frame::from_size(96, 64), &Carried::default(), &options)
            .unwrap();
    };
    depth(&folder.path().join("depth.exr"));
    for (number, strength) in [(1, 0.01), (2, 1.0), (3, 0.01)] {
        noisy(&folder.path().join(format!("c.{number:04}.exr")), strength);
    }
    let lens = ["--focal-length", "100", "--f-number", "1", "--focus", "2", "--quality", "final"];
    let views = |name: &str, folder: &Path| -> u64 {
        let report = fs::read_to_string(folder.join(name)).unwrap();
        serde_json::from_str::<serde_json::Value>(&report).unwrap()["views"].as_u64().unwrap()
    };
    let alone: Vec<u64> = (1..=3)
        .map(|number| {
            let input = format!("c.{number:04}.exr");
            let arguments =
                ["render", &input, "--depth-file", "depth.exr", "-o", "a.exr", "--report", "a.json"];
            ended_with(&run(folder.path(), &[&arguments[..], &lens].concat()), 0);
            views("a.json", folder.path())
        })
        .collect();
    assert!(alone[1] > alone[0], "the second frame is harder: {alone:?}");
    let arguments =
        ["render", "c.####.exr", "--depth-file", "depth.exr", "-o", "o.####.exr", "--report", "r.####.json"];
    ended_with(&run(folder.path(), &[&arguments[..], &lens].concat()), 0);
    for number in 1..=3 {
        assert_eq!(views(&format!("r.{number:04}.json"), folder.path()), alone[1], "frame {number}");
    }
}

#[test]
fn decisions_of_a_plan_are_those_of_every_part_of_the_shot() {
    let folder = shot(&[1, 2, 3, 4]);
    let lens = ["--focus", "6", "--quality", "draft"];
    let plan = ["plan", "shot.####.exr", "--decisions", "shot.toml"];
    ended_with(&run(folder.path(), &[&plan[..], &lens].concat()), 0);
    let decisions = fs::read_to_string(folder.path().join("shot.toml")).unwrap();
    assert!(decisions.contains("views = "), "{decisions}");
    let kept =
        decisions.replace(decisions.lines().find(|line| line.starts_with("views")).unwrap(), "views = 7");
    fs::write(folder.path().join("shot.toml"), kept).unwrap();
    let arguments = ["render", "shot.####.exr", "-o", "out/f.####.exr", "--decisions", "shot.toml"];
    let parts = ["--frames", "1-2", "--report", "r.####.json"];
    ended_with(&run(folder.path(), &[&arguments[..], &lens, &parts].concat()), 0);
    let report = fs::read_to_string(folder.path().join("r.0002.json")).unwrap();
    assert_eq!(serde_json::from_str::<serde_json::Value>(&report).unwrap()["views"], 7);
}

#[test]
fn keys_of_a_preset_are_those_of_each_frame() {
    let folder = shot(&[1, 3]);
    let keys = "[[lens.focus_keys]]\nframe = 1\ndistance = 4\n[[lens.focus_keys]]\nframe = 3\ndistance = 8\n";
    fs::write(folder.path().join("pull.toml"), keys).unwrap();
    let arguments =
        ["render", "shot.####.exr", "-o", "out/f.####.exr", "--preset", "pull.toml", "--views", "4"];
    ended_with(&run(folder.path(), &[&arguments[..], &["--report", "r.####.json"]].concat()), 0);
    for (number, distance) in [(1, 4.0), (3, 8.0)] {
        let report = fs::read_to_string(folder.path().join(format!("r.{number:04}.json"))).unwrap();
        let report: serde_json::Value = serde_json::from_str(&report).unwrap();
        assert_eq!(report["lens"]["focus_distance"], distance, "{report}");
    }
}

#[test]
fn a_line_of_json_says_how_each_frame_ended_and_the_last_how_the_shot_did() {
    let folder = shot(&[1, 2]);
    let lines = lines(&render(folder.path(), &["--json"]));
    assert_eq!(lines.len(), 3);
    assert_eq!(lines[2]["shot"]["rendered"], 2);
    assert_eq!(lines[2]["shot"]["exit_code"], 0);
    assert!(lines[0]["seconds"].as_f64().unwrap() > 0.0 && lines[0]["error"].is_null());
}
