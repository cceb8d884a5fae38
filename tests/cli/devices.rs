//! Where it computes.

use super::program::{STACK, names, stderr, thinlens};
use std::path::Path;
use std::process::Output;

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
    let why = if cfg!(feature = "gpu") {
        "there is no graphics card"
    } else {
        "this program was built without GPU support"
    };
    assert!(device.ends_with(&format!(": {why}")), "{device}");
}

/// The program where drivers find no screen, and the Vulkan loader says which drivers it finds.
#[cfg(target_os = "linux")]
fn without_screen(folder: &Path, args: &[&str]) -> Output {
    thinlens(folder, args).env_remove("XDG_RUNTIME_DIR").env("VK_LOADER_DEBUG", "driver").output().unwrap()
}

#[test]
#[cfg(target_os = "linux")]
fn drivers_may_speak_on_standard_error_but_not_of_a_missing_screen() {
    let folder = tempfile::tempdir().unwrap();
    let listed = without_screen(folder.path(), &["devices"]);
    if String::from_utf8_lossy(&listed.stdout).contains("gpu   none") {
        return;
    }
    let rendered = without_screen(folder.path(), &["render", STACK, "-o", "a.exr", "--device", "gpu"]);
    for output in [listed, rendered] {
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(0), "{text}");
        assert!(text.contains("DRIVER:"), "what else drivers write is kept: {text}");
        assert!(!text.contains("XDG_RUNTIME_DIR"), "{text}");
    }
}
