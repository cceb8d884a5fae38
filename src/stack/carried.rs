//! Data copied from input to output: channels that no peel uses, and attributes that are still valid.

use super::decode::Decoded;
use super::header::{Channel, ExrFile};
use super::options::Carry;
use super::{Carried, CarriedChannel, Cryptomatte, Window, windows};
use crate::finding::Finding;
use exr::image::FlatSamples;
use exr::meta::attribute::{AttributeValue, Text};
use exr::meta::header::{ImageAttributes, LayerAttributes, standard_names as standard};

/// Attributes that describe the storage of the input file, or that are not valid for the output.
const NOT_CARRIED: [&str; 27] = [
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
    "thinlens.digest",
    "thinlens.effects",
    "thinlens.kind",
    "thinlens.method",
    "thinlens.settings",
    "thinlens.source",
    "thinlens.supersample",
    "thinlens.version",
    "thinlens.views",
    "tiles",
    "type",
    "version",
];

impl Carried {
    /// Adds the attributes to the headers of an output file: standard ones to their own fields, as the encoder requires,
    /// all others to `other`.
    pub fn apply_attributes(&self, shared: &mut ImageAttributes, own: &mut LayerAttributes) {
        for (name, value) in &self.attributes {
            if !(set_shared(shared, name, value) || set_text(own, name, value) || set_other(own, name, value))
            {
                own.other.insert(name.clone(), value.clone());
            }
        }
    }
}

/// Sets an attribute that all parts of a file share.
fn set_shared(shared: &mut ImageAttributes, name: &Text, value: &AttributeValue) -> bool {
    match (name.as_slice(), value) {
        (standard::TIME_CODE, AttributeValue::TimeCode(value)) => shared.time_code = Some(*value),
        (standard::CHROMATICITIES, AttributeValue::Chromaticities(value)) => {
            shared.chromaticities = Some(*value);
        }
        (_, AttributeValue::TimeCode(_) | AttributeValue::Chromaticities(_)) => {
            shared.other.insert(name.clone(), value.clone());
        }
        _ => return false,
    }
    true
}

fn set_text(own: &mut LayerAttributes, name: &Text, value: &AttributeValue) -> bool {
    let AttributeValue::Text(text) = value else { return false };
    let field = match name.as_slice() {
        standard::RENDERING_TRANSFORM => &mut own.rendering_transform_name,
        standard::LOOK_MOD_TRANSFORM => &mut own.look_modification_transform_name,
        standard::OWNER => &mut own.owner,
        standard::COMMENTS => &mut own.comments,
        standard::CAPTURE_DATE => &mut own.capture_date,
        standard::WRAP_MODES => &mut own.wrap_mode_name,
        standard::VIEW => &mut own.view_name,
        standard::SOFTWARE => &mut own.software_name,
        _ => return false,
    };
    *field = Some(text.clone());
    true
}

fn set_other(own: &mut LayerAttributes, name: &Text, value: &AttributeValue) -> bool {
    if let AttributeValue::F32(number) = value
        && let Some(field) = number_field(own, name)
    {
        *field = Some(*number);
        return true;
    }
    match (name.as_slice(), value) {
        (standard::ADOPTED_NEUTRAL, AttributeValue::FloatVec2(value)) => own.adopted_neutral = Some(*value),
        (standard::ENVIRONMENT_MAP, AttributeValue::EnvironmentMap(value)) => {
            own.environment_map = Some(*value);
        }
        (standard::KEY_CODE, AttributeValue::KeyCode(value)) => own.film_key_code = Some(*value),
        (standard::FRAMES_PER_SECOND, AttributeValue::Rational(value)) => {
            own.frames_per_second = Some(*value);
        }
        (standard::WORLD_TO_CAMERA, AttributeValue::Matrix4x4(value)) => own.world_to_camera = Some(*value),
        (standard::WORLD_TO_NDC, AttributeValue::Matrix4x4(value)) => {
            own.world_to_normalized_device = Some(*value);
        }
        (standard::ORIGINAL_DATA_WINDOW, AttributeValue::IntegerBounds(value)) => {
            own.original_data_window = Some(*value);
        }
        // A header cannot hold a standard name with a value of another type.
        (name, _) => return standard::ALL.contains(&name),
    }
    true
}

