// `shear` on a GPU; the CPU code is src/methods/shear/.
//
// The ray of view (u, j) at pixel p passes, in the bin of CoC radius c, the fragments at p + ⌊c·u + j + ½⌋. The CPU computes
// these shifts as whole numbers. A workgroup has a tile of pixels. For each tile and view there is a list of the groups of
// neighbouring bins that the view moves by the same shift and that may be visible in the tile, nearest first; most lists have
// one or two groups. A thread follows the rays of four pixels along the list until they are occluded. Where one opaque surface
// covers the tile in a view, the list is not followed. No fragments are sorted, and no two threads write to the same address.
//
// shear_lists.wgsl is part of the same module and builds the lists. This file has the declarations of both, and
//
//   paint              views → sums, or the picture
//   paint_translucent  the same for scenes with translucent fragments
//
// Colours and keys have the rows that the band reads; sums and pictures are [plane][row][column] with the rows that the band
// writes.

struct Params {
    // Size of the picture, in pixels.
    width: u32,
    height: u32,
    // The rows that the band reads.
    source_start: u32,
    source_rows: u32,
    // The rows that the band writes.
    band_start: u32,
    band_rows: u32,
    layers: u32,
    bins: u32,
    // Number of words with a bit for each bin, 32 bins to a word.
    words: u32,
    // Capacity of a list of groups, in entries.
    entries: u32,
    // The bins in focus are focused_start .. focused_end.
    focused_start: u32,
    focused_end: u32,
    // Number of views of the picture, and of this batch.
    views: u32,
    batch_views: u32,
    transparent_background: u32,
    // One bit for each channel that these views render.
    channels: u32,
    // Offset of the barrel in the frame's corners, in aperture radii; 0 without a barrel.
    cats_eye: f32,
    axis_x_px: f32,
    axis_y_px: f32,
    half_diagonal_px: f32,
    // Width over which a view fades in at the barrel, in aperture radii.
    softness: f32,
}

@group(0) @binding(0) var<uniform> params: Params;
// [view][bin], four to a vector; `unpacked_shift` reads one.
@group(0) @binding(1) var<uniform> shifts: array<vec4u, 4096>;
// A key has a fragment's first bin from bit BIN_SHIFT on, the number of further bins from EXTRA_SHIFT on, and the flag OPAQUE.
// NO_KEY for no fragment. A texel has four layers, a word two.
@group(0) @binding(2) var keys: texture_2d_array<u32>;
// [word][row of blocks][column], one bit for each bin: the bins in a block, in the window that begins at it, and in the windows
// of the square that begins at it.
@group(0) @binding(3) var<storage, read_write> block_bins: array<u32>;
@group(0) @binding(4) var<storage, read_write> window_bins: array<u32>;
@group(0) @binding(5) var<storage, read_write> square_window_bins: array<u32>;
// [row of blocks][column], packed `Occluder`: of a block, and of the window that begins at it.
@group(0) @binding(6) var<storage, read_write> block_occluders: array<u32>;
@group(0) @binding(7) var<storage, read_write> window_occluders: array<u32>;
// [square][view][word], one bit for each bin.
@group(0) @binding(8) var<storage, read_write> square_bins: array<u32>;
// [tile][view][entry], packed `Group`.
@group(0) @binding(9) var<storage, read_write> groups: array<vec2u>;
// [tile][index]: the shift of a view's first group, and the view. Views in which an occluder covers the tile come first.
@group(0) @binding(10) var<storage, read_write> ordered_views: array<vec2u>;
// [tile]: the number of views in which an occluder covers the tile.
@group(0) @binding(11) var<storage, read_write> covered_views: array<u32>;
// Number of entries of the longest list, which may exceed the capacity.
@group(0) @binding(12) var<storage, read_write> longest_list: atomic<u32>;
// Red, green, blue, alpha; one array layer for each layer of the stack.
@group(0) @binding(13) var colors: texture_2d_array<f32>;
// [view], in aperture radii.
@group(0) @binding(14) var<storage, read> lens_points: array<vec2f>;
// Planes: red, green, blue, rays in focus, rays that missed, rays hidden by the barrel.
@group(0) @binding(15) var<storage, read_write> sums: array<f32>;
// Planes: red, green, blue, alpha, share of rays in focus.
@group(0) @binding(16) var<storage, read_write> picture: array<f32>;

// The program defines OPAQUE_ALPHA, MIN_TRANSMITTANCE, MIN_HIT_VIEWS, the layout of keys, and the sides TILE and BLOCK in
// pixels and SQUARE in tiles.

// Constants of a pipeline: whether the stack has more layers than a texel of keys, and whether a barrel hides views.
override MANY_LAYERS = true;
override BARREL = true;

