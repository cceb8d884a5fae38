// `point-splat`: points scattered as sprites into three layers of each pixel, Lee, Kim & Choi 2008.
//
// GpuBackend of src/methods/point_splat/splat.rs and layers.rs. There points are scattered; here a thread gathers what reaches its two
// neighbouring pixels, since sums must not depend on the order of threads. Points lie in blocks, and a workgroup walks those of its
// region's window that reach its tile, in their order. A sprite's weights come from a table.
//
// splat: adds some rows of blocks to the layers of a strip of picture rows.
// blend: the strip's pixels from their layers.

struct Params {
    // Of the picture, in pixels.
    width: i32,
    height: i32,
    // Pixel of the first block's upper left corner; outside of the picture where points are repeated past its border.
    source_column: i32,
    source_row: i32,
    // Picture rows that the band makes: the first, and how many.
    band_row: i32,
    band_rows: i32,
    // First row of the strip, from the band's first.
    strip_row: i32,
    // Rows of blocks to add: the first, and the one past the last.
    first_blocks: u32,
    last_blocks: u32,
    // Whether nothing was added before.
    is_first: u32,
    // Blocks and regions beside one another.
    blocks_across: u32,
    regions_across: i32,
    // Planes of content: 3, or 4 with alpha.
    channels: u32,
}

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

@group(0) @binding(0) var<uniform> params: Params;
// A point's content: red, green, blue and, where the background is open, alpha; premultiplied.
@group(0) @binding(1) var<storage, read> lights: array<vec4f>;
// Bits of a point's CoC radius and of its alpha, the weight of its own pixel, and what `weight` unpacks.
@group(0) @binding(2) var<storage, read> shapes: array<vec4u>;
// A block's first point, and their number (8 bits) below how far they reach in pixels.
@group(0) @binding(3) var<storage, read> blocks: array<vec2u>;
// For each region the blocks that may reach it: first and past-the-last column, first and past-the-last row.
@group(0) @binding(4) var<storage, read> windows: array<vec4u>;
// Sprites of CoC radii over 0, row by row.
@group(0) @binding(5) var<storage, read> weights: array<f32>;
// Least and greatest CoC radius of the same-depth layer, [row of the band][column].
@group(0) @binding(6) var<storage, read> bounds: array<vec2f>;
// [row of the strip][pair of columns]
@group(0) @binding(7) var<storage, read_write> sums: array<Layers>;
// [channel][row of the band][column]
@group(0) @binding(8) var<storage, read_write> picture: array<f32>;

// BLOCK and REGION, the sides of both in pixels, are the program's.

const TILE = vec2i(8, 8);
// Neighbours in a row, of which a thread makes two.
const PAIR = vec2i(2, 1);

