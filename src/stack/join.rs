//! Peels with data windows of their own, joined into the one that holds them all.

use super::layers::{Layer, Layers};
use super::options::ReadOptions;
use super::shading::Shading;
use super::windows::{self, place};
use super::{Frame, Peel, Window, guard, names};
use crate::error::Error;
use crate::finding::Finding;
use crate::image::Plane;
use exr::image::FlatSamples;

/// Number of windows that an error lists.
const LISTED: usize = 12;

/// `layers` with the frame that holds all of them, and with the channels in its data window. The header says the number of `samples` a pixel
/// along each axis, where `options` do not.
///
/// # Errors
/// [`crate::error::ErrorKind::Limits`] for peels so far apart that the window around them does not fit into memory.
pub(super) fn join(
    layers: Layers,
    (options, samples): (&ReadOptions, Option<usize>),
) -> Result<Layers, Error> {
    let samples = options.supersample.or(samples).unwrap_or(1);
    let Layers { peels, mut channels, mut findings, frame: of_channels, .. } = layers;
    let frame =
        whole_frame(&peels, of_channels, (options, samples)).map_err(|error| error.in_file(&layers.name))?;
    findings.extend(union_finding(&peels, frame));
    for channel in &mut channels {
        let samples = std::mem::replace(&mut channel.samples, FlatSamples::F32(Vec::new()));
        channel.samples = windows::place_samples(samples, of_channels.data, frame.data);
    }
    Ok(Layers { peels: with_depth_of_empty(peels), channels, findings, frame, ..layers })
}

/// The frame of a stack of `layers` with this many `samples` a pixel along each axis, in which the channels of its first file have the frame
/// `first`: its data window holds all of them.
fn whole_frame(
    layers: &[Layer],
    first: Frame,
    (options, samples): (&ReadOptions, usize),
) -> Result<Frame, Error> {
    let parts: Vec<Window> = layers.iter().map(|layer| layer.window).chain([first.data]).collect();
    if parts.iter().all(|window| *window == first.data) {
        return Ok(first);
    }
    let mut data = windows::rows_of(windows::union(&parts, first.display), options.rows.as_ref());
    // Of a frame that is read in rows, only headers say what all of them are to be placed in.
    if options.rows.is_none() {
        let with_content = layers.iter().filter(|layer| layer.has_content());
        data = with_content.fold(data, |data, layer| windows::joined(data, layer.window));
        // Crops do not end where pixels of several samples do.
        data = windows::in_whole_pixels(data, first.display, samples);
    }
    let bytes = windows::bytes(data, layers.len());
    let limit = options.max_bytes.unwrap_or_else(guard::default_max_bytes);
    if bytes <= limit {
        return Ok(Frame { data, ..first });
    }
    let shown: Vec<String> = parts.iter().take(LISTED).map(Window::to_string).collect();
    Err(Error::limits(
        "the peels lie too far apart: the window around all of them requires more memory than the limit",
    )
    .with("found", shown.join(", "))
    .with("limit", format!("{} MiB, of {} MiB for {data}", limit >> 20, bytes >> 20))
    .help("render all peels with one data window, or leave out those that are not in the picture"))
}

/// Says that peels have data windows of their own.
fn union_finding(layers: &[Layer], frame: Frame) -> Option<Finding> {
    let smaller = layers.iter().filter(|layer| layer.window != frame.data).count();
    let text = format!(
        "{smaller} of {} peels cover a part of the data window {}; they are empty outside of it",
        layers.len(),
        frame.data
    );
    (smaller > 0).then(|| Finding::note("frame", text))
}

/// `layers`, of which those that are empty need no depth if another one has it.
fn with_depth_of_empty(mut layers: Vec<Layer>) -> Vec<Layer> {
    if layers.iter().any(|layer| layer.depth.is_some()) {
        for layer in layers.iter_mut().filter(|layer| layer.depth.is_none() && !layer.has_content()) {
            layer.depth = Some(Plane::filled(layer.window.width, layer.window.height, f32::INFINITY));
        }
    }
    layers
}

/// `layer` as peel number `i`, and what its surfaces reflect, in the data window of the stack.
pub(super) fn placed(i: usize, layer: Layer, data: Window) -> Result<(Peel, Option<Shading>), Error> {
    let Layer { color, alpha, depth, window, found, shading, .. } = layer;
    let Some(depth) = depth else {
        return Err(Error::input(format!("peel {i} has no depth channel"))
            .with("found", found)
            .with("looked for", names::LOOKED_FOR)
            .help("enable the Z pass, name it with `depth_channel`, or give it as `depth_file`"));
    };
    let placed = |plane: Plane, outside: f32| place(plane, window, data, outside);
    let peel = Peel {
        color: color.map(|plane| placed(plane, 0.0)),
        alpha: placed(alpha, 0.0),
        depth: placed(depth, f32::INFINITY),
    };
    Ok((peel, shading.map(|shading| shading.placed(window, data))))
}
