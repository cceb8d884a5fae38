// Depth layers matted out of the peels, blurred and composited in one cascade of Gaussians (Schedl & Wimmer 2012):
// GPU backend of src/methods/published/recursive_gaussian/. Concatenated after coverage_planes.wgsl and
// other_coverage_planes.wgsl. The other coverage planes hold the current layer, or the planes to composite with the
// result.
//
// All coverage planes but the finished ones have the rows that the band reads.
//
// |update_visibility   visibility of the next peel behind a peel
// |add_share           adds a layer's share of a peel to the layer (eqs. 2 to 4)
// |compose_over        composites a layer over coverage planes
// |compose_under       composites a layer under coverage planes
// |box_pass            one pass of an extended box along every line
// |finish              the rows that the band renders, divided by coverage

struct Matting {
    rise_from: f32,
    rise_to: f32,
    rise_slope: f32,
    own_from: f32,
    own_to: f32,
    own_slope: f32,
    fall_from: f32,
    fall_to: f32,
    fall_slope: f32,
    first: u32,
}

struct Lines {
    count: i32,
    length: i32,
    from_first: i32,
    from_plane: i32,
    from_line: i32,
    from_sample: i32,
    to_first: i32,
    to_plane: i32,
    to_line: i32,
    to_sample: i32,
    chunk: i32,
    radius: i32,
    edge: f32,
    scale: f32,
    steps: f32,
    step: f32,
    fine_steps: f32,
    fine_step: f32,
}

struct Part {
    first_row: i32,
    rows: i32,
}

@group(0) @binding(3) var<uniform> matting: Matting;
// Colours of a peel: red, green and blue. The rest: coverage and depth.
@group(0) @binding(4) var<storage, read> peel_colors: array<f32>;
@group(0) @binding(5) var<storage, read> peel_rest: array<f32>;
@group(0) @binding(10) var<storage, read> visibility: array<f32>;
@group(0) @binding(11) var<storage, read_write> visibility_behind: array<f32>;
// Input and output planes of a pass.
@group(0) @binding(12) var<storage, read> from_planes: array<f32>;
@group(0) @binding(13) var<storage, read_write> to_planes: array<f32>;
@group(0) @binding(14) var<uniform> lines: Lines;
@group(0) @binding(15) var<uniform> part: Part;

// From the program: OPAQUE_ALPHA, and MIN_MAGNITUDE, below which values are 0.

// Pixel index in the rows that are read; -1 outside of the part.
fn part_pixel(at: vec3u) -> i32 {
    let inside = i32(at.x) < frame.width && i32(at.y) < part.rows;
    return select(-1, (i32(at.y) + part.first_row) * frame.width + i32(at.x), inside);
}

@compute @workgroup_size(16, 16)
fn update_visibility(@builtin(global_invocation_id) at: vec3u) {
    let index = part_pixel(at);
    if index >= 0 {
        let alpha = peel_rest[index];
        visibility_behind[index] = visibility[index] * select(1.0 - alpha, 0.0, alpha >= OPAQUE_ALPHA);
    }
}

// A ramp from 0 to 1, linear in depth; a ramp of zero width is a step.
fn ramp(depth: f32, start: f32, end: f32, slope: f32) -> f32 {
    let value = select(min((depth - start) * slope, 1.0), 1.0, depth >= end);
    return select(value, 0.0, depth < start);
}

// Share in the layer of a fragment whose share `visible_share` is visible.
fn share_of(depth: f32, alpha: f32, visible_share: f32) -> f32 {
    let nearer = visible_share * (1.0 - ramp(depth, matting.own_from, matting.own_to, matting.own_slope));
    // The divisor of a translucent fragment is far from 0; that of an opaque one is not used.
    let layer_share = select(0.0, (1.0 - nearer) / max(1.0 - alpha * nearer, 1e-6), depth > matting.rise_to);
    let rise = ramp(depth, matting.rise_from, matting.rise_to, matting.rise_slope);
    let not_past = select(layer_share, rise, alpha >= OPAQUE_ALPHA);
    let past = visible_share * (1.0 - ramp(depth, matting.fall_from, matting.fall_to, matting.fall_slope));
    return select(0.0, select(past, not_past, depth <= matting.fall_from), alpha > 0.0);
}

