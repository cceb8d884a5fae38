//! The naming table: the peel and the role of each channel name.
//!
//! | source | colour | depth | peels |
//! | --- | --- | --- | --- |
//! | one view layer per peel (Blender) | `Peel0.Combined.R G B A`, any prefix | `Peel0.Depth.Z` or `.V` | by the number in the prefix |
//! | one view layer (Blender) | `ViewLayer.Combined.R G B A` | `ViewLayer.Depth.Z` or `.V` | one |
//! | integrator with peels (Mitsuba) | `peel0.R G B A` | `peel0.depth`, `.depth.T`, `.Z`, `.T` | by the number |
//! | one picture | `R G B A` | `depth.T`, `Depth.Z`, `depth.Y`, `depth`, `Z` | one |
//! | one part per peel | part `peel0`: `R G B A` | part `peel0`: `Z` or `depth` | by the number |
//! | one part per pass | part `rgba`: `R G B A` | part `depth`: `Z`, the only depth of the file | one |
//! | groups of any name | `front.R G B A`, `back.R G B A` | `front.Z`, `back.Z` | by name, with a warning |
//! | grey | `Y` | as one picture | one |
//! | anti-aliased colour of peel 0 | `Peel0.Beauty.R G B A` beside numbered peels | that of peel 0 | see [`super::beauty`] |
//! | the same as a view layer | `Peel0.Beauty.Combined.R G B A` | that of peel 0 | as above |
//!
//! Case is ignored. The first match in this order is used: `Combined`, `peelN`, root, groups with depth of
//! their own, a single group. All other channels are copied to the output: duplicates (`img.R` beside `R`), `Noisy Image`, `Denoising …`,
//! cryptomattes, vectors (`P.X Y Z`, whose `Z` is not depth). Colour without alpha has alpha 1.

use super::options::ReadOptions;
use crate::error::Error;
use crate::finding::Finding;
use std::collections::BTreeMap;

/// Names of depth channels after their prefix, in order of preference.
const DEPTH_ENDINGS: [&str; 8] =
    ["depth.z", "depth.v", "depth.t", "depth.y", "depth.depth", "depth", "z", "t"];
/// Name of the colour group of a view layer.
const COMBINED: &str = "combined";
/// Name of the anti-aliased colour group of peel 0, after the peel's.
const BEAUTY: &str = "beauty";
/// Name under which Blender writes the compositor's result, which is not a view layer.
const COMPOSITE: &str = "composite";
/// Prefixes of colour groups that are not the picture.
const NOT_THE_PICTURE: [&str; 3] = ["noisy", "denoising", "crypto"];
/// Names of colour groups that are preferred if several could be the picture.
const THE_PICTURE: [&str; 5] = ["rgba", "beauty", "rgb", "color", "img"];
/// Maximum number of names in an error; the rest is counted.
const SHOWN_NAMES: usize = 24;

/// The channels of one peel, as indices in the list of names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct PeelChannels {
    /// Name of the peel; empty at the root.
    pub(super) prefix: String,
    /// Red, green, blue.
    pub(super) color: [usize; 3],
    /// Alpha, if there is any.
    pub(super) alpha: Option<usize>,
    /// Depth, if there is any.
    pub(super) depth: Option<usize>,
}

/// The peels found in a file's channel names.
#[derive(Debug, Default)]
pub(super) struct Assigned {
    /// The peels, nearest first.
    pub(super) peels: Vec<PeelChannels>,
    /// The anti-aliased colour of the first peel, without depth, if there is any.
    pub(super) beauty: Option<PeelChannels>,
    /// Warnings.
    pub(super) findings: Vec<Finding>,
}

/// Channels with one prefix.
#[derive(Debug, Default)]
struct Group {
    /// Red, green, blue, alpha, luminance.
    channels: [Option<usize>; 5],
}

/// The channels of a file, grouped by prefix.
struct ChannelGroups<'a> {
    /// Colour channels by full prefix.
    colors: BTreeMap<&'a str, Group>,
    /// Rank and index of the preferred depth channel, by prefix.
    depths: BTreeMap<&'a str, (usize, usize)>,
}

impl Group {
    /// Red, green, blue; grey three times.
    fn color(&self) -> Option<[usize; 3]> {
        let [red, green, blue, _, grey] = self.channels;
        match (red, green, blue, grey) {
            (Some(red), Some(green), Some(blue), _) => Some([red, green, blue]),
            (None, None, None, Some(grey)) => Some([grey; 3]),
            _ => None,
        }
    }

    fn is_rgb(&self) -> bool {
        self.channels[..3].iter().all(Option::is_some)
    }
}

