// A-buffer and B-buffers (2003): contributions are splatted into two pyramids, in front of and behind focus, at the level of
// their blur. CPU version: src/methods/published/b_buffer/.
// Concatenated after coverage_planes.wgsl, other_coverage_planes.wgsl, pyramid.wgsl, first_level.wgsl.
//
// Channels of a pyramid: content, occupancy and, behind focus, the occupancy that the same contributions have in the next finer
// level. One pyramid buffer serves all levels of a field, the coarsest first: the contributions of level n are splatted to level
// 1, reduced to level n, and combined with level n + 1, which is complete by then.
//
// The other coverage planes hold sums. While peels are culled, their colours hold the CoC radius of the last opaque contribution
// and the transmittance since then.
//
// cull:               removes from a peel the contributions that the A-buffer does not need.
// clear:              sets level 1 to zero.
// splat:              adds the contributions of a peel that go to a level to level 1.
// saturate_top:       scales the coarsest level to an occupancy of at most one.
// combine_level:      combines a level with the expanded coarser one.
// clear_sums:         sets the sums to zero.
// gather:             adds the contributions of a peel that go to level 0 to the sums.
// composite_field:    composites the sums, combined with the expanded level 1, over the result.
// composite_in_focus: composites the contributions of a peel that are in focus over the result.

struct LevelWeights {
    sign: f32,
    in_focus_px: f32,
    rise_start_px2: f32,
    rise_slope: f32,
    fall_end_px2: f32,
    fall_slope: f32,
    peak_px2: f32,
    has_coarser: u32,
}

struct PeelUniform {
    is_nearest: u32,
    first_row: i32,
    same_surface_px: f32,
    in_focus_px: f32,
}

@group(0) @binding(3) var<uniform> level_weights: LevelWeights;
// The peel as [plane][row][column]: red, green and blue; coverage and signed CoC radius in pixels.
@group(0) @binding(4) var<storage, read_write> peel_colors: array<f32>;
@group(0) @binding(5) var<storage, read_write> peel_rest: array<f32>;
@group(0) @binding(10) var<uniform> peel: PeelUniform;

// The program sets OPAQUE_ALPHA and LEVEL_SHARE.

// Signed CoC radius in pixels of no surface: nearer than every real one.
const NO_SURFACE_PX: f32 = -3e38;

// The kept share of the next contribution of a pixel. Negative transmittance in front of focus marks a pixel that is occluded:
// every farther contribution is culled.
fn keep(index: i32, alpha: f32, coc_px: f32) -> f32 {
    let plane = source_plane();
    var surface_px = NO_SURFACE_PX;
    var transmittance = vec2f(1.0);
    if peel.is_nearest == 0u {
        surface_px = other_colors[index];
        transmittance = vec2f(other_colors[plane + index], other_colors[2 * plane + index]);
    }
    let same_px = max(peel.same_surface_px, LEVEL_SHARE * abs(surface_px));
    let drops = alpha <= 0.0 || transmittance.x < 0.0 || abs(coc_px - surface_px) < same_px;
    let behind = coc_px > 0.0;
    let share = select(transmittance.x, transmittance.y, behind);
    if !drops && alpha >= OPAQUE_ALPHA {
        surface_px = coc_px;
        transmittance = vec2f(select(1.0, -1.0, behind), 1.0);
    } else if !drops {
        transmittance *= select(vec2f(1.0 - alpha, 1.0), vec2f(1.0, 1.0 - alpha), behind);
    }
    other_colors[index] = surface_px;
    other_colors[plane + index] = transmittance.x;
    other_colors[2 * plane + index] = transmittance.y;
    return select(share, 0.0, drops);
}

@compute @workgroup_size(16, 16)
fn cull(@builtin(global_invocation_id) at: vec3u) {
    if i32(at.x) >= frame.width || i32(at.y) >= frame.source_rows {
        return;
    }
    let plane = source_plane();
    let index = i32(at.y) * frame.width + i32(at.x);
    let kept = keep(index, peel_rest[index], peel_rest[plane + index]);
    peel_rest[index] *= kept;
    for (var k = 0; k < 3; k++) {
        peel_colors[k * plane + index] *= kept;
    }
}