@compute @workgroup_size(16, 16)
fn add_share(@builtin(global_invocation_id) at: vec3u) {
    let index = part_pixel(at);
    if index < 0 {
        return;
    }
    let plane = source_plane();
    let alpha = peel_rest[index];
    var layer = Pixel(vec4f(0.0), 0.0);
    if matting.first == 0u {
        layer = other_pixel(index);
    }
    let layer_share = (1.0 - layer.coverage) * share_of(peel_rest[plane + index], alpha, visibility[index]);
    let colors = vec3f(peel_colors[index], peel_colors[plane + index], peel_colors[2 * plane + index]);
    set_other_pixel(index, Pixel(layer.content + layer_share * vec4f(colors, 0.0), layer.coverage + layer_share * alpha));
}

@compute @workgroup_size(16, 16)
fn compose_over(@builtin(global_invocation_id) at: vec3u) {
    let index = part_pixel(at);
    if index >= 0 {
        lay_over(index, other_pixel(index));
    }
}

@compute @workgroup_size(16, 16)
fn compose_under(@builtin(global_invocation_id) at: vec3u) {
    let index = part_pixel(at);
    if index >= 0 {
        set_result_pixel(index, over(result_pixel(index), other_pixel(index)));
    }
}

// A value in whole steps, and its remainder in whole fine steps. Integer sums of these have no rounding error,
// whatever values are added and subtracted.
fn in_steps(value: f32) -> vec2i {
    let steps = value * lines.steps;
    let whole = trunc(steps);
    return vec2i(i32(whole), i32((steps - whole) * lines.fine_steps));
}

fn from_steps(sum: vec2i) -> f32 {
    return f32(sum.x) * lines.step + f32(sum.y) * lines.fine_step;
}

@compute @workgroup_size(64)
fn box_pass(@builtin(global_invocation_id) at: vec3u) {
    let line = i32(at.x);
    let start = i32(at.y) * lines.chunk;
    if line >= lines.count || start >= lines.length {
        return;
    }
    let from_first = lines.from_first + i32(at.z) * lines.from_plane + line * lines.from_line;
    let to_first = lines.to_first + i32(at.z) * lines.to_plane + line * lines.to_line;
    let last = lines.length - 1;
    let radius = lines.radius;
    var sum = vec2i(0);
    for (var i = start - radius; i <= start + radius; i++) {
        sum += in_steps(from_planes[from_first + clamp(i, 0, last) * lines.from_sample]);
    }
    var previous = from_planes[from_first + clamp(start - radius - 1, 0, last) * lines.from_sample];
    for (var i = start; i < min(start + lines.chunk, lines.length); i++) {
        let leaving = from_planes[from_first + max(i - radius, 0) * lines.from_sample];
        let entering = from_planes[from_first + min(i + radius + 1, last) * lines.from_sample];
        let value = lines.scale * (from_steps(sum) + lines.edge * (previous + entering));
        to_planes[to_first + i * lines.to_sample] = select(value, 0.0, abs(value) < MIN_MAGNITUDE);
        sum += in_steps(entering) - in_steps(leaving);
        previous = leaving;
    }
}

@compute @workgroup_size(16, 16)
fn finish(@builtin(global_invocation_id) at: vec3u) {
    if i32(at.x) < frame.width && i32(at.y) < frame.made_rows {
        let index = i32(at.y) * frame.width + i32(at.x);
        let source = index + (frame.made_first - frame.source_first) * frame.width;
        set_result_pixel(index, normalised(other_pixel(source)));
    }
}
