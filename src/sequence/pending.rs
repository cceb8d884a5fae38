//! Frames that are still being made by the program that writes the input.

use std::path::Path;

/// Whether the file at `path` is there as a whole.
pub fn is_finished(path: &Path) -> bool {
    path.is_file()
}
