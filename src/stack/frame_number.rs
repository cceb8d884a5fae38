//! The frame number, from the names of files.
//!
//! It is the last number before the extension that can be one. Of files that are one frame together it occurs in the names of all:
//! `peel0.0042.exr` and `peel1.0042.exr` are frame 42. Of files that are frames of a sequence it is the last number that varies:
//! `shot.0001.001.exr` and `shot.0002.001.exr` are frames 1 and 2.
//!
//! No frame numbers are:
//!
//! | number | such as |
//! | --- | --- |
//! | before a letter: sizes, rates, units | `4k`, `1080p`, `1920x1080`, `24fps`, `50mm`, `2x` |
//! | behind a letter that stands behind a digit | the last of `1920x1080`, of `9f3c2` |
//! | behind a word that counts something else | `v002`, `sh020`, `cam1`, `peel0`, `rec709` |
//! | of a peel or layer, of one or two digits | `peel_1`, `layer.02`; but `layer_0002` is frame 2 |
//! | an f-number | `f22`, `f2.8`; but `f0022` is frame 22 |
//! | a date | `2026-11-26`, `2026_11_26` |
//!
//! A dash before the number is its sign where nothing is left of it that it could join: at the start of a name and behind `.`,
//! `_`, `-` or a space. `pull.-0005.exr` is frame −5, `shot-0005.exr` frame 5.

use super::Source;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

/// Words before a number that count something else than frames: versions, places of a film, cameras, layers, colour spaces.
const OTHER_COUNTS: [&str; 24] = [
    "v", "ver", "version", "rev", "take", "tk", "s", "sc", "sq", "sh", "ep", "cam", "camera", "view", "peel",
    "layer", "pass", "lod", "rec", "bt", "aces", "iso", "spp", "x",
];

/// Words that count peels also where a dot, dash or underscore stands before the number, of at most [`PEEL_DIGITS`].
const PEELS: [&str; 2] = ["peel", "layer"];

/// Digits that the number of a peel has at most.
const PEEL_DIGITS: usize = 2;

/// Digits that an f-number has at most before its point.
const F_NUMBER_DIGITS: usize = 2;

/// The frame number in the names of `sources`, which are one frame, if they have one.
pub(crate) fn frame_number(sources: &[Source]) -> Option<i64> {
    // The numbers of pipes such as `/dev/fd/63` are the system's.
    let is_device = |source: &Source| ["/dev", "/proc"].iter().any(|root| source.name().starts_with(root));
    if sources.iter().any(is_device) {
        return None;
    }
    let mut numbers = sources.iter().map(|source| FileName::of(source.name()).in_the_stem().collect());
    let first: Vec<i64> = numbers.next()?;
    let others: Vec<Vec<i64>> = numbers.collect();
    first.into_iter().rev().find(|number| others.iter().all(|other| other.contains(number)))
}

/// A path, taken apart at its frame number.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Numbered {
    /// The frame number.
    pub(crate) frame: i64,
    /// The texts before, between and behind the places of the number. There is at least one place.
    pub(crate) texts: Vec<String>,
    /// How many digits the number has in each place, without its sign.
    pub(crate) digits: Vec<usize>,
}

/// The frame numbers of `paths`, each of which is a frame of its own; nothing for a path without a number.
///
/// Of paths that differ in numbers alone it is the last number that varies, be it in a folder's name; if none varies, the last of
/// the file's name. The number may stand in several places, as in `0042/shot.0042.exr`.
pub(crate) fn frame_numbers<'a>(paths: impl IntoIterator<Item = &'a Path>) -> Vec<Option<Numbered>> {
    let names: Vec<FileName> = paths.into_iter().map(FileName::of).collect();
    let mut alike: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    for (index, name) in names.iter().enumerate() {
        alike.entry(name.texts(&name.all()).join("\0")).or_default().push(index);
    }
    let mut numbered = vec![None; names.len()];
    for indices in alike.into_values() {
        let alike: Vec<&FileName> = indices.iter().map(|&index| &names[index]).collect();
        let places = places(&alike);
        for (index, name) in indices.into_iter().zip(alike) {
            numbered[index] = name.numbered(&places);
        }
    }
    numbered
}

