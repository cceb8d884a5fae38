//! The cost of `opaque-blur`, in the terms that its module head names. The nanoseconds are fitted by `examples/cost_model.rs`.

use super::parameters::OpaqueBlurParameters;
use crate::methods::contract::Plan;
use crate::methods::cost::{Cost, WorkKind, term};
use crate::methods::shared::sub_image_pixels;
use crate::scene::Workload;

/// The cost of `plan`.
pub(super) fn cost(plan: &Plan, workload: &Workload<'_>) -> Cost {
    let [composited, _] =
        sub_image_pixels(workload, plan.parameters.get::<OpaqueBlurParameters>().first_radius_px);
    Cost::new(
        WorkKind::Planes,
        [
            term("pixels", 0.000, workload.pixels()),
            term("pixels × layers", 2.800, workload.pixels() * workload.merged_layers()),
            term("samples to merge", 24.714, workload.merged()),
            term("pixels × sub-images", 16.768, composited),
            term("pixels before a background", 135.768, workload.pixels_before_background()),
        ],
    )
}
