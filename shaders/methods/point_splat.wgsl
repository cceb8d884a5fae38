// `point-splat`: points scattered as sprites into three layers of each pixel, Lee, Kim & Choi 2008.
//
// GPU backend of src/methods/published/point_splat/splat.rs and layers.rs. There points are scattered. Here a thread
// gathers the points that reach its two neighbouring pixels, as sums must not depend on the order of threads. Points
// are stored in blocks. A workgroup visits, in order, the blocks of its region's window that reach its tile. Sprite
// weights come from a table.
//
// |splat   adds some rows of blocks to the layers of a strip of picture rows
// |blend   blends the layers of the strip's pixels

struct Params {
    // Size of the picture, in pixels.
    width: i32,
    height: i32,
    // Pixel at the upper left corner of the first block; outside of the picture where points are repeated past its
    // border.
    source_column: i32,
    source_row: i32,
    // Picture rows of the band: first row, and number.
    band_row: i32,
    band_rows: i32,
    // First row of the strip, relative to the band.
    strip_row: i32,
    // Rows of blocks to add: first row, and end.
    first_blocks: u32,
    last_blocks: u32,
    // Whether the sums start at zero.
    is_first: u32,
    // Blocks per row, and regions per row.
    blocks_across: u32,
    regions_across: i32,
    // Number of planes of the picture: red, green, blue and, where the background is visible, alpha and coverage.
    planes: u32,
}

// Sums of the points in one layer of two neighbouring pixels.
struct Sum {
    red: vec2f,
    green: vec2f,
    blue: vec2f,
    opacity: vec2f,
    alpha: vec2f,
}

// The layers in front of the visible surface, at its depth, and behind it.
struct Layers {
    front: Sum,
    same: Sum,
    behind: Sum,
}

@group(0) @binding(0) var<uniform> params: Params;
// Content of each point: red, green, blue and, where the background is visible, alpha; premultiplied.
@group(0) @binding(1) var<storage, read> lights: array<vec4f>;
// Per point: bits of CoC radius and alpha, index of the weight of its own pixel, and the bits that `weight` unpacks.
@group(0) @binding(2) var<storage, read> shapes: array<vec4u>;
// Per block: first point; number of points in the low 8 bits, reach in pixels above.
@group(0) @binding(3) var<storage, read> blocks: array<vec2u>;
// Per region, the range of blocks that may reach it: first and end column, first and end row.
@group(0) @binding(4) var<storage, read> windows: array<vec4u>;
// Sprites of CoC radii above 0, row by row.
@group(0) @binding(5) var<storage, read> weights: array<f32>;
// Minimum and maximum CoC radius of the same-depth layer, [row of the band][column].
@group(0) @binding(6) var<storage, read> bounds: array<vec2f>;
// [row of the strip][pair of columns]
@group(0) @binding(7) var<storage, read_write> sums: array<Layers>;
// [plane][row of the band][column]
@group(0) @binding(8) var<storage, read_write> picture: array<f32>;

// From the program: BLOCK and REGION, the sides of both in pixels.

const TILE = vec2i(8, 8);
// Neighbouring pixels in a row, of which a thread computes two.
const PAIR = vec2i(2, 1);

