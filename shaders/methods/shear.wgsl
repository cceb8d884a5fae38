// `shear` on a GPU; the CPU code is src/methods/shear/.
//
// The ray of view (u, j) at pixel p passes, in the bin of CoC radius c, the fragments at p + ⌊c·u + j + ½⌋. The CPU computes
// these shifts as whole numbers. Rows take turns with several sets of views, which differ in j. A workgroup has a tile of pixels.
// For each tile, turn and view there is a list of the groups of neighbouring bins that the view moves by the same shift and that
// may be visible in the tile, nearest first; most lists have one or two groups. A thread follows rays along the list until they
// are occluded: without translucent fragments the rays of four pixels at once. Where one opaque surface covers the tile in a view,
// the list is not followed. No fragments are sorted, and no two threads write to the same address.
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
    // The bins that count as in focus, at least in part, are focused_start .. focused_end.
    focused_start: u32,
    focused_end: u32,
    // The bins that count as near, at least in part, are those before near_end.
    near_end: u32,
    // The first bins before focus whose blocks on the CPU have 2, 4, 8 and 16 bins at most.
    near_pairs_from: u32,
    near_fours_from: u32,
    near_eights_from: u32,
    near_sixteens_from: u32,
    // Number of views of the picture, and of this batch.
    views: u32,
    batch_views: u32,
    // Number of sets of views that rows take turns with: row y has set y mod turns.
    turns: u32,
    // Whether lost rays count as opaque black; otherwise they are left out of the mean.
    lost_are_black: u32,
    // One bit for each channel that these views render.
    channels: u32,
    // Whether these views are blended over the picture that others made, by the share of averages in each pixel.
    blends: u32,
    // The plane of the picture that has the share of these views' rays that near surfaces stop.
    near_share_plane: u32,
    // Offset of the barrel in the frame's corners, in aperture radii; 0 without a barrel.
    cats_eye: f32,
    axis_x_px: f32,
    axis_y_px: f32,
    half_diagonal_px: f32,
    // Width over which a view fades in at the barrel, in aperture radii.
    softness: f32,
}

@group(0) @binding(0) var<uniform> params: Params;
// [turn][view][bin]: the shift, and the first and the end (from the 17th bit on) of the bins that the view moves alike around it.
@group(0) @binding(1) var<storage, read> shifts: array<vec2u>;
// A key has a fragment's first bin from bit BIN_SHIFT on, the number of further bins from EXTRA_SHIFT on, and the flags OPAQUE and
// CHANGES_PEEL. NO_KEY for no fragment. A texel has four layers.
@group(0) @binding(2) var keys: texture_2d_array<u32>;
// [word][row of blocks][column], one bit for each bin: the bins in a block, in the window that begins at it, and in the windows
// of the square that begins at it.
@group(0) @binding(3) var<storage, read_write> block_bins: array<u32>;
@group(0) @binding(4) var<storage, read_write> window_bins: array<u32>;
@group(0) @binding(5) var<storage, read_write> square_window_bins: array<u32>;
// [row of blocks][column], packed `Occluder`: of a block, and of the window that begins at it.
@group(0) @binding(6) var<storage, read_write> block_occluders: array<u32>;
@group(0) @binding(7) var<storage, read_write> window_occluders: array<u32>;
// [square][turn][view][word], one bit for each bin.
@group(0) @binding(8) var<storage, read_write> square_bins: array<u32>;
// [tile][turn][view][entry], packed `Group`; or the shift and flags of a view in which an occluder covers the tile.
@group(0) @binding(9) var<storage, read_write> groups: array<vec2u>;
// [tile][turn][index]: the shift of a view's first group, and the view. Views in which an occluder covers the tile come first; from
// bit FOCUS_SHIFT on these have the bin whose focus counts for the occluder.
@group(0) @binding(10) var<storage, read_write> ordered_views: array<vec2u>;
// [tile][turn]: the number of views in which an occluder covers the tile.
@group(0) @binding(11) var<storage, read_write> covered_views: array<u32>;
// Number of entries of the longest list, which may exceed the capacity.
@group(0) @binding(12) var<storage, read_write> longest_list: atomic<u32>;
// Red, green, blue, alpha; one array layer for each layer of the stack.
@group(0) @binding(13) var colors: texture_2d_array<f32>;
// [turn][view].
@group(0) @binding(14) var<storage, read> views: array<View>;
// Planes: red, green, blue, rays in focus, rays that end in the background, lost rays, rays hidden by the barrel. With near light, also its
// red, green and blue, the rays that near surfaces stop, and the same times their CoC radius.
@group(0) @binding(15) var<storage, read_write> sums: array<f32>;
// Planes: red, green, blue, alpha, share of rays in focus. With near light, also its CoC radius, red, green and blue, and the share of rays
// that near surfaces stop, or three of them: for red, for green and alpha, and for blue.
@group(0) @binding(16) var<storage, read_write> picture: array<f32>;
// [bin], two to a vector: how far the bin counts as in focus, as the bits of a number, or for a bin that counts as near its negative CoC
// radius in pixels; and the nearest bin that may hold an earlier hit of the same translucent surface.
@group(0) @binding(17) var<uniform> bin_table: array<vec4u, HALF_MAX_BINS>;
// The rows that the band reads: share of the background in the pixel, CoC radius of the pixel's last fragment in pixels, and share of
// averages in the pixel, and share of the background behind a fragment that a ray passes beside in the pixel.
@group(0) @binding(18) var pixels: texture_2d_array<f32>;

