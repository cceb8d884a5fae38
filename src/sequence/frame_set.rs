//! Sets of frame numbers in the notation of render farms: `1-10,20-30`, `1-100x2`, `-5-5`.
//!
//! | text | frames |
//! | --- | --- |
//! | `7` | 7 |
//! | `1-10`, `10-1` | 1 to 10, rising or falling |
//! | `1-10x3` | every third: 1, 4, 7, 10 |
//! | `1-10y3` | those that `x3` leaves out: 2, 3, 5, 6, 8, 9 |
//! | `1-10:3` | every third, then every second, then all that are left: 1, 4, 7, 10, 3, 5, 9, 2, 6, 8 |
//! | `1-3,8` | several, in this order, each frame once |
//!
//! The notation is FileSeq's. Differences: frames are whole numbers; a text without any frame, a space inside a number and `#`
//! behind a range are errors.

use crate::error::Error;
use std::collections::HashSet;
use std::fmt;

/// The most frames that a text may name, those named twice included.
pub const MOST_FRAMES: u64 = 10_000_000;

/// Frame numbers in an order, each once. See the [module](self) for the notation, which `Display` writes too.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct FrameSet {
    /// The numbers in their order.
    numbers: Vec<i64>,
    /// The same numbers, rising.
    sorted: Vec<i64>,
}

impl FrameSet {
    /// The frames that `text` names. The parts are separated by commas; spaces between their numbers and signs do not count.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Settings`](crate::error::ErrorKind::Settings) if the text has another form, a number does not fit into 64
    /// bits, a step is 0, or the text names no frame or more than [`MOST_FRAMES`].
    pub fn parse(text: &str) -> Result<Self, Error> {
        let mut numbers = Vec::new();
        let mut named = 0;
        for part in text.split(',').map(str::trim).filter(|part| !part.is_empty()) {
            let range = Range::parse(part).ok_or_else(|| not_frames(text, part))?;
            named += range.len();
            if named > u128::from(MOST_FRAMES) {
                return Err(too_many(text));
            }
            range.add_to(&mut numbers);
        }
        if numbers.is_empty() {
            return Err(not_frames(text, text));
        }
        Ok(Self::from_numbers(numbers))
    }

    /// The set of `numbers`, in their order. A number that occurs again is left out.
    pub fn from_numbers(numbers: impl IntoIterator<Item = i64>) -> Self {
        let mut numbers: Vec<i64> = numbers.into_iter().collect();
        if !numbers.is_sorted_by(|a, b| a < b) {
            let mut seen = HashSet::with_capacity(numbers.len());
            numbers.retain(|&number| seen.insert(number));
        }
        let mut sorted = numbers.clone();
        sorted.sort_unstable();
        Self { numbers, sorted }
    }

    /// The frames in their order.
    pub fn iter(&self) -> impl Iterator<Item = i64> + '_ {
        self.numbers.iter().copied()
    }

    /// How many frames there are.
    pub fn len(&self) -> usize {
        self.numbers.len()
    }

    /// Whether there is no frame.
    pub fn is_empty(&self) -> bool {
        self.numbers.is_empty()
    }

    /// Whether `frame` is one of them.
    pub fn contains(&self, frame: i64) -> bool {
        self.sorted.binary_search(&frame).is_ok()
    }
}

/// The shortest text that the notation has for runs of equal steps; [`FrameSet::parse`] makes the same set of it.
impl fmt::Display for FrameSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut rest = &self.numbers[..];
        while let Some(&first) = rest.first() {
            if rest.len() < self.numbers.len() {
                f.write_str(",")?;
            }
            let (count, step) = run(rest);
            let last = rest[count - 1];
            match step {
                _ if count == 1 => write!(f, "{first}")?,
                -1 | 1 => write!(f, "{first}-{last}")?,
                _ => write!(f, "{first}-{last}x{}", step.unsigned_abs())?,
            }
            rest = &rest[count..];
        }
        Ok(())
    }
}

/// How many of the first `numbers` follow one another in equal steps, and the step. Two numbers make a run with a step of 1 only.
fn run(numbers: &[i64]) -> (usize, i128) {
    let step_at = |i: usize| i128::from(numbers[i]) - i128::from(numbers[i - 1]);
    if numbers.len() < 2 {
        return (1, 0);
    }
    let step = step_at(1);
    let count = 2 + (2..numbers.len()).take_while(|&i| step_at(i) == step).count();
    if count == 2 && step.abs() != 1 { (1, 0) } else { (count, step) }
}

/// Which frames of a range are taken, and in which order.
#[derive(Clone, Copy)]
enum Taken {
    /// Every n-th (`x`).
    Every(u64),
    /// All but every n-th (`y`).
    AllBut(u64),
    /// Every n-th, then of the rest every (n − 1)-th …, and at last all (`:`).
    Staggered(u64),
}

/// One part of a text: from `first` to `last`, both within.
struct Range {
    first: i64,
    last: i64,
    taken: Taken,
}

