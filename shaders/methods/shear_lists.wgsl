// The lists of `shear`: for each tile, turn and view the groups of bins that may be visible. Declarations: shear.wgsl.
//
//   find_block_bins          the bins of each block of pixels
//   find_window_bins         the bins of each window of blocks, which holds all fragments of a tile moved by a shift
//   find_square_window_bins  the same for a square of tiles
//   find_block_occluders     the bins of the first layer in each block, if it occludes all others there
//   find_window_occluders    the same for each window
//   find_square_bins         the bins that may be visible in each square of tiles, for each turn and view
//   find_groups              of those, the groups of bins that may be visible in each tile, for each turn and view
//   sort_views               the order of the views of each tile and turn: those in which an occluder covers the tile come first

fn blocks_size() -> vec2u {
    return (vec2u(params.width, params.source_rows) + (BLOCK - 1u)) / BLOCK;
}

// The bits of the bins first .. end of one word.
fn bits_of(first: u32, end: u32) -> u32 {
    return (0xffffffffu << (first & 31u)) & (0xffffffffu >> (31u - ((end - 1u) & 31u)));
}

// The bins of `key` that lie in word `word`, one bit each.
fn bins_of(key: u32, word: u32) -> u32 {
    let first = max(key >> BIN_SHIFT, 32u * word);
    let last = min(last_bin(key), 32u * word + 31u);
    return select(bits_of(first, last + 1u), 0u, key == NO_KEY || first > last);
}

@compute @workgroup_size(8, 8)
fn find_block_bins(@builtin(global_invocation_id) at: vec3u) {
    let size = blocks_size();
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let end = min(BLOCK * (at.xy + 1u), vec2u(params.width, params.source_rows));
    var bits = 0u;
    for (var slice = 0u; 4u * slice < params.layers; slice++) {
        for (var y = BLOCK * at.y; y < end.y; y++) {
            for (var x = BLOCK * at.x; x < end.x; x++) {
                let key = keys_at(vec2u(x, y), slice);
                bits |= bins_of(key.x, at.z) | bins_of(key.y, at.z);
                bits |= bins_of(key.z, at.z) | bins_of(key.w, at.z);
            }
        }
    }
    block_bins[(at.z * size.y + at.y) * size.x + at.x] = bits;
}

@compute @workgroup_size(8, 8)
fn find_window_bins(@builtin(global_invocation_id) at: vec3u) {
    let size = blocks_size();
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let end = min(at.xy + WINDOW, size);
    var bits = 0u;
    for (var y = at.y; y < end.y; y++) {
        for (var x = at.x; x < end.x; x++) {
            bits |= block_bins[(at.z * size.y + y) * size.x + x];
        }
    }
    window_bins[(at.z * size.y + at.y) * size.x + at.x] = bits;
}

@compute @workgroup_size(8, 8)
fn find_square_window_bins(@builtin(global_invocation_id) at: vec3u) {
    let size = blocks_size();
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let step = TILE / BLOCK;
    let end = min(at.xy + SQUARE * step, size);
    var bits = 0u;
    for (var y = at.y; y < end.y; y += step) {
        for (var x = at.x; x < end.x; x += step) {
            bits |= window_bins[(at.z * size.y + y) * size.x + x];
        }
    }
    square_window_bins[(at.z * size.y + at.y) * size.x + at.x] = bits;
}

// The smallest and largest first bin of the first layer, if at each sample it is opaque and no other layer begins in a nearer
// bin: a group with all of these bins occludes every ray there. Otherwise `last` lies past all bins.
struct Occluder {
    first: u32,
    last: u32,
}

// Lies past all bins; the first bin of NO_KEY.
const NO_BIN = 0xffffu;

fn packed_occluder(occluder: Occluder) -> u32 {
    return occluder.first | (occluder.last << 16u);
}

fn unpacked_occluder(word: u32) -> Occluder {
    return Occluder(word & 0xffffu, word >> 16u);
}

// The occluder of two regions together.
fn merged(a: Occluder, b: Occluder) -> Occluder {
    return Occluder(min(a.first, b.first), max(a.last, b.last));
}

