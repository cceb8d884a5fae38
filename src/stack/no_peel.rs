//! What is given as a peel and is none: a copy of a layer, the other eye, the next frame.
//!
//! A peel is what a ray meets behind the one before it, so it is farther nearly everywhere both have something. A copy lies at the same
//! depth. The next frame, and the other eye, lie at the same depth where nothing moved, and here and there nearer.
//!
//! Cost: one read of alpha and depth.

use super::depth::FarDepth;
use super::frame_number::frame_numbers;
use super::{Peel, Source};
use crate::error::Error;
use crate::finding::Finding;
use crate::parallel;
use crate::settings::DepthConvention;
use pulp::{Arch, NullaryFnOnce};

/// Depths are the same up to this share of the distance.
const SAME: f32 = 1e-5;
/// A fragment is nearer by more than this share of its distance: half floats round depth.
const NEARER: f32 = 1e-3;
/// Fewest fragments of which anything is concluded.
const FEWEST: u64 = 16;
/// Share of the fragments at the depth of the one before, from which on a peel is a copy unless some of the rest are behind.
const COPY: f64 = 0.95;
/// The same where some of the rest are nearer, or names say that the files are frames.
const MOSTLY: f64 = 0.5;
/// The same where names say that the files are frames.
const SOME: f64 = 0.05;
/// Share of the fragments that are nearer than the one before, from which on the peel moved.
const MOVED: f64 = 0.001;
/// Digits from which on a number in names that differ in nothing else is that of a frame.
const FRAME_DIGITS: usize = 3;

/// The fragments of one peel, against the last before each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Against {
    /// Fragments behind another, both with a depth.
    both: u64,
    /// Those of them at its depth.
    same: u64,
    /// Those of them that are nearer.
    nearer: u64,
}

/// Whether the names of `sources` differ in a number alone that may be that of a frame.
pub(super) fn are_numbered(sources: &[Source]) -> bool {
    digits(sources).is_some()
}

/// Refuses `sources` that are frames of a sequence by their names.
///
/// # Errors
/// Names that differ in a number of three digits or more alone. Numbers of peels (`peel0`, `peel_001`) are not of frames.
pub(super) fn check_names(sources: &[Source]) -> Result<(), Error> {
    match digits(sources) {
        Some(digits) if digits >= FRAME_DIGITS && !sources.iter().all(is_called_peel) => {
            Err(frames(sources.iter().map(Source::base_name)))
        }
        _ => Ok(()),
    }
}

/// Whether a word in the file's name is that of a peel.
fn is_called_peel(source: &Source) -> bool {
    source.base_name().to_ascii_lowercase().contains("peel")
}

/// The most digits of the number in which alone the names of `sources` differ, if there is one.
fn digits(sources: &[Source]) -> Option<usize> {
    let numbered = frame_numbers(sources.iter().map(Source::name));
    let first = numbered.first()?.clone()?;
    let mut frames = vec![first.frame];
    for other in numbered.get(1..)? {
        let other = other.as_ref().filter(|other| other.texts == first.texts)?;
        frames.push(other.frame);
    }
    frames.sort_unstable();
    let differ = frames.len() > 1 && frames.windows(2).all(|pair| pair[0] != pair[1]);
    let digits = numbered.iter().flatten().flat_map(|numbered| &numbered.digits).copied().max()?;
    differ.then_some(digits)
}

fn frames(names: impl Iterator<Item = String>) -> Error {
    Error::settings("the files are frames of a sequence, not peels of one frame")
        .with("found", names.take(4).collect::<Vec<_>>().join(" "))
        .help(
            "render a sequence by a pattern in quotes, as in 'shot.####.exr', or give one frame; peels of one frame are called \
             peel0, peel1 and so on, nearest first",
        )
}

/// Checks that each of `peels`, called `names`, is one. `are_numbered` says that they are files whose names differ in a number alone.
///
/// A peel that is hidden by the one before it nearly everywhere, nowhere nearer, and behind it in places gets a warning: it may be the picture
/// without an object.
///
/// # Errors
/// A peel at the depth of the one before it nearly everywhere; one that is so in most places and nearer in others; a numbered file
/// that is so in some places.
pub(super) fn check(
    peels: &[Peel],
    names: &[String],
    convention: DepthConvention,
    are_numbered: bool,
) -> Result<Option<Finding>, Error> {
    let far = FarDepth::new(convention);
    let name = |i: usize| names.get(i).filter(|name| !name.is_empty()).map_or("root", String::as_str);
    for (i, against) in against(peels, &far).into_iter().enumerate().filter(|(_, found)| found.both >= FEWEST)
    {
        let share = |count: u64| count as f64 / against.both as f64;
        let (same, moved) = (share(against.same), share(against.nearer) >= MOVED);
        if are_numbered && (same >= SOME || moved) {
            return Err(frames(names.iter().cloned()));
        }
        let at =
            format!("at the depth of a peel before it in {:.1} % of the pixels that both have", 100.0 * same);
        let behind = against.both - against.same - against.nearer;
        if same >= COPY && behind < FEWEST || same >= MOSTLY && moved {
            return Err(Error::input(format!("{} is no peel: it lies {at}", name(i)))
                .with("found", format!("peel {i} of {}: {}", peels.len(), names.join(", ")))
                .help(
                    "copies of a layer, light groups, eyes and frames are pictures of their own: render one at a time, named with \
                     `color_channel` where one file has several",
                ));
        }
        if same >= MOSTLY {
            let text =
                format!("{} lies {at}: it shows nothing there, as a picture without an object does", name(i));
            return Ok(Some(Finding::warning("peels", text)));
        }
    }
    Ok(None)
}

