// `point-splat`: points scattered as sprites into three layers of each pixel, Lee, Kim & Choi 2008.
//
// Twin of src/methods/point_splat/splat.rs and layers.rs. There points are scattered; here a thread gathers what reaches its two
// neighbouring pixels, since sums must not depend on the order of threads. Points lie in blocks, row by row of blocks, and a
// workgroup walks those of its region's window that reach its tile, in their order. A sprite's weights come from a table. A point at
// the frame's border stands for its repetitions past it.
//
// splat: pixels of a strip of rows, from blocks of points.

struct Params {
    // Of the picture, in pixels.
    width: i32,
    height: i32,
    // Picture row of the first row of blocks.
    source_row: i32,
    // Picture rows that the band makes: the first, and how many.
    band_row: i32,
    band_rows: i32,
    // First row of the strip, from the band's first.
    strip_row: i32,
    // Blocks and regions beside one another.
    blocks_across: u32,
    regions_across: i32,
    // Planes of content: 3, or 4 with alpha.
    channels: u32,
    // Pixels along the sides of a block and of a region.
    block: i32,
    region: i32,
}

@group(0) @binding(0) var<uniform> params: Params;
// A point's content: red, green, blue and, where the background is open, alpha; premultiplied.
@group(0) @binding(1) var<storage, read> lights: array<vec4f>;
// Bits of a point's CoC radius and of its alpha, the weight of its own pixel, and what `point` unpacks.
@group(0) @binding(2) var<storage, read> shapes: array<vec4u>;
// A block's first point, and their number (8 bits) below how far they reach in pixels.
@group(0) @binding(3) var<storage, read> blocks: array<vec2u>;
// For each region the blocks that may reach it: first and past-the-last column, first and past-the-last row.
@group(0) @binding(4) var<storage, read> windows: array<vec4u>;
// Sprites of CoC radii over 0, row by row: see `weight`.
@group(0) @binding(5) var<storage, read> weights: array<f32>;
// Least and greatest CoC radius of the same-depth layer, [row of the band][column].
@group(0) @binding(6) var<storage, read> bounds: array<vec2f>;
// [channel][row of the band][column]
@group(0) @binding(7) var<storage, read_write> picture: array<f32>;

const TILE = vec2i(8, 8);
const PIXELS_A_THREAD = 2;

// What arrived in one layer of two neighbouring pixels.
struct Sum {
    red: vec2f,
    green: vec2f,
    blue: vec2f,
    opacity: vec2f,
    alpha: vec2f,
}

// In front of what is visible, at its depth, behind it.
struct Layers {
    front: Sum,
    same: Sum,
    behind: Sum,
}

// A point's place and blur.
struct Point {
    at: vec2i,
    coc_px: f32,
    alpha: f32,
    is_hidden: bool,
    // Index of the weight of the point's own pixel, and of a row's weights.
    weight: i32,
    stride: i32,
    // 0 about a pixel, 1 about the corner of four.
    corner: i32,
    is_turned: bool,
    // Offsets of the first and the last pixel that it reaches.
    low: vec2i,
    high: vec2i,
    // Whether it is repeated to the left and above, and to the right and below.
    is_first: vec2<bool>,
    is_last: vec2<bool>,
}

fn point(shape: vec4u, origin: vec2i) -> Point {
    var point: Point;
    let packed = shape.w;
    point.at = origin + vec2i(vec2u(packed, packed >> 2) & vec2u(3));
    point.coc_px = bitcast<f32>(shape.x);
    point.alpha = bitcast<f32>(shape.y);
    point.weight = i32(shape.z);
    point.corner = i32((packed >> 4) & 1);
    point.is_hidden = (packed & 32) != 0;
    point.is_turned = (packed & 64) != 0;
    let reach = i32(packed >> 7);
    // Past one picture off, repetitions tell nothing new.
    let across = min(reach, params.width);
    let down = min(reach + point.corner, params.height);
    point.stride = 2 * across + 2;
    point.low = vec2i(-across, -down);
    point.high = vec2i(across + 1, down);
    point.is_first = point.at == vec2i(0);
    point.is_last = point.at + 1 + point.corner == vec2i(params.width, params.height);
    return point;
}

// Weight of a sprite at `offset` from its pixel, or the upper left one of four.
fn tabled(point: Point, offset: vec2i) -> f32 {
    let turned = select(offset, point.corner - offset, point.is_turned);
    return weights[point.weight + turned.y * point.stride + turned.x];
}

// Weight of a point and its repetitions at `offset` from it.
fn weight(point: Point, offset: vec2i) -> f32 {
    if any(offset < point.low) || any(offset > point.high) {
        return 0.0;
    }
    let halving = vec2u(u32(point.corner));
    let fewer = ((offset - point.low) >> halving) << halving;
    let more = ((point.high - offset) >> halving) << halving;
    let first = offset - select(vec2i(0), fewer, point.is_last);
    let last = offset + select(vec2i(0), more, point.is_first);
    var sum = 0.0;
    for (var y = first.y; y <= last.y; y += 1 + point.corner) {
        for (var x = first.x; x <= last.x; x += 1 + point.corner) {
            sum += tabled(point, vec2i(x, y));
        }
    }
    return sum;
}

