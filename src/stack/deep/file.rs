//! A file with deep parts: which of its channels are what, and the pictures that it holds.

use super::super::header::ExrFile;
use super::super::input::Opened;
use super::super::names::{self, PeelChannels};
use super::super::options::ReadOptions;
use super::super::{Frame, Source, guard};
use super::block::{ALPHA, DEPTH, Layout, ROLES};
use super::element::DeepElement;
use super::unpack::Packing;
use crate::error::Error;
use crate::finding::Finding;
use exr::meta::attribute::{AttributeValue, Text};
use std::path::PathBuf;

/// An opened file with deep parts.
#[derive(Debug)]
pub(in crate::stack) struct DeepFile {
    /// The path or name for messages.
    pub(in crate::stack) name: PathBuf,
    /// Its deep pictures, at least one.
    pub(in crate::stack) elements: Vec<DeepElement>,
    /// Windows of the first of them.
    pub(in crate::stack) frame: Frame,
    /// The header's attributes.
    pub(in crate::stack) attributes: Vec<(Text, AttributeValue)>,
    /// Full name of the depth channel of the first picture.
    pub(in crate::stack) depth_channel: String,
    /// Warnings and decisions.
    pub(in crate::stack) findings: Vec<Finding>,
}

/// Whether `source` is a file with deep parts.
///
/// # Errors
/// The file cannot be opened or read.
pub(in crate::stack) fn is_deep(source: &Source) -> Result<bool, Error> {
    guard::has_deep_part(&mut Opened::open(source)?)
}

/// Opens a file with deep parts.
///
/// # Errors
/// A damaged header, channels that are no deep picture with depth, a codec that deep parts cannot have.
pub(in crate::stack) fn open(source: &Source, options: &ReadOptions) -> Result<DeepFile, Error> {
    let file = ExrFile::open_deep(Opened::open(source)?)?.of_requested_view(options)?;
    let name = file.name.clone();
    open_parts(file, source, options).map_err(|error| error.in_file(&name))
}

fn open_parts(file: ExrFile, source: &Source, options: &ReadOptions) -> Result<DeepFile, Error> {
    let deep: Vec<usize> =
        (0..file.channels.len()).filter(|&i| file.header(file.channels[i].part).deep).collect();
    let all = file.names();
    let names: Vec<&str> = deep.iter().map(|&index| all[index]).collect();
    let assigned = names::assign(&names, options)?;
    let pictures = assigned.peels;
    // Peels are ordered by name, deep pictures by depth.
    let mut findings = assigned.findings;
    findings.retain(|finding| finding.about != "peels");
    let layouts: Vec<(usize, Layout)> =
        pictures.iter().map(|picture| layout(&file, &deep, picture)).collect::<Result<_, Error>>()?;
    let (first, part) = match (pictures.first(), layouts.first()) {
        (Some(first), Some((part, _))) => (first, *part),
        _ => return Err(Error::input("the file has no deep picture")),
    };
    let depth_channel = first.depth.map_or_else(String::new, |depth| names[depth].to_owned());
    findings.extend(opaque(&layouts));
    findings.extend(left_out(&file, &layouts));
    let (name, frame, attributes) = (file.name.clone(), file.frame(part), file.attributes());
    let frame = Frame { data: file.whole_window(part), ..frame };
    let mut opened = Some(file);
    let elements = layouts.into_iter().map(|(part, layout)| {
        let file = match opened.take() {
            Some(file) => file,
            None => ExrFile::open_deep(Opened::open(source)?)?.of_requested_view(options)?,
        };
        DeepElement::new(file, part, layout)
    });
    let elements = elements.collect::<Result<Vec<_>, Error>>()?;
    Ok(DeepFile { name, elements, frame, attributes, depth_channel, findings })
}

/// The part of a picture, and how its samples are stored.
fn layout(file: &ExrFile, deep: &[usize], picture: &PeelChannels) -> Result<(usize, Layout), Error> {
    let channel = |index: usize| &file.channels[deep[index]];
    let part = channel(picture.color[0]).part;
    let Some(depth) = picture.depth else {
        let own: Vec<&str> = deep.iter().map(|&index| file.channels[index].name.as_str()).collect();
        return Err(Error::input("the deep samples have no depth channel")
            .with("found", names::shown(&own))
            .with("looked for", "Z")
            .help("name it with `depth_channel`"));
    };
    let mut roles: [Option<usize>; ROLES] = [None; ROLES];
    for (role, index) in roles.iter_mut().zip(picture.color) {
        *role = Some(index);
    }
    (roles[ALPHA], roles[DEPTH]) = (picture.alpha, Some(depth));
    if roles.iter().flatten().any(|&index| channel(index).part != part) {
        return Err(Error::input("the channels of one deep picture are in several parts")
            .help("give each part of the file a unique name"));
    }
    let mut roles = roles.map(|role| role.map(|index| channel(index).index));
    roles[DEPTH + 1] = back_of(file, deep, deep[depth]);
    let header = file.header(part);
    let types = header.channels.list.iter().map(|channel| channel.sample_type).collect();
    Ok((part, Layout { packing: Packing::of(header.compression)?, types, roles }))
}

/// The index, in its part, of the channel with the back of the volumes whose front is in channel `depth`: `ZBack` beside `Z`.
fn back_of(file: &ExrFile, deep: &[usize], depth: usize) -> Option<usize> {
    let front = &file.channels[depth];
    let name = format!("{}Back", front.name);
    let channels = deep.iter().map(|&index| &file.channels[index]);
    let mut fitting =
        channels.filter(|back| back.part == front.part && back.name.eq_ignore_ascii_case(&name));
    fitting.next().map(|back| back.index)
}

/// A warning about samples that do not say how opaque they are.
fn opaque(layouts: &[(usize, Layout)]) -> Option<Finding> {
    let text = "the deep samples have no channel A: each is taken as opaque";
    layouts.iter().any(|(_, layout)| layout.roles[ALPHA].is_none()).then(|| Finding::warning("alpha", text))
}

/// A note about what is not read of the file.
fn left_out(file: &ExrFile, layouts: &[(usize, Layout)]) -> Option<Finding> {
    let is_used = |part: usize, index: usize| {
        let of_part = |(own, layout): &(usize, Layout)| *own == part && layout.roles.contains(&Some(index));
        layouts.iter().any(of_part)
    };
    let others = file.channels.iter().filter(|channel| !is_used(channel.part, channel.index));
    let others: Vec<&str> = others.map(|channel| channel.name.as_str()).collect();
    let text =
        format!("not part of the deep picture, and not copied to the output: {}", names::shown(&others));
    (!others.is_empty()).then(|| Finding::note("channels", text))
}
