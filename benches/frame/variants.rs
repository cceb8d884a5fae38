//! Other stacks from a stack: its first peel alone, and the frame repeated 2 × 2; and whether two pictures are equal.

use exr::image::{FlatImage, FlatSamples};
use exr::prelude::{ReadChannels as _, ReadLayers as _, Vec2, WritableImage as _, read};
use std::path::Path;

/// Reads all flat channels of all parts.
pub(crate) fn read_all(path: &Path) -> FlatImage {
    let layers = read().no_deep_data().largest_resolution_level().all_channels().all_layers();
    layers.all_attributes().from_file(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Writes `image`.
pub(crate) fn write_all(image: &FlatImage, path: &Path) {
    image.write().to_file(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
}

/// The channels of `image` whose first dotted name is that of its first channel: `Peel0.Combined.R`, `Peel0.Depth.Z`, …
pub(crate) fn first_peel(image: &FlatImage) -> FlatImage {
    let full_name = |layer: Option<String>, channel: String| match layer {
        Some(layer) => format!("{layer}.{channel}"),
        None => channel,
    };
    let group = |name: &str| name.split('.').next().unwrap_or_default().to_owned();
    let mut first = None;
    let mut image = image.clone();
    for layer in &mut image.layer_data {
        let name = layer.attributes.layer_name.as_ref().map(ToString::to_string);
        layer.channel_data.list.retain(|channel| {
            let group = group(&full_name(name.clone(), channel.name.to_string()));
            *first.get_or_insert_with(|| group.clone()) == group
        });
    }
    image.layer_data.retain(|layer| !layer.channel_data.list.is_empty());
    image
}

/// `image` twice as wide and high: the frame four times. An overscan doubles too.
pub(crate) fn tiled(mut image: FlatImage) -> FlatImage {
    let display = &mut image.attributes.display_window;
    display.size = display.size * Vec2(2, 2);
    display.position = display.position * Vec2(2, 2);
    for layer in &mut image.layer_data {
        let width = layer.size.width();
        for channel in &mut layer.channel_data.list {
            channel.sample_data = match &channel.sample_data {
                FlatSamples::F16(values) => FlatSamples::F16(repeated(values, width)),
                FlatSamples::F32(values) => FlatSamples::F32(repeated(values, width)),
                FlatSamples::U32(values) => FlatSamples::U32(repeated(values, width)),
            };
        }
        layer.size = layer.size * Vec2(2, 2);
        layer.attributes.layer_position = layer.attributes.layer_position * Vec2(2, 2);
    }
    image
}

/// Rows of `width` values, each twice side by side, and all of them again below.
fn repeated<T: Copy>(values: &[T], width: usize) -> Vec<T> {
    values.chunks(width).flat_map(|row| [row, row]).flatten().copied().collect::<Vec<T>>().repeat(2)
}

/// Whether the pictures in two files have the same channels with the same bits.
pub(crate) fn are_equal(a: &Path, b: &Path) -> bool {
    let channels = |path| {
        let layers = read_all(path).layer_data.into_iter();
        let channels = layers.flat_map(|layer| layer.channel_data.list);
        channels.map(|channel| (channel.name, bits(&channel.sample_data))).collect::<Vec<_>>()
    };
    channels(a) == channels(b)
}

fn bits(samples: &FlatSamples) -> Vec<u32> {
    match samples {
        FlatSamples::F16(values) => values.iter().map(|value| u32::from(value.to_bits())).collect(),
        FlatSamples::F32(values) => values.iter().map(|value| value.to_bits()).collect(),
        FlatSamples::U32(values) => values.clone(),
    }
}