/// Which of the numbers of `names`, which differ in numbers alone, are the frame number; none if they have none.
fn places(names: &[&FileName]) -> Vec<usize> {
    let Some(first) = names.first() else { return Vec::new() };
    let varies =
        |&place: &usize| names.iter().any(|name| name.numbers[place].value != first.numbers[place].value);
    let all = first.all();
    let in_the_stem = |&place: &usize| first.numbers[place].at.start >= first.stem;
    let Some(frame) = all.iter().copied().rfind(varies).or_else(|| all.iter().copied().rfind(in_the_stem))
    else {
        return Vec::new();
    };
    let same =
        |&place: &usize| names.iter().all(|name| name.numbers[place].value == name.numbers[frame].value);
    all.into_iter().filter(same).collect()
}

/// A path as text, with the numbers in it that can be frame numbers.
struct FileName {
    /// The whole path.
    text: String,
    /// Where the file's name starts.
    stem: usize,
    /// The numbers in the folders' names and in the file's, without its extension.
    numbers: Vec<Number>,
}

/// A number in a text.
struct Number {
    /// Where it stands, with its sign.
    at: Range<usize>,
    /// Its value.
    value: i64,
}

impl FileName {
    fn of(path: &Path) -> Self {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let text = path.with_file_name(&*name).to_string_lossy().into_owned();
        let extension = path.extension().map_or(0, |extension| extension.to_string_lossy().len() + 1);
        let stem = text.len().saturating_sub(name.len());
        let numbers = numbers(&text[..text.len().saturating_sub(extension)]);
        Self { text, stem, numbers }
    }

    /// The places of all numbers.
    fn all(&self) -> Vec<usize> {
        (0..self.numbers.len()).collect()
    }

    /// The numbers of the file's name.
    fn in_the_stem(&self) -> impl Iterator<Item = i64> {
        self.numbers.iter().filter(|number| number.at.start >= self.stem).map(|number| number.value)
    }

    /// The texts around the numbers at `places`.
    fn texts(&self, places: &[usize]) -> Vec<&str> {
        let mut start = 0;
        let mut texts = Vec::with_capacity(places.len() + 1);
        for at in places.iter().map(|&place| &self.numbers[place].at) {
            texts.push(&self.text[start..at.start]);
            start = at.end;
        }
        texts.push(&self.text[start..]);
        texts
    }

    /// The path, taken apart at `places`, which all have the frame number.
    fn numbered(&self, places: &[usize]) -> Option<Numbered> {
        let frame = self.numbers[*places.first()?].value;
        let texts = self.texts(places).into_iter().map(str::to_owned).collect();
        let digits = |&place: &usize| self.text[self.numbers[place].at.clone()].trim_start_matches('-').len();
        Some(Numbered { frame, texts, digits: places.iter().map(digits).collect() })
    }
}

/// The numbers in `text` that can be frame numbers.
fn numbers(text: &str) -> Vec<Number> {
    let mut numbers = Vec::new();
    let mut end = 0;
    while let Some(start) = text[end..].find(|c: char| c.is_ascii_digit()).map(|at| end + at) {
        end = text[start..].find(|c: char| !c.is_ascii_digit()).map_or(text.len(), |at| start + at);
        if let Some(end_of_date) =
            date(&text[start..]).filter(|_| !text[..start].ends_with(char::is_alphanumeric))
        {
            end = start + end_of_date;
        } else if !counts_something_else(text, start..end) {
            let start = start - usize::from(has_sign(&text[..start]));
            numbers.extend(text[start..end].parse().ok().map(|value| Number { at: start..end, value }));
        }
    }
    numbers
}

/// Whether a number behind `head` is negative.
fn has_sign(head: &str) -> bool {
    let before = head.strip_suffix('-').map(|head| head.chars().next_back());
    before.is_some_and(|before| before.is_none_or(|c| matches!(c, '.' | '_' | '-' | ' ' | '/' | '\\')))
}

