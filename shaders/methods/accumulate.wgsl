// Traces lens rays through the stack. CPU version: src/methods/accumulate/, whose module heads explain the method.
//
// look     computes the extents of all fragments, and for each tile of samples the CoC depths that have a fragment
// follow   traces the rays of a batch of views and adds them to the sums
//
// A ray (p + j + c·u, c) traverses tiles in order of rising c, and the samples of those that are not empty. Coordinates are those
// of the whole stack, independent of the rows that are uploaded.

// The rows of the stack that the band reads, and the lens.
struct Frame {
    // Width of the picture; first row that the band makes, and number of rows.
    width: u32,
    row: u32,
    rows: u32,
    layers: u32,
    // Samples per pixel along each axis.
    supersample: f32,
    // Width of the stack in samples; first and last row of samples that is uploaded.
    columns: i32,
    top: i32,
    bottom: i32,
    // Minimum and maximum CoC depth of all fragments.
    nearest: f32,
    farthest: f32,
    slabs_per_px: f32,
    // Where the optical axis meets the picture, distance from there to the corners, and offset of the barrel from the aperture as
    // seen from the corners, in aperture radii.
    axis_x: f32,
    axis_y: f32,
    half_diagonal_px: f32,
    cats_eye: f32,
    // Number of sets of views that rows take turns with, and views from one of these sets to the next.
    turns: u32,
    turn_views: u32,
}

// A lens sample, prepared for rays.
struct View {
    // Samples that a ray moves per pixel of CoC depth.
    step_x: f32,
    step_y: f32,
    // Reciprocal of the step; 0 along an axis that the ray is perpendicular to.
    inverse_x: f32,
    inverse_y: f32,
    // Position in the pixel, and shift of the ray by aberrations, in pixels.
    jitter_x: f32,
    jitter_y: f32,
    shift_x: f32,
    shift_y: f32,
    // Point on the aperture.
    lens_x: f32,
    lens_y: f32,
}

@group(0) @binding(3) var<uniform> frame: Frame;
@group(0) @binding(4) var<storage, read> views: array<View>;
// [layer][row][column].
@group(0) @binding(5) var<storage, read> red: array<f32>;
@group(0) @binding(6) var<storage, read> green: array<f32>;
@group(0) @binding(7) var<storage, read> blue: array<f32>;
@group(0) @binding(8) var<storage, read> alpha: array<f32>;
@group(0) @binding(9) var<storage, read> coc_px: array<f32>;
// Interval of CoC depth of each fragment; both ends BEYOND where there is none.
@group(0) @binding(10) var<storage, read> extents: array<vec2f>;
// [row][column] of tiles: one bit per slab, set where the slab has a fragment.
@group(0) @binding(11) var<storage, read> tiles: array<vec2u>;
// The same two buffers, writable, for `look`.
@group(0) @binding(12) var<storage, read_write> extents_made: array<vec2f>;
@group(0) @binding(13) var<storage, read_write> tiles_made: array<vec2u>;

// Constants from the program: OPAQUE_ALPHA; JOIN_PX, MAX_JOIN_PX and ROUGHNESS, by which neighbours are one surface; SAME_HIT_PX, the
// distance in CoC depth within which a ray is still in the same translucent surface; REACH_PX, by which a fragment's interval exceeds its
// CoC depth at most; TILE, the side of a tile in samples, and its binary logarithm TILE_BITS; SLABS, the number of slabs that the CoC
// depths are divided into; MAX_TRANSLUCENT_LAYERS.

// A constant of the pipeline: whether some fragment is translucent.
override TRANSLUCENT = true;

// The bits of the slabs in the second word of a tile.
const SECOND_WORD: u32 = 0x3fffffff;
// Set in the second word of a tile where the fragments of every sample are sorted nearest first.
const NEAREST_FIRST: u32 = 0x40000000;

