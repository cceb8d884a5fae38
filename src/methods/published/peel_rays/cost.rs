//! Cost of `peel-rays`, in the terms of the module's head. `examples/cost_model.rs` fits the nanoseconds.

use super::parameters::PeelRaysParameters;
use crate::methods::contract::Plan;
use crate::methods::cost::{Cost, WorkKind, term};
use crate::scene::Workload;

/// The cost of `plan`.
pub(super) fn cost(plan: &Plan, workload: &Workload<'_>) -> Cost {
    let parameters = plan.parameters.get::<PeelRaysParameters>();
    let rays = workload.pixels() * workload.views();
    // Two steps per sample that is passed along the longer of the two axes.
    let steps = 2.0 * 0.77 * workload.supersample() * workload.depths().before_px;
    let steps = steps.min(parameters.linear_steps as f64);
    Cost::new(
        WorkKind::Rays,
        [
            term("samples", 26.684, workload.samples()),
            term("pixels", 37.500, workload.pixels()),
            term("rays", 62.218, rays),
            term("binary steps", 2.588, rays * (parameters.binary_steps as f64).min(steps)),
            term("linear steps", 3.861, rays * steps),
        ],
    )
}
