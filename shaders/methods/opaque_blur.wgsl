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

// NOTHING, where there is no more to rescale, is the program's.

// The matting weight of a pixel of the source; 0 where there is none.
fn weight_at(index: i32) -> f32 {
    let plane = frame.source_rows * frame.width;
    let coc_px = source_rest[(frame.channels - 3) * plane + max(index, 0)];
    return select(0.0, matting_weight(coc_px), index >= 0);
}

// A pixel of the source in the sub-image.
fn matted(index: i32) -> Pixel {
    let plane = frame.source_rows * frame.width;
    let kept = max(index, 0);
    let weight = weight_at(index);
    // Where the background is closed that is the CoC radius.
    let alpha = source_rest[kept];
    let colors = vec3f(source_colors[kept], source_colors[plane + kept], source_colors[2 * plane + kept]);
    return Pixel(weight * vec4f(colors, select(0.0, alpha, frame.channels > 3)), weight);
}

// Two coarse samples' parts of a row of fine ones.
struct Pair {
    left: vec4f,
    right: vec4f,
    alpha: vec2f,
}

fn matted_pair(x: i32, y: i32) -> Pair {
    let a = matted(source_index(x, y));
    let b = matted(source_index(x + 1, y));
    let c = matted(source_index(x + 2, y));
    let d = matted(source_index(x + 3, y));
    let e = matted(source_index(x + 4, y));
    let f = matted(source_index(x + 5, y));
    return Pair(
        level.inner * (b.content + c.content) + level.outer * (a.content + d.content),
        level.inner * (d.content + e.content) + level.outer * (c.content + f.content),
        analysed_pair(vec3f(a.coverage, b.coverage, c.coverage), vec3f(d.coverage, e.coverage, f.coverage)),
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
    let content = transpose(mat4x4f(upper.left, upper.right, lower.left, lower.right));
    for (var k = 0; k < 3; k++) {
        set_coarse(k, x, y, content[k]);
    }
    if frame.channels > 3 {
        set_coarse(3, x, y, content[3]);
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
    let four = fine_four(column, row);
    if !any(four.makes) {
        return;
    }
    let values = expanded(channel, corners(column, row));
    for (var k = 0; k < 4; k++) {
        if four.makes[k] {
            let index = fine_index(channel, four.x[k], four.y[k]);
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
    let four = frame_four(column, row);
    if !any(four.makes) {
        return;
    }
    let index = four.y * frame.width + four.x;
    let source = select(vec4i(-1), index + (frame.made_first - frame.source_first) * frame.width, four.makes);
    let own = vec4f(weight_at(source.x), weight_at(source.y), weight_at(source.z), weight_at(source.w));
    let around = corners(column, row);
    let blurred = expanded(frame.channels, around);
    let something = blurred > vec4f(NOTHING);
    let glowing = with_glow(expanded(frame.channels + 1, around), own);
    let alpha = select(vec4f(0.0), glowing, something);
    let scale = alpha / select(vec4f(1.0), blurred, something);
    let front = expanded_content(around);
    for (var k = 0; k < 4; k++) {
        if four.makes[k] {
            lay_over(index[k], Pixel(scale[k] * front[k], alpha[k]));
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
    lay_over(index, matted(source));
}