fn uploaded_rows() -> i32 {
    return frame.bottom - frame.top + 1;
}

// Index in the first layer of an uploaded sample.
fn sample_index(position: vec2i) -> u32 {
    return u32((position.y - frame.top) * frame.columns + position.x);
}

fn layer_stride() -> u32 {
    return u32(uploaded_rows() * frame.columns);
}

fn tile_columns() -> i32 {
    return (frame.columns + TILE - 1) >> TILE_BITS;
}

// Index of a tile; tiles past the border repeat those at the border.
fn tile_index(tile: vec2i) -> u32 {
    let first = frame.top >> TILE_BITS;
    let x = clamp(tile.x, 0, tile_columns() - 1);
    let y = clamp(tile.y, first, frame.bottom >> TILE_BITS);
    return u32((y - first) * tile_columns() + x);
}

// The slab of CoC depth `coc`; beyond either end, the slab at that end.
fn slab(coc: f32) -> u32 {
    return u32(round(clamp((coc - frame.nearest) * frame.slabs_per_px - 0.5, 0.0, f32(SLABS - 1u))));
}

// Bit `index` of a tile's two words.
fn bit(index: u32) -> vec2u {
    return select(vec2u(0u, 1u << (index & 31u)), vec2u(1u << (index & 31u), 0u), index < 32u);
}

// CoC radius of the fragment of `layer` at `position`; BEYOND where there is none.
fn coc_px_at(layer: u32, position: vec2i) -> f32 {
    let first = vec2i(0, frame.top);
    let last = vec2i(frame.columns - 1, frame.bottom);
    if any(position < first) || any(position > last) {
        return BEYOND;
    }
    let index = layer * layer_stride() + sample_index(position);
    return select(BEYOND, coc_px[index], alpha[index] > 0.0);
}

// Whether the surface of the fragment of `layer` at `position` goes on in the same layer on one side. CPU version: `surface::goes_on`.
fn goes_on(layer: u32, position: vec2i, side: vec2i) -> bool {
    let before = coc_px_at(layer, position - side);
    let own = coc_px_at(layer, position);
    let next = coc_px_at(layer, position + side);
    let after = coc_px_at(layer, position + 2 * side);
    let back = select(abs(own - before), 0.0, before == BEYOND);
    let ahead = select(abs(after - next), 0.0, after == BEYOND);
    let limit = max(min(ROUGHNESS * (back + ahead), MAX_JOIN_PX), JOIN_PX);
    return next != BEYOND && abs(next - own) < limit;
}

// CoC radius of the neighbour on one side that continues the surface of the fragment of `layer` at `position`: in its own layer, or where
// the surface does not go on there, in any other within JOIN_PX; BEYOND if there is none.
fn continuation_px(layer: u32, position: vec2i, side: vec2i) -> f32 {
    if goes_on(layer, position, side) {
        return coc_px_at(layer, position + side);
    }
    let own = coc_px_at(layer, position);
    for (var other = 0u; other < frame.layers; other++) {
        let neighbour = coc_px_at(other, position + side);
        if other != layer && abs(neighbour - own) < JOIN_PX {
            return neighbour;
        }
    }
    return BEYOND;
}

// `interval` of a fragment of CoC radius `own`, extended half-way to its neighbour of CoC radius `other`.
fn extended_to(other: f32, own: f32, interval: vec2f) -> vec2f {
    let middle = 0.5 * (own + other);
    return select(vec2f(min(interval.x, middle), max(interval.y, middle)), interval, other == BEYOND);
}

// Interval of CoC depth of the fragment of `layer` at `position`.
fn extent(layer: u32, position: vec2i) -> vec2f {
    let own = coc_px_at(layer, position);
    var interval = vec2f(own);
    if own == BEYOND {
        return interval;
    }
    interval = extended_to(continuation_px(layer, position, vec2i(-1, 0)), own, interval);
    interval = extended_to(continuation_px(layer, position, vec2i(1, 0)), own, interval);
    interval = extended_to(continuation_px(layer, position, vec2i(0, -1)), own, interval);
    return extended_to(continuation_px(layer, position, vec2i(0, 1)), own, interval);
}

