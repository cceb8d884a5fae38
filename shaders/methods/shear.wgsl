// `shear` on a GPU; its twin is src/methods/shear/.
//
// A view (u, j) sees at pixel p, in the bin of CoC radius c, the fragments at p + ⌊c·u + j + ½⌋: the shifts, made by the CPU in whole
// numbers. A group of threads has a tile of pixels, and for each view a list of what the view can show it, nearest first: groups of
// neighbouring bins that it moves alike, most often one or two. A thread follows the rays of four pixels along that list until
// they are stopped. Where a view shows a tile nothing but one opaque surface, a wall, the list need not be followed. No fragments are
// sorted, and no two threads write to one place.
//
// With it goes shear_lists.wgsl, which makes the lists. Here is what both declare, and
//
//   paint            views → sums, or the picture
//   paint_veils      the same where fragments let light through
//
// Colours and keys have the rows that the band reads; sums and pictures are [plane][row][column], rows those that the band makes.

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
    bins: u32,
    // Words of 32 bins.
    words: u32,
    // Entries that a list of groups has room for.
    entries: u32,
    // Bins in focus: from the first to before the end.
    focused_start: u32,
    focused_end: u32,
    // Views of the picture, and of this go.
    views: u32,
    views_in_go: u32,
    transparent_background: u32,
    // A bit for each channel that these views make.
    channels: u32,
    // The barrel: how far aside it stands in the frame's corners, in aperture radii; 0 for none.
    cats_eye: f32,
    axis_x_px: f32,
    axis_y_px: f32,
    half_diagonal_px: f32,
    // Over how many aperture radii a view fades in at the barrel.
    softness: f32,
}

@group(0) @binding(0) var<uniform> params: Params;
// [view][bin], four to a vector: see `shift_in`.
@group(0) @binding(1) var<uniform> shifts: array<vec4u, 4096>;
// For each fragment the first bin that it is in, from BIN_SHIFT on; how many more, from EXTRA_SHIFT on; OPAQUE. NO_KEY for none. Four layers
// a texel, two to a word.
@group(0) @binding(2) var keys: texture_2d_array<u32>;
// [word][row of blocks][column]: a bit a bin.
@group(0) @binding(3) var<storage, read_write> blocks: array<u32>;
@group(0) @binding(4) var<storage, read_write> windows: array<u32>;
@group(0) @binding(5) var<storage, read_write> far_windows: array<u32>;
// [row of blocks][column]: see `Wall`.
@group(0) @binding(6) var<storage, read_write> block_walls: array<u32>;
@group(0) @binding(7) var<storage, read_write> walls: array<u32>;
// [square][view][word]: a bit a bin.
@group(0) @binding(8) var<storage, read_write> far: array<u32>;
// [tile][view][entry]: see `Group`.
@group(0) @binding(9) var<storage, read_write> groups: array<vec2u>;
// [tile][turn]: a view, and the shift of its first group. First come those that show a wall: so many.
@group(0) @binding(10) var<storage, read_write> turns: array<vec2u>;
@group(0) @binding(11) var<storage, read_write> turns_of_walls: array<u32>;
// Entries of the longest list, whether or not there was room.
@group(0) @binding(12) var<storage, read_write> longest: atomic<u32>;
// Red, green, blue, alpha, a layer each.
@group(0) @binding(13) var colors: texture_2d_array<f32>;
@group(0) @binding(14) var<storage, read> lens_points: array<vec2f>;
@group(0) @binding(15) var<storage, read_write> sums: array<f32>;
@group(0) @binding(16) var<storage, read_write> picture: array<f32>;

// OPAQUE_ALPHA, STOPPED_BELOW, MIN_HIT, what keys are made of, and the sides TILE and BLOCK in pixels and SQUARE in tiles are the
// program's.

// A pipeline's own constants, what a kernel need not ask each ray: whether there are fragments in more layers than a texel of keys has,
// and whether a barrel hides views.
override MANY_LAYERS = true;
override RIM = true;

// Whether these are the first views and the last ones of a set.
override FIRST = true;
override FINAL = true;

// Blocks along a window: as many as a tile can touch.
const WINDOW = TILE / BLOCK + 1u;

