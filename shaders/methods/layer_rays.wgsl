// Lens rays against depth layers, by false position, thickened to cones: twin of src/methods/layer_rays/, whose module heads have
// the reasons.
//
// follow         the rays of a go of views, added to the sums, where no cone is wider than a sample
// follow_cones   the same for any cones
// central        the ray through the middle of each pixel and lens, where nothing is known of any other
//
// Fragments, layers, N-buffers and mipmaps are the CPU's tables. An N-buffer is kept for a slab of neighbouring layers.

// The layers, and how rays meet them.
struct Frame {
    // Views of a set, and sets.
    views: u32,
    sets: u32,
    // Layers; neighbouring ones share an N-buffer, a slab of them each.
    layers: u32,
    layers_per_slab: u32,
    slabs: u32,
    // Mipmap levels above the stack itself, and the diameter of a cone in samples for each pixel of CoC radius.
    levels: u32,
    cone_per_coc_px: f32,
    // Steps of false position.
    iterations: u32,
    // Whether rays that leave the frame are left out.
    discard_outside: u32,
}

// What one layer has in a texel of a mipmap: colour (premultiplied) and coverage.
struct Texel {
    layer: u32,
    red: f32,
    green: f32,
    blue: f32,
    alpha: f32,
}

// Views are [set][view]. Beside N-buffers are, per slab, the bits of how far rays go in it, and, per layer, the bits of its near and its
// far bound, and its slab.
@group(0) @binding(9) var<uniform> frame: Frame;
// Per level of the mipmaps its columns, its first and its last row at hand, its last row in all, and where its starts begin; then
// the starts: where each texel's list begins, and where the last one ends.
@group(0) @binding(10) var<storage, read> starts: array<u32>;
// The lists, each in the order of the layers.
@group(0) @binding(11) var<storage, read> texels: array<Texel>;

// The program's are MAX_SLABS; and SLAB_WORDS, LAYER_WORDS and LEVEL_WORDS, the words of a slab, a layer and a level.

// A cone that is wider than a sample is of this mipmap level at least.
const MIN_LEVEL: f32 = 1e-7;

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

// CoC radii between which `ray` is within the frame; it passes the plane of focus within it.
fn stay(ray: Ray) -> vec2f {
    let size = vec2f(f32(stack.columns), f32(stack.height));
    let still = ray.step == vec2f(0.0);
    let step = select(ray.step, vec2f(1.0), still);
    let a = -ray.start / step;
    let b = (size - ray.start) / step;
    // A ray that stands still never leaves.
    let enters = select(min(min(a, b), vec2f(0.0)), vec2f(-ABSENT), still);
    let leaves = select(max(max(a, b), vec2f(0.0)), vec2f(ABSENT), still);
    return vec2f(max(enters.x, enters.y), min(leaves.x, leaves.y));
}

// Where what is said of a layer begins.
fn words_of(layer: u32) -> u32 {
    return SLAB_WORDS * frame.slabs + LAYER_WORDS * layer;
}

// Near and far bound of a layer.
fn interval(layer: u32) -> vec2f {
    let word = words_of(layer);
    return vec2f(bitcast<f32>(nbuffers[word]), bitcast<f32>(nbuffers[word + 1u]));
}

// The slab that a layer is of.
fn slab_of(layer: u32) -> u32 {
    return nbuffers[words_of(layer) + 2u];
}

// The slabs that rays through the pixel whose centre is at sample position `centre` can meet, a bit each.
fn slabs_around(centre: vec2f) -> vec2u {
    var slabs = vec2u(0u);
    for (var slab = 0u; slab < frame.slabs; slab++) {
        let reach = bitcast<f32>(nbuffers[NBUFFER_WORDS * frame.slabs + slab]);
        if least_in(slab, window_between(centre - reach, centre + reach)) < ABSENT {
            slabs[slab >> 5u] |= 1u << (slab & 31u);
        }
    }
    return slabs;
}

// Whether `ray` can meet anything in a layer of `slab` that holds the CoC radii of `bounds`.
fn can_meet(ray: Ray, slab: u32, bounds: vec2f) -> bool {
    return least_in(slab, window_between(ray_at(ray, bounds.x), ray_at(ray, bounds.y))) <= bounds.y;
}

// The layer's nearest fragment where the ray is at `c`, as if it were met there: of the CoC radii of `bounds`, and of those behind
// `behind`.
fn over(ray: Ray, bounds: vec2f, behind: f32, c: f32) -> Hit {
    let first = list_at(ray_at(ray, c));
    for (var k = 0u; k < stack.depth; k++) {
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

// Mipmap level of the cone of a ray at CoC radius `at`; 0 where it is no wider than a sample, whatever a logarithm makes of 1.
fn cone_level(at: f32) -> f32 {
    let diameter = frame.cone_per_coc_px * abs(at);
    return select(0.0, clamp(log2(diameter), MIN_LEVEL, f32(frame.levels)), diameter > 1.0 && frame.levels > 0u);
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
    return select(MAX_SLABS, 32u + firstTrailingBit(high), high != 0u);
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
            seen.transmitted *= let_through(shown.a);
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

// Adds the rays of a go of views through the pixel at `at` of those that are made.
fn add_rays(at: vec2u, has_cones: bool) {
    if at.x >= stack.width || at.y >= stack.rows {
        return;
    }
    let pixel = vec2u(at.x, stack.row + at.y);
    let centre = centre_of(pixel);
    let slabs = slabs_around(centre);
    let first_view = hash(pixel) % frame.sets * frame.views;
    var sum = Sum(vec3f(0.0), 0.0, 0.0);
    for (var i = batch.first_view; i < batch.end_view; i++) {
        let part = part_of_sum(follow_ray(ray_of(first_view + i, centre), slabs, has_cones));
        sum = Sum(sum.color + part.color, sum.hit + part.hit, sum.rays + part.rays);
    }
    add_batch(at.y * stack.width + at.x, sum);
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
    if at.x >= stack.width || at.y >= stack.rows {
        return;
    }
    let index = at.y * stack.width + at.x;
    let sum = saved_sum(index);
    let is_open = batch.transparent_background != 0u && sum.rays > 0.0;
    if is_open || !shows_nothing(sum) {
        return;
    }
    let centre = centre_of(vec2u(at.x, stack.row + at.y));
    save_sum(index, part_of_sum(follow_ray(Ray(centre, vec2f(0.0)), slabs_around(centre), true)));
}
