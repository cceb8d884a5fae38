//! Runs that begin again: what is there and right is kept, everything else is rendered.

use super::program::{STACK, names};
use super::{all, ended_with, render, shot, statuses};
use std::fs;
use std::path::Path;
use std::time::{Duration, SystemTime};

/// Renders with `--resume` and `more`; returns the status of every frame.
fn resume(folder: &Path, more: &[&str]) -> Vec<(i64, String)> {
    let output = render(folder, &[&["--resume", "--json"][..], more].concat());
    ended_with(&output, 0);
    statuses(&output)
}

/// Every output, byte by byte.
fn pictures(folder: &Path) -> Vec<Vec<u8>> {
    let out = folder.join("out");
    names(&out).into_iter().map(|name| fs::read(out.join(name)).unwrap()).collect()
}

#[test]
fn frames_that_are_there_are_skipped_and_the_result_is_that_of_one_run() {
    let folder = shot(&[1, 2, 3]);
    ended_with(&render(folder.path(), &[]), 0);
    let whole = pictures(folder.path());
    assert_eq!(resume(folder.path(), &[]), all(&[1, 2, 3], "skipped"));
    fs::remove_file(folder.path().join("out/f.0002.exr")).unwrap();
    let expected = [(1, "skipped"), (2, "rendered"), (3, "skipped")].map(|(n, s)| (n, s.to_owned()));
    assert_eq!(resume(folder.path(), &[]), expected);
    assert!(pictures(folder.path()) == whole, "not one bit differs");
}

#[test]
fn a_picture_cut_short_is_rendered_again() {
    let folder = shot(&[1, 2]);
    ended_with(&render(folder.path(), &[]), 0);
    let whole = pictures(folder.path());
    let path = folder.path().join("out/f.0001.exr");
    let bytes = fs::read(&path).unwrap();
    for length in [0, 3, 100, bytes.len() / 2, bytes.len() - 1] {
        fs::write(&path, &bytes[..length]).unwrap();
        let statuses = resume(folder.path(), &[]);
        assert_eq!(statuses, [all(&[1], "rendered"), all(&[2], "skipped")].concat(), "{length} bytes");
        assert!(pictures(folder.path()) == whole, "{length} bytes");
    }
}

#[test]
fn changed_settings_inputs_and_presets_are_rendered_again() {
    let folder = shot(&[1, 2]);
    let preset = folder.path().join("lens.toml");
    let with_preset = ["--preset", "lens.toml"];
    fs::write(&preset, "[lens]\nf_number = 2.0\n").unwrap();
    ended_with(&render(folder.path(), &with_preset), 0);
    assert_eq!(resume(folder.path(), &with_preset), all(&[1, 2], "skipped"));
    fs::write(&preset, "[lens]\nf_number = 2.8\n").unwrap();
    assert_eq!(resume(folder.path(), &with_preset), all(&[1, 2], "rendered"), "another f-number");
    for flags in [&["--codec", "piz"][..], &["--precision", "float"], &["--blades", "5"]] {
        let flags = [&with_preset[..], flags].concat();
        assert_eq!(resume(folder.path(), &flags), all(&[1, 2], "rendered"), "{flags:?}");
        assert_eq!(resume(folder.path(), &flags), all(&[1, 2], "skipped"), "{flags:?}");
    }
    assert_eq!(resume(folder.path(), &with_preset), all(&[1, 2], "rendered"), "the flags are gone");
    let input = fs::File::options().append(true).open(folder.path().join("shot.0002.exr")).unwrap();
    input.set_modified(SystemTime::now() + Duration::from_secs(5)).unwrap();
    assert_eq!(
        resume(folder.path(), &with_preset),
        [all(&[1], "skipped"), all(&[2], "rendered")].concat(),
        "a newer input"
    );
}

#[test]
fn what_costs_time_only_is_no_reason_to_render_again() {
    let folder = shot(&[1, 2]);
    ended_with(&render(folder.path(), &[]), 0);
    for flags in [&["--threads", "1"][..], &["--quiet"], &["--memory", "3GiB"]] {
        assert_eq!(resume(folder.path(), flags), all(&[1, 2], "skipped"), "{flags:?}");
    }
}

#[test]
fn a_missing_preview_or_report_is_made_again() {
    let folder = shot(&[1, 2]);
    let more = ["--preview", "out/p.####.png", "--report", "out/r.####.json"];
    ended_with(&render(folder.path(), &more), 0);
    assert_eq!(resume(folder.path(), &more), all(&[1, 2], "skipped"));
    for name in ["p.0001.png", "r.0001.json"] {
        fs::remove_file(folder.path().join("out").join(name)).unwrap();
        assert_eq!(resume(folder.path(), &more), [all(&[1], "rendered"), all(&[2], "skipped")].concat());
    }
}

#[test]
fn png_pictures_are_resumed_too() {
    let folder = shot(&[1, 2]);
    let arguments = ["render", "shot.####.exr", "-o", "out/f.####.png", "--focus", "6", "--views", "4"];
    let resume = [&arguments[..], &["--resume", "--json"]].concat();
    ended_with(&super::program::run(folder.path(), &arguments), 0);
    assert_eq!(statuses(&super::program::run(folder.path(), &resume)), all(&[1, 2], "skipped"));
    let brighter = [&resume[..], &["--exposure", "1"]].concat();
    assert_eq!(statuses(&super::program::run(folder.path(), &brighter)), all(&[1, 2], "rendered"));
}

#[test]
fn another_programs_picture_of_that_name_is_replaced() {
    let folder = shot(&[1]);
    fs::copy(STACK, folder.path().join("out/f.0001.exr")).unwrap();
    assert_eq!(resume(folder.path(), &[]), all(&[1], "rendered"));
}
