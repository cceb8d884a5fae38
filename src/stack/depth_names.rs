//! The names of depth: which channels are depth, and what others of a similar name are.
//!
//! A channel is depth by a word of [`WORDS`] that is its own name (`depth`, `ViewLayer.Pz`) or that of its group, in which it holds the
//! one value (`Depth.Z`, `VRayZDepth.R`). The letters `Z` and `T` alone say it only beside colour of the same prefix, because passes of every
//! kind have channels called so: `Mist.Z`, `st.T`, `Denoising Depth.Z`, `volume.Z`.
//!
//! | program | depth |
//! | --- | --- |
//! | Blender | `ViewLayer.Depth.Z`, `.Depth.V`; of a file output `Depth.V`, `Z.V` |
//! | Mitsuba | `peel0.depth`, `depth.T`, `peel0.T` |
//! | Nuke | `depth.Z`; parts `depth`, `depth.main` |
//! | `RenderMan` | `z` beside `Ci` |
//! | Houdini, Karma | `Pz`, `Pz.z`, `depth`, `hitPz` |
//! | V-Ray, Corona | `Z`, `VRayZDepth.R G B`, `CESSENTIAL_ZDepth.R` |
//! | Arnold, Redshift | `Z`, `Depth.Z` |
//! | Unreal | `FinalImageWorldDepth.R G B` |
//! | pbrt | `Pz` beside `dzdx` |
//!
//! Case, spaces and punctuation within a name are ignored.

use std::collections::BTreeSet;

/// Names that say depth, in order of preference: in small letters, without anything but letters and digits.
const WORDS: [&str; 14] = [
    "depth",
    "z",
    "pz",
    "hitpz",
    "zdepth",
    "depthz",
    "cameradepth",
    "lineardepth",
    "worlddepth",
    "scenedepth",
    "zbuffer",
    "depthpass",
    "zpass",
    "vrayzdepth",
];

/// Ends of longer names that say it too.
const ENDINGS: [&str; 3] = ["zdepth", "worlddepth", "scenedepth"];

/// Channels that hold the one value of a group, in order of preference. The last is of a picture of three equal channels.
const VALUES: [&str; 7] = ["z", "v", "t", "y", "depth", "r", "red"];

/// Index in [`VALUES`] of the first that is a colour.
const PICTURE: usize = 5;

/// Parts of names that say something else, each with what it is.
const OTHERS: [(&str, &str); 12] = [
    ("normalis", "depth from 0 to 1"),
    ("normaliz", "depth from 0 to 1"),
    ("mist", "a mist pass, not a distance"),
    ("denois", "a feature of a denoiser"),
    ("noisy", "a feature of a denoiser"),
    ("volume", "depth within volumes"),
    ("fog", "fog"),
    ("shadow", "depth as lights see it"),
    ("variance", "a variance"),
    ("crypto", "a cryptomatte"),
    ("normal", "a normal"),
    ("zback", "the back of samples"),
];

/// Whole names of groups that say something else.
const OTHER_GROUPS: [(&str, &str); 6] = [
    ("st", "texture coordinates"),
    ("uv", "texture coordinates"),
    ("n", "a normal"),
    ("motion", "a motion vector"),
    ("vector", "a motion vector"),
    ("velocity", "a motion vector"),
];

/// Rank of the letter `t`: behind everything else in its group.
const LAST_RANK: usize = WORDS.len() * (VALUES.len() + 1);

/// A channel that is depth by its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct NamedDepth<'a> {
    /// The prefix of the picture that it belongs to; empty at the root.
    pub(super) owner: &'a str,
    /// The lowest of its owner's is used.
    pub(super) rank: usize,
    /// Whether a letter alone says it, which counts only beside colour.
    pub(super) is_letter: bool,
    /// Whether it is the red of a group whose other colours should be equal.
    pub(super) is_picture: bool,
}

