//! One file's peels, before they are put together with those of other files.

use super::decode::{Decoded, Use, decode};
use super::header::ExrFile;
use super::names::{self, Assigned, PeelChannels};
use super::options::{Carry, ReadOptions};
use super::sanitise::Replaced;
use super::{CarriedChannel, ColorRange, Cryptomatte, Frame, Precision, Window, carried, cryptomatte};
use crate::error::Error;
use crate::finding::Finding;
use crate::image::Plane;
use exr::meta::attribute::{AttributeValue, SampleType, Text};
use std::path::PathBuf;

/// A peel whose depth may be in another file.
#[derive(Debug)]
pub(super) struct Layer {
    /// Red, green, blue.
    pub(super) color: [Plane; 3],
    /// Alpha; 1 where the file has none.
    pub(super) alpha: Plane,
    /// Depth, if the file has it.
    pub(super) depth: Option<Plane>,
    /// Where the planes lie.
    pub(super) window: Window,
    /// What the peel is called in the file; may be empty.
    pub(super) prefix: String,
    /// Full name of its depth channel, if any.
    pub(super) depth_channel: String,
    /// The channels it was found among, to show.
    pub(super) found: String,
}

/// What one file holds.
#[derive(Debug)]
pub(super) struct Layers {
    /// The path or name to show.
    pub(super) name: PathBuf,
    /// The peels, nearest first; at least one.
    pub(super) peels: Vec<Layer>,
    /// Where the first peel lies.
    pub(super) frame: Frame,
    /// Of the colour channels.
    pub(super) precision: Precision,
    /// How bright colours can be.
    pub(super) color_range: ColorRange,
    /// The header's attributes.
    pub(super) attributes: Vec<(Text, AttributeValue)>,
    /// Channels to hand on.
    pub(super) channels: Vec<CarriedChannel>,
    /// The cryptomattes of the first peel.
    pub(super) cryptomattes: Vec<Cryptomatte>,
    /// Doubts and decisions.
    pub(super) findings: Vec<Finding>,
    /// Values that had to be replaced.
    pub(super) replaced: Replaced,
}

/// Decodes the peels of an OpenEXR file, and the channels that `options` ask for.
///
/// # Errors
/// No colour; damaged pixels; more memory than allowed.
pub(super) fn read_exr(file: ExrFile, options: &ReadOptions) -> Result<Layers, Error> {
    let names = file.names();
    let mut assigned = names::assign(&names, options).map_err(|error| error.in_file(&file.name))?;
    // A depth file replaces what depth there is.
    if options.depth_file.is_some() {
        assigned.peels.iter_mut().for_each(|peel| peel.depth = None);
    }
    read_assigned(file, assigned, options)
}

/// Decodes the main picture of an OpenEXR file alone.
///
/// # Errors
/// As [`read_exr`].
pub(super) fn read_exr_picture(file: ExrFile) -> Result<Layers, Error> {
    let mut peel = names::picture(&file.names()).map_err(|error| error.in_file(&file.name))?;
    peel.depth = None;
    let options = ReadOptions { carry: Carry::None, ..ReadOptions::default() };
    read_assigned(file, Assigned { peels: vec![peel], findings: Vec::new() }, &options)
}

/// Decodes one channel of an OpenEXR file, as depth, and says its name.
///
/// # Errors
/// As [`read_exr`].
pub(super) fn read_exr_depth(file: ExrFile, options: &ReadOptions) -> Result<(Plane, String), Error> {
    let wanted = options.depth_channel.as_deref();
    let place = names::depth_alone(&file.names(), wanted).map_err(|error| error.in_file(&file.name))?;
    let name = file.channels[place].name.clone();
    let (decoded, _) = decode(file, &[(place, Use::Depth)], options.max_bytes)?;
    Ok((planes(decoded.into_iter()).next().unwrap_or_default(), name))
}

fn read_assigned(file: ExrFile, assigned: Assigned, options: &ReadOptions) -> Result<Layers, Error> {
    let Assigned { peels, mut findings } = assigned;
    peels
        .iter()
        .try_for_each(|peel| check_one_part(&file, peel))
        .map_err(|error| error.in_file(&file.name))?;
    let Some(first) = peels.first() else {
        return Err(Error::input("there is no peel").in_file(&file.name));
    };
    let frame = file.frame(file.channels[first.color[0]].part);
    let used: Vec<usize> = peels.iter().flat_map(wanted_of).map(|(place, _)| place).collect();
    let deeper: Vec<&str> = peels[1..].iter().map(|peel| peel.prefix.as_str()).collect();
    let cryptomattes = cryptomatte::find(&file, frame.data, &deeper);
    let asked_for = if options.objects { cryptomattes.as_slice() } else { &[] };
    let (handed_on, left) = carried::choose(&file, &used, (options.carry, asked_for), frame.data);
    findings.extend(left);
    let mut wanted: Vec<(usize, Use)> = peels.iter().flat_map(wanted_of).collect();
    wanted.extend(handed_on.iter().map(|&place| (place, Use::Carry)));

    let named = |&place: &usize| (file.channels[place].name.clone(), file.channels[place].quantize_linearly);
    let carried_names: Vec<(String, bool)> = handed_on.iter().map(named).collect();
    let is_half =
        |peel: &PeelChannels| peel.color.iter().all(|&c| file.channels[c].sample_type == SampleType::F16);
    let precision = if peels.iter().all(is_half) { Precision::Half } else { Precision::Float };
    let (name, attributes) = (file.name.clone(), file.attributes());
    let described: Vec<Described> = peels.into_iter().map(|peel| Described::of(&file, peel)).collect();

    let (decoded, replaced) = decode(file, &wanted, options.max_bytes)?;
    let mut decoded = decoded.into_iter();
    let peels = described.into_iter().map(|peel| peel.take(&mut decoded)).collect();
    let channels = carried::channels(carried_names, decoded);
    let color_range = ColorRange::Unbounded;
    Ok(Layers {
        name,
        peels,
        frame,
        precision,
        color_range,
        attributes,
        channels,
        cryptomattes,
        findings,
        replaced,
    })
}