// Whether this is the first batch, and the last one, of a set of views.
override FIRST_BATCH = true;
override LAST_BATCH = true;

// Side of a window in blocks: as many as a tile can touch.
const WINDOW = TILE / BLOCK + 1u;

// Distance in rows between the pixels of a thread.
const ROWS_APART = 4u;

// Share of the view through `lens` that the barrel lets pass to `pixel`.
fn barrel_transmittance(lens: vec2f, pixel: vec2u) -> f32 {
    let position = vec2f(pixel) + vec2f(0.5, 0.5 + f32(params.band_start));
    let height = (position - vec2f(params.axis_x_px, params.axis_y_px)) / params.half_diagonal_px;
    let within = 1.0 - length(lens - params.cats_eye * height);
    return clamp(within / params.softness + 0.5, 0.0, 1.0);
}

// Mask of the bits of a key that are its first bin.
const KEY_BIN_MASK = 0xffffu ^ ((1u << BIN_SHIFT) - 1u);

// The order of no fragment.
const NONE = 0xffffffffu;

// The keys of the four layers from `4 · slice` on.
fn keys_at(source: vec2u, slice: u32) -> vec4u {
    let four = textureLoad(keys, source, slice, 0).xy;
    return vec4u(four.x & 0xffffu, four.x >> 16u, four.y & 0xffffu, four.y >> 16u);
}

// `nearest` among the four layers from `4 · slice` on. Fragments are compared by bin, and within a bin by layer, which takes
// the place of the lowest bits of the key.
fn nearest_of_four(group: Group, source: vec2u, slice: u32, start: u32) -> u32 {
    let key = keys_at(source, slice);
    let begin = group.first << BIN_SHIFT;
    let order = max(key & vec4u(KEY_BIN_MASK), vec4u(begin)) | vec4u(0u, 1u, 2u, 3u);
    let extra = (key & vec4u(EXTRA_MASK << EXTRA_SHIFT)) << vec4u(BIN_SHIFT - EXTRA_SHIFT);
    let inside = (key < vec4u(group.end << BIN_SHIFT)) & (key + extra >= vec4u(begin));
    let layers_before = min(max(start & 0xffu, 4u * slice) - 4u * slice, 4u);
    let min_order = ((start >> 8u) << BIN_SHIFT) | layers_before;
    let found = select(vec4u(NONE), order, inside & (order >= vec4u(min_order)));
    let best = min(min(found.x, found.y), min(found.z, found.w));
    return select(((best >> BIN_SHIFT) << 8u) | (4u * slice + (best & 3u)), NONE, best == NONE);
}

// The order of the nearest fragment of `group` at `source` whose order is at least `start`, or NONE. An order has the bin and,
// in the eight lowest bits, the layer.
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

// Pixel `i` of the four of a thread, which lie in one column.
fn pixel_of(tile: vec2u, at: vec2u, i: u32) -> vec2u {
    return TILE * tile + at + vec2u(0u, i * ROWS_APART);
}

// Share of the rays of `view` that the barrel lets pass to a thread's pixels.
fn initial_transmittance(view: u32, tile: vec2u, at: vec2u) -> vec4f {
    if !BARREL {
        return vec4f(1.0);
    }
    let lens = lens_points[view];
    return vec4f(
        barrel_transmittance(lens, pixel_of(tile, at, 0u)),
        barrel_transmittance(lens, pixel_of(tile, at, 1u)),
        barrel_transmittance(lens, pixel_of(tile, at, 2u)),
        barrel_transmittance(lens, pixel_of(tile, at, 3u)),
    );
}

// Index of the first entry of the list of `view` for `tile`.
fn list_of(view: u32, tile: vec2u) -> u32 {
    return ((tile.y * tiles_size().x + tile.x) * params.batch_views + view) * params.entries;
}

// The fragment that a ray hits: the sample and the order; NONE for a ray that has not hit any.
struct Hit {
    source: vec2u,
    order: u32,
}

// `hit`, or the hit of the ray through `pixel` in `group` if it has not hit anything before.
fn next_hit(hit: Hit, group: Group, pixel: vec2u) -> Hit {
    let source = source_of(pixel, unpacked_shift(group.shift));
    let order = nearest(group, source, 0u);
    let hit_before = hit.order != NONE;
    return Hit(select(source, hit.source, hit_before), select(order, hit.order, hit_before));
}

// Colour at `hit`, and 1 if it is in focus; 0 for a ray that hit nothing.
fn light_at(hit: Hit) -> vec4f {
    let color = textureLoad(colors, hit.source, hit.order & 0xffu, 0);
    let light = vec4f(color.rgb, select(0.0, 1.0, in_focus(hit.order)));
    return select(vec4f(0.0), light, hit.order != NONE);
}

