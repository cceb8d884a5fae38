//! A file's channels by the groups that their names put them in: colours, depths and positions, each by the prefix before them.

use super::depth_names::{self, NamedDepth};
use std::collections::{BTreeMap, BTreeSet};

/// Name of the colour group of a view layer.
pub(super) const COMBINED: &str = "combined";
/// Names of groups of positions, in small letters.
const POSITIONS: [&str; 7] = ["p", "position", "worldposition", "pworld", "pos", "wpp", "hitp"];

/// Channels with one prefix.
#[derive(Debug, Default)]
pub(super) struct Group {
    /// Red, green, blue, alpha, luminance, and the chroma of red and blue.
    pub(super) channels: [Option<usize>; 7],
}

/// The channels of a file, grouped by prefix.
pub(super) struct ChannelGroups<'a> {
    /// Colour channels by full prefix.
    pub(super) colors: BTreeMap<&'a str, Group>,
    /// The preferred depth channel, by prefix.
    pub(super) depths: BTreeMap<&'a str, RankedDepth>,
    /// The green and blue of groups that hold depth in red, by the index of that.
    pub(super) same: BTreeMap<usize, Vec<usize>>,
    /// `X Y Z` of positions, by the prefix of their group.
    pub(super) positions: BTreeMap<&'a str, [Option<usize>; 3]>,
}

/// A depth channel: of those with one prefix, the smallest is preferred.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct RankedDepth {
    pub(super) rank: usize,
    pub(super) index: usize,
}

impl Group {
    /// Red, green, blue; grey three times; or chroma of red, luminance, chroma of blue.
    pub(super) fn color(&self) -> Option<[usize; 3]> {
        let [red, green, blue, _, grey, ..] = self.channels;
        match (red, green, blue, grey) {
            (Some(red), Some(green), Some(blue), _) => Some([red, green, blue]),
            (None, None, None, Some(grey)) => {
                Some(self.chroma().map_or([grey; 3], |[red, blue]| [red, grey, blue]))
            }
            _ => None,
        }
    }

    /// The chroma of red and blue of a picture of luminance and chroma.
    pub(super) fn chroma(&self) -> Option<[usize; 2]> {
        let [red, green, blue, _, grey, chroma_red, chroma_blue] = self.channels;
        let has_rgb = [red, green, blue].iter().any(Option::is_some);
        grey.filter(|_| !has_rgb).and(Some([chroma_red?, chroma_blue?]))
    }

    pub(super) fn is_rgb(&self) -> bool {
        self.channels[..3].iter().all(Option::is_some) || self.chroma().is_some()
    }
}

