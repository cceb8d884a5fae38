// Lens rays against depth layers, by false position, thickened to cones: twin of src/methods/layer_rays/, whose module heads have
// the reasons.
//
// follow         the rays of a go of views, added to the sums, where no cone is wider than a sample
// follow_cones   the same for any cones
// central        the ray through the middle of each pixel and lens, where nothing is known of any other
//
// A ray is over sample position start + c·step at CoC radius c. Positions are those of the whole stack, whichever rows of it are at
// hand. Fragments, layers, N-buffers and mipmaps are the CPU's tables.

// The rows of the stack at hand, and how rays meet them.
struct Frame {
    // Columns of the picture; its first row that is made, and how many are.
    width: u32,
    row: u32,
    rows: u32,
    // Views of a set, and sets.
    views: u32,
    sets: u32,
    // Samples of a pixel along each axis.
    supersample: f32,
    // Columns and rows of the whole stack, in samples; the first of its rows at hand, and the last.
    columns: u32,
    height: u32,
    top: u32,
    bottom: u32,
    // Fragments that a sample may have.
    depth: u32,
    // Layers; neighbouring ones share an N-buffer, a slab of them each.
    layers: u32,
    layers_per_slab: u32,
    slabs: u32,
    // The grid of blocks that N-buffers are kept for, and blocks a sample.
    block_columns: u32,
    block_rows: u32,
    blocks_per_sample: f32,
    // Mipmap levels above the stack itself, and the diameter of a cone in samples for each pixel of CoC radius.
    levels: u32,
    cone_per_coc_px: f32,
    // Steps of false position.
    iterations: u32,
    // Whether rays that leave the frame are left out.
    discard_outside: u32,
}

// A lens sample, as rays need it: where in the pixel, and how far for each pixel of CoC radius, in samples.
struct View {
    start_x: f32,
    start_y: f32,
    step_x: f32,
    step_y: f32,
}

// What one layer has in a texel of a mipmap: colour (premultiplied) and coverage.
struct Texel {
    layer: u32,
    red: f32,
    green: f32,
    blue: f32,
    alpha: f32,
}

@group(0) @binding(3) var<uniform> frame: Frame;
// [set][view].
@group(0) @binding(4) var<storage, read> views: array<View>;
// [row][column][fragment]: CoC radius, rising; ABSENT where there is no further fragment.
@group(0) @binding(5) var<storage, read> coc_px: array<f32>;
// The same for red and green, and for blue and alpha.
@group(0) @binding(6) var<storage, read> red_green: array<vec2f>;
@group(0) @binding(7) var<storage, read> blue_alpha: array<vec2f>;
// Per slab, where its N-buffer begins, how many levels it has, and the bits of how far rays go in it; per layer the bits of its
// near and its far bound, and its slab; then the bits of the N-buffers, [slab][level][row][column].
@group(0) @binding(8) var<storage, read> culling: array<u32>;
// Per level of the mipmaps its columns, its first and its last row at hand, its last row in all, and where its starts begin; then
// the starts: where each texel's list begins, and where the last one ends.
@group(0) @binding(9) var<storage, read> starts: array<u32>;
// The lists, each in the order of the layers.
@group(0) @binding(10) var<storage, read> texels: array<Texel>;

// The program's are OPAQUE_ALPHA; ABSENT, farther than any fragment; MOST_SLABS; and SLAB_WORDS, LAYER_WORDS and LEVEL_WORDS, the words
// of a slab, a layer and a level.

// A cone that is wider than a sample is of this mipmap level at least.
const LEAST_LEVEL: f32 = 1e-7;

struct Ray {
    start: vec2f,
    step: vec2f,
}

// Where a ray meets a layer.
struct Hit {
    found: bool,
    // CoC radius at which it does.
    at: f32,
    // Which fragment it meets.
    index: u32,
    // CoC radius of that fragment.
    coc_px: f32,
}

// What a ray has seen, what of it goes on, and whether it counts.
struct Seen {
    color: vec3f,
    transmitted: f32,
    counts: bool,
}

// A number that looks drawn by chance, of the pixel alone (Jarzynski & Olano 2020, pcg2d).
fn hash(pixel: vec2u) -> u32 {
    var v = pixel * 1664525u + 1013904223u;
    v.x += v.y * 1664525u;
    v.y += v.x * 1664525u;
    v ^= v >> vec2u(16u);
    v.x += v.y * 1664525u;
    return v.x ^ (v.x >> 16u);
}

fn ray_at(ray: Ray, c: f32) -> vec2f {
    return ray.start + c * ray.step;
}