/// Whether the digits at `at` belong to a size, a version and the like.
fn counts_something_else(text: &str, at: Range<usize>) -> bool {
    let (head, digits, tail) = (&text[..at.start], &text[at.clone()], &text[at.end..]);
    if tail.starts_with(char::is_alphabetic) || is_f_number(head, digits) || is_peel(head, digits) {
        return true;
    }
    let word = last_word(head);
    let is_inside_a_word =
        !word.is_empty() && head[..head.len() - word.len()].ends_with(|c: char| c.is_ascii_digit());
    is_inside_a_word || OTHER_COUNTS.contains(&word.to_ascii_lowercase().as_str())
}

/// Whether `digits` behind `head` are an f-number or its decimal.
fn is_f_number(head: &str, digits: &str) -> bool {
    let behind_f = |head: &str, digits: &str| {
        digits.len() <= F_NUMBER_DIGITS && last_word(head).eq_ignore_ascii_case("f")
    };
    let decimal_of = |head: &str| {
        let whole = head.len() - head.bytes().rev().take_while(u8::is_ascii_digit).count();
        whole < head.len() && behind_f(&head[..whole], &head[whole..])
    };
    behind_f(head, digits) || (digits.len() == 1 && head.strip_suffix('.').is_some_and(decimal_of))
}

/// Whether `digits` behind `head` and its last dot, dash or underscore number a peel.
fn is_peel(head: &str, digits: &str) -> bool {
    let named = head.strip_suffix(['.', '-', '_']).map(last_word);
    let is_word = named.is_some_and(|word| PEELS.iter().any(|peel| word.eq_ignore_ascii_case(peel)));
    is_word && digits.len() <= PEEL_DIGITS
}

/// The letters at the end of `text`; of `ShotCamera` the `Camera`.
fn last_word(text: &str) -> &str {
    let mut start = text.len();
    for (at, letter) in text.char_indices().rev().take_while(|(_, c)| c.is_alphabetic()) {
        if letter.is_lowercase() && text[start..].starts_with(char::is_uppercase) {
            break;
        }
        start = at;
    }
    &text[start..]
}