// Sums over views for a thread's pixels: light as `light_at` returns it, rays that hit nothing, and rays that the barrel hides.
struct ThreadSums {
    first: vec4f,
    second: vec4f,
    third: vec4f,
    fourth: vec4f,
    missed: vec4f,
    hidden: vec4f,
}

// Flag in an entry of `ordered_views`: the occluder is in focus. The view is in the bits below.
const FOCUSED_FLAG = 0x10000u;

// The entries of a tile in `ordered_views`: covered views are first .. covered_end, the others covered_end .. end.
struct TileViews {
    first: u32,
    covered_end: u32,
    end: u32,
}

fn views_of(tile: vec2u) -> TileViews {
    let index = tile.y * tiles_size().x + tile.x;
    let first = index * params.batch_views;
    return TileViews(first, first + covered_views[index], first + params.batch_views);
}

// Colour of the first layer at `pixel` moved by `shift`, and `focused`.
fn occluder_light(pixel: vec2u, shift: vec2i, focused: f32) -> vec4f {
    return vec4f(textureLoad(colors, source_of(pixel, shift), 0u, 0).rgb, focused);
}

// Sums over the views in which an occluder covers `tile`: their hits are known without keys.
fn sum_covered_views(tile: vec2u, at: vec2u, of_tile: TileViews) -> ThreadSums {
    var total: ThreadSums;
    for (var i = of_tile.first; i < of_tile.covered_end; i++) {
        let next = ordered_views[i];
        let shift = unpacked_shift(next.x);
        let focused = select(0.0, 1.0, (next.y & FOCUSED_FLAG) != 0u);
        let passing = initial_transmittance(next.y & (FOCUSED_FLAG - 1u), tile, at);
        total.first += passing.x * occluder_light(pixel_of(tile, at, 0u), shift, focused);
        total.second += passing.y * occluder_light(pixel_of(tile, at, 1u), shift, focused);
        total.third += passing.z * occluder_light(pixel_of(tile, at, 2u), shift, focused);
        total.fourth += passing.w * occluder_light(pixel_of(tile, at, 3u), shift, focused);
        total.hidden += 1.0 - passing;
    }
    return total;
}

@compute @workgroup_size(16, 4)
fn paint(@builtin(local_invocation_id) local: vec3u, @builtin(workgroup_id) tile_id: vec3u) {
    let at = local.xy;
    let tile = tile_id.xy;
    let of_tile = views_of(tile);
    var total = sum_covered_views(tile, at, of_tile);
    for (var i = of_tile.covered_end; i < of_tile.end; i++) {
        let view = ordered_views[i].y;
        let list = list_of(view, tile);
        var first = Hit(vec2u(0u), NONE);
        var second = first;
        var third = first;
        var fourth = first;
        var entry = 0u;
        loop {
            let next = groups[list + entry];
            let group = unpacked(next);
            first = next_hit(first, group, pixel_of(tile, at, 0u));
            second = next_hit(second, group, pixel_of(tile, at, 1u));
            third = next_hit(third, group, pixel_of(tile, at, 2u));
            fourth = next_hit(fourth, group, pixel_of(tile, at, 3u));
            entry++;
            let max_order = max(max(first.order, second.order), max(third.order, fourth.order));
            if (next.y & LAST) != 0u || max_order != NONE {
                break;
            }
        }
        let passing = initial_transmittance(view, tile, at);
        total.first += passing.x * light_at(first);
        total.second += passing.y * light_at(second);
        total.third += passing.z * light_at(third);
        total.fourth += passing.w * light_at(fourth);
        let orders = vec4u(first.order, second.order, third.order, fourth.order);
        total.missed += select(vec4f(0.0), passing, orders == vec4u(NONE));
        total.hidden += 1.0 - passing;
    }
    add_thread_sums(tile, at, total);
}

// Light that a ray gathers: colour, and in the fourth component the coverage in focus; and the transmittance after it, 0 for an
// occluded ray.
struct Composite {
    light: vec4f,
    transmittance: f32,
}

// Composites the fragments of `group` at `pixel` along a ray of transmittance `before`, front to back.
fn composite(group: Group, pixel: vec2u, before: f32) -> Composite {
    var light = vec4f(0.0);
    var transmittance = before;
    if before <= 0.0 {
        return Composite(light, transmittance);
    }
    let source = source_of(pixel, unpacked_shift(group.shift));
    var start = 0u;
    loop {
        let order = nearest(group, source, start);
        if order == NONE {
            break;
        }
        let color = textureLoad(colors, source, order & 0xffu, 0);
        let alpha = select(color.a, 1.0, color.a >= OPAQUE_ALPHA);
        light += transmittance * vec4f(color.rgb, select(0.0, alpha, in_focus(order)));
        transmittance *= 1.0 - alpha;
        transmittance = select(0.0, transmittance, transmittance >= MIN_TRANSMITTANCE);
        start = order + 1u;
        if transmittance <= 0.0 {
            break;
        }
    }
    return Composite(light, transmittance);
}

