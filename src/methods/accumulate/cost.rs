//! Cost of `accumulate`, in the terms of the parent module's cost formula; `examples/cost_model.rs` fits the nanoseconds.

use crate::methods::contract::Plan;
use crate::methods::cost::{Cost, WorkKind, term};
use crate::scene::Workload;

/// Mean of `|x| + |y|` over the unit disc: sample sides that a ray crosses per unit of CoC radius.
const SIDES_CROSSED: f64 = 8.0 / (3.0 * std::f64::consts::PI);

/// Cost of executing the plan.
pub(super) fn cost(_plan: &Plan, workload: &Workload<'_>) -> Cost {
    let rays = workload.pixels() * workload.views();
    let cells = rays * workload.supersample() * SIDES_CROSSED * workload.depths().whole_px;
    Cost::new(
        WorkKind::Rays,
        [
            term("samples", 11.403, workload.samples()),
            term("rays", 184.094, rays),
            term("rays × layers", 7.194, rays * workload.layers()),
            term("samples passed", 1.963, cells),
            term("samples passed × layers", 0.172, cells * workload.layers()),
        ],
    )
}
