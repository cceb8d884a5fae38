//! What `scatter` costs, in the terms of the module's head; the nanoseconds are fitted by `examples/cost_model.rs`.

use crate::methods::contract::Plan;
use crate::methods::cost::{Cost, WorkKind, term};
use crate::scene::Workload;

/// What carrying out `plan` costs.
pub(super) fn cost(_plan: &Plan, workload: &Workload<'_>) -> Cost {
    let pixels = workload.pixels();
    let rows = workload.sums(|coc| workload.disc_rows(coc))[0];
    let front = workload.sums(|_| 1.0)[0].max(1.0);
    // Slices are an eighth of a pixel wide near focus, where changes are counted by half pixels.
    let finer = workload.sums(|coc| (coc / 32.0).max(0.5) / (coc / 32.0).max(0.125))[0] / front;
    let [changes, edges] = [workload.stats.spread.changes[0], workload.stats.spread.edges[0]];
    let runs = (edges + (changes - edges) * finer) / workload.supersample() + workload.size()[1];
    let slices = workload.slices(0.125);
    Cost::new(
        WorkKind::Rows,
        [
            term("pixels", 40.954, pixels),
            term("pixels × layers", 1.789, pixels * workload.layers()),
            term("samples to merge", 19.318, workload.merged()),
            term("rows of sprites", 2.297, rows),
            term("rows of runs", 68.013, runs / front * rows),
            term("pixels × slices", 0.247, pixels * slices),
        ],
    )
}