/// The channels of one peel in the order they are decoded.
fn wanted_of(peel: &PeelChannels) -> impl Iterator<Item = (usize, Use)> + use<> {
    let color = peel.color.into_iter().map(|place| (place, Use::Color));
    color
        .chain(peel.alpha.map(|place| (place, Use::Alpha)))
        .chain(peel.depth.map(|place| (place, Use::Depth)))
}

/// Two parts may share a name, but a picture's channels must be in one of them.
fn check_one_part(file: &ExrFile, peel: &PeelChannels) -> Result<(), Error> {
    let part = file.channels[peel.color[0]].part;
    let mut all = peel.color.iter().chain(&peel.alpha);
    if all.all(|&place| file.channels[place].part == part) {
        return Ok(());
    }
    Err(Error::input("the channels of one picture are spread over several parts")
        .with("found", names::shown(&file.names()))
        .help("give each part of the file a name of its own"))
}

/// What is known of a peel before its pixels are.
struct Described {
    channels: PeelChannels,
    window: Window,
    depth_window: Window,
    depth_channel: String,
    found: String,
}

impl Described {
    fn of(file: &ExrFile, channels: PeelChannels) -> Self {
        let window_of = |place: usize| file.frame(file.channels[place].part).data;
        let window = window_of(channels.color[0]);
        let all = file.names();
        let near: Vec<&str> = all.iter().copied().filter(|name| name.starts_with(&channels.prefix)).collect();
        Self {
            window,
            depth_window: channels.depth.map_or(window, window_of),
            depth_channel: channels.depth.map_or_else(String::new, |place| all[place].to_owned()),
            found: names::shown(&near),
            channels,
        }
    }

    fn take(self, decoded: &mut impl Iterator<Item = Decoded>) -> Layer {
        let Self { channels, window, depth_window, depth_channel, found } = self;
        let mut next = || planes(decoded.by_ref()).next().unwrap_or_default();
        let color = [next(), next(), next()];
        let alpha = match channels.alpha {
            Some(_) => next(),
            None => Plane::filled(window.width, window.height, 1.0),
        };
        let depth = channels.depth.map(|_| place(next(), depth_window, window, f32::INFINITY));
        Layer { color, alpha, depth, window, prefix: channels.prefix, depth_channel, found }
    }
}

fn planes(decoded: impl Iterator<Item = Decoded>) -> impl Iterator<Item = Plane> {
    decoded.filter_map(|decoded| match decoded {
        Decoded::Plane(plane) => Some(plane),
        Decoded::Samples(_) => None,
    })
}

/// `plane`, which lies in window `from`, as a plane of window `to`; `outside` where it has no pixels.
pub(super) fn place(plane: Plane, from: Window, to: Window, outside: f32) -> Plane {
    if from == to {
        return plane;
    }
    let mut placed = Plane::filled(to.width, to.height, outside);
    // Coordinates are below 2^30 (guard), so their differences fit.
    let left = from.x.max(to.x);
    let right = (from.x + from.width as i32).min(to.x + to.width as i32);
    if left >= right {
        return placed;
    }
    for y in from.y.max(to.y)..(from.y + from.height as i32).min(to.y + to.height as i32) {
        let source = &plane.row((y - from.y) as usize)[(left - from.x) as usize..(right - from.x) as usize];
        placed.row_mut((y - to.y) as usize)[(left - to.x) as usize..(right - to.x) as usize]
            .copy_from_slice(source);
    }
    placed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_crop_lands_at_its_place_and_nothing_lies_around_it() {
        let crop = Window { x: -1, y: 5, width: 1, height: 1 };
        let whole = Window { x: -2, y: 4, width: 3, height: 2 };
        let placed = place(Plane::filled(1, 1, 7.0), crop, whole, 0.0);
        assert_eq!(placed.values(), [0.0, 0.0, 0.0, 0.0, 7.0, 0.0]);
        assert_eq!(place(placed, whole, crop, 0.0).values(), [7.0]);
    }
}
