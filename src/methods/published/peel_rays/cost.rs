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
            term("samples", 27.047, workload.samples()),
            term("pixels", 79.045, workload.pixels()),
            term("rays", 85.176, rays),
            term("binary steps", 4.056, rays * (parameters.binary_steps as f64).min(steps)),
            term("linear steps", 5.868, rays * steps),
            term("pixels before a background", 51.943, workload.pixels_before_background()),
        ],
    )
}
