// Lens rays against the stack, one by one: twin of src/methods/accumulate/, whose module heads have the reasons.
//
// look     extents of all fragments, and for each tile of samples the CoC depths that have a fragment
// follow   the rays of a go of views, added to the sums
//
// A ray (p + j + c·u, c) walks tiles, and in those that are not empty samples, c rising. Coordinates are those of the whole stack,
// whichever rows of it are at hand.

// The rows of the stack at hand, and the lens before them.
struct Frame {
    // Columns of the picture; its first row that is made, and how many are.
    width: u32,
    row: u32,
    rows: u32,
    layers: u32,
    // Samples of a pixel along each axis.
    supersample: f32,
    // Columns of the stack in samples; the first of its rows at hand, and the last.
    columns: i32,
    top: i32,
    bottom: i32,
    // CoC depths between which all fragments lie.
    nearest: f32,
    farthest: f32,
    slabs_per_px: f32,
    // Where the lens's axis meets the picture, how far its corners are from there, and how far aside of the aperture the barrel stands.
    axis_x: f32,
    axis_y: f32,
    half_diagonal_px: f32,
    cats_eye: f32,
}

// A lens sample, as rays need it.
struct View {
    // Samples that a ray moves by for each pixel of CoC depth.
    step_x: f32,
    step_y: f32,
    // One over that; 0 along an axis that it does not move on.
    inverse_x: f32,
    inverse_y: f32,
    // Place in the pixel, and how far aberrations move the ray, in pixels.
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
// From where to where each fragment reaches in CoC depth; both ABSENT where there is none.
@group(0) @binding(10) var<storage, read> extents: array<vec2f>;
// [row][column] of tiles: a bit for each slab that has a fragment.
@group(0) @binding(11) var<storage, read> tiles: array<vec2u>;
// The two, as they are made.
@group(0) @binding(12) var<storage, read_write> extents_made: array<vec2f>;
@group(0) @binding(13) var<storage, read_write> tiles_made: array<vec2u>;

// The program's are OPAQUE_ALPHA; JOIN_PX, below which neighbours are one surface; TILE, the side of a tile in samples, and its
// logarithm TILE_BITS; SLABS, into so many the CoC depths are cut.
// The bits of the slabs in the second word of a tile.
const SECOND_WORD: u32 = 0x3fffffff;
// Set in the second word of a tile that has all fragments nearest first.
const NEAREST_FIRST: u32 = 0x40000000;
// Farther than any fragment, and than any ray goes.
const ABSENT: f32 = 3e38;

fn rows_at_hand() -> i32 {
    return frame.bottom - frame.top + 1;
}

// Index of a sample at hand in the first layer.
fn sample_index(place: vec2i) -> u32 {
    return u32((place.y - frame.top) * frame.columns + place.x);
}

fn layer_stride() -> u32 {
    return u32(rows_at_hand() * frame.columns);
}

fn tile_columns() -> i32 {
    return (frame.columns + TILE - 1) >> TILE_BITS;
}

// Index of a tile; those past the border have what those at the border have.
fn tile_index(tile: vec2i) -> u32 {
    let first = frame.top >> TILE_BITS;
    let x = clamp(tile.x, 0, tile_columns() - 1);
    let y = clamp(tile.y, first, frame.bottom >> TILE_BITS);
    return u32((y - first) * tile_columns() + x);
}

// The slab of CoC depth `coc`; beyond the ends, the last one.
fn slab(coc: f32) -> u32 {
    return u32(round(clamp((coc - frame.nearest) * frame.slabs_per_px - 0.5, 0.0, f32(SLABS - 1u))));
}

// Bit `index` of the two words of a tile.
fn bit(index: u32) -> vec2u {
    return select(vec2u(0u, 1u << (index & 31u)), vec2u(1u << (index & 31u), 0u), index < 32u);
}

// `reach` as far as halfway to the fragment at `index`, if it is one surface with that of CoC radius `coc`.
fn reach_to(index: u32, coc: f32, reach: vec2f) -> vec2f {
    let other = coc_px[index];
    let middle = 0.5 * (coc + other);
    let joined = alpha[index] > 0.0 && abs(other - coc) < JOIN_PX;
    return select(reach, vec2f(min(reach.x, middle), max(reach.y, middle)), joined);
}

// From where to where the fragment at `index` reaches, which is at `place` in its layer.
fn extent(index: u32, place: vec2i) -> vec2f {
    let own = alpha[index];
    let coc = coc_px[index];
    var reach = select(vec2f(ABSENT), vec2f(coc), own > 0.0);
    if own < OPAQUE_ALPHA {
        // Translucent fragments stay thin: reaching into one another they would count twice.
        return reach;
    }
    if place.x > 0 {
        reach = reach_to(index - 1u, coc, reach);
    }
    if place.x + 1 < frame.columns {
        reach = reach_to(index + 1u, coc, reach);
    }
    if place.y > frame.top {
        reach = reach_to(index - u32(frame.columns), coc, reach);
    }
    if place.y < frame.bottom {
        reach = reach_to(index + u32(frame.columns), coc, reach);
    }
    return reach;
}

var<workgroup> occupied: array<atomic<u32>, 2>;
var<workgroup> disordered: atomic<u32>;

// Looks at all fragments of a sample; returns the slabs that have one, and whether they are not nearest first.
fn look_at(place: vec2i) -> vec3u {
    var found = vec3u(0u);
    var nearest = -ABSENT;
    for (var layer = 0u; layer < frame.layers; layer++) {
        let index = layer * layer_stride() + sample_index(place);
        extents_made[index] = extent(index, place);
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
    let place = tile * TILE + vec2i(local.xy);
    if place.x < frame.columns && place.y >= frame.top && place.y <= frame.bottom {
        let found = look_at(place);
        atomicOr(&occupied[0], found.x);
        atomicOr(&occupied[1], found.y);
        atomicOr(&disordered, found.z);
    }
    workgroupBarrier();
    if index == 0u {
        let words = vec2u(atomicLoad(&occupied[0]), atomicLoad(&occupied[1]));
        // A fragment may reach into the slabs beside its own.
        let nearer = vec2u((words.x >> 1u) | (words.y << 31u), words.y >> 1u);
        let farther = vec2u(words.x << 1u, (words.y << 1u) | (words.x >> 31u));
        let spread = (words | nearer | farther) & vec2u(0xffffffffu, SECOND_WORD);
        let ordered = select(NEAREST_FIRST, 0u, atomicLoad(&disordered) != 0u);
        tiles_made[tile_index(tile)] = spread | vec2u(0u, ordered);
    }
}

// The samples `start + c·step` that a ray passes, c its CoC depth.
struct Ray {
    start: vec2f,
    step: vec2f,
    inverse: vec2f,
    // CoC depth at which it leaves a sample along an axis that it does not move on.
    never: vec2f,
    // Where it heads: -1 or 1 on each axis.
    heading: vec2i,
}

// What a ray has seen, and what of it goes on.
struct Seen {
    color: vec3f,
    transmitted: f32,
}

// Where a ray leaves a square of samples: at which CoC depth, and on which side.
struct Exit {
    at: f32,
    side: vec2i,
}

// The part of a ray's way over a tile in which there may be fragments.
struct Passage {
    begin: f32,
    end: f32,
    // None, if this is not set.
    open: bool,
    // Whether each sample has its fragments nearest first: past one behind a ray's stay there is then none before it.
    nearest_first: bool,
}

// The ray of `view` through the pixel whose centre is at `centre`, a place in the picture.
fn ray_of(view: View, centre: vec2f) -> Ray {
    let point = centre + vec2f(view.jitter_x, view.jitter_y) + vec2f(view.shift_x, view.shift_y);
    let step = vec2f(view.step_x, view.step_y);
    let inverse = vec2f(view.inverse_x, view.inverse_y);
    let never = select(vec2f(0.0), vec2f(ABSENT), inverse == vec2f(0.0));
    let heading = select(vec2i(-1), vec2i(1), step > vec2f(0.0));
    return Ray(point * frame.supersample, step, inverse, never, heading);
}

// The sample at CoC depth `coc`.
fn cell_at(ray: Ray, coc: f32) -> vec2i {
    return vec2i(floor(ray.start + coc * ray.step));
}

// Where `ray` leaves the square of `side` samples that begins at `first`.
fn leaves(ray: Ray, first: vec2i, side: i32) -> Exit {
    let edge = first + side * max(ray.heading, vec2i(0));
    let leave = (vec2f(edge) - ray.start) * ray.inverse + ray.never;
    if leave.x <= leave.y {
        return Exit(leave.x, vec2i(ray.heading.x, 0));
    }
    return Exit(leave.y, vec2i(0, ray.heading.y));
}

// What there is over `tile` from CoC depth `begin` to `end`.
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
    // A little before where the first slab begins, and a little behind where the last one ends, for rounding.
    let slabs_begin = frame.nearest + (f32(first) - 0.01) / frame.slabs_per_px;
    let slabs_end = frame.nearest + (f32(last) + 1.01) / frame.slabs_per_px;
    return Passage(
        max(begin, slabs_begin),
        min(end, slabs_end),
        any(found != vec2u(0u)),
        (words.y & NEAREST_FIRST) != 0u,
    );
}

// The first layer from `first` on with a fragment at `index` of the first layer that overlaps the ray's stay there, from CoC depth
// `begin` to `end`; past the last one if there is none.
fn next_met(index: u32, first: u32, begin: f32, end: f32, nearest_first: bool) -> u32 {
    var layer = first;
    while layer < frame.layers {
        let reach = extents[index + layer * layer_stride()];
        if reach.x <= end && reach.y >= begin {
            return layer;
        }
        if nearest_first && reach.x < ABSENT && reach.x > end + JOIN_PX {
            return frame.layers;
        }
        layer++;
    }
    return layer;
}

// Follows `ray` over the samples of `tile`.
fn cross_tile(ray: Ray, tile: vec2i, passage: Passage, seen: ptr<function, Seen>) {
    let first = tile * TILE;
    let least = vec2i(0, frame.top);
    let last = vec2i(frame.columns - 1, frame.bottom);
    var enter = passage.begin;
    var cell = clamp(cell_at(ray, enter), first, first + TILE - 1);
    var layer = 0u;
    var index = 0u;
    loop {
        // To the next fragment that is met, in a loop of its own: threads that differ in how far that is wait least.
        var exit: Exit;
        loop {
            exit = leaves(ray, cell, 1);
            index = sample_index(clamp(cell, least, last));
            layer = next_met(index, layer, enter, min(exit.at, passage.end), passage.nearest_first);
            if layer < frame.layers || !(exit.at < passage.end) {
                break;
            }
            cell += exit.side;
            enter = exit.at;
            layer = 0u;
        }
        if layer >= frame.layers {
            return;
        }
        index += layer * layer_stride();
        let own = alpha[index];
        (*seen).color += (*seen).transmitted * vec3f(red[index], green[index], blue[index]);
        (*seen).transmitted *= select(1.0 - own, 0.0, own >= OPAQUE_ALPHA);
        if (*seen).transmitted <= 0.0 {
            return;
        }
        layer++;
    }
}

// Follows `ray` through the stack.
fn follow_ray(ray: Ray) -> Seen {
    var seen = Seen(vec3f(0.0), 1.0);
    var enter = frame.nearest;
    var tile = cell_at(ray, enter) >> vec2u(TILE_BITS);
    loop {
        // To the next tile that has anything, as above.
        var exit: Exit;
        var passage: Passage;
        loop {
            exit = leaves(ray, tile * TILE, TILE);
            passage = passage_over(tile, enter, min(exit.at, frame.farthest));
            if passage.open || !(exit.at < frame.farthest) {
                break;
            }
            tile += exit.side;
            enter = exit.at;
        }
        if passage.open {
            cross_tile(ray, tile, passage, &seen);
        }
        if seen.transmitted <= 0.0 || !(exit.at < frame.farthest) {
            return seen;
        }
        tile += exit.side;
        enter = exit.at;
    }
    return seen;
}

// Whether the ray through `lens` passes the barrel, seen from the place `height` of the field.
fn passes_barrel(lens: vec2f, height: vec2f) -> bool {
    return frame.cats_eye == 0.0 || 1.0 - length(lens - frame.cats_eye * height) >= 0.0;
}

@compute @workgroup_size(8, 8)
fn follow(@builtin(global_invocation_id) at: vec3u) {
    if at.x >= frame.width || at.y >= frame.rows {
        return;
    }
    let centre = vec2f(f32(at.x), f32(frame.row + at.y)) + 0.5;
    let height = (centre - vec2f(frame.axis_x, frame.axis_y)) / frame.half_diagonal_px;
    var sum = Sum(vec3f(0.0), 0.0, 0.0);
    for (var i = go.first_view; i < go.end_view; i++) {
        let view = views[i];
        if passes_barrel(vec2f(view.lens_x, view.lens_y), height) {
            let seen = follow_ray(ray_of(view, centre));
            sum.color += seen.color;
            sum.hit += 1.0 - seen.transmitted;
            sum.rays += 1.0;
        }
    }
    add_go(at.y * frame.width + at.x, sum);
}
