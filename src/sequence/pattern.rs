//! File names in which the frame number varies: `shot.####.exr`, `shots/%04d/beauty.exr`.
//!
//! | written | digits at least | from |
//! | --- | --- | --- |
//! | `#` | 4 | FileSeq |
//! | `##`, `###`, `####` … | as many as there are `#` | Nuke, Blender |
//! | `@`, `@@`, `@@@` … | as many as there are `@` | FileSeq |
//! | `%d`, `%04d` | 1, 4 | Nuke, FFmpeg |
//! | `$F`, `$F4`, `${F4}` | 1, 4 | Houdini |
//!
//! A number with more digits than that is written whole. The sign of a negative number counts as a digit: frame −5 of `####` is
//! `-005`. Names with other digits are found too: `-0005`, as Blender writes it, or `7` for `0007`.
//!
//! The folders on the way that exist, and a file that exists, are no patterns, whatever their names. Nor is a single `@` before a
//! letter or digit: `plate@2x.exr`.

use crate::error::Error;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// The most digits that a pattern may ask for.
const MOST_DIGITS: usize = 32;

/// A path in which the frame number varies, in one place or in several that all have the same number. See the
/// [module](self) for how it is written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pattern {
    /// The whole path as it was written.
    path: PathBuf,
    /// The folders that exist.
    base: PathBuf,
    /// The names behind them: folders, and at last the file.
    names: Vec<Name>,
}

/// The name of a folder or a file: text and places for the number, in turns.
type Name = Vec<Piece>;

/// A piece of a name.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Piece {
    /// The same for every frame.
    Text(String),
    /// The frame number with at least this many characters.
    Number(usize),
}

impl Pattern {
    /// The file of frame `number` where `path` is a pattern, else `path`.
    ///
    /// # Errors
    /// Those of [`Self::parse`].
    pub fn file_at(path: &Path, number: i64) -> Result<PathBuf, Error> {
        Ok(Self::parse(path)?.map_or_else(|| path.to_owned(), |pattern| pattern.at(number)))
    }

    /// The pattern that `path` is, or nothing if it is the name of one file: it exists, or has no place for a number. What
    /// exists is looked up on the disk.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Settings`](crate::error::ErrorKind::Settings) if a place asks for more than 32 digits.
    pub fn parse(path: &Path) -> Result<Option<Self>, Error> {
        let base = existing(path);
        let rest = path.strip_prefix(base).unwrap_or(path);
        let texts: Option<Vec<&str>> = rest.components().map(|name| name.as_os_str().to_str()).collect();
        // A place for a number is ASCII; what is no text has none that could be replaced.
        let names: Vec<Name> = texts.unwrap_or_default().into_iter().map(pieces).collect();
        let widest = names.iter().flatten().filter_map(|piece| match piece {
            Piece::Number(digits) => Some(*digits),
            Piece::Text(_) => None,
        });
        match widest.max() {
            None => Ok(None),
            Some(digits) if digits > MOST_DIGITS => Err(too_wide(path, digits)),
            Some(_) => Ok(Some(Self { path: path.to_owned(), base: base.to_owned(), names })),
        }
    }

    /// The path with a place for the number between each of `texts` and the next, of so many `digits` at least.
    pub(super) fn between(texts: &[String], digits: &[usize]) -> Self {
        // No path contains a NUL, so it stands for a place until the path is taken apart.
        let path = texts.join("\0");
        let mut digits = digits.iter().copied();
        let mut pieces = |name: &str| {
            let mut pieces = Vec::new();
            for (index, text) in name.split('\0').enumerate() {
                pieces.extend((index > 0).then(|| Piece::Number(digits.next().unwrap_or(1))));
                pieces.extend((!text.is_empty()).then(|| Piece::Text(text.to_owned())));
            }
            pieces
        };
        let first = Path::new(&path).ancestors().find(|folder| !folder.to_string_lossy().contains('\0'));
        let base = first.unwrap_or(Path::new("")).to_owned();
        let rest = Path::new(&path).strip_prefix(&base).unwrap_or(Path::new(&path));
        let names = rest.components().map(|name| pieces(&name.as_os_str().to_string_lossy())).collect();
        let mut pattern = Self { path: PathBuf::new(), base, names };
        pattern.path = pattern.filled(|digits| if digits == 1 { "@".to_owned() } else { "#".repeat(digits) });
        pattern
    }

