//! The choice of the device.

use super::program::{STACK, names, stderr, thinlens};
use std::path::Path;
use std::process::Output;

/// Runs the program without any graphics driver.
#[cfg(target_os = "linux")]
fn without_driver(folder: &Path, args: &[&str]) -> Output {
    let hidden = |variable: &str| (variable.to_owned(), "/nonexistent.json".to_owned());
    let variables = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"].map(hidden);
    thinlens(folder, args).envs(variables).output().unwrap()
}

#[test]
#[cfg(target_os = "linux")]
fn a_requested_gpu_that_does_not_exist_is_an_error() {
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
fn without_a_driver_auto_chooses_the_cpu_and_prints_why() {
    let folder = tempfile::tempdir().unwrap();
    let output = without_driver(folder.path(), &["render", STACK, "-o", "a.exr"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let text = stderr(&output);
    let device = text.lines().find(|line| line.starts_with("device: ")).unwrap();
    let why = if cfg!(feature = "gpu") {
        "there is no graphics card"
    } else {
        "this program was built without GPU support"
    };
    assert!(device.ends_with(&format!(": {why}")), "{device}");
}

/// The program without a display, and with a Vulkan loader that prints which drivers it finds.
#[cfg(target_os = "linux")]
fn without_screen(folder: &Path, args: &[&str]) -> Output {
    thinlens(folder, args).env_remove("XDG_RUNTIME_DIR").env("VK_LOADER_DEBUG", "driver").output().unwrap()
}

#[test]
#[cfg(target_os = "linux")]
fn messages_of_drivers_reach_standard_error_except_those_about_a_missing_display() {
    let folder = tempfile::tempdir().unwrap();
    let listed = without_screen(folder.path(), &["devices"]);
    if String::from_utf8_lossy(&listed.stdout).contains("gpu   none") {
        return;
    }
    let rendered = without_screen(folder.path(), &["render", STACK, "-o", "a.exr", "--device", "gpu"]);
    for output in [listed, rendered] {
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(0), "{text}");
        assert!(text.contains("DRIVER:"), "other messages of drivers are kept: {text}");
        assert!(!text.contains("XDG_RUNTIME_DIR"), "{text}");
    }
}