/// Finds the peels in `names`. A peel's depth may be missing: it may be in another file.
///
/// # Errors
/// No colour, several possible pictures, or a name in `options` that does not exist.
pub(super) fn assign(names: &[&str], options: &ReadOptions) -> Result<Assigned, Error> {
    let groups = ChannelGroups::from_names(names);
    let prefixes = match &options.color_channel {
        Some(requested) => groups.named_colors(requested, names)?,
        None => groups.pictures(names).map_err(|error| {
            error.help("enable the Combined pass, or name the group with `color_channel`")
        })?,
    };
    let mut peels: Vec<PeelChannels> = prefixes.iter().filter_map(|prefix| groups.peel(prefix)).collect();
    peels.sort_by_cached_key(|peel| order(&peel.prefix));
    match &options.depth_channel {
        Some(requested) => name_depths(&mut peels, names, requested)?,
        None => groups.only_depth(&mut peels),
    }
    let mut findings = Vec::new();
    let stems: Vec<String> = peels.iter().map(|peel| order(&peel.prefix).0).collect();
    if stems.windows(2).any(|pair| pair[0] != pair[1]) {
        let list: Vec<&str> = peels.iter().map(|peel| peel.prefix.as_str()).collect();
        let text = format!(
            "{} are used as peels in this order, by name only: number them nearest first",
            list.join(", ")
        );
        findings.push(Finding::warning("peels", text));
    }
    let beauty = peels.first().and_then(|peel| groups.beauty(&peel.prefix));
    if let (Some(peel), None) = (peels.first(), &beauty) {
        findings.extend(groups.incomplete_beauty(&peel.prefix));
    }
    Ok(Assigned { peels, beauty, findings })
}

/// The main picture in `names`, for comparing: root first, then `Combined`, then a single group.
///
/// # Errors
/// No colour, or several possible pictures.
pub(super) fn picture(names: &[&str]) -> Result<PeelChannels, Error> {
    let groups = ChannelGroups::from_names(names);
    let root = groups.colors.get("").and_then(Group::color).map(|_| "");
    let found = match root {
        Some(root) => Ok(root),
        None => groups
            .pictures(names)
            .map(|found| found.into_iter().min_by_key(|prefix| order(prefix)).unwrap_or_default()),
    };
    found
        .and_then(|prefix| groups.peel(prefix).ok_or_else(|| no_color(names)))
        .map_err(|error| error.help("write the picture as R G B without a prefix, or as Combined"))
}

/// Index of the depth channel in a depth file: the requested name, else a known depth name, else the only channel, grey or red.
///
/// # Errors
/// The requested channel does not exist, or no channel can be depth.
pub(super) fn depth_alone(names: &[&str], requested: Option<&str>) -> Result<usize, Error> {
    if let Some(requested) = requested {
        return names
            .iter()
            .position(|name| *name == requested)
            .ok_or_else(|| no_such("depth channel", requested, names));
    }
    let groups = ChannelGroups::from_names(names);
    let best = groups.depths.iter().min_by_key(|(prefix, (rank, _))| (order(prefix), *rank));
    let grey = || groups.colors.get("").and_then(|group| group.channels[4].or(group.channels[0]));
    let alone = || (names.len() == 1).then_some(0);
    best.map(|(_, &(_, index))| index).or_else(alone).or_else(grey).ok_or_else(|| {
        Error::input("the depth file has no depth channel")
            .with("found", shown(names))
            .with("looked for", "Depth.Z, Depth.V, depth.T, depth, Z, or a single channel")
            .help("name it with `depth_channel`")
    })
}

/// Whether `names` hold a colour picture.
pub(super) fn has_color(names: &[&str]) -> bool {
    ChannelGroups::from_names(names).colors.values().any(Group::is_rgb)
}

/// The names as one line, truncated if there are many.
pub(super) fn shown(names: &[&str]) -> String {
    let mut line = names.iter().take(SHOWN_NAMES).copied().collect::<Vec<_>>().join(" ");
    if names.len() > SHOWN_NAMES {
        line.push_str(&format!(" and {} more", names.len() - SHOWN_NAMES));
    }
    if line.is_empty() { "no channels".to_owned() } else { line }
}

