//! Frames that are still being made by the program that writes them.

use crate::stack::{self, Source};
use std::path::Path;
use std::time::Duration;

/// How long a file that is wrong, and not merely cut short, has to be unchanged before it counts as finished.
const SETTLED: Duration = Duration::from_secs(10);

/// Whether nothing more is written to the file at `path`: it is whole, or has been wrong for so long that reading it will say how.
///
/// A file that is cut short is waited for however old it is: renderers write for hours.
pub fn is_finished(path: &Path) -> bool {
    match stack::is_complete(&Source::file(path)) {
        Ok(whole) => whole,
        Err(_) => age(path).is_some_and(|age| age >= SETTLED),
    }
}

/// Time since the file at `path` was last changed; `None` if it is not there.
fn age(path: &Path) -> Option<Duration> {
    path.metadata().ok()?.modified().ok()?.elapsed().ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{self, File};
    use std::time::SystemTime;

    #[test]
    fn a_file_that_is_missing_or_cut_short_is_not_finished() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        assert!(!is_finished(&path), "missing");
        let bytes = fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/samples/fence/stack.exr")).unwrap();
        for length in [0, 4, 200, bytes.len() / 2, bytes.len() - 1] {
            fs::write(&path, &bytes[..length]).unwrap();
            assert!(!is_finished(&path), "{length} of {} bytes", bytes.len());
        }
        fs::write(&path, &bytes).unwrap();
        assert!(is_finished(&path));
    }

    #[test]
    fn a_file_that_is_not_what_it_says_is_finished_when_it_has_not_changed_for_long() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let version_9 = [0x76, 0x2f, 0x31, 0x01, 9, 0, 0, 0];
        fs::write(&path, [&version_9[..], &[0; 64]].concat()).unwrap();
        let is_finished_now = is_finished(&path);
        File::options().write(true).open(&path).unwrap().set_modified(SystemTime::UNIX_EPOCH).unwrap();
        assert!(!is_finished_now && is_finished(&path));
    }
}
