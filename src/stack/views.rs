//! The views of a stereo file: which there are, and the file as if it had only one of them.
//!
//! A file states its views in `multiView`, whose first is the hero, or each part in its own `view`. A channel belongs to the view that one
//! of the parts of its name says (`right.R`, `ViewLayer.Combined.left.R`, the part `rgba_left`); without one, to the hero. Files that state
//! none have views where two groups called left and right, or the root and a right, have colour and depth each: lights called so have
//! no depth.

use super::Source;
use super::header::{Channel, ExrFile};
use super::input::Opened;
use super::names;
use super::options::ReadOptions;
use crate::error::Error;
use crate::finding::Finding;

/// The two sides in files that do not state their views.
const SIDES: [&str; 2] = ["left", "right"];

/// The value that asks for every view.
pub const ALL_VIEWS: &str = "all";

/// The views of a file.
#[derive(Debug, Default)]
struct Views {
    /// Their names, the hero's first.
    names: Vec<String>,
    /// The view of each channel of the file, and its name without the view's.
    channels: Vec<(Option<usize>, String)>,
}

impl Views {
    fn of(file: &ExrFile) -> Self {
        let names = stated(file);
        if names.is_empty() {
            return Self::unstated(file);
        }
        let channels = file.channels.iter().map(|channel| {
            let own = file.header(channel.part).own_attributes.view_name.as_ref().map(ToString::to_string);
            let of_part = own.and_then(|own| names.iter().position(|name| *name == own));
            let by_name = || names.iter().position(|name| without(&channel.name, name).is_some());
            match of_part.or_else(by_name) {
                Some(view) => {
                    let name = without(&channel.name, &names[view]).unwrap_or_else(|| channel.name.clone());
                    (Some(view), name)
                }
                None => (None, channel.name.clone()),
            }
        });
        Self { channels: channels.collect(), names }
    }

    /// The two sides of a file that does not state its views, if it has them.
    fn unstated(file: &ExrFile) -> Self {
        let channels = file.channels.iter().map(|channel| {
            let side =
                SIDES.iter().enumerate().find_map(|(side, name)| Some((side, side_of(&channel.name, name)?)));
            side.map_or_else(|| (None, channel.name.clone()), |(side, name)| (Some(side), name))
        });
        let views = Self { names: SIDES.map(str::to_owned).to_vec(), channels: channels.collect() };
        let is_whole = |view: Option<usize>| {
            let names: Vec<&str> = views
                .channels
                .iter()
                .filter(|(other, _)| *other == view)
                .map(|(_, name)| name.as_str())
                .collect();
            names::has_picture(&names) && names::has_depth(&names)
        };
        let is_stereo = is_whole(Some(1)) && (is_whole(Some(0)) || is_whole(None));
        if is_stereo { views } else { Self::default() }
    }

    /// The names of the views that have a picture.
    fn present(&self) -> Vec<&str> {
        let has_picture = |view: usize| {
            let of_view =
                |&&(other, _): &&(Option<usize>, String)| other.map_or(view == 0, |other| other == view);
            let names: Vec<&str> =
                self.channels.iter().filter(of_view).map(|(_, name)| name.as_str()).collect();
            names::has_picture(&names)
        };
        (0..self.names.len())
            .filter(|&view| has_picture(view))
            .map(|view| self.names[view].as_str())
            .collect()
    }
}

impl ExrFile {
    /// The names of its views, the hero's first; empty for a file with one.
    pub(super) fn views(&self) -> Vec<String> {
        let views = Views::of(self);
        let present = views.present();
        if present.len() > 1 { present.into_iter().map(str::to_owned).collect() } else { Vec::new() }
    }

    /// The file with the view that `options` request; with all of them where the options name the colour's channels themselves.
    ///
    /// # Errors
    /// Those of [`ExrFile::of_view`].
    pub(super) fn of_requested_view(self, options: &ReadOptions) -> Result<Self, Error> {
        match (&options.view, &options.color_channel) {
            (None, Some(_)) => Ok(self),
            (view, _) => self.of_view(view.as_deref()),
        }
    }

