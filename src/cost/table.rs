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
pub(super) const MADE_SECONDS: [f64; KINDS.len()] = [0.0318, 0.0190, 0.0140];

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
        terms: &[term("samples of the picture", 20.795)],
    },
    Cost {
        method: "shear",
        kind: Kind::Rows,
        work: work::shear,
        terms: &[
            term("pixels × layers", 18.173),
            term("samples to merge", 23.505),
            term("pixels to fill", 221.605),
            term("pixels × views", 0.738),
            term("translucent fragments × views", 24.582),
            term("rows × slices × views", 3.462),
            term("runs × views", 15.656),
            term("highlights", 10644.557),
            term("rows of highlights", 1163.577),
        ],
    },
    Cost {
        method: "accumulate",
        kind: Kind::Rays,
        work: work::accumulate,
        terms: &[
            term("samples", 4.212),
            term("rays", 56.017),
            term("rays × layers", 1.716),
            term("samples passed", 1.684),
            term("samples passed × layers", 0.063),
        ],
    },
    Cost {
        method: "recursive-gaussian",
        kind: Kind::Planes,
        work: work::recursive_gaussian,
        terms: &[
            term("pixels × layers", 3.243),
            term("samples to merge", 18.948),
            term("pixels × depth layers", 21.912),
            term("pixels matted × layers", 5.163),
        ],
    },
    Cost {
        method: "b-buffer",
        kind: Kind::Planes,
        work: work::b_buffer,
        terms: &[
            term("pixels", 16.097),
            term("pixels × layers", 2.996),
            term("samples to merge", 18.234),
            term("pixels × levels", 3.650),
            term("pixels × layers × levels", 1.572),
        ],
    },
    Cost {
        method: "point-splat",
        kind: Kind::Rows,
        work: work::point_splat,
        terms: &[
            term("pixels", 380.626),
            term("samples to merge", 17.460),
            term("pixels to look behind", 33.764),
            term("area of sprites", 8.214),
            term("rows of sprites", 33.553),
        ],
    },
    Cost {
        method: "layer-rays",
        kind: Kind::Rays,
        work: work::layer_rays,
        terms: &[
            term("samples", 47.692),
            term("samples in cones", 8.059),
            term("pixels × depth layers", 30.370),
            term("rays", 81.775),
            term("rays with cones", 28.264),
            term("rays × iterations", 5.978),
        ],
    },
    Cost {
        method: "opaque-blur",
        kind: Kind::Planes,
        work: work::opaque_blur,
        terms: &[
            term("pixels", 7.764),
            term("pixels × layers", 2.365),
            term("samples to merge", 19.818),
            term("pixels × sub-images", 10.943),
        ],
    },
    Cost {
        method: "pyramid-disocclusion",
        kind: Kind::Planes,
        work: work::pyramid_disocclusion,
        terms: &[
            term("pixels", 16.145),
            term("pixels × layers", 3.388),
            term("samples to merge", 21.806),
            term("area of pyramids", 25.156),
        ],
    },
    Cost {
        method: "peel-rays",
        kind: Kind::Rays,
        work: work::peel_rays,
        terms: &[
            term("samples", 26.684),
            term("pixels", 37.500),
            term("rays", 62.218),
            term("binary steps", 2.588),
            term("linear steps", 3.861),
        ],
    },
    Cost {
        method: "gather",
        kind: Kind::Rows,
        work: work::gather,
        terms: &[
            term("pixels", 30.065),
            term("pixels × layers", 2.067),
            term("samples to merge", 21.452),
            term("pixels × near levels", 4.943),
            term("pixels visited", 1.080),
        ],
    },
    Cost {
        method: "scatter",
        kind: Kind::Rows,
        work: work::scatter,
        terms: &[
            term("pixels", 40.954),
            term("pixels × layers", 1.789),
            term("samples to merge", 19.318),
            term("rows of sprites", 2.297),
            term("rows of runs", 68.013),
            term("pixels × slices", 0.247),
        ],
    },
];
