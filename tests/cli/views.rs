//! `--view`: one view of a stereo file, or each.

use super::program::{names, run, stderr};
use super::stdout;
use std::path::Path;
use thinlens::stack::read_picture;

/// Left and right views of one grey and one depth each, of 8 × 8 pixels, as `stereo.exr` in `folder`.
fn write_stereo(folder: &Path) {
    use exr::prelude::*;
    let channel = |name: &str, value: f32| AnyChannel::new(name, FlatSamples::F32(vec![value; 64]));
    let view = |prefix: &str, grey: f32, depth: f32| {
        let colors = ["R", "G", "B"].map(|name| channel(&format!("{prefix}{name}"), grey));
        colors.into_iter().chain([channel(&format!("{prefix}Z"), depth)]).collect::<Vec<_>>()
    };
    let channels = [view("left.", 0.25, 3.0), view("right.", 0.75, 4.0)].concat();
    let views = Some(vec![Text::from("left"), Text::from("right")]);
    let attributes = LayerAttributes { multi_view_names: views, ..LayerAttributes::default() };
    let layer = Layer::new((8, 8), attributes, Encoding::FAST_LOSSLESS, AnyChannels::sort(channels.into()));
    Image::from_layer(layer).write().to_file(folder.join("stereo.exr")).unwrap();
}

fn grey(path: &Path) -> f32 {
    read_picture(path).unwrap().pixel(4, 4)[0]
}

#[test]
fn each_view_gets_a_file_and_the_focus_of_the_first() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    write_stereo(folder.path());
    let render = |arguments: &[&str]| {
        run(folder.path(), &[&["render", "stereo.exr", "--views", "2"], arguments].concat())
    };
    let refused = render(&["-o", "out.exr"]);
    assert_eq!(refused.status.code(), Some(4), "{}", stderr(&refused));
    assert!(
        stderr(&refused).contains("--view left") && stderr(&refused).contains("--view all"),
        "{}",
        stderr(&refused)
    );
    stdout(&render(&["-o", "out.exr", "--view", "all", "--report", "report.json"]));
    assert_eq!(
        names(folder.path()),
        ["out.left.exr", "out.right.exr", "report.left.json", "report.right.json", "stereo.exr"]
    );
    assert_eq!([grey(&at("out.left.exr")), grey(&at("out.right.exr"))], [0.25, 0.75]);
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(at("report.right.json")).unwrap()).unwrap();
    assert!(report.to_string().contains("\"focus_distance\":3.0"), "the left view's: {report}");
    stdout(&render(&["-o", "one.exr", "--view", "right"]));
    assert_eq!(grey(&at("one.exr")), 0.75);
    stdout(&render(&["-o", "%v_%V.exr", "--view", "all"]));
    assert_eq!([grey(&at("l_left.exr")), grey(&at("r_right.exr"))], [0.25, 0.75]);
    stdout(&render(&["-o", "only.%V.exr", "--view", "left"]));
    assert_eq!(grey(&at("only.left.exr")), 0.25);
}

#[test]
fn all_views_need_files_and_a_stereo_picture() {
    let folder = tempfile::tempdir().unwrap();
    write_stereo(folder.path());
    let text =
        |arguments: &[&str]| stderr(&run(folder.path(), &[&["render", "--view", "all"], arguments].concat()));
    assert!(text(&["stereo.exr", "-o", "-"]).contains("room for one view"));
    assert!(text(&[super::program::STACK, "-o", "out.exr"]).contains("the file has one view"));
    assert!(
        text(&["stereo.####.exr", "--frames", "1-2", "-o", "out.####.exr"]).contains("for a single frame")
    );
}