impl Range {
    /// The range that `part` names, or nothing if it has another form.
    fn parse(part: &str) -> Option<Self> {
        let (first, rest) = number(part)?;
        if rest.is_empty() {
            return Some(Self { first, last: first, taken: Taken::Every(1) });
        }
        let (last, rest) = number(rest.strip_prefix('-')?.trim_start())?;
        let Some(letter) = rest.chars().next() else {
            return Some(Self { first, last, taken: Taken::Every(1) });
        };
        let (step, rest) = number(rest[letter.len_utf8()..].trim_start())?;
        // The step of a falling range may have the sign, too: `10-1x-2`.
        if !rest.is_empty() || step == 0 || (step < 0 && first < last) {
            return None;
        }
        let step = step.unsigned_abs();
        let taken = match letter {
            'x' => Taken::Every(step),
            'y' => Taken::AllBut(step),
            ':' => Taken::Staggered(step),
            _ => return None,
        };
        Some(Self { first, last, taken })
    }

    /// Frames between the ends, both included.
    fn width(&self) -> u128 {
        u128::from(self.first.abs_diff(self.last)) + 1
    }

    /// Frames that are taken.
    fn len(&self) -> u128 {
        let every = |step: u64| self.width().div_ceil(u128::from(step));
        match self.taken {
            Taken::Every(step) => every(step),
            Taken::AllBut(step) => self.width() - every(step),
            Taken::Staggered(_) => self.width(),
        }
    }

    /// Appends the frames to `numbers`. There are at most [`MOST_FRAMES`] of them.
    fn add_to(&self, numbers: &mut Vec<i64>) {
        let width = u64::try_from(self.width()).unwrap_or(u64::MAX);
        let at = |offset: u64| match self.first <= self.last {
            true => self.first.saturating_add_unsigned(offset),
            false => self.first.saturating_sub_unsigned(offset),
        };
        let count = u64::try_from(self.len()).unwrap_or(u64::MAX);
        match self.taken {
            Taken::Every(step) => numbers.extend((0..count).map(|i| at(i.saturating_mul(step)))),
            // With a step of 1 nothing is left; otherwise every step leaves step − 1 frames, behind its first.
            Taken::AllBut(step) => numbers.extend((0..count).map(|i| at(i + i / (step - 1) + 1))),
            Taken::Staggered(step) => numbers.extend(staggered(width, step).into_iter().map(at)),
        }
    }
}

/// The offsets `0..width`, each once: every `step`-th, then of the rest every (`step` − 1)-th, and so on.
fn staggered(width: u64, step: u64) -> Vec<u64> {
    let mut taken = vec![false; usize::try_from(width).unwrap_or(usize::MAX)];
    let mut offsets = Vec::with_capacity(taken.len());
    for step in (1..=step.min(width)).rev() {
        let every = usize::try_from(step).unwrap_or(usize::MAX);
        for (offset, taken) in (0..).zip(&mut taken).step_by(every) {
            if !std::mem::replace(taken, true) {
                offsets.push(offset);
            }
        }
    }
    offsets
}

/// The whole number at the start of `text`, and what follows it and the spaces behind it.
fn number(text: &str) -> Option<(i64, &str)> {
    let sign = usize::from(text.starts_with('-'));
    let digits = text[sign..].bytes().take_while(u8::is_ascii_digit).count();
    let (number, rest) = text.split_at(sign + digits);
    Some((number.parse().ok()?, rest.trim_start()))
}

/// `part` of `text` names no frames.
fn not_frames(text: &str, part: &str) -> Error {
    let found = match part == text.trim() {
        true => format!("\"{text}\""),
        false => format!("\"{part}\" in \"{text}\""),
    };
    Error::settings("this is not a list of frames")
        .with("found", found)
        .with("expected", "whole numbers and ranges, separated by commas, such as 1-10,20-30 or -5-5")
        .help("1-100x2 is every second frame, 1-100y2 the frames between, 1-100:8 all of them, from coarse to fine")
}

