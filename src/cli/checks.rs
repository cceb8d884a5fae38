//! Checks on output files, made before any work: a render must not fail at its last step for a reason known at its first.

use std::path::{Path, PathBuf};
use thinlens::error::Error;
use thinlens::output::atomic;

/// Checks that `output` can become a file: it is not one of `inputs`, and its folder can be written. A file that stands in
/// its place will be replaced, as a whole and only at the end.
///
/// # Errors
/// Which of these does not hold.
pub(super) fn output<'a>(output: &Path, inputs: impl Iterator<Item = &'a PathBuf>) -> Result<(), Error> {
    not_an_input(output, inputs)?;
    atomic::check_writable(output)
}

/// Checks that `output` is called as a PNG is.
///
/// # Errors
/// If it is not.
pub(super) fn png(output: &Path) -> Result<(), Error> {
    if output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png")) {
        return Ok(());
    }
    Err(Error::settings("this picture is written as PNG only")
        .in_file(output)
        .with("looked for", ".png")
        .help("give the file a name that ends in .png"))
}

fn not_an_input<'a>(output: &Path, mut inputs: impl Iterator<Item = &'a PathBuf>) -> Result<(), Error> {
    // Canonical paths: `./a.exr`, `a.exr` and a link to it are one file. An output that does not exist is no input.
    let Ok(output_file) = output.canonicalize() else { return Ok(()) };
    match inputs.find(|input| input.canonicalize().is_ok_and(|input| input == output_file)) {
        Some(input) => Err(Error::output("the output is one of the inputs")
            .in_file(output)
            .with("input", input.display().to_string())
            .help("write to another file; the input stays as it is")),
        None => Ok(()),
    }
}

/// Checks that files can be written into `folder`, making it if need be.
///
/// # Errors
/// If it cannot be made, or is no folder, or cannot be written into.
pub(super) fn folder(folder: &Path) -> Result<(), Error> {
    std::fs::create_dir_all(folder).map_err(|cause| {
        Error::output("the output folder cannot be made").in_file(folder).caused_by(cause)
    })?;
    atomic::check_writable(&folder.join("results.json"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(path: &Path, inputs: &[PathBuf]) -> Result<(), String> {
        output(path, inputs.iter()).map_err(|error| error.to_string())
    }

    #[test]
    fn a_new_file_in_a_folder_passes_and_so_does_one_to_replace() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(check(&folder.path().join("out.exr"), &[]), Ok(()));
        let file = tempfile::NamedTempFile::new().unwrap();
        assert_eq!(check(file.path(), &[]), Ok(()));
    }

    #[test]
    fn an_input_is_never_an_output_under_any_of_its_names() {
        let folder = tempfile::tempdir().unwrap();
        let input = folder.path().join("in.exr");
        std::fs::write(&input, "").unwrap();
        let same = folder.path().join(".").join("in.exr");
        assert!(check(&same, std::slice::from_ref(&input)).unwrap_err().contains("one of the inputs"));
        #[cfg(unix)]
        {
            let link = folder.path().join("link.exr");
            std::os::unix::fs::symlink(&input, &link).unwrap();
            assert!(check(&link, &[input]).unwrap_err().contains("one of the inputs"));
        }
    }

    #[test]
    fn a_folder_is_no_output_and_a_missing_folder_holds_none() {
        let folder = tempfile::tempdir().unwrap();
        assert!(check(folder.path(), &[]).unwrap_err().contains("is a folder"));
        let message = check(&folder.path().join("no/out.exr"), &[]).unwrap_err();
        assert!(message.contains("does not exist"), "{message}");
    }
}
