//! The channels of the output: `R G B A` and the channels copied from the input.

use crate::finding::Finding;
use crate::image::{Image, Plane};
use crate::stack::{Carried, CarriedChannel, Frame, Precision};
use exr::image::FlatSamples;
use exr::meta::attribute::{ChannelDescription, SampleType, Text};
use half::f16;
use half::slice::HalfFloatSliceExt as _;

/// Names of the picture's channels at the root.
const PICTURE: [&str; 4] = ["R", "G", "B", "A"];

/// Maximum length of a name in OpenEXR, in bytes.
const MAX_NAME_BYTES: usize = 255;

/// Values that are clamped before they are rounded: few enough to stay in the nearest cache.
const GROUP: usize = 256;

/// Samples of one channel.
enum Samples<'a> {
    /// A plane to be rounded to half.
    Half(&'a Plane),
    /// A plane of floats.
    Float(&'a Plane),
    /// Samples of the input, in their own type.
    Carried(&'a FlatSamples),
}

/// One channel to write.
pub(super) struct Channel<'a> {
    /// Its description in the header.
    pub(super) description: ChannelDescription,
    samples: Samples<'a>,
}

impl Channel<'_> {
    /// Row `y`, in native byte order. Values beyond the largest half float are clamped to it, so that bright pixels do not become infinite.
    /// `halves` is scratch memory.
    pub(super) fn row<'s>(&'s self, y: usize, width: usize, halves: &'s mut Vec<f16>) -> &'s [u8] {
        let row = y * width..(y + 1) * width;
        match self.samples {
            Samples::Float(plane) => bytemuck::cast_slice(plane.row(y)),
            Samples::Half(plane) => {
                halves.resize(width, f16::ZERO);
                clamp_to_halves(plane.row(y), halves);
                bytes_of_halves(halves)
            }
            Samples::Carried(FlatSamples::F16(values)) => bytes_of_halves(&values[row]),
            Samples::Carried(FlatSamples::F32(values)) => bytemuck::cast_slice(&values[row]),
            Samples::Carried(FlatSamples::U32(values)) => bytemuck::cast_slice(&values[row]),
        }
    }
}

/// Rounds `values` to `halves`, which are as many.
fn clamp_to_halves(values: &[f32], halves: &mut [f16]) {
    let limit = f16::MAX.to_f32();
    let mut clamped = [0.0; GROUP];
    for (values, halves) in values.chunks(GROUP).zip(halves.chunks_mut(GROUP)) {
        let clamped = &mut clamped[..values.len()];
        clamped.iter_mut().zip(values).for_each(|(clamped, value)| *clamped = value.clamp(-limit, limit));
        halves.convert_from_f32_slice(clamped);
    }
}

fn bytes_of_halves(halves: &[f16]) -> &[u8] {
    let bits: &[u16] = halves.reinterpret_cast();
    bytemuck::cast_slice(bits)
}

/// All channels in the order of the file, sorted by the bytes of their names. Channels that cannot be copied are reported in `findings`.
pub(super) fn collect<'a>(
    image: &'a Image,
    frame: &Frame,
    carried: &'a Carried,
    precision: Precision,
    findings: &mut Vec<Finding>,
) -> Vec<Channel<'a>> {
    let mut channels: Vec<Channel<'a>> = PICTURE
        .iter()
        .zip(&image.planes)
        .map(|(name, plane)| {
            let (kind, samples) = match precision {
                Precision::Half => (SampleType::F16, Samples::Half(plane)),
                Precision::Float => (SampleType::F32, Samples::Float(plane)),
            };
            Channel { description: ChannelDescription::named(*name, kind), samples }
        })
        .collect();
    for channel in &carried.channels {
        let name = encode_name(&channel.name);
        let known = channels.iter().any(|other| other.description.name == name);
        match conflict(channel, &name, known, frame) {
            Some(reason) => findings.push(Finding::warning(
                "channels",
                format!("channel {:?} of the input is left out: {reason}", channel.name),
            )),
            None => channels.push(carry(channel, name)),
        }
    }
    channels.sort_by(|a, b| a.description.name.as_slice().cmp(b.description.name.as_slice()));
    channels
}

fn carry(channel: &CarriedChannel, name: Text) -> Channel<'_> {
    let kind = match &channel.samples {
        FlatSamples::F16(_) => SampleType::F16,
        FlatSamples::F32(_) => SampleType::F32,
        FlatSamples::U32(_) => SampleType::U32,
    };
    Channel {
        description: ChannelDescription::new(name, kind, channel.quantize_linearly),
        samples: Samples::Carried(&channel.samples),
    }
}

/// The reason why a channel cannot be written beside the picture.
fn conflict(channel: &CarriedChannel, name: &Text, known: bool, frame: &Frame) -> Option<String> {
    let (width, height) = (frame.data.width, frame.data.height);
    if PICTURE.contains(&channel.name.as_str()) {
        Some("the picture has a channel of this name".to_owned())
    } else if known {
        Some("another channel has the same name".to_owned())
    } else if name.as_slice().is_empty() || name.as_slice().len() > MAX_NAME_BYTES {
        Some(format!("a channel's name has 1 to {MAX_NAME_BYTES} bytes"))
    } else if channel.samples.len() != width * height {
        Some(format!("it has {} samples, the picture {width}×{height}", channel.samples.len()))
    } else {
        None
    }
}

/// The bytes of a name in the file: one byte per character, as the EXR library decodes them, or UTF-8 if that is not possible.
fn encode_name(name: &str) -> Text {
    Text::new_or_none(name).unwrap_or_else(|| Text::from_slice_unchecked(name.as_bytes()))
}
