//! `thinlens score` and `thinlens compare`.

use super::program::{STACK, run, stderr};
use super::stdout;
use std::fs;
use std::path::Path;
use thinlens::image::Image;
use thinlens::output::exr::{self, ExrOptions};
use thinlens::stack::{Carried, Frame, Precision, Window, read_picture};

/// Writes the part of `picture` in `data`, whose pixels are those of its display window, to `path`.
fn write_part(path: &Path, picture: &Image, data: Window) {
    let display = Window { x: 0, y: 0, width: picture.width(), height: picture.height() };
    let frame = Frame { data, display, pixel_aspect: 1.0 };
    let from = [data.x, data.y].map(|start| start.unsigned_abs() as usize);
    let part = picture.clone().part(from, (data.width, data.height));
    let options = ExrOptions { precision: Precision::Float, codec: exr::Codec::default() };
    exr::write(path, &part, &frame, &Carried::default(), &options).unwrap();
}

#[test]
fn a_picture_scored_against_itself_has_no_error() {
    let folder = tempfile::tempdir().unwrap();
    let picture = concat!(env!("CARGO_MANIFEST_DIR"), "/samples/fence/reference.exr");
    let text = stdout(&run(folder.path(), &["score", picture, picture]));
    assert!(text.contains("PSNR          200.00 dB"), "{text}");
}

#[test]
fn a_pixel_that_is_no_number_counts_as_black_against_white_and_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let window = Window { x: 0, y: 0, width: 40, height: 25 };
    let mut picture = Image::from_fn(40, 25, |x, _| [0.5, 0.01 * x as f32, 0.2, 1.0]);
    write_part(&folder.path().join("whole.exr"), &picture, window);
    picture.planes[0].set(7, 3, f32::NAN);
    picture.planes[1].set(39, 24, f32::INFINITY);
    write_part(&folder.path().join("broken.exr"), &picture, window);
    // Two pixels of a thousand have an error of 1.
    for pair in [["broken.exr", "broken.exr"], ["broken.exr", "whole.exr"], ["whole.exr", "broken.exr"]] {
        let output = run(folder.path(), &["score", pair[0], pair[1], "--json"]);
        let json: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
        assert!((json["psnr_db"].as_f64().unwrap() - 10.0 * 500_f64.log10()).abs() < 0.01, "{json}");
        assert_eq!(json["broken_pixels"], 2);
        let said = stderr(&output);
        assert!(
            said.contains("broken.exr: 1 colour values were NaN, set to 0; 1 colour values were infinite"),
            "{said}"
        );
    }
}

