// A second set of coverage planes beside that of coverage_planes.wgsl, for the rows that a band reads: sums, or an intermediate
// layer.

@group(0) @binding(8) var<storage, read_write> other_colors: array<f32>;
@group(0) @binding(9) var<storage, read_write> other_rest: array<f32>;

fn other_pixel(index: i32) -> Pixel {
    let plane = source_plane();
    // Without an alpha of content this value is coverage, and is not used.
    let alpha = other_rest[index];
    let colors = vec3f(other_colors[index], other_colors[plane + index], other_colors[2 * plane + index]);
    let coverage = other_rest[(frame.channels - 3) * plane + index];
    return Pixel(vec4f(colors, select(0.0, alpha, frame.channels > 3)), coverage);
}

fn set_other_pixel(index: i32, pixel: Pixel) {
    let plane = source_plane();
    other_colors[index] = pixel.content.r;
    other_colors[plane + index] = pixel.content.g;
    other_colors[2 * plane + index] = pixel.content.b;
    if frame.channels > 3 {
        other_rest[index] = pixel.content.a;
    }
    other_rest[(frame.channels - 3) * plane + index] = pixel.coverage;
}