// Rows of a tile that a thread's pixels are apart.
const ROWS_APART = 4u;

// How much of the view through `lens` passes the barrel, seen from `pixel`.
fn passing(lens: vec2f, pixel: vec2u) -> f32 {
    let place = vec2f(pixel) + vec2f(0.5, 0.5 + f32(params.band_start));
    let height = (place - vec2f(params.axis_x_px, params.axis_y_px)) / params.half_diagonal_px;
    let within = 1.0 - length(lens - params.cats_eye * height);
    return clamp(within / params.softness + 0.5, 0.0, 1.0);
}

// The bits of a key that are its first bin.
const ALL_BINS = 0xffffu ^ ((1u << BIN_SHIFT) - 1u);

// No fragment.
const NONE = 0xffffffffu;

// The keys of the four layers from `4 · slice` on.
fn keys_at(source: vec2u, slice: u32) -> vec4u {
    let four = textureLoad(keys, source, slice, 0).xy;
    return vec4u(four.x & 0xffffu, four.x >> 16u, four.y & 0xffffu, four.y >> 16u);
}

// `nearest` among the four layers from `4 · slice` on: the least of bins, and below that, in place of what else a key says, of layers.
fn nearest_of_four(group: Group, source: vec2u, slice: u32, start: u32) -> u32 {
    let key = keys_at(source, slice);
    let begin = group.first << BIN_SHIFT;
    let order = max(key & vec4u(ALL_BINS), vec4u(begin)) | vec4u(0u, 1u, 2u, 3u);
    let extra = (key & vec4u(EXTRA << EXTRA_SHIFT)) << vec4u(BIN_SHIFT - EXTRA_SHIFT);
    let inside = (key < vec4u(group.end << BIN_SHIFT)) & (key + extra >= vec4u(begin));
    let layers_before = min(max(start & 0xffu, 4u * slice) - 4u * slice, 4u);
    let least = ((start >> 8u) << BIN_SHIFT) | layers_before;
    let found = select(vec4u(NONE), order, inside & (order >= vec4u(least)));
    let best = min(min(found.x, found.y), min(found.z, found.w));
    return select(((best >> BIN_SHIFT) << 8u) | (4u * slice + (best & 3u)), NONE, best == NONE);
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

// What of the rays of `view` passes the barrel, from a thread's pixels.
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
    let source = source_of(pixel, shift_in(group.shift));
    let order = nearest(group, source, 0u);
    let was_before = hit.order != NONE;
    return Hit(select(source, hit.source, was_before), select(order, hit.order, was_before));
}

// What a ray that is stopped at `hit` sees: colour, and whether it is in focus; of one that is not, nothing.
fn light_at(hit: Hit) -> vec4f {
    let color = textureLoad(colors, hit.source, hit.order & 0xffu, 0);
    let seen = vec4f(color.rgb, select(0.0, 1.0, in_focus(hit.order)));
    return select(vec4f(0.0), seen, hit.order != NONE);
}

// What the rays of a thread's pixels see: light as `light_at` has it, how many met nothing, and how many the barrel hides.
struct Seen {
    first: vec4f,
    second: vec4f,
    third: vec4f,
    fourth: vec4f,
    missed: vec4f,
    hidden: vec4f,
}

// A bit of a turn above its view: its wall is in focus.
const SHARP = 0x10000u;

// The turns of a tile: first those of views that show it a wall.
struct Turns {
    first: u32,
    end_of_walls: u32,
    end: u32,
}

fn turns_of(tile: vec2u) -> Turns {
    let index = tile.y * tiles_size().x + tile.x;
    let first = index * params.views_in_go;
    return Turns(first, first + turns_of_walls[index], first + params.views_in_go);
}

fn wall_light(pixel: vec2u, shift: vec2i, sharp: f32) -> vec4f {
    return vec4f(textureLoad(colors, source_of(pixel, shift), 0u, 0).rgb, sharp);
}

