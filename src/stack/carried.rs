//! What is handed on from input to output: the channels no peel uses, and the attributes that still hold.

use super::decode::Decoded;
use super::header::ExrFile;
use super::read::Carry;
use super::{Carried, CarriedChannel, Finding, Window};
use exr::meta::attribute::{AttributeValue, Text};

/// Attributes that describe how the pixels lay in the input file, or what is no longer true of the output.
const NOT_CARRIED: [&str; 19] = [
    "channels",
    "chunkCount",
    "compression",
    "dataWindow",
    "deepImageState",
    "displayWindow",
    "dwaCompressionLevel",
    "lineOrder",
    "maxSamplesPerPixel",
    "multiView",
    "name",
    "pixelAspectRatio",
    "preview",
    "screenWindowCenter",
    "screenWindowWidth",
    "thinlens.supersample",
    "tiles",
    "type",
    "version",
];

/// Which channels of `file` travel, as places in its list, and what is said of those left behind.
///
/// Only channels as large as the picture can: `data` is the picture's data window.
pub(super) fn choose(
    file: &ExrFile,
    used: &[usize],
    carry: Carry,
    data: Window,
) -> (Vec<usize>, Vec<Finding>) {
    let wanted = |place: &usize| match carry {
        Carry::Unused => !used.contains(place),
        Carry::All => true,
        Carry::None => false,
    };
    let all = (0..file.channels.len()).filter(wanted);
    let (fitting, others): (Vec<_>, Vec<_>) =
        all.partition(|&place| file.frame(file.channels[place].part).data == data);
    let text =
        || format!("{} channels have another data window than the picture: not handed on", others.len());
    let findings = if others.is_empty() { Vec::new() } else { vec![Finding::warning("channels", text())] };
    (fitting, findings)
}

/// The decoded channels with their names.
pub(super) fn channels(
    named: Vec<(String, bool)>,
    decoded: impl Iterator<Item = Decoded>,
) -> Vec<CarriedChannel> {
    let samples = decoded.filter_map(|decoded| match decoded {
        Decoded::Samples(samples) => Some(samples),
        Decoded::Plane(_) => None,
    });
    let together = named.into_iter().zip(samples);
    together
        .map(|((name, quantize_linearly), samples)| CarriedChannel { name, samples, quantize_linearly })
        .collect()
}

/// The attributes that still hold for the output, each name once.
pub(super) fn attributes(all: &[(Text, AttributeValue)]) -> Vec<(Text, AttributeValue)> {
    let keep = |name: &Text| !NOT_CARRIED.iter().any(|left| name.eq(left));
    all.iter().filter(|(name, _)| keep(name)).cloned().collect()
}

/// Drops channels of a stack whose samples are not the output's pixels.
pub(super) fn drop_supersampled(carried: &mut Carried) -> Option<Finding> {
    let count = carried.channels.len();
    carried.channels.clear();
    let text = format!("{count} other channels are supersampled, the picture will not be: not handed on");
    (count > 0).then(|| Finding::warning("channels", text))
}
