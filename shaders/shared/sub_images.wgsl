// Matting weights: the fraction of each pixel that belongs to a sub-image.
// CPU version: src/methods/shared/sub_images.rs.

struct Matting {
    rises: u32,
    rise_start: f32,
    rise_scale: f32,
    falls: u32,
    fall_start: f32,
    fall_scale: f32,
    inverse: f32,
}

@group(0) @binding(3) var<uniform> matting: Matting;

// From 0 at CoC radius `start` to 1, linear in depth.
fn ramp(coc_px: f32, start: f32, scale: f32) -> f32 {
    let nearness = max(1.0 - coc_px * matting.inverse, 1e-6);
    return clamp((coc_px - start) * scale / nearness, 0.0, 1.0);
}

// Fraction that is not nearer than the depth range of the sub-image.
fn not_nearer_weight(coc_px: f32) -> f32 {
    return select(1.0, ramp(coc_px, matting.rise_start, matting.rise_scale), matting.rises == 1u);
}

fn matting_weight(coc_px: f32) -> f32 {
    let fallen = select(0.0, ramp(coc_px, matting.fall_start, matting.fall_scale), matting.falls == 1u);
    return not_nearer_weight(coc_px) * (1.0 - fallen);
}
