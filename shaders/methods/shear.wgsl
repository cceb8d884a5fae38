// `shear` on a GPU; its twin is src/methods/shear/.
//
// A view (u, j) sees at pixel p, in the bin of CoC radius c, the fragments at p + ⌊c·u + j + ½⌋: the shifts, made by the CPU in whole
// numbers. A group of threads has a tile of pixels, and for each view a list of what the view can show it, nearest first: groups of
// neighbouring bins that it moves alike, most often one or two. A thread follows the rays of four pixels along that list until
// they are stopped. Nothing is sorted, and no two threads write to one place.
//
//   find_bins        CoC radius → bin
//   join_bins        bin → key: the bin, which neighbouring bins the fragment joins, whether it is opaque
//   smooth_rows      the prefilter along rows, a thread a row
//   smooth_columns   the prefilter along columns, a thread a column
//   mark_blocks      which bins each block of pixels holds
//   mark_windows     which bins each window of blocks holds: what a tile can see, wherever a view moves it
//   mark_far         the same for a square of tiles
//   find_far         the bins that each view can show to each square of tiles
//   find_groups      of those, the groups of bins that it can show to each tile
//   paint            sums over some views
//   paint_veils      the same where fragments let light through
//   finish           sums → picture
//
// Colours and CoC radii come a layer at a time, [row][column], rows those that the band reads; keys have four layers a texel; sums
// and pictures are [plane][row][column], rows those that the band makes.