    /// [`ExrFile::of_requested_view`] of a file that comes beside a picture, and need not have views.
    ///
    /// # Errors
    /// Those of [`ExrFile::of_view`].
    pub(super) fn of_requested_view_if_any(self, options: &ReadOptions) -> Result<Self, Error> {
        if self.views().is_empty() { Ok(self.of_hero()) } else { self.of_requested_view(options) }
    }

    /// The file as if it had the requested view only, with the channels' names as in a file of one view.
    ///
    /// # Errors
    /// Several views and none requested; a requested one that is not there.
    pub(super) fn of_view(self, requested: Option<&str>) -> Result<Self, Error> {
        let views = Views::of(&self);
        let present = views.present();
        let listed = present.join(", ");
        let view = match (requested, present.as_slice()) {
            (None, [] | [_]) => 0,
            (None, _) => return Err(several(&present).in_file(&self.name)),
            (Some(ALL_VIEWS), [_, _, ..]) if !present.contains(&ALL_VIEWS) => {
                return Err(several(&present).in_file(&self.name));
            }
            (Some(requested), present) => {
                let found =
                    named(present, requested).and_then(|name| views.names.iter().position(|n| n == name));
                found.ok_or_else(|| {
                    let found = if listed.is_empty() { "no views".to_owned() } else { listed.clone() };
                    Error::settings(format!("there is no view called {requested}"))
                        .with("found", found)
                        .in_file(&self.name)
                })?
            }
        };
        let finding = (present.len() > 1).then(|| {
            Finding::note(
                "view",
                format!("{} of the views {listed}: nothing of the others is used", views.names[view]),
            )
        });
        Ok(self.only_view(views, view, finding))
    }

    /// The file as if it had its hero view only.
    pub(super) fn of_hero(self) -> Self {
        let views = Views::of(&self);
        self.only_view(views, 0, None)
    }

    fn only_view(self, views: Views, view: usize, finding: Option<Finding>) -> Self {
        if views.names.is_empty() {
            return self;
        }
        let of = |wanted: Option<usize>| {
            let named =
                self.channels.iter().zip(&views.channels).filter(move |(_, (view, _))| *view == wanted);
            named.map(|(channel, (_, name))| Channel { name: name.clone(), ..channel.clone() })
        };
        let mut channels: Vec<Channel> = of(Some(view)).collect();
        if view == 0 {
            // A channel that states the hero's view comes before one of the same name that states none.
            let names: Vec<String> = channels.iter().map(|channel| channel.name.clone()).collect();
            channels.extend(of(None).filter(|channel| !names.contains(&channel.name)));
        }
        let mut findings = self.findings;
        findings.extend(finding);
        Self { channels, findings, ..self }
    }
}

/// The views that the headers state, the hero's first.
fn stated(file: &ExrFile) -> Vec<String> {
    let headers = || file.meta_data.headers.iter().map(|header| &header.own_attributes);
    let in_one_part = headers().filter_map(|own| own.multi_view_names.as_ref()).flatten();
    let of_parts = headers().filter_map(|own| own.view_name.as_ref());
    let mut names: Vec<String> = Vec::new();
    for name in in_one_part.chain(of_parts).map(ToString::to_string) {
        if !name.is_empty() && !names.contains(&name) {
            names.push(name);
        }
    }
    names
}

/// The channel's name without the view's, which is a part of it before the last, or the end of one behind `_`, `-` or a space.
fn without(channel: &str, view: &str) -> Option<String> {
    let (groups, last) = channel.rsplit_once('.')?;
    let mut parts: Vec<&str> = groups.split('.').collect();
    if let Some(at) = parts.iter().rposition(|part| part.eq_ignore_ascii_case(view)) {
        parts.remove(at);
    } else {
        let at = parts.iter().position(|part| trimmed(part, view).is_some())?;
        parts[at] = trimmed(parts[at], view)?;
    }
    parts.push(last);
    Some(parts.join("."))
}

