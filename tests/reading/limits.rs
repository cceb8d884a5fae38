//! One limit of memory for everything that is decoded, and blocks of every size.

use super::fixtures::{Part, exr_bytes, source, stack_of};
use exr::meta::attribute::Compression;
use image::{GrayImage, ImageFormat};
use std::io::Cursor;
use thinlens::error::ErrorKind;
use thinlens::render::{Job, prepare};
use thinlens::settings::Values;
use thinlens::stack::{ReadOptions, Source, read, read_framed};

const MIB: u64 = 1 << 20;

/// A grey PNG of `side` × `side` pixels, which compress to nearly nothing.
fn png(side: u32) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    GrayImage::from_pixel(side, side, image::Luma([255]))
        .write_to(&mut bytes, ImageFormat::Png)
        .expect("it can be written");
    bytes.into_inner()
}

fn within(max_bytes: u64) -> ReadOptions {
    ReadOptions { max_bytes: Some(max_bytes), ..ReadOptions::default() }
}

#[test]
fn a_picture_counts_with_all_that_is_made_of_its_samples() {
    // A grey pixel of a byte is four bytes as RGBA and four floats in planes: 21 bytes.
    let picture = Source::memory("grey.png", png(300));
    let refused = read_framed(&picture, &within(21 * 300 * 300 - 1)).unwrap_err();
    assert_eq!(refused.kind(), ErrorKind::Limits, "{refused}");
    assert!(refused.to_string().contains("300×300 pixels"), "{refused}");
    assert!(read_framed(&picture, &within(21 * 300 * 300)).is_ok());
}

#[test]
fn an_aperture_image_is_within_the_limit_too() {
    let folder = tempfile::tempdir().unwrap();
    let image = folder.path().join("aperture.png");
    std::fs::write(&image, png(1000)).unwrap();
    let stack = exr_bytes(vec![Part::flat((8, 8), "R=1 G=1 B=1 A=1 Z=3")]);
    let job = |memory| Job {
        memory: Some(memory),
        flags: Values { aperture_image: Some(image.clone()), ..Values::default() },
        ..Job::new([source(stack.clone())])
    };
    let refused = prepare(&job(20 * MIB)).unwrap_err();
    assert_eq!(refused.kind(), ErrorKind::Limits, "{refused}");
    assert!(refused.to_string().contains("`aperture_image`"), "{refused}");
    assert!(prepare(&job(100 * MIB)).is_ok());
}

#[test]
fn the_peels_of_several_files_are_within_the_limit_together() {
    let peel =
        |depth: &str| source(exr_bytes(vec![Part::flat((64, 64), &format!("R=1 G=1 B=1 A=0.5 Z={depth}"))]));
    let peels = [peel("1"), peel("2"), peel("3")];
    // A block has up to 16 rows of the file.
    let (planes, block) = (64 * 64 * 20, 64 * 16 * 20);
    assert!(read(&peels, &within(3 * planes + block)).is_ok());
    let refused = read(&peels, &within(2 * planes + block)).unwrap_err();
    assert_eq!(refused.kind(), ErrorKind::Limits, "{refused}");
}

#[test]
fn a_dwa_block_that_is_stored_raw_is_read_wherever_it_is() {
    // Blocks have 32 or 256 rows; the last one may have one, and does not become smaller when compressed.
    for compression in [Compression::DWAA(None), Compression::DWAB(Some(45.0))] {
        for size in [(1, 1), (7, 5), (3, 33), (2, 257)] {
            let part = Part::flat(size, "R=0.5 G=0.25 B=1 A=1 Z=3");
            let stack = stack_of(vec![Part { compression, ..part }]);
            let depths = stack.peels[0].depth.values();
            let is_right = depths.iter().all(|depth| (depth - 3.0).abs() < 0.01);
            assert!(is_right, "{compression:?}, {size:?}");
        }
    }
}
