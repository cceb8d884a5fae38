// Image pyramids: analysis and B-spline synthesis between two levels, for a band of rows.
// CPU version: src/methods/shared/pyramid/mod.rs. Comes after coverage_planes.wgsl.
//
// Each thread computes 2 × 2 samples, which share most of their inputs.
//
// Levels 1 and up are in one buffer, each as [channel][row][column] from `start` on; rows are stored from `first` on.
// Level 0 is not stored: its samples are pixels of the frame, at source_index.
//
// reduce: computes a level from the next finer one.

struct Step {
    fine_width: i32,
    fine_height: i32,
    fine_first: i32,
    fine_rows: i32,
    fine_start: i32,
    coarse_width: i32,
    coarse_height: i32,
    coarse_first: i32,
    coarse_rows: i32,
    coarse_start: i32,
    from_row: i32,
    to_row: i32,
    repeats: u32,
    outer: f32,
    inner: f32,
}

@group(0) @binding(0) var<uniform> level: Step;
@group(0) @binding(1) var<storage, read_write> levels: array<f32>;

// Index in a plane of the source of the sample at a column and a row of level 0; -1 past a clear border.
fn source_index(x: i32, y: i32) -> i32 {
    let column = x - frame.origin_x;
    let row = y - frame.origin_y;
    let inside = column >= 0 && column < frame.width && row >= 0 && row < frame.height;
    if !inside && level.repeats == 0u {
        return -1;
    }
    // Rows that were not read contribute to no sample of the band, so any row may stand in for them.
    let kept_row = clamp(clamp(row, 0, frame.height - 1) - frame.source_first, 0, frame.source_rows - 1);
    return kept_row * frame.width + clamp(column, 0, frame.width - 1);
}

fn coarse_index(channel: i32, x: i32, y: i32) -> i32 {
    let row = channel * level.coarse_rows + y - level.coarse_first;
    return level.coarse_start + row * level.coarse_width + x;
}

fn fine_index(channel: i32, x: i32, y: i32) -> i32 {
    let row = channel * level.fine_rows + y - level.fine_first;
    return level.fine_start + row * level.fine_width + x;
}

// The two coarse samples among six fine samples in a row.
fn analyzed_pair(left: vec3f, right: vec3f) -> vec2f {
    return vec2f(
        level.inner * (left.y + left.z) + level.outer * (left.x + right.x),
        level.inner * (right.x + right.y) + level.outer * (left.z + right.z),
    );
}

fn fine_sample(channel: i32, x: i32, y: i32) -> f32 {
    let inside = x >= 0 && x < level.fine_width && y >= 0 && y < level.fine_height;
    if !inside && level.repeats == 0u {
        return 0.0;
    }
    let row = clamp(y, 0, level.fine_height - 1);
    // Rows that are not stored contribute to no sample of the band, so any row may stand in for them.
    let kept_row = clamp(row, level.fine_first, level.fine_first + level.fine_rows - 1);
    return levels[fine_index(channel, clamp(x, 0, level.fine_width - 1), kept_row)];
}

fn fine_pair(channel: i32, x: i32, y: i32) -> vec2f {
    return analyzed_pair(
        vec3f(fine_sample(channel, x, y), fine_sample(channel, x + 1, y), fine_sample(channel, x + 2, y)),
        vec3f(fine_sample(channel, x + 3, y), fine_sample(channel, x + 4, y), fine_sample(channel, x + 5, y)),
    );
}

// The coarse samples around a corner: their indices in channel 0, and whether they exist.
struct Corners {
    index: vec4i,
    exists: vec4<bool>,
}

// The corner, in fine samples, around which a thread computes four of them.
fn fine_corner(at: vec3u) -> vec2i {
    return vec2i(i32(at.x), i32(at.y) + (level.from_row + 1) / 2);
}

// The same in level 0, for the rows that a band makes.
fn frame_corner(at: vec3u) -> vec2i {
    return vec2i(at.xy) + (vec2i(frame.origin_x, frame.made_first + frame.origin_y) + 1) / 2;
}

// The coarse samples at columns `corner.x - 1` and `corner.x` of row `corner.y - 1`, then those of row `corner.y`.
fn corners(corner: vec2i) -> Corners {
    return corners_of(level, corner);
}