// [layer][row][column] of the whole picture: how much of a ray to the pixel sees light that moves, and the fragment's CoC radius.
@group(0) @binding(23) var<storage, read> mirrors: array<vec2f>;

// A lens sample.
struct View {
    // Point on the aperture, in aperture radii.
    lens_x: f32,
    lens_y: f32,
    // Place in the pixel, and shift by aberrations, in pixels.
    jitter_x: f32,
    jitter_y: f32,
    shift_x: f32,
    shift_y: f32,
    // Shift at the CoC radius at infinity.
    at_infinity: u32,
}

// The program defines OPAQUE_ALPHA, MIN_TRANSMITTANCE, MIN_HIT_VIEWS, the layout of keys, BIN_BITS and HALF_MAX_BINS (of the largest
// number of bins), LEVELS of blocks of bins, MAX_TRANSLUCENT_LAYERS, and the sides TILE and BLOCK in pixels and SQUARE in tiles.

// Constants of a pipeline: whether the stack has more layers than a texel of keys, whether a barrel hides views, and whether the
// background is visible.
override MANY_LAYERS = true;
override BARREL = true;
override BACKGROUND = true;

// Whether near light is kept apart: what rays gather from near surfaces. CPU version: src/methods/shear/near.rs.
override NEAR = true;

// Whether this is the first batch, and the last one, of a set of views.
override FIRST_BATCH = true;
override LAST_BATCH = true;

// Side of a window in blocks: as many as a tile can touch.
const WINDOW = TILE / BLOCK + 1u;

// Distance in rows and columns between the pixels of a thread.
const APART = TILE / 2u;

// Share of the view through `lens` that the barrel lets pass to `pixel`.
fn barrel_transmittance(lens: vec2f, pixel: vec2u) -> f32 {
    let position = vec2f(pixel) + vec2f(0.5, 0.5 + f32(params.band_start));
    let height = (position - vec2f(params.axis_x_px, params.axis_y_px)) / params.half_diagonal_px;
    let within = 1.0 - length(lens - params.cats_eye * height);
    return clamp(within / params.softness + 0.5, 0.0, 1.0);
}

// The order of no fragment.
const NONE = 0xffffffffu;

// The keys of the four layers from `4 · slice` on.
fn keys_at(source: vec2u, slice: u32) -> vec4u {
    return textureLoad(keys, source, slice, 0);
}

fn last_bin(key: u32) -> u32 {
    return (key >> BIN_SHIFT) + ((key >> EXTRA_SHIFT) & EXTRA_MASK);
}

// The blocks of bins that the CPU paints at once: the largest ones of up to 2^(LEVELS − 1) bins that are aligned to multiples of their
// size and lie within a group. Within a block layers are in order. The block of size 2^l around a bin lies within a group if the bin
// before the group and the one after it differ from that bin in a bit from the l-th on.

// For bins of `group`, one less than the size of their blocks.
fn rests_of(bins: vec4u, group: Group) -> vec4u {
    var differing = min(bins ^ vec4u(group.first - 1u), bins ^ vec4u(group.end));
    differing = min(differing, vec4u((1u << LEVELS) - 1u));
    // All bits below the highest one.
    differing |= differing >> vec4u(1u);
    differing |= differing >> vec4u(2u);
    differing |= differing >> vec4u(4u);
    return differing >> vec4u(1u);
}

