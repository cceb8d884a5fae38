//! The header of the output file.
//!
//! It is not written by the EXR library, because the library stores custom attributes in hash maps: their order
//! would differ between runs, and equal pictures would give different files.

use super::channels::Channel;
use crate::finding::Finding;
use crate::output::atomic::Target;
use crate::stack::{Carried, Frame, Window};
use exr::compression::Compression;
use exr::meta::BlockDescription;
use exr::meta::attribute::{self, AttributeValue, ChannelList, IntegerBounds, LineOrder, Text};
use exr::meta::header::{Header, LayerAttributes, standard_names};
use std::collections::BTreeMap;

/// Attributes that describe the storage of the input, not its content.
const STRUCTURAL: [&[u8]; 13] = [
    standard_names::CHANNELS,
    standard_names::COMPRESSION,
    standard_names::DATA_WINDOW,
    standard_names::DISPLAY_WINDOW,
    standard_names::LINE_ORDER,
    standard_names::PIXEL_ASPECT,
    standard_names::TILES,
    standard_names::BLOCK_TYPE,
    standard_names::NAME,
    standard_names::DEEP_DATA_VERSION,
    standard_names::CHUNKS,
    standard_names::MAX_SAMPLES,
    standard_names::DWA_COMPRESSION_LEVEL,
];

/// Names of this many bytes or more require [`LONG_NAMES`].
const LONG_NAME: usize = 32;

/// Flag in the version field: names of up to 255 bytes.
const LONG_NAMES: u32 = 1 << 10;

/// Attributes by name.
pub(super) type Attributes = BTreeMap<Vec<u8>, AttributeValue>;

/// The header that the EXR library requires to compress blocks.
pub(super) fn describe(frame: &Frame, channels: &[Channel<'_>], compression: Compression) -> Header {
    let size = (frame.data.width, frame.data.height);
    let list = channels.iter().map(|channel| channel.description.clone()).collect();
    let mut header = Header::new(Text::default(), size, list).with_encoding(
        compression,
        BlockDescription::ScanLines,
        LineOrder::Increasing,
    );
    header.own_attributes = LayerAttributes::default();
    header.own_attributes.layer_position = (frame.data.x, frame.data.y).into();
    header.shared_attributes.display_window = bounds(&frame.display);
    header.shared_attributes.pixel_aspect = frame.pixel_aspect;
    header
}

/// The carried attributes, overridden by those of this file. Attributes that cannot be written are reported in `findings`.
pub(super) fn attributes(header: &Header, carried: &Carried, findings: &mut Vec<Finding>) -> Attributes {
    let mut all = Attributes::new();
    for (name, value) in &carried.attributes {
        if STRUCTURAL.contains(&name.as_slice()) {
            continue;
        }
        let mut long_names = false;
        match attribute::validate(name, value, &mut long_names, false, header.data_window(), true) {
            Ok(()) => {
                all.insert(name.as_slice().to_vec(), value.clone());
            }
            Err(error) => findings.push(Finding::warning(
                "attributes",
                format!("attribute {:?} of the input is left out: {error}", name.to_string()),
            )),
        }
    }
    for (name, value) in header.all_named_attributes() {
        let carries_over = [standard_names::WINDOW_CENTER, standard_names::WINDOW_WIDTH].contains(&name)
            && all.get(name).is_some_and(|old| old.kind_name() == value.kind_name());
        if !carries_over {
            all.insert(name.to_vec(), value);
        }
    }
    let version = AttributeValue::Text(Text::from_slice_unchecked(env!("CARGO_PKG_VERSION").as_bytes()));
    all.insert(b"thinlens.version".to_vec(), version);
    all
}

/// Writes everything before the table of block offsets.
pub(super) fn write(mut target: &mut dyn Target, attributes: &Attributes) -> exr::error::UnitResult {
    let long = |name: &[u8]| name.len() >= LONG_NAME;
    let long_names = attributes.iter().any(|(name, value)| match value {
        AttributeValue::ChannelList(ChannelList { list, .. }) => {
            list.iter().any(|channel| long(channel.name.as_slice()))
        }
        _ => long(name) || long(value.kind_name()),
    });
    let version: u32 = 2 | if long_names { LONG_NAMES } else { 0 };
    target.write_all(&exr::meta::magic_number::BYTES)?;
    target.write_all(&version.to_le_bytes())?;
    for (name, value) in attributes {
        attribute::write(name, value, &mut target)?;
    }
    target.write_all(&[0])?;
    Ok(())
}

fn bounds(window: &Window) -> IntegerBounds {
    IntegerBounds::new((window.x, window.y), (window.width, window.height))
}