fn number_field<'a>(own: &'a mut LayerAttributes, name: &Text) -> Option<&'a mut Option<f32>> {
    Some(match name.as_slice() {
        standard::WHITE_LUMINANCE => &mut own.white_luminance,
        standard::X_DENSITY => &mut own.horizontal_density,
        standard::UTC_OFFSET => &mut own.utc_offset,
        standard::LONGITUDE => &mut own.longitude,
        standard::LATITUDE => &mut own.latitude,
        standard::ALTITUDE => &mut own.altitude,
        standard::FOCUS => &mut own.focus,
        standard::EXPOSURE_TIME => &mut own.exposure,
        standard::APERTURE => &mut own.aperture,
        standard::ISO_SPEED => &mut own.iso_speed,
        standard::NEAR => &mut own.near_clip_plane,
        standard::FAR => &mut own.far_clip_plane,
        standard::FOV_X => &mut own.horizontal_field_of_view,
        standard::FOV_Y => &mut own.vertical_field_of_view,
        _ => return None,
    })
}

/// Indices of the channels of `file` to copy, and a finding about those that cannot be copied. The channels of `mattes` are included
/// with every value of `carry`.
///
/// Only channels within the picture's data window `data` can be copied.
pub(super) fn choose(
    file: &ExrFile,
    used: &[usize],
    (carry, mattes): (Carry, &[Cryptomatte]),
    data: Window,
) -> (Vec<usize>, Vec<Finding>) {
    let requested = |index: &usize| match carry {
        Carry::Unused => !used.contains(index),
        Carry::All => true,
        Carry::None => false,
    };
    let is_matte = |index: &usize| mattes.iter().any(|matte| matte.has(&file.channels[*index].name));
    let all = (0..file.channels.len()).filter(|index| requested(index) || is_matte(index));
    let (fitting, others): (Vec<_>, Vec<_>) =
        all.partition(|&index| windows::is_within(file.frame(file.channels[index].part).data, data));
    let text = || {
        let count = others.len();
        format!("{count} channels have pixels outside of the picture's data window: not copied to the output")
    };
    let findings = if others.is_empty() { Vec::new() } else { vec![Finding::warning("channels", text())] };
    (fitting, findings)
}

/// The decoded channels, each with its window, in the data window `data`.
pub(super) fn channels(
    described: Vec<(Channel, Window)>,
    decoded: impl Iterator<Item = Decoded>,
    data: Window,
) -> Vec<CarriedChannel> {
    let samples = decoded.filter_map(|decoded| match decoded {
        Decoded::Samples(samples) => Some(samples),
        Decoded::Plane(_) => None,
    });
    let carried = |((channel, window), samples): ((Channel, Window), FlatSamples)| CarriedChannel {
        name: channel.name,
        samples: windows::place_samples(samples, window, data),
        quantize_linearly: channel.quantize_linearly,
    };
    described.into_iter().zip(samples).map(carried).collect()
}

/// The attributes that are valid for the output.
pub(super) fn attributes(all: &[(Text, AttributeValue)]) -> Vec<(Text, AttributeValue)> {
    let keep = |name: &Text| !NOT_CARRIED.iter().any(|left| name.eq(left));
    all.iter().filter(|(name, _)| keep(name)).cloned().collect()
}

/// Removes the channels of a supersampled stack, whose samples are not the output's pixels.
pub(super) fn drop_supersampled(carried: &mut Carried) -> (Vec<CarriedChannel>, Option<Finding>) {
    let dropped = std::mem::take(&mut carried.channels);
    let count = dropped.len();
    let text =
        format!("{count} other channels are supersampled, the output is not: not copied to the output");
    let finding = (count > 0).then(|| Finding::warning("channels", text));
    (dropped, finding)
}