// Weights of a point in two neighbouring pixels, the left one at `offset` from the corner of the point's block.
fn weight(shape: vec4u, offset: vec2i) -> vec2f {
    let packed = shape.w;
    let corner = i32((packed >> 4) & 1);
    let reach = i32(packed >> 7);
    // Past one picture off, repetitions tell nothing new.
    let across = min(reach, params.width);
    let down = min(reach + corner, params.height);
    let left = offset - vec2i(vec2u(packed, packed >> 2) & vec2u(3));
    let columns = vec2i(left.x, left.x + 1);
    // In front of focus a sprite is turned by 180° about its centre.
    let is_turned = (packed & 64) != 0;
    let turned = select(columns, corner - columns, is_turned);
    let row = select(left.y, corner - left.y, is_turned) * (2 * across + 2);
    let at = vec2i(i32(shape.z) + row) + turned;
    let is_within = (columns >= vec2i(-across)) & (columns <= vec2i(across + 1)) & vec2<bool>(abs(left.y) <= down);
    let inside = select(vec2i(0), at, is_within);
    return select(vec2f(0.0), vec2f(weights[inside.x], weights[inside.y]), is_within);
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

// Adds a point to the layer that it belongs to in either pixel, by their bounds (eq. 6).
fn splatted(layers: Layers, shape: vec4u, light: vec4f, shares: vec2f, least: vec2f, most: vec2f) -> Layers {
    let coc_px = vec2f(bitcast<f32>(shape.x));
    let alpha = bitcast<f32>(shape.y);
    // Hidden points occlude nothing: they are in front of nothing.
    let is_hidden = (shape.w & 32) != 0;
    let is_front = coc_px < least;
    let is_behind = coc_px > most;
    let none = vec2f(0.0);
    return Layers(
        added(layers.front, select(none, shares, is_front & vec2<bool>(!is_hidden)), light, alpha),
        added(layers.same, select(shares, none, is_front | is_behind), light, alpha),
        added(layers.behind, select(none, shares, is_behind), light, alpha),
    );
}

// Whether a block whose points reach `reach` pixels touches the tile at `tile`.
fn touches(origin: vec2i, reach: i32, tile: vec2i) -> bool {
    return all(origin - reach < tile + TILE) && all(origin + BLOCK + reach > tile);
}

// `behind`, alpha 1 unless it is nothing, seen past a layer: normalised, so that alpha is one again (eq. 7).
fn blended(sum: Sum, k: u32, behind: vec4f, is_anything: ptr<function, bool>) -> vec4f {
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
    var content = blended(layers.behind, k, vec4f(0.0), &is_anything);
    content = blended(layers.same, k, content, &is_anything);
    content = blended(layers.front, k, content, &is_anything);
    let plane = u32(params.band_rows * params.width);
    for (var channel = 0u; channel < params.channels; channel++) {
        picture[channel * plane + u32(at.y * params.width + at.x)] = content[channel];
    }
}

// The left pixel of a thread's two, its row counted from the strip's first.
fn left_pixel(group: vec3u, thread: vec3u) -> vec2i {
    return vec2i(group.xy) * TILE + vec2i(thread.xy) * PAIR;
}

fn is_outside(left: vec2i) -> bool {
    return left.x >= params.width || left.y + params.strip_row >= params.band_rows;
}

// Index of a pair's layers.
fn pair(left: vec2i) -> i32 {
    return left.y * ((params.width + 1) / 2) + left.x / 2;
}

@compute @workgroup_size(4, 8)
fn splat(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_id) thread: vec3u) {
    let left = left_pixel(group, thread);
    if is_outside(left) {
        return;
    }
    let own = (left.y + params.strip_row) * params.width;
    let of_left = bounds[own + left.x];
    let of_right = bounds[own + min(left.x + 1, params.width - 1)];
    let least = vec2f(of_left.x, of_right.x);
    let most = vec2f(of_left.y, of_right.y);
    let tile = vec2i(group.xy) * TILE + vec2i(0, params.strip_row);
    let regions = tile / REGION;
    let window = windows[regions.y * params.regions_across + regions.x];
    // From here on in pixels of the picture.
    let in_picture = vec2i(0, params.strip_row + params.band_row);
    let source = vec2i(params.source_column, params.source_row);
    var layers: Layers;
    if params.is_first == 0 {
        layers = sums[pair(left)];
    }
    for (var row = max(window.z, params.first_blocks); row < min(window.w, params.last_blocks); row++) {
        // In one running sum the rounding of thousands of small steps would show.
        var recent: Layers;
        for (var column = window.x; column < window.y; column++) {
            let block = blocks[row * params.blocks_across + column];
            let origin = source + vec2i(vec2u(column, row)) * BLOCK;
            if !touches(origin, i32(block.y >> 8), vec2i(group.xy) * TILE + in_picture) {
                continue;
            }
            for (var i = block.x; i < block.x + (block.y & 255); i++) {
                let shape = shapes[i];
                let shares = weight(shape, left + in_picture - origin);
                if any(shares > vec2f(0.0)) {
                    recent = splatted(recent, shape, lights[i], shares, least, most);
                }
            }
        }
        layers.front = joined(layers.front, recent.front);
        layers.same = joined(layers.same, recent.same);
        layers.behind = joined(layers.behind, recent.behind);
    }
    sums[pair(left)] = layers;
}

@compute @workgroup_size(4, 8)
fn blend(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_id) thread: vec3u) {
    let left = left_pixel(group, thread);
    if is_outside(left) {
        return;
    }
    let layers = sums[pair(left)];
    let at = left + vec2i(0, params.strip_row);
    write(layers, 0u, at);
    write(layers, 1u, at + vec2i(1, 0));
}
