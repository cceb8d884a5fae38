//! Flags and preset keys of the lens and of the border.

use super::program::{STACK, run, stderr};
use super::stdout;
use std::fs;
use thinlens::stack::read_picture;

#[test]
fn the_border_is_reported_and_affects_only_the_edge_of_the_frame() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    let lens = ["--preset", "portrait", "--focus", "6", "--views", "64"];
    let picture = |border: &[&str], output: &str| {
        let files =
            ["render", STACK, "-o", output, "--report", "r.json", "--confidence", "known.exr", "--verify"];
        let output_of = run(folder.path(), &[files.as_slice(), &lens, border].concat());
        assert_eq!(output_of.status.code(), Some(0), "{}", stderr(&output_of));
        let report: serde_json::Value = serde_json::from_slice(&fs::read(file("r.json")).unwrap()).unwrap();
        (read_picture(&file(output)).unwrap(), read_picture(&file("known.exr")).unwrap(), report)
    };
    let (own, _, report) = picture(&[], "own.exr");
    assert_eq!(report["picture"]["border"]["value"], "clamp");
    let (clamped, ..) = picture(&["--border", "clamp"], "clamped.exr");
    assert!(clamped == own, "clamp is the default, bit for bit");
    for border in ["mirror", "transparent"] {
        let (found, known, report) = picture(&["--border", border], "found.exr");
        assert_eq!((found.width(), found.height()), (own.width(), own.height()), "{border}");
        assert_eq!((known.width(), known.height()), (own.width(), own.height()), "{border}");
        assert_eq!(report["picture"]["border"]["value"], border);
        assert_eq!(report["picture"]["border"]["origin"]["from"], "flag");
        let findings = report["findings"].as_array().unwrap();
        assert!(findings.iter().any(|finding| finding["about"] == "border"), "{findings:?}");
        let min_db = report["probe"]["interval_db"][0].as_f64().unwrap();
        assert!(min_db > 30.0, "the expected colours include the border: {min_db} dB");
        let off = |x, y| {
            let pairs = own.pixel(x, y).into_iter().zip(found.pixel(x, y));
            pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
        };
        let (x, y) = (own.width() / 2, own.height() / 2);
        assert!(off(x, y) < 0.01, "{border}: {} at the centre", off(x, y));
        assert_eq!(found.pixel(0, y)[3] < 0.95, border == "transparent", "{border}: {:?}", found.pixel(0, y));
    }
}

#[test]
fn a_presets_border_and_extrapolation_are_printed_with_their_origin() {
    let folder = tempfile::tempdir().unwrap();
    let preset = "[picture]\nborder = 'mirror'\n[highlight-extrapolation]\ngain = 4\n";
    fs::write(folder.path().join("mine.toml"), preset).unwrap();
    let text = stdout(&run(folder.path(), &["inspect", STACK, "--preset", "mine.toml", "--focus", "6"]));
    let line = |name: &str| text.lines().find(|line| line.trim_start().starts_with(name)).unwrap().to_owned();
    assert!(
        text.lines().any(|line| line.contains("mirror  ") && line.contains("preset mine.toml")),
        "{text}"
    );
    assert!(line("gain").contains('4') && line("gain").contains("preset mine.toml"), "{text}");
    assert!(line("falloff").contains('3') && line("falloff").contains("default"), "{text}");
    assert!(line("highlight-extrapolation").contains("off  the source is scene-linear"), "{text}");
}

#[test]
fn the_blurred_highlights_of_a_png_are_extrapolated_unless_that_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    let light = |x, y| if (x, y) == (24, 16) { [255; 3] } else { [40; 3] };
    image::RgbImage::from_fn(48, 32, |x, y| image::Rgb(light(x, y))).save(file("in.png")).unwrap();
    image::ImageBuffer::from_pixel(48, 32, image::Luma([30_000_u16])).save(file("depth.png")).unwrap();
    let sum = |flags: &[&str]| {
        let files = ["render", "in.png", "--depth-file", "depth.png", "-o", "out.exr", "--method", "scatter"];
        let lens = [
            "--depth-convention",
            "normalised",
            "--near",
            "1",
            "--far",
            "9",
            "--focus",
            "3",
            "--f-number",
            "0.05",
        ];
        let output = run(folder.path(), &[files.as_slice(), &lens, flags].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let picture = read_picture(&file("out.exr")).unwrap();
        picture.planes[1].values().iter().sum::<f32>()
    };
    let (gained, clipped) = (sum(&[]), sum(&["--without", "highlight-extrapolation"]));
    // The light is one white pixel, and extrapolation adds as much again, up to the precision of half floats.
    assert!((gained - clipped - 1.0).abs() < 0.05, "{gained} and {clipped}");
}

