//! The channels of the output: the picture's four and those carried over from the input.

use crate::finding::Finding;
use crate::image::{Image, Plane};
use crate::stack::{Carried, CarriedChannel, Frame, Precision};
use exr::image::FlatSamples;
use exr::meta::attribute::{ChannelDescription, SampleType, Text};
use half::f16;
use half::slice::HalfFloatSliceExt as _;

/// Names at the root that are the picture's own.
const PICTURE: [&str; 4] = ["R", "G", "B", "A"];

/// The longest name that OpenEXR allows, in bytes.
const LONGEST_NAME: usize = 255;

/// Samples of one channel.
enum Samples<'a> {
    /// A plane to be rounded to half.
    Half(&'a Plane),
    /// A plane as it is.
    Float(&'a Plane),
    /// Samples of the input, in their own type.
    Carried(&'a FlatSamples),
}

/// One channel to write.
pub(super) struct Channel<'a> {
    /// What the header says of it.
    pub(super) description: ChannelDescription,
    samples: Samples<'a>,
}

impl Channel<'_> {
    /// Appends row `y` in the machine's byte order. Half values beyond the largest half are clamped to it, so that no
    /// bright pixel becomes infinite.
    pub(super) fn append_row(&self, y: usize, width: usize, bytes: &mut Vec<u8>) {
        let row = y * width..(y + 1) * width;
        match self.samples {
            Samples::Float(plane) => bytes.extend_from_slice(bytemuck::cast_slice(plane.row(y))),
            Samples::Half(plane) => {
                let limit = f16::MAX.to_f32();
                let clamped: Vec<f32> = plane.row(y).iter().map(|v| v.clamp(-limit, limit)).collect();
                let mut halves = vec![f16::ZERO; width];
                halves.convert_from_f32_slice(&clamped);
                append_halves(&halves, bytes);
            }
            Samples::Carried(FlatSamples::F16(values)) => append_halves(&values[row], bytes),
            Samples::Carried(FlatSamples::F32(values)) => {
                bytes.extend_from_slice(bytemuck::cast_slice(&values[row]));
            }
            Samples::Carried(FlatSamples::U32(values)) => {
                bytes.extend_from_slice(bytemuck::cast_slice(&values[row]));
            }
        }
    }
}

fn append_halves(halves: &[f16], bytes: &mut Vec<u8>) {
    let bits: &[u16] = halves.reinterpret_cast();
    bytes.extend_from_slice(bytemuck::cast_slice(bits));
}

/// All channels in the order of the file, by the bytes of their names; what cannot be carried goes to `findings`.
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
        match obstacle(channel, &name, known, frame) {
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

/// Why a channel cannot stand beside the picture.
fn obstacle(channel: &CarriedChannel, name: &Text, known: bool, frame: &Frame) -> Option<String> {
    let (width, height) = (frame.data.width, frame.data.height);
    if PICTURE.contains(&channel.name.as_str()) {
        Some("the picture takes its name".to_owned())
    } else if known {
        Some("another channel has its name".to_owned())
    } else if name.as_slice().is_empty() || name.as_slice().len() > LONGEST_NAME {
        Some(format!("a channel's name has 1 to {LONGEST_NAME} bytes"))
    } else if channel.samples.len() != width * height {
        Some(format!("it has {} samples, the picture {width}×{height}", channel.samples.len()))
    } else {
        None
    }
}

/// A name in the bytes of the file: one byte a character as the EXR library reads them, UTF-8 where that cannot be.
fn encode_name(name: &str) -> Text {
    Text::new_or_none(name).unwrap_or_else(|| Text::from_slice_unchecked(name.as_bytes()))
}