// CoC radii between which `ray` is within the frame; it passes the plane of focus within it.
fn stay(ray: Ray) -> vec2f {
    let size = vec2f(f32(frame.columns), f32(frame.height));
    let still = ray.step == vec2f(0.0);
    let step = select(ray.step, vec2f(1.0), still);
    let a = -ray.start / step;
    let b = (size - ray.start) / step;
    // A ray that stands still never leaves.
    let enters = select(min(min(a, b), vec2f(0.0)), vec2f(-ABSENT), still);
    let leaves = select(max(max(a, b), vec2f(0.0)), vec2f(ABSENT), still);
    return vec2f(max(enters.x, enters.y), min(leaves.x, leaves.y));
}

// Near and far bound of a layer.
fn interval(layer: u32) -> vec2f {
    let word = SLAB_WORDS * frame.slabs + LAYER_WORDS * layer;
    return vec2f(bitcast<f32>(culling[word]), bitcast<f32>(culling[word + 1u]));
}

// The slab that a layer is of.
fn slab_of(layer: u32) -> u32 {
    return culling[SLAB_WORDS * frame.slabs + LAYER_WORDS * layer + 2u];
}

// The least CoC radius of a slab in the blocks that hold the rectangle from `least` to `greatest`.
fn nearest_within(slab: u32, least: vec2f, greatest: vec2f) -> f32 {
    let levels = culling[SLAB_WORDS * slab + 1u];
    if levels == 0u {
        return ABSENT;
    }
    let last = vec2f(f32(frame.block_columns - 1u), f32(frame.block_rows - 1u));
    let begin = vec2u(clamp(least * frame.blocks_per_sample, vec2f(0.0), last));
    let end = max(vec2u(clamp(greatest * frame.blocks_per_sample, vec2f(0.0), last)), begin) + 1u;
    let shorter = min(end.x - begin.x, end.y - begin.y);
    let level = min(firstLeadingBit(shorter), levels - 1u);
    let side = 1u << level;
    let values = culling[SLAB_WORDS * slab] + level * frame.block_columns * frame.block_rows;
    var nearest = ABSENT;
    for (var y = begin.y; y < end.y; y += side) {
        let row = values + min(y, end.y - side) * frame.block_columns;
        for (var x = begin.x; x < end.x; x += side) {
            nearest = min(nearest, bitcast<f32>(culling[row + min(x, end.x - side)]));
        }
    }
    return nearest;
}

// The slabs that rays through the pixel whose centre is at sample position `centre` can meet, a bit each.
fn slabs_around(centre: vec2f) -> vec2u {
    var slabs = vec2u(0u);
    for (var slab = 0u; slab < frame.slabs; slab++) {
        let reach = bitcast<f32>(culling[SLAB_WORDS * slab + 2u]);
        if nearest_within(slab, centre - reach, centre + reach) < ABSENT {
            slabs[slab >> 5u] |= 1u << (slab & 31u);
        }
    }
    return slabs;
}

// Whether `ray` can meet anything in a layer of `slab` that holds the CoC radii of `bounds`.
fn can_meet(ray: Ray, slab: u32, bounds: vec2f) -> bool {
    let a = ray_at(ray, bounds.x);
    let b = ray_at(ray, bounds.y);
    return nearest_within(slab, min(a, b), max(a, b)) <= bounds.y;
}

// The layer's nearest fragment where the ray is at `c`, as if it were met there: of the CoC radii of `bounds`, and of those behind
// `behind`.
fn over(ray: Ray, bounds: vec2f, behind: f32, c: f32) -> Hit {
    let least = vec2f(0.0, f32(frame.top));
    let last = vec2f(f32(frame.columns - 1u), f32(frame.bottom));
    let place = vec2u(clamp(ray_at(ray, c), least, last));
    let first = ((place.y - frame.top) * frame.columns + place.x) * frame.depth;
    for (var k = 0u; k < frame.depth; k++) {
        let coc = coc_px[first + k];
        if coc >= bounds.x && coc > behind {
            return Hit(coc <= bounds.y, c, first + k, coc);
        }
    }
    return Hit(false, c, first, ABSENT);
}

// Where a ray that is `ahead` before the surface at the first of `ends` and `past` behind it at the second crosses the straight line
// between.
fn crossing(ends: vec2f, ahead: f32, past: f32) -> f32 {
    let whole = ahead + past;
    var share = 0.0;
    if whole > 0.0 {
        share = ahead / whole;
    }
    return clamp(ends.x + (ends.y - ends.x) * share, ends.x, ends.y);
}

