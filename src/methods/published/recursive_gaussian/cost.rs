//! Cost of `recursive-gaussian`, in the terms of the module's head. `examples/cost_model.rs` fits the nanoseconds.

use super::layers::MAX_LAYERS;
use super::parameters::RecursiveGaussianParameters;
use crate::methods::contract::Plan;
use crate::methods::cost::{Cost, WorkKind, term};
use crate::scene::Workload;

/// The cost of `plan`.
pub(super) fn cost(plan: &Plan, workload: &Workload<'_>) -> Cost {
    let parameters = plan.parameters.get::<RecursiveGaussianParameters>();
    // Layer n is blurred by σ_n² = n (n + 1) (2n + 1) / 6. It lies where the CoC diameter is `coc_per_sigma` times
    // σ_n.
    let boundary_px = |n: u32| {
        let n = f64::from(n);
        0.5 * f64::from(parameters.coc_per_sigma) * (n * (n + 1.0) * (2.0 * n + 1.0) / 6.0).sqrt()
    };
    let layers_to_reach =
        |reach: f64| (0..MAX_LAYERS as u32).find(|&n| boundary_px(n) >= reach).unwrap_or(MAX_LAYERS as u32);
    let [front, back] = workload.reach_px().map(layers_to_reach);
    let needed = f64::from(1 + front + back);
    // Layers beyond the last fragment are not blurred.
    let blurred = parameters.layers.map_or(needed, |layers| needed.min(layers as f64));
    let back_ranges = (0..=back).map(|n| [boundary_px(n.saturating_sub(1)), boundary_px(n + 1)]);
    let front_ranges = (1..=front).map(|n| [-boundary_px(n + 1), -boundary_px(n - 1)]);
    let matted: f64 = back_ranges.chain(front_ranges).map(|range| workload.rows_with(range)).sum();
    let matted = matted * workload.size()[0] * blurred / needed;
    Cost::new(
        WorkKind::Planes,
        [
            term("pixels × layers", 11.096, workload.pixels() * workload.merged_layers()),
            term("samples to merge", 17.340, workload.merged()),
            term("pixels × depth layers", 38.905, workload.pixels() * blurred),
            term("pixels matted × layers", 12.571, matted * workload.merged_layers()),
            term("pixels before a background", 335.174, workload.pixels_before_background()),
        ],
    )
}