#[test]
fn score_can_measure_hdr_flip_and_write_a_map_of_flip() {
    let folder = tempfile::tempdir().unwrap();
    let sample = |name: &str| format!("{}/samples/fence/{name}.exr", env!("CARGO_MANIFEST_DIR"));
    let (image, reference) = (sample("pinhole"), sample("reference"));
    let output =
        run(folder.path(), &["score", &image, &reference, "--hdr-flip", "--map", "map.png", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert!(json["flip"].as_f64().unwrap() > 0.3 && json["hdr_flip"].as_f64().unwrap() > 0.3, "{json}");
    let map = image::open(folder.path().join("map.png")).unwrap();
    assert_eq!((map.width(), map.height()), (320, 180));
    let onto_input = run(folder.path(), &["score", &image, &reference, "--map", &image]);
    assert!(stderr(&onto_input).contains("one of the inputs"), "{}", stderr(&onto_input));
}

#[test]
fn pictures_with_different_data_windows_are_scored_where_both_have_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let picture = Image::from_fn(96, 80, |x, y| [x as f32 / 96.0, y as f32 / 80.0, 0.5, 1.0]);
    let parts = [(0, 0, 90, 70), (10, 8, 86, 72), (90, 0, 6, 80)];
    for (number, (x, y, width, height)) in parts.into_iter().enumerate() {
        let path = folder.path().join(format!("{number}.exr"));
        write_part(&path, &picture, Window { x, y, width, height });
    }
    let output = run(folder.path(), &["score", "0.exr", "1.exr", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!(json["psnr_db"], 200.0, "both show the same picture there");
    let window = serde_json::json!({ "x": 10, "y": 8, "width": 80, "height": 62 });
    assert_eq!(json["compared"], window);
    assert!(stderr(&output).contains("80×62 pixels that both pictures show"), "{}", stderr(&output));
    let apart = run(folder.path(), &["score", "0.exr", "2.exr"]);
    assert_ne!(apart.status.code(), Some(0));
    assert!(stderr(&apart).contains("different parts of the frame"), "{}", stderr(&apart));
}

#[test]
fn compare_measures_against_a_reference_of_a_part_of_the_frame_there() {
    let folder = tempfile::tempdir().unwrap();
    let sample = |name: &str| format!("{}/samples/fence/{name}", env!("CARGO_MANIFEST_DIR"));
    let (x, y, width, height) = (100, 50, 128, 96);
    let whole = read_picture(Path::new(&sample("reference.exr"))).unwrap();
    write_part(&folder.path().join("part.exr"), &whole, Window { x, y, width, height });
    let common = [STACK, "--preset", &sample("preset.toml")];
    let measured =
        ["--methods", "shear:16", "--repeats", "1", "--probes", "60", "--reference", "part.exr", "--json"];
    let output = run(folder.path(), &[["compare"].as_slice(), &common, &measured].concat());
    let json: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!(json["compared"], serde_json::json!({ "x": x, "y": y, "width": width, "height": height }));
    let rendered = ["--views", "16", "-o", "out.exr", "--precision", "float"];
    let output = run(folder.path(), &[["render"].as_slice(), &common, &rendered].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let scored = stdout(&run(folder.path(), &["score", "out.exr", "part.exr", "--json"]));
    let scored: serde_json::Value = serde_json::from_str(&scored).unwrap();
    let [compared, scored] =
        [&json["entries"][0]["model"]["psnr_db"], &scored["psnr_db"]].map(|db| db.as_f64().unwrap());
    assert!((compared - scored).abs() < 0.01, "{compared} and {scored} dB");
}

#[test]
fn compare_measures_methods_on_one_stack_and_marks_those_on_the_front() {
    let folder = tempfile::tempdir().unwrap();
    let sample = |name: &str| format!("{}/samples/fence/{name}", env!("CARGO_MANIFEST_DIR"));
    let (preset, reference) = (sample("preset.toml"), sample("reference.exr"));
    let common = ["compare", STACK, "--preset", &preset, "--repeats", "1", "--probes", "60"];
    let measured = ["--methods", "shear:16,opaque-blur", "--reference", &reference, "-o", "out", "--json"];
    let output = run(folder.path(), &[common.as_slice(), &measured].concat());
    let json: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
    let entries = &json["entries"];
    assert_eq!((&entries[0]["method"], &entries[0]["views"]), (&"shear".into(), &16.into()));
    assert!(entries[1]["views"].is_null(), "opaque-blur does not sample the lens");
    let db = |entry: usize| entries[entry]["model"]["psnr_db"].as_f64().unwrap();
    assert!(
        db(0) > db(1) + 5.0 && entries[0]["on_front"] == true,
        "only peels have the surfaces behind the fence"
    );
    let files = [
        "shear-16.png",
        "shear-16-flip.png",
        "opaque-blur.png",
        "results.json",
        "results.csv",
        "report.html",
    ];
    for file in files {
        assert!(folder.path().join("out").join(file).is_file(), "{file}");
    }
    let read = |file: &str| fs::read_to_string(folder.path().join("out").join(file)).unwrap();
    assert_eq!(serde_json::from_str::<serde_json::Value>(&read("results.json")).unwrap(), json);
    assert_eq!(read("results.csv").lines().count(), 3);

    let table = stdout(&run(folder.path(), &[common.as_slice(), &["--methods", "scatter"]].concat()));
    assert!(table.contains("* scatter"), "alone it is on the front: {table}");
    let small = folder.path().join("small.png");
    image::GrayImage::new(3, 2).save(&small).unwrap();
    let other_size = run(folder.path(), &[common.as_slice(), &["--reference", "small.png"]].concat());
    assert!(stderr(&other_size).contains("the pictures differ in size"), "{}", stderr(&other_size));
    let unknown = run(folder.path(), &[common.as_slice(), &["--methods", "sheer"]].concat());
    assert!(stderr(&unknown).contains("did you mean 'shear'?"), "{}", stderr(&unknown));
}

#[test]
fn a_comparison_has_its_inputs_and_commands_that_render_its_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let preset = concat!(env!("CARGO_MANIFEST_DIR"), "/samples/fence/preset.toml");
    let lens = ["--preset", preset, "--f-number", "4", "--blades", "5"];
    let rest =
        ["--methods", "scatter:saturation=0.5", "--repeats", "2", "--probes", "60", "-o", "my out", "--json"];
    let switches = ["--force", "open-background", "--without", "fill,highlights"];
    let output = run(folder.path(), &[["compare", STACK].as_slice(), &lens, &switches, &rest].concat());
    let json: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert!(json["command"].as_str().unwrap().ends_with("-o 'my out' --json"), "{}", json["command"]);
    assert_eq!((&json["stack"]["peels"], &json["lens"]["f_number"]["value"]), (&4.into(), &4.0.into()));
    assert!(json["machine"]["threads"].as_u64().unwrap() > 0);
    let entry = &json["entries"][0];
    assert_eq!(json["yardstick"]["name"], entry["name"], "the only entry is the best one");
    assert_eq!((entry["runs"].as_array().unwrap().len(), &entry["map"]), (2, &serde_json::Value::Null));
    let (blur, whole) = (&entry["cpu_seconds"], &entry["whole"]["cpu_seconds"]);
    let shared = json["prepared"]["cpu_seconds"].as_f64().unwrap();
    assert!((blur.as_f64().unwrap() + shared - whole.as_f64().unwrap()).abs() < 1e-9);

    let command = entry["command"].as_str().unwrap();
    assert!(command.ends_with("-o scatter-saturation-0.5.exr"), "{command}");
    assert!(command.contains("--force open-background --without fill,highlights"), "{command}");
    let words: Vec<&str> = command.split(' ').skip(1).collect();
    let (_, words) = words.split_last().unwrap();
    run(folder.path(), &[words, &["again.png"]].concat());
    let picture = folder.path().join("my out").join(entry["picture"].as_str().unwrap());
    let [again, picture] =
        [folder.path().join("again.png"), picture].map(|path| read_picture(&path).unwrap());
    assert!(again == picture, "the same pixels; the texts of the two files differ");
}