/// `text` names more than [`MOST_FRAMES`].
fn too_many(text: &str) -> Error {
    Error::settings("the list has too many frames")
        .with("found", format!("\"{text}\""))
        .with("expected", format!("at most {MOST_FRAMES} frames"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::ErrorKind;

    fn frames(text: &str) -> Vec<i64> {
        FrameSet::parse(text).unwrap().iter().collect()
    }

    #[test]
    fn a_range_has_both_its_ends_and_falls_when_the_first_is_the_greater() {
        assert_eq!(frames("3-6"), [3, 4, 5, 6]);
        assert_eq!(frames("6-3"), [6, 5, 4, 3]);
        assert_eq!(frames("4"), [4]);
        assert_eq!(frames("0004-0006"), [4, 5, 6], "zeros in front do not count");
    }

    #[test]
    fn a_minus_before_a_number_is_its_sign() {
        assert_eq!(frames("-5--3"), [-5, -4, -3]);
        assert_eq!(frames("-2-1"), [-2, -1, 0, 1]);
        assert_eq!(frames("1--1"), [1, 0, -1]);
        assert_eq!(frames("-7"), [-7]);
    }

    #[test]
    fn x_takes_every_nth_frame_and_y_the_frames_between() {
        assert_eq!(frames("1-10x3"), [1, 4, 7, 10]);
        assert_eq!(frames("1-10y3"), [2, 3, 5, 6, 8, 9]);
        assert_eq!(frames("10-1x4"), [10, 6, 2]);
        assert_eq!(frames("10-1x-4"), [10, 6, 2]);
        assert_eq!(frames("1-3x99"), [1]);
        assert_eq!(frames("5-5x-1"), [5]);
        let mut both = [frames("-20-35x7"), frames("-20-35y7")].concat();
        both.sort_unstable();
        assert_eq!(both, frames("-20-35"));
    }

    #[test]
    fn a_colon_goes_from_coarse_to_fine_with_each_frame_once() {
        assert_eq!(frames("1-10:3"), [1, 4, 7, 10, 3, 5, 9, 2, 6, 8]);
        assert_eq!(frames("1-5:1"), [1, 2, 3, 4, 5]);
        assert_eq!(
            frames("3-1:9223372036854775807"),
            [3, 1, 2],
            "a step beyond the range takes its first only"
        );
    }

    #[test]
    fn parts_keep_their_order_and_each_frame_comes_once() {
        assert_eq!(frames("8-9,1-3"), [8, 9, 1, 2, 3]);
        assert_eq!(frames("1-5x2,1-5"), [1, 3, 5, 2, 4]);
        assert_eq!(frames(" 1 - 5 x 2 ,, 9, "), [1, 3, 5, 9]);
    }

    #[test]
    fn other_texts_are_errors_that_show_the_part_and_the_form() {
        for text in [
            "", " , ", "a", "1-", "1-5z2", "1-5x", "1-5x0", "1-5x-2", "1.5", "1 2", "+1", "1x2", "1-5x2x2",
            "--1", "\u{661}",
        ] {
            let error = FrameSet::parse(text).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::Settings, "{text}");
        }
        let said = FrameSet::parse("1-10,20-x").unwrap_err().to_string();
        assert!(said.contains("\"20-x\" in \"1-10,20-x\"") && said.contains("1-10,20-30"), "{said}");
        assert_eq!(FrameSet::parse("1-9y1").unwrap_err().kind(), ErrorKind::Settings, "it names no frame");
    }

    #[test]
    fn a_list_that_is_too_long_is_refused_before_it_is_made() {
        for text in [
            "1-99999999999",
            "1-10000001",
            "1-6000000,1-6000000",
            "-9223372036854775808-9223372036854775807:2",
        ] {
            let said = FrameSet::parse(text).unwrap_err().to_string();
            assert!(said.contains("10000000"), "{said}");
        }
        assert!(FrameSet::parse("1-99999999999999999999").is_err(), "no number of 64 bits");
    }

    #[test]
    fn the_ends_of_64_bits_are_frames() {
        assert_eq!(frames("9223372036854775806-9223372036854775807"), [i64::MAX - 1, i64::MAX]);
        assert_eq!(frames("-9223372036854775807--9223372036854775808"), [i64::MIN + 1, i64::MIN]);
        assert_eq!(
            frames("-9223372036854775808-9223372036854775807x9223372036854775807"),
            [i64::MIN, -1, i64::MAX - 1]
        );
        assert_eq!(
            frames("9223372036854775807-9223372036854775800y4"),
            [6, 5, 4, 2, 1, 0].map(|n| i64::MAX - 7 + n)
        );
        let text = "-9223372036854775808,9223372036854775807";
        assert_eq!(FrameSet::parse(text).unwrap().to_string(), text);
    }

    #[test]
    fn the_text_of_a_set_is_short_and_makes_the_same_set() {
        for (text, short) in [
            ("1,2,3,4", "1-4"),
            ("1-10,20-30x2", "1-10,20-30x2"),
            ("1,3,4,5", "1,3-5"),
            ("2,7", "2,7"),
            ("5,4", "5-4"),
            ("9-1x4,-4--2", "9-1x4,-4--2"),
            ("1-6y3", "2-3,5-6"),
            ("1-8:4", "1,5-4,7,3-2,6,8"),
        ] {
            let set = FrameSet::parse(text).unwrap();
            assert_eq!(set.to_string(), short);
            assert_eq!(FrameSet::parse(short).unwrap(), set);
        }
        assert_eq!(FrameSet::from_numbers([]).to_string(), "");
    }

    #[test]
    fn a_set_knows_its_frames_whatever_their_order() {
        let set = FrameSet::from_numbers([7, -2, 7, 3]);
        assert_eq!((set.len(), set.is_empty()), (3, false));
        assert_eq!(set.iter().collect::<Vec<_>>(), [7, -2, 3]);
        assert!([7, -2, 3].into_iter().all(|frame| set.contains(frame)) && !set.contains(4));
    }
}
