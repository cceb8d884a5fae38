//! Mutations: what a disk, a network, another program or an attacker does to a file.

use super::corpus::Sample;
use fastrand::Rng;

/// Bytes at the start of a file that are mutated more often: its header.
const HEAD: usize = 700;

/// Numbers that are at an edge of what a field can hold.
const EDGES: [u32; 10] =
    [0, 1, 0xff, 0xffff, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, 0x0001_0000, 0x7f80_0000, 0x3fff_ffff];

/// Mutant `number` of `samples[at]`: always the same.
pub(super) fn mutant(samples: &[Sample], at: usize, number: u64) -> Vec<u8> {
    let mut rng = Rng::with_seed(number.wrapping_mul(0x9e37_79b9).wrapping_add(at as u64));
    let mut bytes = samples[at].bytes.clone();
    for _ in 0..rng.usize(1..=3) {
        mutate(&mut bytes, samples, &mut rng);
    }
    bytes
}

/// A place in `bytes`, most often in their header.
fn place(bytes: &[u8], rng: &mut Rng) -> usize {
    let end = if rng.bool() { bytes.len() } else { bytes.len().min(HEAD) };
    rng.usize(0..end.max(1))
}

fn mutate(bytes: &mut Vec<u8>, samples: &[Sample], rng: &mut Rng) {
    if bytes.is_empty() {
        return;
    }
    let at = place(bytes, rng);
    let length = rng.usize(1..=16).min(bytes.len() - at);
    match rng.u8(0..10) {
        0..=2 => bytes[at] ^= 1 << rng.u8(0..8),
        3 => bytes[at] = rng.u8(..),
        4 | 5 => {
            let edge = EDGES[rng.usize(0..EDGES.len())].to_le_bytes();
            bytes[at..].iter_mut().zip(edge).for_each(|(byte, edge)| *byte = edge);
        }
        6 => bytes.truncate(at),
        7 => drop(bytes.drain(at..at + length)),
        8 => {
            let copy: Vec<u8> = bytes[at..at + length].to_vec();
            let to = place(bytes, rng);
            bytes.splice(to..to, copy);
        }
        _ => {
            let other = &samples[rng.usize(0..samples.len())].bytes;
            let from = place(other, rng);
            let length = rng.usize(1..=64).min(other.len() - from);
            let end = (at + length).min(bytes.len());
            bytes.splice(at..end, other[from..from + length].iter().copied());
        }
    }
}
