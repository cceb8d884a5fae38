// Image pyramids: analysis and B-spline synthesis between two levels, for a band of rows.
// CPU twin: src/methods/shared/pyramid/mod.rs. Sums are taken in its order.
//
// Levels 1 and up lie in one buffer, each as [channel][row][column] from `start` on, of which the rows from `first` on are kept.
// Level 0 is not stored: its samples are pixels of the frame, at source_index.
//
// reduce: a level from the finer one.

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

@group(0) @binding(0) var<uniform> level: Step;
@group(0) @binding(1) var<storage, read_write> levels: array<f32>;
@group(0) @binding(2) var<uniform> frame: Frame;

// Where a plane of the source has the sample at a column and a row of level 0; -1 past a clear border.
fn source_index(x: i32, y: i32) -> i32 {
    let column = x - frame.origin_x;
    let row = y - frame.origin_y;
    let inside = column >= 0 && column < frame.width && row >= 0 && row < frame.height;
    if !inside && level.repeats == 0u {
        return -1;
    }
    let kept_row = clamp(row, 0, frame.height - 1) - frame.source_first;
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

// A coarse sample of the four rows of four fine ones around it.
fn analysed(a: vec4f, b: vec4f, c: vec4f, d: vec4f) -> f32 {
    let sums = level.outer * (a + d) + level.inner * (b + c);
    return level.inner * (sums.y + sums.z) + level.outer * (sums.x + sums.w);
}

fn fine_sample(channel: i32, x: i32, y: i32) -> f32 {
    let inside = x >= 0 && x < level.fine_width && y >= 0 && y < level.fine_height;
    if !inside && level.repeats == 0u {
        return 0.0;
    }
    return levels[fine_index(channel, clamp(x, 0, level.fine_width - 1), clamp(y, 0, level.fine_height - 1))];
}

fn fine_row(channel: i32, x: i32, y: i32) -> vec4f {
    return vec4f(
        fine_sample(channel, x, y),
        fine_sample(channel, x + 1, y),
        fine_sample(channel, x + 2, y),
        fine_sample(channel, x + 3, y),
    );
}

fn coarse_sample(channel: i32, x: i32, y: i32) -> f32 {
    let inside = x >= 0 && x < level.coarse_width && y >= 0 && y < level.coarse_height;
    if !inside && level.repeats == 0u {
        return 0.0;
    }
    return levels[coarse_index(channel, clamp(x, 0, level.coarse_width - 1), clamp(y, 0, level.coarse_height - 1))];
}

// A sample of the finer level by biquadratic interpolation of the coarser one: 3/4 of the nearest, 1/4 of the next, either way.
fn expanded(channel: i32, x: i32, y: i32) -> f32 {
    let near = vec2i(min(x / 2, level.coarse_width - 1), min(y / 2, level.coarse_height - 1));
    let next = near + select(vec2i(-1), vec2i(1), (vec2i(x, y) & vec2i(1)) == vec2i(1));
    let nearest = 0.75 * coarse_sample(channel, near.x, near.y) + 0.25 * coarse_sample(channel, near.x, next.y);
    let beside = 0.75 * coarse_sample(channel, next.x, near.y) + 0.25 * coarse_sample(channel, next.x, next.y);
    return 0.75 * nearest + 0.25 * beside;
}

@compute @workgroup_size(16, 16)
fn reduce(@builtin(global_invocation_id) at: vec3u) {
    let x = i32(at.x);
    let y = i32(at.y) + level.from_row;
    let channel = i32(at.z);
    if x >= level.coarse_width || y >= level.to_row {
        return;
    }
    let left = 2 * x - 1;
    let top = 2 * y - 1;
    levels[coarse_index(channel, x, y)] = analysed(
        fine_row(channel, left, top),
        fine_row(channel, left, top + 1),
        fine_row(channel, left, top + 2),
        fine_row(channel, left, top + 3),
    );
}
