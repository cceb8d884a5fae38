// Depth layers matted out of the peels, blurred and composed in one cascade of Gaussians (Schedl & Wimmer 2012).
// CPU twin: src/methods/recursive_gaussian/. Before it: sheet.wgsl.
//
// Every sheet but the finished one has the rows that the band reads.
//
// see:        how much of a peel is seen through those before it.
// share:      adds a layer's part of a peel to the layer (eqs. 2 to 4).
// before:     composes a sheet with a layer before it.
// behind:     composes a sheet with a layer behind it.
// transpose:  columns become rows.
// pass_along: an extended box along every column.
// finish:     a sheet's rows that the band makes, divided by coverage.

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
    chunk: i32,
    radius: i32,
    edge: f32,
    scale: f32,
    steps: f32,
    step: f32,
    fine_steps: f32,
    fine_step: f32,
}

@group(0) @binding(3) var<uniform> matting: Matting;
// Red, green and blue; coverage and depth.
@group(0) @binding(4) var<storage, read> peel_colors: array<f32>;
@group(0) @binding(5) var<storage, read> peel_rest: array<f32>;
// A sheet in the making, or one that is composed with another.
@group(0) @binding(8) var<storage, read_write> layer_colors: array<f32>;
@group(0) @binding(9) var<storage, read_write> layer_rest: array<f32>;
@group(0) @binding(10) var<storage, read> seen: array<f32>;
@group(0) @binding(11) var<storage, read_write> seen_behind: array<f32>;
// Planes before and after a pass.
@group(0) @binding(12) var<storage, read> from_planes: array<f32>;
@group(0) @binding(13) var<storage, read_write> to_planes: array<f32>;
@group(0) @binding(14) var<uniform> lines: Lines;

// Coverage from which on nothing is seen behind.
const OPAQUE_ALPHA: f32 = 0.999;
// Smaller values are 0.
const LEAST: f32 = 1e-20;

fn source_plane() -> i32 {
    return frame.source_rows * frame.width;
}

// The pixel of the rows that are read, -1 where there is none.
fn source_pixel(at: vec3u) -> i32 {
    let inside = i32(at.x) < frame.width && i32(at.y) < frame.source_rows;
    return select(-1, i32(at.y) * frame.width + i32(at.x), inside);
}

fn layer_value(channel: i32, index: i32) -> f32 {
    if channel < 3 {
        return layer_colors[channel * source_plane() + index];
    }
    return layer_rest[(channel - 3) * source_plane() + index];
}

fn set_layer(channel: i32, index: i32, value: f32) {
    if channel < 3 {
        layer_colors[channel * source_plane() + index] = value;
    } else {
        layer_rest[(channel - 3) * source_plane() + index] = value;
    }
}

@compute @workgroup_size(16, 16)
fn see(@builtin(global_invocation_id) at: vec3u) {
    let index = source_pixel(at);
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

fn add_to_layer(channel: i32, index: i32, value: f32) {
    var sum = value;
    if matting.first == 0u {
        sum += layer_value(channel, index);
    }
    set_layer(channel, index, sum);
}

@compute @workgroup_size(16, 16)
fn share(@builtin(global_invocation_id) at: vec3u) {
    let index = source_pixel(at);
    if index < 0 {
        return;
    }
    let plane = source_plane();
    let alpha = peel_rest[index];
    var covered = 0.0;
    if matting.first == 0u {
        covered = layer_value(frame.channels, index);
    }
    let part = (1.0 - covered) * share_of(peel_rest[plane + index], alpha, seen[index]);
    for (var k = 0; k < 3; k++) {
        add_to_layer(k, index, part * peel_colors[k * plane + index]);
    }
    if frame.channels > 3 {
        add_to_layer(3, index, select(0.0, part * alpha, matting.shows == 1u));
    }
    add_to_layer(frame.channels, index, part * alpha);
}

@compute @workgroup_size(16, 16)
fn before(@builtin(global_invocation_id) at: vec3u) {
    let index = source_pixel(at);
    if index < 0 {
        return;
    }
    let covered = layer_value(frame.channels, index);
    for (var k = 0; k <= frame.channels; k++) {
        lay_over(k, index, layer_value(k, index), covered);
    }
}

@compute @workgroup_size(16, 16)
fn behind(@builtin(global_invocation_id) at: vec3u) {
    let index = source_pixel(at);
    if index < 0 {
        return;
    }
    let known = result_value(frame.channels, index);
    for (var k = 0; k <= frame.channels; k++) {
        set_result(k, index, result_value(k, index) + (1.0 - known) * layer_value(k, index));
    }
}

var<workgroup> square: array<f32, 272>;

@compute @workgroup_size(16, 16)
fn transpose(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_id) local: vec3u) {
    let plane = i32(group.z) * lines.count * lines.length;
    let corner = 16 * vec2i(group.xy);
    let column = corner.x + i32(local.x);
    let row = corner.y + i32(local.y);
    // A column more than the square has, so that a column of it lies in as many banks as a row.
    if column < lines.count && row < lines.length {
        square[17u * local.y + local.x] = from_planes[plane + row * lines.count + column];
    }
    workgroupBarrier();
    let new_column = corner.y + i32(local.x);
    let new_row = corner.x + i32(local.y);
    if new_column < lines.length && new_row < lines.count {
        to_planes[plane + new_row * lines.length + new_column] = square[17u * local.x + local.y];
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
    let column = i32(at.x);
    let start = i32(at.y) * lines.chunk;
    if column >= lines.count || start >= lines.length {
        return;
    }
    let line = i32(at.z) * lines.count * lines.length + column;
    let last = lines.length - 1;
    let radius = lines.radius;
    var sum = vec2i(0);
    for (var i = start - radius; i <= start + radius; i++) {
        sum += in_steps(from_planes[line + clamp(i, 0, last) * lines.count]);
    }
    var previous = from_planes[line + clamp(start - radius - 1, 0, last) * lines.count];
    for (var i = start; i < min(start + lines.chunk, lines.length); i++) {
        let leaving = from_planes[line + max(i - radius, 0) * lines.count];
        let entering = from_planes[line + min(i + radius + 1, last) * lines.count];
        let value = lines.scale * (of_steps(sum) + lines.edge * (previous + entering));
        to_planes[line + i * lines.count] = select(value, 0.0, abs(value) < LEAST);
        sum += in_steps(entering) - in_steps(leaving);
        previous = leaving;
    }
}

@compute @workgroup_size(16, 16)
fn finish(@builtin(global_invocation_id) at: vec3u) {
    if i32(at.x) >= frame.width || i32(at.y) >= frame.made_rows {
        return;
    }
    let index = i32(at.y) * frame.width + i32(at.x);
    let source = index + (frame.made_first - frame.source_first) * frame.width;
    let coverage = layer_value(frame.channels, source);
    for (var k = 0; k < frame.channels; k++) {
        let known = layer_value(k, source) / select(1.0, coverage, coverage > 0.0);
        let value = select(0.0, known, coverage > 0.0);
        // A blur's rounding may leave an opacity a little past whole.
        set_result(k, index, select(value, clamp(value, 0.0, 1.0), k == 3));
    }
}