    /// The path as it was written.
    pub fn as_path(&self) -> &Path {
        &self.path
    }

    /// The path of `frame`.
    pub fn at(&self, frame: i64) -> PathBuf {
        self.filled(|digits| format!("{frame:0digits$}"))
    }

    /// The path with `number` of its least number of characters in each place.
    fn filled(&self, number: impl Fn(usize) -> String) -> PathBuf {
        let mut path = self.base.clone();
        for name in &self.names {
            let pieces = name.iter().map(|piece| match piece {
                Piece::Text(text) => text.clone(),
                Piece::Number(digits) => number(*digits),
            });
            path.push(pieces.collect::<String>());
        }
        path
    }

    /// The frame whose path `path` is, with any number of digits.
    pub fn number_of(&self, path: &Path) -> Option<i64> {
        let rest = path.strip_prefix(&self.base).ok()?;
        let mut names = rest.components();
        let mut number = None;
        let all = self.names.iter().all(|pieces| {
            let name = names.next().and_then(|name| name.as_os_str().to_str());
            name.is_some_and(|name| read(pieces, name, &mut number))
        });
        if all && names.next().is_none() { number } else { None }
    }

    /// The frames whose files exist, rising.
    ///
    /// # Errors
    ///
    /// As [`Pattern::files`].
    pub fn on_disk(&self) -> Result<Vec<i64>, Error> {
        Ok(self.files()?.into_keys().collect())
    }

    /// The files that exist, by frame. Each folder is listed once. Of two files of one frame that differ in their digits the one
    /// that [`Pattern::at`] names counts, or else the one with the sign in front of all digits.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Input`](crate::error::ErrorKind::Input) if a folder cannot be listed, or if a frame has two files and none
    /// is named as the pattern says.
    pub fn files(&self) -> Result<BTreeMap<i64, PathBuf>, Error> {
        let mut found = Vec::new();
        self.find(&self.base, &self.names, None, &mut found)?;
        let mut ranked: Vec<_> =
            found.into_iter().map(|(frame, path)| (frame, self.rank(frame, &path), path)).collect();
        ranked.sort_unstable();
        let mut files = BTreeMap::new();
        let mut rank_of_last = None;
        for (frame, rank, path) in ranked {
            match files.get(&frame) {
                None => _ = files.insert(frame, path),
                Some(other) if rank_of_last == Some((frame, rank)) => return Err(twice(frame, other, &path)),
                Some(_) => continue,
            }
            rank_of_last = Some((frame, rank));
        }
        Ok(files)
    }

    /// How far the digits in `path` are from those of the pattern: the lower the nearer.
    fn rank(&self, frame: i64, path: &Path) -> u8 {
        let magnitude = frame.unsigned_abs();
        let signed = || self.filled(|digits| format!("-{magnitude:0digits$}"));
        match path {
            path if path == self.at(frame) => 0,
            path if frame < 0 && path == signed() => 1,
            _ => 2,
        }
    }

    /// Adds to `found` what lies in `folder` under `names`, where the folder's own path has said `number`.
    fn find(
        &self,
        folder: &Path,
        names: &[Name],
        number: Option<i64>,
        found: &mut Vec<(i64, PathBuf)>,
    ) -> Result<(), Error> {
        let Some((name, rest)) = names.split_first() else { return Ok(()) };
        if let ([Piece::Text(text)], false) = (&name[..], rest.is_empty()) {
            return self.find(&folder.join(text), rest, number, found);
        }
        for entry in listing(folder)? {
            let mut number = number;
            if !entry.name.to_str().is_some_and(|text| read(name, text, &mut number)) {
                continue;
            }
            let path = folder.join(entry.name);
            match (number, rest.is_empty()) {
                (_, false) if entry.is_folder => self.find(&path, rest, number, found)?,
                (Some(number), true) if !entry.is_folder => found.push((number, path)),
                _ => {}
            }
        }
        Ok(())
    }
}

/// The longest part of `path` from its start that exists, empty if none does.
pub(super) fn existing(path: &Path) -> &Path {
    path.ancestors().find(|folder| folder.exists()).unwrap_or(Path::new(""))
}

/// What a folder has.
pub(super) struct Entry {
    /// Its name in the folder.
    pub(super) name: OsString,
    /// Whether it is a folder itself.
    pub(super) is_folder: bool,
}

