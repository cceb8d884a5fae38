//! Whether a file is all there is seen by its end, in every kind of OpenEXR file: no shorter file passes, and no file with a hole.

use super::fixtures::{Part, exr_bytes, source};
use exr::meta::attribute::Compression;
use thinlens::error::ErrorKind;
use thinlens::stack::is_complete;

/// Whether a file of `bytes` is whole.
fn is_whole(bytes: Vec<u8>) -> bool {
    is_complete(&source(bytes)).expect("a file that can be read")
}

/// Small files of every layout that the fixtures can write.
fn written() -> Vec<(&'static str, Vec<u8>)> {
    let part = |channels| Part::flat((21, 37), channels);
    let parts = vec![part("R=1 G=1 B=1 A=1").named("colour"), part("Z=4").named("depth")];
    let tiled = Part { tile: Some((8, 8)), ..part("R=1 Z=4") };
    let raw = Part { compression: Compression::Uncompressed, ..part("R=1 Z=4") };
    let several_tiled = vec![Part { tile: Some((8, 8)), ..part("R=1") }.named("a"), part("Z=4").named("b")];
    vec![
        ("scan lines", exr_bytes(vec![part("R=1 G=1 B=1 A=1 Z=4")])),
        ("not compressed", exr_bytes(vec![raw])),
        ("tiles", exr_bytes(vec![tiled])),
        ("parts", exr_bytes(parts)),
        ("parts, one with tiles", exr_bytes(several_tiled)),
    ]
}

#[test]
fn a_file_is_complete_and_none_of_its_beginnings_is() {
    let mut files = written();
    let mut png = std::io::Cursor::new(Vec::new());
    image::RgbImage::new(9, 5).write_to(&mut png, image::ImageFormat::Png).unwrap();
    files.push(("PNG", png.into_inner()));
    for (name, bytes) in files {
        assert!(is_complete(&source(bytes.clone())).unwrap(), "{name}");
        for length in 0..bytes.len() {
            let beginning = is_complete(&source(bytes[..length].to_vec()));
            assert!(!beginning.unwrap(), "{name}: {length} of {} bytes", bytes.len());
        }
    }
}

/// An EXR header of 8 × 4 pixels with a codec of one row a chunk, and `attributes` in addition: name, type, value.
fn header(flags: u32, attributes: &[(&str, &str, &[u8])]) -> Vec<u8> {
    let window: Vec<u8> = [0i32, 0, 7, 3].into_iter().flat_map(i32::to_le_bytes).collect();
    let always: [(&str, &str, &[u8]); 3] = [
        ("compression", "compression", &[2]),
        ("dataWindow", "box2i", &window),
        ("displayWindow", "box2i", &window),
    ];
    let mut bytes = [&[0x76, 0x2f, 0x31, 0x01][..], &(2 | flags).to_le_bytes()].concat();
    for (name, kind, value) in always.iter().chain(attributes) {
        let size = (value.len() as u32).to_le_bytes();
        bytes.extend([name.as_bytes(), &[0], kind.as_bytes(), &[0], &size, value].concat());
    }
    bytes.push(0);
    bytes
}

/// `header` with a table of `chunks` offsets, all of the one chunk that follows.
fn with_table(header: &[u8], chunks: usize, chunk: &[u8]) -> Vec<u8> {
    let offset = (header.len() + 8 * chunks) as u64;
    [header, &offset.to_le_bytes().repeat(chunks), chunk].concat()
}

/// Asserts that a file with `header` has `chunks` offsets, the first `full` of which are needed: it is whole as soon as these are all
/// there, the table and the chunk behind it too.
fn assert_offsets(header: &[u8], (full, chunks): (usize, usize), chunk: &[u8]) {
    let whole = with_table(header, chunks, chunk);
    assert!(is_whole(whole.clone()), "{chunks} offsets");
    assert!(!is_whole(whole[..whole.len() - 1].to_vec()), "its last byte is missing");
    let patched = |number: usize, offset: u64| {
        let mut bytes = with_table(header, chunks + 1, chunk);
        let at = header.len() + 8 * number;
        bytes[at..at + 8].copy_from_slice(&offset.to_le_bytes());
        is_whole(bytes)
    };
    assert!(!patched(0, 0) && !patched(full - 1, 0), "{full} offsets: a chunk that is not written yet");
    assert!(patched(full, 0), "{full} offsets: what follows them is not needed");
    let beyond = 1 << 30;
    assert!(!patched(chunks - 1, beyond), "{chunks} offsets: the last chunk is not there yet");
    assert!(patched(chunks, beyond), "{chunks} offsets: what follows them is no offset");
}

#[test]
fn a_chunk_that_is_not_written_is_missed_in_scan_lines_and_in_tiles_of_every_level() {
    let scan_line = [&0i32.to_le_bytes()[..], &3u32.to_le_bytes(), &[7; 3]].concat();
    assert_offsets(&header(0, &[]), (4, 4), &scan_line);
    let tile = [&[0; 16][..], &3u32.to_le_bytes(), &[7; 3]].concat();
    // Tiles of 2 × 2. One level: 4 · 2. Both sides halved: 8 + 2 + 1 + 1. Each side halved: (4 + 2 + 1 + 1) · (2 + 1 + 1).
    for (mode, chunks) in [(0u8, 8), (1, 12), (2, 32)] {
        for rounding in [0, 1u8] {
            let tiles = [&2u32.to_le_bytes()[..], &2u32.to_le_bytes(), &[mode | rounding << 4]].concat();
            assert_offsets(&header(1 << 9, &[("tiles", "tiledesc", &tiles)]), (8, chunks), &tile);
        }
    }
    // Tiles of 3 × 3 of 8 × 4 pixels: levels of 8 × 4, 4 × 2, 2 × 1, 1 × 1 have 3 · 2 + 2 · 1 + 1 + 1.
    let tiles = [&3u32.to_le_bytes()[..], &3u32.to_le_bytes(), &[1]].concat();
    assert_offsets(&header(1 << 9, &[("tiles", "tiledesc", &tiles)]), (6, 10), &tile);
}

#[test]
fn deep_data_is_complete_once_its_last_samples_are_there() {
    let sizes = [5u64, 6, 99].map(u64::to_le_bytes).concat();
    let chunk = [&0i32.to_le_bytes()[..], &sizes, &[7; 11]].concat();
    let count = 4u32.to_le_bytes();
    let deep: [(&str, &str, &[u8]); 2] = [("type", "string", b"deepscanline"), ("chunkCount", "int", &count)];
    assert_offsets(&header(1 << 11, &deep), (4, 4), &chunk);
}

#[test]
fn what_is_missing_may_still_come_and_what_is_wrong_is_an_error() {
    assert!(!is_complete(&source(Vec::new())).unwrap(), "an empty file");
    assert!(!is_complete(&source(vec![0; 4096])).unwrap(), "reserved, and not written yet");
    assert!(is_complete(&source(b"any other format".to_vec())).unwrap());
    let mut version_3 = exr_bytes(vec![Part::flat((2, 2), "R=1")]);
    version_3[4] = 3;
    assert_eq!(is_complete(&source(version_3)).unwrap_err().kind(), ErrorKind::Unsupported);
    let no_name_ends = [&[0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0][..], &[b'x'; 300]].concat();
    assert_eq!(is_complete(&source(no_name_ends)).unwrap_err().kind(), ErrorKind::Input);
    let missing = thinlens::stack::Source::file("no/such.exr");
    assert_eq!(is_complete(&missing).unwrap_err().kind(), ErrorKind::Input);
}