// The first bins of the blocks of `group` that have `bins`.
fn blocks_of(bins: vec4u, group: Group) -> vec4u {
    return bins & ~rests_of(bins, group);
}

// The bin in the middle of the block of `group` that has `bin`: its CoC radius is the block's.
fn middle_of(bin: u32, group: Group) -> u32 {
    let rest = rests_of(vec4u(bin), group).x;
    return (bin & ~rest) + ((rest + 1u) >> 1u);
}

// The entry of `bin` in `bin_table`.
fn of_bin(bin: u32) -> vec2u {
    let two = bin_table[bin >> 1u];
    return select(two.xy, two.zw, (bin & 1u) != 0u);
}

// How far `bin` counts as in focus, or the negative CoC radius of a bin that counts as near.
fn value_of(bin: u32) -> f32 {
    return bitcast<f32>(of_bin(bin).x);
}

// Colour of near surfaces, in the fourth component how far they stop rays, and that times their CoC radius.
struct NearLight {
    light: vec4f,
    radius: f32,
}

const NOTHING_NEAR = NearLight(vec4f(0.0), 0.0);

// What a ray that gathers `light`, a colour and a coverage, in a bin of `value` gathers from near surfaces.
fn near_light(value: f32, light: vec4f) -> NearLight {
    if !NEAR || value >= 0.0 {
        return NOTHING_NEAR;
    }
    let t = clamp((-value - NEAR_FROM_PX) / (NEAR_FULL_FROM_PX - NEAR_FROM_PX), 0.0, 1.0);
    let share = t * t * (3.0 - 2.0 * t);
    return NearLight(share * light, share * -value * light.a);
}

fn near_sum(a: NearLight, b: NearLight) -> NearLight {
    return NearLight(a.light + b.light, a.radius + b.radius);
}

// The order of the nearest fragment of `group` at `source`, among the four layers from `4 · slice` on, whose order is at least
// `start`. Fragments are ordered by the block of their first bin in the group, then by layer: an order has the block's first bin from
// bit BIN_SHIFT on, and the layer.
fn nearest_of_four(group: Group, source: vec2u, slice: u32, start: u32) -> u32 {
    let key = keys_at(source, slice);
    let first = key >> vec4u(BIN_SHIFT);
    let last = first + ((key >> vec4u(EXTRA_SHIFT)) & vec4u(EXTRA_MASK));
    let inside = (first < vec4u(group.end)) & (last >= vec4u(group.first));
    let block = blocks_of(max(first, vec4u(group.first)), group);
    let order = (block << vec4u(BIN_SHIFT)) | (vec4u(4u * slice) + vec4u(0u, 1u, 2u, 3u));
    let found = select(vec4u(NONE), order, inside & (order >= vec4u(start)));
    return min(min(found.x, found.y), min(found.z, found.w));
}

// The order of the nearest fragment of `group` at `source` whose order is at least `start`, or NONE.
fn nearest(group: Group, source: vec2u, start: u32) -> u32 {
    var best = nearest_of_four(group, source, 0u, start);
    if MANY_LAYERS {
        for (var slice = 1u; 4u * slice < params.layers; slice++) {
            best = min(best, nearest_of_four(group, source, slice, start));
        }
    }
    return best;
}

fn layer_of(order: u32) -> u32 {
    return order & ((1u << BIN_SHIFT) - 1u);
}

// The turn of a row of the band.
fn turn_of(row: u32) -> u32 {
    return (params.band_start + row) % params.turns;
}

// Pixel `i` of the four of a thread, one in each quarter of a tile.
fn pixel_of(tile: vec2u, at: vec2u, i: u32) -> vec2u {
    return TILE * tile + at + APART * vec2u(i & 1u, i >> 1u);
}

// Share of the rays of `view` that the barrel lets pass to `pixel`.
fn passing_to(view: View, pixel: vec2u) -> f32 {
    if !BARREL {
        return 1.0;
    }
    return barrel_transmittance(vec2f(view.lens_x, view.lens_y), pixel);
}

