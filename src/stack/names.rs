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
//! | luminance and chroma, each with a sample a pixel | `Y RY BY` | as one picture | one |
//! | `RenderMan` | `Ci.r g b`, `a` at the root | `z` | one |
//! | Unreal | `FinalImage.R G B A` | `FinalImageWorldDepth.R G B` | one |
//! | position with a camera in the header | any | `P.X Y Z` | one |
//! | anti-aliased colour of peel 0 | `Peel0.Beauty.R G B A` beside numbered peels | that of peel 0 | see [`super::beauty`] |
//! | the same as a view layer | `Peel0.Beauty.Combined.R G B A` | that of peel 0 | as above |
//!
//! [`super::depth_names`] has the names of depth, [`super::shading`] those of what surfaces reflect. Case is ignored. The first match in this order is used: `Combined`, `peelN`, root, groups with depth of
//! their own, a single group. All other channels are copied to the output: duplicates (`img.R` beside `R`), `Noisy Image`, `Denoising …`,
//! cryptomattes, vectors (`P.X Y Z`, whose `Z` is not depth). Colour without alpha has alpha 1.

use super::channel_groups::{
    COMBINED, ChannelGroups, Group, RankedDepth, is_numbered_peel, last_part, layer_of, order, strip_ending,
    vectors,
};
use super::depth_names;
use super::options::ReadOptions;
use super::shading::ShadingChannels;
use crate::error::Error;
use crate::finding::Finding;

/// Name of the anti-aliased colour group of peel 0, after the peel's.
const BEAUTY: &str = "beauty";
/// Name under which Blender writes the compositor's result, which is not a view layer.
const COMPOSITE: &str = "composite";
/// Prefixes of colour groups that are not the picture.
const NOT_THE_PICTURE: [&str; 3] = ["noisy", "denoising", "crypto"];
/// Names of colour groups that are preferred if several could be the picture.
const THE_PICTURE: [&str; 7] = ["rgba", "beauty", "rgb", "color", "img", "ci", "finalimage"];
/// Name of `RenderMan`'s colour group, whose alpha is at the root.
const WITHOUT_ALPHA: &str = "ci";
/// The names of depth that are tried, for errors.
pub(super) const LOOKED_FOR: &str = "Depth.Z, Depth.V, depth.T, depth, Z";
/// Maximum number of names in an error; the rest is counted.
const SHOWN_NAMES: usize = 24;

/// The channels of one peel, as indices in the list of names.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct PeelChannels {
    /// Name of the peel; empty at the root.
    pub(super) prefix: String,
    /// Red, green, blue.
    pub(super) color: [usize; 3],
    /// Whether these are the chroma of red, luminance, and the chroma of blue.
    pub(super) is_chroma: bool,
    /// Alpha, if there is any.
    pub(super) alpha: Option<usize>,
    /// Depth, if there is any.
    pub(super) depth: Option<usize>,
    /// Where depth is the red of a picture: its green and blue, which should be equal to it.
    pub(super) same_as_depth: Vec<usize>,
    /// The position `X Y Z` of the surface, which a camera turns into depth.
    pub(super) position: Option<[usize; 3]>,
    /// What the surface reflects, if the file says so.
    pub(super) shading: Option<ShadingChannels>,
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

/// A channel of a depth file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct DepthAlone {
    /// Its index.
    pub(super) index: usize,
    /// As [`PeelChannels::same_as_depth`].
    pub(super) same: Vec<usize>,
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

/// The depth channel in a depth file: the requested name, else a known depth name, else the only channel, grey or red.
///
/// # Errors
/// The requested channel does not exist, or no channel can be depth.
pub(super) fn depth_alone(names: &[&str], requested: Option<&str>) -> Result<DepthAlone, Error> {
    if let Some(requested) = requested {
        let index = names.iter().position(|name| *name == requested);
        let index = index.ok_or_else(|| no_such("depth channel", requested, names))?;
        return Ok(DepthAlone { index, same: Vec::new() });
    }
    let groups = ChannelGroups::from_names(names);
    if let Some((_, best)) = groups.depths.iter().min_by_key(|(prefix, depth)| (order(prefix), depth.rank)) {
        let same = groups.same.get(&best.index).cloned().unwrap_or_default();
        return Ok(DepthAlone { index: best.index, same });
    }
    let is_free = |index: &usize| depth_names::other_meaning(names[*index]).is_none();
    let alone = (names.len() == 1).then_some(0).filter(is_free);
    let mut pictures = groups.colors.iter().filter(|(prefix, _)| !is_other(prefix));
    let picture = match (groups.colors.get(""), pictures.next(), pictures.next()) {
        (Some(root), ..) => Some(root),
        (None, Some((_, only)), None) => Some(only),
        _ => None,
    };
    let of_picture =
        picture.and_then(|Group { channels: [red, green, blue, _, grey, ..] }| match (grey, red) {
            (Some(grey), _) => Some(DepthAlone { index: *grey, same: Vec::new() }),
            (None, Some(red)) => {
                Some(DepthAlone { index: *red, same: green.iter().chain(blue).copied().collect() })
            }
            _ => None,
        });
    let alone = alone.map(|index| DepthAlone { index, same: Vec::new() });
    alone.or(of_picture.filter(|depth| is_free(&depth.index))).ok_or_else(|| {
        let error = Error::input("the depth file has no depth channel")
            .with("found", shown(names))
            .with("looked for", LOOKED_FOR)
            .help("name it with `depth_channel`");
        match doubtful(names) {
            Some(doubtful) => error.with("could be meant", doubtful),
            None => error,
        }
    })
}

