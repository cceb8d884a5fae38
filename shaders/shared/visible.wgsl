// The image visible to the camera, for the rows that a band reads: one colour and one CoC radius per pixel, no holes.
// CPU version: src/methods/shared/content.rs. Comes after coverage_planes.wgsl.

// Colour in one buffer; in the other CoC radius in pixels, after alpha if the background is visible.
@group(0) @binding(4) var<storage, read> visible_colors: array<f32>;
@group(0) @binding(5) var<storage, read> visible_rest: array<f32>;

fn visible_coc_px(index: i32) -> f32 {
    return visible_rest[(frame.channels - 3) * source_plane() + index];
}

fn visible_content(index: i32) -> vec4f {
    let plane = source_plane();
    // Without an alpha this value is the CoC radius, and is not used.
    let alpha = visible_rest[index];
    let colors = vec3f(visible_colors[index], visible_colors[plane + index], visible_colors[2 * plane + index]);
    return vec4f(colors, select(0.0, alpha, frame.channels > 3));
}