// What the rays of the views see that show `tile` nothing but a wall: where they end needs no keys.
fn seen_walls(tile: vec2u, at: vec2u, of_tile: Turns) -> Seen {
    var seen: Seen;
    for (var turn = of_tile.first; turn < of_tile.end_of_walls; turn++) {
        let next = turns[turn];
        let shift = shift_in(next.x);
        let sharp = select(0.0, 1.0, (next.y & SHARP) != 0u);
        let start = start_of(next.y & (SHARP - 1u), tile, at);
        seen.first += start.x * wall_light(pixel_of(tile, at, 0u), shift, sharp);
        seen.second += start.y * wall_light(pixel_of(tile, at, 1u), shift, sharp);
        seen.third += start.z * wall_light(pixel_of(tile, at, 2u), shift, sharp);
        seen.fourth += start.w * wall_light(pixel_of(tile, at, 3u), shift, sharp);
        seen.hidden += 1.0 - start;
    }
    return seen;
}

@compute @workgroup_size(16, 4)
fn paint(@builtin(local_invocation_id) local: vec3u, @builtin(workgroup_id) tile_id: vec3u) {
    let at = local.xy;
    let tile = tile_id.xy;
    let of_tile = turns_of(tile);
    var seen = seen_walls(tile, at, of_tile);
    for (var turn = of_tile.end_of_walls; turn < of_tile.end; turn++) {
        let view = turns[turn].y;
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
    let source = source_of(pixel, shift_in(group.shift));
    var start = 0u;
    loop {
        let order = nearest(group, source, start);
        if order == NONE {
            break;
        }
        let color = textureLoad(colors, source, order & 0xffu, 0);
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
    let of_tile = turns_of(tile);
    var seen = seen_walls(tile, at, of_tile);
    for (var turn = of_tile.end_of_walls; turn < of_tile.end; turn++) {
        let view = turns[turn].y;
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

// Writes a pixel of the picture: the mean over all views, of which `hidden` did not pass the barrel. Rays that met nothing, `missed`, are
// transparent where the background is open, and left out of the mean where it is closed. Red, green, blue, alpha, and the share of
// rays that met something in focus, the fourth part of `sum`.
fn show(at: vec2u, sum: vec4f, missed: f32, hidden: f32) {
    let plane = params.width * params.band_rows;
    let pixel = at.y * params.width + at.x;
    let views = f32(params.views) - hidden;
    let hit = views - missed;
    let share = 1.0 / select(hit, views, params.transparent_background != 0u);
    let mean = select(vec4f(0.0), vec4f(sum.rgb, hit) * share, hit > MIN_HIT);
    for (var channel = 0u; channel < 4u; channel++) {
        if (params.channels & (1u << channel)) != 0u {
            picture[channel * plane + pixel] = mean[channel];
        }
    }
    if (params.channels & 8u) != 0u {
        picture[4u * plane + pixel] = sum.a / max(views, MIN_HIT);
    }
}

// Adds a go's sums to those of the goes before it; the last one's are the picture.
fn add(at: vec2u, go: vec4f, missed_in_go: f32, hidden_in_go: f32) {
    if at.x >= params.width || at.y >= params.band_rows {
        return;
    }
    var sum = go;
    var missed = missed_in_go;
    var hidden = hidden_in_go;
    let plane = params.width * params.band_rows;
    let pixel = at.y * params.width + at.x;
    if !FIRST {
        sum += vec4f(sums[pixel], sums[plane + pixel], sums[2u * plane + pixel], sums[3u * plane + pixel]);
        missed += sums[4u * plane + pixel];
        hidden += sums[5u * plane + pixel];
    }
    if FINAL {
        show(at, sum, missed, hidden);
    } else {
        sums[pixel] = sum.r;
        sums[plane + pixel] = sum.g;
        sums[2u * plane + pixel] = sum.b;
        sums[3u * plane + pixel] = sum.a;
        sums[4u * plane + pixel] = missed;
        sums[5u * plane + pixel] = hidden;
    }
}

fn add_four(tile: vec2u, at: vec2u, seen: Seen) {
    add(pixel_of(tile, at, 0u), seen.first, seen.missed.x, seen.hidden.x);
    add(pixel_of(tile, at, 1u), seen.second, seen.missed.y, seen.hidden.y);
    add(pixel_of(tile, at, 2u), seen.third, seen.missed.z, seen.hidden.z);
    add(pixel_of(tile, at, 3u), seen.fourth, seen.missed.w, seen.hidden.w);
}