#[test]
fn the_aberrations_of_a_preset_are_printed_and_its_aperture_image_is_found_beside_it() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("lenses")).unwrap();
    let light = |x: u32, _| image::Luma([if x < 16 { 255_u8 } else { 0 }]);
    image::ImageBuffer::from_fn(32, 32, light).save(folder.path().join("lenses/half.png")).unwrap();
    let preset = "[aperture]\nimage = 'half.png'\ncats_eye = 0.5\n[aberrations]\nspherical_um = -90\n";
    fs::write(folder.path().join("lenses/mine.toml"), preset).unwrap();
    let flags =
        ["inspect", STACK, "--preset", "lenses/mine.toml", "--focus", "6", "--axial-color", "-30,45.5"];
    let text = stdout(&run(folder.path(), &flags));
    for (name, value, from) in [
        ("aperture image", "lenses/half.png", "preset lenses/mine.toml"),
        ("cat's eye", "0.5 aperture radii", "preset lenses/mine.toml"),
        ("spherical", "-90 µm", "preset lenses/mine.toml"),
        ("axial colour", "red -30, blue 45.5 µm", "flag"),
        ("lateral colour", "red 0, blue 0 µm", "default"),
        ("vignetting", "0", "default"),
    ] {
        let shown =
            |line: &str| line.trim_start().starts_with(name) && line.contains(value) && line.ends_with(from);
        assert!(text.lines().any(shown), "{name} {value} {from}:\n{text}");
    }
    let decided = |name: &str| {
        text.lines().find(|line| line.contains(&format!("{name}  "))).unwrap_or_default().to_owned()
    };
    assert!(decided("aperture-image").contains("50 % of the light"), "{}", decided("aperture-image"));
}

#[test]
fn an_impossible_lens_is_refused_with_the_setting_that_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |flags: &[&str]| {
        let output = run(folder.path(), &[&["plan", STACK, "--focus", "6"], flags].concat());
        assert_ne!(output.status.code(), Some(0), "{flags:?}");
        stderr(&output)
    };
    assert!(refused(&["--aperture-image", "none.png"]).contains("none.png"));
    assert!(refused(&["--cats-eye", "2"]).contains("--cats-eye must be a number from 0 to 1.2"));
    assert!(refused(&["--spherical", "nan"]).contains("--spherical must be a number from -5000 to 5000"));
    assert!(refused(&["--lateral-color", "1,1e9"]).contains("--lateral-color must be two numbers from"));
    assert!(refused(&["--axial-color", "7"]).contains("two numbers separated by a comma"));
    fs::write(folder.path().join("black.png"), b"not a picture").unwrap();
    assert!(refused(&["--aperture-image", "black.png"]).contains("not a picture"));
    image::GrayImage::new(8, 8).save(folder.path().join("black.png")).unwrap();
    assert!(refused(&["--aperture-image", "black.png"]).contains("lets no light through"));
}

#[test]
fn vignetting_and_lateral_color_are_in_the_file_with_every_method() {
    let folder = tempfile::tempdir().unwrap();
    let picture = |method: &str, flags: &[&str]| {
        let own =
            ["render", STACK, "-o", "out.exr", "--focus", "6", "--focal-length", "20", "--method", method];
        let output = run(folder.path(), &[own.as_slice(), flags].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        read_picture(&folder.path().join("out.exr")).unwrap()
    };
    for method in ["scatter", "shear"] {
        let plain = picture(method, &[]);
        let dark = picture(method, &["--vignetting", "1"]);
        // 20 mm before 36 mm are 177.8 px before 320; the corner's pixel is 159.5 px and 89.5 px from the axis.
        let tangent = 159.5f32.hypot(89.5) / 177.78;
        let expected = (1.0 + tangent * tangent).powi(-2);
        let ratio = dark.pixel(0, 0)[1] / plain.pixel(0, 0)[1];
        assert!((ratio - expected).abs() < 1e-3, "{method}: {ratio}, expected {expected}");
        assert_eq!(dark.pixel(0, 0)[3], plain.pixel(0, 0)[3], "{method}: alpha is not light");
        let fringed = picture(method, &["--lateral-color", "225,0"]);
        // 225 µm are 2 px in the corner, and nothing on the axis.
        assert_eq!(fringed.planes[1..3], plain.planes[1..3], "{method}: green and blue stay");
        let moved = |x, y| (fringed.pixel(x, y)[0] - plain.pixel(x, y)[0]).abs();
        let near = (150..170).map(|x| moved(x, 90)).fold(0.0, f32::max);
        let far = (0..40).map(|x| moved(x, 10)).fold(0.0, f32::max);
        assert!(
            near < 0.05 && far > 0.1,
            "{method}: red moved by {near} on the axis, {far} beside the corner"
        );
    }
}
