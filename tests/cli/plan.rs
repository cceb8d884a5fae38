//! `thinlens plan`, and targets for the number of lens samples.

use super::program::{STACK, names, run, stderr, thinlens};
use super::stdout;
use std::fs;
use std::path::Path;
use std::process::Output;
use thinlens::methods::METHODS;

/// Runs `plan` on the sample stack, with its calibration stored in `cache`.
fn plan(folder: &Path, cache: &str, arguments: &[&str]) -> Output {
    let stack = ["plan", STACK, "--preset", "portrait", "--focus", "6"];
    thinlens(folder, &[&stack, arguments].concat()).env("THINLENS_CACHE_DIR", cache).output().unwrap()
}

#[test]
fn plan_prints_the_effects_and_the_cost_of_every_quality_level() {
    let folder = tempfile::tempdir().unwrap();
    let text = stdout(&plan(folder.path(), "cache", &["--views", "48", "--uncalibrated"]));
    for words in [
        "method                  shear",
        "highlights              off",
        "device                  ",
        "on the CPU",
        "* shear:48 ",
        "  shear:256 ",
        "not calibrated",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
    assert!(!text.contains("gather"), "only the chosen method: {text}");
    let peels: Vec<&str> = text.lines().skip(1).take_while(|line| line.starts_with("  ")).collect();
    assert!(text.starts_with("peels ") && peels.len() == 4, "one line per peel: {text}");
    assert!(peels[0].starts_with("  1 ") && peels[0].contains(" 100.0 % "), "the first covers all: {text}");
    assert_eq!(names(folder.path()), [""; 0], "without a calibration no file is written");
    let json = stdout(&plan(
        folder.path(),
        "cache",
        &["--json", "--all-methods", "--uncalibrated", "--views", "64"],
    ));
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let covered = |peel: usize| json["peels"][peel]["covered"].as_f64().unwrap();
    assert!(covered(0) == 1.0 && (0.01..0.1).contains(&covered(3)), "{}", json["peels"]);
    let costs = json["costs"].as_array().unwrap();
    let steps: usize = METHODS.iter().map(|method| method.info().steps.len()).sum();
    assert_eq!(costs.len(), steps, "the default is one of the quality levels");
    assert!(costs.iter().all(|cost| cost["cpu_seconds"].as_f64().unwrap() > 0.0), "{json}");
    let error_db = |name: &str| {
        let row = costs.iter().find(|cost| cost["name"] == name).unwrap();
        row["sampling_error"]["psnr_db"].as_f64()
    };
    assert!(error_db("shear:256") > error_db("shear:16"), "{json}");
    assert!(error_db("accumulate:16").is_some_and(|db| (25.0..50.0).contains(&db)), "{json}");
    assert_eq!(error_db("gather:64"), None, "it cannot render single pixels");
    assert!(text.contains(" dB (") && !text.contains("- not measured: "), "{text}");
    let chosen: Vec<_> = costs.iter().filter(|cost| cost["chosen"] == true).collect();
    assert!(chosen.len() == 1 && chosen[0]["name"] == "shear:64", "{chosen:?}");
    assert_eq!((&json["calibrated"], &json["plan"]["views"]), (&false.into(), &64.into()));
    assert!(json["device"]["reason"].is_string(), "{}", json["device"]);
}

#[test]
fn the_error_that_plan_predicts_is_the_error_that_verify_measures_with_disocclusion_fill() {
    let folder = tempfile::tempdir().unwrap();
    let preset = Path::new(STACK).with_file_name("preset.toml").display().to_string();
    let pinhole = Path::new(STACK).with_file_name("pinhole.exr").display().to_string();
    for stack in [STACK, &pinhole] {
        let json = |command: &[&str]| -> serde_json::Value {
            let lens = ["--preset", &preset, "--json"];
            serde_json::from_str(&stdout(&run(folder.path(), &[command, &lens].concat()))).unwrap()
        };
        let plan = json(&["plan", stack, "--uncalibrated", "--views", "64"]);
        let step = plan["costs"].as_array().unwrap().iter().find(|cost| cost["name"] == "shear:64").unwrap();
        let predicted_db = step["sampling_error"]["psnr_db"].as_f64().unwrap();
        let render =
            |flags: &[&str]| json(&[&["render", stack, "-o", "a.exr"], flags].concat())["probe"].clone();
        let verified = render(&["--views", "64", "--verify"]);
        let verified_db = verified["psnr_db"].as_f64().unwrap();
        assert!(
            (predicted_db - verified_db).abs() < 0.01,
            "{stack}: predicted {predicted_db} dB, measured {verified_db}"
        );
        // The search measures fewer pixels with fewer rays.
        let target = (verified_db - 1.0).floor().to_string();
        let found = render(&["--target-db", &target]);
        let found_db = found["psnr_db"].as_f64().unwrap();
        let within = verified_db - 4.0..verified_db + 6.0;
        assert!(within.contains(&found_db), "{stack}: {found}, requested {target} dB");
    }
}

#[test]
fn a_target_is_reached_or_the_report_says_what_was_reached() {
    let folder = tempfile::tempdir().unwrap();
    let report = |flags: &[&str]| {
        let render = ["render", STACK, "--preset", "portrait", "--focus", "6", "-o", "a.exr", "--json"];
        let output = run(folder.path(), &[render.as_slice(), flags].concat());
        let json: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
        (json, stderr(&output))
    };
    let (coarse, _) = report(&["--quality", "draft"]);
    let (fine, _) = report(&["--target-db", "45"]);
    let views = |report: &serde_json::Value| report["views"].as_u64().unwrap();
    assert!(views(&coarse) <= views(&fine), "{} and {} views", coarse["dial"], fine["dial"]);
    assert_eq!(fine["dial"]["met"], true, "{}", fine["dial"]);
    assert!(fine["probe"]["psnr_db"].as_f64().unwrap() >= 45.0, "{}", fine["probe"]);
    let (unmet, said) = report(&["--target-db", "80", "--f-number", "0.7"]);
    assert_eq!(unmet["dial"]["met"], false, "{}", unmet["dial"]);
    assert!(said.contains("warning: views: shear cannot reach 80 dB"), "{said}");
    assert!(said.contains("--method accumulate"), "the method that can is named: {said}");
}

#[test]
fn a_time_budget_decides_the_number_of_views() {
    let folder = tempfile::tempdir().unwrap();
    let views = |seconds: &str| {
        let render = ["render", STACK, "--preset", "portrait", "--focus", "6", "-o", "a.exr", "--json"];
        let arguments = [render.as_slice(), &["--time-budget", seconds]].concat();
        let output = thinlens(folder.path(), &arguments).env("THINLENS_CACHE_DIR", "cache").output().unwrap();
        let json: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
        assert!(json["dial"]["statement"].as_str().unwrap().contains("predicted"), "{}", json["dial"]);
        json["views"].as_u64().unwrap()
    };
    assert_eq!(views("0.000001"), 8, "the minimum number of views");
    assert!(views("1") > 64, "a second is long for a small picture");
}

#[test]
fn the_number_of_views_or_its_target_is_given_once_and_only_to_methods_that_support_it() {
    let folder = tempfile::tempdir().unwrap();
    let failed = |flags: &[&str]| {
        let output = run(folder.path(), &[["render", STACK, "-o", "a.exr"].as_slice(), flags].concat());
        (output.status.code(), stderr(&output))
    };
    assert_eq!(failed(&["--views", "8", "--quality", "draft"]).0, Some(2));
    assert_eq!(failed(&["--target-db", "200"]).0, Some(2));
    assert_eq!(failed(&["--time-budget", "0"]).0, Some(2));
    let (code, message) = failed(&["--method", "gather", "--target-db", "40"]);
    assert!(code == Some(2) && message.contains("gather cannot search for"), "{message}");
    let (code, message) = failed(&["--method", "scatter", "--quality", "draft"]);
    assert!(code == Some(2) && message.contains("scatter does not sample the lens"), "{message}");
}

#[test]
fn plan_times_the_machine_once_and_reports_a_damaged_calibration() {
    let folder = tempfile::tempdir().unwrap();
    let measured_at = |arguments: &[&str]| {
        let json = stdout(&plan(folder.path(), "cache", &[&["--json"], arguments].concat()));
        serde_json::from_str::<serde_json::Value>(&json).unwrap()["calibration"].clone()
    };
    let first = measured_at(&[]);
    assert_eq!(measured_at(&[]), first, "kept");
    let files = names(&folder.path().join("cache"));
    assert_eq!(files.len(), 1, "{files:?}");
    let file = folder.path().join("cache").join(&files[0]);
    fs::write(&file, "torn").unwrap();
    let again = plan(folder.path(), "cache", &[]);
    assert!(stderr(&again).contains("is no calibration"), "{}", stderr(&again));
    assert!(stdout(&again).contains("calibrated for this machine"), "{}", stdout(&again));
    assert!(fs::read_to_string(&file).unwrap().contains("factors"), "written anew");
    fs::write(&file, "torn").unwrap();
    measured_at(&["--recalibrate"]);
    assert!(fs::read_to_string(&file).unwrap().contains("factors"), "asked to");
}

#[test]
fn a_plan_prints_requested_effects_and_what_each_choice_changes_within_119_columns() {
    let folder = tempfile::tempdir().unwrap();
    let common = ["--preset", "portrait", "--focus", "6"];
    let switches = ["--force", "fill,open-background", "--force", "highlights", "--without", "resolve"];
    let text = stdout(&run(folder.path(), &[["inspect", STACK].as_slice(), &common, &switches].concat()));
    let plan = text.split("\nplan\n").nth(1).unwrap();
    assert_eq!(plan.matches("requested; the plan's own choice was ").count(), 4, "{plan}");
    assert!(plan.contains("fill                    on   requested; the plan's own choice was off"), "{plan}");
    assert!(plan.contains("resolve                 off  requested; the plan's own choice was on"), "{plan}");
    assert!(plan.contains("without it, about ") && plan.contains("with it, "), "both ways: {plan}");
    assert!(text.lines().all(|line| line.chars().count() < 120), "{text}");
    let files = ["-o", "a.exr", "--views", "4", "--json"];
    let json =
        stdout(&run(folder.path(), &[["render", STACK].as_slice(), &common, &switches, &files].concat()));
    let report: serde_json::Value = serde_json::from_str(&json).unwrap();
    let effects = report["plan"]["effects"].as_array().unwrap();
    let forced = effects.iter().filter(|effect| effect["forced"] == true);
    let names: Vec<&str> = forced.map(|effect| effect["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["highlights", "fill", "open-background", "resolve"]);
    assert!(effects.iter().all(|effect| effect["change"].as_str().unwrap().len() > 5), "{json}");
}

#[test]
fn an_effect_that_cannot_be_switched_is_an_error_before_anything_is_read_or_run() {
    let folder = tempfile::tempdir().unwrap();
    let said = |arguments: &[&str]| {
        let output = run(folder.path(), arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        stderr(&output)
    };
    let unknown = said(&["render", "no/such.exr", "-o", "a.exr", "--without", "blurr"]);
    assert!(unknown.contains("did you mean 'blur'?"), "{unknown}");
    let lens =
        ["compare", STACK, "--preset", "portrait", "--focus", "6", "--force", "fill", "--probes", "60"];
    let halfway = said(&[lens.as_slice(), &["--methods", "shear:4,gather", "-o", "out"]].concat());
    assert!(halfway.contains("'fill' cannot be forced: gather has no such pass"), "{halfway}");
    assert_eq!(names(&folder.path().join("out")), [""; 0], "nothing ran");
}
