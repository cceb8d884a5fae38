//! A file of any content, read in every way in which the program reads a picture.

#![no_main]

use libfuzzer_sys::fuzz_target;
use thinlens::stack::{ReadOptions, Source, footprint, is_complete, read, read_framed};

/// Memory that a file may ask for.
const MAX_BYTES: u64 = 64 << 20;

fuzz_target!(|bytes: &[u8]| {
    let source = Source::memory("fuzz.exr", bytes);
    let options = ReadOptions { max_bytes: Some(MAX_BYTES), objects: true, ..ReadOptions::default() };
    let sources = std::slice::from_ref(&source);
    let _ = is_complete(&source);
    let _ = footprint(sources, &options);
    let _ = read_framed(&source, &options);
    let _ = read(sources, &ReadOptions { rows: Some(1..3), ..options.clone() });
    if let Ok(stack) = read(sources, &options) {
        let _ = stack.objects();
        let size = (stack.width(), stack.height());
        for peel in &stack.peels {
            assert_eq!((peel.depth.width(), peel.depth.height()), size);
            assert!(peel.color.iter().all(|plane| plane.values().iter().all(|value| value.is_finite())));
        }
    }
});
