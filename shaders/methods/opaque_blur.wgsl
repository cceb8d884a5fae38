// Opaque image blur (Kraus 2011): sub-images by depth, each blurred and composited over those behind it.
// CPU version: src/methods/published/opaque_blur/mod.rs.
// Concatenated after coverage_planes.wgsl, visible.wgsl, pyramid.wgsl, first_level.wgsl, sub_images.wgsl.
//
// Channels of a pyramid: content, alpha, glow of alpha. Synthesis overwrites the analysis, sample by sample.
//
// matte:              level 1 of the sub-image, matted out of the picture.
// glow:               expands a level from the coarser one, with eq. 9 for the glow.
// composite:          composites the frame, expanded from level 1 and rescaled (eq. 7), over the result (eq. 6).
// composite_in_focus: composites the sub-image in focus over the result.

// The program sets MIN_ALPHA: blurred alpha up to it is 0, and there is nothing to rescale.

// The matting weight of a pixel of the source; 0 where there is no pixel.
fn weight_at(index: i32) -> f32 {
    return select(0.0, matting_weight(visible_coc_px(max(index, 0))), index >= 0);
}

// A pixel of the source, matted for the sub-image: content and alpha.
fn matted(index: i32) -> Sample {
    let weight = weight_at(index);
    return Sample(weight * visible_content(max(index, 0)), vec2f(weight, 0.0));
}

fn matted_pair(x: i32, y: i32) -> Pair {
    return pair_of(
        matted(source_index(x, y)),
        matted(source_index(x + 1, y)),
        matted(source_index(x + 2, y)),
        matted(source_index(x + 3, y)),
        matted(source_index(x + 4, y)),
        matted(source_index(x + 5, y)),
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
    let block = block_of(upper, lower);
    set_content(x, y, block.content);
    set_coarse(frame.channels, x, y, block.rest[0]);
    set_coarse(frame.channels + 1, x, y, block.rest[0]);
}

// A_syn = A_exp + A_ana - A_exp A_ana (eq. 9).
fn with_glow(expanded_alpha: vec4f, analysed_alpha: vec4f) -> vec4f {
    return expanded_alpha + (analysed_alpha - expanded_alpha * analysed_alpha);
}

@compute @workgroup_size(16, 16)
fn glow(@builtin(global_invocation_id) at: vec3u) {
    let corner = fine_corner(at);
    let channel = i32(at.z);
    let four = fine_four(corner);
    if !any(four.makes) {
        return;
    }
    let values = expanded(channel, corners(corner));
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
fn composite(@builtin(global_invocation_id) at: vec3u) {
    let corner = frame_corner(at);
    let four = frame_four(corner);
    if !any(four.makes) {
        return;
    }
    let index = four.y * frame.width + four.x;
    let source = select(vec4i(-1), index + (frame.made_first - frame.source_first) * frame.width, four.makes);
    let own = vec4f(weight_at(source.x), weight_at(source.y), weight_at(source.z), weight_at(source.w));
    let around = corners(corner);
    let blurred_alpha = expanded(frame.channels, around);
    let has_alpha = blurred_alpha > vec4f(MIN_ALPHA);
    let glow_alpha = with_glow(expanded(frame.channels + 1, around), own);
    let alpha = select(vec4f(0.0), glow_alpha, has_alpha);
    let scale = alpha / select(vec4f(1.0), blurred_alpha, has_alpha);
    let front = expanded_content(around);
    for (var k = 0; k < 4; k++) {
        if four.makes[k] {
            lay_over(index[k], Pixel(scale[k] * front[k], alpha[k]));
        }
    }
}

@compute @workgroup_size(16, 16)
fn composite_in_focus(@builtin(global_invocation_id) at: vec3u) {
    if i32(at.x) >= frame.width || i32(at.y) >= frame.made_rows {
        return;
    }
    let index = i32(at.y) * frame.width + i32(at.x);
    let source = (i32(at.y) + frame.made_first - frame.source_first) * frame.width + i32(at.x);
    let front = matted(source);
    lay_over(index, Pixel(front.content, front.rest.x));
}