// What `pixels` has at `pixel` of the band moved by `shift`.
fn background_at(pixel: vec2u, shift: vec2i) -> vec4f {
    return textureLoad(pixels, source_of(pixel, shift), 0u, 0);
}

// Where a ray of `view` from `pixel` ends that has `left` of its light: in the background, or where the stack has nothing. CPU version:
// `Background::met_by`.
fn end_of(view: View, pixel: vec2u, left: f32) -> vec2f {
    if !BACKGROUND || left <= 0.0 {
        return vec2f(0.0, left);
    }
    let at_infinity = background_at(pixel, unpacked_shift(view.at_infinity));
    var share = at_infinity.x;
    if share < 1.0 {
        let moved = at_infinity.y * vec2f(view.lens_x, view.lens_y) + vec2f(view.jitter_x, view.jitter_y);
        let shift = vec2i(floor(moved + vec2f(view.shift_x, view.shift_y) + 0.5));
        share = max(share, background_at(pixel, shift).w);
    }
    let transparent = min(left, share);
    return vec2f(transparent, left - transparent);
}

// What a ray gathers: colour, and in the fourth component the coverage in focus; and what of it is near.
struct Light {
    all: vec4f,
    near: NearLight,
}

const NO_LIGHT = Light(vec4f(0.0), NOTHING_NEAR);

// The light of a fragment of `color` and `coverage` in a bin of `value`.
fn light_of(value: f32, color: vec3f, coverage: f32) -> Light {
    return Light(vec4f(color, coverage * max(value, 0.0)), near_light(value, vec4f(color, coverage)));
}

// The sample of the fragment of CoC radius `coc` at `source`, a place of the whole picture, that `ray` has met: of those of its pixel, the
// nearest one to the ray at that depth. CPU version: `Mirrors::met`.
fn met_sample(layer: u32, source: vec2i, coc: f32, ray: LensRay) -> Met {
    let side = u32(reflecting.supersample);
    let place = ray.start + coc * ray.step;
    var least = BEYOND;
    var best = Met(layer, NONE);
    for (var index = 0u; index < side * side; index++) {
        let at = source * i32(side) + vec2i(i32(index % side), i32(index / side));
        let from_place = vec2f(at) + 0.5 - place;
        let apart = min(dot(from_place, from_place), 1e4);
        for (var other = 0u; other < reflecting.layers; other++) {
            let fragment = reflecting_in(other, at);
            if fragment == 0u || dot(of_fragment(fragment, 2u).zw, vec2f(1.0)) <= 0.0 {
                continue;
            }
            let off = max(abs(of_fragment(fragment, 0u).w - coc) - MIRROR_SAME_PX, 0.0);
            let cost = 1e4 * off + apart;
            if cost < least {
                least = cost;
                best = Met(other, index);
            }
        }
    }
    return best;
}

// What a ray of `view` from `pixel` sees of light that moves in the fragment of `layer` at `source`, and the weight of it.
fn reflection_at(view: View, pixel: vec2u, source: vec2u, layer: u32) -> vec4f {
    if !REFLECTS {
        return vec4f(0.0);
    }
    let at = vec2i(source + vec2u(0u, params.source_start));
    let own = mirrors[(layer * params.height + u32(at.y)) * params.width + u32(at.x)];
    if own.x <= 0.0 {
        return vec4f(0.0);
    }
    let off = vec2f(view.jitter_x + view.shift_x, view.jitter_y + view.shift_y);
    let place = vec2f(pixel + vec2u(0u, params.band_start)) + 0.5 + off;
    let step = vec2f(view.lens_x, view.lens_y) * reflecting.supersample;
    let inverse = select(vec2f(0.0), 1.0 / step, abs(step) > vec2f(STEEP));
    let ray = lens_ray(place * reflecting.supersample, step, inverse);
    var met = Met(layer, 0u);
    if reflecting.supersample > 1.0 {
        met = met_sample(layer, at, own.y, ray);
        if met.fragment == NONE {
            return vec4f(0.0, 0.0, 0.0, own.x);
        }
    }
    let side = u32(reflecting.supersample);
    let sample = at * i32(side) + vec2i(i32(met.fragment % side), i32(met.fragment / side));
    let moved = moved_light(met.layer, sample, ray);
    if moved.share <= 0.0 {
        return vec4f(0.0, 0.0, 0.0, own.x);
    }
    return vec4f(own.x * (moved.seen / moved.share), own.x);
}

