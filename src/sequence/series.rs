//! The files of one input of a shot, by frame: from a pattern, a wildcard, a folder or a list.

use super::frame_set::FrameSet;
use super::pattern::{Entry, Pattern, existing, listing, twice, unlisted};
use crate::error::Error;
use crate::stack::{Numbered, frame_numbers};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The most sequences that a message lists.
const MOST_LISTED: usize = 8;

/// One input of a shot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Series {
    /// The same file for every frame.
    Still(PathBuf),
    /// A file a frame.
    Moving(Moving),
}

/// A file a frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Moving {
    /// How the files are called, or else what the user wrote for them.
    name: Result<Pattern, PathBuf>,
    /// The files that exist, by frame.
    files: BTreeMap<i64, PathBuf>,
    /// Whether the name was concluded from the files.
    pub(super) is_concluded: bool,
}

impl Series {
    /// The files of `input`: a pattern, a wildcard, a folder, or else one file.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Settings`](crate::error::ErrorKind::Settings) if `input` is no valid pattern, or if a wildcard or a folder
    /// has more than one sequence; [`ErrorKind::Input`](crate::error::ErrorKind::Input) if a folder cannot be listed or a frame
    /// has two files.
    pub(super) fn of(input: &Path) -> Result<Self, Error> {
        if input.is_dir() {
            return Ok(Self::Moving(Moving::only(input, pictures_in(input)?)?));
        }
        let wildcard = wildcard(input);
        match (Pattern::parse(input)?, wildcard) {
            (Some(_), Some(_)) => Err(Error::settings("a file name has either a frame number or wildcards")
                .in_file(input)
                .help("write shot.####.exr or 'shot.*.exr'")),
            (Some(pattern), None) => {
                let files = pattern.files()?;
                Ok(Self::Moving(Moving { name: Ok(pattern), files, is_concluded: false }))
            }
            (None, Some(wildcard)) => Ok(Self::Moving(Moving::only(input, matching(&wildcard)?)?)),
            (None, None) => Ok(Self::Still(input.to_owned())),
        }
    }

    /// Where the file of `frame` is, or would be.
    pub(super) fn at(&self, frame: i64) -> PathBuf {
        match self {
            Self::Still(path) => path.clone(),
            Self::Moving(moving) => moving.at(frame),
        }
    }
}

impl Moving {
    /// Each of `files` as a frame of its own.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Input`](crate::error::ErrorKind::Input) if a file has no frame number, or two have the same.
    pub(super) fn each(files: &[PathBuf]) -> Result<Self, Error> {
        let Found { sequences, stills } = Found::among(files)?;
        if let Some(still) = stills.first() {
            return Err(Error::input("the file's name has no frame number").in_file(still).help(
                "number the files of a shot, as in shot.0001.exr; sizes, versions, cameras and dates are not frame numbers",
            ));
        }
        let name = match &sequences[..] {
            [one] => one.name.clone(),
            _ => Err(PathBuf::new()),
        };
        let mut all = Self { name, files: BTreeMap::new(), is_concluded: true };
        for (frame, path) in sequences.into_iter().flat_map(|sequence| sequence.files) {
            all.add(frame, path)?;
        }
        Ok(all)
    }

    /// The one sequence that `files` are, which the user wrote as `input`. Without files it has no frames.
    fn only(input: &Path, files: Vec<PathBuf>) -> Result<Self, Error> {
        let mut found = Found::among(&files)?;
        match (found.sequences.pop(), &found.sequences[..], &found.stills[..]) {
            (Some(one), [], []) => Ok(one),
            (None, [], []) => {
                Ok(Self { name: Err(input.to_owned()), files: BTreeMap::new(), is_concluded: true })
            }
            (last, ..) => {
                found.sequences.extend(last);
                Err(not_one_sequence(input, &found))
            }
        }
    }

    /// Adds the file of a frame.
    fn add(&mut self, frame: i64, path: PathBuf) -> Result<(), Error> {
        match self.files.get(&frame) {
            Some(other) if *other != path => Err(twice(frame, other, &path)),
            _ => {
                self.files.insert(frame, path);
                Ok(())
            }
        }
    }

