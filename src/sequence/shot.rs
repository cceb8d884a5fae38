//! The frames of a shot, with the files of each.

use super::frame_set::FrameSet;
use super::series::{Moving, Series};
use crate::error::Error;
use crate::finding::Finding;
use std::collections::BTreeSet;
use std::path::PathBuf;

/// The most gaps between frames that a finding lists.
const MOST_GAPS: usize = 8;

/// A frame of a shot.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct ShotFrame {
    /// Its number.
    pub number: i64,
    /// Its files, in the order of the shot's inputs.
    pub inputs: Vec<PathBuf>,
}

/// The frames of a shot.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Shot {
    /// The frames that have all their files: in the order in which they were asked for, or else rising.
    pub frames: Vec<ShotFrame>,
    /// The frames that lack a file, in the same order: of those asked for, or else of those of which another file is there.
    /// [`Shot::absent`] says which file.
    pub missing: Vec<i64>,
    /// What was concluded from the names of the files.
    pub findings: Vec<Finding>,
    /// The inputs.
    series: Vec<Series>,
}

impl Shot {
    /// The shot that `inputs` are, or nothing if they are the files of one frame. An input is
    ///
    /// * a [`Pattern`](super::Pattern), or a wildcard (`shot.*.exr`) or a folder whose files are one sequence: a file a frame;
    /// * another file: the same for every frame. Several files whose names differ in their frame number alone are frames of
    ///   their own where `frames` are given.
    ///
    /// `frames` are those wanted, in their order; without them all frames of which a file is there are.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Settings`](crate::error::ErrorKind::Settings) if a pattern is invalid, or a wildcard or folder has more than
    /// one sequence; [`ErrorKind::Input`](crate::error::ErrorKind::Input) if a folder cannot be listed, two files are one frame,
    /// or, without `frames`, no frame has all its files.
    pub fn find(inputs: &[PathBuf], frames: Option<&FrameSet>) -> Result<Option<Self>, Error> {
        let series = inputs.iter().map(|input| Series::of(input)).collect::<Result<Vec<_>, _>>()?;
        if series.iter().any(|series| matches!(series, Series::Moving(_))) {
            return Self::of(series, frames).map(Some);
        }
        let Some(frames) = frames.filter(|_| !inputs.is_empty()) else { return Ok(None) };
        match Moving::each(inputs) {
            Ok(moving) if inputs.len() > 1 && moving.is_one_sequence() => {
                Self::of(vec![Series::Moving(moving)], Some(frames)).map(Some)
            }
            _ => Self::of(series, Some(frames)).map(Some),
        }
    }