// Share of contributions of CoC radius `coc_px` that goes to the current level.
fn weight_of(coc_px: f32) -> f32 {
    let squared_px2 = coc_px * coc_px;
    let rise = clamp((squared_px2 - level_weights.rise_start_px2) * level_weights.rise_slope, 0.0, 1.0);
    let fall = clamp((level_weights.fall_end_px2 - squared_px2) * level_weights.fall_slope, 0.0, 1.0);
    return select(0.0, min(rise, fall), level_weights.sign * coc_px > level_weights.in_focus_px);
}

// A weighted contribution: content, and occupancy in this level and in the next finer one.
fn contribution(index: i32) -> Sample {
    let plane = source_plane();
    let coc_px = peel_rest[plane + index];
    let coverage = peel_rest[index];
    let weight = weight_of(coc_px);
    let in_finer = select(0.0, 1.0 - weight, weight > 0.0 && coc_px * coc_px < level_weights.peak_px2);
    let colors = vec3f(peel_colors[index], peel_colors[plane + index], peel_colors[2 * plane + index]);
    return Sample(weight * vec4f(colors, 0.0), coverage * vec2f(weight, in_finer));
}

fn contributed_pair(x: i32, y: i32) -> Pair {
    return pair_of(
        contribution(source_index(x, y)),
        contribution(source_index(x + 1, y)),
        contribution(source_index(x + 2, y)),
        contribution(source_index(x + 3, y)),
        contribution(source_index(x + 4, y)),
        contribution(source_index(x + 5, y)),
    );
}

@compute @workgroup_size(16, 16)
fn clear(@builtin(global_invocation_id) at: vec3u) {
    let x = 2 * i32(at.x);
    let y = 2 * i32(at.y) + level.from_row;
    if x < level.coarse_width && y < level.to_row {
        set_coarse(i32(at.z), x, y, vec4f(0.0));
    }
}

fn add_coarse(channel: i32, x: i32, y: i32, value: vec4f) {
    let index = coarse_index(channel, x, y);
    // Samples past the last column or row are not set.
    let right = select(0, 1, x + 1 < level.coarse_width);
    let below = select(0, level.coarse_width, y + 1 < level.to_row);
    let before = vec4f(levels[index], levels[index + right], levels[index + below], levels[index + below + right]);
    set_coarse(channel, x, y, before + value);
}

@compute @workgroup_size(16, 16)
fn splat(@builtin(global_invocation_id) at: vec3u) {
    let x = 2 * i32(at.x);
    let y = 2 * i32(at.y) + level.from_row;
    if x >= level.coarse_width || y >= level.to_row {
        return;
    }
    let left = 2 * x - 1;
    let top = 2 * y - 1;
    let c = contributed_pair(left, top + 2);
    let d = contributed_pair(left, top + 3);
    let upper = four_rows(contributed_pair(left, top), contributed_pair(left, top + 1), c, d);
    let lower = four_rows(c, d, contributed_pair(left, top + 4), contributed_pair(left, top + 5));
    let block = block_of(upper, lower);
    for (var k = 0; k < 3; k++) {
        add_coarse(k, x, y, block.content[k]);
    }
    add_coarse(frame.channels, x, y, block.rest[0]);
    if level_weights.sign > 0.0 {
        add_coarse(frame.channels + 1, x, y, block.rest[1]);
    }
}

@compute @workgroup_size(16, 16)
fn saturate_top(@builtin(global_invocation_id) at: vec3u) {
    let x = i32(at.x);
    let y = i32(at.y) + level.from_row;
    if x >= level.coarse_width || y >= level.to_row {
        return;
    }
    let occupancy = max(levels[coarse_index(frame.channels, x, y)], 1.0);
    for (var k = 0; k <= frame.channels; k++) {
        levels[coarse_index(k, x, y)] /= occupancy;
    }
}

// The share of `value` that fits into the `remaining` occupancy.
fn share_of(value: vec4f, remaining: vec4f) -> vec4f {
    let limit = max(remaining, vec4f(0.0));
    let exceeds = value > limit;
    return select(vec4f(1.0), limit / select(vec4f(1.0), value, exceeds), exceeds);
}

// The kept shares of a level itself and of the expanded coarser one.
struct Shares {
    own: vec4f,
    coarser: vec4f,
}

fn shares(own: vec4f, in_finer: vec4f, coarser: vec4f) -> Shares {
    if level_weights.sign > 0.0 {
        let kept = share_of(own, vec4f(1.0));
        return Shares(kept, share_of(coarser, 1.0 - own * kept - in_finer));
    }
    return Shares(share_of(own, 1.0 - coarser), vec4f(1.0));
}