/// What is in `folder`: nothing if it is not there or no folder.
///
/// # Errors
///
/// [`ErrorKind::Input`](crate::error::ErrorKind::Input) if it cannot be listed.
pub(super) fn listing(folder: &Path) -> Result<Vec<Entry>, Error> {
    let here = folder.as_os_str().is_empty();
    let entry = |entry: fs::DirEntry| {
        // Only a link has to be followed, which asks the disk once more.
        let kind = entry.file_type()?;
        let is_folder = kind.is_dir() || (kind.is_symlink() && entry.path().is_dir());
        Ok(Entry { name: entry.file_name(), is_folder })
    };
    let listed = fs::read_dir(if here { Path::new(".") } else { folder });
    match listed.and_then(|entries| entries.map(|listed| listed.and_then(entry)).collect()) {
        Ok(entries) => Ok(entries),
        Err(error) if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => {
            Ok(Vec::new())
        }
        Err(error) => Err(unlisted(folder, error)),
    }
}

/// The pieces of a name.
fn pieces(name: &str) -> Name {
    let mut pieces = Vec::new();
    let mut text = String::new();
    let mut rest = name;
    while let Some(first) = rest.chars().next() {
        let place = place(rest);
        if let Some((_, digits)) = place {
            if !text.is_empty() {
                pieces.push(Piece::Text(std::mem::take(&mut text)));
            }
            pieces.push(Piece::Number(digits));
        } else {
            text.push(first);
        }
        rest = &rest[place.map_or(first.len_utf8(), |(length, _)| length)..];
    }
    if !text.is_empty() {
        pieces.push(Piece::Text(text));
    }
    pieces
}

/// The length of the place for a number that `text` starts with, and its least number of digits.
fn place(text: &str) -> Option<(usize, usize)> {
    let until =
        |from: usize, is: fn(char) -> bool| text[from..].find(|c| !is(c)).map_or(text.len(), |at| from + at);
    let digits_until = |from: usize| {
        let end = until(from, |c| c.is_ascii_digit());
        // What does not fit is far too wide.
        (end, if end == from { 1 } else { text[from..end].parse().unwrap_or(usize::MAX) })
    };
    match text.as_bytes() {
        [b'#' | b'@', ..] => {
            let end = until(0, |c| matches!(c, '#' | '@'));
            let hashes = text[..end].matches('#').count();
            let part_of_a_word = &text[..end] == "@" && text[end..].starts_with(char::is_alphanumeric);
            (!part_of_a_word).then_some((end, end - hashes + if hashes == 1 { 4 } else { hashes }))
        }
        [b'%', ..] => {
            let (end, digits) = digits_until(1);
            text[end..].starts_with('d').then_some((end + 1, digits))
        }
        [b'$', b'{', b'F', ..] => {
            let (end, digits) = digits_until(3);
            text[end..].starts_with('}').then_some((end + 1, digits))
        }
        [b'$', b'F', ..] => {
            let (end, digits) = digits_until(2);
            (!text[end..].starts_with(char::is_alphabetic)).then_some((end, digits))
        }
        _ => None,
    }
}

/// Whether `name` is `pieces` with the same number in all places; `number` is that of earlier names, if it is known, and becomes
/// that of this name.
fn read(pieces: &[Piece], name: &str, number: &mut Option<i64>) -> bool {
    match pieces.split_first() {
        None => name.is_empty(),
        Some((Piece::Text(text), rest)) => {
            name.strip_prefix(text.as_str()).is_some_and(|name| read(rest, name, number))
        }
        Some((Piece::Number(_), rest)) => {
            let sign = usize::from(name.starts_with('-'));
            let digits = name[sign..].bytes().take_while(u8::is_ascii_digit).count();
            // Digits behind the place may be text of the pattern.
            (1..=digits).rev().any(|count| {
                let (spelt, name) = name.split_at(sign + count);
                let mut same = spelt.parse().ok();
                let agrees = same.is_some() && number.is_none_or(|number| same == Some(number));
                let matches = agrees && read(rest, name, &mut same);
                if matches {
                    *number = same;
                }
                matches
            })
        }
    }
}

/// `folder` cannot be listed.
pub(super) fn unlisted(folder: &Path, error: io::Error) -> Error {
    Error::input("the folder cannot be listed").in_file(folder).caused_by(error)
}

