// Sub-images by depth, in which the parts that nearer ones hide are filled from their surroundings (Kraus & Strengert 2007).
// CPU version: src/methods/published/pyramid_disocclusion/mod.rs.
// Concatenated after coverage_planes.wgsl, visible.wgsl, pyramid.wgsl, first_level.wgsl, sub_images.wgsl.
//
// Two pyramids: one fills holes, with the channels content, CoC radius and known share; the other blurs, with the channels
// content and alpha. Samples of level 0 of the filled picture are computed where they are needed, from the picture and level 1.
//
// pull_first:         level 1 of the pixels that are not nearer than the sub-image.
// pull:               the next coarser level of them.
// copy:               copies a level that two pyramids have from one to the other.
// total:              sums the coarsest level, in parts.
// fill:               fills the unknown share of the coarsest level with the mean of everything known.
// push:               fills the unknown share of a level with the expanded coarser one.
// matte:              level 1 of the sub-image, matted out of the filled picture.
// expand:             expands a level from the coarser one.
// composite:          composites the frame, expanded from level 1, over the result.
// composite_in_focus: composites the sub-image in focus over the result.

// Means of the known content and CoC radius.
struct Means {
    red: f32,
    green: f32,
    blue: f32,
    alpha: f32,
    coc_px: f32,
}

// The pyramid that is filled, or copied from. Its coarser level is read.
@group(0) @binding(8) var<uniform> filled: Step;
@group(0) @binding(9) var<storage, read_write> filled_levels: array<f32>;
@group(0) @binding(10) var<uniform> means: Means;
// Sums as [channel][part].
@group(0) @binding(11) var<storage, read_write> totals: array<f32>;

// The program sets BEST_QUARTER, and PART_VALUES, the number of values that a workgroup of PART_THREADS threads sums.

// Index of a sample of the coarser level of the filled pyramid.
fn filled_index(channel: i32, x: i32, y: i32) -> i32 {
    let row = channel * filled.coarse_rows + y - filled.coarse_first;
    return filled.coarse_start + row * filled.coarse_width + x;
}

// Factor that raises the known share of samples to what their best known quarter could give.
fn raise(known: vec4f) -> vec4f {
    return 1.0 / max(known, vec4f(BEST_QUARTER));
}

// The kept part of a sample of level 0: content; CoC radius and the kept share.
fn known_sample(x: i32, y: i32) -> Sample {
    let index = source_index(x, y);
    let coc_px = visible_coc_px(index);
    let kept = not_nearer_weight(coc_px);
    return Sample(kept * visible_content(index), kept * vec2f(coc_px, 1.0));
}

fn known_pair(x: i32, y: i32) -> Pair {
    return pair_of(
        known_sample(x, y),
        known_sample(x + 1, y),
        known_sample(x + 2, y),
        known_sample(x + 3, y),
        known_sample(x + 4, y),
        known_sample(x + 5, y),
    );
}

@compute @workgroup_size(16, 16)
fn pull_first(@builtin(global_invocation_id) at: vec3u) {
    let x = 2 * i32(at.x);
    let y = 2 * i32(at.y) + level.from_row;
    if x >= level.coarse_width || y >= level.to_row {
        return;
    }
    let left = 2 * x - 1;
    let top = 2 * y - 1;
    let c = known_pair(left, top + 2);
    let d = known_pair(left, top + 3);
    let upper = four_rows(known_pair(left, top), known_pair(left, top + 1), c, d);
    let lower = four_rows(c, d, known_pair(left, top + 4), known_pair(left, top + 5));
    let block = block_of(upper, lower);
    let raised = raise(block.rest[1]);
    let content = block.content;
    set_content(x, y, mat4x4f(raised * content[0], raised * content[1], raised * content[2], raised * content[3]));
    set_coarse(frame.channels, x, y, raised * block.rest[0]);
    set_coarse(frame.channels + 1, x, y, raised * block.rest[1]);
}

