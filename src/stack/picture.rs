//! Pictures that are not OpenEXR: PNG, TIFF, Radiance HDR, JPEG.
//!
//! Integer samples are sRGB with straight alpha: they are decoded to linear light, then premultiplied.
//! Float samples are assumed linear and premultiplied. A TIFF that says how it combines colour and alpha is believed. Integer depth is scaled to 0 … 1, without decoding.

use super::input::Opened;
use super::layers::{Layer, Layers};
use super::options::ReadOptions;
use super::sanitise::{self, Replaced};
use super::{AlphaMode, ColorRange, Frame, Precision, Window, depth_picture, guard, tiff_alpha};
use crate::error::Error;
use crate::finding::Finding;
use crate::image::Plane;
use crate::memory::shown_bytes;
use image::{DynamicImage, ImageDecoder, ImageReader, Limits};
use std::path::Path;

/// A picture without depth.
///
/// # Errors
/// An unknown format, a damaged file, a picture above the memory limit.
pub(super) fn read_color(mut opened: Opened, options: &ReadOptions) -> Result<Layers, Error> {
    let name = opened.name.clone();
    let stated = tiff_alpha::alpha_mode(&mut opened.input).map_err(|cause| unreadable(&name, cause))?;
    let picture = load(opened, options)?;
    let window = Window { x: 0, y: 0, width: picture.width() as usize, height: picture.height() as usize };
    let (precision, coded) = match picture.color().bytes_per_pixel() / picture.color().channel_count() {
        1 => (Precision::Half, Some("8-bit")),
        2 => (Precision::Float, Some("16-bit")),
        _ => (Precision::Float, None),
    };
    let has_alpha = picture.color().has_alpha();
    let of_format = if coded.is_some() { AlphaMode::Straight } else { AlphaMode::Premultiplied };
    let mode = options.alpha.or(stated).unwrap_or(of_format);
    let (mut color, mut alpha) = linear_planes(picture);
    let mut replaced = Replaced::default();
    color.iter_mut().for_each(|plane| sanitise::color(plane.values_mut(), &mut replaced));
    sanitise::alpha(alpha.values_mut(), &mut replaced);
    let mut findings = Vec::new();
    if let Some(depth) = coded {
        let text = format!("{depth} colour is assumed sRGB, decoded to linear light");
        findings.push(Finding::note("colour", text));
    }
    if has_alpha {
        let why = match (options.alpha, stated) {
            (Some(_), _) => "as requested",
            (None, Some(_)) => "as the file says",
            (None, None) => "as its format has it",
        };
        findings.push(Finding::note("alpha", format!("{}, {why}", mode.name())));
    }
    let color_range = if coded.is_some() { ColorRange::UpToWhite } else { ColorRange::Unbounded };
    let frame = Frame { data: window, display: window, pixel_aspect: 1.0 };
    let found = "a picture without depth".to_owned();
    let (prefix, depth_channel) = (String::new(), String::new());
    let layer = Layer { color, alpha, depth: None, window, prefix, depth_channel, found, shading: None };
    let layer = layer.premultiplied(has_alpha.then_some(mode));
    let (attributes, channels, cryptomattes) = (Vec::new(), Vec::new(), Vec::new());
    let peels = vec![layer];
    Ok(Layers {
        name,
        peels,
        is_merged: false,
        beauty: None,
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

/// The requested, red or only channel of a picture as depth.
///
/// # Errors
/// As [`read_color`]; a picture in colours of which no channel is requested.
pub(super) fn read_depth(opened: Opened, options: &ReadOptions) -> Result<(Plane, Vec<Finding>), Error> {
    let name = opened.name.clone();
    let picture = load(opened, options)?;
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let mut plane = Plane::zeros(width, height);
    let requested = options.depth_channel.as_deref();
    let chosen =
        requested.and_then(|name| ["R", "G", "B"].iter().position(|other| name.eq_ignore_ascii_case(other)));
    if picture.color().has_color() && chosen.is_none() {
        check_grey(&picture).map_err(|error| error.in_file(&name))?;
    }
    let at = chosen.unwrap_or(0);
    let mut findings = Vec::new();
    let values = plane.values_mut();
    match picture.color().bytes_per_pixel() / picture.color().channel_count() {
        1 => {
            findings.push(Finding::warning("depth", EIGHT_BITS));
            fill(values, picture.into_rgb8().pixels().map(|pixel| f32::from(pixel[at]) / 255.0));
        }
        2 => fill(values, picture.into_rgb16().pixels().map(|pixel| f32::from(pixel[at]) / 65535.0)),
        _ => fill(values, picture.into_rgb32f().pixels().map(|pixel| pixel[at])),
    }
    Ok((plane, findings))
}

/// What is said of depth of 8 bits.
pub(super) const EIGHT_BITS: &str =
    "depth has 8 bits: its 256 steps are visible in the blur; save it with 16 bits or as OpenEXR";

/// Checks that the three channels of a picture are equal, as in depth that was saved as colour.
///
/// # Errors
/// Those of [`depth_picture::check_equal`].
fn check_grey(picture: &DynamicImage) -> Result<(), Error> {
    let rgb = picture.to_rgb32f();
    let [red, green, blue] = std::array::from_fn(|channel| {
        let mut plane = Plane::zeros(rgb.width() as usize, rgb.height() as usize);
        fill(plane.values_mut(), rgb.pixels().map(|pixel| pixel[channel]));
        plane
    });
    depth_picture::check_equal(&red, &[green, blue], "R")
}

fn fill(values: &mut [f32], from: impl Iterator<Item = f32>) {
    values.iter_mut().zip(from).for_each(|(value, from)| *value = from);
}

/// Bytes of a pixel in the planes of red, green, blue and alpha.
const PLANES_BYTES: u64 = 16;

const UNREADABLE: &str = "the picture cannot be read";
const DAMAGED: &str = "the file is damaged or truncated: copy or save it again";

/// The error of a file that ends early, or of a disk that failed.
fn unreadable(name: &Path, cause: std::io::Error) -> Error {
    Error::reading(UNREADABLE, cause).in_file(name).help(DAMAGED)
}

/// The error of a picture that can only be read as a whole.
fn not_in_rows() -> Error {
    Error::unsupported("only OpenEXR can be read a few rows at a time")
        .help("save the picture as a ZIP scanline OpenEXR, or allow more memory with `memory`")
}

/// Width and height of a picture, from its header.
///
/// # Errors
/// As [`read_color`].
pub(super) fn size(mut opened: Opened) -> Result<(usize, usize), Error> {
    let name = opened.name.clone();
    let fail =
        |error: image::ImageError| Error::input("the picture cannot be read").in_file(&name).caused_by(error);
    let head = opened.first_bytes()?;
    let format = image::guess_format(&head).map_err(|_| unknown_format(&name, &head))?;
    let (width, height) = ImageReader::with_format(opened.input, format).into_dimensions().map_err(fail)?;
    Ok((width as usize, height as usize))
}

/// The error of a file that starts with `head`, which is none of the formats.
fn unknown_format(name: &Path, head: &[u8]) -> Error {
    let claims_exr = name.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr"));
    let what = if claims_exr {
        "this is not an OpenEXR file"
    } else {
        "this is not a picture in a supported format"
    };
    Error::input(what)
        .in_file(name)
        .with("found", format!("a file that starts with {:?}", String::from_utf8_lossy(head)))
        .with("expected", "OpenEXR, PNG, TIFF, Radiance HDR, JPEG")
}

fn load(mut opened: Opened, options: &ReadOptions) -> Result<DynamicImage, Error> {
    if options.rows.is_some() {
        return Err(not_in_rows().in_file(&opened.name));
    }
    let head = opened.first_bytes()?;
    let name = opened.name;
    let fail = |error: image::ImageError| {
        let error = match error {
            image::ImageError::IoError(cause) => return unreadable(&name, cause),
            other => other,
        };
        let (what, help) = match &error {
            image::ImageError::Limits(_) => {
                return Error::limits("the picture requires more memory than the limit")
                    .in_file(&name)
                    .caused_by(error)
                    .help("crop or scale the picture");
            }
            image::ImageError::Unsupported(_) => {
                ("this kind of picture is not supported", "save it as OpenEXR")
            }
            _ => (UNREADABLE, DAMAGED),
        };
        let kind = if matches!(error, image::ImageError::Unsupported(_)) {
            Error::unsupported
        } else {
            Error::input
        };
        kind(what).in_file(&name).caused_by(error).help(help)
    };
    if image::guess_format(&head).is_err() {
        return Err(unknown_format(&name, &head));
    }
    let limit = options.max_bytes.unwrap_or_else(guard::default_max_bytes);
    let mut limits = Limits::default();
    limits.max_alloc = Some(limit);
    let mut reader =
        ImageReader::new(opened.input).with_guessed_format().map_err(|cause| unreadable(&name, cause))?;
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(fail)?;
    check_budget(&decoder, limit).map_err(|error| error.in_file(&name))?;
    DynamicImage::from_decoder(decoder).map_err(fail)
}

/// Checks that the decoded picture, its samples as red, green, blue and alpha, and the planes made of them are within `limit` bytes
/// together.
///
/// # Errors
/// [`Error::limits`] if they are not.
fn check_budget(decoder: &impl ImageDecoder, limit: u64) -> Result<(), Error> {
    let ((width, height), color) = (decoder.dimensions(), decoder.color_type());
    let [all, channels] = [color.bytes_per_pixel(), color.channel_count()].map(u64::from);
    let converted = if channels == 4 { 0 } else { 4 * all / channels.max(1) };
    let bytes = (u64::from(width) * u64::from(height)).saturating_mul(all + converted + PLANES_BYTES);
    if bytes <= limit {
        return Ok(());
    }
    Err(Error::limits("the picture requires more memory than the limit")
        .with("found", format!("{width}×{height} pixels: {}", shown_bytes(bytes)))
        .with("limit", shown_bytes(limit))
        .help("crop or scale the picture, or allow more with `memory`"))
}

/// Linear colour, and alpha.
fn linear_planes(picture: DynamicImage) -> ([Plane; 3], Plane) {
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let mut planes: [Plane; 4] = std::array::from_fn(|_| Plane::zeros(width, height));
    let mut put = |i: usize, pixel: [f32; 4]| {
        planes.iter_mut().zip(pixel).for_each(|(plane, value)| plane.values_mut()[i] = value);
    };
    match picture.color().bytes_per_pixel() / picture.color().channel_count() {
        1 => {
            let linear = linear_table(256);
            for (i, pixel) in picture.into_rgba8().pixels().enumerate() {
                let [r, g, b, a] = pixel.0;
                let [r, g, b] = [r, g, b].map(|code| linear[usize::from(code)]);
                put(i, [r, g, b, f32::from(a) / 255.0]);
            }
        }
        2 => {
            let linear = linear_table(65536);
            for (i, pixel) in picture.into_rgba16().pixels().enumerate() {
                let [r, g, b, a] = pixel.0;
                let [r, g, b] = [r, g, b].map(|code| linear[usize::from(code)]);
                put(i, [r, g, b, f32::from(a) / 65535.0]);
            }
        }
        _ => picture.into_rgba32f().pixels().enumerate().for_each(|(i, pixel)| put(i, pixel.0)),
    }
    let [red, green, blue, alpha] = planes;
    ([red, green, blue], alpha)
}

/// Linear light of each code of an sRGB scale of `codes` steps (IEC 61966-2-1).
fn linear_table(codes: usize) -> Vec<f32> {
    let linear =
        |coded: f64| if coded <= 0.04045 { coded / 12.92 } else { ((coded + 0.055) / 1.055).powf(2.4) };
    (0..codes).map(|code| linear(code as f64 / (codes - 1) as f64) as f32).collect()
}
