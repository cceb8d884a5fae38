//! The program as a user meets it.

#![expect(clippy::unwrap_used, reason = "a test stops at the first thing that fails")]

mod program;

use program::{STACK, names, run, stderr, thinlens};
use std::fs;
use std::path::Path;
use std::process::Output;
use thinlens::image::Image;
use thinlens::methods::METHODS;
use thinlens::output::exr::{self, ExrOptions};
use thinlens::settings::{BUILT_IN, MethodParameters, Parameter, Preset};
use thinlens::stack::{Carried, Frame, Precision, Window, read_picture};

fn stdout(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(0), "{}", stderr(output));
    String::from_utf8(output.stdout.clone()).unwrap()
}

#[test]
fn help_lists_every_subcommand() {
    let folder = tempfile::tempdir().unwrap();
    let help = stdout(&run(folder.path(), &["--help"]));
    for command in [
        "render",
        "inspect",
        "plan",
        "compare",
        "score",
        "methods",
        "presets",
        "devices",
        "demo",
        "completions",
        "man",
    ] {
        assert!(help.contains(&format!("\n  {command} ")), "{command}: {help}");
    }
}

#[test]
fn a_wrong_call_exits_with_2_and_a_failure_with_1() {
    let folder = tempfile::tempdir().unwrap();
    let code = |arguments: &[&str]| run(folder.path(), arguments).status.code();
    assert_eq!(code(&[]), Some(2));
    assert_eq!(code(&["blur"]), Some(2));
    assert_eq!(code(&["render", STACK]), Some(2), "no output named");
    assert_eq!(code(&["render", STACK, "-o", "a.exr", "--method", "no-such"]), Some(2));
    assert_eq!(code(&["render", STACK, "-o", "a.exr", "--focus", "1", "--focus-at", "1,1"]), Some(2));
    assert_eq!(code(&["render", STACK, "-o", "-", "--json"]), Some(2));
    assert_eq!(code(&["render", STACK, "-o", "a.png", "--preview", "a.png"]), Some(2));
    assert_eq!(code(&["render", STACK, "-o", "a.exr", "--exposure", "1"]), Some(2), "nothing to brighten");
    assert_eq!(code(&["render", STACK, "-o", "a.png", "--codec", "piz"]), Some(2), "nothing to compress");
    assert_eq!(code(&["render", "no-such.exr", "-o", "a.exr"]), Some(1));
    assert_eq!(code(&["presets", "show", "no-such"]), Some(1));
    assert_eq!(code(&["--version"]), Some(0));
}

#[test]
fn devices_lists_the_processor_and_what_auto_chooses_and_why() {
    let folder = tempfile::tempdir().unwrap();
    let text = stdout(&run(folder.path(), &["devices"]));
    let json: serde_json::Value =
        serde_json::from_str(&stdout(&run(folder.path(), &["devices", "--json"]))).unwrap();
    let processor = json["processor"].as_str().unwrap();
    assert!(text.starts_with(&format!("cpu   {processor}, ")), "{text}");
    let [auto, reason] = ["auto", "auto_reason"].map(|key| json[key].as_str().unwrap());
    assert_eq!(text.lines().last().unwrap(), format!("auto  {auto}: {reason}"));
    for adapter in json["adapters"].as_array().unwrap() {
        assert!(text.contains(adapter["name"].as_str().unwrap()), "{text}");
    }
}

#[test]
fn methods_lists_every_method() {
    let folder = tempfile::tempdir().unwrap();
    let text = stdout(&run(folder.path(), &["methods"]));
    let json: serde_json::Value =
        serde_json::from_str(&stdout(&run(folder.path(), &["methods", "--json"]))).unwrap();
    assert_eq!(text.lines().count(), METHODS.len());
    for (i, method) in METHODS.iter().enumerate() {
        let name = method.info().name;
        assert!(text.lines().any(|line| line.starts_with(name)), "{name}");
        assert_eq!(json[i]["name"], name);
    }
}

