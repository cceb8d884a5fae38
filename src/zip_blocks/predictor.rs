//! Differences from byte to byte, and the bytes of which they are.
//!
//! `differences[0] = bytes[0]`, `differences[i] = bytes[i] − bytes[i − 1] + 128`, modulo 256.

/// What is added to a difference: none is then in the middle of the range.
const BIAS: u8 = 128;

/// Replaces differences by the bytes of which they are. On x86-64 with AVX2 sixteen at a time.
pub(super) fn integrate(bytes: &mut [u8]) {
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = pulp::x86::V3::try_new() {
        return simd.vectorize(Integrate { simd, bytes });
    }
    integrate_on(BIAS, bytes);
}

/// Replaces differences by bytes, where `last` is the byte before the first of them.
fn integrate_on(mut last: u8, bytes: &mut [u8]) {
    for byte in bytes {
        last = last.wrapping_add(*byte).wrapping_sub(BIAS);
        *byte = last;
    }
}

/// Writes the differences of `bytes` to `differences`, which is as long.
pub(super) fn differentiate(bytes: &[u8], differences: &mut [u8]) {
    let ([first, rest @ ..], [first_difference, differences @ ..]) = (bytes, differences) else { return };
    *first_difference = *first;
    for (difference, (byte, before)) in differences.iter_mut().zip(rest.iter().zip(bytes)) {
        *difference = byte.wrapping_sub(*before).wrapping_add(BIAS);
    }
}

/// [`integrate`], with vectors.
#[cfg(target_arch = "x86_64")]
struct Integrate<'a> {
    simd: pulp::x86::V3,
    bytes: &'a mut [u8],
}

#[cfg(target_arch = "x86_64")]
impl pulp::NullaryFnOnce for Integrate<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { simd, bytes } = self;
        let (sse2, ssse3) = (simd.sse2, simd.ssse3);
        let splat = |byte: u8| sse2._mm_set1_epi8(byte.cast_signed());
        let (bias, last_lane) = (splat(BIAS), splat(15));
        let mut before = splat(BIAS);
        let (groups, rest) = bytes.as_chunks_mut::<16>();
        for group in groups {
            // Modulo 256, subtracting 128 is flipping the highest bit.
            let mut sums: std::arch::x86_64::__m128i = sse2._mm_xor_si128(pulp::cast(*group), bias);
            sums = sse2._mm_add_epi8(sums, sse2._mm_slli_si128::<1>(sums));
            sums = sse2._mm_add_epi8(sums, sse2._mm_slli_si128::<2>(sums));
            sums = sse2._mm_add_epi8(sums, sse2._mm_slli_si128::<4>(sums));
            sums = sse2._mm_add_epi8(sums, sse2._mm_slli_si128::<8>(sums));
            *group = pulp::cast(sse2._mm_add_epi8(sums, before));
            // From group to group one addition alone is waited for.
            before = sse2._mm_add_epi8(before, ssse3._mm_shuffle_epi8(sums, last_lane));
        }
        let [last, ..]: [u8; 16] = pulp::cast(before);
        integrate_on(last, rest);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_integrated_from_their_differences_with_and_without_vectors() {
        let mut random = fastrand::Rng::with_seed(3);
        for size in (0..70).chain([255, 256, 1000]) {
            let bytes: Vec<u8> = (0..size).map(|_| random.u8(..)).collect();
            let mut differences = vec![0; size];
            differentiate(&bytes, &mut differences);
            for i in 1..size {
                assert_eq!(bytes[i], bytes[i - 1].wrapping_add(differences[i]).wrapping_add(128), "{i}");
            }
            let mut plain = differences.clone();
            integrate_on(BIAS, &mut plain);
            assert_eq!(plain, bytes);
            integrate(&mut differences);
            assert_eq!(differences, bytes);
        }
    }
}
