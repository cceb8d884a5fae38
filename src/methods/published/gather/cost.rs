//! The cost of `gather`, in the terms that its module head names. The nanoseconds are fitted by `examples/cost_model.rs`.

use crate::methods::contract::Plan;
use crate::methods::cost::{Cost, WorkKind, term};
use crate::scene::Workload;

/// The cost of `plan`.
pub(super) fn cost(_plan: &Plan, workload: &Workload<'_>) -> Cost {
    let max_samples = workload.views();
    let visited = |reach: f64| {
        let disc = std::f64::consts::PI * (reach + 0.5).powi(2);
        if reach <= 0.5 { 0.0 } else { disc.min(max_samples) }
    };
    // Eight levels of radius per octave, four per step, each a pass over the picture.
    let steps = workload.stats.spread.steps.iter().skip(1);
    let levels = 4.0 * steps.filter(|step| step.front[0] > 0).count() as f64;
    let pixels = workload.pixels();
    Cost::new(
        WorkKind::Rows,
        [
            term("pixels", 22.998, pixels),
            term("pixels × layers", 3.147, pixels * workload.merged_layers()),
            term("samples to merge", 23.347, workload.merged()),
            term("pixels × near levels", 5.888, pixels * levels),
            term("pixels visited", 3.908, workload.reached(visited)),
            term("pixels before a background", 720.628, workload.pixels_before_background()),
        ],
    )
}
