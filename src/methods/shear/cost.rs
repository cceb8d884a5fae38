//! The cost of `shear`, in the terms of the module's head; the nanoseconds per unit are fitted by `examples/cost_model.rs`.

use super::bins::plateau_px;
use crate::methods::contract::Plan;
use crate::methods::cost::{Cost, WorkKind, term};
use crate::scene::{Discs, EffectKind, Workload};

/// The cost of rendering `plan`.
pub(super) fn cost(plan: &Plan, workload: &Workload<'_>) -> Cost {
    let stats = workload.stats;
    let views = workload.views();
    let width_px = f64::from(plateau_px(plan.views.unwrap_or(0)));
    let [edges, changes] = [stats.spread.edges, stats.spread.changes].map(|sums| sums.iter().sum::<f64>());
    // Bins of half the width cut slopes twice as often; edges are cut as often whatever the width.
    let spans = (edges + (changes - edges) * 0.5 / width_px) / workload.supersample() + workload.size()[1];
    let translucent = stats.translucent_fragments as f64 / workload.supersample().powi(2);
    let discs = plan
        .strength(EffectKind::Highlights)
        .map_or_else(Discs::default, |threshold| workload.discs(threshold));
    let fills = plan.does(EffectKind::Fill);
    let [filled, over_hidden] =
        if fills { [workload.pixels(), workload.pixels_over_hidden()] } else { [0.0; 2] };
    Cost::new(
        WorkKind::Rows,
        [
            term("pixels × layers", 39.442, workload.pixels() * workload.merged_layers()),
            term("samples to merge", 27.079, workload.merged()),
            term("pixels to fill", 164.341, filled),
            term("pixels to fill over hidden ones", 1196.544, over_hidden),
            term("pixels × views", 0.631, workload.pixels() * views),
            term("translucent fragments × views", 123.004, translucent * views),
            term("rows × slices × views", 16.980, workload.row_slices(width_px) * views),
            term("spans × views", 31.726, spans * views),
            term("highlights", 288668.687, discs.count),
            term("rows of highlights", 0.000, discs.rows),
        ],
    )
}