var<workgroup> occupied: array<atomic<u32>, 2>;
var<workgroup> disordered: atomic<u32>;

// Computes the extents of all fragments of a sample; returns the bits of the slabs that have one, and whether they are not sorted
// nearest first.
fn analyze_sample(position: vec2i) -> vec3u {
    var found = vec3u(0u);
    var nearest = -BEYOND;
    for (var layer = 0u; layer < frame.layers; layer++) {
        let index = layer * layer_stride() + sample_index(position);
        extents_made[index] = extent(layer, position);
        if alpha[index] > 0.0 {
            let coc = coc_px[index];
            found |= vec3u(bit(slab(coc)), u32(coc < nearest));
            nearest = coc;
        }
    }
    return found;
}

@compute @workgroup_size(8, 8)
fn look(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_id) local: vec3u, @builtin(local_invocation_index) index: u32) {
    if index == 0u {
        atomicStore(&occupied[0], 0u);
        atomicStore(&occupied[1], 0u);
        atomicStore(&disordered, 0u);
    }
    workgroupBarrier();
    let tile = vec2i(group.xy) + vec2i(0, frame.top >> TILE_BITS);
    let position = tile * TILE + vec2i(local.xy);
    if position.x < frame.columns && position.y >= frame.top && position.y <= frame.bottom {
        let found = analyze_sample(position);
        atomicOr(&occupied[0], found.x);
        atomicOr(&occupied[1], found.y);
        atomicOr(&disordered, found.z);
    }
    workgroupBarrier();
    if index == 0u {
        let words = vec2u(atomicLoad(&occupied[0]), atomicLoad(&occupied[1]));
        // A fragment may extend into the slabs next to its own.
        let nearer = vec2u((words.x >> 1u) | (words.y << 31u), words.y >> 1u);
        let farther = vec2u(words.x << 1u, (words.y << 1u) | (words.x >> 31u));
        let spread = (words | nearer | farther) & vec2u(0xffffffffu, SECOND_WORD);
        let ordered = select(NEAREST_FIRST, 0u, atomicLoad(&disordered) != 0u);
        tiles_made[tile_index(tile)] = spread | vec2u(0u, ordered);
    }
}

// Colour that a ray has collected, and its remaining transmittance.
struct RayResult {
    color: vec3f,
    transmittance: f32,
}

// The part of a ray's path over a tile that may hit fragments.
struct Passage {
    begin: f32,
    end: f32,
    // Whether the tile has fragments there.
    occupied: bool,
    // Whether the fragments of each sample are sorted nearest first: once one is behind the ray's interval, all that follow are.
    nearest_first: bool,
}

// The ray of `view` through the pixel with its centre at `centre`, in picture pixels, in which rays extend over the part `jitter`.
fn ray_of(view: View, centre: vec2f, jitter: f32) -> LensRay {
    let point = centre + jitter * vec2f(view.jitter_x, view.jitter_y) + vec2f(view.shift_x, view.shift_y);
    let step = vec2f(view.step_x, view.step_y);
    return lens_ray(point * frame.supersample, step, vec2f(view.inverse_x, view.inverse_y));
}

