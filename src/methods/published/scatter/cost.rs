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
            term("pixels", 27.127, pixels),
            term("pixels × layers", 4.103, pixels * workload.merged_layers()),
            term("samples to merge", 26.445, workload.merged()),
            term("rows of sprites", 4.567, rows),
            term("rows of spans", 170.223, spans / front * rows),
            term("pixels × slices", 0.696, pixels * slices),
            term("pixels before a background", 593.468, workload.pixels_before_background()),
        ],
    )
}
