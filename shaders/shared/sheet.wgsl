// A band of a picture of which some is known: content, premultiplied by coverage, and coverage.
// CPU twin: src/methods/shared/content.rs.
//
// Planes one after the other, as [plane][row][column]: colour in one buffer, in the other an open background's alpha, if there
// is one, and coverage.
//
// normalise: content divided by coverage.

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

fn lay_over(channel: i32, index: i32, front: f32, alpha: f32) {
    set_result(channel, index, front + (1.0 - alpha) * result_value(channel, index));
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
