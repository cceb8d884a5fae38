// Lens rays intersected with depth layers by false position, and widened to cones: GPU backend of
// src/methods/published/layer_rays/, whose module heads give the reasons.
//
// |follow         adds the rays of a batch of views to the sums, where no cone is wider than a sample
// |follow_cones   the same for any cones
// |central        the ray through the centre of pixel and lens, where all other rays were discarded
//
// Fragments, layers, N-buffers and mipmaps are the CPU's tables. One N-buffer serves a slab of neighbouring layers.

// Sizes of the tables, and how rays are traced.
struct Frame {
    // Views per set, and number of sets.
    views: u32,
    sets: u32,
    // Number of layers, layers per slab, and number of slabs. Each slab has one N-buffer.
    layers: u32,
    layers_per_slab: u32,
    slabs: u32,
    // Mipmap levels above the stack, and the cone diameter in samples per pixel of CoC radius.
    levels: u32,
    cone_per_coc_px: f32,
    // Iterations of false position.
    iterations: u32,
    // Whether rays that leave the frame are discarded.
    discard_outside: u32,
}

// One layer in a mipmap texel: colour (premultiplied) and coverage.
struct Texel {
    layer: u32,
    red: f32,
    green: f32,
    blue: f32,
    alpha: f32,
}

// Views are [set][view]. The N-buffer table also holds, as float bits, the reach of rays per slab, and the near and
// far bound per layer; and the slab index per layer.
@group(0) @binding(9) var<uniform> frame: Frame;
// Per mipmap level: columns, first and last uploaded row, last row of the level, index of its starts. Then the
// starts: the start of each texel's list, and the end of the last one.
@group(0) @binding(10) var<storage, read> starts: array<u32>;
// The lists, each ordered by layer.
@group(0) @binding(11) var<storage, read> texels: array<Texel>;

// From the program: MAX_SLABS; SLAB_WORDS, LAYER_WORDS and LEVEL_WORDS, the u32 words per slab, layer and level.

// Minimum mipmap level of a cone that is wider than a sample.
const MIN_LEVEL: f32 = 1e-7;

// A hit of a ray in a layer.
struct Hit {
    found: bool,
    // CoC radius of the ray at the hit.
    at: f32,
    // Index of the fragment.
    index: u32,
    // CoC radius of the fragment.
    coc_px: f32,
}

// Accumulated colour of a ray, its transmittance, and whether the ray counts (false: discarded).
struct RayTrace {
    color: vec3f,
    transmittance: f32,
    counts: bool,
}

// Pseudo-random number of a pixel (Jarzynski & Olano 2020, pcg2d).
fn hash(pixel: vec2u) -> u32 {
    var v = pixel * 1664525u + 1013904223u;
    v.x += v.y * 1664525u;
    v.y += v.x * 1664525u;
    v ^= v >> vec2u(16u);
    v.x += v.y * 1664525u;
    return v.x ^ (v.x >> 16u);
}

// CoC radii between which `ray` is inside the frame. It must be inside at the plane of focus.
fn frame_interval(ray: Ray) -> vec2f {
    let size = vec2f(f32(stack.columns), f32(stack.height));
    let is_still = ray.step == vec2f(0.0);
    let step = select(ray.step, vec2f(1.0), is_still);
    let a = -ray.start / step;
    let b = (size - ray.start) / step;
    // A ray with zero step never leaves.
    let enters = select(min(min(a, b), vec2f(0.0)), vec2f(-ABSENT), is_still);
    let leaves = select(max(max(a, b), vec2f(0.0)), vec2f(ABSENT), is_still);
    return vec2f(max(enters.x, enters.y), min(leaves.x, leaves.y));
}

// Index of the first word of a layer.
fn layer_words(layer: u32) -> u32 {
    return SLAB_WORDS * frame.slabs + LAYER_WORDS * layer;
}

// Near and far bound of a layer.
fn interval(layer: u32) -> vec2f {
    let word = layer_words(layer);
    return vec2f(bitcast<f32>(nbuffers[word]), bitcast<f32>(nbuffers[word + 1u]));
}

// Slab index of a layer.
fn slab_of(layer: u32) -> u32 {
    return nbuffers[layer_words(layer) + 2u];
}

// Bit mask of the slabs that rays through the pixel with centre `centre` (in samples) can hit.
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

// Whether `ray` can hit anything in a layer of `slab` with CoC radii `bounds`.
fn can_hit(ray: Ray, slab: u32, bounds: vec2f) -> bool {
    return least_in(slab, window_between(ray_at(ray, bounds.x), ray_at(ray, bounds.y))) <= bounds.y;
}

