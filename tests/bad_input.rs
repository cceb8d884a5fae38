//! Invalid input and output is refused with what was expected, what was found and what to do, with an exit code that says whether trying
//! again helps, and no file is left behind.

#![cfg(feature = "cli")]
#![expect(clippy::unwrap_used, reason = "a test stops at the first failure")]

mod program;

use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, WritableImage};
use program::{STACK, names, run, stderr, thinlens};
use std::fs;
use std::path::Path;
use std::process::Output;

const LENS: [&str; 6] = ["--focal-length", "50", "--f-number", "2", "--focus", "6"];

/// Writes an EXR with constant `channels`.
fn write_exr(path: &Path, (width, height): (usize, usize), channels: &[(&str, f32)]) {
    let channel =
        |(name, value): &(&str, f32)| AnyChannel::new(*name, FlatSamples::F32(vec![*value; width * height]));
    let channels = AnyChannels::sort(channels.iter().map(channel).collect());
    Image::from_channels((width, height), channels).write().to_file(path).unwrap();
}

const COLOUR: [(&str, f32); 4] = [("R", 0.5), ("G", 0.5), ("B", 0.5), ("A", 1.0)];

/// Writes an EXR with colour and the depth `z`.
fn write_picture(path: &Path, size: (usize, usize), z: f32) {
    write_exr(path, size, &[&COLOUR[..], &[("Z", z)]].concat());
}

/// Exit codes: trying again may help; the call is wrong; the input is bad.
const RETRY: i32 = 1;
const CALL: i32 = 2;
const INPUT: i32 = 4;

/// Checks that `output` is an error with the exit code and all the words, and that the folder holds `files` and nothing else.
fn assert_refused(output: &Output, (code, words): (i32, &[&str]), folder: &Path, files: &[&str]) {
    let text = stderr(output);
    assert_eq!(output.status.code(), Some(code), "{text}");
    assert!(text.starts_with("error: ") || text.contains("\nerror: "), "{text}");
    assert!(!text.contains("panicked"), "{text}");
    for word in words {
        assert!(text.contains(word), "'{word}' is missing: {text}");
    }
    assert_eq!(output.stdout, b"", "an error leaves standard output empty");
    assert_eq!(names(folder), files);
}

/// Renders `inputs` and checks that it is refused.
fn assert_render_refused(folder: &Path, inputs: &[&str], words: &[&str]) {
    let files = names(folder);
    let files: Vec<_> = files.iter().map(String::as_str).collect();
    let arguments = [&["render"], inputs, &["-o", "out.exr"], &LENS].concat();
    assert_refused(&run(folder, &arguments), (INPUT, words), folder, &files);
}

#[test]
fn a_missing_file() {
    let folder = tempfile::tempdir().unwrap();
    assert_render_refused(folder.path(), &["no-such.exr"], &["no-such.exr"]);
}

#[test]
fn a_file_that_is_not_an_exr() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("text.exr"), "this is not a picture").unwrap();
    assert_render_refused(folder.path(), &["text.exr"], &["text.exr"]);
}

#[test]
fn an_empty_file() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("empty.exr"), "").unwrap();
    assert_render_refused(folder.path(), &["empty.exr"], &["empty.exr"]);
}

#[test]
fn a_folder_in_place_of_a_file() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("frames")).unwrap();
    assert_render_refused(folder.path(), &["frames"], &["frames"]);
}

#[test]
fn a_truncated_exr() {
    let folder = tempfile::tempdir().unwrap();
    let whole = fs::read(STACK).unwrap();
    fs::write(folder.path().join("cut.exr"), &whole[..whole.len() / 2]).unwrap();
    assert_render_refused(folder.path(), &["cut.exr"], &["cut.exr"]);
}

