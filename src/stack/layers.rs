//! The peels of one file, before they are combined with those of other files.

use super::chroma;
use super::decode::{Decoded, Use, decode};
use super::depth_picture;
use super::header::{Channel, ExrFile};
use super::names::{self, Assigned, PeelChannels};
use super::options::{Carry, ReadOptions};
use super::position::{self, WorldToCamera};
use super::sanitise::Replaced;
use super::shading::{Shading, ShadingChannels};
use super::windows::{self, place_depth};
use super::{
    AlphaMode, CarriedChannel, ColorRange, Cryptomatte, Frame, Precision, Window, alpha, carried, cryptomatte,
};
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
    /// Data window of the planes.
    pub(super) window: Window,
    /// Name of the peel in the file; may be empty.
    pub(super) prefix: String,
    /// Full name of its depth channel, if any.
    pub(super) depth_channel: String,
    /// The channels with its prefix, for errors.
    pub(super) found: String,
    /// What its surfaces reflect, if the file says so.
    pub(super) shading: Option<Shading>,
}

/// The anti-aliased picture of the stack's frame.
#[derive(Debug)]
pub(super) struct Beauty {
    /// Where it is from, for messages.
    pub(super) name: String,
    /// Red, green, blue: premultiplied.
    pub(super) color: [Plane; 3],
    /// Alpha; 1 where the file has none.
    pub(super) alpha: Plane,
    /// Its windows; the planes cover the data window.
    pub(super) frame: Frame,
    /// Whether the user names it; otherwise the stack holds it.
    pub(super) is_requested: bool,
}

/// The content of one file.
#[derive(Debug)]
pub(super) struct Layers {
    /// The path or name for messages.
    pub(super) name: PathBuf,
    /// The peels, nearest first; at least one.
    pub(super) peels: Vec<Layer>,
    /// Whether the peels are fragments that were sorted by depth, pixel by pixel, and not hits of rays: two of them may lie as close as
    /// they like.
    pub(super) is_merged: bool,
    /// The anti-aliased colour of the first peel, if there is any.
    pub(super) beauty: Option<Beauty>,
    /// Display window of the first peel, and the data window of the channels, which holds all peels.
    pub(super) frame: Frame,
    /// Numeric type of the colour channels.
    pub(super) precision: Precision,
    /// Range of the colours.
    pub(super) color_range: ColorRange,
    /// The header's attributes.
    pub(super) attributes: Vec<(Text, AttributeValue)>,
    /// Channels to copy to the output, and requested cryptomattes.
    pub(super) channels: Vec<CarriedChannel>,
    /// The cryptomattes of the first peel.
    pub(super) cryptomattes: Vec<Cryptomatte>,
    /// Warnings and decisions.
    pub(super) findings: Vec<Finding>,
    /// Whether the peels are files whose names differ in a number alone that may be that of a frame.
    pub(super) is_numbered: bool,
    /// Counts of replaced values.
    pub(super) replaced: Replaced,
}

impl Layer {
    /// The layer, its colour multiplied by alpha if `alpha` says that the file has it straight.
    pub(super) fn premultiplied(mut self, alpha: Option<AlphaMode>) -> Self {
        match alpha {
            Some(AlphaMode::Straight) => {
                alpha::premultiply(&mut self.color, &self.alpha);
                self.shading = self.shading.map(|shading| shading.premultiplied(&self.alpha));
            }
            Some(AlphaMode::Opaque) => self.alpha.values_mut().fill(1.0),
            Some(AlphaMode::Premultiplied) | None => {}
        }
        self
    }

    /// Whether any of its pixels has light or alpha.
    pub(super) fn has_content(&self) -> bool {
        self.color.iter().chain([&self.alpha]).any(|plane| plane.values().iter().any(|&value| value != 0.0))
    }

    /// The layer as the beauty that the stack holds; `frame` has its windows.
    pub(super) fn into_beauty(self, frame: Frame) -> Beauty {
        Beauty { name: self.prefix, color: self.color, alpha: self.alpha, frame, is_requested: false }
    }
}

/// Decodes the peels of an OpenEXR file, and the other channels that `options` request.
///
/// # Errors
/// No colour, damaged pixels, more memory than allowed.
pub(super) fn read_exr(file: ExrFile, options: &ReadOptions) -> Result<Layers, Error> {
    let assigned = assign(&file, options)?;
    read_assigned(file, assigned, options)
}

