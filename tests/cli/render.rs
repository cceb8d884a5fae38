//! `thinlens render` and `thinlens demo`: pictures, masks and reports.

use super::program::{STACK, names, run, stderr};
use super::stdout;
use std::fs;
use std::path::Path;
use thinlens::image::Image;
use thinlens::output::exr::{self, ExrOptions};
use thinlens::stack::{Carried, Frame, Precision, Window, read_picture};

#[test]
fn the_demo_requires_no_files_and_prints_its_psnr() {
    let folder = tempfile::tempdir().unwrap();
    let text = stdout(&run(folder.path(), &["demo"]));
    assert!(text.contains("PSNR") && text.contains("wrote "), "{text}");
    let demo = folder.path().join("thinlens-demo");
    assert_eq!(names(&demo), ["report.json", "side-by-side.png", "terrace.exr", "terrace.png"]);
    let report = fs::read_to_string(demo.join("report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    for key in ["version", "input", "output", "method", "lens", "plan", "seconds", "views", "warnings"] {
        assert!(!report[key].is_null(), "{key}: {report}");
    }
    assert_eq!(report["device"]["kind"], "cpu");
}

#[test]
fn a_render_writes_its_output_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let output = run(folder.path(), &["render", STACK, "-o", "out.exr", "--focus", "6", "--views", "4"]);
    assert_eq!(stdout(&output), "");
    assert!(stderr(&output).contains("method: "), "{}", stderr(&output));
    assert_eq!(names(folder.path()), ["out.exr"]);
}

#[test]
fn a_render_with_json_prints_its_report_and_the_origin_of_every_value() {
    let folder = tempfile::tempdir().unwrap();
    let arguments =
        ["render", STACK, "-o", "out.png", "--preset", "portrait", "--focus", "6", "--views", "4", "--json"];
    let report: serde_json::Value = serde_json::from_str(&stdout(&run(folder.path(), &arguments))).unwrap();
    assert_eq!(report["lens"]["f_number"]["origin"]["name"], "portrait");
    assert_eq!(report["lens"]["focus"]["origin"]["from"], "flag");
    assert_eq!(report["lens"]["metres_per_unit"]["origin"]["from"], "default");
    assert_eq!(report["views"], 4);
}

#[test]
fn an_existing_output_survives_a_failed_render_and_is_replaced_by_a_successful_one() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.exr");
    fs::write(&out, "precious").unwrap();
    let arguments = ["render", STACK, "-o", "out.exr", "--views", "4"];
    let failed = run(folder.path(), &[&arguments[..], &["--focus", "0.001"]].concat());
    assert_eq!(failed.status.code(), Some(2));
    assert_eq!(fs::read(&out).unwrap(), b"precious");
    assert_eq!(run(folder.path(), &[&arguments[..], &["--focus", "6"]].concat()).status.code(), Some(0));
    assert_eq!(fs::read(&out).unwrap()[..4], [0x76, 0x2f, 0x31, 0x01]);
    assert_eq!(names(folder.path()), ["out.exr"]);
}

