//! Checks on output files, made before any work: a render must not fail at its last step for a reason known at its first.

use std::path::{Path, PathBuf};
use thinlens::error::Error;
use thinlens::output::atomic;

/// Checks that `output` can become a file: it is not one of `inputs`, nothing stands in its place that `force` does not
/// allow to replace, and its folder can be written.
///
/// # Errors
/// Which of these does not hold.
pub(super) fn output<'a>(
    output: &Path,
    inputs: impl Iterator<Item = &'a PathBuf>,
    force: bool,
) -> Result<(), Error> {
    not_an_input(output, inputs)?;
    atomic::check_writable(output)?;
    if output.is_file() && !force {
        return Err(Error::output("the output exists already")
            .in_file(output)
            .help("add --force to replace it, or choose another name"));
    }
    Ok(())
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

#[cfg(test)]
mod tests {
    use super::*;

    fn check(path: &Path, inputs: &[PathBuf], force: bool) -> Result<(), String> {
        output(path, inputs.iter(), force).map_err(|error| error.to_string())
    }

    #[test]
    fn a_new_file_in_a_folder_passes() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(check(&folder.path().join("out.exr"), &[], false), Ok(()));
    }

    #[test]
    fn an_existing_file_is_replaced_only_by_force() {
        let file = tempfile::NamedTempFile::new().unwrap();
        assert!(check(file.path(), &[], false).unwrap_err().contains("--force"));
        assert_eq!(check(file.path(), &[], true), Ok(()));
    }

    #[test]
    fn an_input_is_never_an_output_under_any_of_its_names() {
        let folder = tempfile::tempdir().unwrap();
        let input = folder.path().join("in.exr");
        std::fs::write(&input, "").unwrap();
        let same = folder.path().join(".").join("in.exr");
        assert!(check(&same, std::slice::from_ref(&input), true).unwrap_err().contains("one of the inputs"));
        #[cfg(unix)]
        {
            let link = folder.path().join("link.exr");
            std::os::unix::fs::symlink(&input, &link).unwrap();
            assert!(check(&link, &[input], true).unwrap_err().contains("one of the inputs"));
        }
    }

    #[test]
    fn a_folder_is_no_output_and_a_missing_folder_holds_none() {
        let folder = tempfile::tempdir().unwrap();
        assert!(check(folder.path(), &[], true).unwrap_err().contains("is a folder"));
        let message = check(&folder.path().join("no/out.exr"), &[], false).unwrap_err();
        assert!(message.contains("does not exist"), "{message}");
    }
}