#[test]
fn methods_describes_one_method_as_a_preset_of_its_defaults() {
    let folder = tempfile::tempdir().unwrap();
    for method in METHODS {
        let info = method.info();
        let text = stdout(&run(folder.path(), &["methods", info.name]));
        assert!(text.contains(info.source), "{text}");
        let preset = Preset::parse(&text, info.name).unwrap();
        assert_eq!(preset.values.method.as_deref(), Some(info.name));
        assert_eq!(preset.parameters, MethodParameters::default(), "{}", info.name);
        for Parameter { name, description, .. } in MethodParameters::of(info.name) {
            assert!(text.contains(&format!("\n# {description}")), "{name}: {text}");
            assert!(text.contains(&format!("\n{name} = ")), "{name}: {text}");
        }
        for deviation in info.deviations {
            assert!(text.contains(deviation.reason), "{}: {text}", deviation.reason);
        }
    }
    let unknown = run(folder.path(), &["methods", "sheer"]);
    assert_eq!(unknown.status.code(), Some(1));
    assert!(stderr(&unknown).contains("did you mean 'shear'?"), "{}", stderr(&unknown));
}

#[test]
fn a_parameter_out_of_its_range_is_refused_with_key_value_range_and_default() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("lens.toml"), "[method.accumulate]\nrays = 0\n").unwrap();
    let output = run(folder.path(), &["render", STACK, "--preset", "lens.toml", "-o", "a.exr"]);
    assert_eq!(output.status.code(), Some(1));
    let text = stderr(&output);
    assert!(text.contains("'rays' must be a whole number from 1 to 65536 (the default is 1024)"), "{text}");
    assert!(text.contains("2 | rays = 0"), "{text}");
    assert!(!folder.path().join("a.exr").exists(), "nothing written");
}

#[test]
fn the_readme_lists_every_method_as_the_program_does() {
    let readme = include_str!("../README.md");
    for method in METHODS {
        let info = method.info();
        let row = format!("| `{}` | {} | {} | {} |", info.name, info.role, info.summary, info.source);
        assert!(readme.contains(&row), "the README's methods table lacks: {row}");
    }
}

#[test]
fn presets_are_listed_and_shown_as_files_to_start_from() {
    let folder = tempfile::tempdir().unwrap();
    let list = stdout(&run(folder.path(), &["presets"]));
    for preset in BUILT_IN {
        assert!(list.lines().any(|line| line.starts_with(preset.name)), "{}", preset.name);
        let text = stdout(&run(folder.path(), &["presets", "show", preset.name]));
        assert!(Preset::parse(&text, preset.name).is_ok(), "{}", preset.name);
    }
}

#[test]
fn completions_and_manual_pages_are_printed() {
    let folder = tempfile::tempdir().unwrap();
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        assert!(stdout(&run(folder.path(), &["completions", shell])).contains("thinlens"), "{shell}");
    }
    assert!(stdout(&run(folder.path(), &["man"])).contains(".TH"));
    assert!(stdout(&run(folder.path(), &["man", "render"])).contains("f\\-number"));
}

#[test]
fn a_reader_that_stops_reading_is_no_failure() {
    let folder = tempfile::tempdir().unwrap();
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let output = thinlens(folder.path(), &["presets"]).stdout(writer).output().unwrap();
    assert_eq!((output.status.code(), stderr(&output)), (Some(0), String::new()));
}

/// The program where no graphics driver is found.
#[cfg(target_os = "linux")]
fn without_driver(folder: &Path, args: &[&str]) -> Output {
    let hidden = |variable: &str| (variable.to_owned(), "/nonexistent.json".to_owned());
    let variables = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"].map(hidden);
    thinlens(folder, args).envs(variables).output().unwrap()
}

#[test]
#[cfg(target_os = "linux")]
fn a_gpu_asked_for_by_name_is_never_replaced_silently() {
    let folder = tempfile::tempdir().unwrap();
    let output = without_driver(folder.path(), &["render", STACK, "-o", "a.exr", "--device", "gpu"]);
    assert_eq!(output.status.code(), Some(1));
    let text = stderr(&output);
    assert!(
        text.contains("there is no graphics adapter") && text.contains("help: use --device auto"),
        "{text}"
    );
    assert!(names(folder.path()).is_empty(), "nothing was written");
}