/// `part` without `view` at its end and what joins the two.
fn trimmed<'a>(part: &'a str, view: &str) -> Option<&'a str> {
    let at = part.len().checked_sub(view.len())?;
    let (head, tail) = part.split_at_checked(at)?;
    let joined = head.strip_suffix(['_', '-', ' ']).filter(|head| !head.is_empty());
    joined.filter(|_| tail.eq_ignore_ascii_case(view))
}

/// [`without`] for a side, which may also be written as its first letter.
fn side_of(channel: &str, side: &str) -> Option<String> {
    without(channel, side).or_else(|| without(channel, &side[..1]))
}

/// The view of `present` that `requested` names: by its name, or by its first letter or a side's.
fn named<'a>(present: &[&'a str], requested: &str) -> Option<&'a str> {
    let whole = present.iter().find(|name| name.eq_ignore_ascii_case(requested));
    let first = |text: &str| text.chars().next().map(|c| c.to_ascii_lowercase());
    let is_side = requested.len() == 1 || SIDES.iter().any(|side| side.eq_ignore_ascii_case(requested));
    let mut by_letter = present.iter().filter(|name| first(name) == first(requested));
    let only = match (is_side, by_letter.next(), by_letter.next()) {
        (true, Some(only), None) if requested.len() == 1 || only.len() == 1 => Some(only),
        _ => None,
    };
    whole.or(only).copied()
}

fn several(present: &[&str]) -> Error {
    let (last, others) = present.split_last().unwrap_or((&"", &[]));
    let hero = present.first().copied().unwrap_or_default();
    Error::input(format!(
        "the file has several views, {} and {last}: each is a picture of its own",
        others.join(", ")
    ))
    .help(format!("render one with `view = {hero}`, or each with `view = {ALL_VIEWS}`"))
}

/// Checks that `sources` are not the two eyes of one picture, by their names.
///
/// # Errors
/// Two names that differ in their side alone.
pub(super) fn check_files(sources: &[Source]) -> Result<(), Error> {
    let sides = |source: &Source| {
        let name = source.base_name();
        SIDES.iter().position(|side| name_without(&name, side).is_some()).map(|side| {
            let rest = name_without(&name, SIDES[side]).unwrap_or_default();
            (side, rest)
        })
    };
    let found: Vec<Option<(usize, String)>> = sources.iter().map(sides).collect();
    let is_pair = |i: usize, j: usize| match (&found[i], &found[j]) {
        (Some((side, rest)), Some((other, same))) => side != other && rest == same,
        _ => false,
    };
    let pair = (0..sources.len()).find_map(|i| (0..i).find(|&j| is_pair(i, j)).map(|j| (j, i)));
    let Some((first, second)) = pair else { return Ok(()) };
    Err(Error::settings("two files are the left and the right view of one picture, not peels of one stack")
        .with("found", format!("{} and {}", sources[first].base_name(), sources[second].base_name()))
        .help("render each view by itself, with `focus_distance` for both to have one focus"))
}

/// A file's name without the side, which is one of the words between its dots, dashes, underscores and spaces.
fn name_without(name: &str, side: &str) -> Option<String> {
    let mut words: Vec<&str> = name.split(['.', '_', '-', ' ']).collect();
    let is_side = |word: &&str| word.eq_ignore_ascii_case(side) || **word == side[..1].to_ascii_uppercase();
    let at = words.iter().rposition(is_side)?;
    words.remove(at);
    Some(words.join("."))
}

/// The names of the views of an OpenEXR file, the hero's first; empty for a file of one view and for other formats.
///
/// # Errors
/// Those of [`super::read()`] that headers show.
pub fn views(source: &Source) -> Result<Vec<String>, Error> {
    let mut opened = Opened::open(source)?;
    if opened.is_exr()? { Ok(ExrFile::open(opened)?.views()) } else { Ok(Vec::new()) }
}
