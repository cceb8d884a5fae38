//! What one unit of each kind of work takes, in nanoseconds of processor time.
//!
//! Made by `cargo run --release --example cost_model -- FOLDER`, which measures, fits and prints this table, on two virtual
//! cores of an AMD EPYC with AVX-512. How far predictions are off on scenes that the fit has not seen stands in the README.

use super::work::{self, Work};
use crate::scene::{EffectKind, Plan};

/// Kinds of work that machines may be differently good at.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Rows of pixels in vectors, close together in memory.
    Rows,
    /// Rays that look up one sample here and one there.
    Rays,
    /// Passes over planes as large as the picture.
    Planes,
}

/// Every kind.
pub(super) const KINDS: [Kind; 3] = [Kind::Rows, Kind::Rays, Kind::Planes];

/// The method that stands for a kind of work in a calibration, and its views.
pub(super) fn calibrated_by(kind: Kind) -> (&'static str, Option<usize>) {
    match kind {
        Kind::Rows => ("shear", Some(16)),
        Kind::Rays => ("accumulate", Some(2)),
        Kind::Planes => ("opaque-blur", None),
    }
}

/// Processor seconds of a calibration's runs on the machine of the table.
pub(super) const MADE_SECONDS: [f64; KINDS.len()] = [1.0, 1.0, 1.0];

/// One term of a method's cost.
#[derive(Debug)]
pub(super) struct Term {
    /// What is counted.
    pub(super) name: &'static str,
    /// What one takes.
    pub(super) nanoseconds: f64,
}

/// What a method costs.
#[derive(Debug)]
pub(super) struct Cost {
    /// Name of the method; `pinhole` for a plan without a blur.
    pub(super) method: &'static str,
    /// The kind of its work.
    pub(super) kind: Kind,
    /// Counts the terms.
    pub(super) work: Work,
    /// The terms.
    pub(super) terms: &'static [Term],
}

/// The cost of what `plan` asks for.
///
/// # Panics
/// Never: every method has its costs, which is tested.
pub(super) fn cost_of(plan: &Plan) -> &'static Cost {
    let name = if plan.does(EffectKind::Blur) { plan.method } else { "pinhole" };
    COSTS.iter().find(|cost| cost.method == name).expect("every method has its costs")
}

const fn term(name: &'static str, nanoseconds: f64) -> Term {
    Term { name, nanoseconds }
}

/// Every method, and the picture without a lens.
pub(super) static COSTS: [Cost; 12] = [
    Cost {
        method: "pinhole",
        kind: Kind::Planes,
        work: work::pinhole,
        terms: &[
            term("pixels", 1.0),
            term("samples of the picture", 1.0),
        ],
    },
    Cost {
        method: "shear",
        kind: Kind::Rows,
        work: work::shear,
        terms: &[
            term("pixels × layers", 1.0),
            term("samples to merge", 1.0),
            term("pixels to fill", 1.0),
            term("pixels × views", 1.0),
            term("translucent fragments × views", 1.0),
            term("rows × slices × views", 1.0),
            term("runs × views", 1.0),
            term("hidden fragments × views", 1.0),
            term("highlights' area", 1.0),
        ],
    },
    Cost {
        method: "accumulate",
        kind: Kind::Rays,
        work: work::accumulate,
        terms: &[
            term("samples", 1.0),
            term("rays", 1.0),
            term("rays × layers", 1.0),
            term("samples passed", 1.0),
            term("samples passed × layers", 1.0),
        ],
    },
    Cost {
        method: "recursive-gaussian",
        kind: Kind::Planes,
        work: work::recursive_gaussian,
        terms: &[
            term("pixels × layers", 1.0),
            term("samples to merge", 1.0),
            term("pixels × depth layers blurred", 1.0),
            term("depth layers blurred × layers", 1.0),
            term("depth layers looked at × layers", 1.0),
        ],
    },
    Cost {
        method: "b-buffer",
        kind: Kind::Planes,
        work: work::b_buffer,
        terms: &[
            term("pixels", 1.0),
            term("pixels × layers", 1.0),
            term("samples to merge", 1.0),
            term("pixels × levels", 1.0),
            term("pixels × layers × levels", 1.0),
        ],
    },
    Cost {
        method: "point-splat",
        kind: Kind::Rows,
        work: work::point_splat,
        terms: &[
            term("pixels", 1.0),
            term("pixels × layers", 1.0),
            term("samples to merge", 1.0),
            term("area of visible sprites", 1.0),
            term("area of hidden sprites", 1.0),
            term("rows of sprites", 1.0),
        ],
    },
    Cost {
        method: "layer-rays",
        kind: Kind::Rays,
        work: work::layer_rays,
        terms: &[
            term("samples", 1.0),
            term("samples in cones", 1.0),
            term("pixels × depth layers", 1.0),
            term("rays", 1.0),
            term("rays with cones", 1.0),
            term("depth layers passed", 1.0),
            term("depth layers skipped", 1.0),
            term("rays × iterations", 1.0),
        ],
    },
    Cost {
        method: "opaque-blur",
        kind: Kind::Planes,
        work: work::opaque_blur,
        terms: &[
            term("pixels", 1.0),
            term("pixels × layers", 1.0),
            term("samples to merge", 1.0),
            term("pixels × sub-images", 1.0),
            term("area of pyramids", 1.0),
        ],
    },
    Cost {
        method: "pyramid-disocclusion",
        kind: Kind::Planes,
        work: work::pyramid_disocclusion,
        terms: &[
            term("pixels", 1.0),
            term("pixels × layers", 1.0),
            term("samples to merge", 1.0),
            term("pixels × sub-images", 1.0),
            term("area of pyramids", 1.0),
        ],
    },
    Cost {
        method: "peel-rays",
        kind: Kind::Rays,
        work: work::peel_rays,
        terms: &[
            term("samples", 1.0),
            term("pixels", 1.0),
            term("rays", 1.0),
            term("binary steps", 1.0),
            term("linear steps", 1.0),
        ],
    },
    Cost {
        method: "gather",
        kind: Kind::Rows,
        work: work::gather,
        terms: &[
            term("pixels", 1.0),
            term("pixels × layers", 1.0),
            term("samples to merge", 1.0),
            term("pixels × near levels", 1.0),
            term("pixels visited", 1.0),
        ],
    },
    Cost {
        method: "scatter",
        kind: Kind::Rows,
        work: work::scatter,
        terms: &[
            term("pixels", 1.0),
            term("pixels × layers", 1.0),
            term("samples to merge", 1.0),
            term("rows of sprites", 1.0),
            term("rows of runs", 1.0),
            term("pixels × slices", 1.0),
        ],
    },
];
