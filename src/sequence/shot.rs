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
        let shot = match Self::are_frames(inputs) {
            true => Self::of_files(inputs, Some(frames)),
            false => Self::of(series, Some(frames)),
        };
        shot.map(Some)
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

    /// Whether `files` look like frames of a shot: there are several, and their names differ in the frame number alone. Peels and
    /// layers (`peel0.exr`, `layer_1.exr`) do not.
    pub fn are_frames(files: &[PathBuf]) -> bool {
        files.len() > 1 && Moving::each(files).is_ok_and(|moving| moving.is_one_sequence())
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::ErrorKind;
    use std::fs;
    use tempfile::TempDir;

    /// A folder with empty files of these names.
    fn folder_of(names: &[&str]) -> TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
        }
        folder
    }

    /// What `Shot::find` says of these inputs in `folder`.
    fn find(folder: &TempDir, inputs: &[&str], frames: Option<&str>) -> Result<Option<Shot>, Error> {
        let inputs: Vec<PathBuf> = inputs.iter().map(|name| folder.path().join(name)).collect();
        Shot::find(&inputs, frames.map(|text| FrameSet::parse(text).unwrap()).as_ref())
    }

    /// The shot of these inputs in `folder`.
    fn shot(folder: &TempDir, inputs: &[&str], frames: Option<&str>) -> Shot {
        find(folder, inputs, frames).unwrap().unwrap()
    }

    /// The error of these inputs in `folder`.
    fn error(folder: &TempDir, inputs: &[&str], frames: Option<&str>) -> Error {
        find(folder, inputs, frames).unwrap_err()
    }

    /// The frames of `shot`, each as its number and the names of its files in `folder`.
    fn frames(folder: &TempDir, shot: &Shot) -> Vec<String> {
        let name = |path: &PathBuf| path.strip_prefix(folder.path()).unwrap().display().to_string();
        let frame = |frame: &ShotFrame| {
            let names: Vec<String> = frame.inputs.iter().map(name).collect();
            format!("{}: {}", frame.number, names.join(" "))
        };
        shot.frames.iter().map(frame).collect()
    }

    /// The numbers of the frames of `shot`.
    fn numbers(shot: &Shot) -> Vec<i64> {
        shot.frames.iter().map(|frame| frame.number).collect()
    }

    /// All findings of `shot`.
    fn said(shot: &Shot) -> String {
        shot.findings.iter().map(|finding| finding.text.as_str()).collect::<Vec<_>>().join("; ")
    }

    #[test]
    fn plain_files_without_frames_are_one_frame() {
        let folder = folder_of(&["peel0.exr", "peel1.exr", "a.####.exr"]);
        assert!(find(&folder, &["peel0.exr", "peel1.exr"], None).unwrap().is_none());
        assert!(find(&folder, &["not_there.0001.exr"], None).unwrap().is_none(), "reading says so");
        assert!(find(&folder, &["a.####.exr"], None).unwrap().is_none(), "a file has this name");
        assert!(Shot::find(&[], Some(&FrameSet::from_numbers([1]))).unwrap().is_none());
    }

    #[test]
    fn without_frames_all_that_are_there_rise() {
        let folder = folder_of(&["a.0010.exr", "a.0009.exr", "a.-001.exr", "b.0001.exr"]);
        let shot = shot(&folder, &["a.####.exr"], None);
        assert_eq!(frames(&folder, &shot), ["-1: a.-001.exr", "9: a.0009.exr", "10: a.0010.exr"]);
        assert!(shot.missing.is_empty());
    }

    #[test]
    fn frames_come_in_the_order_asked_for_and_so_do_the_missing() {
        let folder = folder_of(&["a.0001.exr", "a.0002.exr", "a.0003.exr"]);
        let shot = shot(&folder, &["a.####.exr"], Some("5-2,1,9"));
        assert_eq!(numbers(&shot), [3, 2, 1]);
        assert_eq!(shot.missing, [5, 4, 9]);
        assert_eq!(shot.absent(5), [folder.path().join("a.0005.exr")]);
        assert!(shot.absent(3).is_empty());
    }

    #[test]
    fn inputs_advance_together_and_keep_their_order() {
        let names = ["c.1.exr", "c.2.exr", "c.3.exr", "z/0001.exr", "z/0003.exr", "sky.exr"];
        let folder = folder_of(&names);
        let shot = shot(&folder, &["z/####.exr", "sky.exr", "c.@.exr"], None);
        assert_eq!(
            frames(&folder, &shot),
            ["1: z/0001.exr sky.exr c.1.exr", "3: z/0003.exr sky.exr c.3.exr"]
        );
        assert_eq!(shot.missing, [2]);
        assert_eq!(shot.absent(2), [folder.path().join("z/0002.exr")]);
        let warning = shot.findings.iter().find(|finding| finding.warning).unwrap();
        assert!(warning.text.contains(": 2;") && warning.text.contains("0002.exr"), "{}", warning.text);
        assert_eq!(
            shot.inputs_at(7),
            ["z/0007.exr", "sky.exr", "c.7.exr"].map(|name| folder.path().join(name))
        );
    }

    #[test]
    fn a_still_is_the_same_for_every_frame() {
        let folder = folder_of(&["still.0007.exr", "depth.exr"]);
        let one = shot(&folder, &["still.0007.exr"], Some("3-4"));
        assert_eq!(frames(&folder, &one), ["3: still.0007.exr", "4: still.0007.exr"]);
        assert!(said(&one).contains("the same"), "{}", said(&one));
        let two = shot(&folder, &["still.0007.exr", "depth.exr"], Some("3"));
        assert_eq!(frames(&folder, &two), ["3: still.0007.exr depth.exr"]);
    }

    #[test]
    fn plain_files_that_differ_in_their_number_are_frames_where_frames_are_given() {
        let folder = folder_of(&[]);
        let names = ["a.0002.exr", "a.0001.exr"];
        let of_two = shot(&folder, &names, Some("1-3"));
        assert_eq!(frames(&folder, &of_two), ["1: a.0001.exr", "2: a.0002.exr"]);
        assert_eq!(
            (of_two.missing.clone(), of_two.absent(3)),
            (vec![3], vec![folder.path().join("a.0003.exr")])
        );
        let peels = shot(&folder, &["peel0.exr", "peel1.exr"], Some("1"));
        assert_eq!(frames(&folder, &peels), ["1: peel0.exr peel1.exr"], "peels are not frames");
        let two_names = shot(&folder, &["a.0001.exr", "b.0001.exr"], Some("1"));
        assert_eq!(frames(&folder, &two_names), ["1: a.0001.exr b.0001.exr"]);
    }

    #[test]
    fn files_look_like_frames_where_the_frame_number_alone_differs() {
        let are_frames =
            |names: &[&str]| Shot::are_frames(&names.iter().map(PathBuf::from).collect::<Vec<_>>());
        assert!(are_frames(&["shot.0001.exr", "shot.0002.exr", "shot.0003.exr"]));
        assert!(are_frames(&["env0001.exr", "env0002.exr"]));
        assert!(are_frames(&["layer_0001.exr", "layer_0002.exr"]));
        for peels in [
            ["peel0.exr", "peel1.exr"],
            ["layer_0.exr", "layer_1.exr"],
            ["a.0007.Peel.00.exr", "a.0007.Peel.01.exr"],
        ] {
            assert!(!are_frames(&peels), "{peels:?}");
        }
        assert!(!are_frames(&["beauty.0001.exr", "depth.0001.exr"]));
        assert!(!are_frames(&["shot.0001.exr"]) && !are_frames(&[]));
    }

    #[test]
    fn a_wildcard_is_the_one_sequence_that_it_matches() {
        let names =
            ["a.0001.001.exr", "a.0002.001.exr", ".a.0003.001.exr", "a.0009.001.exr/x", "1/c.exr", "2/c.exr"];
        let folder = folder_of(&names);
        let of_files = shot(&folder, &["a.*.exr"], None);
        assert_eq!(frames(&folder, &of_files), ["1: a.0001.001.exr", "2: a.0002.001.exr"]);
        assert!(said(&of_files).contains("a.####.001.exr (1-2)"), "{}", said(&of_files));
        assert_eq!(of_files.inputs_at(3), [folder.path().join("a.0003.001.exr")]);
        let of_folders = shot(&folder, &["?/c.exr"], None);
        assert_eq!(frames(&folder, &of_folders), ["1: 1/c.exr", "2: 2/c.exr"]);
        let none = error(&folder, &["b.*.exr"], None);
        assert_eq!(none.kind(), ErrorKind::Input);
        assert_eq!(shot(&folder, &["b.*.exr"], Some("4")).missing, [4]);
    }

    #[test]
    fn wildcards_in_folders_that_exist_are_letters() {
        let folder = folder_of(&["take[1]*/a.0001.exr", "take1x/a.0002.exr"]);
        assert_eq!(numbers(&shot(&folder, &["take[1]*/a.*.exr"], None)), [1]);
    }

    #[test]
    fn wildcards_and_a_frame_number_together_are_wrong_use() {
        let folder = folder_of(&["a.0001.exr"]);
        assert_eq!(error(&folder, &["*.####.exr"], None).kind(), ErrorKind::Settings);
        assert_eq!(error(&folder, &["***.exr"], None).kind(), ErrorKind::Settings);
    }

    #[test]
    fn a_folder_is_the_one_sequence_in_it() {
        let folder = folder_of(&["s/a.1.exr", "s/a.2.EXR", "s/notes.txt", "t/a.9.exr", "t/a.10.exr", "u/x"]);
        assert_eq!(numbers(&shot(&folder, &["t"], None)), [9, 10]);
        assert_eq!(
            error(&folder, &["s"], None).kind(),
            ErrorKind::Settings,
            "two extensions are two sequences"
        );
        assert_eq!(error(&folder, &["u"], None).kind(), ErrorKind::Input, "no pictures");
    }

    #[test]
    fn a_folder_of_several_sequences_is_an_error_that_lists_them() {
        let folder = folder_of(&["b.0001.exr", "b.0002.exr", "d.0001.exr", "d.0002.exr", "still.exr"]);
        let error = error(&folder, &["."], None);
        let said = error.to_string();
        assert_eq!(error.kind(), ErrorKind::Settings);
        assert!(said.contains("b.####.exr (1-2)") && said.contains("d.####.exr (1-2)"), "{said}");
        assert!(said.contains("still.exr"), "{said}");
    }

    #[test]
    fn gaps_are_said_and_a_regular_step_has_none() {
        let folder = folder_of(&[
            "a.1.exr", "a.3.exr", "a.5.exr", "a.11.exr", "b.2.exr", "b.4.exr", "b.5.exr", "b.9.exr",
        ]);
        assert_eq!(said(&shot(&folder, &["a.@.exr"], None)), "4 frames, 1 to 11; not there: 7-9x2");
        assert_eq!(said(&shot(&folder, &["b.@.exr"], None)), "4 frames, 2 to 9; not there: 3,6-8");
        assert_eq!(said(&shot(&folder, &["b.@.exr"], Some("2,4"))), "", "those asked for are there");
        fs::remove_file(folder.path().join("a.11.exr")).unwrap();
        assert_eq!(said(&shot(&folder, &["a.@.exr"], None)), "", "every second frame");
    }

    #[test]
    fn the_ends_of_64_bits_are_frames_with_a_gap_between() {
        let folder = folder_of(&["a.-9223372036854775808.exr", "a.9223372036854775807.exr", "a.0.exr"]);
        let text = said(&shot(&folder, &["a.@.exr"], None));
        assert!(text.contains("-9223372036854775807--1,1-9223372036854775806"), "{text}");
    }

    #[test]
    fn without_any_frame_the_error_says_what_is_there() {
        let folder = folder_of(&["beauty.0001.exr", "beauty.0002.exr", "depth.0007.exr"]);
        let wrong_name = error(&folder, &["colour.####.exr"], None);
        assert_eq!(wrong_name.kind(), ErrorKind::Input);
        assert!(wrong_name.to_string().contains("beauty.####.exr (1-2)"), "{wrong_name}");
        let nothing_shared = error(&folder, &["beauty.####.exr", "depth.####.exr"], None).to_string();
        assert!(nothing_shared.contains("(1-2)") && nothing_shared.contains("(7)"), "{nothing_shared}");
    }

    #[test]
    fn of_files_numbers_each_by_what_varies() {
        let paths = |names: &[&str]| names.iter().map(PathBuf::from).collect::<Vec<_>>();
        let files = paths(&["x/a.0002.001.exr", "x/a.0001.001.exr", "x/a.0001.001.exr"]);
        let shot = Shot::of_files(&files, None).unwrap();
        assert_eq!(numbers(&shot), [1, 2], "a file named twice is one frame");
        assert_eq!(
            Shot::of_files(&files, Some(&FrameSet::from_numbers([2, 1]))).unwrap().frames[0].number,
            2
        );
        let two_names = Shot::of_files(&paths(&["a.0001.exr", "b.0002.exr"]), None).unwrap();
        assert_eq!(numbers(&two_names), [1, 2]);
    }

    #[test]
    fn two_files_of_one_number_are_an_error_that_names_both() {
        for names in [["peel0.0005.exr", "peel1.0005.exr"], ["a.5.exr", "a.05.exr"]] {
            let error = Shot::of_files(&names.map(PathBuf::from), None).unwrap_err();
            let said = error.to_string();
            assert_eq!(error.kind(), ErrorKind::Input);
            assert!(said.contains("frame 5") && names.iter().all(|name| said.contains(name)), "{said}");
        }
        let folder = folder_of(&["a.5.exr", "a.05.exr"]);
        assert!(error(&folder, &["a.*.exr"], None).to_string().contains("frame 5"));
    }

    #[test]
    fn a_file_without_a_number_is_no_frame() {
        let error = Shot::of_files(&["cam1.exr", "cam2.exr"].map(PathBuf::from), None).unwrap_err();
        assert!(error.to_string().contains("cam1.exr"), "{error}");
    }
}