    /// The frames that have a file, rising.
    pub(super) fn frames(&self) -> impl Iterator<Item = i64> + '_ {
        self.files.keys().copied()
    }

    /// Whether the files' names differ in the frame number alone.
    pub(super) fn is_one_sequence(&self) -> bool {
        self.name.is_ok()
    }

    /// Whether `frame` has a file.
    pub(super) fn has(&self, frame: i64) -> bool {
        self.files.contains_key(&frame)
    }

    /// Where the file of `frame` is, or would be.
    fn at(&self, frame: i64) -> PathBuf {
        let would_be = || self.name.as_ref().map_or_else(Clone::clone, |pattern| pattern.at(frame));
        self.files.get(&frame).cloned().unwrap_or_else(would_be)
    }

    /// How the files are called.
    pub(super) fn name(&self) -> &Path {
        self.name.as_ref().map_or_else(PathBuf::as_path, Pattern::as_path)
    }

    /// How the files are called, with their frames.
    pub(super) fn described(&self) -> String {
        let frames = FrameSet::from_numbers(self.frames());
        format!("{} ({frames})", self.name().display())
    }

    /// The sequences in the folder of files that were not found.
    pub(super) fn neighbours(&self) -> Option<String> {
        let files = pictures_in(self.name().parent()?).ok()?;
        Some(Found::among(&files).ok()?.described()).filter(|text| !text.is_empty())
    }
}

/// What files are together.
struct Found {
    /// Files with frame numbers, by name.
    sequences: Vec<Moving>,
    /// Files without.
    stills: Vec<PathBuf>,
}

impl Found {
    /// What `files` are.
    fn among(files: &[PathBuf]) -> Result<Self, Error> {
        let mut stills = Vec::new();
        let mut alike: BTreeMap<Vec<String>, Vec<(&PathBuf, Numbered)>> = BTreeMap::new();
        for (path, numbered) in files.iter().zip(frame_numbers(files.iter().map(PathBuf::as_path))) {
            match numbered {
                Some(numbered) => alike.entry(numbered.texts.clone()).or_default().push((path, numbered)),
                None => stills.push(path.clone()),
            }
        }
        let mut sequences = Vec::with_capacity(alike.len());
        for (texts, members) in alike {
            let mut digits = vec![usize::MAX; texts.len() - 1];
            for (least, here) in members.iter().flat_map(|(_, numbered)| (0..).zip(&numbered.digits)) {
                digits[least] = digits[least].min(*here);
            }
            let name = Ok(Pattern::between(&texts, &digits));
            let mut sequence = Moving { name, files: BTreeMap::new(), is_concluded: true };
            for (path, numbered) in members {
                sequence.add(numbered.frame, path.clone())?;
            }
            sequences.push(sequence);
        }
        Ok(Self { sequences, stills })
    }

    /// The sequences with their frames, and the other files.
    fn described(&self) -> String {
        let sequences = self.sequences.iter().map(Moving::described);
        let all = sequences.chain(self.stills.iter().map(|path| path.display().to_string()));
        let mut listed: Vec<String> = all.take(MOST_LISTED).collect();
        let more = self.sequences.len() + self.stills.len() - listed.len();
        listed.extend((more > 0).then(|| format!("{more} more")));
        listed.join(", ")
    }
}

/// `path` with what exists of it escaped, if the rest has wildcards.
fn wildcard(path: &Path) -> Option<String> {
    let base = existing(path);
    let rest = path.strip_prefix(base).ok()?.to_str()?;
    let has_wildcards =
        rest.contains(['*', '?']) || rest.find('[').is_some_and(|at| rest[at..].contains(']'));
    let base = glob::Pattern::escape(base.to_str()?);
    has_wildcards.then(|| Path::new(&base).join(rest).to_string_lossy().into_owned())
}

/// The files that `wildcard` matches, by name. Hidden ones are matched by a dot only.
fn matching(wildcard: &str) -> Result<Vec<PathBuf>, Error> {
    let mut options = glob::MatchOptions::new();
    options.require_literal_separator = true;
    options.require_literal_leading_dot = true;
    let wrong =
        |error| Error::settings("the wildcards are not valid").with("found", wildcard).caused_by(error);
    let mut files = Vec::new();
    for found in glob::glob_with(wildcard, options).map_err(wrong)? {
        let path = found.map_err(|error| {
            let folder = error.path().to_owned();
            unlisted(&folder, error.into())
        })?;
        files.extend(Some(path).filter(|path| !path.is_dir()));
    }
    Ok(files)
}

/// The OpenEXR files in `folder`, by name, but for hidden ones.
fn pictures_in(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let is_picture = |entry: &Entry| {
        let name = Path::new(&entry.name);
        let is_exr = name.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr"));
        is_exr && !entry.is_folder && !name.to_string_lossy().starts_with('.')
    };
    let pictures = listing(folder)?.into_iter().filter(is_picture);
    let mut files: Vec<PathBuf> = pictures.map(|entry| folder.join(entry.name)).collect();
    files.sort_unstable();
    Ok(files)
}

/// `input` is not one sequence.
fn not_one_sequence(input: &Path, found: &Found) -> Error {
    let what = match found.sequences.is_empty() {
        true => "the files have no frame numbers",
        false => "the files are more than one sequence",
    };
    Error::settings(what)
        .in_file(input)
        .with("found", found.described())
        .help("name the inputs of a frame one by one, each as a pattern such as beauty.####.exr")
}
