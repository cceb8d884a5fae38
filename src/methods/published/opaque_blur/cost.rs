//! What `opaque-blur` costs, in the terms of the module's head; the nanoseconds are fitted by `examples/cost_model.rs`.

use super::parameters::OpaqueBlurParameters;
use crate::methods::contract::Plan;
use crate::methods::cost::{Cost, WorkKind, term};
use crate::methods::shared::sub_image_pixels;
use crate::scene::Workload;

/// What carrying out `plan` costs.
pub(super) fn cost(plan: &Plan, workload: &Workload<'_>) -> Cost {
    let [laid, _] = sub_image_pixels(workload, plan.parameters.get::<OpaqueBlurParameters>().first_radius_px);
    Cost::new(
        WorkKind::Planes,
        [
            term("pixels", 7.764, workload.pixels()),
            term("pixels × layers", 2.365, workload.pixels() * workload.layers()),
            term("samples to merge", 19.818, workload.merged()),
            term("pixels × sub-images", 10.943, laid),
        ],
    )
}
