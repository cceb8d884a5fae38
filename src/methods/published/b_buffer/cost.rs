//! The cost of `b-buffer`, in the terms that its module head names. The nanoseconds are fitted by `examples/cost_model.rs`.

use crate::methods::contract::Plan;
use crate::methods::cost::{Cost, WorkKind, term};
use crate::scene::Workload;

/// The cost of `plan`.
pub(super) fn cost(_plan: &Plan, workload: &Workload<'_>) -> Cost {
    // Level n has the variance (4ⁿ − 1) / 2, a disc c² / 4.
    let levels: f64 = workload.reach_px().map(|coc| (1.0 + 0.5 * coc * coc).log(4.0).ceil()).iter().sum();
    let pixels = workload.pixels();
    Cost::new(
        WorkKind::Planes,
        [
            term("pixels", 25.151, pixels),
            term("pixels × layers", 2.028, pixels * workload.merged_layers()),
            term("samples to merge", 21.104, workload.merged()),
            term("pixels × levels", 6.698, pixels * levels),
            term("pixels × layers × levels", 2.405, pixels * workload.merged_layers() * levels),
            term("pixels before a background", 186.162, workload.pixels_before_background()),
        ],
    )
}