// Four samples of the finer level. Indices of samples that do not exist are replaced by that of the first sample.
fn fine_samples(channel: i32, index: vec4i) -> vec4f {
    let at = index + channel * level.fine_rows * level.fine_width;
    return vec4f(levels[at.x], levels[at.y], levels[at.z], levels[at.w]);
}

@compute @workgroup_size(16, 16)
fn combine_level(@builtin(global_invocation_id) at: vec3u) {
    let corner = fine_corner(at);
    let four = fine_four(corner);
    if !any(four.makes) {
        return;
    }
    let indices = level.fine_start + (four.y - level.fine_first) * level.fine_width + four.x;
    let index = select(vec4i(level.fine_start), indices, four.makes);
    let around = corners(corner);
    let in_finer = select(vec4f(0.0), fine_samples(frame.channels + 1, index), level_weights.sign > 0.0);
    let share = shares(fine_samples(frame.channels, index), in_finer, expanded(frame.channels, around));
    for (var channel = 0; channel <= frame.channels; channel++) {
        let combined = share.own * fine_samples(channel, index) + share.coarser * expanded(channel, around);
        for (var k = 0; k < 4; k++) {
            if four.makes[k] {
                levels[index[k] + channel * level.fine_rows * level.fine_width] = combined[k];
            }
        }
    }
}

@compute @workgroup_size(16, 16)
fn clear_sums(@builtin(global_invocation_id) at: vec3u) {
    if i32(at.x) < frame.width && i32(at.y) < frame.source_rows {
        set_other_pixel(i32(at.y) * frame.width + i32(at.x), Pixel(vec4f(0.0), 0.0));
    }
}

@compute @workgroup_size(16, 16)
fn gather(@builtin(global_invocation_id) at: vec3u) {
    let row = i32(at.y) + peel.first_row - frame.source_first;
    if i32(at.x) >= frame.width || row >= frame.source_rows {
        return;
    }
    let index = row * frame.width + i32(at.x);
    let own = contribution(index);
    let sum = other_pixel(index);
    set_other_pixel(index, Pixel(sum.content + own.content, sum.coverage + own.rest.x));
}

@compute @workgroup_size(16, 16)
fn composite_field(@builtin(global_invocation_id) at: vec3u) {
    let corner = frame_corner(at);
    let four = frame_four(corner);
    if !any(four.makes) {
        return;
    }
    let index = select(vec4i(0), four.y * frame.width + four.x, four.makes);
    let source = index + (frame.made_first - frame.source_first) * frame.width;
    let around = corners(corner);
    let has_coarser = level_weights.has_coarser == 1u;
    let coarser = select(vec4f(0.0), expanded(frame.channels, around), has_coarser);
    let a = other_pixel(source.x);
    let b = other_pixel(source.y);
    let c = other_pixel(source.z);
    let d = other_pixel(source.w);
    let own = vec4f(a.coverage, b.coverage, c.coverage, d.coverage);
    let own_content = mat4x4f(a.content, b.content, c.content, d.content);
    let share = shares(own, vec4f(0.0), coarser);
    let occupancy = share.own * own + share.coarser * coarser;
    // Without coarser levels the values read here are not used.
    let content = expanded_content(around);
    for (var k = 0; k < 4; k++) {
        if four.makes[k] {
            let coarser_content = select(vec4f(0.0), content[k], has_coarser);
            lay_over(index[k], Pixel(share.own[k] * own_content[k] + share.coarser[k] * coarser_content, occupancy[k]));
        }
    }
}

@compute @workgroup_size(16, 16)
fn composite_in_focus(@builtin(global_invocation_id) at: vec3u) {
    let row = i32(at.y) + peel.first_row - frame.made_first;
    if i32(at.x) >= frame.width || row >= frame.made_rows {
        return;
    }
    let plane = source_plane();
    let source = (row + frame.made_first - frame.source_first) * frame.width + i32(at.x);
    if abs(peel_rest[plane + source]) > peel.in_focus_px {
        return;
    }
    let index = row * frame.width + i32(at.x);
    let coverage = peel_rest[source];
    let colors = vec3f(peel_colors[source], peel_colors[plane + source], peel_colors[2 * plane + source]);
    lay_over(index, Pixel(vec4f(colors, 0.0), coverage));
}
