//! `thinlens inspect`.

use super::program::{STACK, names, run, stderr};
use super::stdout;

#[test]
fn inspect_shows_what_a_render_would_do() {
    let folder = tempfile::tempdir().unwrap();
    let text = stdout(&run(folder.path(), &["inspect", STACK, "--preset", "portrait", "--focus", "6"]));
    for words in
        ["peels                   4", "85 mm", "preset portrait", "6 depth units", "CoC radius", "method"]
    {
        assert!(text.contains(words), "{words}: {text}");
    }
    let json = stdout(&run(folder.path(), &["inspect", STACK, "--focus", "6", "--json"]));
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["stack"]["peels"], 4);
    assert_eq!(json["stack"]["convention"], "planar");
}

#[test]
fn inspect_shows_the_shares_of_point_samples_and_coverage_which_a_flag_overrules() {
    let folder = tempfile::tempdir().unwrap();
    let inspect = |more: &[&str]| stdout(&run(folder.path(), &[&["inspect", STACK], more].concat()));
    let found = inspect(&[]);
    assert!(found.contains("point samples 100.0 %, coverage 0.0 %: silhouettes are hard"), "{found}");
    assert!(found.contains("--kind overrules it"), "{found}");
    let json: serde_json::Value = serde_json::from_str(&inspect(&["--kind", "coverage", "--json"])).unwrap();
    assert_eq!((&json["stack"]["kind"], &json["stack"]["antialiased"]), (&"coverage".into(), &1.0.into()));
    let refused = stderr(&run(folder.path(), &["inspect", STACK, "--kind", "supersampled"]));
    assert!(refused.contains("--supersample"), "{refused}");
}

#[test]
fn inspect_prints_the_limits_of_sharpness_and_writes_the_focus_zones() {
    let folder = tempfile::tempdir().unwrap();
    let inspect = |more: &[&str]| {
        let lens = ["inspect", STACK, "--preset", "portrait", "--focus", "6", "--json"];
        run(folder.path(), &[&lens, more].concat())
    };
    let output = inspect(&["--overlay", "focus.png"]);
    assert!(stderr(&output).contains("wrote focus.png"), "{}", stderr(&output));
    let picture = image::open(folder.path().join("focus.png")).unwrap();
    assert_eq!((picture.width(), picture.height()), (320, 180));
    let json: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
    let [near, far] = ["near_limit", "far_limit"].map(|limit| json["sharpness"][limit].as_f64().unwrap());
    assert!(near < 6.0 && 6.0 < far, "{near} … {far}");
    let shares = ["in_front", "in_focus", "behind", "empty"].map(|zone| json["focus_shares"][zone].as_f64());
    assert!((shares.into_iter().flatten().sum::<f64>() - 1.0).abs() < 1e-9, "{shares:?}");
    let refused = inspect(&["--overlay", "focus.exr"]);
    assert!(stderr(&refused).contains("PNG only"), "{}", stderr(&refused));
    assert_eq!(names(folder.path()), ["focus.png"]);
}

#[test]
fn inspect_prints_how_many_peels_the_lens_sees() {
    let folder = tempfile::tempdir().unwrap();
    let inspect = |more: &[&str]| {
        let lens = ["inspect", STACK, "--preset", "portrait", "--focus", "6"];
        stdout(&run(folder.path(), &[&lens, more].concat()))
    };
    let text = inspect(&[]);
    assert!(text.contains("peels needed            3 of 4") && text.contains("export 3"), "{text}");
    let json: serde_json::Value = serde_json::from_str(&inspect(&["--json"])).unwrap();
    let psnr_db: Vec<f64> = (0..2).filter_map(|k| json["peels_seen"]["psnr_db"][k].as_f64()).collect();
    assert!(psnr_db[0] < psnr_db[1] && psnr_db[1] < 50.0, "{json}");
    assert!(!inspect(&["--f-number", "inf"]).contains("peels needed"), "a pinhole sees only the first peel");
}