// The light of a `reflection` in a fragment in a bin of `value`, which is no more in focus where its surface is.
fn reflected_light(value: f32, reflection: vec4f) -> Light {
    return Light(vec4f(reflection.rgb, -reflection.a * max(value, 0.0)), NOTHING_NEAR);
}

// `light`, `share` of it.
fn scaled(light: Light, share: f32) -> Light {
    return Light(share * light.all, NearLight(share * light.near.light, share * light.near.radius));
}

fn light_sum(a: Light, b: Light) -> Light {
    return Light(a.all + b.all, near_sum(a.near, b.near));
}

// The bin whose value counts for a fragment that is met in `bin` of `group`, before focus: that in the middle of the CPU's block, which is
// no wider than two pixels.
fn near_middle_of(bin: u32, group: Group) -> u32 {
    let pairs = u32(bin >= params.near_pairs_from) + u32(bin >= params.near_fours_from);
    let level = pairs + u32(bin >= params.near_eights_from) + u32(bin >= params.near_sixteens_from);
    let rest = min(rests_of(vec4u(bin), group).x, (1u << level) - 1u);
    return (bin & ~rest) + ((rest + 1u) >> 1u);
}

// The value of the bin in which a ray meets the fragment of `order` in `group` at `source`.
fn value_at(order: u32, group: Group, source: vec2u) -> f32 {
    let first = order >> BIN_SHIFT;
    if !NEAR || first >= params.near_end {
        return value_of(middle_of(first, group));
    }
    let layer = layer_of(order);
    let key = keys_at(source, layer >> 2u)[layer & 3u];
    return value_of(near_middle_of(max(key >> BIN_SHIFT, group.first), group));
}

// Sums over the rays of a pixel.
struct RaySums {
    // Colour, and in the fourth component the rays that hit something in focus.
    light: vec4f,
    // Rays that end in the background, lost rays, and rays that the barrel hides.
    transparent: f32,
    lost: f32,
    hidden: f32,
    near: NearLight,
}

const NO_RAYS = RaySums(vec4f(0.0), 0.0, 0.0, 0.0, NOTHING_NEAR);

// `sums` with a ray of `view` from `pixel` that the barrel lets `passing` pass, that gathered `light`, and that has `left` of its light.
fn with_ray(sums: RaySums, view: View, pixel: vec2u, passing: f32, light: Light, left: f32) -> RaySums {
    let ends = end_of(view, pixel, left);
    return RaySums(
        sums.light + light.all,
        sums.transparent + ends.x,
        sums.lost + ends.y,
        sums.hidden + 1.0 - passing,
        near_sum(sums.near, light.near),
    );
}

// Index of a view in the order [turn][view].
fn view_index(turn: u32, view: u32) -> u32 {
    return turn * params.batch_views + view;
}

// Index of a tile's turn in the order [tile][turn].
fn tile_turn(tile: vec2u, turn: u32) -> u32 {
    return (tile.y * tiles_size().x + tile.x) * params.turns + turn;
}

// Index of the first entry of the list of `view` for `tile`.
fn list_of(tile: vec2u, turn: u32, view: u32) -> u32 {
    return (tile_turn(tile, turn) * params.batch_views + view) * params.entries;
}

// From this bit on, an entry of `ordered_views` has a bin; the view is in the bits below.
const FOCUS_SHIFT = 16u;

// The entries of a tile and turn in `ordered_views`: covered views are first .. covered_end, the others covered_end .. end.
struct TileViews {
    first: u32,
    covered_end: u32,
    end: u32,
}

fn views_of(tile: vec2u, turn: u32) -> TileViews {
    let index = tile_turn(tile, turn);
    let first = index * params.batch_views;
    return TileViews(first, first + covered_views[index], first + params.batch_views);
}

// A view in which an occluder covers a tile: the shift, and the value of the occluder's bin.
struct CoveredView {
    view: View,
    shift: vec2i,
    value: f32,
}

fn covered_view(index: u32, turn: u32) -> CoveredView {
    let entry = ordered_views[index];
    let view = views[view_index(turn, entry.y & ((1u << FOCUS_SHIFT) - 1u))];
    return CoveredView(view, unpacked_shift(entry.x), value_of(entry.y >> FOCUS_SHIFT));
}