// The first layer at `source`.
fn occluder_at(source: vec2u) -> Occluder {
    let own = keys_at(source, 0u);
    var others = min(own.y, min(own.z, own.w));
    for (var slice = 1u; 4u * slice < params.layers; slice++) {
        let deeper = keys_at(source, slice);
        others = min(others, min(min(deeper.x, deeper.y), min(deeper.z, deeper.w)));
    }
    let first = own.x >> BIN_SHIFT;
    let occludes = own.x != NO_KEY && (own.x & OPAQUE) != 0u && (others >> BIN_SHIFT) >= first;
    return Occluder(first, select(NO_BIN, first, occludes));
}

@compute @workgroup_size(8, 8)
fn find_block_occluders(@builtin(global_invocation_id) at: vec3u) {
    let size = blocks_size();
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let end = min(BLOCK * (at.xy + 1u), vec2u(params.width, params.source_rows));
    var occluder = Occluder(NO_BIN, 0u);
    for (var y = BLOCK * at.y; y < end.y; y++) {
        for (var x = BLOCK * at.x; x < end.x; x++) {
            occluder = merged(occluder, occluder_at(vec2u(x, y)));
        }
    }
    block_occluders[at.y * size.x + at.x] = packed_occluder(occluder);
}

@compute @workgroup_size(8, 8)
fn find_window_occluders(@builtin(global_invocation_id) at: vec3u) {
    let size = blocks_size();
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let end = min(at.xy + WINDOW, size);
    var occluder = Occluder(NO_BIN, 0u);
    for (var y = at.y; y < end.y; y++) {
        for (var x = at.x; x < end.x; x++) {
            occluder = merged(occluder, unpacked_occluder(block_occluders[y * size.x + x]));
        }
    }
    window_occluders[at.y * size.x + at.x] = packed_occluder(occluder);
}

// The sample at `pixel` of the band moved by `shift`; past the border the border's sample.
fn source_of(pixel: vec2u, shift: vec2i) -> vec2u {
    let position = vec2i(pixel) + vec2i(0, i32(params.band_start)) + shift;
    let inside = clamp(position, vec2i(0), vec2i(vec2u(params.width, params.height)) - 1);
    return vec2u(u32(inside.x), min(u32(inside.y) - params.source_start, params.source_rows - 1u));
}

fn tiles_size() -> vec2u {
    return (vec2u(params.width, params.band_rows) + (TILE - 1u)) / TILE;
}

// Columns and rows of a shift, 16 bits each.
fn unpacked_shift(word: u32) -> vec2i {
    return vec2i(i32(word << 16u) >> 16u, i32(word) >> 16u);
}

// The neighbouring bins first .. end, which a view moves by the same shift: all that it does, whether visible or not.
struct Group {
    first: u32,
    end: u32,
    shift: u32,
}

// Bits of an entry: its first bin and its end, and flags: the last entry of its list, and a first entry in which the first layer
// covers the tile and occludes every ray. Such an entry has the bin whose focus counts in place of first bin and end.
const END_SHIFT = 13u;
const BIN_MASK = 0x1fffu;
const LAST = 0x4000000u;
const COVERED = 0x8000000u;

fn packed(group: Group) -> vec2u {
    return vec2u(group.shift, group.first | (group.end << END_SHIFT));
}

fn unpacked(entry: vec2u) -> Group {
    return Group(entry.y & BIN_MASK, (entry.y >> END_SHIFT) & BIN_MASK, entry.x);
}

// The group of `bin` in view `at` in the order [turn][view].
fn group_of(at: u32, bin: u32) -> Group {
    let entry = shifts[at * params.bins + bin];
    return Group(entry.y & 0xffffu, entry.y >> 16u, entry.x);
}

// Index of the window of the tile or square that begins at pixel `corner`, moved by `shift`.
fn window_of(corner: vec2u, shift: u32) -> u32 {
    let block = source_of(corner, unpacked_shift(shift)) / BLOCK;
    return block.y * blocks_size().x + block.x;
}

// Index of the word of `window` that has `bin`.
fn word_of(window: u32, bin: u32) -> u32 {
    let size = blocks_size();
    return (bin >> 5u) * size.x * size.y + window;
}