impl<'a> ChannelGroups<'a> {
    fn from_names(names: &[&'a str]) -> Self {
        let mut colors: BTreeMap<&str, Group> = BTreeMap::new();
        let mut depths: BTreeMap<&str, (usize, usize)> = BTreeMap::new();
        // A prefix with an X channel is a vector: its Y is not grey and its Z is not depth.
        let vectors: std::collections::BTreeSet<&str> =
            names.iter().filter_map(|name| strip_ending(name, "x")).collect();
        for (index, &name) in names.iter().enumerate() {
            let depth = DEPTH_ENDINGS.iter().enumerate().find_map(|(rank, ending)| {
                strip_ending(name, ending)
                    .filter(|prefix| ending.len() > 1 || !vectors.contains(prefix))
                    .map(|prefix| (prefix, rank))
            });
            if let Some((prefix, rank)) = depth {
                let best = depths.entry(prefix).or_insert((rank, index));
                *best = (*best).min((rank, index));
            } else if let Some((prefix, role)) = color_role(name)
                && !vectors.contains(prefix)
            {
                colors.entry(prefix).or_default().channels[role].get_or_insert(index);
            }
        }
        Self { colors, depths }
    }

    /// The prefixes of the peels' colour groups, in the order of the table.
    fn pictures(&self, names: &[&str]) -> Result<Vec<&'a str>, Error> {
        let rgb: Vec<&str> =
            self.colors.iter().filter(|(_, group)| group.is_rgb()).map(|(prefix, _)| *prefix).collect();
        let is_likely = |prefix: &&str| !is_other(prefix) && !self.is_beauty(prefix);
        let likely: Vec<&str> = rgb.iter().copied().filter(is_likely).collect();
        let choose = |fits: &dyn Fn(&str) -> bool| -> Vec<&'a str> {
            likely.iter().copied().filter(|prefix| fits(prefix)).collect()
        };
        let is_combined = |prefix: &str| last_part(prefix).eq_ignore_ascii_case(COMBINED);
        let is_view_layer = |prefix: &str| {
            let layer = strip_ending(prefix, COMBINED).unwrap_or_default();
            is_combined(prefix) && !last_part(layer).eq_ignore_ascii_case(COMPOSITE)
        };
        let has_depth = |prefix: &str| self.depths.contains_key(prefix);
        let is_picture =
            |prefix: &str| THE_PICTURE.iter().any(|name| last_part(prefix).eq_ignore_ascii_case(name));
        let grey =
            || self.colors.iter().filter(|(prefix, group)| group.color().is_some() && !is_other(prefix));
        let choices = [
            choose(&is_view_layer),
            choose(&is_combined),
            choose(&is_numbered_peel),
            choose(&|prefix| prefix.is_empty()),
            choose(&has_depth),
        ];
        if let Some(chosen) = choices.into_iter().find(|chosen| !chosen.is_empty()) {
            return Ok(chosen);
        }
        match (likely.as_slice(), choose(&is_picture).as_slice()) {
            ([only], _) | (_, [only]) => Ok(vec![*only]),
            ([], _) => match grey().map(|(prefix, _)| *prefix).min_by_key(|prefix| prefix.len()) {
                Some(grey) => Ok(vec![grey]),
                None => Err(no_color(names)),
            },
            _ => Err(Error::input("several channel groups could be the picture")
                .with("found", likely.join(" "))
                .with("looked for", "Combined, peelN, or R G B without a prefix")),
        }
    }

    /// The prefixes of the groups called `name`: the full prefix, else its last part.
    fn named_colors(&self, name: &str, names: &[&str]) -> Result<Vec<&'a str>, Error> {
        let name = name.trim_end_matches('.');
        let pick = |fits: &dyn Fn(&str) -> bool| -> Vec<&'a str> {
            let groups = self.colors.iter().filter(|(prefix, group)| group.color().is_some() && fits(prefix));
            groups.map(|(prefix, _)| *prefix).collect()
        };
        let exact = pick(&|prefix| prefix == name);
        let found =
            if exact.is_empty() { pick(&|prefix| prefix.ends_with(&format!(".{name}"))) } else { exact };
        if found.is_empty() { Err(no_such("colour group", name, names)) } else { Ok(found) }
    }

    /// The peel with the colour group `prefix`.
    fn peel(&self, prefix: &str) -> Option<PeelChannels> {
        let group = self.colors.get(prefix)?;
        let layer = layer_of(prefix);
        // Another pass of a layer (`ViewLayer.DiffCol`) has the layer's depth.
        let outer = layer.rsplit_once('.').map(|(outer, _)| outer);
        let depth = self.depths.get(layer).or_else(|| outer.and_then(|outer| self.depths.get(outer)));
        Some(PeelChannels {
            prefix: layer.to_owned(),
            color: group.color()?,
            alpha: group.channels[3],
            depth: depth.map(|&(_, index)| index),
        })
    }

    /// The anti-aliased colour of the peel `prefix`, if that is a numbered one.
    fn beauty(&self, prefix: &str) -> Option<PeelChannels> {
        let group = self.colors.keys().copied().find(|group| is_beauty_of(group, prefix))?;
        self.peel(group).map(|beauty| PeelChannels { depth: None, ..beauty })
    }

    /// A warning if the anti-aliased colour of the peel `prefix` lacks a channel.
    fn incomplete_beauty(&self, prefix: &str) -> Option<Finding> {
        let is_incomplete = |(group, channels): &(&&str, &Group)| {
            is_beauty_of(group, prefix)
                && channels.channels.iter().any(Option::is_some)
                && channels.color().is_none()
        };
        let (group, _) = self.colors.iter().find(is_incomplete)?;
        let text = format!("{group} is not used: it lacks one of R, G, B");
        Some(Finding::warning("beauty", text))
    }

    /// Whether `group` is the anti-aliased colour of a peel that is here too.
    fn is_beauty(&self, group: &str) -> bool {
        self.colors.keys().any(|other| is_beauty_of(group, layer_of(other)))
    }

    /// Gives a single picture without depth the file's depth: that of the root, or the only one.
    fn only_depth(&self, peels: &mut [PeelChannels]) {
        if let [peel] = peels
            && peel.depth.is_none()
        {
            let only = (self.depths.len() == 1).then(|| self.depths.values().next()).flatten();
            peel.depth = self.depths.get("").or(only).map(|&(_, index)| index);
        }
    }
}