@compute @workgroup_size(16, 16)
fn pull(@builtin(global_invocation_id) at: vec3u) {
    let x = 2 * i32(at.x);
    let y = 2 * i32(at.y) + level.from_row;
    if x >= level.coarse_width || y >= level.to_row {
        return;
    }
    let known = reduced(frame.channels + 1, x, y);
    let raised = raise(known);
    for (var channel = 0; channel <= frame.channels; channel++) {
        set_coarse(channel, x, y, raised * reduced(channel, x, y));
    }
    set_coarse(frame.channels + 1, x, y, raised * known);
}

@compute @workgroup_size(16, 16)
fn copy(@builtin(global_invocation_id) at: vec3u) {
    let x = i32(at.x);
    // One of the two may have fewer rows.
    let y = i32(at.y) + max(level.from_row, filled.from_row);
    if x < level.coarse_width && y < min(level.to_row, filled.to_row) {
        levels[coarse_index(i32(at.z), x, y)] = filled_levels[filled_index(i32(at.z), x, y)];
    }
}

var<workgroup> sums: array<f32, PART_THREADS>;

@compute @workgroup_size(PART_THREADS)
fn total(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32
) {
    let values = u32(level.coarse_rows * level.coarse_width);
    let start = u32(level.coarse_start) + group.y * values;
    let end = min((group.x + 1u) * PART_VALUES, values);
    var sum = 0.0;
    for (var k = group.x * PART_VALUES + local; k < end; k += PART_THREADS) {
        sum += levels[start + k];
    }
    sums[local] = sum;
    for (var half = PART_THREADS / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half {
            sums[local] += sums[local + half];
        }
    }
    if local == 0u {
        totals[group.y * groups.x + group.x] = sums[0];
    }
}

@compute @workgroup_size(16, 16)
fn fill(@builtin(global_invocation_id) at: vec3u) {
    let x = i32(at.x);
    let y = i32(at.y) + level.from_row;
    if x >= level.coarse_width || y >= level.to_row {
        return;
    }
    let unknown = 1.0 - levels[coarse_index(frame.channels + 1, x, y)];
    let content = vec4f(means.red, means.green, means.blue, means.alpha);
    for (var channel = 0; channel < frame.channels; channel++) {
        levels[coarse_index(channel, x, y)] += unknown * content[channel];
    }
    levels[coarse_index(frame.channels, x, y)] += unknown * means.coc_px;
}

@compute @workgroup_size(16, 16)
fn push(@builtin(global_invocation_id) at: vec3u) {
    let corner = fine_corner(at);
    let channel = i32(at.z);
    let four = fine_four(corner);
    if !any(four.makes) {
        return;
    }
    let values = expanded(channel, corners(corner));
    for (var k = 0; k < 4; k++) {
        if four.makes[k] {
            let unknown = 1.0 - levels[fine_index(frame.channels + 1, four.x[k], four.y[k])];
            levels[fine_index(channel, four.x[k], four.y[k])] += unknown * values[k];
        }
    }
}

// Four samples around a corner, expanded from the filled pyramid.
fn filled_four(channel: i32, at: Corners) -> vec4f {
    let index = at.index + channel * filled.coarse_rows * filled.coarse_width;
    return interpolated(
        vec4f(filled_levels[index.x], filled_levels[index.y], filled_levels[index.z], filled_levels[index.w])
    );
}

// A sample of the filled picture, matted for the sub-image: content and alpha. `behind` and its CoC radius fill the share that is
// not kept.
fn matted(source: i32, behind: vec4f, behind_coc_px: f32) -> Sample {
    let own_coc_px = visible_coc_px(source);
    let kept = not_nearer_weight(own_coc_px);
    let weight = matting_weight(kept * own_coc_px + (1.0 - kept) * behind_coc_px);
    let content = kept * visible_content(source) + (1.0 - kept) * behind;
    return Sample(weight * content, vec2f(weight, 0.0));
}

// Four samples around a corner.
struct Samples {
    left_above: Sample,
    right_above: Sample,
    left_below: Sample,
    right_below: Sample,
}