#[test]
fn a_header_with_more_pixels_than_fit_into_memory() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("huge.exr");
    write_picture(&path, (4, 4), 5.0);
    let mut bytes = fs::read(&path).unwrap();
    for window in ["dataWindow", "displayWindow"] {
        claim_size(&mut bytes, window, 100_000);
    }
    fs::write(&path, bytes).unwrap();
    assert_render_refused(folder.path(), &["huge.exr"], &["huge.exr", "100000"]);
}

/// Sets the end of a window in the header to `size`. Its name is followed by type, length and four `i32`.
fn claim_size(bytes: &mut [u8], window: &str, size: i32) {
    let name = format!("{window}\0box2i\0\u{10}\0\0\0");
    let at = bytes.windows(name.len()).position(|part| part == name.as_bytes()).unwrap();
    let corner = at + name.len() + 8;
    let end = (size - 1).to_le_bytes();
    bytes[corner..corner + 4].copy_from_slice(&end);
    bytes[corner + 4..corner + 8].copy_from_slice(&end);
}

#[test]
fn a_picture_without_depth() {
    let folder = tempfile::tempdir().unwrap();
    write_exr(&folder.path().join("beauty.exr"), (4, 4), &COLOUR);
    assert_render_refused(folder.path(), &["beauty.exr"], &["depth", "beauty.exr", "--depth-"]);
}

#[test]
fn a_depth_of_another_size() {
    let folder = tempfile::tempdir().unwrap();
    write_exr(&folder.path().join("beauty.exr"), (4, 4), &COLOUR);
    write_exr(&folder.path().join("depth.exr"), (8, 4), &[("Z", 5.0)]);
    let inputs = ["beauty.exr", "--depth-file", "depth.exr"];
    assert_render_refused(folder.path(), &inputs, &["depth", "size", "8"]);
}

#[test]
fn a_depth_that_is_nan_everywhere() {
    let folder = tempfile::tempdir().unwrap();
    write_picture(&folder.path().join("nan.exr"), (4, 4), f32::NAN);
    assert_render_refused(folder.path(), &["nan.exr"], &["depth"]);
}

#[test]
fn a_focus_nearer_than_the_focal_length() {
    let folder = tempfile::tempdir().unwrap();
    let arguments =
        ["render", STACK, "-o", "out.exr", "--focal-length", "85", "--f-number", "2", "--focus", "0.05"];
    let words = ["cannot focus this near", "found: focus distance 0.05", "help: raise --focus"];
    assert_refused(&run(folder.path(), &arguments), (CALL, &words), folder.path(), &[]);
}

#[test]
fn an_f_number_of_0() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["render", STACK, "-o", "out.exr", "--f-number", "0", "--focus", "6"];
    let words = ["--f-number must be a positive number, or inf: inf is a pinhole", "found: 0"];
    assert_refused(&run(folder.path(), &arguments), (CALL, &words), folder.path(), &[]);
}

#[test]
fn a_negative_focal_length() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["render", STACK, "-o", "out.exr", "--focal-length", "-50", "--focus", "6"];
    let words = ["--focal-length must be a positive number", "found: -50"];
    assert_refused(&run(folder.path(), &arguments), (CALL, &words), folder.path(), &[]);
}

#[test]
fn a_normalised_depth_whose_ends_are_at_one_distance() {
    let folder = tempfile::tempdir().unwrap();
    let depth = ["--depth-convention", "normalised", "--near", "5", "--far", "5"];
    let arguments = [&["render", STACK, "-o", "out.exr"], &LENS[..], &depth].concat();
    let words = ["must lie beyond its near end", "found: near 5, far 5", "help: "];
    assert_refused(&run(folder.path(), &arguments), (CALL, &words), folder.path(), &[]);
}

#[test]
fn an_unknown_key_in_a_preset() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("my.toml"), "[lens]\nf_numbr = 2\n").unwrap();
    let words =
        ["unknown key 'f_numbr' in [lens]", "my.toml:2:1", "^^^^^^^", "help: did you mean 'f_number'?"];
    let arguments = ["render", STACK, "-o", "out.exr", "--preset", "my.toml"];
    assert_refused(&run(folder.path(), &arguments), (CALL, &words), folder.path(), &["my.toml"]);
}

