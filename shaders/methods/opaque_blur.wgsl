// Opaque image blur (Kraus 2011): sub-images by depth, each blurred and laid over those behind it.
// CPU twin: src/methods/opaque_blur/mod.rs. Before it: sheet.wgsl, pyramid.wgsl, sub_images.wgsl.
//
// Channels of a pyramid: content, alpha, glow of alpha. Synthesis writes over the analysis, sample by sample.
//
// matte:     level 1 of the sub-image, matted out of the picture.
// glow:      a level expanded from the coarser one, with eq. 9 for the glow.
// lay:       the frame expanded from level 1, rescaled (eq. 7), over the result (eq. 6).
// lay_sharp: the sub-image in focus over the result.

// Colour in one buffer, the rest in another: content and CoC radius.
@group(0) @binding(4) var<storage, read> source_colors: array<f32>;
@group(0) @binding(5) var<storage, read> source_rest: array<f32>;

// Where the blur brings less there is nothing to rescale.
const NOTHING: f32 = 1e-30;

fn source_value(channel: i32, index: i32) -> f32 {
    let plane = frame.source_rows * frame.width;
    if channel < 3 {
        return source_colors[channel * plane + index];
    }
    return source_rest[(channel - 3) * plane + index];
}

// The matting weight of a pixel of the source, if there is one.
fn weight_at(index: i32) -> f32 {
    if index < 0 {
        return 0.0;
    }
    return matting_weight(source_value(frame.channels, index));
}

// Content of a pixel, and its alpha.
struct Sample {
    content: vec4f,
    alpha: f32,
}

fn matted(x: i32, y: i32) -> Sample {
    let index = source_index(x, y);
    let weight = weight_at(index);
    let kept = max(index, 0);
    let opacity = select(0.0, source_rest[kept], frame.channels > 3);
    let content = vec4f(source_value(0, kept), source_value(1, kept), source_value(2, kept), opacity);
    return Sample(weight * content, weight);
}

// Two coarse samples' parts of a row of fine ones.
struct Pair {
    left: vec4f,
    right: vec4f,
    alpha: vec2f,
}

fn matted_pair(x: i32, y: i32) -> Pair {
    let a = matted(x, y);
    let b = matted(x + 1, y);
    let c = matted(x + 2, y);
    let d = matted(x + 3, y);
    let e = matted(x + 4, y);
    let f = matted(x + 5, y);
    return Pair(
        level.inner * (b.content + c.content) + level.outer * (a.content + d.content),
        level.inner * (d.content + e.content) + level.outer * (c.content + f.content),
        analysed_pair(vec3f(a.alpha, b.alpha, c.alpha), vec3f(d.alpha, e.alpha, f.alpha)),
    );
}

fn four_rows(a: Pair, b: Pair, c: Pair, d: Pair) -> Pair {
    return Pair(
        level.outer * (a.left + d.left) + level.inner * (b.left + c.left),
        level.outer * (a.right + d.right) + level.inner * (b.right + c.right),
        level.outer * (a.alpha + d.alpha) + level.inner * (b.alpha + c.alpha),
    );
}

@compute @workgroup_size(16, 16)
fn matte(@builtin(global_invocation_id) at: vec3u) {
    let x = 2 * i32(at.x);
    let y = 2 * i32(at.y) + level.from_row;
    if x >= level.coarse_width || y >= level.to_row {
        return;
    }
    let left = 2 * x - 1;
    let top = 2 * y - 1;
    let c = matted_pair(left, top + 2);
    let d = matted_pair(left, top + 3);
    let upper = four_rows(matted_pair(left, top), matted_pair(left, top + 1), c, d);
    let lower = four_rows(c, d, matted_pair(left, top + 4), matted_pair(left, top + 5));
    for (var k = 0; k < frame.channels; k++) {
        set_coarse(k, x, y, vec4f(upper.left[k], upper.right[k], lower.left[k], lower.right[k]));
    }
    let alpha = vec4f(upper.alpha, lower.alpha);
    set_coarse(frame.channels, x, y, alpha);
    set_coarse(frame.channels + 1, x, y, alpha);
}

// A_syn = A_exp + A_ana - A_exp A_ana (eq. 9).
fn with_glow(expanded_alpha: vec4f, analysed_alpha: vec4f) -> vec4f {
    return expanded_alpha + (analysed_alpha - expanded_alpha * analysed_alpha);
}

@compute @workgroup_size(16, 16)
fn glow(@builtin(global_invocation_id) at: vec3u) {
    let column = i32(at.x);
    let row = i32(at.y) + (level.from_row + 1) / 2;
    let channel = i32(at.z);
    let x = vec4i(2 * column - 1, 2 * column, 2 * column - 1, 2 * column);
    let y = vec4i(2 * row - 1, 2 * row - 1, 2 * row, 2 * row);
    let makes = (x >= vec4i(0)) & (x < vec4i(level.fine_width)) & (y >= vec4i(level.from_row)) & (y < vec4i(level.to_row));
    if !any(makes) {
        return;
    }
    let values = expanded(channel, corners(column, row));
    for (var k = 0; k < 4; k++) {
        if makes[k] {
            let index = fine_index(channel, x[k], y[k]);
            if channel > frame.channels {
                levels[index] = with_glow(values, vec4f(levels[index]))[k];
            } else {
                levels[index] = values[k];
            }
        }
    }
}

@compute @workgroup_size(16, 16)
fn lay(@builtin(global_invocation_id) at: vec3u) {
    let column = i32(at.x) + (frame.origin_x + 1) / 2;
    let row = i32(at.y) + (frame.made_first + frame.origin_y + 1) / 2;
    let x = vec4i(2 * column - 1, 2 * column, 2 * column - 1, 2 * column) - frame.origin_x;
    let y = vec4i(2 * row - 1, 2 * row - 1, 2 * row, 2 * row) - frame.origin_y - frame.made_first;
    let makes = (x >= vec4i(0)) & (x < vec4i(frame.width)) & (y >= vec4i(0)) & (y < vec4i(frame.made_rows));
    if !any(makes) {
        return;
    }
    let index = y * frame.width + x;
    let source = select(vec4i(-1), index + (frame.made_first - frame.source_first) * frame.width, makes);
    let own = vec4f(weight_at(source.x), weight_at(source.y), weight_at(source.z), weight_at(source.w));
    let around = corners(column, row);
    let blurred = expanded(frame.channels, around);
    let something = blurred > vec4f(NOTHING);
    let glowing = with_glow(expanded(frame.channels + 1, around), own);
    let alpha = select(vec4f(0.0), glowing, something);
    let scale = alpha / select(vec4f(1.0), blurred, something);
    for (var channel = 0; channel <= frame.channels; channel++) {
        var front = alpha;
        if channel < frame.channels {
            front = expanded(channel, around) * scale;
        }
        for (var k = 0; k < 4; k++) {
            if makes[k] {
                lay_over(channel, index[k], front[k], alpha[k]);
            }
        }
    }
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
