//! Blocks of ZIP and ZIPS files: whatever their samples, to the bit; and damaged ones.

use super::fixtures::{Part, exr_bytes, source, stack_of};
use exr::image::FlatSamples;
use exr::meta::attribute::Compression;
use half::f16;
use thinlens::stack::{ReadOptions, read};

/// Odd in both directions, with a last block of 6 rows.
const SIZE: (usize, usize) = (37, 70);

/// Values of each of the rows' kinds: `true` is noise, which deflate does not make smaller, and the others are zeros, negative zeros and a
/// ramp, by turns of 5 rows.
fn values(is_noise: bool) -> Vec<f16> {
    let mut random = fastrand::Rng::with_seed(1);
    let value = |i: usize| match (is_noise, i / SIZE.0 / 5 % 3) {
        // Every finite half.
        (true, _) => f16::from_bits(random.u16(..0x7c00) | random.u16(..2) << 15),
        (false, 0) => f16::ZERO,
        (false, 1) => f16::NEG_ZERO,
        (false, _) => f16::from_f32(i as f32 / 16.0),
    };
    (0..SIZE.0 * SIZE.1).map(value).collect()
}

#[test]
fn samples_of_every_type_are_read_to_the_bit_from_packed_and_raw_blocks() {
    for is_noise in [false, true] {
        let halves = values(is_noise);
        let floats: Vec<f32> = halves.iter().map(|half| half.to_f32() * 1.000_1).collect();
        let ids: Vec<u32> = floats.iter().map(|float| float.to_bits()).collect();
        for compression in [Compression::Uncompressed, Compression::ZIP1, Compression::ZIP16] {
            for tile in [None, Some((16, 8)), Some((64, 128))] {
                let part = Part { compression, tile, ..Part::flat(SIZE, "A=1 Z=4 B=0") };
                let part = part
                    .with("R", FlatSamples::F16(halves.clone()))
                    .with("G", FlatSamples::F32(floats.clone()))
                    .with("id.H", FlatSamples::F16(halves.clone()))
                    .with("id.F", FlatSamples::F32(floats.clone()))
                    .with("id.U", FlatSamples::U32(ids.clone()));
                let stack = stack_of(vec![part]);
                let name = format!("{compression:?}, {tile:?}, noise: {is_noise}");
                let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<u32>>();
                let [red, green, blue] = &stack.peels[0].color;
                let expected: Vec<f32> = halves.iter().map(|half| half.to_f32()).collect();
                assert_eq!(bits(red.values()), bits(&expected), "{name}");
                assert_eq!(bits(green.values()), bits(&floats), "{name}");
                assert_eq!(bits(blue.values()), vec![0; ids.len()], "{name}");
                for carried in &stack.carried.channels {
                    match &carried.samples {
                        FlatSamples::F16(samples) => {
                            assert!(
                                samples
                                    .iter()
                                    .map(|half| half.to_bits())
                                    .eq(halves.iter().map(|half| half.to_bits())),
                                "{name}"
                            );
                        }
                        FlatSamples::F32(samples) => assert_eq!(bits(samples), bits(&floats), "{name}"),
                        FlatSamples::U32(samples) => assert_eq!(*samples, ids, "{name}"),
                    }
                }
                assert_eq!(stack.carried.channels.len(), 3);
            }
        }
    }
}

/// Where the blocks of a file with `count` of them begin: the first begins behind the table of their positions.
fn blocks(bytes: &[u8], count: usize) -> Vec<usize> {
    let word = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight bytes")) as usize;
    let table = (0..bytes.len() - 8).find(|&at| word(at) == at + 8 * count).expect("a table");
    (0..count).map(|block| word(table + 8 * block)).collect()
}

#[test]
fn of_several_damaged_blocks_the_first_in_the_file_is_reported_whatever_the_number_of_threads() {
    let ramp = (0..SIZE.0 * SIZE.1).map(|i| 1.0 + i as f32).collect();
    let part = Part::flat(SIZE, "R=1 G=1 B=1 Z=1").with("R", FlatSamples::F32(ramp));
    let mut bytes = exr_bytes(vec![part]);
    let blocks = blocks(&bytes, 5);
    // A block is its row, its size, and zlib data, which begins with 0x78.
    for block in [1, 2] {
        bytes[blocks[block] + 8] = 0;
    }
    // Its row is that of no block.
    bytes[blocks[3]] = 1;
    let failure = |bytes: &[u8], threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| read(&[source(bytes.to_vec())], &ReadOptions::default())).unwrap_err().to_string()
    };
    for threads in [1, 2, 3, 8].repeat(5) {
        let error = failure(&bytes, threads);
        assert!(error.starts_with("a block of pixels cannot be decompressed"), "{threads} threads: {error}");
    }
    bytes[blocks[0]] = 1;
    for threads in [1, 2, 3, 8].repeat(5) {
        let error = failure(&bytes, threads);
        assert!(error.contains("invalid or repeated position"), "{threads} threads: {error}");
    }
}