// The layer's fragment below the ray at `c`, as a hit at `c`: the nearest one within `bounds` whose CoC radius is
// larger than `passed_coc_px`.
fn fragment_at(ray: Ray, bounds: vec2f, passed_coc_px: f32, c: f32) -> Hit {
    let first = list_at(ray_at(ray, c));
    for (var k = 0u; k < stack.depth; k++) {
        let coc = coc_px[first + k];
        if coc >= bounds.x && coc > passed_coc_px {
            return Hit(coc <= bounds.y, c, first + k, coc);
        }
    }
    return Hit(false, c, first, ABSENT);
}

// CoC radius where the straight line between `ends` is zero, for a ray that is `ahead` before the surface at the
// first end and `past` behind it at the second.
fn crossing(ends: vec2f, ahead: f32, past: f32) -> f32 {
    let total = ahead + past;
    var share = 0.0;
    if total > 0.0 {
        share = ahead / total;
    }
    return clamp(ends.x + (ends.y - ends.x) * share, ends.x, ends.y);
}

// Intersection of the ray with the height field of a layer, by false position.
fn intersect(ray: Ray, bounds: vec2f, passed_coc_px: f32) -> Hit {
    var ends = bounds;
    let first = fragment_at(ray, bounds, passed_coc_px, bounds.x);
    let last = fragment_at(ray, bounds, passed_coc_px, bounds.y);
    var surface_found = first.found;
    var ahead = select(bounds.y, first.coc_px, first.found) - ends.x;
    var past = ends.y - select(bounds.x, last.coc_px, last.found);
    var at = crossing(ends, ahead, past);
    for (var i = 0u; i < frame.iterations; i++) {
        let guess = fragment_at(ray, bounds, passed_coc_px, at);
        let height = select(select(bounds.y, bounds.x, surface_found), guess.coc_px, guess.found);
        if height > at {
            surface_found = surface_found || guess.found;
            ends.x = at;
            ahead = height - at;
        } else if height < at {
            ends.y = at;
            past = at - height;
        } else {
            return guess;
        }
        at = crossing(ends, ahead, past);
    }
    let last_guess = fragment_at(ray, bounds, passed_coc_px, at);
    if !last_guess.found {
        return last_guess;
    }
    // At that depth the ray is over no fragment, or over the one that it hits.
    return fragment_at(ray, bounds, passed_coc_px, last_guess.coc_px);
}

// `layer` in texel `place` of a mipmap level.
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

// Bilinear sample of `layer` at `position`, in samples, in mipmap level `number`.
fn bilinear(number: u32, position: vec2f, layer: u32) -> vec4f {
    let words = LEVEL_WORDS * (number - 1u);
    let last = vec2u(starts[words] - 1u, starts[words + 3u]);
    let uploaded_rows = vec2u(starts[words + 1u], starts[words + 2u]);
    let place = clamp(position / f32(1u << number) - 0.5, vec2f(0.0), vec2f(last));
    let share = fract(place);
    let x0 = u32(place.x);
    let x1 = min(x0 + 1u, last.x);
    let y0 = clamp(u32(place.y), uploaded_rows.x, uploaded_rows.y);
    let y1 = clamp(u32(place.y) + 1u, uploaded_rows.x, uploaded_rows.y);
    var sum = (1.0 - share.x) * (1.0 - share.y) * texel_at(words, vec2u(x0, y0), layer);
    sum += share.x * (1.0 - share.y) * texel_at(words, vec2u(x1, y0), layer);
    sum += (1.0 - share.x) * share.y * texel_at(words, vec2u(x0, y1), layer);
    return sum + share.x * share.y * texel_at(words, vec2u(x1, y1), layer);
}

// Mipmap level of a ray's cone at CoC radius `at`; exactly 0 where the cone is no wider than a sample, as log2(1) may
// round.
fn cone_level(at: f32) -> f32 {
    let diameter = frame.cone_per_coc_px * abs(at);
    return select(0.0, clamp(log2(diameter), MIN_LEVEL, f32(frame.levels)), diameter > 1.0 && frame.levels > 0u);
}

// Colour and coverage of `layer` within the cone of `ray` at `hit`, on mipmap level `level`.
fn cone(ray: Ray, hit: Hit, layer: u32, level: f32) -> vec4f {
    let position = ray_at(ray, hit.at);
    let finer = u32(ceil(level)) - 1u;
    var fine = color_of(hit.index);
    if finer > 0u {
        fine = bilinear(finer, position, layer);
    }
    let mixed = fine + (level - f32(finer)) * (bilinear(finer + 1u, position, layer) - fine);
    // Removes the rounding error of a cone that is fully covered.
    return mixed / select(1.0, mixed.a, mixed.a >= OPAQUE_ALPHA);
}

