//! Whether the depths of a stack can be what the file says, and what they are if not: the way through the checks of the depth's values.

use super::convention::{self, Conclusion};
use super::depth_values::DepthValues;
use super::options::ReadOptions;
use super::{Peel, depth_specks, depth_steps, order};
use crate::error::Error;
use crate::finding::Finding;
use crate::parallel;
use crate::settings::{DepthConvention, Values};

/// What is known of a file beside its depths.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known<'a> {
    /// What to read and how.
    pub(super) options: &'a ReadOptions,
    /// The camera data of the header.
    pub(super) camera: &'a Values,
    /// Whether it is said that depth has 8 bits.
    pub(super) has_8_bits: bool,
}

/// What the depths are, after all checks.
#[derive(Debug)]
pub(super) struct Depths {
    /// How they are written.
    pub(super) convention: DepthConvention,
    /// See [`super::Stack::near_is_one`].
    pub(super) near_is_one: bool,
    /// What was found.
    pub(super) findings: Vec<Finding>,
}

/// Corrects the depths of `peels`, the whole of what one file has of them: their sign, which end of normalised depth is near, specks.
///
/// # Errors
/// No depth at all.
pub(super) fn correct_values(
    peels: &mut [Peel],
    conclusion: Conclusion,
    known: Known<'_>,
) -> Result<Vec<Finding>, Error> {
    let convention = conclusion.convention;
    let values = DepthValues::of(peels);
    let mut findings = Vec::new();
    findings.extend(values.turn_around(peels, convention));
    if known.options.rows.is_none() {
        let writes_zero = match convention {
            DepthConvention::Inverse => true,
            DepthConvention::Ray => !conclusion.guessed,
            _ => false,
        };
        findings.extend(values.check(writes_zero)?);
        findings.extend(values.doubt());
    }
    if near_is_one(convention, known) {
        peels.iter_mut().for_each(inverted);
        findings.push(Finding::note("depth", "depth 1 is nearer than depth 0: `near` is above `far`"));
    }
    findings.extend(depth_specks::repair(peels, convention));
    Ok(findings)
}

/// Checks the depths of `peels`, which `concluded` says how to read and why, and corrects those that are written otherwise, unless they are
/// those of elements that were.
///
/// # Errors
/// No depth at all; a part of a file of which only the whole says how it is written.
pub(super) fn correct(
    peels: &mut [Peel],
    (conclusion, finding): (Conclusion, Finding),
    (known, is_merged): (Known<'_>, bool),
) -> Result<Depths, Error> {
    let convention = conclusion.convention;
    let mut findings = vec![finding];
    if !is_merged {
        findings.extend(correct_values(peels, conclusion, known)?);
    } else if known.options.rows.is_none() {
        // Elements were corrected before they were merged; together they may still have nothing but background.
        findings.extend(DepthValues::of(peels).check(false)?);
    }
    if known.options.rows.is_none() {
        findings.extend(depth_steps::doubt(peels, convention).filter(|_| !known.has_8_bits));
    }
    findings.extend(convention::doubt(conclusion, order::depth_range(peels, convention)));
    Ok(Depths { convention, near_is_one: near_is_one(convention, known), findings })
}

/// Whether the distance of depth 0 is set to be above that of depth 1. Both must be set.
pub(super) fn near_is_one(convention: DepthConvention, Known { options, camera, .. }: Known<'_>) -> bool {
    let [near, far] = [options.near.or(camera.near), options.far.or(camera.far)];
    convention == DepthConvention::Normalised && near.zip(far).is_some_and(|(near, far)| near > far)
}

/// Turns normalised depth around, so that 0 is near. Background stays.
fn inverted(peel: &mut Peel) {
    let invert = |depth: &mut f32| {
        if *depth >= 0.0 && *depth < f32::INFINITY {
            *depth = 1.0 - depth.min(1.0);
        }
    };
    parallel::for_each_block(peel.depth.values_mut(), &|_, values| values.iter_mut().for_each(invert));
}
