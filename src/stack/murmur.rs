//! From a name to a cryptomatte's id: `MurmurHash3` (x86, 32 bits, seed 0), kept from being a float that no picture can hold.

/// The id of `name`, as the bits of the float that stands in the channels.
///
/// The exponent is kept from 0 and 255, so that the float is neither denormal nor infinite nor NaN.
pub(super) fn id(name: &str) -> u32 {
    const EXPONENT: u32 = 0x7f80_0000;
    let hash = murmur3(name.as_bytes());
    match hash & EXPONENT {
        0 => hash | 0x0080_0000,
        EXPONENT => hash & !0x0080_0000,
        _ => hash,
    }
}

fn murmur3(bytes: &[u8]) -> u32 {
    let (blocks, tail) = bytes.as_chunks::<4>();
    let mut hash = blocks.iter().fold(0u32, |hash, block| {
        let mixed = (hash ^ scrambled(u32::from_le_bytes(*block))).rotate_left(13);
        mixed.wrapping_mul(5).wrapping_add(0xe654_6b64)
    });
    let mut last = [0; 4];
    last[..tail.len()].copy_from_slice(tail);
    hash ^= scrambled(u32::from_le_bytes(last));
    // The length counts modulo 2^32.
    finished(hash ^ bytes.len() as u32)
}

fn scrambled(block: u32) -> u32 {
    block.wrapping_mul(0xcc9e_2d51).rotate_left(15).wrapping_mul(0x1b87_3593)
}

/// Every bit of `hash` mixed into every other.
fn finished(mut hash: u32) -> u32 {
    hash = (hash ^ (hash >> 16)).wrapping_mul(0x85eb_ca6b);
    hash = (hash ^ (hash >> 13)).wrapping_mul(0xc2b2_ae35);
    hash ^ (hash >> 16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_murmur3() {
        // Values that every implementation of MurmurHash3_x86_32 is checked by: no, one, two and three bytes left over.
        assert_eq!(murmur3(b""), 0);
        assert_eq!(murmur3(b"test"), 0xba6b_d213);
        assert_eq!(murmur3(b"Hello, world!"), 0xc036_3e43);
        assert_eq!(murmur3(b"The quick brown fox jumps over the lazy dog"), 0x2e4f_f723);
    }

    #[test]
    fn ids_are_those_of_cryptomattes_own_tests_and_pictures() {
        // nuke/cryptomatte_utilities_tests.py, in https://github.com/Psyop/Cryptomatte.
        let relative = |name: &str, float: f64| (f64::from(f32::from_bits(id(name))) / float - 1.0).abs();
        for (name, float) in [
            ("hello", 6.070_562_710_24e-17),
            ("cube", -4.084_619_125_19e15),
            ("sphere", 2.790_186_043_83e15),
            ("plane", 3.665_576_175_93e-11),
        ] {
            assert!(relative(name, float) < 1e-10, "{name}: {:e}", f32::from_bits(id(name)));
        }
        // The manifest of sample_images/debug_images/multichannel.exr there.
        assert_eq!(id("/obj/box:polygons:1"), 0x9d41_6418);
        assert_eq!(id("/obj/instance1:instances:0"), 0x0d54_c6cc);
        assert_eq!(id("/obj/instance1:instances:100"), 0x2dcd_2966);
    }

    #[test]
    fn no_id_is_a_float_that_a_picture_cannot_hold() {
        let names: Vec<String> = (0..5000).map(|i| format!("object{i}")).collect();
        let saved = names.iter().filter(|name| !f32::from_bits(murmur3(name.as_bytes())).is_normal()).count();
        assert!(saved > 0, "some hashes are no normal floats");
        for name in &names {
            let (id, hash) = (id(name), murmur3(name.as_bytes()));
            assert!(f32::from_bits(id).is_normal(), "{name}");
            assert_eq!(
                id & !0x0080_0000,
                hash & !0x0080_0000,
                "{name}: only the last bit of the exponent moves"
            );
        }
    }
}
