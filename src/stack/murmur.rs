//! The cryptomatte id of a name: `MurmurHash3` (x86, 32 bits, seed 0), modified so that its bits are a normal float.

/// The id of `name`, as the bits of the float in the channels.
///
/// Exponents 0 and 255 are changed, so that the float is neither denormal nor infinite nor NaN.
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
        let mixed = (hash ^ mix_block(u32::from_le_bytes(*block))).rotate_left(13);
        mixed.wrapping_mul(5).wrapping_add(0xe654_6b64)
    });
    let mut last = [0; 4];
    last[..tail.len()].copy_from_slice(tail);
    hash ^= mix_block(u32::from_le_bytes(last));
    // MurmurHash3 uses the length modulo 2^32.
    finalize(hash ^ bytes.len() as u32)
}

fn mix_block(block: u32) -> u32 {
    block.wrapping_mul(0xcc9e_2d51).rotate_left(15).wrapping_mul(0x1b87_3593)
}

/// The finalizer, which mixes every bit of `hash` into every other.
fn finalize(mut hash: u32) -> u32 {
    hash = (hash ^ (hash >> 16)).wrapping_mul(0x85eb_ca6b);
    hash = (hash ^ (hash >> 13)).wrapping_mul(0xc2b2_ae35);
    hash ^ (hash >> 16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_murmur3() {
        // Published test values of MurmurHash3_x86_32, with 0 to 3 remaining bytes.
        assert_eq!(murmur3(b""), 0);
        assert_eq!(murmur3(b"test"), 0xba6b_d213);
        assert_eq!(murmur3(b"Hello, world!"), 0xc036_3e43);
        assert_eq!(murmur3(b"The quick brown fox jumps over the lazy dog"), 0x2e4f_f723);
    }

    #[test]
    fn ids_are_those_of_the_cryptomatte_repository() {
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
    fn every_id_is_a_normal_float() {
        let names: Vec<String> = (0..5000).map(|i| format!("object{i}")).collect();
        let changed =
            names.iter().filter(|name| !f32::from_bits(murmur3(name.as_bytes())).is_normal()).count();
        assert!(changed > 0, "some hashes are not normal floats");
        for name in &names {
            let (id, hash) = (id(name), murmur3(name.as_bytes()));
            assert!(f32::from_bits(id).is_normal(), "{name}");
            assert_eq!(
                id & !0x0080_0000,
                hash & !0x0080_0000,
                "{name}: only the last bit of the exponent changes"
            );
        }
    }
}
