// `shear` on a GPU; its twin is src/methods/shear/.
//
// A view (u, j) sees at pixel p, in the bin of CoC radius c, the fragments at p + ⌊c·u + j + ½⌋: the shifts, made by the CPU in whole
// numbers. A thread has a pixel, and walks the bins of each view front to back until its ray is stopped; a group has a tile of
// pixels and walks only bins that the view can show it (`find_candidates`), most often one to three. Nothing is sorted, and no two
// threads write to one place.
//
//   load_layer       planes of a layer → colours and CoC radii
//   find_bins        CoC radius → bin
//   join_bins        bin → key: the bin, which neighbouring bins the fragment joins, whether it is opaque
//   smooth_rows      the prefilter along rows, a thread a row
//   smooth_columns   the prefilter along columns, a thread a column
//   mark_blocks      which bins each block of pixels holds
//   mark_windows     which bins each window of blocks holds: what a tile can see, wherever a view moves it
//   find_candidates  which bins each view can show to each tile
//   paint            sums over some views
//   finish           sums → picture
//
// Buffers of layers are [layer][row][column], rows those that the band reads; sums and pictures are [plane][row][column], rows
// those that it makes.

struct Params {
    // Of the picture.
    width: u32,
    height: u32,
    // The rows that are read.
    source_start: u32,
    source_rows: u32,
    // The rows that are made.
    band_start: u32,
    band_rows: u32,
    layers: u32,
    // The layer that is loaded.
    layer: u32,
    bins: u32,
    // Words of 32 bins.
    words: u32,
    // Bins in focus: from the first to before the end.
    focused_start: u32,
    focused_end: u32,
    // The table of bins.
    cells: u32,
    start_px: f32,
    cells_per_px: f32,
    // Radius of the prefilter's box in pixels, for each pixel of CoC radius.
    radius_per_coc: f32,
    // Views of the picture, and those of this go: all before it are in the sums.
    views: u32,
    views_before: u32,
    views_in_go: u32,
    open_background: u32,
    // A bit for each channel that these views make.
    channels: u32,
    // The rim: how far aside it stands in the frame's corners, in aperture radii; 0 for none.
    cats_eye: f32,
    axis_x_px: f32,
    axis_y_px: f32,
    half_diagonal_px: f32,
    // Over how many aperture radii a view fades in at the rim.
    softness: f32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> planes: array<f32>;
@group(0) @binding(2) var<storage, read_write> colors: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> coc_px: array<f32>;
@group(0) @binding(4) var<storage, read_write> indices: array<u32>;
@group(0) @binding(5) var<storage, read_write> keys: array<u32>;
@group(0) @binding(6) var<storage, read> bin_ends_px: array<f32>;
@group(0) @binding(7) var<storage, read> first_in_cell: array<u32>;
@group(0) @binding(8) var<storage, read_write> blocks: array<u32>;
@group(0) @binding(9) var<storage, read_write> windows: array<u32>;
@group(0) @binding(10) var<storage, read_write> candidates: array<u32>;
@group(0) @binding(11) var<storage, read> shifts: array<vec2i>;
@group(0) @binding(12) var<storage, read> lens_points: array<vec2f>;
@group(0) @binding(13) var<storage, read_write> sums: array<f32>;
@group(0) @binding(14) var<storage, read_write> picture: array<f32>;

// The bin of a sample without a fragment.
const EMPTY = 0xffffu;

// Bits of a key; the bin is above them.
const NEARER = 1u;
const FARTHER = 2u;
const OPAQUE = 4u;
const BIN_SHIFT = 3u;
const NO_KEY = 0xffffu;

// OPAQUE_ALPHA, JOIN_PX, SURFACE_PX, LEAST_VARIANCE, STOPPED_BELOW and LEAST_HIT are the program's.

// Sides of a tile and of a block, and blocks along a window: as many as a tile can touch.
const TILE = 16u;
const BLOCK = 4u;
const WINDOW = 5u;

fn samples() -> u32 {
    return params.width * params.source_rows;
}

@compute @workgroup_size(16, 16)
fn load_layer(@builtin(global_invocation_id) at: vec3u) {
    if at.x >= params.width || at.y >= params.source_rows {
        return;
    }
    let sample = at.y * params.width + at.x;
    let plane = samples();
    let target_sample = params.layer * plane + sample;
    colors[target_sample] = vec4f(
        planes[sample],
        planes[plane + sample],
        planes[2u * plane + sample],
        planes[3u * plane + sample],
    );
    coc_px[target_sample] = planes[4u * plane + sample];
}

@compute @workgroup_size(16, 16)
fn find_bins(@builtin(global_invocation_id) at: vec3u) {
    if at.x >= params.width || at.y >= params.source_rows {
        return;
    }
    let sample = (at.z * params.source_rows + at.y) * params.width + at.x;
    var bin = EMPTY;
    if colors[sample].a > 0.0 {
        let c = coc_px[sample];
        let cell = u32(max((c - params.start_px) * params.cells_per_px, 0.0));
        bin = first_in_cell[min(cell, params.cells - 1u)];
        bin += u32(c >= bin_ends_px[bin]);
    }
    indices[sample] = bin;
}

// The bits by which the fragment of `bin` joins its neighbour `other`, if that is of its surface; 8 says that it is.
const FOUND = 8u;

fn joined(bin: u32, c: f32, other: u32) -> u32 {
    let other_bin = indices[other];
    if other_bin == EMPTY || abs(coc_px[other] - c) >= JOIN_PX {
        return 0u;
    }
    return FOUND | select(0u, NEARER, other_bin < bin) | select(0u, FARTHER, other_bin > bin);
}

// The bits by which the fragment of `layer` joins its neighbours at `neighbour`: a surface goes on in its own peel; only where
// another begins there may it go on in any other.
fn joined_at(bin: u32, c: f32, layer: u32, neighbour: u32) -> u32 {
    let plane = samples();
    var bits = joined(bin, c, layer * plane + neighbour);
    for (var other = 0u; other < params.layers && bits == 0u; other++) {
        if other != layer {
            bits = joined(bin, c, other * plane + neighbour);
        }
    }
    return bits;
}

fn key_of(layer: u32, at: vec2u) -> u32 {
    let here = at.y * params.width + at.x;
    let sample = layer * samples() + here;
    let bin = indices[sample];
    if bin == EMPTY {
        return NO_KEY;
    }
    if colors[sample].a < OPAQUE_ALPHA {
        return bin << BIN_SHIFT;
    }
    let c = coc_px[sample];
    var bits = OPAQUE;
    if at.y > 0u {
        bits |= joined_at(bin, c, layer, here - params.width);
    }
    if at.y + 1u < params.source_rows {
        bits |= joined_at(bin, c, layer, here + params.width);
    }
    if at.x > 0u {
        bits |= joined_at(bin, c, layer, here - 1u);
    }
    if at.x + 1u < params.width {
        bits |= joined_at(bin, c, layer, here + 1u);
    }
    return (bin << BIN_SHIFT) | (bits & (NEARER | FARTHER | OPAQUE));
}

// Two layers a word: the nearer one in the lower half.
@compute @workgroup_size(16, 16)
fn join_bins(@builtin(global_invocation_id) at: vec3u) {
    if at.x >= params.width || at.y >= params.source_rows {
        return;
    }
    let layer = 2u * at.z;
    let nearer = key_of(layer, at.xy);
    var farther = NO_KEY;
    if layer + 1u < params.layers {
        farther = key_of(layer + 1u, at.xy);
    }
    keys[(at.z * params.source_rows + at.y) * params.width + at.x] = nearer | (farther << 16u);
}

// The weight of neighbour `there` in the mean at `here`: see src/methods/shear/prefilter.rs.
fn smoothing(here: u32, there: u32, alpha: f32, other_alpha: f32) -> f32 {
    let c = coc_px[here];
    let radius = abs(c) * params.radius_per_coc;
    let variance = radius * radius * (1.0 / 3.0);
    let v = max(variance, 1e-4);
    let a = (v + 1.0 - sqrt(1.0 + 2.0 * v)) / v;
    let same = alpha > 0.0 && alpha == other_alpha;
    let smooth_here = same && abs(c - coc_px[there]) < SURFACE_PX && variance > LEAST_VARIANCE;
    return select(0.0, a, smooth_here);
}

// Smooths `count` samples from `first` on, `step` apart, there and back. The weight between two neighbours is the farther one's.
fn smooth_line(first: u32, step: u32, count: u32) {
    var last = colors[first];
    for (var i = 1u; i < count; i++) {
        let here = first + i * step;
        var color = colors[here];
        let a = smoothing(here, here - step, color.a, last.a);
        if a > 0.0 {
            color = vec4f((1.0 - a) * color.rgb + a * last.rgb, color.a);
            colors[here] = color;
        }
        last = color;
    }
    for (var i = count - 1u; i > 0u; i--) {
        let there = first + i * step;
        let here = there - step;
        var color = colors[here];
        let a = smoothing(there, here, last.a, color.a);
        if a > 0.0 {
            color = vec4f((1.0 - a) * color.rgb + a * last.rgb, color.a);
            colors[here] = color;
        }
        last = color;
    }
}

@compute @workgroup_size(64)
fn smooth_rows(@builtin(global_invocation_id) at: vec3u) {
    if at.x < params.source_rows {
        smooth_line((at.y * params.source_rows + at.x) * params.width, 1u, params.width);
    }
}

@compute @workgroup_size(64)
fn smooth_columns(@builtin(global_invocation_id) at: vec3u) {
    if at.x < params.width {
        smooth_line(at.y * samples() + at.x, params.width, params.source_rows);
    }
}

fn blocks_size() -> vec2u {
    return (vec2u(params.width, params.source_rows) + (BLOCK - 1u)) / BLOCK;
}

// The bins of `word` that `key` is in.
fn bins_of(key: u32, word: u32) -> u32 {
    if key == NO_KEY {
        return 0u;
    }
    let first = (key >> BIN_SHIFT) - (key & NEARER);
    let end = (key >> BIN_SHIFT) + ((key & FARTHER) / FARTHER) + 1u;
    var bits = 0u;
    for (var bin = first; bin < end; bin++) {
        bits |= select(0u, 1u << (bin & 31u), bin >> 5u == word);
    }
    return bits;
}

@compute @workgroup_size(8, 8)
fn mark_blocks(@builtin(global_invocation_id) at: vec3u) {
    let size = blocks_size();
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let end = min(BLOCK * (at.xy + 1u), vec2u(params.width, params.source_rows));
    var bits = 0u;
    for (var pair = 0u; 2u * pair < params.layers; pair++) {
        var last = NO_KEY | (NO_KEY << 16u);
        for (var y = BLOCK * at.y; y < end.y; y++) {
            for (var x = BLOCK * at.x; x < end.x; x++) {
                let both = keys[(pair * params.source_rows + y) * params.width + x];
                if both != last {
                    bits |= bins_of(both & 0xffffu, at.z) | bins_of(both >> 16u, at.z);
                    last = both;
                }
            }
        }
    }
    blocks[(at.z * size.y + at.y) * size.x + at.x] = bits;
}

@compute @workgroup_size(8, 8)
fn mark_windows(@builtin(global_invocation_id) at: vec3u) {
    let size = blocks_size();
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let end = min(at.xy + WINDOW, size);
    var bits = 0u;
    for (var y = at.y; y < end.y; y++) {
        for (var x = at.x; x < end.x; x++) {
            bits |= blocks[(at.z * size.y + y) * size.x + x];
        }
    }
    windows[(at.z * size.y + at.y) * size.x + at.x] = bits;
}

// The sample that a view shows at `pixel` of the band where it moves by `shift`: those at the border go on for ever.
fn source_of(pixel: vec2u, shift: vec2i) -> vec2u {
    let place = vec2i(pixel) + vec2i(0, i32(params.band_start)) + shift;
    let inside = clamp(place, vec2i(0), vec2i(vec2u(params.width, params.height)) - 1);
    return vec2u(u32(inside.x), min(u32(inside.y) - params.source_start, params.source_rows - 1u));
}

fn tiles_size() -> vec2u {
    return (vec2u(params.width, params.band_rows) + (TILE - 1u)) / TILE;
}

// A thread has a tile and a view, one row of tiles a group.
@compute @workgroup_size(64)
fn find_candidates(@builtin(global_invocation_id) at: vec3u) {
    let tiles = tiles_size();
    if at.x >= tiles.x {
        return;
    }
    let view = at.z;
    let size = blocks_size();
    let corner = TILE * at.xy;
    let result = ((at.y * tiles.x + at.x) * params.views_in_go + view) * params.words;
    for (var word = 0u; word < params.words; word++) {
        let end = min(32u, params.bins - 32u * word);
        var bits = 0u;
        for (var bit = 0u; bit < end; bit++) {
            let shift = shifts[view * params.bins + 32u * word + bit];
            let block = source_of(corner, shift) / BLOCK;
            bits |= windows[(word * size.y + block.y) * size.x + block.x] & (1u << bit);
        }
        candidates[result + word] = bits;
    }
}

// How much of the view through `lens` passes the rim, seen from `pixel`.
fn passing(lens: vec2f, pixel: vec2u) -> f32 {
    let place = vec2f(pixel) + vec2f(0.5, 0.5 + f32(params.band_start));
    let height = (place - vec2f(params.axis_x_px, params.axis_y_px)) / params.half_diagonal_px;
    let within = 1.0 - length(lens - params.cats_eye * height);
    return clamp(within / params.softness + 0.5, 0.0, 1.0);
}

// What the rays of a pixel have met.
struct Seen {
    color: vec3f,
    // Share of rays that met something in focus.
    focused: f32,
    // Share of rays that met nothing.
    missed: f32,
    // Views that the rim hides.
    hidden: f32,
}

// Whether the fragment of `key` is in `bin`.
fn is_in(key: u32, bin: u32) -> bool {
    let own = key >> BIN_SHIFT;
    return own == bin || (own == bin + 1u && (key & NEARER) != 0u) || (own + 1u == bin && (key & FARTHER) != 0u);
}

// Adds what a ray, of which `before` is left, meets in `bin` at `sample`, and returns what is left then: 0 of a ray that is stopped.
fn meet(bin: u32, sample: u32, before: f32, seen: ptr<function, Seen>) -> f32 {
    let plane = samples();
    let focused = bin >= params.focused_start && bin < params.focused_end;
    var left = before;
    for (var layer = 0u; layer < params.layers && left > 0.0; layer += 2u) {
        var both = keys[(layer >> 1u) * plane + sample];
        for (var half = 0u; half < 2u && left > 0.0; half++) {
            let key = both & 0xffffu;
            both >>= 16u;
            if is_in(key, bin) {
                let color = colors[(layer + half) * plane + sample];
                let alpha = select(color.a, 1.0, (key & OPAQUE) != 0u);
                (*seen).color += left * color.rgb;
                (*seen).focused += select(0.0, left * alpha, focused);
                left *= 1.0 - alpha;
                left = select(0.0, left, left >= STOPPED_BELOW);
            }
        }
    }
    return left;
}

@compute @workgroup_size(16, 16)
fn paint(@builtin(global_invocation_id) at: vec3u, @builtin(workgroup_id) tile: vec3u) {
    if at.x >= params.width || at.y >= params.band_rows {
        return;
    }
    var seen: Seen;
    let in_tile = (tile.y * tiles_size().x + tile.x) * params.views_in_go;
    for (var view = 0u; view < params.views_in_go; view++) {
        var left = 1.0;
        if params.cats_eye > 0.0 {
            left = passing(lens_points[view], at.xy);
            seen.hidden += 1.0 - left;
        }
        for (var word = 0u; word < params.words && left > 0.0; word++) {
            var bits = candidates[(in_tile + view) * params.words + word];
            while bits != 0u && left > 0.0 {
                let bin = 32u * word + firstTrailingBit(bits);
                bits &= bits - 1u;
                let source = source_of(at.xy, shifts[view * params.bins + bin]);
                left = meet(bin, source.y * params.width + source.x, left, &seen);
            }
        }
        seen.missed += left;
    }
    add(at.y * params.width + at.x, seen);
}

// Adds a go's sums to those of the goes before it.
fn add(pixel: u32, seen: Seen) {
    let plane = params.width * params.band_rows;
    let values = array<f32, 6>(
        seen.color.r,
        seen.color.g,
        seen.color.b,
        seen.focused,
        seen.missed,
        seen.hidden,
    );
    for (var i = 0u; i < 6u; i++) {
        let before = select(0.0, sums[i * plane + pixel], params.views_before > 0u);
        sums[i * plane + pixel] = before + values[i];
    }
}

// The mean over all views: rays that met nothing are transparent where the background is open, and left out of the mean where it
// is closed. Red, green, blue, alpha, and the share of rays that met something in focus.
@compute @workgroup_size(16, 16)
fn finish(@builtin(global_invocation_id) at: vec3u) {
    if at.x >= params.width || at.y >= params.band_rows {
        return;
    }
    let plane = params.width * params.band_rows;
    let pixel = at.y * params.width + at.x;
    let views = f32(params.views) - sums[5u * plane + pixel];
    let hit = views - sums[4u * plane + pixel];
    let weight = select(hit, views, params.open_background != 0u);
    for (var channel = 0u; channel < 4u; channel++) {
        if (params.channels & (1u << channel)) != 0u {
            let sum = select(hit, sums[channel * plane + pixel], channel < 3u);
            picture[channel * plane + pixel] = select(0.0, sum / weight, hit > LEAST_HIT);
        }
    }
    if (params.channels & 8u) != 0u {
        picture[4u * plane + pixel] = sums[3u * plane + pixel] / max(views, LEAST_HIT);
    }
}