/// Two files are the same frame.
pub(super) fn twice(frame: i64, one: &Path, other: &Path) -> Error {
    Error::input(format!("two files are frame {frame}"))
        .with("found", format!("{}, {}", one.display(), other.display()))
        .help("remove one of them, or name the files of the shot by a pattern such as shot.####.exr")
}

/// A place asks for too many digits.
fn too_wide(path: &Path, digits: usize) -> Error {
    Error::settings("the pattern has too many digits for a frame number")
        .in_file(path)
        .with("found", format!("{digits} digits"))
        .with("expected", format!("at most {MOST_DIGITS}, such as #### or %04d"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::ErrorKind;

    /// A pattern whose folders do not exist.
    fn pattern(path: &str) -> Pattern {
        Pattern::parse(Path::new(path)).unwrap().unwrap()
    }

    /// A folder with empty files of these names.
    fn folder_of(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
        }
        folder
    }

    /// The frames that `written` finds in `folder`, with their names.
    fn found(folder: &tempfile::TempDir, written: &str) -> Vec<(i64, String)> {
        let pattern = Pattern::parse(&folder.path().join(written)).unwrap().unwrap();
        let name = |path: PathBuf| path.strip_prefix(folder.path()).unwrap().display().to_string();
        pattern.files().unwrap().into_iter().map(|(frame, path)| (frame, name(path))).collect()
    }

    #[test]
    fn every_notation_writes_its_number_of_digits() {
        for (written, seventh) in [
            ("a.#.exr", "a.0007.exr"),
            ("a.##.exr", "a.07.exr"),
            ("a.####.exr", "a.0007.exr"),
            ("a.######.exr", "a.000007.exr"),
            ("a.@.exr", "a.7.exr"),
            ("a@@@.exr", "a007.exr"),
            ("a.%d.exr", "a.7.exr"),
            ("a%05d.exr", "a00007.exr"),
            ("a.$F.exr", "a.7.exr"),
            ("a.$F4.exr", "a.0007.exr"),
            ("a${F3}b.exr", "a007b.exr"),
            ("a_${F}b.exr", "a_7b.exr"),
            ("####", "0007"),
        ] {
            assert_eq!(pattern(written).at(7), Path::new(seventh), "{written}");
        }
    }

    #[test]
    fn a_number_longer_than_its_place_is_written_whole_and_a_sign_takes_a_digit() {
        assert_eq!(pattern("a.##.exr").at(12345), Path::new("a.12345.exr"));
        assert_eq!(pattern("a.####.exr").at(-5), Path::new("a.-005.exr"));
        assert_eq!(pattern("a.@.exr").at(-5), Path::new("a.-5.exr"));
        assert_eq!(pattern("a.%d.exr").at(i64::MIN), Path::new("a.-9223372036854775808.exr"));
    }

    #[test]
    fn all_places_have_the_same_number_in_folders_too() {
        let pattern = pattern("no_such_folder/####/beauty.@@.exr");
        assert_eq!(pattern.at(12), Path::new("no_such_folder/0012/beauty.12.exr"));
        assert_eq!(pattern.number_of(Path::new("no_such_folder/0012/beauty.12.exr")), Some(12));
        assert_eq!(pattern.number_of(Path::new("no_such_folder/0012/beauty.13.exr")), None);
        assert_eq!(pattern.number_of(Path::new("no_such_folder/0012/x/beauty.12.exr")), None);
    }

    #[test]
    fn names_without_a_place_are_no_patterns() {
        for name in [
            "a.exr",
            "a.0001.exr",
            "user@host.exr",
            "plate@2x.exr",
            "100%.exr",
            "50%dust%4.exr",
            "$FF.exr",
            "$HOME",
            "${F",
        ] {
            let is_pattern = name == "50%dust%4.exr";
            assert_eq!(Pattern::parse(Path::new(name)).unwrap().is_some(), is_pattern, "{name}");
        }
    }

    #[test]
    fn what_exists_is_no_pattern() {
        let folder = folder_of(&["take#1/shot.0001.exr", "take#1/a.####.exr"]);
        let parse = |name: &str| Pattern::parse(&folder.path().join("take#1").join(name)).unwrap();
        assert_eq!(parse("a.####.exr"), None, "a file of that name is there");
        let shot = parse("shot.####.exr").unwrap();
        assert_eq!(
            shot.at(2),
            folder.path().join("take#1/shot.0002.exr"),
            "the folder of that name is there"
        );
    }

    #[test]
    fn too_many_digits_are_an_error() {
        for name in ["a%033d.exr", "a.$F99999999999999999999.exr", &"#".repeat(33)] {
            assert_eq!(Pattern::parse(Path::new(name)).unwrap_err().kind(), ErrorKind::Settings, "{name}");
        }
        assert_eq!(pattern(&"#".repeat(32)).at(1).as_os_str().len(), 32);
    }

    #[test]
    fn the_number_of_a_name_is_that_of_which_the_pattern_makes_the_name() {
        for written in ["a.####.exr", "a@b.@.exr", "a%03d1.exr", "1$F.exr", "a-##.exr", "##_##"] {
            let pattern = pattern(written);
            for frame in [0, 1, -1, 42, -42, 99_999, 11, i64::MAX, i64::MIN] {
                assert_eq!(pattern.number_of(&pattern.at(frame)), Some(frame), "{written} {frame}");
            }
            assert_eq!(pattern.number_of(Path::new("b.0001.exr")), None, "{written}");
        }
    }

    #[test]
    fn files_are_found_whatever_their_digits_rising() {
        let names = ["a.0010.exr", "a.0009.exr", "a.12345.exr", "a.-0005.exr", "a.-003.exr", "a.2.exr"];
        let folder =
            folder_of(&[&names[..], &["a.x.exr", "a.0001.exr.tmp", "b.0001.exr", "a.0003.exr/x"]].concat());
        let frames: Vec<i64> = found(&folder, "a.####.exr").into_iter().map(|(frame, _)| frame).collect();
        assert_eq!(frames, [-5, -3, 2, 9, 10, 12345]);
        assert_eq!(found(&folder, "a.@.exr").len(), 6);
        assert_eq!(found(&folder, "c.####.exr"), []);
        assert_eq!(found(&folder, "no_folder/####/c.exr"), []);
    }

    #[test]
    fn files_are_found_in_folders_that_vary() {
        let names = ["0001/b.0001.exr", "0002/b.2.exr", "0003/b.0004.exr", "x/b.0005.exr", "0006"];
        let folder = folder_of(&names);
        let expected =
            [(1, "0001/b.0001.exr"), (2, "0002/b.2.exr")].map(|(frame, name)| (frame, name.to_owned()));
        assert_eq!(found(&folder, "####/b.####.exr"), expected);
        assert_eq!(found(&folder, "####/b.0004.exr"), [(3, "0003/b.0004.exr".to_owned())]);
    }

    #[test]
    fn of_two_files_of_one_frame_the_padded_one_counts() {
        let folder = folder_of(&["a.1.exr", "a.0001.exr", "a.01.exr", "a.-0002.exr", "a.-2.exr"]);
        let expected = [(-2, "a.-0002.exr"), (1, "a.0001.exr")].map(|(frame, name)| (frame, name.to_owned()));
        assert_eq!(found(&folder, "a.####.exr"), expected);
    }

    #[test]
    fn two_files_of_one_frame_that_the_pattern_does_not_write_are_an_error_that_names_both() {
        let folder = folder_of(&["a.1.exr", "a.01.exr"]);
        let error = Pattern::parse(&folder.path().join("a.####.exr")).unwrap().unwrap().files().unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Input);
        let said = error.to_string();
        assert!(said.contains("frame 1") && said.contains("a.1.exr") && said.contains("a.01.exr"), "{said}");
    }

    #[cfg(unix)]
    #[test]
    fn names_that_are_no_text_are_neither_patterns_nor_frames() {
        use std::ffi::OsStr;
        use std::os::unix::ffi::OsStrExt;
        let odd = Path::new(OsStr::from_bytes(b"a\xff.####.exr"));
        assert_eq!(Pattern::parse(odd).unwrap(), None);
        let folder = folder_of(&["a.0001.exr"]);
        fs::write(folder.path().join(OsStr::from_bytes(b"a\xff.0002.exr")), "").unwrap();
        assert_eq!(found(&folder, "a.####.exr").len(), 1);
        assert_eq!(pattern("a.####.exr").number_of(odd), None);
    }
}