// `sums` with the ray from `pixel` of a view in which an occluder covers the tile: its hit is known without keys.
fn with_covered_ray(sums: RaySums, covered: CoveredView, pixel: vec2u) -> RaySums {
    let passing = passing_to(covered.view, pixel);
    let source = source_of(pixel, covered.shift);
    let color = textureLoad(colors, source, 0u, 0).rgb;
    let reflection = reflected_light(covered.value, reflection_at(covered.view, pixel, source, 0u));
    let light = scaled(light_sum(light_of(covered.value, color, 1.0), reflection), passing);
    return RaySums(
        sums.light + light.all,
        sums.transparent,
        sums.lost,
        sums.hidden + 1.0 - passing,
        near_sum(sums.near, light.near),
    );
}

// The fragment that a ray hits: the sample, the order, and the value of its bin; NONE for a ray that has not hit any.
struct Hit {
    source: vec2u,
    order: u32,
    value: f32,
}

const NO_HIT = Hit(vec2u(0u), NONE, 0.0);

// `hit`, or the hit of the ray through `pixel` in `group` if it has not hit anything before.
fn next_hit(hit: Hit, group: Group, pixel: vec2u) -> Hit {
    if hit.order != NONE {
        return hit;
    }
    let source = source_of(pixel, unpacked_shift(group.shift));
    let order = nearest(group, source, 0u);
    if order == NONE {
        return hit;
    }
    return Hit(source, order, value_at(order, group, source));
}

// `sums` with a ray of `view` from `pixel` that ends at `hit`.
fn with_opaque_ray(sums: RaySums, view: View, pixel: vec2u, hit: Hit) -> RaySums {
    let passing = passing_to(view, pixel);
    if hit.order == NONE {
        return with_ray(sums, view, pixel, passing, NO_LIGHT, passing);
    }
    let layer = layer_of(hit.order);
    let color = textureLoad(colors, hit.source, layer, 0).rgb;
    let reflection = reflected_light(hit.value, reflection_at(view, pixel, hit.source, layer));
    let light = light_sum(light_of(hit.value, color, 1.0), reflection);
    return with_ray(sums, view, pixel, passing, scaled(light, passing), 0.0);
}

@compute @workgroup_size(16, 16)
fn paint(@builtin(local_invocation_id) local: vec3u, @builtin(workgroup_id) tile_id: vec3u) {
    let at = local.xy;
    let tile = tile_id.xy;
    // APART is a multiple of the number of turns: the four pixels have the same.
    let turn = turn_of(at.y);
    let of_tile = views_of(tile, turn);
    var first = NO_RAYS;
    var second = NO_RAYS;
    var third = NO_RAYS;
    var fourth = NO_RAYS;
    for (var i = of_tile.first; i < of_tile.covered_end; i++) {
        let covered = covered_view(i, turn);
        first = with_covered_ray(first, covered, pixel_of(tile, at, 0u));
        second = with_covered_ray(second, covered, pixel_of(tile, at, 1u));
        third = with_covered_ray(third, covered, pixel_of(tile, at, 2u));
        fourth = with_covered_ray(fourth, covered, pixel_of(tile, at, 3u));
    }
    for (var i = of_tile.covered_end; i < of_tile.end; i++) {
        let number = ordered_views[i].y;
        let list = list_of(tile, turn, number);
        var first_hit = NO_HIT;
        var second_hit = NO_HIT;
        var third_hit = NO_HIT;
        var fourth_hit = NO_HIT;
        var entry = 0u;
        loop {
            let next = groups[list + entry];
            let group = unpacked(next);
            first_hit = next_hit(first_hit, group, pixel_of(tile, at, 0u));
            second_hit = next_hit(second_hit, group, pixel_of(tile, at, 1u));
            third_hit = next_hit(third_hit, group, pixel_of(tile, at, 2u));
            fourth_hit = next_hit(fourth_hit, group, pixel_of(tile, at, 3u));
            entry++;
            let max_order = max(max(first_hit.order, second_hit.order), max(third_hit.order, fourth_hit.order));
            if (next.y & LAST) != 0u || max_order != NONE {
                break;
            }
        }
        let view = views[view_index(turn, number)];
        first = with_opaque_ray(first, view, pixel_of(tile, at, 0u), first_hit);
        second = with_opaque_ray(second, view, pixel_of(tile, at, 1u), second_hit);
        third = with_opaque_ray(third, view, pixel_of(tile, at, 2u), third_hit);
        fourth = with_opaque_ray(fourth, view, pixel_of(tile, at, 3u), fourth_hit);
    }
    add_batch(pixel_of(tile, at, 0u), first);
    add_batch(pixel_of(tile, at, 1u), second);
    add_batch(pixel_of(tile, at, 2u), third);
    add_batch(pixel_of(tile, at, 3u), fourth);
}