impl<'a> ChannelGroups<'a> {
    pub(super) fn from_names(names: &[&'a str]) -> Self {
        let vectors = vectors(names);
        let mut groups = Self {
            colors: BTreeMap::new(),
            depths: BTreeMap::new(),
            same: BTreeMap::new(),
            positions: BTreeMap::new(),
        };
        let mut letters = Vec::new();
        let mut pictures: Vec<(&str, usize)> = Vec::new();
        for (index, &name) in names.iter().enumerate() {
            groups.note_position(name, index);
            match depth_names::depth_by_name(name, &vectors) {
                Some(_) if is_split_position(name, names) => {}
                Some(depth) if depth.is_letter => letters.push((depth, index)),
                Some(depth) => {
                    groups.note_depth(depth.owner, depth.rank, index);
                    if depth.is_picture {
                        pictures.push((name.rsplit_once('.').map_or("", |(prefix, _)| prefix), index));
                    }
                }
                None => {
                    let color = color_role(name).filter(|(prefix, _)| !vectors.contains(prefix));
                    if let Some((prefix, role)) =
                        color.filter(|(prefix, _)| !depth_names::is_depth_group(prefix))
                    {
                        groups.colors.entry(prefix).or_default().channels[role].get_or_insert(index);
                    }
                }
            }
        }
        letters.retain(|(depth, index)| groups.may_say_depth(depth, names[*index]));
        for (depth, index) in letters {
            groups.note_depth(depth.owner, depth.rank, index);
        }
        for (prefix, red) in pictures {
            let is_same = |name: &&str| {
                color_role(name).is_some_and(|(of, role)| of == prefix && (1..=2).contains(&role))
            };
            groups.same.insert(red, (0..names.len()).filter(|&index| is_same(&names[index])).collect());
        }
        groups
    }

    fn note_depth(&mut self, owner: &'a str, rank: usize, index: usize) {
        let ranked = RankedDepth { rank, index };
        let best = self.depths.entry(owner).or_insert(ranked);
        *best = (*best).min(ranked);
    }

    fn note_position(&mut self, name: &'a str, index: usize) {
        let Some((prefix, last)) = name.rsplit_once('.') else { return };
        let group = last_part(prefix).to_ascii_lowercase();
        let axes = [["x", "r"], ["y", "g"], ["z", "b"]];
        let axis = axes.iter().position(|names| names.iter().any(|axis| last.eq_ignore_ascii_case(axis)));
        if let Some(axis) = axis.filter(|_| POSITIONS.contains(&group.as_str())) {
            self.positions.entry(prefix).or_default()[axis].get_or_insert(index);
        }
    }

    /// Whether a letter says depth: beside colour of the same prefix, or at the root. `T` is texture coordinates of all but peels.
    fn may_say_depth(&self, depth: &NamedDepth<'_>, name: &str) -> bool {
        let is_t = name.ends_with(['t', 'T']);
        let is_beside = |prefix: &str| *prefix == *depth.owner || layer_of(prefix) == depth.owner;
        let beside_color = self.colors.keys().any(|prefix| is_beside(prefix));
        if is_t {
            beside_color && is_numbered_peel(depth.owner)
        } else {
            beside_color || depth.owner.is_empty()
        }
    }
}

/// The prefixes with an `X` channel: vectors, whose `Y` is not grey and whose `Z` is not depth.
pub(super) fn vectors<'a>(names: &[&'a str]) -> BTreeSet<&'a str> {
    names.iter().filter_map(|name| strip_ending(name, "x")).collect()
}

/// Whether `name` is the last of `Px Py Pz`, a position. That of pbrt is in the camera's space, where the last is depth.
fn is_split_position(name: &str, names: &[&str]) -> bool {
    let has = |wanted: &str| names.iter().any(|name| name.eq_ignore_ascii_case(wanted));
    name.eq_ignore_ascii_case("pz") && has("px") && !has("dzdx")
}

/// `name` without `ending` and the dot before it, if `ending` is its last part or parts; case is ignored.
pub(super) fn strip_ending<'a>(name: &'a str, ending: &str) -> Option<&'a str> {
    let at = name.len().checked_sub(ending.len())?;
    let tail = name.get(at..)?;
    let head = &name[..at];
    let whole = head.is_empty() || head.ends_with('.');
    (whole && tail.eq_ignore_ascii_case(ending)).then(|| head.strip_suffix('.').unwrap_or(head))
}

/// Prefix and index in [`Group::channels`] of a colour channel.
fn color_role(name: &str) -> Option<(&str, usize)> {
    const ENDINGS: [&[&str]; 7] =
        [&["r", "red"], &["g", "green"], &["b", "blue"], &["a", "alpha"], &["y"], &["ry"], &["by"]];
    ENDINGS.iter().enumerate().find_map(|(role, endings)| {
        endings.iter().find_map(|ending| strip_ending(name, ending)).map(|prefix| (prefix, role))
    })
}

pub(super) fn last_part(prefix: &str) -> &str {
    prefix.rsplit('.').next().unwrap_or(prefix)
}

/// The name of the layer whose colour group is `prefix`.
pub(super) fn layer_of(prefix: &str) -> &str {
    strip_ending(prefix, COMBINED).unwrap_or(prefix)
}

/// Whether `prefix` is "peel" and a number.
pub(super) fn is_numbered_peel(prefix: &str) -> bool {
    let (stem, number) = order(prefix);
    stem.to_ascii_lowercase().ends_with("peel") && number >= 0
}

/// Sort key of a peel: its name without the number at the end, and that number, −1 if there is none.
pub(super) fn order(prefix: &str) -> (String, i64) {
    let layer = layer_of(prefix);
    let stem = layer.trim_end_matches(|c: char| c.is_ascii_digit());
    let number = layer[stem.len()..].parse().unwrap_or(-1);
    (stem.trim_end_matches(['_', ' ', '-', '.']).to_owned(), number)
}