// Weights of a point in two neighbouring pixels; the left one is at `offset` from the corner of the point's block.
fn weight(shape: vec4u, offset: vec2i) -> vec2f {
    let packed = shape.w;
    let corner = i32((packed >> 4) & 1);
    let reach = i32(packed >> 7);
    // Beyond one picture size, repetitions add no new term.
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

fn sum_of(sum: Sum, other: Sum) -> Sum {
    return Sum(
        sum.red + other.red,
        sum.green + other.green,
        sum.blue + other.blue,
        sum.opacity + other.opacity,
        sum.alpha + other.alpha,
    );
}

// Adds a point to its layer in either pixel, by the bounds of the same-depth layer (eq. 6).
fn splatted(layers: Layers, shape: vec4u, light: vec4f, shares: vec2f, min_coc_px: vec2f, max_coc_px: vec2f) -> Layers {
    let coc_px = vec2f(bitcast<f32>(shape.x));
    let alpha = bitcast<f32>(shape.y);
    // Hidden points occlude nothing: they have no front layer.
    let is_hidden = (shape.w & 32) != 0;
    let is_front = coc_px < min_coc_px;
    let is_behind = coc_px > max_coc_px;
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

// Blends a layer over `behind`, whose alpha is 1 unless it is empty, and normalises, so that alpha is 1 again (eq.
// 7).
fn blended(sum: Sum, k: u32, behind: vec4f, has_content: ptr<function, bool>) -> vec4f {
    let alpha = sum.alpha[k];
    if alpha <= 0.0 {
        return behind;
    }
    // With alpha over one, the transmittance is zero.
    let transmittance = select(0.0, max(1.0 - alpha, 0.0), *has_content);
    *has_content = true;
    let content = vec4f(sum.red[k], sum.green[k], sum.blue[k], sum.opacity[k]);
    return (content + transmittance * behind) / (alpha + transmittance);
}

// Share of pixel `k` of a thread's two that the layers cover. CPU version: `layers::blend`.
fn covered(layers: Layers, k: u32) -> f32 {
    let alphas = min(vec3f(layers.front.alpha[k], layers.same.alpha[k], layers.behind.alpha[k]), vec3f(1.0));
    return alphas.x + (1.0 - alphas.x) * (alphas.y + (1.0 - alphas.y) * alphas.z);
}

// Writes pixel `k` of a thread's two.
fn write_pixel(layers: Layers, k: u32, at: vec2i) {
    if at.x >= params.width {
        return;
    }
    var has_content = false;
    var content = blended(layers.behind, k, vec4f(0.0), &has_content);
    content = blended(layers.same, k, content, &has_content);
    content = blended(layers.front, k, content, &has_content);
    let plane = u32(params.band_rows * params.width);
    let pixel = u32(at.y * params.width + at.x);
    for (var channel = 0u; channel < min(params.planes, 4u); channel++) {
        picture[channel * plane + pixel] = content[channel];
    }
    if params.planes > 4u {
        picture[4u * plane + pixel] = covered(layers, k);
    }
}

// The left pixel of a thread's two; its row is relative to the strip.
fn left_pixel(group: vec3u, thread: vec3u) -> vec2i {
    return vec2i(group.xy) * TILE + vec2i(thread.xy) * PAIR;
}

fn is_outside(left: vec2i) -> bool {
    return left.x >= params.width || left.y + params.strip_row >= params.band_rows;
}

// Index of the layers of a pair of pixels.
fn pair_index(left: vec2i) -> i32 {
    return left.y * ((params.width + 1) / 2) + left.x / 2;
}

@compute @workgroup_size(4, 8)
fn splat(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_id) thread: vec3u) {
    let left = left_pixel(group, thread);
    if is_outside(left) {
        return;
    }
    let row_start = (left.y + params.strip_row) * params.width;
    let left_bounds = bounds[row_start + left.x];
    let right_bounds = bounds[row_start + min(left.x + 1, params.width - 1)];
    let min_coc_px = vec2f(left_bounds.x, right_bounds.x);
    let max_coc_px = vec2f(left_bounds.y, right_bounds.y);
    let tile = vec2i(group.xy) * TILE + vec2i(0, params.strip_row);
    let regions = tile / REGION;
    let window = windows[regions.y * params.regions_across + regions.x];
    // From here on, coordinates are in pixels of the picture.
    let in_picture = vec2i(0, params.strip_row + params.band_row);
    let source = vec2i(params.source_column, params.source_row);
    var layers: Layers;
    if params.is_first == 0 {
        layers = sums[pair_index(left)];
    }
    for (var row = max(window.z, params.first_blocks); row < min(window.w, params.last_blocks); row++) {
        // Partial sums per row of blocks: one running sum over thousands of small terms would have a visible f32
        // error.
        var partial: Layers;
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
                    partial = splatted(partial, shape, lights[i], shares, min_coc_px, max_coc_px);
                }
            }
        }
        layers.front = sum_of(layers.front, partial.front);
        layers.same = sum_of(layers.same, partial.same);
        layers.behind = sum_of(layers.behind, partial.behind);
    }
    sums[pair_index(left)] = layers;
}

@compute @workgroup_size(4, 8)
fn blend(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_id) thread: vec3u) {
    let left = left_pixel(group, thread);
    if is_outside(left) {
        return;
    }
    let layers = sums[pair_index(left)];
    let at = left + vec2i(0, params.strip_row);
    write_pixel(layers, 0u, at);
    write_pixel(layers, 1u, at + vec2i(1, 0));
}