// The same of the coarser level of `step`.
fn corners_of(step: Step, corner: vec2i) -> Corners {
    let x = corner.x + vec4i(-1, 0, -1, 0);
    let y = corner.y + vec4i(-1, -1, 0, 0);
    let width = vec4i(step.coarse_width);
    let height = vec4i(step.coarse_height);
    let inside = (x >= vec4i(0)) & (x < width) & (y >= vec4i(0)) & (y < height);
    let kept_x = clamp(x, vec4i(0), width - 1);
    let first = vec4i(step.coarse_first);
    let kept_y = clamp(clamp(y, vec4i(0), height - 1), first, first + step.coarse_rows - 1) - first;
    return Corners(step.coarse_start + kept_y * width + kept_x, inside | vec4<bool>(step.repeats == 1u));
}

// Biquadratic interpolation of the coarse samples around a corner: weights 3/4 for the nearest and 1/4 for the next, along each
// axis.
fn interpolated(coarse: vec4f) -> vec4f {
    let blend = 0.75 * coarse + 0.25 * coarse.zwxy;
    return 0.75 * blend + 0.25 * blend.yxwz;
}

// The finer level's samples around a corner: at columns `2 x - 1` and `2 x` of row `2 y - 1`, then those of row `2 y`.
fn expanded(channel: i32, at: Corners) -> vec4f {
    let index = at.index + channel * level.coarse_rows * level.coarse_width;
    let found = vec4f(levels[index.x], levels[index.y], levels[index.z], levels[index.w]);
    return interpolated(select(vec4f(0.0), found, at.exists));
}

// Four samples around a corner: their positions, and which of them the pass makes.
struct Four {
    x: vec4i,
    y: vec4i,
    makes: vec4<bool>,
}

// Those of the finer level.
fn fine_four(corner: vec2i) -> Four {
    let x = 2 * corner.x + vec4i(-1, 0, -1, 0);
    let y = 2 * corner.y + vec4i(-1, -1, 0, 0);
    let makes = (x >= vec4i(0)) & (x < vec4i(level.fine_width)) & (y >= vec4i(level.from_row)) & (y < vec4i(level.to_row));
    return Four(x, y, makes);
}

// Those of level 0, as pixels of the rows that a band makes.
fn frame_four(corner: vec2i) -> Four {
    let x = 2 * corner.x + vec4i(-1, 0, -1, 0) - frame.origin_x;
    let y = 2 * corner.y + vec4i(-1, -1, 0, 0) - frame.origin_y - frame.made_first;
    let makes = (x >= vec4i(0)) & (x < vec4i(frame.width)) & (y >= vec4i(0)) & (y < vec4i(frame.made_rows));
    return Four(x, y, makes);
}

// The content of four samples of the finer level, one column per sample.
fn expanded_content(at: Corners) -> mat4x4f {
    var alpha = vec4f(0.0);
    if frame.channels > 3 {
        alpha = expanded(3, at);
    }
    return transpose(mat4x4f(expanded(0, at), expanded(1, at), expanded(2, at), alpha));
}

// 2 × 2 coarse samples, from column x of row y on.
fn reduced(channel: i32, x: i32, y: i32) -> vec4f {
    let left = 2 * x - 1;
    let top = 2 * y - 1;
    let c = fine_pair(channel, left, top + 2);
    let d = fine_pair(channel, left, top + 3);
    let upper = level.outer * (fine_pair(channel, left, top) + d) + level.inner * (fine_pair(channel, left, top + 1) + c);
    let lower = level.outer * (c + fine_pair(channel, left, top + 5)) + level.inner * (d + fine_pair(channel, left, top + 4));
    return vec4f(upper, lower);
}

@compute @workgroup_size(16, 16)
fn reduce(@builtin(global_invocation_id) at: vec3u) {
    let x = 2 * i32(at.x);
    let y = 2 * i32(at.y) + level.from_row;
    if x < level.coarse_width && y < level.to_row {
        set_coarse(i32(at.z), x, y, reduced(i32(at.z), x, y));
    }
}

// Stores 2 × 2 coarse samples from column x of row y on, without those outside the level or the pass's rows.
fn set_coarse(channel: i32, x: i32, y: i32, value: vec4f) {
    let index = coarse_index(channel, x, y);
    let second = x + 1 < level.coarse_width;
    levels[index] = value.x;
    if second {
        levels[index + 1] = value.y;
    }
    if y + 1 < level.to_row {
        levels[index + level.coarse_width] = value.z;
        if second {
            levels[index + level.coarse_width + 1] = value.w;
        }
    }
}
