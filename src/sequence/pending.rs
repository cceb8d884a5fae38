//! Frames that are still being made by the program that writes the input.

use crate::stack;
use std::path::Path;

/// Whether the file at `path` is there as a whole.
pub fn is_finished(path: &Path) -> bool {
    stack::is_complete(path).unwrap_or(false)
}
