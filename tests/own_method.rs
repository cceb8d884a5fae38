//! A method added by a user of the library: one type, available in every command.

#![cfg(feature = "cli")]
#![expect(
    clippy::unwrap_used,
    clippy::exit,
    reason = "a test stops at the first thing that fails; the program ends with its code"
)]

use std::path::Path;
use std::process::{Command, ExitCode, Output};
use thinlens::error::Error;
use thinlens::image::Image;
use thinlens::methods::{Method, MethodInfo, Plan, Progress, Registry};
use thinlens::scene::Scene;
use thinlens::settings::ParameterTable;

/// Environment variable with the program's arguments, one per line: the test's own binary then runs as the program.
const ARGUMENTS: &str = "THINLENS_TEST_ARGUMENTS";

const STACK: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/samples/fence/stack.exr");

/// The pinhole picture, darkened; no blur.
#[derive(Debug)]
struct Dim;

thinlens::declare_parameters! {
    /// Parameters of `dim`.
    DimParameters {
        /// Fraction of the light that is kept.
        kept: f32 = 0.5, Number(0.0, 1.0);
    }
}

impl Method for Dim {
    fn info(&self) -> MethodInfo {
        MethodInfo {
            source: "this test",
            steps: &["kept=0.25", "kept=0.5", "kept=1"],
            ..MethodInfo::new("dim", "the pinhole picture, darkened")
        }
    }

    fn parameters(&self) -> ParameterTable {
        ParameterTable::of::<DimParameters>()
    }

    fn blur(&self, scene: Scene, plan: &Plan, _progress: &Progress<'_>) -> Result<Image, Error> {
        let kept = plan.parameters.get::<DimParameters>().kept;
        let mut image = scene.into_pinhole();
        let values = image.planes[..3].iter_mut().flat_map(|plane| plane.values_mut());
        values.for_each(|value| *value *= kept);
        Ok(image)
    }
}

/// Not a test by itself: where [`ARGUMENTS`] is set, this binary runs the program with one additional method.
#[test]
fn program() {
    let Ok(arguments) = std::env::var(ARGUMENTS) else { return };
    let words = std::iter::once("thinlens").chain(arguments.lines()).map(Into::into);
    let code = thinlens::cli::run_with(words, &Registry::default().with(&Dim));
    std::process::exit(i32::from(code != ExitCode::SUCCESS));
}

/// Runs the program with the method of this test in `folder`.
fn run(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "program", "--nocapture", "--quiet"])
        .env(ARGUMENTS, arguments.join("\n"))
        .env("THINLENS_CACHE_DIR", concat!(env!("CARGO_TARGET_TMPDIR"), "/calibration"))
        .current_dir(folder)
        .output()
        .unwrap()
}

/// Standard output of a run, which has to succeed.
fn stdout(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn every_command_has_the_added_method() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let dim = ["--method", "dim", "--device", "cpu"];
    let with = |command: &[&'static str]| [command, &dim[..]].concat();
    assert!(stdout(folder, &["methods"]).contains("dim                   custom"), "listed with its role");
    assert!(stdout(folder, &["methods", "dim"]).contains("kept = 0.5"), "with its parameters");
    assert!(stdout(folder, &["completions", "bash"]).contains("accumulate recursive-gaussian"), "listed");
    assert!(stdout(folder, &["completions", "bash"]).contains(" dim"), "completed");
    assert!(stdout(folder, &["man", "render"]).contains("dim"), "documented");
    stdout(folder, &with(&["render", STACK, "-o", "out.exr", "--report", "report.json"]));
    let report: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(folder.join("report.json")).unwrap()).unwrap();
    assert_eq!((&report["method"], &report["plan"]["parameters"]["kept"]), (&"dim".into(), &0.5.into()));
    assert!(stdout(folder, &with(&["inspect", STACK])).contains("dim"), "the plan of a render");
    let plan = stdout(folder, &with(&["plan", STACK, "--uncalibrated", "--all-methods"]));
    let row = plan.lines().find(|line| line.contains("dim:kept=0.25")).unwrap();
    assert!(row.contains('?'), "its cost is unknown: {row}");
    let compared = stdout(
        folder,
        &["compare", STACK, "--methods", "dim,dim:kept=1,scatter", "--repeats", "1", "-o", "c"],
    );
    assert!(compared.contains("dim:kept=1") && folder.join("c/report.html").is_file(), "{compared}");
}

#[test]
fn parameters_of_the_added_method_are_set_by_flags_and_presets_and_checked() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::write(folder.join("lens.toml"), "[method]\nname = 'dim'\n[method.dim]\nkept = 1\n").unwrap();
    stdout(folder, &["render", STACK, "--preset", "lens.toml", "-o", "kept.exr", "--device", "cpu"]);
    stdout(
        folder,
        &["render", STACK, "--method", "dim", "--set", "kept=1", "-o", "set.exr", "--device", "cpu"],
    );
    let [preset, flag] =
        ["kept.exr", "set.exr"].map(|name| thinlens::stack::read_picture(&folder.join(name)).unwrap());
    assert_eq!(preset, flag);
    let refused = run(folder, &["render", STACK, "--method", "dim", "--set", "kept=2", "-o", "a.exr"]);
    let text = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(
        !refused.status.success() && text.contains("'kept' of dim must be a number from 0 to 1"),
        "{text}"
    );
}

#[test]
fn a_time_budget_that_cannot_be_predicted_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let refused =
        run(folder.path(), &["render", STACK, "--method", "dim", "--time-budget", "1", "-o", "a.exr"]);
    let text = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success() && text.contains("dim does not sample the lens"), "{text}");
}