// The first slab of `slabs` from `first` on; MAX_SLABS if there is none.
fn next_slab(slabs: vec2u, first: u32) -> u32 {
    let from_first = 0xffffffffu << (first & 31u);
    let low = select(0u, slabs.x & from_first, first < 32u);
    let high = select(slabs.y & from_first, slabs.y, first < 32u);
    if low != 0u {
        return firstTrailingBit(low);
    }
    return select(MAX_SLABS, 32u + firstTrailingBit(high), high != 0u);
}

// The first layer of `slabs` from `first` on in which `ray` can hit anything; the number of layers if there is none.
fn next_layer(ray: Ray, slabs: vec2u, first: u32) -> u32 {
    var layer = first;
    while layer < frame.layers {
        let slab = next_slab(slabs, slab_of(layer));
        if slab >= frame.slabs {
            return frame.layers;
        }
        layer = max(layer, slab * frame.layers_per_slab);
        if can_hit(ray, slab, interval(layer)) {
            return layer;
        }
        layer++;
    }
    return layer;
}

// Traces `ray` through the layers of `slabs`, front to back. `has_cones` is a constant at each call.
fn follow_ray(ray: Ray, slabs: vec2u, has_cones: bool) -> RayTrace {
    let inverse = select(vec2f(0.0), 1.0 / ray.step, abs(ray.step) > vec2f(STEEP));
    let lens = lens_ray(ray.start, ray.step, inverse);
    let frame_bounds = select(vec2f(-ABSENT, ABSENT), frame_interval(ray), frame.discard_outside != 0u);
    var trace = RayTrace(vec3f(0.0), 1.0, true);
    // Fragments up to this CoC radius were hit before.
    var passed_coc_px = -ABSENT;
    var layer = 0u;
    // One loop for layers and hits, which includes the search for the next layer: this minimizes the divergence of
    // threads.
    loop {
        layer = next_layer(ray, slabs, layer);
        if layer >= frame.layers {
            return trace;
        }
        let bounds = interval(layer);
        let hit = intersect(ray, vec2f(max(bounds.x, passed_coc_px), bounds.y), passed_coc_px);
        var next_layer_due = !hit.found;
        if hit.found {
            trace.counts = hit.at >= frame_bounds.x && hit.at <= frame_bounds.y;
            var color = color_of(hit.index);
            if has_cones {
                let level = cone_level(hit.at);
                next_layer_due = level > 0.0;
                if next_layer_due {
                    color = cone(ray, hit, layer, level);
                }
            }
            let moved = moved_at(in_frame(vec2i(floor(ray_at(ray, hit.at)))), hit.coc_px, lens);
            trace.color += trace.transmittance * (color.rgb + color.a * (moved.seen - moved.own));
            trace.transmittance *= let_through(color.a);
            passed_coc_px = hit.coc_px;
        }
        if trace.transmittance <= 0.0 || !trace.counts {
            return trace;
        }
        layer += u32(next_layer_due);
    }
    return trace;
}

// The sum of `ray`; discarded rays add nothing.
fn sum_of_ray(ray: Ray, slabs: vec2u, has_cones: bool) -> Sum {
    let trace = follow_ray(ray, slabs, has_cones);
    if !trace.counts {
        return NO_RAYS;
    }
    return ended(ray, trace.color, trace.transmittance);
}

// Adds the rays of a batch of views through pixel `at` of the band.
fn add_rays(at: vec2u, has_cones: bool) {
    if at.x >= stack.width || at.y >= stack.rows {
        return;
    }
    let pixel = vec2u(at.x, stack.row + at.y);
    let centre = centre_of(pixel);
    let extent = extent_in(pixel);
    let slabs = slabs_around(centre);
    let first_view = hash(pixel) % frame.sets * frame.views;
    var sum = NO_RAYS;
    for (var i = batch.first_view; i < batch.end_view; i++) {
        sum = added(sum, sum_of_ray(ray_of(first_view + i, centre, extent), slabs, has_cones));
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
    if sum.transparent > 0.0 || !shows_nothing(sum) {
        return;
    }
    let centre = centre_of(vec2u(at.x, stack.row + at.y));
    save_sum(index, sum_of_ray(Ray(centre, vec2f(0.0)), slabs_around(centre), true));
}
