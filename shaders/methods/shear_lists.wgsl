// What each view of `shear` can show to each tile: lists of groups of bins. Declarations: shear.wgsl.
//
//   mark_blocks      which bins each block of pixels holds
//   mark_windows     which bins each window of blocks holds: what a tile can see, wherever a view moves it
//   mark_far         the same for a square of tiles
//   find_far         the bins that each view can show to each square of tiles
//   find_groups      of those, the groups of bins that it can show to each tile

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