#[test]
fn an_unknown_method_in_a_preset() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("my.toml"), "[method]\nname = 'sheer'\n").unwrap();
    let arguments = ["render", STACK, "-o", "out.exr", "--preset", "my.toml"];
    let words = ["no method called 'sheer'", "did you mean 'shear'?"];
    assert_refused(&run(folder.path(), &arguments), (CALL, &words), folder.path(), &["my.toml"]);
}

#[test]
fn an_output_folder_that_does_not_exist() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = [&["render", STACK, "-o", "no/such/out.exr"], &LENS[..]].concat();
    let words =
        ["the output's folder does not exist", "in: no/such/out.exr", "help: create it: mkdir -p no/such"];
    assert_refused(&run(folder.path(), &arguments), (CALL, &words), folder.path(), &[]);
}

#[test]
fn an_output_folder_that_is_a_file() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("file"), "").unwrap();
    let arguments = [&["render", STACK, "-o", "file/out.exr"], &LENS[..]].concat();
    let words = ["the output's folder is not a folder", "in: file/out.exr"];
    assert_refused(&run(folder.path(), &arguments), (CALL, &words), folder.path(), &["file"]);
}

#[cfg(unix)]
#[test]
fn an_output_folder_that_is_read_only() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let locked = folder.path().join("locked");
    fs::create_dir(&locked).unwrap();
    fs::set_permissions(&locked, fs::Permissions::from_mode(0o555)).unwrap();
    let anybody_may_write = fs::write(locked.join("probe"), "").is_ok();
    if !anybody_may_write {
        let arguments = [&["render", STACK, "-o", "locked/out.exr"], &LENS[..]].concat();
        assert_refused(
            &run(folder.path(), &arguments),
            (RETRY, &["locked", "writ"]),
            folder.path(),
            &["locked"],
        );
        assert_eq!(names(&locked), [""; 0]);
    }
    fs::set_permissions(&locked, fs::Permissions::from_mode(0o755)).unwrap();
}

#[test]
fn an_output_that_is_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = [&["render", STACK, "-o", "."], &LENS[..]].concat();
    assert_refused(
        &run(folder.path(), &arguments),
        (CALL, &["the output is a folder", "help: "]),
        folder.path(),
        &[],
    );
}

#[test]
fn an_output_that_is_an_input() {
    let folder = tempfile::tempdir().unwrap();
    fs::copy(STACK, folder.path().join("in.exr")).unwrap();
    let before = fs::read(STACK).unwrap();
    let arguments = [&["render", "in.exr", "-o", "./in.exr"], &LENS[..]].concat();
    let words = ["the output is one of the inputs", "help: "];
    assert_refused(&run(folder.path(), &arguments), (CALL, &words), folder.path(), &["in.exr"]);
    assert!(fs::read(folder.path().join("in.exr")).unwrap() == before, "the input is untouched");
}

#[test]
fn an_output_of_an_unknown_format() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = [&["render", STACK, "-o", "out.jpg"], &LENS[..]].concat();
    assert_refused(&run(folder.path(), &arguments), (CALL, &["expected: .exr, .png"]), folder.path(), &[]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_for_a_file_and_for_standard_output() {
    let folder = tempfile::tempdir().unwrap();
    let words = ["no space left for the output file", "help: free some space"];
    let render = |output| [&["render", STACK, "--views", "4", "-o", output], &LENS[..]].concat();
    std::os::unix::fs::symlink("/dev/full", folder.path().join("full.exr")).unwrap();
    assert_refused(&run(folder.path(), &render("full.exr")), (RETRY, &words), folder.path(), &["full.exr"]);
    let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let output = thinlens(folder.path(), &render("-")).stdout(full).output().unwrap();
    assert_refused(&output, (RETRY, &words), folder.path(), &["full.exr"]);
}
