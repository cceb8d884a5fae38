//! The files that are mutated: small ones of every kind that can be read, and what fuzzing found.

use super::fixtures::{Part, exr_bytes, exr_bytes_displayed};
use exr::image::FlatSamples;
use exr::meta::attribute::{AttributeValue, Compression, Text};
use image::{ColorType, ImageFormat};
use std::io::Cursor;
use std::path::Path;

/// A file to mutate.
pub(super) struct Sample {
    /// Its name, for messages.
    pub(super) name: String,
    /// Its content.
    pub(super) bytes: Vec<u8>,
    /// Whether it can be read.
    pub(super) is_whole: bool,
}

/// Every file.
pub(super) fn all() -> Vec<Sample> {
    let made =
        exrs().into_iter().chain(pictures()).map(|(name, bytes)| Sample { name, bytes, is_whole: true });
    made.chain(files("tests/cycles", true)).chain(files("tests/mutants/found", false)).collect()
}

/// The files in `folder`, in the order of their names.
fn files(folder: &str, is_whole: bool) -> Vec<Sample> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut paths: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension != "py"));
    paths.sort();
    let sample = |path: &std::path::PathBuf| {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        // Renders of Cycles have no depth.
        let is_whole = is_whole && name == "stack.exr";
        Sample { name, bytes: std::fs::read(path).unwrap(), is_whole }
    };
    paths.iter().map(sample).collect()
}

const SIZE: (usize, usize) = (7, 5);
const RGBAZ: &str = "R=0.5 G=0.25 B=1 A=1 Z=3";

/// A part with a gradient in its red and depth, so that codecs have something to do.
fn part() -> Part {
    let ramp = |scale: f32| (0..SIZE.0 * SIZE.1).map(|i| 1.0 + scale * i as f32).collect();
    Part::flat(SIZE, RGBAZ).with("R", FlatSamples::F32(ramp(0.1))).with("Z", FlatSamples::F32(ramp(0.3)))
}

fn half(values: f32) -> FlatSamples {
    FlatSamples::F16(vec![half::f16::from_f32(values); SIZE.0 * SIZE.1])
}

/// OpenEXR files: every codec, tiles, parts, layers, data windows, attributes, cryptomattes, types of samples.
fn exrs() -> Vec<(String, Vec<u8>)> {
    let codecs = [
        Compression::Uncompressed,
        Compression::RLE,
        Compression::ZIP1,
        Compression::ZIP16,
        Compression::PIZ,
        Compression::PXR24,
        Compression::B44,
        Compression::B44A,
    ];
    let coded = codecs
        .into_iter()
        .map(|compression| (format!("{compression:?}"), vec![Part { compression, ..part() }]));
    let text = |text: &str| AttributeValue::Text(Text::from(text));
    let crypto =
        "R=0.5 G=0.5 B=1 A=1 Z=3 CryptoObject00.R=1 CryptoObject00.G=1 CryptoObject00.B=0 CryptoObject00.A=0";
    let described = |part: Part| {
        part.attribute("cryptomatte/1/name", text("CryptoObject"))
            .attribute("cryptomatte/1/manifest", text("{\"cube\":\"3f800000\",\"b\":\"00000000\"}"))
            .attribute("cryptomatte/1/hash", text("MurmurHash3_32"))
    };
    let camera = part()
        .attribute("thinlens.focus_distance", AttributeValue::F32(4.0))
        .attribute("thinlens.kind", text("coverage"))
        .attribute("thinlens.depth_convention", text("ray"))
        .attribute("focus", AttributeValue::F32(3.0))
        .attribute("aperture", AttributeValue::F32(2.0))
        .attribute("comments", text("a note"));
    let views = part()
        .attribute("multiView", AttributeValue::TextVector(vec![Text::from("left"), Text::from("right")]));
    let mixed = part()
        .with("G", half(0.25))
        .with("id", FlatSamples::U32(vec![7; SIZE.0 * SIZE.1]))
        .with("A", half(0.5));
    let peels = "Peel0.R=0.5 Peel0.G=0.5 Peel0.B=1 Peel0.A=0.5 Peel0.Z=3 Peel1.R=0.5 Peel1.G=0.5 Peel1.B=1 Peel1.A=1 Peel1.Z=5";
    let others = [
        ("tiles", vec![Part { tile: Some((4, 4)), ..part() }]),
        ("parts", vec![part().named("front"), part().named("back")]),
        ("views", vec![views]),
        ("layers", vec![Part::flat(SIZE, peels)]),
        ("overscan", vec![part().at(-2, -1)]),
        ("camera", vec![camera]),
        ("cryptomatte", vec![described(Part::flat(SIZE, crypto))]),
        ("types", vec![mixed]),
        ("dwaa", vec![Part { compression: Compression::DWAA(Some(45.0)), ..part() }]),
    ];
    let named = coded.chain(others.map(|(name, parts)| (name.to_owned(), parts)));
    let mut files: Vec<_> = named.map(|(name, parts)| (format!("{name}.exr"), exr_bytes(parts))).collect();
    files.push(("crop.exr".to_owned(), exr_bytes_displayed(vec![part().at(3, 2)], (20, 20))));
    files
}

/// Pictures of other formats.
fn pictures() -> Vec<(String, Vec<u8>)> {
    let formats = [
        (ImageFormat::Png, ColorType::Rgba8),
        (ImageFormat::Png, ColorType::L16),
        (ImageFormat::Tiff, ColorType::Rgb8),
        (ImageFormat::Tiff, ColorType::Rgb32F),
        (ImageFormat::Hdr, ColorType::Rgb32F),
        (ImageFormat::Jpeg, ColorType::Rgb8),
    ];
    let picture = |(format, color): (ImageFormat, ColorType)| {
        let bytes: Vec<u8> = match color {
            ColorType::Rgb32F => (0..105).flat_map(|i| (i as f32 / 100.0).to_ne_bytes()).collect(),
            _ => (0..35 * u16::from(color.bytes_per_pixel())).map(|i| (i * 7) as u8).collect(),
        };
        let mut file = Cursor::new(Vec::new());
        image::write_buffer_with_format(&mut file, &bytes, 7, 5, color, format).unwrap();
        (format!("{color:?}.{}", format.extensions_str()[0]), file.into_inner())
    };
    formats.map(picture).into()
}