/// The channels of a file by peel, as `options` request them.
fn assign(file: &ExrFile, options: &ReadOptions) -> Result<Assigned, Error> {
    let own_name = |stored: &Option<String>| stored.as_deref().map(|stored| file.name_without_view(stored));
    let named = ReadOptions {
        color_channel: own_name(&options.color_channel),
        depth_channel: own_name(&options.depth_channel),
        ..options.clone()
    };
    let mut assigned = names::assign(&file.names(), &named).map_err(|error| error.in_file(&file.name))?;
    // A depth file replaces the depth of this file.
    if options.depth_file.is_some() {
        assigned.peels.iter_mut().for_each(|peel| *peel = std::mem::take(peel).without_depth());
    }
    let camera = position::world_to_camera(&file.attributes());
    for peel in &mut assigned.peels {
        // A position is used where there is no depth and a camera that turns it into one.
        if peel.depth.is_some() || camera.is_none() {
            peel.position = None;
        }
        // Bands of rows do not have what lies beyond them, where reflections move to.
        if options.rows.is_none() {
            peel.shading = ShadingChannels::of(&file.names(), &peel.prefix);
        }
    }
    Ok(assigned)
}

/// The channels of a file by peel, and the indices of those that are read beside them: to be copied, and requested cryptomattes.
///
/// # Errors
/// No colour.
pub(super) fn channels_to_read(
    file: &ExrFile,
    options: &ReadOptions,
) -> Result<(Assigned, Vec<usize>), Error> {
    let assigned = assign(file, options)?;
    let (_, kept, _) = beside_peels(file, &assigned, options);
    Ok((assigned, kept))
}

/// The cryptomattes of a file, the indices of the channels that are read beside those of the peels, and findings about the rest.
fn beside_peels(
    file: &ExrFile,
    assigned: &Assigned,
    options: &ReadOptions,
) -> (Vec<Cryptomatte>, Vec<usize>, Vec<Finding>) {
    let Assigned { peels, beauty, .. } = assigned;
    let peels_own = peels.iter().chain(beauty).flat_map(channels_of_peel);
    let used: Vec<usize> = peels_own.map(|(index, _)| index).collect();
    let Some(Frame { data, .. }) = frame_of(file, peels) else {
        return (Vec::new(), Vec::new(), Vec::new());
    };
    let deeper: Vec<&str> = peels[1..].iter().map(|peel| peel.prefix.as_str()).collect();
    let mut cryptomattes = cryptomatte::find(file, data, &deeper);
    if options.objects && file.is_on_disk() {
        cryptomatte::read_sidecars(&mut cryptomattes, &file.name);
    }
    let requested_mattes = if options.objects { cryptomattes.as_slice() } else { &[] };
    let (kept, mut findings) = carried::choose(file, &used, (options.carry, requested_mattes), data);
    findings.extend(cryptomatte::half_ids(file));
    (cryptomattes, kept, findings)
}

/// Decodes only the main picture of an OpenEXR file.
///
/// # Errors
/// As [`read_exr`].
pub(super) fn read_exr_picture(file: ExrFile, options: &ReadOptions) -> Result<Layers, Error> {
    let peel = names::picture(&file.names()).map_err(|error| error.in_file(&file.name))?.without_depth();
    let ReadOptions { alpha, max_bytes, .. } = *options;
    let options = ReadOptions { carry: Carry::None, alpha, max_bytes, ..ReadOptions::default() };
    read_assigned(file, Assigned { peels: vec![peel], ..Assigned::default() }, &options)
}

/// The pixels of the main picture of an OpenEXR file whose colour is NaN or infinite, as column and row of its data window.
///
/// # Errors
/// As [`read_exr`].
pub(super) fn broken_pixels(file: ExrFile, options: &ReadOptions) -> Result<Vec<[usize; 2]>, Error> {
    let peel = names::picture(&file.names()).map_err(|error| error.in_file(&file.name))?;
    // Depth is decoded as it is.
    let requested = peel.color.map(|index| (index, Use::Depth));
    let (decoded, _) = decode(file, &requested, options.max_bytes)?;
    let color: Vec<Plane> = planes(decoded.into_iter()).collect();
    let (width, height) = color.first().map_or((0, 0), |plane| (plane.width(), plane.height()));
    let is_broken = |&[x, y]: &[usize; 2]| color.iter().any(|plane| !plane.get(x, y).is_finite());
    let places = (0..height).flat_map(|y| (0..width).map(move |x| [x, y]));
    Ok(places.filter(is_broken).collect())
}

/// Decodes one channel of an OpenEXR file as depth, and returns its name and its windows.
///
/// # Errors
/// As [`read_exr`]; a picture whose three channels differ.
pub(super) fn read_exr_depth(file: ExrFile, options: &ReadOptions) -> Result<(Plane, String, Frame), Error> {
    let requested = options.depth_channel.as_deref().map(|stored| file.name_without_view(stored));
    let found =
        names::depth_alone(&file.names(), requested.as_deref()).map_err(|error| error.in_file(&file.name))?;
    let Channel { name, part, .. } = file.channels[found.index].clone();
    let (path, frame) = (file.name.clone(), file.frame(part));
    let channels: Vec<(usize, Use)> =
        std::iter::once(found.index).chain(found.same).map(|index| (index, Use::Depth)).collect();
    let (decoded, _) = decode(file, &channels, options.max_bytes)?;
    let mut planes = planes(decoded.into_iter());
    let depth = planes.next().unwrap_or_default();
    depth_picture::check_equal(&depth, &planes.collect::<Vec<_>>(), &name)
        .map_err(|error| error.in_file(&path))?;
    Ok((depth, name, frame))
}