/// `name` without `ending` and the dot before it, if `ending` is its last part or parts; case is ignored.
fn strip_ending<'a>(name: &'a str, ending: &str) -> Option<&'a str> {
    let at = name.len().checked_sub(ending.len())?;
    let tail = name.get(at..)?;
    let head = &name[..at];
    let whole = head.is_empty() || head.ends_with('.');
    (whole && tail.eq_ignore_ascii_case(ending)).then(|| head.strip_suffix('.').unwrap_or(head))
}

/// Prefix and index in [`Group::channels`] of a colour channel.
fn color_role(name: &str) -> Option<(&str, usize)> {
    const ENDINGS: [&[&str]; 5] = [&["r", "red"], &["g", "green"], &["b", "blue"], &["a", "alpha"], &["y"]];
    ENDINGS.iter().enumerate().find_map(|(role, endings)| {
        endings.iter().find_map(|ending| strip_ending(name, ending)).map(|prefix| (prefix, role))
    })
}

fn last_part(prefix: &str) -> &str {
    prefix.rsplit('.').next().unwrap_or(prefix)
}

/// The name of the layer whose colour group is `prefix`.
fn layer_of(prefix: &str) -> &str {
    strip_ending(prefix, COMBINED).unwrap_or(prefix)
}

/// Whether the colour group `group` is named as the anti-aliased colour of the numbered peel `peel`.
fn is_beauty_of(group: &str, peel: &str) -> bool {
    strip_ending(layer_of(group), BEAUTY)
        .is_some_and(|layer| layer.eq_ignore_ascii_case(peel) && is_numbered_peel(peel))
}

/// Whether `prefix` is "peel" and a number.
fn is_numbered_peel(prefix: &str) -> bool {
    let (stem, number) = order(prefix);
    stem.to_ascii_lowercase().ends_with("peel") && number >= 0
}

fn is_other(prefix: &str) -> bool {
    let last = last_part(prefix).to_ascii_lowercase();
    NOT_THE_PICTURE.iter().any(|start| last.starts_with(start))
}

/// Sort key of a peel: its name without the number at the end, and that number, −1 if there is none.
fn order(prefix: &str) -> (String, i64) {
    let layer = layer_of(prefix);
    let stem = layer.trim_end_matches(|c: char| c.is_ascii_digit());
    let number = layer[stem.len()..].parse().unwrap_or(-1);
    (stem.trim_end_matches(['_', ' ', '-', '.']).to_owned(), number)
}

/// Gives every peel the depth channel `requested`: the full name, else the name after the peel's prefix.
fn name_depths(peels: &mut [PeelChannels], names: &[&str], requested: &str) -> Result<(), Error> {
    let find = |full: &str| names.iter().position(|name| *name == full);
    for peel in &mut *peels {
        peel.depth = find(&format!("{}.{requested}", peel.prefix));
    }
    if let [peel] = &mut *peels {
        peel.depth = find(requested).or(peel.depth);
    }
    if peels.iter().all(|peel| peel.depth.is_none()) {
        Err(no_such("depth channel", requested, names))
    } else {
        Ok(())
    }
}

fn no_such(what: &str, name: &str, names: &[&str]) -> Error {
    Error::settings(format!("there is no {what} called {name}"))
        .with("found", shown(names))
        .help("write the name of colour without .R, .G, .B, and the full name of depth")
}

fn no_color(names: &[&str]) -> Error {
    Error::input("there are no colour channels")
        .with("found", shown(names))
        .with("looked for", "R G B, Combined.R G B, peel0.R G B, Y")
}
