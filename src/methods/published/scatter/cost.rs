//! The cost of `scatter`, in the terms that its module head names. The nanoseconds are fitted by `examples/cost_model.rs`.

use crate::methods::contract::Plan;
use crate::methods::cost::{Cost, WorkKind, term};
use crate::scene::Workload;

/// The cost of `plan`.
pub(super) fn cost(_plan: &Plan, workload: &Workload<'_>) -> Cost {
    let pixels = workload.pixels();
    let rows = workload.sums(|coc| workload.disc_rows(coc))[0];
    let front = workload.sums(|_| 1.0)[0].max(1.0);
    // Slices near focus are an eighth of a pixel wide; the statistics count changes there by half pixels.
    let finer = workload.sums(|coc| (coc / 32.0).max(0.5) / (coc / 32.0).max(0.125))[0] / front;
    let [changes, edges] = [workload.stats.spread.changes[0], workload.stats.spread.edges[0]];
    let spans = (edges + (changes - edges) * finer) / workload.supersample() + workload.size()[1];
    let slices = workload.slices(0.125);
    Cost::new(
        WorkKind::Rows,
        [
            term("pixels", 19.232, pixels),
            term("pixels × layers", 3.770, pixels * workload.merged_layers()),
            term("samples to merge", 22.790, workload.merged()),
            term("rows of sprites", 3.810, rows),
            term("rows of spans", 166.805, spans / front * rows),
            term("pixels × slices", 0.713, pixels * slices),
            term("pixels before a background", 585.772, workload.pixels_before_background()),
        ],
    )
}
