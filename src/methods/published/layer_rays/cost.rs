//! Cost of `layer-rays`, in the terms of the module's head. `examples/cost_model.rs` fits the nanoseconds.

use super::parameters::LayerRaysParameters;
use crate::methods::contract::Plan;
use crate::methods::cost::{Cost, WorkKind, term};
use crate::scene::Workload;

/// The cost of `plan`.
pub(super) fn cost(plan: &Plan, workload: &Workload<'_>) -> Cost {
    let parameters = plan.parameters.get::<LayerRaysParameters>();
    let rays = workload.pixels() * workload.views();
    let span: f64 = workload.reach_px().iter().sum();
    // Layers share N-buffers: there are at most 64 of them.
    let slabs = (1.0 + span / f64::from(parameters.delta_px)).min(64.0);
    let bundles = workload.pixels() * slabs;
    let cones = if parameters.cones { 1.0 } else { 0.0 };
    Cost::new(
        WorkKind::Rays,
        [
            term("samples", 46.224, workload.samples()),
            term("samples in cones", 23.885, workload.samples() * cones),
            term("pixels × depth layers", 47.125, bundles),
            term("rays", 136.540, rays),
            term("rays with cones", 35.670, rays * cones),
            term("rays × iterations", 9.780, rays * parameters.iterations as f64),
            term("pixels before a background", 28.824, workload.pixels_before_background()),
        ],
    )
}