struct Params {
    // Of the picture; columns of a row of colours.
    width: u32,
    height: u32,
    stride: u32,
    // The rows that are read.
    source_start: u32,
    source_rows: u32,
    // The rows that are made.
    band_start: u32,
    band_rows: u32,
    layers: u32,
    // The layer at hand.
    layer: u32,
    bins: u32,
    // Words of 32 bins.
    words: u32,
    // Entries that a list of groups has room for.
    entries: u32,
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
// [view][bin], two to a vector.
@group(0) @binding(1) var<uniform> shifts: array<vec4i, 4096>;
@group(0) @binding(2) var<storage, read_write> colors: array<vec4f>;
@group(0) @binding(3) var<storage, read> coc_px: array<f32>;
@group(0) @binding(4) var<storage, read> bin_ends_px: array<f32>;
@group(0) @binding(5) var<storage, read> first_in_cell: array<u32>;
// A fragment: the bits of its CoC radius, and its bin with OPAQUE.
@group(0) @binding(6) var fragments_made: texture_storage_2d_array<rg32uint, write>;
@group(0) @binding(7) var fragments: texture_2d_array<u32>;
@group(0) @binding(8) var keys_made: texture_storage_2d_array<rg32uint, write>;
@group(0) @binding(9) var keys: texture_2d_array<u32>;
@group(0) @binding(10) var<storage, read_write> blocks: array<u32>;
@group(0) @binding(11) var<storage, read_write> windows: array<u32>;
// [tile][view][entry]: see `Group`. Entries of the longest list, whether or not there was room.
@group(0) @binding(12) var<storage, read_write> groups: array<vec2u>;
@group(0) @binding(17) var<storage, read_write> longest: atomic<u32>;
// [square][view][word]: a bit a bin.
@group(0) @binding(18) var<storage, read_write> far: array<u32>;
@group(0) @binding(19) var<storage, read_write> far_windows: array<u32>;
@group(0) @binding(13) var<storage, read> lens_points: array<vec2f>;
@group(0) @binding(14) var<storage, read_write> sums: array<f32>;
@group(0) @binding(15) var<storage, read_write> picture: array<f32>;
// The colours once more, smoothed.
@group(0) @binding(16) var smoothed: texture_2d_array<f32>;

// The bin of a sample without a fragment; a bit above the bins.
const EMPTY = 0xffffu;
const OPAQUE = 0x10000u;

// Bits of a key; the bin is above them.
const NEARER = 1u;
const FARTHER = 2u;
const BIN_SHIFT = 3u;
const NO_KEY = 0xffffu;

// OPAQUE_ALPHA, JOIN_PX, SURFACE_PX, LEAST_VARIANCE, STOPPED_BELOW and LEAST_HIT are the program's.

// Whether there are fragments in more layers than a texel of keys has, and whether a rim hides views: what a kernel need not ask
// each ray. (A pipeline's own constants.)
override MANY_LAYERS = true;
override RIM = true;

// Sides of a tile and of a block, and blocks along a window: as many as a tile can touch.
const TILE = 16u;
const BLOCK = 4u;
const WINDOW = 5u;

// Tiles along a square, and windows along a far one: as many as a square can touch.
const SQUARE = 4u;

// Rows of a tile that a thread's pixels are apart.
const ROWS_APART = 4u;

@compute @workgroup_size(16, 16)
fn find_bins(@builtin(global_invocation_id) at: vec3u) {
    if at.x >= params.width || at.y >= params.source_rows {
        return;
    }
    let c = coc_px[at.y * params.width + at.x];
    let alpha = colors[at.y * params.stride + at.x].a;
    var bin = EMPTY;
    if alpha > 0.0 {
        let cell = u32(max((c - params.start_px) * params.cells_per_px, 0.0));
        bin = first_in_cell[min(cell, params.cells - 1u)];
        bin += u32(c >= bin_ends_px[bin]);
        bin |= select(0u, OPAQUE, alpha >= OPAQUE_ALPHA);
    }
    textureStore(fragments_made, at.xy, params.layer, vec4u(bitcast<u32>(c), bin, 0u, 0u));
}

// The bits by which the fragment `own` joins the neighbour in `layer` at `place`, if that is of its surface; FOUND says that it is.
const FOUND = 4u;

fn joined(own: vec2u, place: vec2u, layer: u32) -> u32 {
    let other = textureLoad(fragments, place, layer, 0).xy;
    let bin = own.y & EMPTY;
    let other_bin = other.y & EMPTY;
    let near = abs(bitcast<f32>(other.x) - bitcast<f32>(own.x)) < JOIN_PX;
    let bits = FOUND | select(0u, NEARER, other_bin < bin) | select(0u, FARTHER, other_bin > bin);
    return select(0u, bits, near && other_bin != EMPTY);
}

// The bits by which the fragment `own` of `layer` joins its neighbours at `place`: a surface goes on in its own peel; only where
// another begins there may it go on in any other.
fn joined_at(own: vec2u, layer: u32, place: vec2u) -> u32 {
    var bits = joined(own, place, layer);
    for (var other = 0u; bits == 0u && other < params.layers; other++) {
        if other != layer {
            bits = joined(own, place, other);
        }
    }
    return bits;
}

fn key_of(layer: u32, at: vec2u) -> u32 {
    if layer >= params.layers {
        return NO_KEY;
    }
    let own = textureLoad(fragments, at, layer, 0).xy;
    if own.y == EMPTY {
        return NO_KEY;
    }
    // Translucent fragments join nothing: they would count twice.
    var bits = 0u;
    if (own.y & OPAQUE) != 0u {
        if at.y > 0u {
            bits |= joined_at(own, layer, at - vec2u(0u, 1u));
        }
        if at.y + 1u < params.source_rows {
            bits |= joined_at(own, layer, at + vec2u(0u, 1u));
        }
        if at.x > 0u {
            bits |= joined_at(own, layer, at - vec2u(1u, 0u));
        }
        if at.x + 1u < params.width {
            bits |= joined_at(own, layer, at + vec2u(1u, 0u));
        }
    }
    return ((own.y & EMPTY) << BIN_SHIFT) | (bits & (NEARER | FARTHER));
}

@compute @workgroup_size(16, 16)
fn join_bins(@builtin(global_invocation_id) at: vec3u) {
    if at.x >= params.width || at.y >= params.source_rows {
        return;
    }
    let layer = 4u * at.z;
    let first = key_of(layer, at.xy) | (key_of(layer + 1u, at.xy) << 16u);
    let second = key_of(layer + 2u, at.xy) | (key_of(layer + 3u, at.xy) << 16u);
    textureStore(keys_made, at.xy, at.z, vec4u(first, second, 0u, 0u));
}

// The weight of the other of two neighbours in the mean at one with CoC radius `c`: see src/methods/shear/prefilter.rs.
fn smoothing(c: f32, other_c: f32, alpha: f32, other_alpha: f32) -> f32 {
    let radius = abs(c) * params.radius_per_coc;
    let variance = radius * radius * (1.0 / 3.0);
    let v = max(variance, 1e-4);
    let a = (v + 1.0 - sqrt(1.0 + 2.0 * v)) / v;
    let same = alpha > 0.0 && alpha == other_alpha;
    return select(0.0, a, same && abs(c - other_c) < SURFACE_PX && variance > LEAST_VARIANCE);
}

// A line of samples: where it begins among the colours and among the CoC radii, how far its samples lie apart there, and how many
// there are.
struct Line {
    color: u32,
    coc: u32,
    color_step: u32,
    coc_step: u32,
    count: u32,
}

// Smooths a line, there and back. The weight between two neighbours is by the farther one's CoC radius.
fn smooth_line(line: Line) {
    var last = colors[line.color];
    var last_c = coc_px[line.coc];
    for (var i = 1u; i < line.count; i++) {
        let here = line.color + i * line.color_step;
        let c = coc_px[line.coc + i * line.coc_step];
        var color = colors[here];
        let a = smoothing(c, last_c, color.a, last.a);
        if a > 0.0 {
            color = vec4f((1.0 - a) * color.rgb + a * last.rgb, color.a);
            colors[here] = color;
        }
        last = color;
        last_c = c;
    }
    for (var i = line.count - 1u; i > 0u; i--) {
        let here = line.color + (i - 1u) * line.color_step;
        let c = coc_px[line.coc + (i - 1u) * line.coc_step];
        var color = colors[here];
        let a = smoothing(last_c, c, last.a, color.a);
        if a > 0.0 {
            color = vec4f((1.0 - a) * color.rgb + a * last.rgb, color.a);
            colors[here] = color;
        }
        last = color;
        last_c = c;
    }
}

@compute @workgroup_size(64)
fn smooth_rows(@builtin(global_invocation_id) at: vec3u) {
    if at.x < params.source_rows {
        smooth_line(Line(at.x * params.stride, at.x * params.width, 1u, 1u, params.width));
    }
}

@compute @workgroup_size(64)
fn smooth_columns(@builtin(global_invocation_id) at: vec3u) {
    if at.x < params.width {
        smooth_line(Line(at.x, at.x, params.stride, params.width, params.source_rows));
    }
}

fn blocks_size() -> vec2u {
    return (vec2u(params.width, params.source_rows) + (BLOCK - 1u)) / BLOCK;
}

// The bins of `word` that `key` is in.
fn bins_of(key: u32, word: u32) -> u32 {
    let nearer = key & NEARER;
    let bins = (2u << (nearer + ((key & FARTHER) / FARTHER))) - 1u;
    let first = i32((key >> BIN_SHIFT) - nearer) - i32(32u * word);
    let from_here = select(0u, bins << u32(first & 31), first >= 0 && first < 32);
    let from_before = select(0u, bins >> u32(-first & 31), first < 0 && first > -3);
    return select(from_here | from_before, 0u, key == NO_KEY);
}

@compute @workgroup_size(8, 8)
fn mark_blocks(@builtin(global_invocation_id) at: vec3u) {
    let size = blocks_size();
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let end = min(BLOCK * (at.xy + 1u), vec2u(params.width, params.source_rows));
    var bits = 0u;
    for (var slice = 0u; 4u * slice < params.layers; slice++) {
        for (var y = BLOCK * at.y; y < end.y; y++) {
            for (var x = BLOCK * at.x; x < end.x; x++) {
                let four = textureLoad(keys, vec2u(x, y), slice, 0).xy;
                bits |= bins_of(four.x & 0xffffu, at.z) | bins_of(four.x >> 16u, at.z);
                bits |= bins_of(four.y & 0xffffu, at.z) | bins_of(four.y >> 16u, at.z);
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

// Neighbouring bins, from the first to before the end, that a view moves by the same shift.
struct Group {
    first: u32,
    end: u32,
    shift: vec2i,
}

// Bits of an entry beside its first bin and its end: whether it is the last of its list.
const END_SHIFT = 13u;
const BIN_MASK = 0x1fffu;
const LAST = 0x4000000u;

fn packed(group: Group, flags: u32) -> vec2u {
    let shift = (u32(group.shift.x) & 0xffffu) | (u32(group.shift.y) << 16u);
    return vec2u(shift, group.first | (group.end << END_SHIFT) | flags);
}

fn unpacked(entry: vec2u) -> Group {
    let shift = vec2i(i32(entry.x << 16u) >> 16u, i32(entry.x) >> 16u);
    return Group(entry.y & BIN_MASK, (entry.y >> END_SHIFT) & BIN_MASK, shift);
}

fn shift_of(view: u32, bin: u32) -> vec2i {
    let i = view * params.bins + bin;
    let two = shifts[i >> 1u];
    return select(two.xy, two.zw, (i & 1u) == 1u);
}

// Where the word is, among windows, that says whether `view` can show `bin` to the tile or square that begins at pixel `corner`.
fn window_of(corner: vec2u, view: u32, bin: u32) -> u32 {
    let size = blocks_size();
    let block = source_of(corner, shift_of(view, bin)) / BLOCK;
    return ((bin >> 5u) * size.y + block.y) * size.x + block.x;
}

@compute @workgroup_size(8, 8)
fn mark_far(@builtin(global_invocation_id) at: vec3u) {
    let size = blocks_size();
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let step = TILE / BLOCK;
    let end = min(at.xy + SQUARE * step, size);
    var bits = 0u;
    for (var y = at.y; y < end.y; y += step) {
        for (var x = at.x; x < end.x; x += step) {
            bits |= windows[(at.z * size.y + y) * size.x + x];
        }
    }
    far_windows[(at.z * size.y + at.y) * size.x + at.x] = bits;
}

fn squares_size() -> vec2u {
    return (tiles_size() + (SQUARE - 1u)) / SQUARE;
}

@compute @workgroup_size(64)
fn find_far(@builtin(global_invocation_id) at: vec3u) {
    let squares = squares_size();
    if at.x >= squares.x {
        return;
    }
    let corner = SQUARE * TILE * at.xy;
    let bins = ((at.y * squares.x + at.x) * params.views_in_go + at.z) * params.words;
    for (var word = 0u; word < params.words; word++) {
        let count = min(32u, params.bins - 32u * word);
        var bits = 0u;
        for (var bit = 0u; bit < count; bit++) {
            bits |= far_windows[window_of(corner, at.z, 32u * word + bit)] & (1u << bit);
        }
        far[bins + word] = bits;
    }
}

@compute @workgroup_size(64)
fn find_groups(@builtin(global_invocation_id) at: vec3u) {
    let tiles = tiles_size();
    if at.x >= tiles.x {
        return;
    }
    let square = at.y / SQUARE * squares_size().x + at.x / SQUARE;
    let bins = (square * params.views_in_go + at.z) * params.words;
    let list = ((at.y * tiles.x + at.x) * params.views_in_go + at.z) * params.entries;
    // A list of nothing has one group, that no fragment is in.
    var group = Group(BIN_MASK, BIN_MASK, vec2i(0));
    var count = 1u;
    var word = 0u;
    var bits = far[bins];
    loop {
        if bits == 0u {
            word++;
            if word == params.words {
                break;
            }
            bits = far[bins + word];
            continue;
        }
        let bin = 32u * word + firstTrailingBit(bits);
        bits &= bits - 1u;
        let shift = shift_of(at.z, bin);
        let is_first = group.first == BIN_MASK;
        if !is_first && all(shift == group.shift) {
            group.end = bin + 1u;
        } else if ((windows[window_of(TILE * at.xy, at.z, bin)] >> (bin & 31u)) & 1u) == 1u {
            if !is_first {
                if count < params.entries {
                    groups[list + count - 1u] = packed(group, 0u);
                }
                count++;
            }
            group = Group(bin, bin + 1u, shift);
        }
    }
    if count <= params.entries {
        groups[list + count - 1u] = packed(group, LAST);
    }
    atomicMax(&longest, count);
}

// How much of the view through `lens` passes the rim, seen from `pixel`.
fn passing(lens: vec2f, pixel: vec2u) -> f32 {
    let place = vec2f(pixel) + vec2f(0.5, 0.5 + f32(params.band_start));
    let height = (place - vec2f(params.axis_x_px, params.axis_y_px)) / params.half_diagonal_px;
    let within = 1.0 - length(lens - params.cats_eye * height);
    return clamp(within / params.softness + 0.5, 0.0, 1.0);
}

// No fragment.
const NONE = 0xffffffffu;

// `nearest` among the four layers from `4 · slice` on.
fn nearest_of_four(group: Group, source: vec2u, slice: u32, start: u32) -> u32 {
    let four = textureLoad(keys, source, slice, 0).xy;
    let key = vec4u(four.x & 0xffffu, four.x >> 16u, four.y & 0xffffu, four.y >> 16u);
    let bin = key >> vec4u(BIN_SHIFT);
    let first = max(bin - (key & vec4u(NEARER)), vec4u(group.first));
    let last = min(bin + ((key & vec4u(FARTHER)) >> vec4u(1u)), vec4u(group.end - 1u));
    let order = (first << vec4u(8u)) + (4u * slice + vec4u(0u, 1u, 2u, 3u));
    let found = select(vec4u(NONE), order, (first <= last) & (order >= vec4u(start)));
    return min(min(found.x, found.y), min(found.z, found.w));
}

// The place in the order of `group` at `source` of the nearest fragment that is not before place `start`: its bin, and below that, in
// eight bits, its layer.
fn nearest(group: Group, source: vec2u, start: u32) -> u32 {
    var best = nearest_of_four(group, source, 0u, start);
    if MANY_LAYERS {
        for (var slice = 1u; 4u * slice < params.layers; slice++) {
            best = min(best, nearest_of_four(group, source, slice, start));
        }
    }
    return best;
}

fn in_focus(order: u32) -> bool {
    let bin = order >> 8u;
    return bin >= params.focused_start && bin < params.focused_end;
}

// A thread's pixels: one, and three more below it.
fn pixel_of(tile: vec2u, at: vec2u, i: u32) -> vec2u {
    return TILE * tile + at + vec2u(0u, i * ROWS_APART);
}

// What of the rays of `view` passes the rim, from a thread's pixels.
fn start_of(view: u32, tile: vec2u, at: vec2u) -> vec4f {
    if !RIM {
        return vec4f(1.0);
    }
    let lens = lens_points[view];
    return vec4f(
        passing(lens, pixel_of(tile, at, 0u)),
        passing(lens, pixel_of(tile, at, 1u)),
        passing(lens, pixel_of(tile, at, 2u)),
        passing(lens, pixel_of(tile, at, 3u)),
    );
}

fn list_of(view: u32, tile: vec2u) -> u32 {
    return ((tile.y * tiles_size().x + tile.x) * params.views_in_go + view) * params.entries;
}

// Where a ray is stopped: the sample and the place in the order there.
struct Hit {
    source: vec2u,
    order: u32,
}

// `hit`, or where the ray through `pixel` is stopped in `group` if it was not before.
fn stopped(hit: Hit, group: Group, pixel: vec2u) -> Hit {
    let source = source_of(pixel, group.shift);
    let order = nearest(group, source, 0u);
    let was_before = hit.order != NONE;
    return Hit(select(source, hit.source, was_before), select(order, hit.order, was_before));
}

// What a ray that is stopped at `hit` sees: colour, and whether it is in focus; of one that is not, nothing.
fn light_at(hit: Hit) -> vec4f {
    let color = textureLoad(smoothed, hit.source, hit.order & 0xffu, 0);
    let seen = vec4f(color.rgb, select(0.0, 1.0, in_focus(hit.order)));
    return select(vec4f(0.0), seen, hit.order != NONE);
}

// What the rays of a thread's pixels see: light as `light_at` has it, how many met nothing, and how many the rim hides.
struct Seen {
    first: vec4f,
    second: vec4f,
    third: vec4f,
    fourth: vec4f,
    missed: vec4f,
    hidden: vec4f,
}

@compute @workgroup_size(16, 4)
fn paint(@builtin(local_invocation_id) local: vec3u, @builtin(workgroup_id) tile_id: vec3u) {
    let at = local.xy;
    let tile = tile_id.xy;
    var seen: Seen;
    for (var view = 0u; view < params.views_in_go; view++) {
        let list = list_of(view, tile);
        var first = Hit(vec2u(0u), NONE);
        var second = first;
        var third = first;
        var fourth = first;
        var entry = 0u;
        loop {
            let next = groups[list + entry];
            let group = unpacked(next);
            first = stopped(first, group, pixel_of(tile, at, 0u));
            second = stopped(second, group, pixel_of(tile, at, 1u));
            third = stopped(third, group, pixel_of(tile, at, 2u));
            fourth = stopped(fourth, group, pixel_of(tile, at, 3u));
            entry++;
            let last = max(max(first.order, second.order), max(third.order, fourth.order));
            if (next.y & LAST) != 0u || last != NONE {
                break;
            }
        }
        let start = start_of(view, tile, at);
        seen.first += start.x * light_at(first);
        seen.second += start.y * light_at(second);
        seen.third += start.z * light_at(third);
        seen.fourth += start.w * light_at(fourth);
        let orders = vec4u(first.order, second.order, third.order, fourth.order);
        seen.missed += select(vec4f(0.0), start, orders == vec4u(NONE));
        seen.hidden += 1.0 - start;
    }
    add_four(tile, at, seen);
}

// What a ray meets: the colour, in its fourth part what of it was in focus; and what is left then, 0 of a ray that is stopped.
struct Met {
    light: vec4f,
    left: f32,
}

// What a ray of which `before` is left meets in `group` at `pixel`.
fn meet(group: Group, pixel: vec2u, before: f32) -> Met {
    var light = vec4f(0.0);
    var left = before;
    if before <= 0.0 {
        return Met(light, left);
    }
    let source = source_of(pixel, group.shift);
    var start = 0u;
    loop {
        let order = nearest(group, source, start);
        if order == NONE {
            break;
        }
        let color = textureLoad(smoothed, source, order & 0xffu, 0);
        let alpha = select(color.a, 1.0, color.a >= OPAQUE_ALPHA);
        light += left * vec4f(color.rgb, select(0.0, alpha, in_focus(order)));
        left *= 1.0 - alpha;
        left = select(0.0, left, left >= STOPPED_BELOW);
        start = order + 1u;
        if left <= 0.0 {
            break;
        }
    }
    return Met(light, left);
}

@compute @workgroup_size(16, 4)
fn paint_veils(@builtin(local_invocation_id) local: vec3u, @builtin(workgroup_id) tile_id: vec3u) {
    let at = local.xy;
    let tile = tile_id.xy;
    var seen: Seen;
    for (var view = 0u; view < params.views_in_go; view++) {
        let list = list_of(view, tile);
        var left = start_of(view, tile, at);
        seen.hidden += 1.0 - left;
        var entry = 0u;
        loop {
            let next = groups[list + entry];
            let group = unpacked(next);
            let first = meet(group, pixel_of(tile, at, 0u), left.x);
            let second = meet(group, pixel_of(tile, at, 1u), left.y);
            let third = meet(group, pixel_of(tile, at, 2u), left.z);
            let fourth = meet(group, pixel_of(tile, at, 3u), left.w);
            seen.first += first.light;
            seen.second += second.light;
            seen.third += third.light;
            seen.fourth += fourth.light;
            left = vec4f(first.left, second.left, third.left, fourth.left);
            entry++;
            if (next.y & LAST) != 0u || all(left <= vec4f(0.0)) {
                break;
            }
        }
        seen.missed += left;
    }
    add_four(tile, at, seen);
}

// Adds a go's sums to those of the goes before it.
fn add(at: vec2u, sum: vec4f, missed: f32, hidden: f32) {
    if at.x >= params.width || at.y >= params.band_rows {
        return;
    }
    let plane = params.width * params.band_rows;
    let pixel = at.y * params.width + at.x;
    let more = params.views_before > 0u;
    sums[pixel] = sum.r + select(0.0, sums[pixel], more);
    sums[plane + pixel] = sum.g + select(0.0, sums[plane + pixel], more);
    sums[2u * plane + pixel] = sum.b + select(0.0, sums[2u * plane + pixel], more);
    sums[3u * plane + pixel] = sum.a + select(0.0, sums[3u * plane + pixel], more);
    sums[4u * plane + pixel] = missed + select(0.0, sums[4u * plane + pixel], more);
    sums[5u * plane + pixel] = hidden + select(0.0, sums[5u * plane + pixel], more);
}

fn add_four(tile: vec2u, at: vec2u, seen: Seen) {
    add(pixel_of(tile, at, 0u), seen.first, seen.missed.x, seen.hidden.x);
    add(pixel_of(tile, at, 1u), seen.second, seen.missed.y, seen.hidden.y);
    add(pixel_of(tile, at, 2u), seen.third, seen.missed.z, seen.hidden.z);
    add(pixel_of(tile, at, 3u), seen.fourth, seen.missed.w, seen.hidden.w);
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