// [layer]: the last bin of the block, or blocks, in which the thread's ray last hit a translucent fragment, below the number of the
// ray (counted from 1) from bit BIN_BITS on. Entries of earlier rays are smaller than those of the current one.
var<private> translucent_hits: array<u32, MAX_TRANSLUCENT_LAYERS>;

// Whether a hit of the translucent fragment of `order` and `key` in `group` is in a surface that the thread's ray `number` hit before;
// remembers it. A fragment counts once in a group, whatever its number of blocks there. CPU version: `TranslucentHits`.
fn hit_before(group: Group, order: u32, key: u32, number: u32) -> bool {
    let stamp = number << BIN_BITS;
    let same_from = stamp | of_bin(order >> BIN_SHIFT).y;
    let layer = layer_of(order);
    var before = translucent_hits[layer] >= same_from;
    if (key & CHANGES_PEEL) != 0u {
        // Bins from the group's first on lie at the same sample, and two fragments of one sample are two surfaces.
        let same_sample_from = stamp | group.first;
        for (var other = 0u; other < params.layers; other++) {
            let last = translucent_hits[other];
            before |= last >= same_from && last < same_sample_from;
        }
    }
    let last = min(last_bin(key), group.end - 1u);
    translucent_hits[layer] = stamp | last | rests_of(vec4u(last), group).x;
    return before;
}

// Light that a ray gathers; the transmittance after it, 0 for an occluded ray;
// and the transmittance that the ray had when it came to count as occluded.
struct Composite {
    light: Light,
    transmittance: f32,
    spent: f32,
}

// Composites the fragments of `group` at `pixel` along the thread's ray `number` of `view`, of transmittance `before`, front to back.
fn composite(view: View, group: Group, pixel: vec2u, number: u32, before: f32) -> Composite {
    var light = NO_LIGHT;
    var transmittance = before;
    let source = source_of(pixel, unpacked_shift(group.shift));
    var start = 0u;
    loop {
        let order = nearest(group, source, start);
        if order == NONE {
            break;
        }
        start = order + 1u;
        let layer = layer_of(order);
        let key = keys_at(source, layer >> 2u)[layer & 3u];
        if (key & OPAQUE) == 0u && hit_before(group, order, key, number) {
            continue;
        }
        let color = textureLoad(colors, source, layer, 0);
        let alpha = select(color.a, 1.0, (key & OPAQUE) != 0u);
        let value = value_at(order, group, source);
        let reflection = reflected_light(value, reflection_at(view, pixel, source, layer));
        light = light_sum(light, scaled(light_sum(light_of(value, color.rgb, alpha), reflection), transmittance));
        transmittance *= 1.0 - alpha;
        if transmittance < MIN_TRANSMITTANCE {
            return Composite(light, 0.0, transmittance);
        }
    }
    return Composite(light, transmittance, 0.0);
}

@compute @workgroup_size(16, 16)
fn paint_translucent(@builtin(global_invocation_id) global: vec3u) {
    let pixel = global.xy;
    let tile = pixel / TILE;
    let turn = turn_of(pixel.y);
    let of_tile = views_of(tile, turn);
    var total = NO_RAYS;
    for (var i = of_tile.first; i < of_tile.covered_end; i++) {
        total = with_covered_ray(total, covered_view(i, turn), pixel);
    }
    for (var i = of_tile.covered_end; i < of_tile.end; i++) {
        let view_number = ordered_views[i].y;
        let view = views[view_index(turn, view_number)];
        let list = list_of(tile, turn, view_number);
        let ray_number = i - of_tile.covered_end + 1u;
        let passing = passing_to(view, pixel);
        var light = NO_LIGHT;
        var transmittance = passing;
        var spent = 0.0;
        var entry = 0u;
        while transmittance > 0.0 {
            let next = groups[list + entry];
            let passed = composite(view, unpacked(next), pixel, ray_number, transmittance);
            light = light_sum(light, passed.light);
            transmittance = passed.transmittance;
            spent = passed.spent;
            entry++;
            if (next.y & LAST) != 0u {
                break;
            }
        }
        total = with_ray(total, view, pixel, passing, light, transmittance);
        total.lost += spent;
    }
    add_batch(pixel, total);
}

