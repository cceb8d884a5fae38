//! A preset of any text, and a render with it of a stack of a few pixels.

#![no_main]

use libfuzzer_sys::fuzz_target;
use thinlens::gpu::DeviceChoice;
use thinlens::render::{Job, prepare};
use thinlens::settings::Preset;
use thinlens::stack::Source;

/// A small stack.
const STACK: &[u8] = include_bytes!("../../tests/cycles/stack.exr");

fuzz_target!(|text: &str| {
    let Ok(preset) = Preset::parse(text, "fuzz.toml") else { return };
    // What is written reads back.
    let written = preset.to_toml();
    assert!(Preset::parse(&written, "written.toml").is_ok(), "{written}");
    let job = Job { device: DeviceChoice::Cpu, ..Job::new([Source::memory("stack.exr", STACK)]) };
    let job = Job { memory: Some(256 << 20), frame: Some(1), ..job }.with_preset("fuzz.toml", preset);
    let _ = prepare(&job);
});
