//! Checks of output files before any work starts, so that a long render does not fail when it is written.

use std::path::Path;
use thinlens::error::Error;
use thinlens::output::atomic;

/// Checks that `output` can be written: it is not one of `inputs`, and its folder is writable. An existing file is replaced
/// at the end, in one step.
///
/// # Errors
/// The condition that does not hold.
pub(super) fn output(output: &Path, inputs: impl Iterator<Item: AsRef<Path>>) -> Result<(), Error> {
    not_an_input(output, inputs)?;
    atomic::check_writable(output)
}

/// Checks that the name of `output` ends in `.png`.
///
/// # Errors
/// Any other name.
pub(super) fn png(output: &Path) -> Result<(), Error> {
    if output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png")) {
        return Ok(());
    }
    Err(Error::settings("this picture is written as PNG only")
        .in_file(output)
        .with("expected", ".png")
        .help("give the file a name that ends in .png"))
}

/// Checks that `output` is not one of `inputs`.
///
/// # Errors
/// It is.
pub(super) fn not_an_input(output: &Path, mut inputs: impl Iterator<Item: AsRef<Path>>) -> Result<(), Error> {
    // Canonical paths: `./a.exr`, `a.exr` and a link to it are the same file. An output that does not exist is not an input.
    let Ok(output_file) = output.canonicalize() else { return Ok(()) };
    match inputs.find(|input| input.as_ref().canonicalize().is_ok_and(|input| input == output_file)) {
        Some(input) => Err(Error::settings("the output is one of the inputs")
            .in_file(output)
            .with("input", input.as_ref().display().to_string())
            .help("write to another file; inputs are never overwritten")),
        None => Ok(()),
    }
}

/// Checks that files can be written into `folder`; creates it if it does not exist.
///
/// # Errors
/// It cannot be created, is not a folder, or is not writable.
pub(super) fn folder(folder: &Path) -> Result<(), Error> {
    atomic::create_folder(folder)?;
    atomic::check_writable(&folder.join("results.json"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    fn check(path: &Path, inputs: &[PathBuf]) -> Result<(), String> {
        output(path, inputs.iter()).map_err(|error| error.to_string())
    }

    #[test]
    fn a_new_file_and_an_existing_file_pass() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(check(&folder.path().join("out.exr"), &[]), Ok(()));
        let file = tempfile::NamedTempFile::new().unwrap();
        assert_eq!(check(file.path(), &[]), Ok(()));
    }

    #[test]
    fn an_output_that_is_an_input_under_another_path_is_refused() {
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
    fn a_folder_as_output_and_an_output_in_a_missing_folder_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        assert!(check(folder.path(), &[]).unwrap_err().contains("is a folder"));
        let message = check(&folder.path().join("no/out.exr"), &[]).unwrap_err();
        assert!(message.contains("does not exist"), "{message}");
    }
}