#[test]
fn output_to_a_dash_is_an_exr_on_standard_output() {
    let folder = tempfile::tempdir().unwrap();
    let output = run(folder.path(), &["render", STACK, "-o", "-", "--focus", "6", "--views", "4"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert_eq!(output.stdout[..4], [0x76, 0x2f, 0x31, 0x01]);
    assert_eq!(names(folder.path()), [""; 0]);
}

#[test]
fn the_number_of_threads_does_not_change_a_bit() {
    let folder = tempfile::tempdir().unwrap();
    for threads in ["1", "3"] {
        let out = format!("{threads}.exr");
        let arguments = ["render", STACK, "-o", &out, "--focus", "6", "--views", "4", "--threads", threads];
        assert_eq!(run(folder.path(), &arguments).status.code(), Some(0));
    }
    let read = |name: &str| fs::read(folder.path().join(name)).unwrap();
    assert!(read("1.exr") == read("3.exr"), "1 and 3 threads differ");
}

#[test]
fn a_confidence_mask_is_the_share_of_light_from_surfaces_in_the_stack() {
    let folder = tempfile::tempdir().unwrap();
    let pinhole = Path::new(STACK).with_file_name("pinhole.exr").display().to_string();
    let render = |stack: &str, method: &str, mask: &str| {
        let lens = ["--preset", "portrait", "--focus", "6", "--views", "32", "--json", "--confidence", mask];
        run(folder.path(), &[&["render", stack, "-o", "out.exr", "--method", method], &lens[..]].concat())
    };
    let mean = |stack: &str, mask: &str| {
        let output = render(stack, "shear", mask);
        let json: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
        assert_eq!(json["confidence"]["file"], mask, "{}", stderr(&output));
        json["confidence"]["mean"].as_f64().unwrap()
    };
    let [four_peels, one_peel] = [mean(STACK, "known.png"), mean(&pinhole, "guessed.exr")];
    assert!(four_peels > 0.999 && one_peel < 0.97, "{four_peels} and {one_peel}");
    let mask = image::open(folder.path().join("known.png")).unwrap();
    assert_eq!((mask.color(), mask.width()), (image::ColorType::L8, 320));
    assert_eq!(names(folder.path()), ["guessed.exr", "known.png", "out.exr"]);

    let refused = run(
        folder.path(),
        &["render", STACK, "-o", "no.exr", "--method", "scatter", "--confidence", "no.png"],
    );
    assert!(stderr(&refused).contains("scatter cannot measure"), "{}", stderr(&refused));
    let nowhere = render(STACK, "shear", "-");
    assert!(
        stderr(&nowhere).contains("the confidence mask cannot be written to standard output"),
        "{}",
        stderr(&nowhere)
    );
    let twice = render(STACK, "shear", "out.exr");
    assert!(stderr(&twice).contains("two outputs"), "{}", stderr(&twice));
    assert_eq!(names(folder.path()), ["guessed.exr", "known.png", "out.exr"], "nothing more is written");
}

#[test]
fn a_render_can_measure_its_sampling_error() {
    let folder = tempfile::tempdir().unwrap();
    let output = run(folder.path(), &["render", STACK, "-o", "a.exr", "--verify", "60", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert!(json["probe"]["interval_db"][0].as_f64().is_some(), "{json}");
    assert!(stderr(&output).contains("sampling error: "), "{}", stderr(&output));
    let few = run(folder.path(), &["render", STACK, "-o", "b.exr", "--verify", "3"]);
    assert_eq!(few.status.code(), Some(2), "three probes are too few");
}

#[test]
fn a_parameter_of_the_method_can_be_set_by_a_flag() {
    let folder = tempfile::tempdir().unwrap();
    let render = ["render", STACK, "--method", "scatter", "--report", "r.json", "-o", "a.exr"];
    let set = run(folder.path(), &[render.as_slice(), &["--set", "saturation=0.5"]].concat());
    assert!(set.status.success(), "{}", stderr(&set));
    let report: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(folder.path().join("r.json")).unwrap()).unwrap();
    assert_eq!(report["plan"]["parameters"]["saturation"], 0.5);
    let wrong = run(folder.path(), &[render.as_slice(), &["--set", "saturatoin=0.5"]].concat());
    assert!(stderr(&wrong).contains("did you mean 'saturation'?"), "{}", stderr(&wrong));
}

#[test]
fn a_picture_in_focus_is_unchanged_bit_for_bit_as_half_and_as_float() {
    const SIZE: usize = 37;
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    let depth = image::ImageBuffer::from_fn(SIZE as u32, SIZE as u32, |x, y| {
        image::Luma([((x * 7 + y * 13) % 5) as u16 * 10_000])
    });
    depth.save(file("depth.png")).unwrap();
    let mut random = fastrand::Rng::with_seed(1);
    let pixel = || {
        let alpha = if random.bool() { 1.0 } else { random.f32() };
        let [r, g, b] = std::array::from_fn(|_| alpha * random.f32() * 10_f32.powi(random.i32(-6..4)));
        [r, g, b, alpha]
    };
    let values: Vec<[f32; 4]> = std::iter::repeat_with(pixel).take(SIZE * SIZE).collect();
    let picture = Image::from_fn(SIZE, SIZE, |x, y| values[y * SIZE + x]);
    let window = Window { x: 0, y: 0, width: SIZE, height: SIZE };
    let frame = Frame { data: window, display: window, pixel_aspect: 1.0 };
    for precision in [Precision::Half, Precision::Float] {
        let options = ExrOptions { precision, codec: exr::Codec::default() };
        exr::write(&file("in.exr"), &picture, &frame, &Carried::default(), &options).unwrap();
        let lens = ["--depth-convention", "normalised", "--near", "5", "--far", "5.1", "--focus", "5.05"];
        let files = ["render", "in.exr", "--depth-file", "depth.png", "-o", "out.exr", "--report", "r.json"];
        let output = run(folder.path(), &[files.as_slice(), &lens].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let report: serde_json::Value = serde_json::from_slice(&fs::read(file("r.json")).unwrap()).unwrap();
        assert_eq!(report["plan"]["effects"][0]["on"], false, "nothing is blurred: {report}");
        let (before, after) =
            (read_picture(&file("in.exr")).unwrap(), read_picture(&file("out.exr")).unwrap());
        assert!(before == after, "{precision:?}");
        assert_eq!(precision == Precision::Float, after == picture, "half represents fewer values");
    }
}