@compute @workgroup_size(16, 4)
fn paint_translucent(@builtin(local_invocation_id) local: vec3u, @builtin(workgroup_id) tile_id: vec3u) {
    let at = local.xy;
    let tile = tile_id.xy;
    let of_tile = views_of(tile);
    var total = sum_covered_views(tile, at, of_tile);
    for (var i = of_tile.covered_end; i < of_tile.end; i++) {
        let view = ordered_views[i].y;
        let list = list_of(view, tile);
        var transmittance = initial_transmittance(view, tile, at);
        total.hidden += 1.0 - transmittance;
        var entry = 0u;
        loop {
            let next = groups[list + entry];
            let group = unpacked(next);
            let first = composite(group, pixel_of(tile, at, 0u), transmittance.x);
            let second = composite(group, pixel_of(tile, at, 1u), transmittance.y);
            let third = composite(group, pixel_of(tile, at, 2u), transmittance.z);
            let fourth = composite(group, pixel_of(tile, at, 3u), transmittance.w);
            total.first += first.light;
            total.second += second.light;
            total.third += third.light;
            total.fourth += fourth.light;
            transmittance = vec4f(
                first.transmittance,
                second.transmittance,
                third.transmittance,
                fourth.transmittance,
            );
            entry++;
            if (next.y & LAST) != 0u || all(transmittance <= vec4f(0.0)) {
                break;
            }
        }
        total.missed += transmittance;
    }
    add_thread_sums(tile, at, total);
}

// Writes a pixel of the picture: the mean over all views but the `hidden` ones, which the barrel blocks. Rays that hit nothing,
// `missed`, count as transparent if the background is transparent, and are excluded from the mean otherwise. The planes are
// red, green, blue, alpha, and the share of rays that hit something in focus, which is the fourth component of `sum`.
fn write_pixel(at: vec2u, sum: vec4f, missed: f32, hidden: f32) {
    let plane = params.width * params.band_rows;
    let pixel = at.y * params.width + at.x;
    let views = f32(params.views) - hidden;
    let hit = views - missed;
    let share = 1.0 / select(hit, views, params.transparent_background != 0u);
    let mean = select(vec4f(0.0), vec4f(sum.rgb, hit) * share, hit > MIN_HIT_VIEWS);
    for (var channel = 0u; channel < 4u; channel++) {
        if (params.channels & (1u << channel)) != 0u {
            picture[channel * plane + pixel] = mean[channel];
        }
    }
    if (params.channels & 8u) != 0u {
        picture[4u * plane + pixel] = sum.a / max(views, MIN_HIT_VIEWS);
    }
}

// Adds the sums of a batch to those of the batches before it; the last batch writes the picture.
fn add_batch(at: vec2u, batch_sum: vec4f, batch_missed: f32, batch_hidden: f32) {
    if at.x >= params.width || at.y >= params.band_rows {
        return;
    }
    var sum = batch_sum;
    var missed = batch_missed;
    var hidden = batch_hidden;
    let plane = params.width * params.band_rows;
    let pixel = at.y * params.width + at.x;
    if !FIRST_BATCH {
        sum += vec4f(sums[pixel], sums[plane + pixel], sums[2u * plane + pixel], sums[3u * plane + pixel]);
        missed += sums[4u * plane + pixel];
        hidden += sums[5u * plane + pixel];
    }
    if LAST_BATCH {
        write_pixel(at, sum, missed, hidden);
    } else {
        sums[pixel] = sum.r;
        sums[plane + pixel] = sum.g;
        sums[2u * plane + pixel] = sum.b;
        sums[3u * plane + pixel] = sum.a;
        sums[4u * plane + pixel] = missed;
        sums[5u * plane + pixel] = hidden;
    }
}

fn add_thread_sums(tile: vec2u, at: vec2u, total: ThreadSums) {
    add_batch(pixel_of(tile, at, 0u), total.first, total.missed.x, total.hidden.x);
    add_batch(pixel_of(tile, at, 1u), total.second, total.missed.y, total.hidden.y);
    add_batch(pixel_of(tile, at, 2u), total.third, total.missed.z, total.hidden.z);
    add_batch(pixel_of(tile, at, 3u), total.fourth, total.missed.w, total.hidden.w);
}
