//! Amount of work of sub-images by depth.

use crate::scene::Workload;

/// Number of pixels of all sub-images of a picture, and of the finest levels of their pyramids.
pub(in crate::methods) fn sub_image_pixels(workload: &Workload<'_>, first_radius_px: f32) -> [f64; 2] {
    let first = f64::from(first_radius_px);
    let max_levels = workload.size()[0].max(workload.size()[1]).max(1.0).log2().ceil() as i32 + 1;
    let needed =
        |reach: f64| if reach <= 0.0 { 0 } else { ((reach / first).log2().ceil() as i32 + 1).max(1) };
    let [near, far] = workload.reach_px().map(|reach| needed(reach).min(max_levels));
    let infinity = f64::from(workload.stats.spread.coc_infinity_px);
    let possible =
        (1..=max_levels).take_while(|&i| first * f64::from(i - 1).exp2() < infinity).count() as i32;
    // The sides of a pyramid of n levels are multiples of 2ⁿ, with a border.
    let padded = |levels: i32| {
        let multiple = f64::from(levels).exp2();
        workload.size().map(|side| ((side + 2.0) / multiple).ceil() * multiple).iter().product::<f64>()
    };
    let far = far.min(possible);
    let blurred: f64 = (1..=near).chain(1..=far).map(padded).sum();
    [workload.pixels() * f64::from(1 + near + far), blurred]
}