/// What `name` says of the channel as depth; `None` if it is something else. `vectors` are the prefixes with an `X`, whose `Z` is a
/// coordinate.
pub(super) fn depth_by_name<'a>(name: &'a str, vectors: &BTreeSet<&str>) -> Option<NamedDepth<'a>> {
    if other_meaning(name).is_some() {
        return None;
    }
    let (prefix, last) = name.rsplit_once('.').unwrap_or(("", name));
    let (outer, group) = prefix.rsplit_once('.').unwrap_or(("", prefix));
    let value = VALUES.iter().position(|value| last.eq_ignore_ascii_case(value));
    if let (Some(word), Some(value)) = (word(group), value)
        && !vectors.contains(prefix)
    {
        let rank = word * (VALUES.len() + 1) + value;
        return Some(NamedDepth { owner: outer, rank, is_letter: false, is_picture: value >= PICTURE });
    }
    let is_letter = last.eq_ignore_ascii_case("z") || last.eq_ignore_ascii_case("t");
    if is_letter && vectors.contains(prefix) {
        return None;
    }
    let own = || word(last).map(|word| word * (VALUES.len() + 1) + VALUES.len());
    let rank = if last.eq_ignore_ascii_case("t") { LAST_RANK } else { own()? };
    Some(NamedDepth { owner: prefix, rank, is_letter, is_picture: false })
}

/// Whether the group `name` holds depth, and is no picture.
pub(super) fn is_depth_group(name: &str) -> bool {
    word(name.rsplit('.').next().unwrap_or(name)).is_some()
}

/// What a channel is that could be taken for depth by a part of its name. The layers that its group belongs to may have any name.
pub(super) fn other_meaning(name: &str) -> Option<&'static str> {
    let (groups, last) = name.rsplit_once('.').unwrap_or(("", name));
    let group = plain(groups.rsplit('.').next().unwrap_or(groups));
    let last = plain(last);
    let part = OTHERS.iter().find(|(part, _)| group.contains(part) || last.contains(part));
    part.or_else(|| OTHER_GROUPS.iter().find(|(other, _)| group == *other)).map(|(_, meaning)| *meaning)
}

/// Whether a channel has anything in its name that depth has, so that it could have been meant.
pub(super) fn could_be_depth(name: &str) -> bool {
    const HINTS: [&str; 5] = ["depth", "dist", "mist", "disparity", "zbuf"];
    let last = name.rsplit('.').next().unwrap_or(name);
    let is_letter = ["z", "t", "v", "pz"].iter().any(|letter| last.eq_ignore_ascii_case(letter));
    is_letter || HINTS.iter().any(|hint| plain(name).contains(hint))
}

/// Index in [`WORDS`] of the word that a name is or ends with.
fn word(name: &str) -> Option<usize> {
    let plain = plain(name);
    let exact = WORDS.iter().position(|word| plain == *word);
    exact.or_else(|| ENDINGS.iter().any(|ending| plain.ends_with(ending)).then_some(WORDS.len() - 1))
}

/// The letters and digits of a name, in small letters.
fn plain(name: &str) -> String {
    name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn owner(name: &str) -> Option<&str> {
        depth_by_name(name, &BTreeSet::new()).map(|depth| depth.owner)
    }

    #[test]
    fn the_names_of_renderers_are_depth_of_the_layer_before_them() {
        for (name, expected) in [
            ("Z", ""),
            ("depth.Z", ""),
            ("ViewLayer.Depth.V", "ViewLayer"),
            ("Z.V", ""),
            ("Pz", ""),
            ("Pz.z", ""),
            ("VRayZDepth.R", ""),
            ("VRayZDepth", ""),
            ("CESSENTIAL_ZDepth.R", ""),
            ("FinalImageWorldDepth.R", ""),
            ("FinalImageMRQ_WorldDepth.R", ""),
            ("rgba.Z Depth", "rgba"),
            ("Depth.depth", ""),
            ("peel0.T", "peel0"),
        ] {
            assert_eq!(owner(name), Some(expected), "{name}");
        }
    }

    #[test]
    fn other_passes_are_not_depth_whatever_their_channels_are_called() {
        for name in [
            "ViewLayer.Mist.Z",
            "Denoising Depth.Z",
            "st.T",
            "volume_depth.Z",
            "volume.Z",
            "Z.variance",
            "ShadowDepth.Z",
            "N.Z",
            "Depth.A",
            "Depth.G",
            "ZBack",
            "depth_mask",
        ] {
            assert_eq!(owner(name), None, "{name}");
        }
        assert_eq!(depth_by_name("P.Z", &BTreeSet::from(["P"])), None, "a coordinate");
    }

    #[test]
    fn of_one_layer_the_depth_group_is_preferred_to_letters_and_to_pictures() {
        let rank = |name: &str| depth_by_name(name, &BTreeSet::new()).expect("it is depth").rank;
        for pair in
            ["depth.Z", "depth.V", "depth.T", "depth.Y", "depth", "Z", "Pz", "VRayZDepth.R", "T"].windows(2)
        {
            assert!(rank(pair[0]) < rank(pair[1]), "{pair:?}");
        }
    }
}
