//! Cost of `point-splat`, in the terms of the module's head. `examples/cost_model.rs` fits the nanoseconds.

use super::parameters::PointSplatParameters;
use crate::methods::contract::Plan;
use crate::methods::cost::{Cost, WorkKind, term};
use crate::scene::Workload;

/// The cost of `plan`.
pub(super) fn cost(plan: &Plan, workload: &Workload<'_>) -> Cost {
    let parameters = plan.parameters.get::<PointSplatParameters>();
    let edges = workload.edge_density();
    // Pixels with another surface within their CoC are not reduced.
    let near_edge = |coc_px: f64| 1.0 - (-edges * 2.0 * coc_px).exp();
    let points = |coc_px: f64| match parameters.accelerated && coc_px >= 2.0 {
        true => near_edge(coc_px) + 0.25 * (1.0 - near_edge(coc_px)),
        false => 1.0,
    };
    let area = |coc_px: f64| workload.disc_px(coc_px.max(0.5));
    let visible = workload.sums(|coc| points(coc) * area(coc))[0];
    let rows = workload.sums(|coc| points(coc) * workload.disc_rows(coc))[0];
    let hides = parameters.hidden && workload.stats.layers > 1;
    let hidden = if hides { workload.pixels() } else { 0.0 };
    Cost::new(
        WorkKind::Rows,
        [
            term("pixels", 794.995, workload.pixels()),
            term("samples to merge", 27.383, workload.merged()),
            term("pixels to look behind", 44.041, hidden),
            term("area of sprites", 18.383, visible),
            term("rows of sprites", 59.959, rows),
            term("pixels before a background", 680.854, workload.pixels_before_background()),
        ],
    )
}