#[test]
#[cfg(target_os = "linux")]
fn without_a_driver_auto_is_the_cpu_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let output = without_driver(folder.path(), &["render", STACK, "-o", "a.exr"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let text = stderr(&output);
    let device = text.lines().find(|line| line.starts_with("device: ")).unwrap();
    assert!(device.ends_with(": there is no graphics card"), "{device}");
}

#[test]
fn the_demo_needs_nothing_and_says_how_good_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let text = stdout(&run(folder.path(), &["demo"]));
    assert!(text.contains("PSNR") && text.contains("wrote "), "{text}");
    let demo = folder.path().join("thinlens-demo");
    assert_eq!(names(&demo), ["fence.exr", "fence.png", "report.json", "side-by-side.png"]);
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
fn an_existing_output_survives_a_failed_render_and_gives_way_to_a_good_one() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.exr");
    fs::write(&out, "precious").unwrap();
    let arguments = ["render", STACK, "-o", "out.exr", "--views", "4"];
    let failed = run(folder.path(), &[&arguments[..], &["--focus", "0.001"]].concat());
    assert_eq!(failed.status.code(), Some(1));
    assert_eq!(fs::read(&out).unwrap(), b"precious");
    assert_eq!(run(folder.path(), &[&arguments[..], &["--focus", "6"]].concat()).status.code(), Some(0));
    assert_eq!(fs::read(&out).unwrap()[..4], [0x76, 0x2f, 0x31, 0x01]);
    assert_eq!(names(folder.path()), ["out.exr"]);
}