    /// The shot whose frames are `files`, each a frame of its own, numbered by the number in its name that varies. `frames` as in
    /// [`Shot::find`].
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Input`](crate::error::ErrorKind::Input) if a file has no frame number or two have the same, or if there are no
    /// files and no `frames`.
    pub fn of_files(files: &[PathBuf], frames: Option<&FrameSet>) -> Result<Self, Error> {
        Self::of(vec![Series::Moving(Moving::each(files)?)], frames)
    }

    /// Where the files of `frame` are, or would be.
    pub fn inputs_at(&self, frame: i64) -> Vec<PathBuf> {
        self.series.iter().map(|series| series.at(frame)).collect()
    }

    /// The files that `frame` lacked when the shot was found. Where files follow no pattern, it is what was written for them.
    pub fn absent(&self, frame: i64) -> Vec<PathBuf> {
        let lacks = |series: &&Series| matches!(series, Series::Moving(moving) if !moving.has(frame));
        self.series.iter().filter(lacks).map(|series| series.at(frame)).collect()
    }

    /// The shot of these inputs.
    fn of(series: Vec<Series>, frames: Option<&FrameSet>) -> Result<Self, Error> {
        let mut shot = Self { frames: Vec::new(), missing: Vec::new(), findings: Vec::new(), series };
        let there: BTreeSet<i64> = shot.moving().flat_map(Moving::frames).collect();
        match frames {
            Some(frames) => frames.iter().for_each(|frame| shot.add(frame)),
            None => there.iter().for_each(|&frame| shot.add(frame)),
        }
        if frames.is_none() && shot.frames.is_empty() {
            return Err(no_frames(&shot));
        }
        shot.findings = findings(&shot, frames, &there);
        Ok(shot)
    }

    /// Puts `number` with the frames or the missing ones.
    fn add(&mut self, number: i64) {
        if self.moving().all(|moving| moving.has(number)) {
            self.frames.push(ShotFrame { number, inputs: self.inputs_at(number) });
        } else {
            self.missing.push(number);
        }
    }

    /// The inputs that vary.
    fn moving(&self) -> impl Iterator<Item = &Moving> {
        self.series.iter().filter_map(|series| match series {
            Series::Moving(moving) => Some(moving),
            Series::Still(_) => None,
        })
    }
}

/// What the names of the files of `shot` say; `there` are the frames of which a file is.
fn findings(shot: &Shot, frames: Option<&FrameSet>, there: &BTreeSet<i64>) -> Vec<Finding> {
    let mut findings = Vec::new();
    let concluded = shot.moving().filter(|moving| moving.is_concluded && moving.frames().next().is_some());
    findings.extend(concluded.map(|moving| {
        Finding::note("frames", format!("each file is a frame of its own: {}", moving.described()))
    }));
    if shot.moving().next().is_none() {
        findings.push(Finding::note("frames", "the inputs are the same for every frame"));
    }
    if frames.is_some() {
        return findings;
    }
    if let Some(gaps) = gaps(there) {
        findings.push(Finding::note("frames", gaps));
    }
    if let Some(&first) = shot.missing.first() {
        let files: Vec<String> = shot.absent(first).iter().map(|path| path.display().to_string()).collect();
        let missing = FrameSet::from_numbers(shot.missing.iter().copied());
        let text = format!(
            "left out, since not all their files are there: {missing}; there is no {}",
            files.join(", ")
        );
        findings.push(Finding::warning("frames", text));
    }
    findings
}

/// Which numbers are left out between the first and the last of `frames`, going by the largest step that meets them all.
fn gaps(frames: &BTreeSet<i64>) -> Option<String> {
    let (first, last) = (frames.first()?, frames.last()?);
    let pairs = || frames.iter().zip(frames.iter().skip(1)).map(|(a, b)| (i128::from(*a), i128::from(*b)));
    let step = pairs().fold(0, |step, (a, b)| common_divisor(step, b - a));
    let gaps = pairs().filter(|(a, b)| b - a > step).map(|(a, b)| match (a + step, b - step) {
        (from, to) if from == to => from.to_string(),
        (from, to) if step == 1 => format!("{from}-{to}"),
        (from, to) => format!("{from}-{to}x{step}"),
    });
    let mut gaps: Vec<String> = gaps.collect();
    let more = gaps.len().saturating_sub(MOST_GAPS);
    gaps.truncate(MOST_GAPS);
    let text = gaps.join(",");
    let more = if more > 0 { format!(" and {more} more gaps") } else { String::new() };
    (!text.is_empty()).then(|| format!("{} frames, {first} to {last}; not there: {text}{more}", frames.len()))
}

/// The greatest common divisor of two numbers that are not negative.
fn common_divisor(a: i128, b: i128) -> i128 {
    if b == 0 { a } else { common_divisor(b, a % b) }
}

/// No frame of `shot` has all its files.
fn no_frames(shot: &Shot) -> Error {
    let described = |moving: &Moving| match moving.frames().next() {
        Some(_) => moving.described(),
        None => format!("{} (no files)", moving.name().display()),
    };
    let found: Vec<String> = shot.moving().map(described).collect();
    let error = Error::input("no frame has all its files").with("found", found.join(", "));
    let empty = shot.moving().find(|moving| moving.frames().next().is_none());
    let error = match empty.and_then(Moving::neighbours) {
        Some(neighbours) => error.with("in the folder", neighbours),
        None => error,
    };
    error.help("a pattern such as shot.####.exr stands for files such as shot.0001.exr; all inputs have the same numbers")
}
