//! Pictures with overscan, crops and pixels that are not square.

use super::program::{run, stderr};
use super::stdout;
use exr::image::FlatSamples;
use std::path::Path;
use thinlens::image::Image;
use thinlens::output::exr::{self as writer, ExrOptions};
use thinlens::stack::{Carried, CarriedChannel, Frame, Precision, Window};

/// The display window of the pictures.
const DISPLAY: Window = Window { x: 0, y: 0, width: 24, height: 16 };

/// A lens that blurs nothing.
const SHARP: [&str; 4] = ["--f-number", "inf", "--focus", "3"];

/// Writes a picture at depth 3 to `path`, whose pixels say where they are in the display window.
fn write(path: &Path, data: Window, pixel_aspect: f32) {
    let at = |x: usize, y: usize| {
        let [column, row] = [x as i32 + data.x, y as i32 + data.y].map(|place| place as f32);
        [0.5 + 0.01 * column, 0.5 + 0.01 * row, 0.25, 1.0]
    };
    let picture = Image::from_fn(data.width, data.height, at);
    let samples = FlatSamples::F32(vec![3.0; data.width * data.height]);
    let depth = CarriedChannel { name: "Z".to_owned(), samples, quantize_linearly: false };
    let carried = Carried { channels: vec![depth], attributes: Vec::new() };
    let options = ExrOptions { precision: Precision::Float, codec: writer::Codec::default() };
    writer::write(path, &picture, &Frame { data, display: DISPLAY, pixel_aspect }, &carried, &options)
        .unwrap();
}

fn size(path: &Path) -> (u32, u32) {
    image::image_dimensions(path).unwrap()
}

#[test]
fn pngs_show_the_display_window_of_overscan_and_of_a_crop() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    for (x, y, width, height) in [(-4, -2, 32, 20), (6, 5, 10, 8), (0, 0, 24, 16)] {
        write(&file("in.exr"), Window { x, y, width, height }, 1.0);
        let render = ["render", "in.exr", "-o", "out.png", "--preview", "preview.png"];
        let output = run(folder.path(), &[render.as_slice(), &SHARP].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let is_whole = (width, height) == (24, 16);
        assert_eq!(
            stderr(&output).contains("the PNG shows the display window"),
            !is_whole,
            "{}",
            stderr(&output)
        );
        let inspect = ["inspect", "in.exr", "--overlay", "map.png"];
        stdout(&run(folder.path(), &[inspect.as_slice(), &SHARP].concat()));
        for name in ["out.png", "preview.png", "map.png"] {
            assert_eq!(size(&file(name)), (24, 16), "{name} of {width}×{height}");
        }
        let shown = image::open(file("out.png")).unwrap().into_rgba8();
        // Linear 0.5 + 0.01 · 8 and 0.5 + 0.01 · 6 in sRGB.
        assert_eq!(shown.get_pixel(8, 6).0[..2], [200, 197], "{width}×{height}");
        assert_eq!(shown.get_pixel(0, 0).0[3], if width == 10 { 0 } else { 255 });
    }
}

#[test]
fn a_png_of_pixels_that_are_twice_as_wide_as_high_has_twice_as_many_columns() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    write(&file("in.exr"), DISPLAY, 2.0);
    let output = run(folder.path(), &[["render", "in.exr", "-o", "out.png"].as_slice(), &SHARP].concat());
    assert!(stderr(&output).contains("2 times as wide as high"), "{}", stderr(&output));
    assert_eq!(size(&file("out.png")), (48, 16));
    let output = run(folder.path(), &[["render", "in.exr", "-o", "out.exr"].as_slice(), &SHARP].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let scored = stdout(&run(folder.path(), &["score", "in.exr", "out.exr", "--json"]));
    assert!(scored.contains("\"psnr_db\": 200.0"), "{scored}");
}

#[test]
fn score_compares_the_display_window_of_overscan_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    write(&file("overscan.exr"), Window { x: -4, y: -2, width: 32, height: 20 }, 1.0);
    write(&file("whole.exr"), DISPLAY, 1.0);
    for other in ["overscan.exr", "whole.exr"] {
        let output = run(folder.path(), &["score", "overscan.exr", other, "--json"]);
        let json: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
        let window = serde_json::json!({ "x": 4, "y": 2, "width": 24, "height": 16 });
        assert_eq!((&json["psnr_db"], &json["compared"]), (&200.0.into(), &window), "{other}");
        let said = "24×16 pixels that both pictures show of the display window, from column 4 and row 2 on";
        assert!(stderr(&output).contains(said), "{}", stderr(&output));
    }
}

#[test]
fn default_focus_finds_content_that_has_left_the_middle() {
    let folder = tempfile::tempdir().unwrap();
    write(&folder.path().join("in.exr"), Window { x: 0, y: 0, width: 8, height: 5 }, 1.0);
    let output = run(folder.path(), &["render", "in.exr", "-o", "out.exr", "--views", "4"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let text = stderr(&output);
    let said =
        "nothing is at the centre of the picture, 12, 8: focused at 3, on what is nearest to it, at 7, 4";
    assert!(text.contains(said) && text.contains("--focus-at"), "{text}");
    let outside = run(folder.path(), &["render", "in.exr", "-o", "out.exr", "--focus-at", "9,2"]);
    let text = stderr(&outside);
    assert!(
        text.contains("24 × 16 pixels") && text.contains("0 to 8 from the left, 0 to 5 from the top"),
        "{text}"
    );
}
