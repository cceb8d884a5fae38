// Coverage planes of a band: content, premultiplied by coverage, and coverage.
// CPU version: src/methods/shared/content.rs.
//
// Layout [plane][row][column]: colour in one buffer; in the other coverage, after the alpha of content if it has one.
//
// normalise: divides content by coverage.

struct Frame {
    width: i32,
    height: i32,
    source_first: i32,
    source_rows: i32,
    made_first: i32,
    made_rows: i32,
    origin_x: i32,
    origin_y: i32,
    channels: i32,
}

@group(0) @binding(2) var<uniform> frame: Frame;
@group(0) @binding(6) var<storage, read_write> result_colors: array<f32>;
@group(0) @binding(7) var<storage, read_write> result_rest: array<f32>;

// Number of values per plane, for the rows that the band reads.
fn source_plane() -> i32 {
    return frame.source_rows * frame.width;
}

// A pixel of coverage planes; the fourth component of content is 0 without an alpha.
struct Pixel {
    content: vec4f,
    coverage: f32,
}

fn result_pixel(index: i32) -> Pixel {
    let plane = frame.made_rows * frame.width;
    // Without an alpha of content this value is coverage, and is not used.
    let alpha = result_rest[index];
    let colors = vec3f(result_colors[index], result_colors[plane + index], result_colors[2 * plane + index]);
    let coverage = result_rest[(frame.channels - 3) * plane + index];
    return Pixel(vec4f(colors, select(0.0, alpha, frame.channels > 3)), coverage);
}

fn set_result_pixel(index: i32, pixel: Pixel) {
    let plane = frame.made_rows * frame.width;
    result_colors[index] = pixel.content.r;
    result_colors[plane + index] = pixel.content.g;
    result_colors[2 * plane + index] = pixel.content.b;
    if frame.channels > 3 {
        result_rest[index] = pixel.content.a;
    }
    result_rest[(frame.channels - 3) * plane + index] = pixel.coverage;
}

fn over(front: Pixel, back: Pixel) -> Pixel {
    let transmittance = 1.0 - front.coverage;
    return Pixel(front.content + transmittance * back.content, front.coverage + transmittance * back.coverage);
}

fn lay_over(index: i32, front: Pixel) {
    set_result_pixel(index, over(front, result_pixel(index)));
}

// Content divided by coverage.
fn normalised(pixel: Pixel) -> Pixel {
    let known = pixel.coverage > 0.0;
    let content = select(vec4f(0.0), pixel.content / select(1.0, pixel.coverage, known), known);
    // Rounding in a blur may make alpha slightly larger than 1.
    return Pixel(vec4f(content.rgb, clamp(content.a, 0.0, 1.0)), pixel.coverage);
}

@compute @workgroup_size(16, 16)
fn normalise(@builtin(global_invocation_id) at: vec3u) {
    if i32(at.x) < frame.width && i32(at.y) < frame.made_rows {
        let index = i32(at.y) * frame.width + i32(at.x);
        set_result_pixel(index, normalised(result_pixel(index)));
    }
}