// Where the ray meets the height field of a layer, by false position.
fn meet(ray: Ray, bounds: vec2f, behind: f32) -> Hit {
    var ends = bounds;
    let first = over(ray, bounds, behind, bounds.x);
    let last = over(ray, bounds, behind, bounds.y);
    var begun = first.found;
    var ahead = select(bounds.y, first.coc_px, first.found) - ends.x;
    var past = ends.y - select(bounds.x, last.coc_px, last.found);
    var at = crossing(ends, ahead, past);
    for (var i = 0u; i < frame.iterations; i++) {
        let found = over(ray, bounds, behind, at);
        let height = select(select(bounds.y, bounds.x, begun), found.coc_px, found.found);
        if height > at {
            begun = begun || found.found;
            ends.x = at;
            ahead = height - at;
        } else if height < at {
            ends.y = at;
            past = at - height;
        } else {
            return found;
        }
        at = crossing(ends, ahead, past);
    }
    let near_it = over(ray, bounds, behind, at);
    if !near_it.found {
        return near_it;
    }
    // There the ray is over nothing, or over what it does meet.
    return over(ray, bounds, behind, near_it.coc_px);
}

// What `layer` has in texel `place` of a mipmap level.
fn texel_at(level_words: u32, place: vec2u, layer: u32) -> vec4f {
    let index = starts[level_words + 4u] + (place.y - starts[level_words + 1u]) * starts[level_words] + place.x;
    for (var i = starts[index]; i < starts[index + 1u]; i++) {
        let texel = texels[i];
        if texel.layer == layer {
            return vec4f(texel.red, texel.green, texel.blue, texel.alpha);
        }
    }
    return vec4f(0.0);
}

// What `layer` has at `position`, in samples, in mipmap level `number`: between the four nearest texels.
fn bilinear(number: u32, position: vec2f, layer: u32) -> vec4f {
    let words = LEVEL_WORDS * (number - 1u);
    let last = vec2u(starts[words] - 1u, starts[words + 3u]);
    let at_hand = vec2u(starts[words + 1u], starts[words + 2u]);
    let place = clamp(position / f32(1u << number) - 0.5, vec2f(0.0), vec2f(last));
    let share = fract(place);
    let x0 = u32(place.x);
    let x1 = min(x0 + 1u, last.x);
    let y0 = clamp(u32(place.y), at_hand.x, at_hand.y);
    let y1 = clamp(u32(place.y) + 1u, at_hand.x, at_hand.y);
    var sum = (1.0 - share.x) * (1.0 - share.y) * texel_at(words, vec2u(x0, y0), layer);
    sum += share.x * (1.0 - share.y) * texel_at(words, vec2u(x1, y0), layer);
    sum += (1.0 - share.x) * share.y * texel_at(words, vec2u(x0, y1), layer);
    return sum + share.x * share.y * texel_at(words, vec2u(x1, y1), layer);
}

// What a fragment shows: red, green, blue (premultiplied) and alpha.
fn color_of(index: u32) -> vec4f {
    return vec4f(red_green[index], blue_alpha[index]);
}

// Mipmap level of the cone of a ray at CoC radius `at`; 0 where it is no wider than a sample, whatever a logarithm makes of 1.
fn cone_level(at: f32) -> f32 {
    let diameter = frame.cone_per_coc_px * abs(at);
    return select(0.0, clamp(log2(diameter), LEAST_LEVEL, f32(frame.levels)), diameter > 1.0 && frame.levels > 0u);
}

// What the cone of `ray`, of mipmap level `level`, sees of `layer` where it meets `hit`.
fn cone(ray: Ray, hit: Hit, layer: u32, level: f32) -> vec4f {
    let position = ray_at(ray, hit.at);
    let finer = u32(ceil(level)) - 1u;
    var fine = color_of(hit.index);
    if finer > 0u {
        fine = bilinear(finer, position, layer);
    }
    let mixed = fine + (level - f32(finer)) * (bilinear(finer + 1u, position, layer) - fine);
    // A cone that is blocked but for rounding shows all of its colour.
    return mixed / select(1.0, mixed.a, mixed.a >= OPAQUE_ALPHA);
}

// The first slab of `slabs` from `first` on; past the last one if there is none.
fn next_slab(slabs: vec2u, first: u32) -> u32 {
    let from_first = 0xffffffffu << (first & 31u);
    let low = select(0u, slabs.x & from_first, first < 32u);
    let high = select(slabs.y & from_first, slabs.y, first < 32u);
    if low != 0u {
        return firstTrailingBit(low);
    }
    return select(MOST_SLABS, 32u + firstTrailingBit(high), high != 0u);
}