#[test]
fn an_output_of_a_dash_is_an_exr_on_standard_output() {
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
fn inspect_says_what_is_sharp_and_paints_it() {
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
fn inspect_says_how_many_peels_the_lens_sees() {
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
    assert!(!inspect(&["--f-number", "inf"]).contains("peels needed"), "a pinhole sees the first alone");
}

#[test]
fn a_mask_says_how_much_of_the_picture_the_stack_knows() {
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
    assert!(stderr(&refused).contains("scatter cannot say"), "{}", stderr(&refused));
    let nowhere = render(STACK, "shear", "-");
    assert!(stderr(&nowhere).contains("a mask cannot go to standard output"), "{}", stderr(&nowhere));
    let twice = render(STACK, "shear", "out.exr");
    assert!(stderr(&twice).contains("two outputs"), "{}", stderr(&twice));
    assert_eq!(names(folder.path()), ["guessed.exr", "known.png", "out.exr"], "nothing more is written");
}

/// Runs `plan` on the sample stack, with its calibration kept in `cache`.
fn plan(folder: &Path, cache: &str, arguments: &[&str]) -> Output {
    let stack = ["plan", STACK, "--preset", "portrait", "--focus", "6"];
    thinlens(folder, &[&stack, arguments].concat()).env("THINLENS_CACHE_DIR", cache).output().unwrap()
}

#[test]
fn plan_shows_the_effects_and_what_every_step_will_cost() {
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
    assert!(!text.contains("gather"), "one method alone: {text}");
    let peels: Vec<&str> = text.lines().skip(1).take_while(|line| line.starts_with("  ")).collect();
    assert!(text.starts_with("peels ") && peels.len() == 4, "one line a peel: {text}");
    assert!(peels[0].starts_with("  1 ") && peels[0].contains(" 100.0 % "), "the first covers all: {text}");
    assert_eq!(names(folder.path()), [""; 0], "without a calibration nothing is kept");
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
    assert_eq!(costs.len(), steps, "the default is one of the steps");
    assert!(costs.iter().all(|cost| cost["cpu_seconds"].as_f64().unwrap() > 0.0), "{json}");
    let error_db = |name: &str| {
        let row = costs.iter().find(|cost| cost["name"] == name).unwrap();
        row["sampling_error"]["psnr_db"].as_f64()
    };
    assert!(error_db("shear:256") > error_db("shear:16"), "{json}");
    assert!(error_db("accumulate:16").is_some_and(|db| (25.0..50.0).contains(&db)), "{json}");
    assert_eq!(error_db("gather:64"), None, "it cannot be asked for single pixels");
    assert!(text.contains(" dB (") && !text.contains("- paints its picture as a whole"), "{text}");
    let chosen: Vec<_> = costs.iter().filter(|cost| cost["chosen"] == true).collect();
    assert!(chosen.len() == 1 && chosen[0]["name"] == "shear:64", "{chosen:?}");
    assert_eq!((&json["calibrated"], &json["plan"]["views"]), (&false.into(), &64.into()));
    assert!(json["device"]["reason"].is_string(), "{}", json["device"]);
}

#[test]
fn what_is_foreseen_of_a_render_is_what_is_verified_of_it_guesses_included() {
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
        let foreseen_db = step["sampling_error"]["psnr_db"].as_f64().unwrap();
        let render =
            |flags: &[&str]| json(&[&["render", stack, "-o", "a.exr"], flags].concat())["probe"].clone();
        let verified = render(&["--views", "64", "--verify"]);
        let verified_db = verified["psnr_db"].as_f64().unwrap();
        assert!(
            (foreseen_db - verified_db).abs() < 0.01,
            "{stack}: {foreseen_db} dB, in truth {verified_db}"
        );
        // A search looks at fewer pixels, with fewer rays.
        let target = (verified_db - 1.0).floor().to_string();
        let found = render(&["--target-db", &target]);
        let found_db = found["psnr_db"].as_f64().unwrap();
        let within = verified_db - 4.0..verified_db + 6.0;
        assert!(within.contains(&found_db), "{stack}: {found}, asked for {target} dB");
    }
}

#[test]
fn a_target_is_reached_or_the_report_says_what_was() {
    let folder = tempfile::tempdir().unwrap();
    let report = |flags: &[&str]| {
        let render = ["render", STACK, "--preset", "portrait", "--focus", "6", "-o", "a.exr", "--json"];
        let output = run(folder.path(), &[render.as_slice(), flags].concat());
        let json: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
        (json, stderr(&output))
    };
    let (rough, _) = report(&["--quality", "draft"]);
    let (fine, _) = report(&["--target-db", "45"]);
    let views = |report: &serde_json::Value| report["views"].as_u64().unwrap();
    assert!(views(&rough) <= views(&fine), "{} and {} views", rough["dial"], fine["dial"]);
    assert_eq!(fine["dial"]["met"], true, "{}", fine["dial"]);
    assert!(fine["probe"]["psnr_db"].as_f64().unwrap() >= 45.0, "{}", fine["probe"]);
    let (unmet, said) = report(&["--target-db", "80"]);
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
    assert_eq!(views("0.000001"), 8, "no fewer are worth a picture");
    assert!(views("1") > 64, "a second is long for a small picture");
}

#[test]
fn what_decides_the_views_is_given_once_and_only_to_methods_that_can_follow() {
    let folder = tempfile::tempdir().unwrap();
    let failed = |flags: &[&str]| {
        let output = run(folder.path(), &[["render", STACK, "-o", "a.exr"].as_slice(), flags].concat());
        (output.status.code(), stderr(&output))
    };
    assert_eq!(failed(&["--views", "8", "--quality", "draft"]).0, Some(2));
    assert_eq!(failed(&["--target-db", "200"]).0, Some(2));
    assert_eq!(failed(&["--time-budget", "0"]).0, Some(2));
    let (code, message) = failed(&["--method", "gather", "--target-db", "40"]);
    assert!(code == Some(1) && message.contains("gather cannot look for"), "{message}");
    let (code, message) = failed(&["--method", "scatter", "--quality", "draft"]);
    assert!(code == Some(1) && message.contains("scatter does not sample the lens"), "{message}");
}

#[test]
fn plan_times_the_machine_once_and_says_so_when_it_has_to_again() {
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
fn a_picture_scores_perfectly_against_itself() {
    let folder = tempfile::tempdir().unwrap();
    let picture = concat!(env!("CARGO_MANIFEST_DIR"), "/samples/fence/reference.exr");
    let text = stdout(&run(folder.path(), &["score", picture, picture]));
    assert!(text.contains("PSNR          200.00 dB"), "{text}");
}

#[test]
fn a_score_can_have_hdr_flip_and_a_map_of_the_difference() {
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
fn a_render_can_say_how_large_its_sampling_error_is() {
    let folder = tempfile::tempdir().unwrap();
    let output = run(folder.path(), &["render", STACK, "-o", "a.exr", "--verify", "60", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert!(json["probe"]["interval_db"][0].as_f64().is_some(), "{json}");
    assert!(stderr(&output).contains("sampling error: "), "{}", stderr(&output));
    let few = run(folder.path(), &["render", STACK, "-o", "b.exr", "--verify", "3"]);
    assert_eq!(few.status.code(), Some(2), "three probes are no sample");
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
fn compare_measures_methods_on_one_stack_and_marks_those_that_nothing_beats() {
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
    assert!(db(0) > db(1) + 5.0 && entries[0]["on_front"] == true, "the fence hides what only peels know");
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
fn a_comparison_says_how_it_was_made_and_its_commands_render_its_pictures() {
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
    assert_eq!(fs::read(folder.path().join("again.png")).unwrap(), fs::read(picture).unwrap());
}

#[test]
fn what_is_in_focus_comes_out_as_it_went_in_bit_for_bit_as_half_and_as_float() {
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
        assert_eq!(precision == Precision::Float, after == picture, "half holds fewer values");
    }
}

#[test]
fn a_plan_says_what_was_asked_for_and_what_each_choice_changes_on_a_page_of_119_columns() {
    let folder = tempfile::tempdir().unwrap();
    let common = ["--preset", "portrait", "--focus", "6"];
    let switches = ["--force", "fill,open-background", "--force", "highlights", "--without", "resolve"];
    let text = stdout(&run(folder.path(), &[["inspect", STACK].as_slice(), &common, &switches].concat()));
    let plan = text.split("\nplan\n").nth(1).unwrap();
    assert_eq!(plan.matches("asked for; the plan's own choice was ").count(), 4, "{plan}");
    assert!(plan.contains("fill                    on   asked for; the plan's own choice was off"), "{plan}");
    assert!(plan.contains("resolve                 off  asked for; the plan's own choice was on"), "{plan}");
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
        assert_eq!(output.status.code(), Some(1), "{arguments:?}");
        stderr(&output)
    };
    let unknown = said(&["render", "no/such.exr", "-o", "a.exr", "--without", "blurr"]);
    assert!(unknown.contains("did you mean 'blur'?"), "{unknown}");
    let lens =
        ["compare", STACK, "--preset", "portrait", "--focus", "6", "--force", "fill", "--probes", "60"];
    let halfway = said(&[lens.as_slice(), &["--methods", "shear:4,gather", "-o", "out"]].concat());
    assert!(halfway.contains("'fill' cannot be forced: gather has no such step"), "{halfway}");
    assert_eq!(names(&folder.path().join("out")), [""; 0], "nothing ran");
}

#[test]
fn what_lies_beyond_the_frame_is_said_and_shows_at_its_edge_alone() {
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
        let least_db = report["probe"]["interval_db"][0].as_f64().unwrap();
        assert!(least_db > 30.0, "the stack's truth has the border too: {least_db} dB");
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
fn a_presets_border_and_extrapolation_are_shown_with_where_they_come_from() {
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
    // The light is one pixel of white, and what it gains as much again, but for the precision of half floats.
    assert!((gained - clipped - 1.0).abs() < 0.05, "{gained} and {clipped}");
}

#[test]
fn the_faults_of_a_presets_lens_are_shown_and_its_image_is_found_beside_it() {
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
fn a_lens_that_cannot_be_is_refused_by_what_is_wrong_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |flags: &[&str]| {
        let output = run(folder.path(), &[&["plan", STACK, "--focus", "6"], flags].concat());
        assert_ne!(output.status.code(), Some(0), "{flags:?}");
        stderr(&output)
    };
    assert!(refused(&["--aperture-image", "none.png"]).contains("none.png"));
    assert!(refused(&["--cats-eye", "2"]).contains("the cat's eye must be from 0 to 1.2"));
    assert!(refused(&["--spherical", "nan"]).contains("spherical aberration must be from -5000 to 5000"));
    assert!(refused(&["--lateral-color", "1,1e9"]).contains("lateral colour must be from"));
    assert!(refused(&["--axial-color", "7"]).contains("two numbers with a comma"));
    fs::write(folder.path().join("black.png"), b"not a picture").unwrap();
    assert!(refused(&["--aperture-image", "black.png"]).contains("not a picture"));
    image::GrayImage::new(8, 8).save(folder.path().join("black.png")).unwrap();
    assert!(refused(&["--aperture-image", "black.png"]).contains("lets no light through"));
}

#[test]
fn what_a_lens_does_to_the_whole_picture_is_in_the_file_whatever_the_method() {
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