// The part of a ray's path over `tile`, from CoC depth `begin` to `end`, that may hit fragments.
fn passage_over(tile: vec2i, begin: f32, end: f32) -> Passage {
    let words = tiles[tile_index(tile)];
    let from_slab = slab(begin);
    let to_slab = slab(end);
    let all = 0xffffffffu;
    let from_mask = select(vec2u(0u, all << (from_slab & 31u)), vec2u(all << (from_slab & 31u), all), from_slab < 32u);
    let to_mask = select(vec2u(all, all >> (31u - (to_slab & 31u))), vec2u(all >> (31u - (to_slab & 31u)), 0u), to_slab < 32u);
    let found = words & from_mask & to_mask & vec2u(all, SECOND_WORD);
    let first = select(32u + firstTrailingBit(found.y), firstTrailingBit(found.x), found.x != 0u);
    let last = select(firstLeadingBit(found.x), 32u + firstLeadingBit(found.y), found.y != 0u);
    // From the begin of the first slab to the end of the last one, with margins for rounding.
    let slabs_begin = frame.nearest + (f32(first) - 0.01) / frame.slabs_per_px;
    let slabs_end = frame.nearest + (f32(last) + 1.01) / frame.slabs_per_px;
    return Passage(
        max(begin, slabs_begin),
        min(end, slabs_end),
        any(found != vec2u(0u)),
        (words.y & NEAREST_FIRST) != 0u,
    );
}

// The first layer from `first` on whose fragment overlaps the ray's interval from CoC depth `begin` to `end`; the number of
// layers if there is none. `index` is that of the sample in the first layer.
fn next_hit(index: u32, first: u32, begin: f32, end: f32, nearest_first: bool) -> u32 {
    var layer = first;
    while layer < frame.layers {
        let interval = extents[index + layer * layer_stride()];
        if max(interval.x, begin) <= min(interval.y, end) {
            return layer;
        }
        if nearest_first && interval.x < BEYOND && interval.x > end + REACH_PX {
            return frame.layers;
        }
        layer++;
    }
    return layer;
}

// The hit of a translucent fragment: its layer and position, and the CoC depth where the ray leaves it in its sample.
struct TranslucentHit {
    layer: u32,
    position: vec2i,
    coc_end: f32,
}

// The last translucent hit of the thread's ray in each layer that has one, and the number of these.
var<private> translucent_hits: array<TranslucentHit, MAX_TRANSLUCENT_LAYERS>;
var<private> translucent_hit_count: u32;

// Whether one surface has the fragment of `before` in one layer and continues beside it with that of `hit` in another.
fn changes_layer(before: TranslucentHit, hit: TranslucentHit) -> bool {
    let side = hit.position - before.position;
    let apart = abs(side);
    if apart.x + apart.y != 1 {
        return false;
    }
    let step = coc_px_at(hit.layer, hit.position) - coc_px_at(before.layer, before.position);
    return abs(step) < JOIN_PX
        && !goes_on(before.layer, before.position, side)
        && !goes_on(hit.layer, hit.position, -side);
}

// Whether `hit`, which begins at CoC depth `begin`, is in a surface that the ray has hit before; remembers it. CPU version:
// `TranslucentHits`.
fn is_repeated(hit: TranslucentHit, begin: f32) -> bool {
    var repeated = false;
    var place = translucent_hit_count;
    for (var i = 0u; i < translucent_hit_count; i++) {
        let before = translucent_hits[i];
        let is_near = begin <= before.coc_end + SAME_HIT_PX;
        place = select(place, i, before.layer == hit.layer);
        if is_near && !repeated {
            repeated = before.layer == hit.layer || changes_layer(before, hit);
        }
    }
    translucent_hits[place] = hit;
    translucent_hit_count = max(translucent_hit_count, place + 1u);
    return repeated;
}

// Whether the fragment of `layer` at `position`, of index `index`, is in a translucent surface that the ray has hit before. The ray is in
// the sample from CoC depth `begin` to `end`.
fn is_hit_before(layer: u32, position: vec2i, index: u32, begin: f32, end: f32) -> bool {
    if !TRANSLUCENT || alpha[index] >= OPAQUE_ALPHA {
        return false;
    }
    let interval = extents[index];
    let hit = TranslucentHit(layer, position, min(interval.y, end));
    return is_repeated(hit, max(interval.x, begin));
}