// Whether the first layer, which is `occluder`, occludes every ray in `group`, and counts as in focus, and as near, alike everywhere.
fn is_covered(group: Group, occluder: Occluder) -> bool {
    if occluder.first < group.first || occluder.last >= group.end {
        return false;
    }
    let first = middle_of(occluder.first, group);
    let last = middle_of(occluder.last, group);
    let is_near = NEAR && first < params.near_end;
    return first == last || (!is_near && (last < params.focused_start || first >= params.focused_end));
}

fn squares_size() -> vec2u {
    return (tiles_size() + (SQUARE - 1u)) / SQUARE;
}

// Number of views in all turns.
fn all_views() -> u32 {
    return params.turns * params.batch_views;
}

@compute @workgroup_size(64)
fn find_square_bins(@builtin(global_invocation_id) at: vec3u) {
    let squares = squares_size();
    if at.x >= squares.x {
        return;
    }
    let corner = SQUARE * TILE * at.xy;
    let bins = ((at.y * squares.x + at.x) * all_views() + at.z) * params.words;
    for (var word = 0u; word < params.words; word++) {
        let end = min(params.bins, 32u * (word + 1u));
        var bits = 0u;
        var bin = 32u * word;
        while bin < end {
            let group = group_of(at.z, bin);
            let group_end = min(group.end, end);
            let window = window_of(corner, group.shift);
            bits |= square_window_bins[word_of(window, bin)] & bits_of(bin, group_end);
            bin = group_end;
        }
        square_bins[bins + word] = bits;
    }
}

@compute @workgroup_size(64)
fn find_groups(@builtin(global_invocation_id) at: vec3u) {
    let tiles = tiles_size();
    if at.x >= tiles.x {
        return;
    }
    let square = at.y / SQUARE * squares_size().x + at.x / SQUARE;
    let bins = (square * all_views() + at.z) * params.words;
    let list = ((at.y * tiles.x + at.x) * all_views() + at.z) * params.entries;
    // The list of a tile without fragments has one group, without bins.
    var group = Group(BIN_MASK, BIN_MASK, 0u);
    var occluder = Occluder(NO_BIN, NO_BIN);
    var covered = false;
    var count = 1u;
    var word = 0u;
    var bits = square_bins[bins];
    loop {
        if bits == 0u {
            word++;
            if word == params.words {
                break;
            }
            bits = square_bins[bins + word];
            continue;
        }
        let bin = 32u * word + firstTrailingBit(bits);
        let next = group_of(at.z, bin);
        let of_next = bits_of(bin, min(next.end, 32u * (word + 1u)));
        bits &= ~of_next;
        if next.first == group.first {
            continue;
        }
        let window = window_of(TILE * at.xy, next.shift);
        if (window_bins[word_of(window, bin)] & of_next) == 0u {
            continue;
        }
        if group.first != BIN_MASK {
            if count < params.entries {
                groups[list + count - 1u] = packed(group);
            }
            count++;
        }
        group = next;
        occluder = unpacked_occluder(window_occluders[window]);
        covered = is_covered(group, occluder);
        if covered {
            break;
        }
    }
    if count <= params.entries {
        var last = packed(group);
        if covered && count == 1u {
            let is_near = NEAR && occluder.first < params.near_end;
            let middle = select(middle_of(occluder.first, group), near_middle_of(occluder.first, group), is_near);
            last.y = middle | COVERED;
        }
        groups[list + count - 1u] = last | vec2u(0u, LAST);
    }
    atomicMax(&longest_list, count);
}

@compute @workgroup_size(64)
fn sort_views(@builtin(global_invocation_id) at: vec3u) {
    let tiles = tiles_size();
    if at.x >= tiles.x {
        return;
    }
    let index = tile_turn(at.xy, at.z);
    let views = index * params.batch_views;
    var first = 0u;
    var end = params.batch_views;
    for (var view = 0u; view < params.batch_views; view++) {
        let head = groups[(views + view) * params.entries];
        let is_covered = (head.y & COVERED) != 0u;
        end -= select(1u, 0u, is_covered);
        let focus = select(0u, (head.y & BIN_MASK) << FOCUS_SHIFT, is_covered);
        ordered_views[views + select(end, first, is_covered)] = vec2u(head.x, view | focus);
        first += select(0u, 1u, is_covered);
    }
    covered_views[index] = first;
}