fn added(sum: Sum, shares: vec2f, light: vec4f, alpha: f32) -> Sum {
    return Sum(
        sum.red + shares * light.x,
        sum.green + shares * light.y,
        sum.blue + shares * light.z,
        sum.opacity + shares * light.w,
        sum.alpha + shares * alpha,
    );
}

fn joined(sum: Sum, other: Sum) -> Sum {
    return Sum(
        sum.red + other.red,
        sum.green + other.green,
        sum.blue + other.blue,
        sum.opacity + other.opacity,
        sum.alpha + other.alpha,
    );
}

// Adds a point to the layer that it belongs to in either pixel (eq. 6).
fn splatted(layers: Layers, point: Point, light: vec4f, shares: vec2f, least: vec2f, most: vec2f) -> Layers {
    let is_front = vec2f(point.coc_px) < least;
    let is_behind = vec2f(point.coc_px) > most;
    let none = vec2f(0.0);
    // Hidden points occlude nothing.
    let in_front = select(none, shares, is_front & vec2<bool>(!point.is_hidden));
    let at_its_depth = select(shares, none, is_front | is_behind);
    let behind = select(none, shares, is_behind);
    return Layers(
        added(layers.front, in_front, light, point.alpha),
        added(layers.same, at_its_depth, light, point.alpha),
        added(layers.behind, behind, light, point.alpha),
    );
}

// Whether a block whose points reach `reach` pixels touches the tile at `tile`.
fn touches(origin: vec2i, reach: i32, tile: vec2i) -> bool {
    return all(origin - reach < tile + TILE) && all(origin + params.block + reach > tile);
}

// `behind`, alpha 1 unless it is nothing, seen past a layer: normalised, so that alpha is one again (eq. 7).
fn blend(sum: Sum, k: u32, behind: vec4f, is_anything: ptr<function, bool>) -> vec4f {
    let alpha = sum.alpha[k];
    if alpha <= 0.0 {
        return behind;
    }
    // Where more than one arrived, nothing of what is behind passes.
    let passed = select(0.0, max(1.0 - alpha, 0.0), *is_anything);
    *is_anything = true;
    let content = vec4f(sum.red[k], sum.green[k], sum.blue[k], sum.opacity[k]);
    return (content + passed * behind) / (alpha + passed);
}

// Writes pixel `k` of a thread's two.
fn write(layers: Layers, k: u32, at: vec2i) {
    if at.x >= params.width {
        return;
    }
    var is_anything = false;
    var content = blend(layers.behind, k, vec4f(0.0), &is_anything);
    content = blend(layers.same, k, content, &is_anything);
    content = blend(layers.front, k, content, &is_anything);
    let plane = u32(params.band_rows * params.width);
    for (var channel = 0u; channel < params.channels; channel++) {
        picture[channel * plane + u32(at.y * params.width + at.x)] = content[channel];
    }
}

@compute @workgroup_size(4, 8)
fn splat(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_id) thread: vec3u) {
    // In the band, its rows being those of `bounds` and of the picture that is written.
    let tile = vec2i(group.xy) * TILE + vec2i(0, params.strip_row);
    let left = tile + vec2i(thread.xy) * vec2i(PIXELS_A_THREAD, 1);
    if left.x >= params.width || left.y >= params.band_rows {
        return;
    }
    let own = left.y * params.width;
    let near = bounds[own + left.x];
    let far = bounds[own + min(left.x + 1, params.width - 1)];
    let least = vec2f(near.x, far.x);
    let most = vec2f(near.y, far.y);
    let place = left + vec2i(0, params.band_row);
    let regions = tile / params.region;
    let window = windows[regions.y * params.regions_across + regions.x];
    var layers: Layers;
    for (var row = window.z; row < window.w; row++) {
        // A running sum of thousands of small steps would show their rounding.
        var recent: Layers;
        for (var column = window.x; column < window.y; column++) {
            let block = blocks[row * params.blocks_across + column];
            let origin = vec2i(vec2u(column, row)) * params.block + vec2i(0, params.source_row);
            if !touches(origin, i32(block.y >> 8), tile + vec2i(0, params.band_row)) {
                continue;
            }
            for (var i = block.x; i < block.x + (block.y & 255); i++) {
                let point = point(shapes[i], origin);
                let shares = vec2f(weight(point, place - point.at), weight(point, place + vec2i(1, 0) - point.at));
                if any(shares > vec2f(0.0)) {
                    recent = splatted(recent, point, lights[i], shares, least, most);
                }
            }
        }
        layers.front = joined(layers.front, recent.front);
        layers.same = joined(layers.same, recent.same);
        layers.behind = joined(layers.behind, recent.behind);
    }
    write(layers, 0u, left);
    write(layers, 1u, left + vec2i(1, 0));
}