/// Display window of the first of `peels`, and the window that holds them all; `None` if there are none.
pub(super) fn frame_of(file: &ExrFile, peels: &[PeelChannels]) -> Option<Frame> {
    let frame = |peel: &PeelChannels| file.frame(file.channels[peel.color[0]].part);
    let first = frame(peels.first()?);
    let windows: Vec<Window> = peels.iter().map(|peel| frame(peel).data).collect();
    Some(Frame { data: windows::union(&windows, first.display), ..first })
}

fn read_assigned(file: ExrFile, assigned: Assigned, options: &ReadOptions) -> Result<Layers, Error> {
    assigned
        .peels
        .iter()
        .chain(&assigned.beauty)
        .try_for_each(|peel| check_one_part(&file, peel))
        .map_err(|error| error.in_file(&file.name))?;
    let Some(frame) = frame_of(&file, &assigned.peels) else {
        return Err(Error::input("the file has no peel").in_file(&file.name));
    };
    let (cryptomattes, kept, of_kept) = beside_peels(&file, &assigned, options);
    let Assigned { peels, beauty, mut findings } = assigned;
    findings.extend(of_kept);
    findings.extend(file.findings.iter().cloned());
    findings.extend(peels.iter().filter_map(|peel| peel.shading.as_ref()?.doubt(&peel.prefix)));
    findings.extend(not_in_bands(&file, &peels, options));
    let mut requested: Vec<(usize, Use)> = peels.iter().chain(&beauty).flat_map(requested_channels).collect();
    requested.extend(kept.iter().map(|&index| (index, Use::Carry)));

    let kept =
        kept.iter().map(|&index| (file.channels[index].clone(), file.frame(file.channels[index].part).data));
    let kept: Vec<(Channel, Window)> = kept.collect();
    let is_half =
        |peel: &PeelChannels| peel.color.iter().all(|&c| file.channels[c].sample_type == SampleType::F16);
    let precision = if peels.iter().all(is_half) { Precision::Half } else { Precision::Float };
    let (name, attributes) = (file.name.clone(), file.attributes());
    let described: Vec<Described> =
        peels.into_iter().map(|peel| Described::from_channels(&file, peel)).collect();
    let beauty = beauty.map(|beauty| {
        (file.frame(file.channels[beauty.color[0]].part), Described::from_channels(&file, beauty))
    });

    let (decoded, replaced) = decode(file, &requested, options.max_bytes)?;
    let mut decoded = decoded.into_iter();
    let camera = position::world_to_camera(&attributes);
    let luminance = chroma::luminance(&attributes);
    let mut beyond = Vec::new();
    let mut layer = |peel: Described, camera: Option<&WorldToCamera>| {
        let (layer, found) =
            peel.into_layer(&mut decoded, (camera, luminance)).map_err(|error| error.in_file(&name))?;
        beyond.extend(found);
        Ok::<Layer, Error>(layer.premultiplied(options.alpha))
    };
    let peels = described.into_iter().map(|peel| layer(peel, camera.as_ref())).collect::<Result<_, _>>()?;
    let beauty = match beauty {
        Some((frame, described)) => Some(layer(described, None)?.into_beauty(frame)),
        None => None,
    };
    findings.extend(beyond);
    let channels = carried::channels(kept, decoded, frame.data);
    let color_range = ColorRange::Unbounded;
    Ok(Layers {
        name,
        peels,
        is_merged: false,
        beauty,
        frame,
        precision,
        color_range,
        attributes,
        channels,
        cryptomattes,
        findings,
        is_numbered: false,
        replaced,
    })
}

/// The warning that reflections of a frame that is read in rows do not move, if the file says what they are.
fn not_in_bands(file: &ExrFile, peels: &[PeelChannels], options: &ReadOptions) -> Option<Finding> {
    let names = file.names();
    let says = options.rows.is_some()
        && peels.iter().any(|peel| ShadingChannels::of(&names, &peel.prefix).is_some());
    let text =
        "reflections do not move with the lens in a frame that is rendered in bands: allow more memory";
    says.then(|| Finding::warning("reflections", text))
}

/// All that is decoded of one peel, in order.
fn requested_channels(peel: &PeelChannels) -> impl Iterator<Item = (usize, Use)> + use<> {
    let shading = peel.shading.iter().flat_map(ShadingChannels::indices).map(|index| (index, Use::Depth));
    channels_of_peel(peel).chain(shading.collect::<Vec<_>>())
}