/// The length of the date that `text` starts with: year, month and day, joined by dashes or underscores.
fn date(text: &str) -> Option<usize> {
    const LENGTH: usize = "2026-11-26".len();
    let date = text.get(..LENGTH)?;
    let joint = date.chars().nth(4).filter(|joint| matches!(joint, '-' | '_'))?;
    let parts: Option<Vec<u16>> = date.split(joint).map(|part| part.parse().ok()).collect();
    let is_date = matches!(parts.as_deref(), Some([1900..=2099, 1..=12, 1..=31]));
    (is_date && !text[LENGTH..].starts_with(|c: char| c.is_ascii_digit())).then_some(LENGTH)
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

    /// The frames of files that are frames of their own.
    fn frames(names: &[&str]) -> Vec<Option<i64>> {
        let numbered = frame_numbers(names.iter().map(Path::new));
        numbered.into_iter().map(|numbered| numbered.map(|numbered| numbered.frame)).collect()
    }

    #[test]
    fn a_dash_that_joins_nothing_is_a_sign() {
        assert_eq!(number(&["pull.-0005.exr"]), Some(-5));
        assert_eq!(number(&["pull_-5.exr"]), Some(-5));
        assert_eq!(number(&["-0005.exr"]), Some(-5));
        assert_eq!(number(&["pull--0005.exr"]), Some(-5));
        assert_eq!(number(&["shots/-0005.exr"]), Some(-5));
        assert_eq!(number(&["shot-0005.exr"]), Some(5));
        assert_eq!(number(&["shot.0001-0005.exr"]), Some(5));
        assert_eq!(number(&["pull.-0000.exr"]), Some(0));
    }

    #[test]
    fn digits_behind_the_letters_of_a_name_are_a_frame() {
        assert_eq!(number(&["env0042.exr"]), Some(42));
        assert_eq!(number(&["mov0042.exr", "dev0042.exr"]), Some(42));
        assert_eq!(number(&["frame7.exr"]), Some(7));
        assert_eq!(number(&["fresh0042.exr"]), Some(42), "a word that ends as another one counts frames");
    }

    #[test]
    fn sizes_rates_and_units_are_not_frames() {
        for name in [
            "render_1080p.exr",
            "hdri_16k.exr",
            "hdri_2K.exr",
            "a_24fps.exr",
            "a_50mm.exr",
            "a@2x.exr",
            "1920x1080.exr",
        ] {
            assert_eq!(number(&[name]), None, "{name}");
        }
        assert_eq!(number(&["shot.0042_4k.exr"]), Some(42));
        assert_eq!(number(&["shot.0042.1920x1080.exr"]), Some(42));
        assert_eq!(number(&["shot.0042.rec709.32bit.exr"]), Some(42));
        assert_eq!(number(&["hdri_16k_0042.exr"]), Some(42));
    }

    #[test]
    fn what_counts_scenes_cameras_and_layers_is_not_a_frame() {
        for name in
            ["cam1.exr", "sc010_sh020.exr", "peel0.exr", "Shot_Take3.exr", "beautyV002.exr", "a_9f3c2.exr"]
        {
            assert_eq!(number(&[name]), None, "{name}");
        }
        assert_eq!(number(&["sc010_sh020.0042.exr"]), Some(42));
        assert_eq!(number(&["layer_0002.exr"]), Some(2));
        assert_eq!(number(&["shot.0042.cam1.exr"]), Some(42));
        assert_eq!(number(&["shot.0042.denoised.exr"]), Some(42));
        assert_eq!(number(&["shot_v002.0042.exr"]), Some(42));
    }

    #[test]
    fn an_f_number_and_a_date_are_not_frames() {
        for name in ["a_f22.exr", "a_f2.8.exr", "a_F1.4.exr", "a_2026-11-26.exr", "2026_11_26.exr"] {
            assert_eq!(number(&[name]), None, "{name}");
        }
        assert_eq!(number(&["a_f0022.exr"]), Some(22));
        assert_eq!(number(&["a_f2.8.0042.exr"]), Some(42));
        assert_eq!(number(&["0042_f2.8.exr"]), Some(42));
        assert_eq!(number(&["a_2026-11-26_0042.exr"]), Some(42));
        assert_eq!(number(&["a_2026-13-26.exr"]), Some(26), "no month has this number");
    }

    #[test]
    fn of_frames_of_a_sequence_the_last_number_that_varies_counts() {
        assert_eq!(frames(&["shot.0001.001.exr", "shot.0002.001.exr"]), [Some(1), Some(2)]);
        assert_eq!(frames(&["a.1.10.exr", "a.2.11.exr"]), [Some(10), Some(11)]);
        assert_eq!(frames(&["shots/0001/b.exr", "shots/0002/b.exr"]), [Some(1), Some(2)]);
        assert_eq!(frames(&["a.9.exr", "a.10.exr", "a.-1.exr"]), [Some(9), Some(10), Some(-1)]);
        assert_eq!(frames(&["shot.0001_v003.exr", "shot.0002_v004.exr"]), [Some(1), Some(2)]);
    }

    #[test]
    fn where_no_number_varies_the_last_of_the_name_counts() {
        assert_eq!(frames(&["0007/shot.0001.002.exr"]), [Some(2)]);
        assert_eq!(frames(&["0007/shot.exr", "cam1.exr", "cam2.exr"]), [None, None, None]);
        assert_eq!(frames(&["peel0.0042.exr", "peel1.0042.exr"]), [Some(42), Some(42)]);
    }

    #[test]
    fn a_number_that_stands_in_several_places_is_taken_apart_in_all() {
        let names = ["0009/a.0009.b.7.exr", "0010/a.10.b.7.exr"].map(Path::new);
        let numbered = frame_numbers(names);
        let texts = ["", "/a.", ".b.7.exr"].map(str::to_owned).to_vec();
        let expected = [(9, vec![4, 4]), (10, vec![4, 2])]
            .map(|(frame, digits)| Some(Numbered { frame, texts: texts.clone(), digits }));
        assert_eq!(numbered, expected);
    }

    #[cfg(unix)]
    #[test]
    fn names_that_are_no_text_have_numbers_too() {
        use std::os::unix::ffi::OsStrExt;
        let path = Path::new(std::ffi::OsStr::from_bytes(b"f\xff/a\xff.0042.e\xffr"));
        assert_eq!(frame_number(&[Source::File(path.into())]), Some(42));
        assert_eq!(frames(&["", "/", "..", "a/.."]), [None; 4]);
    }
}