// The matted samples around `corner`, whose pixels have the indices `source`.
fn matted_four(corner: vec2i, source: vec4i) -> Samples {
    let around = corners_of(filled, corner);
    var alpha = vec4f(0.0);
    if frame.channels > 3 {
        alpha = filled_four(3, around);
    }
    let content =
        transpose(mat4x4f(filled_four(0, around), filled_four(1, around), filled_four(2, around), alpha));
    let coc_px = filled_four(frame.channels, around);
    return Samples(
        matted(source.x, content[0], coc_px.x),
        matted(source.y, content[1], coc_px.y),
        matted(source.z, content[2], coc_px.z),
        matted(source.w, content[3], coc_px.w),
    );
}

fn matted_at(corner: vec2i) -> Samples {
    let x = 2 * corner.x;
    let y = 2 * corner.y;
    let above = vec2i(source_index(x - 1, y - 1), source_index(x, y - 1));
    let below = vec2i(source_index(x - 1, y), source_index(x, y));
    return matted_four(corner, vec4i(above, below));
}

// The contributions of two rows to two coarse samples.
struct TwoRows {
    above: Pair,
    below: Pair,
}

fn matted_rows(column: i32, row: i32) -> TwoRows {
    let a = matted_at(vec2i(column, row));
    let b = matted_at(vec2i(column + 1, row));
    let c = matted_at(vec2i(column + 2, row));
    return TwoRows(
        pair_of(a.left_above, a.right_above, b.left_above, b.right_above, c.left_above, c.right_above),
        pair_of(a.left_below, a.right_below, b.left_below, b.right_below, c.left_below, c.right_below),
    );
}

@compute @workgroup_size(16, 16)
fn matte(@builtin(global_invocation_id) at: vec3u) {
    let x = 2 * i32(at.x);
    let y = 2 * i32(at.y) + level.from_row;
    if x >= level.coarse_width || y >= level.to_row {
        return;
    }
    let first = matted_rows(x, y);
    let second = matted_rows(x, y + 1);
    let third = matted_rows(x, y + 2);
    let upper = four_rows(first.above, first.below, second.above, second.below);
    let lower = four_rows(second.above, second.below, third.above, third.below);
    let block = block_of(upper, lower);
    set_content(x, y, block.content);
    set_coarse(frame.channels, x, y, block.rest[0]);
}

@compute @workgroup_size(16, 16)
fn expand(@builtin(global_invocation_id) at: vec3u) {
    let corner = fine_corner(at);
    let channel = i32(at.z);
    let four = fine_four(corner);
    if !any(four.makes) {
        return;
    }
    let values = expanded(channel, corners(corner));
    for (var k = 0; k < 4; k++) {
        if four.makes[k] {
            levels[fine_index(channel, four.x[k], four.y[k])] = values[k];
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
    let around = corners(corner);
    let alpha = expanded(frame.channels, around);
    let front = expanded_content(around);
    for (var k = 0; k < 4; k++) {
        if four.makes[k] {
            lay_over(four.y[k] * frame.width + four.x[k], Pixel(front[k], alpha[k]));
        }
    }
}

@compute @workgroup_size(16, 16)
fn composite_in_focus(@builtin(global_invocation_id) at: vec3u) {
    let corner = frame_corner(at);
    let four = frame_four(corner);
    if !any(four.makes) {
        return;
    }
    let index = select(vec4i(0), four.y * frame.width + four.x, four.makes);
    let samples = matted_four(corner, index + (frame.made_first - frame.source_first) * frame.width);
    composite_sample(four.makes.x, index.x, samples.left_above);
    composite_sample(four.makes.y, index.y, samples.right_above);
    composite_sample(four.makes.z, index.z, samples.left_below);
    composite_sample(four.makes.w, index.w, samples.right_below);
}

fn composite_sample(exists: bool, index: i32, front: Sample) {
    if exists {
        lay_over(index, Pixel(front.content, front.rest.x));
    }
}
