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
    assert!(device.ends_with(": there is no graphics card"), "{device}");
}