/// Whether `names` hold a channel that is depth by its name.
pub(super) fn has_depth(names: &[&str]) -> bool {
    !ChannelGroups::from_names(names).depths.is_empty()
}

/// The channels that could be meant as depth but are not named so, each with what else it is; `None` without any.
pub(super) fn doubtful(names: &[&str]) -> Option<String> {
    let (vectors, groups) = (vectors(names), ChannelGroups::from_names(names));
    let is_coordinate =
        |name: &str| name.rsplit_once('.').is_some_and(|(prefix, _)| vectors.contains(prefix));
    let is_depth = |index: usize| groups.depths.values().any(|depth| depth.index == index);
    let could = names.iter().enumerate().filter(|(index, name)| {
        depth_names::could_be_depth(name) && !is_coordinate(name) && !is_depth(*index)
    });
    let told = could.map(|(_, name)| match depth_names::other_meaning(name) {
        Some(meaning) => format!("{name} ({meaning})"),
        None => (*name).to_owned(),
    });
    let positions = groups.positions.iter().filter(|(_, axes)| axes.iter().all(Option::is_some));
    let told = told.chain(
        positions.map(|(group, _)| format!("{group} (a position, which needs worldToCamera in the header)")),
    );
    let told: Vec<String> = told.collect();
    let told: Vec<&str> = told.iter().map(String::as_str).collect();
    (!told.is_empty()).then(|| listed(&told, ", "))
}

/// Whether `names` hold a picture, in colours or grey.
pub(super) fn has_picture(names: &[&str]) -> bool {
    ChannelGroups::from_names(names).colors.values().any(|group| group.color().is_some())
}

/// Whether `names` hold a colour picture.
pub(super) fn has_color(names: &[&str]) -> bool {
    ChannelGroups::from_names(names).colors.values().any(Group::is_rgb)
}

/// The names as one line, truncated if there are many.
pub(super) fn shown(names: &[&str]) -> String {
    listed(names, " ")
}

fn listed(names: &[&str], joint: &str) -> String {
    let mut line = names.iter().take(SHOWN_NAMES).copied().collect::<Vec<_>>().join(joint);
    if names.len() > SHOWN_NAMES {
        line.push_str(&format!(" and {} more", names.len() - SHOWN_NAMES));
    }
    if line.is_empty() { "no channels".to_owned() } else { line }
}

impl<'a> ChannelGroups<'a> {
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
        let root_alpha = || self.colors.get("").and_then(|root| root.channels[3]);
        let alpha = group.channels[3].or_else(|| is_named(prefix, WITHOUT_ALPHA).then(root_alpha).flatten());
        let mut peel = PeelChannels {
            prefix: layer.to_owned(),
            color: group.color()?,
            is_chroma: group.chroma().is_some(),
            alpha,
            depth: None,
            same_as_depth: Vec::new(),
            position: self.position(layer),
            shading: None,
        };
        self.set_depth(&mut peel, depth);
        Some(peel)
    }

    fn set_depth(&self, peel: &mut PeelChannels, depth: Option<&RankedDepth>) {
        peel.depth = depth.map(|depth| depth.index);
        peel.same_as_depth = peel.depth.and_then(|depth| self.same.get(&depth)).cloned().unwrap_or_default();
    }

    /// The channels of the position of the layer `layer`, or of the root.
    fn position(&self, layer: &str) -> Option<[usize; 3]> {
        let of = |owner: &str| {
            let own = |prefix: &str| prefix.rsplit_once('.').map_or("", |(outer, _)| outer) == owner;
            self.positions.iter().find(|(prefix, _)| own(prefix)).and_then(|(_, axes)| match axes {
                [Some(x), Some(y), Some(z)] => Some([*x, *y, *z]),
                _ => None,
            })
        };
        of(layer).or_else(|| of(""))
    }

    /// The anti-aliased colour of the peel `prefix`, if that is a numbered one.
    fn beauty(&self, prefix: &str) -> Option<PeelChannels> {
        let group = self.colors.keys().copied().find(|group| is_beauty_of(group, prefix))?;
        self.peel(group).map(PeelChannels::without_depth)
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
            self.set_depth(peel, self.depths.get("").or(only));
        }
    }
}

impl PeelChannels {
    /// The same without anything that depth could be made of.
    pub(super) fn without_depth(self) -> Self {
        Self { depth: None, same_as_depth: Vec::new(), position: None, ..self }
    }
}

/// Whether the last part of `prefix` is `name`.
fn is_named(prefix: &str, name: &str) -> bool {
    last_part(prefix).eq_ignore_ascii_case(name)
}

/// Whether the colour group `group` is named as the anti-aliased colour of the numbered peel `peel`.
fn is_beauty_of(group: &str, peel: &str) -> bool {
    strip_ending(layer_of(group), BEAUTY)
        .is_some_and(|layer| layer.eq_ignore_ascii_case(peel) && is_numbered_peel(peel))
}

fn is_other(prefix: &str) -> bool {
    let last = last_part(prefix).to_ascii_lowercase();
    NOT_THE_PICTURE.iter().any(|start| last.starts_with(start))
}

/// Gives every peel the depth channel `requested`: the full name, else the name after the peel's prefix.
fn name_depths(peels: &mut [PeelChannels], names: &[&str], requested: &str) -> Result<(), Error> {
    let find = |full: &str| names.iter().position(|name| *name == full);
    for peel in &mut *peels {
        *peel = std::mem::take(peel).without_depth();
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