/// The channels of one peel that are not copied to the output, in the order in which they are decoded.
fn channels_of_peel(peel: &PeelChannels) -> impl Iterator<Item = (usize, Use)> + use<> {
    let color = peel.color.into_iter().map(|index| (index, Use::Color));
    color
        .chain(peel.alpha.map(|index| (index, Use::Alpha)))
        .chain(peel.depth.map(|index| (index, Use::Depth)))
        .chain(peel.same_as_depth.clone().into_iter().map(|index| (index, Use::Depth)))
        .chain(peel.position.into_iter().flatten().map(|index| (index, Use::Depth)))
}

/// Checks that the channels of a picture are in one part: several parts may have the same name.
fn check_one_part(file: &ExrFile, peel: &PeelChannels) -> Result<(), Error> {
    let part = file.channels[peel.color[0]].part;
    let mut all = peel.color.iter().chain(&peel.alpha);
    if all.all(|&index| file.channels[index].part == part) {
        return Ok(());
    }
    Err(Error::input("the channels of one picture are in several parts")
        .with("found", names::shown(&file.names()))
        .help("give each part of the file a unique name"))
}

/// The description of a peel, before its pixels are decoded.
struct Described {
    channels: PeelChannels,
    window: Window,
    depth_window: Window,
    depth_channel: String,
    found: String,
    /// The data windows of the shading channels.
    shading_windows: Vec<Window>,
}

impl Described {
    fn from_channels(file: &ExrFile, channels: PeelChannels) -> Self {
        let window_of = |index: usize| file.frame(file.channels[index].part).data;
        let window = window_of(channels.color[0]);
        let all = file.names();
        let same_prefix: Vec<&str> =
            all.iter().copied().filter(|name| name.starts_with(&channels.prefix)).collect();
        let depth = channels.depth.or(channels.position.map(|[x, ..]| x));
        let mut found = names::shown(&same_prefix);
        if let (None, Some(doubtful)) = (depth, names::doubtful(&all)) {
            found.push_str(&format!("; not depth by name: {doubtful}"));
        }
        let depth_channel = match (channels.depth, channels.position) {
            (Some(index), _) => all[index].to_owned(),
            (None, Some([.., z])) => all[z].to_owned(),
            (None, None) => String::new(),
        };
        let shading_windows =
            channels.shading.iter().flat_map(ShadingChannels::indices).map(window_of).collect();
        let depth_window = depth.map_or(window, window_of);
        Self { window, depth_window, depth_channel, found, channels, shading_windows }
    }

    /// The layer, from the decoded channels, and what is assumed of its depth where only its colour has pixels; a position needs the `camera`
    /// of the file, chroma the `luminance` of its red, green and blue.
    ///
    /// # Errors
    /// Depth as a picture whose channels differ.
    fn into_layer(
        self,
        decoded: &mut impl Iterator<Item = Decoded>,
        (camera, luminance): (Option<&WorldToCamera>, Option<[f32; 3]>),
    ) -> Result<(Layer, Option<Finding>), Error> {
        let Self { channels, window, depth_window, depth_channel, found, shading_windows } = self;
        let mut next = || planes(decoded.by_ref()).next().unwrap_or_default();
        let mut color = [next(), next(), next()];
        if let (true, Some(luminance)) = (channels.is_chroma, luminance) {
            chroma::to_rgb(&mut color, luminance);
        }
        let alpha = match channels.alpha {
            Some(_) => next(),
            None => Plane::filled(window.width, window.height, 1.0),
        };
        let mut depth = channels.depth.map(|_| next());
        let same: Vec<Plane> = channels.same_as_depth.iter().map(|_| next()).collect();
        if let Some(depth) = &depth {
            depth_picture::check_equal(depth, &same, &depth_channel)?;
        }
        if let (Some(_), Some(camera)) = (channels.position, camera) {
            depth = Some(camera.depth_of([next(), next(), next()]));
        }
        let depth = depth.map(|depth| place_depth(depth, depth_window, window));
        let beyond = windows::depth_beyond(&depth_channel, depth_window, (window, &alpha));
        let mut windows_of = shading_windows.into_iter();
        let placed = || windows::place(next(), windows_of.next().unwrap_or(window), window, 0.0);
        let shading = channels.shading.map(|shading| shading.read(&color, placed));
        let prefix = channels.prefix;
        Ok((Layer { color, alpha, depth, window, prefix, depth_channel, found, shading }, beyond))
    }
}

fn planes(decoded: impl Iterator<Item = Decoded>) -> impl Iterator<Item = Plane> {
    decoded.filter_map(|decoded| match decoded {
        Decoded::Plane(plane) => Some(plane),
        Decoded::Samples(_) => None,
    })
}
