// Depth layers matted out of the peels, blurred and composed in one cascade of Gaussians (Schedl & Wimmer 2012).
// CPU twin: src/methods/recursive_gaussian/. Before it: covered.wgsl, other_sheet.wgsl.
// The other covered is a layer in the making, or what is composed with the result.
//
// Every covered but the finished one has the rows that the band reads.
//
// see:        how much of a peel is seen through those before it.
// share:      adds a layer's part of a peel to the layer (eqs. 2 to 4).
// before:     composes a covered with a layer before it.
// behind:     composes a covered with a layer behind it.
// pass_along: an extended box along every line.
// finish:     a covered's rows that the band makes, divided by coverage.

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
    shows: u32,
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
// Red, green and blue; coverage and depth.
@group(0) @binding(4) var<storage, read> peel_colors: array<f32>;
@group(0) @binding(5) var<storage, read> peel_rest: array<f32>;
@group(0) @binding(10) var<storage, read> seen: array<f32>;
@group(0) @binding(11) var<storage, read_write> seen_behind: array<f32>;
// Planes before and after a pass.
@group(0) @binding(12) var<storage, read> from_planes: array<f32>;
@group(0) @binding(13) var<storage, read_write> to_planes: array<f32>;
@group(0) @binding(14) var<uniform> lines: Lines;
@group(0) @binding(15) var<uniform> part: Part;

// OPAQUE_ALPHA, and LEAST below which values are 0, are the program's.

// The pixel of the part of the rows that are read, -1 where there is none.
fn part_pixel(at: vec3u) -> i32 {
    let inside = i32(at.x) < frame.width && i32(at.y) < part.rows;
    return select(-1, (i32(at.y) + part.first_row) * frame.width + i32(at.x), inside);
}

@compute @workgroup_size(16, 16)
fn see(@builtin(global_invocation_id) at: vec3u) {
    let index = part_pixel(at);
    if index >= 0 {
        let alpha = peel_rest[index];
        seen_behind[index] = seen[index] * select(1.0 - alpha, 0.0, alpha >= OPAQUE_ALPHA);
    }
}

// From 0 to 1, linear in depth; a ramp of no width is a step.
fn ramp(depth: f32, start: f32, end: f32, slope: f32) -> f32 {
    let risen = select(min((depth - start) * slope, 1.0), 1.0, depth >= end);
    return select(risen, 0.0, depth < start);
}

// What the layer gets of a fragment of which a share is seen.
fn share_of(depth: f32, alpha: f32, seen_share: f32) -> f32 {
    let nearer = seen_share * (1.0 - ramp(depth, matting.own_from, matting.own_to, matting.own_slope));
    // The divisor of what is not opaque is far from 0; that of what is, is not used.
    let own = select(0.0, (1.0 - nearer) / max(1.0 - alpha * nearer, 1e-6), depth > matting.rise_to);
    let rise = ramp(depth, matting.rise_from, matting.rise_to, matting.rise_slope);
    let not_past = select(own, rise, alpha >= OPAQUE_ALPHA);
    let past = seen_share * (1.0 - ramp(depth, matting.fall_from, matting.fall_to, matting.fall_slope));
    return select(0.0, select(past, not_past, depth <= matting.fall_from), alpha > 0.0);
}

@compute @workgroup_size(16, 16)
fn share(@builtin(global_invocation_id) at: vec3u) {
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
    let own = (1.0 - layer.coverage) * share_of(peel_rest[plane + index], alpha, seen[index]);
    let colors = vec3f(peel_colors[index], peel_colors[plane + index], peel_colors[2 * plane + index]);
    let content = vec4f(colors, select(0.0, alpha, matting.shows == 1u));
    set_other_pixel(index, Pixel(layer.content + own * content, layer.coverage + own * alpha));
}

@compute @workgroup_size(16, 16)
fn before(@builtin(global_invocation_id) at: vec3u) {
    let index = part_pixel(at);
    if index >= 0 {
        lay_over(index, other_pixel(index));
    }
}

@compute @workgroup_size(16, 16)
fn behind(@builtin(global_invocation_id) at: vec3u) {
    let index = part_pixel(at);
    if index >= 0 {
        set_result_pixel(index, over(result_pixel(index), other_pixel(index)));
    }
}

// A value in whole steps, and what is left of it in whole fine steps: sums of such never drift, whatever enters and leaves them.
fn in_steps(value: f32) -> vec2i {
    let steps = value * lines.steps;
    let whole = trunc(steps);
    return vec2i(i32(whole), i32((steps - whole) * lines.fine_steps));
}

fn of_steps(sum: vec2i) -> f32 {
    return f32(sum.x) * lines.step + f32(sum.y) * lines.fine_step;
}

@compute @workgroup_size(64)
fn pass_along(@builtin(global_invocation_id) at: vec3u) {
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
        let value = lines.scale * (of_steps(sum) + lines.edge * (previous + entering));
        to_planes[to_first + i * lines.to_sample] = select(value, 0.0, abs(value) < LEAST);
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