// The first layer of `slabs` from `first` on in which `ray` can meet anything; past the last one if there is none.
fn next_layer(ray: Ray, slabs: vec2u, first: u32) -> u32 {
    var layer = first;
    while layer < frame.layers {
        let slab = next_slab(slabs, slab_of(layer));
        if slab >= frame.slabs {
            return frame.layers;
        }
        layer = max(layer, slab * frame.layers_per_slab);
        if can_meet(ray, slab, interval(layer)) {
            return layer;
        }
        layer++;
    }
    return layer;
}

// Follows `ray` through the layers of `slabs`, front to back; `has_cones` is known when the shader is compiled.
fn follow_ray(ray: Ray, slabs: vec2u, has_cones: bool) -> Seen {
    let inside = select(vec2f(-ABSENT, ABSENT), stay(ray), frame.discard_outside != 0u);
    var seen = Seen(vec3f(0.0), 1.0, true);
    // The CoC radius up to which fragments have been met.
    var behind = -ABSENT;
    var layer = 0u;
    // One loop for layers and hits, and the search for the next layer in it: threads that differ in either wait least.
    loop {
        layer = next_layer(ray, slabs, layer);
        if layer >= frame.layers {
            return seen;
        }
        let bounds = interval(layer);
        let hit = meet(ray, vec2f(max(bounds.x, behind), bounds.y), behind);
        var goes_on = !hit.found;
        if hit.found {
            seen.counts = hit.at >= inside.x && hit.at <= inside.y;
            var shown = color_of(hit.index);
            if has_cones {
                let level = cone_level(hit.at);
                goes_on = level > 0.0;
                if goes_on {
                    shown = cone(ray, hit, layer, level);
                }
            }
            seen.color += seen.transmitted * shown.rgb;
            seen.transmitted *= select(1.0 - shown.a, 0.0, shown.a >= OPAQUE_ALPHA);
            behind = hit.coc_px;
        }
        if seen.transmitted <= 0.0 || !seen.counts {
            return seen;
        }
        layer += u32(goes_on);
    }
    return seen;
}

// `seen` as part of a sum, to which rays that do not count add nothing.
fn part_of_sum(seen: Seen) -> Sum {
    if !seen.counts {
        return Sum(vec3f(0.0), 0.0, 0.0);
    }
    return Sum(seen.color, 1.0 - seen.transmitted, 1.0);
}

// The sample position of the centre of a pixel.
fn centre_of(pixel: vec2u) -> vec2f {
    return (vec2f(pixel) + 0.5) * frame.supersample;
}

// Adds the rays of a go of views through the pixel at `at` of those that are made.
fn add_rays(at: vec2u, has_cones: bool) {
    if at.x >= frame.width || at.y >= frame.rows {
        return;
    }
    let pixel = vec2u(at.x, frame.row + at.y);
    let centre = centre_of(pixel);
    let slabs = slabs_around(centre);
    let first_view = hash(pixel) % frame.sets * frame.views;
    var sum = Sum(vec3f(0.0), 0.0, 0.0);
    for (var i = go.first_view; i < go.end_view; i++) {
        let view = views[first_view + i];
        let ray = Ray(centre + vec2f(view.start_x, view.start_y), vec2f(view.step_x, view.step_y));
        let part = part_of_sum(follow_ray(ray, slabs, has_cones));
        sum = Sum(sum.color + part.color, sum.hit + part.hit, sum.rays + part.rays);
    }
    add_go(at.y * frame.width + at.x, sum);
}

@compute @workgroup_size(8, 8)
fn follow(@builtin(global_invocation_id) at: vec3u) {
    add_rays(at.xy, false);
}

@compute @workgroup_size(8, 8)
fn follow_cones(@builtin(global_invocation_id) at: vec3u) {
    add_rays(at.xy, true);
}

@compute @workgroup_size(8, 8)
fn central(@builtin(global_invocation_id) at: vec3u) {
    if at.x >= frame.width || at.y >= frame.rows {
        return;
    }
    let index = at.y * frame.width + at.x;
    let sum = saved_sum(index);
    let is_open = go.open_background != 0u && sum.rays > 0.0;
    if is_open || !shows_nothing(sum) {
        return;
    }
    let centre = centre_of(vec2u(at.x, frame.row + at.y));
    save_sum(index, part_of_sum(follow_ray(Ray(centre, vec2f(0.0)), slabs_around(centre), true)));
}
