// Opaque image blur (Kraus 2011): sub-images by depth, each blurred and laid over those behind it.
// CPU twin: src/methods/opaque_blur/mod.rs. Before it: pyramid.wgsl, sub_images.wgsl.
//
// Channels of a pyramid: content, alpha, glow of alpha. Synthesis writes over the analysis, sample by sample.
//
// matte:     level 1 of the sub-image, matted out of the picture.
// glow:      a level expanded from the coarser one, with eq. 9 for the glow.
// lay:       the frame expanded from level 1, rescaled (eq. 7), over the result (eq. 6).
// lay_sharp: the sub-image in focus over the result.
// normalise: the result divided by its coverage.

// Colour in one buffer, the rest in another; planes of the source are content and CoC radius, those of the result content and coverage.
@group(0) @binding(4) var<storage, read> source_colors: array<f32>;
@group(0) @binding(5) var<storage, read> source_rest: array<f32>;
@group(0) @binding(6) var<storage, read_write> result_colors: array<f32>;
@group(0) @binding(7) var<storage, read_write> result_rest: array<f32>;

// Where the blur brings less there is nothing to rescale.
const NOTHING: f32 = 1e-30;

fn source_value(channel: i32, index: i32) -> f32 {
    let plane = frame.source_rows * frame.width;
    if channel < 3 {
        return source_colors[channel * plane + index];
    }
    return source_rest[(channel - 3) * plane + index];
}

fn result_value(channel: i32, index: i32) -> f32 {
    let plane = frame.made_rows * frame.width;
    if channel < 3 {
        return result_colors[channel * plane + index];
    }
    return result_rest[(channel - 3) * plane + index];
}

fn set_result(channel: i32, index: i32, value: f32) {
    let plane = frame.made_rows * frame.width;
    if channel < 3 {
        result_colors[channel * plane + index] = value;
    } else {
        result_rest[(channel - 3) * plane + index] = value;
    }
}

// The matting weight of a pixel of the source, if there is one.
fn weight_at(index: i32) -> f32 {
    if index < 0 {
        return 0.0;
    }
    return matting_weight(source_value(frame.channels, index));
}

fn indices(x: i32, y: i32) -> vec4i {
    return vec4i(source_index(x, y), source_index(x + 1, y), source_index(x + 2, y), source_index(x + 3, y));
}

fn weights_at(at: vec4i) -> vec4f {
    return vec4f(weight_at(at.x), weight_at(at.y), weight_at(at.z), weight_at(at.w));
}

fn contents(channel: i32, at: vec4i) -> vec4f {
    let kept = max(at, vec4i(0));
    return vec4f(
        source_value(channel, kept.x),
        source_value(channel, kept.y),
        source_value(channel, kept.z),
        source_value(channel, kept.w),
    );
}

@compute @workgroup_size(16, 16)
fn matte(@builtin(global_invocation_id) at: vec3u) {
    let x = i32(at.x);
    let y = i32(at.y) + level.from_row;
    if x >= level.coarse_width || y >= level.to_row {
        return;
    }
    let a = indices(2 * x - 1, 2 * y - 1);
    let b = indices(2 * x - 1, 2 * y);
    let c = indices(2 * x - 1, 2 * y + 1);
    let d = indices(2 * x - 1, 2 * y + 2);
    let weights = mat4x4f(weights_at(a), weights_at(b), weights_at(c), weights_at(d));
    let alpha = analysed(weights[0], weights[1], weights[2], weights[3]);
    for (var k = 0; k < frame.channels; k++) {
        var value = 0.0;
        // Weights are 0 or more: where they come to nothing there is nothing.
        if alpha > 0.0 {
            value = analysed(
                weights[0] * contents(k, a),
                weights[1] * contents(k, b),
                weights[2] * contents(k, c),
                weights[3] * contents(k, d),
            );
        }
        levels[coarse_index(k, x, y)] = value;
    }
    levels[coarse_index(frame.channels, x, y)] = alpha;
    levels[coarse_index(frame.channels + 1, x, y)] = alpha;
}

// A_syn = A_exp + A_ana - A_exp A_ana (eq. 9).
fn with_glow(expanded_alpha: f32, analysed_alpha: f32) -> f32 {
    return expanded_alpha + (analysed_alpha - expanded_alpha * analysed_alpha);
}

@compute @workgroup_size(16, 16)
fn glow(@builtin(global_invocation_id) at: vec3u) {
    let x = i32(at.x);
    let y = i32(at.y) + level.from_row;
    let channel = i32(at.z);
    if x >= level.fine_width || y >= level.to_row {
        return;
    }
    let index = fine_index(channel, x, y);
    let value = expanded(channel, x, y);
    levels[index] = select(value, with_glow(value, levels[index]), channel > frame.channels);
}

fn lay_over(channel: i32, index: i32, front: f32, alpha: f32) {
    set_result(channel, index, front + (1.0 - alpha) * result_value(channel, index));
}

@compute @workgroup_size(16, 16)
fn lay(@builtin(global_invocation_id) at: vec3u) {
    let x = i32(at.x) + frame.origin_x;
    let y = i32(at.y) + frame.made_first + frame.origin_y;
    if i32(at.x) >= frame.width || i32(at.y) >= frame.made_rows {
        return;
    }
    let index = i32(at.y) * frame.width + i32(at.x);
    let blurred = expanded(frame.channels, x, y);
    if blurred <= NOTHING {
        return;
    }
    let alpha = with_glow(expanded(frame.channels + 1, x, y), weight_at(source_index(x, y)));
    for (var k = 0; k < frame.channels; k++) {
        lay_over(k, index, expanded(k, x, y) * (alpha / blurred), alpha);
    }
    lay_over(frame.channels, index, alpha, alpha);
}

@compute @workgroup_size(16, 16)
fn lay_sharp(@builtin(global_invocation_id) at: vec3u) {
    if i32(at.x) >= frame.width || i32(at.y) >= frame.made_rows {
        return;
    }
    let index = i32(at.y) * frame.width + i32(at.x);
    let source = (i32(at.y) + frame.made_first - frame.source_first) * frame.width + i32(at.x);
    let alpha = weight_at(source);
    for (var k = 0; k < frame.channels; k++) {
        lay_over(k, index, alpha * source_value(k, source), alpha);
    }
    lay_over(frame.channels, index, alpha, alpha);
}

@compute @workgroup_size(16, 16)
fn normalise(@builtin(global_invocation_id) at: vec3u) {
    if i32(at.x) >= frame.width || i32(at.y) >= frame.made_rows {
        return;
    }
    let index = i32(at.y) * frame.width + i32(at.x);
    let coverage = result_value(frame.channels, index);
    for (var k = 0; k < frame.channels; k++) {
        let known = result_value(k, index) / select(1.0, coverage, coverage > 0.0);
        let value = select(0.0, known, coverage > 0.0);
        // A blur's rounding may leave an opacity a little past whole.
        set_result(k, index, select(value, clamp(value, 0.0, 1.0), k == 3));
    }
}