// Traces `ray` over the samples of `tile`.
fn cross_tile(ray: LensRay, tile: vec2i, passage: Passage, result: ptr<function, RayResult>) {
    let first = tile * TILE;
    let min_cell = vec2i(0, frame.top);
    let max_cell = vec2i(frame.columns - 1, frame.bottom);
    var enter = passage.begin;
    var cell = clamp(cell_at(ray, enter), first, first + TILE - 1);
    var layer = 0u;
    var index = 0u;
    var position = cell;
    loop {
        // An inner loop advances to the next hit, so that threads wait less for others whose next hit is farther away.
        var exit: Exit;
        loop {
            exit = leaves(ray, cell, 1);
            position = clamp(cell, min_cell, max_cell);
            index = sample_index(position);
            layer = next_hit(index, layer, enter, min(exit.coc, passage.end), passage.nearest_first);
            if layer < frame.layers || !(exit.coc < passage.end) {
                break;
            }
            cell += exit.side;
            enter = exit.coc;
            layer = 0u;
        }
        if layer >= frame.layers {
            return;
        }
        index += layer * layer_stride();
        if !is_hit_before(layer, position, index, enter, min(exit.coc, passage.end)) {
            let own = alpha[index];
            let moved = moved_light(layer, position, ray);
            let color = vec3f(red[index], green[index], blue[index]) + own * (moved.seen - moved.own);
            (*result).color += (*result).transmittance * color;
            (*result).transmittance *= select(1.0 - own, 0.0, own >= OPAQUE_ALPHA);
            if (*result).transmittance <= 0.0 {
                return;
            }
        }
        layer++;
    }
}

// Traces `ray` through the stack.
fn trace_ray(ray: LensRay) -> RayResult {
    var result = RayResult(vec3f(0.0), 1.0);
    translucent_hit_count = 0u;
    var enter = frame.nearest;
    var tile = cell_at(ray, enter) >> vec2u(TILE_BITS);
    loop {
        // An inner loop advances to the next occupied tile, for the same reason.
        var exit: Exit;
        var passage: Passage;
        loop {
            exit = leaves(ray, tile * TILE, TILE);
            passage = passage_over(tile, enter, min(exit.coc, frame.farthest));
            if passage.occupied || !(exit.coc < frame.farthest) {
                break;
            }
            tile += exit.side;
            enter = exit.coc;
        }
        if passage.occupied {
            cross_tile(ray, tile, passage, &result);
        }
        if result.transmittance <= 0.0 || !(exit.coc < frame.farthest) {
            return result;
        }
        tile += exit.side;
        enter = exit.coc;
    }
    return result;
}

// Whether the ray through `lens` passes the barrel, as seen from field position `height`.
fn passes_barrel(lens: vec2f, height: vec2f) -> bool {
    return frame.cats_eye == 0.0 || 1.0 - length(lens - frame.cats_eye * height) >= 0.0;
}

@compute @workgroup_size(8, 8)
fn follow(@builtin(global_invocation_id) at: vec3u) {
    if at.x >= frame.width || at.y >= frame.rows {
        return;
    }
    let pixel = vec2u(at.x, frame.row + at.y);
    let centre = vec2f(pixel) + 0.5;
    let jitter = jitter_at(pixel);
    let first_of_turn = pixel.y % frame.turns * frame.turn_views;
    let height = (centre - vec2f(frame.axis_x, frame.axis_y)) / frame.half_diagonal_px;
    var sum = NO_RAYS;
    for (var i = batch.first_view; i < batch.end_view; i++) {
        let view = views[first_of_turn + i];
        if passes_barrel(vec2f(view.lens_x, view.lens_y), height) {
            let ray = ray_of(view, centre, jitter);
            let result = trace_ray(ray);
            sum = added(sum, ended_ray(result.color, result.transmittance, ray.start, ray.step, frame.supersample));
        }
    }
    add_batch(at.y * frame.width + at.x, sum);
}