// `value` in the place of `before` by `weight`.
fn blended(before: f32, value: f32, weight: f32) -> f32 {
    return select(before + weight * (value - before), value, weight >= 1.0);
}

// Writes a pixel of the picture: the mean over all views but those that the barrel hides. Lost rays are left out of the mean, or count
// as opaque black. The planes are red, green, blue, alpha, and the share of rays that hit something in focus.
fn write_pixel(at: vec2u, sum: RaySums) {
    let plane = params.width * params.band_rows;
    let pixel = at.y * params.width + at.x;
    let views = f32(params.views) - sum.hidden;
    let known = views - sum.lost;
    let weight = select(known, views, params.lost_are_black != 0u);
    let covered = weight - sum.transparent;
    // Light without alpha has colour where nothing is covered.
    let has_views = weight > MIN_HIT_VIEWS;
    let is_covered = has_views && covered > MIN_HIT_VIEWS;
    let mean = select(vec4f(0.0), vec4f(sum.light.rgb, covered) / weight, vec4<bool>(vec3<bool>(has_views), is_covered));
    var share = 1.0;
    if params.blends != 0u {
        share = textureLoad(pixels, source_of(at, vec2i(0)), 0u, 0).z;
    }
    for (var channel = 0u; channel < 4u; channel++) {
        if (params.channels & (1u << channel)) != 0u {
            let index = channel * plane + pixel;
            picture[index] = blended(picture[index], mean[channel], share);
        }
    }
    if (params.channels & 8u) != 0u {
        let index = 4u * plane + pixel;
        picture[index] = blended(picture[index], sum.light.a / max(views, MIN_HIT_VIEWS), share);
    }
    if NEAR {
        let near = select(vec4f(0.0), sum.near.light / weight, has_views);
        let radius = select(0.0, sum.near.radius / weight, has_views);
        if (params.channels & 8u) != 0u {
            let index = 5u * plane + pixel;
            picture[index] = blended(picture[index], radius, share);
        }
        for (var channel = 0u; channel < 3u; channel++) {
            if (params.channels & (1u << channel)) != 0u {
                let index = (6u + channel) * plane + pixel;
                picture[index] = blended(picture[index], near[channel], share);
            }
        }
        let index = params.near_share_plane * plane + pixel;
        picture[index] = blended(picture[index], near.a, share);
    }
}

// Adds the sums of a batch to those of the batches before it; the last batch writes the picture.
fn add_batch(at: vec2u, batch_sum: RaySums) {
    if at.x >= params.width || at.y >= params.band_rows {
        return;
    }
    var sum = batch_sum;
    let plane = params.width * params.band_rows;
    let pixel = at.y * params.width + at.x;
    if !FIRST_BATCH {
        sum.light += vec4f(sums[pixel], sums[plane + pixel], sums[2u * plane + pixel], sums[3u * plane + pixel]);
        sum.transparent += sums[4u * plane + pixel];
        sum.lost += sums[5u * plane + pixel];
        sum.hidden += sums[6u * plane + pixel];
        if NEAR {
            let first = 7u * plane + pixel;
            let light = vec4f(sums[first], sums[first + plane], sums[first + 2u * plane], sums[first + 3u * plane]);
            sum.near = near_sum(sum.near, NearLight(light, sums[first + 4u * plane]));
        }
    }
    if LAST_BATCH {
        write_pixel(at, sum);
    } else {
        sums[pixel] = sum.light.r;
        sums[plane + pixel] = sum.light.g;
        sums[2u * plane + pixel] = sum.light.b;
        sums[3u * plane + pixel] = sum.light.a;
        sums[4u * plane + pixel] = sum.transparent;
        sums[5u * plane + pixel] = sum.lost;
        sums[6u * plane + pixel] = sum.hidden;
        if NEAR {
            let first = 7u * plane + pixel;
            for (var i = 0u; i < 4u; i++) {
                sums[first + i * plane] = sum.near.light[i];
            }
            sums[first + 4u * plane] = sum.near.radius;
        }
    }
}
