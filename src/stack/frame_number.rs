//! The frame number, from the names of the input files.
//!
//! It is the last group of digits before the extension that occurs in the names of all files: `peel0.0042.exr` and
//! `peel1.0042.exr` are frame 42. Digits after a letter `v` are a version (`shot_v002.exr`), never a frame.

use super::Source;
use std::path::Path;

/// The frame number in the names of `sources`, if they have one.
pub(crate) fn frame_number(sources: &[Source]) -> Option<i64> {
    let mut numbers = sources.iter().map(|source| numbers(source.name()));
    let first = numbers.next()?;
    let others: Vec<Vec<i64>> = numbers.collect();
    first.into_iter().rev().find(|number| others.iter().all(|other| other.contains(number)))
}

/// The numbers in a file name that can be a frame number.
fn numbers(path: &Path) -> Vec<i64> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let mut numbers = Vec::new();
    let mut rest = &*stem;
    while let Some(start) = rest.find(|c: char| c.is_ascii_digit()) {
        let (head, tail) = rest.split_at(start);
        let end = tail.find(|c: char| !c.is_ascii_digit()).unwrap_or(tail.len());
        if !head.ends_with(['v', 'V']) {
            numbers.extend(tail[..end].parse::<i64>());
        }
        rest = &tail[end..];
    }
    numbers
}

#[cfg(test)]
mod tests {
    use super::*;

    fn number(names: &[&str]) -> Option<i64> {
        frame_number(&names.iter().map(|name| Source::File(name.into())).collect::<Vec<_>>())
    }

    #[test]
    fn the_last_digits_before_the_extension_are_the_frame() {
        assert_eq!(number(&["shot.0042.exr"]), Some(42));
        assert_eq!(number(&["s010_0001.beauty.exr"]), Some(1));
        assert_eq!(number(&["0007"]), Some(7));
        assert_eq!(number(&["take2/shot.exr"]), None, "a folder is no part of the name");
        assert_eq!(number(&["shot.exr2"]), None, "neither is the extension");
    }

    #[test]
    fn a_version_is_not_a_frame_number() {
        assert_eq!(number(&["v2_beauty.exr"]), None);
        assert_eq!(number(&["shot_V002.exr"]), None);
        assert_eq!(number(&["shot.0042_v003.exr"]), Some(42));
        assert_eq!(number(&["v2.17.exr"]), Some(17));
    }

    #[test]
    fn the_number_occurs_in_the_names_of_all_files() {
        assert_eq!(number(&["peel0.0042.exr", "peel1.0042.exr"]), Some(42));
        assert_eq!(number(&["a.0042.peel0.exr", "a.0042.peel1.exr"]), Some(42));
        assert_eq!(number(&["peel0.exr", "peel1.exr"]), None, "peels are not frames");
    }

    #[test]
    fn numbers_that_do_not_fit_are_skipped() {
        assert_eq!(number(&["shot.0042_99999999999999999999.exr"]), Some(42));
        assert_eq!(number(&[]), None);
    }
}
