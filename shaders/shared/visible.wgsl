// What the camera sees, all of it known: one colour and one CoC radius a pixel, of the rows that a band reads.
// CPU twin: src/methods/shared/content.rs. Before it: covered.wgsl.

// Colour in one buffer, the rest in another: an open background's alpha, if there is one, and CoC radius in pixels.
@group(0) @binding(4) var<storage, read> visible_colors: array<f32>;
@group(0) @binding(5) var<storage, read> visible_rest: array<f32>;

fn visible_coc_px(index: i32) -> f32 {
    return visible_rest[(frame.channels - 3) * source_plane() + index];
}

fn visible_content(index: i32) -> vec4f {
    let plane = source_plane();
    // Where the background is closed that is the CoC radius.
    let alpha = visible_rest[index];
    let colors = vec3f(visible_colors[index], visible_colors[plane + index], visible_colors[2 * plane + index]);
    return vec4f(colors, select(0.0, alpha, frame.channels > 3));
}
