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
            term("pixels × layers", 3.617, workload.pixels() * workload.merged_layers()),
            term("samples to merge", 28.518, workload.merged()),
            term("pixels × sub-images", 18.306, composited),
            term("pixels before a background", 152.881, workload.pixels_before_background()),
        ],
    )
}