/// The counts of every peel.
fn against(peels: &[Peel], far: &FarDepth) -> Vec<Against> {
    let (width, height) = peels.first().map_or((0, 0), |peel| (peel.depth.width(), peel.depth.height()));
    let (none, arch) = (|| vec![Against::default(); peels.len()], Arch::new());
    let joined = |mut sum: Vec<Against>, row: Vec<Against>| {
        for (sum, row) in sum.iter_mut().zip(row) {
            sum.both += row.both;
            sum.same += row.same;
            sum.nearer += row.nearer;
        }
        sum
    };
    let of_row = |y: usize| {
        // Depth of the last fragment so far; infinite where there is none, or background.
        let mut last = vec![f32::INFINITY; width];
        let mut depth = vec![0.0; width];
        let of_peel = |peel: &Peel| {
            far.fill_row(peel.depth.row(y), &mut depth);
            let (last, alpha, depth) = (&mut last[..], peel.alpha.row(y), &depth[..]);
            arch.dispatch(CountRow { last, alpha, depth })
        };
        peels.iter().map(of_peel).collect()
    };
    parallel::map(height, &of_row).into_iter().fold(none(), joined)
}

/// Counts a row of a peel of these depths ([`FarDepth`]) against `last`, the depth of the last fragment so far, and updates it; compiled for
/// each instruction set.
struct CountRow<'a> {
    last: &'a mut [f32],
    alpha: &'a [f32],
    depth: &'a [f32],
}

impl NullaryFnOnce for CountRow<'_> {
    type Output = Against;

    #[inline(always)]
    fn call(self) -> Against {
        let [mut both, mut same, mut nearer] = [0_u32; 3];
        for (last, (&alpha, &depth)) in self.last.iter_mut().zip(self.alpha.iter().zip(self.depth)) {
            let present = (alpha > 0.0) & (depth < f32::INFINITY);
            let has_both = present & (*last < f32::INFINITY);
            both += u32::from(has_both);
            same += u32::from(has_both & ((depth - *last).abs() <= SAME * depth));
            nearer += u32::from(has_both & (depth < *last * (1.0 - NEARER)));
            *last = if present { depth } else { *last };
        }
        Against { both: both.into(), same: same.into(), nearer: nearer.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;

    fn peel(depths: &[f32]) -> Peel {
        let alpha = Plane::from_fn(depths.len(), 1, |x, _| f32::from(depths[x] < 1e9));
        let depth = Plane::from_values(depths.len(), 1, depths);
        Peel { color: std::array::from_fn(|_| alpha.clone()), alpha, depth }
    }

    fn checked(front: &[f32], back: &[f32], are_numbered: bool) -> Result<Option<Finding>, Error> {
        let names = ["front".to_owned(), "back".to_owned()];
        check(&[peel(front), peel(back)], &names, DepthConvention::Planar, are_numbered)
    }

    #[test]
    fn a_peel_behind_or_before_another_is_one_and_a_copy_is_none() {
        let near = [3.0; 40];
        assert_eq!(checked(&near, &[3.1; 40], false).unwrap(), None);
        assert_eq!(checked(&[3.1; 40], &near, false).unwrap(), None, "the wrong order is sorted");
        let error = checked(&near, &near, false).unwrap_err().to_string();
        assert!(error.starts_with("back is no peel") && error.contains("100.0 %"), "{error}");
        let sky = [1e10; 40];
        assert_eq!(checked(&sky, &sky, false).unwrap(), None, "background has no depth");
    }

    #[test]
    fn what_is_the_same_but_for_what_moved_is_none() {
        let mut moved = [12.0; 40];
        let mut still = moved;
        still[..6].fill(3.0);
        moved[3..9].fill(3.0);
        assert!(checked(&still, &moved, false).is_err());
        let plate = checked(&still, &[12.0; 40], false).unwrap();
        assert!(plate.is_some_and(|finding| finding.warning), "a picture without the object");
        let (mut points, mut few) = ([12.0; 1000], [12.0; 1000]);
        points[..20].fill(3.0);
        few[..3].fill(3.0);
        let plate = checked(&points, &[12.0; 1000], false).unwrap();
        assert!(plate.is_some_and(|finding| finding.warning), "the same of small objects");
        assert!(checked(&few, &[12.0; 1000], false).is_err(), "a copy, but for noise");
    }

    #[test]
    fn numbered_files_are_frames_where_depth_says_so_and_peels_elsewhere() {
        let (near, far) = ([3.0; 40], [12.0; 40]);
        assert_eq!(checked(&near, &far, true).unwrap(), None);
        let mut back = far;
        back[..4].fill(3.0);
        assert!(checked(&near, &back, true).is_err());
        assert_eq!(checked(&near, &back, false).unwrap(), None);
    }

    #[test]
    fn names_that_differ_in_a_frame_number_are_refused() {
        let refused = |names: &[&str]| {
            let sources: Vec<Source> = names.iter().map(Source::file).collect();
            check_names(&sources).is_err()
        };
        assert!(refused(&["shot.0001.exr", "shot.0002.exr"]));
        assert!(refused(&["0998/shot.exr", "1001/shot.exr"]));
        for peels in [
            ["peel0.exr", "peel1.exr"],
            ["shot.0001.peel0.exr", "shot.0001.peel1.exr"],
            ["peel0.0007.exr", "peel1.0007.exr"],
            ["front.exr", "back.exr"],
            ["front.0001.exr", "back.0002.exr"],
            ["crown1.exr", "crown2.exr"],
            ["peel_000.exr", "peel_001.exr"],
        ] {
            assert!(!refused(&peels), "{peels:?}");
        }
    }
}
