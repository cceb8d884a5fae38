//! The cost of `pyramid-disocclusion`, in the terms that its module head names. The nanoseconds are fitted by
//! `examples/cost_model.rs`.

use super::parameters::PyramidDisocclusionParameters;
use crate::methods::contract::Plan;
use crate::methods::cost::{Cost, WorkKind, term};
use crate::methods::shared::sub_image_pixels;
use crate::scene::Workload;

/// The cost of `plan`.
pub(super) fn cost(plan: &Plan, workload: &Workload<'_>) -> Cost {
    let [_, blurred] =
        sub_image_pixels(workload, plan.parameters.get::<PyramidDisocclusionParameters>().first_radius_px);
    Cost::new(
        WorkKind::Planes,
        [
            term("pixels", 8.943, workload.pixels()),
            term("pixels × layers", 5.615, workload.pixels() * workload.merged_layers()),
            term("samples to merge", 25.082, workload.merged()),
            term("area of pyramids", 34.239, blurred),
            term("pixels before a background", 165.524, workload.pixels_before_background()),
        ],
    )
}
